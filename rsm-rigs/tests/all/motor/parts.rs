//! Circle diagram, inverter, modulation, encoder, machine.

use std::f64::consts::{PI, TAU};

use rsm_rigs::motor::circle_diagram::CircleDiagram;
use rsm_rigs::motor::closed_loop::Drive;
use rsm_rigs::motor::controller::Known;
use rsm_rigs::motor::current_loop::modulate;
use rsm_rigs::motor::encoder::{Encoder, Settings};
use rsm_rigs::motor::inverter::Inverter;
use rsm_rigs::motor::machine::Machine;
use rsm_rigs::motor::park::{Angle, from_phases, to_phases};

use super::motor;

fn known() -> Known {
    Drive::default().known(&motor())
}

/// v_d^2 + v_q^2 in steady state, straight from (17), (18).
fn voltage(known: &Known, i_d: f64, i_q: f64, speed: f64) -> f64 {
    let w_e = known.pole_pairs * speed;
    let v_d = known.resistance * i_d - w_e * known.inductance * i_q;
    let v_q = known.resistance * i_q + w_e * (known.inductance * i_d + known.flux_linkage);
    v_d.hypot(v_q)
}

#[test]
fn the_circle_diagram_agrees_with_a_search_over_all_currents() {
    let known = known();
    let diagram = CircleDiagram::new(known);
    let (limit, allowed) = (known.current_limit, known.reference_voltage(known.bus_voltage));
    let step = 0.1;
    let across = (limit / step) as i32;
    for (torque, speed) in [
        (10.0, 300.0),
        (21.6, 480.0),
        (12.0, 650.0),
        (-12.0, 650.0),
        (0.5, 700.0),
        (21.6, 780.0),
        (-21.6, 780.0),
        (21.6, 1500.0),
    ] {
        let found = diagram.solve(torque, speed, allowed);
        // Everything on a grid that both limits (20) allow: the i_q nearest to the demand first, then the smallest |i_d|.
        let wanted = torque / known.torque_constant();
        let mut best = (f64::INFINITY, f64::INFINITY, 0.0);
        for q in -across..=across {
            for d in 0..=across {
                let (i_d, i_q) = (-f64::from(d) * step, f64::from(q) * step);
                if i_d.hypot(i_q) <= limit && voltage(&known, i_d, i_q, speed) <= allowed {
                    let missing = (i_q - wanted).abs();
                    // The grid's own step decides between neighbours in i_q.
                    if missing < best.0 - 1e-9 || (missing < best.0 + 1e-9 && -i_d < best.1) {
                        best = (missing, -i_d, i_q);
                    }
                }
            }
        }
        // A grid point lies within a step in i_q of the best; at the limits the boundary's slope d i_d/d i_q, up to 10 here, makes more of it in i_d.
        // So i_q is compared by the step, i_d by that of the solution at the grid's own i_q.
        assert!((found.i_q_a - best.2).abs() <= 1.5 * step, "{torque} at {speed}: {found:?} {best:?}");
        let same = diagram.solve(best.2 * known.torque_constant(), speed, allowed);
        assert!((same.i_d_a + best.1).abs() <= 1.01 * step, "{torque} at {speed}: {same:?} {best:?}");
        assert!(voltage(&known, found.i_d_a, found.i_q_a, speed) <= allowed * (1.0 + 1e-12));
        assert!(found.i_d_a.hypot(found.i_q_a) <= limit * (1.0 + 1e-12));
    }
}

#[test]
fn backwards_is_forwards_in_a_mirror() {
    let diagram = CircleDiagram::new(known());
    for (torque, speed) in [(5.0, 700.0), (-5.0, 700.0), (21.6, 780.0), (-21.6, 780.0)] {
        let (one, other) = (diagram.solve(torque, speed, 148.0), diagram.solve(-torque, -speed, 148.0));
        assert!(one.i_d_a == other.i_d_a && one.i_q_a == -other.i_q_a && one.i_d_a < 0.0);
        // Against the speed the resistive drop helps: braking needs less weakening.
        let braking = diagram.solve(-torque.abs(), speed, 148.0);
        assert!(braking.i_d_a > diagram.solve(torque.abs(), speed, 148.0).i_d_a);
    }
}

#[test]
fn edges_have_the_average_of_the_averaged_inverter() {
    let inverter = Inverter { period: 1e-4, dead_time: 2e-6, bus_voltage: 300.0 };
    // Currents into and out of the motor, a leg that does not switch, a pulse shorter than the dead time, one that is cut at the period's end.
    for duties in [[0.5, 0.3, 0.8], [0.0, 1.0, 0.4], [0.01, 0.5, 0.999], [0.95, 0.05, 0.5]] {
        for currents in [[5.0, -3.0, -2.0], [-5.0, 3.0, 2.0], [0.0, 1.0, -1.0]] {
            let mut edges = inverter.edges(duties);
            let (mut sum, mut spans) = ([0.0; 2], 0.0);
            while let Some((span, voltage)) = edges.next(currents) {
                assert!(span >= 0.0);
                spans += span;
                sum = [sum[0] + span * voltage[0], sum[1] + span * voltage[1]];
            }
            assert!((spans - inverter.period).abs() < 1e-18, "{spans}");
            // With duty 0.999 and current out of the motor the lower switch closes 1.95 us after the period's end: what is cut off is counted here.
            let cut = if duties[2] == 0.999 && currents[2] < 0.0 { 0.02 - 0.0005 - 0.0005 } else { 0.0 };
            let effective = [duties[0], duties[1], duties[2]];
            let average = inverter.average(effective, currents);
            let expected = from_phases(to_phases(average));
            for k in 0..2 {
                let found = sum[k] / inverter.period;
                assert!((found - expected[k]).abs() < 1e-9 + 300.0 * cut, "{duties:?} {currents:?}: {found} {}", expected[k]);
            }
        }
    }
}

#[test]
fn dead_time_takes_the_fundamental_of_a_square_wave() {
    let inverter = Inverter { period: 1e-4, dead_time: 2e-6, bus_voltage: 300.0 };
    // Currents along the d axis: each phase loses V_dc t_d/T = 6 V with the sign of its current. The fundamental of a square wave of height 1 is
    // 4/pi.
    let steps = 36_000;
    let mut lost = [0.0; 2];
    for k in 0..steps {
        let angle = Angle::new(TAU * (f64::from(k) + 0.5) / f64::from(steps));
        let wanted = angle.to_stator([40.0, 25.0]);
        let duties = modulate(to_phases(wanted), inverter.bus_voltage);
        let got = angle.to_rotor(inverter.average(duties, to_phases(angle.to_stator([10.0, 0.0]))));
        lost = [lost[0] + (40.0 - got[0]) / f64::from(steps), lost[1] + (25.0 - got[1]) / f64::from(steps)];
    }
    // 36,000 midpoints of a piecewise smooth function with six jumps: errors of 1/36,000 of a jump each.
    assert!((lost[0] - 6.0 * 4.0 / PI).abs() < 1e-3 && lost[1].abs() < 1e-3, "{lost:?}");
}

#[test]
fn modulation_reaches_the_whole_circle_of_the_bus() {
    // V_dc/sqrt 3 at every angle: no duty is cut, and the mean voltage is what was asked for.
    let bus = 270.0;
    let inverter = Inverter { period: 1e-4, dead_time: 0.0, bus_voltage: bus };
    let (mut low, mut high) = (1.0f64, 0.0f64);
    for k in 0..360 {
        let asked = Angle::new(f64::from(k).to_radians()).to_stator([bus / 3f64.sqrt(), 0.0]);
        let duties = modulate(to_phases(asked), bus);
        let got = inverter.average(duties, [0.0; 3]);
        assert!((got[0] - asked[0]).abs() < 1e-11 && (got[1] - asked[1]).abs() < 1e-11, "{k}");
        low = duties.into_iter().fold(low, f64::min);
        high = duties.into_iter().fold(high, f64::max);
    }
    // The circle touches the hexagon at 30 degrees and so on: there the duties span all of 0 to 1.
    assert!(low < 1e-12 && high > 1.0 - 1e-12, "{low} {high}");
}

#[test]
fn a_coarse_encoder_measures_a_steady_speed_exactly_and_the_angle_within_a_count() {
    let (period, speed) = (1e-4, 37.0);
    let count = TAU / 256.0;
    for (interpolated, allowed) in [(true, 0.02), (false, 0.51)] {
        let mut encoder = Encoder::new(Settings { interpolated, ..Settings::COARSE }, period, 0.0, 0.0);
        let mut worst: f64 = 0.0;
        for k in 0..5000 {
            let end = f64::from(k + 1) * period;
            let reading = encoder.read(f64::from(k) * period, speed * end, speed);
            if k > 1000 {
                // Twenty time constants of the filter have passed; the edges are placed to the last digits.
                assert!((reading.speed - speed).abs() < 1e-6, "{}", reading.speed);
                worst = worst.max((reading.angle - speed * end).abs() / count);
            }
        }
        // Without interpolation the middle of the count is half a count off at its ends.
        assert!(worst < allowed, "{worst} counts");
    }
    // When the rotor stops the reading cannot stay: 0.3 s after the last edge at most count/0.3 s is left.
    let mut encoder = Encoder::new(Settings::COARSE, period, 0.0, 0.0);
    for k in 0..5000 {
        let angle = speed * (f64::from(k + 1) * period).min(0.2);
        encoder.read(f64::from(k) * period, angle, 0.0);
    }
    assert!(encoder.reading().speed.abs() < 1.2 * count / 0.3, "{:?}", encoder.reading());
}

#[test]
fn the_machine_keeps_the_books_of_energy() {
    let plant = motor();
    let of = |name| plant.parameters.number(name);
    let (r, l, j, b) = (of("phase_resistance"), of("phase_inductance"), of("inertia"), of("viscous_friction"));
    let mut machine = Machine::new(&plant, 0.0, 50.0).unwrap();
    let stored = |m: &Machine| {
        let t = m.truth();
        0.75 * l * (t.i_d * t.i_d + t.i_q * t.i_q) + 0.5 * j * t.speed * t.speed
    };
    let (before, step, load) = (stored(&machine), 1e-6, 3.0);
    let (mut supplied, mut used) = (0.0, 0.0);
    for _ in 0..50_000 {
        let voltage = Angle::new(4.0 * machine.truth().angle).to_stator([-4.0, 25.0]);
        let at = |m: &Machine| {
            let t = m.truth();
            let [v_d, v_q] = Angle::new(4.0 * t.angle).to_rotor(voltage);
            let copper = 1.5 * r * (t.i_d * t.i_d + t.i_q * t.i_q);
            (1.5 * (v_d * t.i_d + v_q * t.i_q), copper + b * t.speed * t.speed + load * t.speed)
        };
        let one = at(&machine);
        machine.advance(voltage, load, step);
        let other = at(&machine);
        supplied += 0.5 * step * (one.0 + other.0);
        used += 0.5 * step * (one.1 + other.1);
    }
    let balance = supplied - used - (stored(&machine) - before);
    // Trapezoids of 1 us over what turns with up to 400 rad/s: (400e-6)^2/12 of some tens of joules.
    assert!(balance.abs() < 1e-5 && supplied > 10.0, "{balance} J of {supplied} J");
}

#[test]
fn a_motor_with_an_effect_without_size_moves_as_without_it() {
    let plain = crate::plant("pmac", "");
    let with = crate::plant("pmac", &crate::effect("constant-load", "torque = 0.0"));
    let [plain, with] = [plain, with].map(|file| {
        let mut machine = Machine::new(&file, 1e-4, 300.0).unwrap();
        for k in 0..400 {
            let angle = 4.0 * machine.truth().angle;
            let [v_d, v_q] = [-5.0, 90.0 + 10.0 * f64::from(k % 7)];
            let (sin, cos) = angle.sin_cos();
            machine.advance([cos * v_d - sin * v_q, sin * v_d + cos * v_q], 0.5, 1e-4);
        }
        machine.truth()
    });
    // Both integrate with errors of less than 4e-5 of what moves; the speeds, the slowest part, agree better.
    assert!((plain.speed - with.speed).abs() < 1e-4 * plain.speed.abs(), "{plain:?} {with:?}");
    for (a, b) in [(plain.i_d, with.i_d), (plain.i_q, with.i_q)] {
        assert!((a - b).abs() < 1e-3 * (plain.i_d.hypot(plain.i_q)), "{plain:?} {with:?}");
    }
    assert!(plain.i_d.hypot(plain.i_q) > 10.0, "{plain:?}");
}

#[test]
fn the_frame_of_the_sensors_is_turned_by_what_an_effect_puts_on_the_angle() {
    let turned = crate::plant("pmac", &crate::effect("angle-offset", "angle = 0.1"));
    let mut machine = Machine::new(&turned, 0.0, 300.0).unwrap();
    let voltage = [30.0, 20.0];
    machine.advance(voltage, 0.0, 5e-4);
    let truth = machine.truth();
    let off = machine.sensed_angle() - 4.0 * truth.angle;
    assert!((off - 0.1).abs() < 1e-9, "{off}");
    // A reading is the current in the turned frame.
    let [i_d, i_q, _] = machine.readings();
    let (sin, cos) = 0.1_f64.sin_cos();
    assert!((i_d - (cos * truth.i_d + sin * truth.i_q)).abs() < 1e-9 * i_d.hypot(i_q));
    assert!((i_q - (cos * truth.i_q - sin * truth.i_d)).abs() < 1e-9 * i_d.hypot(i_q));
    // A voltage of the stator acts the same, however the sensors are turned.
    let mut straight = Machine::new(&crate::plant("pmac", ""), 0.0, 300.0).unwrap();
    straight.advance(voltage, 0.0, 5e-4);
    assert!((straight.truth().i_q - truth.i_q).abs() < 1e-3 * i_d.hypot(i_q), "{:?} {truth:?}", straight.truth());
}

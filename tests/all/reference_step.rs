//! `rsm check --limits` proves the step of `rsm-rigs/src/motor/limits/step.rs`. The tests show that it gives the bits of the step that runs,
//! `motor_loop::references`, and that the proof's box contains the operating points that the drive accepts.
//!
//! The copy does not check samples and has no state: its inputs are the values that the target's step used, which are in the target's state after the
//! tick.

use std::collections::BTreeMap;

use motor_loop::{
    BadSamples, Demand, Drive, FOLD_SPEED_RAD_S, LARGEST_TORQUE_NM, Motor, ReferenceState, References, SLOWEST_RAD_S,
    TRIM_FROM, Tuning, references,
};
use rsm_core::check::Checked;
use rsm_core::source::Source;
use rsm_rigs::motor::limits::range::Range;
use rsm_rigs::motor::limits::step::{Constants, Step, Tapes};
use rsm_rigs::motor::limits::{self, Operation, Verdict};
use rsm_sim::plant_file::{Parameters, PlantFile};
use rsm_tests::cases;

fn parameters() -> Parameters {
    let source = Source::read(&cases::root().join("rsm-sim/plants/pmac.toml")).unwrap_or_else(|faults| panic!("{faults}"));
    PlantFile::read(&source).unwrap_or_else(|faults| panic!("{faults}")).effective_parameters()
}

fn model() -> Checked {
    let source =
        Source::read(&cases::root().join("generated/coefficients/motor.toml")).unwrap_or_else(|faults| panic!("{faults}"));
    Checked::read(&source).unwrap_or_else(|faults| panic!("{faults}"))
}

/// The target's constants for these parameters. The current control is not part of the outer step, so any tuning can be used.
fn drive(parameters: &Parameters) -> Drive {
    let number = |name: &str| parameters.number(name) as f32;
    let motor = Motor {
        phase_resistance_ohm: number("phase_resistance"),
        phase_inductance_h: number("phase_inductance"),
        flux_linkage_wb: number("flux_linkage"),
        pole_pairs: number("pole_pairs"),
        bus_voltage_v: number("bus_voltage"),
        current_limit_a: number("current_limit"),
    };
    Drive::new(&motor, &Tuning { pwm_period_s: 1e-4, bandwidth_rad_s: 1500.0, dead_time_s: 1e-6, dead_time_current_a: 1.0 })
}

/// A linear congruential generator (Knuth's MMIX).
struct Draw(u64);

impl Draw {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        self.0 >> 11
    }

    fn between(&mut self, low: f32, high: f32) -> f32 {
        let share = self.bits() as f64 / (1u64 << 53) as f64;
        (f64::from(low) + (f64::from(high) - f64::from(low)) * share) as f32
    }

    /// One of these, or its neighbours in f32.
    fn near(&mut self, values: &[f32]) -> f32 {
        let value = values[self.bits() as usize % values.len()];
        [value, value.next_up(), value.next_down()][self.bits() as usize % 3]
    }
}

/// A point where three of four numbers are random in their range, and one is at an edge: of the plausible range, of the surfaces' speeds, of a sign.
fn sample(drive: &Drive, draw: &mut Draw) -> Demand {
    let limits = &drive.limits;
    let (speed, bus) = (limits.speed_rad_s, limits.bus_v);
    let (low, high) = (bus.middle - bus.half, bus.middle + bus.half);
    let at_edge: [bool; 4] = std::array::from_fn(|_| draw.bits().is_multiple_of(4));
    let bus_voltage_v = if at_edge[0] { draw.near(&[low, high, drive.nominal_bus_v]) } else { draw.between(low, high) };
    // At this speed the surfaces end on this bus.
    let end = FOLD_SPEED_RAD_S * bus_voltage_v / drive.nominal_bus_v;
    let speed_rad_s =
        if at_edge[1] { draw.near(&[0.0, end, -end, speed, -speed, FOLD_SPEED_RAD_S]) } else { draw.between(-speed, speed) };
    let all = limits.torque_nm;
    let torque_nm = if at_edge[2] { draw.near(&[0.0, all, -all, 0.5 * all, -0.5 * all]) } else { draw.between(-all, all) };
    let voltage_share = if at_edge[3] { draw.near(&[0.0, 0.96, 1.2, 1e6, f32::NAN]) } else { draw.between(0.5, 1.5) };
    Demand { torque_nm, speed_rad_s, bus_voltage_v, voltage_share }
}

/// A state with any references and any trim; bus voltage and speed are fresh, so that the first sample in the range has the full weight.
fn state(drive: &Drive, draw: &mut Draw) -> ReferenceState {
    let limit = drive.current_limit_a;
    let last = References {
        i_d_a: 0.0,
        i_q_a: if draw.bits().is_multiple_of(4) { draw.near(&[0.0, limit, -limit]) } else { draw.between(-limit, limit) },
    };
    let trim_a = if draw.bits().is_multiple_of(2) { draw.near(&[0.0, limit]).max(0.0) } else { draw.between(0.0, limit) };
    let in_a_row = [0, 9, 10][draw.bits() as usize % 3] * u32::from(draw.bits().is_multiple_of(8));
    ReferenceState { last, trim_a, bad: BadSamples { all: in_a_row, in_a_row }, ..ReferenceState::default() }
}

/// -0 and 0 are the same current.
fn bits(value: f32) -> u32 {
    (value + 0.0).to_bits()
}

/// One tick of both. Returns the kind of the tick, for the counts.
fn compare(step: &mut Step<'_>, drive: &Drive, state: &mut ReferenceState, demand: &Demand) -> Result<[bool; 4], String> {
    let before = state.clone();
    let found = references(state, drive, demand);
    let mirror = if state.speed_rad_s < 0.0 { -1.0 } else { 1.0 };
    let coast = before.bad.in_a_row >= drive.limits.bad_in_a_row;
    let torque = if coast { 0.0 } else { mirror * state.torque_nm };
    let last_torque = drive.newton_metres_per_ampere * (mirror * before.last.i_q_a);
    let circle_speed = step.circle_speed(Range::point(state.speed_rad_s.abs()), Range::point(state.bus_voltage_v));
    let wanted = step.wanted(Range::point(torque), Range::point(last_torque), circle_speed);
    let own = step.currents(wanted, circle_speed, Range::point(state.trim_a));
    for (name, target, own) in [("i_d", found.i_d_a, own.i_d), ("i_q", mirror * found.i_q_a, own.i_q)] {
        let all = [target, own.low, own.high].map(bits);
        if all != [all[0]; 3] {
            return Err(format!("{name}: {target:?} of the target, {own:?} of the copy; {demand:?} after {before:?}"));
        }
    }
    Ok([circle_speed.low > FOLD_SPEED_RAD_S, mirror < 0.0, state.trim_a > 0.0, coast])
}

/// How often each kind occurred, by tick, over many starts; or the first difference.
fn compare_all(step: &mut Step<'_>, drive: &Drive) -> Result<BTreeMap<(usize, usize), usize>, String> {
    let bus = drive.limits.bus_v;
    let mut draw = Draw(12);
    let mut kinds = BTreeMap::new();
    for _ in 0..6000 {
        let mut state = state(drive, &mut draw);
        // The first tick takes the samples whole; in those that follow, bus and speed come from a lag and a bad sample leaves them as they were.
        for tick in 0..4 {
            let demand = sample(drive, &mut draw);
            let in_band = (demand.bus_voltage_v - bus.middle).abs() < bus.half;
            // Without a good sample of the bus there is nothing to divide by, and the target takes the lowest bus: no point of the proof.
            if state.bus_voltage_v == 0.0 && !in_band {
                break;
            }
            for (kind, is) in compare(step, drive, &mut state, &demand)?.into_iter().enumerate() {
                *kinds.entry((tick, kind)).or_insert(0) += usize::from(is);
            }
        }
    }
    Ok(kinds)
}

#[test]
fn the_step_that_is_proved_has_the_bits_of_the_step_that_runs() {
    let parameters = parameters();
    let (drive, tapes) = (drive(&parameters), Tapes::new(&model()).unwrap_or_else(|faults| panic!("{faults}")));
    let mut step = Step::new(Constants::new(&parameters), &tapes);
    let kinds = compare_all(&mut step, &drive).unwrap_or_else(|difference| panic!("{difference}"));
    // Beyond the surfaces, backwards, trimmed and coasting: each occurs in the first tick and later.
    assert_eq!(kinds.len(), 16);
    assert!(kinds.values().all(|count| *count > 50), "{kinds:?}");
    // The points detect an error of the last bit of a constant.
    let off: [fn(&mut Constants) -> &mut f32; 6] = [
        |it| &mut it.newton_metres_per_ampere,
        |it| &mut it.amperes_per_newton_metre,
        |it| &mut it.current_limit_a,
        |it| &mut it.per_ampere,
        |it| &mut it.nominal_bus_v,
        |it| &mut it.weakening_per_speed,
    ];
    for (number, constant) in off.into_iter().enumerate() {
        let mut step = Step::new(Constants::new(&parameters), &tapes);
        let value = constant(&mut step.constants);
        *value = value.next_up();
        assert!(compare_all(&mut step, &drive).is_err(), "constant {number} may be off by a bit");
    }
}

/// From this bus voltage on the voltage limit is proved, in V; the drive takes samples down to 150 V, so that a noise of 5 % at 180 V is not bad.
const PROVED_FROM_V: f32 = 155.0;

#[test]
fn the_proof_covers_what_the_drive_takes_for_plausible() {
    let parameters = parameters();
    let (drive, model) = (drive(&parameters), model());
    let limits = &drive.limits;
    let [lowest, highest] = [limits.bus_v.middle - limits.bus_v.half, limits.bus_v.middle + limits.bus_v.half];
    assert!(lowest < PROVED_FROM_V);
    let prove = |from: f32| {
        // The trim of the target ends at the current limit.
        let operation =
            Operation { top_speed_rad_s: limits.speed_rad_s, bus_voltage_v: [from, highest], trim_a: drive.current_limit_a };
        limits::prove(&model, &parameters, &operation, limits::WORK).unwrap_or_else(|faults| panic!("{faults}"))
    };
    let found = prove(PROVED_FROM_V);
    assert_eq!(found.verdict, Verdict::Proved, "{found:?}");

    // Below, the voltage of the references may be a little beyond the limit where nothing is trimmed yet: at most 0.3 %. The current limit holds.
    let found = prove(lowest);
    assert!(found.voltage.at_most < 1.003 && found.current.at_most <= 1.0, "{found:?}");
    let Verdict::VoltageExceeded(point) = found.verdict else { panic!("{found:?}") };
    assert!(point.bus_voltage_v < PROVED_FROM_V, "{point:?}");
    // The step that runs gives these references.
    let last = References { i_d_a: 0.0, i_q_a: point.last_torque_nm / drive.newton_metres_per_ampere };
    let mut state = ReferenceState { last, trim_a: point.trim_a, ..ReferenceState::default() };
    let demand = Demand {
        torque_nm: point.torque_nm,
        speed_rad_s: point.speed_rad_s,
        bus_voltage_v: point.bus_voltage_v,
        voltage_share: TRIM_FROM,
    };
    let given = references(&mut state, &drive, &demand);
    assert_eq!([given.i_d_a, given.i_q_a], [point.i_d_a, point.i_q_a], "{point:?}");
}

/// The surfaces are evaluated without clamps: the step's own limits keep the arguments in the ranges of the model.
#[test]
fn the_step_keeps_to_the_ranges_of_the_surfaces() {
    let range = |name: &str| {
        let model = model();
        let input = model.model().inputs.iter().find(|input| input.name == name).expect("an input");
        input.range.map(|bound| bound as f32)
    };
    assert_eq!(range("torque"), [-LARGEST_TORQUE_NM, LARGEST_TORQUE_NM]);
    let [slowest, fastest] = range("speed");
    assert!(slowest == SLOWEST_RAD_S && FOLD_SPEED_RAD_S <= fastest);
    // The torque is k_t times at most sqrt(0.9996) of the current limit, also of a motor with more torque than the surfaces have.
    let nominal = parameters();
    let drive = drive(&nominal);
    assert_eq!(drive.newton_metres_per_ampere, 1.5 * 4.0 * 0.06);
    for (flux_linkage_wb, current_limit_a) in [(0.06, 60.0), (0.06, 75.0), (0.5, 60.0), (1e-3, 1e-3), (0.3, 3.0)] {
        let motor = Motor {
            phase_resistance_ohm: 0.08,
            phase_inductance_h: 0.9e-3,
            flux_linkage_wb,
            pole_pairs: 4.0,
            bus_voltage_v: 270.0,
            current_limit_a,
        };
        let tuning = Tuning { pwm_period_s: 1e-4, bandwidth_rad_s: 1500.0, dead_time_s: 0.0, dead_time_current_a: 1.0 };
        let drive = Drive::new(&motor, &tuning);
        // Two roundings of the product at most, 6e-8 each: far less than the 2e-4 that the circle holds back.
        let torque = drive.newton_metres_per_ampere * (drive.current_limit_a * 0.9998);
        assert!(
            drive.current_limit_a == current_limit_a && torque <= LARGEST_TORQUE_NM,
            "{flux_linkage_wb} {current_limit_a}: {torque}"
        );
    }
}

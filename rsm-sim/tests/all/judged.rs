//! Every text of the tests and every shipped text along a record, compared with solutions that share no code with the compiler and the engine.
//!
//! The rates are written here by hand from the physics of each plant; sorting, elimination and index reduction are done on paper. `ode_solvers`
//! integrates them (Dormand and Prince, order 8), or a closed form is used. The instants at which a law changes are found by bisection. Inputs are
//! constant from row to row. Three plants are also compared with SciPy, if this machine has it.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use ode_solvers::dop_shared::OutputType;
use ode_solvers::{Dop853, SVector, System};
use rsm_core::source::{Fault, Faults, Source};
use rsm_sim::equations::{EquationFile, Machine, Method, Setting, Signals};

#[path = "../../../tests/src/skipped.rs"]
mod skipped;

/// The permitted difference between the engine and the reference, as a share of the largest value of the signal. Both have an error of 1e-12 per
/// step, and in none of these plants do errors grow.
const AGREE: f64 = 1e-8;

/// The tolerance of the engine.
const TIGHT: Setting = Setting::new(Method::Explicit, 1e-12);

/// An input: its name, and its value at the instant of a row.
type Drive<'f> = (&'f str, &'f dyn Fn(f64) -> f64);

/// The outputs of the engine, by name.
struct Run {
    time: Vec<f64>,
    outputs: Vec<(String, Vec<f64>)>,
}

/// Runs a plant file along rows with a constant period.
fn along(file: &EquationFile, rows: usize, period: f64, drives: &[Drive<'_>], setting: Setting) -> Run {
    let mut machine = Machine::new(file).unwrap_or_else(|faults| panic!("{faults}"));
    let time: Vec<f64> = (0..rows).map(|k| k as f64 * period).collect();
    let values: Vec<Vec<f64>> = drives.iter().map(|(_, of)| time.iter().map(|time| of(*time)).collect()).collect();
    let mut columns: Vec<(&str, &[f64])> = vec![("time", &time)];
    columns.extend(drives.iter().zip(&values).map(|((name, _), values)| (*name, values.as_slice())));
    let signals = Signals::in_memory(file, &machine, &columns).unwrap_or_else(|faults| panic!("{faults}"));
    let found = signals.simulate(file, &mut machine, setting).unwrap_or_else(|failed| panic!("{failed:?}"));
    let names = machine.outputs().into_iter().map(|it| it.0);
    Run { outputs: names.zip(found).collect(), time }
}

/// A text of the compiler's tests.
fn text(name: &str) -> EquationFile {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../rsm-model/tests/models").join(format!("{name}.mo"));
    let source = Source::read(&path).unwrap_or_else(|faults| panic!("{faults}"));
    EquationFile::of_text(&source).unwrap_or_else(|faults| panic!("{faults}"))
}

/// A shipped text with other parameter values.
fn shipped(model: &str, more: &str) -> EquationFile {
    let open = |name: &str| Err(Faults::one(Fault::whole_file(name, "not asked for")));
    let plant = format!("format = 2\nmodel = \"rsm:{model}\"\n{more}");
    EquationFile::read(&Source::new("plant.toml", plant), &open).unwrap_or_else(|faults| panic!("{faults}"))
}

impl Run {
    fn of(&self, name: &str) -> &[f64] {
        &self.outputs.iter().find(|it| it.0 == name).unwrap_or_else(|| panic!("no output {name}")).1
    }

    /// Checks every row of an output against the reference.
    fn agrees(&self, name: &str, judged: &[f64]) {
        let found = self.of(name);
        assert_eq!(found.len(), judged.len());
        let largest = judged.iter().fold(0.0_f64, |most, it| most.max(it.abs()));
        let (row, off) = found
            .iter()
            .zip(judged)
            .map(|(a, b)| (a - b).abs())
            .enumerate()
            .fold((0, 0.0), |most: (usize, f64), it| if it.1 > most.1 || it.1.is_nan() { it } else { most });
        println!("{name}: {:.1e} of {largest:.3e}", off / largest);
        assert!(largest > 0.0 && off <= AGREE * largest, "{name}, row {row}: {} is not {}", found[row], judged[row]);
    }
}

/// Rates written by hand, in the form that the solver needs.
struct Rates<F>(F);

impl<F: Fn(f64, &[f64; N]) -> [f64; N], const N: usize> System<f64, SVector<f64, N>> for Rates<F> {
    fn system(&self, time: f64, x: &SVector<f64, N>, dx: &mut SVector<f64, N>) {
        *dx = SVector::from((self.0)(time, &(*x).into()));
    }
}

/// The states at `to`, from the states at `from`.
fn solved<const N: usize>(from: f64, to: f64, states: [f64; N], rates: impl Fn(f64, &[f64; N]) -> [f64; N]) -> [f64; N] {
    // Lengths are of the order of metres, speeds of metres per second: errors below 1e-14 of these change no digit of the comparison.
    let mut solver = Dop853::new(Rates(rates), from, to, to - from, SVector::from(states), 1e-13, 1e-14);
    solver.set_output(OutputType::Sparse);
    solver.integrate().unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(solver.x_out().last(), Some(&to));
    (*solver.y_out().last().expect("the end is told")).into()
}

/// The states at every row. The rates get the row, whose inputs are constant up to the next row.
fn rows<const N: usize>(time: &[f64], start: [f64; N], rates: impl Fn(usize, &[f64; N]) -> [f64; N]) -> Vec<[f64; N]> {
    let mut all = vec![start];
    for row in 1..time.len() {
        let last = all[row - 1];
        all.push(solved(time[row - 1], time[row], last, |_, x| rates(row - 1, x)));
    }
    all
}

fn of<const N: usize>(all: &[[f64; N]], signal: impl Fn(usize, &[f64; N]) -> f64) -> Vec<f64> {
    all.iter().enumerate().map(|(row, x)| signal(row, x)).collect()
}

/// A step up, then a step down.
fn steps(time: f64) -> f64 {
    if time < 0.05 {
        0.0
    } else if time < 0.3 {
        2.0
    } else {
        -0.5
    }
}

#[test]
fn an_axis_of_one_mass() {
    let run = along(&text("axis"), 101, 0.01, &[("command", &steps)], TIGHT);
    let judged = rows(&run.time, [0.0, 0.0], |row, [_, v]| [*v, (35.15 * steps(run.time[row]) - 203.5 * v) / 95.1]);
    run.agrees("position", &of(&judged, |_, x| x[0]));
}

#[test]
fn two_inertias_with_a_spring_as_two_tools_write_them() {
    let torque = |time: f64| 10.0 * steps(time);
    let judged = |time: &[f64]| {
        rows(time, [0.0; 4], |row, [motor, motor_speed, load, load_speed]| {
            let spring = 300.0 * (load - motor) + 0.4 * (load_speed - motor_speed);
            [*motor_speed, (torque(time[row]) + spring) / 0.1, *load_speed, -spring / 2.0]
        })
    };
    for name in ["two-inertias", "quoted"] {
        let run = along(&text(name), 101, 0.005, &[("torque", &torque)], TIGHT);
        run.agrees("speed", &of(&judged(&run.time), |_, x| x[3]));
    }
}

#[test]
fn a_gear_between_rigid_inertias_is_one_inertia() {
    let run = along(&text("gear-train"), 101, 0.01, &[("torque", &steps)], TIGHT);
    // The inertia at the load: 2 kg m^2, and 0.1 kg m^2 behind a ratio of 7, which also multiplies the torque.
    let mut speed = vec![0.0];
    for row in 1..run.time.len() {
        let rate = 7.0 * steps(run.time[row - 1]) / (2.0 + 49.0 * 0.1);
        speed.push(speed[row - 1] + rate * (run.time[row] - run.time[row - 1]));
    }
    run.agrees("speed", &speed);
}

#[test]
fn a_circuit_whose_resistors_form_a_loop() {
    let voltage = |time: f64| 12.0 * steps(time);
    let run = along(&text("rlc"), 201, 0.002, &[("voltage", &voltage)], TIGHT);
    // The voltage of the node between the resistors: (V - u)/10 = u/20 + i.
    let node = |row: usize, i: f64| (voltage(run.time[row]) / 10.0 - i) / (1.0 / 10.0 + 1.0 / 20.0);
    let judged = rows(&run.time, [0.0, 0.0], |row, [i, u]| [(node(row, *i) - 5.0 * i - u) / 0.1, i / 1e-3]);
    run.agrees("current", &of(&judged, |row, x| (voltage(run.time[row]) - node(row, x[0])) / 10.0));
}

#[test]
fn a_tank_that_overflows() {
    let inflow = |time: f64| if time < 40.0 { 0.03 } else { 0.005 };
    let run = along(&text("tank"), 101, 1.0, &[("inflow", &inflow)], TIGHT);
    // With root finding written here: above the edge another law applies.
    let rate = |row: usize, level: f64, is_over: bool| {
        (inflow(run.time[row]) - 0.02 * level - if is_over { 3.0 * (level - 1.0) } else { 0.0 }) / 0.5
    };
    let (mut level, mut is_over) = (0.2, false);
    let (mut judged, mut crossed) = (vec![level], 0);
    for row in 1..run.time.len() {
        let (from, to) = (run.time[row - 1], run.time[row]);
        let at = |time: f64| {
            if time == from { level } else { solved(from, time, [level], |_, [x]| [rate(row - 1, *x, is_over)])[0] }
        };
        let end = at(to);
        level = if (end > 1.0) == is_over {
            end
        } else {
            let (mut before, mut after) = (from, to);
            while before < 0.5 * (before + after) && 0.5 * (before + after) < after {
                let middle = 0.5 * (before + after);
                if (at(middle) > 1.0) == is_over { before = middle } else { after = middle }
            }
            let edge = at(before);
            is_over = !is_over;
            crossed += 1;
            solved(before, to, [edge], |_, [x]| [rate(row - 1, *x, is_over)])[0]
        };
        judged.push(level);
    }
    assert_eq!(crossed, 2);
    run.agrees("level", &judged);
}

#[test]
fn a_rod_of_four_nodes() {
    let heat = |time: f64| 50.0 * steps(time / 1000.0);
    let run = along(&text("thermal"), 101, 10.0, &[("heat", &heat)], TIGHT);
    let judged = rows(&run.time, [293.15; 4], |row, [a, b, c, d]| {
        let between = [2.0 * (a - b), 2.0 * (b - c), 2.0 * (c - d), 2.0 * (d - 293.15)];
        [
            (heat(run.time[row]) - between[0]) / 100.0,
            (between[0] - between[1]) / 100.0,
            (between[1] - between[2]) / 100.0,
            (between[2] - between[3]) / 100.0,
        ]
    });
    run.agrees("hot", &of(&judged, |_, x| x[0]));
}

#[test]
fn the_pitch_axis_of_a_quadrotor() {
    let front = |time: f64| 5.88399 + 0.1 * steps(time);
    let rear = |time: f64| 5.88399 - 0.05 * steps(time);
    let run = along(&text("pitch"), 101, 0.01, &[("front", &front), ("rear", &rear)], TIGHT);
    let judged = rows(&run.time, [5.88399, 5.88399, 0.05, 0.0, 0.0, 0.0, 0.0], |row, [f, r, pitch, rate, _, vx, vz]| {
        let (lift, air) = (f + r, 0.1 * vx.hypot(*vz));
        let time = run.time[row];
        [
            (front(time) - f) / 0.04,
            (rear(time) - r) / 0.04,
            *rate,
            0.2 * (f - r) / 0.015,
            *vx,
            (lift * pitch.sin() - air * vx) / 1.2,
            (lift * pitch.cos() - air * vz) / 1.2 - 9.80665,
        ]
    });
    run.agrees("pitch", &of(&judged, |_, x| x[2]));
    run.agrees("x", &of(&judged, |_, x| x[4]));
}

fn opening(time: f64) -> f64 {
    if time < 0.02 { 0.0 } else { 0.3 }
}

#[test]
fn a_hydraulic_cylinder() {
    let run = along(&text("cylinder"), 201, 1e-3, &[("opening", &opening)], TIGHT);
    let judged = rows(&run.time, [2e6, 2e6, 0.0, 0.0], |row, [a, b, x, v]| {
        let valve = |drop: f64| 2e-7 * opening(run.time[row]) * drop.signum() * drop.abs().sqrt();
        [
            1.2e9 * (valve(1e7 - a) - 1e-3 * v) / (5e-4 + 1e-3 * x),
            1.2e9 * (1e-3 * v - valve(*b)) / (5e-4 - 1e-3 * x),
            *v,
            (1e-3 * (a - b) - 800.0 * v - 20_000.0 * x) / 50.0,
        ]
    });
    run.agrees("position", &of(&judged, |_, x| x[2]));
}

#[test]
fn a_capacitor_behind_a_diode() {
    let voltage = |time: f64| 400.0 * time;
    // The voltage across the diode, by bisection: the sum of the voltages of diode and resistor increases with it.
    let current = |u: f64, v: f64| {
        let taken = |drop: f64| 10.0 * 1e-9 * (drop / 0.05).exp_m1() + drop;
        let (mut low, mut high) = (-10.0, 1.1);
        while low < 0.5 * (low + high) && 0.5 * (low + high) < high {
            let middle = 0.5 * (low + high);
            if taken(middle) < u - v { low = middle } else { high = middle }
        }
        (u - v - low) / 10.0
    };
    for setting in [TIGHT, Setting::new(Method::Stiff, 1e-11)] {
        let run = along(&text("diode"), 41, 1e-4, &[("u", &voltage)], setting);
        let judged = rows(&run.time, [0.0], |row, [v]| [current(voltage(run.time[row]), *v) / 1e-4]);
        run.agrees("i", &of(&judged, |row, x| current(voltage(run.time[row]), x[0])));
    }
}

#[test]
fn a_pendulum_in_cartesian_coordinates() {
    let run = along(&text("pendulum"), 151, 0.02, &[], TIGHT);
    // The angle from the hanging position as the only coordinate satisfies the constraint.
    let judged = rows(&run.time, [0.25_f64.asin(), 0.0], |_, [angle, rate]| [*rate, -9.81 / 0.8 * angle.sin()]);
    run.agrees("x", &of(&judged, |_, x| 0.8 * x[0].sin()));
    run.agrees("y", &of(&judged, |_, x| -0.8 * x[0].cos()));
}

#[test]
fn a_ball_that_bounces() {
    let run = along(&text("ball"), 101, 0.025, &[], TIGHT);
    // A parabola from each bounce to the next: the ball leaves with 0.8 of its speed at impact.
    let (mut from, mut speed) = ((2.0 / 9.81_f64).sqrt(), 0.8 * (2.0 * 9.81_f64).sqrt());
    let judged: Vec<f64> = run
        .time
        .iter()
        .map(|time| {
            if *time < (2.0 / 9.81_f64).sqrt() {
                return 1.0 - 9.81 / 2.0 * time * time;
            }
            while *time > from + 2.0 * speed / 9.81 {
                (from, speed) = (from + 2.0 * speed / 9.81, 0.8 * speed);
            }
            let since = time - from;
            speed * since - 9.81 / 2.0 * since * since
        })
        .collect();
    assert!(speed < 0.8_f64.powi(3) * 4.5, "four bounces at least");
    run.agrees("height", &judged);
}

#[test]
fn a_heater_with_a_thermostat() {
    let run = along(&text("hysteresis"), 101, 1.0, &[], TIGHT);
    // From one border to the other, the temperature approaches 393.15 K or 293.15 K with a time constant of 50 s.
    let (mut from, mut begin, mut is_on) = (0.0_f64, 340.0_f64, true);
    let mut switched = 0;
    let judged: Vec<f64> = run
        .time
        .iter()
        .map(|time| {
            loop {
                let (end, border) = if is_on { (393.15, 360.0) } else { (293.15, 350.0) };
                let until = from + 50.0 * ((begin - end) / (border - end)).ln();
                if *time <= until {
                    return end + (begin - end) * (-(time - from) / 50.0).exp();
                }
                (from, begin, is_on) = (until, border, !is_on);
                switched += 1;
            }
        })
        .collect();
    assert!(switched >= 5, "{switched}");
    run.agrees("temperature", &judged);
}

#[test]
fn a_plant_of_first_order_under_a_sampled_controller() {
    let reference = |time: f64| (3.0 * time).sin();
    let run = along(&text("sampled"), 101, 0.004, &[("reference", &reference)], TIGHT);
    let (mut y, mut u, mut sum) = (0.0_f64, 0.0_f64, 0.0_f64);
    let mut now = 0.0_f64;
    let mut judged = Vec::new();
    // Rows are every 4 ms and instants of the controller every 10 ms: counted in ms, they coincide exactly.
    for ms in 0..=400 {
        let time = f64::from(ms) / 1000.0;
        y = u + (y - u) * (-(time - now) / 0.1).exp();
        now = time;
        if ms % 10 == 0 {
            let e = reference(run.time[ms as usize / 4]) - y;
            sum += 0.01 * e;
            u = 2.0 * e + 5.0 * sum;
        }
        if ms % 4 == 0 {
            judged.push(y);
        }
    }
    run.agrees("y", &judged);
}

#[test]
fn the_shipped_motor() {
    let v_d = |time: f64| -3.0 * steps(time);
    let v_q = |time: f64| 8.0 + 6.0 * steps(time);
    let load = |time: f64| 0.2 + 0.1 * steps(time);
    for holds in [false, true] {
        let file = shipped("pmac", &format!("[parameters]\nholds_i_d = {holds}\n"));
        let run = along(&file, 201, 2e-3, &[("v_d", &v_d), ("v_q", &v_q), ("load_torque", &load)], TIGHT);
        let judged = rows(&run.time, [0.0; 3], |row, [i_d, i_q, w]| {
            let (time, w_e) = (run.time[row], 4.0 * w);
            [
                if holds { 0.0 } else { (v_d(time) - 0.08 * i_d) / 9e-4 + w_e * i_q },
                (v_q(time) - 0.08 * i_q - 0.06 * w_e) / 9e-4 - w_e * i_d,
                (1.5 * 4.0 * 0.06 * i_q - 8e-4 * w - load(time)) / 0.0015,
            ]
        });
        if !holds {
            run.agrees("i_d", &of(&judged, |_, x| x[0]));
        }
        run.agrees("i_q", &of(&judged, |_, x| x[1]));
        run.agrees("speed", &of(&judged, |_, x| x[2]));
    }
}

fn throttle(time: f64) -> f64 {
    if time < 0.05 { 0.1 } else { 0.6 }
}

#[test]
fn the_shipped_driveline() {
    let file = shipped("driveline", "[parameters]\ngear = 2\n[initial]\nroad_speed = 8.0\n");
    // The fast modes of the shaft decay in 50 us, the car's speed in minutes, so the method for stiff plants is compared too, with its own order.
    for (setting, count) in [(TIGHT, 151), (Setting::new(Method::Stiff, 1e-10), 41)] {
        driveline(&along(&file, count, 2e-3, &[("throttle", &throttle)], setting));
    }
}

fn driveline(run: &Run) {
    let (gear, last) = (2.2, 3.7);
    let wanted = |row: usize, w: f64| throttle(run.time[row]) * (120.0 + 0.6 * w - 0.001 * w * w);
    let wheel = |shaft: f64, shaft_speed: f64, wheel: f64, speed: f64| {
        let pull = 5000.0 * (shaft / last - wheel) + 65.0 * (shaft_speed / last - speed);
        let road = 1560.0 * 0.0980665 + 0.5 * 0.81 * 1.2 * (0.32 * speed).powi(2);
        (pull, (pull - 0.1 * speed - 0.32 * road) / (1.0 + 1560.0 * 0.32 * 0.32))
    };
    // The car rolls steadily with the torque of the engine.
    let speed = 8.0 / 0.32;
    let engine_speed = gear * last * speed;
    let torque = wanted(0, engine_speed);
    let clutch = torque - 15.0 - 0.03 * engine_speed;
    let start = [torque, clutch / 1e4, engine_speed, 0.0, last * speed, -gear * last * clutch / 5000.0, speed];
    let judged = rows(&run.time, start, |row, [torque, engine, engine_speed, shaft, shaft_speed, angle, speed]| {
        let clutch = 1e4 * (engine - gear * shaft) + 30.0 * (engine_speed - gear * shaft_speed);
        let (pull, gained) = wheel(*shaft, *shaft_speed, *angle, *speed);
        [
            (wanted(row, *engine_speed) - torque) / 0.1,
            *engine_speed,
            (torque - 15.0 - 0.03 * engine_speed - clutch) / 0.17,
            *shaft_speed,
            (gear * clutch - (0.1 + 0.1 / (last * last)) * shaft_speed - pull / last) / (0.014 + 0.031 / (last * last)),
            *speed,
            gained,
        ]
    });
    run.agrees("engine_speed", &of(&judged, |_, x| x[2]));
    run.agrees("road_speed", &of(&judged, |_, x| 0.32 * x[6]));
    run.agrees("acceleration", &of(&judged, |_, x| 0.32 * wheel(x[3], x[4], x[5], x[6]).1));
}

/// Position and speed of the shipped axis after a time with a constant command.
fn moved(position: f64, speed: f64, command: f64, time: f64) -> (f64, f64) {
    let (end, lag) = (command * 35.15065188248547 / 203.5034, 95.1089 / 203.5034);
    let gone = -(-time / lag).exp_m1();
    (position + end * time + (speed - end) * lag * gone, speed + (end - speed) * gone)
}

#[test]
fn the_shipped_axis_open_and_under_its_controller() {
    let run = along(&shipped("servo-axis#ServoAxis", ""), 101, 0.01, &[("command", &steps)], TIGHT);
    let (mut position, mut speed, mut judged) = (0.0, 0.0, vec![0.0]);
    for row in 1..run.time.len() {
        (position, speed) = moved(position, speed, steps(run.time[row - 1]), run.time[row] - run.time[row - 1]);
        judged.push(position);
    }
    run.agrees("position", &judged);

    // A step that is large enough to reach the limit of the command, then one that is not.
    let reference = |time: f64| if time < 0.1 { 0.02 } else { 0.0201 };
    for from_difference in [false, true] {
        let more = format!("[parameters]\nvelocity_from_difference = {from_difference}\n");
        let file = shipped("servo-axis#ServoAxisClosedLoop", &more);
        let run = along(&file, 301, 1e-3, &[("reference", &reference)], TIGHT);
        let (mut position, mut speed) = (0.0, 0.0);
        let (mut before, mut long_before) = (0.0, 0.0);
        let (mut positions, mut commands) = (Vec::new(), Vec::new());
        for row in 0..run.time.len() {
            let seen = if from_difference { (position - long_before) / 0.002 } else { speed };
            let wanted = 243.45 * (160.18 * (reference(run.time[row]) - position) - seen);
            let command = wanted.clamp(-10.0, 10.0);
            (long_before, before) = (before, position);
            positions.push(position);
            commands.push(command);
            (position, speed) = moved(position, speed, command, 1e-3);
        }
        assert!(commands[0] == 10.0 && commands.iter().any(|it| it.abs() < 9.0));
        run.agrees("position", &positions);
        run.agrees("command", &commands);
    }
}

/// The rows from SciPy for a plant of `judge.py`; `None` if there is no SciPy.
fn by_scipy(plant: &str, run: &Run) -> Option<Vec<Vec<f64>>> {
    let script = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/all/judge.py");
    let python = std::env::var("RSM_PYTHON").unwrap_or_else(|_| "python3".to_string());
    let is_there = Command::new(&python).args(["-c", "import scipy.integrate"]).stderr(Stdio::null()).status();
    if !is_there.is_ok_and(|status| status.success()) {
        skipped::skipped("python3 with scipy is missing (apt-get install python3-scipy)");
        return None;
    }
    let mut child = Command::new(&python)
        .arg(script)
        .arg(plant)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("python starts");
    let times: String = run.time.iter().map(|time| format!("{time:?}\n")).collect();
    child.stdin.take().expect("it reads").write_all(times.as_bytes()).expect("it takes the instants");
    let found = child.wait_with_output().expect("it ends");
    assert!(found.status.success(), "{plant}");
    let text = String::from_utf8(found.stdout).expect("it writes text");
    let number = |word: &str| word.parse().unwrap_or_else(|_| panic!("{plant}: {word}"));
    Some(text.lines().map(|line| line.split(' ').map(number).collect()).collect())
}

#[test]
fn scipy_says_the_same() {
    let inflow = |time: f64| if time < 40.0 { 0.03 } else { 0.005 };
    let cases: [(&str, EquationFile, usize, f64, Drive<'_>); 3] = [
        (
            "driveline",
            shipped("driveline", "[parameters]\ngear = 2\n[initial]\nroad_speed = 8.0\n"),
            101,
            2e-3,
            ("throttle", &throttle),
        ),
        ("cylinder", text("cylinder"), 101, 1e-3, ("opening", &opening)),
        ("tank", text("tank"), 101, 1.0, ("inflow", &inflow)),
    ];
    for (plant, file, rows, period, drive) in cases {
        let run = along(&file, rows, period, &[drive], TIGHT);
        let Some(judged) = by_scipy(plant, &run) else { return };
        for (place, (name, _)) in run.outputs.iter().enumerate() {
            run.agrees(name, &judged.iter().map(|row| row[place]).collect::<Vec<f64>>());
        }
    }
}

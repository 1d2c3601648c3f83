//! Times of the motor's controllers. Both times of a ratio are measured in the same run.
//!
//! In: the plant. Out: nanoseconds and ratios. The compared functions run in turns for many rounds, and the medians are taken, so that other load of
//! the machine affects both alike. The argument of each call depends on the result of the call before it.

use std::hint::black_box;
use std::time::Instant;

use host_runners::motor::Steps;
use rsm_rigs::motor::circle_diagram::CircleDiagram;
use rsm_rigs::motor::closed_loop::Drive;
use rsm_rigs::motor::controller::{Controller, Demand};
use rsm_rigs::motor::field_oriented::FullController;
use rsm_rigs::motor::figures;
use rsm_rigs::motor::inverter::Fidelity;
use rsm_sim::plant_file::PlantFile;
use serde_json::{Value, json};

use super::Printer;
use super::paper::Paper;
use crate::outcome::Refusal;

/// The evaluator as `targets/motor-loop` embeds it.
mod embedded {
    rsm_macros::include_model!("../generated/coefficients/motor.toml", precision = "f32");
}

/// Number of rounds for the short functions; the median of the rounds is taken.
const ROUNDS: usize = 101;

/// Calls a round. 4,000 calls of about 10 ns take far longer than the clock's resolution (about 25 ns). 4,000 calls of about 100 ns are still so
/// short that few rounds are interrupted.
const CALLS: usize = 4_000;

/// Rounds of whole simulations, and the simulated time of each in s.
const SIMULATIONS: usize = 5;
const SIMULATED_S: f64 = 4.0;

/// The operating point of the timed controllers: half torque, in the weakening region.
const TORQUE_NM: f64 = 8.0;
const SPEED_RAD_S: f64 = 650.0;
const BUS_V: f64 = 270.0;

/// The measured times.
pub struct Times {
    evaluator_ns: f64,
    solve_ns: f64,
    surface_step_ns: f64,
    full_step_ns: f64,
    /// Simulated time over elapsed time: with an averaged inverter and the surface's controller; then with the full controller; then with a switched
    /// inverter.
    averaged: f64,
    averaged_full: f64,
    switched: f64,
}

impl Times {
    pub fn json(&self) -> Value {
        json!({
            "evaluator_ns": self.evaluator_ns,
            "solve_ns": self.solve_ns,
            "surface_step_ns": self.surface_step_ns,
            "full_step_ns": self.full_step_ns,
            "realtime_factor_averaged": self.averaged,
            "realtime_factor_averaged_full_controller": self.averaged_full,
            "realtime_factor_switched": self.switched,
        })
    }

    pub fn html(&self) -> String {
        format!(
            "<p>Times of this run: evaluator {:.1} ns, circle-diagram solve {:.1} ns; 1 kHz step {:.0} ns with the surfaces, {:.0} ns full. The whole simulation \
             runs {:.0} times as fast as real time with an averaged inverter ({:.0} with the full controller) and {:.0} times with a switched one.</p>\n",
            self.evaluator_ns,
            self.solve_ns,
            self.surface_step_ns,
            self.full_step_ns,
            self.averaged,
            self.averaged_full,
            self.switched
        )
    }
}

/// Nanoseconds a call for functions that run in turns: the median of the rounds for each.
fn in_turns<const N: usize>(mut works: [&mut dyn FnMut(); N]) -> [f64; N] {
    let mut times = [const { Vec::new() }; N];
    for _ in 0..ROUNDS {
        for (work, times) in works.iter_mut().zip(&mut times) {
            let begin = Instant::now();
            work();
            times.push(begin.elapsed().as_secs_f64() * 1e9 / CALLS as f64);
        }
    }
    times.map(median)
}

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

/// A chain of calls. Each argument depends on the last result but always equals `start`: it takes the sign of the result, which is never negative.
/// That costs two operations on bits, as in the chain of `bench/`, and stays in the registers of the floating-point unit.
fn chain(start: f64, mut call: impl FnMut(f64) -> f64) {
    let start = black_box(start);
    let mut argument = start;
    for _ in 0..CALLS {
        argument = start.copysign(call(argument));
    }
    assert_eq!(black_box(argument).to_bits(), start.to_bits(), "a result was negative");
}

/// The same in single precision, as the embedded evaluator uses it.
fn chain_f32(start: f32, mut call: impl FnMut(f32) -> f32) {
    let start = black_box(start);
    let mut argument = start;
    for _ in 0..CALLS {
        argument = start.copysign(call(argument));
    }
    assert_eq!(black_box(argument).to_bits(), start.to_bits(), "a result was negative");
}

/// Measures the times, prints them and stores them among the figures.
pub fn measure(printer: &Printer, plant: &PlantFile, paper: &mut Paper) -> Result<Times, Refusal> {
    let drive = Drive::default();
    let known = drive.known(plant);
    let voltage = known.reference_voltage(BUS_V);
    let diagram = CircleDiagram::new(known);
    let (mut full, mut steps) = (FullController::full(known), Steps::new(&known));
    let demand = |torque_nm: f64| Demand { torque_nm, speed_rad_s: black_box(SPEED_RAD_S), bus_voltage_v: BUS_V };
    let [evaluator_ns, masked_ns, solve_ns, surface_step_ns, full_step_ns] = in_turns([
        &mut || {
            // Each result is the next torque, without any other operation in the chain: the time of the evaluator does not depend on its argument.
            let last = (0..CALLS).fold(TORQUE_NM as f32, |torque, _| {
                embedded::motor::weakening_current_f32(torque, black_box(SPEED_RAD_S as f32))
            });
            black_box(last);
        },
        &mut || {
            chain_f32(TORQUE_NM as f32, |torque| embedded::motor::weakening_current_f32(torque, black_box(SPEED_RAD_S as f32)));
        },
        &mut || chain(TORQUE_NM, |torque| -diagram.solve(torque, black_box(SPEED_RAD_S), voltage).i_d_a),
        &mut || chain(TORQUE_NM, |torque| -steps.references(&demand(torque)).i_d_a),
        &mut || chain(TORQUE_NM, |torque| -full.references(&demand(torque)).i_d_a),
    ]);

    let switched_drive = Drive { fidelity: Fidelity::Switched, ..drive };
    let mut factors = [const { Vec::new() }; 3];
    for _ in 0..SIMULATIONS {
        let seed = 100;
        factors[0].push(figures::realtime_factor(plant, &drive, &mut Steps::new(&known), seed, SIMULATED_S)?);
        factors[1].push(figures::realtime_factor(plant, &drive, &mut FullController::full(known), seed, SIMULATED_S)?);
        factors[2].push(figures::realtime_factor(plant, &switched_drive, &mut Steps::new(&known), seed, SIMULATED_S)?);
    }
    let [averaged, averaged_full, switched] = factors.map(median);
    let times = Times { evaluator_ns, solve_ns, surface_step_ns, full_step_ns, averaged, averaged_full, switched };

    paper.note("evaluator_ns", evaluator_ns);
    // The time of the solve depends on its argument, so both are timed at the same argument: in the chain that takes only the sign.
    paper.note("ratio_solve", solve_ns / masked_ns);
    paper.note("ratio_step", full_step_ns / surface_step_ns);
    paper.note("ratio_simulation", averaged / averaged_full);
    paper.note("realtime_factor", averaged);
    printer.print(&format!(
        "time     evaluator {evaluator_ns:.1} ns, solve {solve_ns:.1} ns; step {surface_step_ns:.0} ns, full {full_step_ns:.0} ns; simulation {averaged:.0} \
         times real time, switched {switched:.0}"
    ))?;
    Ok(times)
}

//! The figures of the motor's controllers: the difference of their commands, the difference of their run-ups, the speed of their simulation.
//!
//! In: a plant file, a drive, surfaces, seeds. Out: numbers and the traces behind them. The full controller is the standard; both see the same
//! sensors. Never fits anything, never prints. Times are those of the machine; everything else is the same for the same files on one machine.

use rsm_core::order;
use std::time::Instant;

use rsm_core::check::Checked;
use rsm_core::lower;
use rsm_core::number::Precision;
use rsm_core::run::Interpreter;
use rsm_core::source::{Fault, Faults};

use super::closed_loop::{ClosedLoop, Drive, Trace};
use super::controller::{Controller, Demand, Known, Measured, References};
use super::field_oriented::{FullController, Weakening};
use super::surface::{SurfaceReferences, Surfaces};
use super::tasks::{DYNAMOMETER_INERTIA, RandomProfile, RunUp};
use rsm_sim::plant_file::PlantFile;

/// Profiles go over this range of speed, in rad/s: a little past 7500 rpm.
pub const TOP_SPEED: f64 = 800.0;

/// 7500 rpm, in rad/s.
pub const RUN_UP_SPEED: f64 = 7500.0 * std::f64::consts::PI / 30.0;

/// Inertia on the shaft in a run-up, in kg m^2: four of the shipped motor's own, so that it takes two seconds.
pub const RUN_UP_INERTIA: f64 = 0.04;

/// The fan in a run-up, in N m s^2: 1.2 N m at 7500 rpm.
pub const RUN_UP_FAN: f64 = 2e-6;

/// The difference of commands from those of the full controller, over the milliseconds in which the full controller weakens the field.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Differences {
    /// Milliseconds in all.
    pub ticks: usize,
    /// Absolute differences of the current advance, in degrees, ascending: one a millisecond with weakening.
    pub angles: Vec<f64>,
    /// The largest weakening current where the full controller has none, in A.
    pub spurious: f64,
}

impl Differences {
    /// The mean, in degrees.
    #[must_use]
    pub fn mean(&self) -> f64 {
        self.angles.iter().sum::<f64>() / self.angles.len() as f64
    }

    /// The smallest difference that a share (0 to 1) of all does not exceed, in degrees.
    #[must_use]
    pub fn quantile(&self, share: f64) -> f64 {
        let rank = (share * self.angles.len() as f64).ceil() as usize;
        self.angles[rank.clamp(1, self.angles.len()) - 1]
    }
}

/// A source of current advance that is compared: degrees and weakening current (A) for a demand and what the full controller made of it.
type Answer<'a> = dyn FnMut(&Demand, &References) -> (f64, f64) + 'a;

/// The full controller in the loop, another source beside it.
struct Beside<'a, 'b> {
    full: FullController,
    answer: &'a mut Answer<'b>,
    found: Differences,
}

impl Controller for Beside<'_, '_> {
    fn references(&mut self, demand: &Demand) -> References {
        let full = self.full.references(demand);
        let (angle, weakening) = (self.answer)(demand, &full);
        self.found.ticks += 1;
        if full.i_d_a < 0.0 {
            self.found.angles.push((angle - advance(&full)).abs());
        } else {
            self.found.spurious = self.found.spurious.max(weakening);
        }
        full
    }

    fn duties(&mut self, measured: &Measured) -> [f64; 3] {
        self.full.duties(measured)
    }
}

/// The angle of the current vector from the nearer half of the q axis towards the negative d axis, in degrees, 0 to 90: the current advance, driving
/// or braking, forwards or backwards alike.
#[must_use]
pub fn advance(references: &References) -> f64 {
    (-references.i_d_a).atan2(references.i_q_a.abs()).to_degrees()
}

/// Commands of a source against the full controller's over random profiles, one a seed, each of `duration` s: torque between minus and plus k_t I,
/// speed between 0 and [`TOP_SPEED`].
fn differences(
    plant: &PlantFile,
    drive: &Drive,
    seeds: &[u64],
    duration: f64,
    answer: &mut Answer<'_>,
) -> Result<Differences, Faults> {
    let known = drive.known(plant);
    let mut beside = Beside { full: FullController::full(known), answer, found: Differences::default() };
    for seed in seeds {
        let (mut machine, mut task) = random_profile(plant, drive, *seed, duration)?;
        machine.run(&mut beside, &mut task);
    }
    let mut found = beside.found;
    if found.angles.is_empty() {
        return Err(Faults::one(Fault::whole_file(
            "profile",
            "the full controller never weakens the flux in this profile: use a longer profile",
        )));
    }
    order::sort(&mut found.angles);
    Ok(found)
}

/// The surfaces of a controller against the full controller. Each limits a demand beyond its limits in its own way.
///
/// # Errors
/// A plant that cannot run; profiles in which nothing is weakened.
pub fn command_difference(
    plant: &PlantFile,
    drive: &Drive,
    surfaces: &Surfaces,
    seeds: &[u64],
    duration: f64,
) -> Result<Differences, Faults> {
    let mut references = SurfaceReferences::new(drive.known(plant), surfaces);
    differences(plant, drive, seeds, duration, &mut |demand, _| {
        let found = references.references(demand);
        (advance(&found), -found.i_d_a)
    })
}

/// One surface of (torque, speed) against the full controller, at the torque that the full controller delivers: what its form can do. In degrees it
/// is the advance angle; in A the weakening current.
///
/// # Errors
/// A surface that is not there, or of other inputs or another unit; see [`command_difference`].
pub fn surface_difference(
    plant: &PlantFile,
    drive: &Drive,
    model: &Checked,
    surface: &str,
    seeds: &[u64],
    duration: f64,
) -> Result<Differences, Faults> {
    let refused = |what: String| Faults::one(Fault::whole_file("model", format!("surface `{surface}`: {what}")));
    let Some(index) = model.model().surfaces.iter().position(|found| found.name == surface) else {
        return Err(refused("the model has no surface of this name".to_string()));
    };
    let found = &model.model().surfaces[index];
    if found.inputs != ["torque", "speed"] {
        return Err(refused(format!("found the inputs {}, expected torque, speed", found.inputs.join(", "))));
    }
    let is_angle = match found.unit.as_str() {
        "deg" => true,
        "A" => false,
        unit => return Err(refused(format!("found the unit {unit}, expected deg or A"))),
    };
    let tape = lower::surface(model, index, Precision::F64);
    let mut interpreter = Interpreter::new(&tape);
    let known = drive.known(plant);
    let (k_t, limit) = (known.torque_constant(), known.current_limit);
    differences(plant, drive, seeds, duration, &mut |demand, full| {
        let mirrored = full.i_q_a * 1f64.copysign(demand.speed_rad_s);
        let value = interpreter.eval(&[k_t * mirrored, demand.speed_rad_s.abs()]);
        let length = full.i_q_a.abs();
        if is_angle {
            (value, (length * value.to_radians().tan()).min(limit))
        } else {
            (value.atan2(length).to_degrees(), value)
        }
    })
}

/// A random profile on the dynamometer, ready to run with any controller.
///
/// # Errors
/// A plant that cannot run in a loop.
pub fn random_profile(
    plant: &PlantFile,
    drive: &Drive,
    seed: u64,
    duration: f64,
) -> Result<(ClosedLoop, RandomProfile), Faults> {
    let known = drive.known(plant);
    let torque = known.torque_constant() * known.current_limit;
    let inertia = plant.effective_parameters().number("inertia") + DYNAMOMETER_INERTIA;
    let task = RandomProfile::new(seed, torque, TOP_SPEED, duration, inertia, known.pwm_period);
    Ok((ClosedLoop::new(plant, drive, DYNAMOMETER_INERTIA, task.first_speed())?, task))
}

/// A run-up from rest with full torque to [`RUN_UP_SPEED`].
///
/// # Errors
/// A plant that cannot run in a loop.
pub fn run_up<C: Controller + ?Sized>(plant: &PlantFile, drive: &Drive, controller: &mut C) -> Result<Trace, Faults> {
    let Known { current_limit, .. } = drive.known(plant);
    let torque = drive.known(plant).torque_constant() * current_limit;
    // Longer than any drive takes that can reach the speed.
    let mut task = RunUp::new(torque, RUN_UP_SPEED, RUN_UP_FAN, 20.0);
    Ok(ClosedLoop::new(plant, drive, RUN_UP_INERTIA, 0.0)?.run(controller, &mut task))
}

/// The difference of two run-ups.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RunUps {
    /// Root mean square of the torque's difference at equal times, in percent of the peak torque of the first.
    pub torque_rms_percent: f64,
    /// Difference of the run-up times, in percent of the first, positive where the second takes longer.
    pub time_percent: f64,
}

/// The second run-up against the first. The time of a run-up is interpolated between its last rows.
#[must_use]
pub fn compare_run_ups(first: &Trace, second: &Trace) -> RunUps {
    let pairs = || first.rows.iter().zip(&second.rows);
    let square = pairs().map(|(one, other)| (other.torque - one.torque).powi(2)).sum::<f64>() / pairs().count() as f64;
    let peak = first.rows.iter().map(|row| row.torque.abs()).fold(0.0, f64::max);
    let (one, other) = (run_up_time(first), run_up_time(second));
    RunUps { torque_rms_percent: 100.0 * square.sqrt() / peak, time_percent: 100.0 * (other - one) / one }
}

/// When a run-up reaches its speed, in s: by a straight line through the last two rows, whose last may be just below or above.
#[must_use]
pub fn run_up_time(trace: &Trace) -> f64 {
    match trace.rows.as_slice() {
        [.., before, last] if last.truth.speed > before.truth.speed => {
            let slope = (last.truth.speed - before.truth.speed) / (last.time - before.time);
            last.time + (RUN_UP_SPEED - last.truth.speed) / slope
        }
        rows => rows.last().map_or(0.0, |row| row.time),
    }
}

/// How many times faster than real time a random profile of `duration` s runs with a controller, by the clock.
///
/// # Errors
/// A plant that cannot run in a loop.
pub fn realtime_factor<C: Controller + ?Sized>(
    plant: &PlantFile,
    drive: &Drive,
    controller: &mut C,
    seed: u64,
    duration: f64,
) -> Result<f64, Faults> {
    let (mut machine, mut task) = random_profile(plant, drive, seed, duration)?;
    let start = Instant::now();
    let trace = machine.run(controller, &mut task);
    let elapsed = start.elapsed().as_secs_f64();
    Ok(trace.rows.len() as f64 * super::controller::REFERENCE_PERIOD_S / elapsed)
}

//! The simulated dynamometer bench of the motor.
//!
//! In: a plant file, settings (modulation depth, current advance), a seed. Out: a measured point for each run, or the result that the run did not
//! reach the voltage limit. A run is made as on a real bench, without a formula: the drive regulates the current vector, the dynamometer raises the
//! speed until the drive's voltage is at its limit, holds that speed, and the readings are averaged.
//!
//! Modulation depth is the share of the current limit, current advance the angle of the current vector from the q axis towards the negative d axis:
//! i_d = -I sin, i_q = I cos. Up to 90 degrees the motor drives, beyond it brakes. The voltage limit is what the drive leaves to its references:
//! V_dc/sqrt 3 less the drive's margin. At it the vector makes the highest torque that is available with this current at this speed, so every point
//! lies on the boundary of the circle diagram.
//!
//! Braking points are a region of their own, with negative torque: the resistive drop is then on the other side, and mirrored they would be wrong by
//! it (at 60 A by 1.7 A of weakening current).

mod csv;
pub mod limit_points;

use rsm_core::source::{Fault, Faults};

pub use csv::csv;

use crate::motor::closed_loop::{ClosedLoop, Drive, Sensed, Task};
use crate::motor::controller::{Demand, Known, REFERENCE_PERIOD_S, References};
use crate::motor::encoder;
use crate::motor::field_oriented::{FieldOriented, Weakening};
use crate::motor::machine::{Truth, check_plant};
use crate::motor::noise::Noise;
use crate::motor::tasks::{DYNAMOMETER_INERTIA, Dynamometer};
use rsm_core::threads::{available, in_threads};
use rsm_sim::plant_file::PlantFile;

/// What is set in a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setting {
    /// The number of the run.
    pub run: u32,
    /// Modulation depth, in percent of the current limit: above 0, to 100.
    pub depth: f64,
    /// Current advance, in degrees: 0 to below 180.
    pub advance: f64,
}

/// The bench.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bench {
    /// The drive under test.
    pub drive: Drive,
    /// The dynamometer's highest speed, in rad/s.
    pub top_speed: f64,
}

impl Default for Bench {
    /// 850 rad/s, 8120 rpm. Surfaces are wanted up to 800 rad/s, so there are points slightly beyond their end. Points far beyond would
    /// increase the error of the surface where it is used (in a trial to 1000 rad/s its mean error grew by a fifth). A fine encoder: a bench has
    /// better instruments than the drive.
    fn default() -> Self {
        Bench { drive: Drive { encoder: encoder::Settings::FINE, ..Drive::default() }, top_speed: 850.0 }
    }
}

/// A measured point: means over the window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// What was set.
    pub setting: Setting,
    /// Air-gap torque from the measured current, k_t i_q (21), in N m; negative when braking.
    pub torque: f64,
    /// Speed, in rad/s.
    pub speed: f64,
    /// Currents of the rotor frame as the drive measures them, in A.
    pub i_d: f64,
    /// See above.
    pub i_q: f64,
    /// Commanded voltage vector's length, in V.
    pub voltage: f64,
    /// Torque at the dynamometer's flange, in N m: what friction leaves.
    pub shaft_torque: f64,
}

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Outcome {
    /// At the voltage limit.
    AtLimit(Point),
    /// At the dynamometer's top speed, below the voltage limit: the point is not on the boundary.
    BelowLimit(Point),
    /// The current went beyond twice its limit: the drive switched off, nothing was measured.
    Tripped(Setting),
}

/// Where the protection of a drive switches off, over the current limit. Regulation overshoots by a fifth at most; beyond twice the limit it has lost
/// the current (an inductance that falls with it).
const TRIP: f64 = 2.0;

/// Where a run starts, in rad/s: well below every base speed.
const START_SPEED: f64 = 100.0;

/// The steepest ramp, in rad/s^2: to the top speed in half a second.
const RAMP: f64 = 2000.0;

/// How fast the search for the limit closes in, in 1/s. The voltage grows about in proportion to the speed, so the set point moves by this share of
/// the missing voltage; an eighth of the dynamometer's bandwidth, which must follow.
const SEARCH_RATE: f64 = 8.0;

/// Time constant of the voltage reading, in s. It is read once a millisecond; current noise of 0.2 A makes some 0.5 V in one reading and 0.1 V
/// after this.
const VOLTAGE_FILTER: f64 = 0.02;

/// The limit is near when the voltage is within this share of it: ten times the noise that the filter leaves.
const NEAR: f64 = 0.01;

/// From there the search takes so long, in s: five of its time constants leave 0.007 % of the limit. It goes on while the readings are averaged, so
/// that their mean voltage is the limit.
const SETTLE: f64 = 5.0 / SEARCH_RATE;

/// Averaging window, in s; readings of currents and voltage at the PWM rate, of speed at 1 kHz.
const WINDOW: f64 = 0.2;

/// A run that has not ended by then never will, in s: ramp, search over five of its time constants for the flattest voltage, window.
const AT_MOST: f64 = 10.0;

impl Bench {
    /// Makes the runs, in the order given. The noise of a run comes from `seed` and its number, so a run gives the same point in any plan. Runs share
    /// the machine's processors; their number changes no bit.
    ///
    /// # Errors
    /// A plant that is no motor, or one that cannot run in a loop; a plant of which every run trips.
    pub fn run(&self, plant: &PlantFile, settings: &[Setting], seed: u64) -> Result<Vec<Outcome>, Faults> {
        check_plant(plant)?;
        let runs = in_threads(settings, available(), |setting| self.one(plant, *setting, seed));
        let outcomes = runs.into_iter().collect::<Result<Vec<Outcome>, Faults>>()?;
        if !outcomes.is_empty() && outcomes.iter().all(|it| matches!(it, Outcome::Tripped(_))) {
            let what = "every run ends with more than twice the current limit: check the parameters of the motor";
            return Err(Faults::one(Fault::whole_file("plant file", what)));
        }
        Ok(outcomes)
    }

    /// Makes one run.
    ///
    /// # Errors
    /// See [`Bench::run`].
    pub fn one(&self, plant: &PlantFile, setting: Setting, seed: u64) -> Result<Outcome, Faults> {
        check_plant(plant)?;
        let mut noise = Noise::new(mixed(seed, setting.run));
        let drive = Drive { noise_seed: Some(noise.whole()), ..self.drive };
        let known = drive.known(plant);
        let mut controller = FieldOriented::new(known, Vector::new(&known, setting));
        let inertia = plant.effective_parameters().number("inertia") + DYNAMOMETER_INERTIA;
        let mut shaft =
            Shaft { dynamometer: Dynamometer::new(inertia), set_point: START_SPEED, slope: 0.0, period: drive.pwm_period() };
        let mut machine = ClosedLoop::new(plant, &drive, DYNAMOMETER_INERTIA, START_SPEED)?;
        let sigma = plant.noise.iter().find(|(name, _)| *name == "speed").map_or(0.0, |(_, sigma)| *sigma);
        let limit = known.reference_voltage(known.bus_voltage);
        let mut search = Search { limit, top: self.top_speed, voltage: 0.0, settled: 0.0, at_top: false };
        let rows = (AT_MOST / REFERENCE_PERIOD_S) as usize;
        for _ in 0..rows {
            let row = machine.millisecond(&mut controller, &mut shaft).expect("a bench's demand never ends");
            if trips(&row.truth, &known) {
                return Ok(Outcome::Tripped(setting));
            }
            let [v_d, v_q] = controller.currents().last().voltage;
            search.step(v_d.hypot(v_q), &mut shaft);
            if search.settled >= SETTLE {
                break;
            }
        }
        let mut sum = Sum::default();
        let window = (WINDOW / REFERENCE_PERIOD_S) as usize;
        for _ in 0..window {
            // The bench's own speed sensor; the readings of the drive are its last of each millisecond.
            let row = machine.millisecond(&mut controller, &mut shaft).expect("a bench's demand never ends");
            if trips(&row.truth, &known) {
                return Ok(Outcome::Tripped(setting));
            }
            let sample = controller.currents().last();
            search.step(sample.voltage[0].hypot(sample.voltage[1]), &mut shaft);
            sum.add(&sample.current, &sample.voltage, machine.speed_reading() + sigma * noise.normal(), row.load);
        }
        let point = sum.point(setting, &known);
        if ![point.torque, point.speed, point.i_d, point.voltage, point.shaft_torque].into_iter().all(f64::is_finite) {
            return Ok(Outcome::Tripped(setting));
        }
        Ok(if !search.at_top { Outcome::AtLimit(point) } else { Outcome::BelowLimit(point) })
    }
}

/// Whether the protection switches the drive off, also if a current is not finite.
fn trips(truth: &Truth, known: &Known) -> bool {
    let current = truth.i_d.hypot(truth.i_q);
    current.is_nan() || current > TRIP * known.current_limit
}

/// One seed for every run of a seed. The odd factor is that of SplitMix64 (Steele, Lea, Flood 2014): runs in a row get seeds far apart.
fn mixed(seed: u64, run: u32) -> u64 {
    seed ^ u64::from(run).wrapping_mul(0x9E37_79B9_7F4A_7C15)
}

/// A drive that regulates a vector whatever is asked for.
struct Vector(References);

impl Vector {
    fn new(known: &Known, setting: Setting) -> Self {
        let length = setting.depth / 100.0 * known.current_limit;
        let (sin, cos) = setting.advance.to_radians().sin_cos();
        Vector(References { i_d_a: -length * sin, i_q_a: length * cos })
    }
}

impl Weakening for Vector {
    fn references(&mut self, _demand: &Demand) -> References {
        self.0
    }
}

/// The dynamometer at its set point.
struct Shaft {
    dynamometer: Dynamometer,
    set_point: f64,
    /// In rad/s^2; the set point moves by it.
    slope: f64,
    period: f64,
}

impl Task for Shaft {
    fn torque_demand(&mut self, _sensed: &Sensed) -> Option<f64> {
        Some(0.0)
    }

    fn load_torque(&mut self, _time: f64, truth: &Truth) -> f64 {
        self.set_point += self.slope * self.period;
        self.dynamometer.torque(truth.speed, self.set_point, self.slope, self.period)
    }
}

/// The search for the speed at which the voltage is at its limit.
struct Search {
    limit: f64,
    top: f64,
    /// Filtered, in V.
    voltage: f64,
    /// For how long the voltage has been near the limit, or the speed at the top, in s.
    settled: f64,
    /// The dynamometer turns no faster, and there is voltage left.
    at_top: bool,
}

impl Search {
    /// A millisecond of it: sets the slope of the set point.
    fn step(&mut self, voltage: f64, shaft: &mut Shaft) {
        self.voltage += REFERENCE_PERIOD_S / VOLTAGE_FILTER * (voltage - self.voltage);
        let missing = (self.limit - self.voltage) / self.limit;
        shaft.slope = (SEARCH_RATE * missing * shaft.set_point).clamp(-RAMP, RAMP);
        self.at_top = shaft.set_point >= self.top && missing > 0.0;
        if self.at_top {
            (shaft.set_point, shaft.slope) = (self.top, 0.0);
        }
        self.settled = if missing.abs() < NEAR || self.at_top { self.settled + REFERENCE_PERIOD_S } else { 0.0 };
    }
}

/// Sums of readings.
#[derive(Default)]
struct Sum {
    count: f64,
    i_d: f64,
    i_q: f64,
    v_d: f64,
    v_q: f64,
    speed: f64,
    load: f64,
}

impl Sum {
    fn add(&mut self, current: &[f64; 2], voltage: &[f64; 2], speed: f64, load: f64) {
        self.count += 1.0;
        self.i_d += current[0];
        self.i_q += current[1];
        self.v_d += voltage[0];
        self.v_q += voltage[1];
        self.speed += speed;
        self.load += load;
    }

    fn point(&self, setting: Setting, known: &Known) -> Point {
        let of = |sum: f64| sum / self.count;
        let (i_d, i_q) = (of(self.i_d), of(self.i_q));
        Point {
            setting,
            torque: known.torque_constant() * i_q,
            speed: of(self.speed),
            i_d,
            i_q,
            voltage: of(self.v_d).hypot(of(self.v_q)),
            shaft_torque: of(self.load),
        }
    }
}

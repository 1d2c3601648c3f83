//! What an effect is: its description, and the hooks through which it changes a plant.
//!
//! In: the arguments of an effect from a plant file. Out: an object with the hooks that it needs; the others change nothing. A hook never
//! allocates and never keeps anything from call to call: what an effect remembers is a state, integrated with those of the plant.

pub mod declared;

use crate::kind::{OUTPUTS, PlantKind};
use crate::parameters::Parameters;

pub use declared::{Argument, Declared, Plausible, Role, Step, Unit};

/// A word that an effect takes beside its numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Subject {
    /// None.
    None,
    /// `parameter`: a nominal parameter of the plant.
    Parameter,
    /// `output`: an output of the plant.
    Output,
    /// `at`: a site or an input of a plant of equations.
    Site,
}

/// An effect that stands in a file.
#[derive(Debug, Clone)]
pub struct Entry {
    /// Which effect.
    pub description: &'static Description,
    /// With what.
    pub arguments: Arguments,
}

/// The arguments of one effect as they stand in a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Arguments {
    /// The plant on which it stands.
    pub plant: PlantKind,
    /// The named parameter or output, if it takes one.
    pub subject: Option<String>,
    /// Numbers by name, in the order of the description.
    pub numbers: Vec<(&'static str, f64)>,
}

impl Arguments {
    /// An optional number.
    #[must_use]
    pub fn optional(&self, name: &str) -> Option<f64> {
        self.numbers.iter().find(|(found, _)| *found == name).map(|(_, value)| *value)
    }

    /// A number that the description requires.
    ///
    /// # Panics
    /// When it is not there: the reader of plant files lets no such effect through.
    #[must_use]
    pub fn number(&self, name: &str) -> f64 {
        self.optional(name)
            .unwrap_or_else(|| panic!("the effect's required number `{name}` was checked when the file was read"))
    }

    /// The first of two names that is given: `torque` on a rotor, `force` on an axis.
    #[must_use]
    pub fn either(&self, first: &str, second: &str) -> f64 {
        self.optional(first).unwrap_or_else(|| self.number(second))
    }

    /// The place of the named output.
    ///
    /// # Panics
    /// When there is none: the reader of plant files lets no such effect through.
    #[must_use]
    pub fn output(&self) -> usize {
        let name = self.subject.as_deref().expect("an effect on an output names it");
        self.plant.output(name).expect("the output was checked when the file was read")
    }
}

/// Where a search for the numbers of an effect may begin, by the scales of the records.
pub enum Guesses {
    /// As code says.
    Code(fn(&Survey) -> Vec<Guess>),
    /// As the file of the effect says at one place of a plant.
    File(Box<FromFile>),
}

/// Guesses by the scales of the records.
pub type FromFile = dyn Fn(&Survey) -> Vec<Guess> + Send + Sync;

impl Guesses {
    /// Where it may begin.
    #[must_use]
    pub fn of(&self, survey: &Survey) -> Vec<Guess> {
        match self {
            Guesses::Code(code) => code(survey),
            Guesses::File(file) => file(survey),
        }
    }
}

impl std::fmt::Debug for Guesses {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Guesses")
    }
}

/// The sizes of the quantities of a place at which effects can stand, by their names: roles of a site, and the scales that files of effects name.
#[derive(Debug, Clone, PartialEq)]
pub struct Scales {
    /// The place.
    pub at: String,
    /// Each size by its name.
    pub sizes: Vec<(String, f64)>,
}

/// What a file, a report and a test may know of an effect.
#[derive(Debug)]
pub struct Description {
    /// The kind in a file; the file name in the code with `-` for `_`.
    pub kind: &'static str,
    /// The plants on which it can stand.
    pub plants: &'static [PlantKind],
    /// Whether it names a parameter, an output or a site.
    pub subject: Subject,
    /// The only place where it stands, of an effect of a plant of equations; `None` where any name of its kind will do.
    pub at: Option<&'static str>,
    /// Its numbers.
    pub arguments: &'static [Argument],
    /// What the report says; `{name}` stands for an argument with its unit.
    pub sentence: &'static str,
    /// What an engineer measures or looks at to be sure, in a sentence.
    pub check: &'static str,
    /// Makes the effect.
    pub build: fn(&Arguments) -> Box<dyn Effect>,
    /// Where a search for its numbers may begin.
    pub guesses: Guesses,
    /// What else a search wants to know.
    pub declared: Declared,
}

/// What records and nominal plant say of sizes: the scales of first guesses.
#[derive(Debug, Clone)]
pub struct Survey {
    /// The plant.
    pub plant: PlantKind,
    /// Its nominal parameters.
    pub parameters: Parameters,
    /// Sample period, in s.
    pub period: f64,
    /// Length of the longest record, in s.
    pub duration: f64,
    /// Largest first input (length of the voltage vector; throttle; command).
    pub input: f64,
    /// Effort at the first body that the inputs can cause: torque of the motor, force of the drive, torque at the wheel.
    pub effort: f64,
    /// Typical speed of the first body.
    pub speed: f64,
    /// Largest output that is read in these records, for each output of the plant.
    pub largest: [f64; OUTPUTS],
    /// Spread (standard deviation about the mean) of each output.
    pub spread: [f64; OUTPUTS],
    /// Noise of each output.
    pub noise: [f64; OUTPUTS],
    /// Waves of force over the position in what is left, the strongest first; of an axis.
    pub waves: Vec<Wave>,
    /// The smallest step between readings of each output, where they are multiples of one.
    pub quantum: [Option<f64>; OUTPUTS],
    /// The gears in which records run, first gear first; all false elsewhere.
    pub gears: [bool; 5],
    /// The named output, of an effect on one.
    pub output: usize,
    /// The nominal value of the named parameter, of an effect on one.
    pub nominal: f64,
    /// Sizes at the places of a plant of equations; empty elsewhere.
    pub scales: Vec<Scales>,
    /// Parameters that the plant file calls exact by a tolerance of 0: none of them can be in error.
    pub exact: Vec<&'static str>,
}

/// A force amplitude sin(2 pi q/pitch + phase) over the position of an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wave {
    /// In N.
    pub amplitude: f64,
    /// In m.
    pub pitch: f64,
    /// In rad.
    pub phase: f64,
}

/// Numbers of an effect at which a search begins, in the order of [`Description::arguments_on`]; NaN leaves an optional one out.
#[derive(Debug, Clone, PartialEq)]
pub struct Guess {
    /// The numbers.
    pub values: Vec<f64>,
    /// The number that scales the effect, and its value without effect: near it the effect grows in proportion.
    pub neutral: Option<(usize, f64)>,
    /// The number that is a phase: a quarter of a turn further the effect is another one.
    pub phase: Option<usize>,
}

impl Guess {
    /// Of an effect that its first number scales from a value without effect.
    #[must_use]
    pub fn scaled(values: Vec<f64>, without: f64) -> Self {
        Guess { values, neutral: Some((0, without)), phase: None }
    }

    /// Of an effect that no number scales.
    #[must_use]
    pub fn at(values: Vec<f64>) -> Self {
        Guess { values, neutral: None, phase: None }
    }
}

impl Description {
    /// The numbers that it takes on a plant.
    pub fn arguments_on(&self, plant: PlantKind) -> impl Iterator<Item = &'static Argument> {
        self.arguments.iter().filter(move |argument| argument.on.is_none_or(|on| on == plant))
    }

    /// The number of a name that it takes on a plant.
    #[must_use]
    pub fn argument(&self, plant: PlantKind, name: &str) -> Option<&'static Argument> {
        self.arguments_on(plant).find(|argument| argument.name == name)
    }
}

/// Position, speed and nominal viscous friction of a body (rad or m, per second).
#[derive(Debug, Clone, Copy)]
pub struct Motion {
    /// Angle or position.
    pub position: f64,
    /// Angular or linear speed.
    pub speed: f64,
    /// What the plant itself takes off, per unit of speed.
    pub viscous_friction: f64,
}

/// Electrical quantities of a motor at an instant, in the true rotor frame.
#[derive(Debug, Clone, Copy)]
pub struct Currents {
    /// Direct current, in A.
    pub i_d: f64,
    /// Quadrature current, in A.
    pub i_q: f64,
    /// Electrical angle, in rad.
    pub theta_e: f64,
}

/// What a motor's equations take as constant and an effect may not.
#[derive(Debug, Clone, Copy)]
pub struct Machine {
    /// Phase resistance, in ohm.
    pub resistance: f64,
    /// Phase inductance, in H.
    pub inductance: f64,
    /// Flux linkage, in Wb.
    pub flux_linkage: f64,
}

/// The flexible joints of a driveline.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Joint {
    /// Between engine and transmission, engine side.
    Clutch,
    /// Between final drive and wheel, wheel side.
    Driveshaft,
}

/// A joint at an instant.
#[derive(Debug, Clone, Copy)]
pub struct Twist {
    /// Which joint.
    pub joint: Joint,
    /// Its twist, in rad.
    pub angle: f64,
    /// Its rate, in rad/s.
    pub rate: f64,
    /// Nominal stiffness, in N m/rad.
    pub stiffness: f64,
    /// Nominal damping, in N m s/rad.
    pub damping: f64,
}

/// A body that is split at a joint of an effect.
#[derive(Debug, Clone, Copy)]
pub struct Split {
    /// The near side.
    pub near: Motion,
    /// Inertia or mass of the whole body.
    pub inertia: f64,
    /// What holds the far side back.
    pub load: f64,
    /// The piece of the law that is held, if one is.
    pub held: Option<u32>,
}

/// The law of a joint: what it carries, and to which of its pieces (0 to 3) the state belongs. The integrator places the instants at which the piece changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Carried {
    /// Torque or force.
    pub effort: f64,
    /// 0 where the law has a single piece.
    pub piece: u32,
}

/// The wheel on the road.
#[derive(Debug, Clone, Copy)]
pub struct Contact {
    /// r w_w, in m/s.
    pub surface_speed: f64,
    /// Everything that holds the vehicle back, in N.
    pub resistance: f64,
    /// Mass of the vehicle, in kg.
    pub mass: f64,
}

/// The true state at the start, for the states of effects.
#[derive(Debug, Clone, Copy)]
pub struct FirstInstant {
    /// Position and speed of the first body.
    pub motion: Motion,
    /// Road speed of a driveline, in m/s; 0 elsewhere.
    pub road_speed: f64,
    /// The time of the record's first row, in s.
    pub time: f64,
}

/// What decides how fast an effect's own dynamics are, at an instant and in the span that follows.
#[derive(Debug, Clone, Copy)]
pub struct Scale {
    /// Inertia or mass of the whole body.
    pub inertia: f64,
    /// Inertia or mass that is left at the drive.
    pub drive_inertia: f64,
    /// The least speed of the first body in the span, without its sign, at the rate at which it changes now.
    pub slowest: f64,
    /// How fast that speed changes, without its sign.
    pub change: f64,
    /// Of a motor.
    pub windings: Windings,
    /// Of a driveline.
    pub vehicle: Vehicle,
}

/// What decides how fast a motor's effects are; zeros, and an inductance of 1, elsewhere.
#[derive(Debug, Clone, Copy)]
pub struct Windings {
    /// Nominal inductance, in H.
    pub inductance: f64,
    /// Decay of a current, r/L, and swing of current against speed, at the nominal inductance, in 1/s.
    pub decay: f64,
    /// See `decay`.
    pub swing: f64,
    /// Electrical speed, in rad/s, without sign.
    pub turning: f64,
    /// Least and largest length of the current vector in the span, at the rate at which it changes now, in A.
    pub current: (f64, f64),
    /// How fast the current vector moves, in A/s.
    pub change: f64,
}

/// What decides how fast a driveline's effects are; ones, and zeros for speeds and twists, elsewhere.
#[derive(Debug, Clone, Copy)]
pub struct Vehicle {
    /// Wheel inertia and radius.
    pub wheel: (f64, f64),
    /// Speed of the vehicle, in m/s.
    pub speed: f64,
    /// Speed of the crank, in rad/s.
    pub crank_speed: f64,
    /// Sum of the inverse inertias on both sides of the clutch, at the engine, in 1/(kg m^2).
    pub clutch_mobility: f64,
    /// Stiffness of the clutch; its largest twist in the span, in rad: what there is, or what the engine can ask for; its rate, in rad/s, without sign.
    pub clutch: (f64, f64, f64),
    /// The swing of each joint on its spring, clutch and driveshaft, in rad/s.
    pub swing: (f64, f64),
}

impl Scale {
    /// Of bodies alone: their inertias, speed and acceleration of the first, the length of the span.
    #[must_use]
    pub fn of(inertia: f64, drive_inertia: f64, motion: (f64, f64), span: f64) -> Self {
        let (speed, change) = (motion.0.abs(), motion.1.abs());
        let slowest = (speed - span * change).max(0.0);
        let windings = Windings { inductance: 1.0, decay: 0.0, swing: 0.0, turning: 0.0, current: (0.0, 0.0), change: 0.0 };
        let vehicle = Vehicle {
            wheel: (1.0, 1.0),
            speed: 0.0,
            crank_speed: 0.0,
            clutch_mobility: 1.0,
            clutch: (1.0, 0.0, 0.0),
            swing: (1.0, 1.0),
        };
        Scale { inertia, drive_inertia, slowest, change, windings, vehicle }
    }
}

/// The hooks. Every one has a default that changes nothing.
#[allow(unused_variables)]
pub trait Effect: Send + Sync {
    /// Parameters: once, before the simulation.
    // mutant `body to ()`: it does nothing.
    fn parameters(&self, parameters: &mut Parameters) {}

    /// Inputs: the first input (both voltages of a motor) as it acts.
    fn input(&self, value: f64) -> f64 {
        value
    }

    /// Inputs: seconds by which the first input acts later.
    fn delay(&self) -> f64 {
        0.0
    }

    /// Readings: seconds by which an output is read late.
    fn reads_late(&self, _output: usize) -> f64 {
        0.0
    }

    /// Whether it acts between rows: false where it has no hooks but those of parameters, inputs, starts, rates and readings. The others are then not called.
    fn acts_between_rows(&self) -> bool {
        true
    }

    /// Extra states: how many.
    fn states(&self) -> usize {
        0
    }

    /// Extra states: their start.
    // mutant `body to ()`: it does nothing.
    fn start(&self, start: &FirstInstant, own: &mut [f64]) {}

    /// Extra states: those that follow outputs, at rest with what the effects before this one read.
    // mutant `body to ()`: it does nothing.
    fn settle(&self, outputs: &[f64; 3], own: &mut [f64]) {}

    /// The fastest rate, in 1/s, that it brings into the equations.
    fn fastest_rate(&self, scale: &Scale) -> f64 {
        0.0
    }

    /// What of that rate a linear part of the equations leaves, in 1/s: all of it, unless the effect is linear or nearly so. Where its law has pieces, the
    /// rate at which they may change.
    fn nonlinear_rate(&self, scale: &Scale) -> f64 {
        self.fastest_rate(scale)
    }

    /// Whether one of its laws has pieces.
    fn has_pieces(&self) -> bool {
        false
    }

    /// Frame: how far the frame of the record is turned against the true one, in rad.
    fn frame_angle(&self, theta: f64) -> f64 {
        0.0
    }

    /// Frame: the voltage that the bus allows.
    fn voltage_limit(&self, voltage: [f64; 2]) -> [f64; 2] {
        voltage
    }

    /// Frame: the voltage that reaches the windings.
    fn voltage_loss(&self, voltage: [f64; 2], current: [f64; 2]) -> [f64; 2] {
        voltage
    }

    /// Parameters of a motor that depend on its state.
    // mutant `body to ()`: it does nothing.
    fn machine(&self, at: &Currents, own: &[f64], rates: &mut [f64], machine: &mut Machine) {}

    /// Effort on the first body (rotor, carriage, wheel), positive forward.
    fn effort(&self, motion: &Motion) -> f64 {
        0.0
    }

    /// Effort of the load, positive against forward motion.
    fn load(&self, own: &[f64], rates: &mut [f64]) -> f64 {
        0.0
    }

    /// The share of the body's inertia that stands behind a joint of its own.
    fn split(&self) -> Option<f64> {
        None
    }

    /// Position and speed of the body behind that joint.
    fn far_motion(&self, own: &[f64]) -> Motion {
        Motion { position: 0.0, speed: 0.0, viscous_friction: 0.0 }
    }

    /// The law of that joint: the effort that holds the near body back; moves the far one.
    fn passes(&self, body: &Split, own: &[f64], rates: &mut [f64]) -> Carried {
        Carried { effort: body.load, piece: 0 }
    }

    /// Law of a joint of the plant. Where a piece is held, the law follows it beyond its end.
    fn joint(&self, twist: &Twist, effort: f64, held: Option<u32>) -> Carried {
        Carried { effort, piece: 0 }
    }

    /// Law of a joint: what it can carry at most, after every [`Effect::joint`].
    fn joint_limit(&self, joint: Joint, effort: f64, held: Option<u32>) -> Carried {
        Carried { effort, piece: 0 }
    }

    /// Law of a joint: its free play, in rad.
    fn slack(&self, joint: Joint) -> f64 {
        0.0
    }

    /// Effort of an engine at its crank angle.
    fn engine_torque(&self, torque: f64, crank_angle: f64) -> f64 {
        torque
    }

    /// Speed of the air against a vehicle, in m/s.
    fn air_speed(&self, speed: f64) -> f64 {
        speed
    }

    /// Extra state: the speed of a vehicle that does not follow its wheel.
    fn vehicle_speed(&self, own: &[f64]) -> Option<f64> {
        None
    }

    /// Law of the joint between wheel and road, in N; moves that vehicle.
    fn traction(&self, contact: &Contact, own: &[f64], rates: &mut [f64]) -> Option<f64> {
        None
    }

    /// Outputs: what is read of an output, after the effects before this one.
    fn reads(&self, output: usize, value: f64, time: f64, own: &[f64], rates: &mut [f64]) -> f64 {
        value
    }

    /// Outputs: whether [`Effect::reads`] moves a state.
    fn reads_with_memory(&self) -> bool {
        false
    }

    /// Outputs: the way back, for the start.
    fn truth(&self, output: usize, reading: f64, time: f64) -> f64 {
        reading
    }
}

/// tanh(x/x_s): the sign of x, smooth over x_s.
#[must_use]
pub fn smooth_sign(x: f64, scale: f64) -> f64 {
    (x / scale).tanh()
}

/// Its slope, 1/x_s at 0.
fn smooth_sign_slope(x: f64, scale: f64) -> f64 {
    let sign = smooth_sign(x, scale);
    (1.0 - sign * sign) / scale
}

/// How fast a level with the smooth sign of the speed is, in 1/s: its steepest slope in the span over the inertia. A speed that passes through the width of the sign faster than
/// the slope turns it sees a kink, whose mark grows with slope and step: then the geometric mean of slope and passing.
#[must_use]
pub fn smooth_sign_rate(level: f64, width: f64, scale: &Scale) -> f64 {
    let slope = level * smooth_sign_slope(scale.slowest, width) / scale.drive_inertia;
    slope.max((slope * scale.change / width).sqrt())
}

/// Width of the smooth sign on a rotor, in rad/s (docs/book/src/reference/plants.md, section 3).
pub const ROTOR_SIGN_WIDTH: f64 = 1.0;

/// Width of the smooth sign on an axis, in m/s (docs/book/src/reference/plants.md, section 3).
pub const AXIS_SIGN_WIDTH: f64 = 1e-3;

/// The width on a plant.
#[must_use]
pub fn sign_width(plant: PlantKind) -> f64 {
    if plant == PlantKind::ServoAxis { AXIS_SIGN_WIDTH } else { ROTOR_SIGN_WIDTH }
}

#[cfg(test)]
mod tests;

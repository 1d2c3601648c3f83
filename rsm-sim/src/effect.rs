//! The interface of an effect: its description, and the hooks by which it changes a plant.
//!
//! In: the arguments of an effect from a plant file. Out: an object with the hooks that the effect needs; the other hooks change nothing. A hook does
//! not allocate memory and does not store data between calls. If an effect has a memory, this memory is a state that is integrated together with the
//! states of the plant.

pub mod declared;

use crate::kind::{OUTPUTS, PlantKind};
use crate::parameters::Parameters;

pub use declared::{Argument, Declared, Plausible, Role, Step, Unit};

/// The kind of name that an effect needs in addition to its numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Subject {
    /// No name.
    None,
    /// `parameter`: a nominal parameter of the plant.
    Parameter,
    /// `output`: an output of the plant.
    Output,
    /// `at`: a site or an input of a plant of equations.
    Site,
}

/// An effect in a plant file.
#[derive(Debug, Clone)]
pub struct Entry {
    /// The effect.
    pub description: &'static Description,
    /// Its arguments.
    pub arguments: Arguments,
}

/// The arguments of one effect, as written in a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Arguments {
    /// The plant of the effect.
    pub plant: PlantKind,
    /// The named parameter or output, if the effect needs one.
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
    /// If the number is missing. The reader of plant files refuses such an effect.
    #[must_use]
    pub fn number(&self, name: &str) -> f64 {
        self.optional(name)
            .unwrap_or_else(|| panic!("the effect's required number `{name}` was checked when the file was read"))
    }

    /// The number of the first of two names that is present: `torque` for a rotor, `force` for an axis.
    #[must_use]
    pub fn either(&self, first: &str, second: &str) -> f64 {
        self.optional(first).unwrap_or_else(|| self.number(second))
    }

    /// The index of the named output.
    ///
    /// # Panics
    /// If there is no such output. The reader of plant files refuses such an effect.
    #[must_use]
    pub fn output(&self) -> usize {
        let name = self.subject.as_deref().expect("an effect on an output names it");
        self.plant.output(name).expect("the output was checked when the file was read")
    }
}

/// The start points of a search for the numbers of an effect, computed from the scales of the records.
pub enum Guesses {
    /// Computed by code.
    Code(fn(&Survey) -> Vec<Guess>),
    /// Computed from the file of the effect, at one place of a plant.
    File(Box<FromFile>),
}

/// A function that computes guesses from the scales of the records.
pub type FromFile = dyn Fn(&Survey) -> Vec<Guess> + Send + Sync;

impl Guesses {
    /// The start points.
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

/// The magnitudes of the quantities at a place where effects can act, by name: the roles of a site, and the scales that effect files define.
#[derive(Debug, Clone, PartialEq)]
pub struct Scales {
    /// The place.
    pub at: String,
    /// The magnitudes, each with its name.
    pub sizes: Vec<(String, f64)>,
}

/// The description of an effect for plant files, reports and tests.
#[derive(Debug)]
pub struct Description {
    /// The name of the kind in a plant file: the name of the source file with `-` in place of `_`.
    pub kind: &'static str,
    /// The plants of format 1 to which the effect can be added.
    pub plants: &'static [&'static str],
    /// Whether the effect refers to a parameter, an output or a site.
    pub subject: Subject,
    /// For an effect of a plant of equations, the only place where it acts; `None` if any name of the right kind is permitted.
    pub at: Option<&'static str>,
    /// Its numbers.
    pub arguments: &'static [Argument],
    /// The sentence in the report; `{name}` is replaced by an argument with its unit.
    pub sentence: &'static str,
    /// A sentence: how an engineer can verify the effect by a measurement or an inspection.
    pub check: &'static str,
    /// Builds the effect.
    pub build: fn(&Arguments) -> Box<dyn Effect>,
    /// The start points of a search for its numbers.
    pub guesses: Guesses,
    /// Further data for a search.
    pub declared: Declared,
}

/// The magnitudes of quantities in the records and the nominal plant. They are the scales of the first guesses.
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
    /// The largest effort at the first body that the inputs can cause: torque of the motor, force of the drive, torque at the wheel.
    pub effort: f64,
    /// Typical speed of the first body.
    pub speed: f64,
    /// The largest reading in these records, for each output of the plant.
    pub largest: [f64; OUTPUTS],
    /// Spread (standard deviation about the mean) of each output.
    pub spread: [f64; OUTPUTS],
    /// The noise of each output.
    pub noise: [f64; OUTPUTS],
    /// For an axis: periodic forces over the position in the residuals, the strongest first.
    pub waves: Vec<Wave>,
    /// The quantum of each output, if its readings are integer multiples of one.
    pub quantum: [Option<f64>; OUTPUTS],
    /// Parameters that occur in no equation of any record.
    pub unused: Vec<&'static str>,
    /// The index of the named output, for an effect on an output.
    pub output: usize,
    /// The nominal value of the named parameter, for an effect on a parameter.
    pub nominal: f64,
    /// Magnitudes at the places of a plant of equations; empty for other plants.
    pub scales: Vec<Scales>,
    /// Parameters with a tolerance of 0 in the plant file. They are exact, so an error of them is not considered.
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

/// The numbers of an effect at which a search begins, in the order of [`Description::arguments_on`]. NaN means that an optional number is absent.
#[derive(Debug, Clone, PartialEq)]
pub struct Guess {
    /// The numbers.
    pub values: Vec<f64>,
    /// The index of the number that scales the effect, and its neutral value. Near the neutral value the effect is proportional to the difference.
    pub neutral: Option<(usize, f64)>,
    /// The index of the number that is a phase. A shift by a quarter of a period gives an independent second effect.
    pub phase: Option<usize>,
}

impl Guess {
    /// A guess for an effect that is scaled by its first number; `without` is the neutral value.
    #[must_use]
    pub fn scaled(values: Vec<f64>, without: f64) -> Self {
        Guess { values, neutral: Some((0, without)), phase: None }
    }

    /// A guess for an effect that is not scaled by a number.
    #[must_use]
    pub fn at(values: Vec<f64>) -> Self {
        Guess { values, neutral: None, phase: None }
    }
}

impl Description {
    /// The numbers of the effect on a plant.
    pub fn arguments_on(&self, plant: PlantKind) -> impl Iterator<Item = &'static Argument> {
        self.arguments.iter().filter(move |argument| argument.on.is_none_or(|on| plant.is(on)))
    }

    /// The number with this name on a plant.
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
    /// The effort that the plant's own equations subtract, per unit of speed.
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

/// The constants in a motor's equations that an effect can change.
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

/// A body that an effect splits in two by a joint.
#[derive(Debug, Clone, Copy)]
pub struct Split {
    /// The near side.
    pub near: Motion,
    /// Inertia or mass of the whole body.
    pub inertia: f64,
    /// The load on the far side.
    pub load: f64,
    /// The held piece of the law, if there is one.
    pub held: Option<u32>,
}

/// The result of a joint's law: the effort, and the piece (0 to 3) to which the state belongs. The integrator locates the instants at which the piece
/// changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Carried {
    /// Torque or force.
    pub effort: f64,
    /// The piece; 0 if the law has a single piece.
    pub piece: u32,
}

/// The wheel on the road.
#[derive(Debug, Clone, Copy)]
pub struct Contact {
    /// The speed r w_w of the tyre's surface, in m/s.
    pub surface_speed: f64,
    /// The sum of all resistances of the vehicle, in N.
    pub resistance: f64,
    /// Mass of the vehicle, in kg.
    pub mass: f64,
}

/// The true state at the start, from which the states of effects are set.
#[derive(Debug, Clone, Copy)]
pub struct FirstInstant {
    /// Position and speed of the first body.
    pub motion: Motion,
    /// Road speed of a driveline, in m/s; 0 for other plants.
    pub road_speed: f64,
    /// The time of the record's first row, in s.
    pub time: f64,
}

/// The quantities that determine the rates of an effect, at an instant and in the span after it.
#[derive(Debug, Clone, Copy)]
pub struct Scale {
    /// Inertia or mass of the whole body.
    pub inertia: f64,
    /// Inertia or mass that remains at the drive.
    pub drive_inertia: f64,
    /// The smallest magnitude of the first body's speed in the span, extrapolated with its present acceleration.
    pub slowest: f64,
    /// The magnitude of the acceleration of this body.
    pub change: f64,
    /// The quantities of a motor.
    pub windings: Windings,
    /// The quantities of a driveline.
    pub vehicle: Vehicle,
}

/// The quantities that determine the rates of a motor's effects. For other plants all are 0, except the inductance, which is 1.
#[derive(Debug, Clone, Copy)]
pub struct Windings {
    /// Nominal inductance, in H.
    pub inductance: f64,
    /// The decay rate of a current, r/L plus the decay rate of the speed, at the nominal inductance, in 1/s.
    pub decay: f64,
    /// The angular frequency of the oscillation of current against speed, at the nominal inductance, in 1/s.
    pub swing: f64,
    /// The magnitude of the electrical speed, in rad/s.
    pub turning: f64,
    /// Minimum and maximum length of the current vector in the span, extrapolated with its present derivative, in A.
    pub current: (f64, f64),
    /// The magnitude of the current vector's derivative, in A/s.
    pub change: f64,
}

/// The quantities that determine the rates of a driveline's effects. For other plants all are 1, except speeds and twists, which are 0.
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
    /// Stiffness of the clutch; its largest twist in the span, in rad (the present twist, or the twist that the engine can produce); the magnitude of
    /// its twist rate, in rad/s.
    pub clutch: (f64, f64, f64),
    /// The natural frequencies of clutch and driveshaft, in rad/s.
    pub swing: (f64, f64),
}

impl Scale {
    /// The scale of a plant with bodies only: their inertias, speed and acceleration of the first body, the length of the span.
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

/// The hooks. The default of each hook changes nothing.
#[allow(unused_variables)]
pub trait Effect: Send + Sync {
    /// Parameters: changes them once, before the simulation.
    // mutant `body to ()`: it does nothing.
    fn parameters(&self, parameters: &mut Parameters) {}

    /// Inputs: changes the first input (both voltages of a motor).
    fn input(&self, value: f64) -> f64 {
        value
    }

    /// Inputs: the delay of the first input, in s.
    fn delay(&self) -> f64 {
        0.0
    }

    /// Readings: the delay of an output's readings, in s.
    fn reads_late(&self, _output: usize) -> f64 {
        0.0
    }

    /// Whether the effect acts between rows. False if it has only hooks of parameters, inputs, starts, rates and readings; then the others are not
    /// called.
    fn acts_between_rows(&self) -> bool {
        true
    }

    /// Extra states: their number.
    fn states(&self) -> usize {
        0
    }

    /// Extra states: sets their start.
    // mutant `body to ()`: it does nothing.
    fn start(&self, start: &FirstInstant, own: &mut [f64]) {}

    /// Extra states: sets the states that depend on outputs to their steady state for the readings of the previous effects.
    // mutant `body to ()`: it does nothing.
    fn settle(&self, outputs: &[f64; 3], own: &mut [f64]) {}

    /// The fastest rate that the effect adds to the equations, in 1/s.
    fn fastest_rate(&self, scale: &Scale) -> f64 {
        0.0
    }

    /// The rate that remains after the linear part of the equations is subtracted, in 1/s. This is the full rate, unless the effect is linear or
    /// almost linear. For a law in pieces it is the rate at which the pieces can change.
    fn nonlinear_rate(&self, scale: &Scale) -> f64 {
        self.fastest_rate(scale)
    }

    /// Whether one of its laws is defined in pieces.
    fn has_pieces(&self) -> bool {
        false
    }

    /// Frame: the angle between the frame of the record and the true one, in rad.
    fn frame_angle(&self, theta: f64) -> f64 {
        0.0
    }

    /// Frame: the voltage after the limit of the bus.
    fn voltage_limit(&self, voltage: [f64; 2]) -> [f64; 2] {
        voltage
    }

    /// Frame: the voltage at the windings, after the loss of the inverter.
    fn voltage_loss(&self, voltage: [f64; 2], current: [f64; 2]) -> [f64; 2] {
        voltage
    }

    /// Sets the parameters of a motor that depend on its state.
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

    /// The share of the body's inertia that the effect moves behind its own joint.
    fn split(&self) -> Option<f64> {
        None
    }

    /// Position and speed of the body behind that joint.
    fn far_motion(&self, own: &[f64]) -> Motion {
        Motion { position: 0.0, speed: 0.0, viscous_friction: 0.0 }
    }

    /// The law of that joint: returns the effort on the near body and computes the derivatives of the far body.
    fn passes(&self, body: &Split, own: &[f64], rates: &mut [f64]) -> Carried {
        Carried { effort: body.load, piece: 0 }
    }

    /// Law of a joint of the plant. If a piece is held, its law is also used outside of the piece's range.
    fn joint(&self, twist: &Twist, effort: f64, held: Option<u32>) -> Carried {
        Carried { effort, piece: 0 }
    }

    /// Law of a joint: limits the effort. It is called after every [`Effect::joint`].
    fn joint_limit(&self, joint: Joint, effort: f64, held: Option<u32>) -> Carried {
        Carried { effort, piece: 0 }
    }

    /// Law of a joint: its free play, in rad.
    fn slack(&self, joint: Joint) -> f64 {
        0.0
    }

    /// The torque of an engine at its crank angle.
    fn engine_torque(&self, torque: f64, crank_angle: f64) -> f64 {
        torque
    }

    /// Speed of the air against a vehicle, in m/s.
    fn air_speed(&self, speed: f64) -> f64 {
        speed
    }

    /// Extra state: the speed of a vehicle if the wheel can slip.
    fn vehicle_speed(&self, own: &[f64]) -> Option<f64> {
        None
    }

    /// Law of the contact between wheel and road: returns the force in N and computes the derivative of the vehicle's speed.
    fn traction(&self, contact: &Contact, own: &[f64], rates: &mut [f64]) -> Option<f64> {
        None
    }

    /// Outputs: the reading of an output; `value` is the reading after the previous effects.
    fn reads(&self, output: usize, value: f64, time: f64, own: &[f64], rates: &mut [f64]) -> f64 {
        value
    }

    /// Outputs: whether [`Effect::reads`] computes the derivative of a state.
    fn reads_with_memory(&self) -> bool {
        false
    }

    /// Outputs: the inverse of [`Effect::reads`], for the start.
    fn truth(&self, output: usize, reading: f64, time: f64) -> f64 {
        reading
    }
}

/// The formula tanh(x/x_s): a smooth sign of x with the width x_s.
#[must_use]
pub fn smooth_sign(x: f64, scale: f64) -> f64 {
    (x / scale).tanh()
}

/// The slope of the smooth sign: 1/x_s at 0.
fn smooth_sign_slope(x: f64, scale: f64) -> f64 {
    let sign = smooth_sign(x, scale);
    (1.0 - sign * sign) / scale
}

/// The rate of an effort with the smooth sign of the speed, in 1/s: its steepest slope in the span, divided by the inertia. If the speed passes
/// through the width of the sign faster than this rate, the sign acts like a kink, and the error of a step grows with slope and step. Then the rate
/// is the geometric mean of the slope's rate and the rate of passing.
#[must_use]
pub fn smooth_sign_rate(level: f64, width: f64, scale: &Scale) -> f64 {
    let slope = level * smooth_sign_slope(scale.slowest, width) / scale.drive_inertia;
    slope.max((slope * scale.change / width).sqrt())
}

/// Width of the smooth sign on a rotor, in rad/s (docs/book/src/reference/plants.md, section 3).
pub const ROTOR_SIGN_WIDTH: f64 = 1.0;

/// Width of the smooth sign on an axis, in m/s (docs/book/src/reference/plants.md, section 3).
pub const AXIS_SIGN_WIDTH: f64 = 1e-3;

/// The width of the smooth sign for a plant.
#[must_use]
pub fn sign_width(plant: PlantKind) -> f64 {
    if plant.is("servo-axis") { AXIS_SIGN_WIDTH } else { ROTOR_SIGN_WIDTH }
}

#[cfg(test)]
mod tests;

//! The reference step of `targets/motor-loop/src/references.rs` over ranges, operation by operation.
//!
//! In: ranges of what the step computes from. Out: ranges of what it computes, in f32. For ranges that are points it is the step itself: a
//! test that may import both compares the bits. Never decides anything about limits.
//!
//! The step has two parts. [`Step::wanted`] gives the wanted i_q: the torque demand within the limit that the surface `limit_current` gives.
//! [`Step::currents`] gives the currents, from the wanted i_q and the scaled speed alone.

use rsm_core::check::Checked;
use rsm_core::lower;
use rsm_core::number::Precision;
use rsm_core::source::{Fault, Faults};
use rsm_core::tape::Tape;
use rsm_core::values::Values;
use rsm_fit::units::Conversion;

use super::range::{Range, of_tape};
use rsm_sim::plant_file::Parameters;

/// `circle::LONGEST_LEG` of the target.
const LONGEST_LEG: f32 = 0.948_683_2;

/// `references::FOLD_SPEED_RAD_S` of the target: beyond this circle speed the surfaces are asked at it.
const FOLD_SPEED_RAD_S: f32 = 780.0;

/// `references::FOLD_PER_RAD_S` of the target: 1/the circle speed beyond it at which no torque is left.
const FOLD_PER_RAD_S: f32 = 1.0 / 780.0;

/// `drive::STEEPER` of the target.
const STEEPER: f32 = 1.25;

/// `circle::HELD_BACK` of the target: the square of the radius of the circle whose other leg is taken.
const HELD_BACK: f32 = 0.9996;

/// The constants of `Drive` that the step uses, made as `Drive::new` makes them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Constants {
    /// k_t, in N m/A.
    pub newton_metres_per_ampere: f32,
    /// 1/k_t.
    pub amperes_per_newton_metre: f32,
    /// I, in A.
    pub current_limit_a: f32,
    /// 1/I.
    pub per_ampere: f32,
    /// The bus voltage at which the surfaces were measured, in V.
    pub nominal_bus_v: f32,
    /// How much weakening a speed beyond the surfaces takes, in A s/rad.
    pub weakening_per_speed: f32,
}

impl Constants {
    /// Of a plant of kind `pmac`, whose parameters become f32 before anything is computed from them.
    ///
    /// # Panics
    /// When the parameters are not those of a `pmac` plant.
    #[must_use]
    pub fn new(parameters: &Parameters) -> Self {
        let number = |name: &str| parameters.number(name) as f32;
        let (pole_pairs, lambda, l) = (number("pole_pairs"), number("flux_linkage"), number("phase_inductance"));
        let edge = FOLD_SPEED_RAD_S * FOLD_SPEED_RAD_S;
        Constants {
            newton_metres_per_ampere: 1.5 * pole_pairs * lambda,
            amperes_per_newton_metre: 1.0 / (1.5 * pole_pairs * lambda),
            current_limit_a: number("current_limit"),
            per_ampere: 1.0 / number("current_limit"),
            nominal_bus_v: number("bus_voltage"),
            // 0.577_350_26: 1/sqrt 3.
            weakening_per_speed: STEEPER * 0.95 * 0.577_350_26 * number("bus_voltage") / (pole_pairs * edge * l),
        }
    }
}

/// The tapes of the surfaces that the step asks, in f32.
#[derive(Debug, Clone)]
pub struct Tapes {
    weakening: Tape,
    limit: Tape,
}

impl Tapes {
    /// Of a model with the surfaces `weakening_current` (torque, speed) and `limit_current` (torque, current, speed), in N*m, A and rad/s: what
    /// the step passes them is in these units.
    ///
    /// # Errors
    /// A surface that is missing or has other inputs or units; a model that f32 cannot hold.
    pub fn new(model: &Checked) -> Result<Self, Faults> {
        if let Some(faults) = model.refusal(Precision::F32) {
            return Err(faults);
        }
        Ok(Tapes {
            weakening: tape(model, "weakening_current", &[("torque", "N*m"), ("speed", "rad/s")])?,
            limit: tape(model, "limit_current", &[("torque", "N*m"), ("current", "A"), ("speed", "rad/s")])?,
        })
    }
}

/// The tape of a surface that must have these inputs in these units and a response in A.
fn tape(model: &Checked, name: &str, inputs: &[(&str, &str)]) -> Result<Tape, Faults> {
    let refuse = |what: String| Faults::one(Fault::whole_file(model.file(), what));
    let Some(index) = model.model().surfaces.iter().position(|surface| surface.name == name) else {
        let others: Vec<&str> = model.model().surfaces.iter().map(|surface| surface.name.as_str()).collect();
        let found = if others.is_empty() { "none".to_string() } else { others.join(", ") };
        return Err(refuse(format!("the motor's loop needs the surface `{name}`; the model has {found}")));
    };
    let surface = &model.model().surfaces[index];
    let expected: Vec<&str> = inputs.iter().map(|(name, _)| *name).collect();
    if surface.inputs != expected {
        let found = surface.inputs.join(", ");
        return Err(refuse(format!("surface `{name}`: found the inputs {found}, expected {}", expected.join(", "))));
    }
    let own = model.inputs_of(surface);
    let units = own.iter().map(|input| (input.name.as_str(), input.unit.as_str())).zip(inputs.iter().map(|(_, unit)| *unit));
    for ((what, found), unit) in units.chain([((name, surface.unit.as_str()), "A")]) {
        // The factor between the two units must be 1: the loop passes numbers without conversion.
        let is_same = Conversion::between(found, unit).is_ok_and(|way| way.apply(1.0) == 1.0 && way.apply(0.0) == 0.0);
        if !is_same {
            return Err(refuse(format!("surface `{name}`: `{what}` is in {found}, the motor's loop has it in {unit}")));
        }
    }
    Ok(lower::surface(model, index, Precision::F32))
}

/// i_d and i_q, for a motor that turns forwards.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Currents {
    /// i_d, in A.
    pub i_d: Range,
    /// i_q, in A.
    pub i_q: Range,
}

/// The step.
#[derive(Debug)]
pub struct Step<'t> {
    /// Its constants.
    pub constants: Constants,
    weakening: Values<'t>,
    limit: Values<'t>,
}

impl<'t> Step<'t> {
    /// The step around these surfaces.
    #[must_use]
    pub fn new(constants: Constants, tapes: &'t Tapes) -> Self {
        let [weakening, limit] = [&tapes.weakening, &tapes.limit].map(Values::new);
        Step { constants, weakening, limit }
    }

    /// The longest i_d, in A.
    #[must_use]
    pub fn most_weakening(&self) -> f32 {
        LONGEST_LEG * self.constants.current_limit_a
    }

    /// The speed at which the surfaces are asked: that with the voltage circle of this bus, in rad/s.
    #[must_use]
    pub fn circle_speed(&self, speed: Range, bus_voltage: Range) -> Range {
        speed * (Range::point(self.constants.nominal_bus_v) / bus_voltage)
    }

    /// The most i_q that is asked for, in A: what the surface `limit_current` leaves of the current limit, at the torque of the last tick; folded
    /// back beyond the surfaces.
    pub fn most(&mut self, last_torque: Range, circle_speed: Range) -> Range {
        let limit = Range::point(self.constants.current_limit_a);
        let most_weakening = Range::point(self.most_weakening());
        let (asked, beyond) = edge(circle_speed);
        let fold = (Range::point(1.0) - beyond * Range::point(FOLD_PER_RAD_S)).at_least(0.0);
        let found = of_tape(&mut self.limit, [last_torque, limit, asked]);
        let at_limit = found.within(Range::point(0.0), most_weakening) * Range::point(self.constants.per_ampere);
        fold * (limit * other_leg(at_limit * at_limit))
    }

    /// The i_q that a torque demand asks for, in A, after a tick with the torque `last_torque`; both forwards.
    pub fn wanted(&mut self, torque: Range, last_torque: Range, circle_speed: Range) -> Range {
        let most = self.most(last_torque, circle_speed);
        (self.constants.amperes_per_newton_metre * torque).within(-most, most)
    }

    /// The current references for a wanted i_q; `trim` is what the feedback of the voltage adds to the weakening current.
    pub fn currents(&mut self, wanted: Range, circle_speed: Range, trim: Range) -> Currents {
        let most_weakening = Range::point(self.most_weakening());
        let (asked, beyond) = edge(circle_speed);
        let torque = self.constants.newton_metres_per_ampere * wanted;
        let surface = of_tape(&mut self.weakening, [torque, asked]);
        let weakening = surface + (beyond * Range::point(self.constants.weakening_per_speed) + trim);
        let i_d = -weakening.within(Range::point(0.0), most_weakening);
        let most = self.most_beside(i_d);
        Currents { i_d, i_q: wanted.within(-most, most) }
    }

    /// The most i_q beside an i_d, in A, by the current circle.
    pub fn most_beside(&self, i_d: Range) -> Range {
        let share = self.constants.per_ampere * i_d;
        self.constants.current_limit_a * other_leg(share * share)
    }
}

/// The second coordinate of a point on a circle of radius 1, from the square of the first.
fn other_leg(square: Range) -> Range {
    (Range::point(HELD_BACK) - square).root()
}

/// The circle speed at which the surfaces are asked, and how far the speed is beyond.
fn edge(circle_speed: Range) -> (Range, Range) {
    // s - min(s, edge) is a step of s alone, and monotone: its ends are those of the difference at the ends of s.
    let asked = |speed: f32| speed.min(FOLD_SPEED_RAD_S);
    let beyond = |speed: f32| speed - asked(speed);
    let Range { low, high } = circle_speed;
    (Range::ends(asked(low), asked(high)), Range::ends(beyond(low), beyond(high)))
}

//! Free play in a joint.
//!
//! Formula      twist phi becomes phi - clamp(phi, -gap/2, gap/2), the damper acts in contact only; on the axis the drive has the mass (1 - rho) M
//!              and the carriage rho M; sensors and friction remain at the drive
//! Source       M. Nordin, P.-O. Gutman, 2002 (survey of backlash models); docs/book/src/reference/plants.md, section 3
//! Acts on      the driveshaft; the joint between drive and carriage
//! Looks like   shaft compliance, coulomb friction at reversals
//! Told apart   by a reversal of the load under small amplitudes
//! Report says  "There is a free play of {gap} in the drive."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{
    Argument, Arguments, Carried, Declared, Description, Effect, FirstInstant, Guess, Joint, Motion, Scale, Split, Subject,
    Survey, Twist, Unit,
};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "backlash",
    plants: &["driveline", "servo-axis"],
    subject: Subject::None,
    at: None,
    arguments: &[
        Argument::new("gap", Unit::Gap, Bound::NotNegative),
        Argument::new("mass_ratio", Unit::Is("1"), Bound::Between(0.0, 1.0)).on("servo-axis"),
        Argument::new("stiffness", Unit::Is("N/m"), Bound::Positive).on("servo-axis"),
        Argument::new("damping", Unit::Is("N*s/m"), Bound::NotNegative).on("servo-axis"),
    ],
    sentence: "There is a free play of {gap} in the drive.",
    check: "Hold the drive and move the load by hand, or reverse it under a small torque, and measure the free play between the two.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::NOTHING,
};

struct Backlash {
    half_gap: f64,
    /// The joint of an axis; `None` for a driveline.
    far: Option<Far>,
}

/// The body behind the joint of an axis, and the stiffness and damping of the contact.
struct Far {
    ratio: f64,
    stiffness: f64,
    damping: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(Backlash {
        half_gap: arguments.number("gap") / 2.0,
        far: (arguments.plant.is("servo-axis")).then(|| Far {
            ratio: arguments.number("mass_ratio"),
            stiffness: arguments.number("stiffness"),
            damping: arguments.number("damping"),
        }),
    })
}

impl Backlash {
    /// The effort of the contact. The piece is 0 if the joint is open, 1 in forward contact, 2 in backward contact.
    fn contact(&self, twist: f64, rate: f64, stiffness: f64, damping: f64, held: Option<u32>) -> Carried {
        let piece = if twist > self.half_gap { 1 } else { 2 * u32::from(twist < -self.half_gap) };
        let effort = match held.unwrap_or(piece) {
            0 => 0.0,
            1 => stiffness * (twist - self.half_gap) + damping * rate,
            _ => stiffness * (twist + self.half_gap) + damping * rate,
        };
        Carried { effort, piece }
    }
}

fn guesses(survey: &Survey) -> Vec<Guess> {
    // On the driveshaft one and four degrees. On the axis shares of the travel from a hundredth of a per cent, with a ratio of 2.7: a gap with other
    // contact instants has its own minimum, and from a guess that is wrong by a factor of seven no fit converges. The contacts have three
    // stiffnesses, an octave of frequency apart.
    if survey.plant.is("driveline") {
        return vec![Guess::at(vec![0.0175]), Guess::at(vec![0.07])];
    }
    let mass = survey.parameters.number("mass");
    let mut guesses = Vec::new();
    for gap in [1e-4, 2.7e-4, 7e-4, 1.9e-3, 5e-3] {
        for (ratio, share) in [(0.33, 0.012), (0.67, 0.012), (0.33, 0.025), (0.67, 0.025), (0.33, 0.05), (0.67, 0.05)] {
            let rate = std::f64::consts::TAU * share / survey.period;
            let reduced = mass * ratio * (1.0 - ratio);
            let gap = gap * survey.largest[0];
            guesses.push(Guess::at(vec![gap, ratio, rate * rate * reduced, 2.0 * 0.2 * rate * reduced]));
        }
    }
    guesses
}

impl Effect for Backlash {
    fn slack(&self, joint: Joint) -> f64 {
        if joint == Joint::Driveshaft { 2.0 * self.half_gap } else { 0.0 }
    }

    fn joint(&self, twist: &Twist, effort: f64, held: Option<u32>) -> Carried {
        if twist.joint != Joint::Driveshaft || self.far.is_some() {
            return Carried { effort, piece: 0 };
        }
        let linear = twist.stiffness * twist.angle + twist.damping * twist.rate;
        let Carried { effort: contact, piece } = self.contact(twist.angle, twist.rate, twist.stiffness, twist.damping, held);
        // Contributions of other effects to the linear law remain.
        Carried { effort: effort - linear + contact, piece }
    }

    fn states(&self) -> usize {
        if self.far.is_some() { 2 } else { 0 }
    }

    // The far body starts at the position and speed of the drive, so the joint is at rest.
    fn start(&self, start: &FirstInstant, own: &mut [f64]) {
        if self.far.is_some() {
            own.copy_from_slice(&[start.motion.position, start.motion.speed]);
        }
    }

    fn split(&self) -> Option<f64> {
        self.far.as_ref().map(|far| far.ratio)
    }

    fn far_motion(&self, own: &[f64]) -> Motion {
        Motion { position: own[0], speed: own[1], viscous_friction: 0.0 }
    }

    fn passes(&self, body: &Split, own: &[f64], rates: &mut [f64]) -> Carried {
        let Some(far) = &self.far else { return Carried { effort: body.load, piece: 0 } };
        let (twist, rate) = (body.near.position - own[0], body.near.speed - own[1]);
        let Carried { effort, piece } = self.contact(twist, rate, far.stiffness, far.damping, body.held);
        rates[0] = own[1];
        rates[1] = (effort - body.load) / (far.ratio * body.inertia);
        Carried { effort, piece }
    }

    fn has_pieces(&self) -> bool {
        true
    }

    // Within each piece the law is linear. A contact opens within half a period of the shaft's oscillation; with a quarter of this frequency at least
    // three steps fall into this time.
    fn nonlinear_rate(&self, scale: &Scale) -> f64 {
        if self.far.is_some() { self.fastest_rate(scale) } else { 0.25 * scale.vehicle.swing.1 }
    }

    // The natural frequency of the two bodies on the spring, and the rate of the damper against the lighter one. The rate is doubled, because every
    // contact excites the oscillation with the full relative speed. With half the step, a fourth-order method has a sixteenth of the error.
    fn fastest_rate(&self, scale: &Scale) -> f64 {
        let Some(far) = &self.far else { return 0.0 };
        let mobility = 1.0 / scale.drive_inertia + 1.0 / (far.ratio * scale.inertia);
        2.0 * (far.stiffness * mobility).sqrt().max(far.damping * mobility)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(numbers: &[(&'static str, f64)]) -> Box<dyn Effect> {
        build(&Arguments { plant: crate::equation_plant::driveline(), subject: None, numbers: numbers.to_vec() })
    }

    #[test]
    fn inside_the_gap_nothing_is_carried() {
        let play = made(&[("gap", 0.05)]);
        // The linear law gives 1000 * 0.02 + 10 * 1 = 30 inside the gap; at 0.035 the contact gives 1000 * 0.01 + 10 = 20.
        for (angle, linear, expected) in [(0.02, 30.0, 0.0), (0.035, 45.0, 20.0), (-0.035, -25.0, 0.0)] {
            let twist = Twist { joint: Joint::Driveshaft, angle, rate: 1.0, stiffness: 1000.0, damping: 10.0 };
            assert!((play.joint(&twist, linear, None).effort - expected).abs() < 1e-12);
        }
        assert_eq!([play.slack(Joint::Driveshaft), play.slack(Joint::Clutch)], [0.05, 0.0]);
    }
}

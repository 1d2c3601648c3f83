//! Friction that decreases with speed from its static level to its Coulomb level.
//!
//! Formula      (F_c + (F_s - F_c) exp(-(v/v_st)^2)) tanh(v/v_s)
//! Source       R. Stribeck, 1902; B. Armstrong-Helouvry, P. Dupont, C. Canudas de Wit, 1994; docs/book/src/reference/plants.md, section 3
//! Acts on      effort at the rotor; force on the carriage
//! Looks like   coulomb friction at speed
//! Told apart   by slow motion around the Stribeck velocity
//! Report says  "Friction of {coulomb} rises to {static} below a speed of {stribeck_velocity}."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::declared::{Forms, FormsOf, Part};
use crate::effect::{
    Argument, Arguments, Declared, Description, Effect, Guess, Motion, Plausible, Scale, Subject, Survey, Unit, sign_width,
    smooth_sign, smooth_sign_rate,
};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "stribeck-friction",
    plants: &["pmac", "servo-axis"],
    subject: Subject::None,
    at: None,
    arguments: &[
        Argument::new("coulomb", Unit::Effort, Bound::NotNegative).plausible(Plausible::EffortOneWay).level(),
        Argument::new("static", Unit::Effort, Bound::NotNegative).plausible(Plausible::EffortOneWay).level(),
        Argument::new("stribeck_velocity", Unit::Speed, Bound::Positive).plausible(Plausible::Speed),
    ],
    sentence: "Friction of {coulomb} rises to {static} below a speed of {stribeck_velocity}.",
    check: "Drive at several constant speeds around the Stribeck velocity: the effort must fall as the speed rises.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared { generalises: Some("coulomb-friction"), forms: FormsOf::Code(forms), ..Declared::NOTHING },
};

/// At high speed it is a dry friction with the Coulomb level.
fn forms(arguments: &Arguments) -> Forms {
    Forms { special: vec![vec![Part::new("coulomb-friction", arguments.number("coulomb"))]], ..Forms::default() }
}

struct StribeckFriction {
    coulomb: f64,
    rise: f64,
    velocity: f64,
    width: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(StribeckFriction {
        coulomb: arguments.number("coulomb"),
        rise: arguments.number("static") - arguments.number("coulomb"),
        velocity: arguments.number("stribeck_velocity"),
        width: sign_width(arguments.plant),
    })
}

fn guesses(survey: &Survey) -> Vec<Guess> {
    // Stribeck velocities as shares of the typical speed, half a decade apart. A fit of the logarithm converges over this distance.
    [0.3, 0.1, 0.03, 0.01]
        .iter()
        .map(|share| Guess::at(vec![0.03 * survey.effort, 0.06 * survey.effort, share * survey.speed]))
        .collect()
}

impl Effect for StribeckFriction {
    fn effort(&self, motion: &Motion) -> f64 {
        let ratio = motion.speed / self.velocity;
        -(self.coulomb + self.rise * (-ratio * ratio).exp()) * smooth_sign(motion.speed, self.width)
    }

    // The slope at rest, or the slope of the decrease at higher speed: the steepest slope of exp(-x^2) is 0.86 at x = 0.71.
    fn fastest_rate(&self, scale: &Scale) -> f64 {
        let rest = smooth_sign_rate((self.coulomb + self.rise).max(self.coulomb), self.width, scale);
        let x = scale.slowest / self.velocity;
        let fall = if x > 0.71 { 2.0 * x * (-x * x).exp() } else { 0.86 };
        rest.max(fall * self.rise.abs() / (self.velocity * scale.drive_inertia))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::equation_plant::pmac;

    fn made(numbers: &[(&'static str, f64)]) -> Box<dyn Effect> {
        build(&Arguments { plant: pmac(), subject: None, numbers: numbers.to_vec() })
    }

    #[test]
    fn it_falls_with_speed() {
        let friction = made(&[("coulomb", 1.0), ("static", 2.0), ("stribeck_velocity", 20.0)]);
        // At 20 rad/s the friction is 1 + exp(-1) = 1.36788, at 200 rad/s it is 1.
        for (speed, expected) in [(20.0, -1.3678794411714423), (200.0, -1.0), (-200.0, 1.0)] {
            let found = friction.effort(&Motion { position: 0.0, speed, viscous_friction: 0.0 });
            assert!((found - expected).abs() < 1e-12, "{found} at {speed}");
        }
    }
}

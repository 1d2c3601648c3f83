//! Friction that depends on the direction.
//!
//! Formula      F+ tanh(v/v_s) forward, F- tanh(v/v_s) backward; if given, b+ v and b- v replace the nominal b v
//! Source       A. Janot, M. Gautier, M. Brunot, 2019 (the measured EMPS axis); docs/book/src/reference/plants.md, section 3
//! Acts on      effort at the rotor; force on the carriage
//! Looks like   coulomb friction with a constant load
//! Told apart   by different speeds in both directions: an offset does not change with the viscous part
//! Report says  "Friction is {forward} forward and {backward} backward."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::declared::{Forms, FormsOf, Level, Part};
use crate::effect::{
    Argument, Arguments, Declared, Description, Effect, Guess, Motion, Plausible, Scale, Subject, Survey, Unit, sign_width,
    smooth_sign, smooth_sign_rate,
};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "asymmetric-friction",
    plants: &["servo-axis", "pmac"],
    subject: Subject::None,
    at: None,
    arguments: &[
        Argument::new("forward", Unit::Effort, Bound::NotNegative).plausible(Plausible::EffortOneWay).level(),
        Argument::new("backward", Unit::Effort, Bound::NotNegative).plausible(Plausible::EffortOneWay).level(),
        Argument::new("viscous_forward", Unit::EffortPerSpeed, Bound::NotNegative).optional(),
        Argument::new("viscous_backward", Unit::EffortPerSpeed, Bound::NotNegative).optional(),
    ],
    sentence: "Friction is {forward} forward and {backward} backward.",
    check: "Drive slowly at the same speed both ways and compare the efforts, level by level; look at seals, guides and anything that wears on one side.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared { generalises: Some("coulomb-friction"), forms: FormsOf::Code(forms), ..Declared::NOTHING },
};

/// Levels F + c forward and F - c backward are equivalent to a dry friction F and a constant load c. Without a difference only F remains, and the two
/// viscous parts are equal to one viscous parameter of the plant.
fn forms(arguments: &Arguments) -> Forms {
    let mean = |a, b| Some(0.5 * (arguments.optional(a)? + arguments.optional(b)?));
    let (forward, backward) = (arguments.number("forward"), arguments.number("backward"));
    let dry = Part::new("coulomb-friction", 0.5 * (forward + backward));
    let pair = vec![dry, Part::new("constant-load", 0.5 * (forward - backward))];
    let viscous = mean("viscous_forward", "viscous_backward");
    let error = |value| Part { kind: "parameter-error", subject: Some("viscous_friction"), value };
    let is_bare = arguments.numbers.len() == 2;
    // Without viscous numbers the effect is equivalent to this pair, so the pair is not a special case.
    let special = if arguments.optional("viscous_forward").is_some() { vec![vec![dry], pair.clone()] } else { vec![vec![dry]] };
    Forms {
        special,
        alike: is_bare.then_some(pair),
        level: Some(Level { of: dry, errors: viscous.map(error).into_iter().collect() }),
    }
}

struct AsymmetricFriction {
    level: [f64; 2],
    viscous: [Option<f64>; 2],
    width: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(AsymmetricFriction {
        level: [arguments.number("forward"), arguments.number("backward")],
        viscous: [arguments.optional("viscous_forward"), arguments.optional("viscous_backward")],
        width: sign_width(arguments.plant),
    })
}

fn guesses(survey: &Survey) -> Vec<Guess> {
    // A twentieth of the drive's effort, in either direction and in both; then with viscous parts.
    let level = 0.05 * survey.effort;
    let viscous = survey.parameters.number("viscous_friction");
    let none = f64::NAN;
    let mut guesses: Vec<Guess> =
        [[level, 0.0], [0.0, level], [level, level]].iter().map(|it| Guess::at(vec![it[0], it[1], none, none])).collect();
    guesses.push(Guess::at(vec![level, level, 1.2 * viscous, 0.8 * viscous]));
    guesses.push(Guess::at(vec![level, level, 0.8 * viscous, 1.2 * viscous]));
    guesses
}

impl Effect for AsymmetricFriction {
    fn effort(&self, motion: &Motion) -> f64 {
        // mutant `< to <=`: at rest both directions give 0.
        let direction = usize::from(motion.speed < 0.0);
        // The plant's equations subtract the nominal viscous part; this line adds it again.
        let viscous = self.viscous[direction].map_or(0.0, |viscous| (motion.viscous_friction - viscous) * motion.speed);
        viscous - self.level[direction] * smooth_sign(motion.speed, self.width)
    }

    fn fastest_rate(&self, scale: &Scale) -> f64 {
        let sign = smooth_sign_rate(self.level[0].max(self.level[1]), self.width, scale);
        let viscous = self.viscous[0].unwrap_or(0.0).max(self.viscous[1].unwrap_or(0.0)) / scale.drive_inertia;
        // The law has a kink at rest, where the order of the method decreases to two: with a third of the step the error is a ninth.
        let kink = if scale.slowest == 0.0 { 3.0 } else { 1.0 };
        kink * (sign + viscous)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(numbers: &[(&'static str, f64)]) -> Box<dyn Effect> {
        build(&Arguments { plant: crate::equation_plant::servo_axis(), subject: None, numbers: numbers.to_vec() })
    }

    #[test]
    fn each_direction_has_its_own_level() {
        let friction = made(&[("forward", 20.0), ("backward", 30.0), ("viscous_backward", 240.0)]);
        // Forward: the plant's own viscous part remains. Backward at -0.1 m/s: 30 N, plus (200 - 240) * -0.1 = 4 N.
        for (speed, expected) in [(0.1, -20.0), (-0.1, 34.0)] {
            let found = friction.effort(&Motion { position: 0.0, speed, viscous_friction: 200.0 });
            assert!((found - expected).abs() < 1e-12, "{found} at {speed}");
        }
    }

    #[test]
    fn its_plainer_forms_are_a_dry_friction_with_and_without_a_load() {
        let of = |numbers: &[(&'static str, f64)]| {
            forms(&Arguments { plant: crate::equation_plant::servo_axis(), subject: None, numbers: numbers.to_vec() })
        };
        let (dry, load) = (Part::new("coulomb-friction", 25.0), Part::new("constant-load", 5.0));
        let levels = [("forward", 30.0), ("backward", 20.0)];
        let bare = of(&levels);
        assert_eq!((bare.special, bare.alike), (vec![vec![dry]], Some(vec![dry, load])));
        assert_eq!(bare.level, Some(Level { of: dry, errors: vec![] }));
        // With viscous parts the pair is a special case, and their mean is an error of the plant's viscous parameter.
        let whole = of(&[levels[0], levels[1], ("viscous_forward", 100.0), ("viscous_backward", 140.0)]);
        assert_eq!((whole.special, whole.alike), (vec![vec![dry], vec![dry, load]], None));
        let error = Part { kind: "parameter-error", subject: Some("viscous_friction"), value: 120.0 };
        assert_eq!(whole.level, Some(Level { of: dry, errors: vec![error] }));
    }
}

//! Wind.
//!
//! Formula      drag acts on (road_speed + wind)^2
//! Source       quadratic drag, I. Newton, 1687; docs/book/src/reference/plants.md, section 3
//! Acts on      the speed of the air
//! Looks like   an error of drag area at one speed
//! Told apart   by different speeds
//! Report says  "There is a headwind of {wind}."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{Argument, Arguments, Declared, Description, Effect, Guess, Plausible, Subject, Survey, Unit};
use crate::schema::Bound;

/// The largest wind speed, in m/s: above 12 Beaufort (33 m/s) no test drive takes place.
const STORM: f64 = 40.0;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "headwind",
    plants: &["driveline"],
    subject: Subject::None,
    at: None,
    arguments: &[Argument::new("wind", Unit::Is("m/s"), Bound::Any).plausible(Plausible::Within(STORM))],
    sentence: "There is a headwind of {wind}.",
    check: "Drive the same road both ways; what changes sign is wind.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::NOTHING,
};

struct Headwind {
    wind: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(Headwind { wind: arguments.number("wind") })
}

fn guesses(_survey: &Survey) -> Vec<Guess> {
    // A breeze of 3 m/s.
    vec![Guess::scaled(vec![3.0], 0.0)]
}

impl Effect for Headwind {
    fn air_speed(&self, speed: f64) -> f64 {
        speed + self.wind
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(numbers: &[(&'static str, f64)]) -> Box<dyn Effect> {
        build(&Arguments { plant: crate::equation_plant::driveline(), subject: None, numbers: numbers.to_vec() })
    }

    #[test]
    fn the_wind_adds_to_the_speed() {
        assert_eq!(made(&[("wind", 5.0)]).air_speed(20.0), 25.0);
    }
}

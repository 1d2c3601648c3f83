//! The motor's surfaces, from a plant to a fitted model. The demo shows these steps, and `rsm diagnose --refit` repeats them.
//!
//! In: a plant file, settings of the bench, a specification. Out: the points of the bench, their fit, and both as files. Never writes.

use std::path::PathBuf;

use rsm_core::source::Source;
use rsm_fit::fit::Outcome as Fitted;
use rsm_fit::plan::{DesignSpecification, Plan};
use rsm_fit::spec::Specification;
use rsm_rigs::bench::{self, Bench, Setting};
use rsm_rigs::motor::closed_loop::Drive;
use rsm_sim::plant_file::PlantFile;

use crate::commands::{experiment, fit};
use crate::outcome::Refusal;

/// The shipped plans: half of the map of modulation depth and current advance, and the whole.
pub const PLANS: [(&str, &str); 2] =
    [("dyno-90", include_str!("../demo/motor/dyno-90.toml")), ("dyno-180", include_str!("../demo/motor/dyno-180.toml"))];

/// The plan of the other half, to which no surface is fitted.
pub const UNSEEN: (&str, &str) = ("dyno-unseen", include_str!("../demo/motor/dyno-unseen.toml"));

/// The shipped specification.
pub const FIT: &str = include_str!("../demo/motor/fit.toml");

/// Seeds of the bench's noise: of the fitted runs and of the holdout runs. They are the same as those of the shipped data.
pub const SEEDS: [u64; 2] = [1, 2];

/// The lowest speed of the surfaces, divided by the base speed at full torque: 440 rad/s of 447.5 in the shipped specification.
const BELOW_BASE: f64 = 440.0 / 447.5;

/// The highest speed of the surfaces, divided by the lowest: 800 rad/s and 440 in the shipped specification.
const SPAN: f64 = 800.0 / 440.0;

/// The points of the bench and their fit.
pub struct Measured {
    /// The runs that are fitted, then the holdout runs.
    pub outcomes: [Vec<bench::Outcome>; 2],
    /// The fit.
    pub fitted: Fitted,
    /// The same fit as files: the specification `fit.toml` and its data `dyno.csv` and `dyno-unseen.csv`.
    pub files: Vec<(&'static str, String)>,
}

/// A shipped plan and its settings.
pub fn plan(name: &str, text: &str) -> Result<(Plan, Vec<Setting>), Refusal> {
    let specification = DesignSpecification::from_source(Source::new(format!("{name}.toml"), text))?;
    let plan = Plan::make(&specification)?;
    let settings = experiment::settings(&plan)?;
    Ok((plan, settings))
}

/// Runs the settings and those of the other half of the map on the bench, and fits the first. Writes nothing.
pub fn measure(plant: &PlantFile, bench: &Bench, settings: &[Setting], specification: &str) -> Result<Measured, Refusal> {
    let (_, unseen) = plan(UNSEEN.0, UNSEEN.1)?;
    let outcomes = [bench.run(plant, settings, SEEDS[0])?, bench.run(plant, &unseen, SEEDS[1])?];
    let data = [("dyno.csv", bench::csv(&outcomes[0])), ("dyno-unseen.csv", bench::csv(&outcomes[1]))];
    let sources = data.clone().map(|(name, text)| Source::new(name, text));
    let parsed = Specification::from_source(Source::new("fit.toml", specification), PathBuf::new())?;
    let fitted = fit::sources_with_progress(&parsed, &sources)?;
    fit::require_all(&fitted)?;
    let files = [("fit.toml", specification.to_string())].into_iter().chain(data).collect();
    Ok(Measured { outcomes, fitted, files })
}

/// Bench and specification for a motor: the shipped ones with their ranges in proportion to its torque, current and base speed. For the shipped motor
/// they equal the shipped ones.
pub fn for_motor(plant: &PlantFile) -> (Bench, String) {
    let known = Drive::default().known(plant);
    let current = known.current_limit;
    let torque = known.torque_constant() * current;
    let low = rounded(BELOW_BASE * known.base_speed());
    let high = rounded(SPAN * low);
    let text = FIT
        .replace("range = [-21.6, 21.6]", &format!("range = [{:?}, {:?}]", -rounded(torque), rounded(torque)))
        .replace("# 60 A", "")
        .replace("range = [6.0, 60.0]", &format!("range = [{:?}, {:?}]", rounded(0.1 * current), rounded(current)))
        .replace("range = [440.0, 800.0]", &format!("range = [{low:?}, {high:?}]"))
        .replace("output_range = [0.0, 60.0]", &format!("output_range = [0.0, {:?}]", rounded(current)));
    let shipped = Bench::default();
    // The ratio of the bench's top speed to the highest speed of the surfaces is that of the shipped bench (800 rad/s).
    (Bench { top_speed: shipped.top_speed / 800.0 * high, ..shipped }, text)
}

/// Rounds to three digits, so that the file is easy to read.
fn rounded(value: f64) -> f64 {
    format!("{value:.2e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_motor_has_the_shipped_ranges() {
        let text = include_str!("../../rsm-sim/plants/pmac.toml");
        let plant = PlantFile::read(&Source::new("pmac.toml", text)).unwrap();
        let (bench, specification) = for_motor(&plant);
        assert_eq!(bench, Bench::default());
        assert_eq!(specification, FIT.replace("# 60 A", ""));
        // Half the flux, no resistance: the base speed is V/(p sqrt(lambda^2 + (L I)^2)) = 148.09/(4 sqrt(0.03^2 + 0.054^2)) = 599.3 rad/s. The
        // lowest speed is 440/447.5 of it.
        let text = text
            .replace("flux_linkage = 0.06", "flux_linkage = 0.03")
            .replace("phase_resistance = 0.08", "phase_resistance = 0.0");
        let plant = PlantFile::read(&Source::new("other.toml", text)).unwrap();
        let (bench, specification) = for_motor(&plant);
        assert!(
            specification.contains("range = [589.0, 1070.0]") && specification.contains("range = [-10.8, 10.8]"),
            "{specification}"
        );
        // 850/800 of 1070 rad/s.
        assert!((bench.top_speed - 1136.875).abs() < 1e-9);
    }
}

//! A test case: an axis in open loop, driven by steps of its command, with an effect that the nominal plant lacks.
//!
//! In: tolerances, an effect, noise. Out: whitened records, the nominal and the true plant, and a search with its inputs. Used only by tests.

use rsm_core::source::Source;
use rsm_sim::kind::OUTPUTS;

use super::hypotheses::Hypothesis;
use super::model::Model;
use super::noise::NoiseFloor;
use super::search::{Search, WorkLimits};
use super::whitened_residuals::{Prepared, WhitenedResiduals};
use rsm_fit::random::Random;
use rsm_sim::effect::Survey;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;
use rsm_sim::simulate::Simulator;

/// Standard deviation of the noise of the position, in m.
const NOISE: f64 = 1e-5;

/// The plant file of the axis. `tolerances` and `effects` are TOML.
pub(super) fn file(tolerances: &str, effects: &str) -> PlantFile {
    let text = format!(
        "format = 1\nplant = \"servo-axis\"\n[parameters]\nmass = 2\nforce_gain = 4\nviscous_friction = 3\ncommand_limit = 10\n\
         [tolerance]\n{tolerances}\n{effects}\n"
    );
    PlantFile::read(&Source::new("axis.toml", text)).unwrap()
}

/// An effect entry: dry friction of this many newtons.
pub(super) fn friction(force: f64) -> String {
    format!("[[effects]]\nkind = \"coulomb-friction\"\nparameters = {{ force = {force} }}\n")
}

/// A record of 0.6 s of the true axis with command steps of 2 V and -1.5 V, with or without noise, and the nominal plant.
pub(super) fn whitened(nominal: &PlantFile, truth: &PlantFile, noisy: bool) -> (WhitenedResiduals, Model) {
    whitened_between(nominal, truth, noisy, [2.0, -1.5])
}

/// The same with command steps between two values in V.
pub(super) fn whitened_between(
    nominal: &PlantFile,
    truth: &PlantFile,
    noisy: bool,
    [first, second]: [f64; 2],
) -> (WhitenedResiduals, Model) {
    let mut csv = "time[s],command[V],position[m]\n".to_string();
    for k in 0..600 {
        csv += &format!("{},{},0\n", f64::from(k) / 1000.0, if k % 200 < 100 { first } else { second });
    }
    let mut record = Record::read(&Source::new("r.csv", csv), truth).unwrap();
    let simulated = Simulator::new(truth, &record).unwrap().run(&record).unwrap();
    let mut random = Random::new(5);
    let mut noise = || if noisy { NOISE * random.normal() } else { 0.0 };
    record.measured[0] = Some(simulated.of("position").unwrap().iter().map(|value| value + noise()).collect());
    let model = Model::nominal(nominal, &[&record], [NOISE; OUTPUTS]);
    (WhitenedResiduals::new(vec![Prepared::new(record, 2)], [NoiseFloor::white(NOISE); OUTPUTS], 1), model)
}

/// A search without a work limit and without progress messages.
pub(super) fn search<'a>(
    whitened: &'a WhitenedResiduals,
    unseen: &'a WhitenedResiduals,
    nominal: &'a Model,
    hypotheses: &'a [Hypothesis],
    survey: &'a Survey,
) -> Search<'a> {
    Search {
        whitened,
        unseen,
        nominal,
        hypotheses,
        survey,
        further_guesses: 0,
        rounded: &[],
        equation_error_fits: &[],
        limits: WorkLimits::within(u64::MAX / 2),
        progress: &|_| {},
    }
}

//! Corrects the readings of records whose noise has heavy tails.
//!
//! In: records and a fit along them. Out: the same records, with outliers moved as in [`super::tails`]. Readings of outputs without heavy tails are
//! not changed.

use super::alignment;
use super::checks::Finding;
use super::levenberg::Fit;
use super::model::Model;
use super::prepared::Prepared;
use super::tails::{OutputResidual, Tails, scaled_to_uniform};
use super::validation;
use super::whitened_residuals::{Simulated, WhitenedResiduals};
use rsm_sim::kind::OUTPUTS;
use rsm_sim::kind::PlantKind;

/// The noise distributions of all outputs, from the residual of a simulation.
fn noise_distributions(
    whitened: &WhitenedResiduals,
    simulated: &[Simulated],
    kind: PlantKind,
    findings: &[Finding],
) -> [Option<Tails>; OUTPUTS] {
    let mut laws = [None; OUTPUTS];
    for (output, law) in laws.iter_mut().enumerate() {
        let floor = &whitened.floors[output];
        let mut even: Vec<(&Prepared, usize, Vec<f64>)> = Vec::new();
        for (prepared, simulated) in whitened.records.iter().zip(simulated) {
            let Some(k) = prepared.outputs.iter().position(|it| *it == output) else { continue };
            let left = difference(prepared.measured(k), &simulated[k]);
            even.push((prepared, k, scaled_to_uniform(floor, prepared.measured(k), &left).0));
        }
        let mut lists: Vec<OutputResidual<'_>> = Vec::new();
        for (prepared, k, left) in &even {
            let jumps = alignment::jumps_of(prepared, *k, kind, findings);
            lists.push(OutputResidual { measured: prepared.measured(*k), left, used: &prepared.used[*k], jumps });
        }
        *law = if lists.is_empty() { None } else { Tails::found(&lists) };
    }
    laws
}

/// The readings as recorded, for each record by output. Distributions are always estimated from these, with the best fit so far.
#[derive(Debug, Clone)]
pub(super) struct RecordedReadings(Vec<Vec<Option<Vec<f64>>>>);

impl RecordedReadings {
    /// The readings of the records.
    #[must_use]
    pub(super) fn of(whitened: &WhitenedResiduals) -> Self {
        RecordedReadings(whitened.records.iter().map(|it| it.record.measured.clone()).collect())
    }

    /// Exchanges them with the readings in the records.
    fn swap(&mut self, whitened: &mut WhitenedResiduals) {
        self.0.iter_mut().zip(&mut whitened.records).for_each(|(own, it)| std::mem::swap(own, &mut it.record.measured));
    }
}

/// A change of the noise correlation below this changes readings by less than a tenth of the noise, and only after outliers.
const LEAST_CORRELATION_CHANGE: f64 = 0.1;

/// Detects heavy tails with a fit, and corrects outliers in both sets of records. Returns whether readings changed. A fit with an error hides tails
/// under structure, or takes structure for correlated noise, so distributions are estimated again when a better fit exists. `recorded` holds the
/// readings of both sets as recorded; `findings` tell which rows were left out as jumps.
pub(super) fn detect(
    whitened: &mut WhitenedResiduals,
    unseen: &mut WhitenedResiduals,
    recorded: &mut [RecordedReadings; 2],
    fit: &Fit,
    findings: &[Finding],
) -> bool {
    recorded[0].swap(whitened);
    let laws = noise_distributions(whitened, &fit.simulated, fit.model.file.kind, findings);
    let is_same = |(one, other): (&Option<Tails>, &Option<Tails>)| match (one, other) {
        (Some(one), Some(other)) => (one.correlation - other.correlation).abs() < LEAST_CORRELATION_CHANGE,
        (one, other) => one.is_none() && other.is_none(),
    };
    let changes = !laws.iter().zip(&whitened.tails).all(is_same);
    if changes {
        recorded[1].swap(unseen);
        *recorded = [RecordedReadings::of(whitened), RecordedReadings::of(unseen)];
        whitened.tails = laws;
        correct(whitened, &fit.simulated);
        *unseen = corrected(whitened.with_records(std::mem::take(&mut unseen.records)), &fit.model);
    } else {
        recorded[0].swap(whitened);
    }
    changes
}

/// Corrects the readings of the records by their noise distributions. `simulated` is a simulation of them; the readings must be as recorded.
fn correct(whitened: &mut WhitenedResiduals, simulated: &[Simulated]) {
    for (prepared, simulated) in whitened.records.iter_mut().zip(simulated) {
        for (k, values) in simulated.iter().enumerate() {
            let output = prepared.outputs[k];
            let Some(law) = whitened.tails[output] else { continue };
            let measured = prepared.measured(k);
            let corrected =
                law.corrected_readings(measured, &difference(measured, values), &prepared.used[k], &whitened.floors[output]);
            prepared.record.measured[output] = Some(corrected);
        }
    }
}

/// Holdout records, corrected with the distributions of the fitted records. If a model cannot be simulated along them, they stay unchanged.
#[must_use]
pub(super) fn corrected(mut unseen: WhitenedResiduals, model: &Model) -> WhitenedResiduals {
    if unseen.tails.iter().any(Option::is_some)
        && let Some(there) = validation::fit_initial_states(&unseen, model)
    {
        correct(&mut unseen, &there.simulated);
    }
    unseen
}

/// Readings minus simulation.
pub(super) fn difference(measured: &[f64], simulated: &[f64]) -> Vec<f64> {
    measured.iter().zip(simulated).map(|(measured, simulated)| measured - simulated).collect()
}

#[cfg(test)]
mod tests {
    use super::super::levenberg;
    use super::super::noise::NoiseFloor;
    use super::*;
    use rsm_core::source::Source;
    use rsm_fit::random::Random;
    use rsm_sim::kind::by_output;
    use rsm_sim::plant_file::PlantFile;
    use rsm_sim::record::Record;
    use rsm_sim::simulate::Simulator;

    /// A closed axis on which both readings have outliers, at a fit that misses the position by what lasts, and at one that does not.
    #[test]
    fn tails_under_structure_of_one_output_are_found_once_it_is_gone_and_those_of_the_other_stay() {
        let file =
            PlantFile::read(&Source::new("axis.toml", include_str!("../../../rsm-sim/plants/servo-axis.toml").to_string()))
                .unwrap();
        let row = |k: usize| format!("{},{},0,0\n", k as f64 / 1000.0, 1e-2 * (k as f64 / 300.0).sin());
        let csv = "time[s],reference[m],position[m],command[V]\n".to_string() + &(0..3000).map(row).collect::<String>();
        let mut record = Record::read(&Source::new("r.csv", csv), &file).unwrap();
        let simulated = Simulator::new(&file, &record).unwrap().run(&record).unwrap();
        let mut random = Random::new(9);
        let sds = by_output(&[1e-6, 1e-3, 1.0], 1.0);
        for (k, name) in ["position", "command"].iter().enumerate() {
            let mut noise = || if random.uniform() < 0.02 { 20.0 } else { 1.0 } * sds[k] * random.normal();
            record.measured[k] = Some(simulated.of(name).unwrap().iter().map(|value| value + noise()).collect());
        }
        let mut whitened = WhitenedResiduals::new(vec![Prepared::new(record.clone(), 2)], sds.map(NoiseFloor::white), 1);
        let model = Model::nominal(&PlantFile { tolerance: Vec::new(), ..file }, &[&record], sds);
        let fit = levenberg::fit(&whitened, model, 4).unwrap();
        let mut missed = fit.clone();
        // Ten rows in forty are off by thirty times the noise.
        missed.simulated[0][0].iter_mut().enumerate().filter(|(k, _)| k / 10 % 4 == 0).for_each(|(_, value)| *value += 3e-5);
        let mut unseen = WhitenedResiduals::new(Vec::new(), whitened.floors, 1);
        let mut recorded = [&whitened, &unseen].map(RecordedReadings::of);
        assert!(detect(&mut whitened, &mut unseen, &mut recorded, &missed, &[]));
        assert!(whitened.tails[0].is_none() && whitened.tails[1].is_some(), "{:?}", whitened.tails);
        assert_eq!(whitened.records[0].record.measured[0], record.measured[0]);
        assert!(detect(&mut whitened, &mut unseen, &mut recorded, &fit, &[]));
        assert!(whitened.tails[0].is_some() && unseen.tails == whitened.tails, "{:?}", whitened.tails);
        // Corrected from the recorded readings, not from corrected ones, and once.
        let mut once = WhitenedResiduals::new(vec![Prepared::new(record.clone(), 2)], sds.map(NoiseFloor::white), 1);
        let mut of_once = [&once, &unseen].map(RecordedReadings::of);
        assert!(detect(&mut once, &mut unseen.clone(), &mut of_once, &fit, &[]));
        assert_eq!(whitened.records[0].record.measured, once.records[0].record.measured);
        assert_ne!(whitened.records[0].record.measured, record.measured);
        assert!(!detect(&mut whitened, &mut unseen, &mut recorded, &fit, &[]));
        assert_eq!(whitened.records[0].record.measured, once.records[0].record.measured);
    }
}

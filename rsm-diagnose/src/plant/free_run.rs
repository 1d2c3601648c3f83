//! The free-run error of a plant of known structure: the usual measure in publications that compare models of measured machines.
//!
//! In: a plant file with its effects, and records. Out: its parameters, fitted to the simulation error, and root mean square errors. Names no cause.

use super::levenberg::{self, Fit};
use super::model::{InitialMotion, Model, Place};
use super::noise::NoiseFloor;
use super::whitened_residuals::{Prepared, WhitenedResiduals};
use rsm_sim::kind::OUTPUTS;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;

/// Steps of a fit that starts from values of the right size.
const STEPS: usize = 40;

/// Fits a plant to records. All parameters of its effects, all parameters with a tolerance and all initial states are unknown. `noise` is the noise
/// of each output in its unit; it weights the outputs against one another. `None` if the plant cannot be simulated.
#[must_use]
pub fn fitted(file: &PlantFile, records: &[&Record], noise: [f64; OUTPUTS], threads: usize) -> Option<Fit> {
    let whitened = whitened(file, records, noise, threads);
    let nominal = Model::nominal(file, records, noise);
    let model = nominal.with_effects(&nominal, file.effects.clone());
    levenberg::fit(&whitened, model, STEPS)
}

/// The same plant along another record. Only the initial state and the named parameters of effects are fitted, to the first `rows` rows. These show
/// the present condition of the machine (warm oil, a slack belt). The rows after them evaluate the fit.
#[must_use]
pub fn adapted(found: &Fit, record: &Record, rows: usize, numbers: &[&str], noise: [f64; OUTPUTS]) -> Option<Model> {
    let whole = [record];
    let mut model = found.model.clone();
    let own = |place: &Place| matches!(place, Place::Effect { number, .. } if numbers.contains(number));
    model.unknowns.retain(|it| own(&it.place));
    model.file.initial.clear();
    model.at_start = InitialMotion::of(model.file.kind, whole.into_iter());
    model.take_starts(&whole, noise);
    let beginning = Prepared::new(record.clone(), model.file.kind.outputs().len()).shortened(rows);
    let whitened = WhitenedResiduals::new(vec![beginning], noise.map(NoiseFloor::white), 1);
    levenberg::fit(&whitened, model, STEPS).map(|fit| fit.model)
}

/// Root mean square error of each measured output over some rows, in its unit. `None` where the model cannot be simulated.
#[must_use]
pub fn errors(model: &Model, record: &Record, rows: std::ops::Range<usize>) -> Option<Vec<f64>> {
    let whitened = whitened(&model.file, &[record], [1.0; OUTPUTS], 1);
    let simulated = whitened.run(model)?.pop()?;
    let prepared = &whitened.records[0];
    let each = simulated.iter().enumerate().map(|(k, values)| {
        let (measured, simulated) = (&prepared.measured(k)[rows.clone()], &values[rows.clone()]);
        let squares: f64 = measured.iter().zip(simulated).map(|(measured, it)| (measured - it).powi(2)).sum();
        (squares / measured.len().max(1) as f64).sqrt()
    });
    Some(each.collect())
}

/// The results of the measured axis in open loop.
#[derive(Debug, Clone)]
pub struct AxisFreeRuns {
    /// Each simulation with the root mean square error of the position, in m.
    pub errors: Vec<(&'static str, f64)>,
    /// The plant as fitted to the training record.
    pub trained: Model,
    /// The same without its drift, with the viscous friction of the first quarter of the test record.
    pub today: Model,
}

/// Free runs of the training record and of the test record. The test record is simulated as trained; then without the drift, because the drift of a
/// load belongs to one record; then with the viscous friction fitted to the first quarter of the test record, over all of it and over the other three
/// quarters. `None` if the axis cannot be simulated.
#[must_use]
pub fn axis_free_runs(file: &PlantFile, training: &Record, test: &Record) -> Option<AxisFreeRuns> {
    /// The smallest step of its encoder, in m. With only one output, this affects only the weight of the priors.
    const ENCODER: f64 = 5e-8;
    let (noise, rows) = ([ENCODER; OUTPUTS], test.rows());
    let position = |model: &Model, record: &Record, rows| errors(model, record, rows).map(|errors| errors[0]);
    let mut found = fitted(file, &[training], noise, 1)?;
    let trained = found.model.clone();
    let drift = found.model.file.effects.iter_mut().flat_map(|it| &mut it.arguments.numbers).find(|it| it.0 == "force_rate")?;
    drift.1 = 0.0;
    let as_trained = adapted(&found, test, rows, &[], noise)?;
    let quarter = rows / 4;
    let today = adapted(&found, test, quarter, &["viscous_forward", "viscous_backward"], noise)?;
    let errors = vec![
        ("training record", position(&trained, training, 0..training.rows())?),
        ("test record, all numbers from the training record but its start", position(&as_trained, test, 0..rows)?),
        ("test record, viscous friction from its first quarter", position(&today, test, 0..rows)?),
        ("  the three quarters behind it", position(&today, test, quarter..rows)?),
    ];
    Some(AxisFreeRuns { errors, trained, today })
}

fn whitened(file: &PlantFile, records: &[&Record], noise: [f64; OUTPUTS], threads: usize) -> WhitenedResiduals {
    let outputs = file.kind.outputs().len();
    let prepared = records.iter().map(|record| Prepared::new((*record).clone(), outputs)).collect();
    WhitenedResiduals::new(prepared, noise.map(NoiseFloor::white), threads)
}

#[cfg(test)]
mod tests {
    use super::super::axis_under_steps;
    use super::*;

    #[test]
    fn numbers_are_found_and_what_changed_is_found_again_from_the_beginning_of_another_record() {
        let file = |force: f64| axis_under_steps::file("mass = 0.2", &axis_under_steps::friction(force));
        let record = |force: f64| {
            let (mut whitened, _) = axis_under_steps::whitened(&file(force), &file(force), false);
            whitened.records.remove(0).record
        };
        let (one, other) = (record(0.8), record(1.0));
        let found = fitted(&file(0.5), &[&one], [1e-5; OUTPUTS], 1).unwrap();
        let force = |model: &Model| model.file.effects[0].arguments.number("force");
        assert!((force(&found.model) - 0.8).abs() < 1e-4, "{}", force(&found.model));
        assert!(errors(&found.model, &one, 0..600).unwrap()[0] < 1e-6);
        let unchanged = adapted(&found, &other, 200, &[], [1e-5; OUTPUTS]).unwrap();
        let changed = adapted(&found, &other, 200, &["force"], [1e-5; OUTPUTS]).unwrap();
        assert!((force(&changed) - 1.0).abs() < 1e-3 && force(&unchanged) == force(&found.model), "{}", force(&changed));
        let [plain, better] = [&unchanged, &changed].map(|model| errors(model, &other, 200..600).unwrap()[0]);
        assert!(better < 0.01 * plain, "{better} {plain}");
    }
}

//! Fits the answer of a search on a part of the rows to more rows.
//!
//! In: the training records, and a cause with the rivals that the part does not distinguish from it. Out: the plant with its numbers from more rows,
//! and which of these rivals fit worse there. Names no other cause: if a rival fits better there, the answer does not hold.

use rsm_core::order;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;

use super::checks;
use super::effect_size;
use super::levenberg::{self, Fit};
use super::model::Model;
use super::outlier_correction;
use super::row_share::RowShare;
use super::search::AcceptedCause;
use super::validation;
use super::whitened_residuals::WhitenedResiduals;

/// Steps of a fit that starts near its minimum.
const STEPS: usize = 4;

/// A plant whose numbers are fitted to more rows than its causes were searched on, with these records.
#[derive(Debug, Clone)]
pub struct FitToMoreRows {
    /// The training records.
    pub whitened: WhitenedResiduals,
    /// The fit to them.
    pub fit: Fit,
}

/// Fits the plant of a search, and the rivals of its causes, to as many rows of the training records as a whole search uses. The noise is that of the
/// search. `threshold` is the gain by chance. Returns the causes too, each with the differences of its rivals: from more rows if these distinguish
/// what the part did not. `None` if the plant cannot be simulated, or if a rival explains these rows better.
#[must_use]
pub fn fit_to_more_rows(
    training: &[Record],
    share: RowShare,
    file: &PlantFile,
    whitened: &WhitenedResiduals,
    (fit, causes): (&Fit, &[AcceptedCause]),
    threshold: f64,
) -> Option<(FitToMoreRows, Vec<AcceptedCause>)> {
    let (prepared, _) = checks::prepared(training.iter().flat_map(|record| share.pieces(record, file)), file);
    let there = outlier_correction::corrected(whitened.with_records(prepared), &fit.model);
    let decides = |fit: &Fit| effect_size::deciding_difference(threshold, fit.cost, fit.residual.len());
    let times = there.rows() as f64 / fit.residual.len() as f64;
    let equal_rivals = |(cause, one): (usize, &AcceptedCause)| {
        let same = effect_size::equal(decides(fit), one.gain);
        let rivals = one.rivals.iter().enumerate().filter(move |it| it.1.1 < same);
        rivals.map(|(rival, _)| (cause, rival)).collect::<Vec<_>>()
    };
    let equal: Vec<(usize, usize)> = causes.iter().enumerate().flat_map(equal_rivals).collect();
    let models: Vec<&Model> =
        std::iter::once(&fit.model).chain(equal.iter().map(|&(cause, rival)| &causes[cause].rival_models[rival].1)).collect();
    let mut fits = there.jobs(&models, |there, model| fitted(there, model)).into_iter();
    let fit = fits.next().flatten()?;
    let mut causes = causes.to_vec();
    for ((cause, rival), other) in equal.into_iter().zip(fits) {
        let AcceptedCause { gain, rivals, .. } = &mut causes[cause];
        // A rival that cannot be simulated along more rows does not explain them.
        let worse = other.map_or(f64::INFINITY, |other| other.cost - fit.cost);
        if worse < -decides(&fit) {
            return None;
        }
        if worse >= effect_size::equal(decides(&fit), *gain * times) {
            rivals[rival].1 = worse;
        }
    }
    for one in &mut causes {
        order::ascending(&mut one.rivals, |it| it.1);
    }
    Some((FitToMoreRows { whitened: there, fit }, causes))
}

/// The fit of a plant to these records, from its numbers.
fn fitted(there: &WhitenedResiduals, model: &Model) -> Option<Fit> {
    let started = validation::fit_initial_states(there, model)?;
    levenberg::fit(there, validation::with_starts_of(model, &started), STEPS)
}

#[cfg(test)]
mod tests {
    use super::super::axis_under_steps;
    use super::super::noise_floor::NoiseFloor;
    use super::super::row_share::Searched;
    use super::super::whitened_residuals::Prepared;
    use super::*;
    use rsm_core::source::Source;
    use rsm_fit::random::Random;
    use rsm_sim::kind::OUTPUTS;
    use rsm_sim::simulate::Simulator;

    /// The noise of the position.
    const SD: f64 = 1e-4; // m

    /// The gain by chance, in squared standard deviations.
    const THRESHOLD: f64 = 30.0;

    const ROWS: usize = 1200;

    /// While an axis moves forward, dry friction and a constant load are the same force.
    const LOAD: &str = "[[effects]]\nkind = \"constant-load\"\nparameters = { force = 1.0 }\n";

    fn friction() -> String {
        axis_under_steps::friction(1.0)
    }

    /// The cause `answer` with the rival `other`, fitted to the first half of a record of an axis with friction, and the comparison on the whole
    /// record. The command of the second half is between `low` and 3 V.
    fn compared(answer: &str, other: &str, low: f64) -> Option<(f64, f64)> {
        let nominal = axis_under_steps::file("", "");
        let truth = axis_under_steps::file("", &friction());
        let mut csv = "time[s],command[V],position[m]\n".to_string();
        for k in 0..ROWS {
            let least = if k < ROWS / 2 { 1.0 } else { low };
            csv += &format!("{},{},0\n", k as f64 / 1000.0, if k % 200 < 100 { 3.0 } else { least });
        }
        let mut record = Record::read(&Source::new("r.csv", csv), &truth).unwrap();
        let simulated = Simulator::new(&truth, &record).unwrap().run(&record).unwrap();
        let mut random = Random::new(8);
        record.measured[0] = Some(simulated.of("position").unwrap().iter().map(|value| value + SD * random.normal()).collect());
        let part = record.piece(0..ROWS / 2);
        let model = Model::nominal(&nominal, &[&part], [SD; OUTPUTS]);
        let whitened = WhitenedResiduals::new(vec![Prepared::new(part, 2)], [NoiseFloor::white(SD); OUTPUTS], 2);
        let with = |effects: &str| {
            let model = model.with_effects(&model, axis_under_steps::file("", effects).effects);
            levenberg::fit(&whitened, model, 8).unwrap()
        };
        let (calibrated, fit, rival) = (levenberg::fit(&whitened, model.clone(), 8).unwrap(), with(answer), with(other));
        let on_the_part = rival.cost - fit.cost;
        let cause = AcceptedCause {
            label: "answer".to_string(),
            gain: calibrated.cost - fit.cost,
            rivals: vec![("rival".to_string(), on_the_part)],
            aliases_not_fitted: Vec::new(),
            rival_models: vec![("rival".to_string(), rival.model)],
            rivals_tested: true,
            without: calibrated.model.clone(),
        };
        let records = [record];
        let share = RowShare::of_rows(&records, &[], Searched::Most);
        let (numbers, causes) = fit_to_more_rows(&records, share, &nominal, &whitened, (&fit, &[cause]), THRESHOLD)?;
        assert_eq!(numbers.whitened.rows(), ROWS);
        Some((on_the_part, causes[0].rivals[0].1))
    }

    #[test]
    fn a_rival_that_is_equal_on_a_part_is_compared_on_more_rows() {
        // In the second half the axis moves in both directions.
        let (before, after) = compared(&friction(), LOAD, -6.0).unwrap();
        assert!(before.abs() < THRESHOLD && after > 10.0 * THRESHOLD, "{before} {after}");
        // If the rival is the right one, the answer of the part does not hold.
        assert_eq!(compared(LOAD, &friction(), -6.0), None);
        // If the second half does not distinguish them either, the rival stays what it was.
        let (before, after) = compared(&friction(), LOAD, 1.0).unwrap();
        assert_eq!(before.to_bits(), after.to_bits());
        assert!(compared(LOAD, &friction(), 1.0).is_some());
    }
}

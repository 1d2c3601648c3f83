//! A survey of the records: the sizes from which first guesses are made.
//!
//! In: prepared records and the calibrated plant's residuals. Out: a [`Survey`]. It contains only scales and does not choose between causes.

use super::levenberg::Fit;
use super::rounding;
use super::waves;
use super::whitened_residuals::WhitenedResiduals;
use rsm_core::order;
use rsm_sim::effect::Survey;
use rsm_sim::equation_plant;
use rsm_sim::kind::OUTPUTS;
use rsm_sim::record::Record;

/// The survey of training records.
#[must_use]
pub fn survey(whitened: &WhitenedResiduals, fit: &Fit) -> Survey {
    let kind = fit.model.file.kind;
    let parameters = fit.model.file.parameters.clone();
    let mut largest = [0.0_f64; OUTPUTS];
    let mut spread = [0.0; OUTPUTS];
    let mut ends = [(0.0, 0.0); OUTPUTS];
    let mut quantum = [None; OUTPUTS];
    let mut input = 0.0_f64;
    for output in 0..kind.outputs().len() {
        let lists: Vec<&[f64]> = whitened
            .records
            .iter()
            .filter_map(|it| it.outputs.iter().position(|found| *found == output).map(|k| it.measured(k)))
            .collect();
        let all: Vec<f64> = lists.iter().flat_map(|values| values.iter().copied()).collect();
        if all.is_empty() {
            continue;
        }
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        ends[output] = order::ends(&all);
        largest[output] = ends[output].0.abs().max(ends[output].1.abs());
        spread[output] = (all.iter().map(|value| (value - mean) * (value - mean)).sum::<f64>() / all.len() as f64).sqrt();
        let used = whitened
            .records
            .iter()
            .filter_map(|it| it.outputs.iter().position(|found| *found == output).map(|k| it.used[k].as_slice()));
        quantum[output] = rounding::step_of(lists.iter().copied().zip(used), whitened.floors[output].sd);
    }
    for prepared in &whitened.records {
        let record = &prepared.record;
        let lengths = record.inputs.iter().take(1).flatten().map(|it| it.abs());
        input = lengths.fold(input, f64::max);
    }
    let records: Vec<&Record> = whitened.records.iter().map(|it| &it.record).collect();
    let scales = equation_plant::scales(&fit.model.file, &records).unwrap_or_default();
    // An output that stays at zero still has a scale: its noise.
    for output in 0..kind.outputs().len() {
        largest[output] = largest[output].max(whitened.floors[output].sd);
        spread[output] = spread[output].max(whitened.floors[output].sd);
    }
    Survey {
        plant: kind,
        period: whitened.records.first().map_or(1e-3, |it| it.record.period),
        duration: whitened.records.iter().map(|it| it.record.period * it.record.rows() as f64).fold(0.0, f64::max),
        input: input.max(f64::MIN_POSITIVE),
        largest,
        ends,
        spread,
        noise: whitened.floors.map(|floor| floor.sd),
        waves: waves::waves(whitened, fit),
        quantum,
        unused: equation_plant::unused(&fit.model.file, &records),
        output: 0,
        nominal: 0.0,
        scales,
        exact: fit.model.file.tolerance.iter().filter(|it| it.1 == 0.0).map(|it| it.0).collect(),
        parameters,
    }
}

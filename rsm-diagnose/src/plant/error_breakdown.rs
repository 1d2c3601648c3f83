//! The breakdown of the error: further data for the report.
//!
//! In: the nominal, the calibrated and the extended plant along the evaluation records, and the accepted causes. Out: an [`ErrorBreakdown`]: errors
//! by region, frequency and order, curves, the calibration, what each cause removes, what is left, and a correction of it. No verdict depends on it.

pub use super::cause::Contribution;
use super::combinations::{self, Combinations, Combined};
pub use super::compared::Compared;
use super::correction::{self, CorrectionResult, Simulation};
use super::levenberg::Fit;
use super::model::{Model, Place};
use super::orders::{self, Orders};
use super::posterior::Posterior;
use super::quantities::{self, Quantity};
use super::regions::{self, ErrorSlice, Region, Side};
use super::search::AcceptedCause;
use super::spectrum::{self, Spectrum};
use super::validation;
use super::whitened_residuals::{Prepared, WhitenedResiduals};
use rsm_sim::equation_plant::SiteSignal;
use rsm_sim::schema;

/// The number of causes whose evidence is examined in detail.
const MOST_DETAILED_CAUSES: usize = 3;

/// The number of regions that are named as places where a cause acts.
const PLACES: usize = 3;

/// The zoomed view of a curve shows one part in this many of a record's rows.
const ZOOM: usize = 25;

/// Simulated outputs along one record.
#[derive(Debug, Clone, PartialEq)]
pub struct Trace {
    /// The record's place among the evaluation records.
    pub record: usize,
    /// The output, by its place in the plant.
    pub output: usize,
    /// Which rows count.
    pub used: Vec<bool>,
    /// Instants, in s.
    pub time: Vec<f64>,
    /// As measured.
    pub measured: Vec<f64>,
    /// By the nominal plant.
    pub nominal: Vec<f64>,
    /// By the nominal plant, calibrated within its tolerances.
    pub before: Vec<f64>,
    /// By the extended plant.
    pub after: Vec<f64>,
    /// By the extended plant plus the correction, if this output has one.
    pub corrected: Option<Vec<f64>>,
    /// The rows with the largest error of the calibrated plant.
    pub worst: std::ops::Range<usize>,
    /// The squared error of the calibrated plant divided by the variance of the noise, summed over all rows.
    pub error: f64,
}

/// A nominal parameter that calibration moved within its tolerance.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibratedParameter {
    /// Its name.
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// The value in the plant file.
    pub nominal: f64,
    /// The calibrated value.
    pub value: f64,
    /// The lower end of its 95 % interval.
    pub low: f64,
    /// The upper end.
    pub high: f64,
    /// The change, in standard deviations of its tolerance.
    pub sds: f64,
}

/// All data that a report shows.
#[derive(Debug, Clone, Default)]
pub struct ErrorBreakdown {
    /// Whether no fit used the evaluation records. Otherwise they are the training records.
    pub unseen: bool,
    /// Files and rows of training and of evaluation records.
    pub records: [Vec<(String, usize)>; 2],
    /// Errors by output and region.
    pub slices: Vec<ErrorSlice>,
    /// Regions in which the calibrated plant is wrong.
    pub before: Vec<Region>,
    /// Regions in which the extended plant is wrong.
    pub after: Vec<Region>,
    /// Errors by frequency.
    pub spectra: Vec<Spectrum>,
    /// Errors by order.
    pub orders: Vec<Orders>,
    /// Curves of all outputs in all records.
    pub traces: Vec<Trace>,
    /// Calibrated parameters.
    pub calibration: Vec<CalibratedParameter>,
    /// The black-box correction, where structure is left.
    pub correction: Option<CorrectionResult>,
    /// The result of each combination of the strongest causes.
    pub combinations: Combinations<Combined>,
}

/// Orders are reported only if the spectrum has more orders than this.
const LEAST_ORDERS: usize = 5;

impl ErrorBreakdown {
    /// Files and rows of the evaluation records.
    #[must_use]
    pub fn evaluation_records(&self) -> &[(String, usize)] {
        &self.records[usize::from(self.unseen)]
    }

    /// The curves of an output in the record where the calibrated plant is worst, and their index among all curves.
    #[must_use]
    pub fn worst(&self, output: usize) -> Option<(usize, &Trace)> {
        let traces = self.traces.iter().enumerate().filter(|(_, it)| it.output == output);
        traces.max_by(|a, b| a.1.error.total_cmp(&b.1.error))
    }

    /// Spectra over orders of the outputs whose error stands out at an order, before or after.
    pub fn significant_orders(&self) -> impl Iterator<Item = &Orders> {
        let has_place = |it: &&Orders| {
            let is_place = |region: &Region| region.output == it.output && region.quantity == "order";
            self.before.iter().chain(&self.after).any(is_place)
        };
        self.orders.iter().filter(|it| it.order.len() >= LEAST_ORDERS).filter(has_place)
    }
}

/// The breakdown, and what the strongest causes do on the evaluation records, in the order of the accepted causes. In all its parts, `before` is the
/// calibrated plant and `after` is the extended plant.
#[must_use]
pub fn error_breakdown(it: &Compared<'_>, accepted: &[AcceptedCause]) -> (ErrorBreakdown, Vec<Option<Contribution>>) {
    let strongest = combinations::strongest(accepted);
    let without: Vec<Option<Fit>> = strongest
        .iter()
        .map(|place| validation::fit_initial_states(it.evaluation_records(), &accepted[*place].without))
        .collect();
    let judged = it.evaluation_records();
    let signals = quantities::site_signals(judged, it.after);
    let quantities = quantities::quantities(judged, it.fit.model.file.kind, &it.after.simulated, &signals);
    let along = Along { signals: &signals, quantities: &quantities };
    let mut contributions = vec![None; accepted.len()];
    for (place, without) in strongest.iter().zip(&without).take(MOST_DETAILED_CAUSES) {
        contributions[*place] = without.as_ref().map(|without| contribution(it, without, along));
    }
    (ErrorBreakdown { combinations: combinations::combinations(it, accepted, &without), ..of_plants(it, along) }, contributions)
}

/// What the extended plant does along the evaluation records.
#[derive(Clone, Copy)]
struct Along<'a> {
    signals: &'a [Vec<SiteSignal>],
    quantities: &'a [Quantity],
}

/// The breakdown without the figures of single causes.
fn of_plants(it: &Compared<'_>, Along { signals, quantities }: Along<'_>) -> ErrorBreakdown {
    let judged = it.evaluation_records();
    let (before, after) = (&it.before.simulated, &it.after.simulated);
    let kind = it.fit.model.file.kind;
    let slices = regions::slices(judged, before, after, quantities);
    let spectra = spectrum::spectra(judged, before, after);
    let orders = orders::orders(judged, signals, before, after);
    let wrong = |side: Side| {
        let spectral = orders::spectral(judged, &slices, &spectra, &orders, side);
        regions::regions(&slices, &spectral, side)
    };
    let correction = it.structure.then(|| {
        let own = quantities::site_signals(it.whitened, it.fit);
        let training = Simulation { whitened: it.whitened, simulated: &it.fit.simulated, signals: &own };
        let unseen = Simulation { whitened: it.unseen, simulated: after, signals };
        correction::correction(kind, training, unseen)
    });
    let names = |whitened: &WhitenedResiduals| -> Vec<(String, usize)> {
        whitened.records.iter().map(|it| (regions::name_of(&it.record.file), it.record.rows())).collect()
    };
    let mut traces = Vec::new();
    for (record, prepared) in judged.records.iter().enumerate() {
        for (k, output) in prepared.outputs.iter().enumerate() {
            let added = match &correction {
                Some(CorrectionResult::Useful(found)) => {
                    correction::added(kind, found, prepared, &after[record], &signals[record], *output)
                }
                _ => None,
            };
            let curves = [&it.nominal_there.simulated, before, after].map(|simulated| simulated[record][k].as_slice());
            traces.push(trace(record, prepared, k, curves, added, judged.floors[*output].sd));
        }
    }
    ErrorBreakdown {
        unseen: !it.unseen.records.is_empty(),
        records: [names(it.whitened), names(it.unseen)],
        before: wrong(Side::Before),
        after: wrong(Side::After),
        slices,
        spectra,
        orders,
        traces,
        calibration: calibration(it.nominal, it.fit),
        correction,
        combinations: Combinations::default(),
    }
}

fn trace(
    record: usize,
    prepared: &Prepared,
    k: usize,
    [nominal, before, after]: [&[f64]; 3],
    added: Option<Vec<f64>>,
    sd: f64,
) -> Trace {
    let measured = prepared.measured(k);
    let used = &prepared.used[k];
    let rows = measured.len();
    // Cumulative sums: the worst stretch is the one with the largest increase.
    let mut sums = vec![0.0];
    for row in 0..rows {
        let error = if used[row] { (measured[row] - before[row]) / sd } else { 0.0 };
        sums.push(sums[row] + error * error);
    }
    let length = (rows / ZOOM).max(40).min(rows);
    let start = (0..=rows - length).max_by(|a, b| (sums[a + length] - sums[*a]).total_cmp(&(sums[b + length] - sums[*b])));
    let start = start.unwrap_or(0);
    Trace {
        record,
        output: prepared.outputs[k],
        used: used.clone(),
        time: prepared.record.time.clone(),
        measured: measured.to_vec(),
        nominal: nominal.to_vec(),
        before: before.to_vec(),
        after: after.to_vec(),
        corrected: added.map(|added| after.iter().zip(added).map(|(after, added)| after + added).collect()),
        worst: start..start + length,
        error: sums[rows],
    }
}

/// The changes that calibration made to the parameters that have a tolerance and are not causes.
fn calibration(nominal: &Model, fit: &Fit) -> Vec<CalibratedParameter> {
    let (extended, posterior) = (&fit.model, Posterior::of(fit));
    let kind = nominal.file.kind;
    let moved = nominal.file.tolerance.iter().filter_map(|(name, tolerance)| {
        let unknown = extended.unknowns.iter().position(|it| it.place == Place::Nominal(name))?;
        let (was, is) = (nominal.file.parameters.optional(name)?, extended.file.parameters.optional(name)?);
        let sd = tolerance * was.abs();
        let unit = schema::index(kind, name).map_or("", |index| schema::parameters(kind)[index].unit);
        let (low, high) = posterior.interval(fit, unknown)?;
        (sd > 0.0).then(|| CalibratedParameter { name, unit, nominal: was, value: is, low, high, sds: (is - was) / sd })
    });
    moved.collect()
}

/// What a cause does on the evaluation records, compared with the plant without it.
fn contribution(it: &Compared<'_>, without: &Fit, Along { signals, quantities }: Along<'_>) -> Contribution {
    let judged = it.evaluation_records();
    let slices = regions::slices(judged, &without.simulated, &it.after.simulated, quantities);
    let spectra = spectrum::spectra(judged, &without.simulated, &it.after.simulated);
    let orders = orders::orders(judged, signals, &without.simulated, &it.after.simulated);
    let spectral = orders::spectral(judged, &slices, &spectra, &orders, Side::Before);
    let squared = |fit: &Fit, record: usize| {
        let first = judged.first(record);
        let own = &fit.residual[first..first + WhitenedResiduals::length(&judged.records[record])];
        own.iter().map(|value| value * value).sum::<f64>()
    };
    let outputs = validation::errors(judged, without).into_iter().zip(validation::errors(judged, it.after));
    Contribution {
        outputs: outputs.map(|(without, with)| (without.output, without.noise_ratio, with.noise_ratio)).collect(),
        records: (0..judged.records.len())
            .map(|k| {
                let name = regions::name_of(&judged.records[k].record.file);
                (name, squared(without, k), squared(it.after, k))
            })
            .collect(),
        wrong_regions: regions::most_informative(&regions::regions(&slices, &spectral, Side::Before), PLACES),
    }
}

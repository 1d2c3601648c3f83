//! The gain on holdout rows.
//!
//! In: the nominal surface, extensions, and rows that were not used for them: separate files, or folds of the new data. Each fold is left out in
//! turn, and everything, including the choice of causes, is repeated without it. Out: errors before and after. A holdout row is used only for its
//! error.

use rsm_core::model::{Input, Model, Surface};

use super::Verdict;
use super::data::NewData;
use super::estimate::{numbers, refine};
use super::explain::{explain, from_noise};
use super::explained::Explained;
use super::extension::{Extension, evaluate, extend};
use super::hypotheses;
use super::null::Thresholds;
use super::sample::{ExtraColumn, RowSet, Sample};
use crate::engine::holdout::excess;
pub(super) use crate::engine::holdout::removed_share;
use crate::engine::work::Work;
use rsm_fit::random::Random;

/// The number of folds of the cross-validation: a fifth is left out at a time (Hastie, Tibshirani, Friedman, The Elements of Statistical Learning,
/// 7.10).
pub const FOLDS: usize = 5;

/// Up to this many rows, every noise model is tried again in each fold.
const ALL_NOISE: usize = 200;

/// Errors of one response on holdout rows.
#[derive(Debug, Clone, PartialEq)]
pub struct Errors {
    /// The number of rows.
    pub rows: usize,
    /// The root mean square, in the unit of the response.
    pub rmse: f64,
    /// The same divided by the noise.
    pub noise_ratio: f64,
}

impl Errors {
    /// The mean square above the noise, divided by the noise variance.
    pub(super) fn excess(&self) -> f64 {
        excess(self.noise_ratio.powi(2))
    }
}

/// Holdout rows: measured, and computed by the nominal file, by the extended file, and by the extended file with offsets.
#[derive(Debug, Clone, Default)]
pub struct HoldoutRows {
    /// As measured.
    pub measured: Vec<f64>,
    /// By the nominal file.
    pub nominal: Vec<f64>,
    /// By the extended file alone.
    pub file: Vec<f64>,
    /// By the extended file plus the offsets of drift and blocks, if a row determines them.
    pub extended: Vec<f64>,
}

impl HoldoutRows {
    /// The errors of one of these lists.
    pub fn errors(&self, computed: &[f64], noise: f64) -> Errors {
        let rows = self.measured.len();
        let square: f64 = self.measured.iter().zip(computed).map(|(y, f)| (y - f).powi(2)).sum();
        let rmse = (square / rows.max(1) as f64).sqrt();
        Errors { rows, rmse, noise_ratio: rmse / noise }
    }

    /// The removed share of the mean square above the noise; 0 if there was none.
    pub fn gain(&self, noise: f64) -> f64 {
        let [nominal, extended] = [&self.nominal, &self.extended].map(|it| self.errors(it, noise).excess());
        removed_share(nominal, extended)
    }

    /// With the verdict "no discrepancy" the file stays as it is.
    pub fn of(self, verdict: Verdict) -> Self {
        match verdict {
            Verdict::NoDiscrepancy => HoldoutRows { file: self.nominal.clone(), extended: self.nominal.clone(), ..self },
            Verdict::Explained | Verdict::Unexplained => self,
        }
    }

    fn extend(&mut self, other: HoldoutRows) {
        self.measured.extend(other.measured);
        self.nominal.extend(other.nominal);
        self.file.extend(other.file);
        self.extended.extend(other.extended);
    }
}

/// Rows of another file, or of a fold: values of inputs, further columns, places in the run order of the diagnosis.
struct Rows<'a> {
    points: Vec<Vec<f64>>,
    response: Vec<f64>,
    extras: &'a [ExtraColumn],
    at: Vec<usize>,
    places: Option<Vec<usize>>,
}

fn judge(nominal: (&Surface, &[Input]), extension: &Extension, rows: &Rows<'_>) -> Result<HoldoutRows, String> {
    let mut points = rows.points.clone();
    for name in &extension.columns {
        let column = rows.extras.iter().find(|it| it.name == *name).and_then(|it| it.values.as_ref());
        let column = column.ok_or_else(|| format!("found no column `{name}` of numbers, which the extended surface needs"))?;
        points.push(rows.at.iter().map(|row| column[*row]).collect());
    }
    let file = evaluate(&extension.surface, &extension.inputs, &points);
    let offset = |k: usize| -> f64 {
        let row = rows.at[k];
        let number = |name: &str| rows.extras.iter().find(|it| it.name == name)?.values.as_ref().map(|values| values[row]);
        let level = |name: &str| {
            let (names, of) = rows.extras.iter().find(|it| it.name == name)?.levels.as_ref()?;
            Some(names[of[row]].clone())
        };
        let place = rows.places.as_ref().map(|places| places[k]);
        extension.offsets.iter().filter_map(|offset| offset.at(place, &number, &level)).sum()
    };
    Ok(HoldoutRows {
        measured: rows.response.clone(),
        nominal: evaluate(nominal.0, nominal.1, &rows.points),
        extended: file.iter().enumerate().map(|(k, f)| f + offset(k)).collect(),
        file,
    })
}

/// Evaluates on the rows of holdout files. Rows outside the box or the support are left out here too.
///
/// # Errors
/// If a column is missing that the extension needs, or if no row is inside; as a sentence.
pub fn on_files(model: &Model, index: usize, extension: &Extension, data: &NewData) -> Result<HoldoutRows, String> {
    let response = data.responses[index].as_ref().ok_or("found no column of the response")?;
    let all = vec![true; response.len()];
    let sample = Sample::new(model, index, &data.inputs, (response, &all), &data.extras, RowSet::Inside);
    if sample.rows() == 0 {
        return Err("no row is inside the ranges and the support of the surface".to_string());
    }
    let rows = Rows {
        points: sample.points.clone(),
        response: sample.response.clone(),
        extras: &data.extras,
        at: sample.places.clone(),
        places: None,
    };
    judge((&sample.surface, &sample.inputs), extension, &rows)
}

/// Evaluates by cross-validation over the rows of the sample. Outlying runs of the explanation of all rows are not evaluated. With many rows, the
/// noise model and the coefficient uncertainty are taken from that explanation: they are no causes, and estimating them again would be seven eighths
/// of the work. Causes are chosen again without each fold, each time within its own work limit.
pub fn by_folds(sample: &Sample, thresholds: &Thresholds, all: &Explained, taken: &[Input], limit: usize) -> HoldoutRows {
    let mut rows: Vec<usize> = (0..sample.rows()).filter(|row| !all.outliers.contains(row)).collect();
    Random::new(0xf01d).shuffle(&mut rows);
    let mut judged = HoldoutRows::default();
    for fold in 0..FOLDS {
        let mut left_out: Vec<usize> = rows.iter().copied().skip(fold).step_by(FOLDS).collect();
        left_out.sort_unstable();
        let others: Vec<usize> = (0..sample.rows()).filter(|row| !left_out.contains(row)).collect();
        let training = sample.select(&others);
        let (hypotheses, work) = (hypotheses::all(&training), Work::within(limit));
        let mut found = if sample.rows() > ALL_NOISE {
            from_noise(&training, &hypotheses, thresholds, all.noise, all.variance_factor, &work)
        } else {
            explain(&training, &hypotheses, thresholds, &work)
        };
        refine(&training, &mut found);
        let extension = extend(&training, &found, &numbers(&training, &found), taken);
        let test = sample.select(&left_out);
        let at: Vec<usize> = (0..test.rows()).collect();
        let rows = Rows {
            points: test.points.clone(),
            response: test.response.clone(),
            extras: &test.extras,
            at,
            places: Some(test.places.clone()),
        };
        if let Ok(part) = judge((&sample.surface, &sample.inputs), &extension, &rows) {
            judged.extend(part);
        }
    }
    judged
}

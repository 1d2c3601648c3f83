//! The rows of one response that a diagnosis uses.
//!
//! In: new data in the units of the model, in run order, and a surface. Out: [`Sample`]: the rows inside the box and the support, with the values of
//! the file's polynomial and of each of its terms. Rows outside are counted by place and not used: the error of an extrapolated polynomial is not a
//! fault of the file.

use rsm_core::model::{Evidence, Input, Model, Surface};

use crate::engine::columns::{dot, solve};
use rsm_fit::design::{Design, Physical};
use rsm_fit::random::Random;
use rsm_fit::residual_sd_of;
use rsm_fit::support::Region;

/// A column of the data that the model does not have.
#[derive(Debug, Clone, PartialEq)]
pub struct ExtraColumn {
    /// Its name.
    pub name: String,
    /// Its unit; `1` if the header has none.
    pub unit: String,
    /// Its numbers, if every cell is a number.
    pub values: Option<Vec<f64>>,
    /// The smallest and the largest number in all the data.
    pub range: [f64; 2],
    /// The names of levels and the level of each row, if the column may be one of blocks.
    pub levels: Option<(Vec<String>, Vec<usize>)>,
    /// Whether the values rise from run to run: a clock or a counter.
    pub clock: bool,
}

impl ExtraColumn {
    /// Some of the rows.
    fn select(&self, rows: &[usize]) -> Self {
        ExtraColumn {
            values: self.values.as_ref().map(|values| rows.iter().map(|row| values[*row]).collect()),
            levels: self.levels.as_ref().map(|(names, of)| (names.clone(), rows.iter().map(|row| of[*row]).collect())),
            ..self.clone()
        }
    }

    /// The middle and the half range of the numbers in all the data. They are the same for every surface that lacks the column.
    pub fn coding(&self) -> Option<(f64, f64)> {
        let [low, high] = self.values.as_ref().map(|_| self.range)?;
        Some(((low + high) / 2.0, (high - low) / 2.0))
    }
}

/// Rows of one response, in run order.
#[derive(Debug, Clone)]
pub struct Sample {
    /// The surface of the file.
    pub surface: Surface,
    /// Its inputs, in its order.
    pub inputs: Vec<Input>,
    /// The values of every input as read.
    pub points: Vec<Vec<f64>>,
    /// The response as read.
    pub response: Vec<f64>,
    /// The values of the file's polynomial, not saturated.
    pub nominal: Vec<f64>,
    /// Columns of the terms of the file.
    pub terms: Vec<Vec<f64>>,
    /// Columns that are not in the model.
    pub extras: Vec<ExtraColumn>,
    /// The index of each row among all rows of the data, in run order.
    pub places: Vec<usize>,
    /// Covariance of the coefficients of the file, in units of the noise variance of its rows.
    pub prior: Vec<Vec<f64>>,
    /// The number of rows from which the file was made. `None` if the file does not state it; then `prior` assumes as many rows as here.
    pub rows_of_file: Option<f64>,
    /// The standard deviation of the noise of those rows, if the file states it.
    pub sd_of_file: Option<f64>,
    /// Points spread evenly over box and support, assumed for the rows from which the file was made.
    pub spread: Vec<Vec<f64>>,
    /// Indices of rows outside the box or the support, or where the file saturates.
    pub outside: Vec<usize>,
}

/// The rows that a sample takes.
#[derive(Debug, Clone, Copy)]
pub enum RowSet<'a> {
    /// Rows whose readings are inside the box and the support.
    Inside,
    /// Also rows beyond by no more than [`REACH`], as a faulty sensor may read.
    Near,
    /// These rows, if they are near.
    Places(&'a [usize]),
}

/// In half ranges: the largest bias of a hypothesis, or a gain of 1.25 for an input whose range begins at zero.
const REACH: f64 = 0.5;

/// This many points give the mean products of terms to two per cent.
const SPREAD: usize = 2000;

/// As a share of the range: a smaller excess is the rounding of a unit conversion.
const ROUNDING: f64 = 1e-9;

impl Sample {
    /// Whether an input is the contrast of a category, which no sensor reads.
    pub(super) fn is_contrast(&self, input: usize) -> bool {
        self.surface.is_contrast(&self.inputs[input].name)
    }

    /// The sample for surface `index` of a model. `points`, the response and `extras` are of all rows. A row that is not `used` is neither in the
    /// sample nor outside.
    pub fn new(
        model: &Model,
        index: usize,
        points: &[Vec<f64>],
        (response, used): (&[f64], &[bool]),
        extras: &[ExtraColumn],
        taken: RowSet<'_>,
    ) -> Self {
        let surface = model.surfaces[index].clone();
        let inputs: Vec<Input> = surface
            .inputs
            .iter()
            .map(|name| model.input(name).expect("a checked surface names known inputs").clone())
            .collect();
        let of_input =
            |input: &Input| model.inputs.iter().position(|other| other.name == input.name).expect("it is one of them");
        let columns: Vec<&Vec<f64>> = inputs.iter().map(|input| &points[of_input(input)]).collect();
        let region = Region::new(&surface, &inputs);
        let mut places = Vec::new();
        let mut outside = Vec::new();
        let reach = if matches!(taken, RowSet::Inside) { 0.0 } else { REACH };
        for row in (0..response.len()).filter(|row| used[*row]) {
            let point: Vec<f64> = columns.iter().map(|column| column[row]).collect();
            let wanted = if let RowSet::Places(wanted) = taken { wanted.binary_search(&row).is_ok() } else { true };
            if wanted && is_inside(&surface, &inputs, &region, &point, reach) { places.push(row) } else { outside.push(row) }
        }
        let rows_of_file = surface.evidence.iter().find_map(|(name, value)| match value {
            Evidence::Whole(rows) if name == "rows" && *rows > 0 => Some(*rows as f64),
            _ => None,
        });
        let sd_of_file = residual_sd_of(&surface).filter(|sd| *sd > 0.0);
        let mut sample = Sample {
            points: columns.iter().map(|column| places.iter().map(|row| column[*row]).collect()).collect(),
            response: places.iter().map(|row| response[*row]).collect(),
            extras: extras.iter().map(|extra| extra.select(&places)).collect(),
            nominal: Vec::new(),
            terms: Vec::new(),
            prior: Vec::new(),
            rows_of_file,
            sd_of_file,
            spread: Vec::new(),
            surface,
            inputs,
            places,
            outside,
        };
        let powers: Vec<Vec<u32>> = sample.surface.terms.iter().map(|term| term.powers.clone()).collect();
        sample.terms = sample.columns_of(&powers, &sample.points);
        sample.nominal = sample.polynomial(&sample.points);
        if let Some([low, high]) = sample.surface.output_range {
            // Where the evaluator saturates, the data contain no information about the polynomial.
            let inner: Vec<usize> = (0..sample.rows()).filter(|row| (low..=high).contains(&sample.nominal[*row])).collect();
            let lost = (0..sample.rows()).filter(|row| !inner.contains(row)).map(|row| sample.places[row]);
            let outside: Vec<usize> = sample.outside.iter().copied().chain(lost).collect();
            sample = sample.select(&inner);
            sample.outside = outside;
            sample.outside.sort_unstable();
        }
        sample.spread = spread(&sample, &region);
        let terms = sample.columns_of(&powers, &sample.spread);
        // sigma^2 (X'X)^-1 for as many rows as made the file, drawn at random from box and support. Its mean is M^-1/(rows - terms - 1), with M the
        // mean products (exact where the inverse Wishart distribution holds). The coefficients of designed experiments are more accurate, so this is
        // a cautious value.
        let free = (rows_of_file.unwrap_or(sample.rows() as f64) - terms.len() as f64 - 1.0).max(1.0);
        let share = sample.spread.first().map_or(0, Vec::len) as f64 / free;
        let constant = vec![0.0; sample.spread.first().map_or(0, Vec::len)];
        sample.prior = solve(&terms, &constant).covariance;
        sample.prior.iter_mut().flatten().for_each(|value| *value *= share);
        sample
    }

    /// The indices of rows that are inside for at least one of the plausible sensors: `sensors` has the gains and biases for each input.
    pub fn truly_inside(&self, sensors: &[Vec<(f64, f64)>]) -> Vec<usize> {
        let region = Region::new(&self.surface, &self.inputs);
        let is_inside = |row: &usize| {
            let mut points: Vec<Vec<f64>> = vec![Vec::new()];
            for (column, sensors) in self.points.iter().zip(sensors) {
                let truths = sensors.iter().map(|(gain, bias)| (column[*row] - bias) / gain);
                points =
                    truths.flat_map(|truth| points.iter().map(move |begun| [begun.as_slice(), &[truth]].concat())).collect();
            }
            points.iter().any(|point| is_inside(&self.surface, &self.inputs, &region, point, 0.0))
        };
        (0..self.rows()).filter(is_inside).map(|row| self.places[row]).collect()
    }

    /// The number of rows.
    pub fn rows(&self) -> usize {
        self.response.len()
    }

    /// Measured minus computed.
    pub fn residual(&self) -> Vec<f64> {
        self.response.iter().zip(&self.nominal).map(|(y, f)| y - f).collect()
    }

    /// Some of the rows.
    pub fn select(&self, rows: &[usize]) -> Self {
        let of = |column: &Vec<f64>| -> Vec<f64> { rows.iter().map(|row| column[*row]).collect() };
        Sample {
            surface: self.surface.clone(),
            inputs: self.inputs.clone(),
            points: self.points.iter().map(of).collect(),
            response: of(&self.response),
            nominal: of(&self.nominal),
            terms: self.terms.iter().map(of).collect(),
            extras: self.extras.iter().map(|extra| extra.select(rows)).collect(),
            places: rows.iter().map(|row| self.places[*row]).collect(),
            prior: self.prior.clone(),
            rows_of_file: self.rows_of_file,
            sd_of_file: self.sd_of_file,
            spread: self.spread.clone(),
            outside: self.outside.clone(),
        }
    }

    /// The columns of terms at points; a term is given by its powers.
    pub fn columns_of(&self, powers: &[Vec<u32>], points: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let design = Design::new(&self.surface, &self.inputs, powers.to_vec());
        let rows = points.first().map_or(0, Vec::len);
        let mut columns = vec![Vec::with_capacity(rows); powers.len()];
        for row in 0..rows {
            let point: Vec<Physical> = points.iter().map(|column| Physical(column[row])).collect();
            for (column, value) in columns.iter_mut().zip(design.row_as_measured(&point)) {
                column.push(value.to_f64());
            }
        }
        columns
    }

    /// The file's polynomial at points.
    pub fn polynomial(&self, points: &[Vec<f64>]) -> Vec<f64> {
        let powers: Vec<Vec<u32>> = self.surface.terms.iter().map(|term| term.powers.clone()).collect();
        let columns = self.columns_of(&powers, points);
        let rows = points.first().map_or(0, Vec::len);
        (0..rows)
            .map(|row| self.surface.terms.iter().zip(&columns).map(|(term, column)| term.coefficient * column[row]).sum())
            .collect()
    }

    /// Coded values of an input at the rows: the variable of the powers in the terms.
    pub fn coded(&self, input: usize) -> Vec<f64> {
        let factors = rsm_core::basis::Factor::all(&self.surface, &self.inputs);
        let value = |xi: &f64| factors[input].variable.value(rsm_fit::dd::Dd::from(*xi)).to_f64();
        self.points[input].iter().map(value).collect()
    }
}

/// Whether a point is inside the box and the support, or beyond by no more than `reach` half ranges.
fn is_inside(surface: &Surface, inputs: &[Input], region: &Region, point: &[f64], reach: f64) -> bool {
    let in_box = inputs.iter().zip(point).all(|(input, value)| {
        let [low, high] = input.range;
        let margin = (ROUNDING + reach / 2.0) * (high - low);
        // An inverse is not defined on the other side of zero.
        let is_defined = !surface.reciprocal.contains(&input.name) || value * (low + high) > 0.0;
        is_defined && (low - margin..=high + margin).contains(value)
    });
    let point: Vec<Physical> = point.iter().copied().map(Physical).collect();
    in_box && {
        let coded: Vec<f64> = region.coded(&point).iter().map(|x| x.to_f64()).collect();
        let margin = |normal: &[f64]| ROUNDING + reach * dot(normal, normal).sqrt();
        surface.support.iter().all(|space| dot(&space.normal, &coded) <= space.bound + margin(&space.normal))
    }
}

/// Random points of the box inside the support; of the box alone if the support is too thin to be hit.
fn spread(sample: &Sample, region: &Region) -> Vec<Vec<f64>> {
    let mut random = Random::new(0x5b0e);
    let mut points = vec![Vec::with_capacity(SPREAD); sample.inputs.len()];
    let mut drawn = 0;
    while points[0].len() < SPREAD {
        let point: Vec<f64> =
            sample.inputs.iter().map(|input| input.range[0] + (input.range[1] - input.range[0]) * random.share()).collect();
        drawn += 1;
        let physical: Vec<Physical> = point.iter().copied().map(Physical).collect();
        let coded: Vec<f64> = region.coded(&physical).iter().map(|x| x.to_f64()).collect();
        let inside = sample.surface.support.iter().all(|space| dot(&space.normal, &coded) <= space.bound);
        if inside || drawn > 50 * SPREAD {
            points.iter_mut().zip(point).for_each(|(column, value)| column.push(value));
        }
    }
    points
}

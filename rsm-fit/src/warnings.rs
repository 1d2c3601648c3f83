//! Warnings about a fitted surface.
//!
//! In: a fitted surface with its rows and figures. Out: warnings, each with a kind and a sentence; and whether a lack of fit is significant. Each
//! test on residuals has a false-alarm rate of [`ALARM`] if the model is right and the noise is normal and independent. The other warnings compare
//! the surface with its data and give no false alarm there. Changes nothing.
//!
//! ```text
//! lack-of-fit           F against replicates; and the largest t of a term that is not in the model, up to one order above
//! outliers              the largest externally studentised residual, Bonferroni over rows
//! correlated-residuals  neighbours in the run order, or as rows stand, against random orders; whitened errors with autoregressive noise
//! near-random-walk      autoregressive noise whose level is hardly known (`autoregressive/report.rs`)
//! explains-little       less than half of the spread about the mean on holdout rows
//! output-bound          the output range limits the surface at some rows
//! bounds-off-data       most responses lie beyond the bounds of a constraint or of the output range
//! constraints-off-data  constraints raise the residuals by more than noise explains
//! rows-seen             rows kept apart are exact copies of fitted rows
//! judged-by-choosers    there are no holdout rows
//! missing-rows          a large share of the rows is left out because a cell is missing (`left_out.rs`)
//! ```
//!
//! Sources: Myers, Montgomery, Anderson-Cook, Response Surface Methodology, 2.6 and 2.7 (lack of fit, R-student); Cook, Weisberg 1982,
//! 2.2.2 (Bonferroni for the largest); Wald, Wolfowitz 1943 (serial correlation against random orders); Gourieroux, Holly, Monfort 1982, Econometrica
//! 50 (inequality constraints).

use rsm_core::order;
use std::borrow::Cow;

use rsm_core::model::{Input, Surface};

use crate::autoregressive::Whitening;
use crate::dd::Dd;
use crate::design::eight::Seen;
use crate::design::{self, Design, count_of_candidates};
use crate::distributions::{two_sided_t, upper_f};
use crate::qr::{Growing, Triangle};
use crate::selection::Sample;
use crate::sequence::Sequence;
use crate::spec::{Constraint, MOST_TERMS};
use crate::statistics::{self, ResponseStatistics, RowsUsed, Serial, Warning, serial, value};
use crate::verdict::LEAST_EXPLAINED;

/// The false-alarm rate of each test.
pub(crate) const ALARM: f64 = 0.01;

/// Residuals below this share of the spread are rounding errors of the data and are not tested.
const EXACT: f64 = 1e-9;

/// A row counts as limited by the output range if the polynomial exceeds it by more than this share of the spread.
const HELD: f64 = 1e-9;

/// A response counts as beyond a bound by at least this many residual standard deviations.
const FAR: f64 = 3.0;

/// The limit of double-double multiplications in the search for a missing term: 2 * 10^8 take a second. Above it, terms of the next order are not
/// tested; if it is still exceeded, none are.
const WORK: f64 = 2e8;

/// Steps of 1/2 in the search for a t that is certainly within noise: up to 20, which has a probability of 10^-88 with many rows.
const MOST_HALVES: u32 = 40;

/// The largest number of named outliers.
const MOST_NAMED: usize = 5;

pub(crate) struct Notes<'a> {
    pub surface: &'a Surface,
    pub inputs: &'a [Input],
    pub design: &'a Design,
    pub fit: &'a Sample,
    pub sequence: &'a Sequence,
    /// The transformation of rows with autoregressive errors: all tests are then of whitened rows.
    pub whitening: Option<&'a Whitening>,
    pub constraints: &'a [Constraint],
    pub statistics: &'a ResponseStatistics,
    /// Whether the coefficients are shrunken.
    pub is_shrunk: bool,
    /// The residual standard deviation of least squares without constraints.
    pub free_residual_sd: Option<f64>,
    pub highest_order: u32,
    /// The explained share of the spread on rows that were not used for any choice.
    pub explained: Option<f64>,
    pub copies: &'a [(&'static str, usize)],
    /// Whether the rows have groups that stay together.
    pub is_grouped: bool,
    /// The triangle of the terms of `design`, if it is known, and the leverages of the rows, times their weights.
    pub triangle: Option<&'a Triangle>,
    pub leverages: Option<&'a [f64]>,
}

/// The warnings, with data for other figures.
pub(crate) struct Noted {
    pub warnings: Vec<Warning>,
    /// Whether a lack of fit is significant.
    pub is_lacking: bool,
    /// The serial correlation, if errors of neighbours are correlated.
    pub serial: Option<Serial>,
}

/// Residuals of the fitted rows with related figures.
struct Residuals<'a> {
    /// sqrt(weight) (y - yhat), or whitened errors.
    weighted: Vec<f64>,
    /// The whitened terms of each row; empty with independent errors.
    whitened: Vec<Vec<Dd>>,
    /// The values of the polynomial, before the output range.
    predicted: Vec<f64>,
    triangle: Cow<'a, Triangle>,
}

impl Notes<'_> {
    /// All warnings.
    pub(crate) fn all(&self) -> Noted {
        let mut warnings = Vec::new();
        let mut serial = None;
        let mut warn = |kind: &'static str, what: Option<String>| warnings.extend(what.map(|what| Warning { kind, what }));
        let residuals = self.residuals();
        let low = self.fit.response.iter().copied().fold(f64::INFINITY, f64::min);
        let high = self.fit.response.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let spread = high - low;
        // Tests for least squares are not made for other coefficients.
        let is_held = self.is_shrunk || self.statistics.constraints.as_ref().is_some_and(|constraints| constraints.active);
        let is_exact = self.statistics.residual_sd.is_none_or(|sd| sd <= EXACT * spread);
        warn("explains-little", self.explains_little(spread, is_held));
        let lack = if is_exact { None } else { self.against_replicates().or_else(|| self.missing_term(is_held)) };
        let is_lacking = lack.is_some();
        warn("lack-of-fit", lack);
        if !is_exact && !is_held {
            warn("outliers", self.outliers(&residuals));
        }
        if !is_exact {
            serial = self.serial(&residuals, is_held);
            warn("correlated-residuals", serial.as_ref().map(|serial| self.correlated(serial)));
        }
        warn("output-bound", self.output_bound(&residuals, spread));
        warn("bounds-off-data", self.bounds_off_data(low, high));
        if !is_exact {
            warn("constraints-off-data", self.constraints_off_data());
        }
        for (key, count) in self.copies {
            warn(
                "rows-seen",
                Some(format!("{count} rows of `{key}` are exact copies of fitted rows: they are no holdout rows")),
            );
        }
        Noted { warnings, is_lacking, serial }
    }

    fn residuals(&self) -> Residuals<'_> {
        let coefficients: Vec<Dd> = self.statistics.terms.iter().map(|term| Dd::from(term.coefficient)).collect();
        let (weighted, predicted) = self.fit.observed(|rows| {
            let of_one = |(row, predicted): (usize, Dd)| {
                let error = Dd::from(rows.response[row]) - predicted;
                let error = if rows.weights.is_empty() { error } else { error * rows.weight(row).sqrt() };
                (error.to_f64(), predicted.to_f64())
            };
            rows.values(self.design, &coefficients, Seen::AsMeasured).into_iter().enumerate().map(of_one).unzip()
        });
        let Some(whitening) = self.whitening else {
            let triangle = self.triangle.map_or_else(|| Cow::Owned(self.fit.to_fit(self.design)), Cow::Borrowed);
            return Residuals { weighted, whitened: Vec::new(), predicted, triangle };
        };
        let rows = self.fit.observed(|fit| whitening.rows(self.design, fit, self.sequence));
        let mut errors = vec![0.0; rows.len()];
        let mut whitened = vec![Vec::new(); rows.len()];
        for (row, mut terms) in self.sequence.rows.iter().zip(rows) {
            let response = terms.pop().expect("the response is behind the terms");
            errors[*row] = (response - value(&terms, &coefficients)).to_f64();
            whitened[*row] = terms;
        }
        Residuals { weighted: errors, whitened, predicted, triangle: Cow::Owned(self.triangle_of(self.design)) }
    }

    /// The triangle of some terms and the response, of whitened rows if errors are autoregressive.
    fn triangle_of(&self, design: &Design) -> Triangle {
        match self.whitening {
            None => self.fit.to_fit(design),
            Some(whitening) => self.fit.observed(|fit| whitening.triangle(design, fit, self.sequence)),
        }
    }

    fn explains_little(&self, spread: f64, is_held: bool) -> Option<String> {
        if spread == 0.0 {
            return None;
        }
        let fitted = self.statistics.r2_predicted.or(self.statistics.r2);
        let (share, rows) = match self.explained {
            Some(share) => (share, "holdout rows"),
            None => (if is_held { self.statistics.r2? } else { fitted? }, "the fitted rows"),
        };
        explains_little(share, rows)
    }

    fn against_replicates(&self) -> Option<String> {
        let lack = self.statistics.lack_of_fit.as_ref()?;
        let p = lack.p.filter(|p| *p < ALARM)?;
        let f = lack.f.unwrap_or(f64::INFINITY);
        Some(format!("the surface misses the means of repeated points by more than their scatter (F = {f:.1}, p = {p:.1e})"))
    }

    /// The term outside of the model that would explain most, if it is significant.
    fn missing_term(&self, is_held: bool) -> Option<String> {
        if is_held {
            return None;
        }
        let (order, terms) = self.wider()?;
        let chosen = self.design.terms();
        let others: Vec<Vec<u32>> = terms.into_iter().filter(|powers| !chosen.contains(powers)).collect();
        if others.is_empty() {
            return None;
        }
        let design = Design::new(self.surface, self.inputs, [chosen, &others].concat());
        let triangle = self.triangle_of(&design);
        let mut growing = Growing::new(&triangle);
        for k in 0..chosen.len() {
            growing.add(k).ok()?;
        }
        let freedom = self.fit.rows().checked_sub(chosen.len() + 1).filter(|freedom| *freedom > 0)? as f64;
        let left = growing.residual_square().to_f64();
        let gains = (chosen.len()..design.width()).filter_map(|k| Some((k, growing.effect_of_adding(k)?.0.to_f64())));
        let (term, gain) = gains.reduce(|best, other| if other.1 > best.1 { other } else { best })?;
        let t = (gain / ((left - gain).max(0.0) / freedom)).sqrt();
        // Corrected for the number of tested terms.
        let p = if t.is_finite() { two_sided_t(t, freedom)? * others.len() as f64 } else { 0.0 };
        (p < ALARM).then(|| {
            let above = if order > self.highest_order { ", which is above the order that was fitted," } else { "" };
            let share = 100.0 * gain / left;
            format!("{}{above} would take {share:.1} % of the residual sum of squares (p = {p:.1e})", design.name_of(term))
        })
    }

    /// All terms up to one order above the highest fitted one, or up to that.
    fn wider(&self) -> Option<(u32, Vec<Vec<u32>>)> {
        let fits = |order: &u32| {
            let count = count_of_candidates(self.surface, *order);
            count <= MOST_TERMS && (count * count) as f64 * self.fit.rows() as f64 <= WORK
        };
        let order = [self.highest_order + 1, self.highest_order].into_iter().find(fits)?;
        Some((order, design::terms_up_to(self.surface, order)))
    }

    fn outliers(&self, residuals: &Residuals<'_>) -> Option<String> {
        let rows = self.fit.rows();
        let terms: Vec<usize> = (0..self.design.width()).collect();
        let growing = Growing::of(&residuals.triangle, &terms).ok()?;
        let freedom = rows.checked_sub(terms.len() + 1).filter(|freedom| *freedom > 0)? as f64;
        let square: f64 = residuals.weighted.iter().map(|error| error * error).sum();
        let leverages = match self.leverages {
            Some(leverages) => Cow::Borrowed(leverages),
            None if self.whitening.is_some() => {
                Cow::Owned(residuals.whitened.iter().map(|x| growing.leverage(x).to_f64()).collect())
            }
            None => Cow::Owned(self.fit.observed(|fit| statistics::leverages(self.design, &growing, fit))),
        };
        let studentised = |row: usize| {
            let own = 1.0 - leverages[row];
            let error = residuals.weighted[row];
            let without = ((square - error * error / own) / freedom).max(0.0);
            let t = error / (without * own).sqrt();
            // With leverage 1 the surface passes through the point whatever its response is.
            (own > 1e-9 && !t.is_nan()).then_some((row, t))
        };
        let found: Vec<(usize, f64)> = (0..rows).filter_map(studentised).collect();
        let tested = found.len() as f64;
        let is_small = |t: f64| two_sided_t(t, freedom).is_some_and(|p| p * tested >= 2.0 * ALARM);
        // The probability falls with t. So all rows up to this t are within it too: a factor of 2 is above every rounding error.
        let within = (1..MOST_HALVES).map(|k| 0.5 * f64::from(k)).take_while(|t| is_small(*t)).last().unwrap_or(0.0);
        let is_beyond = |(_, t): &&(usize, f64)| {
            !t.is_finite() || t.abs() > within && two_sided_t(*t, freedom).is_some_and(|p| p * tested < ALARM)
        };
        let mut beyond: Vec<&(usize, f64)> = found.iter().filter(is_beyond).collect();
        order::descending(&mut beyond, |it| it.1.abs());
        let named: Vec<String> =
            beyond.iter().take(MOST_NAMED).map(|(row, t)| format!("{}: {t:+.1}", self.place(*row))).collect();
        let more = beyond.len().saturating_sub(MOST_NAMED);
        let more = if more > 0 { format!(", and {more} more") } else { String::new() };
        (!beyond.is_empty()).then(|| {
            format!(
                "{} that noise does not explain, in standard deviations: {}{more}",
                count(beyond.len(), "row has an error", "rows have errors"),
                named.join("; ")
            )
        })
    }

    /// A fitted row described by its inputs, because its number alone means little after a split.
    fn place(&self, row: usize) -> String {
        let each = self.surface.inputs.iter().zip(&self.fit.columns).map(|(name, column)| format!("{name} = {}", column[row]));
        format!("({})", each.collect::<Vec<String>>().join(", "))
    }

    fn serial(&self, residuals: &Residuals<'_>, is_held: bool) -> Option<Serial> {
        let sequence = self.sequence;
        let errors: Vec<f64> = sequence.rows.iter().map(|row| residuals.weighted[*row]).collect();
        let (correlation, p) = serial::of_neighbours(&errors, &sequence.places).filter(|(_, p)| *p <= ALARM)?;
        let errors = || {
            let terms: Vec<usize> = (0..self.design.width()).collect();
            let is_possible = !is_held && self.whitening.is_none();
            let solved = Growing::of(&residuals.triangle, &terms).ok().filter(|_| is_possible)?;
            let weighted = &residuals.weighted;
            self.fit.observed(|fit| serial::newey_west(self.design, &solved, fit, sequence, weighted, correlation))
        };
        let (lags, standard_errors) = errors().map_or((None, Vec::new()), |(lags, errors)| (Some(lags), errors));
        let coefficients = self.statistics.terms.iter().map(|term| term.coefficient);
        let freedom = self.fit.rows().saturating_sub(self.design.width()).max(1);
        let intervals = serial::intervals(coefficients, &standard_errors, freedom);
        let order = if sequence.is_known { "run-order" } else { "rows" };
        Some(Serial { order, correlation, p, lags, standard_errors, intervals })
    }

    fn correlated(&self, serial: &Serial) -> String {
        let (who, why) = match serial.order {
            "rows" => {
                ("rows", "a quantity drifts during the recording, or the surface has an error that neighbouring rows share")
            }
            _ => ("runs", "a quantity drifts"),
        };
        let ratio = serial.largest_ratio(self.statistics.terms.iter().map(|term| term.standard_error));
        let known = ratio.zip(serial.lags).map_or(String::new(), |(ratio, lags)| {
            format!("; estimated with {lags} lags (Newey-West) they are up to {ratio:.1} times as large")
        });
        let (correlation, p) = (serial.correlation, serial.p);
        if self.whitening.is_some() {
            return format!(
                "errors of neighbouring rows are correlated ({correlation:.2}) after the noise is whitened: give `noise` a higher order, or the surface has an error that neighbouring rows share"
            );
        }
        // A row that is left out at random has its neighbours among the fitted rows.
        let is_at_random = self.statistics.cross_validation.is_some() && !self.is_grouped && serial.order == "rows";
        let of_left_out = if is_at_random {
            ". Errors on rows left out at random are those of the same recording: if there are several, give the column that tells them apart in `keep_together` of a split"
        } else {
            ""
        };
        format!(
            "errors of neighbouring {who} are correlated ({correlation:.2}, p = {}): {why}. The standard errors are too small{known}{of_left_out}",
            if p < 1e-3 { format!("{p:.1e}") } else { format!("{p:.3}") }
        )
    }

    fn output_bound(&self, residuals: &Residuals<'_>, spread: f64) -> Option<String> {
        let [low, high] = self.surface.output_range?;
        let margin = HELD * spread;
        let held = residuals.predicted.iter().filter(|y| **y < low - margin || **y > high + margin).count();
        (held > 0).then(|| {
            let [low, high] = self.in_response([low, high]);
            format!("the output range [{low}, {high}] limits the surface at {held} of {} fitted rows", self.fit.rows())
        })
    }

    /// Two values of the terms, in the unit of the response and in order.
    fn in_response(&self, [low, high]: [f64; 2]) -> [f64; 2] {
        let Some(transform) = self.surface.transform else { return [low, high] };
        let [low, high] = [low, high].map(|end| transform.response(end));
        [low.min(high), low.max(high)]
    }

    fn bounds_off_data(&self, low: f64, high: f64) -> Option<String> {
        let of_constraint = |constraint: &Constraint| match constraint {
            Constraint::Bounds { min, max } => Some((min.unwrap_or(f64::NEG_INFINITY), max.unwrap_or(f64::INFINITY))),
            _ => None,
        };
        let ranges = self.constraints.iter().filter_map(of_constraint);
        let ranges = ranges.chain(self.surface.output_range.map(|[low, high]| (low, high)));
        let far = FAR * self.free_residual_sd.unwrap_or(0.0);
        ranges.into_iter().find_map(|(least, most)| {
            let beyond = self.fit.response.iter().filter(|y| **y < least - far || **y > most + far).count();
            (2 * beyond > self.fit.rows()).then(|| {
                let [least, most] = self.in_response([least, most]);
                let [low, high] = self.in_response([low, high]);
                format!(
                    "{beyond} of {} responses lie far beyond the bounds [{least}, {most}]; they run from {low} to {high}",
                    self.fit.rows()
                )
            })
        })
    }
}

impl Notes<'_> {
    /// If the true surface keeps q active constraints, the rise of the residual sum of squares by them, divided by the variance of the noise, is a
    /// mixture of chi-squares with at most q degrees of freedom (Gourieroux, Holly, Monfort 1982). So the upper tail of F with q and the residual
    /// degrees of freedom is a bound of its probability. The variance is that of the fit without constraints.
    fn constraints_off_data(&self) -> Option<String> {
        let told = self.statistics.constraints.as_ref().filter(|told| told.active)?;
        let (free, held) = (told.residual_sd_without?, self.statistics.residual_sd?);
        let terms = self.statistics.terms.len();
        let freedom = self.fit.rows().checked_sub(terms).filter(|freedom| *freedom > 0)? as f64;
        let points: usize = told.constraints.iter().map(|one| one.points.len()).sum();
        let active = points.clamp(1, terms) as f64;
        let f = freedom * ((held / free).powi(2) - 1.0) / active;
        let p = upper_f(f, [active, freedom]).filter(|p| *p < ALARM)?;
        let names: Vec<&str> =
            told.constraints.iter().filter(|one| !one.points.is_empty()).map(|one| one.constraint.as_str()).collect();
        let change = told.largest_change.as_ref().map_or(String::new(), |change| {
            let place: Vec<String> = change.at.0.iter().map(|(name, x)| format!("{name} = {x:.4}")).collect();
            format!("; they change the surface by up to {:.4} at {}", change.value, place.join(", "))
        });
        Some(format!(
            "the data contradict the constraints ({}): the residual standard deviation is {held:.4} with them and {free:.4} without, more than noise explains (F = {f:.1}, p = {p:.1e}){change}",
            names.join("; ")
        ))
    }
}

/// The message if a surface explains too little of the spread about the mean.
pub(crate) fn explains_little(share: f64, rows: &str) -> Option<String> {
    (share < LEAST_EXPLAINED).then(|| {
        if share <= 0.0 {
            format!("on {rows} the surface does no better than the mean (R2 {share:.3})")
        } else {
            format!("on {rows} the surface explains {:.1} % of the spread about the mean", 100.0 * share)
        }
    })
}

/// The warning if there are no rows that were not used for any choice.
pub(crate) fn not_judged(used: &RowsUsed) -> Warning {
    Warning { kind: "judged-by-choosers", what: format!("there is no error estimate from holdout rows: {}", used.error) }
}

fn count(count: usize, one: &str, many: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { many })
}

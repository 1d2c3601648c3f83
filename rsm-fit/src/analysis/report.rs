//! The analysis of a fitted surface for `rsm fit --json`.
//!
//! In: the design of the chosen terms and the fitted rows. Out: a [`Report`]. There is none if it would take too long, if there is no constant term,
//! or if the residual has no degree of freedom. Terms enter by kind: first order, interactions, squares, then order by order.

use serde::Serialize;

use super::{Analysis, BoxCox, Criteria, Influence, Line, box_cox, coefficients, line};
use crate::dd::Dd;
use crate::design::{Design, order};
use crate::observations::Observations;
use crate::qr::{Growing, Triangle};
use crate::sequence::Sequence;

/// The limit of double-double multiplications: 10^8 take a second.
const WORK: f64 = 1e8;

/// The largest number of named rows.
const MOST_NAMED: usize = 5;

/// The figures of a term, in the order of the model.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TermReport {
    /// Bounds of the 95 % interval of the coefficient.
    pub interval: [f64; 2],
    /// The variance inflation factor; `None` for the constant.
    pub vif: Option<f64>,
    /// The increase of the residual sum of squares without this term.
    pub partial_ss: f64,
}

/// A row with its influence.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RowReport {
    /// Its number among the fitted rows, from 1.
    pub row: usize,
    /// Its influence.
    #[serde(flatten)]
    pub influence: Influence,
}

/// The analysis of one response.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// The analysis of variance; each line is after those before it.
    pub sequential: Vec<Line>,
    /// The terms in the order of the model.
    pub terms: Vec<TermReport>,
    /// Akaike's criterion.
    pub aic: f64,
    /// The same with the correction for few rows.
    pub aicc: Option<f64>,
    /// Schwarz's criterion.
    pub bic: f64,
    /// The Durbin-Watson statistic in run order if it is known, otherwise in row order. Pairs over a left-out row do not count, and the sum is scaled
    /// to the number of pairs without gaps.
    pub durbin_watson: Option<f64>,
    /// The rows with the largest Cook's distances, the largest first.
    pub influential: Vec<RowReport>,
    /// The Box-Cox power of the response; `None` if a response is not above 0.
    pub box_cox: Option<BoxCox>,
}

pub(crate) fn of(design: &Design, fit: Observations<'_>, sequence: &Sequence) -> Option<Report> {
    let width = design.width();
    if fit.response.len() as f64 * (width as f64 + 1.0).powi(2) > WORK {
        return None;
    }
    let (constant, kinds) = kinds(design)?;
    let rows = &sequence.rows;
    let response: Vec<f64> = rows.iter().map(|row| fit.response[*row]).collect();
    let weights: Vec<f64> = rows.iter().filter_map(|row| fit.weights.get(*row).copied()).collect();
    let entered: Vec<usize> =
        std::iter::once(constant).chain(kinds.iter().flat_map(|(_, terms)| terms.iter().copied())).collect();
    // The constant has the value 1, but for odd symmetry, which has no constant.
    let plain = |row: usize| {
        let terms = design.row_as_measured(&fit.point(rows[row]));
        entered.iter().map(|k| terms[*k]).collect::<Vec<Dd>>()
    };
    let groups: Vec<(&str, usize)> = kinds.iter().map(|(name, terms)| (name.as_str(), terms.len())).collect();
    let analysis = Analysis::of_rows(&groups, &plain, &response, &weights).ok()?;
    // With a zero residual, the criteria are not defined.
    if !(analysis.aic.is_finite() && analysis.residual_sd > 0.0) {
        return None;
    }
    let term = |k: usize| {
        let place = entered.iter().position(|other| *other == k).expect("every term entered");
        let found = &analysis.coefficients[place];
        TermReport { interval: found.interval, vif: found.vif, partial_ss: found.partial_ss }
    };
    let mut influential: Vec<RowReport> =
        rows.iter().zip(&analysis.rows).map(|(row, influence)| RowReport { row: row + 1, influence: *influence }).collect();
    let cook = |report: &RowReport| report.influence.cook.unwrap_or(0.0);
    influential.sort_by(|a, b| cook(b).total_cmp(&cook(a)).then(a.row.cmp(&b.row)));
    influential.truncate(MOST_NAMED);
    // Columns in memory, only where the power exists.
    let columns = || {
        let mut columns = vec![Vec::with_capacity(rows.len()); entered.len() - 1];
        for row in 0..rows.len() {
            columns.iter_mut().zip(&plain(row)[1..]).for_each(|(column, x)| column.push(x.to_f64()));
        }
        columns
    };
    let has_power = weights.is_empty() && response.iter().all(|y| *y > 0.0);
    let power = if has_power { box_cox(&columns(), &response) } else { None };
    Some(Report {
        terms: (0..width).map(term).collect(),
        aic: analysis.aic,
        aicc: analysis.aicc,
        bic: analysis.bic,
        durbin_watson: durbin_watson(&analysis, &weights, sequence).filter(|d| d.is_finite()),
        influential,
        box_cox: power,
        sequential: analysis.sequential,
    })
}

/// Terms that enter together, with the name of their line.
type Kind = (String, Vec<usize>);

/// The constant, and the other terms by kind.
fn kinds(design: &Design) -> Option<(usize, Vec<Kind>)> {
    let constant = design.terms().iter().position(|powers| order(powers) == 0)?;
    // Blocks and other additive categories first, then the other categories by themselves.
    let mut kinds: Vec<Kind> = design.shifts();
    let highest = design.terms().iter().map(|powers| order(powers)).max()?;
    let has_entered: Vec<usize> = kinds.iter().flat_map(|(_, terms)| terms.iter().copied()).collect();
    for at in 1..=highest {
        let of_order = |k: &usize| order(&design.terms()[*k]) == at && !has_entered.contains(k);
        let terms: Vec<usize> = (0..design.width()).filter(of_order).collect();
        let is_square = |k: &usize| design.terms()[*k].contains(&2);
        match at {
            1 => kinds.push(("first order".to_string(), terms)),
            2 => {
                let (squares, products): (Vec<usize>, Vec<usize>) = terms.into_iter().partition(is_square);
                kinds.push(("interactions".to_string(), products));
                kinds.push(("squares".to_string(), squares));
            }
            _ => kinds.push((format!("order {at}"), terms)),
        }
    }
    Some((constant, kinds))
}

/// The part of the report that needs no rows, from the triangle of all candidates. `chosen`: the candidates that are the terms of `design`; `logs`:
/// the sum of the logarithms of the weights, whose mean is 1.
pub(crate) fn of_triangle(design: &Design, triangle: &Triangle, chosen: &[usize], logs: f64) -> Option<Report> {
    let (constant, kinds) = kinds(design)?;
    let (rows, width) = (triangle.rows(), design.width());
    let freedom = rows.checked_sub(width).filter(|freedom| *freedom > 0)?;
    let mut growing = Growing::new(triangle);
    growing.add(chosen[constant]).ok()?;
    let mut left = vec![growing.residual_square()];
    let mut entered = vec![constant];
    let mut spreads = vec![None];
    for (_, terms) in &kinds {
        entered.extend(terms);
    }
    // Before other columns are added: about the mean.
    spreads.extend(entered[1..].iter().map(|term| Some(growing.own_square(chosen[*term]))));
    for (_, terms) in &kinds {
        for term in terms {
            growing.add(chosen[*term]).ok()?;
        }
        left.push(growing.residual_square());
    }
    let residual = growing.residual_square();
    let mean_square = residual / Dd::from(freedom as f64);
    let criteria = Criteria::of(logs, rows, residual, width);
    // With a zero residual, the criteria are not defined.
    if !(criteria.aic.is_finite() && residual > Dd::ZERO) {
        return None;
    }
    let mut sequential: Vec<Line> = Vec::new();
    for (k, (name, terms)) in kinds.iter().enumerate().filter(|(_, (_, terms))| !terms.is_empty()) {
        sequential.push(line(name, terms.len(), left[k] - left[k + 1], Some((mean_square, freedom))));
    }
    sequential.push(line("residual", freedom, residual, None));
    let found = coefficients(&growing.coefficients(), &growing, mean_square, freedom, |place| spreads[place]);
    let term = |k: usize| {
        let place = entered.iter().position(|other| *other == k).expect("every term entered");
        TermReport { interval: found[place].interval, vif: found[place].vif, partial_ss: found[place].partial_ss }
    };
    Some(Report {
        terms: (0..width).map(term).collect(),
        aic: criteria.aic,
        aicc: criteria.aicc,
        bic: criteria.bic,
        durbin_watson: None,
        influential: Vec::new(),
        box_cox: None,
        sequential,
    })
}

/// The statistic of all rows, or of the pairs of neighbours beside gaps.
fn durbin_watson(analysis: &Analysis, weights: &[f64], sequence: &Sequence) -> Option<f64> {
    if !sequence.has_gaps() {
        return Some(analysis.durbin_watson);
    }
    let root = |k: usize| weights.get(k).map_or(1.0, |weight| weight.sqrt());
    let errors: Vec<f64> = analysis.rows.iter().enumerate().map(|(k, row)| row.residual * root(k)).collect();
    let seconds: Vec<usize> = (1..errors.len()).filter(|k| sequence.places[*k] == sequence.places[*k - 1] + 1).collect();
    let neighbours: f64 = seconds.iter().map(|k| (errors[*k] - errors[*k - 1]).powi(2)).sum();
    let square: f64 = errors.iter().map(|error| error * error).sum();
    Some(neighbours / seconds.len() as f64 * (errors.len() - 1) as f64 / square)
}

//! The next experiment: the record that separates causes which the present records cannot separate, or that covers the region of an unexplained
//! error.
//!
//! In: the fitted plant, its rivals, the library of excitations. Out: a [`NextExperiment`]. Two plants that agree on the present records are
//! simulated along each excitation. What counts is the difference that remains after the wrong plant has adapted: its parameters as far as the
//! present records allow (their information matrix), and the initial state of the new record freely. All this is to first order about the fits, in
//! units of the noise. The true plant is not used.

use super::excitations::{self, Excitation, Limits};
use super::levenberg::{self, Fit};
use super::model::{Model, Place};
use super::quantities;
use super::whitened_residuals::{Column, Prepared, Simulated, WhitenedResiduals};
use crate::engine::columns::dot;
use crate::engine::normal::{Normal, symmetric};
use crate::engine::verdict::Verdict;
use rsm_core::order;
use rsm_sim::equation_plant::{self, SiteKind, SiteSignal};
use rsm_sim::kind::PlantKind;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;

/// The largest number of rivals that are examined. The next diagnosis handles the others.
const MOST_PAIRS: usize = 4;

/// The squared difference D of two fits has variance 4 D, if D is the expected value. Two standard deviations are required, so that the wrong cause
/// is rejected in 97 of 100 records.
const SIGMAS: f64 = 2.0;

/// Each operating quantity is divided into this many cells for an unexplained error. Quarters hold enough rows for a mean.
const CELLS: usize = 4;

/// A rival that the records do not distinguish from a cause.
#[derive(Debug, Clone)]
pub struct Alias {
    /// The accepted cause.
    pub cause: String,
    /// The rival.
    pub rival: String,
    /// The plant with the rival in place of the cause, fitted to the same records.
    pub model: Model,
    /// The difference of the fits, in squared standard deviations of the noise, above which the worse one is rejected.
    pub limit: f64,
}

/// The difference of two plants along a record.
#[derive(Debug, Clone, PartialEq)]
pub struct Difference {
    /// The accepted cause.
    pub cause: String,
    /// Its rival.
    pub rival: String,
    /// The squared difference that remains, in units of the noise: how much worse the wrong plant fits.
    pub squared: f64,
    /// The root mean square of the difference over the readings, in multiples of the noise.
    pub times_noise: f64,
    /// Whether that is enough to reject the wrong plant.
    pub enough: bool,
}

/// The purpose of a next experiment.
#[derive(Debug, Clone)]
pub enum NextExperiment {
    /// This record distinguishes causes.
    Distinguishes {
        /// The record.
        excitation: Excitation,
        /// The result for each pair; the strongest rival of the strongest cause comes first.
        differences: Vec<Difference>,
    },
    /// No record of the library distinguishes these causes. Holds the best record's result for each pair.
    NotDistinguishable {
        /// The pairs with their largest differences.
        differences: Vec<Difference>,
        /// The number of records that were tried.
        tried: usize,
    },
    /// Most rows of this record are where the unexplained error is.
    CoversError {
        /// The record.
        excitation: Excitation,
        /// The expected mean squared error above the noise in it, in units of the noise variance.
        expected: f64,
        /// The same in the present records.
        present: f64,
    },
}

/// Chooses the next experiment. `None` if there are no rivals and no unexplained error, or if no record of the library helps.
#[must_use]
pub fn next(
    whitened: &WhitenedResiduals,
    fit: &Fit,
    aliases: &[Alias],
    verdict: Verdict,
    progress: &(dyn Fn(&str) + Sync),
) -> Option<NextExperiment> {
    if aliases.is_empty() && verdict != Verdict::Unexplained {
        return None;
    }
    progress("looking for the next experiment");
    let limits = Limits::of(whitened, fit)?;
    if aliases.is_empty() {
        covering_record(whitened, fit, &limits)
    } else {
        distinguishing_record(whitened, fit, aliases, &limits)
    }
}

fn distinguishing_record(
    whitened: &WhitenedResiduals,
    fit: &Fit,
    aliases: &[Alias],
    limits: &Limits,
) -> Option<NextExperiment> {
    let rivals: Vec<(&Alias, Fit)> = aliases
        .iter()
        .take(MOST_PAIRS)
        .filter_map(|it| Some((it, levenberg::linearised(whitened, it.model.clone())?)))
        .collect();
    let mut accepted: Vec<&PlantFile> = vec![&fit.model.file];
    accepted.extend(rivals.iter().map(|(alias, _)| &alias.model.file));
    let library = excitations::library(&accepted, limits);
    let rows: Vec<Trial> = library.iter().filter_map(|it| Trial::new(whitened, fit, it)).collect();
    let mut best: Vec<Difference> = Vec::new();
    let mut first: Option<usize> = None;
    for (alias, rival) in &rivals {
        let found = rows.iter().map(|trial| trial.difference_without_adaptation(rival));
        let mut order: Vec<(usize, f64)> =
            found.enumerate().filter_map(|(place, plain)| Some((place, plain? / rows[place].readings()))).collect();
        order::descending(&mut order, |it| it.1);
        let mut most: Option<(usize, Difference)> = None;
        for (place, bound) in order {
            // Adapting only reduces a difference, so the remaining records cannot exceed the difference already found.
            if most
                .as_ref()
                .is_some_and(|(_, difference)| difference.enough && difference.times_noise * difference.times_noise >= bound)
            {
                break;
            }
            let Some(difference) = rows[place].difference(fit, rival, alias) else { continue };
            let better = |(_, before): &(usize, Difference)| {
                (difference.enough, difference.times_noise) > (before.enough, before.times_noise)
            };
            if most.as_ref().is_none_or(better) {
                most = Some((place, difference));
            }
        }
        let Some((place, difference)) = most else { continue };
        if difference.enough {
            first = Some(place);
            break;
        }
        best.push(difference);
    }
    let Some(place) = first else {
        return (!best.is_empty())
            .then_some(NextExperiment::NotDistinguishable { differences: by_name(best), tried: library.len() });
    };
    let differences = rivals.iter().filter_map(|(alias, rival)| rows[place].difference(fit, rival, alias)).collect();
    Some(NextExperiment::Distinguishes { excitation: rows[place].excitation.clone(), differences: by_name(differences) })
}

/// One line for each pair of names. A rival with and without its optional parameters is two plants; the one with the smaller difference counts.
fn by_name(differences: Vec<Difference>) -> Vec<Difference> {
    let mut list: Vec<Difference> = Vec::new();
    for it in differences {
        match list.iter_mut().find(|there| there.cause == it.cause && there.rival == it.rival) {
            Some(there) if it.squared < there.squared => *there = it,
            Some(_) => {}
            None => list.push(it),
        }
    }
    list
}

/// An excitation with the accepted plant's outputs along it.
struct Trial<'a> {
    excitation: &'a Excitation,
    whitened: WhitenedResiduals,
}

impl<'a> Trial<'a> {
    fn new(present: &WhitenedResiduals, fit: &Fit, excitation: &'a Excitation) -> Option<Self> {
        let mut prepared = Prepared::new(excitation.record.clone(), fit.model.file.kind.outputs().len());
        // The new record has the same columns as the present records.
        let held: Vec<bool> =
            prepared.outputs.iter().map(|output| present.records.iter().any(|it| it.outputs.contains(output))).collect();
        let mut k = 0;
        prepared.used.retain(|_| {
            k += 1;
            held[k - 1]
        });
        k = 0;
        prepared.outputs.retain(|_| {
            k += 1;
            held[k - 1]
        });
        (!prepared.outputs.is_empty()).then_some(Trial { excitation, whitened: present.with_records(vec![prepared]) })
    }

    fn record(&self) -> &Record {
        &self.whitened.records[0].record
    }

    fn readings(&self) -> f64 {
        self.whitened.rows().max(1) as f64
    }

    /// A plant along the record, with the initial state from the first row.
    fn model(&self, of: &Fit) -> Model {
        let mut model = of.model.clone();
        model.file.initial.clear();
        model.take_starts(&[self.record()], self.whitened.floors.map(|floor| floor.sd));
        model
    }

    /// The squared difference between a plant and the accepted one, without adaptation.
    fn difference_without_adaptation(&self, rival: &Fit) -> Option<f64> {
        let simulated = self.whitened.run(&self.model(rival))?;
        let difference = self.whitened.residual(&simulated);
        Some(dot(&difference, &difference))
    }

    /// The remaining difference. Either of the two may be wrong and adapt; the smaller result counts.
    fn difference(&self, fit: &Fit, rival: &Fit, alias: &Alias) -> Option<Difference> {
        let [of_fit, of_rival] = [fit, rival].map(|it| self.whitened.run(&self.model(it)));
        let (of_fit, of_rival) = (of_fit?, of_rival?);
        let squared = f64::min(
            self.remaining_difference(rival, &of_rival, &of_fit)?,
            self.remaining_difference(fit, &of_fit, &of_rival)?,
        );
        Some(Difference {
            cause: alias.cause.clone(),
            rival: alias.rival.clone(),
            squared,
            times_noise: (squared / self.readings()).sqrt(),
            enough: squared - SIGMAS * 2.0 * squared.sqrt() > alias.limit,
        })
    }

    /// The squared difference between `truth` and a plant that adapts: d.d - p.(F + J^T J)^-1 p with p = J^T d. J is the plant's derivative along
    /// this record, F its information matrix from the present records, priors included.
    fn remaining_difference(&self, adapts: &Fit, its: &[Simulated], truth: &[Simulated]) -> Option<f64> {
        let model = self.model(adapts);
        let starts: Vec<usize> =
            (0..model.unknowns.len()).filter(|k| matches!(model.unknowns[*k].place, Place::Start { .. })).collect();
        // The model of the new record has the same unknowns of the plant in the same order, followed by its own initial states.
        let here = |k: usize| adapts.model.unknowns[..k].iter().filter(|it| !matches!(it.place, Place::Start { .. })).count();
        let of_plant: Vec<Option<usize>> = adapts
            .free
            .iter()
            .map(|&k| (!matches!(adapts.model.unknowns[k].place, Place::Start { .. })).then(|| here(k)))
            .collect();
        let chosen: Vec<usize> = of_plant.iter().flatten().copied().chain(starts.iter().copied()).collect();
        let columns = self.whitened.derivatives(&model, its, &chosen)?;
        let difference = self.whitened.changes(its, truth, 1.0);
        let mut columns = columns.into_iter();
        let mut all: Vec<Option<Column>> = of_plant.iter().map(|it| if it.is_some() { columns.next() } else { None }).collect();
        all.extend(columns.map(Some));
        let (known, n) = (adapts.free.len(), all.len());
        let present = adapts.matrix();
        let matrix = symmetric(n, |i, j| {
            let before = if i < known && j < known { present[i * known + j] } else { 0.0 };
            before + all[i].as_ref().zip(all[j].as_ref()).map_or(0.0, |(a, b)| a.dot(b))
        });
        let pull: Vec<f64> = all.iter().map(|it| it.as_ref().map_or(0.0, |column| column.dot_stack(&difference))).collect();
        let solved = Normal::new(&matrix, n, 0.0).solve(&pull);
        Some((dot(&difference, &difference) - dot(&pull, &solved)).max(0.0))
    }
}

/// The record with the largest expected error, from the present residual at each operating point.
fn covering_record(whitened: &WhitenedResiduals, fit: &Fit, limits: &Limits) -> Option<NextExperiment> {
    let kind = fit.model.file.kind;
    let signals = quantities::site_signals(whitened, fit);
    let each = whitened.records.iter().zip(&fit.simulated).zip(&signals);
    let points: Vec<Vec<[f64; 2]>> =
        each.map(|((it, simulated), signals)| operating_points(kind, &it.record, simulated, signals)).collect();
    let edges: Vec<Vec<f64>> = (0..2)
        .map(|axis| {
            let mut all: Vec<f64> = points.iter().flatten().map(|point| point[axis]).collect();
            order::sort(&mut all);
            (1..CELLS).filter_map(|k| all.get(k * all.len() / CELLS).copied()).collect()
        })
        .collect();
    let cell = |point: &[f64; 2]| {
        let place = |axis: usize| edges[axis].iter().filter(|edge| point[axis] > **edge).count();
        CELLS * place(0) + place(1)
    };
    // The mean squared residual above the noise in each cell.
    let mut sums = [(0.0, 0.0); CELLS * CELLS];
    for ((prepared, simulated), points) in whitened.records.iter().zip(&fit.simulated).zip(&points) {
        for (k, values) in simulated.iter().enumerate() {
            let sd = whitened.floors[prepared.outputs[k]].sd;
            for (row, (measured, value)) in prepared.measured(k).iter().zip(values).enumerate() {
                if prepared.used[k][row] {
                    let sum = &mut sums[cell(&points[row])];
                    *sum = (sum.0 + ((measured - value) / sd).powi(2), sum.1 + 1.0);
                }
            }
        }
    }
    // A cell without rows gets the mean of the cells in its row and its column.
    let of = |cells: &mut dyn Iterator<Item = usize>| {
        let (sum, count) = cells.fold((0.0, 0.0), |sum, k| (sum.0 + sums[k].0, sum.1 + sums[k].1));
        if count > 0.0 { Some((sum / count - 1.0).max(0.0)) } else { None }
    };
    let beyond: Vec<f64> = (0..CELLS * CELLS)
        .map(|k| {
            let (first, second) = (k / CELLS, k % CELLS);
            let beside = || {
                let row = of(&mut (0..CELLS).map(|it| CELLS * first + it)).unwrap_or(0.0);
                let column = of(&mut (0..CELLS).map(|it| CELLS * it + second)).unwrap_or(0.0);
                0.5 * (row + column)
            };
            of(&mut std::iter::once(k)).unwrap_or_else(beside)
        })
        .collect();
    let expected = |points: &[[f64; 2]]| points.iter().map(|it| beyond[cell(it)]).sum::<f64>() / points.len().max(1) as f64;
    let all: Vec<[f64; 2]> = points.concat();
    let present = expected(&all);
    let library = excitations::library(&[&fit.model.file], limits);
    let held: Vec<usize> = (0..kind.outputs().len()).collect();
    let best = library
        .into_iter()
        .filter_map(|it| {
            let outputs: Vec<usize> = held.iter().copied().filter(|k| it.record.measured[*k].is_some()).collect();
            let simulated = excitations::outputs_of(&it.record, &outputs)?;
            let bare = PlantFile { initial: Vec::new(), ..fit.model.file.clone() };
            let signals = equation_plant::site_signals(&bare, &it.record)?;
            let expected = expected(&operating_points(kind, &it.record, &simulated, &signals));
            Some((it, expected))
        })
        .max_by(|a, b| a.1.total_cmp(&b.1))?;
    (best.1 > present).then_some(NextExperiment::CoversError { excitation: best.0, expected: best.1, present })
}

/// Two quantities that give the operating point of a plant: the speed of its first body, or its first output; then its current, its position or its
/// first input, whichever varies.
fn operating_points(kind: PlantKind, record: &Record, simulated: &Simulated, signals: &[SiteSignal]) -> Vec<[f64; 2]> {
    let is_body = |it: &&SiteSignal| matches!(it.kind, SiteKind::Rotation | SiteKind::Translation);
    let body = signals.iter().filter(is_body).find(|it| it.role == "speed");
    let varies = |values: &Vec<f64>| values.windows(2).any(|pair| pair[0] != pair[1]);
    let first = body.map(SiteSignal::length).or_else(|| simulated.first().cloned());
    let current = signals.iter().find(|it| it.kind == SiteKind::Winding && it.role == "currents").map(SiteSignal::length);
    let position = body.filter(|it| it.kind == SiteKind::Translation);
    let position = position.and_then(|body| signals.iter().find(|it| it.at == body.at && it.role == "position"));
    let inputs = record.inputs.iter().take(kind.inputs().len()).cloned();
    let second = current.into_iter().chain(position.map(SiteSignal::length)).chain(inputs).find(varies);
    let at = |values: &Option<Vec<f64>>, row: usize| values.as_ref().and_then(|it| it.get(row)).copied().unwrap_or(0.0);
    (0..record.rows()).map(|row| [at(&first, row), at(&second, row)]).collect()
}

//! Chooses the set of causes that explains a sample best, for given outlying runs and noise.
//!
//! In: a sample, hypotheses, thresholds, the state of [`super::explain`]. Out: hypotheses. The result of the search is checked again: each cause must
//! exceed its threshold within the set, shapes that equal a plain shift are dropped, changes between runs are placed at their row, and a missing
//! order is reported by its terms. Never changes outlying runs or the noise.

use super::explained::{Explained, solved};
use super::hypotheses::{Hypothesis, HypothesisKind, LEAST_SIDE, MOST_CHANGES, Part, step};
use super::null::Thresholds;
use super::sample::Sample;
use super::search::{Candidate, Search};
use super::whitening::Space;
use crate::engine::columns::dot;
use crate::engine::significance::{ln_p_of_squares, ln_upper_f};
use crate::engine::work::Work;
use rsm_core::order;

/// The contribution of one cause in a set.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Contribution {
    /// The decrease of 2 ln(likelihood) without it.
    pub gain: f64,
    /// ln of the probability that chance gives as much.
    pub ln_p: f64,
}

/// The best set of causes for the given outliers and noise.
///
/// If the limit of `work` is reached, the best set so far is returned.
pub(super) fn causes(
    sample: &Sample,
    hypotheses: &[Hypothesis],
    thresholds: &Thresholds,
    now: &Explained,
    work: &Work<'_>,
) -> Vec<Hypothesis> {
    let space = now.space(sample);
    let residual = space.in_whitened_space(&sample.residual());
    let mut pool: Vec<Hypothesis> = hypotheses.to_vec();
    let mut chosen = Vec::new();
    let mut finer = false;
    let mut offered = candidates(&pool, thresholds, &space);
    let mut search = counted(&offered, &residual, work);
    // Each round removes shapes, and the second kind of round occurs once, so the number of rounds is finite. More than a few were never observed.
    for _ in 0..MOST_SEARCHES {
        let mut found = search.best(work);
        // The costs are for a single cause. In the set, each cause must exceed its threshold.
        loop {
            let worths: Vec<Contribution> =
                found.set.iter().map(|member| contribution(&search, &offered, &found.set, *member)).collect();
            let weakest = (0..worths.len()).max_by(|a, b| worths[*a].ln_p.total_cmp(&worths[*b].ln_p));
            match weakest {
                Some(weakest) if worths[weakest].ln_p > thresholds.ln_p_mean => {
                    found.set.remove(weakest);
                }
                _ => break,
            }
        }
        chosen = found.set.iter().map(|member| pool[*member].clone()).collect::<Vec<_>>();
        if let Some(member) =
            found.set.iter().find(|member| is_shift(&pool, &offered, &search, &found.set, **member, thresholds))
        {
            let gone = &pool[*member];
            let places: Vec<usize> = (0..pool.len()).filter(|place| !is_nearer_a_shift(&pool[*place], gone)).collect();
            pool = places.iter().map(|place| pool[*place].clone()).collect();
            offered = places.iter().map(|place| offered[*place].clone()).collect();
            search = search.among(&places);
            continue;
        }
        // A change between runs is searched on a grid first, then at every row near the best place.
        match finer_steps(sample, &chosen, &pool) {
            Some(places) if !finer => {
                pool.extend(places);
                offered = candidates(&pool, thresholds, &space);
                search = counted(&offered, &residual, work);
            }
            _ => break,
        }
        finer = true;
    }
    let singled = significant_terms(sample, chosen.clone(), hypotheses, &space);
    if kinds(&singled) == kinds(&chosen) {
        return chosen;
    }
    // A complete order was the best single choice; its separate terms may be better.
    let pool: Vec<Hypothesis> =
        singled.iter().chain(pool.iter().filter(|it| !matches!(it.kind, HypothesisKind::Order(_)))).cloned().collect();
    let candidates = candidates(&pool, thresholds, &space);
    let search = counted(&candidates, &residual, work);
    let (found, singles) = (search.best(work), (0..singled.len()).collect::<Vec<_>>());
    let is_worth = |member: &usize| contribution(&search, &candidates, &found.set, *member).ln_p <= thresholds.ln_p_mean;
    if found.score < search.score(&singles) && found.set.iter().all(is_worth) {
        found.set.iter().map(|member| pool[*member].clone()).collect()
    } else {
        singled
    }
}

fn counted(candidates: &[Candidate], residual: &[f64], work: &Work<'_>) -> Search {
    work.add(Search::multiplications(candidates, residual.len()));
    Search::new(candidates, residual)
}

fn kinds(set: &[Hypothesis]) -> Vec<&HypothesisKind> {
    set.iter().map(|it| &it.kind).collect()
}

/// Whether a shape is removed together with one that was only a shift: the shape itself, and for changes in the run order all shapes nearer to a
/// shift.
fn is_nearer_a_shift(it: &Hypothesis, gone: &Hypothesis) -> bool {
    let likeness = |it: &Hypothesis| it.columns[0].iter().sum::<f64>().abs() / dot(&it.columns[0], &it.columns[0]).sqrt();
    match (&it.kind, &gone.kind) {
        (HypothesisKind::Step(_), HypothesisKind::Step(_)) => likeness(it) >= likeness(gone),
        (kind, other) => kind == other && it.columns == gone.columns,
    }
}

/// The largest number of rounds of [`causes`].
const MOST_SEARCHES: usize = 12;

/// The value of the missing input for which the file was made is at most this many half ranges of the data away from their middle.
const FURTHEST_REFERENCE: f64 = 3.0;

/// Whether a shape with its own shift is only that shift, which is a bias of the response. Two kinds of shape are tested. Blocks that all have an
/// offset, and an input with an unknown value in the file, must exceed the threshold without their shift, and that value must be plausible. A change
/// or a drift must exceed the threshold when a bias is present; otherwise a change three runs before the end would fit better than a bias, only by
/// the choice of its place.
fn is_shift(
    pool: &[Hypothesis],
    candidates: &[Candidate],
    search: &Search,
    set: &[usize],
    member: usize,
    thresholds: &Thresholds,
) -> bool {
    let width = candidates[member].columns.len();
    let Some(bias) = pool.iter().position(|it| it.kind == HypothesisKind::ResponseBias) else { return false };
    if set.contains(&bias) {
        return false;
    }
    let instead: Vec<usize> = set.iter().map(|other| if *other == member { bias } else { *other }).collect();
    let beside: Vec<usize> = set.iter().copied().chain([bias]).collect();
    let (with, more) = match pool[member].kind {
        HypothesisKind::Block(_) if pool[member].reference.is_none() => (set, width - 1),
        HypothesisKind::Input(_, Part::Linear | Part::Square) if width == 2 => (set, 1),
        HypothesisKind::Step(_) | HypothesisKind::Drift(_) => (beside.as_slice(), 1),
        _ => return false,
    };
    let rows = candidates[member].columns[0].len();
    let unknowns: usize = with.iter().map(|it| candidates[*it].columns.len()).sum();
    let freedom = rows.saturating_sub(unknowns).max(1) as f64;
    let left = search.square(with);
    let ln_p = ln_p_of_squares(search.square(&instead) - left, more as f64, left, freedom);
    let is_worth_nothing = ln_p > thresholds.ln_p_mean - pool[member].prior / 2.0;
    let is_far = || {
        let solved = search.coefficients(set, member);
        (solved[1] / solved[0]).abs() > FURTHEST_REFERENCE
    };
    is_worth_nothing || matches!(pool[member].kind, HypothesisKind::Input(_, Part::Linear)) && is_far()
}

/// Replaces a complete missing order by those of its terms that are significant (Holm 1979, at 5 %), if the other terms together are not (F test, 5
/// %). The order itself has already exceeded its threshold.
fn significant_terms(sample: &Sample, chosen: Vec<Hypothesis>, hypotheses: &[Hypothesis], space: &Space) -> Vec<Hypothesis> {
    const LEVEL: f64 = 0.05;
    let Some(place) = chosen.iter().position(|it| matches!(it.kind, HypothesisKind::Order(_))) else { return chosen };
    let mut set = chosen.clone();
    let order = set.remove(place);
    set.push(order.clone());
    let whole = solved(sample, &set, space);
    let freedom = space.rows().saturating_sub(whole.rank).max(1) as f64;
    let square = dot(&whole.residual, &whole.residual);
    let first = whole.coefficients.len() - order.columns.len();
    let ln_p = |k: usize| {
        let variance = square / freedom * whole.covariance[first + k][first + k];
        if variance > 0.0 { ln_upper_f(whole.coefficients[first + k].powi(2) / variance, 1.0, freedom) } else { 0.0 }
    };
    let mut by_p: Vec<usize> = (0..order.columns.len()).collect();
    order::ascending(&mut by_p, |it| ln_p(*it));
    let count = by_p.len();
    let standing = by_p.iter().enumerate().take_while(|(rank, k)| ln_p(**k) < (LEVEL / (count - rank) as f64).ln());
    let powers: Vec<&Vec<u32>> =
        standing.filter_map(|(_, k)| order.in_file[*k].first()).map(|(_, monomial)| &monomial.powers).collect();
    set.pop();
    for powers in &powers {
        set.extend(hypotheses.iter().find(|it| it.kind == HypothesisKind::Term((*powers).clone())).cloned());
    }
    let part = solved(sample, &set, space);
    let others = whole.rank.saturating_sub(part.rank) as f64;
    let taken = dot(&part.residual, &part.residual) - square;
    let nothing_left = others == 0.0 || ln_p_of_squares(taken, others, square, freedom) > LEVEL.ln();
    if powers.is_empty() || !nothing_left { chosen } else { set }
}

/// Changes at the rows between the places of the grid, near the chosen ones.
fn finer_steps(sample: &Sample, chosen: &[Hypothesis], pool: &[Hypothesis]) -> Option<Vec<Hypothesis>> {
    let rows = sample.rows();
    let reach = rows / MOST_CHANGES + 1;
    if rows <= MOST_CHANGES + 2 * LEAST_SIDE {
        return None;
    }
    let known: Vec<usize> =
        pool.iter().filter_map(|it| if let HypothesisKind::Step(at) = it.kind { Some(at) } else { None }).collect();
    let mut finer = Vec::new();
    for it in chosen {
        let HypothesisKind::Step(at) = it.kind else { continue };
        for place in at.saturating_sub(reach).max(LEAST_SIDE)..=(at + reach).min(rows - LEAST_SIDE) {
            if !known.contains(&place) {
                for before in [0.0, -1.0] {
                    // The group is that of the grid place, so that two near changes are not both chosen.
                    finer.push(Hypothesis {
                        kind: HypothesisKind::Step(place),
                        columns: vec![step(rows, place, before)],
                        ..it.clone()
                    });
                }
            }
        }
    }
    (!finer.is_empty()).then_some(finer)
}

/// The hypotheses in the form that the search uses.
pub(super) fn candidates(hypotheses: &[Hypothesis], thresholds: &Thresholds, space: &Space) -> Vec<Candidate> {
    let widest = hypotheses.iter().map(|it| it.columns.len()).max().unwrap_or(0);
    let costs: Vec<f64> =
        (0..=widest).map(|width| if width == 0 { 0.0 } else { thresholds.cost(width, space.rows()) }).collect();
    let of_one = |it: &Hypothesis| Candidate {
        columns: it.columns.iter().map(|column| space.in_whitened_space(column)).collect(),
        group: it.group,
        change: if let HypothesisKind::Step(at) = it.kind { Some(at) } else { None },
        cost: costs[it.columns.len()] + it.prior,
    };
    hypotheses.iter().map(of_one).collect()
}

/// The contribution of a member of a set.
pub(super) fn contribution(search: &Search, candidates: &[Candidate], set: &[usize], member: usize) -> Contribution {
    let rest: Vec<usize> = set.iter().copied().filter(|other| *other != member).collect();
    let columns = |set: &[usize]| -> usize { set.iter().map(|it| candidates[*it].columns.len()).sum() };
    let (without, with) = (search.square(&rest), search.square(set));
    let rows = candidates.first().and_then(|it| it.columns.first()).map_or(0, Vec::len);
    let width = (columns(set) - columns(&rest)) as f64;
    let freedom = rows.saturating_sub(columns(set)).max(1) as f64;
    Contribution { gain: rows as f64 * (without / with).ln(), ln_p: ln_p_of_squares(without - with, width, with, freedom) }
}

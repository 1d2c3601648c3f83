//! The set of causes that explains a sample best, for given outlying runs and noise.
//!
//! In: a sample, hypotheses, thresholds, the state of [`super::explain`]. Out: hypotheses. The result of the search is checked again: each cause must exceed its threshold within the set, shapes that equal a plain
//! shift are dropped, changes between runs are placed at their row, and a missing order is reported by its terms. Never changes outlying runs or the noise.

use super::explained::{Explained, solved};
use super::hypotheses::{Claim, Hypothesis, LEAST_SIDE, MOST_CHANGES, Part, step};
use super::null::Thresholds;
use super::sample::Sample;
use super::search::{Candidate, Search};
use super::whitening::Space;
use crate::engine::columns::dot;
use crate::engine::significance::{ln_p_of_squares, ln_upper_f};
use crate::engine::work::Work;

/// What one cause of a set is worth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Worth {
    /// By how much 2 ln of the likelihood falls without it.
    pub gain: f64,
    /// ln of the probability of as much by chance.
    pub ln_p: f64,
}

/// The best set of causes, outliers and noise as they are.
///
/// `work` is a limit: where it is met, the best set so far is the answer.
pub(super) fn causes(
    sample: &Sample,
    hypotheses: &[Hypothesis],
    thresholds: &Thresholds,
    now: &Explained,
    work: &Work<'_>,
) -> Vec<Hypothesis> {
    let space = now.space(sample);
    let residual = space.carried(&sample.residual());
    let mut pool: Vec<Hypothesis> = hypotheses.to_vec();
    let mut chosen = Vec::new();
    let mut finer = false;
    let mut offered = candidates(&pool, thresholds, &space);
    let mut search = counted(&offered, &residual, work);
    // Each turn takes shapes away, and the second kind of turn comes once; there are finitely many shapes, and more than a few in one search there never were.
    for _ in 0..MOST_SEARCHES {
        let mut found = search.best(work);
        // Costs are of one cause alone; in the set each must be worth its threshold.
        loop {
            let worths: Vec<Worth> = found.set.iter().map(|member| worth(&search, &offered, &found.set, *member)).collect();
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
        // A change between runs is looked for on a grid first; then at every row about the best place.
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
    let singled = singled_out(sample, chosen.clone(), hypotheses, &space);
    if claims(&singled) == claims(&chosen) {
        return chosen;
    }
    // A whole order was the best of all sets, its single terms need not be.
    let pool: Vec<Hypothesis> =
        singled.iter().chain(pool.iter().filter(|it| !matches!(it.claim, Claim::Order(_)))).cloned().collect();
    let candidates = candidates(&pool, thresholds, &space);
    let search = counted(&candidates, &residual, work);
    let (found, singles) = (search.best(work), (0..singled.len()).collect::<Vec<_>>());
    let is_worth = |member: &usize| worth(&search, &candidates, &found.set, *member).ln_p <= thresholds.ln_p_mean;
    if found.score < search.score(&singles) && found.set.iter().all(is_worth) {
        found.set.iter().map(|member| pool[*member].clone()).collect()
    } else {
        singled
    }
}

fn counted(candidates: &[Candidate], residual: &[f64], work: &Work<'_>) -> Search {
    work.takes(Search::multiplications(candidates, residual.len()));
    Search::new(candidates, residual)
}

fn claims(set: &[Hypothesis]) -> Vec<&Claim> {
    set.iter().map(|it| &it.claim).collect()
}

/// Whether a shape goes with one that was nothing but a shift: itself, and of changes in the run order all that are nearer to a shift.
fn is_nearer_a_shift(it: &Hypothesis, gone: &Hypothesis) -> bool {
    let likeness = |it: &Hypothesis| it.columns[0].iter().sum::<f64>().abs() / dot(&it.columns[0], &it.columns[0]).sqrt();
    match (&it.claim, &gone.claim) {
        (Claim::Step(_), Claim::Step(_)) => likeness(it) >= likeness(gone),
        (claim, other) => claim == other && it.columns == gone.columns,
    }
}

/// See [`causes`].
const MOST_SEARCHES: usize = 12;

/// Half ranges of the data from their middle: the file was made at a value of the missing input that is no further from the data than these are wide.
const FURTHEST_REFERENCE: f64 = 3.0;

/// Whether a shape with a shift of its own is nothing but that shift. The shift alone is a bias of the response. Two kinds: blocks that all have an offset, or an input whose value in the file nobody knows, less their
/// shift must be worth a cause, and that value must be where it can have been; a change or a drift must be worth one beside a bias (else a change three runs before the end is a better bias by choice of its place).
fn is_shift(
    pool: &[Hypothesis],
    candidates: &[Candidate],
    search: &Search,
    set: &[usize],
    member: usize,
    thresholds: &Thresholds,
) -> bool {
    let width = candidates[member].columns.len();
    let Some(bias) = pool.iter().position(|it| it.claim == Claim::ResponseBias) else { return false };
    if set.contains(&bias) {
        return false;
    }
    let instead: Vec<usize> = set.iter().map(|other| if *other == member { bias } else { *other }).collect();
    let beside: Vec<usize> = set.iter().copied().chain([bias]).collect();
    let (with, more) = match pool[member].claim {
        Claim::Block(_) if pool[member].reference.is_none() => (set, width - 1),
        Claim::Input(_, Part::Linear | Part::Square) if width == 2 => (set, 1),
        Claim::Step(_) | Claim::Drift(_) => (beside.as_slice(), 1),
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
    is_worth_nothing || matches!(pool[member].claim, Claim::Input(_, Part::Linear)) && is_far()
}

/// A whole order that is missing, as those of its terms that stand out within it (Holm 1979, at 5 %), where the others are together nothing (F, 5 %): the order has passed its threshold already.
fn singled_out(sample: &Sample, chosen: Vec<Hypothesis>, hypotheses: &[Hypothesis], space: &Space) -> Vec<Hypothesis> {
    const LEVEL: f64 = 0.05;
    let Some(place) = chosen.iter().position(|it| matches!(it.claim, Claim::Order(_))) else { return chosen };
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
    by_p.sort_by(|a, b| ln_p(*a).total_cmp(&ln_p(*b)));
    let count = by_p.len();
    let standing = by_p.iter().enumerate().take_while(|(rank, k)| ln_p(**k) < (LEVEL / (count - rank) as f64).ln());
    let powers: Vec<&Vec<u32>> =
        standing.filter_map(|(_, k)| order.in_file[*k].first()).map(|(_, monomial)| &monomial.powers).collect();
    set.pop();
    for powers in &powers {
        set.extend(hypotheses.iter().find(|it| it.claim == Claim::Term((*powers).clone())).cloned());
    }
    let part = solved(sample, &set, space);
    let others = whole.rank.saturating_sub(part.rank) as f64;
    let taken = dot(&part.residual, &part.residual) - square;
    let nothing_left = others == 0.0 || ln_p_of_squares(taken, others, square, freedom) > LEVEL.ln();
    if powers.is_empty() || !nothing_left { chosen } else { set }
}

/// Changes at the rows between the places of the grid, about those that were chosen.
fn finer_steps(sample: &Sample, chosen: &[Hypothesis], pool: &[Hypothesis]) -> Option<Vec<Hypothesis>> {
    let rows = sample.rows();
    let reach = rows / MOST_CHANGES + 1;
    if rows <= MOST_CHANGES + 2 * LEAST_SIDE {
        return None;
    }
    let known: Vec<usize> = pool.iter().filter_map(|it| if let Claim::Step(at) = it.claim { Some(at) } else { None }).collect();
    let mut finer = Vec::new();
    for it in chosen {
        let Claim::Step(at) = it.claim else { continue };
        for place in at.saturating_sub(reach).max(LEAST_SIDE)..=(at + reach).min(rows - LEAST_SIDE) {
            if !known.contains(&place) {
                for before in [0.0, -1.0] {
                    // The group of the place on the grid: two changes that near are one.
                    finer.push(Hypothesis {
                        claim: Claim::Step(place),
                        columns: vec![step(rows, place, before)],
                        ..it.clone()
                    });
                }
            }
        }
    }
    (!finer.is_empty()).then_some(finer)
}

/// The hypotheses as the search sees them.
pub(super) fn candidates(hypotheses: &[Hypothesis], thresholds: &Thresholds, space: &Space) -> Vec<Candidate> {
    let widest = hypotheses.iter().map(|it| it.columns.len()).max().unwrap_or(0);
    let costs: Vec<f64> =
        (0..=widest).map(|width| if width == 0 { 0.0 } else { thresholds.cost(width, space.rows()) }).collect();
    let of_one = |it: &Hypothesis| Candidate {
        columns: it.columns.iter().map(|column| space.carried(column)).collect(),
        group: it.group,
        change: if let Claim::Step(at) = it.claim { Some(at) } else { None },
        cost: costs[it.columns.len()] + it.prior,
    };
    hypotheses.iter().map(of_one).collect()
}

/// What a member of a set is worth to it.
pub(super) fn worth(search: &Search, candidates: &[Candidate], set: &[usize], member: usize) -> Worth {
    let rest: Vec<usize> = set.iter().copied().filter(|other| *other != member).collect();
    let columns = |set: &[usize]| -> usize { set.iter().map(|it| candidates[*it].columns.len()).sum() };
    let (without, with) = (search.square(&rest), search.square(set));
    let rows = candidates.first().and_then(|it| it.columns.first()).map_or(0, Vec::len);
    let width = (columns(set) - columns(&rest)) as f64;
    let freedom = rows.saturating_sub(columns(set)).max(1) as f64;
    Worth { gain: rows as f64 * (without / with).ln(), ln_p: ln_p_of_squares(without - with, width, with, freedom) }
}

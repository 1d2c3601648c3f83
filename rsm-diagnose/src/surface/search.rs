//! Searches for the set of hypotheses that explains a residual, on the matrix of inner products of their columns.
//!
//! In: hypotheses as columns in the space of [`super::whitening`], the residual there, the cost of each. Out: the set with the smallest n ln(sum of
//! squares) plus costs. A beam search grows several sets at once, so two causes that mask each other are found together. The sets are then improved
//! by removing and exchanging members. The costs decide how much a cause must gain.

use crate::engine::columns::subtract;
use crate::engine::normal::{Normal, symmetric};
use crate::engine::work::Work;
use rsm_core::order;

/// A hypothesis in the form that the search uses.
#[derive(Debug, Clone)]
pub(super) struct Candidate {
    /// Its columns, whitened.
    pub columns: Vec<Vec<f64>>,
    /// Two candidates of one group are never in a set together.
    pub group: usize,
    /// The row of a change in the run order. Two changes are never nearer than [`LEAST_BLOCK`].
    pub change: Option<usize>,
    /// Its cost in the criterion.
    pub cost: f64,
}

/// The number of paths that are followed at once, and of continuations of each. For two causes that mask each other, one must be among the first
/// continuations of the other.
const BEAM: usize = 5;

/// The largest size of a set. One data file cannot distinguish more causes.
const MOST_CAUSES: usize = 9;

/// The smallest number of rows between two changes in the run order. Fewer rows are single outlying runs.
pub(super) const LEAST_BLOCK: usize = 3;

/// A pivot below this share of a column's own square is rounding error.
const DEPENDENT_PIVOT: f64 = 1e-9;

/// The products of all columns and the residual, with no column in the set.
struct GramMatrix {
    width: usize,
    values: Vec<f64>,
}

impl GramMatrix {
    fn at(&self, i: usize, j: usize) -> f64 {
        self.values[i * self.width + j]
    }
}

/// The same with some columns swept in: all others are orthogonal to them. Only the rows of the pivots are kept, as in a Cholesky factor, and an
/// entry is computed when needed. So a sweep costs the width times the number of swept columns, not the square of the width.
#[derive(Clone)]
struct SweptGram<'a> {
    start: &'a GramMatrix,
    /// For each swept column: its row at that time, and the row divided by its pivot.
    swept: Vec<(Vec<f64>, Vec<f64>)>,
    /// The square of each column.
    own: Vec<f64>,
    /// The product of each column with the residual.
    with_residual: Vec<f64>,
}

impl<'a> SweptGram<'a> {
    fn new(start: &'a GramMatrix) -> Self {
        let last = start.width - 1;
        let own = (0..start.width).map(|k| start.at(k, k)).collect();
        let with_residual = (0..start.width).map(|k| start.at(k, last)).collect();
        SweptGram { start, swept: Vec::new(), own, with_residual }
    }

    fn at(&self, i: usize, j: usize) -> f64 {
        self.swept.iter().fold(self.start.at(i, j), |value, (row, factors)| value - factors[i] * row[j])
    }

    fn row(&self, i: usize) -> Vec<f64> {
        let mut values = self.start.values[i * self.start.width..(i + 1) * self.start.width].to_vec();
        for (row, factors) in &self.swept {
            subtract(&mut values, row, factors[i]);
        }
        values
    }

    fn sweep(&mut self, k: usize) {
        let row = self.row(k);
        let factors: Vec<f64> = row.iter().map(|value| value / row[k]).collect();
        let last = self.start.width - 1;
        for i in 0..=last {
            self.own[i] -= factors[i] * row[i];
            self.with_residual[i] -= factors[i] * row[last];
        }
        self.swept.push((row, factors));
    }
}

/// The number of columns that are multiplied side by side: as many sums as fit into the registers.
const SIDE_BY_SIDE: usize = 8;

/// The products of all columns with one another, each summed in the order of the rows.
fn products(columns: &[&[f64]]) -> Vec<f64> {
    let width = columns.len();
    let mut values = vec![0.0; width * width];
    for (block, some) in columns.chunks(SIDE_BY_SIDE).enumerate() {
        let first = block * SIDE_BY_SIDE;
        let rows = some.first().map_or(0, |column| column.len());
        let packed: Vec<[f64; SIDE_BY_SIDE]> =
            (0..rows).map(|row| std::array::from_fn(|k| some.get(k).map_or(0.0, |column| column[row]))).collect();
        for (i, column) in columns.iter().enumerate().skip(first) {
            let mut sums = [0.0; SIDE_BY_SIDE];
            for (x, others) in column.iter().zip(&packed) {
                for (sum, other) in sums.iter_mut().zip(others) {
                    *sum += other * x;
                }
            }
            for (k, product) in sums.into_iter().take(some.len()).enumerate() {
                values[i * width + first + k] = product;
                values[(first + k) * width + i] = product;
            }
        }
    }
    values
}

/// A candidate without its columns.
#[derive(Clone)]
struct Member {
    width: usize,
    group: usize,
    change: Option<usize>,
    cost: f64,
}

/// The constant data of a search.
pub(super) struct Search {
    candidates: Vec<Member>,
    /// The first column of each candidate.
    first: Vec<usize>,
    own: Vec<f64>,
    start: GramMatrix,
    rows: f64,
}

/// A set of candidates in ascending order, with its criterion.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct CandidateSet {
    /// Indices of the candidates.
    pub set: Vec<usize>,
    /// The criterion.
    pub score: f64,
}

impl Search {
    /// The number of multiplications for the products of a search.
    pub(super) fn multiplications(candidates: &[Candidate], rows: usize) -> usize {
        let width: usize = candidates.iter().map(|it| it.columns.len()).sum();
        width * width / 2 * rows
    }

    /// A search for the given residual.
    pub(super) fn new(candidates: &[Candidate], residual: &[f64]) -> Self {
        let mut columns: Vec<&[f64]> = candidates.iter().flat_map(|it| it.columns.iter().map(Vec::as_slice)).collect();
        columns.push(residual);
        let width = columns.len();
        let start = GramMatrix { width, values: products(&columns) };
        let member = |it: &Candidate| Member { width: it.columns.len(), group: it.group, change: it.change, cost: it.cost };
        Search::of(candidates.iter().map(member).collect(), start, residual.len())
    }

    fn of(candidates: Vec<Member>, start: GramMatrix, rows: usize) -> Self {
        let mut first = Vec::new();
        let mut next = 0;
        for candidate in &candidates {
            first.push(next);
            next += candidate.width;
        }
        let own = (0..start.width).map(|k| start.at(k, k)).collect();
        Search { candidates, first, own, start, rows: rows as f64 }
    }

    /// The same search among fewer candidates, given by ascending indices.
    pub(super) fn among(&self, places: &[usize]) -> Search {
        let mut columns: Vec<usize> = places.iter().flat_map(|place| self.columns_of(*place)).collect();
        columns.push(self.start.width - 1);
        let values = columns.iter().flat_map(|i| columns.iter().map(|j| self.start.at(*i, *j))).collect();
        let candidates = places.iter().map(|place| self.candidates[*place].clone()).collect();
        Search::of(candidates, GramMatrix { width: columns.len(), values }, self.rows as usize)
    }

    fn residual(&self, products: &SweptGram<'_>) -> f64 {
        let last = self.start.width - 1;
        // A sum of squares below this share is the rounding error of the products.
        products.own[last].max(1e-14 * self.own[last])
    }

    /// n ln(sum of squares).
    fn misfit(&self, square: f64) -> f64 {
        self.rows * square.max(f64::MIN_POSITIVE).ln()
    }

    fn columns_of(&self, candidate: usize) -> std::ops::Range<usize> {
        self.first[candidate]..self.first[candidate] + self.candidates[candidate].width
    }

    fn with<'p>(&self, products: &SweptGram<'p>, candidate: usize) -> SweptGram<'p> {
        let mut grown = products.clone();
        for k in self.columns_of(candidate) {
            if grown.own[k] > DEPENDENT_PIVOT * self.own[k] {
                grown.sweep(k);
            }
        }
        grown
    }

    /// The square of the residual after adding a candidate.
    fn square_with(&self, products: &SweptGram<'_>, candidate: usize) -> f64 {
        let last = self.start.width - 1;
        let columns = self.columns_of(candidate);
        if columns.len() == 1 {
            let k = columns.start;
            let own = products.own[k];
            let product = products.with_residual[k];
            let taken = if own > DEPENDENT_PIVOT * self.own[k] { product * product / own } else { 0.0 };
            return (products.own[last] - taken).max(1e-14 * self.own[last]);
        }
        // A small separate matrix: its columns and the residual.
        let places: Vec<usize> = columns.clone().chain([last]).collect();
        let width = places.len();
        let values = places.iter().flat_map(|i| places.iter().map(|j| products.at(*i, *j))).collect();
        let start = GramMatrix { width, values };
        let mut small = SweptGram::new(&start);
        for (k, column) in columns.enumerate() {
            if small.own[k] > DEPENDENT_PIVOT * self.own[column] {
                small.sweep(k);
            }
        }
        small.own[width - 1].max(1e-14 * self.own[last])
    }

    fn products_of(&self, set: &[usize]) -> SweptGram<'_> {
        set.iter().fold(SweptGram::new(&self.start), |products, candidate| self.with(&products, *candidate))
    }

    fn cost(&self, set: &[usize]) -> f64 {
        set.iter().map(|candidate| self.candidates[*candidate].cost).sum()
    }

    /// The criterion of a set.
    pub(super) fn score(&self, set: &[usize]) -> f64 {
        self.misfit(self.residual(&self.products_of(set))) + self.cost(set)
    }

    /// The square of the residual of a set.
    pub(super) fn square(&self, set: &[usize]) -> f64 {
        self.residual(&self.products_of(set))
    }

    /// The coefficients of a member of a set.
    pub(super) fn coefficients(&self, set: &[usize], member: usize) -> Vec<f64> {
        let rest: Vec<usize> = set.iter().copied().filter(|other| *other != member).collect();
        let products = self.products_of(&rest);
        let columns: Vec<usize> = self.columns_of(member).collect();
        let matrix = symmetric(columns.len(), |i, j| products.at(columns[i], columns[j]));
        let right: Vec<f64> = columns.iter().map(|column| products.with_residual[*column]).collect();
        Normal::fine(&matrix, columns.len()).solve(&right)
    }

    fn is_allowed_with(&self, set: &[usize], candidate: usize) -> bool {
        set.iter().all(|member| self.are_compatible(*member, candidate))
    }

    /// Whether two candidates may be in one set.
    fn are_compatible(&self, a: usize, b: usize) -> bool {
        let (a, b) = (&self.candidates[a], &self.candidates[b]);
        a.group != b.group && a.change.zip(b.change).is_none_or(|(a, b)| a.abs_diff(b) >= LEAST_BLOCK)
    }

    /// All candidates that may be added to a set, each with the resulting score.
    pub(super) fn joined(&self, set: &[usize]) -> Vec<(usize, f64)> {
        let products = self.products_of(set);
        self.joined_to(&products, set)
    }

    fn joined_to(&self, products: &SweptGram<'_>, set: &[usize]) -> Vec<(usize, f64)> {
        let cost = self.cost(set);
        let of = |candidate: usize| {
            (candidate, self.misfit(self.square_with(products, candidate)) + cost + self.candidates[candidate].cost)
        };
        (0..self.candidates.len()).filter(|candidate| self.is_allowed_with(set, *candidate)).map(of).collect()
    }

    /// The best set. If the work limit is reached, the best one found so far.
    pub(super) fn best(&self, work: &Work<'_>) -> CandidateSet {
        let mut best = CandidateSet { set: Vec::new(), score: self.score(&[]) };
        let mut paths = vec![(best.clone(), SweptGram::new(&self.start))];
        for depth in 1..=MOST_CAUSES {
            if !work.has_work_left() {
                break;
            }
            work.add(paths.len() * self.start.width * depth);
            let mut grown: Vec<(CandidateSet, usize)> = Vec::new();
            for (path, (found, products)) in paths.iter().enumerate() {
                let mut joined = self.joined_to(products, &found.set);
                order::ascending(&mut joined, |it| it.1);
                for (candidate, score) in joined.into_iter().take(BEAM) {
                    let mut set = found.set.clone();
                    set.push(candidate);
                    set.sort_unstable();
                    if !grown.iter().any(|(other, _)| other.set == set) {
                        grown.push((CandidateSet { set, score }, path));
                    }
                }
            }
            order::ascending(&mut grown, |it| it.0.score);
            grown.truncate(BEAM);
            paths = grown
                .into_iter()
                .map(|(found, path)| {
                    let (before, products) = &paths[path];
                    let new =
                        *found.set.iter().find(|member| !before.set.contains(member)).expect("a grown set has a new member");
                    let products = self.with(products, new);
                    (found, products)
                })
                .collect();
            let Some((front, _)) = paths.first() else { break };
            if front.score < best.score {
                best = front.clone();
            } else if depth >= best.set.len() + 3 {
                // Three causes that gain nothing alone or in pairs are not searched.
                break;
            }
        }
        self.exchanged(best, work)
    }

    /// Removes up to two members and adds up to two others, whichever gains most, while the criterion falls. One at a time is not enough: if a cause
    /// was taken with the wrong shape, a second one compensates for the difference (for example a drift that is right in the middle, and a bias), and
    /// neither can be removed alone.
    fn exchanged(&self, mut best: CandidateSet, work: &Work<'_>) -> CandidateSet {
        // Each round lowers the criterion, so the number of rounds is finite; the bound is against cycles by rounding.
        for _ in 0..4 * MOST_CAUSES {
            if !work.has_work_left() {
                break;
            }
            let mut next = best.clone();
            let wide = self.candidates.iter().filter(|it| it.width > 1).count();
            for out in subsets_of_two(best.set.len()) {
                let rest: Vec<usize> =
                    (0..best.set.len()).filter(|place| !out.contains(place)).map(|place| best.set[place]).collect();
                work.add(self.candidates.len() * self.candidates.len() / 2 + wide * self.start.width * (rest.len() + 1));
                let products = self.products_of(&rest);
                let alone = self.misfit(self.residual(&products)) + self.cost(&rest);
                // A change below a thousandth is rounding error and could cycle.
                let mut consider = |new: &[usize], score: f64| {
                    if score < next.score - 1e-3 && rest.len() + new.len() <= MOST_CAUSES {
                        let mut set: Vec<usize> = rest.iter().chain(new).copied().collect();
                        set.sort_unstable();
                        next = CandidateSet { set, score };
                    }
                };
                consider(&[], alone);
                for (candidate, score) in self.joined_to(&products, &rest) {
                    consider(&[candidate], score);
                }
                if let Some((pair, score)) = self.best_pair(&products, &rest) {
                    consider(&pair, score);
                }
            }
            if next.set == best.set {
                break;
            }
            best = next;
        }
        best
    }

    /// The two candidates that together gain most, added to a set. A candidate of one column is a row of the products, and two of them are solved by
    /// Cramer's rule. Those of several columns are swept in, and then combined with all others.
    fn best_pair(&self, products: &SweptGram<'_>, set: &[usize]) -> Option<([usize; 2], f64)> {
        let last = self.start.width - 1;
        let free: Vec<usize> = (0..self.candidates.len()).filter(|candidate| self.is_allowed_with(set, *candidate)).collect();
        let cost = self.cost(set);
        let left = self.residual(products);
        let mut best: Option<([usize; 2], f64)> = None;
        let mut consider = |pair: [usize; 2], square: f64| {
            let score = self.misfit(square.max(1e-14 * self.own[last])) + cost + self.cost(&pair);
            if best.is_none_or(|best| score < best.1) {
                best = Some((pair, score));
            }
        };
        let (narrow, wide): (Vec<usize>, Vec<usize>) =
            free.iter().copied().partition(|candidate| self.candidates[*candidate].width == 1);
        // Logarithms are expensive: for each first candidate, only the best partner of each cost is scored.
        for (place, a) in narrow.iter().enumerate() {
            let i = self.first[*a];
            let (own, product) = (products.own[i], products.with_residual[i]);
            if own <= DEPENDENT_PIVOT * self.own[i] {
                continue;
            }
            let row = products.row(i);
            let mut of_costs: Vec<(f64, usize, f64)> = Vec::new();
            for b in narrow[place + 1..].iter().filter(|b| self.are_compatible(*a, **b)) {
                let j = self.first[*b];
                let factor = row[j] / own;
                let other = products.own[j] - factor * row[j];
                if other <= DEPENDENT_PIVOT * self.own[j] {
                    continue;
                }
                let taken = (products.with_residual[j] - factor * product).powi(2) / other;
                let cost = self.candidates[*b].cost;
                match of_costs.iter_mut().find(|it| it.0 == cost) {
                    Some(it) if it.2 >= taken => {}
                    Some(it) => (it.1, it.2) = (*b, taken),
                    None => of_costs.push((cost, *b, taken)),
                }
            }
            let alone = left - product * product / own;
            for (_, b, taken) in of_costs {
                consider([*a, b], alone - taken);
            }
        }
        for a in wide {
            let with = self.with(products, a);
            for b in free.iter().filter(|b| **b != a && self.are_compatible(a, **b)) {
                consider([a, *b], self.square_with(&with, *b));
            }
        }
        best
    }
}

/// The empty subset, each single index, and each pair of indices below `count`.
fn subsets_of_two(count: usize) -> Vec<Vec<usize>> {
    let ones = (0..count).map(|a| vec![a]);
    let twos = (0..count).flat_map(|a| (0..a).map(move |b| vec![b, a]));
    std::iter::once(Vec::new()).chain(ones).chain(twos).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pair_that_masks_each_other_is_found_together() {
        // a and b nearly cancel; d follows their sum loosely and is the best alone.
        let n = 40;
        let wave = |k: usize, w: f64| (k as f64 * w).sin();
        let a: Vec<f64> = (0..n).map(|k| wave(k, 0.7)).collect();
        let b: Vec<f64> = (0..n).map(|k| wave(k, 0.7) + 0.3 * wave(k, 1.9)).collect();
        let d: Vec<f64> = (0..n).map(|k| wave(k, 1.9) + 0.4 * wave(k, 2.8)).collect();
        let y: Vec<f64> = (0..n).map(|k| 3.0 * (b[k] - a[k]) + 0.01 * wave(k, 2.3)).collect();
        let candidate = |column: &Vec<f64>, group| Candidate { columns: vec![column.clone()], group, change: None, cost: 10.0 };
        let candidates = [candidate(&a, 0), candidate(&b, 1), candidate(&d, 2)];
        let search = Search::new(&candidates, &y);
        let alone = search.joined(&[]);
        assert!(alone[2].1 < alone[0].1 && alone[2].1 < alone[1].1, "{alone:?}");
        assert_eq!(search.best(&Work::unbounded()).set, [0, 1]);
        // Of one group they may not stand together.
        let candidates = [candidate(&a, 0), candidate(&b, 0), candidate(&d, 2)];
        assert!(!Search::new(&candidates, &y).best(&Work::unbounded()).set.starts_with(&[0, 1]));
    }

    #[test]
    fn a_wrong_shape_goes_together_with_what_made_up_for_it() {
        // A drift that is right at the first run, taken for one that is right in the middle and a bias: neither can go alone, as both sets leave the
        // same, and three cost more than two.
        let n = 30;
        let time = |k: usize| k as f64 / (n - 1) as f64;
        let other: Vec<f64> = (0..n).map(|k| (k as f64 * 1.3).sin()).collect();
        let y: Vec<f64> = (0..n).map(|k| 2.0 * time(k) + other[k] + 0.01 * (k as f64 * 2.3).sin()).collect();
        let candidate = |column: Vec<f64>, group| Candidate { columns: vec![column], group, change: None, cost: 10.0 };
        let candidates = [
            candidate((0..n).map(time).collect(), 0),
            candidate((0..n).map(|k| time(k) - 0.5).collect(), 0),
            candidate(vec![1.0; n], 1),
            candidate(other, 2),
        ];
        let search = Search::new(&candidates, &y);
        let wrong = CandidateSet { set: vec![1, 2, 3], score: search.score(&[1, 2, 3]) };
        assert_eq!(search.exchanged(wrong, &Work::unbounded()).set, [0, 3]);
    }

    #[test]
    fn changes_in_the_run_order_keep_their_distance() {
        // One run that is off is two changes, one run apart: not a pair of causes.
        let n = 30;
        let step = |at: usize| (0..n).map(|k| f64::from(u8::from(k >= at))).collect::<Vec<f64>>();
        let y: Vec<f64> = (0..n).map(|k| if k == 12 { 1.0 } else { 1e-3 * (k as f64).sin() }).collect();
        let candidate = |at: usize| Candidate { columns: vec![step(at)], group: at, change: Some(at), cost: 10.0 };
        let candidates = [candidate(12), candidate(13), candidate(15)];
        let best = Search::new(&candidates, &y).best(&Work::unbounded()).set;
        assert!(!best.starts_with(&[0, 1]), "{best:?}");
        let far = [candidate(12), Candidate { change: None, ..candidate(13) }];
        assert_eq!(Search::new(&far, &y).best(&Work::unbounded()).set, [0, 1]);
    }
}

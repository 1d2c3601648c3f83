//! The triangle of many rows: groups of rows on several threads, and the rows of a group in lanes.
//!
//! In: the number of rows and a function that gives their terms and responses in lanes. Out: a [`Triangle`]. The rows of a group are dealt to the
//! lanes in turn. Each lane is reduced by itself, by the steps of [`Compressed`]; then the triangles of all lanes of all groups are reduced as rows,
//! in their order. Fewer rows than a group, and those behind the last whole group, are reduced one after the other. So the bits depend on the number
//! of rows alone, not on the number of threads, and those of a table with fewer rows than [`GROUP`] are those of [`Compressed`].

use super::{BLOCK, Compressed, Triangle};
use crate::dd::Dd;
use crate::dd::lanes::{self, LANES, Lanes};
use crate::threads;
use rsm_core::vector::{Work, widest};

/// The number of rows of a group: 4,096 in each lane, so that the triangles of the lanes are less than a hundredth of the rows of ten terms.
pub(crate) const GROUP: usize = 4096 * LANES;

/// The number of rows that a lane reduces together: the block of ten terms is in the cache of the second level, 128 bytes for each number.
const ROWS: usize = 128;

/// An upper limit of the number of reductions of a table, of its lanes and of the whole. A triangle that is reduced again as rows counts as one more,
/// because its rows are as many as its columns.
pub(crate) fn reductions(rows: usize) -> usize {
    let groups = rows / GROUP;
    // Of each lane its blocks, a last, shorter one, and its triangle, which fills at most one block of the whole.
    rows / BLOCK + 1 + groups * LANES * (GROUP / LANES / ROWS + 3)
}

/// The triangle of a table. `rows_at(state, first, out)` writes the terms and the response of the rows from `first` on, one in each lane.
pub(crate) fn triangle<S>(
    width: usize,
    rows: usize,
    state: impl Fn() -> S + Sync,
    rows_at: impl Fn(&mut S, usize, &mut [Lanes]) + Sync,
) -> Triangle {
    let mut whole = Gathered::new(width);
    let of_group = |group: usize| {
        let mut state = state();
        group_of(width, |first, out| rows_at(&mut state, group * GROUP + first, out))
    };
    threads::in_order(rows / GROUP, of_group, |lanes| whole.add_lanes(&lanes));
    let (mut state, mut out) = (state(), vec![Lanes::ZERO; width]);
    for first in (rows / GROUP * GROUP..rows).step_by(LANES) {
        rows_at(&mut state, first, &mut out);
        for lane in 0..LANES.min(rows - first) {
            whole.push(out.iter().map(|value| value.get(lane)));
        }
    }
    whole.finish()
}

/// The triangles of groups and single rows behind them.
#[derive(Debug)]
pub(crate) struct Gathered {
    compressed: Compressed,
    rows: usize,
}

impl Gathered {
    pub(crate) fn new(width: usize) -> Self {
        Gathered { compressed: Compressed::new(width), rows: 0 }
    }

    /// Adds the triangles of a group, of [`group_of`].
    pub(crate) fn add_lanes(&mut self, columns: &[Vec<Lanes>]) {
        for lane in 0..LANES {
            for row in 0..columns.len() {
                self.compressed.push(columns.iter().map(|column| column[row].get(lane)));
            }
        }
        self.rows += GROUP;
    }

    /// Adds a row.
    pub(crate) fn push(&mut self, row: impl IntoIterator<Item = Dd>) {
        self.compressed.push(row);
        self.rows += 1;
    }

    pub(crate) fn finish(self) -> Triangle {
        Triangle { rows: self.rows, ..self.compressed.finish() }
    }
}

/// The triangle of each lane of a group, by columns. `rows_at(first, out)` as in [`triangle`], `first` in the group.
pub(crate) fn group_of(width: usize, mut rows_at: impl FnMut(usize, &mut [Lanes])) -> Vec<Vec<Lanes>> {
    // Wide triangles are reduced together with as many rows.
    let most = width + ROWS.max(width);
    let mut columns = vec![Vec::with_capacity(most); width];
    let mut row = vec![Lanes::ZERO; width];
    let mut v = Vec::with_capacity(most);
    for first in (0..GROUP).step_by(LANES) {
        rows_at(first, &mut row);
        columns.iter_mut().zip(&row).for_each(|(column, value)| column.push(*value));
        if columns[0].len() >= most {
            reduce(&mut columns, &mut v);
        }
    }
    reduce(&mut columns, &mut v);
    // With more columns than rows of a lane, the last rows of its triangle are zero.
    columns.iter_mut().for_each(|column| column.resize(width, Lanes::ZERO));
    columns
}

/// Reduces each lane to a triangle. `v`: memory.
fn reduce(columns: &mut [Vec<Lanes>], v: &mut Vec<Lanes>) {
    let width = columns.len();
    for k in 0..width {
        let (before, after) = columns.split_at_mut(k + 1);
        let Some(tail) = before[k].get_mut(k..).filter(|tail| !tail.is_empty()) else { break };
        // The steps of `Reflection::of`.
        let below = widest(Square(&tail[1..]));
        let norm = tail[0].mul(tail[0]).add(below).sqrt();
        let turned = tail[0].against(norm);
        v.clear();
        v.extend_from_slice(tail);
        v[0] = tail[0].sub(turned);
        let scale = Lanes::splat(Dd::from(2.0)).div(v[0].mul(v[0]).add(below));
        // A lane whose tail is already zero is not reflected.
        tail[0] = below.choose(tail[0], turned);
        tail[1..].fill(Lanes::ZERO);
        for column in after {
            widest(Reflected { v, scale, below, column: &mut column[k..] });
        }
    }
    columns.iter_mut().for_each(|column| column.truncate(width));
}

/// The sum of squares of a column.
struct Square<'a>(&'a [Lanes]);

impl Work for Square<'_> {
    type Found = Lanes;

    #[inline(always)]
    fn run(self) -> Lanes {
        lanes::product_of(self.0, self.0)
    }
}

/// The steps of `Reflection::apply`.
struct Reflected<'a> {
    v: &'a [Lanes],
    scale: Lanes,
    below: Lanes,
    column: &'a mut [Lanes],
}

impl Work for Reflected<'_> {
    type Found = ();

    #[inline(always)]
    fn run(self) {
        let factor = self.below.unless_zero(lanes::product_of(self.v, self.column).mul(self.scale));
        for (x, v) in self.column.iter_mut().zip(self.v) {
            *x = x.sub(factor.mul(*v));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// Rows with columns of zeros in some lanes, one lane whose first column is 0 below its first row, and one column that is 0 in the first rows.
    fn table(rows: usize, width: usize) -> Vec<Vec<Dd>> {
        let mut random = Random::new(rows as u64);
        let number = |random: &mut Random| Dd::sum_of(random.normal(), 1e-18 * random.normal());
        let row = |row: usize| {
            let is_zero = |k: usize| match k {
                0 => row % LANES == 3 && row % GROUP >= LANES,
                1 => row < 1000,
                2 => row.is_multiple_of(LANES),
                _ => false,
            };
            (0..width).map(|k| if is_zero(k) { Dd::ZERO } else { number(&mut random) }).collect()
        };
        (0..rows).map(row).collect()
    }

    fn of(table: &[Vec<Dd>]) -> Triangle {
        triangle(
            table[0].len(),
            table.len(),
            || (),
            |(), first, out| {
                for lane in 0..LANES {
                    let row = &table[(first + lane).min(table.len() - 1)];
                    out.iter_mut().zip(row).for_each(|(out, value)| out.set(lane, *value));
                }
            },
        )
    }

    #[test]
    fn a_small_table_has_the_bits_of_rows_one_after_the_other() {
        for rows in [3, 9, 1000, GROUP - 1] {
            let table = table(rows, 5);
            let mut compressed = Compressed::new(5);
            table.iter().for_each(|row| compressed.push(row.iter().copied()));
            assert_eq!(of(&table).columns, compressed.finish().columns);
        }
    }

    #[test]
    fn a_large_table_has_the_bits_of_its_lanes_one_after_the_other_for_any_number_of_threads() {
        let table = table(2 * GROUP + 77, 4);
        let mut whole = Compressed::new(4);
        for group in 0..2 {
            for lane in 0..LANES {
                let own = table[group * GROUP..(group + 1) * GROUP].iter().skip(lane).step_by(LANES);
                let mut compressed = Compressed { block: ROWS, ..Compressed::new(4) };
                own.for_each(|row| compressed.push(row.iter().copied()));
                let triangle = compressed.finish();
                (0..4).for_each(|row| whole.push((0..4).map(|k| triangle.columns[k][row])));
            }
        }
        table[2 * GROUP..].iter().for_each(|row| whole.push(row.iter().copied()));
        let expected = whole.finish().columns;
        for threads in [1, 2, 5] {
            threads::limit(threads);
            let found = of(&table);
            assert_eq!(found.columns, expected, "{threads}");
            assert_eq!(found.rows(), table.len());
        }
        threads::limit(0);
    }

    #[test]
    fn the_sums_of_squares_are_those_of_the_rows() {
        let table = table(GROUP + 40, 4);
        let triangle = of(&table);
        for (k, column) in triangle.columns.iter().enumerate() {
            let square: Dd = table.iter().map(|row| row[k] * row[k]).sum();
            let found: Dd = column.iter().map(|x| *x * *x).sum();
            // A reflection of m numbers changes a column by less than 40 m 2^-100 of its norm (`partial/bound.rs`), and there are at most 4 of each
            // row and 4 for each of the reductions.
            let bound = 2.0 * 40.0 * 4.0 * (table.len() + 4 * reductions(table.len())) as f64 * 2f64.powi(-100);
            assert!(((found - square) / square).to_f64().abs() <= bound, "{k}: {found:?} {square:?}");
        }
    }
}

//! The triangle of many rows: groups of rows on several threads, and the rows of a group in lanes.
//!
//! In: the number of rows and a function that gives their terms and responses in lanes. Out: a [`Triangle`]. The rows of a group are dealt to the
//! lanes in turn. Each lane is reduced by itself, by reflections as those of [`Compressed`] whose sums need fewer operations ([`lanes::Sum`]); then
//! the triangles of all lanes of all groups are reduced as rows, in their order. Fewer rows than a group, and those behind the last whole group, are
//! reduced one after the other. So the bits depend on the number of rows alone, not on the number of threads, and those of a table with fewer rows
//! than [`GROUP`] are those of [`Compressed`].

use super::{BLOCK, Compressed, Triangle};
use crate::dd::Dd;
use crate::dd::lanes::{self, LANES, Lanes, Sum, Work, widest};
use crate::threads;

/// The number of rows of a group: 4,096 in each lane, so that the triangles of the lanes are less than a hundredth of the rows of ten terms.
pub(crate) const GROUP: usize = 4096 * LANES;

/// The number of rows that a lane reduces together: two columns of them, with 128 bytes for each number, are in a cache of the first level of 32 kB.
const ROWS: usize = 64;

const _: () = assert!(ROWS <= lanes::SUMMED);

/// An upper limit of the number of reductions of a table, of its lanes and of the whole. A triangle that is reduced again as rows counts as one more,
/// because its rows are as many as its columns.
pub(crate) fn reductions(rows: usize) -> usize {
    let groups = rows / GROUP;
    // Of each lane its blocks, a last, shorter one, and its triangle, which fills at most one block of the whole.
    // A block of a lane has one row of its triangle, not `width`: with a response and a term it counts half at most.
    rows / BLOCK + 1 + groups * LANES * (GROUP / LANES / ROWS / 2 + 3)
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
    let mut triangle = vec![vec![Lanes::ZERO; width]; width];
    let mut block = vec![Vec::with_capacity(ROWS); width];
    let mut row = vec![Lanes::ZERO; width];
    for first in (0..GROUP).step_by(LANES) {
        rows_at(first, &mut row);
        block.iter_mut().zip(&row).for_each(|(column, value)| column.push(*value));
        if block[0].len() == ROWS {
            reduce(&mut triangle, &mut block);
        }
    }
    triangle
}

/// Reduces a triangle and the rows below it to a triangle, in each lane, and removes these rows. A reflection changes one row of the triangle.
fn reduce(triangle: &mut [Vec<Lanes>], block: &mut [Vec<Lanes>]) {
    // For each column the sum of its products with the next one to be reduced.
    let mut sums: Vec<Lanes> = block.iter().map(|column| widest(Product(&block[0], column))).collect();
    for k in 0..block.len() {
        let (before, after) = block.split_at_mut(k + 1);
        let v = &mut before[k];
        let (reflected, reflection) = widest(OfColumn { top: triangle[k][k], v, below: sums[k] });
        triangle[k][k] = reflected;
        if let Some((next, others)) = after.split_first_mut() {
            let (tops, sums) = (&mut triangle[k + 1..], &mut sums[k + 1..]);
            sums[0] =
                widest(Reflected { reflection: &reflection, sum: sums[0], top: &mut tops[0][k], column: next, with: None });
            for ((column, top), sum) in others.iter_mut().zip(&mut tops[1..]).zip(&mut sums[1..]) {
                *sum = widest(Reflected { reflection: &reflection, sum: *sum, top: &mut top[k], column, with: Some(next) });
            }
        }
        v.clear();
    }
}

/// The steps of `Reflection::of` for a row of a triangle and those below it. Out: the reflected row of the triangle, and the reflection.
struct OfColumn<'a> {
    top: Lanes,
    v: &'a [Lanes],
    below: Lanes,
}

impl<'a> Work for OfColumn<'a> {
    type Found = (Lanes, Reflection<'a>);

    #[inline(always)]
    fn compute<const FUSED: bool>(self) -> Self::Found {
        let OfColumn { top, v, below } = self;
        let norm = top.times::<FUSED>(top).add(below).root::<FUSED>();
        let turned = top.against(norm);
        let first = top.sub(turned);
        let scale = Lanes::splat(Dd::from(2.0)).over::<FUSED>(first.times::<FUSED>(first).add(below));
        // A lane whose rows are already zero is not reflected.
        (below.choose(top, turned), Reflection { first, v, scale, below })
    }
}

/// The sum of the products of two columns.
struct Product<'a>(&'a [Lanes], &'a [Lanes]);

impl Work for Product<'_> {
    type Found = Lanes;

    #[inline(always)]
    fn compute<const FUSED: bool>(self) -> Lanes {
        let mut sum = Sum::ZERO;
        for (x, y) in self.0.iter().zip(self.1) {
            sum.add_product::<FUSED>(*x, *y);
        }
        sum.total()
    }
}

/// A reflection of one row of a triangle and the rows below it.
struct Reflection<'a> {
    first: Lanes,
    v: &'a [Lanes],
    scale: Lanes,
    below: Lanes,
}

/// The steps of `Reflection::apply`. Out: the sum of the products of the reflected column with another one, without their rows in the triangle.
struct Reflected<'a> {
    reflection: &'a Reflection<'a>,
    /// The sum of the products of the column with that of the reflection.
    sum: Lanes,
    top: &'a mut Lanes,
    column: &'a mut [Lanes],
    /// `None` for the column itself.
    with: Option<&'a [Lanes]>,
}

impl Work for Reflected<'_> {
    type Found = Lanes;

    /// One pass over the column. It also keeps the compiler from vectors over rows in place of lanes, which are in eight places of the memory.
    #[inline(always)]
    fn compute<const FUSED: bool>(self) -> Lanes {
        let Reflection { first, v, scale, below } = *self.reflection;
        let product = first.times::<FUSED>(*self.top).add(self.sum);
        let factor = below.unless_zero(product.times::<FUSED>(scale));
        *self.top = lanes::without::<FUSED>(*self.top, factor, first);
        let mut sum = Sum::ZERO;
        match self.with {
            None => {
                for (x, v) in self.column.iter_mut().zip(v) {
                    *x = lanes::without::<FUSED>(*x, factor, *v);
                    sum.add_product::<FUSED>(*x, *x);
                }
            }
            Some(with) => {
                for ((x, v), with) in self.column.iter_mut().zip(v).zip(with) {
                    *x = lanes::without::<FUSED>(*x, factor, *v);
                    sum.add_product::<FUSED>(*x, *with);
                }
            }
        }
        sum.total()
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

    /// The triangle of the rows of a lane, one number after the other.
    struct OneByOne {
        triangle: Vec<Vec<Dd>>,
    }

    impl OneByOne {
        /// A product and its error.
        fn product(x: Dd, y: Dd) -> (f64, f64) {
            let ([x, x_low], [y, y_low]) = (x.parts(), y.parts());
            (x * y, x.mul_add(y, -(x * y)) + (x * y_low + x_low * y))
        }

        fn sum_of_products(x: &[Dd], y: &[Dd]) -> Dd {
            let (mut high, mut low) = (0.0, 0.0);
            for (x, y) in x.iter().zip(y) {
                let (product, error) = OneByOne::product(*x, *y);
                let [sum, rest] = Dd::sum_of(high, product).parts();
                (high, low) = (sum, low + (rest + error));
            }
            Dd::sum_of(high, low)
        }

        fn without(x: Dd, factor: Dd, v: Dd) -> Dd {
            let (product, error) = OneByOne::product(factor, v);
            let [high, low] = x.parts();
            let [difference, rest] = Dd::sum_of(high, -product).parts();
            Dd::sum_of(difference, (low - error) + rest)
        }

        fn reduce(&mut self, mut block: Vec<Vec<Dd>>) {
            for k in 0..block.len() {
                let v = block[k].clone();
                let (top, below) = (self.triangle[k][k], OneByOne::sum_of_products(&v, &v));
                if below == Dd::ZERO {
                    continue;
                }
                let norm = (top * top + below).sqrt();
                let turned = if top > Dd::ZERO { -norm } else { norm };
                let first = top - turned;
                let scale = Dd::from(2.0) / (first * first + below);
                self.triangle[k][k] = turned;
                for (column, top) in block.iter_mut().zip(&mut self.triangle).skip(k + 1) {
                    let factor = (first * top[k] + OneByOne::sum_of_products(&v, column)) * scale;
                    top[k] = OneByOne::without(top[k], factor, first);
                    column.iter_mut().zip(&v).for_each(|(x, v)| *x = OneByOne::without(*x, factor, *v));
                }
            }
        }
    }

    #[test]
    fn a_large_table_has_the_bits_of_its_lanes_one_after_the_other_for_any_number_of_threads() {
        let table = table(2 * GROUP + 77, 4);
        let mut whole = Compressed::new(4);
        for group in 0..2 {
            for lane in 0..LANES {
                let own: Vec<&Vec<Dd>> = table[group * GROUP..(group + 1) * GROUP].iter().skip(lane).step_by(LANES).collect();
                let mut lane = OneByOne { triangle: vec![vec![Dd::ZERO; 4]; 4] };
                for rows in own.chunks(ROWS) {
                    lane.reduce((0..4).map(|k| rows.iter().map(|row| row[k]).collect()).collect());
                }
                (0..4).for_each(|row| whole.push((0..4).map(|k| lane.triangle[k][row])));
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
    fn a_reflection_has_the_same_bits_with_fused_operations_and_without() {
        let mut random = Random::new(5);
        for exponent in [-320, -170, -150, -20, 0, 20, 150, 170, 300] {
            let mut column = || {
                let number = |random: &mut Random| {
                    let high = random.normal() * 10f64.powi(exponent + random.below(9) as i32);
                    if random.below(9) == 0 { Dd::ZERO } else { Dd::sum_of(high, high * 1e-17 * random.normal()) }
                };
                let mut lanes = vec![Lanes::ZERO; ROWS];
                lanes.iter_mut().for_each(|lanes| (0..LANES).for_each(|k| lanes.set(k, number(&mut random))));
                lanes
            };
            let (v, column, with) = (column(), column(), column());
            let reflection = Reflection { first: column[0], v: &v, scale: with[1], below: v[2] };
            // What is changed, and the sum.
            let bits = |column: Vec<Lanes>, of: &dyn Fn(Reflected<'_>) -> Lanes| {
                let (mut column, mut top) = (column, with[3]);
                let sum =
                    of(Reflected { reflection: &reflection, sum: v[4], top: &mut top, column: &mut column, with: Some(&with) });
                let bits = |it: f64| if it.is_nan() { f64::NAN.to_bits() } else { it.to_bits() };
                let all = column.into_iter().chain([top, sum]);
                all.flat_map(|it| (0..LANES).flat_map(move |k| it.get(k).parts()).map(bits)).collect::<Vec<u64>>()
            };
            let expected = bits(column.clone(), &|it| it.compute::<false>());
            assert_eq!(bits(column.clone(), &|it| it.compute::<true>()), expected, "{exponent}");
            assert_eq!(bits(column.clone(), &|it| widest(it)), expected, "{exponent}");
        }
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

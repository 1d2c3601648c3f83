//! Least squares by Householder reflections in double-double arithmetic, on a model that may grow.
//!
//! In: rows of a design matrix, each followed by its response. Out: coefficients, the triangular factor, the residual sum of squares. [`Compressed`]
//! takes any number of rows and keeps a triangle: an orthogonal transformation of all candidate columns and the response, which has the same
//! least-squares solution for every choice of columns. [`Growing`] solves on that triangle and adds a column at the cost of one reflection. A column
//! that is a linear combination of the others (within the rounding of the data) is rejected by name.
//!
//! Source: Golub, Van Loan, Matrix Computations, 5.2 (Householder QR) and 6.5 (updating); Lawson, Hanson, Solving Least Squares
//! Problems, chapter 27 (sequential accumulation).

use crate::dd::Dd;
use crate::dd::lanes::{self, Lanes, Work, widest};

pub(crate) mod table;

/// A column is rejected if its component orthogonal to the other columns is below this share of it. Data are rounded to f64, with relative errors up
/// to 2^-53; 2^-46 leaves a factor of 128 for sums of several such columns. For Filip, the worst of NIST's sets, the share is 2^-31.
pub(crate) const DEPENDENT: f64 = 1.0 / (1u64 << 46) as f64;

/// The number of rows that are reduced together. Larger blocks need more memory; smaller ones repeat the work on the triangle.
pub(crate) const BLOCK: usize = 512;

/// A matrix by columns.
type Columns = Vec<Vec<Dd>>;

/// The triangle of a tall matrix: the candidates and, last, the response.
#[derive(Debug, Clone)]
pub struct Compressed {
    columns: Columns,
    rows: usize,
    /// [`BLOCK`]; smaller in a test.
    block: usize,
}

impl Compressed {
    /// Without rows; `width` includes the response.
    #[must_use]
    pub fn new(width: usize) -> Self {
        Compressed { columns: vec![Vec::new(); width], rows: 0, block: BLOCK }
    }

    /// Adds a row: the terms, then the response.
    pub fn push(&mut self, row: impl IntoIterator<Item = Dd>) {
        let mut count = 0;
        for (column, value) in self.columns.iter_mut().zip(row) {
            column.push(value);
            count += 1;
        }
        assert_eq!(count, self.columns.len(), "a row has a number for every column");
        self.rows += 1;
        let width = self.columns.len();
        let height = self.columns.first().expect("the response, at least").len();
        if height >= width + self.block.max(width) {
            self.reduce();
        }
    }

    /// The number of added rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows
    }

    fn reduce(&mut self) {
        let width = self.columns.len();
        for k in 0..width {
            let (before, after) = self.columns.split_at_mut(k + 1);
            if let Some(reflection) = Reflection::of(&mut before[k], k) {
                for column in after {
                    reflection.apply(column);
                }
            }
        }
        for column in &mut self.columns {
            column.truncate(width);
        }
    }

    /// The triangle, as columns with at most as many rows as there are columns.
    #[must_use]
    pub fn finish(mut self) -> Triangle {
        // With fewer rows than columns, no reduction is needed.
        if self.rows > self.columns.len() {
            self.reduce();
        }
        Triangle { columns: self.columns, rows: self.rows }
    }
}

/// Candidates and response after an orthogonal transformation.
#[derive(Debug, Clone)]
pub struct Triangle {
    columns: Columns,
    rows: usize,
}

impl Triangle {
    /// The triangle of the rows of several triangles with the same candidates.
    ///
    /// # Panics
    /// If `parts` is empty.
    #[must_use]
    pub fn stacked(parts: &[&Triangle]) -> Self {
        let mut columns = parts.first().expect("a triangle to stack").columns.clone();
        for part in &parts[1..] {
            for (column, more) in columns.iter_mut().zip(&part.columns) {
                column.extend(more);
            }
        }
        Compressed { columns, rows: parts.iter().map(|part| part.rows).sum(), block: BLOCK }.finish()
    }

    /// A triangle from its columns, the response last.
    pub(crate) fn of_columns(columns: Vec<Vec<Dd>>, rows: usize) -> Self {
        Triangle { columns, rows }
    }

    /// The columns, the response last, all of one length.
    pub(crate) fn columns(&self) -> &[Vec<Dd>] {
        &self.columns
    }

    /// The triangle of all rows times a factor.
    pub(crate) fn times(mut self, factor: Dd) -> Self {
        self.columns.iter_mut().flatten().for_each(|entry| *entry = *entry * factor);
        self
    }

    /// The number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// The number of candidates.
    #[must_use]
    pub fn width(&self) -> usize {
        self.columns.len() - 1
    }

    /// |response - sum of coefficient times column|^2 for some candidates.
    #[must_use]
    pub(crate) fn sum_of_squares(&self, candidates: &[usize], coefficients: &[Dd]) -> Dd {
        let mut residual = self.columns[self.width()].clone();
        for (candidate, coefficient) in candidates.iter().zip(coefficients) {
            for (entry, value) in residual.iter_mut().zip(&self.columns[*candidate]) {
                *entry -= *coefficient * *value;
            }
        }
        residual.iter().map(|entry| *entry * *entry).sum()
    }

    /// |response|^2.
    #[must_use]
    pub(crate) fn response_square(&self) -> Dd {
        self.sum_of_squares(&[], &[])
    }
}

/// The reflection I - 2 v v'/(v'v), which reduces the tail of a column to a single number.
struct Reflection {
    from: usize,
    v: Vec<Dd>,
    scale: Dd,
}

impl Reflection {
    /// The reflection for a column from a row on. The column is replaced by the result. `None` if the tail is already zero.
    fn of(column: &mut [Dd], from: usize) -> Option<Self> {
        let tail = column.get_mut(from..)?;
        let below: Dd = tail.iter().skip(1).map(|x| *x * *x).sum();
        if below == Dd::ZERO {
            return None;
        }
        let norm = (tail[0] * tail[0] + below).sqrt();
        // The sign that adds, to avoid cancellation.
        // mutant `> to >=`: for 0 both signs give the same.
        let turned = if tail[0] > Dd::ZERO { -norm } else { norm };
        let mut v = tail.to_vec();
        v[0] = tail[0] - turned;
        let square = v[0] * v[0] + below;
        tail.fill(Dd::ZERO);
        tail[0] = turned;
        Some(Reflection { from, v, scale: Dd::from(2.0) / square })
    }

    fn apply(&self, column: &mut [Dd]) {
        let Some(tail) = column.get_mut(self.from..) else { return };
        let product: Dd = self.v.iter().zip(tail.iter()).map(|(v, x)| *v * *x).sum();
        let factor = product * self.scale;
        for (x, v) in tail.iter_mut().zip(&self.v) {
            *x -= factor * *v;
        }
    }
}

/// A linear dependence of columns.
#[derive(Debug, Clone, PartialEq)]
pub struct Dependent {
    /// The norm of the column divided by the norm of its orthogonal component; infinite if that is zero.
    pub condition: f64,
    /// The candidates involved, the rejected one last.
    pub candidates: Vec<usize>,
}

/// A least-squares problem to which columns are added one at a time.
#[derive(Debug, Clone)]
pub struct Growing {
    /// Transformed candidates and, last, the response.
    columns: Columns,
    norms: Vec<f64>,
    chosen: Vec<usize>,
    /// The rows of a judge, which are not fitted, by column: the residual of each column after the chosen candidates. Empty without a judge.
    judging: Columns,
}

impl Growing {
    /// A problem without chosen candidates.
    #[must_use]
    pub fn new(triangle: &Triangle) -> Self {
        let norm = |column: &Vec<Dd>| column.iter().map(|x| *x * *x).sum::<Dd>().sqrt().to_f64();
        let norms = triangle.columns.iter().map(norm).collect();
        Growing { columns: triangle.columns.clone(), norms, chosen: Vec::new(), judging: Vec::new() }
    }

    /// The same with other rows that evaluate each choice, so that [`Growing::judged`] needs no solution. Both triangles must have the same
    /// candidates.
    #[must_use]
    pub fn judged_by(fit: &Triangle, judge: &Triangle) -> Self {
        Growing { judging: judge.columns.clone(), ..Growing::new(fit) }
    }

    /// The sum of squares that the chosen candidates leave on the judge's rows.
    #[must_use]
    pub fn judged(&self) -> Dd {
        self.judging.last().map_or(Dd::ZERO, |response| response.iter().map(|x| *x * *x).sum())
    }

    /// The effect of adding a candidate: the reduction of the residual sum of squares of the fitted rows, and the sum of squares that would be left
    /// on the judge's rows. `None` if it is linearly dependent on the chosen ones.
    #[must_use]
    pub fn effect_of_adding(&self, candidate: usize) -> Option<(Dd, Dd)> {
        let (own, last) = self.last_with(candidate)?;
        let left = match (self.judging.get(candidate), self.judging.last()) {
            (Some(column), Some(response)) => {
                response.iter().zip(column).map(|(y, x)| *y - last * *x).map(|error| error * error).sum()
            }
            _ => Dd::ZERO,
        };
        Some((last * last * own * own, left))
    }

    /// The norm of a candidate's orthogonal component, and its coefficient if it is added.
    fn last_with(&self, candidate: usize) -> Option<(Dd, Dd)> {
        let k = self.chosen.len();
        let own = self.own_part(candidate).ok()?;
        let (column, response) = (&self.columns[candidate], &self.columns[self.columns.len() - 1]);
        let product: Dd = column[k..].iter().zip(&response[k..]).map(|(x, y)| *x * *y).sum();
        Some((own, product / (own * own)))
    }

    /// A problem with only these candidates: cheaper than one with all of them.
    ///
    /// # Errors
    /// The first candidate that is linearly dependent on those before it, numbered as in the triangle.
    pub fn of(triangle: &Triangle, candidates: &[usize]) -> Result<Self, Dependent> {
        let mut small = Growing::new(&Triangle {
            columns: candidates.iter().chain([&triangle.width()]).map(|k| triangle.columns[*k].clone()).collect(),
            rows: triangle.rows,
        });
        for k in 0..candidates.len() {
            small.add(k).map_err(|dependent| Dependent {
                candidates: dependent.candidates.iter().map(|k| candidates[*k]).collect(),
                ..dependent
            })?;
        }
        Ok(small)
    }

    /// The chosen candidates, in the order in which they were added.
    #[must_use]
    pub fn chosen(&self) -> &[usize] {
        &self.chosen
    }

    /// Adds a candidate.
    ///
    /// # Errors
    /// If it is linearly dependent on the chosen ones. The problem is then unchanged.
    pub fn add(&mut self, candidate: usize) -> Result<(), Dependent> {
        let k = self.chosen.len();
        self.own_part(candidate)?;
        let mut column = self.columns[candidate].clone();
        let reflection = Reflection::of(&mut column, k);
        self.chosen.push(candidate);
        if let Some(reflection) = reflection {
            for (other, entry) in self.columns.iter_mut().enumerate() {
                // Chosen columns are zero from row k on, except for this one.
                if !self.chosen.contains(&other) {
                    reflection.apply(entry);
                }
            }
        }
        self.columns[candidate] = column;
        self.judge_without(candidate, k);
        Ok(())
    }

    /// Subtracts a newly chosen candidate from all other columns of the judge's rows, with the coefficients of the fitted rows.
    fn judge_without(&mut self, candidate: usize, k: usize) {
        if self.judging.is_empty() {
            return;
        }
        let own = std::mem::take(&mut self.judging[candidate]);
        let diagonal = self.columns[candidate][k];
        for (other, column) in self.judging.iter_mut().enumerate() {
            if !self.chosen.contains(&other) {
                let share = self.columns[other][k] / diagonal;
                for (entry, x) in column.iter_mut().zip(&own) {
                    *entry -= share * *x;
                }
            }
        }
    }

    /// The sum of squares of the component of a candidate that is orthogonal to the chosen ones.
    pub(crate) fn own_square(&self, candidate: usize) -> Dd {
        self.columns[candidate].iter().skip(self.chosen.len()).map(|x| *x * *x).sum()
    }

    /// The norm of the component of a candidate that is orthogonal to the chosen ones. There are never more chosen ones than rows.
    fn own_part(&self, candidate: usize) -> Result<Dd, Dependent> {
        let k = self.chosen.len();
        let column = &self.columns[candidate];
        let own = column[k..].iter().map(|x| *x * *x).sum::<Dd>().sqrt();
        let norm = self.norms[candidate];
        if own.to_f64() > DEPENDENT * norm {
            return Ok(own);
        }
        // The candidate as a combination of the chosen ones: R w = column. Those with a share above the square root of the threshold count as
        // involved.
        let mut weights: Vec<Dd> = column[..k].to_vec();
        self.back_substitute(&mut weights);
        let share = |(weight, chosen): &(&Dd, &usize)| weight.to_f64().abs() * self.norms[**chosen] > DEPENDENT.sqrt() * norm;
        let mut candidates: Vec<usize> = weights.iter().zip(&self.chosen).filter(share).map(|(_, chosen)| *chosen).collect();
        candidates.push(candidate);
        let condition = if own.to_f64() > 0.0 { norm / own.to_f64() } else { f64::INFINITY };
        Err(Dependent { condition, candidates })
    }

    /// Solves R x = b in place.
    fn back_substitute(&self, b: &mut [Dd]) {
        for row in (0..b.len()).rev() {
            let column = &self.columns[self.chosen[row]];
            b[row] = b[row] / column[row];
            let (above, from) = b.split_at_mut(row);
            for (entry, value) in above.iter_mut().zip(column) {
                *entry -= from[0] * *value;
            }
        }
    }

    /// Solves R'x = b in place.
    fn forward_substitute(&self, b: &mut [Dd]) {
        for row in 0..b.len() {
            let column = &self.columns[self.chosen[row]];
            let known: Dd = b[..row].iter().zip(column).map(|(x, r)| *x * *r).sum();
            b[row] = (b[row] - known) / column[row];
        }
    }

    /// The norm of a chosen candidate's column, by its index among the chosen ones.
    #[must_use]
    pub fn norm(&self, place: usize) -> f64 {
        self.norms[self.chosen[place]]
    }

    /// The coefficients of the chosen candidates.
    #[must_use]
    pub fn coefficients(&self) -> Vec<Dd> {
        let mut b = self.columns[self.columns.len() - 1][..self.chosen.len()].to_vec();
        self.back_substitute(&mut b);
        b
    }

    /// R^-T x for the row x of a linear function of the coefficients.
    #[must_use]
    pub fn projected(&self, mut row: Vec<Dd>) -> Vec<Dd> {
        self.forward_substitute(&mut row);
        row
    }

    /// The b with R b = c.
    #[must_use]
    pub(crate) fn coefficients_of(&self, mut c: Vec<Dd>) -> Vec<Dd> {
        self.back_substitute(&mut c);
        c
    }

    /// The residual sum of squares.
    #[must_use]
    pub(crate) fn residual_square(&self) -> Dd {
        let response = &self.columns[self.columns.len() - 1];
        response[self.chosen.len()..].iter().map(|x| *x * *x).sum()
    }

    /// The diagonal of (X'X)^-1.
    #[must_use]
    pub fn variances(&self) -> Vec<Dd> {
        let width = self.chosen.len();
        // Row i of R^-1 solves R'z = e_i for the whole row at once: (X'X)^-1 = R^-1 R^-T.
        let mut variances = vec![Dd::ZERO; width];
        for k in 0..width {
            let mut unit = vec![Dd::ZERO; width];
            unit[k] = Dd::ONE;
            self.back_substitute(&mut unit);
            for (variance, entry) in variances.iter_mut().zip(&unit) {
                *variance += *entry * *entry;
            }
        }
        variances
    }

    /// The leverages of rows of the chosen candidates, one in each lane. `row` is replaced.
    pub(crate) fn leverages(&self, row: &mut [Lanes]) -> Lanes {
        widest(Projected(self, row));
        lanes::value(row, row)
    }

    /// (X'X)^-1 x in each lane, in place: the effect of a row on the coefficients.
    pub(crate) fn effects(&self, row: &mut [Lanes]) {
        widest(Projected(self, row));
        for place in (0..row.len()).rev() {
            let column = &self.columns[self.chosen[place]];
            let (above, from) = row.split_at_mut(place);
            from[0] = from[0].div(Lanes::splat(column[place]));
            for (entry, value) in above.iter_mut().zip(column) {
                *entry = entry.sub(from[0].mul(Lanes::splat(*value)));
            }
        }
    }

    /// The leverage of a row of the chosen candidates, x (X'X)^-1 x'.
    #[must_use]
    pub fn leverage(&self, row: &[Dd]) -> Dd {
        let mut z = row.to_vec();
        self.forward_substitute(&mut z);
        z.iter().map(|x| *x * *x).sum()
    }
}

/// R^-T x in each lane, in place: the steps of `forward_substitute`.
struct Projected<'a>(&'a Growing, &'a mut [Lanes]);

impl Work for Projected<'_> {
    type Found = ();

    #[inline(always)]
    fn compute<const FUSED: bool>(self) {
        let Projected(solved, row) = self;
        for place in 0..row.len() {
            let column = &solved.columns[solved.chosen[place]];
            let (before, from) = row.split_at_mut(place);
            let mut known = Lanes::ZERO;
            for (x, r) in before.iter().zip(column) {
                known = known.add(x.times::<FUSED>(Lanes::splat(*r)));
            }
            from[0] = from[0].sub(known).div(Lanes::splat(column[place]));
        }
    }
}

#[cfg(test)]
mod tests;

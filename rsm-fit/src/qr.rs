//! Least squares by Householder reflections in double-double arithmetic, on a model that may grow.
//!
//! In: rows of a design matrix with the response behind them. Out: coefficients, the triangular factor, the residual sum of
//! squares. [`Compressed`] takes any number of rows and keeps a triangle: an orthogonal transformation of all candidate columns
//! and of the response, which has the same least-squares solution for every choice of columns. [`Growing`] solves on that
//! triangle and appends a column at the cost of one reflection. A column that is a linear combination of the others (to within
//! the rounding of the data) is refused by name, never solved silently.
//!
//! Source: Golub, Van Loan, Matrix Computations, 5.2 (Householder QR) and 6.5 (updating); Lawson, Hanson, Solving Least Squares
//! Problems, chapter 27 (sequential accumulation).

use crate::dd::Dd;

/// A column is refused when the part of it that the other columns do not make up is below this share of it. Data are rounded to
/// f64, each value wrong by up to 2^-53 of itself; 2^-46 leaves a factor 128 for sums of several such columns. Filip, the worst
/// of NIST's sets, is at 2^-31.
pub(crate) const DEPENDENT: f64 = 1.0 / (1u64 << 46) as f64;

/// Rows that are reduced together. Larger blocks cost memory, smaller ones repeat the work on the triangle.
const BLOCK: usize = 512;

/// A matrix by columns.
type Columns = Vec<Vec<Dd>>;

/// The triangle of a tall matrix: the candidates and, last, the response.
#[derive(Debug, Clone)]
pub struct Compressed {
    columns: Columns,
    rows: usize,
}

impl Compressed {
    /// No rows yet; `width` counts the response.
    #[must_use]
    pub fn new(width: usize) -> Self {
        Compressed { columns: vec![Vec::new(); width], rows: 0 }
    }

    /// Takes a row in: the terms, then the response.
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
        if height >= width + BLOCK.max(width) {
            self.reduce();
        }
    }

    /// How many rows were taken in.
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

    /// The triangle, as columns of at most as many rows as there are columns.
    #[must_use]
    pub fn finish(mut self) -> Triangle {
        // Fewer rows than columns are small already.
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
    /// The triangle of the rows of several, which have the same candidates.
    ///
    /// # Panics
    /// When there is none.
    #[must_use]
    pub fn stacked(parts: &[&Triangle]) -> Self {
        let mut columns = parts.first().expect("a triangle to stack").columns.clone();
        for part in &parts[1..] {
            for (column, more) in columns.iter_mut().zip(&part.columns) {
                column.extend(more);
            }
        }
        Compressed { columns, rows: parts.iter().map(|part| part.rows).sum() }.finish()
    }

    /// How many rows went in.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// How many candidates there are.
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

/// I - 2 v v'/(v'v), which turns the tail of one column into a single number.
struct Reflection {
    from: usize,
    v: Vec<Dd>,
    scale: Dd,
}

impl Reflection {
    /// The reflection for a column from a row on; the column becomes its result. `None` when there is nothing to turn.
    fn of(column: &mut [Dd], from: usize) -> Option<Self> {
        let tail = column.get_mut(from..)?;
        let below: Dd = tail.iter().skip(1).map(|x| *x * *x).sum();
        if below == Dd::ZERO {
            return None;
        }
        let norm = (tail[0] * tail[0] + below).sqrt();
        // The sign that adds, so that nothing cancels.
        // mutant `> to >=`: nothing is added to 0, so either sign does.
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

/// The columns that make one column up.
#[derive(Debug, Clone, PartialEq)]
pub struct Dependent {
    /// How much larger the column is than the part of it that is its own; infinite when nothing is.
    pub condition: f64,
    /// The candidates involved, the refused one last.
    pub candidates: Vec<usize>,
}

/// A least-squares problem that grows by a column at a time.
#[derive(Debug, Clone)]
pub struct Growing {
    /// Transformed candidates and, last, the response.
    columns: Columns,
    norms: Vec<f64>,
    chosen: Vec<usize>,
    /// Rows that judge and are not fitted, column by column: what the chosen candidates leave of each. Empty where nobody judges.
    judging: Columns,
}

impl Growing {
    /// Nothing chosen yet.
    #[must_use]
    pub fn new(triangle: &Triangle) -> Self {
        let norm = |column: &Vec<Dd>| column.iter().map(|x| *x * *x).sum::<Dd>().sqrt().to_f64();
        let norms = triangle.columns.iter().map(norm).collect();
        Growing { columns: triangle.columns.clone(), norms, chosen: Vec::new(), judging: Vec::new() }
    }

    /// Nothing chosen yet, with other rows that judge each choice: [`Growing::judged`] costs no solution then. Both triangles have
    /// the same candidates.
    #[must_use]
    pub fn judged_by(fit: &Triangle, judge: &Triangle) -> Self {
        Growing { judging: judge.columns.clone(), ..Growing::new(fit) }
    }

    /// The sum of squares that the chosen candidates leave on the rows that judge.
    #[must_use]
    pub fn judged(&self) -> Dd {
        self.judging.last().map_or(Dd::ZERO, |response| response.iter().map(|x| *x * *x).sum())
    }

    /// What a candidate more would do: how much it takes from the residual sum of squares of the fitted rows, and what would be
    /// left on the rows that judge. `None` if it is linearly dependent on the chosen ones.
    #[must_use]
    pub fn ahead(&self, candidate: usize) -> Option<(Dd, Dd)> {
        let (own, last) = self.last_with(candidate)?;
        let left = match (self.judging.get(candidate), self.judging.last()) {
            (Some(column), Some(response)) => {
                response.iter().zip(column).map(|(y, x)| *y - last * *x).map(|error| error * error).sum()
            }
            _ => Dd::ZERO,
        };
        Some((last * last * own * own, left))
    }

    /// The norm of a candidate's own part, and the coefficient that it would get.
    fn last_with(&self, candidate: usize) -> Option<(Dd, Dd)> {
        let k = self.chosen.len();
        let own = self.own_part(candidate).ok()?;
        let (column, response) = (&self.columns[candidate], &self.columns[self.columns.len() - 1]);
        let product: Dd = column[k..].iter().zip(&response[k..]).map(|(x, y)| *x * *y).sum();
        Some((own, product / (own * own)))
    }

    /// A problem of some candidates alone: cheaper than one that carries all of them along.
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

    /// The chosen candidates, in the order in which they came.
    #[must_use]
    pub fn chosen(&self) -> &[usize] {
        &self.chosen
    }

    /// Appends a candidate.
    ///
    /// # Errors
    /// If it is linearly dependent on the chosen ones; nothing is changed then.
    pub fn add(&mut self, candidate: usize) -> Result<(), Dependent> {
        let k = self.chosen.len();
        self.own_part(candidate)?;
        let mut column = self.columns[candidate].clone();
        let reflection = Reflection::of(&mut column, k);
        self.chosen.push(candidate);
        if let Some(reflection) = reflection {
            for (other, entry) in self.columns.iter_mut().enumerate() {
                // Chosen columns are zero from row k on, except this one.
                if !self.chosen.contains(&other) {
                    reflection.apply(entry);
                }
            }
        }
        self.columns[candidate] = column;
        self.judge_without(candidate, k);
        Ok(())
    }

    /// Takes the part of a newly chosen candidate out of all other columns of the rows that judge, as the fitted rows have it.
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

    /// The norm of the part of a candidate that is orthogonal to the chosen ones. There are never more chosen ones than rows.
    fn own_part(&self, candidate: usize) -> Result<Dd, Dependent> {
        let k = self.chosen.len();
        let column = &self.columns[candidate];
        let own = column[k..].iter().map(|x| *x * *x).sum::<Dd>().sqrt();
        let norm = self.norms[candidate];
        if own.to_f64() > DEPENDENT * norm {
            return Ok(own);
        }
        // The candidate as a combination of the chosen ones: R w = column. Those with a share above the threshold's root count as involved.
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

    /// The norm of a chosen candidate's column, by its place among the chosen.
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

    /// R^-T x: the row of a linear function of the coefficients, seen from R b.
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

    /// The leverage of a row of the chosen candidates, x (X'X)^-1 x'.
    #[must_use]
    pub fn leverage(&self, row: &[Dd]) -> Dd {
        let mut z = row.to_vec();
        self.forward_substitute(&mut z);
        z.iter().map(|x| *x * *x).sum()
    }
}

#[cfg(test)]
mod tests;

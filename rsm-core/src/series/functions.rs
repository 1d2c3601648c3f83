//! Recurrences of elementary functions.
//!
//! In: the coefficients of the arguments up to an order, and those of the function below it. Out: that of the function. Each recurrence follows from
//! the differential equation of the function (A. Griewank, A. Walther, "Evaluating Derivatives", 2008, table 13.2). For w = exp u, for example, w' =
//! w u' gives k w_k = sum over j from 1 of j u_j w_(k-j).

use crate::elementary::{self, Computed, Function};
use crate::number::{Precision, integer};
use crate::tape::Reg;

use super::{Value, Writing};

impl Writing<'_> {
    /// Order 0 of the helpers of a function's recurrence.
    pub(super) fn first_helpers(&mut self, row: &Computed) {
        let Some(x) = self.get(row.arguments[0].0, 0) else { return };
        let Some(w) = self.get(row.result.0, 0) else { return };
        let other = match row.function {
            Function::Sin => Some(Function::Cos),
            Function::Cos => Some(Function::Sin),
            Function::Sinh => Some(Function::Cosh),
            Function::Cosh => Some(Function::Sinh),
            _ => None,
        };
        let one = self.builder.constant(integer(1));
        let found = match row.function {
            _ if other.is_some() => other.map(|other| elementary::write(&mut self.builder, other, &[x])),
            Function::Tan | Function::Atan => {
                // 1 + w^2, 1 + u^2
                let of = if row.function == Function::Tan { w } else { x };
                let square = self.builder.multiply(of, of);
                Some(self.builder.add(one, square))
            }
            Function::Tanh | Function::Asin | Function::Acos => {
                // (1 - w) (1 + w), and the root of (1 - u) (1 + u)
                let of = if row.function == Function::Tanh { w } else { x };
                let (below, above) = (self.builder.subtract(one, of), self.builder.add(one, of));
                let product = self.builder.multiply(below, above);
                let is_tanh = row.function == Function::Tanh;
                Some(if is_tanh { product } else { elementary::write(&mut self.builder, Function::Sqrt, &[product]) })
            }
            Function::Atan2 => {
                let Some(second) = self.get(row.arguments[1].0, 0) else { return };
                let (a, b) = (self.builder.multiply(second, second), self.builder.multiply(x, x));
                Some(self.builder.add(a, b))
            }
            _ => None,
        };
        if found.is_some() {
            let helper = self.series.helper(row.result, "beside");
            self.set(helper, 0, found);
        }
    }

    /// The coefficient k of a function, for k of at least 1.
    pub(super) fn function(&mut self, row: &Computed, k: usize) -> Option<Reg> {
        let (u, w) = (row.arguments[0].0, row.result.0);
        if row.function == Function::Floor {
            return None;
        }
        match row.function {
            Function::Floor => None,
            Function::Exp => {
                let sum = self.weighted(u, w, k, k);
                self.times(sum, 1.0 / k as f64)
            }
            Function::Log | Function::Log10 => {
                // u w' = u', of log10 u'/log 10
                let taken = self.weighted(w, u, k - 1, k);
                let taken = self.times(taken, 1.0 / k as f64);
                let of_u = self.get(u, k);
                let scale = Precision::F64.round(&elementary::inverse_log_of_ten());
                let of_u = if row.function == Function::Log { of_u } else { self.times(of_u, scale) };
                let numerator = self.difference(of_u, taken)?;
                let divisor = self.get(u, 0)?;
                Some(self.builder.divide(numerator, divisor))
            }
            Function::Sqrt => self.root(u, w, k),
            Function::Sin | Function::Cos | Function::Sinh | Function::Cosh => {
                let beside = self.series.helper(row.result, "beside");
                let (own, other) = (self.weighted(u, beside, k, k), self.weighted(u, w, k, k));
                let (own, other) = (self.times(own, 1.0 / k as f64), self.times(other, 1.0 / k as f64));
                let (own, other) = match row.function {
                    Function::Sin => (own, self.difference(None, other)),
                    Function::Cos => (self.difference(None, own), other),
                    _ => (own, other),
                };
                self.set(beside, k, other);
                own
            }
            Function::Tan | Function::Tanh => {
                let beside = self.series.helper(row.result, "beside");
                let sum = self.weighted(u, beside, k, k);
                let own = self.times(sum, 1.0 / k as f64);
                // The square needs this order of the function itself.
                self.set(w, k, own);
                let square = self.product(w, w, k);
                let square = if row.function == Function::Tan { square } else { self.difference(None, square) };
                self.set(beside, k, square);
                own
            }
            Function::Atan | Function::Asin | Function::Acos => {
                let beside = self.series.helper(row.result, "beside");
                let square = self.product(u, u, k);
                let slope = if row.function == Function::Atan {
                    square
                } else {
                    let argument = self.difference(None, square);
                    self.root_of(argument, beside, k)
                };
                self.set(beside, k, slope);
                let of_u = self.get(u, k);
                let of_u = if row.function == Function::Acos { self.difference(None, of_u) } else { of_u };
                self.quotient(of_u, w, beside, k)
            }
            Function::Atan2 => {
                // of (y, x): (x^2 + y^2) w' = x y' - y x'
                let (y, x) = (u, row.arguments[1].0);
                let beside = self.series.helper(row.result, "beside");
                let (of_x, of_y) = (self.product(x, x, k), self.product(y, y, k));
                let square = self.sum(of_x, of_y);
                self.set(beside, k, square);
                let (left, right) = (self.weighted(y, x, k, k), self.weighted(x, y, k, k));
                let numerator = self.difference(left, right);
                let numerator = self.times(numerator, 1.0 / k as f64);
                self.quotient(numerator, w, beside, k)
            }
        }
    }

    /// The sum over j from 1 to an end of j a_j b_(k-j), the newest coefficients last.
    fn weighted(&mut self, a: Value, b: Value, end: usize, k: usize) -> Option<Reg> {
        let mut sum = None;
        for j in 1..=end {
            let weighted = self.get(a, j);
            let weighted = self.times(weighted, j as f64);
            let term = match (weighted, self.get(b, k - j)) {
                (Some(a), Some(b)) => Some(self.builder.multiply(a, b)),
                _ => None,
            };
            sum = self.sum(sum, term);
        }
        sum
    }

    /// w_k of q w' = n: (n_k - (sum over j below k of j w_j q_(k-j))/k)/q_0, where n_k is the coefficient of the integral of n.
    fn quotient(&mut self, numerator: Option<Reg>, w: Value, q: Value, k: usize) -> Option<Reg> {
        let taken = self.weighted(w, q, k - 1, k);
        let taken = self.times(taken, 1.0 / k as f64);
        let numerator = self.difference(numerator, taken)?;
        let divisor = self.get(q, 0)?;
        Some(self.builder.divide(numerator, divisor))
    }

    /// w_k of w^2 = u.
    fn root(&mut self, u: Value, w: Value, k: usize) -> Option<Reg> {
        let of_u = self.get(u, k);
        self.root_of(of_u, w, k)
    }

    fn root_of(&mut self, of_u: Option<Reg>, w: Value, k: usize) -> Option<Reg> {
        let taken = self.products(w, w, 1, k - 1, k);
        let numerator = self.difference(of_u, taken)?;
        let first = self.get(w, 0)?;
        let divisor = self.builder.times(first, integer(2));
        Some(self.builder.divide(numerator, divisor))
    }
}

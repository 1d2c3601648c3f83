//! Functions of small matrices for steps that solve what is linear exactly.
//!
//! In: a matrix A and a span H. Out: [`Chain`]: the functions phi_1, phi_2, phi_3 of A H/2^k for k = 0, 1, 2, ..., where phi_0(z) = e^z and phi_k+1(z) = (phi_k(z) - 1/k!)/z. By scaling and doubling (B. V. Minchev, W. M. Wright,
//! "A review of exponential integrators for first order semi-linear problems", 2005, section 7): the halves come for nothing on the way. Never inverts a matrix, so that of a free body is no special case. No
//! memory is asked for once the lists have their length.

/// The norm of A h below which the series are summed.
const SMALL: f64 = 0.5;

/// Terms of phi_3: 0.5^15/(18!/3!) is 3e-20 of the first. Four powers of four blocks of four (M. S. Paterson, L. J. Stockmeyer, 1973).
const TERMS: usize = 16;

/// Doublings at most: a norm beyond has no meaning in f64.
const MOST: usize = 60;

/// Numbers a row, so that rows are filled up with zeros to whole registers.
pub(super) fn stride(n: usize) -> usize {
    n.div_ceil(4) * 4
}

/// The functions of a matrix over a span and its halves.
#[derive(Debug, Clone, Default)]
pub(super) struct Chain {
    n: usize,
    /// By level phi_1, phi_2, phi_3, each row by row.
    values: Vec<f64>,
    levels: usize,
    work: Vec<f64>,
}

impl Chain {
    /// The levels: from the whole span on to where the norm is small.
    pub(super) fn levels(&self) -> usize {
        self.levels
    }

    fn size(&self) -> usize {
        self.n * stride(self.n)
    }

    /// phi_1, phi_2, phi_3 of A H/2^level, row by row with [`stride`] numbers a row.
    pub(super) fn at(&self, level: usize) -> [&[f64]; 3] {
        let size = self.size();
        let all = &self.values[3 * level * size..3 * (level + 1) * size];
        [&all[..size], &all[size..2 * size], &all[2 * size..]]
    }

    /// Takes another matrix, row by row without filling; at least so many levels. `false` where it is too large or no number.
    pub(super) fn take(&mut self, n: usize, a: &[f64], span: f64, levels: usize) -> bool {
        let (size, row) = (n * stride(n), stride(n));
        // Room for z, its powers, e^z and two products, and the scales of the states. What fills rows up stays 0.
        if self.n != n {
            self.n = n;
            self.work.clear();
            self.work.resize(7 * size + n, 0.0);
        }
        let (scales, work) = self.work.split_at_mut(n);
        let (z, rest) = work.split_at_mut(size);
        for i in 0..n {
            for j in 0..n {
                z[i * row + j] = a[i * n + j] * span;
            }
        }
        balance(n, z, scales);
        let norm = (0..n).map(|i| z[i * row..i * row + n].iter().map(|it| it.abs()).sum()).fold(0.0, f64::max);
        if !f64::is_finite(norm) {
            return false;
        }
        let mut doublings = 0;
        let mut share = 1.0;
        while norm * share > SMALL {
            share *= 0.5;
            doublings += 1;
            if doublings > MOST {
                return false;
            }
        }
        while doublings + 1 < levels {
            share *= 0.5;
            doublings += 1;
        }
        self.levels = doublings + 1;
        z.iter_mut().for_each(|it| *it *= share);
        self.values.resize(3 * self.levels * size, 0.0);
        let Chain { values, .. } = self;
        let last = &mut values[3 * doublings * size..];
        let (one, other) = last.split_at_mut(size);
        let (two, three) = other.split_at_mut(size);
        let (z2, rest) = rest.split_at_mut(size);
        let (z3, rest) = rest.split_at_mut(size);
        let (z4, rest) = rest.split_at_mut(size);
        let (zero, rest) = rest.split_at_mut(size);
        let spare = &mut rest[..size];
        product(n, z2, z, z);
        product(n, z3, z2, z);
        product(n, z4, z2, z2);
        // 1/(k + 3)! for k from 0 on.
        let mut weights = [0.0; TERMS];
        let mut factorial = 2.0;
        for (k, weight) in weights.iter_mut().enumerate() {
            factorial *= (k + 3) as f64;
            *weight = 1.0 / factorial;
        }
        three.fill(0.0);
        for block in (0..TERMS / 4).rev() {
            if block + 1 < TERMS / 4 {
                product(n, spare, three, z4);
            } else {
                spare.fill(0.0);
            }
            let [w0, w1, w2, w3] = std::array::from_fn(|k| weights[4 * block + k]);
            for k in 0..size {
                three[k] = spare[k] + w1 * z[k] + w2 * z2[k] + w3 * z3[k];
            }
            diagonal(n, three, w0);
        }
        product(n, two, z, three);
        diagonal(n, two, 0.5);
        product(n, one, z, two);
        diagonal(n, one, 1.0);
        product(n, zero, z, one);
        diagonal(n, zero, 1.0);
        for k in (0..doublings).rev() {
            let (before, behind) = values.split_at_mut(3 * (k + 1) * size);
            let next = &mut before[3 * k * size..];
            let (one, other) = behind[..3 * size].split_at(size);
            let (two, three) = other.split_at(size);
            let (next_one, other) = next.split_at_mut(size);
            let (next_two, next_three) = other.split_at_mut(size);
            // phi_1(2z) = (e^z + 1) phi_1/2, phi_2(2z) = (phi_1^2 + 2 phi_2)/4, phi_3(2z) = (phi_1 phi_2 + phi_2 + 2 phi_3)/8
            product(n, next_one, zero, one);
            product(n, next_two, one, one);
            product(n, next_three, one, two);
            for k in 0..size {
                next_one[k] = 0.5 * (next_one[k] + one[k]);
                next_two[k] = 0.25 * (next_two[k] + 2.0 * two[k]);
                next_three[k] = 0.125 * (next_three[k] + two[k] + 2.0 * three[k]);
            }
            if k > 0 {
                product(n, spare, zero, zero);
                zero.copy_from_slice(spare);
            }
        }
        // Back from balanced states: scales are powers of two.
        if scales.iter().any(|it| *it != 1.0) {
            for i in 0..n {
                for j in 0..n {
                    spare[i * row + j] = scales[i] / scales[j];
                }
            }
            for matrix in values.chunks_exact_mut(size) {
                matrix.iter_mut().zip(&*spare).for_each(|(it, scale)| *it *= scale);
            }
        }
        values.iter().all(|it| it.is_finite())
    }
}

/// Scales states by powers of two so that rows and columns of a matrix are of one size (B. N. Parlett, C. Reinsch, "Balancing a matrix for calculation of eigenvalues and eigenvectors", 1969): fewer doublings.
fn balance(n: usize, a: &mut [f64], scales: &mut [f64]) {
    let stride = stride(n);
    scales.fill(1.0);
    for _ in 0..20 {
        let mut moved = false;
        for i in 0..n {
            let (mut row, mut column) = (0.0, 0.0);
            for j in (0..n).filter(|j| *j != i) {
                row += a[i * stride + j].abs();
                column += a[j * stride + i].abs();
            }
            if !(row > 0.0 && column > 0.0 && row.is_finite() && column.is_finite()) {
                continue;
            }
            let (sum, mut factor) = (row + column, 1.0);
            let (mut r, mut c) = (row, column);
            while c < 0.5 * r {
                (factor, c, r) = (2.0 * factor, 2.0 * c, 0.5 * r);
            }
            while c > 2.0 * r {
                (factor, c, r) = (0.5 * factor, 0.5 * c, 2.0 * r);
            }
            if c + r < 0.95 * sum {
                moved = true;
                scales[i] *= factor;
                for j in 0..n {
                    a[i * stride + j] *= 1.0 / factor;
                }
                for j in 0..n {
                    a[j * stride + i] *= factor;
                }
            }
        }
        if !moved {
            return;
        }
    }
}

fn diagonal(n: usize, matrix: &mut [f64], value: f64) {
    let stride = stride(n);
    (0..n).for_each(|k| matrix[k * stride + k] += value);
}

fn product(n: usize, to: &mut [f64], a: &[f64], b: &[f64]) {
    match stride(n) {
        4 => product_of::<4>(n, to, a, b),
        8 => product_of::<8>(n, to, a, b),
        12 => product_of::<12>(n, to, a, b),
        16 => product_of::<16>(n, to, a, b),
        20 => product_of::<20>(n, to, a, b),
        _ => product_of::<24>(n, to, a, b),
    }
}

fn product_of<const S: usize>(n: usize, to: &mut [f64], a: &[f64], b: &[f64]) {
    let (a, _) = a.as_chunks::<S>();
    let (b, _) = b.as_chunks::<S>();
    let (to, _) = to.as_chunks_mut::<S>();
    for (to, a) in to.iter_mut().zip(a) {
        let mut sum = [0.0; S];
        for (factor, row) in a[..n].iter().zip(b) {
            for (sum, value) in sum.iter_mut().zip(row) {
                *sum += factor * value;
            }
        }
        *to = sum;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// phi_1 to phi_3 of a number, from their definition: no digits are lost for numbers of the size of 1 and more.
    fn plain(z: f64) -> [f64; 3] {
        let one = (z.exp() - 1.0) / z;
        let two = (one - 1.0) / z;
        [one, two, (two - 0.5) / z]
    }

    #[test]
    fn a_triangular_matrix_by_its_eigenvectors() {
        // A = [-2 3; 0 -800] has the eigenvectors (1, 0) and (3, -798): f(A)(3, -798) = f(-800)(3, -798), so the corner is 3 (f(-2) - f(-800))/798.
        let mut chain = Chain::default();
        assert!(chain.take(2, &[-2.0, 3.0, 0.0, -800.0], 1.0, 1));
        assert!(chain.levels() > 10, "{}", chain.levels());
        for level in 0..4 {
            let h = 0.5_f64.powi(level as i32);
            let (slow, fast) = (plain(-2.0 * h), plain(-800.0 * h));
            for (k, matrix) in chain.at(level).into_iter().enumerate() {
                let corner = 3.0 * (slow[k] - fast[k]) / 798.0;
                // Eleven doublings of numbers near 1, and the digits that the definition itself loses at -0.25.
                for (found, expected) in [(matrix[0], slow[k]), (matrix[5], fast[k]), (matrix[1], corner), (matrix[4], 0.0)] {
                    assert!((found - expected).abs() < 1e-12, "level {level}, phi_{}: {found} for {expected}", k + 1);
                }
            }
        }
    }

    #[test]
    fn states_of_other_units_have_the_same_functions() {
        // The same matrix with its second state in thousandths: entries off the diagonal by 1000 and by 1/1000.
        let (mut plain, mut scaled) = (Chain::default(), Chain::default());
        assert!(plain.take(2, &[-3.0, 4.0, -5.0, -60.0], 0.7, 1) && scaled.take(2, &[-3.0, 4e-3, -5e3, -60.0], 0.7, 1));
        for (one, other) in plain.at(0).into_iter().zip(scaled.at(0)) {
            for (place, factor) in [(0, 1.0), (1, 1e-3), (4, 1e3), (5, 1.0)] {
                // Eight doublings.
                assert!((one[place] * factor - other[place]).abs() <= 1e-13 * factor, "{place}");
            }
        }
    }

    #[test]
    fn of_nothing_they_are_the_first_terms_and_of_no_number_nothing() {
        let mut chain = Chain::default();
        assert!(chain.take(3, &[0.0; 9], 0.1, 2));
        assert_eq!(chain.at(1).map(|it| it[5]), [1.0, 0.5, 1.0 / 6.0]);
        assert!(!chain.take(1, &[f64::NAN], 0.1, 2) && !chain.take(1, &[1e300], 1e10, 2));
    }
}

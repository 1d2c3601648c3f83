//! Small dense symmetric matrices, row by row in one slice.
//!
//! In: a matrix of `n` rows. Out: its Cholesky factor, its inverse, products. Simple loops in a fixed order give the same bits on every machine. A
//! library that selects its kernel by processor does not, and a design must be the same everywhere.

/// A pivot below this share of its diagonal is rounding error: the products have errors of about 1e-14.
const LEAST_PIVOT: f64 = 1e-12;

/// The lower factor L with L L' = A; `None` if A is not positive definite, up to rounding.
pub(super) fn cholesky(a: &[f64], n: usize) -> Option<Vec<f64>> {
    let mut l = a.to_vec();
    for j in 0..n {
        for k in 0..j {
            let factor = l[j * n + k];
            l[j * n + j] -= factor * factor;
        }
        let pivot = l[j * n + j];
        if pivot.is_nan() || pivot <= LEAST_PIVOT * a[j * n + j] {
            return None;
        }
        let root = pivot.sqrt();
        l[j * n + j] = root;
        for i in j + 1..n {
            let (above, below) = l.split_at_mut(i * n);
            let mut sum = below[j];
            for k in 0..j {
                sum -= below[k] * above[j * n + k];
            }
            below[j] = sum / root;
        }
    }
    for i in 0..n {
        l[i * n + i + 1..(i + 1) * n].fill(0.0);
    }
    Some(l)
}

/// The inverse of L L'.
pub(super) fn inverse(l: &[f64], n: usize) -> Vec<f64> {
    // The inverse of L, multiplied by its transpose from the left.
    let mut k = vec![0.0; n * n];
    for j in 0..n {
        k[j * n + j] = 1.0 / l[j * n + j];
        for i in j + 1..n {
            let mut sum = 0.0;
            for m in j..i {
                sum -= l[i * n + m] * k[m * n + j];
            }
            k[i * n + j] = sum / l[i * n + i];
        }
    }
    let mut a = vec![0.0; n * n];
    for m in 0..n {
        for i in 0..=m {
            let factor = k[m * n + i];
            for j in 0..=m {
                a[i * n + j] += factor * k[m * n + j];
            }
        }
    }
    a
}

/// A v.
pub(super) fn times(a: &[f64], v: &[f64]) -> Vec<f64> {
    a.chunks_exact(v.len()).map(|row| dot(row, v)).collect()
}

/// v . w.
pub(in crate::plan) fn dot(v: &[f64], w: &[f64]) -> f64 {
    v.iter().zip(w).map(|(v, w)| v * w).sum()
}

/// A += factor v v'.
pub(super) fn add_square(a: &mut [f64], factor: f64, v: &[f64]) {
    for (row, x) in a.chunks_exact_mut(v.len()).zip(v) {
        let scaled = factor * x;
        for (cell, y) in row.iter_mut().zip(v) {
            *cell += scaled * y;
        }
    }
}

/// A B.
pub(super) fn product(a: &[f64], b: &[f64], n: usize) -> Vec<f64> {
    let mut c = vec![0.0; n * n];
    for i in 0..n {
        for k in 0..n {
            let factor = a[i * n + k];
            if factor != 0.0 {
                for j in 0..n {
                    c[i * n + j] += factor * b[k * n + j];
                }
            }
        }
    }
    c
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_inverse_times_its_matrix_is_one_and_what_is_singular_has_none() {
        let a = [4.0, 2.0, 1.0, 2.0, 5.0, 3.0, 1.0, 3.0, 6.0];
        let l = cholesky(&a, 3).unwrap();
        let one = product(&inverse(&l, 3), &a, 3);
        for (k, value) in one.iter().enumerate() {
            // Entries of the size of 1 and a condition of 10: some 1e-15.
            assert!((value - f64::from(u8::from(k % 4 == 0))).abs() < 1e-14, "{one:?}");
        }
        assert!(cholesky(&[1.0, 2.0, 2.0, 4.0], 2).is_none());
        assert!(cholesky(&[f64::NAN], 1).is_none());
        let mut b = vec![0.0; 4];
        add_square(&mut b, 2.0, &[1.0, 3.0]);
        assert_eq!((b.as_slice(), times(&b, &[1.0, 0.0])), ([2.0, 6.0, 6.0, 18.0].as_slice(), vec![2.0, 6.0]));
    }
}

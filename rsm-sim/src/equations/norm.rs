//! The norm of a small matrix, which determines the number of doublings of its functions ([`super::phi`]).
//!
//! In: a matrix, column by column. Out: the same with balanced states; its largest sum of a row.

/// Scales the states by powers of two so that rows and columns of the matrix have about the same size, which reduces the number of doublings (B. N.
/// Parlett, C. Reinsch, "Balancing a matrix for calculation of eigenvalues and eigenvectors", 1969).
#[inline(always)]
pub(super) fn balance<const S: usize>(a: &mut [[f64; S]]) {
    let n = a.len();
    for _ in 0..20 {
        let mut moved = false;
        for i in 0..n {
            let (mut row, mut column) = (0.0, 0.0);
            for (j, other) in a.iter().enumerate().filter(|it| it.0 != i) {
                row += other[i].abs();
                column += a[i][j].abs();
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
                let inverse = 1.0 / factor;
                a.iter_mut().for_each(|column| column[i] *= inverse);
                a[i].iter_mut().for_each(|it| *it *= factor);
            }
        }
        if !moved {
            return;
        }
    }
}

/// The largest sum of magnitudes of a row; NaN if an entry is NaN.
#[inline(always)]
pub(super) fn largest_row<const S: usize>(a: &[[f64; S]]) -> f64 {
    let mut sums = [0.0; S];
    for column in a {
        for (sum, it) in sums.iter_mut().zip(column) {
            *sum += it.abs();
        }
    }
    sums.into_iter().fold(0.0, |most, it| if it > most || it.is_nan() { it } else { most })
}

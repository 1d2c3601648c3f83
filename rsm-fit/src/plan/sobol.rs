//! Points of Sobol's sequence.
//!
//! In: the number of factors, a seed. Out: successive points in [-1, 1). The first 2^m of them fill the cube more evenly than random points. Every
//! coordinate is shifted by random bits, which keeps the evenness (Cranley, Patterson 1976, in base 2: L'Ecuyer, Lemieux 2002), so that different
//! seeds give different designs. At most 16 factors.
//!
//! Direction numbers: Joe, Kuo 2008 (new-joe-kuo-6); its first lines are below. Order of points: Antonov, Saleev 1979.

use crate::random::Random;

/// Bits of a coordinate.
const BITS: usize = 32;

/// Degree, inner coefficients and first numbers of the primitive polynomial of each dimension from the second on.
const POLYNOMIALS: [(usize, u32, &[u32]); 15] = [
    (1, 0, &[1]),
    (2, 1, &[1, 3]),
    (3, 1, &[1, 3, 1]),
    (3, 2, &[1, 1, 1]),
    (4, 1, &[1, 1, 3, 3]),
    (4, 4, &[1, 3, 5, 13]),
    (5, 2, &[1, 1, 5, 5, 17]),
    (5, 4, &[1, 1, 5, 5, 5]),
    (5, 7, &[1, 1, 7, 11, 19]),
    (5, 11, &[1, 1, 5, 1, 1]),
    (5, 13, &[1, 1, 1, 3, 11]),
    (5, 14, &[1, 3, 5, 5, 31]),
    (6, 1, &[1, 3, 3, 9, 7, 49]),
    (6, 13, &[1, 1, 1, 15, 21, 21]),
    (6, 16, &[1, 3, 1, 13, 27, 49]),
];

/// The sequence, from its first point.
pub(super) struct Sobol {
    directions: Vec<[u32; BITS]>,
    now: Vec<u32>,
    index: u32,
}

impl Sobol {
    /// With a random shift.
    pub(super) fn new(factors: usize, random: &mut Random) -> Sobol {
        let mut sequence = Sobol::plain(factors);
        sequence.now.iter_mut().for_each(|bits| *bits = random.below(1 << BITS) as u32);
        sequence
    }

    fn plain(factors: usize) -> Sobol {
        Sobol { directions: (0..factors).map(directions).collect(), now: vec![0; factors], index: 0 }
    }

    /// The next point.
    pub(super) fn next(&mut self) -> Vec<f64> {
        // The middle of its cell of 2^-32.
        let point = self.now.iter().map(|bits| 2.0 * ((f64::from(*bits) + 0.5) / 4_294_967_296.0) - 1.0).collect();
        let bit = self.index.trailing_ones() as usize;
        self.index = self.index.wrapping_add(1);
        if bit < BITS {
            self.now.iter_mut().zip(&self.directions).for_each(|(bits, of)| *bits ^= of[bit]);
        }
        point
    }
}

fn directions(dimension: usize) -> [u32; BITS] {
    let mut out = [0; BITS];
    let Some(k) = dimension.checked_sub(1) else {
        (0..BITS).for_each(|bit| out[bit] = 1 << (BITS - 1 - bit));
        return out;
    };
    let (degree, inner, first) = POLYNOMIALS[k];
    for bit in 0..BITS {
        out[bit] = if bit < degree {
            first[bit] << (BITS - 1 - bit)
        } else {
            let mut number = out[bit - degree] ^ (out[bit - degree] >> degree);
            for m in 1..degree {
                if inner >> (degree - 1 - m) & 1 == 1 {
                    number ^= out[bit - m];
                }
            }
            number
        };
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_points_are_the_published_ones() {
        // SciPy 1.17, qmc.Sobol(16, scramble=False): points 5 and 100 (of 0, 1, ...), in 128ths.
        let mut sequence = Sobol::plain(16);
        let points: Vec<Vec<f64>> =
            (0..101).map(|_| sequence.next().iter().map(|x| ((x + 1.0) * 64.0).floor()).collect()).collect();
        assert_eq!(points[5], [112, 112, 16, 48, 112, 80, 112, 48, 48, 16, 48, 112, 112, 16, 112, 48].map(f64::from));
        assert_eq!(points[100], [53, 33, 99, 93, 113, 95, 3, 61, 81, 89, 59, 87, 61, 109, 41, 63].map(f64::from));
    }

    #[test]
    fn any_two_factors_of_a_power_of_two_stand_once_in_each_cell() {
        // The first two dimensions are a (0, 2)-sequence: 64 points, one in each of 8 x 8, 4 x 16, 64 x 1 cells; the shift keeps it.
        let mut sequence = Sobol::new(2, &mut Random::new(3));
        let points: Vec<Vec<f64>> = (0..64).map(|_| sequence.next()).collect();
        for (a, b) in [(8.0, 8.0), (4.0, 16.0), (64.0, 1.0), (1.0, 64.0)] {
            let cells: std::collections::BTreeSet<(i64, i64)> =
                points.iter().map(|x| (((x[0] + 1.0) / 2.0 * a) as i64, ((x[1] + 1.0) / 2.0 * b) as i64)).collect();
            assert_eq!(cells.len(), 64);
        }
    }
}

//! Fractional factorials of two levels: generators, the defining relation, aliases.
//!
//! In: the number of factors, and generators or a number of runs. Out: points of -1 and 1, and the aliased effects. An effect is the set of its
//! factors, one bit for each. The product of two effects is their symmetric difference, because the square of a column is one (Box, Hunter 1961).
//! Names are not used here.

use std::cmp::Reverse;

use super::points::{Points, full_factorial};

/// A set of factors as bits, and whether its product is -1.
pub type Effect = (u32, bool);

/// The largest number of generator sets tried for minimum aberration; with more, generators are chosen one at a time.
const MOST_SETS: u64 = 300_000;

/// A fraction of the two-level factorial.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fraction {
    /// How many factors there are.
    pub factors: usize,
    /// Each generated factor, with the effect of other factors that it equals.
    pub generators: Vec<(usize, Effect)>,
}

impl Fraction {
    /// The fraction of 2^`base` runs with minimum aberration: the shortest words of the defining relation are as long as possible, and as few as
    /// possible (Fries, Hunter 1980). The first `base` factors are independent, the others are generated. `None` if there are no such generators.
    pub(super) fn least_aberration(factors: usize, base: usize) -> Option<Fraction> {
        let wanted = factors.checked_sub(base)?;
        let effects: Vec<u32> = (1u32..1 << base).rev().filter(|set| set.count_ones() >= 2).collect();
        if wanted > effects.len() {
            return None;
        }
        let of = |chosen: &[u32]| Fraction {
            factors,
            generators: chosen.iter().enumerate().map(|(k, set)| (base + k, (*set, false))).collect(),
        };
        let sets = (0..wanted as u64).fold(1u64, |sets, k| sets.saturating_mul(effects.len() as u64 - k) / (k + 1));
        let mut best: Option<(Vec<usize>, Vec<u32>)> = None;
        if sets <= MOST_SETS {
            let mut places: Vec<usize> = (0..wanted).collect();
            loop {
                let chosen: Vec<u32> = places.iter().map(|place| effects[*place]).collect();
                let pattern = of(&chosen).pattern();
                if best.as_ref().is_none_or(|(least, _)| pattern < *least) {
                    best = Some((pattern, chosen));
                }
                let Some(k) = (0..wanted).rev().find(|k| places[*k] < effects.len() - wanted + k) else { break };
                places[k] += 1;
                (k + 1..wanted).for_each(|m| places[m] = places[m - 1] + 1);
            }
            return best.map(|(_, chosen)| of(&chosen));
        }
        let mut chosen: Vec<u32> = Vec::new();
        for _ in 0..wanted {
            let next = effects
                .iter()
                .filter(|set| !chosen.contains(set))
                .min_by_key(|set| of(&[&chosen[..], &[**set]].concat()).pattern())?;
            chosen.push(*next);
        }
        Some(of(&chosen))
    }

    /// The words of the defining relation: the effects that are constant over the runs, without the empty one.
    #[must_use]
    pub fn words(&self) -> Vec<Effect> {
        let mut words: Vec<Effect> = vec![(0, false)];
        for (factor, (set, is_negative)) in &self.generators {
            let word = set ^ (1 << factor);
            words.extend(words.clone().iter().map(|(other, sign)| (other ^ word, sign ^ is_negative)));
        }
        let mut words: Vec<Effect> = words.into_iter().skip(1).collect();
        words.sort_by_key(|(set, _)| (set.count_ones(), Reverse(set.reverse_bits())));
        words
    }

    /// The resolution: the length of the shortest word; `None` for the full factorial.
    #[must_use]
    pub fn resolution(&self) -> Option<u32> {
        self.words().iter().map(|(set, _)| set.count_ones()).min()
    }

    /// The number of words of each length.
    fn pattern(&self) -> Vec<usize> {
        let mut pattern = vec![0; self.factors + 1];
        for (set, _) in self.words() {
            pattern[set.count_ones() as usize] += 1;
        }
        pattern
    }

    /// Classes of aliased main effects and two-factor interactions, main effects first. Each member has its sign relative to the first. Classes with
    /// one member are left out.
    #[must_use]
    pub fn aliases(&self) -> Vec<Vec<Effect>> {
        let words = self.words();
        let ones = (0..self.factors).map(|k| 1u32 << k);
        let twos = (0..self.factors).flat_map(|a| (a + 1..self.factors).map(move |b| 1u32 << a | 1 << b));
        let effects: Vec<u32> = ones.chain(twos).collect();
        let mut classes: Vec<Vec<Effect>> = Vec::new();
        for effect in effects {
            let class = classes.iter_mut().find_map(|class| {
                let word = words.iter().find(|(word, _)| word ^ effect == class[0].0)?;
                Some((class, word.1))
            });
            match class {
                Some((class, sign)) => class.push((effect, sign)),
                None => classes.push(vec![(effect, false)]),
            }
        }
        classes.retain(|class| class.len() > 1);
        classes
    }

    /// The points, with the independent factors in standard order.
    pub(super) fn points(&self) -> Points {
        let generated = |k: &usize| self.generators.iter().any(|(factor, _)| factor == k);
        let own: Vec<usize> = (0..self.factors).filter(|k| !generated(k)).collect();
        let of_corner = |corner: Vec<f64>| {
            let mut point = vec![0.0; self.factors];
            own.iter().zip(corner).for_each(|(k, x)| point[*k] = x);
            for (factor, (set, is_negative)) in &self.generators {
                let product: f64 = own.iter().filter(|k| set >> **k & 1 == 1).map(|k| point[*k]).product();
                point[*factor] = if *is_negative { -product } else { product };
            }
            point
        };
        full_factorial(&vec![vec![-1.0, 1.0]; own.len()]).into_iter().map(of_corner).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fractions_of_least_aberration_have_the_published_word_lengths() {
        // Fries, Hunter 1980; Montgomery, Design and Analysis of Experiments, table 8.14: factors, runs, resolution, shortest words.
        for (factors, base, resolution, count) in [
            (3, 2, 3, 1),
            (5, 4, 5, 1),
            (6, 4, 4, 3),
            (7, 4, 4, 7),
            (7, 5, 4, 1),
            (8, 4, 4, 14),
            (8, 5, 4, 3),
            (9, 5, 4, 6),
            (11, 4, 3, 12),
            (15, 4, 3, 35),
        ] {
            let fraction = Fraction::least_aberration(factors, base).unwrap();
            assert_eq!(fraction.resolution(), Some(resolution), "{factors} {base}");
            // 3 to 4 of the shortest; of 11 factors in 16 runs 12 words of three letters.
            assert_eq!(fraction.pattern()[resolution as usize], count, "{factors} {base}");
            assert_eq!(fraction.points().len(), 1 << base);
        }
        assert!(Fraction::least_aberration(8, 3).is_none());
    }

    #[test]
    fn aliases_are_columns_that_are_equal_over_all_runs() {
        for (factors, base) in [(5, 3), (7, 4), (6, 5)] {
            let mut fraction = Fraction::least_aberration(factors, base).unwrap();
            fraction.generators[0].1.1 = true;
            let points = fraction.points();
            let column = |set: u32| -> Vec<f64> {
                points.iter().map(|x| (0..factors).filter(|k| set >> k & 1 == 1).map(|k| x[k]).product()).collect()
            };
            let effects: Vec<u32> = (1u32..1 << factors).filter(|set| set.count_ones() <= 2).collect();
            let aliases = fraction.aliases();
            for a in &effects {
                for b in effects.iter().filter(|b| *b > a) {
                    let inner: f64 = column(*a).iter().zip(column(*b)).map(|(x, y)| x * y).sum();
                    let together = aliases.iter().find_map(|class| {
                        let sign = |of: &u32| class.iter().find(|(set, _)| set == of).map(|(_, sign)| *sign);
                        Some(sign(a)? != sign(b)?)
                    });
                    let expected = together.map_or(0.0, |is_negative| if is_negative { -1.0 } else { 1.0 });
                    assert_eq!(inner, expected * points.len() as f64, "{a:b} {b:b}");
                }
            }
        }
    }
}

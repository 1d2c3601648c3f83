//! Tests that a cost is that of the written tape, and that the chosen scheme is the cheapest of all allowed ones.

use crate::lower::nest::Written;
use crate::number::{Precision, Rational, integer};
use crate::tape::{Op, Port, Reg, TapeBuilder};

use super::*;

/// A linear congruential generator (Knuth, MMIX): deterministic, and good enough for these tests.
struct Random(u64);

impl Random {
    fn below(&mut self, limit: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % limit
    }
}

/// Terms of some factors, and for each factor the depth at which it is ready.
struct Polynomial {
    terms: Vec<(Vec<u32>, Rational)>,
    waits: Vec<usize>,
}

impl Polynomial {
    /// Up to `count` terms with powers up to `order`, 1 and -1 among the coefficients.
    fn random(random: &mut Random, factors: usize, count: usize, order: usize) -> Self {
        let mut powers: Vec<Vec<u32>> =
            (0..1 + random.below(count)).map(|_| (0..factors).map(|_| random.below(order + 1) as u32).collect()).collect();
        powers.sort();
        powers.dedup();
        let terms = powers.into_iter().enumerate().map(|(k, powers)| (powers, integer([-2, -1, 3, 1, 5][k % 5]))).collect();
        Polynomial { terms, waits: (0..factors).map(|_| random.below(4)).collect() }
    }

    fn scaled_terms(&self) -> Vec<ScaledTerm<'_>> {
        self.terms.iter().map(|(powers, coefficient)| ScaledTerm { powers, coefficient: coefficient.clone() }).collect()
    }

    fn ready(&self) -> Vec<Option<usize>> {
        self.waits.iter().copied().map(Some).collect()
    }

    /// The cost from a written tape: the number of operations after the variables, and the depth. The second number is the depth that the writer
    /// returns.
    fn written(&self, levels: &[Level]) -> (Cost, usize) {
        let mut tape = TapeBuilder::new(Precision::F64);
        let mut variables: Vec<Option<(Reg, usize)>> = vec![];
        for (k, waits) in self.waits.iter().enumerate() {
            let input = tape.push(Op::Input(Port(k as u32)));
            let reg = (0..*waits).fold(input, |reg, _| tape.push(Op::Absolute(reg)));
            variables.push(Some((reg, *waits)));
        }
        let scaled_terms = self.scaled_terms();
        let scaled_terms: Vec<&ScaledTerm<'_>> = scaled_terms.iter().collect();
        let (output, told) = Nest::new(&mut Written(&mut tape), &variables).value(&scaled_terms, levels);
        let tape = tape.finish("s", vec!["x".to_string(); self.waits.len()], output);
        let of_the_sums = |op: &&Op| matches!(op, Op::Add(..) | Op::Subtract(..) | Op::Multiply(..) | Op::Negate(_));
        (Cost { operations: tape.ops.iter().filter(of_the_sums).count(), ready: tape.depth() }, told)
    }
}

#[test]
fn a_cost_is_that_of_the_written_tape() {
    let mut random = Random(1);
    for _ in 0..300 {
        let factors = 1 + random.below(4);
        let polynomial = Polynomial::random(&mut random, factors, 12, 7);
        let form = |random: &mut Random| if random.below(2) == 0 { Form::Horner } else { Form::Powers };
        let mut levels: Vec<Level> = (0..factors).map(|factor| Level { factor, form: form(&mut random) }).collect();
        levels.rotate_left(random.below(factors));
        let scaled_terms = polynomial.scaled_terms();
        let scaled_terms: Vec<&ScaledTerm<'_>> = scaled_terms.iter().collect();
        let counted = cost(&scaled_terms, &levels, &polynomial.ready());
        let (written, told) = polynomial.written(&levels);
        assert_eq!((counted, told), (written, written.ready), "{:?} {levels:?}", polynomial.terms);
    }
}

/// All orders of the candidates, by recursion over the first one.
fn all_orders(candidates: &[Candidate]) -> Vec<Vec<Candidate>> {
    let Some(last) = candidates.len().checked_sub(1) else { return vec![vec![]] };
    (0..=last)
        .flat_map(|first| {
            let others = [&candidates[..first], &candidates[first + 1..]].concat();
            all_orders(&others).into_iter().map(move |rest| [vec![candidates[first]], rest].concat())
        })
        .collect()
}

/// The order of the file, then the orders with one exchange.
fn orders_of_one_exchange(candidates: &[Candidate]) -> Vec<Vec<Candidate>> {
    let count = candidates.len();
    let pairs = (0..count).flat_map(|a| (a + 1..count).map(move |b| (a, b)));
    let exchanged = pairs.map(|(a, b)| {
        let mut order = candidates.to_vec();
        order.swap(a, b);
        order
    });
    std::iter::once(candidates.to_vec()).chain(exchanged).collect()
}

/// Every scheme of an order with at most `most` levels in the form of powers, in this order: first all levels in Horner form, then counted like a
/// binary number whose last digit is the outermost level. The form of powers is allowed only if the powers are finite, and if nothing at this level
/// and inside can be infinite.
fn schemes(order: &[Candidate], most: u32) -> Vec<Vec<Level>> {
    let may = |k: usize| order[k].has_powers && order[k..].iter().all(|inside| inside.is_bounded);
    (0..1usize << order.len())
        .filter(|set| set.count_ones() <= most && (0..order.len()).all(|k| set & (1 << k) == 0 || may(k)))
        .map(|set| {
            let form = |k: usize| if set & (1 << k) == 0 { Form::Horner } else { Form::Powers };
            order.iter().enumerate().map(|(k, candidate)| Level { factor: candidate.factor, form: form(k) }).collect()
        })
        .collect()
}

/// Compares the chosen scheme with all allowed schemes, each written on a tape of its own. Returns the number of levels in the form of powers.
fn compare(polynomial: &Polynomial, candidates: &[Candidate], all: &[Vec<Level>]) -> usize {
    let scaled_terms = polynomial.scaled_terms();
    let scaled_terms: Vec<&ScaledTerm<'_>> = scaled_terms.iter().collect();
    let found = best(&scaled_terms, candidates, &polynomial.ready());
    let powers = |levels: &[Level]| levels.iter().filter(|level| level.form == Form::Powers).count();
    let price = |levels: &&Vec<Level>| {
        let (cost, _) = polynomial.written(levels);
        // An operation counts as much as two steps of the chain.
        (2 * cost.operations + cost.ready, powers(levels), cost.operations)
    };
    // `min_by_key` returns the first of equal elements.
    let expected = all.iter().min_by_key(price).expect("there is a scheme");
    assert_eq!(&found, expected, "{:?} {:?} {candidates:?}", polynomial.terms, polynomial.waits);
    powers(&found)
}

fn candidates(random: &mut Random, factors: usize) -> Vec<Candidate> {
    // For most factors the form of powers is allowed, so that both forms are often possible.
    (0..factors).map(|factor| Candidate { factor, is_bounded: random.below(6) > 0, has_powers: random.below(6) > 0 }).collect()
}

#[test]
fn up_to_three_factors_the_cheapest_of_all_orders_and_forms_is_chosen() {
    let (mut random, mut seen) = (Random(2), [0; 4]);
    for _ in 0..160 {
        let factors = 1 + random.below(3);
        let polynomial = Polynomial::random(&mut random, factors, 10, 6);
        let candidates = candidates(&mut random, factors);
        let all: Vec<Vec<Level>> = all_orders(&candidates).iter().flat_map(|order| schemes(order, 3)).collect();
        seen[compare(&polynomial, &candidates, &all)] += 1;
    }
    assert!(seen[..3].iter().all(|count| *count > 5), "forms are not often a choice: {seen:?}");
}

#[test]
fn up_to_six_factors_the_cheapest_of_all_orders_with_one_form_of_powers_is_chosen() {
    let (mut random, mut seen) = (Random(3), [0; 2]);
    for (factors, count) in [(4, 12), (5, 3)] {
        for _ in 0..count {
            let polynomial = Polynomial::random(&mut random, factors, 6, 4);
            let candidates = candidates(&mut random, factors);
            let all: Vec<Vec<Level>> = all_orders(&candidates).iter().flat_map(|order| schemes(order, 1)).collect();
            seen[compare(&polynomial, &candidates, &all)] += 1;
        }
    }
    assert!(seen.iter().all(|count| *count > 0), "{seen:?}");
}

/// The best score of some orders in Horner form. The costs are only counted, because there are many orders.
fn least_score(polynomial: &Polynomial, orders: &[Vec<Candidate>]) -> usize {
    let scaled_terms = polynomial.scaled_terms();
    let scaled_terms: Vec<&ScaledTerm<'_>> = scaled_terms.iter().collect();
    let horner = |candidate: &Candidate| Level { factor: candidate.factor, form: Form::Horner };
    let score = |order: &Vec<Candidate>| {
        let levels: Vec<Level> = order.iter().map(horner).collect();
        cost(&scaled_terms, &levels, &polynomial.ready()).score()
    };
    orders.iter().map(score).min().expect("there is an order")
}

#[test]
fn of_six_factors_all_orders_are_tried_and_of_seven_those_with_one_exchange() {
    let mut random = Random(5);
    for (factors, tries_all) in [(6, true), (7, false)] {
        let mut told_apart = 0;
        for _ in 0..6 {
            let polynomial = Polynomial::random(&mut random, factors, 8, 3);
            let candidates: Vec<Candidate> =
                (0..factors).map(|factor| Candidate { factor, is_bounded: false, has_powers: false }).collect();
            let of_one_exchange = least_score(&polynomial, &orders_of_one_exchange(&candidates));
            // Seven factors have 5040 orders, more than needed: the orders with two exchanges contain enough better ones.
            let more: Vec<Vec<Candidate>> = if tries_all {
                all_orders(&candidates)
            } else {
                orders_of_one_exchange(&candidates).iter().flat_map(|order| orders_of_one_exchange(order)).collect()
            };
            let of_more = least_score(&polynomial, &more);
            let scaled_terms = polynomial.scaled_terms();
            let scaled_terms: Vec<&ScaledTerm<'_>> = scaled_terms.iter().collect();
            let found =
                cost(&scaled_terms, &best(&scaled_terms, &candidates, &polynomial.ready()), &polynomial.ready()).score();
            assert_eq!(found, if tries_all { of_more } else { of_one_exchange });
            told_apart += usize::from(of_more < of_one_exchange);
        }
        assert!(told_apart > 0, "one exchange is always enough: that shows nothing");
    }
}

#[test]
fn of_more_factors_the_cheapest_of_one_exchange_is_chosen() {
    let mut random = Random(4);
    // With few terms many orders have the same cost; the order of the file comes first.
    for count in [1, 1, 1, 2, 2, 2, 3, 3, 8, 8, 8, 8] {
        let polynomial = Polynomial::random(&mut random, 7, count, 4);
        let candidates = candidates(&mut random, 7);
        let all: Vec<Vec<Level>> = orders_of_one_exchange(&candidates).iter().flat_map(|order| schemes(order, 1)).collect();
        compare(&polynomial, &candidates, &all);
    }
}

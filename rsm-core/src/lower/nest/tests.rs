//! Tests of the written operations against lists worked by hand, and of the depth of sums against every other order of addition.

use super::*;
use crate::number::Precision;
use crate::tape::Port;

/// The powers of one variable that are written when these powers are requested, in the order of writing: the exponents of both factors of each
/// product.
fn products(asked: &[u32]) -> Vec<[u32; 2]> {
    let mut tape = TapeBuilder::new(Precision::F64);
    let variable = tape.push(Op::Input(Port(0)));
    let mut output = Written(&mut tape);
    let mut nest = Nest::new(&mut output, &[Some((variable, 0))]);
    let mut last = (variable, 0);
    for exponent in asked {
        last = nest.power(0, *exponent);
    }
    let tape = tape.finish("powers", vec!["x".to_owned()], last.0);
    assert_eq!(last.1, tape.depth(), "a power says when it is ready");
    let mut exponents = vec![1];
    tape.ops[1..]
        .iter()
        .map(|op| {
            let Op::Multiply(a, b) = op else { panic!("{op:?} is no product") };
            let of = [exponents[a.0 as usize], exponents[b.0 as usize]];
            exponents.push(of[0] + of[1]);
            of
        })
        .collect()
}

#[test]
fn powers_are_shared_and_shallow() {
    // By hand: an existing power costs nothing. Otherwise a power is one product of two existing powers, of several such pairs the one with the
    // smallest depth; otherwise a product of two halves.
    assert_eq!(products(&[1]), [[0; 2]; 0]);
    assert_eq!(products(&[2]), [[1, 1]]);
    assert_eq!(products(&[2, 2]), [[1, 1]]);
    assert_eq!(products(&[3]), [[1, 1], [2, 1]]);
    assert_eq!(products(&[4]), [[1, 1], [2, 2]]);
    assert_eq!(products(&[5]), [[1, 1], [2, 1], [3, 2]]);
    // x^4 from x^2 twice (depth 2), not from x^3 and x (depth 3).
    assert_eq!(products(&[3, 4]), [[1, 1], [2, 1], [2, 2]]);
    // x^7 = x^5 x^2 has one product, x^4 x^3 would have two.
    assert_eq!(products(&[5, 7]), [[1, 1], [2, 1], [3, 2], [5, 2]]);
    // x^6: of x^3 x^3, x^4 x^2 and x^5 x the last has a depth of one more; x^3 x^3 comes first.
    assert_eq!(products(&[3, 4, 5, 6]), [[1, 1], [2, 1], [2, 2], [3, 2], [3, 3]]);
    assert_eq!(products(&[2, 4, 8]), [[1, 1], [2, 2], [4, 4]]);
}

/// The smallest depth of a sum: tries every pair first, then every pair of the rest, and so on.
fn shallowest(ready: &[usize]) -> usize {
    if let [only] = ready {
        return *only;
    }
    let mut least = usize::MAX;
    for b in 1..ready.len() {
        for a in 0..b {
            let mut left = ready.to_vec();
            let (of_b, of_a) = (left.remove(b), left.remove(a));
            left.push(of_a.max(of_b) + 1);
            least = least.min(shallowest(&left));
        }
    }
    least
}

#[test]
fn no_other_order_of_a_sum_is_shallower() {
    let one_half = integer(1) / integer(2);
    // All combinations of depths of up to five addends, with and without a constant.
    for count in 1..=5u32 {
        for number in 0..4usize.pow(count) {
            for has_constant in [false, true] {
                let mut ready: Vec<usize> = (0..count).map(|k| number / 4usize.pow(k) % 4).collect();
                let mut counted = Counted::default();
                let mut nest = Nest::new(&mut counted, &[]);
                let mut parts: Vec<Part<'_, usize>> = ready.iter().map(|ready| Part::Value(*ready)).collect();
                if has_constant {
                    // A constant is ready at depth 0.
                    ready.push(0);
                    parts.push(Part::Constant(&one_half));
                }
                let sum = super::super::levels::shallowest_sum(&mut nest, parts);
                let (found, operations) = (nest.written(sum), ready.len() - 1);
                assert_eq!((found, counted.operations), (shallowest(&ready), operations), "{ready:?} {has_constant}");
            }
        }
    }
}

/// A sign and its operand: the constant 3, the variable x, or its opposite.
#[test]
fn a_sign_costs_an_operation_only_where_no_sum_takes_it() {
    #[derive(Clone, Copy, Debug)]
    enum Kind {
        Constant,
        Value,
        Opposite,
    }
    let three = integer(3);
    let all = [Kind::Constant, Kind::Value, Kind::Opposite];
    for (a, b) in all.into_iter().flat_map(|a| all.map(|b| (a, b))) {
        let mut tape = TapeBuilder::new(Precision::F64);
        let x = tape.push(Op::Input(Port(0)));
        let mut output = Written(&mut tape);
        let mut nest = Nest::new(&mut output, &[]);
        let part = |kind| match kind {
            Kind::Constant => Part::Constant(&three),
            Kind::Value => Part::Value((x, 0)),
            Kind::Opposite => Part::Opposite((x, 0)),
        };
        let value = |kind| match kind {
            Kind::Constant => three.clone(),
            Kind::Value => integer(7),
            Kind::Opposite => integer(-7),
        };
        let sum = nest.sum(part(a), part(b));
        let (sum, ready) = nest.written(sum);
        let product = nest.product(part(a), (x, 0));
        let (product, _) = nest.written(product);
        let output = tape.push(Op::Subtract(sum, product));
        let tape = tape.finish("t", vec!["x".to_owned()], output);
        // Sum and product are in one number; their sizes distinguish them.
        let expected = value(a) + value(b) - value(a) * integer(7);
        assert_eq!(crate::exact::ideal(&tape, &[integer(7)]), Some(expected), "{a:?} {b:?}\n{tape}");
        // Of two opposites one keeps its sign. The opposite of a product is written, because no sum uses it here.
        let signs = usize::from(matches!((a, b), (Kind::Opposite, Kind::Opposite))) + usize::from(matches!(a, Kind::Opposite));
        assert_eq!(tape.operation_count(), 3 + signs, "{a:?} {b:?}\n{tape}");
        assert_eq!(ready, 1 + usize::from(matches!((a, b), (Kind::Opposite, Kind::Opposite))), "{a:?} {b:?}");
    }
}

//! A family of models from a seed, with every option of the file. Without rounding each tape equals the exact reference. With rounding it is within
//! its bound, and the true polynomial is within its range. Both limits are nearly reached somewhere.

use rsm_core::certificate;
use rsm_core::check::Checked;
use rsm_core::exact;
use rsm_core::lower;
use rsm_core::model::{Coding, HalfSpace, Input, Knot, Model, Outside, Sigmoid, Surface, Symmetry, Term, Wave};
use rsm_core::number::{Precision, Rational, exact, integer};
use rsm_core::run::Interpreter;
use rsm_core::tape::{Op, Tape};

/// Knuth's MMIX generator: sufficient for varied models.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn below(&mut self, limit: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % limit
    }

    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        let share = self.below(1 << 30) as f64 / ((1u64 << 30) - 1) as f64;
        low * (1.0 - share) + high * share
    }
}

fn input(random: &mut Random, k: usize, coding: Coding) -> Input {
    let width = random.between(0.5, 4.0);
    let low = random.between(-3.0, 3.0);
    let range = match random.below(if coding == Coding::None { 5 } else { 9 }) {
        0 | 1 => [low, low + width],
        2 => [-width, width],
        3 => [width, 3.0 * width],
        4 => [-2.0 * width, -0.5 * width],
        // A range of 16 numbers in f32, with a middle that is not a number of f32.
        5 => [1e6 + 1.0, 1e6 + 2.0],
        6 => [-3e-12 * width, 1e-12],
        // High powers of the scale exceed the exponents of f32.
        7 => [-4e25, 7e25 * width],
        _ => [0.0, 250.0 * width],
    };
    let outside = if random.below(3) == 0 { Outside::Extrapolate } else { Outside::Clamp };
    Input { name: ["a", "b", "c"][k].to_string(), unit: "1".to_string(), range, outside }
}

pub(crate) fn model(random: &mut Random, index: usize) -> Model {
    let coding = if index % 4 == 3 { Coding::None } else { Coding::Range };
    let inputs: Vec<Input> = (0..1 + index % 3).map(|k| input(random, k, coding)).collect();
    let mut surface = Surface { name: "s".to_string(), unit: "1".to_string(), coding, ..Surface::default() };
    for input in &inputs {
        let [low, high] = input.range;
        surface.inputs.push(input.name.clone());
        let is_symmetric = low == -high;
        if is_symmetric && random.below(3) > 0 {
            let kind = if random.below(2) == 0 { Symmetry::Odd } else { Symmetry::Even };
            surface.symmetry.push((input.name.clone(), kind));
        } else if low * high > 0.0 && high - low > 0.4 * high.abs() && random.below(2) == 0 {
            surface.reciprocal.push(input.name.clone());
        }
        let bottom = if is_symmetric { 0.0 } else { low };
        let at = bottom + (high - bottom) * random.between(0.2, 0.8);
        if random.below(3) == 0 && bottom < at && at < high {
            surface.knots.push(Knot { input: input.name.clone(), at });
        }
        // Widths from a tenth of the range to more than the whole, and centres also slightly outside.
        if random.below(3) == 0 && !surface.reciprocal.contains(&input.name) {
            let (at, width) = (low + (high - low) * random.between(-0.2, 1.2), (high - low) * random.between(0.1, 1.3));
            surface.sigmoids.push(Sigmoid { input: input.name.clone(), at, width });
        }
        let is_plain = !surface.reciprocal.contains(&input.name) && !surface.is_symmetric(&input.name);
        if random.below(3) == 0 && is_plain && input.outside == Outside::Clamp {
            // The exact reference of order n has about 700 n digits.
            let (period, order) = ((high - low) * random.between(1.0, 2.0), 1 + random.below(5) as u32);
            surface.waves.push(Wave { input: input.name.clone(), period, order });
        }
    }
    let order = 1 + random.below(4) as u32;
    let factors = surface.width();
    for _ in 0..1 + random.below(9) {
        let mut powers = vec![0; factors];
        for _ in 0..random.below(order as usize + 1) {
            powers[random.below(factors)] += 1;
        }
        for (k, input) in inputs.iter().enumerate() {
            if surface.symmetry.contains(&(input.name.clone(), Symmetry::Odd)) {
                powers[k] = powers[k].max(1);
            }
        }
        // Coefficients that need no product, powers of two, and others.
        let coefficient =
            [1.0, -1.0, 2.0, -0.5, 0.0, random.between(-2.0, 2.0), random.between(-2.0, 2.0), 1e-7][random.below(8)];
        if surface.terms.iter().all(|term| term.powers != powers) {
            surface.terms.push(Term { powers, coefficient });
        }
    }
    if random.below(3) == 0 {
        surface.output_range = Some([[-0.5, 0.1], [-1e3, 0.2], [-0.3, 1e9]][random.below(3)]);
    }
    if random.below(3) == 0 {
        let normal = inputs.iter().map(|_| [1.0, -0.7, 0.3][random.below(3)]).collect();
        surface.support = vec![HalfSpace { normal, bound: 0.3 }];
    }
    Model { name: format!("m{index}"), inputs, surfaces: vec![surface], compensators: vec![] }
}

/// Every model of the family in the precisions that hold it.
fn each(mut visit: impl FnMut(&Checked, Precision, &mut Random)) {
    let mut random = Random(20);
    for index in 0..90 {
        let checked = Checked::from_model(&model(&mut random, index)).unwrap_or_else(|faults| panic!("{faults}"));
        for precision in Precision::ALL.into_iter().filter(|precision| checked.refusal(*precision).is_none()) {
            visit(&checked, precision, &mut random);
        }
    }
}

/// Numbers of the type: ends, middle, knots and random ones, in the range and slightly outside.
pub(crate) fn points(checked: &Checked, precision: Precision, random: &mut Random, count: usize, around: f64) -> Vec<Vec<f64>> {
    let surface = &checked.model().surfaces[0];
    let mut one = |input: &Input| {
        let [low, high] = input.range;
        let [inner_low, inner_high] = [precision.round_up(&exact(low)), precision.round_down(&exact(high))];
        let knots: Vec<f64> = surface.knots.iter().filter(|knot| knot.input == input.name).map(|knot| knot.at).collect();
        let value = match random.below(6) {
            0 => inner_low,
            1 => inner_high,
            2 if !knots.is_empty() => knots[0],
            3 => low + (high - low) / 2.0,
            _ => random.between(low - around * (high - low), high + around * (high - low)),
        };
        let value = precision.round(&exact(value));
        if around == 0.0 { value.clamp(inner_low, inner_high) } else { value }
    };
    let inputs = checked.inputs_of(surface);
    (0..count).map(|_| inputs.iter().map(&mut one).collect()).collect()
}

pub(crate) fn rational(point: &[f64]) -> Vec<Rational> {
    point.iter().map(|xi| exact(*xi)).collect()
}

pub(crate) fn run(tape: &Tape, point: &[f64]) -> f64 {
    match tape.precision {
        Precision::F64 => Interpreter::<f64>::new(tape).eval(point),
        Precision::F32 => {
            let narrow: Vec<f32> = point.iter().map(|xi| *xi as f32).collect();
            f64::from(Interpreter::<f32>::new(tape).eval(&narrow))
        }
    }
}

#[test]
fn without_rounding_every_tape_is_the_reference() {
    let mut compared = 0;
    each(|checked, precision, random| {
        let surface = &checked.model().surfaces[0];
        let inputs = checked.inputs_of(surface);
        let tape = lower::surface(checked, 0, precision);
        for point in points(checked, precision, random, 8, 0.5) {
            let at = rational(&point);
            let Some(truth) = exact::value(surface, &inputs, &at) else { continue };
            assert_eq!(exact::ideal(&tape, &at).as_ref(), Some(&truth), "{} at {point:?}\n{tape}", surface.name);
            compared += 1;
        }
        // Every operation that the result does not need is absent or an argument.
        let mut live = vec![false; tape.ops.len()];
        live[tape.output().0 as usize] = true;
        for k in (0..live.len()).rev() {
            assert!(live[k] || matches!(tape.ops[k], Op::Input(_)), "r{k} is for nothing\n{tape}");
            if live[k] {
                tape.ops[k].operands().iter().for_each(|operand| live[operand.0 as usize] = true);
            }
        }
    });
    assert!(compared > 900, "only {compared} points");
}

#[test]
fn with_rounding_every_tape_keeps_its_bound_and_its_range() {
    let mut close = 0;
    each(|checked, precision, random| {
        let surface = &checked.model().surfaces[0];
        let inputs = checked.inputs_of(surface);
        let tape = lower::surface(checked, 0, precision);
        let found = certificate::surface(checked, 0, &[precision]);
        let bound = found.tapes[0].error;
        assert!(bound.is_finite(), "no bound\n{tape}");
        let mut worst = 0.0f64;
        for point in points(checked, precision, random, 12, 0.0) {
            let at = rational(&point);
            let polynomial = exact::polynomial(surface, &inputs, &at).expect("no pole in the box");
            assert!(
                exact(found.range.low) <= polynomial && polynomial <= exact(found.range.high),
                "{:?} at {point:?}",
                found.range
            );
            let error = exact(run(&tape, &point)) - exact::value(surface, &inputs, &at).expect("no pole in the box");
            let error = if error < integer(0) { -error } else { error };
            let told = Precision::F64.round(&error);
            assert!(error <= exact(bound), "{told:e} at {point:?} is above {bound:e}\n{tape}");
            worst = worst.max(told);
        }
        // Within 12 points, without a search.
        close += usize::from(worst > 0.2 * bound);
    });
    assert!(close > 30, "only {close} bounds are met within a factor of five");
}

#[test]
fn what_leaves_the_box_is_clamped_or_extrapolated_and_nan_passes() {
    each(|checked, precision, random| {
        let surface = &checked.model().surfaces[0];
        let inputs = checked.inputs_of(surface);
        let tape = lower::surface(checked, 0, precision);
        for point in points(checked, precision, random, 2, 0.0) {
            for (k, input) in inputs.iter().enumerate() {
                let with = |value: f64| {
                    let mut moved = point.clone();
                    moved[k] = value;
                    run(&tape, &moved)
                };
                assert!(with(f64::NAN).is_nan(), "NaN in `{}` is lost\n{tape}", input.name);
                if input.outside == Outside::Clamp {
                    let [low, high] =
                        [precision.round_up(&exact(input.range[0])), precision.round_down(&exact(input.range[1]))];
                    assert_eq!(with(f64::INFINITY).to_bits(), with(high).to_bits(), "{tape}");
                    assert_eq!(with(f64::NEG_INFINITY).to_bits(), with(low).to_bits(), "{tape}");
                }
            }
        }
    });
}

#[test]
fn a_support_is_one_where_every_half_space_holds() {
    let mut seen = [0, 0];
    each(|checked, precision, random| {
        let surface = &checked.model().surfaces[0];
        let Some(tape) = lower::support(checked, 0, precision) else {
            assert!(surface.support.is_empty());
            return;
        };
        let inputs = checked.inputs_of(surface);
        let factors = rsm_core::basis::Factor::all(surface, &inputs);
        for point in points(checked, precision, random, 8, 0.5) {
            if point.contains(&0.0) && !surface.reciprocal.is_empty() {
                continue;
            }
            let at = rational(&point);
            let space = &surface.support[0];
            let sum = space
                .normal
                .iter()
                .enumerate()
                .fold(integer(0), |sum, (k, entry)| sum + exact(*entry) * factors[k].value(at[k].clone()));
            // Rounding affects the result only within a few units of the magnitudes of the terms. A margin of 1e-3 is far more than that, except for
            // ranges of 16 numbers.
            let margin = (sum.clone() - exact(space.bound)) * integer(1000);
            if margin < integer(1) && margin > integer(-1) {
                continue;
            }
            let inside = run(&tape, &point);
            assert_eq!(inside == 1.0, sum <= exact(space.bound), "{point:?}\n{tape}");
            seen[inside as usize] += 1;
            let mut bad = point.clone();
            bad[0] = f64::NAN;
            assert_eq!(run(&tape, &bad), 0.0);
        }
    });
    assert!(seen.iter().all(|count| *count > 20), "{seen:?}");
}

/// A surface of one input with one half-space, and a saturation.
fn supported(range: [f64; 2], normal: f64, bound: f64, output_range: [f64; 2]) -> Checked {
    let input = Input { name: "x".to_string(), unit: "1".to_string(), range, outside: Outside::Clamp };
    let surface = Surface {
        name: "s".to_string(),
        unit: "1".to_string(),
        inputs: vec!["x".to_string()],
        output_range: Some(output_range),
        terms: vec![Term { powers: vec![1], coefficient: 1.0 }],
        support: vec![HalfSpace { normal: vec![normal], bound }],
        ..Surface::default()
    };
    let model = Model { name: "m".to_string(), inputs: vec![input], surfaces: vec![surface], compensators: vec![] };
    Checked::from_model(&model).unwrap_or_else(|faults| panic!("{faults}"))
}

#[test]
fn a_support_keeps_its_meaning_where_its_weights_leave_the_exponents() {
    // x/half times the normal, compared with half of the normal: supported up to a half of the coded range.
    for (half, normal) in [(1e-30, 1e20), (1e30, 1e-20), (1e-35, 1.0), (1.0, 1e30), (1e-30, 1e30), (3e37, 1e-30)] {
        let checked = supported([-half, half], normal, 0.5 * normal, [-1.0, 1.0]);
        for precision in Precision::ALL {
            let tape = lower::support(&checked, 0, precision).expect("it has a support");
            assert!(tape.ops.iter().all(|op| !matches!(op, Op::Constant(constant) if !constant.value.is_finite())), "{tape}");
            for (share, inside) in [(-1.0, 1.0), (0.0, 1.0), (0.49, 1.0), (0.51, 0.0), (1.0, 0.0), (2.0, 0.0)] {
                assert_eq!(run(&tape, &[precision.round(&exact(share * half))]), inside, "{share} of {half}, {normal}\n{tape}");
            }
        }
    }
}

#[test]
fn numbers_that_f32_cannot_hold_are_refused_or_rounded_towards_it() {
    let refused = |checked: &Checked| checked.refusal(Precision::F32).map(|faults| faults.to_string());
    let beyond = "a number of `support` is larger than f32 can hold";
    for (normal, bound) in [(1.0, 1e300), (1e300, 1.0), (-1e300, 1.0), (1.0, f64::from(f32::MAX))] {
        let found = refused(&supported([-1.0, 1.0], normal, bound, [-1.0, 1.0])).expect("f32 cannot hold it");
        assert!(found.contains(beyond), "{found}");
    }
    // The limit is below all numbers of f32, so no point is supported.
    let never = supported([-1.0, 1.0], 1.0, -1e300, [-1.0, 1.0]);
    assert_eq!(refused(&never), None);
    assert_eq!(run(&lower::support(&never, 0, Precision::F32).unwrap(), &[-1.0]), 0.0);
    let wide = supported([-1e300, 1.0], 1.0, 1.0, [-1.0, 1.0]);
    assert!(refused(&wide).expect("f32 has no -1e300").contains("the range is wider than f32 can hold"));
    // A saturation that f32 cannot reach changes no number.
    let loose = supported([-1.0, 1.0], 1.0, 1.0, [-1e300, 1e300]);
    assert_eq!(refused(&loose), None);
    let tape = lower::surface(&loose, 0, Precision::F32);
    assert!(rsm_core::rounding::error_bound(&tape, &[[-1.0, 1.0]]).is_finite());
    assert_eq!(run(&tape, &[0.5]), 0.5);
    let above = supported([-1.0, 1.0], 1.0, 1.0, [1e299, 1e300]);
    assert!(refused(&above).expect("f32 has none of these").contains("f32 has no number in the output range"));
}

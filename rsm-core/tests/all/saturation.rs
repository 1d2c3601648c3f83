//! A bound of `output_range` that no argument reaches is not on the tape, and no bit of a result changes.
//!
//! The reference clamps the results of the same surface without `output_range`. It does not use ranges or rounding bounds.

use rsm_core::check::Checked;
use rsm_core::lower;
use rsm_core::model::{Coding, Input, Model, Outside, Surface, Symmetry, Term};
use rsm_core::number::Precision;
use rsm_core::run::{Interpreter, Scalar};

/// A linear congruential generator (Knuth, MMIX): deterministic, and sufficient for varied models.
struct Random(u64);

impl Random {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % limit
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.below(1 << 31) as f64 / (1u64 << 31) as f64
    }
}

/// A surface of one or two inputs, of order up to 3, with any coding, symmetry and kind of range.
fn random(random: &mut Random) -> Model {
    let inputs: Vec<Input> = ["x", "y"][..1 + random.below(2) as usize]
        .iter()
        .map(|name| {
            let width = random.between(0.5, 4.0);
            let range = match random.below(4) {
                0 => [-width, width],
                1 => [1e6 + 1.0, 1e6 + 2.0],
                2 => [-4e15, 7e15 * width],
                _ => [-1.0, width],
            };
            let outside = if random.below(6) == 0 { Outside::Extrapolate } else { Outside::Clamp };
            Input { name: (*name).to_string(), unit: "1".to_string(), range, outside }
        })
        .collect();
    let symmetric = |input: &&Input| input.range[0] == -input.range[1];
    let symmetry: Vec<(String, Symmetry)> = inputs
        .iter()
        .filter(symmetric)
        .map(|input| (input.name.clone(), if random.below(2) == 0 { Symmetry::Odd } else { Symmetry::Even }))
        .collect();
    let mut terms: Vec<Term> = vec![];
    for total in 0..4u32 {
        let mut powers = if inputs.len() == 1 { vec![total] } else { vec![random.below(u64::from(total) + 1) as u32, 0] };
        if let [first, second] = powers[..] {
            powers[1] = total.max(second + first) - first;
        }
        for (k, input) in inputs.iter().enumerate() {
            if symmetry.contains(&(input.name.clone(), Symmetry::Odd)) {
                powers[k] = powers[k].max(1);
            }
        }
        let coefficient = [1.0, -1.0, random.between(-2.0, 2.0)][random.below(3) as usize];
        if terms.iter().all(|term| term.powers != powers) {
            terms.push(Term { powers, coefficient });
        }
    }
    let surface = Surface {
        name: "s".to_string(),
        unit: "1".to_string(),
        inputs: inputs.iter().map(|input| input.name.clone()).collect(),
        coding: Coding::Range,
        symmetry,
        terms,
        ..Surface::default()
    };
    Model { name: "m".to_string(), inputs, surfaces: vec![surface], compensators: vec![] }
}

fn checked(model: &Model) -> Checked {
    Checked::from_model(model).unwrap_or_else(|faults| panic!("{faults}"))
}

fn with_bounds(model: &Model, bounds: [f64; 2]) -> Model {
    let mut model = model.clone();
    model.surfaces[0].output_range = Some(bounds);
    model
}

/// Values of an input: bounds and their neighbours, both zeros, far outside, infinities, NaN, and some inside.
fn values(input: &Input, random: &mut Random) -> Vec<f64> {
    let [low, high] = input.range;
    let mut all = vec![f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, -0.0, 5e-324, -1e300, 1e300, 3e38, 1e-40];
    for bound in [low, high] {
        all.extend([bound, bound.next_up(), bound.next_down(), f64::from((bound as f32).next_up()), bound as f32 as f64]);
    }
    all.extend((0..12).map(|_| random.between(low, high)));
    all
}

fn points(model: &Model, random: &mut Random) -> Vec<Vec<f64>> {
    let each: Vec<Vec<f64>> = model.inputs.iter().map(|input| values(input, random)).collect();
    match &each[..] {
        [x] => x.iter().map(|x| vec![*x]).collect(),
        [x, y] => x.iter().flat_map(|x| y.iter().map(move |y| vec![*x, *y])).collect(),
        _ => unreachable!("one or two inputs"),
    }
}

trait Number: Scalar {
    fn nearest(value: f64) -> Self;
    fn wide(self) -> f64;
}
impl Number for f64 {
    fn nearest(value: f64) -> Self {
        value
    }
    fn wide(self) -> f64 {
        self
    }
}
impl Number for f32 {
    fn nearest(value: f64) -> Self {
        value as f32
    }
    fn wide(self) -> f64 {
        f64::from(self)
    }
}

/// The values of the surface without `output_range`.
fn plain<T: Number>(model: &Model, points: &[Vec<f64>]) -> Vec<T> {
    let tape = lower::surface(&checked(model), 0, T::PRECISION);
    let mut run = Interpreter::<T>::new(&tape);
    points.iter().map(|point| run.eval(&point.iter().map(|xi| T::nearest(*xi)).collect::<Vec<T>>())).collect()
}

/// The numbers of omitted and of written bounds.
#[derive(Default, Debug)]
struct Seen {
    left_out: usize,
    one_left_out: usize,
    written: usize,
}

fn compare<T: Number>(model: &Model, random: &mut Random, seen: &mut Seen) {
    if checked(model).refusal(T::PRECISION).is_some() {
        return;
    }
    let points = points(model, random);
    let plain: Vec<T> = plain(model, &points);
    let finite: Vec<f64> = plain.iter().map(|value| value.wide()).filter(|value| value.is_finite()).collect();
    let (least, greatest) = finite.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, g), v| (l.min(*v), g.max(*v)));
    let step = |value: f64, up: bool| {
        let narrow = T::nearest(value).wide();
        let next = |value: f64| if up { T::PRECISION.next_up(value) } else { T::PRECISION.next_down(value) };
        next(next(narrow))
    };
    let spread = (greatest - least).max(least.abs().max(greatest.abs()) * 1e-3).max(1e-3);
    // Bounds far outside the results, at their extremes, two numbers inside of the extremes, and well inside.
    for (below, above) in [
        (least - 0.1 * spread, greatest + 0.1 * spread),
        (least - 0.1 * spread, greatest - 0.3 * spread),
        (least, greatest),
        (step(least, true), step(greatest, false)),
        (least + 0.3 * spread, greatest + 0.1 * spread),
    ] {
        if below >= above || !below.is_finite() || !above.is_finite() {
            continue;
        }
        let bounded = checked(&with_bounds(model, [below, above]));
        if bounded.refusal(T::PRECISION).is_some() {
            continue;
        }
        let saturation = lower::saturation(&bounded, 0, T::PRECISION).expect("there is an output_range");
        let extrapolates = model.inputs.iter().any(|input| input.outside == Outside::Extrapolate);
        assert!(!extrapolates || (saturation.below && saturation.above), "an argument may be anywhere\n{model:?}");
        match (saturation.below, saturation.above) {
            (true, true) => seen.written += 1,
            (false, false) => seen.left_out += 1,
            _ => seen.one_left_out += 1,
        }
        let tape = lower::surface(&bounded, 0, T::PRECISION);
        let mut run = Interpreter::<T>::new(&tape);
        let [low, high] = [T::PRECISION.round_up(&exact(below)), T::PRECISION.round_down(&exact(above))].map(T::nearest);
        for (point, value) in points.iter().zip(&plain) {
            let above = if *value < low { low } else { *value };
            let expected = if high < above { high } else { above };
            let found = run.eval(&point.iter().map(|xi| T::nearest(*xi)).collect::<Vec<T>>());
            let both_nan = found.wide().is_nan() && expected.wide().is_nan();
            assert!(
                both_nan || found.bits() == expected.bits(),
                "{:?} for {:?} at {point:?}, {saturation:?}\n{model:?}\n{tape}",
                found.wide(),
                expected.wide()
            );
        }
    }
}

fn exact(value: f64) -> rsm_core::number::Rational {
    rsm_core::number::exact(value)
}

#[test]
fn a_bound_that_is_left_out_changes_no_bit() {
    let (mut generator, mut seen) = (Random(7), Seen::default());
    for _ in 0..14 {
        let model = random(&mut generator);
        compare::<f64>(&model, &mut generator, &mut seen);
        compare::<f32>(&model, &mut generator, &mut seen);
    }
    // Bounds are omitted where they should be, and each case occurs often.
    assert!(seen.left_out > 10 && seen.one_left_out > 8 && seen.written > 10, "{seen:?}");
}

/// 2 + x over [-1, 1] ends at 3. A bound of 3 needs no clamp, because the tape never exceeds it: its last sum is exact at the end of the range, and
/// rounding is monotone. The error bound cannot show this. If the bound is one number lower, the clamp has an effect.
#[test]
fn a_bound_that_is_reached_by_one_number_is_written() {
    let text = |high: f64| {
        format!(
            "format = 1\nmodel = \"m\"\n[inputs.x]\nunit = \"1\"\nrange = [-1.0, 1.0]\n[surfaces.s]\nunit = \"1\"\ninputs = [\"x\"]\n\
             output_range = [0.0, {high:?}]\nterms = [{{ powers = [0], coefficient = 2.0 }}, {{ powers = [1], coefficient = 1.0 }}]\n"
        )
    };
    let saturation = |high: f64| {
        let source = rsm_core::source::Source::new("m.toml", text(high));
        let checked = Checked::read(&source).unwrap_or_else(|faults| panic!("{faults}"));
        let tape = lower::surface(&checked, 0, Precision::F64);
        let greatest = Interpreter::<f64>::new(&tape).eval(&[1.0]);
        (lower::saturation(&checked, 0, Precision::F64).expect("there is a range"), greatest)
    };
    let (below, greatest) = saturation(3f64.next_down());
    assert!(!below.below && below.above && greatest == 3f64.next_down(), "{below:?} {greatest}");
    let (far, greatest) = saturation(3.0 + 1e-14);
    assert!(!far.below && !far.above && greatest == 3.0, "{far:?}");
}

/// a - b x with a and b near 1000 and a result near 0: in f32 the tape exceeds the true range by many numbers. A bound just outside of the true range
/// is written anyway.
#[test]
fn the_range_of_the_polynomial_is_not_that_of_its_tape() {
    let mut random = Random(3);
    let mut passed = 0;
    for _ in 0..40 {
        let (a, b) = (1000.0 + random.between(0.0, 1.0), 1000.0 - random.between(0.0, 1.0));
        let input = Input { name: "x".to_string(), unit: "1".to_string(), range: [0.99, 1.0], outside: Outside::Clamp };
        let term = |power: u32, coefficient: f64| Term { powers: vec![power], coefficient };
        let surface = Surface {
            name: "s".to_string(),
            unit: "1".to_string(),
            inputs: vec!["x".to_string()],
            coding: Coding::None,
            terms: vec![term(0, a), term(1, -b)],
            ..Surface::default()
        };
        let model = Model { name: "m".to_string(), inputs: vec![input], surfaces: vec![surface], compensators: vec![] };
        let ends = [a - b * 1.0, a - b * 0.99].map(|end| f64::from(end as f32));
        let bounds = [f64::from((ends[0] as f32).next_down()), f64::from((ends[1] as f32).next_up())];
        let points: Vec<Vec<f64>> = [0.99, 1.0, 0.0, 2.0].iter().map(|x| vec![*x]).collect();
        let values: Vec<f32> = plain(&model, &points);
        let bounded = checked(&with_bounds(&model, bounds));
        let tape = lower::surface(&bounded, 0, Precision::F32);
        let mut run = Interpreter::<f32>::new(&tape);
        for (point, value) in points.iter().zip(values) {
            let expected = f64::from(value).clamp(bounds[0], bounds[1]) as f32;
            passed += usize::from(expected != value);
            assert_eq!(run.eval(&[point[0] as f32]), expected, "{a} {b} at {point:?}\n{tape}");
        }
    }
    assert!(passed > 20, "only {passed} values pass the true range: they prove nothing");
}

/// y = x is computed without an error, so the known range is an enclosure of the true polynomial. A bound exactly at its end changes no value, and is
/// not written.
#[test]
fn a_bound_at_the_end_of_what_is_known_is_not_written() {
    let input = Input { name: "x".to_string(), unit: "1".to_string(), range: [-1.0, 2.0], outside: Outside::Clamp };
    let surface = Surface {
        name: "s".to_string(),
        unit: "1".to_string(),
        inputs: vec!["x".to_string()],
        coding: Coding::None,
        terms: vec![Term { powers: vec![1], coefficient: 1.0 }],
        ..Surface::default()
    };
    let model = Model { name: "m".to_string(), inputs: vec![input], surfaces: vec![surface], compensators: vec![] };
    let of = |bounds: [f64; 2]| {
        lower::saturation(&checked(&with_bounds(&model, bounds)), 0, Precision::F64).expect("there is a range")
    };
    let known = of([-4.0, 4.0]).values.expect("it was asked");
    assert!(-1.0 - 1e-15 < known.low && known.low <= -1.0 && 2.0 <= known.high && known.high < 2.0 + 2e-15, "{known:?}");
    let written = |low: f64, high: f64| (of([low, high]).below, of([low, high]).above);
    let (inside_low, inside_high) = (known.low.next_up(), known.high.next_down());
    assert_eq!(written(known.low, known.high), (false, false));
    assert_eq!(written(inside_low, known.high), (true, false));
    assert_eq!(written(known.low, inside_high), (false, true));
    assert_eq!(written(inside_low, inside_high), (true, true));
}

/// Both bounds, 0.1 and 0.9, are between two numbers of f32: a value at the outer number is outside of the range, and is changed to the inner one.
#[test]
fn a_bound_between_two_numbers_is_the_inner_one() {
    let outer = [Precision::F32.round_down(&exact(0.1)), Precision::F32.round_up(&exact(0.9))];
    let input = Input { name: "x".to_string(), unit: "1".to_string(), range: outer, outside: Outside::Clamp };
    let surface = Surface {
        name: "s".to_string(),
        unit: "1".to_string(),
        inputs: vec!["x".to_string()],
        coding: Coding::None,
        output_range: Some([0.1, 0.9]),
        terms: vec![Term { powers: vec![1], coefficient: 1.0 }],
        ..Surface::default()
    };
    let model = Model { name: "m".to_string(), inputs: vec![input], surfaces: vec![surface], compensators: vec![] };
    let tape = lower::surface(&checked(&model), 0, Precision::F32);
    for end in outer {
        let found = f64::from(Interpreter::<f32>::new(&tape).eval(&[end as f32]));
        assert!((0.1..=0.9).contains(&found) && (found - end).abs() < 1e-7, "{found} for {end}\n{tape}");
    }
}

//! Transforms of a response over the family of models: each tape is the response of the reference, within its bound and range, in both precisions.
//! The logarithm is compared with the exponential of the standard library, which shares nothing with its formula.

use rsm_core::certificate;
use rsm_core::certificate::gradient::derivatives;
use rsm_core::check::Checked;
use rsm_core::exact;
use rsm_core::lower;
use rsm_core::model::{Input, Model, Outside, Surface, Symmetry, Term, Transform};
use rsm_core::number::{Precision, exact, integer};
use rsm_core::range;
use rsm_core::rounding;

use crate::family::{Random, model, points, rational, run};

/// The models of the family that can have the transform. Of a reciprocal the inputs clamp, and its constant moves the terms above 0.
fn with(transform: Transform, mut model: Model) -> Option<Checked> {
    let surface = &mut model.surfaces[0];
    if surface.symmetry.iter().any(|(_, symmetry)| *symmetry == Symmetry::Odd) {
        return None;
    }
    if transform.needs_positive() {
        model.inputs.iter_mut().for_each(|input| input.outside = Outside::Clamp);
    }
    let constant = vec![0; surface.width()];
    surface.terms.retain(|term| term.powers != constant);
    let inputs: Vec<Input> = model.inputs.clone();
    let mut raised = Term { powers: constant, coefficient: 0.5 };
    if transform.needs_positive() && !surface.terms.is_empty() {
        raised.coefficient = 0.5 - range::range(surface, &inputs).low;
    }
    surface.terms.push(raised);
    surface.transform = Some(transform);
    surface.output_range = surface.output_range.map(|_| [0.1, 3.0]);
    Some(Checked::from_model(&model).unwrap_or_else(|faults| panic!("{faults}")))
}

fn each(transform: Transform, count: usize, mut visit: impl FnMut(&Checked, Precision, &mut Random)) {
    let mut random = Random(33);
    for index in 0..count {
        let Some(checked) = with(transform, model(&mut random, index)) else { continue };
        for precision in Precision::ALL.into_iter().filter(|precision| checked.refusal(*precision).is_none()) {
            visit(&checked, precision, &mut random);
        }
    }
}

#[test]
fn without_rounding_a_tape_is_the_response_of_its_terms() {
    for transform in Transform::ALL.into_iter().filter(|transform| *transform != Transform::Log) {
        let mut compared = 0;
        each(transform, 10, |checked, precision, random| {
            let surface = &checked.model().surfaces[0];
            let inputs = checked.inputs_of(surface);
            let tape = lower::surface(checked, 0, precision);
            for point in points(checked, precision, random, 2, 0.5) {
                let at = rational(&point);
                let Some(truth) = exact::value(surface, &inputs, &at) else { continue };
                assert_eq!(exact::ideal(&tape, &at), Some(truth), "{transform:?} at {point:?}\n{tape}");
                compared += 1;
            }
        });
        assert!(compared > 15, "{transform:?}: only {compared} points");
    }
}

#[test]
fn with_rounding_a_tape_keeps_its_bound_and_its_range() {
    for transform in Transform::ALL {
        let (mut seen, mut close) = (0, 0);
        each(transform, 14, |checked, precision, random| {
            let surface = &checked.model().surfaces[0];
            let inputs = checked.inputs_of(surface);
            let tape = lower::surface(checked, 0, precision);
            let found = certificate::surface(checked, 0, &[precision]);
            let bound = found.tapes[0].error;
            assert!(bound.is_finite(), "{transform:?}: no bound\n{tape}");
            let mut worst = 0.0f64;
            for point in points(checked, precision, random, 4, 0.0) {
                let at = rational(&point);
                let response = exact::polynomial(surface, &inputs, &at).expect("no pole in the box");
                assert!(
                    exact(found.range.low) <= response && response <= exact(found.range.high),
                    "{transform:?} {:?}",
                    found.range
                );
                let error = exact(run(&tape, &point)) - exact::value(surface, &inputs, &at).expect("no pole in the box");
                let told = Precision::F64.round(&error).abs();
                assert!(told <= bound, "{transform:?}: {told:e} at {point:?} is above {bound:e}\n{tape}");
                worst = worst.max(told);
            }
            seen += 1;
            // The bound of a logarithm adds the errors of 64 equal factors, which partly cancel.
            close += usize::from(worst > 0.02 * bound);
        });
        assert!(seen > 10 && 3 * close > seen, "{transform:?}: {close} of {seen} bounds are met within a factor of fifty");
    }
}

#[test]
fn the_tape_of_a_logarithm_without_rounding_is_the_reference_to_500_bits() {
    // Few digits: the exact 64th power of a polynomial of order 11 has 700 times as many.
    let checked = Checked::from_model(&one_input(Transform::Log, &[(0, 0.5), (1, 2.5), (2, -1.25)])).unwrap();
    let surface = &checked.model().surfaces[0];
    let inputs = checked.inputs_of(surface);
    for precision in Precision::ALL {
        let tape = lower::surface(&checked, 0, precision);
        for x in [0.0, 0.25, 1.0, 1.5, 2.0, 3.0] {
            let at = [exact(x)];
            let (ideal, truth) = (exact::ideal(&tape, &at).unwrap(), exact::value(surface, &inputs, &at).unwrap());
            let mut off = ideal / truth - integer(1);
            (0..50).for_each(|_| off *= integer(1 << 10));
            assert!(off < integer(1) && off > integer(-1), "{x}");
        }
    }
}

#[test]
fn a_logarithm_is_near_the_exponential_of_its_terms() {
    each(Transform::Log, 24, |checked, precision, random| {
        let mut plain = checked.model().clone();
        let surface = &mut plain.surfaces[0];
        (surface.transform, surface.output_range) = (None, None);
        let plain = Checked::from_model(&plain).unwrap();
        let (tape, terms) = (lower::surface(checked, 0, precision), lower::surface(&plain, 0, Precision::F64));
        let [low, high] = checked.model().surfaces[0].output_range.unwrap_or([0.0, f64::INFINITY]);
        let ranges: Vec<[f64; 2]> = checked.model().inputs.iter().map(|input| input.range).collect();
        let bound = rounding::error_bound(&tape, &ranges);
        for point in points(checked, precision, random, 8, 0.0) {
            let expected = run(&terms, &point).clamp(-32.0, 32.0).exp().clamp(low, high);
            let found = run(&tape, &point);
            // Its rounding errors, the formula's error, and a few units of the reference's own terms, at most 32.
            assert!((found - expected).abs() <= bound + (6e-11 + 1e-13) * expected, "{found} {expected}\n{tape}");
        }
    });
}

#[test]
fn what_leaves_the_box_is_clamped_and_nan_passes() {
    for transform in Transform::ALL {
        each(transform, 12, |checked, precision, random| {
            let inputs = checked.inputs_of(&checked.model().surfaces[0]);
            let tape = lower::surface(checked, 0, precision);
            for point in points(checked, precision, random, 2, 0.0) {
                for (k, input) in inputs.iter().enumerate() {
                    let with = |value: f64| run(&tape, &[&point[..k], &[value], &point[k + 1..]].concat());
                    assert!(with(f64::NAN).is_nan(), "{transform:?}: NaN in `{}` is lost\n{tape}", input.name);
                    if input.outside == Outside::Clamp {
                        let high = precision.round_down(&exact(input.range[1]));
                        assert_eq!(with(f64::INFINITY).to_bits(), with(high).to_bits(), "{tape}");
                    }
                }
            }
        });
    }
}

fn one_input(transform: Transform, terms: &[(u32, f64)]) -> Model {
    let input = Input { name: "x".into(), unit: "1".into(), range: [0.0, 2.0], outside: Outside::Clamp };
    let surface = Surface {
        name: "s".into(),
        unit: "1".into(),
        inputs: vec!["x".into()],
        transform: Some(transform),
        terms: terms.iter().map(|(power, coefficient)| Term { powers: vec![*power], coefficient: *coefficient }).collect(),
        ..Surface::default()
    };
    Model { name: "m".into(), inputs: vec![input], surfaces: vec![surface], ..Model::default() }
}

#[test]
fn the_derivative_is_that_of_the_response() {
    for transform in Transform::ALL {
        // P = 2 + x/2 from 1.5 to 2.5, with x coded.
        let checked = Checked::from_model(&one_input(transform, &[(0, 2.0), (1, 0.5)])).unwrap();
        let tape = lower::gradient(&checked, 0, Precision::F64);
        for x in [0.0f64, 0.3, 1.0, 1.9] {
            let p = 2.0 + 0.5 * (x - 1.0);
            let expected = match transform {
                Transform::SquareRoot => 2.0 * p,
                Transform::CubeRoot => 3.0 * p * p,
                Transform::FourthRoot => 4.0 * p * p * p,
                Transform::Log => p.exp(),
                Transform::ReciprocalSquareRoot => -2.0 / (p * p * p),
                Transform::Reciprocal => -1.0 / (p * p),
            } * 0.5;
            let found = run(&tape, &[x]);
            assert!((found - expected).abs() <= 1e-10 * expected.abs(), "{transform:?} {x}: {found} {expected}");
        }
        // With its own certificate.
        let found = derivatives(&checked, 0, Precision::F64);
        assert!(!found.is_empty());
    }
}

#[test]
fn a_root_of_terms_below_zero_is_zero_and_a_pole_is_refused() {
    let checked = Checked::from_model(&one_input(Transform::SquareRoot, &[(0, 0.0), (1, 1.0)])).unwrap();
    let tape = lower::surface(&checked, 0, Precision::F64);
    assert_eq!([0.0, 0.5, 1.0, 1.5, 2.0].map(|x| run(&tape, &[x])), [0.0, 0.0, 0.0, 0.25, 1.0]);
    let found = range::range(&checked.model().surfaces[0], &checked.inputs_of(&checked.model().surfaces[0]));
    assert!(found.low == 0.0 && (found.high - 1.0).abs() < 1e-9, "{found:?}");
    for (transform, word) in
        [(Transform::Reciprocal, "reciprocal"), (Transform::ReciprocalSquareRoot, "reciprocal-square-root")]
    {
        let found = Checked::from_model(&one_input(transform, &[(0, 1.0), (1, 1.5)])).unwrap_err().to_string();
        assert!(
            found.contains(&format!("`transform` \"{word}\": the value of the terms reaches -5.0000e-1 in the box")),
            "{found}"
        );
    }
    // 1e40 is no number of f32.
    let large = Checked::from_model(&one_input(Transform::FourthRoot, &[(0, 1e10)])).unwrap();
    assert!(large.refusal(Precision::F64).is_none());
    let refused = large.refusal(Precision::F32).unwrap().to_string();
    assert!(refused.contains("a response in the box is too large or too small for f32"), "{refused}");
    // Beyond 32 the exponent is limited.
    let far = Checked::from_model(&one_input(Transform::Log, &[(1, 50.0)])).unwrap();
    let tape = lower::surface(&far, 0, Precision::F32);
    let ends = [0.0, 2.0].map(|x| run(&tape, &[x]));
    assert!((ends[0] / (-32f64).exp() - 1.0).abs() < 1e-4 && (ends[1] / 32f64.exp() - 1.0).abs() < 1e-4, "{ends:?}");
    let at = |x: i64| exact::value(&far.model().surfaces[0], &far.inputs_of(&far.model().surfaces[0]), &[integer(x)]).unwrap();
    assert!(at(2) > at(1) && at(1) == integer(1));
}

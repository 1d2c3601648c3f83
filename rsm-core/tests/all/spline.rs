//! Splines: value, continuity, range and gradient against exact arithmetic; borders of cells; arguments outside, infinite and NaN.

use std::sync::Arc;

use rsm_core::basis;
use rsm_core::certificate::gradient::derivatives;
use rsm_core::check::Checked;
use rsm_core::exact;
use rsm_core::lower;
use rsm_core::model::{Input, Model, Outside, Spline, Surface};
use rsm_core::number::{self, Precision, Rational, integer};
use rsm_core::range;
use rsm_core::rounding;
use rsm_core::run::{Interpreter, Scalar};
use rsm_core::tape::{Constant, Op, Table, TapeBuilder};

use crate::random::Random;

/// Cells of a width that is no number, so that the borders of cells are between numbers.
const RANGES: [[f64; 2]; 3] = [[-0.7, 2.3], [440.0, 801.0], [1e-3, 7e-3]];

fn checked(degree: u32, cells: &[u32], mut coefficient: impl FnMut() -> f64) -> Checked {
    let input = |k: usize| Input { name: format!("x{k}"), unit: "1".into(), range: RANGES[k], outside: Outside::Clamp };
    let inputs: Vec<Input> = (0..cells.len()).map(input).collect();
    let count: usize = cells.iter().map(|cells| (cells + degree) as usize).product();
    let spline = Spline { degree, cells: cells.to_vec(), coefficients: (0..count).map(|_| coefficient()).collect() };
    let surface = Surface {
        name: "s".into(),
        unit: "1".into(),
        inputs: inputs.iter().map(|input| input.name.clone()).collect(),
        spline: Some(spline),
        ..Surface::default()
    };
    let model = Model { name: "m".into(), inputs, surfaces: vec![surface], ..Model::default() };
    Checked::from_model(&model).unwrap_or_else(|faults| panic!("{faults}"))
}

const SHAPES: [&[u32]; 6] = [&[1], &[2], &[9], &[1, 1], &[6, 11], &[2, 1, 3]];

/// Points of an input: ends, borders of cells and their neighbours, and any.
fn values<T: Scalar + Into<f64>>(random: &mut Random, [low, high]: [f64; 2], cells: u32, of: fn(f64) -> T) -> Vec<T> {
    let mut values: Vec<f64> = (0..=cells)
        .map(|k| low + (high - low) * f64::from(k) / f64::from(cells))
        .flat_map(|border| {
            let step = if T::PRECISION == Precision::F64 { 2f64.powi(-52) } else { 2f64.powi(-23) };
            [border, border * (1.0 - step), border * (1.0 + step)]
        })
        .collect();
    values.extend((0..8).map(|_| low + (high - low) * random.share()));
    values.into_iter().map(of).filter(|x| (low..=high).contains(&(*x).into())).collect()
}

fn against_the_reference<T: Scalar + Into<f64>>(checked: &Checked, random: &mut Random, of: fn(f64) -> T) {
    let surface = &checked.model().surfaces[0];
    let inputs = checked.inputs_of(surface);
    let cells = &surface.spline.as_ref().unwrap().cells;
    let tape = lower::surface(checked, 0, T::PRECISION);
    let bound = rounding::error_bound(&tape, &RANGES[..inputs.len()]);
    // The kink of a table makes no error beyond some units in the last place of the cell index.
    let unit = if T::PRECISION == Precision::F64 { 2f64.powi(-52) } else { 2f64.powi(-23) };
    assert!(bound > 0.0 && bound < 3000.0 * unit, "{bound:e} for cells {cells:?} in {:?}", T::PRECISION);
    let (enclosed, bound) = (range::range(surface, &inputs), number::exact(bound));
    let mut run = Interpreter::<T>::new(&tape);
    let each: Vec<Vec<T>> = (0..inputs.len()).map(|k| values(random, RANGES[k], cells[k], of)).collect();
    for row in 0..300 {
        let pick = |values: &Vec<T>, random: &mut Random| values[(random.share() * values.len() as f64) as usize];
        let point: Vec<T> = match each.as_slice() {
            [only] => vec![only[row % only.len()]],
            several => several.iter().map(|values| pick(values, random)).collect(),
        };
        let at: Vec<Rational> = point.iter().map(|x| number::exact((*x).into())).collect();
        let truth = exact::value(surface, &inputs, &at).unwrap();
        let ideal = exact::ideal_all(&tape, &at).unwrap();
        assert_eq!(ideal, std::slice::from_ref(&truth), "the tape is not the spline\n{tape}");
        let found = number::exact(run.eval(&point).into());
        let off = if found < truth { &truth - &found } else { &found - &truth };
        assert!(off <= bound, "{at:?}: {found} instead of {truth}");
        assert!(number::exact(enclosed.low) <= truth && truth <= number::exact(enclosed.high), "{truth} {enclosed:?}");
    }
}

#[test]
fn a_spline_is_its_formula_within_the_certified_distance() {
    let mut random = Random(1);
    for degree in [1, 3] {
        for cells in SHAPES {
            let mut numbers = Random(u64::from(degree) + cells.len() as u64);
            let checked = checked(degree, cells, || 2.0 * numbers.share() - 1.0);
            against_the_reference::<f64>(&checked, &mut random, |x| x);
            against_the_reference::<f32>(&checked, &mut random, |x| x as f32);
        }
    }
}

#[test]
fn the_cost_does_not_depend_on_the_cells() {
    let operations = |degree: u32, cells: &[u32]| {
        let tape = lower::surface(&checked(degree, cells, || 1.0), 0, Precision::F64);
        tape.operation_count()
    };
    // The table in docs/book/src/reference/formats.md, section 2.
    for (degree, few, many, count) in [
        (1, &[2][..], &[200][..], 15),
        (1, &[2, 2], &[60, 40], 35),
        (1, &[2, 2, 2], &[7, 8, 9], 63),
        (3, &[2], &[200], 34),
        (3, &[2, 2], &[60, 40], 99),
        (3, &[2, 2, 2], &[7, 8, 9], 284),
    ] {
        assert_eq!([operations(degree, few), operations(degree, many)], [count; 2]);
    }
}

#[test]
fn a_spline_with_the_coefficients_of_a_line_is_the_line() {
    // Basis functions of uniform knots reproduce a line from its values at the Greville abscissae, here 0, 1, 2, ... along one input.
    for degree in [1, 3] {
        let mut next = 0.0;
        let checked = checked(degree, &[7], || {
            next += 1.0;
            next - 1.0
        });
        let surface = &checked.model().surfaces[0];
        let inputs = checked.inputs_of(surface);
        let first = if degree == 1 { 0 } else { 1 };
        for (share, wanted) in [(0, first), (7, first + 7), (3, first + 3)] {
            let [low, high] = RANGES[0].map(number::exact);
            let at = &low + (high - &low) * integer(share) / integer(7);
            assert_eq!(exact::value(surface, &inputs, &[at]), Some(integer(wanted)));
        }
        let found = range::range(surface, &inputs);
        let (low, high) = (first as f64, (first + 7) as f64);
        assert!(found.low <= low && low - 1e-12 < found.low && found.high >= high && found.high < high + 1e-12, "{found:?}");
    }
}

#[test]
fn arguments_are_clamped_and_nan_gives_nan() {
    for degree in [1, 3] {
        let mut numbers = Random(5);
        let checked = checked(degree, &[4, 3], || numbers.share());
        let tape = lower::surface(&checked, 0, Precision::F64);
        let mut run = Interpreter::<f64>::new(&tape);
        let [[a, b], [c, d], _] = RANGES;
        assert_eq!(run.eval(&[f64::INFINITY, f64::NEG_INFINITY]), run.eval(&[b, c]));
        assert_eq!(run.eval(&[a - 1.0, 1e300]), run.eval(&[a, d]));
        assert!(run.eval(&[f64::NAN, c]).is_nan() && run.eval(&[a, f64::NAN]).is_nan());
        // The last coefficient of a table is its value at the last corner.
        if degree == 1 {
            let last = *checked.model().surfaces[0].spline.as_ref().unwrap().coefficients.last().unwrap();
            assert!((run.eval(&[b, d]) - last).abs() < 1e-14);
        }
    }
}

/// The derivative of the exact spline inside a cell, by a quotient of differences with a step that is small against the cell.
fn slope(surface: &Surface, inputs: &[Input], at: &[Rational], k: usize) -> f64 {
    let [low, high] = inputs[k].range.map(number::exact);
    let step = (high - low) / integer(1 << 30);
    let moved = |sign: i64| {
        let mut moved = at.to_vec();
        moved[k] = &moved[k] + &step * integer(sign);
        exact::polynomial(surface, inputs, &moved).unwrap()
    };
    let quotient = (moved(1) - moved(-1)) / (integer(2) * step);
    Precision::F64.round(&quotient)
}

#[test]
fn the_gradient_is_the_derivative_within_the_certified_distance() {
    let mut random = Random(9);
    for degree in [1, 3] {
        for cells in [&[5][..], &[4, 3]] {
            let mut numbers = Random(7);
            let checked = checked(degree, cells, || 2.0 * numbers.share() - 1.0);
            let surface = &checked.model().surfaces[0];
            let inputs = checked.inputs_of(surface);
            for precision in Precision::ALL {
                let certified = derivatives(&checked, 0, precision);
                for (k, derivative) in certified.iter().enumerate() {
                    let span = RANGES[k][1] - RANGES[k][0];
                    let least = if precision == Precision::F64 { 1e-11 } else { 1e-2 };
                    // A table's slope jumps at a border of cells, and the bound contains the jump.
                    let most = if degree == 1 { 100.0 } else { least } / span;
                    assert!(derivative.error <= most, "{} {:e}", derivative.input, derivative.error);
                }
                for _ in 0..100 {
                    let point: Vec<f64> = (0..cells.len())
                        .map(|k| RANGES[k][0] + (RANGES[k][1] - RANGES[k][0]) * (0.02 + 0.96 * random.share()))
                        .collect();
                    // Numbers of both precisions.
                    let point: Vec<f64> = point.iter().map(|x| f64::from(*x as f32)).collect();
                    let at: Vec<Rational> = point.iter().map(|x| number::exact(*x)).collect();
                    let tape = lower::gradient(&checked, 0, precision);
                    let found: Vec<f64> = if precision == Precision::F64 {
                        let mut run = Interpreter::<f64>::new(&tape);
                        run.eval(&point);
                        run.results().collect()
                    } else {
                        let mut run = Interpreter::<f32>::new(&tape);
                        run.eval(&point.iter().map(|x| *x as f32).collect::<Vec<f32>>());
                        run.results().map(f64::from).collect()
                    };
                    for (k, derivative) in certified.iter().enumerate() {
                        let truth = slope(surface, &inputs, &at, k);
                        // The quotient's own error: third derivative times step squared, (2^-30)^2 of the range, times at most 6 cells^3.
                        let own = 1e-14 * (truth.abs() + 1.0 / (RANGES[k][1] - RANGES[k][0]));
                        assert!(
                            (found[k] - truth).abs() <= derivative.error + own,
                            "{} {truth} {}",
                            found[k],
                            derivative.error
                        );
                        assert!(derivative.range.low <= found[k] && found[k] <= derivative.range.high);
                    }
                }
            }
        }
    }
}

#[test]
fn the_weights_are_a_partition_of_one() {
    for degree in [1, 3] {
        for x in [0.0, 0.3, 1.0, 1.7, 2.0] {
            let (first, weights) = basis::spline_weights(degree, 4, [0.0, 2.0], number::exact(x));
            assert_eq!(weights.len(), degree as usize + 1);
            assert!(first + degree as usize <= 3 + degree as usize);
            assert_eq!(weights.into_iter().fold(integer(0), |sum, weight| sum + weight), integer(1));
        }
    }
}

#[test]
fn what_does_not_fit_is_refused_with_words() {
    let text = |keys: &str, spline: &str| {
        format!(
            "format = 1\nmodel = \"m\"\n[inputs.x]\nunit = \"1\"\nrange = [0.0, 1.0]\n[inputs.y]\nunit = \"1\"\nrange = [0.0, 1.0]\n\
             outside = \"extrapolate\"\n[surfaces.s]\nunit = \"1\"\n{keys}\nspline = {spline}\n"
        )
    };
    let one = "{ degree = 1, cells = [2], coefficients = [1, 2, 3] }";
    let cases = [
        ("inputs = [\"x\"]", "{ degree = 2, cells = [2], coefficients = [1, 2, 3, 4] }", "`degree`: found 2, expected 1 or 3"),
        ("inputs = [\"x\"]", "{ degree = 1, cells = [0], coefficients = [1] }", "`cells`"),
        ("inputs = [\"x\"]", "{ degree = 1, cells = [2], coefficients = [1, 2] }", "found 2 numbers, expected 3"),
        (
            "inputs = [\"x\"]",
            "{ degree = 1, cells = [2, 2], coefficients = [1, 2, 3] }",
            "found 2 numbers, expected 1, one an input",
        ),
        ("inputs = [\"y\"]", one, "`y` extrapolates"),
        ("inputs = [\"x\"]\nterms = [{ powers = [0], coefficient = 1.0 }]", one, "cannot be combined with `terms`"),
        ("inputs = [\"x\"]\nknots = [{ input = \"x\", at = 0.5 }]", one, "cannot be combined with `knots`"),
        ("inputs = [\"x\"]", "{ degree = 1, cells = [2], coefficients = [1, 2, 1e301] }", "too large or too small for f64"),
        ("inputs = [\"x\"]", "{ degree = 1, cells = [2] }", "`coefficients`"),
    ];
    for (keys, spline, wanted) in cases {
        let source = rsm_core::source::Source::new("m.toml", text(keys, spline));
        let faults = Checked::read(&source).expect_err(wanted).to_string();
        assert!(faults.contains(wanted), "{wanted}: {faults}");
    }
    let fine = Checked::read(&rsm_core::source::Source::new("m.toml", text("inputs = [\"x\"]", one))).unwrap();
    let large = text("inputs = [\"x\"]", "{ degree = 1, cells = [2], coefficients = [1, 2, 1e38] }");
    let large = Checked::read(&rsm_core::source::Source::new("m.toml", large)).unwrap();
    assert!(fine.refusal(Precision::F32).is_none() && large.refusal(Precision::F32).is_some());
}

#[test]
fn a_compensator_refuses_a_spline() {
    let text = "format = 1\nmodel = \"m\"\n[inputs.x]\nunit = \"1\"\nrange = [0.0, 1.0]\n[surfaces.s]\nunit = \"1\"\ninputs = [\"x\"]\n\
        spline = { degree = 1, cells = [1], coefficients = [0.5, 0.6] }\n[compensators.k]\nsample_time = 0.001\nnatural_frequency = 10.0\n\
        zero_damping = { surface = \"s\" }\npole_damping = 0.7\n";
    let faults = Checked::read(&rsm_core::source::Source::new("m.toml", text)).unwrap_err().to_string();
    assert!(faults.contains("the surface `s` is a spline"), "{faults}");
}

#[test]
fn a_load_is_masked_and_has_a_bound_where_its_index_is_inside() {
    for precision in Precision::ALL {
        let mut tape = TapeBuilder::sharing(precision);
        let entries = [0.1, -2.0, 3.0, 4.0, 5.0].map(|value| {
            let exact = number::exact(value);
            Constant { value: precision.round(&exact), exact }
        });
        let table = Arc::new(Table::new(entries.to_vec(), 3, 1));
        let x = tape.input(0);
        let index = tape.push(Op::Nearest(x));
        let value = tape.push(Op::Load { table, index, offset: 1 });
        let tape = tape.finish("t", vec!["x".into()], value);
        let error = |range: [f64; 2]| rounding::error_bound(&tape, &[range]);
        assert_eq!((error([0.0, 3.4]), error([0.0, 3.6]), error([-0.6, 1.0])), (0.0, f64::INFINITY, f64::INFINITY));
        // A half goes to the even integer; an index of any bits reads an entry.
        let inside = [(0.0, -2.0), (0.5, -2.0), (1.5, 4.0), (2.5, 4.0), (3.4, 5.0), (-0.4, -2.0)];
        let beyond = [f64::NAN, f64::INFINITY, -7.0, 1e30];
        let mut all: Vec<(f64, Option<f64>)> = inside.iter().map(|(x, y)| (*x, Some(*y))).collect();
        all.extend(beyond.map(|x| (x, None)));
        for (x, wanted) in all {
            let found = match precision {
                Precision::F64 => Interpreter::<f64>::new(&tape).eval(&[x]),
                Precision::F32 => f64::from(Interpreter::<f32>::new(&tape).eval(&[x as f32])),
            };
            assert!(wanted.map_or([-2.0, 3.0, 4.0, 5.0].contains(&found), |wanted| wanted == found), "{x}: {found}");
            if let Some(wanted) = wanted {
                assert_eq!(exact::ideal_all(&tape, &[number::exact(x)]), Some(vec![number::exact(wanted)]));
            }
        }
        assert_eq!(exact::ideal_all(&tape, &[number::exact(9.0)]), None);
        // Numbers above 2^21 may have no fractional digits in f32.
        let mut tape = TapeBuilder::sharing(precision);
        let x = tape.input(0);
        let index = tape.push(Op::Nearest(x));
        let tape = tape.finish("n", vec!["x".into()], index);
        assert_eq!(rounding::error_bound(&tape, &[[0.0, 3e6]]), f64::INFINITY);
    }
}

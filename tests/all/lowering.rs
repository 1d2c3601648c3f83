//! Checks the lowering. Back ends that read the same tape agree even if the tape is wrong. So here the tape is compared with the exact rational
//! reference: without rounding it equals the polynomial, or the step of the filter; with rounding it is within the proved bound.

use rsm_core::emit::{Function, Kind};
use rsm_core::exact;
use rsm_core::model::{Input, Scheduled, Surface, Transform};
use rsm_core::number::{Precision, Rational, exact, integer};
use rsm_core::range;
use rsm_core::rounding;
use rsm_core::run::Interpreter;
use rsm_tests::cases::{self, Case};
use rsm_tests::points::{Number, Points};

/// Random points for each function, and as many special ones. A rational evaluation of a large model takes about a millisecond if no argument is
/// extreme (see [`is_handy`]).
const POINTS: usize = if cfg!(debug_assertions) { 8 } else { 60 };

fn all() -> Vec<Case> {
    cases::random().into_iter().chain(cases::checked_in()).collect()
}

fn of_surfaces(case: &Case) -> impl Iterator<Item = (usize, &Surface, &Function)> {
    case.unit.functions.iter().filter(|function| function.kind == Kind::Surface).map(|function| {
        let surfaces = &case.checked.model().surfaces;
        let index = surfaces.iter().position(|surface| surface.name == function.surface).expect("a function of a surface");
        (index, &surfaces[index], function)
    })
}

/// Finite points, special ones first, as f64 (which represents every f32).
fn points<T: Number>(function: &Function, surface: &Surface) -> Vec<Vec<f64>> {
    let mut points = Points::<T>::new(function, surface);
    let arity = function.inputs.len();
    let all =
        |rows: Vec<T>| rows.chunks(arity).map(|row| row.iter().map(|xi| xi.wide()).collect::<Vec<f64>>()).collect::<Vec<_>>();
    // As many special points as others, from all parts of their list.
    let hurtful: Vec<_> = all(points.hurtful()).into_iter().filter(|row| row.iter().all(|xi| xi.is_finite())).collect();
    let step = hurtful.len().div_ceil(POINTS).max(1);
    hurtful
        .into_iter()
        .step_by(step)
        .chain(all(points.random(POINTS)).into_iter().filter(|row| row.iter().all(|xi| xi.is_finite())))
        .collect()
}

fn points_of(function: &Function, surface: &Surface) -> Vec<Vec<f64>> {
    match function.tape.precision {
        Precision::F64 => points::<f64>(function, surface),
        Precision::F32 => points::<f32>(function, surface),
    }
}

fn rational(point: &[f64]) -> Vec<Rational> {
    point.iter().map(|xi| exact(*xi)).collect()
}

/// Of ordinary size. The fifth power of 5e-324 has five thousand binary digits, and tests an algebraic identity no better than 0.1.
fn is_handy(point: &[f64]) -> bool {
    point.iter().all(|xi| *xi == 0.0 || (1e-30..1e30).contains(&xi.abs()))
}

fn is_in_box(point: &[f64], inputs: &[Input]) -> bool {
    point.iter().zip(inputs).all(|(xi, input)| input.range[0] <= *xi && *xi <= input.range[1])
}

#[test]
fn without_rounding_a_tape_is_the_polynomial() {
    let mut compared = 0;
    for case in all() {
        // An exact power of 64 has too many digits, and the reference rounds it: rsm-core compares both.
        let is_rational = |surface: &Surface| surface.transform != Some(Transform::Log);
        for (_, surface, function) in of_surfaces(&case).filter(|(_, surface, _)| is_rational(surface)) {
            for point in points_of(function, surface).into_iter().filter(|point| is_handy(point)) {
                let at = rational(&point);
                let Some(truth) = exact::value(surface, &function.inputs, &at) else { continue };
                // A tape of a reciprocal divides; where it divides by zero the exact function has a pole too.
                let ideal = exact::ideal(&function.tape, &at).expect("the tape has a pole where the polynomial has none");
                assert_eq!(ideal, truth, "{} at {point:?}\n{}", case.file.display(), function.tape);
                compared += 1;
            }
        }
    }
    assert!(compared > 1000, "only {compared} points compared");
}

#[test]
fn with_rounding_it_stays_within_the_proved_bound_and_the_range_holds() {
    for case in all() {
        for (_, surface, function) in of_surfaces(&case) {
            let ranges: Vec<[f64; 2]> = function.inputs.iter().map(|input| input.range).collect();
            let bound = rounding::error_bound(&function.tape, &ranges);
            let range = range::range(surface, &function.inputs);
            assert!(bound.is_finite(), "{}: no bound\n{}", case.file.display(), function.tape);
            for (k, point) in points_of(function, surface).into_iter().enumerate() {
                // A few extreme points: there the rounding differs (subnormal results).
                if !is_handy(&point) && k % 8 != 0 {
                    continue;
                }
                if !is_in_box(&point, &function.inputs) {
                    continue;
                }
                let at = rational(&point);
                let polynomial = exact::polynomial(surface, &function.inputs, &at).expect("no pole in the box");
                assert!(
                    exact(range.low) <= polynomial && polynomial <= exact(range.high),
                    "{} {}: {} at {point:?} is outside {range:?}",
                    case.file.display(),
                    surface.name,
                    Precision::F64.round(&polynomial)
                );
                let truth = exact::saturated(surface, polynomial);
                let computed = match function.tape.precision {
                    Precision::F64 => Interpreter::<f64>::new(&function.tape).eval(&point),
                    Precision::F32 => {
                        let narrow: Vec<f32> = point.iter().map(|xi| *xi as f32).collect();
                        f64::from(Interpreter::<f32>::new(&function.tape).eval(&narrow))
                    }
                };
                let error = exact(computed) - truth;
                let error = if error < exact(0.0) { -error } else { error };
                assert!(
                    error <= exact(bound),
                    "{} {}: error {:e} at {point:?} is above the bound {bound:e}\n{}",
                    case.file.display(),
                    function.rust_name(),
                    Precision::F64.round(&error),
                    function.tape
                );
            }
        }
    }
}

/// A scheduled number at a point of the compensator's schedule, from the reference.
fn scheduled(case: &Case, scheduled: &Scheduled, schedule: &[Input], at: &[Rational]) -> Option<Rational> {
    if let Some(value) = scheduled.fixed() {
        return Some(exact(value));
    }
    scheduled.surfaces().iter().try_fold(integer(0), |sum, name| {
        let surface = case.checked.model().surface(name).expect("a surface of the compensator");
        let inputs = case.checked.inputs_of(surface);
        let place = |input: &Input| schedule.iter().position(|other| other.name == input.name).expect("in the schedule");
        let own: Vec<Rational> = inputs.iter().map(|input| at[place(input)].clone()).collect();
        Some(sum + exact::value(surface, &inputs, &own)?)
    })
}

fn sequence<T: Number>(function: &Function) -> Vec<Vec<f64>> {
    let rows = Points::<T>::with_knots(function, &[]).sequence(20 * POINTS);
    rows.chunks(function.inputs.len()).map(|row| row.iter().map(|xi| xi.wide()).collect()).collect()
}

/// The equations of the filter, from any state, with numbers from the reference. (That they are the bilinear transform of the compensator
/// is tested beside the lowering.)
#[test]
fn without_rounding_a_step_is_the_filter() {
    let mut compared = 0;
    for case in cases::every_random() {
        for function in case.unit.functions.iter().filter(|function| function.kind == Kind::Step) {
            let mut compensators = case.checked.model().compensators.iter();
            let compensator = compensators.find(|it| it.name == function.surface).expect("a function of a compensator");
            let schedule = &function.inputs[1..];
            let rows = match function.tape.precision {
                Precision::F64 => sequence::<f64>(function),
                Precision::F32 => sequence::<f32>(function),
            };
            let rows = rows.into_iter().filter(|row| row.iter().all(|xi| xi.is_finite()) && is_handy(row));
            for (k, row) in rows.take(POINTS).enumerate() {
                let at = rational(&row);
                let number = |of: &Scheduled| scheduled(case, of, schedule, &at[1..]);
                let numbers =
                    [&compensator.natural_frequency, &compensator.zero_damping, &compensator.pole_damping].map(number);
                let [Some(w), Some(z), Some(p)] = numbers else { continue };
                let Some(v) = compensator.pole_frequency.as_ref().map_or(Some(w.clone()), number) else { continue };
                let x = &at[0];
                let (s1, s2) = (integer(k as i64 % 5 - 2) / integer(7), integer(k as i64 % 3 - 1) / integer(11));
                let (g, r) = (&v * exact(compensator.sample_time) / integer(2), &v / &w);
                let denominator = integer(1) + &g * (&g + integer(2) * &p);
                let u = integer(2) * (&s1 + &g * (x - &s2)) / denominator;
                let high_pass = x - &s2 - (&p + &g / integer(2)) * &u;
                let y = x + (z * &r - p) * &u + (&r * &r - integer(1)) * high_pass;
                let expected = [y, &u - &s1, &s2 + &g * &u];
                let mut states = [s1, s2];
                let y = exact::ideal_step(&function.tape, &mut states, &at).expect("a step has no pole");
                let [next_1, next_2] = states;
                assert_eq!([y, next_1, next_2], expected, "{} at {row:?}\n{}", case.file.display(), function.tape);
                compared += 1;
            }
        }
    }
    assert!(compared > 200, "only {compared} points compared");
}

#[test]
fn no_sequence_makes_a_state_that_is_not_finite() {
    for case in cases::every_random() {
        for function in case.unit.functions.iter().filter(|function| function.kind == Kind::Step) {
            match function.tape.precision {
                Precision::F64 => stays_finite::<f64>(function),
                Precision::F32 => stays_finite::<f32>(function),
            }
        }
    }
}

fn stays_finite<T: Number>(function: &Function) {
    let mut filter = Interpreter::<T>::new(&function.tape);
    let mut points = Points::<T>::with_knots(function, &[]);
    let rows = [points.hurtful(), points.sequence(4000)].concat();
    for row in rows.chunks(function.inputs.len()) {
        let before = filter.states().to_vec();
        let result = filter.step(row);
        assert!(filter.states().iter().all(|state| state.wide().is_finite()), "{row:?} from {before:?}\n{}", function.tape);
        if row.iter().any(|xi| !xi.wide().is_finite()) {
            assert!(result.wide().is_nan() && filter.states() == before, "{row:?} from {before:?}\n{}", function.tape);
        }
    }
}

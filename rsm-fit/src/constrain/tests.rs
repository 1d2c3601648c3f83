//! Problems whose answer is known in closed form, and the parts that lead to it.

use rsm_core::basis::Variable;
use rsm_core::model::{Coding, HalfSpace, Outside, Term};

use super::*;
use crate::dd::Dd;
use crate::design::{Design, Physical};
use crate::qr::Compressed;

/// A fitted surface of natural variables with what it shall keep.
pub(super) struct Case {
    pub surface: Surface,
    pub inputs: Vec<Input>,
    pub problem: Growing,
    pub places: Vec<usize>,
    pub constraints: Vec<Constraint>,
    pub spread: f64,
}

impl Case {
    /// Rows of inputs with a response, fitted by terms.
    pub(super) fn new(ranges: &[[f64; 2]], terms: &[&[u32]], rows: &[(Vec<f64>, f64)], constraints: &[Constraint]) -> Self {
        let names: Vec<String> = (0..ranges.len()).map(|k| format!("x{k}")).collect();
        let input = |(name, range): (&String, &[f64; 2])| Input {
            name: name.clone(),
            unit: "1".into(),
            range: *range,
            outside: Outside::Clamp,
        };
        let inputs: Vec<Input> = names.iter().zip(ranges).map(input).collect();
        let mut surface = Surface { inputs: names, coding: Coding::None, ..Surface::default() };
        let design = Design::new(&surface, &inputs, terms.iter().map(|powers| powers.to_vec()).collect());
        let mut compressed = Compressed::new(terms.len() + 1);
        for (point, y) in rows {
            let point: Vec<Physical> = point.iter().copied().map(Physical).collect();
            compressed.push(design.row_as_measured(&point).into_iter().chain([Dd::from(*y)]));
        }
        let all: Vec<usize> = (0..terms.len()).collect();
        let problem = Growing::of(&compressed.finish(), &all).unwrap();
        let coefficients = problem.coefficients().into_iter().map(Dd::to_f64);
        surface.terms =
            terms.iter().zip(coefficients).map(|(powers, b)| Term { powers: powers.to_vec(), coefficient: b }).collect();
        let (low, high) =
            rows.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), (_, y)| (low.min(*y), high.max(*y)));
        Case { surface, inputs, problem, places: all, constraints: constraints.to_vec(), spread: high - low }
    }

    pub(super) fn task(&self) -> Task<'_> {
        let Case { surface, inputs, problem, places, constraints, spread } = self;
        Task { surface, inputs, constraints, problem, places, spread: *spread }
    }

    pub(super) fn claims(&self) -> Vec<Claim> {
        let halves: Vec<f64> = self.inputs.iter().map(|input| (input.range[1] - input.range[0]) / 2.0).collect();
        claim::of(&self.constraints, &self.surface, &self.inputs, &halves)
    }
}

pub(super) fn line(x: &[f64], y: impl Fn(f64) -> f64) -> Vec<(Vec<f64>, f64)> {
    x.iter().map(|x| (vec![*x], y(*x))).collect()
}

pub(super) fn bounds(min: Option<f64>, max: Option<f64>) -> Constraint {
    Constraint::Bounds { min, max }
}

fn rising() -> Constraint {
    Constraint::Monotone { input: "x0".into(), increasing: true }
}

/// What an active answer tells, each place as a list.
struct Told {
    coefficients: Vec<f64>,
    distances: Vec<f64>,
    points: Vec<Vec<Vec<f64>>>,
    rounds: usize,
    shift: f64,
    change: f64,
    changed_at: Vec<f64>,
}

fn active(outcome: Constrained) -> Told {
    let place = |named: &Named<f64>| named.0.iter().map(|(_, x)| *x).collect::<Vec<f64>>();
    match outcome {
        Constrained::Active { coefficients, constraints, rounds, shift, largest_change } => Told {
            coefficients,
            distances: constraints.iter().map(|report| report.distance).collect(),
            points: constraints.iter().map(|report| report.points.iter().map(place).collect()).collect(),
            rounds,
            shift,
            change: largest_change.value,
            changed_at: place(&largest_change.at),
        },
        other => panic!("{other:?}"),
    }
}

/// To the last bits of numbers of about 1.
fn near(found: &[f64], expected: &[f64]) {
    assert!(
        found.len() == expected.len() && found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 4e-15),
        "{found:?}, expected {expected:?}"
    );
}

/// A proven distance: at most that at which it is enforced, and no more below it than the search leaves.
fn is_proven_at(found: f64, enforced: f64) {
    assert!(found <= enforced * (1.0 + 1e-6) && found > enforced * 0.99, "{found:e}, expected {enforced:e}");
}

#[test]
fn a_line_is_turned_about_the_point_that_costs_least() {
    // y = x at 0 to 4, to stay below 3: b = (d, 3 - ..)/3 with d = 1 and the shift. (X'X)^-1 a for a = (1, 4) is (-0.2, 0.2), its product with a 0.6.
    let case = Case::new(&[[0.0, 4.0]], &[&[0], &[1]], &line(&[0.0, 1.0, 2.0, 3.0, 4.0], |x| x), &[bounds(None, Some(3.0))]);
    let told = active(case.task().run());
    let d = 1.0 + SHIFT * 4.0;
    near(&told.coefficients, &[d / 3.0, 1.0 - d / 3.0]);
    assert_eq!((told.rounds, told.shift, told.points), (1, SHIFT, vec![vec![vec![4.0]]]));
    near(&[told.change, told.changed_at[0]], &[-d, 4.0]);
    is_proven_at(told.distances[0], SHIFT * 4.0);
    // An eighth of it all.
    let eighth = line(&[0.0, 1.0, 2.0, 3.0, 4.0], |x| x / 8.0);
    let told = active(Case::new(&[[0.0, 4.0]], &[&[0], &[1]], &eighth, &[bounds(None, Some(0.375))]).task().run());
    near(&[told.change, told.changed_at[0]], &[-d / 8.0, 4.0]);
    // The same from below: y = -x, above -3.
    let mirrored =
        Case::new(&[[0.0, 4.0]], &[&[0], &[1]], &line(&[0.0, 1.0, 2.0, 3.0, 4.0], |x| -x), &[bounds(Some(-3.0), None)]);
    let told = active(mirrored.task().run());
    near(&told.coefficients, &[-d / 3.0, d / 3.0 - 1.0]);
    near(&[told.change, told.changed_at[0]], &[d, 4.0]);
}

#[test]
fn a_falling_line_that_shall_rise_becomes_the_mean() {
    // Slopes are per half side, 2: slope 2 = shift 5. About the mean of x, 7, where y is 2.2.
    let rows = line(&[5.0, 6.0, 7.0, 8.0, 9.0], |x| if x == 5.0 { 5.0 } else { 9.0 - x });
    let case = Case::new(&[[5.0, 9.0]], &[&[0], &[1]], &rows, &[rising()]);
    let told = active(case.task().run());
    let slope = SHIFT * 5.0 / 2.0;
    near(&told.coefficients, &[2.2 - 7.0 * slope, slope]);
    is_proven_at(told.distances[0], SHIFT * 5.0);
    // The slope is the same everywhere: one of the places is told.
    assert_eq!(told.points[0].len(), 1);
}

#[test]
fn a_vertex_between_the_points_of_the_grid_is_found_and_held() {
    // 5 - x^2 below 4 at x = +-1 to +-4. n = 8, sums of squares 60 and 708: the constant takes all of d = 1, the square 60 d/708.
    let rows = line(&[-4.0, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0, 4.0], |x| 5.0 - x * x);
    let case = Case::new(&[[-4.0, 4.0]], &[&[0], &[2]], &rows, &[bounds(Some(-20.0), Some(4.0))]);
    let told = active(case.task().run());
    let d = 1.0 + SHIFT * 15.0;
    near(&told.coefficients, &[5.0 - d, -1.0 + d * 60.0 / 708.0]);
    assert_eq!((told.rounds, told.shift), (2, SHIFT));
    assert!(told.points[0].len() == 1 && told.points[0][0][0].abs() < 1e-6, "{:?}", told.points);
    // Seen through the interval that encloses it.
    assert!((told.change + d).abs() < 1e-13 && told.changed_at == [0.0], "{}", told.change);
    // The nearer of the two bounds.
    is_proven_at(told.distances[0], SHIFT * 15.0);
    let natural = |slope: f64| told.coefficients[0] + 16.0 * told.coefficients[1] + slope;
    assert!(natural(0.0) > -11.0);
}

#[test]
fn what_holds_already_is_left_as_it_is() {
    let x = [0.0, 1.0, 2.0, 3.0, 4.0];
    let of = |constraints: &[Constraint]| Case::new(&[[0.0, 4.0]], &[&[0], &[1]], &line(&x, |x| x), constraints).task().run();
    let Constrained::Inactive { constraints } = of(&[bounds(Some(-2.0), Some(7.0)), rising(), bounds(None, Some(4.5))]) else {
        panic!("it keeps all of them")
    };
    let distances: Vec<f64> = constraints.iter().map(|report| report.distance).collect();
    for (found, expected) in distances.iter().zip([2.0, 2.0, 0.5]) {
        is_proven_at(*found, expected);
    }
    assert!(constraints.iter().all(|report| report.points.is_empty()));
    // What a proof may miss: 1e-12 of the spread, 4.
    assert!(matches!(of(&[bounds(None, Some(4.0 - 3.5e-12))]), Constrained::Inactive { .. }));
    assert!(matches!(of(&[bounds(None, Some(4.0 - 4.5e-12))]), Constrained::Active { .. }));
    // One that holds does not speak for another.
    assert!(matches!(of(&[bounds(None, Some(4.5)), bounds(None, Some(3.0))]), Constrained::Active { .. }));
}

#[test]
fn contradictions_are_named() {
    let x = [0.0, 1.0, 2.0, 3.0, 4.0];
    let infeasible = |ranges: [f64; 2], terms: &[&[u32]], constraints: &[Constraint]| match Case::new(
        &[ranges],
        terms,
        &line(&x, |x| x),
        constraints,
    )
    .task()
    .run()
    {
        Constrained::Infeasible { constraints } => constraints,
        other => panic!("{other:?}"),
    };
    let (above, below) = (bounds(Some(3.0), None), bounds(None, Some(1.0)));
    let names = [above.to_string(), below.to_string()];
    let free = bounds(None, Some(9.0));
    assert_eq!(infeasible([0.0, 4.0], &[&[0], &[1]], &[above.clone(), free.clone(), below]), names);
    assert_eq!(infeasible([0.0, 4.0], &[&[0], &[1]], &[free.clone(), above.clone(), bounds(None, Some(1.0))]), names);
    // Without a constant the surface is 0 at 0, whatever its slope: at a point of the grid, between them, and at none of them where the solver finds
    // it.
    let one = bounds(Some(1.0), None);
    assert_eq!(infeasible([0.0, 4.0], &[&[1]], &[free.clone(), one.clone()]), [one.to_string()]);
    assert_eq!(infeasible([-4.0, 4.0], &[&[1]], std::slice::from_ref(&one)), [one.to_string()]);
    // A steep parabola keeps it at the grid, and the search finds the place between.
    assert_eq!(infeasible([-4.0, 4.0], &[&[2]], &[bounds(None, Some(1e9)), one.clone()]), [one.to_string()]);
    // A bound of 0 holds there.
    let task = Case::new(&[[0.0, 4.0]], &[&[1]], &line(&x, |x| -x), &[bounds(Some(0.0), None)]);
    assert!(matches!(task.task().run(), Constrained::Active { .. }));
}

#[test]
fn only_the_supported_region_counts() {
    // y = x below 3 over [0, 4], supported up to 2: nothing to do. Supported up to 3.5: as if the range ended there, to a 1024th of it.
    let x = [0.0, 1.0, 2.0, 3.0, 4.0];
    let of = |bound: f64| {
        let mut case = Case::new(&[[0.0, 4.0]], &[&[0], &[1]], &line(&x, |x| x), &[bounds(None, Some(3.0))]);
        case.surface.support = vec![HalfSpace { normal: vec![1.0], bound }];
        case.task().run()
    };
    assert!(matches!(of(2.0), Constrained::Inactive { .. }));
    let told = active(of(3.5));
    let end = told.coefficients[0] + 3.5 * told.coefficients[1];
    assert!(end < 3.0 && end > 2.99 && told.points[0].iter().all(|point| point[0] <= 3.51), "{end} {:?}", told.points);
}

#[test]
fn a_cell_lies_inside_outside_or_across_the_support() {
    let mut case = Case::new(
        &[[0.0, 1.0], [0.0, 1.0]],
        &[&[0, 0]],
        &[(vec![0.0, 0.0], 0.0)],
        &[bounds(Some(0.0), None), Constraint::Convex],
    );
    case.surface.support =
        vec![HalfSpace { normal: vec![1.0, 0.0], bound: 0.5 }, HalfSpace { normal: vec![0.0, 1.0], bound: 0.75 }];
    let claims = case.claims();
    let task = case.task();
    let all = [0.0, 1.0];
    let place = |x: [f64; 2], y: [f64; 2]| task.place(&claims[0], &[x, y]);
    // Up to the bound is inside, from it on across: the bound itself belongs to it.
    assert_eq!(place([0.0, 0.5], [0.0, 0.75]), Place::Inside);
    assert_eq!(place([0.0, 0.5f64.next_up()], [0.0, 0.75]), Place::Partly);
    assert_eq!(place([0.5, 1.0], [0.0, 0.25]), Place::Partly);
    assert_eq!(place([0.5f64.next_up(), 1.0], [0.0, 0.25]), Place::Outside);
    assert_eq!(
        [place(all, [0.0, 0.5]), place([0.0, 0.25], all), place(all, [0.8, 1.0])],
        [Place::Partly, Place::Partly, Place::Outside]
    );
    // Entries of a direction do not count.
    assert_eq!(task.place(&claims[1], &[[0.0, 0.5], [0.0, 0.5], [0.9, 1.0]]), Place::Inside);
    // Another box: x in [2, 6], x - y/2 <= 3.
    let mut case = Case::new(&[[2.0, 6.0], [-1.0, 1.0]], &[&[0, 0]], &[(vec![0.0, 0.0], 0.0)], &[bounds(Some(0.0), None)]);
    case.surface.support = vec![HalfSpace { normal: vec![1.0, -0.5], bound: 3.0 }];
    let claims = case.claims();
    let place = |x: [f64; 2], y: [f64; 2]| case.task().place(&claims[0], &[x, y]);
    assert_eq!(place([0.0, 0.12], [0.0, 1.0]), Place::Inside, "2.48 + 0.5");
    assert_eq!(place([0.0, 0.13], [0.0, 1.0]), Place::Partly, "2.52 + 0.5");
    assert_eq!(place([0.37, 1.0], [0.9, 1.0]), Place::Partly, "3.48 - 0.5");
    assert_eq!(place([0.38, 1.0], [0.0, 1.0]), Place::Outside, "3.52 - 0.5");
}

#[test]
fn places_are_told_in_natural_units() {
    let input = |range: [f64; 2]| Input { name: "x".into(), unit: "1".into(), range, outside: Outside::Clamp };
    for (variable, range) in [
        (Variable::Natural, [2.0, 6.0]),
        (Variable::Centred { low: 2.0, high: 6.0 }, [2.0, 6.0]),
        (Variable::Magnitude, [-6.0, 6.0]),
        (Variable::ScaledMagnitude { high: 6.0 }, [-6.0, 6.0]),
        (Variable::Reciprocal, [2.0, 6.0]),
        (Variable::CentredReciprocal { low: 2.0, high: 6.0 }, [2.0, 6.0]),
    ] {
        for xi in [2.0, 2.5, 3.0, 5.0, 6.0] {
            let x = variable.value(Dd::from(xi)).to_f64();
            assert!((natural(variable, Coded(x), &input(range)) - xi).abs() < 1e-15 * 6.0, "{variable:?} {xi}");
        }
        // A place just beyond the end is the end.
        let [low, high] =
            [0.5, 7.0].map(|xi| natural(variable, Coded(variable.value(Dd::from(xi)).to_f64()), &input([2.0, 6.0])));
        assert_eq!([low, high], [2.0, 6.0], "{variable:?}");
    }
}

#[test]
fn neighbours_within_a_hundredth_of_the_range_are_one_place() {
    let case = Case::new(&[[2.0, 6.0], [0.0, 1.0]], &[&[0, 0]], &[(vec![0.0, 0.0], 0.0)], &[]);
    let task = case.task();
    let named = |x: f64, y: f64| Named(vec![("x0".to_string(), x), ("x1".to_string(), y)]);
    let are_close = |x: f64, y: f64| task.are_close(&named(3.0, 0.5), &named(x, y));
    assert!(are_close(3.03, 0.505) && are_close(2.97, 0.495));
    assert!(!are_close(3.06, 0.5) && !are_close(2.94, 0.5) && !are_close(3.0, 0.515) && !are_close(3.5, 0.9));
    assert!(!task.are_close(&named(3.0, 0.0), &named(3.0, 0.01)), "just so far is apart");
}

#[test]
fn each_place_that_holds_is_told_once_with_its_constraint() {
    let case = Case::new(&[[0.0, 4.0]], &[&[0], &[1]], &line(&[0.0, 4.0], |x| x), &[bounds(Some(-1.0), Some(9.0)), rising()]);
    let claims = case.claims();
    let found = |bound: f64| Found { bound, seen: bound, shares: vec![0.0] };
    let held = [(0, vec![1.0]), (2, vec![2.0]), (1, vec![3.0]), (1, vec![3.01]), (0, vec![1.02])];
    let told = case.task().reports(&claims, &[found(0.5), found(0.25), found(7.0)], &held);
    let points: Vec<Vec<f64>> = told.iter().map(|report| report.points.iter().map(|point| point.0[0].1).collect()).collect();
    assert_eq!(points, [vec![1.0, 3.0], vec![2.0]]);
    assert_eq!(told.iter().map(|report| report.distance).collect::<Vec<_>>(), [0.25, 7.0]);
    assert_eq!(case.task().names([1, 0, 1].into_iter()), [case.constraints[0].to_string(), case.constraints[1].to_string()]);
}

#[test]
fn a_contradiction_is_one_with_the_first_shift() {
    // The constant between two bounds, each of which is enforced a shift inside: a share of 2 shifts must lie between them.
    let between = |shifts: f64| {
        let rows = line(&[0.0, 1.0, 2.0], |x| x);
        let case = Case::new(
            &[[0.0, 2.0]],
            &[&[0]],
            &rows,
            &[bounds(Some(0.5), Some(0.5 + 2.0 * shifts * SHIFT)), bounds(Some(-9.0), None)],
        );
        let (task, free, claims) = (case.task(), case.problem.coefficients(), case.claims());
        let mut points = Points { task: &task, free: &free, claims: &claims, lengths: Vec::new(), points: Vec::new() };
        points.first().unwrap();
        (task.contradiction(&points), case.constraints[0].to_string())
    };
    let (names, name) = between(1.0);
    assert_eq!(names, Some(vec![name]));
    assert_eq!([between(3.0).0, between(5.0).0], [None, None]);
}

#[test]
fn the_shift_grows_for_the_proof_and_late() {
    let next =
        |shift: f64, is_complete: bool, count: usize| Rounds { count: count - 1, shift, last: (0.0, 0) }.next(is_complete);
    assert_eq!(
        [next(SHIFT, false, 1), next(SHIFT, false, 25), next(SHIFT, false, 26)],
        [Some(SHIFT), Some(SHIFT), Some(1.25 * SHIFT)]
    );
    assert_eq!([next(SHIFT, true, 1), next(SHIFT, true, 26)], [Some(2.0 * SHIFT); 2]);
    assert_eq!([next(MOST_SHIFT, false, 1), next(MOST_SHIFT / 2.0, true, 1)], [Some(MOST_SHIFT); 2]);
    assert_eq!([next(MOST_SHIFT, false, 26), next(0.75 * MOST_SHIFT, true, 2), next(0.875 * MOST_SHIFT, false, 30)], [None; 3]);
    // So every search for coefficients ends: after 25 rounds and 30 that grow, or 9 of the proof alone.
    let mut rounds = Rounds::new();
    assert_eq!(std::iter::from_fn(|| rounds.next(false)).count(), 55);
    let mut rounds = Rounds::new();
    assert_eq!(std::iter::from_fn(|| rounds.next(true)).count(), 9);
}

#[test]
fn the_shift_does_not_grow_while_violations_fall() {
    let mut rounds = Rounds::new();
    for k in 0..240 {
        assert_eq!(rounds.next(false), Some(SHIFT), "{k}");
        // Halved in five rounds.
        rounds.note(0.87f64.powi(k));
    }
    // From here on nothing falls: 15 rounds after the last one that halved it.
    let mut rounds = Rounds::new();
    let mut grown = (0..80).map(|k| {
        let shift = rounds.next(false);
        rounds.note(if k < 40 { 0.87f64.powi(k) } else { 1.0 });
        shift
    });
    let first = grown.position(|shift| shift != Some(SHIFT)).unwrap();
    assert!((50..=55).contains(&first), "{first}");
    let mut rounds = Rounds::new();
    let halved = std::iter::from_fn(|| {
        rounds.note(0.5f64.powi(rounds.count as i32));
        rounds.next(false)
    });
    assert_eq!(halved.count(), 250);
}

#[test]
fn what_is_not_proven_is_named() {
    let case = Case::new(
        &[[0.0, 4.0]],
        &[&[0], &[1]],
        &line(&[0.0, 4.0], |x| x),
        &[bounds(Some(-1.0), Some(9.0)), rising(), bounds(None, Some(8.0))],
    );
    let slack = 4e-12;
    let found = [1.0, -1.0, -slack, -1.5 * slack].map(|bound| Found { bound, seen: 0.0, shares: vec![0.0] });
    assert!(case.task().is_proven(&found[2..3]) && !case.task().is_proven(&found[2..]));
    let rounds = Rounds { count: 7, shift: 2e-4, last: (0.0, 0) };
    let told = NotProven::new(&case.task(), &case.claims(), &found, &rounds, 0.25, Stop::LargestShift);
    let names: Vec<&String> = told.constraints.iter().map(|one| &one.constraint).collect();
    assert_eq!(names, [&case.constraints[0].to_string(), &case.constraints[2].to_string()]);
    assert_eq!((told.shift, told.rounds, told.work), (MOST_SHIFT, 7, 0.25));
    // The worse of both bounds; 4 is the spread.
    assert_eq!(
        (told.constraints[0].bound, told.constraints[0].share_of_spread, told.constraints[0].seen),
        (-1.0, -0.25, Some(0.0))
    );
    // Share 0 of [0, 4].
    assert_eq!(told.constraints[0].at.as_ref().map(|at| at.0[0].1), Some(0.0));
    let words = told.to_string();
    for part in [
        "is proven to be at least -1.00e0, 2.5e-1 of the spread, but 0 is required; holds at all examined points, smallest value found 0.00e0 at",
        "The search ended after 7 rounds and 25 % of the work for proofs: the constraints were enforced with a margin of 1.0e-4 of the spread",
    ] {
        assert!(words.contains(part), "{words}");
    }
    let broken = Found { bound: -2.0, seen: -0.5, shares: vec![1.0] };
    let unseen = [0.0, 0.0, 0.0].map(|bound| Found { bound, seen: f64::INFINITY, shares: vec![] });
    let all: Vec<Found> = std::iter::once(broken).chain(unseen).collect();
    let told = NotProven::new(&case.task(), &case.claims(), &all, &rounds, 1.0, Stop::Program);
    assert_eq!((told.constraints.len(), told.work, told.constraints[0].seen), (1, 1.0, Some(-0.5)));
    assert!(told.to_string().contains("broken, smallest value found -5.00e-1"), "{told}");
}

#[test]
fn a_proof_is_sought_for_what_has_none() {
    // The first claim is said to have no proof, and the squares give one; the second has one, and is not asked again: the bound that it is said to
    // have stays.
    let case = Case::new(
        &[[-1.0, 1.0]],
        &[&[0], &[2]],
        &line(&[-1.0, -0.5, 0.5, 1.0], |x| x * x),
        &[bounds(Some(-1.0), None), bounds(None, Some(2.0))],
    );
    let (task, claims) = (case.task(), case.claims());
    let coefficients: Vec<f64> = task.surface.terms.iter().map(|term| term.coefficient).collect();
    let unproven = || {
        let found = |bound| Found { bound, seen: 0.0, shares: vec![0.5] };
        vec![found(-1.0), found(0.25)]
    };
    assert!(task.is_unbroken(&unproven()) && !task.is_proven(&unproven()));
    let mut work = Work { left: MOST_WORK };
    let again = task.proof(&claims, &coefficients, unproven(), &mut work);
    assert!(again[0].bound >= task.enough() && again[1].bound == 0.25, "{} {}", again[0].bound, again[1].bound);
    // One input and one entry: three moments, 27 multiplications a step.
    let spent = MOST_WORK - work.left;
    assert!(spent > 0 && spent.is_multiple_of(27) && spent < 50 * 27, "{spent}");
    work.left = 26;
    let kept = task.proof(&claims, &coefficients, unproven(), &mut work);
    assert_eq!(([kept[0].bound, kept[1].bound], work.left), ([-1.0, 0.25], 26), "nothing is left for it");
    let broken = vec![Found { bound: -1.0, seen: -1e-6, shares: vec![0.5] }];
    assert!(!task.is_unbroken(&broken));
}

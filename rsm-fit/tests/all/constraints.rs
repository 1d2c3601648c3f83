//! Constraints on surfaces: cases calculated by hand, and dense grids evaluated by the interpreter, which shares no code with the fit.

use nalgebra::{DMatrix, DVector};
use rsm_core::check::Checked;
use rsm_core::lower;
use rsm_core::number::Precision;
use rsm_core::run::Interpreter;
use rsm_fit::constrain::{ConstraintStatistics, SHIFT};
use rsm_fit::fit::{Outcome, Verdict};
use rsm_fit::statistics::ResponseStatistics;

use crate::data::{Files, fitted};

/// Fits y as a function of x (range from the data) or of x and z.
fn fit(header: &str, rows: &[Vec<f64>], rest: &str) -> Outcome {
    let files = Files::default();
    let line = |row: &Vec<f64>| row.iter().map(|value| format!("{value:e}")).collect::<Vec<_>>().join(",") + "\n";
    files.file("data.csv", &(header.to_string() + "\n" + &rows.iter().map(line).collect::<String>()));
    let inputs: Vec<&str> =
        header.split(',').filter_map(|cell| cell.split_once('[').map(|(name, _)| name)).filter(|name| *name != "y").collect();
    let sections: String = inputs.iter().map(|input| format!("[inputs.{input}]\n")).collect();
    let names = inputs.iter().map(|input| format!("\"{input}\"")).collect::<Vec<_>>().join(", ");
    let text =
        format!("format = 1\nmodel = \"m\"\ndata = [\"data.csv\"]\n{sections}[responses.y]\ninputs = [{names}]\n{rest}\n");
    fitted(&text, &files)
}

fn statistics(outcome: &Outcome) -> &ResponseStatistics {
    outcome.responses[0].statistics.as_ref().unwrap_or_else(|| panic!("{}", outcome.responses[0].verdict))
}

fn told(outcome: &Outcome) -> &ConstraintStatistics {
    statistics(outcome).constraints.as_ref().unwrap()
}

fn coefficients(outcome: &Outcome) -> Vec<f64> {
    outcome.model.surfaces[0].terms.iter().map(|term| term.coefficient).collect()
}

/// The surface and its support test, through their tapes.
fn evaluator(outcome: &Outcome) -> impl FnMut(&[f64]) -> (f64, bool) + use<> {
    let checked = Checked::from_model(&outcome.model).unwrap();
    let tape = lower::surface(&checked, 0, Precision::F64);
    let support = lower::support(&checked, 0, Precision::F64);
    move |point: &[f64]| {
        let inside = support.as_ref().is_none_or(|tape| Interpreter::<f64>::new(tape).eval(point) == 1.0);
        (Interpreter::<f64>::new(&tape).eval(point), inside)
    }
}

/// A grid of n values from low to high.
fn grid(low: f64, high: f64, n: u32) -> Vec<f64> {
    (0..n).map(|k| low + (high - low) * f64::from(k) / f64::from(n - 1)).collect()
}

/// The tolerance of an evaluator: rounding of about 10^-15 of values near 1, and the slack of the proof, 10^-12 of the spread.
const ROUNDING: f64 = 1e-11;

const LINE: &str = "select = { method = \"fixed\", order = 1 }";
const PARABOLA: &str = "select = { method = \"fixed\", order = 2 }";

#[test]
fn a_falling_line_that_must_not_fall_becomes_the_mean() {
    let rows: Vec<Vec<f64>> = (0..=10).map(|k| vec![f64::from(k), 5.0 - f64::from(k) + f64::from(k % 2)]).collect();
    let mean = rows.iter().map(|row| row[1]).sum::<f64>() / 11.0;
    let rest = format!("{LINE}\nconstraints = [{{ kind = \"monotone\", input = \"x\", direction = \"increasing\" }}]");
    let outcome = fit("x[A],y[V]", &rows, &rest);
    let found = coefficients(&outcome);
    // The sum of coded x over this grid is 0, so the constant is the mean for any slope. The slope is the shift.
    assert!((found[0] - mean).abs() < 1e-15 * 10.0, "{found:?} {mean}");
    let spread = 10.0;
    assert!((found[1] / (SHIFT * spread) - 1.0).abs() < 1e-12, "{found:?}");
    let told = told(&outcome);
    assert!(told.active && told.constraints[0].distance >= 0.0 && !told.constraints[0].points.is_empty(), "{told:?}");
    // The largest change is at an end of the range: the slope of the unconstrained line times half the range.
    let free = fit("x[A],y[V]", &rows, LINE);
    let change = told.largest_change.as_ref().unwrap();
    assert!((change.value.abs() - coefficients(&free)[1].abs()).abs() < 1e-5, "{change:?}");
    assert!(change.at.0[0].1 == 0.0 || change.at.0[0].1 == 10.0, "{change:?}");
    assert_eq!(told.residual_sd_without, statistics(&free).residual_sd);
    assert!(statistics(&outcome).residual_sd > told.residual_sd_without);
    // Statistics that need unconstrained least squares are not given.
    assert!(statistics(&outcome).terms.iter().all(|term| term.standard_error.is_none() && term.p.is_none()));
}

#[test]
fn a_parabola_that_must_not_be_negative_touches_zero_where_it_was_least() {
    // y = x^2 - 0.1 at -1, -0.5, 0, 0.5, 1: by symmetry y = a + c x^2 with a = 0 and c = sum x^2 y/sum x^4 = 1.875/2.125.
    let rows: Vec<Vec<f64>> = grid(-1.0, 1.0, 5).into_iter().map(|x| vec![x, x * x - 0.1]).collect();
    let rest = format!("{PARABOLA}\nconstraints = [{{ kind = \"bounds\", min = 0.0 }}]");
    let outcome = fit("x[A],y[V]", &rows, &rest);
    let found = coefficients(&outcome);
    // The spread is 1, so a is the shift, and c is smaller by shift * sum x^2/sum x^4.
    assert!((found[0] - SHIFT).abs() < 1e-13 && found[1].abs() < 1e-13, "{found:?}");
    assert!((found[2] - (1.875 - SHIFT * 2.5) / 2.125).abs() < 1e-13, "{found:?}");
    let report = &told(&outcome).constraints[0];
    assert_eq!(report.constraint, "bounds min 0");
    assert!(report.points.len() == 1 && report.points[0].0[0].1.abs() < 1e-3, "{report:?}");
    // The constraint is proven, and its distance is no more than the shift.
    assert!((0.0..=SHIFT).contains(&report.distance), "{report:?}");
}

#[test]
fn constraints_that_hold_anyway_leave_every_bit() {
    let rows: Vec<Vec<f64>> =
        (0..=10).map(|k| vec![f64::from(k), 1.0 + 0.3 * f64::from(k) + 0.01 * f64::from(k * k % 7)]).collect();
    let constraints = "constraints = [{ kind = \"bounds\", min = 0.0, max = 9.0 }, { kind = \"monotone\", input = \"x\", direction = \"increasing\" }]";
    let free = fit("x[A],y[V]", &rows, PARABOLA);
    let kept = fit("x[A],y[V]", &rows, &format!("{PARABOLA}\n{constraints}"));
    let bits = |outcome: &Outcome| coefficients(outcome).iter().map(|b| b.to_bits()).collect::<Vec<u64>>();
    assert_eq!(bits(&free), bits(&kept));
    assert!(!told(&kept).active && told(&kept).largest_change.is_none());
    // The proven distances are the true ones, to the accuracy of the search: the smallest value is 1, and the slope is smallest at an end.
    assert!(told(&kept).constraints.iter().all(|report| report.distance > 0.0), "{:?}", told(&kept));
    assert_eq!(statistics(&free).terms, statistics(&kept).terms);
}

#[test]
fn contradictions_are_an_outcome_with_names() {
    let rows: Vec<Vec<f64>> = grid(-2.0, 2.0, 9).into_iter().map(|x| vec![x, x]).collect();
    // An odd surface is 0 at 0, for any coefficients.
    let odd = "symmetry = { x = \"odd\" }\n";
    for (rest, expected) in [
        (format!("{odd}{LINE}\nconstraints = [{{ kind = \"bounds\", min = 1.0 }}]"), "bounds min 1"),
        (
            "select = { method = \"fixed\" }\nterms = [[1]]\nconstraints = [{ kind = \"bounds\", max = -1.0 }]".to_string(),
            "bounds max -1",
        ),
        (
            format!(
                "{LINE}\nconstraints = [{{ kind = \"bounds\", min = 1.0 }}, {{ kind = \"convex\" }}, {{ kind = \"bounds\", max = 0.5 }}]"
            ),
            "bounds min 1; bounds max 0.5",
        ),
    ] {
        let outcome = fit("x[A],y[V]", &rows, &rest);
        assert!(outcome.model.surfaces.is_empty() && !outcome.reached());
        let Verdict::Infeasible { constraints } = &outcome.responses[0].verdict else {
            panic!("{rest}: {}", outcome.responses[0].verdict)
        };
        assert_eq!(constraints.join("; "), expected);
    }
}

#[test]
fn a_bound_holds_on_both_sides_of_an_odd_input() {
    // y = x for -2 to 2. If y is above -1 at x < 0, it is below 1 at x > 0, because the surface is odd: the slope is 1/2 minus the shift.
    let rows: Vec<Vec<f64>> = grid(-2.0, 2.0, 9).into_iter().map(|x| vec![x, x]).collect();
    for bound in ["min = -1", "max = 1", "min = -1, max = 3"] {
        let rest = format!("symmetry = {{ x = \"odd\" }}\n{LINE}\nconstraints = [{{ kind = \"bounds\", {bound} }}]");
        let outcome = fit("x[A],y[V]", &rows, &rest);
        let mut value = evaluator(&outcome);
        let ends = [value(&[-2.0]).0, value(&[2.0]).0];
        // The spread is 4.
        assert!((ends[1] - (1.0 - 4.0 * SHIFT)).abs() < ROUNDING && ends[0] == -ends[1], "{bound}: {ends:?}");
    }
}

#[test]
fn a_kink_that_bends_the_wrong_way_is_straightened() {
    // Straight lines on both sides of 2: their own curvature is 0, only the kink has a curvature.
    let form = "knots = [{ input = \"x\", at = 2.0 }]\nselect = { method = \"fixed\" }\nterms = [[0, 0], [1, 0], [0, 1]]";
    for (kind, sign) in [("convex", 1.0), ("concave", -1.0)] {
        let rows: Vec<Vec<f64>> = grid(0.0, 6.0, 13).into_iter().map(|x| vec![x, -sign * (x - 2.0).abs()]).collect();
        let rest = format!("{form}\nconstraints = [{{ kind = \"{kind}\" }}]");
        let outcome = fit("x[A],y[V]", &rows, &rest);
        // The spread is 4. Without the constraint, the hinge of -|x - 2| is -2 per unit of x, -6 per half range.
        let hinge = coefficients(&outcome)[2];
        assert!((sign * hinge - 4.0 * SHIFT).abs() < ROUNDING, "{kind}: {hinge}");
        let report = &told(&outcome).constraints[0];
        assert!(report.points.iter().all(|point| point.0[0].1 == 2.0) && report.points.len() == 1, "{report:?}");
    }
}

/// Deterministic noise: the fractional part of a multiple of the golden ratio, in [-0.5, 0.5).
fn noise(k: usize) -> f64 {
    (k as f64 * 0.618_033_988_749_894_9).fract() - 0.5
}

#[test]
fn monotone_in_every_form_of_surface() {
    let rows: Vec<Vec<f64>> =
        grid(1.0, 9.0, 33).into_iter().enumerate().map(|(k, x)| vec![x, (x - 3.0).abs().sqrt() + noise(k)]).collect();
    let two_sided: Vec<Vec<f64>> =
        grid(-9.0, 9.0, 37).into_iter().enumerate().map(|(k, x)| vec![x, x.sin() + 0.2 * noise(k)]).collect();
    for (rows, form) in [
        (&rows, "select = { method = \"fixed\", order = 5 }"),
        (&rows, "coding = \"none\"\nselect = { method = \"fixed\", order = 4 }"),
        (&rows, "reciprocal = [\"x\"]\nselect = { method = \"fixed\", order = 4 }"),
        (&rows, "coding = \"none\"\nreciprocal = [\"x\"]\nselect = { method = \"fixed\", order = 3 }"),
        (
            &rows,
            "knots = [{ input = \"x\", at = 3.0 }, { input = \"x\", at = 6.0 }]\nselect = { method = \"fixed\" }\n\
             terms = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 2, 0], [0, 0, 1], [0, 0, 2]]",
        ),
        (
            &rows,
            "reciprocal = [\"x\"]\nknots = [{ input = \"x\", at = 3.0 }]\nselect = { method = \"fixed\" }\n\
             terms = [[0, 0], [1, 0], [2, 0], [0, 1], [0, 2]]",
        ),
        (&two_sided, "symmetry = { x = \"odd\" }\nselect = { method = \"fixed\", order = 5 }"),
    ] {
        for (direction, sign) in [("increasing", 1.0), ("decreasing", -1.0)] {
            let rest = format!("{form}\nconstraints = [{{ kind = \"monotone\", input = \"x\", direction = \"{direction}\" }}]");
            let outcome = fit("x[A],y[V]", rows, &rest);
            assert!(told(&outcome).active, "{rest}");
            let mut value = evaluator(&outcome);
            let values: Vec<f64> = grid(rows[0][0], rows[rows.len() - 1][0], 5001).iter().map(|x| value(&[*x]).0).collect();
            let worst = values.windows(2).map(|pair| sign * (pair[1] - pair[0])).fold(f64::INFINITY, f64::min);
            assert!(worst > -ROUNDING, "{rest}: {worst}");
            // The constraint is active, so the residual standard deviation is larger than without it.
            let free = told(&outcome).residual_sd_without.unwrap();
            assert!(statistics(&outcome).residual_sd.unwrap() > free, "{rest}");
        }
    }
}

/// A saddle-like response over two inputs, negative in the corner of high x and low z.
fn corner() -> Vec<Vec<f64>> {
    let mut rows = Vec::new();
    for x in grid(0.0, 4.0, 9) {
        for z in grid(-3.0, 3.0, 9) {
            rows.push(vec![x, z, 2.0 - 0.8 * x + 0.4 * z + 0.1 * x * x + 0.1 * x * z + 0.1 * noise(rows.len())]);
        }
    }
    rows
}

/// Least squares with a penalty on a dense grid, by Newton's method. Its result is a lower bound of the constrained residual sum of squares, because
/// a penalty and a grid are both weaker than the constraint.
fn penalised(rows: &[Vec<f64>], order: u32, least: f64) -> f64 {
    let powers: Vec<[i32; 2]> = (0..=order as i32).flat_map(|n| (0..=n).map(move |k| [n - k, k])).collect();
    let row = |x: f64, z: f64| {
        DVector::from_iterator(powers.len(), powers.iter().map(|p| ((x - 2.0) / 2.0).powi(p[0]) * (z / 3.0).powi(p[1])))
    };
    let design = DMatrix::from_rows(&rows.iter().map(|r| row(r[0], r[1]).transpose()).collect::<Vec<_>>());
    let response = DVector::from_iterator(rows.len(), rows.iter().map(|r| r[2]));
    let points: Vec<DVector<f64>> = grid(0.0, 4.0, 49)
        .iter()
        .flat_map(|x| grid(-3.0, 3.0, 49).into_iter().map(|z| row(*x, z)).collect::<Vec<_>>())
        .collect();
    let mut b = DVector::zeros(powers.len());
    for weight in [1e2, 1e4, 1e6] {
        let value = |b: &DVector<f64>| {
            let missing = |point: &DVector<f64>| (least - point.dot(b)).max(0.0).powi(2);
            (&design * b - &response).norm_squared() + weight * points.iter().map(missing).sum::<f64>()
        };
        for _ in 0..50 {
            let mut matrix = design.transpose() * &design;
            let mut right = design.transpose() * &response;
            for point in points.iter().filter(|point| point.dot(&b) < least) {
                matrix += weight * point * point.transpose();
                right += weight * least * point;
            }
            let step = matrix.cholesky().unwrap().solve(&right) - &b;
            let now = value(&b);
            // A full step may violate rows that were not active, so the step is halved until it reduces the sum.
            let Some(share) = (0..30).map(|k| 0.5f64.powi(k)).find(|share| value(&(&b + *share * &step)) < now) else { break };
            b += share * step;
        }
    }
    (&design * &b - response).norm_squared()
}

#[test]
fn bounds_in_two_inputs_cost_what_brute_force_finds() {
    for order in [2, 3] {
        let rest =
            format!("select = {{ method = \"fixed\", order = {order} }}\nconstraints = [{{ kind = \"bounds\", min = 0.4 }}]");
        let outcome = fit("x[A],z[A],y[V]", &corner(), &rest);
        let mut value = evaluator(&outcome);
        let least = grid(0.0, 4.0, 201)
            .iter()
            .flat_map(|x| grid(-3.0, 3.0, 201).into_iter().map(|z| value(&[*x, z]).0).collect::<Vec<_>>())
            .fold(f64::INFINITY, f64::min);
        // The constraint is satisfied everywhere, and active somewhere. The grid contains the corner; an active point inside is at most 1/100 from a
        // grid point.
        assert!(least > 0.4 - ROUNDING && least < 0.4 + 1e-3, "{order}: {least}");
        let freedom = statistics(&outcome).rows - statistics(&outcome).terms.len();
        let found = statistics(&outcome).residual_sd.unwrap().powi(2) * freedom as f64;
        let bound = penalised(&corner(), order, 0.4);
        // An active point may be 1/48 of a side from the grid of the brute-force method: about 10^-4 of the value, 10^-6 in the penalty.
        assert!(found > bound * (1.0 - 1e-9) && found < bound * (1.0 + 1e-3), "{order}: {found} {bound}");
        assert!(statistics(&outcome).residual_sd.unwrap() > 1.01 * told(&outcome).residual_sd_without.unwrap());
    }
}

#[test]
fn a_corner_that_the_support_leaves_out_is_not_constrained() {
    // Without the corner of high x and low z, where the response is negative.
    let rows: Vec<Vec<f64>> = corner().into_iter().filter(|row| row[0] / 4.0 - row[1] / 3.0 < 1.1).collect();
    let rest = format!("{PARABOLA}\nconstraints = [{{ kind = \"bounds\", min = 0.75 }}]");
    let whole = fit("x[A],z[A],y[V]", &rows, &rest);
    let supported = fit("x[A],z[A],y[V]", &rows, &format!("support = \"data\"\n{rest}"));
    let sd = |outcome: &Outcome| statistics(outcome).residual_sd.unwrap();
    assert!(told(&whole).active && told(&supported).active);
    assert!(sd(&supported) < 0.99 * sd(&whole), "{} {}", sd(&supported), sd(&whole));
    let mut value = evaluator(&supported);
    let (mut least_inside, mut least) = (f64::INFINITY, f64::INFINITY);
    for x in grid(0.0, 4.0, 401) {
        for z in grid(-3.0, 3.0, 401) {
            let (y, inside) = value(&[x, z]);
            least = least.min(y);
            least_inside = if inside { least_inside.min(y) } else { least_inside };
        }
    }
    // The constraint is satisfied where there are data, and violated where there are none. The bound is active at the edge, to within one cell of the
    // search and one cell of this grid.
    assert!(least_inside > 0.75 - ROUNDING && least_inside < 0.76, "{least_inside}");
    assert!(least < 0.7, "{least}");
}

#[test]
fn convex_and_concave_hold_between_any_two_points() {
    let wavy: Vec<Vec<f64>> = grid(0.0, 6.0, 31)
        .into_iter()
        .enumerate()
        .map(|(k, x)| vec![x, (1.5 * x).sin() + 0.1 * x * x + 0.1 * noise(k)])
        .collect();
    let knots = "knots = [{ input = \"x\", at = 2.0 }, { input = \"x\", at = 4.0 }]\nselect = { method = \"fixed\" }\n\
                 terms = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [2, 0, 0], [0, 3, 0]]";
    let saddle: Vec<Vec<f64>> =
        corner().into_iter().map(|row| vec![row[0], row[1], row[2] + 0.5 * row[0] * row[1] + 0.05 * row[0].powi(3)]).collect();
    let cases: [(&str, &[Vec<f64>], &str); 4] = [
        ("x[A],y[V]", &wavy, "select = { method = \"fixed\", order = 5 }"),
        ("x[A],y[V]", &wavy, knots),
        ("x[A],z[A],y[V]", &saddle, "select = { method = \"fixed\", order = 2 }"),
        ("x[A],z[A],y[V]", &saddle, "coding = \"none\"\nselect = { method = \"fixed\", order = 3 }"),
    ];
    for (header, rows, form) in cases {
        for (kind, sign) in [("convex", 1.0), ("concave", -1.0)] {
            let rest = format!("{form}\nconstraints = [{{ kind = \"{kind}\" }}]");
            let outcome = fit(header, rows, &rest);
            assert!(told(&outcome).active, "{rest}");
            let mut value = evaluator(&outcome);
            let inputs = rows[0].len() - 1;
            let range: Vec<[f64; 2]> = outcome.model.inputs.iter().map(|input| input.range).collect();
            let at = |k: usize, axis: usize| range[axis][0] + (range[axis][1] - range[axis][0]) * (noise(k) + 0.5);
            for k in 0..2000 {
                let one: Vec<f64> = (0..inputs).map(|axis| at(7 * k + axis, axis)).collect();
                let other: Vec<f64> = (0..inputs).map(|axis| at(13 * k + 5 + 3 * axis, axis)).collect();
                let middle: Vec<f64> = one.iter().zip(&other).map(|(a, b)| (a + b) / 2.0).collect();
                let bulge = sign * ((value(&one).0 + value(&other).0) / 2.0 - value(&middle).0);
                assert!(bulge > -ROUNDING, "{rest}: {bulge} between {one:?} and {other:?}");
            }
        }
    }
}

#[test]
fn the_evidence_and_the_report_say_what_the_constraints_cost() {
    let rest = format!("{PARABOLA}\nconstraints = [{{ kind = \"bounds\", min = 0.4 }}]");
    let outcome = fit("x[A],z[A],y[V]", &corner(), &rest);
    let written = rsm_core::model_file::write(&outcome.model);
    for words in
        ["constraints = { active = true", "constraint = \"bounds min 0.4\"", "residual_sd_without = ", "largest_change = "]
    {
        assert!(written.contains(words), "{words}: {written}");
    }
    let report = serde_json::to_value(outcome.report()).unwrap();
    let told = &report["responses"]["y"]["constraints"];
    assert_eq!(told["active"], true);
    assert_eq!(told["constraints"][0]["constraint"], "bounds min 0.4");
    assert!(told["constraints"][0]["points"][0]["x"].is_number() && told["largest_change"]["at"]["z"].is_number(), "{told}");
    assert!(report["responses"]["y"]["terms"][0]["standard_error"].is_null());
}

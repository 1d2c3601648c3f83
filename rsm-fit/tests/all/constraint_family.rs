//! Random feasible problems with constraints, from a seed. Each fit must end with a proof, near the smallest residual sum of squares.
//!
//! A constant satisfies any bounds that contain it, and is monotone and convex. So with a constant term every problem here has a solution.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, NonnegativeConeT};
use nalgebra::{DMatrix, DVector};
use rsm_fit::fit::{Outcome, Verdict};
use rsm_fit::random::Random;

use crate::data::{Files, fitted};

/// A specification and its data.
struct Problem {
    specification: String,
    data: String,
    name: String,
    order: usize,
    rows: Vec<(Vec<f64>, f64)>,
    asked: Asked,
}

/// A constraint over [-1, 1] for every input.
#[derive(Clone, Copy)]
enum Asked {
    Bounds(f64, f64),
    /// The sign of the slope with respect to the first input.
    Monotone(f64),
    Convex,
}

fn problem(seed: u64) -> Problem {
    let mut random = Random::new(seed);
    let inputs = 1 + (seed % 4) as usize;
    let order = 2 + (seed / 4 % 4) as usize;
    let kind = seed / 16 % 3;
    // The number of terms, and half as many rows again.
    let terms = (1..=inputs).fold(1, |count, k| count * (order + k) / k);
    let count = terms * 3 / 2 + 10;
    let slopes: Vec<f64> = (0..inputs).map(|_| random.normal()).collect();
    let curves: Vec<f64> = (0..inputs).map(|_| random.normal()).collect();
    let noise = 0.3 + random.share();
    let names: Vec<String> = (0..inputs).map(|k| format!("x{k}")).collect();
    let mut data = names.iter().map(|name| format!("{name}[1],")).collect::<String>() + "y[1]\n";
    let mut rows = Vec::new();
    for _ in 0..count {
        let x: Vec<f64> = (0..inputs).map(|_| 2.0 * random.share() - 1.0).collect();
        let y: f64 = (0..inputs).map(|k| slopes[k] * x[k] + curves[k] * x[k] * x[k]).sum::<f64>() + (2.0 * x[0]).sin();
        let y = y + noise * random.normal();
        data += &x.iter().map(|x| format!("{x:e},")).collect::<String>();
        data += &format!("{y:e}\n");
        rows.push((x, y));
    }
    let (constraint, asked) = match kind {
        0 => {
            let (min, max) = (-0.5 - random.share(), 0.5 + random.share());
            (format!("{{ kind = \"bounds\", min = {min}, max = {max} }}"), Asked::Bounds(min, max))
        }
        1 => {
            let (direction, sign) = if slopes[0] > 0.0 { ("increasing", 1.0) } else { ("decreasing", -1.0) };
            let constraint = format!("{{ kind = \"monotone\", input = \"x0\", direction = \"{direction}\" }}");
            (constraint, Asked::Monotone(sign))
        }
        _ => ("{ kind = \"convex\" }".to_string(), Asked::Convex),
    };
    let sections: String = names.iter().map(|name| format!("[inputs.{name}]\nrange = [-1.0, 1.0]\n")).collect();
    let list = names.iter().map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(", ");
    let specification = format!(
        "format = 1\nmodel = \"m\"\ndata = [\"data.csv\"]\n{sections}[responses.y]\ninputs = [{list}]\n\
         select = {{ method = \"fixed\", order = {order} }}\nconstraints = [{constraint}]\n"
    );
    let name = format!("seed {seed}: {inputs} inputs, order {order}, {constraint}");
    Problem { specification, data, name, order, rows, asked }
}

fn solved(problem: &Problem) -> Outcome {
    fitted(&problem.specification, &Files::of("data.csv", &problem.data))
}

/// A lower bound of the smallest residual sum of squares: a quadratic program in plain monomials with the constraint at some points only. Points are
/// added where the solution violates the constraint, so the bound approaches the smallest sum; it is a valid bound in each round. It stops when the
/// bound is sufficiently close to `found`.
fn relaxed(problem: &Problem, near: &[Vec<f64>], found: f64) -> f64 {
    let inputs = problem.rows[0].0.len();
    let powers: Vec<Vec<i32>> = (0..inputs).fold(vec![vec![]], |begun: Vec<Vec<i32>>, _| {
        let longer = |start: &Vec<i32>| {
            let left = problem.order as i32 - start.iter().sum::<i32>();
            (0..=left).map(|power| [&start[..], &[power]].concat()).collect::<Vec<_>>()
        };
        begun.iter().flat_map(longer).collect()
    });
    // The value of each monomial, differentiated `orders[k]` times with respect to input k.
    let derived = |x: &[f64], orders: &[i32]| -> Vec<f64> {
        let one = |x: f64, power: i32, order: i32| {
            let factor: f64 = (0..order).map(|k| f64::from(power - k)).product();
            if power < order { 0.0 } else { factor * x.powi(power - order) }
        };
        powers.iter().map(|term| (0..inputs).map(|k| one(x[k], term[k], orders[k])).product()).collect()
    };
    let unit =
        |axes: &[usize]| (0..inputs).map(|k| axes.iter().filter(|axis| **axis == k).count() as i32).collect::<Vec<i32>>();
    // The rows n . b >= d of the constraint at a point. For a convex surface: the row for the direction of smallest curvature.
    let asked = |x: &[f64], b: &DVector<f64>| -> Vec<(Vec<f64>, f64)> {
        match problem.asked {
            Asked::Bounds(low, high) => {
                let value = derived(x, &unit(&[]));
                let opposite = value.iter().map(|v| -v).collect();
                vec![(value, low), (opposite, -high)]
            }
            Asked::Monotone(sign) => vec![(derived(x, &unit(&[0])).iter().map(|v| sign * v).collect(), 0.0)],
            Asked::Convex => {
                let second: Vec<Vec<DVector<f64>>> =
                    (0..inputs).map(|a| (0..inputs).map(|c| DVector::from(derived(x, &unit(&[a, c])))).collect()).collect();
                let curvature = DMatrix::from_fn(inputs, inputs, |a, c| second[a][c].dot(b)).symmetric_eigen();
                let least = curvature.eigenvalues.imin();
                let u = curvature.eigenvectors.column(least);
                let mut row = DVector::zeros(powers.len());
                for a in 0..inputs {
                    for c in 0..inputs {
                        row += u[a] * u[c] * &second[a][c];
                    }
                }
                vec![(row.as_slice().to_vec(), 0.0)]
            }
        }
    };
    let design = DMatrix::from_row_iterator(
        problem.rows.len(),
        powers.len(),
        problem.rows.iter().flat_map(|(x, _)| derived(x, &unit(&[]))),
    );
    let response = DVector::from_iterator(problem.rows.len(), problem.rows.iter().map(|(_, y)| *y));
    let square = design.transpose() * &design;
    let right = design.transpose() * &response;
    let mut b = square.clone().cholesky().unwrap().solve(&right);
    let mut random = Random::new(7);
    let mut rows: Vec<(Vec<f64>, f64)> = Vec::new();
    let mut known = near.to_vec();
    let sum = |b: &DVector<f64>| (&design * b - &response).norm_squared();
    // Usually about forty rounds are needed. A convex surface in four inputs needs three times as many, because the error of the bound falls by a
    // tenth in each round.
    for _ in 0..200 {
        if found / sum(&b) - 1.0 < NEAR / 2.0 {
            break;
        }
        let mut points = known.clone();
        points.extend((0..4000).map(|_| {
            // Half of the coordinates are at an end of the range, because many constraints are active there.
            (0..inputs).map(|_| (4.0 * random.share() - 2.0).clamp(-1.0, 1.0)).collect::<Vec<f64>>()
        }));
        for point in &known {
            for reach in [0.1, 0.01] {
                let moved = |x: &f64, share: f64| (x + reach * (2.0 * share - 1.0)).clamp(-1.0, 1.0);
                points.extend((0..8).map(|_| point.iter().map(|x| moved(x, random.share())).collect::<Vec<f64>>()));
            }
        }
        type Broken = (f64, Vec<f64>, (Vec<f64>, f64));
        let mut broken: Vec<Broken> = Vec::new();
        for x in points {
            for (row, least) in asked(&x, &b) {
                let missing = least - row.iter().zip(b.iter()).map(|(n, b)| n * b).sum::<f64>();
                if missing > 1e-7 {
                    broken.push((missing, x.clone(), (row, least)));
                }
            }
        }
        if broken.is_empty() {
            break;
        }
        broken.sort_by(|one, other| other.0.total_cmp(&one.0));
        // The points must not all be close together.
        let mut apart: Vec<Vec<f64>> = Vec::new();
        for (_, x, row) in broken {
            let is_near = |other: &Vec<f64>| other.iter().zip(&x).all(|(a, b)| (a - b).abs() < 0.03);
            if apart.len() < 40 && !apart.iter().any(is_near) {
                apart.push(x.clone());
                known.push(x);
                rows.push(row);
            }
        }
        b = program(&square, &right, &rows);
    }
    sum(&b)
}

/// The share by which a sum of squares may exceed the smallest one.
const NEAR: f64 = 1e-4;

/// The vector b with the smallest b'Sb/2 - r'b that satisfies the rows.
fn program(square: &DMatrix<f64>, right: &DVector<f64>, rows: &[(Vec<f64>, f64)]) -> DVector<f64> {
    let width = right.len();
    let column = |k: usize, values: Vec<f64>| (k, values);
    let sparse = |height: usize, columns: Vec<(usize, Vec<f64>)>| {
        let starts = columns.iter().scan(0, |end, (_, values)| {
            *end += values.len();
            Some(*end)
        });
        let starts: Vec<usize> = std::iter::once(0).chain(starts).collect();
        let places = columns.iter().flat_map(|(_, values)| 0..values.len()).collect();
        CscMatrix::new(height, width, starts, places, columns.into_iter().flat_map(|(_, values)| values).collect())
    };
    let upper = sparse(width, (0..width).map(|k| column(k, (0..=k).map(|row| square[(row, k)]).collect())).collect());
    let asked = sparse(rows.len(), (0..width).map(|k| column(k, rows.iter().map(|(n, _)| -n[k]).collect())).collect());
    let bounds: Vec<f64> = rows.iter().map(|(_, least)| -least).collect();
    let settings = DefaultSettingsBuilder::default().verbose(false).max_threads(1).build().unwrap();
    let linear: Vec<f64> = right.iter().map(|r| -r).collect();
    let mut solver = DefaultSolver::new(&upper, &linear, &asked, &bounds, &[NonnegativeConeT(rows.len())], settings).unwrap();
    solver.solve();
    DVector::from(solver.solution.x.clone())
}

/// Fits the problem of a seed. Returns the fault, if there is one.
fn fault(seed: u64) -> Option<String> {
    let problem = problem(seed);
    let begin = std::time::Instant::now();
    let outcome = solved(&problem);
    let seconds = begin.elapsed().as_secs_f64();
    if outcome.responses[0].verdict != Verdict::Fitted {
        return Some(format!("{}: {} after {seconds:.1} s", problem.name, outcome.responses[0].verdict));
    }
    println!("seed {seed}: proven after {seconds:.1} s");
    let statistics = outcome.responses[0].statistics.as_ref().unwrap();
    let told = statistics.constraints.as_ref().unwrap();
    let near: Vec<Vec<f64>> =
        told.constraints[0].points.iter().map(|point| point.0.iter().map(|(_, x)| *x).collect()).collect();
    let freedom = statistics.rows - statistics.terms.len();
    let found = statistics.residual_sd.unwrap().powi(2) * freedom as f64;
    let bound = relaxed(&problem, &near, found);
    let excess = found / bound - 1.0;
    println!(
        "{}: {} rounds, shift {:.1e}, {seconds:.1} s, {excess:.1e} above the bound",
        problem.name, told.rounds, told.shift
    );
    // The sum must not be below a lower bound, with the tolerance of the solver, 1e-8, and not far above it.
    (!(-1e-6..NEAR).contains(&excess)).then(|| format!("{}: {excess:e} above the least sum of squares", problem.name))
}

fn expect_none(seeds: impl Iterator<Item = u64>) {
    let faults: Vec<String> = seeds.filter_map(fault).collect();
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn feasible_bounds_and_slopes_end_with_a_proof_near_the_least_sum_of_squares() {
    // Two problems that exchange of the worst point alone leaves without a proof (10, 26), and some with one and two inputs.
    expect_none([4, 5, 10, 21, 26, 29].into_iter());
}

#[test]
fn feasible_convex_problems_of_three_and_four_inputs_end_with_a_proof() {
    expect_none([38, 39].into_iter());
}

/// Results before there were proofs by sums of squares, with one process for each seed and a limit of 300 s, on a busy machine. Of seeds 91 to 269,
/// all were proven near the smallest sum except 91, 95, 139, 143, 187, 191, 235 and 239 (convex, four inputs, orders 4 and 5), which did not end; nor
/// did 43. Seed 90 took two minutes, 255 91 s, 266 63 s.
///
/// Results with these proofs, on a busier machine, with a fifth of a core for each process:
///
/// | seed | order | outcome |
/// |---|---|---|
/// | 139 | 4 | proven after 39 rounds and 74 s, shift 2.1e-5, 3.8e-5 above the bound; 52 s of processor time with the bound |
/// | 43, 91, 187, 235 | 4 | proven after 198 s, 133 s, 140 s and 72 s; their bounds were not run to their ends |
/// | 95, 143, 191, 239 | 5 | proven after 396 s, 490 s, 717 s and 794 s, pauses included; their bounds were not run to their ends |
#[test]
#[ignore = "takes hours: SEEDS=0-32 cargo test -p rsm-fit --test all -- --ignored --nocapture every_feasible"]
fn every_feasible_problem_ends_with_a_proof() {
    let seeds = std::env::var("SEEDS")
        .unwrap_or("0-270".into())
        .split_once('-')
        .map(|(a, b)| a.parse::<u64>().unwrap()..b.parse().unwrap())
        .unwrap();
    expect_none(seeds);
}

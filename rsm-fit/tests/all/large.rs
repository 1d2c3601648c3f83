//! Large tables: the same bits for any number of threads, and the figures of their definitions, row by row.

use std::fmt::Write as _;
use std::path::Path;

use rsm_core::source::Source;
use rsm_fit::dd::Dd;
use rsm_fit::design::{Design, Physical, terms_up_to};
use rsm_fit::fit::Outcome;
use rsm_fit::partial;
use rsm_fit::qr::{Compressed, Growing, Triangle};
use rsm_fit::random::Random;
use rsm_fit::statistics::ResponseStatistics;
use rsm_fit::{Fit, Input, Response, threads};

use crate::data::{Files, fitted, specification};

/// What the tables of this file have.
#[derive(Debug, Clone, Copy, Default)]
struct Shape {
    rows: usize,
    /// The number of different values of each input; 0 if all are different.
    levels: u64,
    weights: bool,
    groups: bool,
    missing: bool,
    /// More lines of the response.
    more: &'static str,
}

impl Shape {
    fn specification(&self) -> String {
        let weights = if self.weights { "weights = \"w\"\n" } else { "" };
        let missing = if self.missing { "missing = \"drop-row\"\n" } else { "" };
        let more = self.more;
        format!(
            "format = 1\nmodel = \"m\"\ndata = [\"t.csv\"]\n{missing}[inputs.a]\nunit = \"1\"\nrange = [-1.0, 2.0]\n\
             [inputs.b]\nunit = \"1\"\nrange = [0.0, 4.0]\n[responses.y]\nunit = \"1\"\ninputs = [\"a\", \"b\"]\n{weights}{more}"
        )
    }

    fn table(&self, seed: u64) -> String {
        let mut random = Random::new(seed);
        let mut text = "a[1],b[1],y[1],w[1],g\n".to_string();
        for row in 0..self.rows {
            let mut share =
                || if self.levels > 0 { random.below(self.levels) as f64 / self.levels as f64 } else { random.share() };
            let (a, b) = (-1.0 + 3.2 * share(), 4.0 * share());
            let y =
                1.0 + a - 0.5 * a * b + 0.3 * (3.0 * b).sin() + 0.05 * random.normal() + if row % 97 == 5 { 2.0 } else { 0.0 };
            let y = if self.missing && row % 31 == 3 { String::new() } else { y.to_string() };
            writeln!(text, "{a},{b},{y},{},g{}", 0.5 + random.share(), random.below(25)).unwrap();
        }
        text
    }

    fn outcome(&self, table: &str) -> Outcome {
        if self.groups {
            // Groups of rows without a split are given in memory.
            let rows = Rows::of(table, self);
            let input = |name: &str, k: usize, range: [f64; 2]| {
                Input::new(name, rows.points.iter().map(|point| point[k]).collect::<Vec<f64>>()).unit("1").range(range)
            };
            let response = Response::new("y", &rows.y).unit("1");
            let response = if self.weights { response.weights(&rows.given) } else { response };
            let fit = Fit::new([input("a", 0, [-1.0, 2.0]), input("b", 1, [0.0, 4.0])], response);
            return fit.order(2).groups(&rows.g).fit().unwrap();
        }
        fitted(&self.specification(), &Files::of("t.csv", table))
    }
}

const FIXED: &str = "select = { method = \"fixed\", order = 2 }\n";
const STEPS: &str = "select = { method = \"fixed\", order = 2 }\nsigmoids = [{ input = \"a\", at = 0.4, width = 0.5 }]\n";
const WAVES: &str = "select = { method = \"fixed\", order = 2 }\nwaves = [{ input = \"b\", period = 4.0, order = 2 }]\n";

/// Two groups of rows in lanes, and rows behind them (`rsm-fit/src/qr/table.rs`).
const LARGE: usize = 2 * 32_768 + 1_003;

#[test]
fn no_bit_depends_on_the_number_of_threads() {
    let shapes = [
        Shape { rows: LARGE, more: FIXED, ..Shape::default() },
        Shape { rows: LARGE, weights: true, missing: true, more: STEPS, ..Shape::default() },
        Shape { rows: LARGE, levels: 90, more: WAVES, ..Shape::default() },
        Shape { rows: LARGE, levels: 90, groups: true, more: FIXED, ..Shape::default() },
        Shape {
            rows: 12_000,
            weights: true,
            more: "loss = \"huber\"\nselect = { method = \"fixed\", order = 2 }\n",
            ..Shape::default()
        },
    ];
    for (seed, shape) in shapes.iter().enumerate() {
        let table = shape.table(seed as u64);
        let part = || {
            let specification = specification(&shape.specification(), Path::new(""));
            partial::of_sources(&specification, &[Source::new("t.csv", table.clone())]).map(|part| part.write()).ok()
        };
        threads::limit(1);
        let (one, sums) = (shape.outcome(&table), part());
        assert!(one.reached() && sums.is_some() != shape.more.contains("huber"), "{shape:?}");
        threads::limit(2);
        assert!(shape.outcome(&table) == one, "{shape:?}");
        assert_eq!(part(), sums, "{shape:?}");
        threads::limit(0);
    }
}

/// The rows that a response uses, as the files give them.
struct Rows {
    points: Vec<[f64; 2]>,
    y: Vec<f64>,
    /// The weights as they are given, and divided by their mean.
    given: Vec<f64>,
    w: Vec<f64>,
    g: Vec<String>,
}

impl Rows {
    fn of(table: &str, shape: &Shape) -> Self {
        let mut rows = Rows { points: vec![], y: vec![], given: vec![], w: vec![], g: vec![] };
        for line in table.lines().skip(1) {
            let cells: Vec<&str> = line.split(',').collect();
            if cells[2].is_empty() {
                continue;
            }
            rows.points.push([cells[0].parse().unwrap(), cells[1].parse().unwrap()]);
            rows.y.push(cells[2].parse().unwrap());
            rows.given.push(if shape.weights { cells[3].parse().unwrap() } else { 1.0 });
            rows.g.push(cells[4].to_string());
        }
        let mean = rows.given.iter().sum::<f64>() / rows.given.len() as f64;
        rows.w = rows.given.iter().map(|w| w / mean).collect();
        rows
    }

    fn triangle(&self, design: &Design, rows: impl Iterator<Item = usize>) -> Triangle {
        let mut compressed = Compressed::new(design.width() + 1);
        for row in rows {
            let root = Dd::from(self.w[row]).sqrt();
            let terms = design.row_as_measured(&self.points[row].map(Physical)).into_iter().chain([Dd::from(self.y[row])]);
            compressed.push(terms.map(|x| x * root));
        }
        compressed.finish()
    }

    /// The error of a row, of coefficients that other rows gave.
    fn error(&self, design: &Design, coefficients: &[Dd], row: usize, is_clamped: bool) -> Dd {
        let point = self.points[row].map(Physical);
        let terms = if is_clamped { design.row(&point) } else { design.row_as_measured(&point) };
        Dd::from(self.y[row]) - terms.iter().zip(coefficients).map(|(x, b)| *x * *b).sum::<Dd>()
    }

    /// Rows with the same key, by comparison of every pair.
    fn alike(&self, is_alike: impl Fn(usize, usize) -> bool) -> Vec<usize> {
        (0..self.y.len()).map(|row| (0..=row).find(|other| is_alike(row, *other)).unwrap()).collect()
    }
}

/// Both numbers come from double-double sums with some 2^-90 of relative error, for a condition below 2^10, and are then rounded to f64: they differ
/// by at most the two roundings. Quotients and roots of them add two more.
fn same(what: &str, found: f64, expected: f64) {
    assert!(
        (found - expected).abs() <= 4.0 * f64::EPSILON * expected.abs(),
        "{what}: {found:e}, by its definition {expected:e}"
    );
}

#[test]
fn the_figures_of_rows_are_those_of_their_definitions() {
    for seed in 0..24 {
        let mut random = Random::new(100 + seed);
        let groups = random.below(3) == 1;
        let shape = Shape {
            rows: 30 + random.below(90) as usize,
            levels: [0, 4, 7][random.below(3) as usize],
            weights: random.below(2) == 1,
            groups,
            missing: !groups && random.below(2) == 1,
            more: if groups { FIXED } else { [FIXED, STEPS, WAVES][random.below(3) as usize] },
        };
        let table = shape.table(seed);
        let outcome = shape.outcome(&table);
        let Some(found) = outcome.statistics("y") else { continue };
        let rows = Rows::of(&table, &shape);
        let all = || 0..rows.y.len();
        let surface = &outcome.model.surfaces[0];
        let design = Design::new(surface, &outcome.model.inputs, terms_up_to(surface, 2));
        let terms: Vec<usize> = (0..design.width()).collect();
        let fit = |rows_of: &mut dyn Iterator<Item = usize>| Growing::of(&rows.triangle(&design, rows_of), &terms).unwrap();
        let coefficients = fit(&mut all()).coefficients();
        for (term, exact) in found.terms.iter().zip(&coefficients) {
            assert_eq!(term.coefficient, exact.to_f64(), "{shape:?}");
        }
        // Each row left out, and the fit repeated without it.
        let weighted = |row: usize, error: Dd| Dd::from(rows.w[row]) * error * error;
        let without = |row: usize| {
            weighted(row, rows.error(&design, &fit(&mut all().filter(|other| *other != row)).coefficients(), row, false))
        };
        same("press", found.press.unwrap(), all().map(without).sum::<Dd>().to_f64());
        lack_of_fit(&rows, &design, &coefficients, found);
        left_out(&rows, &design, &shape, found);
    }
}

fn lack_of_fit(rows: &Rows, design: &Design, coefficients: &[Dd], found: &ResponseStatistics) {
    let count = rows.y.len();
    let firsts = rows.alike(|row, other| rows.points[row] == rows.points[other]);
    let (mut lack, mut pure, mut about_zero, mut points) = (Dd::ZERO, Dd::ZERO, Dd::ZERO, 0);
    for first in (0..count).filter(|row| firsts[*row] == *row) {
        let own: Vec<usize> = (0..count).filter(|row| firsts[*row] == first).collect();
        let weight: Dd = own.iter().map(|row| Dd::from(rows.w[*row])).sum();
        let mean = own.iter().map(|row| Dd::from(rows.w[*row]) * Dd::from(rows.y[*row])).sum::<Dd>() / weight;
        let gap = rows.error(design, coefficients, first, false) - Dd::from(rows.y[first]) + mean;
        lack += weight * gap * gap;
        about_zero += weight * mean * mean;
        pure += own
            .iter()
            .map(|row| Dd::from(rows.w[*row]) * (Dd::from(rows.y[*row]) - mean) * (Dd::from(rows.y[*row]) - mean))
            .sum();
        points += 1;
    }
    same("C", found.confidence_c.unwrap(), 100.0 - 100.0 * (lack / about_zero).to_f64());
    let df = [points - coefficients.len(), count - points];
    match &found.lack_of_fit {
        None => assert!(df.contains(&0)),
        Some(told) => {
            assert_eq!(told.df, df);
            let expected = (lack / Dd::from(df[0] as f64)) / (pure / Dd::from(df[1] as f64));
            same("F", told.f.unwrap(), expected.to_f64());
        }
    }
}

/// The errors of parts that are left out in turn: rows of one group, or at one point, are in one part.
fn left_out(rows: &Rows, design: &Design, shape: &Shape, found: &ResponseStatistics) {
    let count = rows.y.len();
    let is_alike =
        |row: usize, other: usize| rows.points[row] == rows.points[other] || shape.groups && rows.g[row] == rows.g[other];
    let mut group = rows.alike(is_alike);
    // Groups that share a row are one, until nothing changes.
    loop {
        let before = group.clone();
        for (row, group) in group.iter_mut().enumerate() {
            let alike = (0..count).filter(|other| is_alike(row, *other));
            *group = alike.map(|other| before[other]).min().unwrap();
        }
        if group == before {
            break;
        }
    }
    let part_of = rsm_fit::split::parts(&group, 10, 1);
    let parts = part_of.iter().max().unwrap() + 1;
    let Some(told) = &found.cross_validation else {
        assert!(parts < 2 || shape.groups, "{shape:?}");
        return;
    };
    assert_eq!(told.parts, parts);
    let (mut absolute, mut square, mut largest) = (Dd::ZERO, Dd::ZERO, 0.0f64);
    for part in 0..parts {
        let triangle = rows.triangle(design, (0..count).filter(|row| part_of[*row] != part));
        let terms: Vec<usize> = (0..design.width()).collect();
        // The coefficients of a model file.
        let solved = Growing::of(&triangle, &terms).unwrap().coefficients();
        let coefficients: Vec<Dd> = solved.iter().map(|b| Dd::from(b.to_f64())).collect();
        for row in (0..count).filter(|row| part_of[*row] == part) {
            let error = rows.error(design, &coefficients, row, true).abs();
            absolute += error;
            square += error * error;
            largest = largest.max(error.to_f64());
        }
    }
    let rows = Dd::from(count as f64);
    same("mean error", told.errors.mean_abs_error, (absolute / rows).to_f64());
    same("largest error", told.errors.max_abs_error, largest);
    same("root mean square", told.errors.rmse, (square / rows).sqrt().to_f64());
}

#[test]
fn a_large_table_has_the_coefficients_of_rows_one_after_the_other() {
    for shape in [
        Shape { rows: LARGE, more: FIXED, ..Shape::default() },
        Shape { rows: LARGE, weights: true, missing: true, levels: 300, more: STEPS, ..Shape::default() },
    ] {
        let table = shape.table(7);
        let outcome = shape.outcome(&table);
        let found = outcome.statistics("y").unwrap();
        let rows = Rows::of(&table, &shape);
        let surface = &outcome.model.surfaces[0];
        let design = Design::new(surface, &outcome.model.inputs, terms_up_to(surface, 2));
        let terms: Vec<usize> = (0..design.width()).collect();
        let growing = Growing::of(&rows.triangle(&design, 0..rows.y.len()), &terms).unwrap();
        let coefficients = growing.coefficients();
        for (term, exact) in found.terms.iter().zip(&coefficients) {
            same("coefficient", term.coefficient, exact.to_f64());
        }
        let weighted = |row: usize| {
            let leverage = Dd::from(rows.w[row]) * growing.leverage(&design.row_as_measured(&rows.points[row].map(Physical)));
            let error = rows.error(&design, &coefficients, row, false) / (Dd::ONE - leverage);
            Dd::from(rows.w[row]) * error * error
        };
        same("press", found.press.unwrap(), (0..rows.y.len()).map(weighted).sum::<Dd>().to_f64());
    }
}

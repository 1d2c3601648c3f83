//! The curve of a law with its confidence band, and the textbook forms that are nearest to it.
//!
//! In: a law with its coefficients and their covariance, and the values of its variables along the records. Out: points of the curve over each
//! variable; for each form its misfit. Runs no simulation.

use super::terms::Form;
use crate::engine::columns::dot;
use crate::engine::normal::Normal;
use crate::plant::posterior::REACH;
use rsm_core::order;

/// The number of points of a curve.
const POINTS: usize = 41;

/// A curve is over the values that the records visit, without this share at each end: there the records determine little.
const ENDS: f64 = 0.01;

/// The number of forms that are listed.
const LISTED: usize = 3;

/// A point of a curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// The variable.
    pub at: f64,
    /// The law.
    pub value: f64,
    /// The lower end of the 95 % band.
    pub low: f64,
    /// The upper end.
    pub high: f64,
}

/// The law over one of its variables; the others have their median values.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// The variable.
    pub variable: String,
    /// Its unit.
    pub unit: String,
    /// The points, in order.
    pub points: Vec<Point>,
}

/// A textbook form and its distance from the law.
#[derive(Debug, Clone, PartialEq)]
pub struct Textbook {
    /// The form, in words.
    pub words: &'static str,
    /// The root mean square difference of the best such form from the law, as a share of the root mean square of the law, over the rows of the
    /// records.
    pub misfit: f64,
}

/// A law with its coefficients.
pub struct Fitted<'a> {
    /// The form.
    pub form: &'a Form,
    /// The terms.
    pub terms: &'a [Vec<u32>],
    /// The coefficient of each term.
    pub coefficients: &'a [f64],
    /// The covariance of the coefficients of all terms of the form, row by row.
    pub covariance: &'a [Vec<f64>],
    /// The values of the variables of the form along the records, one list for each.
    pub visited: &'a [Vec<f64>],
}

impl Fitted<'_> {
    /// The law at values of its variables.
    #[must_use]
    pub fn value(&self, at: &[f64]) -> f64 {
        self.terms.iter().zip(self.coefficients).map(|(term, c)| c * self.form.value(term, at)).sum()
    }

    fn deviation(&self, at: &[f64]) -> f64 {
        let terms: Vec<f64> = self.form.terms.iter().map(|term| self.form.value(term, at)).collect();
        let variance: f64 = self.covariance.iter().zip(&terms).map(|(row, term)| term * dot(row, &terms)).sum();
        variance.max(0.0).sqrt()
    }

    /// Whether a variable is in the law. The sign and the steps belong to the speed.
    fn depends_on(&self, variable: usize) -> bool {
        let sign = self.form.variables.len();
        let has = |term: &Vec<u32>| term[variable] > 0 || variable == 0 && term.iter().skip(sign).any(|power| *power > 0);
        self.terms.iter().any(has)
    }

    /// The names of the variables in the law.
    #[must_use]
    pub fn inputs(&self) -> Vec<String> {
        let names = self.form.variables.iter().enumerate().filter(|(k, _)| self.depends_on(*k));
        names.map(|(_, it)| it.name.clone()).collect()
    }

    /// The curve over each variable of the law.
    #[must_use]
    pub fn curves(&self) -> Vec<Curve> {
        let sorted: Vec<Vec<f64>> = self
            .visited
            .iter()
            .map(|values| {
                let mut values: Vec<f64> = values.iter().copied().filter(|it| it.is_finite()).collect();
                order::sort(&mut values);
                values
            })
            .collect();
        let share =
            |variable: usize, share: f64| sorted[variable][(share * (sorted[variable].len() - 1) as f64).round() as usize];
        let middle: Vec<f64> = (0..sorted.len()).map(|k| share(k, 0.5)).collect();
        let one = |variable: usize| {
            let (low, high) = (share(variable, ENDS), share(variable, 1.0 - ENDS));
            let point = |k: usize| {
                let mut at = middle.clone();
                at[variable] = low + (high - low) * k as f64 / (POINTS - 1) as f64;
                let (value, reach) = (self.value(&at), REACH * self.deviation(&at));
                Point { at: at[variable], value, low: value - reach, high: value + reach }
            };
            let it = &self.form.variables[variable];
            Curve { variable: it.name.clone(), unit: it.unit.clone(), points: (0..POINTS).map(point).collect() }
        };
        (0..self.form.variables.len()).filter(|k| self.depends_on(*k) && !sorted[*k].is_empty()).map(one).collect()
    }

    /// The nearest textbook forms, the nearest first.
    #[must_use]
    pub fn textbook(&self) -> Vec<Textbook> {
        let rows = self.visited.iter().map(Vec::len).min().unwrap_or(0);
        let at = |row: usize| self.visited.iter().map(|it| it[row]).collect::<Vec<f64>>();
        let law: Vec<f64> = (0..rows).map(|row| self.value(&at(row))).collect();
        let size = dot(&law, &law);
        let (width, place) = (self.form.width, |name: &str| self.form.variables.iter().position(|it| it.name == name));
        let mut list: Vec<Textbook> = FORMS
            .iter()
            .filter_map(|(words, variables, parts)| {
                let places: Vec<usize> = variables.iter().map(|name| place(name)).collect::<Option<_>>()?;
                let columns: Vec<Vec<f64>> = parts
                    .iter()
                    .map(|part| {
                        let value = |row| {
                            let values: Vec<f64> = places.iter().map(|place| self.visited[*place][row]).collect();
                            part(&values, width.unwrap_or(0.0))
                        };
                        (0..rows).map(value).collect()
                    })
                    .collect();
                Some(Textbook { words, misfit: (left(&columns, &law) / size).max(0.0).sqrt() })
            })
            .filter(|it| it.misfit.is_finite())
            .collect();
        order::ascending(&mut list, |it| it.misfit);
        list.truncate(LISTED);
        list
    }
}

/// The square that the best combination of some columns leaves.
fn left(columns: &[Vec<f64>], law: &[f64]) -> f64 {
    let n = columns.len();
    let matrix: Vec<f64> = columns.iter().flat_map(|a| columns.iter().map(move |b| dot(a, b))).collect();
    let found = Normal::fine(&matrix, n).solve(&columns.iter().map(|it| dot(it, law)).collect::<Vec<f64>>());
    let miss = |row: usize| law[row] - columns.iter().zip(&found).map(|(it, c)| c * it[row]).sum::<f64>();
    (0..law.len()).map(|row| miss(row).powi(2)).sum()
}

/// A part of a form: its value at the variables of the form, with the width of a smooth sign (0 if the direction never changes).
type Part = fn(&[f64], f64) -> f64;

fn sign(it: &[f64], width: f64) -> f64 {
    if width > 0.0 { (it[0] / width).tanh() } else { it[0].signum() }
}

const CONSTANT: Part = |_, _| 1.0;
const PROPORTIONAL: Part = |it, _| it[0];
const SQUARE: Part = |it, _| it[0] * it[0].abs();
const CUBE: Part = |it, _| it[0].powi(3);

/// Forms of textbooks: their words, the variables, the parts with free coefficients.
const FORMS: &[(&str, &[&str], &[Part])] = &[
    ("a constant", &[], &[CONSTANT]),
    ("viscous friction", &["speed"], &[PROPORTIONAL]),
    ("dry friction", &["speed"], &[sign]),
    ("dry and viscous friction", &["speed"], &[sign, PROPORTIONAL]),
    ("quadratic drag", &["speed"], &[SQUARE]),
    ("dry friction and quadratic drag", &["speed"], &[sign, SQUARE]),
    ("drag with the third power of the speed", &["speed"], &[CUBE]),
    ("a spring", &["position"], &[PROPORTIONAL, CONSTANT]),
    ("a spring with a cubic part", &["position"], &[PROPORTIONAL, CUBE, CONSTANT]),
    ("a spring with a quadratic part", &["position"], &[PROPORTIONAL, |it, _| it[0] * it[0], CONSTANT]),
    (
        "viscous friction that grows with the square of the position",
        &["speed", "position"],
        &[PROPORTIONAL, |it, _| it[0] * it[1] * it[1]],
    ),
    ("viscous friction at the wheels", &["wheel_speed"], &[PROPORTIONAL]),
    ("dry friction at the wheels", &["wheel_speed"], &[sign]),
    ("quadratic drag at the wheels", &["wheel_speed"], &[SQUARE]),
    ("a leak", &["level"], &[PROPORTIONAL, CONSTANT]),
    ("flow through an opening (E. Torricelli)", &["level"], &[|it, _| it[0].max(0.0).sqrt()]),
    ("conduction", &["temperature"], &[PROPORTIONAL, CONSTANT]),
    ("radiation", &["temperature"], &[|it, _| it[0].powi(4), CONSTANT]),
];

/// The words for the variables of a law: `speed and position`.
#[must_use]
pub fn joined(names: &[String]) -> String {
    match names {
        [] => "nothing".to_string(),
        [one] => one.clone(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rsm_sim::equation_plant::added::Balance;

    fn form(values: &[f64]) -> Form {
        let variables = vec![("speed".to_string(), "m/s".to_string())];
        let balance = Balance { at: "carriage".to_string(), kind: "translation", term: "effort", unit: "N", variables };
        Form::new(&balance, &[values.to_vec()]).unwrap()
    }

    #[test]
    fn a_law_that_is_a_textbook_form_has_it_as_the_nearest_and_a_band_from_its_covariance() {
        let visited: Vec<f64> = (0..201).map(|k| f64::from(k - 100) / 50.0).collect();
        let form = form(&visited);
        // The range is -2.2 to 2.2 m/s: a coded variable is the speed over 2.2.
        let (terms, coefficients) = (vec![vec![1, 0, 0, 0], vec![0, 1, 0, 0]], [2.2 * 3.0, 5.0]);
        let place = |term: &Vec<u32>| form.terms.iter().position(|it| it == term).unwrap();
        let mut covariance = vec![vec![0.0; form.terms.len()]; form.terms.len()];
        for (term, variance) in terms.iter().zip([0.04, 0.09]) {
            covariance[place(term)][place(term)] = variance;
        }
        let visited = vec![visited];
        let law =
            Fitted { form: &form, terms: &terms, coefficients: &coefficients, covariance: &covariance, visited: &visited };
        assert!((law.value(&[1.0]) - 8.0).abs() < 1e-12);
        let forms = law.textbook();
        assert_eq!(forms[0].words, "dry and viscous friction");
        // The rounding of sums over 201 rows.
        assert!(forms[0].misfit < 1e-6 && forms[1].misfit > 0.01, "{forms:?}");
        let curve = &law.curves()[0];
        let last = curve.points[40];
        // The hundredth row from the end, 1.96 m/s: sd^2 = 0.04 (1.96/2.2)^2 + 0.09.
        let sd = (0.04 * (1.96_f64 / 2.2).powi(2) + 0.09).sqrt();
        assert!((last.at - 1.96).abs() < 1e-12 && (last.high - last.value - 1.96 * sd).abs() < 1e-9, "{last:?}");
        assert_eq!((law.inputs(), curve.points.len()), (vec!["speed".to_string()], 41));
    }
}

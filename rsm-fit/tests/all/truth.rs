//! Random surfaces from a seed with a known truth and with noise; and the true error of a fit at new points.
//!
//! Shares only the evaluator's tape and the random numbers with the fit.

use rsm_core::check::Checked;
use rsm_core::lower;
use rsm_core::number::Precision;
use rsm_core::run::Interpreter;
use rsm_fit::fit::Outcome;
use rsm_fit::random::Random;
use rsm_fit::{Fit, Input, Response};

/// A polynomial of uniform inputs in [-1, 1], scaled to a standard deviation of 1, with noise.
pub struct Truth {
    pub inputs: usize,
    pub terms: Vec<(Vec<i32>, f64)>,
    pub offset: f64,
    pub noise: f64,
}

impl Truth {
    pub fn random(inputs: usize, order: u32, noise: f64, random: &mut Random) -> Self {
        let mut terms = Vec::new();
        let mut powers = vec![0; inputs];
        // Counts through all vectors of powers up to the order.
        loop {
            let total: i32 = powers.iter().sum();
            if total > 0 && total <= order as i32 && random.share() < 0.5 {
                terms.push((powers.clone(), random.normal() / f64::from(total)));
            }
            let Some(place) = powers.iter().position(|power| *power < order as i32) else { break };
            powers[place] += 1;
            powers[..place].fill(0);
        }
        if terms.is_empty() {
            terms.push(((0..inputs).map(|k| i32::from(k == 0)).collect(), 1.0));
        }
        let mut truth = Truth { inputs, terms, offset: 0.0, noise };
        let values: Vec<f64> = (0..500).map(|_| truth.point(random)).map(|point| truth.at(&point)).collect();
        let mean = values.iter().sum::<f64>() / 500.0;
        let sd = (values.iter().map(|y| (y - mean).powi(2)).sum::<f64>() / 500.0).sqrt();
        truth.terms.iter_mut().for_each(|(_, coefficient)| *coefficient /= sd);
        truth
    }

    pub fn point(&self, random: &mut Random) -> Vec<f64> {
        (0..self.inputs).map(|_| 2.0 * random.share() - 1.0).collect()
    }

    pub fn at(&self, point: &[f64]) -> f64 {
        let term = |(powers, coefficient): &(Vec<i32>, f64)| {
            coefficient * powers.iter().zip(point).map(|(power, x)| x.powi(*power)).product::<f64>()
        };
        self.offset + self.terms.iter().map(term).sum::<f64>()
    }

    /// Points, and responses with noise.
    pub fn rows(&self, rows: usize, random: &mut Random) -> (Vec<Vec<f64>>, Vec<f64>) {
        let row = |_| {
            let point = self.point(random);
            let y = self.at(&point) + self.noise * random.normal();
            (point, y)
        };
        (0..rows).map(row).unzip()
    }

    /// The fit of some rows over x0, x1, ... in [-1, 1], without a choice of its terms.
    pub fn fit(&self, (points, response): (Vec<Vec<f64>>, Vec<f64>)) -> Fit {
        let column = |k: usize| points.iter().map(|point| point[k]).collect::<Vec<f64>>();
        let inputs: Vec<Input> = (0..self.inputs).map(|k| Input::new(format!("x{k}"), column(k)).range([-1.0, 1.0])).collect();
        Fit::new(inputs, Response::new("y", response).unit("K"))
    }

    /// Rows of a CSV.
    pub fn csv(&self, rows: usize, random: &mut Random) -> String {
        let names: String = (0..self.inputs).map(|k| format!("x{k}[1],")).collect();
        let (points, response) = self.rows(rows, random);
        let line =
            |(point, y): (&Vec<f64>, &f64)| format!("{}{y:e}\n", point.iter().map(|x| format!("{x:e},")).collect::<String>());
        format!("{names}y[K]\n") + &points.iter().zip(&response).map(line).collect::<String>()
    }

    /// Root of the mean square error on this number of new rows, noise included.
    pub fn error_of(&self, outcome: &Outcome, rows: usize, random: &mut Random) -> f64 {
        let checked = Checked::from_model(&outcome.model).unwrap();
        let tape = lower::surface(&checked, 0, Precision::F64);
        let mut interpreter = Interpreter::<f64>::new(&tape);
        let square: f64 = (0..rows)
            .map(|_| {
                let point = self.point(random);
                let value = interpreter.eval(&point);
                (value - self.at(&point) - self.noise * random.normal()).powi(2)
            })
            .sum();
        (square / rows as f64).sqrt()
    }

    /// Root of the mean square difference from the truth at some points.
    pub fn surface_error(&self, outcome: &Outcome, points: &[Vec<f64>]) -> f64 {
        let checked = Checked::from_model(&outcome.model).unwrap();
        let tape = lower::surface(&checked, 0, Precision::F64);
        let mut interpreter = Interpreter::<f64>::new(&tape);
        let square: f64 = points.iter().map(|point| (interpreter.eval(point) - self.at(point)).powi(2)).sum();
        (square / points.len() as f64).sqrt()
    }
}

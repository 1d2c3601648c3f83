//! Residuals of a surface over its inputs, the run order and its own value. A click removes a cause from the computation or restores it.
//!
//! In: a model, the diagnosis of a response. Out: figures. Decides nothing: the means for all combinations of causes come from the diagnosis.

use rsm_core::model::{Model, Surface};
use rsm_diagnose::surface::{Combinations, ResponseDiagnosis, Verdict};

use crate::outcome::Refusal;
use crate::plot::{self, BLUE, GREY, Mark, ORANGE, PINK, Series, Words, curves, switched};

/// The plots of a response.
pub struct Plots<'a> {
    pub model: &'a Model,
    pub response: &'a ResponseDiagnosis,
}

impl Plots<'_> {
    fn surface(&self) -> &Surface {
        &self.model.surfaces[self.response.surface]
    }

    /// The name of a switch: the page may have several responses.
    fn group(&self, of: &str) -> String {
        format!("{of} of {}", self.surface().name)
    }

    /// The combinations of causes that a switch shows; none if the surface agrees with the data.
    fn combinations(&self) -> Option<&Combinations<Vec<f64>>> {
        let combinations = &self.response.shown.combinations;
        Some(combinations).filter(|it| self.response.verdict != Verdict::NoDiscrepancy && !it.causes.is_empty())
    }

    /// A button for each cause. Empty if the surface agrees with the data.
    pub fn switch(&self, of: &str) -> String {
        let Some(combinations) = self.combinations() else { return String::new() };
        let state_texts = vec![String::new(); combinations.of.len()];
        plot::switch(&self.group(of), "Causes in what is computed:", &combinations.causes, &state_texts)
    }

    /// The plot that shows the strongest cause: residuals over the input to which the cause belongs, otherwise over the run order.
    pub fn summary(&self, of: &str) -> Result<String, Refusal> {
        let subject = self.response.causes.first().and_then(|cause| cause.subject.as_ref());
        let input = subject.and_then(|(_, name)| self.surface().inputs.iter().position(|input| input == name));
        match input {
            Some(k) => self.against_input(of, k),
            None => self.against_runs(of),
        }
    }

    /// Adds all plots to the page.
    pub fn section(&self, body: &mut String) -> Result<(), Refusal> {
        let of = "residuals";
        body.push_str("<h3>Residuals</h3>\n");
        body.push_str(&self.switch(of));
        body.push_str("<div class=\"plots\">\n");
        for k in 0..self.surface().inputs.len() {
            body.push_str(&self.against_input(of, k)?);
        }
        body.push_str(&self.against_runs(of)?);
        let shown = &self.response.shown;
        let x = format!("fitted value [{}]", self.surface().unit);
        body.push_str(&self.residuals(of, "against the fitted value", &x, &|row| shown.explained[row])?);
        body.push_str(&self.unseen()?);
        body.push_str("</div>\n");
        Ok(())
    }

    fn against_input(&self, of: &str, k: usize) -> Result<String, Refusal> {
        let name = &self.surface().inputs[k];
        let unit = self.model.input(name).map_or("", |input| input.unit.as_str());
        let column = &self.response.shown.points[k];
        self.residuals(of, &format!("against {name}"), &format!("{name} [{unit}]"), &|row| column[row])
    }

    fn against_runs(&self, of: &str) -> Result<String, Refusal> {
        let shown = &self.response.shown;
        self.residuals(of, "against the run order", "run", &|row| shown.places[row] as f64 + 1.0)
    }

    fn residuals(&self, of: &str, title: &str, x_title: &str, x: &dyn Fn(usize) -> f64) -> Result<String, Refusal> {
        let shown = &self.response.shown;
        let y = format!("measured minus computed [{}]", self.surface().unit_of_terms());
        let points = |computed: &[f64], counts: bool| -> Vec<(f64, f64)> {
            let rows = (0..shown.measured.len()).filter(|row| shown.counts[*row] == counts);
            rows.map(|row| (x(row), shown.measured[row] - computed[row])).collect()
        };
        let file = Series::new("the file", ORANGE, Mark::Cross, points(&shown.nominal, true));
        let explained = Series::new("with the causes", BLUE, Mark::Circle, points(&shown.explained, true));
        let mut series = Vec::new();
        match (self.combinations(), self.response.verdict) {
            (Some(combinations), _) => {
                let last = combinations.of.len() - 1;
                series.extend([file.in_state(0), explained.in_state(last)]);
                for (set, mean) in combinations.of.iter().enumerate().take(last).skip(1) {
                    let name = format!("with {}", combinations.names(set).join(", "));
                    let some = mean.iter().map(|mean| Series::new(&name, ORANGE, Mark::Cross, points(mean, true)));
                    series.extend(some.map(|it| it.in_state(set).only_live()));
                }
            }
            (None, Verdict::NoDiscrepancy) => series.push(file),
            (None, _) => series.extend([file, explained]),
        }
        let outlying = points(&shown.nominal, false);
        if !outlying.is_empty() {
            series.push(Series::new("outlying", PINK, Mark::Cross, outlying));
        }
        switched(Some(&self.group(of)), &Words { title, x: x_title, y: &y }, &series)
    }

    /// Computed against measured values of holdout rows.
    fn unseen(&self) -> Result<String, Refusal> {
        let judged = &self.response.holdout;
        let unit = &self.surface().unit;
        let pairs = |computed: &[f64]| judged.measured.iter().copied().zip(computed.iter().copied()).collect::<Vec<_>>();
        let (low, high) = judged.measured.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), y| (a.min(*y), b.max(*y)));
        let (x, y) = (format!("measured [{unit}]"), format!("computed [{unit}]"));
        let mut all = vec![
            Series::new("equal", GREY, Mark::Line, vec![(low, low), (high, high)]),
            Series::new("the file", ORANGE, Mark::Cross, pairs(&judged.nominal)),
        ];
        if self.response.verdict != Verdict::NoDiscrepancy {
            all.push(Series::new("extended", BLUE, Mark::Circle, pairs(&judged.extended)));
        }
        curves(&Words { title: "holdout rows", x: &x, y: &y }, &all)
    }
}

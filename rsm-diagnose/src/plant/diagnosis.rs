//! The diagnosis of a plant as a value: all data for reports, files and programs.
//!
//! In: figures of a verdict. Out: [`Diagnosis`]. Computes no result of its own.

use super::all_rows::AllRows;
use super::bursts::BURST;
use super::cause::{Cause, Interval};
use super::checks::Finding;
use super::equations::EquationScreen;
use super::error_breakdown::{CalibratedParameter, ErrorBreakdown};
use super::experiment::{Alias, NextExperiment};
use super::final_test::Refusal;
use super::gaps::FilledGaps;
use super::known_loop::KnownLoop;
use super::law::Law;
use super::nested_models::Step;
use super::predictors::Predictor;
use super::row_share::UnusedRows;
use super::search_history::Limit;
use super::tails::Tails;
use super::tested::Tested;
use super::units::WrongUnit;
use super::validation::{Error, worst};
use super::whiteness::RemainingStructure;
pub use crate::engine::verdict::Verdict;
use rsm_sim::plant_file::PlantFile;

/// The figures for causes that leave a residual above chance, but too small to matter in practice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Practical {
    /// The removed share of the squared error above the noise.
    pub removed: f64,
    /// The energy of the residual divided by the energy of the noise.
    pub left: f64,
}

/// An effect of the plant file, tested by the records.
#[derive(Debug, Clone, PartialEq)]
pub struct Claim {
    /// The kind of the catalogue.
    pub kind: &'static str,
    /// The output that it refers to, if any.
    pub subject: Option<String>,
    /// Its parameters estimated from the records, in the order of the file.
    pub records: Vec<Interval>,
    /// Its parameters in the file.
    pub file: Vec<f64>,
    /// Whether the records confirm it.
    pub stands: bool,
}

/// A diagnosis.
#[derive(Debug, Clone)]
pub struct Diagnosis {
    /// The verdict.
    pub verdict: Verdict,
    /// Causes, the strongest first.
    pub causes: Vec<Cause>,
    /// Entries of the extended plant that reduce an unexplained error, but are not accepted as its causes; the strongest first.
    pub helpers: Vec<Cause>,
    /// The file of the only record with another configuration. The causes then belong to this record.
    pub own_record: Option<String>,
    /// Hypotheses that were accepted for a time, and why they were rejected.
    pub refused: Vec<Refusal>,
    /// The practical figures, if the causes explain the error for practical purposes only.
    pub practical: Option<Practical>,
    /// Errors of the nominal plant on validation records (on training records if there are none).
    pub nominal: Vec<Error>,
    /// Errors of the extended plant on the same records.
    pub extended: Vec<Error>,
    /// Share of the validation error above the noise floor that the extension removes.
    pub gain: f64,
    /// The 95 % interval of the gain, over blocks of the rows.
    pub gain_interval: (f64, f64),
    /// The plant file with the causes added.
    pub plant: PlantFile,
    /// A law that is in no textbook, if one removes error that nothing in the catalogue explains. It is then a part of the extended plant, and the
    /// helpers are not. The verdict stays [`Verdict::Unexplained`].
    pub law: Option<Law>,
    /// What is wrong with the data.
    pub findings: Vec<Finding>,
    /// Rows that were left out, because the records are longer than the work limit allows.
    pub unused_rows: Option<UnusedRows>,
    /// The check of the result on all rows, if the search did not use all of them.
    pub all_rows: Option<AllRows>,
    /// Columns whose unit differs from the one in the record. They were converted before all other steps.
    pub units: Vec<WrongUnit>,
    /// Gaps of a few rows that were filled.
    pub filled_gaps: Vec<FilledGaps>,
    /// The noise of each recorded output: its place, standard deviation, and correlation from row to row.
    pub noise: Vec<(usize, f64, f64)>,
    /// Outputs whose noise grows with the reading: its standard deviation at a reading of 0 and at the largest one.
    pub growing: Vec<(usize, f64, f64)>,
    /// Outputs that are rounded to a step as coarse as their noise, with the step.
    pub rounded: Vec<(usize, f64)>,
    /// Outputs whose noise has heavy tails, with the law by which the weight of their readings was reduced.
    pub tails: Vec<(usize, Tails)>,
    /// The gain that a cause needs.
    pub threshold: f64,
    /// The gains that the screen of the calibrated plant predicted.
    pub ranking: Vec<(String, f64)>,
    /// The gains that the last screen predicted, with the causes in the plant.
    pub remaining: Vec<(String, f64)>,
    /// The error on the evaluation records after each added cause.
    pub steps: Vec<Step>,
    /// The work limit that stopped the search, if any.
    pub stopped: Option<Limit>,
    /// What is left on the training records.
    pub left: RemainingStructure,
    /// What is left on the validation records, if there are any.
    pub left_unseen: Option<RemainingStructure>,
    /// The check of the sensors by the known law of the control loop.
    pub known_loop: Option<KnownLoop>,
    /// The equation errors with the recorded signals, without a free run.
    pub equations: Option<EquationScreen>,
    /// A signal that predicts a part of the residual, on the records where it predicts more.
    pub predicted: Option<Predictor>,
    /// Rivals with the same trace. Those of the strongest cause come first, the strongest first.
    pub aliases: Vec<Alias>,
    /// The next record: it would distinguish the rivals, or cover the region of an unexplained error.
    pub next: Option<NextExperiment>,
    /// Further data for a report.
    pub error_breakdown: ErrorBreakdown,
    /// Figures on the test records, if there are any.
    pub tested: Option<Tested>,
    /// The effects that the plant file already had, tested.
    pub claims: Vec<Claim>,
}

impl Diagnosis {
    /// The entries of the extended plant, causes and helpers.
    pub fn entries(&self) -> impl Iterator<Item = &Cause> {
        self.causes.iter().chain(&self.helpers)
    }

    /// Errors of the calibrated plant without causes on the evaluation records; those of the nominal plant if it was not calibrated.
    #[must_use]
    pub fn calibrated(&self) -> &[Error] {
        let first = self.steps.first().filter(|step| step.causes.is_empty());
        first.map_or(self.nominal.as_slice(), |step| step.errors.as_slice())
    }

    /// The output with the largest error of the calibrated plant, among those with curves.
    #[must_use]
    pub fn worst_output(&self) -> Option<usize> {
        let has_curves = |output: usize| self.error_breakdown.traces.iter().any(|it| it.output == output);
        let worst = worst(self.calibrated()).map(|it| it.output);
        let first = || self.error_breakdown.traces.iter().map(|it| it.output).min();
        worst.filter(|output| has_curves(*output)).or_else(first)
    }

    /// The root mean square of the residual over the noise, on the records where more is left or predicted.
    #[must_use]
    pub fn times_noise(&self) -> f64 {
        let unseen = self.left_unseen.as_ref().map_or(0.0, |it| it.excess);
        let predicted = self.predicted.as_ref().map_or(0.0, |it| it.excess);
        (1.0 + self.left.excess.max(unseen).max(predicted).max(0.0)).sqrt()
    }

    /// The parameter that calibration moved most, relative to its tolerance.
    #[must_use]
    pub fn moved_most(&self) -> Option<&CalibratedParameter> {
        self.error_breakdown.calibration.iter().max_by(|a, b| a.sds.abs().total_cmp(&b.sds.abs()))
    }

    /// Whether the noise was made uniform: readings with heavy tails have a smaller weight, and rows of bursts are left out.
    #[must_use]
    pub fn has_uneven_noise(&self) -> bool {
        !self.tails.is_empty() || self.findings.iter().any(|it| it.what == BURST)
    }
}

//! The diagnosis of a plant as a value: all data for reports, files and programs.
//!
//! In: figures of a verdict. Out: [`Diagnosis`]. Never computes one.

use super::bridges::Bridged;
use super::bursts::BURST;
use super::cause::{Cause, Interval};
use super::checks::Finding;
use super::equations::Said;
use super::error_breakdown::{ErrorBreakdown, Moved};
use super::everywhere::Everywhere;
use super::experiment::{Alias, NextExperiment};
use super::known_loop::KnownLoop;
use super::nested_models::Step;
use super::path::Limit;
use super::predicted::Predicted;
use super::share::NotSeen;
use super::tails::Tails;
use super::tested::Tested;
use super::units::InUnit;
use super::validation::{Error, worst};
use super::veto::Refusal;
use super::whiteness::Left;
pub use crate::engine::verdict::Verdict;
use rsm_sim::plant_file::PlantFile;

/// What causes do, where they leave too little to matter for practice, though more than chance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Practical {
    /// Share of the error beyond the noise that is gone, in squares.
    pub gone: f64,
    /// Energy of what is left over that of the noise.
    pub left: f64,
}

/// An effect of the plant file, judged.
#[derive(Debug, Clone, PartialEq)]
pub struct Claim {
    /// The kind of the catalogue.
    pub kind: &'static str,
    /// The named output, where it has one.
    pub subject: Option<String>,
    /// Its numbers as the records have them, in the order of the file.
    pub records: Vec<Interval>,
    /// Its numbers as the file has them.
    pub file: Vec<f64>,
    /// Whether the records let it stand.
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
    /// The record that alone is of another configuration, by its file: the causes are its own.
    pub own_record: Option<String>,
    /// What was accepted temporarily, and why it was rejected.
    pub refused: Vec<Refusal>,
    /// Where causes explain for practical purposes only.
    pub practical: Option<Practical>,
    /// Errors of the nominal plant on validation records (on training records where there are none).
    pub nominal: Vec<Error>,
    /// Errors of the extended plant there.
    pub extended: Vec<Error>,
    /// Share of the validation error above the noise floor that the extension removes.
    pub gain: f64,
    /// Its 95 % interval over blocks of the rows.
    pub gain_interval: (f64, f64),
    /// The plant file with the causes filled in.
    pub plant: PlantFile,
    /// What is wrong with the data.
    pub findings: Vec<Finding>,
    /// Rows that were not looked at, where records are longer than a diagnosis may take.
    pub not_seen: Option<NotSeen>,
    /// The check of the result on all rows, if the search did not use all of them.
    pub everywhere: Option<Everywhere>,
    /// Columns whose unit differs from the one in the record. They were converted before all other steps.
    pub units: Vec<InUnit>,
    /// Gaps of a few rows that were bridged.
    pub bridged: Vec<Bridged>,
    /// Noise of each output that the records hold: place, standard deviation, correlation from row to row.
    pub noise: Vec<(usize, f64, f64)>,
    /// Outputs whose noise grows with the reading: its standard deviation at a reading of 0 and at the largest one.
    pub growing: Vec<(usize, f64, f64)>,
    /// Outputs whose readings are multiples of a step as coarse as their noise, with the step.
    pub rounded: Vec<(usize, f64)>,
    /// Outputs whose noise has heavy tails, with the law by which their readings were made tame.
    pub tails: Vec<(usize, Tails)>,
    /// What a cause had to gain.
    pub threshold: f64,
    /// What the screen of the calibrated plant predicted.
    pub ranking: Vec<(String, f64)>,
    /// What the last screen predicted, with the causes in the plant.
    pub remaining: Vec<(String, f64)>,
    /// How the error falls on the evaluation records, cause by cause.
    pub steps: Vec<Step>,
    /// The limit of work at which the search stopped, if it did.
    pub stopped: Option<Limit>,
    /// What is left at the end on training records.
    pub left: Left,
    /// And on validation records, where there are any.
    pub left_unseen: Option<Left>,
    /// The check of the sensors by the known law of the control loop.
    pub known_loop: Option<KnownLoop>,
    /// The equation errors with the recorded signals, without a free run.
    pub equations: Option<Said>,
    /// What predicts a part of what is left, on the records where it predicts more.
    pub predicted: Option<Predicted>,
    /// Rivals that leave the same trace, the strongest of the strongest cause first.
    pub aliases: Vec<Alias>,
    /// The record that would distinguish them, or that covers the region of an unexplained error.
    pub next: Option<NextExperiment>,
    /// What a report shows beside all this.
    pub error_breakdown: ErrorBreakdown,
    /// Figures of test records, where there are any.
    pub tested: Option<Tested>,
    /// The effects that the plant file came with, judged.
    pub claims: Vec<Claim>,
}

impl Diagnosis {
    /// The entries of the extended plant, causes and helpers.
    pub fn entries(&self) -> impl Iterator<Item = &Cause> {
        self.causes.iter().chain(&self.helpers)
    }

    /// Errors of the calibrated plant, which has no cause yet, on the evaluation records; of the nominal plant where it was not asked.
    #[must_use]
    pub fn calibrated(&self) -> &[Error] {
        let first = self.steps.first().filter(|step| step.causes.is_empty());
        first.map_or(self.nominal.as_slice(), |step| step.errors.as_slice())
    }

    /// The output of which the calibrated plant is worst, of those that have curves.
    #[must_use]
    pub fn worst_output(&self) -> Option<usize> {
        let has_curves = |output: usize| self.error_breakdown.traces.iter().any(|it| it.output == output);
        let worst = worst(self.calibrated()).map(|it| it.output);
        let first = || self.error_breakdown.traces.iter().map(|it| it.output).min();
        worst.filter(|output| has_curves(*output)).or_else(first)
    }

    /// What is left over the noise, as root mean squares: on the records where more is left or predicted.
    #[must_use]
    pub fn times_noise(&self) -> f64 {
        let unseen = self.left_unseen.as_ref().map_or(0.0, |it| it.excess);
        let predicted = self.predicted.as_ref().map_or(0.0, |it| it.excess);
        (1.0 + self.left.excess.max(unseen).max(predicted).max(0.0)).sqrt()
    }

    /// The parameter that calibration moved furthest within its tolerance.
    #[must_use]
    pub fn moved_most(&self) -> Option<&Moved> {
        self.error_breakdown.calibration.iter().max_by(|a, b| a.sds.abs().total_cmp(&b.sds.abs()))
    }

    /// Whether noise was made even: readings of heavy tails count less, and rows of bursts not at all.
    #[must_use]
    pub fn has_uneven_noise(&self) -> bool {
        !self.tails.is_empty() || self.findings.iter().any(|it| it.what == BURST)
    }
}

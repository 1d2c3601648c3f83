//! Prepares records for a search, and calibrates the plant to them.
//!
//! In: a plant file and records. Out: the rows that count, noise floors, initial states, the calibrated plant, the scales of the records. Every fit
//! of causes or claims starts here, so all of them use the same rows, the same noise and the same initial states. Searches for no cause.

use super::calibration::{calibrate, floors, with_rounding};
use super::checks::{self, Finding};
use super::levenberg::{self, Fit};
use super::model::{InitialMotion, Model};
use super::noise::NoiseFloor;
use super::outlier_correction::{self, RecordedReadings};
use super::row_share::{RowShare, Searched};
use super::whitened_residuals::WhitenedResiduals;
use super::{Options, Refused, alignment, bursts, gaps, initial_motion, regions, survey, validation};
use rsm_sim::effect::Survey;
use rsm_sim::kind::OUTPUTS;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;

/// How heavy tails of noise are handled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HeavyTails {
    /// Heavy tails are detected, and outliers are moved towards their neighbours.
    Corrected,
    /// Readings stay as recorded.
    Ignored,
}

/// The number of tests for heavy tails with the calibrated plant. Outliers bias the first calibration, not the second.
const TAILS: usize = 2;

/// Steps of a fit that starts near its minimum.
const STEPS: usize = 4;

/// Records and plant, prepared for a search.
pub struct CalibratedRecords {
    /// Training records.
    pub whitened: WhitenedResiduals,
    /// Validation records; may be empty.
    pub unseen: WhitenedResiduals,
    /// The nominal plant, with the initial states of the training records.
    pub nominal: Model,
    /// The plant that fits the records best within its tolerances.
    pub calibrated: Fit,
    /// What the checks found in the data.
    pub findings: Vec<Finding>,
    /// The share of long records that is used.
    pub share: RowShare,
    /// The scales of the training records.
    pub survey: Survey,
    /// Rounded outputs with their steps.
    pub rounded: Vec<(usize, f64)>,
    /// The readings of both sets of records as recorded.
    recorded: [RecordedReadings; 2],
}

impl CalibratedRecords {
    /// Prepares records and calibrates the plant to them.
    ///
    /// # Errors
    /// [`Refused`] if there is nothing to compare.
    pub fn of(
        file: &PlantFile,
        training: &[Record],
        validation: &[Record],
        tails: HeavyTails,
        searched: Searched,
        options: &Options<'_>,
    ) -> Result<Self, Refused> {
        let mut share = RowShare::of_rows(training, validation, searched);
        let prepare = |records: &[Record]| checks::prepared(records.iter().flat_map(|record| share.pieces(record, file)), file);
        let ((trained, mut findings), (judging, more)) = (prepare(training), prepare(validation));
        findings.extend(more);
        let white = [NoiseFloor::white(1.0); OUTPUTS];
        let mut whitened = WhitenedResiduals::new(trained, white, options.threads);
        let mut unseen = WhitenedResiduals::new(judging, white, options.threads);
        if whitened.records.iter().all(|it| it.outputs.is_empty()) {
            let constant = findings.iter().filter(|it| it.what == "constant");
            let channels: Vec<String> =
                constant.map(|it| format!("{} of {}", it.channel, regions::name_of(&it.record))).collect();
            return Err(if channels.is_empty() { Refused::NoOutputs } else { Refused::OnlyInputs(channels) });
        }
        share.cut(&mut whitened, &mut unseen, file);
        if let Some(not_seen) = share.unused_rows() {
            (options.progress)(&not_seen.to_string());
        }
        (options.progress)("calibrating within tolerances");
        let anew = |whitened: &mut WhitenedResiduals, unseen: &mut WhitenedResiduals, at_start| {
            let found = calibrate(whitened, file, at_start).ok_or(Refused::CannotSimulate)?;
            unseen.floors = whitened.floors;
            Ok(found)
        };
        let at_start = initial_motion::of_axis(&mut whitened, &mut unseen, file);
        let (mut nominal, mut calibrated) = anew(&mut whitened, &mut unseen, at_start)?;
        if checks_by_simulation(&mut whitened, &mut unseen, &calibrated, &mut findings) {
            (nominal, calibrated) = anew(&mut whitened, &mut unseen, at_start)?;
        }
        if initial_motion::is_visible(&whitened, &calibrated, &unseen) {
            (options.progress)("a record begins during a motion: initial states that no column shows are unknown");
            (nominal, calibrated) = anew(&mut whitened, &mut unseen, InitialMotion::InMotion)?;
        }
        let mut recorded = [&whitened, &unseen].map(RecordedReadings::of);
        if tails == HeavyTails::Corrected {
            for _ in 0..TAILS {
                if !outlier_correction::detect(&mut whitened, &mut unseen, &mut recorded, &calibrated, &findings) {
                    break;
                }
                (options.progress)("noise with heavy tails: readings far from their neighbours get a lower weight");
                (nominal, calibrated) = anew(&mut whitened, &mut unseen, nominal.at_start)?;
            }
            if bursts::leave_out(&mut whitened, &mut unseen, &calibrated, &mut findings) {
                (options.progress)("noise with bursts: their rows are left out");
                (nominal, calibrated) = anew(&mut whitened, &mut unseen, nominal.at_start)?;
            }
        }
        if let Some((records, fit)) = gaps::corrected(&whitened, &calibrated) {
            whitened.records = records;
            whitened.floors = floors(&whitened, &fit, file);
            calibrated = levenberg::fit(&whitened, fit.model, STEPS).ok_or(Refused::CannotSimulate)?;
            unseen.floors = whitened.floors;
        }
        correct_unseen(&mut unseen, &calibrated.model);
        let survey = survey::survey(&whitened, &calibrated);
        let mut prepared =
            CalibratedRecords { whitened, unseen, nominal, calibrated, findings, share, survey, rounded: Vec::new(), recorded };
        prepared.round(file)?;
        Ok(prepared)
    }

    /// Handles outputs whose readings are multiples of a coarse step. A simulation with rounding has no derivatives, so fits compare readings with
    /// the mean reading, and the rounding effect is added to the plant at the end.
    fn round(&mut self, file: &PlantFile) -> Result<(), Refused> {
        let step = |k: usize| self.survey.quantum[k].map(|step| (k, step));
        let coarse = (0..file.kind.outputs().len()).filter_map(step).filter(|(k, step)| *step > self.whitened.floors[*k].sd);
        self.rounded = coarse.collect();
        if self.rounded.is_empty() {
            return Ok(());
        }
        let fitted = |whitened: &WhitenedResiduals, fit: &Fit| {
            levenberg::fit(whitened, fit.model.clone(), STEPS).ok_or(Refused::CannotSimulate)
        };
        self.whitened.floors = with_rounding(&self.whitened, &self.calibrated, self.whitened.floors, &self.rounded);
        self.calibrated = fitted(&self.whitened, &self.calibrated)?;
        self.whitened.floors = self.floors(&self.calibrated, file);
        self.unseen.floors = self.whitened.floors;
        self.calibrated = fitted(&self.whitened, &self.calibrated)?;
        Ok(())
    }

    /// The noise of each output from the residual of a fit to the training records.
    #[must_use]
    pub fn floors(&self, fit: &Fit, file: &PlantFile) -> [NoiseFloor; OUTPUTS] {
        with_rounding(&self.whitened, fit, floors(&self.whitened, fit, file), &self.rounded)
    }

    /// Leaves out the rows of bursts that a fit with causes shows; what these causes do had hidden them. Returns whether there are any.
    pub(super) fn leave_out_hidden_bursts(&mut self, fit: &Fit) -> bool {
        bursts::leave_out(&mut self.whitened, &mut self.unseen, fit, &mut self.findings)
    }

    /// Detects heavy tails that were hidden by structure until this fit removed it. Returns whether readings changed.
    pub fn correct_hidden_tails(&mut self, fit: &Fit) -> bool {
        outlier_correction::detect(&mut self.whitened, &mut self.unseen, &mut self.recorded, fit, &self.findings)
    }

    /// Estimates the inputs in the gaps of records from the readings, with the plant of a fit. Returns whether those of the training records changed.
    pub fn correct_gaps(&mut self, fit: &Fit) -> bool {
        let corrected = gaps::corrected(&self.whitened, fit);
        self.correct_unseen(&fit.model);
        let any = corrected.is_some();
        if let Some((records, _)) = corrected {
            self.whitened.records = records;
        }
        any
    }

    /// The same for holdout records only.
    pub fn correct_unseen(&mut self, model: &Model) {
        correct_unseen(&mut self.unseen, model);
    }

    /// From now on records begin in motion.
    pub fn begins_in_motion(&mut self) {
        let records: Vec<&Record> = self.whitened.records.iter().map(|it| &it.record).collect();
        for model in [&mut self.nominal, &mut self.calibrated.model] {
            model.at_start = InitialMotion::InMotion;
            model.take_starts(&records, self.whitened.floors.map(|floor| floor.sd));
        }
    }
}

/// Estimates the inputs in the gaps of holdout records from their readings, with the plant of a model.
fn correct_unseen(unseen: &mut WhitenedResiduals, model: &Model) {
    if unseen.records.iter().all(|it| it.filled_gaps.is_empty()) {
        return;
    }
    let there = validation::fit_initial_states(unseen, model);
    if let Some((records, _)) = there.and_then(|there| gaps::corrected(unseen, &there)) {
        unseen.records = records;
    }
}

/// Checks of the data that need the simulation. Returns whether the rows that count changed.
fn checks_by_simulation(
    whitened: &mut WhitenedResiduals,
    unseen: &mut WhitenedResiduals,
    calibrated: &Fit,
    findings: &mut Vec<Finding>,
) -> bool {
    let before = findings.len();
    let kind = calibrated.model.file.kind;
    alignment::remove_motion_findings(&mut whitened.records, &calibrated.simulated, kind, findings);
    let judged = validation::fit_initial_states(unseen, &calibrated.model).map_or_else(Vec::new, |fit| fit.simulated);
    alignment::remove_motion_findings(&mut unseen.records[..judged.len()], &judged, kind, findings);
    let mut changed = findings.len() != before;
    let training = whitened.records.iter().zip(&calibrated.simulated);
    let all: Vec<_> = training.chain(unseen.records.iter().zip(&judged)).collect();
    let shifts = alignment::shifts(&all);
    let trained = whitened.records.len();
    for shift in shifts {
        let place = shift.record;
        let prepared = if place < trained { &mut whitened.records[place] } else { &mut unseen.records[place - trained] };
        let rows = prepared.record.rows();
        findings.push(Finding {
            record: prepared.record.file.clone(),
            channel: kind.outputs()[prepared.outputs[shift.output]].name.to_string(),
            what: if shift.late > 0 { "shifted in time, late" } else { "shifted in time, early" },
            rows: (prepared.file_row(0), prepared.file_row(rows - 1)),
        });
        prepared.leave_out(shift.output);
        changed = true;
    }
    changed
}

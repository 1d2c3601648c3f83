//! The gain of an extended plant on test records, which nothing else uses.
//!
//! In: the final plants of a diagnosis, and test records. Out: [`Tested`]. Test records are used only here, once, when causes, parameters and verdict
//! are final. Other test files change only these figures. Only the initial state of a record is fitted, to its own first part.

use super::bootstrap;
use super::checks::{self, Finding};
use super::model::Model;
use super::outlier_correction;
use super::prepared::Piece;
use super::validation::{self, Error, gain, gain_of};
use super::whitened_residuals::{Simulated, WhitenedResiduals};
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;

/// The initial state is estimated on the first part of a record, one part in this many. Errors are of the rows after it.
pub const FIRST_PART: usize = 4;

/// Figures of test records.
#[derive(Debug, Clone, PartialEq)]
pub struct Tested {
    /// Their files.
    pub files: Vec<String>,
    /// What is wrong with their data.
    pub findings: Vec<Finding>,
    /// Errors of the nominal plant.
    pub nominal: Vec<Error>,
    /// Errors of the extended plant.
    pub extended: Vec<Error>,
    /// Share of the squared error above the noise floor that the extension removes.
    pub gain: f64,
    /// Its 95 % interval over blocks of the rows.
    pub gain_interval: (f64, f64),
}

/// The figures, relative to the noise of the fitted records. `None` if there are no test records, or if a plant cannot be simulated along them.
#[must_use]
pub fn tested(
    file: &PlantFile,
    records: &[Record],
    fitted: &WhitenedResiduals,
    nominal: &Model,
    extended: &Model,
) -> Option<Tested> {
    let (prepared, findings) = checks::prepared(records.iter().cloned().map(Piece::whole), file);
    if prepared.is_empty() {
        return None;
    }
    let whitened = outlier_correction::corrected(fitted.with_records(prepared), extended);
    let before = from_first_part(&whitened, nominal)?;
    let after = from_first_part(&whitened, extended)?;
    let mut rest = whitened.clone();
    for one in &mut rest.records {
        let first = one.record.rows() / FIRST_PART;
        one.used.iter_mut().for_each(|used| used[..first].fill(false));
    }
    let [nominal, extended] = [&before, &after].map(|simulated| validation::errors_of(&rest, simulated));
    Some(Tested {
        files: records.iter().map(|it| it.file.clone()).collect(),
        findings,
        gain: gain(&nominal, &extended),
        gain_interval: bootstrap::gain_interval(&rest, &before, &after, gain_of),
        nominal,
        extended,
    })
}

/// A simulation of whole records, with initial states from their first parts.
fn from_first_part(whitened: &WhitenedResiduals, model: &Model) -> Option<Vec<Simulated>> {
    let first = whitened.records.iter().map(|it| it.shortened(it.record.rows() / FIRST_PART)).collect();
    let started = validation::fit_initial_states(&whitened.with_records(first), model)?.model;
    whitened.run(&Model { starts: started.starts, unknowns: Vec::new(), ..model.clone() })
}

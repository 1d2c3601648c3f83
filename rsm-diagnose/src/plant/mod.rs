//! Diagnosis of a plant: the error of its simulation, the causes of the catalogue that explain it, and their gain.
//!
//! ```text
//!   records --units, checks--> rows that count --noise--> floor --levenberg--> calibrated plant
//!      --screen--> ranked hypotheses --variable_projection--> best numbers --selection--> causes --validation--> gain
//!      --excitations--> records that could be made --experiment--> the one that separates the causes
//! ```
//!
//! In: a nominal plant file, training and validation records. Out: a [`Diagnosis`]. Only the records and the nominal plant are inputs: no code here
//! may look into the plant that made a record. Does not print or write files.

pub mod alignment;
pub mod all_rows;
#[cfg(test)]
mod axis_under_steps;
pub mod bootstrap;
pub mod bursts;
mod by_configuration;
pub mod calibrated_records;
pub mod calibration;
pub mod candidates;
pub mod cause;
pub mod checks;
pub mod claims;
pub mod combinations;
mod compared;
mod confidence;
pub mod configurations;
pub mod correction;
pub mod curvature;
pub mod diagnosis;
pub mod effect_size;
pub mod equations;
pub mod error_breakdown;
mod exchange;
pub mod excitations;
pub mod experiment;
pub mod final_fit;
pub mod final_test;
pub mod free_run;
mod friction;
pub mod gaps;
pub mod growing_horizon;
pub mod growth;
pub mod hypotheses;
pub mod identifiability;
pub mod initial_motion;
pub mod inverse;
pub mod known_loop;
pub mod law;
pub mod levenberg;
pub mod model;
pub mod more_rows;
pub mod multistart;
pub mod nested_models;
pub mod noise;
pub mod noise_floor;
pub mod nuisance;
mod null;
pub mod octave_spectrum;
pub mod one_body;
mod open_numbers;
pub mod orders;
pub mod other_units;
mod outlier_correction;
mod own_noise;
pub mod plausible;
pub mod position_traces;
pub mod posterior;
pub mod predictors;
pub mod prepared;
pub mod quantities;
pub mod refined_guesses;
pub mod regions;
pub mod rejected;
pub mod repeated_blocks;
pub mod rotation;
pub mod rounding;
pub mod row_share;
pub mod screen;
pub mod search;
pub mod search_history;
mod search_rounds;
pub mod selection;
mod simulation_error;
pub mod spectrum;
pub mod standstill;
pub mod survey;
mod swapped_columns;
pub mod tails;
pub mod tested;
pub mod units;
pub mod upper_band;
pub mod validation;
pub mod variable_projection;
pub mod verdict;
pub mod waves;
pub mod whitened_residuals;
pub mod whiteness;
mod whole_numbers;

// Shared with surfaces.
use crate::engine::normal;
use calibrated_records::HeavyTails;
use row_share::Searched;
pub use rsm_fit::random;
use search_rounds::diagnose_records;

pub use cause::{Cause, Contribution, Interval};
pub use diagnosis::{Diagnosis, Verdict};
pub use experiment::Alias;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;

/// How a diagnosis runs.
pub struct Options<'a> {
    /// The number of simulations in parallel. The results do not depend on it.
    pub threads: usize,
    /// Called with progress messages.
    pub progress: &'a (dyn Fn(&str) + Sync),
}

/// Why there is no diagnosis: a numerical outcome.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Refused {
    /// No training record holds an output.
    NoOutputs,
    /// Every output that the training records hold has one constant value, though the plant moves. Holds the channels with their records.
    OnlyInputs(Vec<String>),
    /// The nominal plant cannot be simulated along the records.
    CannotSimulate,
}

impl std::fmt::Display for Refused {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Refused::NoOutputs => {
                write!(f, "found no output of the plant in the training records, expected at least one measured output")
            }
            Refused::OnlyInputs(channels) => {
                write!(
                    f,
                    "found no measured output: {} read one value in all rows, although the plant moves there; expected measured outputs (`rsm simulate` \
                     computes outputs from the inputs)",
                    channels.join(", ")
                )
            }
            Refused::CannotSimulate => {
                write!(
                    f,
                    "the nominal plant cannot be simulated along the records: check that their inputs are those of this plant, in the right units"
                )
            }
        }
    }
}

impl std::error::Error for Refused {}

/// Diagnoses a plant. Training records give the parameters of causes; training and validation records together choose the causes.
/// [`diagnose_and_test`] also takes test records.
///
/// # Errors
/// [`Refused`] if there is nothing to compare.
///
/// ```
/// use rsm_core::source::Source;
/// use rsm_diagnose::plant::{Options, diagnose};
/// use rsm_sim::{plant_file::PlantFile, record::Record, simulate::Simulator};
///
/// let axis = "format = 1\nplant = \"servo-axis\"\n[parameters]\nmass = 95.0\nforce_gain = 35.0\nviscous_friction = 200.0\n\
///             command_limit = 10.0\n[noise]\nposition = 1e-6\n";
/// let nominal = PlantFile::read(&Source::new("axis.toml", axis))?;
/// let machine = format!("{axis}[[effects]]\nkind = \"coulomb-friction\"\nparameters = {{ force = 20.0 }}\n");
/// let machine = PlantFile::read(&Source::new("machine.toml", machine))?;
///
/// // Two seconds of the machine, to and fro.
/// let time: Vec<f64> = (0..1000).map(|k| f64::from(k) * 0.002).collect(); // s
/// let command: Vec<f64> = time.iter().map(|t| 3.0 * (4.0 * t).sin() + 2.0 * (11.0 * t).sin()).collect(); // V
/// let still = vec![0.0; 1000]; // m; the first reading is the start
/// let record = Record::in_memory(&machine, &[("time", &time), ("command", &command), ("position", &still)])?;
/// let measured = Simulator::new(&machine, &record)?.run(&record)?;
/// let position = measured.of("position").unwrap();
///
/// let record = Record::in_memory(&nominal, &[("time", &time), ("command", &command), ("position", position)])?;
/// let found = diagnose(&nominal, &[record], &[], &Options { threads: 1, progress: &|_| {} })?;
/// assert_eq!(found.causes[0].kind, "coulomb-friction");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn diagnose(
    file: &PlantFile,
    training: &[Record],
    validation: &[Record],
    options: &Options<'_>,
) -> Result<Diagnosis, Refused> {
    diagnose_and_test(file, training, validation, &[], options)
}

/// Diagnoses a plant. The effects in its file are hypotheses that the records test too. Training records give the parameters of causes. Training and
/// validation records together choose the causes. Test records choose nothing: the final gain is computed on them.
///
/// # Errors
/// [`Refused`] if there is nothing to compare.
pub fn diagnose_and_test(
    file: &PlantFile,
    training: &[Record],
    validation: &[Record],
    test: &[Record],
    options: &Options<'_>,
) -> Result<Diagnosis, Refused> {
    let mut right = [training, validation, test].map(<[Record]>::to_vec);
    let swapped: Vec<checks::Finding> =
        right.iter_mut().flat_map(|records| swapped_columns::correct(file, records, options.threads)).collect();
    let [training, validation, test] = &right;
    let mut whole = in_units(file, training, validation, test, options)?;
    whole.findings.splice(0..0, swapped);
    Ok(whole)
}

/// Diagnoses a plant from records whose columns have the right headers.
fn in_units(
    file: &PlantFile,
    training: &[Record],
    validation: &[Record],
    test: &[Record],
    options: &Options<'_>,
) -> Result<Diagnosis, Refused> {
    let found = units::find(file, training, options.threads);
    let diagnosed = |training: &[Record], validation: &[Record], test: &[Record]| {
        if file.effects.is_empty() {
            of_nominal(file, training, validation, test, options)
        } else {
            claims::diagnose(file, training, validation, test, options)
        }
    };
    if found.is_empty() {
        return diagnosed(training, validation, test);
    }
    let mut all = [training, validation, test].map(<[Record]>::to_vec);
    for (one, right) in &found {
        (options.progress)(&one.to_string());
        all.iter_mut().flatten().for_each(|record| right.apply(record));
    }
    let mut whole = diagnosed(&all[0], &all[1], &all[2])?;
    let noise = &whole.noise;
    let gains = units::gains_with_causes(&found, &whole.plant, &all[0], noise, options.threads);
    if whole.verdict != Verdict::Unexplained && gains.iter().any(Option::is_none) {
        // With causes in the plant, the estimated factor no longer corresponds to a unit.
        return diagnosed(training, validation, test);
    }
    whole.units = found.into_iter().map(|it| it.0).collect();
    for (unit, gain) in whole.units.iter_mut().zip(gains) {
        unit.gain = gain.unwrap_or(unit.gain);
    }
    Ok(whole)
}

/// Diagnoses a plant with given effects, if it has any.
fn of_nominal(
    file: &PlantFile,
    training: &[Record],
    validation: &[Record],
    test: &[Record],
    options: &Options<'_>,
) -> Result<Diagnosis, Refused> {
    let diagnosed = |tails, searched| diagnose_records(file, training, validation, test, options, tails, searched);
    if row_share::has_enough_for_a_part(training, validation) {
        if let Some(found) = diagnosed(HeavyTails::Corrected, Searched::Part)? {
            return Ok(found);
        }
        (options.progress)("a part of the rows does not give the whole answer: searching with more rows");
    }
    let of_most = |tails| diagnosed(tails, Searched::Most)?.ok_or(Refused::CannotSimulate);
    let found = of_most(HeavyTails::Corrected)?;
    if !found.has_uneven_noise() || found.verdict != Verdict::Unexplained {
        return Ok(found);
    }
    // If the records are explained without a change of the noise model, the heavy tails and bursts were structure, not noise.
    let plain = of_most(HeavyTails::Ignored)?;
    Ok(if plain.verdict == Verdict::Unexplained { found } else { plain })
}

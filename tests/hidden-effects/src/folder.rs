//! A case as a folder: nominal.toml, train-*.csv, validate-*.csv, truth.json, and files that only the evaluation needs.
//!
//! In: a case. Out: files. A diagnosis gets the nominal file and the records, but not truth.json and the folder `judge`.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use crate::case::{Case, Run};
use crate::files;
use crate::judge;
use crate::plant::{self, Effect};

/// The paths of the files of a case.
#[derive(Debug, Clone)]
pub struct Folder {
    /// The nominal plant.
    pub nominal: PathBuf,
    /// Training records.
    pub train: Vec<PathBuf>,
    /// Validation records.
    pub validate: Vec<PathBuf>,
    /// The plant with true parameters and true effects.
    pub extended: PathBuf,
    /// Validation records without noise.
    pub exact: Vec<PathBuf>,
}

fn write(path: &Path, text: &str) -> Result<(), String> {
    std::fs::write(path, text).map_err(|error| format!("{}: {error}", path.display()))
}

/// Writes a case into a separate folder, and replaces its previous contents.
pub fn write_case(case: &Case, parent: &Path, seed: u64) -> Result<Folder, String> {
    let folder = parent.join(&case.name);
    if folder.exists() {
        std::fs::remove_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    }
    let for_judge = folder.join("judge");
    std::fs::create_dir_all(&for_judge).map_err(|error| format!("{}: {error}", for_judge.display()))?;
    let kind = case.truth.kind;
    let nominal = folder.join("nominal.toml");
    let it = &case.nominal;
    write(&nominal, &files::plant_file(kind, &it.parameters, &it.tolerance, &case.stated, None, &[]))?;
    let records = |name: &str, runs: &[Run]| -> Result<Vec<PathBuf>, String> {
        let each = runs.iter().enumerate().map(|(number, run)| {
            let path = folder.join(format!("{name}-{}.csv", number + 1));
            write(&path, &files::record(kind, &run.noisy, &run.left_out, &case.without))?;
            Ok(path)
        });
        each.collect()
    };
    let (train, validate) = (records("train", &case.train)?, records("validate", &case.validate)?);
    let exact = case.validate.iter().enumerate().map(|(number, run)| {
        let path = for_judge.join(format!("exact-{}.csv", number + 1));
        write(&path, &files::record(kind, &run.exact, &[], &[]))?;
        Ok(path)
    });
    let exact = exact.collect::<Result<Vec<_>, String>>()?;
    let extended = for_judge.join("extended.toml");
    write(&extended, &files::plant_file(kind, &case.truth.parameters, &[], &it.noise, None, &case.truth.effects))?;
    write(&folder.join("truth.json"), &format!("{:#}\n", truth(case, seed)))?;
    Ok(Folder { nominal, train, validate, extended, exact })
}

fn described(effect: &Effect) -> Value {
    let values: Map<String, Value> = effect.values.iter().map(|(name, value)| ((*name).to_string(), json!(value))).collect();
    json!({ "cause": judge::name(effect), "kind": effect.kind, "parameters": values })
}

fn truth(case: &Case, seed: u64) -> Value {
    let parameters: Map<String, Value> =
        case.truth.parameters.values.iter().map(|(name, value)| ((*name).to_string(), json!(value))).collect();
    json!({
        "case": case.name,
        "family": case.family.name(),
        "seed": seed,
        "causes": case.causes.iter().map(described).collect::<Vec<_>>(),
        "outside_the_catalogue": case.truth.outside.iter().map(described).collect::<Vec<_>>(),
        "fault": case.fault.map(|fault| format!("{fault:?}").to_lowercase()),
        "true_parameters": parameters,
        "signal_to_noise": case.signal_to_noise,
    })
}

/// The mean square error of a simulation for the exact validation records, in units of noise, over rows and outputs.
pub fn missed(case: &Case, simulated: &[Vec<Vec<f64>>]) -> f64 {
    let mut sum = 0.0;
    let mut count = 0.0;
    for (run, outputs) in case.validate.iter().zip(simulated) {
        // The reading of a coarse sensor without noise.
        let mut exact = run.exact.clone();
        plant::quantise(&case.truth, &mut exact);
        for ((truth, simulated), sigma) in exact.outputs.iter().zip(outputs).zip(&case.nominal.noise) {
            sum += truth.iter().zip(simulated).map(|(truth, it)| ((truth - it) / sigma).powi(2)).sum::<f64>();
            count += truth.len() as f64;
        }
    }
    sum / count
}

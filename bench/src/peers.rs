//! Other programs with the same work: solvers with the same plants (SciPy's LSODA with rates compiled by numba, diffsol with DiffSL), and fits of the
//! same data (numpy, statsmodels, polars, duckdb, scikit-learn).
//!
//! In: plants as texts with their records; the command `rsm`. Out: rows per second and errors of each solver, measured by
//! `bench/peers/simulation.py`; the tables of `bench/peers/fit.py`; or the reason why they are not available. Both run in a separate Python
//! environment, which is created if it is missing.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

/// The packages of an environment, with the versions for which its script was written, and the modules that it imports.
struct Packages {
    folder: &'static str,
    packages: &'static [&'static str],
    modules: &'static str,
}

const SOLVERS: Packages = Packages {
    folder: "peers",
    packages: &["numpy", "scipy==1.17.1", "numba==0.68.1", "pydiffsol==0.6.2"],
    modules: "scipy, numba, pydiffsol",
};

const FITS: Packages = Packages {
    folder: "peers-fit",
    packages: &["numpy==2.4.6", "statsmodels==0.15.0", "polars==2.1.0", "duckdb==2.0.1", "scikit-learn==1.9.1"],
    modules: "numpy, statsmodels, polars, duckdb, sklearn",
};

/// Prints the tables of fits, and returns whether the script came to its end. `program` is the command `rsm`.
///
/// # Errors
/// A sentence: Python, a package or the network is missing.
pub fn fits(program: &Path, rows: u32, surfaces: u32) -> Result<bool, String> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let (folder, python) = environment(&FITS)?;
    let mut script = Command::new(&python);
    script.arg(here.join("peers/fit.py")).arg(program).arg(folder.join("files"));
    let status = script.args([rows.to_string(), surfaces.to_string()]).status();
    Ok(status.map_err(|error| format!("{}: {error}", python.display()))?.success())
}

/// Runs the other solvers. `plants` contains, by name, the results of [`crate::engines::Text::for_peers`].
///
/// # Errors
/// A sentence: Python, a package or the network is missing, or the script failed.
pub fn measured(plants: &serde_json::Map<String, Value>) -> Result<Value, String> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let (folder, python) = environment(&SOLVERS)?;
    let file = folder.join("plants.json");
    std::fs::write(&file, Value::Object(plants.clone()).to_string()).map_err(|error| format!("{}: {error}", file.display()))?;
    let output = Command::new(&python).arg(here.join("peers/simulation.py")).arg(&file).output();
    let output = output.map_err(|error| format!("{}: {error}", python.display()))?;
    if !output.status.success() {
        return Err(format!("the script ended with {}: {}", output.status, String::from_utf8_lossy(&output.stderr).trim()));
    }
    serde_json::from_slice(&output.stdout).map_err(|error| format!("the script's answer: {error}"))
}

/// The folder of an environment and its Python.
fn environment(of: &Packages) -> Result<(PathBuf, PathBuf), String> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/xtask").join(of.folder);
    let python = folder.join("venv/bin/python");
    let run = |command: &mut Command| match command.output() {
        Ok(output) if output.status.success() => Ok(()),
        Ok(output) => Err(String::from_utf8_lossy(&output.stderr).trim().to_string()),
        Err(error) => Err(error.to_string()),
    };
    if run(Command::new(&python).args(["-c", &format!("import {}", of.modules)])).is_ok() {
        return Ok((folder, python));
    }
    std::fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    run(Command::new("python3").args(["-m", "venv"]).arg(folder.join("venv")))
        .map_err(|why| format!("no Python environment: {why}"))?;
    let mut install = Command::new(&python);
    install.args(["-m", "pip", "install", "--quiet"]).args(of.packages);
    run(&mut install).map_err(|why| format!("pip cannot install {}: {why}", of.packages.join(", ")))?;
    Ok((folder, python))
}

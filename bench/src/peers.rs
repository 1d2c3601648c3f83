//! Other solvers with the same plants: SciPy's LSODA with rates compiled by numba, and diffsol with DiffSL.
//!
//! In: plants as texts with their records. Out: rows per second and errors of each, measured by `bench/peers/simulation.py` in a separate Python
//! environment, which is created if it is missing; or the reason why it is not available.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

/// The packages of the environment, with the versions for which the script was written.
const PACKAGES: [&str; 4] = ["numpy", "scipy==1.17.1", "numba==0.68.1", "pydiffsol==0.6.2"];

/// Runs the other solvers. `plants` contains, by name, the results of [`crate::engines::Text::for_peers`].
///
/// # Errors
/// A sentence: Python, a package or the network is missing, or the script failed.
pub fn measured(plants: &serde_json::Map<String, Value>) -> Result<Value, String> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = here.join("../target/xtask/peers");
    let python = environment(&folder)?;
    let file = folder.join("plants.json");
    std::fs::write(&file, Value::Object(plants.clone()).to_string()).map_err(|error| format!("{}: {error}", file.display()))?;
    let output = Command::new(&python).arg(here.join("peers/simulation.py")).arg(&file).output();
    let output = output.map_err(|error| format!("{}: {error}", python.display()))?;
    if !output.status.success() {
        return Err(format!("the script ended with {}: {}", output.status, String::from_utf8_lossy(&output.stderr).trim()));
    }
    serde_json::from_slice(&output.stdout).map_err(|error| format!("the script's answer: {error}"))
}

fn environment(folder: &Path) -> Result<PathBuf, String> {
    let python = folder.join("venv/bin/python");
    let run = |command: &mut Command| match command.output() {
        Ok(output) if output.status.success() => Ok(()),
        Ok(output) => Err(String::from_utf8_lossy(&output.stderr).trim().to_string()),
        Err(error) => Err(error.to_string()),
    };
    if run(Command::new(&python).args(["-c", "import scipy, numba, pydiffsol"])).is_ok() {
        return Ok(python);
    }
    std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    run(Command::new("python3").args(["-m", "venv"]).arg(folder.join("venv")))
        .map_err(|why| format!("no Python environment: {why}"))?;
    let mut install = Command::new(&python);
    install.args(["-m", "pip", "install", "--quiet"]).args(PACKAGES);
    run(&mut install).map_err(|why| format!("pip cannot install {}: {why}", PACKAGES.join(", ")))?;
    Ok(python)
}

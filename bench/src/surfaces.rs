//! The measured surfaces.
//!
//! In: `../shared/bench/peers/surfaces.json` beside the workspace (inputs with bounds, terms with exponents and coefficients), from which the peers
//! are also generated; `generated/coefficients`. Out: checked models. The six are created once for each behaviour outside the range.

use std::path::{Path, PathBuf};

use rsm_core::check::Checked;
use rsm_core::model::{Input, Model, Outside, Surface, Term};
use rsm_core::source::Source;
use serde_json::Value;

/// One of the six surfaces of the peers' benchmark: `S1` to `S6`.
#[derive(Debug, Clone)]
pub struct PeerSurface {
    /// `S1` to `S6`.
    pub id: String,
    /// A model `s1` with the surface `value`.
    pub model: Model,
}

/// The root of the workspace.
#[must_use]
pub fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("this package lies in the workspace").to_path_buf()
}

/// The six surfaces, or the path where they are missing.
///
/// # Panics
/// If the file exists but is not valid.
pub fn peers() -> Result<Vec<PeerSurface>, String> {
    let path = workspace().join("../shared/bench/peers/surfaces.json");
    let text = std::fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))?;
    let list: Value = serde_json::from_str(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let surfaces = list.as_array().unwrap_or_else(|| panic!("{}: a list is expected", path.display()));
    Ok(surfaces.iter().map(|surface| peer(surface).unwrap_or_else(|| panic!("{}: {surface}", path.display()))).collect())
}

/// The six surfaces, or none with a message. If CI is set they must exist.
///
/// # Panics
/// If they are missing and CI is set.
#[must_use]
pub fn peers_or_none() -> Vec<PeerSurface> {
    peers().unwrap_or_else(|missing| {
        let what = format!("THE SIX SURFACES ARE NOT MEASURED: {missing}");
        assert!(std::env::var_os("CI").is_none(), "{what}");
        eprintln!("\n{what}\n");
        Vec::new()
    })
}

fn peer(json: &Value) -> Option<PeerSurface> {
    let id = json["id"].as_str()?;
    let input = |input: &Value| {
        let range = [input["lo"].as_f64()?, input["hi"].as_f64()?];
        let name = input["name"].as_str()?.to_string();
        Some(Input { name, unit: "1".to_string(), range, outside: Outside::Extrapolate })
    };
    let term = |term: &Value| {
        let power = |power: &Value| u32::try_from(power.as_u64()?).ok();
        let powers = term["exp"].as_array()?.iter().map(power).collect::<Option<_>>()?;
        Some(Term { powers, coefficient: term["coef"].as_f64()? })
    };
    let inputs = json["inputs"].as_array()?.iter().map(input).collect::<Option<Vec<_>>>()?;
    let surface = Surface {
        name: "value".to_string(),
        unit: "1".to_string(),
        inputs: inputs.iter().map(|input| input.name.clone()).collect(),
        terms: json["terms"].as_array()?.iter().map(term).collect::<Option<_>>()?,
        ..Surface::default()
    };
    let model = Model { name: id.to_lowercase(), inputs, surfaces: vec![surface], ..Model::default() };
    Some(PeerSurface { id: id.to_string(), model })
}

impl PeerSurface {
    /// The model with every input clamped, or none.
    ///
    /// # Panics
    /// If rsm refuses the surface.
    #[must_use]
    pub fn checked(&self, outside: Outside) -> Checked {
        let mut model = self.model.clone();
        for input in &mut model.inputs {
            input.outside = outside;
        }
        Checked::from_model(&model).unwrap_or_else(|faults| panic!("{}: {faults}", self.id))
    }
}

/// The models of `generated/coefficients`, ordered by name.
///
/// # Panics
/// If a file is refused: then `generated/` cannot contain its code either.
#[must_use]
pub fn generated() -> Vec<Checked> {
    let folder = workspace().join("generated/coefficients");
    let entries = std::fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.expect("a folder can be listed").path()).collect();
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "toml"));
    paths.sort();
    let read = |path: &PathBuf| {
        Source::read(path).and_then(|source| Checked::read(&source)).unwrap_or_else(|faults| panic!("{faults}"))
    };
    paths.iter().map(read).collect()
}

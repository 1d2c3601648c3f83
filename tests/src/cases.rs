//! The models that every back end must agree on.
//!
//! Out: a [`Case`] for each model file of the build script, or of `generated/coefficients`, with its evaluators lowered.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use rsm_core::check::Checked;
use rsm_core::compile;
use rsm_core::emit::Unit;
use rsm_core::source::Source;

/// One model with all its evaluators.
#[derive(Debug, Clone)]
pub struct Case {
    /// The model file.
    pub file: PathBuf,
    /// The model.
    pub checked: Checked,
    /// Its evaluators, in every precision that can hold it.
    pub unit: Unit,
}

impl Case {
    /// The operations of all evaluators: what their compilation costs.
    #[must_use]
    pub fn operations(&self) -> usize {
        self.unit.functions.iter().map(|function| function.tape.operation_count()).sum()
    }
}

/// The random models of the tests that call compilers: all of them in a campaign, else the sample of [`sample`].
#[must_use]
pub fn random() -> Vec<Case> {
    if crate::is_campaign() { every_random().to_vec() } else { sample() }
}

/// The random models of tests that compile each model many times: as [`random`], but without the few that take longest to compile.
#[must_use]
pub fn quick_random() -> Vec<Case> {
    // Of the 25 models of the sample 21 have fewer operations, and half of the operations in all.
    const MOST_OPERATIONS: usize = 240;
    random().into_iter().filter(|case| crate::is_campaign() || case.operations() < MOST_OPERATIONS).collect()
}

/// All random models: 36 of 1 to 6 inputs and order 1 to 5, 6 with splines, 6 with transforms, 8 with compensators. Read once: some proofs of
/// stability take a second, and many tests ask.
#[must_use]
pub fn every_random() -> &'static [Case] {
    static READ: OnceLock<Vec<Case>> = OnceLock::new();
    READ.get_or_init(|| of_folder(&Path::new(env!("OUT_DIR")).join("models")))
}

/// A sample of the random models, with as few operations as a greedy choice finds: each facet of a model is in one of them.
#[must_use]
pub fn sample() -> Vec<Case> {
    let mut left: Vec<(BTreeSet<String>, &Case)> = every_random().iter().map(|case| (facets(case), case)).collect();
    let mut wanted: BTreeSet<String> = left.iter().flat_map(|(facets, _)| facets.clone()).collect();
    let mut chosen = vec![];
    while !wanted.is_empty() {
        let share = |(facets, case): &(BTreeSet<String>, &Case)| {
            facets.intersection(&wanted).count() as f64 / case.operations().max(1) as f64
        };
        let best =
            (0..left.len()).max_by(|i, j| share(&left[*i]).total_cmp(&share(&left[*j]))).expect("a model has what is wanted");
        let (facets, case) = left.swap_remove(best);
        wanted.retain(|facet| !facets.contains(facet));
        chosen.push(case.clone());
    }
    chosen.sort_by(|one, other| one.file.cmp(&other.file));
    chosen
}

/// What back ends can do differently in a model: the keys of its file and their words (`outside = "clamp"`), the count of inputs and the order of its
/// surfaces, the operations and the precisions of its evaluators.
fn facets(case: &Case) -> BTreeSet<String> {
    let text = std::fs::read_to_string(&case.file).unwrap_or_else(|error| panic!("{}: {error}", case.file.display()));
    let table: toml::Table = text.parse().unwrap_or_else(|error| panic!("{}: {error}", case.file.display()));
    let mut facets = BTreeSet::new();
    for (key, value) in &table {
        match value {
            // Tables by name: inputs, surfaces, compensators.
            toml::Value::Table(named) => named.values().for_each(|value| add_keys(key, value, &mut facets)),
            _ => add_keys(key, value, &mut facets),
        }
    }
    for surface in &case.checked.model().surfaces {
        facets.insert(format!("{} inputs", surface.inputs.len()));
        let order = surface.terms.iter().map(|term| term.powers.iter().sum::<u32>()).max();
        facets.extend(order.map(|order| format!("order {order}")));
        facets
            .extend(surface.spline.iter().map(|spline| format!("degree {} of {} inputs", spline.degree, surface.inputs.len())));
    }
    for function in &case.unit.functions {
        let precision = function.tape.precision.name();
        facets.insert(precision.to_string());
        for op in &function.tape.ops {
            let words = format!("{op:?}");
            facets.insert(format!("{precision} {}", words.split(|c: char| !c.is_alphanumeric()).next().unwrap_or_default()));
        }
    }
    facets
}

/// The paths of keys below a value, with the words that are neither names nor units.
fn add_keys(path: &str, value: &toml::Value, facets: &mut BTreeSet<String>) {
    match value {
        toml::Value::Table(table) => {
            for (key, value) in table {
                let names_inputs = path.ends_with("symmetry");
                add_keys(&if names_inputs { path.to_string() } else { format!("{path} {key}") }, value, facets);
            }
        }
        toml::Value::Array(values) => values.iter().for_each(|value| add_keys(path, value, facets)),
        toml::Value::String(word)
            if !["model", "unit", "input", "inputs", "surface", "reciprocal", "sum"]
                .iter()
                .any(|name| path.ends_with(name)) =>
        {
            facets.insert(format!("{path} {word}"));
        }
        _ => {
            facets.insert(path.to_string());
        }
    }
}

/// The coefficient files that are checked in.
#[must_use]
pub fn checked_in() -> Vec<Case> {
    of_folder(&root().join("generated").join("coefficients"))
}

/// The root of the workspace.
///
/// # Panics
/// Never: this package lies in it.
#[must_use]
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the package lies in the workspace").to_path_buf()
}

/// Every model file of a folder, by name.
///
/// # Panics
/// When the folder has none, or one of them is refused.
#[must_use]
pub fn of_folder(folder: &Path) -> Vec<Case> {
    let entries = std::fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.expect("a readable folder").path()).collect();
    files.retain(|file| file.extension().is_some_and(|extension| extension == "toml"));
    files.sort();
    assert!(!files.is_empty(), "{}: no model file", folder.display());
    files.into_iter().map(of_file).collect()
}

fn of_file(file: PathBuf) -> Case {
    let checked = Source::read(&file).and_then(|source| Checked::read(&source)).unwrap_or_else(|faults| panic!("{faults}"));
    let unit = compile::unit(&checked, &[]).unwrap_or_else(|faults| panic!("{faults}"));
    Case { file, checked, unit }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sample_has_every_facet_and_a_part_of_the_work() {
        let (every, sample) = (every_random(), sample());
        let all_of = |cases: &[Case]| cases.iter().flat_map(facets).collect::<BTreeSet<String>>();
        assert_eq!(all_of(every), all_of(&sample));
        let work = |cases: &[Case]| cases.iter().map(Case::operations).sum::<usize>();
        assert!(work(&sample) * 3 < work(every), "{} of {} operations", work(&sample), work(every));
    }
}

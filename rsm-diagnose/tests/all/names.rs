//! The search does not use names of effects or of plants: special properties of an effect are declared in its own file, those of a plant follow from
//! its text and its sites.

use std::path::{Path, PathBuf};

/// The source files of a folder, except those of tests.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        let name = entry.file_name().unwrap().to_string_lossy().into_owned();
        if entry.is_dir() && name != "tests" {
            found.extend(sources(&entry));
        } else if name.ends_with(".rs") && name != "tests.rs" && name != "axis_under_steps.rs" {
            found.push(entry);
        }
    }
    found
}

/// Lines that contain the name of an effect or of a plant as a string, outside of tests and comments. A module of tests with its code is the end of a
/// file; `mod tests;` names another file, and code follows it.
fn named(text: &str) -> Vec<(usize, &str)> {
    let lines: Vec<&str> = text.lines().collect();
    let begins_tests = |k: usize| lines[k] == "#[cfg(test)]" && lines.get(k + 1).is_some_and(|next| next.ends_with('{'));
    let end = (0..lines.len()).find(|k| begins_tests(*k)).unwrap_or(lines.len());
    let before_tests = lines[..end].iter().copied().enumerate();
    let code = before_tests.filter(|(_, line)| !line.trim_start().starts_with("//"));
    let plants = rsm_sim::equation_plant::first_format();
    let effects: Vec<_> = plants.iter().flat_map(|(_, kind)| rsm_sim::equation_plant::effects_on(*kind)).collect();
    let kinds = effects.iter().map(|it| it.kind);
    let quoted: Vec<String> = kinds.chain(plants.iter().map(|it| it.0)).map(|name| format!("\"{name}\"")).collect();
    let names = |line: &str| quoted.iter().any(|name| line.contains(name));
    code.filter(|(_, line)| names(line)).map(|(number, line)| (number + 1, line)).collect()
}

#[test]
fn no_source_of_the_diagnosis_names_an_effect_or_a_plant() {
    let list = sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src/plant"));
    assert!(list.len() > 60, "{}", list.len());
    for path in list {
        let text = std::fs::read_to_string(&path).unwrap();
        let found = named(&text);
        assert!(found.is_empty(), "{}: {found:?}", path.display());
    }
}

#[test]
fn a_name_is_seen() {
    assert_eq!(
        named("// \"windage\"\n#[cfg(test)]\nmod tests;\nlet a = of(\"windage\");\n#[cfg(test)]\nmod own {\n\"windage\"\n}\n"),
        [(4, "let a = of(\"windage\");")]
    );
    assert_eq!(named("if kind.is(\"pmac\") {}\n").len(), 1);
    assert_eq!(named("let force = of(\"rotor\");\n"), []);
}

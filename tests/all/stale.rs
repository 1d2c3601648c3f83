//! `generated/` is what the emitters give today for `generated/coefficients`, byte for byte.

use std::collections::BTreeMap;
use std::path::Path;

use rsm_core::emit;
use rsm_tests::cases;

/// Name below `generated/` and text of every file that belongs there.
fn expected() -> BTreeMap<String, String> {
    let mut files = BTreeMap::new();
    for case in cases::checked_in() {
        let model = &case.unit.model;
        let c = emit::c::emit(&case.unit);
        files.insert(format!("rust/{model}.rs"), emit::rust::emit(&case.unit));
        files.insert(format!("c/{model}.h"), c.header);
        files.insert(format!("c/{model}.c"), c.source);
    }
    files
}

fn checked_in(generated: &Path) -> BTreeMap<String, String> {
    let mut files = BTreeMap::new();
    for language in ["rust", "c"] {
        let Ok(entries) = std::fs::read_dir(generated.join(language)) else { continue };
        for entry in entries {
            let entry = entry.expect("a readable folder");
            let name = format!("{language}/{}", entry.file_name().to_string_lossy());
            files.insert(name, std::fs::read_to_string(entry.path()).expect("a text file"));
        }
    }
    files
}

#[test]
fn generated_files_are_up_to_date() {
    let generated = cases::root().join("generated");
    let (expected, found) = (expected(), checked_in(&generated));
    let mut wrong = vec![];
    for (name, text) in &expected {
        match found.get(name) {
            None => wrong.push(format!("generated/{name} is missing")),
            Some(found) if found != text => {
                let same = text.lines().zip(found.lines()).take_while(|(new, old)| new == old).count();
                wrong.push(format!("generated/{name} is stale from line {}", same + 1));
            }
            Some(_) => {}
        }
    }
    wrong.extend(
        found.keys().filter(|name| !expected.contains_key(*name)).map(|name| format!("generated/{name} comes from no model")),
    );
    assert!(wrong.is_empty(), "{}\nrun `cargo xtask bless` and look at the difference", wrong.join("\n"));
}

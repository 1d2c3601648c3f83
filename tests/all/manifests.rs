//! The manifests of the libraries: the entries that a registry shows, and that each library can be used without the rest of the workspace.

use std::collections::BTreeSet;
use std::path::Path;

use rsm_tests::cases;
use toml::de::{DeTable, DeValue};

/// The libraries, in order of dependence.
const LIBRARIES: [&str; 10] =
    ["rsm-core", "rsm-macros", "rsm-fit", "rsm-import", "rsm-model", "rsm-sim", "rsm-rigs", "rsm-diagnose", "rsm-sweep", "rsm"];

fn manifest(folder: &Path) -> String {
    std::fs::read_to_string(folder.join("Cargo.toml")).unwrap_or_else(|error| panic!("{}: {error}", folder.display()))
}

fn table<'t, 'i>(of: &'t DeTable<'i>, key: &str) -> &'t DeTable<'i> {
    of.get(key).and_then(|value| value.get_ref().as_table()).unwrap_or_else(|| panic!("there is no `{key}`"))
}

fn texts<'t>(package: &'t DeTable<'_>, key: &str) -> Vec<&'t str> {
    let array = package.get(key).and_then(|value| value.get_ref().as_array());
    array.into_iter().flatten().filter_map(|item| item.get_ref().as_str()).collect()
}

/// What is wrong with the manifest of a library.
fn wrong(name: &str, manifest: &str, folder: &Path) -> Vec<String> {
    let document = DeTable::parse(manifest).unwrap_or_else(|error| panic!("{name}: {error}")).into_inner();
    let package = table(&document, "package");
    let mut wrong = Vec::new();
    let mut require = |held: bool, what: &str| {
        if !held {
            wrong.push(format!("{name}: {what}"));
        }
    };
    let text = |key: &str| package.get(key).and_then(|value| value.get_ref().as_str());
    require(text("description").is_some_and(|text| text.len() > 20), "a `description` of a line");
    require(package.contains_key("license"), "a `license`");
    require(text("readme") == Some("README.md"), "`readme = \"README.md\"`");
    // Rules of crates.io: five of each at most, a keyword of 20 letters at most.
    let keywords = texts(package, "keywords");
    require((1..=5).contains(&keywords.len()) && keywords.iter().all(|word| word.len() <= 20), "one to five short `keywords`");
    require((1..=5).contains(&texts(package, "categories").len()), "one to five `categories`");
    let include = texts(package, "include");
    require(include.contains(&"src") && include.contains(&"README.md"), "`include` with the sources and the README");
    require(include.iter().all(|path| folder.join(path).exists()), "every path of `include`");
    require(!package.contains_key("publish"), "no `publish`");
    let lints = table(&document, "lints").get("workspace").map(|value| value.get_ref());
    require(matches!(lints, Some(DeValue::Boolean(true))), "the lints of the workspace");
    let dependencies = document.get("dependencies").and_then(|value| value.get_ref().as_table());
    for used in dependencies.into_iter().flat_map(|table| table.keys()) {
        let used = used.get_ref();
        let is_ours = used.starts_with("rsm") || ["branch-free", "host-loop"].contains(&used.as_ref());
        require(!is_ours || LIBRARIES.contains(&used.as_ref()), &format!("`{used}` is published"));
    }
    wrong
}

#[test]
fn every_library_has_what_a_registry_shows() {
    let root = cases::root();
    let packed = std::fs::read_to_string(root.join("xtask/src/publish.rs")).expect("the list of what is packed");
    let mut all = Vec::new();
    for name in LIBRARIES {
        let folder = root.join(name);
        all.extend(wrong(name, &manifest(&folder), &folder));
        let readme = std::fs::read_to_string(folder.join("README.md")).unwrap_or_default();
        if !readme.starts_with(&format!("# {name}\n")) {
            all.push(format!("{name}: a README.md with its name as title"));
        }
        if !packed.contains(&format!("\"{name}\"")) {
            all.push(format!("{name}: a place in LIBRARIES of xtask/src/publish.rs"));
        }
    }
    assert!(all.is_empty(), "what is missing:\n  {}", all.join("\n  "));
}

#[test]
fn a_manifest_that_lacks_something_is_named() {
    let folder = cases::root().join("rsm-core");
    let good = manifest(&folder);
    for (from, to, expected) in [
        ("readme = \"README.md\"\n", "", "rsm-core: `readme = \"README.md\"`"),
        ("include = [\"src\", ", "include = [\"src\", \"sources\", ", "rsm-core: every path of `include`"),
        ("keywords = [", "keywords = [\"a-word-of-more-than-20\", ", "rsm-core: one to five short `keywords`"),
        ("license.workspace = true\n", "license.workspace = true\npublish = false\n", "rsm-core: no `publish`"),
        ("[dependencies]\n", "[dependencies]\nrsm-cli.workspace = true\n", "rsm-core: `rsm-cli` is published"),
    ] {
        assert!(good.contains(from), "{from}");
        assert_eq!(wrong("rsm-core", &good.replacen(from, to, 1), &folder), [expected]);
    }
}

/// The packages of `manifest`'s `[dependencies]` and `[build-dependencies]`.
fn dependencies(manifest: &str) -> BTreeSet<String> {
    let document = DeTable::parse(manifest).unwrap_or_else(|error| panic!("{error}")).into_inner();
    let tables = ["dependencies", "build-dependencies"].into_iter().filter_map(|kind| document.get(kind)?.get_ref().as_table());
    tables.flat_map(|table| table.keys()).map(|name| name.get_ref().to_string()).collect()
}

#[test]
fn the_lock_file_of_the_firmware_has_the_dependencies_of_its_packages() {
    // The workspace's own lock file is written by every build; this one is only used, with `--locked`, by a long test of the emulated board.
    let root = cases::root();
    let lock = std::fs::read_to_string(root.join("targets/firmware/rust/Cargo.lock")).expect("the lock file");
    let lock = DeTable::parse(&lock).unwrap_or_else(|error| panic!("{error}")).into_inner();
    let packages = lock.get("package").and_then(|value| value.get_ref().as_array()).expect("packages");
    let packages = packages.iter().filter_map(|package| package.get_ref().as_table());
    let ours: Vec<_> = packages.filter(|package| !package.contains_key("source")).collect();
    assert!(ours.len() > 3, "{} packages of this project", ours.len());
    for package in ours {
        let name = package.get("name").and_then(|value| value.get_ref().as_str()).expect("a name");
        let places = [root.join(name), root.join("targets").join(name), root.join("targets/firmware/rust")];
        let folder = places.iter().find(|folder| folder.join("Cargo.toml").exists()).expect("the last has one");
        // A version follows the name where the file has two versions of the package.
        let locked: BTreeSet<_> =
            texts(package, "dependencies").into_iter().filter_map(|text| text.split(' ').next()).map(str::to_string).collect();
        assert_eq!(locked, dependencies(&manifest(folder)), "{name}: run `cargo metadata` in targets/firmware/rust");
    }
}

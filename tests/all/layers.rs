//! The allowed imports between packages (ARCHITECTURE.md), compared with the manifests.
//!
//! A new package or a new import between packages needs a line here, which a reviewer sees. A failure prints the forbidden import. External
//! packages are named only where they are limited.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use rsm_tests::cases;
use toml::de::{DeTable, DeValue};

/// The packages that a package may use.
pub(super) struct Law {
    pub(super) package: &'static str,
    /// Packages of ours at run time.
    pub(super) ours: &'static [&'static str],
    /// Packages in build.rs and in tests, beyond those.
    aside: &'static [&'static str],
    /// Outside packages; `None` for any.
    outside: Option<&'static [&'static str]>,
}

pub(super) const LAWS: &[Law] = &[
    // Every target build compiles these, so they are kept small.
    Law {
        package: "rsm-core",
        ours: &[],
        // No target build compiles it: it checks the elementary functions.
        aside: &["astro-float"],
        outside: Some(&["foldhash", "num-bigint", "num-rational", "num-traits", "proc-macro2", "quote", "serde", "toml"]),
    },
    Law { package: "rsm-macros", ours: &["rsm-core"], aside: &[], outside: Some(&["proc-macro2", "quote", "syn"]) },
    Law { package: "rsm-fit", ours: &["rsm-core"], aside: &[], outside: None },
    // Files of other tools: uses units and tables, neither plants nor models.
    Law { package: "rsm-import", ours: &["rsm-core", "rsm-fit"], aside: &[], outside: None },
    // Texts to equations to programs: uses neither records nor effects. Units come from rsm-fit.
    Law { package: "rsm-model", ours: &["rsm-core", "rsm-fit"], aside: &[], outside: None },
    Law { package: "rsm-sim", ours: &["rsm-core", "rsm-fit", "rsm-model"], aside: &[], outside: None },
    Law { package: "rsm-rigs", ours: &["rsm-core", "rsm-fit", "rsm-sim"], aside: &[], outside: None },
    // Uses plants, not rigs: a diagnosis must not use how a record was made.
    Law { package: "rsm-diagnose", ours: &["rsm-core", "rsm-fit", "rsm-sim"], aside: &[], outside: None },
    // The handful of types that a user of the library needs.
    Law { package: "rsm", ours: &["rsm-core", "rsm-fit", "rsm-sim", "rsm-diagnose"], aside: &[], outside: Some(&["nalgebra"]) },
    // Between processes and hosts: uses both loops, has no mathematics of its own.
    Law { package: "rsm-link", ours: &["host-loop", "host-runners", "rsm-core", "rsm-sim"], aside: &[], outside: None },
    // Lists of tasks: a diagnosis is a function that it is given.
    Law { package: "rsm-sweep", ours: &["rsm-core", "rsm-fit", "rsm-model", "rsm-sim"], aside: &[], outside: None },
    Law {
        package: "rsm-cli",
        ours: &[
            "rsm-core",
            "rsm-macros",
            "rsm-fit",
            "rsm-import",
            "rsm-model",
            "rsm-sim",
            "rsm-rigs",
            "rsm-diagnose",
            "rsm-link",
            "rsm-sweep",
            "host-loop",
            "host-runners",
            "motor-loop",
            "throttle-loop",
        ],
        aside: &[],
        outside: None,
    },
    // A target gets its evaluators at compile time, from the macro or in build.rs. At run time it has no other code of ours.
    Law { package: "motor-loop", ours: &["branch-free", "rsm-macros"], aside: &["rsm-core"], outside: Some(&[]) },
    Law { package: "throttle-loop", ours: &["branch-free", "rsm-macros"], aside: &["rsm-core"], outside: Some(&[]) },
    // Comparisons that select: uses neither models nor motors.
    Law { package: "branch-free", ours: &[], aside: &[], outside: Some(&[]) },
    // A periodic loop: uses neither models nor motors.
    Law { package: "host-loop", ours: &[], aside: &[], outside: Some(&["nix"]) },
    // On a host, so it may use the plants that the loops run against.
    Law {
        package: "host-runners",
        ours: &["host-loop", "motor-loop", "throttle-loop", "rsm-core", "rsm-sim", "rsm-rigs"],
        aside: &[],
        outside: Some(&["stats_alloc"]),
    },
    Law {
        package: "rsm-tests",
        ours: &[
            "rsm-core",
            "rsm-macros",
            "rsm-fit",
            "rsm-model",
            "rsm-sim",
            "rsm-rigs",
            "host-loop",
            "host-runners",
            "motor-loop",
            "throttle-loop",
            "hidden-effects",
        ],
        aside: &["rsm-core"],
        outside: None,
    },
    // Tests the diagnosis with records of an independent simulation: with an import of ours, one error could be on both sides.
    Law { package: "hidden-effects", ours: &[], aside: &[], outside: Some(&["serde_json"]) },
    Law {
        package: "fuzz",
        ours: &["rsm-core", "rsm-fit", "rsm-import", "rsm-model", "rsm-sim", "rsm-diagnose", "rsm-link", "rsm-sweep"],
        aside: &[],
        outside: Some(&[]),
    },
    // Reads sources as text; imports nothing of ours.
    Law {
        package: "mutants",
        ours: &[],
        aside: &[],
        outside: Some(&["prettyplease", "proc-macro2", "quote", "serde_json", "syn"]),
    },
    Law { package: "rsm-bench", ours: &["rsm-core", "rsm-macros", "rsm-sim", "rsm-diagnose"], aside: &[], outside: None },
    Law { package: "xtask", ours: &[], aside: &[], outside: Some(&[]) },
];

/// External packages that a package must not depend on, not even through others of ours: large ones would be compiled in every target build.
const NEVER_REACHED: &[(&str, &[&str])] = &[
    ("rsm-core", &["nalgebra", "clarabel", "syn"]),
    ("rsm-macros", &["nalgebra", "clarabel"]),
    ("motor-loop", &["nalgebra", "clarabel"]),
    ("throttle-loop", &["nalgebra", "clarabel"]),
    ("host-loop", &["nalgebra", "clarabel"]),
];

/// What a package uses, by manifest.
#[derive(Debug, Default, Clone, PartialEq, Eq)]
struct Uses {
    /// At run time.
    normal: BTreeSet<String>,
    /// In build.rs and in tests.
    aside: BTreeSet<String>,
}

fn parse<'t>(text: &'t str, what: &str) -> DeTable<'t> {
    DeTable::parse(text).unwrap_or_else(|error| panic!("{what}: {error}")).into_inner()
}

fn text<'v>(value: Option<&'v DeValue<'_>>) -> Option<&'v str> {
    value.and_then(DeValue::as_str)
}

fn get<'t, 'i>(table: &'t DeTable<'i>, key: &str) -> Option<&'t DeValue<'i>> {
    table.get(key).map(|value| value.get_ref())
}

/// The name of a package and what it uses. Renamed packages count by their true name.
fn read(manifest: &DeTable<'_>) -> (String, Uses) {
    let package = get(manifest, "package").and_then(DeValue::as_table).expect("a manifest has a package");
    let name = text(get(package, "name")).expect("a package has a name").to_string();
    let mut uses = Uses::default();
    let mut sections = vec![manifest];
    // [target.'cfg(...)'.dependencies]
    if let Some(targets) = get(manifest, "target").and_then(DeValue::as_table) {
        sections.extend(targets.values().filter_map(|target| target.get_ref().as_table()));
    }
    for section in sections {
        for key in ["dependencies", "build-dependencies", "dev-dependencies"] {
            let used = if key == "dependencies" { &mut uses.normal } else { &mut uses.aside };
            for (dependency, value) in get(section, key).and_then(DeValue::as_table).into_iter().flatten() {
                let renamed = value.get_ref().as_table().and_then(|table| text(get(table, "package")));
                used.insert(renamed.unwrap_or(dependency.get_ref()).to_string());
            }
        }
    }
    (name, uses)
}

fn workspace(root: &Path) -> BTreeMap<String, Uses> {
    let read_file = |path: &Path| std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let manifest = read_file(&root.join("Cargo.toml"));
    let manifest = parse(&manifest, "Cargo.toml");
    let workspace = get(&manifest, "workspace").and_then(DeValue::as_table).expect("the root is a workspace");
    let members = get(workspace, "members").and_then(DeValue::as_array).expect("the workspace lists its members");
    let folders = members.iter().filter_map(|member| member.get_ref().as_str());
    folders.map(|folder| read(&parse(&read_file(&root.join(folder).join("Cargo.toml")), folder))).collect()
}

/// Every forbidden import.
fn forbidden(packages: &BTreeMap<String, Uses>) -> Vec<String> {
    let mut arrows = vec![];
    for (name, uses) in packages {
        let Some(law) = LAWS.iter().find(|law| law.package == name) else {
            arrows.push(format!("{name} is a package of which the law of imports says nothing"));
            continue;
        };
        for (used, aside) in uses.normal.iter().map(|used| (used, false)).chain(uses.aside.iter().map(|used| (used, true))) {
            let is_ours = packages.contains_key(used);
            let allowed = if is_ours {
                law.ours.contains(&used.as_str()) || (aside && law.aside.contains(&used.as_str()))
            } else {
                law.outside.is_none_or(|outside| outside.contains(&used.as_str()))
                    || (aside && law.aside.contains(&used.as_str()))
            };
            if !allowed {
                let when = if aside { " (build or test)" } else { "" };
                arrows.push(format!("{name} -> {used}{when}"));
            }
        }
        let reached = reached(packages, name);
        for (_, never) in NEVER_REACHED.iter().filter(|(package, _)| package == name) {
            arrows.extend(never.iter().filter_map(|outside| reached.get(*outside).cloned()));
        }
    }
    arrows
}

/// Everything on which a package depends through our own packages, with the path. Build scripts are part of every build, tests of used
/// packages are not. Both are in one list here, so both are left out.
fn reached(packages: &BTreeMap<String, Uses>, from: &str) -> BTreeMap<String, String> {
    let mut ways = BTreeMap::from([(from.to_string(), from.to_string())]);
    let mut open = vec![from.to_string()];
    while let Some(package) = open.pop() {
        let Some(uses) = packages.get(&package) else { continue };
        for used in &uses.normal {
            if !ways.contains_key(used) {
                ways.insert(used.clone(), format!("{} -> {used}", ways[&package]));
                open.push(used.clone());
            }
        }
    }
    ways
}

#[test]
fn every_import_goes_up() {
    let arrows = forbidden(&workspace(&cases::root()));
    assert!(arrows.is_empty(), "imports that the law forbids:\n  {}", arrows.join("\n  "));
}

#[test]
fn a_forbidden_arrow_is_named() {
    let with = |package: &str, change: &dyn Fn(&mut Uses) -> &mut BTreeSet<String>, used: &str| {
        let mut packages = workspace(&cases::root());
        change(packages.get_mut(package).expect("a package of ours")).insert(used.to_string());
        forbidden(&packages)
    };
    assert!(with("rsm-core", &|uses| &mut uses.normal, "rsm-fit").contains(&"rsm-core -> rsm-fit".to_string()));
    assert_eq!(with("rsm-fit", &|uses| &mut uses.normal, "rsm-cli"), ["rsm-fit -> rsm-cli"]);
    assert_eq!(with("xtask", &|uses| &mut uses.aside, "serde"), ["xtask -> serde (build or test)"]);
    assert_eq!(with("motor-loop", &|uses| &mut uses.normal, "rsm-core"), ["motor-loop -> rsm-core"]);
    // Through another package: the whole path is shown.
    let found = with("rsm-core", &|uses| &mut uses.normal, "nalgebra");
    assert!(found.contains(&"rsm-macros -> rsm-core -> nalgebra".to_string()), "{found:?}");
}

#[test]
fn fitting_does_not_know_emitters() {
    let mut open = vec![cases::root().join("rsm-fit").join("src")];
    while let Some(path) = open.pop() {
        if path.is_dir() {
            open.extend(std::fs::read_dir(&path).expect("a readable folder").map(|entry| entry.expect("an entry").path()));
        } else {
            let text = std::fs::read_to_string(&path).expect("a readable file");
            let line = text.lines().find(|line| line.contains("rsm_core::emit") || line.contains("rsm_core::compile"));
            assert!(line.is_none(), "{}: {}", path.display(), line.unwrap_or_default());
        }
    }
}

#[test]
fn targets_do_without_std() {
    for target in ["branch-free", "motor-loop", "throttle-loop"] {
        let path = cases::root().join("targets").join(target).join("src").join("lib.rs");
        let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        assert!(text.lines().any(|line| line == "#![no_std]"), "{target}: src/lib.rs has no #![no_std]");
        assert!(!text.contains("extern crate"), "{target}: src/lib.rs takes another crate in");
    }
}

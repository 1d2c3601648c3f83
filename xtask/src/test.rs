//! `cargo xtask test`: everything that must hold before a change is done.
//!
//! Out: every stage with its time, a summary, and `N passed, N failed` over all tests as the last line. The fastest stages come first; the
//! first failure ends the run.

use crate::stage::Run;
use crate::workspace::{cargo, cargo_for_tests};
use crate::{dask, generated, helics, hidden_effects, mutants, packages, publish};

/// The libraries that must build without `std`, and the bare-metal target that is tried first: a Cortex-M4F, as in a motor drive.
const WITHOUT_STD: [&str; 2] = ["motor-loop", "throttle-loop"];
const BARE_METAL: &str = "thumbv7em-none-eabihf";

/// The tests of the long matrix, by parts of their names: those that run code of this build, which the stage `test` has run at opt 0, and those that
/// the stage `test` ignores because they take minutes at opt 0. All other tests of the target `across` read files, or call compilers for emitted
/// text: they do not depend on how this workspace is compiled.
const LONG_MATRIX: [&str; 6] = [
    "bit_for_bit::macro_keeps_the_bits",
    "bit_for_bit::all_back_ends_keep_the_bits",
    "inlined::every_way_of_inlining",
    "object_code::barrier_costs_next_to_nothing",
    "reference_step::",
    "of_the_steps_in_rust",
];

/// The packages that contain or run emitted code: the long matrix compiles them like a release. The other libraries remain as the tests before have
/// built them, which saves a second build of all of them. `rsm-core`, whose interpreter gives the reference bits, is at opt 3 in every profile.
const AS_RELEASED: [&str; 4] = ["rsm-tests", "branch-free", "motor-loop", "throttle-loop"];

/// The settings of the release profile for a package that the profile of the tests does not have.
fn as_released(package: &str) -> [String; 4] {
    ["opt-level=3", "debug-assertions=false", "overflow-checks=false", "codegen-units=16"]
        .map(|setting| format!("profile.dev.package.{package}.{setting}"))
}

/// Other systems than Linux on which the command must compile.
const ELSEWHERE: [&str; 2] = ["x86_64-pc-windows-gnu", "aarch64-apple-darwin"];

/// Runs every stage.
pub(crate) fn run() -> bool {
    let mut run = Run::new();
    run.check("packages", packages::ensure)
        .command("format", cargo(&["fmt", "--all", "--check"]))
        // With all features: what is off by default is compiled and linted here.
        .command("clippy", {
            cargo_for_tests(&["clippy", "--workspace", "--all-features", "--all-targets", "--", "-D", "warnings"])
        })
        // Cargo counts them among all targets only by their names.
        .command("clippy of slow tests", {
            let mut clippy = cargo_for_tests(&["clippy", "--workspace", "--all-features"]);
            clippy.args(SLOW).args(["--", "-D", "warnings"]);
            clippy
        })
        .check("helics", helics::ensure)
        .check("dask", dask::ensure)
        .command("test", tests(&[]))
        // Whole diagnoses, pages in a browser, loops between processes and hosts.
        .command("slow tests", tests(&SLOW))
        // At opt 0: these tests read small files, and a second optimised build of the library takes three times as long as all else of this stage.
        .command("parquet and arrow", {
            let unoptimised = "profile.dev.package.rsm-fit.opt-level=0";
            let with_features = ["test", "-p", "rsm-fit", "--features", "parquet,arrow", "--lib", "--config", unoptimised];
            cargo_for_tests(&[&with_features[..], &["--", "partial", "columnar"]].concat())
        })
        .command("programs", programs())
        // The diagnosis on records of the independent simulation: a quick subset; all of it is `cargo xtask hidden-effects`.
        .command("hidden effects", hidden_effects::quick())
        .command("noise of benches", hidden_effects::quick_of_bench("noise"))
        .command("data of benches", hidden_effects::quick_of_bench("data"))
        .command("hidden in surfaces", hidden_effects::quick_surfaces())
        // Whether the tests notice changes of the code: a sample; all of it is `cargo xtask mutants`.
        .command("mutants", mutants::quick())
        // At opt 3: see `LONG_MATRIX`. All points and combinations are `cargo xtask bits`.
        .command("long matrix", across_as_released(&LONG_MATRIX))
        .command("docs", {
            let mut docs = cargo_for_tests(&["doc", "--workspace", "--no-deps"]);
            docs.env("RUSTDOCFLAGS", "-D warnings");
            docs
        })
        // Whether every library can be published; `cargo xtask publish-check` builds each from its package too.
        .command("packing", publish::quick());
    let machine = has_core(BARE_METAL).then_some(BARE_METAL);
    if machine.is_none() && run.held() {
        println!("\nnote: {BARE_METAL} is not installed; the targets are built as `no_std` libraries for this host");
    }
    // Fitter, compiler and diagnosis must run on every usual system of an engineer.
    let elsewhere: Vec<&str> = ELSEWHERE.into_iter().filter(|machine| has_core(machine)).collect();
    if elsewhere.len() < ELSEWHERE.len() && run.held() {
        println!("\nnote: of {} only [{}] are installed (rustup target add)", ELSEWHERE.join(" and "), elsewhere.join(" "));
    }
    if !elsewhere.is_empty() {
        run.command("other systems", {
            let mut check = cargo_for_tests(&["check", "-p", "rsm-cli"]);
            check.args(elsewhere.iter().flat_map(|machine| ["--target", machine]));
            check
        });
    }
    run.command("no_std", {
        let mut build = cargo(&["build", "--release", "--lib"]);
        build.args(WITHOUT_STD.iter().flat_map(|package| ["-p", package]));
        build.args(machine.iter().flat_map(|machine| ["--target", machine]));
        build
    })
    .check("generated", generated::is_up_to_date);
    let held = run.finish();
    println!("\n{}", run.totals());
    held
}

/// The test targets that `cargo test` leaves out, so that the inner loop of a crate stays short. They have `test = false` in its manifest.
const SLOW: [&str; 4] = ["--test", "slow", "--test", "hosts"];

/// The tests of the workspace, or of some targets.
fn tests(targets: &[&str]) -> std::process::Command {
    let mut test = cargo_for_tests(&["test", "--workspace", "--no-fail-fast"]);
    test.args(targets).env("RSM_HELICS", helics::folder());
    test
}

/// Tests of the target `across` at opt 3, by parts of their names; all of them if there is none.
fn across_as_released(names: &[&str]) -> std::process::Command {
    let mut test = cargo_for_tests(&["test", "--workspace", "--test", "across", "--no-fail-fast"]);
    test.args(
        AS_RELEASED.iter().flat_map(|package| as_released(package)).flat_map(|setting| ["--config".to_string(), setting]),
    );
    test.args(["--", "--include-ignored"]).args(names);
    test
}

/// `cargo xtask bits`: the target `across` with 10^6 points for each function, every compiler and every way of inlining with every model.
pub(crate) fn bits() -> bool {
    let mut run = Run::new();
    let mut campaign = across_as_released(&[]);
    campaign.env("RSM_BITS_CAMPAIGN", "1");
    run.check("packages", packages::ensure).command("bits", campaign);
    run.finish()
}

/// Builds the programs that tests start. The tests are listed too, so that cargo uses the libraries that the tests have built.
pub(crate) fn programs() -> std::process::Command {
    cargo_for_tests(&["build", "--workspace", "--bins", "--tests"])
}

/// Whether the compiler in use has the core library of a machine.
fn has_core(machine: &str) -> bool {
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let output = std::process::Command::new(rustc).args(["--print", "target-libdir", "--target", machine]).output();
    output.is_ok_and(|output| {
        output.status.success() && std::path::Path::new(String::from_utf8_lossy(&output.stdout).trim()).is_dir()
    })
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::workspace::{root, sources};

    /// The sources of the target `across`, by module: the path of a test begins with the module.
    fn across() -> Vec<(String, String)> {
        let folder = root().join("tests/all");
        let of_one = |path: PathBuf| {
            let name = path.strip_prefix(&folder).expect("a file inside").with_extension("");
            let module = name.to_string_lossy().replace('/', "::").replace("::mod", "");
            (module, std::fs::read_to_string(&path).expect("a source"))
        };
        sources(&folder, "rs").into_iter().map(of_one).collect()
    }

    /// The paths of the tests of a module that the long matrix runs.
    fn run_of<'a>(module: &str, source: &'a str) -> Vec<(&'a str, bool)> {
        let mut found = Vec::new();
        let mut is_test = false;
        for line in source.lines() {
            if line.trim() == "#[test]" {
                is_test = true;
            } else if let (true, Some(rest)) = (is_test, line.trim().strip_prefix("fn ")) {
                let name = rest.split('(').next().unwrap_or_default();
                let path = format!("{module}::{name}");
                found.push((name, LONG_MATRIX.iter().any(|part| path.contains(part))));
                is_test = false;
            }
        }
        found
    }

    #[test]
    fn every_test_target_that_cargo_leaves_out_is_a_stage() {
        let mut found = Vec::new();
        for manifest in sources(root().as_path(), "toml").iter().filter(|path| path.ends_with("Cargo.toml")) {
            let text = std::fs::read_to_string(manifest).expect("a manifest");
            for target in text.split("[[test]]").skip(1).filter(|target| target.split("[[").next().is_some_and(left_out)) {
                let name = target.lines().find_map(|line| line.strip_prefix("name = \"")?.strip_suffix('"'));
                found.push(name.expect("a name").to_string());
            }
        }
        found.sort_unstable();
        assert_eq!(found, ["hosts", "slow", "slow"]);
        assert!(found.iter().all(|name| SLOW.contains(&name.as_str())));
    }

    fn left_out(target: &str) -> bool {
        target.lines().any(|line| line == "test = false")
    }

    #[test]
    fn the_long_matrix_has_every_ignored_test_and_every_part_names_one() {
        let sources = across();
        assert!(sources.len() > 20);
        for (module, source) in &sources {
            let tests = run_of(module, source);
            for (place, _) in source.match_indices("\n#[ignore") {
                let name = source[place..].split("\nfn ").nth(1).and_then(|rest| rest.split('(').next()).unwrap_or_default();
                assert!(tests.contains(&(name, true)), "`LONG_MATRIX` lacks {module}::{name}");
            }
            // These names identify tests that call code of this build.
            for crate_name in ["through_the_macro", "motor_loop::{CurrentState, Demand", "motor_loop::references"] {
                let is_run = tests.iter().any(|it| it.1) || module.ends_with("sequence");
                assert!(
                    !source.contains(crate_name) || is_run,
                    "`LONG_MATRIX` has no test of {module}, which runs code of this build"
                );
            }
        }
        for part in LONG_MATRIX {
            let one = |(module, source): &(String, String)| {
                run_of(module, source).iter().any(|(name, _)| format!("{module}::{name}").contains(part))
            };
            assert!(sources.iter().any(one), "no test has a name with {part}");
        }
    }
}

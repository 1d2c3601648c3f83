//! `cargo xtask test`: everything that must hold before a change is done.
//!
//! Out: every stage with its time, a summary, and `N passed, N failed` over all tests as the last line. The fastest stages come first; the
//! first failure ends the run.

use crate::stage::Run;
use crate::workspace::cargo;
use crate::{dask, generated, helics, hidden_effects, mutants, packages, publish};

/// The libraries that must build without `std`, and the bare-metal machine to try first: a Cortex-M4F, what a motor drive has.
const WITHOUT_STD: [&str; 2] = ["motor-loop", "throttle-loop"];
const BARE_METAL: &str = "thumbv7em-none-eabihf";

/// Tests that read files or call compilers on emitted text: they do not depend on how this workspace is compiled, and ran before.
const SAME_AT_ANY_LEVEL: [&str; 17] = [
    "book::",
    "documents::",
    "layers::",
    "names::",
    "stale::",
    "refuses::",
    "warnings::",
    "effects::",
    "elementary::",
    "gradients::",
    "inlined::an_evaluator",
    "inlined::options",
    "inlined::infinities",
    "inlined::self_tests",
    "object_code::checked_in",
    "object_code::emitted",
    "object_code::barrier_costs_a_copy",
];

/// The packages that hold emitted code or run it: the long matrix compiles them as a release does. The other libraries stay as the tests before have built them, which saves a second build of
/// all of them; `rsm-core`, whose interpreter the bits are compared with, is at opt 3 in every profile.
const AS_RELEASED: [&str; 4] = ["rsm-tests", "branch-free", "motor-loop", "throttle-loop"];

/// What a release has of a package that the profile of the tests has not.
fn as_released(package: &str) -> [String; 4] {
    ["opt-level=3", "debug-assertions=false", "overflow-checks=false", "codegen-units=16"]
        .map(|setting| format!("profile.dev.package.{package}.{setting}"))
}

/// Systems beside Linux on which the command must compile.
const ELSEWHERE: [&str; 2] = ["x86_64-pc-windows-gnu", "aarch64-apple-darwin"];

/// Runs every stage.
pub(crate) fn run() -> bool {
    let mut run = Run::new();
    run.check("packages", packages::ensure)
        .command("format", cargo(&["fmt", "--all", "--check"]))
        .command("clippy", cargo(&["clippy", "--workspace", "--all-targets", "--", "-D", "warnings"]))
        .check("helics", helics::ensure)
        .check("dask", dask::ensure)
        .command("test", {
            let mut test = cargo(&["test", "--workspace", "--no-fail-fast"]);
            test.env("RSM_HELICS", helics::folder());
            test
        })
        .command("programs", programs())
        // The diagnosis on records of the independent simulation: a quick subset; all of it is `cargo xtask hidden-effects`.
        .command("hidden effects", hidden_effects::quick())
        .command("noise of benches", hidden_effects::quick_of_bench("noise"))
        .command("data of benches", hidden_effects::quick_of_bench("data"))
        .command("hidden in surfaces", hidden_effects::quick_surfaces())
        // Do the tests notice changes of the code? A sample; all of it is `cargo xtask mutants`.
        .command("mutants", mutants::quick())
        // The tests that are ignored above because they are slow at opt 0, and those again that run code of this build, here at opt 3.
        .command("long matrix", {
            let mut test = cargo(&["test", "--workspace", "--test", "across", "--no-fail-fast"]);
            test.args(
                AS_RELEASED
                    .iter()
                    .flat_map(|package| as_released(package))
                    .flat_map(|setting| ["--config".to_string(), setting]),
            );
            test.args(["--", "--include-ignored"]);
            test.args(SAME_AT_ANY_LEVEL.iter().flat_map(|name| ["--skip", name]));
            test
        })
        .command("docs", {
            let mut docs = cargo(&["doc", "--workspace", "--no-deps"]);
            docs.env("RUSTDOCFLAGS", "-D warnings");
            docs
        })
        // Whether every library can be published; `cargo xtask publish-check` builds each from its package too.
        .command("packing", publish::quick());
    let machine = has_core(BARE_METAL).then_some(BARE_METAL);
    if machine.is_none() && run.held() {
        println!("\nnote: {BARE_METAL} is not installed; the targets are built as `no_std` libraries for this host");
    }
    // Fitter, compiler and diagnosis must run on every usual machine of an engineer.
    let elsewhere: Vec<&str> = ELSEWHERE.into_iter().filter(|machine| has_core(machine)).collect();
    if elsewhere.len() < ELSEWHERE.len() && run.held() {
        println!("\nnote: of {} only [{}] are installed (rustup target add)", ELSEWHERE.join(" and "), elsewhere.join(" "));
    }
    if !elsewhere.is_empty() {
        run.command("other systems", {
            let mut check = cargo(&["check", "-p", "rsm-cli"]);
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

/// Builds the programs that tests start. The tests are named too, so that cargo uses the libraries that the tests have built.
pub(crate) fn programs() -> std::process::Command {
    cargo(&["build", "--workspace", "--bins", "--tests"])
}

/// Whether the compiler in use has the core library of a machine.
fn has_core(machine: &str) -> bool {
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let output = std::process::Command::new(rustc).args(["--print", "target-libdir", "--target", machine]).output();
    output.is_ok_and(|output| {
        output.status.success() && std::path::Path::new(String::from_utf8_lossy(&output.stdout).trim()).is_dir()
    })
}

//! `targets/firmware/rust`: the firmware in Rust for a Cortex-M4F, built and run on the emulated board.
//!
//! It is not a member of the workspace, because it needs `core` for another machine. Debian's compiler has the sources of `core`. Without it these
//! tests are skipped with a message, and fail in continuous integration.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use rsm_core::emit::rust_plant;
use rsm_tests::{cases, compilers};

use super::builds::{self, FAST, SLOW};
use super::image::{self, Interrupted};
use super::linked::Linked;

/// Debian's compiler and the lock file of its `core`: from the package rust-web-src.
const COMPILER: &str = "/usr/bin/rustc";

fn there() -> bool {
    let sources = Command::new(COMPILER).args(["--print", "sysroot"]).output().is_ok_and(|output| {
        let root = String::from_utf8_lossy(&output.stdout).trim().to_string();
        Path::new(&root).join("lib/rustlib/src/rust/library/core").exists()
    });
    if sources {
        return builds::emulated();
    }
    let what = "NOT TESTED in Rust on a Cortex-M4F: apt-get install --no-install-recommends rustc-web rust-web-src libstd-rust-web-dev";
    assert!(std::env::var_os("CI").is_none_or(|value| value != "true"), "{what}");
    eprintln!("{what}");
    false
}

/// Builds the programs: the folder that they are in.
fn build() -> PathBuf {
    let scratch = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let plants = scratch.join("firmware-rust-plants");
    std::fs::create_dir_all(&plants).expect("the folder can be made");
    for part in image::parts() {
        compilers::write(&plants, &format!("{}.rs", part.plant.model), &rust_plant::emit(&part.plant));
    }
    // Kept from run to run: `core` and the evaluators' compiler take two minutes of processor time.
    let target = scratch.join("firmware-rust");
    let mut cargo = Command::new(env!("CARGO"));
    cargo.current_dir(cases::root().join("targets/firmware/rust"));
    cargo.args(["build", "--quiet", "--release", "--locked", "-Zbuild-std=core", "--target", "thumbv7em-none-eabihf"]);
    cargo.env("RUSTC", COMPILER).env("RUSTC_BOOTSTRAP", "1").env("CARGO_TARGET_DIR", &target).env("RSM_RIG_PLANTS", &plants);
    // Added to the flags of the package's own configuration, as RUSTFLAGS are not: the frame of each function, for `Linked`.
    cargo.args(["--config", "target.thumbv7em-none-eabihf.rustflags = [\"-Zemit-stack-sizes\"]"]);
    // Settings of the outer cargo for its own build, coverage for example, must not apply here.
    for name in ["RUSTFLAGS", "CARGO_ENCODED_RUSTFLAGS", "RUSTC_WRAPPER", "RUSTC_WORKSPACE_WRAPPER", "RUSTUP_TOOLCHAIN"] {
        cargo.env_remove(name);
    }
    let output = cargo.output().expect("cargo starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    target.join("thumbv7em-none-eabihf/release")
}

#[test]
fn the_firmware_in_rust_has_the_bits_of_the_firmware_in_c() {
    if !there() {
        return;
    }
    let programs = build();
    let mut board = builds::emulate(&programs.join("board"), FAST);
    let counts = board.pop().expect("a line");
    println!("{counts}");
    image::check_counts("rust", &counts);
    let host = image::on_host("rust", "");
    assert_eq!(board.len(), host.len());
    if let Some(k) = board.iter().zip(&host).position(|(board, host)| board != host) {
        panic!("line {k}: Rust on the board has `{}`, C on the host `{}`", board[k], host[k]);
    }

    image::check_hangs(|hang| builds::emulate_with(&programs.join("hangs"), FAST, &hang.to_string()));

    let text = budget(&programs);
    println!("{text}");
    assert!(
        super::readme::blessed_budget("rust/budget.txt", &text),
        "targets/firmware/rust/budget.txt has other counts: run with RSM_BLESS=1"
    );
}

/// The steps, and a part of the mangled name of each.
const STEPS: [(&str, &str); 4] = [
    ("motor_references", "10references10references"),
    ("motor_currents", "8currents8currents"),
    ("throttle_step", "4step4step"),
    ("throttle_raw_step", "3raw8raw_step"),
];

/// Likewise the two functions of the image that interrupts call. The functions of the board are inlined in them: here those of `interrupted.rs`,
/// which return constants.
const INTERRUPTS: [(&str, &str); 2] =
    [(image::INTERRUPTS[0], "5image17current_interrupt"), (image::INTERRUPTS[1], "5image19reference_interrupt")];

/// The lowest word of a frame may be padding, which keeps the stack pointer a multiple of 8. Nobody writes it, so it keeps its paint.
const PADDING: u32 = 4;

/// Instructions, stack and flash, as they must stand in the budget.
fn budget(programs: &Path) -> String {
    let (counting, interrupted) = (programs.join("count"), programs.join("interrupted"));
    let linked = Linked::of(&counting);
    let mut counts: BTreeMap<String, BTreeMap<&str, BTreeSet<u32>>> = BTreeMap::new();
    let lines = builds::emulate(&counting, SLOW);
    for line in &lines {
        let words: Vec<&str> = line.split(' ').collect();
        let what = if words[1] == "stack" { "stack" } else { "instructions" };
        let of_step = counts.entry(words[0].to_string()).or_default().entry(what).or_default();
        of_step.insert(words[2].parse().expect("a number"));
    }
    assert_eq!(counts["nothing"]["stack"], BTreeSet::from([0]), "the measurement itself takes stack");
    let mut found: Vec<(String, u32)> = vec![];
    for (step, part) in STEPS {
        // Constant time, as in C.
        let [instructions, painted] = ["instructions", "stack"].map(|what| {
            let kinds = &counts[step][what];
            assert_eq!(kinds.len(), 1, "{what} of {step} depend on the input: {kinds:?}");
            *kinds.first().expect("a kind")
        });
        let stack = linked.stack(part);
        assert!((stack - PADDING..=stack).contains(&painted), "{step}: {stack} bytes of stack by its frames, {painted} used");
        found.push((format!("{step} instructions"), instructions));
        found.push((format!("{step} stack"), stack));
        found.push((format!("{step} flash"), linked.flash(part)));
    }
    let image = Linked::of(&interrupted);
    found.extend(INTERRUPTS.map(|(name, part)| (format!("{name} stack"), image.frame(part))));
    let nested = image::nested_stack(&Interrupted::of(&builds::emulate(&interrupted, SLOW)));
    found.push(("both-interrupts stack".to_string(), nested));
    found.sort();
    let mut text = String::from(
        "# What the steps in Rust may cost on a Cortex-M4F: instructions of a call, the same for every input; bytes of stack of a call; bytes of flash of a step. Debian's rustc 1.96, release.\n\
         # Counted by tests/all/firmware/rust.rs; RSM_BLESS=1 writes it.\n",
    );
    for (name, number) in &found {
        writeln!(text, "{name:<40} {number}").expect("text");
    }
    text
}

#[test]
fn whatever_instruction_is_interrupted_in_rust_what_is_handed_over_is_whole() {
    if !there() {
        return;
    }
    let program = build().join("interrupted");
    let found = Interrupted::of(&builds::emulate(&program, SLOW));
    assert_eq!(found.handed_over, "handed over: 1 1");
    // Mangled names.
    let parts = ["10references10references", "3raw8raw_step", "5image19reference_interrupt"];
    found.check("rust", &program, &|function| parts.iter().any(|part| function.contains(part)));
}

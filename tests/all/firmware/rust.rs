//! `targets/firmware/rust`: the firmware in Rust for a Cortex-M4F, built and run on the emulated board.
//!
//! It is not a member of the workspace, because it needs `core` for another machine. Debian's compiler has the sources of `core`. Without it these tests are skipped with a message, and fail in
//! continuous integration.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use rsm_core::emit::rust_plant;
use rsm_tests::{cases, compilers};

use super::builds::{self, FAST, SLOW};
use super::image::{self, Interrupted};

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

    // Constant time, as in C; what it is stands in a budget of its own.
    let mut costs: BTreeMap<String, BTreeSet<u32>> = BTreeMap::new();
    for line in builds::emulate(&programs.join("count"), SLOW) {
        let words: Vec<&str> = line.split(' ').collect();
        costs.entry(words[0].to_string()).or_default().insert(words[2].parse().expect("a number"));
    }
    let mut text = String::from(
        "# What the steps in Rust may cost on a Cortex-M4F: instructions of a call, the same for every input. Debian's rustc 1.96, release.\n\
         # Counted by tests/all/firmware/rust.rs; RSM_BLESS=1 writes it.\n",
    );
    for (step, kinds) in &costs {
        assert_eq!(kinds.len(), 1, "{step} costs what its input says: {kinds:?}");
        writeln!(text, "{step:<20} {}", kinds.first().expect("a kind")).expect("text");
    }
    println!("{text}");
    assert!(
        super::readme::blessed_budget("rust/budget.txt", &text),
        "targets/firmware/rust/budget.txt has other counts: run with RSM_BLESS=1"
    );
}

#[test]
fn whatever_instruction_is_interrupted_in_rust_what_is_handed_over_is_whole() {
    if !there() {
        return;
    }
    let program = build().join("interrupted");
    let found = Interrupted::of(&builds::emulate(&program, SLOW));
    assert_eq!(found.handed_over, "handed over: 1 1");
    // Mangled names. Whatever is inlined is in the one that calls it.
    let parts = ["10references10references", "3raw8raw_step", "11interrupted5outer", "5image19reference_interrupt"];
    found.check("rust", &program, &|function| parts.iter().any(|part| function.contains(part)));
}

//! The steps cannot panic: their object code contains no panic.
//!
//! A panic in Rust is a call to `core::panicking`. So the object file of each target library, at opt 3, may name no function outside itself except
//! those with which a compiler copies memory, and has no trap instruction. This is stronger than "no panic": there is no call of any unknown
//! function.

use std::path::{Path, PathBuf};
use std::process::Command;

/// The external functions of an object file, and whether it has a trap instruction.
#[derive(Debug)]
struct Object {
    defined: Vec<String>,
    undefined: Vec<String>,
    traps: bool,
}

/// The compiler may call these for plain assignments; they copy memory and return.
const MEMORY: [&str; 3] = ["memcpy", "memmove", "memset"];

impl Object {
    fn read(file: &Path) -> Self {
        let names = |kind: &str| {
            let text = output(Command::new("nm").args(["--format=just-symbols", kind]).arg(file));
            text.lines().map(String::from).collect()
        };
        let listing = output(Command::new("objdump").args(["-d", "--no-show-raw-insn"]).arg(file));
        assert!(listing.contains("ret"), "no code in {}", file.display());
        Object { defined: names("--defined-only"), undefined: names("--undefined-only"), traps: listing.contains("ud2") }
    }

    fn may_panic(&self) -> bool {
        self.traps || self.undefined.iter().any(|name| !MEMORY.contains(&name.as_str()))
    }
}

fn output(command: &mut Command) -> String {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    assert!(output.status.success(), "{command:?}:\n{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("symbols are ASCII")
}

fn temporary(name: &str) -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join(name)
}

/// The object file of a target library at opt 3, in the target directory of this test.
fn library(package: &str) -> Object {
    let file = temporary(&format!("{package}.o"));
    let mut cargo = Command::new(env!("CARGO"));
    cargo.args(["rustc", "--quiet", "--offline", "--release", "--lib", "--package", package, "--manifest-path"]);
    cargo.arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../Cargo.toml"));
    cargo.arg("--target-dir").arg(temporary(".."));
    cargo.args(["--", "-Ccodegen-units=1"]).arg(format!("--emit=obj={}", file.display()));
    output(&mut cargo);
    Object::read(&file)
}

#[test]
fn no_step_can_panic() {
    for (package, module) in [("motor-loop", "motor_loop"), ("throttle-loop", "throttle_loop")] {
        let object = library(package);
        assert!(object.defined.iter().any(|name| name.contains(module)), "{package} has no step: {object:?}");
        assert!(!object.may_panic(), "{package}: {object:?}");
    }
}

/// The steps are one piece of straight code, evaluators included.
#[test]
fn no_step_branches_or_calls() {
    for (package, steps) in [("motor-loop", ["10references", "8currents"]), ("throttle-loop", ["4step", "8raw_step"])] {
        library(package);
        let listing =
            output(Command::new("objdump").args(["-d", "--no-show-raw-insn"]).arg(temporary(&format!("{package}.o"))));
        for step in steps {
            // The name as it is mangled: its length, itself, then the hash in the older form of mangling, nothing in the newer.
            let ends = [format!("{step}17h"), format!("{step}>:")];
            let code = listing.split("\n\n").find(|code| {
                code.lines().next().is_some_and(|line| line.ends_with(">:") && ends.iter().any(|it| line.contains(it)))
            });
            let code = code.unwrap_or_else(|| panic!("{package} has no {step}"));
            assert_eq!(transfers(code), Vec::<&str>::new(), "{package}: {step}");
            assert!(code.lines().count() > 50, "{package}: {step} is hardly there:\n{code}");
        }
    }
    assert_eq!(transfers(" 0:\tja 4\n 2:\tmaxss %xmm0,%xmm1\n 4:\tcall 8 <f>\n"), [" 0:\tja 4", " 4:\tcall 8 <f>"]);
}

/// Jumps and calls.
fn transfers(code: &str) -> Vec<&str> {
    let goes = |line: &&str| line.split_once(":\t").is_some_and(|(_, text)| text.starts_with('j') || text.starts_with("call"));
    code.lines().filter(goes).collect()
}

#[test]
fn the_test_sees_a_panic_where_there_is_one() {
    let source = temporary("panics.rs");
    let file = temporary("panics.o");
    for (body, panics) in [("a[k]", true), ("a[0]", false), ("match a.get(k) { Some(v) => *v, None => 0 }", false)] {
        let text = format!(
            "#![no_std]\n#[inline(never)]\npub fn step(a: &[u8; 4], k: usize) -> u8 {{\n    let _ = k;\n    {body}\n}}\n"
        );
        std::fs::write(&source, text).expect("the folder for temporary files can be written");
        let mut rustc = Command::new(std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into()));
        rustc.args(["--edition=2024", "--crate-type=lib", "-Copt-level=3"]).arg(format!("--emit=obj={}", file.display()));
        output(rustc.arg(&source));
        assert_eq!(Object::read(&file).may_panic(), panics, "{body}");
    }
}

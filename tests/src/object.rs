//! Object code, read.
//!
//! In: an object file and a symbol. Out: its instructions, and what in them an evaluator must not have: jumps, calls, fused operations.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

/// The instructions of one function: mnemonic, then operands.
#[derive(Debug, Clone)]
pub struct Code {
    /// One line an instruction, padding left out.
    pub instructions: Vec<String>,
}

/// Disassembles one function.
///
/// # Panics
/// When `objdump` is missing, or the function is not in the file.
#[must_use]
pub fn disassemble(file: &Path, symbol: &str) -> Code {
    let output = Command::new("objdump")
        .args(["-d", "--no-show-raw-insn", "-M", "att", &format!("--disassemble={symbol}")])
        .arg(file)
        .output()
        .unwrap_or_else(|error| panic!("cannot start objdump: {error}; apt-get install binutils"));
    let text = String::from_utf8_lossy(&output.stdout);
    let instruction = |line: &str| -> Option<String> {
        let (address, instruction) = line.split_once(":\t")?;
        address.trim().bytes().all(|byte| byte.is_ascii_hexdigit()).then(|| instruction.trim().to_string())
    };
    let mut instructions: Vec<String> = text.lines().filter_map(instruction).collect();
    // What follows the last return is padding up to the next function.
    let is_return = |line: &String| mnemonic(line).starts_with("ret");
    if let Some(last) = instructions.iter().rposition(is_return) {
        instructions.truncate(last + 1);
    }
    assert!(!instructions.is_empty(), "{}: no function {symbol}\n{}", file.display(), String::from_utf8_lossy(&output.stderr));
    Code { instructions }
}

fn mnemonic(instruction: &str) -> &str {
    let mut words = instruction.split_whitespace();
    let first = words.next().unwrap_or_default();
    // A prefix of a return or of a string instruction is a word of its own.
    if matches!(first, "rep" | "repz" | "bnd" | "notrack") { words.next().unwrap_or_default() } else { first }
}

impl Code {
    /// Instructions that go elsewhere: every jump (conditional or not), loop and call.
    #[must_use]
    pub fn transfers(&self) -> Vec<&str> {
        self.all(|mnemonic| mnemonic.starts_with('j') || mnemonic.starts_with("loop") || mnemonic.starts_with("call"))
    }

    /// Fused multiply-adds, scalar or packed.
    #[must_use]
    pub fn fused(&self) -> Vec<&str> {
        self.all(|mnemonic| mnemonic.starts_with("vfm") || mnemonic.starts_with("vfnm"))
    }

    /// How many sums, products, quotients and comparisons there are, by their kind. Of `vmulsd` and `mulsd`: `mul`.
    #[must_use]
    pub fn arithmetic(&self) -> BTreeMap<&'static str, usize> {
        // A sum with a constant may become a difference with its opposite.
        const KINDS: [(&str, &str); 7] =
            [("add", "sum"), ("sub", "sum"), ("mul", "mul"), ("div", "div"), ("max", "max"), ("min", "min"), ("cmp", "cmp")];
        let mut counts = BTreeMap::new();
        for line in &self.instructions {
            let mnemonic = mnemonic(line);
            let is_float = ["ss", "sd", "ps", "pd"].iter().any(|ending| mnemonic.ends_with(ending));
            let plain = mnemonic.strip_prefix('v').unwrap_or(mnemonic);
            if let Some((_, kind)) = KINDS.iter().find(|(begins, _)| is_float && plain.starts_with(begins)) {
                *counts.entry(*kind).or_default() += 1;
            }
        }
        counts
    }

    fn all(&self, wanted: impl Fn(&str) -> bool) -> Vec<&str> {
        self.instructions.iter().filter(|line| wanted(mnemonic(line))).map(String::as_str).collect()
    }
}

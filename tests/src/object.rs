//! Object code, read.
//!
//! In: an object file. Out: the instructions of its functions, and what in them an evaluator must not have: jumps, calls, fused operations.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

/// The instructions of one function: mnemonic, then operands.
#[derive(Debug, Clone)]
pub struct Code {
    /// One line an instruction, padding left out.
    pub instructions: Vec<String>,
}

/// Disassembles every function of an object file.
///
/// # Panics
/// When `objdump` is missing or cannot read the file.
#[must_use]
pub fn disassemble(file: &Path) -> BTreeMap<String, Code> {
    let output = Command::new("objdump")
        .args(["-d", "--no-show-raw-insn", "-M", "att"])
        .arg(file)
        .output()
        .unwrap_or_else(|error| panic!("cannot start objdump: {error}; apt-get install binutils"));
    assert!(output.status.success(), "{}: {}", file.display(), String::from_utf8_lossy(&output.stderr));
    let mut functions: BTreeMap<String, Code> = BTreeMap::new();
    let mut current = String::new();
    for line in String::from_utf8_lossy(&output.stdout).lines() {
        if let Some(symbol) = heading(line) {
            current = symbol.to_string();
        } else if let Some((address, instruction)) = line.split_once(":\t")
            && address.trim().bytes().all(|byte| byte.is_ascii_hexdigit())
        {
            let code = functions.entry(current.clone()).or_insert_with(|| Code { instructions: vec![] });
            code.instructions.push(instruction.trim().to_string());
        }
    }
    for code in functions.values_mut() {
        // What follows the last return is padding up to the next function.
        if let Some(last) = code.instructions.iter().rposition(|line| mnemonic(line).starts_with("ret")) {
            code.instructions.truncate(last + 1);
        }
    }
    functions
}

/// The symbol of a line such as `0000000000000010 <m_s>:`.
fn heading(line: &str) -> Option<&str> {
    let (address, rest) = line.split_once(" <")?;
    let is_address = !address.is_empty() && address.bytes().all(|byte| byte.is_ascii_hexdigit());
    rest.strip_suffix(">:").filter(|_| is_address)
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

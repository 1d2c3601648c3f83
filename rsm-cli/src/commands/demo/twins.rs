//! Compiles the emitted C and Rust with the machine's compilers and compares their results with the interpreter's, bit for bit.
//!
//! Each twin is a program around the emitted file: it reads points from standard input as raw numbers and writes results likewise.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use rsm_core::emit::{Function, Kind, Unit};
use rsm_core::number::Precision;
use rsm_core::run::Interpreter;

use crate::outcome::Refusal;

/// Points a function: a few hundred special ones would do for the corners, the rest is for the arithmetic between them.
const POINTS: usize = 100_000;

/// One compiler's verdict.
pub struct Verdict {
    /// What compiled it: `cc -O2`.
    pub compiler: String,
    /// How many results were compared.
    pub compared: usize,
    /// How many differed in their bits (NaN equals NaN).
    pub different: usize,
}

/// Both twins. A compiler that the machine lacks gives an `Err` with its reason.
pub fn compare(unit: &Unit, folder: &Path) -> Result<Vec<Result<Verdict, String>>, Refusal> {
    let programs = [("cc -O2", c_program(unit, folder)?), ("rustc -O", rust_program(unit, folder)?)];
    let mut verdicts = Vec::new();
    for (name, program) in programs {
        verdicts.push(match program {
            Err(reason) => Err(format!("{name}: {reason}")),
            Ok(program) => Ok(judge(unit, name, &program)?),
        });
    }
    Ok(verdicts)
}

fn surfaces(unit: &Unit) -> impl Iterator<Item = &Function> {
    unit.functions.iter().filter(|function| function.kind == Kind::Surface)
}

/// Compiles, and gives the reason when that is not possible.
fn compile(command: &mut Command, program: PathBuf) -> Result<PathBuf, String> {
    match command.output() {
        Err(error) => Err(format!("cannot be started: {error}")),
        Ok(output) if output.status.success() => Ok(program),
        Ok(output) => Err(String::from_utf8_lossy(&output.stderr).into_owned()),
    }
}

fn c_program(unit: &Unit, folder: &Path) -> Result<Result<PathBuf, String>, Refusal> {
    let model = &unit.model;
    let mut cases = String::new();
    for (k, function) in surfaces(unit).enumerate() {
        let (float, count) = (c_float(function.tape.precision), function.inputs.len());
        let arguments: Vec<String> = (0..count).map(|port| format!("in[{port}]")).collect();
        cases += &format!(
            "  if (which == {k}) {{\n    {float} in[{count}], out;\n    \
             while (fread(in, sizeof in, 1, stdin) == 1) {{ out = {}({}); fwrite(&out, sizeof out, 1, stdout); }}\n  }}\n",
            function.c_name(model),
            arguments.join(", ")
        );
    }
    let text = format!(
        "#include <stdio.h>\n#include <stdlib.h>\n#include \"{model}.h\"\n\nint main(int count, char **words) {{\n  \
         int which = count > 1 ? atoi(words[1]) : 0;\n{cases}  return 0;\n}}\n"
    );
    let main = folder.join("compare.c");
    crate::output::write_all(&[(main.clone(), text.as_bytes())])?;
    let program = folder.join("compare-c");
    let compiler = std::env::var_os("CC").unwrap_or_else(|| "cc".into());
    let source = folder.join(format!("{model}.c"));
    Ok(compile(Command::new(compiler).arg("-O2").arg("-o").arg(&program).arg(main).arg(source), program))
}

fn rust_program(unit: &Unit, folder: &Path) -> Result<Result<PathBuf, String>, Refusal> {
    let model = &unit.model;
    let mut cases = String::new();
    for (k, function) in surfaces(unit).enumerate() {
        let (float, bytes) = (function.tape.precision.name(), bytes(function.tape.precision));
        let at = |port: usize| {
            let (from, to) = (port * bytes, (port + 1) * bytes);
            format!("{float}::from_le_bytes(p[{from}..{to}].try_into().unwrap())")
        };
        let arguments: Vec<String> = (0..function.inputs.len()).map(at).collect();
        cases += &format!(
            "        {k} => for p in points.chunks_exact({}) {{ out.extend({model}::{}({}).to_le_bytes()); }},\n",
            bytes * function.inputs.len(),
            function.rust_name(),
            arguments.join(", ")
        );
    }
    let text = format!(
        "mod {model};\n\nuse std::io::{{Read, Write}};\n\nfn main() {{\n    \
         let which: usize = std::env::args().nth(1).unwrap().parse().unwrap();\n    \
         let (mut points, mut out) = (Vec::new(), Vec::new());\n    \
         std::io::stdin().read_to_end(&mut points).unwrap();\n    match which {{\n{cases}        _ => {{}}\n    }}\n    \
         std::io::stdout().write_all(&out).unwrap();\n}}\n"
    );
    let main = folder.join("compare.rs");
    crate::output::write_all(&[(main.clone(), text.as_bytes())])?;
    let program = folder.join("compare-rust");
    let compiler = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    Ok(compile(Command::new(compiler).args(["-O", "--edition", "2021", "-o"]).arg(&program).arg(main), program))
}

fn c_float(precision: Precision) -> &'static str {
    match precision {
        Precision::F64 => "double",
        Precision::F32 => "float",
    }
}

fn bytes(precision: Precision) -> usize {
    match precision {
        Precision::F64 => 8,
        Precision::F32 => 4,
    }
}

fn judge(unit: &Unit, compiler: &str, program: &Path) -> Result<Verdict, Refusal> {
    let mut verdict = Verdict { compiler: compiler.to_string(), compared: 0, different: 0 };
    for (k, function) in surfaces(unit).enumerate() {
        let points = points(function);
        let (input, expected): (Vec<u8>, Vec<u64>) = match function.tape.precision {
            Precision::F64 => {
                let mut interpreter = Interpreter::<f64>::new(&function.tape);
                let bits = |point: &Vec<f64>| canonical(interpreter.eval(point).to_bits(), Precision::F64);
                (points.iter().flatten().flat_map(|value| value.to_le_bytes()).collect(), points.iter().map(bits).collect())
            }
            Precision::F32 => {
                let points: Vec<Vec<f32>> =
                    points.iter().map(|point| point.iter().map(|value| *value as f32).collect()).collect();
                let mut interpreter = Interpreter::<f32>::new(&function.tape);
                let bits = |point: &Vec<f32>| canonical(u64::from(interpreter.eval(point).to_bits()), Precision::F32);
                (points.iter().flatten().flat_map(|value| value.to_le_bytes()).collect(), points.iter().map(bits).collect())
            }
        };
        let size = bytes(function.tape.precision);
        let output = pipe(program, k, input)?;
        let found = output.chunks_exact(size).map(|chunk| {
            let mut bits = [0; 8];
            bits[..size].copy_from_slice(chunk);
            canonical(u64::from_le_bytes(bits), function.tape.precision)
        });
        verdict.compared += expected.len();
        verdict.different += expected.len().abs_diff(output.len() / size);
        verdict.different += found.zip(&expected).filter(|(found, expected)| found != *expected).count();
    }
    Ok(verdict)
}

/// All NaN are one.
fn canonical(bits: u64, precision: Precision) -> u64 {
    let is_nan = match precision {
        Precision::F64 => f64::from_bits(bits).is_nan(),
        Precision::F32 => f32::from_bits(bits as u32).is_nan(),
    };
    if is_nan { u64::MAX } else { bits }
}

/// Corners, their neighbours, what hurts, then points between and a little outside.
fn points(function: &Function) -> Vec<Vec<f64>> {
    let mut random = 0x5DEE_CE66_D1CE_4E5Bu64;
    let mut next = || {
        // xorshift64 (Marsaglia 2003): order is all that is wanted of it.
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        random
    };
    let hurts = [0.0, -0.0, f64::MIN_POSITIVE / 4.0, 1e-40, 1e30, f64::INFINITY, f64::NEG_INFINITY, f64::NAN];
    (0..POINTS)
        .map(|k| {
            let coordinate = |input: &rsm_core::model::Input| {
                let [low, high] = input.range;
                let edges = [low, high, low.next_down(), low.next_up(), high.next_down(), high.next_up()];
                let choice = next() as usize;
                // Every hundredth point is made of what hurts.
                if k % 100 == 0 {
                    let all = edges.len() + hurts.len();
                    let pick = choice % all;
                    return if pick < edges.len() { edges[pick] } else { hurts[pick - edges.len()] };
                }
                let share = (choice >> 11) as f64 / (1u64 << 53) as f64 * 1.2 - 0.1;
                low + (high - low) * share
            };
            function.inputs.iter().map(coordinate).collect()
        })
        .collect()
}

/// Runs a program on bytes of standard input; a thread feeds it, so that neither pipe can fill up and stop both.
fn pipe(program: &Path, which: usize, input: Vec<u8>) -> Result<Vec<u8>, Refusal> {
    let failed = |error: std::io::Error| Refusal::new(format!("{}: {error}", program.display()));
    let mut child =
        Command::new(program).arg(which.to_string()).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().map_err(failed)?;
    let mut stdin = child.stdin.take().expect("it was piped");
    let feeder = std::thread::spawn(move || stdin.write_all(&input));
    let output = child.wait_with_output().map_err(failed)?;
    feeder.join().expect("writing to a pipe does not panic").map_err(failed)?;
    Ok(output.stdout)
}

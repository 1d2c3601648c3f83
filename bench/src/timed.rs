//! Evaluators for timing: a C program, a Rust program, the interpreter.
//!
//! In: subjects. Out: for each, the time of n evaluations, in one of two modes. *Latency*: a dependent chain, in which every argument of an
//! evaluation depends on the previous result, as in a control loop. *Throughput*: independent evaluations at 512 points. Compiled evaluators are
//! called, not inlined, as in a controller. Each program runs in a separate process and gets its requests on standard input.
//!
//! The chain feeds back (bits of the result AND a mask that is 0 at run time) OR (bits of the base point): a true dependence without rounding. It
//! costs the same few cycles for every evaluator; nothing is subtracted.

use std::fmt::Write as _;
use std::hint::black_box;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use rsm_core::emit::Unit;
use rsm_core::model::Input;
use rsm_core::number::Precision;
use rsm_core::run::{Interpreter, Scalar};
use rsm_core::tape::Tape;

use crate::toolchain::{c_number, c_type, gcc, run, write};

/// The number of points of a throughput pass: 512 points with their results fit in the first-level cache with up to three inputs, and in the
/// second-level cache with eight.
pub const POINTS: usize = 512;

/// The timing mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// A dependent chain.
    Latency,
    /// Independent evaluations.
    Throughput,
}

impl Mode {
    /// Both.
    pub const ALL: [Mode; 2] = [Mode::Latency, Mode::Throughput];

    /// The name in reports and in the programs.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Mode::Latency => "latency",
            Mode::Throughput => "throughput",
        }
    }
}

/// One function in a program.
#[derive(Debug, Clone)]
pub struct Timed {
    /// The call: a C function, or a path in Rust.
    pub call: String,
    /// Its inputs.
    pub inputs: Vec<Input>,
    /// Its scalar type.
    pub precision: Precision,
}

/// The base point of a chain: inside, away from the centre, where terms vanish.
fn base(inputs: &[Input]) -> Vec<f64> {
    inputs.iter().map(|input| input.range[0] + 0.37 * (input.range[1] - input.range[0])).collect()
}

/// The points of a throughput pass, spread over the box by the golden ratio, with one sequence for each input.
fn spread(inputs: &[Input]) -> Vec<Vec<f64>> {
    let share = |point: usize, input: usize| (point as f64 * 0.618_033_988_749_895 + input as f64 * 0.37).fract();
    let at = |point: usize| {
        let inputs = inputs.iter().enumerate();
        inputs.map(|(k, input)| input.range[0] + share(point, k) * (input.range[1] - input.range[0])).collect()
    };
    (0..POINTS).map(at).collect()
}

/// A running program that contains evaluators.
#[derive(Debug)]
pub struct Program {
    child: Child,
    answers: BufReader<std::process::ChildStdout>,
}

impl Program {
    /// A C program of functions that are defined in `sources` and declared here, compiled by gcc -O2 in `folder`.
    #[must_use]
    pub fn c(folder: &Path, sources: &[String], functions: &[Timed]) -> Self {
        let mut text = String::from(C_HEAD);
        let mut table = String::new();
        for (k, Timed { call, inputs, precision }) in functions.iter().enumerate() {
            let (float, n) = (c_type(*precision), inputs.len());
            let bits = if *precision == Precision::F64 { "uint64_t" } else { "uint32_t" };
            let arguments = |array: &str| (0..n).map(|k| format!("{array}[{k}]")).collect::<Vec<_>>().join(", ");
            let row = |point: &[f64]| point.iter().map(|value| c_number(*value)).collect::<Vec<_>>().join(", ");
            let points: Vec<String> = spread(inputs).iter().map(|point| format!("{{{}}}", row(point))).collect();
            write!(
                text,
                "{float} {call}({types});\n\
                 static const {float} base_{k}[] = {{{base}}};\n\
                 static const {float} points_{k}[][{n}] = {{{points}}};\n\
                 static {float} results_{k}[{POINTS}];\n\
                 static void latency_{k}(long count) {{\n\
                 \x20 {float} in[{n}], y = 0; {bits} fixed[{n}], mask = ({bits})zero;\n\
                 \x20 memcpy(in, base_{k}, sizeof in); memcpy(fixed, base_{k}, sizeof fixed);\n\
                 \x20 while (count-- > 0) {{\n\
                 \x20   {bits} u; y = {call}({args}); memcpy(&u, &y, sizeof u);\n\
                 \x20   for (int k = 0; k < {n}; k++) {{ {bits} v = fixed[k] | (u & mask); memcpy(&in[k], &v, sizeof v); }}\n\
                 \x20 }}\n\
                 \x20 results_{k}[0] = y;\n\
                 }}\n\
                 static void throughput_{k}(long count) {{\n\
                 \x20 for (long j = 0; j < count; j++) {{ const {float} *p = points_{k}[j % {POINTS}]; results_{k}[j % {POINTS}] = {call}({p}); }}\n\
                 }}\n",
                types = vec![float; n].join(", "),
                base = row(&base(inputs)),
                points = points.join(", "),
                args = arguments("in"),
                p = arguments("p"),
            )
            .expect("a string takes any text");
            write!(table, "{{latency_{k}, throughput_{k}}}, ").expect("a string takes any text");
        }
        writeln!(text, "static void (*const table[][2])(long) = {{{table}}};\n{C_MAIN}").expect("a string takes any text");
        write(folder, "timed.c", &text);
        gcc(folder, &[&["timed.c".to_string()], sources].concat(), "timed-c");
        Program::start(&folder.join("timed-c"))
    }

    /// A Rust program of emitted modules, compiled by rustc at opt 3 in `folder`. `call` of a function is `module::function`.
    #[must_use]
    pub fn rust(folder: &Path, modules: &[Unit], functions: &[Timed]) -> Self {
        let mut text = String::from(RUST_HEAD);
        for unit in modules {
            let module = rsm_core::emit::rust::emit(unit);
            writeln!(text, "mod {} {{\n{module}}}", unit.model).expect("a string takes any text");
        }
        let mut table = String::new();
        for (k, Timed { call, inputs, precision }) in functions.iter().enumerate() {
            let (float, n) = (precision.name(), inputs.len());
            let points: Vec<String> = spread(inputs).iter().map(|point| format!("{point:?}")).collect();
            let arguments = |array: &str| (0..n).map(|k| format!("{array}[{k}]")).collect::<Vec<_>>().join(", ");
            write!(
                text,
                "#[inline(never)]\n\
                 fn call_{k}({parameters}) -> {float} {{ {call}({passed}) }}\n\
                 fn latency_{k}(count: u64) {{\n\
                 \x20   let base: [{float}; {n}] = black_box({base:?});\n\
                 \x20   let mask = black_box(0);\n\
                 \x20   let (mut x, mut y) = (base, 0.0);\n\
                 \x20   for _ in 0..count {{\n\
                 \x20       y = call_{k}({x});\n\
                 \x20       for k in 0..{n} {{ x[k] = {float}::from_bits(base[k].to_bits() | (y.to_bits() & mask)); }}\n\
                 \x20   }}\n\
                 \x20   black_box(y);\n\
                 }}\n\
                 static POINTS_{k}: [[{float}; {n}]; {POINTS}] = [{points}];\n\
                 fn throughput_{k}(count: u64) {{\n\
                 \x20   let points = black_box(&POINTS_{k});\n\
                 \x20   let mut results = [0.0; {POINTS}];\n\
                 \x20   for j in 0..count as usize {{ let p = &points[j % {POINTS}]; results[j % {POINTS}] = call_{k}({p}); }}\n\
                 \x20   black_box(&results);\n\
                 }}\n",
                parameters = (0..n).map(|k| format!("x{k}: {float}")).collect::<Vec<_>>().join(", "),
                passed = (0..n).map(|k| format!("x{k}")).collect::<Vec<_>>().join(", "),
                base = base(inputs),
                x = arguments("x"),
                points = points.join(", "),
                p = arguments("p"),
            )
            .expect("a string takes any text");
            write!(table, "[latency_{k}, throughput_{k}], ").expect("a string takes any text");
        }
        writeln!(text, "static TABLE: [[fn(u64); 2]; {}] = [{table}];", functions.len()).expect("a string takes any text");
        write(folder, "timed.rs", &text);
        let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
        run(Command::new(rustc).current_dir(folder).args(["--edition=2024", "-Copt-level=3", "timed.rs", "-o", "timed-rust"]));
        Program::start(&folder.join("timed-rust"))
    }

    fn start(program: &Path) -> Self {
        let mut command = Command::new(program);
        let mut child =
            command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("a program just compiled can be started");
        let answers = BufReader::new(child.stdout.take().expect("its output is a pipe"));
        Program { child, answers }
    }

    /// The time of `count` evaluations of a function, given by its index.
    ///
    /// # Panics
    /// If the program has ended.
    pub fn time(&mut self, function: usize, mode: Mode, count: u64) -> Duration {
        let questions = self.child.stdin.as_mut().expect("its input is a pipe");
        let which = usize::from(mode == Mode::Throughput);
        writeln!(questions, "{function} {which} {count}")
            .and_then(|()| questions.flush())
            .expect("the program reads questions");
        let mut answer = String::new();
        self.answers.read_line(&mut answer).expect("the program answers");
        Duration::from_nanos(answer.trim().parse().expect("the answer is a number of nanoseconds"))
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        // The end of its input ends the program. The result of the wait is not needed.
        drop(self.child.stdin.take());
        let _ = self.child.wait();
    }
}

/// The time of `count` interpretations of a tape, measured in the same way as in the programs.
pub fn interpret<T: Scalar>(tape: &Tape, inputs: &[Input], mode: Mode, count: u64, from_bits: impl Fn(u64) -> T) -> Duration {
    let mut interpreter = Interpreter::<T>::new(tape);
    let scalars = |point: &[f64]| point.iter().map(|value| T::from_constant(*value)).collect::<Vec<T>>();
    match mode {
        Mode::Latency => {
            let fixed = black_box(scalars(&base(inputs)));
            let mask = black_box(0);
            let mut x = fixed.clone();
            let started = Instant::now();
            for _ in 0..count {
                let y = interpreter.eval(&x).bits() & mask;
                for (x, fixed) in x.iter_mut().zip(&fixed) {
                    *x = from_bits(fixed.bits() | y);
                }
            }
            black_box(&x);
            started.elapsed()
        }
        Mode::Throughput => {
            let points: Vec<Vec<T>> = spread(inputs).iter().map(|point| scalars(point)).collect();
            let mut results = vec![T::from_constant(0.0); POINTS];
            let started = Instant::now();
            for j in 0..count as usize {
                results[j % POINTS] = interpreter.eval(&points[j % POINTS]);
            }
            black_box(&results);
            started.elapsed()
        }
    }
}

const C_HEAD: &str = "\
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
static volatile uint64_t zero;
";

const C_MAIN: &str = "\
static int64_t now(void) { struct timespec t; clock_gettime(CLOCK_MONOTONIC, &t); return t.tv_sec * INT64_C(1000000000) + t.tv_nsec; }
int main(void) {
  int function, mode; long count;
  while (scanf(\"%d %d %ld\", &function, &mode, &count) == 3) {
    int64_t started = now();
    table[function][mode](count);
    printf(\"%lld\\n\", (long long)(now() - started)); fflush(stdout);
  }
  return 0;
}";

const RUST_HEAD: &str = "\
use std::hint::black_box;
fn main() {
    for line in std::io::stdin().lines() {
        let line = line.unwrap();
        let numbers: Vec<u64> = line.split(' ').map(|word| word.parse().unwrap()).collect();
        let run = TABLE[numbers[0] as usize][numbers[1] as usize];
        let started = std::time::Instant::now();
        run(numbers[2]);
        println!(\"{}\", started.elapsed().as_nanos());
    }
}
";

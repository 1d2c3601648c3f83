//! Elementary functions have the same bits in every back end, and no branch, call or warning.
//!
//! One model of functions that no surface has: every elementary function alone, and the two operations that exist for them, in both precisions.

mod machines;

use std::path::Path;

use rsm_core::elementary::{self, Function as Elementary};
use rsm_core::emit::{Function, Kind, Unit};
use rsm_core::model::{Input, Outside};
use rsm_core::number::{Precision, exact};
use rsm_core::tape::{Op, Reg, TapeBuilder};
use rsm_tests::backend::{Backend, Loaded, Reference};
use rsm_tests::compilers::{self, Compiler};
use rsm_tests::object;
use rsm_tests::points::{Number, Random};

/// Compiler options that keep IEEE 754 and allow fused operations.
const C_COMPILERS: [&str; 6] = [
    "gcc -std=c99 -O0",
    "gcc -std=c99 -O2",
    "gcc -std=gnu11 -O3 -march=native -ffp-contract=fast",
    "clang -std=c99 -O0",
    "clang -std=c99 -O2",
    "clang -std=gnu11 -O3 -march=native -ffp-contract=fast",
];

const RUST_OPTIONS: [&str; 3] = ["-C opt-level=0", "-C opt-level=3", "-C opt-level=3 -C target-cpu=native"];

fn function(
    name: &str,
    range: [f64; 2],
    precision: Precision,
    arity: u32,
    write: impl FnOnce(&mut TapeBuilder, &[Reg]) -> Reg,
) -> Function {
    let mut tape = TapeBuilder::sharing(precision);
    let arguments: Vec<Reg> = (0..arity).map(|port| tape.input(port)).collect();
    let result = write(&mut tape, &arguments);
    let names: Vec<String> = ["x", "y"][..arity as usize].iter().map(|name| (*name).to_string()).collect();
    let input = |name: &String| Input { name: name.clone(), unit: "1".to_string(), range, outside: Outside::Extrapolate };
    Function {
        surface: name.to_string(),
        kind: Kind::Surface,
        unit: "1".to_string(),
        inputs: names.iter().map(input).collect(),
        saturation: None,
        derivatives: vec![],
        kept: vec![],
        rules: vec![],
        tape: tape.finish(name, names, result),
    }
}

/// 2^x after a clamp, times the exponent of x: both operations in sums and products, where a compiler may fuse or reorder.
fn operations(precision: Precision) -> Function {
    function("operations", [-40.0, 40.0], precision, 1, |tape, x| {
        let lift = tape.constant(exact(if precision == Precision::F64 { 1.5 * 2f64.powi(52) } else { 1.5 * 2f64.powi(23) }));
        let (low, high) = (tape.constant(exact(-126.0)), tape.constant(exact(127.0)));
        let lifted = tape.add(x[0], lift);
        let whole = tape.subtract(lifted, lift);
        let (two, one) = (tape.constant(exact(2.0)), tape.constant(exact(1.0)));
        let doubled = tape.multiply(whole, two);
        let clamped = tape.at_least(doubled, low);
        let clamped = tape.at_most(clamped, high);
        // A product that is a whole number goes straight into the sum inside the operation.
        let (of_product, of_clamped) = (tape.multiply(one, clamped), tape.push(Op::PowerOfTwo(clamped)));
        let power = tape.push(Op::PowerOfTwo(of_product));
        let exponent = tape.push(Op::Exponent(x[0]));
        let product = tape.multiply(power, exponent);
        let sum = tape.add(product, of_clamped);
        let nothing = tape.subtract(x[0], x[0]);
        tape.add(sum, nothing)
    })
}

fn unit() -> Unit {
    let all = Elementary::ALL.into_iter().map(|which| {
        let [low, high] = which.range();
        let range = [low.max(-30.0), high.min(30.0)];
        function(which.name(), range, Precision::F64, which.arity() as u32, |tape, x| elementary::write(tape, which, x))
    });
    let functions = all.chain(Precision::ALL.map(operations)).collect();
    Unit { model: "elementary".to_string(), functions }
}

/// Special numbers and random bits.
fn points<T: Number>(arity: usize) -> Vec<T> {
    let mut random = Random(14);
    let mut bits = || random.bits();
    let special = [
        0.0,
        -0.0,
        1.0,
        -1.0,
        0.5,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::NAN,
        5e-324,
        1e-40,
        f64::MAX,
        1e308,
        -745.0,
        22.0,
        8e5,
    ];
    let mut points: Vec<T> = special.iter().flat_map(|x| special.map(|y| [*x, y])).flatten().map(T::nearest).collect();
    while points.len() < 40_000 {
        let any = f64::from_bits(bits());
        let share = (bits() >> 11) as f64 * 2f64.powi(-53);
        points.push(T::nearest(match bits() % 4 {
            0 if any.is_finite() => any,
            1 => 2.0 * share - 1.0,
            2 => 1500.0 * (share - 0.5),
            _ => 20.0 * (share - 0.5),
        }));
    }
    points.truncate(points.len() / arity * arity);
    points
}

fn compare<T: Number + std::fmt::Display>(unit: &Unit, function: &Function, backend: &Loaded) -> Vec<String> {
    let arity = function.inputs.len();
    let points = points::<T>(arity);
    let wanted = Backend::<T>::evaluate(&Reference, unit, function, &points);
    let found = Backend::<T>::evaluate(backend, unit, function, &points);
    let is_nan = |x: T| x.partial_cmp(&x).is_none();
    let rows = points.chunks_exact(arity).zip(wanted.iter().zip(&found));
    let differ = rows.filter(|(_, (wanted, found))| wanted.bits() != found.bits() && !(is_nan(**wanted) && is_nan(**found)));
    differ
        .take(3)
        .map(|(row, (wanted, found))| {
            let row: Vec<String> = row.iter().map(|x| format!("{x}")).collect();
            format!("{} of {}: {found} for {wanted}", function.surface, row.join(", "))
        })
        .collect()
}

fn folder(name: &str) -> std::path::PathBuf {
    compilers::fresh(Path::new(env!("CARGO_TARGET_TMPDIR")), name)
}

fn keeps_the_bits(unit: &Unit, backend: &Loaded, line: &str) {
    let failures: Vec<String> = unit
        .functions
        .iter()
        .flat_map(|function| match function.tape.precision {
            Precision::F64 => compare::<f64>(unit, function, backend),
            Precision::F32 => compare::<f32>(unit, function, backend),
        })
        .collect();
    assert!(failures.is_empty(), "{line}:\n{}", failures.join("\n"));
}

#[test]
fn c_keeps_the_bits_of_elementary_functions() {
    let (unit, folder) = (unit(), folder("elementary-c"));
    compilers::write_c([&unit], &folder);
    for (k, line) in C_COMPILERS.iter().enumerate() {
        let library = compilers::c_library(&Compiler::new(line), &folder, &format!("elementary{k}"));
        let backend = Loaded::open(line, &library);
        assert_eq!(backend.call("elementary_self_test"), 0, "{line}");
        keeps_the_bits(&unit, &backend, line);
    }
}

#[test]
fn rust_keeps_the_bits_of_elementary_functions() {
    let (unit, folder) = (unit(), folder("elementary-rust"));
    compilers::write_rust([&unit], &folder);
    for (k, options) in RUST_OPTIONS.iter().enumerate() {
        let backend = Loaded::open(options, &compilers::rust_library(options, &folder, &format!("elementary_rust{k}")));
        keeps_the_bits(&unit, &backend, options);
    }
}

#[test]
fn elementary_functions_have_no_branch_and_no_call() {
    let (unit, folder) = (unit(), folder("elementary-object"));
    compilers::write_c([&unit], &folder);
    for line in
        ["gcc -std=c99 -O2", "gcc -std=gnu11 -O3 -march=native", "clang -std=c99 -O2", "clang -std=c99 -O3 -march=native"]
    {
        Compiler::new(line).must(&["-c", "elementary.c", "-o", "elementary.o"], &folder);
        let functions = object::disassemble(&folder.join("elementary.o"));
        for (symbol, function) in compilers::c_symbols(&unit) {
            let code = &functions[&symbol];
            assert!(
                code.transfers().is_empty() && code.fused().is_empty(),
                "{line} {symbol}: {:?} {:?}",
                code.transfers(),
                code.fused()
            );
            // A function is its rows: a few instructions each for constants and choices.
            let most = 6 * function.tape.operation_count();
            assert!(code.instructions.len() <= most, "{line} {symbol}: {} instructions", code.instructions.len());
            if std::env::var_os("RSM_SHOW").is_some() {
                println!(
                    "{line} {symbol} {} operations {} instructions",
                    function.tape.operation_count(),
                    code.instructions.len()
                );
            }
        }
    }
}

#[test]
fn elementary_functions_compile_without_a_warning() {
    let (unit, folder) = (unit(), folder("elementary-warnings"));
    compilers::write_c([&unit], &folder);
    for line in [
        "gcc -std=c99 -O2 -pedantic -Wall -Wextra -Wconversion -Wdouble-promotion -Wfloat-equal -Wshadow -Wcast-qual -Wundef -Werror",
        "clang -std=c99 -O2 -Wall -Wextra -Wconversion -Wshadow -Wundef -Werror",
        "g++ -std=c++11 -x c++ -O2 -Wall -Wextra -Wconversion -Werror",
    ] {
        Compiler::new(line).must(&["-DRSM_SELF_TEST", "-c", "elementary.c", "-o", "elementary.o"], &folder);
    }
}

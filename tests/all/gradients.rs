//! Gradients of surfaces have the same bits in every back end, and no branch, call or warning. The self-test in C detects a fused operation.

use std::path::{Path, PathBuf};

use rsm_core::check::Checked;
use rsm_core::compile;
use rsm_core::emit::{Kind, Unit};
use rsm_core::number::Precision;
use rsm_core::source::Source;
use rsm_tests::backend::{Backend, Loaded, Reference};
use rsm_tests::cases::{self, Case};
use rsm_tests::compilers::{self, Compiler};
use rsm_tests::object;
use rsm_tests::points::{Number, Random};

const C_COMPILERS: [&str; 7] = [
    "gcc -std=c99 -O0",
    "gcc -std=c99 -O2",
    "gcc -std=gnu11 -O2 -mfma -ffp-contract=fast",
    "gcc -std=gnu11 -O3 -march=native",
    "clang -std=c99 -O2",
    "clang -std=gnu11 -O2 -mfma -ffp-contract=fast",
    "clang -std=c99 -O3 -march=native",
];

const RUST_OPTIONS: [&str; 2] = ["-C opt-level=0", "-C opt-level=3 -C target-cpu=native"];

/// The models that users see first, and random ones.
fn units() -> Vec<Unit> {
    let with_gradients = |case: &Case| {
        let mut unit = compile::unit_with_gradients(&case.checked, &[]).expect("a checked model");
        unit.functions.retain(|function| function.kind == Kind::Gradient);
        unit
    };
    let cases: Vec<Case> = cases::quick_random().into_iter().chain(cases::checked_in()).collect();
    let units: Vec<Unit> = cases.iter().map(with_gradients).filter(|unit| !unit.functions.is_empty()).collect();
    assert!(units.len() > 8, "{} models", units.len());
    units
}

fn folder(name: &str) -> PathBuf {
    compilers::fresh(Path::new(env!("CARGO_TARGET_TMPDIR")), name)
}

/// Points in the box, at its corners, outside it, and values that are not finite.
fn points<T: Number>(unit: &Unit, function: usize) -> Vec<T> {
    let inputs = &unit.functions[function].inputs;
    let mut random = Random(41);
    let mut share = || random.share();
    let mut points = vec![];
    for row in 0..300 {
        for input in inputs {
            let [low, high] = input.range;
            let at = match (row % 10, (share() * 8.0) as usize) {
                (0, 0) => f64::NAN,
                (0, 1) => f64::INFINITY,
                (0, 2) => f64::NEG_INFINITY,
                (0, 3) => -0.0,
                (1, k) => {
                    if k % 2 == 0 {
                        low
                    } else {
                        high
                    }
                }
                (2, _) => low + (high - low) * (3.0 * share() - 1.0),
                _ => low + (high - low) * share(),
            };
            points.push(T::nearest(at));
        }
    }
    points
}

fn compare<T: Number>(unit: &Unit, function: usize, backend: &Loaded) -> Option<String> {
    let points = points::<T>(unit, function);
    let function = &unit.functions[function];
    let wanted = Backend::<T>::evaluate(&Reference, unit, function, &points);
    let found = Backend::<T>::evaluate(backend, unit, function, &points);
    assert_eq!(wanted.len(), points.len(), "one derivative an input");
    let is_nan = |x: T| x.partial_cmp(&x).is_none();
    let differ = |(wanted, found): (&T, &T)| wanted.bits() != found.bits() && !(is_nan(*wanted) && is_nan(*found));
    let place = wanted.iter().zip(&found).position(differ)?;
    let name = function.c_name(&unit.model);
    Some(format!(
        "{name}: result {place} has bits {:x}, not {:x}\n{}",
        found[place].bits(),
        wanted[place].bits(),
        function.tape
    ))
}

fn keeps_the_bits(units: &[Unit], backend: &Loaded, line: &str) {
    for unit in units {
        for k in 0..unit.functions.len() {
            let failure = match unit.functions[k].tape.precision {
                Precision::F64 => compare::<f64>(unit, k, backend),
                Precision::F32 => compare::<f32>(unit, k, backend),
            };
            assert_eq!(failure, None, "{line}");
        }
    }
}

#[test]
fn c_keeps_the_bits_of_gradients() {
    let (units, folder) = (units(), folder("gradients-c"));
    compilers::write_c(&units, &folder);
    for (k, line) in C_COMPILERS.iter().enumerate() {
        let backend = Loaded::open(line, &compilers::c_library(&Compiler::new(line), &folder, &format!("gradients{k}")));
        for unit in &units {
            assert_eq!(backend.call(&format!("{}_self_test", unit.model)), 0, "{line}: {}", unit.model);
        }
        keeps_the_bits(&units, &backend, line);
    }
}

#[test]
fn rust_keeps_the_bits_of_gradients() {
    let (units, folder) = (units(), folder("gradients-rust"));
    compilers::write_rust(&units, &folder);
    for (k, options) in RUST_OPTIONS.iter().enumerate() {
        let backend = Loaded::open(options, &compilers::rust_library(options, &folder, &format!("gradients_rust{k}")));
        keeps_the_bits(&units, &backend, options);
    }
}

#[test]
fn the_self_test_of_a_gradient_sees_fused_operations() {
    let (units, folder) = (units(), folder("gradients-fused"));
    compilers::write_c(&units, &folder);
    let line = "gcc -std=gnu11 -O2 -mfma -ffp-contract=fast -DRSM_BARRIER(product)=(product)";
    let backend = Loaded::open(line, &compilers::c_library(&Compiler::new(line), &folder, "fused"));
    let failures: Vec<i32> = units.iter().map(|unit| backend.call(&format!("{}_self_test", unit.model))).collect();
    // The derivatives of a surface of first order have no sum of products.
    assert!(2 * failures.iter().filter(|failures| **failures > 0).count() > units.len(), "{failures:?}");
}

#[test]
fn gradients_have_no_branch_and_no_call() {
    let (units, folder) = (units(), folder("gradients-object"));
    compilers::write_c(&units, &folder);
    for line in
        ["gcc -std=c99 -O2", "gcc -std=gnu11 -O3 -march=native", "clang -std=c99 -O2", "clang -std=c99 -O3 -march=native"]
    {
        for unit in &units {
            Compiler::new(line).must(&["-c", &format!("{}.c", unit.model), "-o", "gradient.o"], &folder);
            let functions = object::disassemble(&folder.join("gradient.o"));
            for (symbol, _) in compilers::c_symbols(unit) {
                let code = &functions[&symbol];
                assert!(code.transfers().is_empty() && code.fused().is_empty(), "{line} {symbol}: {:?}", code.instructions);
            }
        }
    }
}

#[test]
fn gradients_compile_without_a_warning() {
    let (units, folder) = (units(), folder("gradients-warnings"));
    compilers::write_c(&units, &folder);
    for unit in &units {
        for line in [
            "gcc -std=c99 -O2 -pedantic -Wall -Wextra -Wconversion -Wdouble-promotion -Wfloat-equal -Wshadow -Wcast-qual -Wundef -Wstrict-prototypes -Wmissing-prototypes -Werror",
            "clang -std=c99 -O2 -Weverything -Wno-declaration-after-statement -Wno-unknown-warning-option -Wno-unsafe-buffer-usage \
             -Wno-unsafe-buffer-usage-in-libc-call -Werror",
            "g++ -std=c++11 -x c++ -O2 -Wall -Wextra -Wconversion -Werror",
        ] {
            Compiler::new(line).must(&["-DRSM_SELF_TEST", "-c", &format!("{}.c", unit.model), "-o", "gradient.o"], &folder);
        }
    }
}

#[test]
fn an_input_may_have_the_name_of_the_array() {
    let model = "format = 1\nmodel = \"hill\"\n[inputs.gradient]\nunit = \"1\"\nrange = [0.0, 30.0]\n[surfaces.force]\nunit = \"N\"\n\
                 inputs = [\"gradient\"]\nterms = [{ powers = [2], coefficient = 35.0 }]\n";
    let checked = Checked::read(&Source::new("hill.toml", model)).unwrap();
    let unit = compile::unit_with_gradients(&checked, &[]).unwrap();
    let folder = folder("gradients-name");
    compilers::write_c([&unit], &folder);
    Compiler::new("gcc -std=c99 -Wall -Wextra -Wshadow -Werror").must(&["-c", "hill.c", "-o", "hill.o"], &folder);
}

//! Every back end gives the bits of the interpreter.
//!
//! One suite, instantiated for emitted Rust through the macro and by rustc at opt 0 and 3, and for emitted C through gcc and clang, with
//! every option of optimising and fusing that keeps IEEE 754. `cargo test` runs it at special points and a few random ones, the long matrix of
//! `cargo xtask test` at 50,000 random points for each function, `cargo xtask bits` at 10^6.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, OnceLock};

use rsm_core::emit::Kind;
use rsm_core::model::{Coding, Knot, Outside, Surface, Symmetry, Transform};
use rsm_core::number::Precision;
use rsm_tests::backend::{Backend, Linked, Loaded, Reference};
use rsm_tests::cases::{self, Case};
use rsm_tests::compilers::{self, Compiler};
use rsm_tests::points::{Number, Points};
use rsm_tests::report;

/// Models through `include_model!`. The build script wrote the calls.
mod through_the_macro {
    include!(concat!(env!("OUT_DIR"), "/macro_models.rs"));
}

/// Random points of each function in addition to the special ones: few, so that `cargo test` at opt 0 is short. The long matrix has more.
const FEW: usize = 200;

/// Random points of each function in the long matrix: as many as take less time than the compilation of all back ends.
const MANY: usize = 50_000;

/// Random points of each function in the campaign `cargo xtask bits`.
const CAMPAIGN: usize = 1_000_000;

/// A step's points are in sequences, each from rest: ten times as many, in sequences of this length while there are few.
const SEQUENCE: usize = 500;

/// Points are made and compared in portions, so that the long matrix does not fill the memory.
const PORTION: usize = 8192;

/// Each is a way in which a user may compile and which keeps IEEE 754. The last options allow fused operations.
const C_COMPILERS: &[&str] = &[
    "gcc -std=c99 -O0",
    "gcc -std=c99 -O2",
    "gcc -std=c99 -O3 -march=native",
    "gcc -std=c99 -O2 -mfma -ffp-contract=fast",
    "gcc -std=gnu11 -O2 -mfma",
    "gcc -std=gnu11 -O3 -march=native",
    "clang -std=c99 -O0",
    "clang -std=c99 -O2",
    "clang -std=c99 -O3 -march=native",
    "clang -std=c99 -O2 -mfma -ffp-contract=fast",
    "clang -std=gnu11 -O2 -mfma",
];

const RUST_OPTIONS: &[&str] = &["-C opt-level=0", "-C opt-level=3", "-C opt-level=3 -C target-cpu=native"];

fn scratch() -> &'static Path {
    Path::new(env!("CARGO_TARGET_TMPDIR"))
}

/// The emitted C of every model, written once.
fn c_folder() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        compilers::kept(scratch(), "bits-c", |folder| {
            compilers::write_c(cases::every_random().iter().map(|case| &case.unit), folder);
        })
    })
}

/// The emitted Rust of every model, written once.
fn rust_folder() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        compilers::kept(scratch(), "bits-rust", |folder| {
            compilers::write_rust(cases::every_random().iter().map(|case| &case.unit), folder);
        })
    })
}

fn file_name(line: &str) -> String {
    let words = line.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| !word.is_empty());
    words.map(str::to_ascii_lowercase).collect::<Vec<_>>().join("_")
}

fn c_backend(line: &str) -> Loaded {
    let (compiler, name) = (Compiler::new(line), file_name(line));
    // The long matrix has the same libraries as the tests before it.
    let library = compilers::once(&compiler, c_folder(), &name, || compilers::c_library(&compiler, c_folder(), &name));
    Loaded::open(line, &library)
}

fn rust_backend(options: &str) -> Loaded {
    let name = file_name(&format!("rust{options}"));
    let (compiler, folder) = (compilers::rustc(options), rust_folder());
    let library = compilers::once(&compiler, folder, &name, || compilers::rust_library(options, folder, &name));
    Loaded::open(&format!("rustc {options}"), &library)
}

/// Compares back ends with the interpreter over all models, on two threads.
fn compare(of_f64: &[&dyn Backend<f64>], of_f32: &[&dyn Backend<f32>], random: usize) {
    let next = AtomicUsize::new(0);
    let failures = Mutex::new(Vec::new());
    let functions: Vec<(&Case, usize)> =
        cases::every_random().iter().flat_map(|case| (0..case.unit.functions.len()).map(move |k| (case, k))).collect();
    let work = || {
        while let Some((case, k)) = functions.get(next.fetch_add(1, Ordering::Relaxed)) {
            let function = &case.unit.functions[*k];
            let found = match function.tape.precision {
                Precision::F64 => compare_function(case, *k, of_f64, random),
                Precision::F32 => compare_function(case, *k, of_f32, random),
            };
            failures.lock().expect("no panic in between").extend(found);
        }
    };
    std::thread::scope(|scope| {
        scope.spawn(work);
        scope.spawn(work);
    });
    let failures = failures.into_inner().expect("no panic in between");
    assert!(failures.is_empty(), "{} functions differ\n\n{}", failures.len(), failures.join("\n"));
}

pub(crate) fn compare_function<T: Number>(
    case: &Case,
    function: usize,
    backends: &[&dyn Backend<T>],
    random: usize,
) -> Vec<String> {
    let function = &case.unit.functions[function];
    let model = case.checked.model();
    let is_step = function.kind == Kind::Step;
    let mut points = if is_step {
        let knots: Vec<Knot> = model.surfaces.iter().flat_map(|surface| surface.knots.clone()).collect();
        Points::<T>::with_knots(function, &knots)
    } else {
        Points::<T>::new(function, model.surface(&function.surface).expect("a function of a surface"))
    };
    let mut silent: Vec<&&dyn Backend<T>> = backends.iter().collect();
    let mut failures = vec![];
    let mut portion = points.hurtful();
    let mut left = if is_step && random == FEW { 10 * random } else { random };
    loop {
        let expected = Reference.evaluate(&case.unit, function, &portion);
        silent.retain(|backend| {
            let found = backend.evaluate(&case.unit, function, &portion);
            let difference = report::differences(&case.unit.model, function, backend.name(), &portion, &expected, &found);
            let is_silent = difference.is_none();
            failures.extend(difference);
            is_silent
        });
        if left == 0 {
            return failures;
        }
        let size = if is_step && random == FEW { SEQUENCE } else { PORTION }.min(left);
        portion = if is_step { points.sequence(size) } else { points.random(size) };
        left -= size;
    }
}

fn compare_loaded(backends: &[Loaded], random: usize) {
    let of_f64: Vec<&dyn Backend<f64>> = backends.iter().map(|backend| backend as &dyn Backend<f64>).collect();
    let of_f32: Vec<&dyn Backend<f32>> = backends.iter().map(|backend| backend as &dyn Backend<f32>).collect();
    compare(&of_f64, &of_f32, random);
}

fn macros() -> (Linked<f64>, Linked<f32>) {
    (Linked::new("include_model!", through_the_macro::F64), Linked::new("include_model!", through_the_macro::F32))
}

#[test]
fn the_random_models_cover_what_they_must() {
    let models: Vec<_> = cases::every_random().iter().map(|case| case.checked.model()).collect();
    let surfaces: Vec<&Surface> = models.iter().flat_map(|model| &model.surfaces).collect();
    assert!(models.len() >= 30);
    for inputs in 1..=6 {
        assert!(models.iter().any(|model| model.inputs.len() == inputs), "{inputs} inputs");
    }
    let count = |wanted: &dyn Fn(&Surface) -> bool| surfaces.iter().filter(|surface| wanted(surface)).count();
    let symmetric = |kind: Symmetry| count(&|surface| surface.symmetry.iter().any(|(_, symmetry)| *symmetry == kind));
    assert!(symmetric(Symmetry::Odd) > 2 && symmetric(Symmetry::Even) > 2);
    assert!(count(&|surface| !surface.knots.is_empty()) > 5);
    assert!(count(&|surface| surface.is_bent()) > 5);
    assert!(count(&|surface| surface.transform.is_some()) > 5);
    assert!(count(&|surface| surface.transform == Some(Transform::Log)) > 0);
    assert!(count(&|surface| !surface.waves.is_empty()) > 5);
    assert!(count(&|surface| !surface.reciprocal.is_empty()) > 5);
    assert!(count(&|surface| surface.output_range.is_some()) > 5);
    assert!(count(&|surface| !surface.support.is_empty()) > 5);
    assert!(count(&|surface| surface.coding == Coding::None) > 3);
    for outside in [Outside::Clamp, Outside::Extrapolate] {
        assert!(models.iter().flat_map(|model| &model.inputs).filter(|input| input.outside == outside).count() > 5);
    }
    let functions = || cases::every_random().iter().flat_map(|case| &case.unit.functions);
    for precision in Precision::ALL {
        let steps = functions().filter(|function| function.kind == Kind::Step && function.tape.precision == precision);
        let arguments: Vec<usize> = steps.map(|function| function.inputs.len()).collect();
        assert!((1..=4).all(|count| arguments.contains(&count)), "{precision:?}: {arguments:?}");
    }
    assert!(functions().filter(|function| function.tape.precision == Precision::F32).count() > 30);
}

#[test]
fn macro_keeps_the_bits() {
    let (of_f64, of_f32) = macros();
    compare(&[&of_f64], &[&of_f32], FEW);
}

#[test]
fn rustc_keeps_the_bits() {
    let backends: Vec<Loaded> = RUST_OPTIONS.iter().map(|options| rust_backend(options)).collect();
    compare_loaded(&backends, FEW);
}

#[test]
fn gcc_keeps_the_bits() {
    let lines = C_COMPILERS.iter().filter(|line| line.starts_with("gcc"));
    compare_loaded(&lines.map(|line| c_backend(line)).collect::<Vec<_>>(), FEW);
}

#[test]
fn clang_keeps_the_bits() {
    let lines = C_COMPILERS.iter().filter(|line| line.starts_with("clang"));
    compare_loaded(&lines.map(|line| c_backend(line)).collect::<Vec<_>>(), FEW);
}

/// The suite notices a wrong bit.
#[test]
#[should_panic(expected = "differs from the interpreter")]
fn a_fused_operation_is_noticed() {
    compare_loaded(&[c_backend("gcc -std=gnu11 -O2 -mfma -DRSM_BARRIER(product)=(product)")], 0);
}

#[test]
#[ignore = "so many points take minutes at opt 0: run by `cargo xtask test` and `cargo xtask bits` at opt 3"]
fn all_back_ends_keep_the_bits_at_many_points() {
    let loaded: Vec<Loaded> = RUST_OPTIONS
        .iter()
        .map(|options| rust_backend(options))
        .chain(C_COMPILERS.iter().map(|line| c_backend(line)))
        .collect();
    let (macro_f64, macro_f32) = macros();
    let mut of_f64: Vec<&dyn Backend<f64>> = vec![&macro_f64];
    let mut of_f32: Vec<&dyn Backend<f32>> = vec![&macro_f32];
    for backend in &loaded {
        of_f64.push(backend);
        of_f32.push(backend);
    }
    compare(&of_f64, &of_f32, if rsm_tests::is_campaign() { CAMPAIGN } else { MANY });
}

//! Updates of surfaces by recursive least squares have the same bits in every back end, state included, and no branch, call or warning.

use std::path::{Path, PathBuf};

use rsm_core::compile::{self, Parts};
use rsm_core::emit::{Function, Kind, Unit};
use rsm_core::lower::{Frozen, Recursive};
use rsm_core::names;
use rsm_core::number::Precision;
use rsm_core::run::Interpreter;
use rsm_tests::backend::{Backend, Loaded, Reference};
use rsm_tests::cases::{self, Case};
use rsm_tests::compilers::{self, Compiler};
use rsm_tests::object;
use rsm_tests::points::{Number, Random};

const C_COMPILERS: [&str; 8] = [
    "gcc -std=c99 -O0",
    "gcc -std=c99 -O2",
    "gcc -std=gnu11 -O2 -mfma -ffp-contract=fast",
    "gcc -std=gnu11 -O3 -march=native",
    "clang -std=c99 -O0",
    "clang -std=c99 -O2",
    "clang -std=gnu11 -O2 -mfma -ffp-contract=fast",
    "clang -std=c99 -O3 -march=native",
];

const RUST_OPTIONS: [&str; 2] = ["-C opt-level=0", "-C opt-level=3 -C target-cpu=native"];

/// With forgetting for one surface of a model and without for the next.
fn settings(k: usize, noise: f64) -> Recursive {
    let forgetting = if k.is_multiple_of(2) { 0.99 } else { 1.0 };
    Recursive { forgetting, gate: 4.0, limit: 3.0 * noise, ..Recursive::new(noise) }
}

/// The updates and adapted surfaces of a model; a surface that cannot be updated is left out.
fn unit(case: &Case) -> Unit {
    let surfaces = case.checked.model().surfaces.iter().enumerate();
    // A noise of a hundredth of the largest coefficient.
    let noise = |surface: &rsm_core::model::Surface| {
        let largest = surface.terms.iter().map(|term| term.coefficient.abs()).fold(0.0, f64::max);
        if largest > 0.0 { 0.01 * largest } else { 1.0 }
    };
    let each = surfaces.map(|(k, surface)| (surface, settings(k, noise(surface))));
    let recursive: Vec<(String, Recursive)> = each
        .filter(|(surface, settings)| settings.refusal(surface).is_none() && surface.terms.len() <= 12)
        .map(|(surface, settings)| (surface.name.clone(), settings))
        .collect();
    let parts = Parts { recursive, ..Parts::default() };
    let mut unit = compile::unit_with_parts(&case.checked, &[], &parts).unwrap_or_else(|faults| panic!("{faults}"));
    unit.functions.retain(|function| matches!(function.kind, Kind::Update | Kind::Adapted));
    unit
}

/// The models that users see first, and some random ones.
fn units() -> Vec<Unit> {
    let cases: Vec<Case> = cases::quick_random().into_iter().step_by(3).chain(cases::checked_in()).collect();
    let units: Vec<Unit> = cases.iter().map(unit).filter(|unit| !unit.functions.is_empty()).collect();
    assert!(units.len() > 5, "{} models", units.len());
    units
}

fn folder(name: &str) -> PathBuf {
    compilers::fresh(Path::new(env!("CARGO_TARGET_TMPDIR")), name)
}

/// Rows of a function: for an update, measured responses beside the prediction, far from it, and samples that are not finite.
fn points<T: Number>(function: &Function) -> Vec<T> {
    let mut random = Random(41);
    let mut interpreter = Interpreter::<T>::new(&function.tape);
    let start: Vec<T> = function.start().into_iter().map(T::from_constant).collect();
    interpreter.set_states(&start);
    let (mut points, mut reasons) = (vec![], vec![]);
    for row in 0..400 {
        let mut at: Vec<T> = vec![];
        for input in &function.inputs {
            let [low, high] = input.range;
            let value = match (row % 10, (random.share() * 8.0) as usize) {
                (0, 0) => f64::NAN,
                (0, 1) => f64::INFINITY,
                (0, 2) => f64::NEG_INFINITY,
                (0, 3) => -0.0,
                (1, _) => low + (high - low) * (1.5 * random.share() - 0.25),
                _ => low + (high - low) * random.share(),
            };
            at.push(T::nearest(value));
        }
        if function.kind == Kind::Update {
            let last = at.len() - 1;
            let drawn = std::mem::replace(&mut at[last], T::nearest(0.0));
            let states = interpreter.states().to_vec();
            let predicted = -interpreter.step(&at);
            interpreter.set_states(&states);
            at[last] = if row % 10 == 2 { T::nearest(100.0) * (predicted + drawn) } else { predicted + drawn };
        }
        interpreter.step(&at);
        reasons.extend(interpreter.results().last());
        points.extend(at);
    }
    if function.kind == Kind::Update {
        let count = |reason: f64| reasons.iter().filter(|it| it.wide() == reason).count();
        assert!(count(0.0) > 50, "{}: {} rows are used", function.surface, count(0.0));
        for reason in [Frozen::NotFinite, Frozen::Outside, Frozen::Error] {
            assert!(count(f64::from(reason as u8)) > 0, "{}: {reason:?}", function.surface);
        }
    }
    points
}

fn compare<T: Number>(unit: &Unit, function: &Function, backend: &Loaded) -> Option<String> {
    let points = points::<T>(function);
    let wanted = Backend::<T>::evaluate(&Reference, unit, function, &points);
    let found = Backend::<T>::evaluate(backend, unit, function, &points);
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
        for function in &unit.functions {
            let failure = match function.tape.precision {
                Precision::F64 => compare::<f64>(unit, function, backend),
                Precision::F32 => compare::<f32>(unit, function, backend),
            };
            assert_eq!(failure, None, "{line}");
        }
    }
}

#[test]
fn c_keeps_the_bits_of_updates() {
    let (units, folder) = (units(), folder("recursive-c"));
    compilers::write_c(&units, &folder);
    for (k, line) in C_COMPILERS.iter().enumerate() {
        let backend = Loaded::open(line, &compilers::c_library(&Compiler::new(line), &folder, &format!("recursive{k}")));
        for unit in &units {
            assert_eq!(backend.call(&format!("{}_self_test", unit.model)), 0, "{line}: {}", unit.model);
        }
        keeps_the_bits(&units, &backend, line);
    }
}

#[test]
fn rust_keeps_the_bits_of_updates() {
    let (units, folder) = (units(), folder("recursive-rust"));
    compilers::write_rust(&units, &folder);
    for (k, options) in RUST_OPTIONS.iter().enumerate() {
        let backend = Loaded::open(options, &compilers::rust_library(options, &folder, &format!("recursive_rust{k}")));
        keeps_the_bits(&units, &backend, options);
    }
}

/// The states of the throttle's surface after the rows, and the adapted surface there, each back end as a program of its own.
#[test]
fn every_state_and_the_adapted_surface_have_the_bits_of_the_interpreter() {
    let case = cases::checked_in().into_iter().find(|case| case.unit.model == "throttle").expect("a checked-in model");
    let unit = unit(&case);
    let folder = folder("recursive-states");
    for precision in Precision::ALL {
        let of =
            |kind| unit.functions.iter().find(|it| it.kind == kind && it.tape.precision == precision).expect("it is emitted");
        let (update, adapted) = (of(Kind::Update), of(Kind::Adapted));
        let wanted = match precision {
            Precision::F64 => states::<f64>(update, adapted),
            Precision::F32 => states::<f32>(update, adapted),
        };
        let (c, rust) = match precision {
            Precision::F64 => (programs::<f64>(&unit, update, adapted), "f64"),
            Precision::F32 => (programs::<f32>(&unit, update, adapted), "f32"),
        };
        let alone = Unit { model: unit.model.clone(), functions: vec![update.clone(), adapted.clone()] };
        compilers::write_c([&alone], &folder);
        compilers::write_rust([&alone], &folder);
        compilers::write(&folder, "main.c", &c[0]);
        compilers::write(&folder, "main.rs", &c[1]);
        let run = || {
            let output = std::process::Command::new(folder.join("program")).output().expect("it was compiled");
            String::from_utf8(output.stdout).expect("text")
        };
        for line in ["gcc -std=c99 -O0", "gcc -std=c99 -O3", "clang -std=c99 -O3"] {
            Compiler::new(line).must(&["main.c", "throttle.c", "-o", "program"], &folder);
            assert_eq!(run(), wanted, "{line} {rust}");
        }
        for options in ["-C opt-level=0", "-C opt-level=3"] {
            compilers::rustc(options).must(&["main.rs", "-o", "program"], &folder);
            assert_eq!(run(), wanted, "rustc {options} {rust}");
        }
    }
}

/// Bits in hexadecimal, a line each: all states, then the adapted surface in the middle of its box.
fn states<T: Number>(update: &Function, adapted: &Function) -> String {
    let mut interpreter = Interpreter::<T>::new(&update.tape);
    let start: Vec<T> = update.start().into_iter().map(T::from_constant).collect();
    interpreter.set_states(&start);
    for row in points::<T>(update).chunks_exact(update.inputs.len()) {
        interpreter.step(row);
    }
    assert!(interpreter.states().iter().zip(&start).filter(|(now, start)| now.bits() != start.bits()).count() > 20);
    let mut evaluator = Interpreter::<T>::new(&adapted.tape);
    evaluator.set_states(&interpreter.states()[..adapted.tape.states.len()]);
    let middle: Vec<T> = adapted.inputs.iter().map(|input| T::nearest((input.range[0] + input.range[1]) / 2.0)).collect();
    let value = evaluator.step(&middle);
    interpreter.states().iter().chain([&value]).map(|it| format!("{:x}\n", it.bits())).collect()
}

/// A program in C and one in Rust that print the same.
fn programs<T: Number>(unit: &Unit, update: &Function, adapted: &Function) -> [String; 2] {
    let (model, precision) = (&unit.model, update.tape.precision);
    let (float, bits, width) = match precision {
        Precision::F64 => ("double", "uint64_t", 64),
        Precision::F32 => ("float", "uint32_t", 32),
    };
    let arity = update.inputs.len();
    let rows: Vec<String> = points::<T>(update).iter().map(|it| format!("0x{:x}", it.bits())).collect();
    let count = rows.len() / arity;
    let fields: Vec<&str> = update.tape.states.iter().map(|state| state.name.as_str()).collect();
    let middle: Vec<T> = adapted.inputs.iter().map(|input| T::nearest((input.range[0] + input.range[1]) / 2.0)).collect();
    let middle: Vec<String> = middle.iter().map(|it| format!("{:?}", it.wide())).collect();
    let surface = &update.surface;
    let x = |open: &str| (0..arity).map(|k| format!("x[{open}{k}]")).collect::<Vec<_>>().join(", ");
    let c = format!(
        "#include \"{model}.h\"\n#include <stdint.h>\n#include <stdio.h>\n#include <string.h>\n\
         static const {bits} rows[] = {{ {} }};\n\
         static void show({float} value) {{ {bits} b; memcpy(&b, &value, sizeof b); printf(\"%llx\\n\", (unsigned long long)b); }}\n\
         int main(void)\n{{\n    {state} state;\n    {float} x[{arity}], y[3];\n    int k;\n    {init}(&state);\n    \
         for (k = 0; k < {count}; k++) {{ memcpy(x, rows + k * {arity}, sizeof x); {step}(&state, {}, y); }}\n{}    \
         show({adapted}(&state, {}));\n    return 0;\n}}\n",
        rows.join(", "),
        x(""),
        fields.iter().map(|field| format!("    show(state.{field});\n")).collect::<String>(),
        middle.join(", "),
        state = names::c_state(model, surface, precision),
        init = names::c_init(model, surface, precision),
        step = update.c_name(model),
        adapted = adapted.c_name(model),
    );
    let rust = format!(
        "mod {model};\nconst ROWS: &[u{width}] = &[{}];\n\
         fn main() {{\n    let mut state = {model}::{}();\n    for row in ROWS.chunks(3) {{\n        \
         let x: Vec<f{width}> = row.iter().map(|it| f{width}::from_bits(*it)).collect();\n        {model}::{}(&mut state, {});\n    }}\n    \
         for value in [{}, {model}::{}(&state, {})] {{ println!(\"{{:x}}\", value.to_bits()); }}\n}}\n",
        rows.join(", "),
        names::rust_init(surface, precision),
        update.rust_name(),
        x(""),
        fields.iter().map(|field| format!("state.{field}")).collect::<Vec<_>>().join(", "),
        adapted.rust_name(),
        middle.join(", "),
    );
    assert_eq!(arity, 3, "the rows of the program in Rust");
    [c, rust]
}

#[test]
fn the_self_test_of_an_update_sees_fused_operations() {
    let (units, folder) = (units(), folder("recursive-fused"));
    compilers::write_c(&units, &folder);
    let line = "gcc -std=gnu11 -O2 -mfma -ffp-contract=fast -DRSM_BARRIER(product)=(product)";
    let backend = Loaded::open(line, &compilers::c_library(&Compiler::new(line), &folder, "fused"));
    for unit in &units {
        assert!(backend.call(&format!("{}_self_test", unit.model)) > 0, "{}", unit.model);
    }
}

#[test]
fn updates_have_no_branch_and_no_call() {
    let (units, folder) = (units(), folder("recursive-object"));
    compilers::write_c(&units, &folder);
    for line in
        ["gcc -std=c99 -O2", "gcc -std=gnu11 -O3 -march=native", "clang -std=c99 -O2", "clang -std=c99 -O3 -march=native"]
    {
        for unit in &units {
            Compiler::new(line).must(&["-c", &format!("{}.c", unit.model), "-o", "update.o"], &folder);
            let functions = object::disassemble(&folder.join("update.o"));
            for (symbol, _) in compilers::c_symbols(unit) {
                let code = &functions[&symbol];
                assert!(code.transfers().is_empty() && code.fused().is_empty(), "{line} {symbol}: {:?}", code.instructions);
            }
        }
    }
}

#[test]
fn updates_in_rust_have_no_branch_and_no_call() {
    let case = cases::checked_in().into_iter().find(|case| case.unit.model == "throttle").expect("a checked-in model");
    let (unit, folder) = (unit(&case), folder("recursive-object-rust"));
    compilers::write_rust([&unit], &folder);
    let mut text = String::from("#![no_std]\n#![deny(warnings)]\nmod throttle;\n");
    let mut symbols = vec![];
    for function in &unit.functions {
        let name = function.rust_name();
        let float = function.tape.precision.name();
        let is_update = function.kind == Kind::Update;
        let state = names::rust_state(&function.surface, function.tape.precision);
        let arguments: String = (0..function.inputs.len()).map(|k| format!(", x{k}: {float}")).collect();
        let pass: String = (0..function.inputs.len()).map(|k| format!(", x{k}")).collect();
        let (mutable, result, out) = if is_update {
            ("mut ", String::new(), format!(", y: &mut [{float}; 3]"))
        } else {
            ("", format!(" -> {float}"), String::new())
        };
        let assigned = if is_update { "*y = " } else { "" };
        text.push_str(&format!(
            "/// For the disassembly.\n#[unsafe(no_mangle)]\npub extern \"C\" fn only_{name}(state: &{mutable}throttle::{state}{arguments}{out}){result} \
             {{\n    {assigned}throttle::{name}(state{pass}){}\n}}\n",
            if is_update { ";" } else { "" }
        ));
        symbols.push(format!("only_{name}"));
    }
    compilers::write(&folder, "only.rs", &text);
    for options in ["-O", "-C opt-level=3 -C target-cpu=native"] {
        // A long function is not inlined automatically; the exported function is then a jump to it.
        let options = format!("{options} -C llvm-args=-inline-threshold=100000");
        compilers::rustc(&options).must(&["--crate-type", "lib", "--emit", "obj", "-o", "only.o", "only.rs"], &folder);
        let functions = object::disassemble(&folder.join("only.o"));
        for symbol in &symbols {
            let code = &functions[symbol];
            assert!(code.transfers().is_empty() && code.fused().is_empty(), "{options} {symbol}: {:?}", code.instructions);
        }
    }
}

#[test]
fn updates_compile_without_a_warning() {
    let (units, folder) = (units(), folder("recursive-warnings"));
    compilers::write_c(&units, &folder);
    for unit in &units {
        for line in [
            "gcc -std=c99 -O2 -pedantic -Wall -Wextra -Wconversion -Wdouble-promotion -Wfloat-equal -Wshadow -Wcast-qual -Wundef -Wstrict-prototypes -Wmissing-prototypes -Werror",
            "clang -std=c99 -O2 -Weverything -Wno-declaration-after-statement -Wno-unknown-warning-option -Wno-unsafe-buffer-usage \
             -Wno-unsafe-buffer-usage-in-libc-call -Werror",
            "g++ -std=c++11 -x c++ -O2 -Wall -Wextra -Wconversion -Werror",
        ] {
            Compiler::new(line).must(&["-DRSM_SELF_TEST", "-c", &format!("{}.c", unit.model), "-o", "update.o"], &folder);
        }
    }
}

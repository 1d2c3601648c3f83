//! Plants of equations as code: every compiler gives the bits of `rsm simulate --fixed-step`, inlined or not, and the object code has no branch, no
//! call and no fused operation.
//!
//! The plants are the texts of `rsm-model/`, with random parameters from a seed; the inputs are random too, and some are not finite.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use rsm_core::emit::plant::Plant;
use rsm_core::emit::{c_plant, rust_plant};
use rsm_core::run::Interpreter;
use rsm_core::source::{Faults, Source};
use rsm_sim::equations::{EquationFile, Inputs, Machine, Method, Setting, code, linearise, run};
use rsm_tests::cases;
use rsm_tests::compilers::{self, Compiler};
use rsm_tests::object;
use rsm_tests::points::Random;

/// The length of the steps in s: shorter than the time constants of all the texts.
const STEP: f64 = 1e-5;

/// Steps of a sequence.
const STEPS: usize = 300;

/// A plant, ready to be printed, with what is needed to run it.
struct Case {
    plant: Plant,
    file: EquationFile,
    machine: Machine,
    /// Inputs of each step, row by row.
    inputs: Vec<Vec<f64>>,
}

/// A fan whose torque is a response surface.
const FAN: &str = "package Fans\n  function drag\n    input Real w;\n    output Real torque;\n  end drag;\n  model Fan\n  input Real push;\n  \
    output Real speed(start = 100.0);\nequation\n  2*der(speed) = 100*push - drag(speed);\n  end Fan;\nend Fans;\n";
const DRAG: &str = "format = 1\nmodel = \"fan\"\n[inputs.w]\nunit = \"rad/s\"\nrange = [0.0, 200.0]\n[surfaces.torque]\nunit = \"N*m\"\ninputs = [\"w\"]\n\
    terms = [{ powers = [0], coefficient = 3.0 }, { powers = [1], coefficient = 6.1 }, { powers = [2], coefficient = 3.3 }]\n";

fn case(model: &str, text: &str, functions: &str, seed: u64) -> Case {
    let open = |name: &str| Ok::<_, Faults>(Source::new(name, if name == "drag.toml" { DRAG } else { text }));
    let plain = format!("format = 2\nmodel = \"{model}\"\n{functions}");
    let read = |text: &str| {
        EquationFile::read(&Source::new("plant.toml", text), &open).unwrap_or_else(|faults| panic!("{model}: {faults}"))
    };
    let mut random = Random(seed);
    let mut parameters = String::from("[parameters]\n");
    let file = read(&plain);
    let system = &file.system;
    for parameter in system.parameters() {
        let (name, value) = (system.name(parameter), system.parameter_value(parameter).unwrap());
        // Booleans and counts stay; all other parameters change by up to a twentieth.
        let whole = value.fract() == 0.0 && value.abs() <= 5.0;
        if !whole && name != "record_period" && name != "Ts" {
            writeln!(parameters, "\"{name}\" = {:?}", value * (0.95 + 0.1 * random.share())).unwrap();
        }
    }
    let file = read(&format!("{plain}{parameters}"));
    let mut machine = Machine::new(&file).unwrap_or_else(|faults| panic!("{model}: {faults}"));
    let count = machine.inputs().len();
    // Each input wanders, and one sample in forty is a step.
    let mut held: Vec<f64> = (0..count).map(|_| random.share()).collect();
    let inputs: Vec<Vec<f64>> = (0..STEPS)
        .map(|_| {
            held.iter_mut()
                .for_each(|it| *it = if random.share() < 0.025 { random.share() } else { *it + 0.01 * (random.share() - 0.5) });
            held.clone()
        })
        .collect();
    let point = machine
        .start(&file, 0.0, inputs.first().map_or(&[], |it| it), &[])
        .unwrap_or_else(|faults| panic!("{model}: {faults}"));
    let linear = linearise(&file, &machine, &point).unwrap_or_else(|faults| panic!("{model}: {faults}"));
    let start = code::Start { point: &point, words: String::new(), linear: &linear };
    let plant = code::plant(&machine, STEP, &start, None, "plant.toml").unwrap_or_else(|what| panic!("{model}: {what}"));
    Case { plant, file, machine, inputs }
}

/// Every text, two of some shipped ones, a surface.
fn all() -> &'static [Case] {
    static CASES: OnceLock<Vec<Case>> = OnceLock::new();
    CASES.get_or_init(|| {
        let root = cases::root();
        let mut texts: Vec<PathBuf> = ["rsm-model/models", "rsm-model/tests/models"]
            .iter()
            .flat_map(|folder| std::fs::read_dir(root.join(folder)).expect("the folder is there"))
            .map(|entry| entry.expect("it can be read").path())
            .filter(|path| path.extension().is_some_and(|it| it == "mo"))
            .collect();
        texts.sort();
        let mut all: Vec<Case> =
            vec![case("fan.mo#Fan", FAN, "[functions]\ndrag = { model = \"drag.toml\", surface = \"torque\" }\n", 7)];
        for (k, path) in texts.iter().enumerate() {
            let text = std::fs::read_to_string(path).expect("it can be read");
            let name = path.file_name().expect("a file").to_string_lossy().into_owned();
            if name == "servo-axis.mo" {
                all.push(case("servo-axis.mo#ServoAxisClosedLoop", &text, "", 5));
                all.push(case("servo-axis.mo#ServoAxis", &text, "", 6));
            } else {
                all.push(case(&name, &text, "", 100 + k as u64));
            }
        }
        // Two texts may hold a model of one name.
        let names: Vec<String> = all.iter().map(|it| it.plant.model.clone()).collect();
        for (k, case) in all.iter_mut().enumerate() {
            if names[..k].contains(&names[k]) {
                case.plant.model = format!("{}_{k}", names[k]);
            }
        }
        all
    })
}

/// What the interpreter gives along a sequence of inputs: outputs of every step, then the states behind the last one.
fn wanted(plant: &Plant, inputs: &[Vec<f64>]) -> Vec<f64> {
    let mut interpreter = Interpreter::<f64>::new(&plant.tape);
    let start: Vec<f64> = plant.states.iter().map(|it| it.1).collect();
    interpreter.set_states(&start);
    let mut results = vec![];
    for row in inputs {
        interpreter.step(row);
        results.extend(interpreter.results().take(plant.outputs.len()));
    }
    results.extend(interpreter.states());
    results
}

/// The places where two rows of numbers have different bits; all NaN count as equal.
fn difference(wanted: &[f64], found: &[f64]) -> Option<String> {
    assert_eq!(wanted.len(), found.len());
    let differ = |(wanted, found): (&f64, &f64)| wanted.to_bits() != found.to_bits() && !(wanted.is_nan() && found.is_nan());
    let place = wanted.iter().zip(found).position(differ)?;
    Some(format!("number {place} is {:e}, not {:e}", found[place], wanted[place]))
}

/// The inputs of a case, with some samples that are not finite.
fn with_bad(case: &Case) -> Vec<Vec<f64>> {
    let mut inputs = case.inputs.clone();
    for (k, row) in inputs.iter_mut().enumerate() {
        if k % 41 == 40
            && let Some(first) = row.first_mut()
        {
            *first = [f64::NAN, f64::INFINITY, -0.0, f64::NEG_INFINITY][k / 41 % 4];
        }
    }
    inputs
}

/// `batch_m(x, y, n)`: n steps from the start, then the states.
fn c_batch(plant: &Plant) -> String {
    let model = &plant.model;
    let arity = plant.inputs.len();
    let pass: String = (0..arity).map(|k| format!(", x[i * {arity} + {k}]")).collect();
    let outputs = if plant.outputs.is_empty() { "" } else { ", &outputs" };
    let local = if plant.outputs.is_empty() { String::new() } else { format!("    {model}_outputs outputs;\n") };
    let of_outputs: String = plant
        .tape
        .outputs
        .iter()
        .take(plant.outputs.len())
        .map(|it| format!("        *y++ = outputs.{};\n", it.name))
        .collect();
    let of_states: String = plant.tape.states.iter().map(|it| format!("    *y++ = state.{};\n", it.name)).collect();
    let head = format!("void batch_{model}(const double *x, double *y, size_t n)");
    format!(
        "RSM_TESTS_EXPORT {head};\n{head}\n{{\n    size_t i;\n    {model}_state state;\n{local}    (void)x;\n    {model}_init(&state);\n    \
         for (i = 0; i < n; i++) {{\n        {model}_step(&state{pass}{outputs});\n{of_outputs}    }}\n{of_states}}}\n"
    )
}

/// The C of all plants in a folder: each as its files, `models.c` with all of them, `batches.c`, and `unity.c` with both.
fn write_c(cases: &[Case], folder: &Path) {
    let (mut models, mut batches) =
        (String::new(), "#include <stddef.h>\n#define RSM_TESTS_EXPORT __attribute__((visibility(\"default\")))\n".to_string());
    for Case { plant, .. } in cases {
        let files = c_plant::emit(plant);
        compilers::write(folder, &format!("{}.h", plant.model), &files.header);
        compilers::write(folder, &format!("{}.c", plant.model), &files.source);
        writeln!(models, "#include \"{}.c\"", plant.model).unwrap();
        writeln!(batches, "#include \"{}.h\"\n{}", plant.model, c_batch(plant)).unwrap();
    }
    compilers::write(folder, "models.c", &models);
    compilers::write(folder, "batches.c", &batches);
    compilers::write(folder, "unity.c", "#include \"models.c\"\n#include \"batches.c\"\n");
}

#[allow(unsafe_code)]
fn compare(cases: &[Case], library: &Path, line: &str) {
    // SAFETY: the library was compiled from emitted text and the batches above, whose type this is.
    let library = unsafe { libloading::Library::new(library) }.unwrap_or_else(|error| panic!("{line}: {error}"));
    let mut wrong = vec![];
    for case in cases {
        let inputs = with_bad(case);
        let wanted = wanted(&case.plant, &inputs);
        let flat: Vec<f64> = inputs.concat();
        let mut found = vec![0.0; wanted.len()];
        // SAFETY: it reads the inputs of that many steps, and writes their outputs and the states.
        unsafe {
            let batch: libloading::Symbol<'_, unsafe extern "C" fn(*const f64, *mut f64, usize)> =
                library.get(format!("batch_{}", case.plant.model).as_bytes()).expect("it is exported");
            batch(flat.as_ptr(), found.as_mut_ptr(), inputs.len());
        }
        wrong.extend(difference(&wanted, &found).map(|what| format!("{}: {what}", case.plant.model)));
    }
    assert!(wrong.is_empty(), "{line}\n{}", wrong.join("\n"));
}

fn scratch(name: &str) -> PathBuf {
    compilers::fresh(Path::new(env!("CARGO_TARGET_TMPDIR")), name)
}

/// The compiler options of the bit suite, and inlined into the loop of the caller.
const C_COMPILERS: [&str; 8] = [
    "-std=c99 -O0",
    "-std=c99 -O2",
    "-std=c99 -O3 -march=native",
    "-std=gnu11 -O2 -mfma -ffp-contract=fast",
    "-std=gnu11 -Os",
    "-std=c99 -O0 -DINLINED",
    "-std=gnu11 -O3 -march=native -ffp-contract=fast -DINLINED",
    "-std=gnu11 -O2 -mfma -DINLINED",
];

#[test]
fn the_emitted_step_is_the_simulation() {
    for case in all() {
        let time: Vec<f64> = (0..STEPS).map(|k| k as f64 * STEP).collect();
        let values: Vec<Vec<f64>> =
            (0..case.machine.inputs().len()).map(|k| case.inputs.iter().map(|row| row[k]).collect()).collect();
        let mut machine = Machine::new(&case.file).unwrap();
        let point = machine.start(&case.file, 0.0, case.inputs.first().map_or(&[], |it| it), &[]).unwrap();
        let setting = Setting::new(Method::Fixed { step: STEP }, 1e-8);
        let found =
            run(&machine, point, Inputs { time: &time, values: &values }, setting).unwrap_or_else(|why| panic!("{why}"));
        let wanted = wanted(&case.plant, &case.inputs);
        let outputs = case.plant.outputs.len();
        let by_row: Vec<f64> = (0..STEPS).flat_map(|row| found.iter().map(move |it| it[row])).collect();
        assert_eq!(difference(&wanted[..STEPS * outputs], &by_row), None, "{}", case.plant.model);
    }
}

#[test]
fn the_family_has_every_form() {
    let has =
        |word: &str| all().iter().filter(|it| it.plant.tape.states.iter().any(|state| state.name.starts_with(word))).count();
    assert!(all().len() >= 17, "{} plants", all().len());
    assert!(has("when_") >= 3 && has("samples_") >= 2 && has("steps") >= 2, "clauses, samples, clocks");
    assert!(all().iter().any(|it| !it.machine.system().iterated().is_empty()), "a nonlinear block");
    assert!(all().iter().any(|it| !it.file.functions.is_empty()), "a surface");
    assert!(all().iter().any(|it| it.machine.system().switches().len() > 1), "comparisons");
}

#[test]
fn c_keeps_the_bits_of_plants() {
    let folder = scratch("plants-c");
    write_c(all(), &folder);
    let mut count = 0;
    for program in ["gcc", "clang"].iter().flat_map(|family| compilers::installed(family)) {
        for options in C_COMPILERS {
            // Other versions of the compilers are tested at -O0 and -O3 only.
            let is_plain = program == "gcc" || program == "clang";
            if !is_plain && !options.contains("-O3") && !options.contains("-O0 ") {
                continue;
            }
            let line = format!("{program} {options}");
            let sources: &[&str] = if options.contains("INLINED") { &["unity.c"] } else { &["models.c", "batches.c"] };
            let name = format!("plants{count}.so");
            let arguments = [&["-shared", "-fPIC", "-fvisibility=hidden", "-o", &name][..], sources].concat();
            Compiler::new(&line).must(&arguments, &folder);
            compare(all(), &folder.join(&name), &line);
            count += 1;
        }
    }
    println!("{count} ways of compiling, {} plants", all().len());
}

#[test]
fn a_fused_operation_in_a_plant_is_noticed() {
    let folder = scratch("plants-fused");
    write_c(all(), &folder);
    let mut differ = 0;
    for Case { plant, .. } in all() {
        let text = format!("#include \"{0}.h\"\nint main(void) {{ return {0}_self_test() != 0; }}\n", plant.model);
        compilers::write(&folder, "main.c", &text);
        let source = format!("{}.c", plant.model);
        let fails = |line: &str| {
            Compiler::new(line).must(&["-DRSM_SELF_TEST", "main.c", &source, "-o", "self_test"], &folder);
            !std::process::Command::new(folder.join("self_test")).status().expect("it starts").success()
        };
        assert!(!fails("gcc -std=gnu11 -O2 -mfma"), "{}", plant.model);
        differ += usize::from(fails("gcc -std=gnu11 -O2 -mfma -DRSM_BARRIER(product)=(product)"));
    }
    // A ball in free fall, and the like, have sums of products that are exact.
    assert!(2 * differ > all().len(), "{differ} of {}", all().len());
}

#[test]
fn rust_keeps_the_bits_of_plants() {
    let folder = scratch("plants-rust");
    let mut text = String::from("#![deny(warnings)]\n");
    for Case { plant, .. } in all() {
        let (model, arity) = (&plant.model, plant.inputs.len());
        compilers::write(&folder, &format!("{model}.rs"), &rust_plant::emit(plant));
        let pass: String = (0..arity).map(|k| format!(", *x.add(i * {arity} + {k})")).collect();
        let count = plant.outputs.len();
        let of_outputs: String = plant
            .tape
            .outputs
            .iter()
            .take(count)
            .enumerate()
            .map(|(k, it)| format!(" *y.add(i * {count} + {k}) = outputs.{};", it.name))
            .collect();
        let of_states: String = (plant.tape.states.iter().enumerate())
            .map(|(k, it)| format!(" *y.add(n * {count} + {k}) = state.{};", it.name))
            .collect();
        let local = if count == 0 { "" } else { "let outputs = " };
        writeln!(
            text,
            "mod {model};\n/// # Safety\n/// As the test calls it.\n#[unsafe(no_mangle)]\n#[allow(unused_variables)]\npub unsafe extern \"C\" fn batch_{model}(x: *const f64, y: *mut f64, n: usize) {{ unsafe {{\n    \
             let mut state = {model}::init();\n    for i in 0..n {{ {local}{model}::step(&mut state{pass});{of_outputs} }}\n   {of_states}\n}} }}"
        )
        .unwrap();
    }
    compilers::write(&folder, "models.rs", &text);
    for (k, options) in ["-C opt-level=0", "-C opt-level=3 -C target-cpu=native"].into_iter().enumerate() {
        let name = format!("plants{k}.so");
        compilers::rustc(options).must(&["--crate-type", "cdylib", "-o", &name, "models.rs"], &folder);
        compare(all(), &folder.join(&name), options);
    }
}

#[test]
fn plants_have_no_branch_no_call_and_no_fused_operation() {
    let folder = scratch("plants-object");
    write_c(all(), &folder);
    for line in ["gcc -O2", "clang -O2", "gcc -O2 -mfma -ffp-contract=fast", "clang -O3 -march=native -ffp-contract=fast"] {
        Compiler::new(line).must(&["-c", "models.c", "-o", "models.o"], &folder);
        let functions = object::disassemble(&folder.join("models.o"));
        for Case { plant, .. } in all() {
            for name in plant.functions(true) {
                let code = &functions[&name];
                assert!(
                    code.transfers().is_empty() && code.fused().is_empty(),
                    "{line} {name}: {:?} {:?}",
                    code.transfers(),
                    code.fused()
                );
            }
        }
    }
}

#[test]
fn plants_compile_without_a_warning() {
    let folder = scratch("plants-warnings");
    write_c(all(), &folder);
    let sources: Vec<String> = all().iter().map(|it| format!("{}.c", it.plant.model)).collect();
    let arguments: Vec<&str> = ["-DRSM_SELF_TEST", "-c"].into_iter().chain(sources.iter().map(String::as_str)).collect();
    for line in [
        "gcc -std=c99 -O2 -pedantic -Wall -Wextra -Wconversion -Wdouble-promotion -Wfloat-equal -Wshadow -Wcast-qual -Wundef -Wstrict-prototypes -Wmissing-prototypes -Werror",
        "clang -std=c99 -O2 -Weverything -Wno-declaration-after-statement -Wno-unknown-warning-option -Wno-unsafe-buffer-usage \
         -Wno-unsafe-buffer-usage-in-libc-call -Werror",
        "g++ -std=c++11 -x c++ -O2 -Wall -Wextra -Wconversion -Werror",
    ] {
        Compiler::new(line).must(&arguments, &folder);
    }
    for case in all() {
        let (files, rust) = (c_plant::emit(&case.plant), rust_plant::emit(&case.plant));
        for text in [&files.header, &files.source, &rust] {
            assert!(text.is_ascii() && text.ends_with('\n') && text.lines().all(|line| line.trim_end() == line), "{text}");
        }
    }
}

/// Other machines, under emulation: those whose compiler and emulator are installed. The test prints which.
#[test]
fn other_machines_keep_the_bits_of_plants() {
    let folder = scratch("plants-emulated");
    write_c(all(), &folder);
    let mut calls = String::new();
    for Case { plant, .. } in all() {
        writeln!(calls, "    failures += {}_self_test();", plant.model).unwrap();
    }
    let includes: String = all().iter().map(|it| format!("#include \"{}.h\"\n", it.plant.model)).collect();
    compilers::write(
        &folder,
        "main.c",
        &format!("{includes}int main(void)\n{{\n    int failures = 0;\n{calls}    return failures != 0;\n}}\n"),
    );
    let there =
        |program: &str| std::process::Command::new(program).arg("--version").output().is_ok_and(|it| it.status.success());
    let mut seen = vec![];
    for (compiler, emulator) in [
        ("aarch64-linux-gnu-gcc", "qemu-aarch64"),
        ("arm-linux-gnueabihf-gcc", "qemu-arm"),
        ("riscv64-linux-gnu-gcc", "qemu-riscv64"),
        ("s390x-linux-gnu-gcc", "qemu-s390x"),
        ("powerpc64le-linux-gnu-gcc", "qemu-ppc64le"),
    ] {
        if !there(compiler) || !there(emulator) {
            continue;
        }
        for level in ["-O0", "-O3 -ffp-contract=fast"] {
            Compiler::new(&format!("{compiler} -std=gnu11 {level} -static -DRSM_SELF_TEST"))
                .must(&["models.c", "main.c", "-o", "emulated"], &folder);
            let status = std::process::Command::new(emulator).arg(folder.join("emulated")).status().expect("it starts");
            assert!(status.success(), "{compiler} {level}: {status}");
        }
        seen.push(emulator);
    }
    println!("machines seen: {}", seen.join(" "));
    if seen.is_empty() {
        eprintln!("NOT TESTED on other machines: no cross compiler with its emulator is here");
    }
}

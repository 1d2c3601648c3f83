//! An evaluator keeps its bits when it is inlined into a caller's loop: by link-time optimisation, by including the source, under every option that
//! allows a compiler to vectorise the loop, to fuse and to reorder. With each set of options the emitted text either refuses to compile or gives the
//! right bits.
//!
//! Every gcc and clang of the machine is tested, found by name; the test prints which. The models are random surfaces that extrapolate (a
//! clamp prevents that a loop is vectorised), some of the other random models, and a compensator.

use std::path::{Path, PathBuf};

use rsm_core::check::Checked;
use rsm_core::compile;
use rsm_core::emit::Unit;
use rsm_core::model::{Coding, Input, Model, Outside, Surface, Term};
use rsm_core::number::Precision;
use rsm_tests::backend::{Backend, Loaded};
use rsm_tests::cases::{self, Case};
use rsm_tests::compilers::{self, Compiler};
use rsm_tests::object;
use rsm_tests::points::Random;

use crate::bit_for_bit::compare_function;

/// Random points of each function in addition to the special ones: some rounds of the widest vector.
const POINTS: usize = 200;

/// Options that change results, alone and in the groups that the compilers define. Each is refused, or has no effect on an evaluator.
const FAST: [&str; 12] = [
    "-ffast-math",
    "-Ofast",
    "-funsafe-math-optimizations",
    "-fassociative-math -fno-signed-zeros -fno-trapping-math",
    "-freciprocal-math",
    "-fno-signed-zeros",
    "-ffinite-math-only",
    "-fno-honor-nans",
    "-fno-honor-infinities",
    "-fapprox-func",
    "-ffp-model=fast",
    "-ffp-model=aggressive",
];

fn scratch(name: &str) -> PathBuf {
    compilers::fresh(Path::new(env!("CARGO_TARGET_TMPDIR")), name)
}

/// A random number from `low` to `high`.
fn between(random: &mut Random, low: f64, high: f64) -> f64 {
    low + (high - low) * random.share()
}

/// Surfaces of one to three inputs that all extrapolate, of order 1 to 4, centred or in natural powers, a second surface of the first input alone.
fn extrapolating() -> Vec<Case> {
    let mut random = Random(0x1a11);
    (0..6)
        .map(|index| {
            let (count, order) = (1 + index % 3, 1 + (index as u32 + 1) % 4);
            let inputs: Vec<Input> = ["x", "y", "z"][..count]
                .iter()
                .map(|name| {
                    let low = between(&mut random, -3.0, 1.0);
                    let range = [low, low + between(&mut random, 0.5, 4.0)];
                    Input { name: (*name).to_string(), unit: "1".to_string(), range, outside: Outside::Extrapolate }
                })
                .collect();
            let mut surface = |name: &str, count: usize, order: u32| {
                let powers = (0..(order + 1).pow(count as u32))
                    .map(|k| (0..count as u32).map(|axis| k / (order + 1).pow(axis) % (order + 1)).collect::<Vec<u32>>());
                let terms = powers
                    .filter(|powers| powers.iter().sum::<u32>() <= order)
                    .map(|powers| Term { powers, coefficient: between(&mut random, -2.0, 2.0) })
                    .collect();
                Surface {
                    name: name.to_string(),
                    unit: "1".to_string(),
                    inputs: inputs[..count].iter().map(|input| input.name.clone()).collect(),
                    coding: if index % 2 == 0 { Coding::Range } else { Coding::None },
                    terms,
                    ..Surface::default()
                }
            };
            let surfaces = vec![surface("s", count, order), surface("t", 1, 2)];
            let model = Model { name: format!("e{index}"), inputs: inputs.clone(), surfaces, compensators: vec![] };
            let checked = Checked::from_model(&model).unwrap_or_else(|faults| panic!("{faults}"));
            let unit = compile::unit(&checked, &[]).unwrap_or_else(|faults| panic!("{faults}"));
            Case { file: PathBuf::from(format!("{}.toml", model.name)), checked, unit }
        })
        .collect()
}

/// The extrapolating models and some of the random ones.
fn some() -> Vec<Case> {
    extrapolating().into_iter().chain(cases::quick_random()).collect()
}

fn every() -> Vec<Case> {
    extrapolating().into_iter().chain(cases::every_random().iter().cloned()).collect()
}

/// How the caller gets the evaluators.
#[derive(Clone, Copy, PartialEq)]
enum Seen {
    /// It includes the source.
    Unity,
    /// The linker puts both together.
    Linked,
    /// The same, and the caller alone is compiled with -Ofast.
    LinkedFromFast,
}

/// The shared object for one set of options; or the compiler's message if the emitted text refused it; `None` if the compiler does not know an
/// option. Objects are linked without the options: a program that is linked with -ffast-math may start in a mode that flushes subnormals.
fn build(line: &str, seen: Seen, folder: &Path) -> Option<Result<PathBuf, String>> {
    let compiler = Compiler::new(&format!("{line} -fPIC -fvisibility=hidden -DRSM_SELF_TEST"));
    let unknown = compiler.run(&["-E", "-x", "c", "/dev/null", "-o", "nothing"], folder);
    let said = String::from_utf8_lossy(&unknown.stderr).into_owned();
    if !unknown.status.success() || said.contains("not supported") || said.contains("argument unused") {
        return None;
    }
    let sources: &[(&str, &str)] = match seen {
        Seen::Unity => &[("unity.c", "")],
        Seen::Linked => &[("models.c", "-flto"), ("batches.c", "-flto"), ("self_tests.c", "-flto")],
        Seen::LinkedFromFast => &[("models.c", "-flto"), ("batches.c", "-flto -Ofast"), ("self_tests.c", "-flto")],
    };
    let mut objects = vec![];
    for (source, options) in sources {
        let object = format!("{source}.o");
        let arguments: Vec<&str> = options.split_whitespace().chain(["-c", source, "-o", &object]).collect();
        let output = compiler.run(&arguments, folder);
        if !output.status.success() {
            return Some(Err(String::from_utf8_lossy(&output.stderr).into_owned()));
        }
        objects.push(object);
    }
    let name = line.replace(|c: char| !c.is_ascii_alphanumeric(), "_") + &format!("_{}.so", seen as u8);
    let program = line.split_whitespace().next().expect("a program");
    let level = if seen == Seen::Unity { "-O0" } else { "-flto -O3 -march=native" };
    let mut arguments: Vec<&str> = vec!["-shared", "-fPIC", "-o", &name];
    arguments.extend(objects.iter().map(String::as_str));
    Compiler::new(&format!("{program} {level}")).must(&arguments, folder);
    Some(Ok(folder.join(name)))
}

/// What is wrong with a library: functions that differ, self-tests that fail.
fn faults(line: &str, library: &Path, cases: &[Case]) -> Vec<String> {
    let loaded = Loaded::open(line, library);
    let mut wrong = differences(&loaded, cases);
    let failures = loaded.call("self_tests");
    if failures != 0 {
        wrong.push(format!("{line}: the self-tests find {failures} differences"));
    }
    wrong
}

/// Functions that differ from the interpreter.
fn differences(loaded: &Loaded, cases: &[Case]) -> Vec<String> {
    let mut wrong = vec![];
    for case in cases {
        for (k, function) in case.unit.functions.iter().enumerate() {
            wrong.extend(match function.tape.precision {
                Precision::F64 => compare_function::<f64>(case, k, &[loaded as &dyn Backend<f64>], POINTS),
                Precision::F32 => compare_function::<f32>(case, k, &[loaded as &dyn Backend<f32>], POINTS),
            });
        }
    }
    wrong
}

/// Each set of options is refused with the message of the emitted text, or gives the right bits. Returns how many were refused.
fn judge(ways: &[(String, Seen)], cases: &[Case], folder: &Path) -> usize {
    compilers::write_c(cases.iter().map(|case| &case.unit), folder);
    let (mut wrong, mut refused, mut unknown) = (vec![], 0, 0);
    for (line, seen) in ways {
        match build(line, *seen, folder) {
            None => unknown += 1,
            Some(Err(said)) => {
                let of_ours =
                    said.contains("change the results") || said.contains("the x87 unit") || said.contains("excess precision");
                assert!(of_ours, "{line} fails, and not because the emitted text refuses it:\n{said}");
                refused += 1;
            }
            Some(Ok(library)) => wrong.extend(faults(line, &library, cases)),
        }
    }
    assert!(wrong.is_empty(), "{} findings\n{}", wrong.len(), wrong.join("\n"));
    println!("{} ways of compiling: {refused} refused, {unknown} with an option that the compiler does not know", ways.len());
    assert!(unknown < ways.len(), "nothing was compiled");
    refused
}

fn all_compilers() -> Vec<String> {
    let all: Vec<String> = ["gcc", "clang"].iter().flat_map(|family| compilers::installed(family)).collect();
    println!("compilers seen: {}", all.join(" "));
    all
}

/// Options under which loops are vectorised. -march=native may have wider vectors than x86-64-v3, which has fused operations.
fn vectorised(is_gcc: bool) -> [&'static str; 2] {
    if is_gcc {
        ["-O3 -march=native", "-O2 -ftree-vectorize -march=x86-64-v3"]
    } else {
        ["-O3 -march=native", "-O2 -mfma -ffp-contract=fast"]
    }
}

#[test]
fn an_evaluator_in_a_vectorised_loop_keeps_its_bits() {
    let mut ways = vec![];
    for compiler in all_compilers() {
        let is_gcc = compiler.starts_with("gcc");
        ways.push((format!("{compiler} {}", vectorised(is_gcc)[0]), Seen::Unity));
        if ["gcc", "clang"].contains(&compiler.as_str()) {
            ways.push((format!("{compiler} {}", vectorised(is_gcc)[1]), Seen::Unity));
            ways.push((format!("{compiler} {}", vectorised(is_gcc)[0]), Seen::Linked));
            ways.push((format!("{compiler} {}", vectorised(is_gcc)[0]), Seen::LinkedFromFast));
        }
    }
    assert_eq!(judge(&ways, &some(), &scratch("inlined")), 0, "these options keep IEEE 754");
}

#[test]
fn options_that_change_results_are_refused_or_undone() {
    let mut ways = vec![];
    for compiler in all_compilers() {
        ways.extend(FAST.map(|options| (format!("{compiler} -O2 -march=native {options}"), Seen::Unity)));
    }
    let refused = judge(&ways, &extrapolating(), &scratch("inlined-fast"));
    assert!(refused > 4, "-ffast-math and -Ofast are refused at least: {refused}");
}

/// No macro shows `-fno-honor-infinities`. Clang from 18 on has a warning for it, and then the emitted text refuses. Only -w silences the warning.
/// Then every result has its bits if the compiler does not know the argument; only a caller that passes a constant infinity, against its own option,
/// gets a wrong result.
#[test]
fn infinities_are_refused_or_keep_their_bits_where_nothing_can_be_told() {
    let cases = extrapolating();
    let folder = scratch("inlined-infinities");
    compilers::write_c(cases.iter().map(|case| &case.unit), &folder);
    compilers::write(&folder, "shows.c", "#if __has_warning(\"-Wnan-infinity-disabled\")\nint yes;\n#endif\n");
    for compiler in compilers::installed("clang") {
        Compiler::new(&compiler).must(&["-E", "-P", "shows.c", "-o", "shows.txt"], &folder);
        let shows = std::fs::read_to_string(folder.join("shows.txt")).expect("it was written").contains("yes");
        let built = build(&format!("{compiler} -O3 -march=native -fno-honor-infinities"), Seen::Unity, &folder).expect("known");
        match &built {
            Err(said) => assert!(said.contains("-fno-honor-infinities would change the results"), "{compiler}: {said}"),
            Ok(library) => assert_eq!(faults(&compiler, library, &cases), Vec::<String>::new()),
        }
        assert_eq!(built.is_err(), shows, "{compiler}");
        let silenced = format!("{compiler} -w -O3 -march=native -fno-honor-infinities");
        let library = build(&silenced, Seen::Unity, &folder).expect("known options").expect("it compiles");
        assert_eq!(differences(&Loaded::open(&silenced, &library), &cases), Vec::<String>::new(), "{silenced}");
    }
}

/// Part of the combinations of ways and models is tested outside of the campaign: of each way this share of the models, of each model this share of
/// the ways.
const PARTS: usize = 5;

#[test]
#[ignore = "every compiler and option: run by `cargo xtask test` for a share of the models each, by `cargo xtask bits` for every model"]
fn every_way_of_inlining_keeps_the_bits() {
    // Other compilers than the default ones get only the models that extrapolate, which vectorise best: every model with eight compilers takes ten
    // minutes.
    let (mut own, mut others) = (vec![], vec![]);
    for compiler in all_compilers() {
        let ways = if ["gcc", "clang"].contains(&compiler.as_str()) { &mut own } else { &mut others };
        let is_gcc = compiler.starts_with("gcc");
        for options in vectorised(is_gcc) {
            ways.push((format!("{compiler} {options}"), Seen::Unity));
            ways.push((format!("{compiler} {options}"), Seen::Linked));
            ways.push((format!("{compiler} {options}"), Seen::LinkedFromFast));
        }
        ways.extend(FAST.map(|options| (format!("{compiler} -O3 -march=native {options}"), Seen::Unity)));
    }
    let parts = if rsm_tests::is_campaign() { 1 } else { PARTS };
    for part in 0..parts {
        let cases: Vec<Case> = every().into_iter().skip(part).step_by(parts).collect();
        let ways: Vec<_> = own.iter().skip(part).step_by(parts).cloned().collect();
        judge(&ways, &cases, &scratch("inlined-every"));
    }
    // A machine may have only the default compilers.
    if !others.is_empty() {
        judge(&others, &extrapolating(), &scratch("inlined-others"));
    }
}

/// The suite can fail: with the builtin of gcc in place of the barrier the loops are vectorised and fused. The self-test,
/// which has such a loop, detects it too.
#[test]
fn the_builtin_barrier_of_gcc_would_not_do() {
    let cases = extrapolating();
    let folder = scratch("inlined-builtin");
    compilers::write_c(cases.iter().map(|case| &case.unit), &folder);
    let line = "gcc -O3 -march=native -DRSM_BARRIER=__builtin_assoc_barrier";
    let library = build(line, Seen::Unity, &folder).expect("known options").expect("it compiles");
    let wrong = faults(line, &library, &cases);
    assert!(wrong.len() > 2 && wrong.iter().any(|it| it.contains("self-tests find")), "{wrong:?}");
}

/// The functions are inlined into the loops, without a call, except the longest: otherwise these tests would prove nothing.
#[test]
fn the_loops_have_the_evaluator_inside() {
    let cases = extrapolating();
    let folder = scratch("inlined-object");
    compilers::write_c(cases.iter().map(|case| &case.unit), &folder);
    for line in ["gcc -O3 -march=native", "clang -O3 -march=native"] {
        Compiler::new(line).must(&["-c", "unity.c", "-o", "unity.o"], &folder);
        let functions = object::disassemble(&folder.join("unity.o"));
        let (mut inside, mut all) = (0, 0);
        for case in &cases {
            for function in &case.unit.functions {
                let code = &functions[&format!("batch_{}_{}", case.unit.model, function.rust_name())];
                assert!(code.fused().is_empty(), "{line}: {:?}", code.fused());
                inside += usize::from(code.transfers().iter().all(|line| !line.starts_with("call")));
                all += 1;
            }
        }
        assert!(3 * inside > 2 * all, "{line}: {inside} of {all}");
    }
}

/// rustc does not fuse, reorder or approximate: a vectorised loop over the same functions has packed products, and no fused operation.
#[test]
fn emitted_rust_in_a_vectorised_loop_keeps_its_bits() {
    let cases = some();
    let folder = scratch("inlined-rust");
    compilers::write_rust(cases.iter().map(|case| &case.unit), &folder);
    let options = "-C opt-level=3 -C target-cpu=native -C llvm-args=-inline-threshold=100000";
    let library = compilers::rust_library(options, &folder, "inlined");
    let functions = object::disassemble(&library);
    let units: Vec<&Unit> = cases.iter().map(|case| &case.unit).collect();
    let mut packed = 0;
    for unit in units {
        for function in &unit.functions {
            let code = &functions[&format!("batch_{}_{}", unit.model, function.rust_name())];
            assert!(code.fused().is_empty(), "{}: {:?}", unit.model, code.fused());
            packed += usize::from(code.instructions.iter().any(|line| line.starts_with("vmulp") || line.starts_with("mulp")));
        }
    }
    assert!(packed > 10, "{packed} loops are vectorised");
    let loaded = Loaded::open("rustc", &library);
    let wrong = differences(&loaded, &cases);
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// The self-tests on AArch64, whose vectors have fused operations in every machine, linked at -O3 with link-time optimisation, under qemu.
#[test]
fn self_tests_pass_on_an_emulated_aarch64() {
    if !is_there(&["aarch64-linux-gnu-gcc", "qemu-aarch64"], "gcc-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user") {
        return;
    }
    let folder = emulated(&extrapolating(), "inlined-aarch64");
    for (barrier, keeps) in [("", true), (" -DRSM_BARRIER=__builtin_assoc_barrier", false)] {
        let line = format!("aarch64-linux-gnu-gcc -O3 -flto -static -DRSM_SELF_TEST{barrier}");
        Compiler::new(&line).must(&["models.c", "self_tests.c", "main.c", "-o", "self_tests"], &folder);
        let passes = Compiler::new("qemu-aarch64").run(&[&program(&folder)], &folder).status.success();
        assert_eq!(passes, keeps, "{line}");
    }
}

/// On 32-bit Arm clang ignores the pragma that undoes its options, so only the barriers of the text protect the bits. Every clang, every option,
/// compensators and reciprocals too, under qemu. A version without barriers shows that the test can fail.
#[test]
fn self_tests_pass_on_an_emulated_arm_whatever_clang_is_told() {
    if !is_there(&["arm-linux-gnueabihf-gcc", "qemu-arm"], "gcc-arm-linux-gnueabihf libc6-dev-armhf-cross qemu-user") {
        return;
    }
    let folder = emulated(&some(), "inlined-arm");
    let machine = "--target=arm-linux-gnueabihf -march=armv7-a -mfpu=vfpv4-d16 -mfloat-abi=hard -O2 -DRSM_SELF_TEST";
    let link = Compiler::new("arm-linux-gnueabihf-gcc -static");
    let (mut passed, mut refused, mut seen_to_fail) = (0, 0, 0);
    for compiler in compilers::installed("clang") {
        for options in FAST {
            for hides in [true, false] {
                let canary = if hides { "" } else { " -DRSM_BARRIER(product)=(product)" };
                let clang = Compiler::new(&format!("{compiler} {machine} {options}{canary}"));
                if !clang.run(&["-E", "-x", "c", "/dev/null", "-o", "nothing"], &folder).status.success() {
                    continue;
                }
                let is_made = ["models", "self_tests"]
                    .iter()
                    .all(|name| clang.run(&["-c", &format!("{name}.c"), "-o", &format!("{name}.o")], &folder).status.success());
                if !is_made {
                    refused += 1;
                    continue;
                }
                link.must(&["models.o", "self_tests.o", "main.c", "-o", "self_tests"], &folder);
                let passes = Compiler::new("qemu-arm").run(&[&program(&folder)], &folder).status.success();
                assert!(passes || !hides, "{compiler} {options}");
                passed += usize::from(hides);
                seen_to_fail += usize::from(!passes);
            }
        }
    }
    println!("{passed} ways give the bits, {refused} are refused, {seen_to_fail} differ where nothing is hidden");
    assert!(passed > 4 && refused > 2 && seen_to_fail > 1, "{passed}, {refused}, {seen_to_fail}");
}

/// Sources of models, their self-tests and a main program that ends with status 0 where all hold.
fn emulated(cases: &[Case], name: &str) -> PathBuf {
    let folder = scratch(name);
    compilers::write_c(cases.iter().map(|case| &case.unit), &folder);
    compilers::write(&folder, "main.c", "int self_tests(void);\nint main(void) { return self_tests() != 0; }\n");
    folder
}

fn program(folder: &Path) -> String {
    folder.join("self_tests").display().to_string()
}

/// Whether these programs are installed; in CI they must be.
pub(super) fn is_there(programs: &[&str], packages: &str) -> bool {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let has = |program: &&str| std::env::split_paths(&path).any(|folder| folder.join(program).is_file());
    let all = programs.iter().all(has);
    if !all {
        assert!(std::env::var_os("CI").is_none(), "apt-get install {packages}");
        rsm_tests::skipped(&format!("apt-get install {packages}"));
    }
    all
}

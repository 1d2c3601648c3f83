//! `examples/measured-motor` on the measured flux map: errors and costs of the full controller, a table and the surfaces, compared with `budget.txt`
//! and with the book.
//!
//! The steps are those of the example's README: fit the map, emit it, run the full controller in C, fit its answers, emit them. The programs run on
//! this host and on an emulated Cortex-M4F.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;

use rsm_core::check::Checked;
use rsm_core::compile;
use rsm_core::number::Precision;
use rsm_core::run::Interpreter;
use rsm_core::source::Source;
use rsm_core::tape::Tape;
use rsm_core::{emit, lower};
use rsm_fit::fit::fit;
use rsm_fit::spec::Specification;
use rsm_tests::cases;
use rsm_tests::compilers::{self, Compiler};

use crate::firmware::builds;
use crate::measured::flux_map;

/// The reference is the full controller in double.
const REFERENCE: &str = "gcc -std=gnu99 -O2 -Wall -Wextra -Wconversion -Wshadow -Werror -DOPTIMUM_DOUBLE";
const HOST: &str = "gcc -std=gnu99 -O2 -Wall -Wextra -Wconversion -Wdouble-promotion -Wshadow -Werror";

fn example() -> PathBuf {
    cases::root().join("examples").join("measured-motor")
}

/// Fits a specification of the example to the files of a folder.
fn fitted(specification: &str, folder: &Path) -> Checked {
    let source = Source::read(&example().join(specification)).unwrap_or_else(|faults| panic!("{faults}"));
    let specification = Specification::from_source(source, folder.to_path_buf()).unwrap_or_else(|faults| panic!("{faults}"));
    let outcome = fit(&specification, &mut |_| {}).unwrap_or_else(|refused| panic!("{refused}"));
    Checked::from_model(&outcome.model).unwrap_or_else(|faults| panic!("{faults}"))
}

fn write_c(unit: &emit::Unit, folder: &Path) {
    let files = emit::c::emit(unit);
    compilers::write(folder, &format!("{}.h", unit.model), &files.header);
    compilers::write(folder, &format!("{}.c", unit.model), &files.source);
}

/// Compiles C of the example and of a folder to one program there.
fn program(line: &str, folder: &Path, name: &str, sources: &[&str], last: &[&str]) -> PathBuf {
    let paths: Vec<String> = sources
        .iter()
        .map(|source| {
            let own = example().join(source);
            if own.exists() { own.display().to_string() } else { (*source).to_string() }
        })
        .collect();
    let includes = [folder, &example(), &builds::firmware()].map(|it| format!("-I{}", it.display()));
    let arguments: Vec<&str> = includes
        .iter()
        .map(String::as_str)
        .chain(["-o", name])
        .chain(paths.iter().map(String::as_str))
        .chain(last.iter().copied())
        .collect();
    Compiler::new(line).must(&arguments, folder);
    folder.join(name)
}

/// The output of a program for these bytes.
fn output(program: &Path, arguments: &[&str], input: &Path) -> String {
    let stdin = std::fs::File::open(input).expect("an input");
    let output = Command::new(program).args(arguments).stdin(Stdio::from(stdin)).output().expect("the program starts");
    assert!(output.status.success(), "{}: {}", program.display(), output.status);
    String::from_utf8(output.stdout).expect("ASCII")
}

/// A folder where everything is fitted, emitted and written, for the tests of this file.
fn made() -> Option<&'static Path> {
    static MADE: OnceLock<Option<PathBuf>> = OnceLock::new();
    MADE.get_or_init(|| {
        let data = flux_map()?;
        let folder = compilers::fresh(Path::new(env!("CARGO_TARGET_TMPDIR")), "measured-motor");
        let map = fitted("flux-map.toml", &data);
        std::fs::write(folder.join("flux_map.toml"), rsm_core::model_file::write(map.model())).expect("a folder of ours");
        write_c(&compile::unit_with_gradients(&map, &[]).unwrap(), &folder);
        let nothing = Path::new("/dev/null");
        for (name, text) in [("answers", "answers.csv"), ("reference", "reference.txt")] {
            let it = program(REFERENCE, &folder, name, &[&format!("{name}.c"), "optimum.c", "flux_map.c"], &["-lm"]);
            compilers::write(&folder, text, &output(&it, &[], nothing));
        }
        program(REFERENCE, &folder, "write_table", &["write_table.c", "optimum.c", "flux_map.c"], &["-lm"]);
        write_c(&compile::unit(&fitted("currents.toml", &folder), &[Precision::F32]).unwrap(), &folder);
        Some(folder)
    })
    .as_deref()
}

/// Errors of a controller: of the angle in degrees and of the torque in N m, each as mean, 99th percentile and largest; then its largest share of the
/// voltage limit and of the current limit.
#[derive(Debug, Clone, Copy)]
struct Errors {
    numbers: [f64; 8],
}

impl Errors {
    fn angle_mean(&self) -> f64 {
        self.numbers[0]
    }

    fn angle_p99(&self) -> f64 {
        self.numbers[1]
    }

    fn words(&self) -> String {
        self.numbers.map(|number| format!("{number:.3}")).join(" ")
    }
}

/// The errors of full controller in float, table with `side` points a side, and surfaces.
fn errors(folder: &Path, side: usize) -> [Errors; 3] {
    let table = output(&folder.join("write_table"), &[&side.to_string()], Path::new("/dev/null"));
    compilers::write(folder, "table.h", &table);
    let sources = ["compare.c", "optimum.c", "step.c", "table.c", "flux_map.c"];
    let compare = program(HOST, folder, "compare", &sources, &["-lm"]);
    let text = output(&compare, &[], &folder.join("reference.txt"));
    let found: Vec<Errors> = text
        .lines()
        .map(|line| {
            let numbers: Vec<f64> = line.split_whitespace().skip(1).map(|word| word.parse().expect("a number")).collect();
            Errors { numbers: numbers.try_into().expect("eight numbers") }
        })
        .collect();
    found.try_into().expect("three controllers")
}

/// Instructions over a grid of operating points: mean, least, most; and bytes of flash.
#[derive(Debug, Clone, Copy)]
struct Cost {
    mean: u32,
    least: u32,
    most: u32,
    flash: u32,
}

/// The cost of the full controller, the table of 33 points a side, and the surfaces on the emulated board.
fn costs(made: &Path) -> [Cost; 3] {
    let folder = made.join("board");
    std::fs::create_dir_all(&folder).expect("a folder of ours");
    let read = Source::read(&made.join("flux_map.toml")).and_then(|source| Checked::read(&source));
    let map = read.unwrap_or_else(|faults| panic!("{faults}"));
    write_c(&compile::unit_with_gradients(&map, &[Precision::F32]).unwrap(), &folder);
    for name in ["currents.h", "currents.c"] {
        std::fs::copy(made.join(name), folder.join(name)).expect("it was written");
    }
    let table = output(&made.join("write_table"), &["33"], Path::new("/dev/null"));
    compilers::write(&folder, "table.h", &table);
    let board = builds::firmware().join("qemu");
    // Without it a square root is a call in place of the instruction.
    let line = format!("{} -O2 -std=gnu99 -fno-math-errno -Wall -Wextra -Wconversion -Werror", builds::CORTEX_M4F);
    let startup = board.join("startup.c").display().to_string();
    let mut objects = vec![];
    let mut flash = |name: &str, source: &str| {
        program(&line, &folder, &format!("{name}.o"), &[source], &["-c"]);
        objects.push(format!("{name}.o"));
        builds::cortex_size(&folder.join(format!("{name}.o"))).0
    };
    let solver = flash("optimum", "optimum.c") + flash("flux_map", "flux_map.c");
    let table = flash("table", "table.c");
    let _ = flash("step", "step.c");
    // The evaluators are inlined there; as functions they stand in sections that the linker leaves out.
    let surface = builds::cortex_section(&folder.join("step.o"), ".text.step_currents");
    let _ = (flash("count", "count.c"), flash("startup", &startup));
    let script = format!("-T{}", board.join("mps2-an386.ld").display());
    let objects: Vec<&str> = objects.iter().map(String::as_str).collect();
    let last = ["-nostartfiles", "--specs=rdimon.specs", "-Wl,--gc-sections", &script, "-lm"];
    let text = builds::emulate(&program(&line, &folder, "count", &objects, &last), builds::SLOW);
    let found = [solver, table, surface].into_iter().zip(&text).map(|(flash, line)| {
        let numbers: Vec<u32> = line.split_whitespace().skip(1).map(|word| word.parse().expect("a number")).collect();
        Cost { mean: numbers[0], least: numbers[1], most: numbers[2], flash }
    });
    found.collect::<Vec<_>>().try_into().expect("three controllers")
}

const NAMES: [&str; 3] = ["full controller", "table 33 x 33", "surfaces"];

/// The smallest table whose error is not above one of the surfaces: points a side, bytes of its numbers.
fn table_of_equal_error(folder: &Path, error: fn(&Errors) -> f64) -> (usize, usize) {
    let side = (9..=97).step_by(4).find(|side| {
        let [_, table, surface] = errors(folder, *side);
        error(&table) <= error(&surface)
    });
    let side = side.expect("a large table has small errors");
    (side, 8 * side * side)
}

#[test]
fn the_surfaces_err_and_cost_what_the_budget_and_the_book_say() {
    let Some(folder) = made() else { return };
    let by_mean = table_of_equal_error(folder, Errors::angle_mean);
    let by_p99 = table_of_equal_error(folder, Errors::angle_p99);
    let errors = errors(folder, 33);
    let surface = errors[2];
    assert!(surface.angle_mean() < 1.0 && surface.angle_p99() < 3.0, "{surface:?}");
    // The currents of the solver in float are those of the solver in double: it has converged.
    assert!(errors[0].numbers[2] < 0.01 && errors[0].numbers[5] < 0.01, "{:?}", errors[0]);
    // Limits that a fit misses by this much are inside the 5 % of the voltage and the 7 % of the current that a drive keeps for control.
    assert!(surface.numbers[6] < 1.06 && surface.numbers[7] < 1.07, "{surface:?}");

    let mut text = String::from(
        "# The controllers of this example on the measured flux map. tests/all/measured_motor.rs writes it with RSM_BLESS=1, and compares.\n\
         # error: angle in degrees (mean, 99th percentile, largest), torque in N m (the same), largest share of the voltage limit and of the current limit.\n\
         # cost: instructions on a Cortex-M4F (mean, least, most), bytes of flash. arm-none-eabi-gcc 12.2 -O2.\n",
    );
    let mut rows = String::new();
    for (name, errors) in NAMES.iter().zip(&errors) {
        writeln!(text, "{name:<16} error {}", errors.words()).expect("text");
    }
    for (what, (side, bytes)) in [("mean", by_mean), ("99th percentile", by_p99)] {
        writeln!(text, "table of equal error of the angle, {what}: {side} x {side}, {bytes} bytes").expect("text");
    }
    if builds::emulated() {
        let costs = costs(folder);
        let [solver, _, own] = costs;
        // In the mean, and so also in the worst case, which counts for a loop.
        assert!(solver.mean >= 50 * own.most, "{solver:?} {own:?}");
        assert_eq!(own.least, own.most, "every input costs the same");
        // Smaller than the numbers alone of either table.
        assert!((own.flash as usize) < by_mean.1.min(by_p99.1), "{own:?} {by_mean:?} {by_p99:?}");
        for (name, Cost { mean, least, most, flash }) in NAMES.iter().zip(costs) {
            writeln!(text, "{name:<16} cost {mean} {least} {most} {flash}").expect("text");
        }
        for ((name, cost), errors) in NAMES.iter().zip(costs).zip(&errors) {
            let e = errors.numbers;
            writeln!(
                rows,
                "| {name} | {:.2} / {:.2} / {:.2} | {:.2} / {:.2} | {} | {} | {} |",
                e[0], e[1], e[2], e[3], e[4], cost.mean, cost.most, cost.flash
            )
            .expect("text");
        }
        let readme = std::fs::read_to_string(cases::root().join("README.md")).expect("the README");
        let most = format!("{},{:03}", solver.most / 1000, solver.most % 1000);
        let angle = format!("{:.2} degrees", surface.angle_mean());
        for figure in [format!("{} instructions", own.most), angle, format!("up to {most}")] {
            assert!(readme.contains(&figure), "README.md must say `{figure}`");
        }
    }
    println!("{text}\n{TITLES}\n{}\n{rows}", "| --- ".repeat(TITLES.matches(" |").count()) + "|");
    let path = example().join("budget.txt");
    if std::env::var_os("RSM_BLESS").is_some() && builds::emulated() {
        std::fs::write(&path, &text).expect("the budget can be written");
    }
    let budget = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    for line in text.lines() {
        let same = budget.lines().any(|allowed| agrees(allowed, line));
        assert!(same, "{}: no line agrees with `{line}`", path.display());
    }
    let book = std::fs::read_to_string(cases::root().join("docs/book/src/results/demo.md")).expect("a page of the book");
    for row in std::iter::once(TITLES).chain(rows.lines()) {
        assert!(book.lines().any(|line| line == row), "docs/book/src/results/demo.md must have the line\n{row}");
    }
}

/// The titles of the table in the book.
const TITLES: &str = "| controller | angle, deg: mean / p99 / largest | torque, N m: mean / p99 | instructions, mean | instructions, most | flash, bytes |";

/// Whole numbers are equal; errors may differ by the last digit that is printed, because the angles come from the C library.
fn agrees(allowed: &str, found: &str) -> bool {
    let (allowed, found): (Vec<&str>, Vec<&str>) = (allowed.split_whitespace().collect(), found.split_whitespace().collect());
    allowed.len() == found.len()
        && allowed.iter().zip(&found).all(|(a, b)| match (a.parse::<f64>(), b.parse::<f64>()) {
            (Ok(x), Ok(y)) if a.contains('.') => (x - y).abs() < 0.0015,
            _ => a == b,
        })
}

/// The map as the interpreter computes it: torque and flux linkage of currents.
struct Map<'t> {
    psi: [Interpreter<'t, f64>; 2],
}

/// The tapes of psi_d and psi_q.
fn tapes(path: &Path) -> [Tape; 2] {
    let read = Source::read(path).and_then(|source| Checked::read(&source));
    let checked = read.unwrap_or_else(|faults| panic!("{faults}"));
    [0, 1].map(|index| lower::surface(&checked, index, Precision::F64))
}

impl<'t> Map<'t> {
    fn new([d, q]: &'t [Tape; 2]) -> Map<'t> {
        Map { psi: [Interpreter::new(d), Interpreter::new(q)] }
    }

    fn torque_and_flux(&mut self, i_d: f64, i_q: f64) -> (f64, f64) {
        let [d, q] = &mut self.psi;
        let (d, q) = (d.eval(&[i_d, i_q]), q.eval(&[i_d, i_q]));
        (3.0 * (d * i_q - q * i_d), d.hypot(q))
    }
}

/// Numbers of `motor.h`.
const LIMIT_A: f64 = 18.67;
const VOLTAGE_V: f64 = 356.5;

/// The best currents of a fine grid, for this torque and this flux: of those that give the torque the least, else those of the most torque.
fn scanned(map: &mut Map<'_>, torque: f64, flux: f64) -> [f64; 3] {
    let mut least: Option<[f64; 3]> = None;
    let mut most = [0.0, 0.0, f64::NEG_INFINITY];
    for k in 0..=373 {
        let i_d = -0.05 * f64::from(k);
        let top = (LIMIT_A * LIMIT_A - i_d * i_d).max(0.0).sqrt();
        // Torque and flux both grow with i_q: the least i_q with the torque, and the most that the flux leaves.
        let mut first_where = |enough: &mut dyn FnMut(f64, f64) -> bool| {
            let (mut low, mut high) = (0.0, top);
            for _ in 0..40 {
                let middle = 0.5 * (low + high);
                let (torque, flux) = map.torque_and_flux(i_d, middle);
                if enough(torque, flux) { high = middle } else { low = middle }
            }
            high
        };
        let i_q_most = first_where(&mut |_, found| found > flux);
        let i_q = first_where(&mut |found, _| found >= torque);
        let (given, needed) = map.torque_and_flux(i_d, i_q);
        if given >= torque - 1e-6 && needed <= flux {
            let amplitude = i_d.hypot(i_q);
            if least.is_none_or(|best| amplitude < best[2]) {
                least = Some([i_d, i_q, amplitude]);
            }
        }
        let (given, needed) = map.torque_and_flux(i_d, i_q_most);
        if needed <= flux * (1.0 + 1e-9) && given > most[2] {
            most = [i_d, i_q_most, given];
        }
    }
    least.unwrap_or(most)
}

/// Compares answers of the full controller with a scan: less current or more torque must not be possible. Returns how often the torque was reached.
fn compare_with_scan(map: &mut Map<'_>, answers: &str) -> [usize; 2] {
    let mut given = [0, 0];
    for line in answers.lines() {
        let numbers: Vec<f64> = line.split_whitespace().map(|word| word.parse().expect("a number")).collect();
        let [torque, speed, i_d, i_q] = numbers[..] else { panic!("{line}") };
        let (torque, i_q) = (torque.abs(), i_q.abs());
        let limit = VOLTAGE_V / (2.0 * speed).max(1.0);
        let (found, flux) = map.torque_and_flux(i_d, i_q);
        // The solver stops when its last step is below a milliampere.
        assert!(flux <= limit * 1.0001 && i_d.hypot(i_q) <= LIMIT_A * 1.0001, "{line}: flux {flux} of {limit}");
        let best = scanned(map, torque, limit);
        let is_given = found > torque - 1e-3;
        given[usize::from(is_given)] += 1;
        // The grid steps by 0.05 A in i_d: near an optimum that is nothing of its value, at a limit 0.05 A, or the torque of it.
        if is_given {
            assert!((i_d.hypot(i_q) - best[2]).abs() < 0.06, "{line}: {best:?}");
            assert!(i_d.hypot(i_q) < best[2] + 2e-3, "{line}: {best:?}");
        } else {
            assert!((found - best[2]).abs() < 0.2 && found > best[2] - 5e-3, "{line}: {found} {best:?}");
        }
    }
    given
}

#[test]
fn the_full_controller_has_the_currents_that_a_scan_of_the_map_finds() {
    let Some(folder) = made() else { return };
    let reference = std::fs::read_to_string(folder.join("reference.txt")).expect("it was written");
    // 100 of 10,000: a scan is 30,000 evaluations of the map.
    let some: Vec<&str> = reference.lines().step_by(100).collect();
    let given = compare_with_scan(&mut Map::new(&tapes(&folder.join("flux_map.toml"))), &some.join("\n"));
    assert!(given.iter().all(|count| *count > 15), "{given:?}");
}

/// A motor whose characteristic current of 10 A is inside the current limit operates at maximum torque per volt at high speed. No measured data are
/// needed for this test.
#[test]
fn the_full_controller_finds_maximum_torque_per_volt_where_a_motor_has_it() {
    let folder = compilers::fresh(Path::new(env!("CARGO_TARGET_TMPDIR")), "measured-motor-linear");
    let inputs = "format = 1\nmodel = \"flux_map\"\n[inputs.i_d]\nunit = \"A\"\nrange = [-20.0, 20.0]\n[inputs.i_q]\nunit = \"A\"\nrange = [-26.0, 26.0]\n";
    let text = format!(
        "{inputs}[surfaces.psi_d]\nunit = \"V*s\"\ninputs = [\"i_d\", \"i_q\"]\nterms = [{{ powers = [0, 0], coefficient = 0.3 }}, {{ powers = [1, 0], coefficient = 0.6 }}]\n\
         [surfaces.psi_q]\nunit = \"V*s\"\ninputs = [\"i_d\", \"i_q\"]\nterms = [{{ powers = [0, 1], coefficient = 1.5 }}]\n"
    );
    compilers::write(&folder, "flux_map.toml", &text);
    let checked = Checked::read(&Source::new("flux_map.toml", text)).unwrap();
    write_c(&compile::unit_with_gradients(&checked, &[]).unwrap(), &folder);
    let it = program(REFERENCE, &folder, "reference", &["reference.c", "optimum.c", "flux_map.c"], &["-lm"]);
    let reference = output(&it, &[], Path::new("/dev/null"));
    let some: Vec<&str> = reference.lines().step_by(100).collect();
    let given = compare_with_scan(&mut Map::new(&tapes(&folder.join("flux_map.toml"))), &some.join("\n"));
    assert!(given.iter().all(|count| *count > 15), "{given:?}");
    // Inside both limits of a point without the torque: only maximum torque per volt is there.
    let inside = some.iter().filter(|line| {
        let numbers: Vec<f64> = line.split_whitespace().map(|word| word.parse().expect("a number")).collect();
        numbers[2].hypot(numbers[3]) < 0.99 * LIMIT_A && numbers[1] > 400.0 && numbers[0].abs() > 25.0
    });
    assert!(inside.count() > 5);
}

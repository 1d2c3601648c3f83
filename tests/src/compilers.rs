//! The compilers of this machine, and what they make of emitted text.
//!
//! In: units and options. Out: shared objects and object files in a scratch folder of the caller, or what the compiler said when it
//! refused. A compiler that is missing is a failure that names the package to install.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use rsm_core::emit::{self, Function, Kind, Unit};
use rsm_core::names;
use rsm_core::number::Precision;

/// One way of compiling.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Compiler {
    /// The program.
    pub program: String,
    /// Its options.
    pub options: Vec<String>,
}

impl Compiler {
    /// From a command line such as `gcc -std=c99 -O2`.
    ///
    /// # Panics
    /// On an empty line.
    #[must_use]
    pub fn new(line: &str) -> Self {
        let mut words = line.split_whitespace().map(str::to_string);
        let program = words.next().expect("a program");
        Compiler { program, options: words.collect() }
    }

    /// The command line.
    #[must_use]
    pub fn name(&self) -> String {
        format!("{} {}", self.program, self.options.join(" "))
    }

    /// Runs the compiler.
    ///
    /// # Panics
    /// When it cannot be started.
    pub fn run(&self, arguments: &[&str], folder: &Path) -> Output {
        let mut command = Command::new(&self.program);
        command.args(&self.options).args(arguments).current_dir(folder);
        command
            .output()
            .unwrap_or_else(|error| panic!("cannot start {}: {error}; apt-get install {}", self.program, self.program))
    }

    /// Runs the compiler, which must succeed.
    ///
    /// # Panics
    /// With what it said, when it does not.
    pub fn must(&self, arguments: &[&str], folder: &Path) {
        let output = self.run(arguments, folder);
        assert!(
            output.status.success(),
            "{} {} failed in {}\n{}",
            self.name(),
            arguments.join(" "),
            folder.display(),
            String::from_utf8_lossy(&output.stderr)
        );
    }
}

/// An empty folder below a scratch folder.
///
/// # Panics
/// When it cannot be made.
#[must_use]
pub fn fresh(scratch: &Path, name: &str) -> PathBuf {
    let folder = scratch.join(name);
    if folder.exists() {
        std::fs::remove_dir_all(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    }
    std::fs::create_dir_all(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    folder
}

/// A folder below a scratch folder for sources and what compilers make of them. What an earlier run has made stays if `write` writes the same
/// sources again.
///
/// # Panics
/// When it cannot be made.
#[must_use]
pub fn kept(scratch: &Path, name: &str, write: impl FnOnce(&Path)) -> PathBuf {
    let folder = scratch.join(name);
    std::fs::create_dir_all(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let before = sources(&folder);
    write(&folder);
    if sources(&folder) != before {
        let made = |path: &PathBuf| path.extension().is_some_and(|it| it == "so" || it == "made");
        for path in files(&folder).into_iter().filter(made) {
            std::fs::remove_file(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        }
    }
    folder
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    files.sort();
    files
}

/// The texts of a folder, with their names.
fn sources(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let is_source = |path: &PathBuf| path.extension().is_some_and(|it| it == "c" || it == "h" || it == "rs");
    let text = |path: PathBuf| {
        let text = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        (path, text)
    };
    files(folder).into_iter().filter(is_source).map(text).collect()
}

/// Makes a shared object in a folder of [`kept`], unless this compiler has made it there from these sources.
pub fn once(compiler: &Compiler, folder: &Path, name: &str, make: impl FnOnce() -> PathBuf) -> PathBuf {
    let version = compiler.run(&["--version"], folder).stdout;
    // What `native` means.
    let processor = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let flags = processor.lines().find(|line| line.starts_with("flags")).unwrap_or_default();
    let maker = format!("{}\n{}\n{flags}", compiler.name(), String::from_utf8_lossy(&version));
    let (made, library) = (folder.join(format!("{name}.made")), folder.join(format!("{name}.so")));
    if library.is_file() && std::fs::read_to_string(&made).is_ok_and(|text| text == maker) {
        return library;
    }
    let library = make();
    std::fs::write(&made, maker).unwrap_or_else(|error| panic!("{}: {error}", made.display()));
    library
}

/// Writes a file.
///
/// # Panics
/// When it cannot.
pub fn write(folder: &Path, name: &str, text: &str) {
    std::fs::write(folder.join(name), text).unwrap_or_else(|error| panic!("{name}: {error}"));
}

/// Writes the emitted C of some models into a folder, and `models.c`, which includes every source.
pub fn write_c<'u>(units: impl IntoIterator<Item = &'u Unit>, folder: &Path) {
    let (mut sources, mut batches) = (String::new(), String::from(EXPORT));
    let mut names: Vec<String> = vec![];
    for unit in units {
        names.push(unit.model.clone());
        let files = emit::c::emit(unit);
        write(folder, &format!("{}.h", unit.model), &files.header);
        write(folder, &format!("{}.c", unit.model), &files.source);
        writeln!(sources, "#include \"{}.c\"", unit.model).expect("text");
        writeln!(batches, "#include \"{}.h\"", unit.model).expect("text");
        for function in &unit.functions {
            let float = if function.tape.precision == Precision::F64 { "double" } else { "float" };
            let arity = function.inputs.len();
            let arguments: Vec<String> = (0..arity).map(|k| format!("x[i * {arity} + {k}]")).collect();
            let (model, name) = (&unit.model, function.rust_name());
            let (mut state, mut pass) = (String::new(), "");
            if function.has_state() {
                let (compensator, precision) = (&function.surface, function.tape.precision);
                let state_type = names::c_state(model, compensator, precision);
                state = format!("{state_type} state; {}(&state); ", names::c_init(model, compensator, precision));
                pass = "&state, ";
            }
            let results = function.tape.outputs.len();
            let call = format!("{}({pass}{}", function.c_name(model), arguments.join(", "));
            let call = if function.has_results() {
                format!("{call}, y + i * {results});")
            } else {
                format!("y[i] = ({float}){call});")
            };
            writeln!(
                batches,
                "RSM_TESTS_EXPORT void batch_{model}_{name}(const {float} *x, {float} *y, size_t n);\n\
                 void batch_{model}_{name}(const {float} *x, {float} *y, size_t n)\n\
                 {{\n    size_t i;\n    {state}for (i = 0; i < n; i++) {{ {call} }}\n}}"
            )
            .expect("text");
        }
    }
    let models: Vec<&str> = names.iter().map(String::as_str).collect();
    write(folder, "self_tests.c", &self_tests(&models));
    // The caller sees the sources: a compiler may inline every function into the loop that calls it.
    write(folder, "unity.c", "#include \"models.c\"\n#include \"batches.c\"\n#include \"self_tests.c\"\n");
    // One translation unit: 36 starts of a compiler less, and the helpers of the sources must get along with each other. The calls are in
    // another one, so that functions are compiled as a user compiles them.
    write(folder, "models.c", &sources);
    write(folder, "batches.c", &batches);
}

/// Batch functions are found in a shared object also where everything else is hidden, as in a program: what is visible cannot be inlined by gcc.
const EXPORT: &str = "#include <stddef.h>\n#define RSM_TESTS_EXPORT __attribute__((visibility(\"default\")))\n";

/// `int self_tests(void)`: the failures of the self-tests of all models.
fn self_tests(models: &[&str]) -> String {
    let mut text = String::from("#if defined(RSM_SELF_TEST)\n");
    for model in models {
        writeln!(text, "#include \"{model}.h\"").expect("text");
    }
    let sum: Vec<String> = models.iter().map(|model| format!("{model}_self_test()")).collect();
    let declaration = "__attribute__((visibility(\"default\"))) int self_tests(void)";
    writeln!(text, "{declaration};\n{declaration}\n{{\n    return {};\n}}\n#endif", sum.join(" + ")).expect("text");
    text
}

/// Every C compiler of a family (`gcc`, `clang`) on the search path: the family's name, then every numbered one that is another program.
///
/// # Panics
/// When the family's own name is missing.
#[must_use]
pub fn installed(family: &str) -> Vec<String> {
    let mut found: Vec<(String, PathBuf)> = vec![];
    let path = std::env::var_os("PATH").unwrap_or_default();
    let mut numbered: Vec<(u32, PathBuf)> = vec![];
    for folder in std::env::split_paths(&path) {
        let own = folder.join(family);
        if found.is_empty() && own.is_file() {
            found.push((family.to_string(), own.canonicalize().unwrap_or(own)));
        }
        let entries = std::fs::read_dir(&folder).into_iter().flatten().flatten();
        numbered.extend(entries.filter_map(|entry| {
            let name = entry.file_name().to_string_lossy().into_owned();
            let number = name.strip_prefix(family)?.strip_prefix('-')?.parse().ok()?;
            Some((number, entry.path()))
        }));
    }
    assert!(!found.is_empty(), "{family} is not on the search path; apt-get install {family}");
    numbered.sort();
    for (number, program) in numbered {
        let program = program.canonicalize().unwrap_or(program);
        if found.iter().all(|(_, known)| *known != program) {
            found.push((format!("{family}-{number}"), program));
        }
    }
    found.into_iter().map(|(name, _)| name).collect()
}

/// Compiles what [`write_c`] wrote to a shared object.
#[must_use]
pub fn c_library(compiler: &Compiler, folder: &Path, name: &str) -> PathBuf {
    let file = folder.join(format!("{name}.so"));
    let out = file.display().to_string();
    compiler.must(&["-shared", "-fPIC", "-DRSM_SELF_TEST", "-o", &out, "models.c", "batches.c"], folder);
    file
}

/// The Rust compiler that compiles this package.
#[must_use]
pub fn rustc(options: &str) -> Compiler {
    let mut compiler = Compiler::new(&format!("rustc --edition 2024 {options}"));
    compiler.program = env!("RSM_TESTS_RUSTC").to_string();
    compiler
}

/// Writes the emitted Rust of some models into a folder, and `models.rs`, a crate that has them as modules and exports a batch function
/// for each evaluator.
pub fn write_rust<'u>(units: impl IntoIterator<Item = &'u Unit>, folder: &Path) {
    let (mut modules, mut batches) = (String::new(), String::new());
    for unit in units {
        let model = &unit.model;
        write(folder, &format!("{model}.rs"), &emit::rust::emit(unit));
        writeln!(modules, "mod {model};").expect("text");
        for function in &unit.functions {
            batches.push_str(&rust_batch(model, function));
        }
    }
    write(folder, "models.rs", &format!("#![deny(warnings)]\n{modules}\n{batches}"));
}

fn rust_batch(model: &str, function: &Function) -> String {
    let float = function.tape.precision.name();
    let arity = function.inputs.len();
    let arguments: Vec<String> = (0..arity).map(|k| format!("*x.add(i * {arity} + {k})")).collect();
    let name = function.rust_name();
    let conversion = if function.kind == Kind::Support { format!(" as {float}") } else { String::new() };
    let (mut state, mut pass) = (String::new(), "");
    if function.has_state() {
        let init = names::rust_init(&function.surface, function.tape.precision);
        let is_read = function.kind == Kind::Adapted;
        state = format!("    let {}state = {model}::{init}();\n", if is_read { "" } else { "mut " });
        pass = if is_read { "&state, " } else { "&mut state, " };
    }
    let place = if function.has_results() {
        format!("*y.cast::<[{float}; {}]>().add(i)", function.tape.outputs.len())
    } else {
        "*y.add(i)".to_string()
    };
    format!(
        "/// # Safety\n/// `x` has `n` rows, `y` room for `n` rows of results.\n#[unsafe(no_mangle)]\n\
         pub unsafe extern \"C\" fn batch_{model}_{name}(x: *const {float}, y: *mut {float}, n: usize) {{\n{state}    \
             for i in 0..n {{ unsafe {{ {place} = {model}::{name}({pass}{}){conversion}; }} }}\n}}\n",
        arguments.join(", ")
    )
}

/// Compiles what [`write_rust`] wrote to a shared object.
#[must_use]
pub fn rust_library(options: &str, folder: &Path, name: &str) -> PathBuf {
    let file = folder.join(format!("{name}.so"));
    rustc(options)
        .must(&["--crate-type", "cdylib", "--crate-name", name, "-o", &file.display().to_string(), "models.rs"], folder);
    file
}

/// The symbols of a unit's functions in C, with the functions.
#[must_use]
pub fn c_symbols(unit: &Unit) -> Vec<(String, &Function)> {
    unit.functions
        .iter()
        .map(|function| (names::c_function(&unit.model, &function.surface, function.kind, function.tape.precision), function))
        .collect()
}

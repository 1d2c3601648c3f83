//! Emitted code compiles without a warning, with all warnings turned on.

use std::path::Path;

use rsm_tests::cases::{self, Case};
use rsm_tests::compilers::{self, Compiler};

const GCC: &str = "-pedantic -Wall -Wextra -Wconversion -Wdouble-promotion -Wfloat-equal -Wshadow -Wcast-qual -Wundef -Werror";

/// Warnings that exist for C only.
const GCC_C: &str = "-Wstrict-prototypes -Wmissing-prototypes";

/// All warnings of clang except three: a declaration after a statement is allowed in C99, which is our language (older clangs warn of it because of
/// C90); the two about buffers require bounds-checked C++ containers, which C does not have.
const CLANG: &str = "-Weverything -Wno-declaration-after-statement -Wno-unknown-warning-option -Wno-unsafe-buffer-usage \
                     -Wno-unsafe-buffer-usage-in-libc-call -Werror";

/// The random models have every helper and every kind of argument; the checked-in ones are what users see first.
fn all_cases() -> Vec<Case> {
    cases::random().into_iter().chain(cases::checked_in()).collect()
}

#[test]
fn c_compiles_without_a_warning() {
    let folder = compilers::fresh(Path::new(env!("CARGO_TARGET_TMPDIR")), "warnings-c");
    let cases = all_cases();
    compilers::write_c(cases.iter().map(|case| &case.unit), &folder);
    let sources: Vec<String> = cases.iter().map(|case| format!("{}.c", case.unit.model)).collect();
    let arguments: Vec<&str> = ["-c"].into_iter().chain(sources.iter().map(String::as_str)).collect();
    for line in [
        format!("gcc -std=c99 -O2 {GCC} {GCC_C}"),
        format!("gcc -std=c99 -O2 {GCC} {GCC_C} -DRSM_SELF_TEST"),
        format!("gcc -std=gnu17 -O2 -march=native {GCC} {GCC_C} -DRSM_SELF_TEST"),
        format!("clang -std=c99 -O2 {CLANG} -DRSM_SELF_TEST"),
        format!("clang -std=c11 -O2 -mavx2 {CLANG}"),
        format!("g++ -std=c++11 -x c++ -O2 {GCC} -DRSM_SELF_TEST"),
    ] {
        Compiler::new(&line).must(&arguments, &folder);
    }
}

#[test]
fn headers_are_includable_alone_and_from_c_plus_plus() {
    let folder = compilers::fresh(Path::new(env!("CARGO_TARGET_TMPDIR")), "warnings-headers");
    let cases = all_cases();
    compilers::write_c(cases.iter().map(|case| &case.unit), &folder);
    for case in &cases {
        let model = &case.unit.model;
        // Twice, and before anything else.
        compilers::write(
            &folder,
            "alone.c",
            &format!("#include \"{model}.h\"\n#include \"{model}.h\"\nextern int x;\nint x;\n"),
        );
        Compiler::new(&format!("gcc -std=c99 {GCC} {GCC_C}")).must(&["-fsyntax-only", "alone.c"], &folder);
        Compiler::new(&format!("g++ -std=c++11 -x c++ {GCC}")).must(&["-fsyntax-only", "alone.c"], &folder);
    }
    // C++ finds the functions by their C names.
    let unit = &cases[0].unit;
    let (symbol, function) = compilers::c_symbols(unit).swap_remove(0);
    let arguments = vec!["0.5"; function.inputs.len()].join(", ");
    let text = format!("#include \"{}.h\"\nint main() {{ return {symbol}({arguments}) > 1e300; }}\n", unit.model);
    compilers::write(&folder, "user.cpp", &text);
    Compiler::new("gcc -std=c99 -O2").must(&["-c", &format!("{}.c", unit.model)], &folder);
    Compiler::new("g++ -std=c++11 -O2").must(&["user.cpp", &format!("{}.o", unit.model), "-o", "user"], &folder);
}

#[test]
fn rust_compiles_without_a_warning_and_without_std() {
    let folder = compilers::fresh(Path::new(env!("CARGO_TARGET_TMPDIR")), "warnings-rust");
    let cases = all_cases();
    compilers::write_rust(cases.iter().map(|case| &case.unit), &folder);
    for case in &cases {
        let model = &case.unit.model;
        let library = format!(
            "//! A user's library.\n#![no_std]\n#![deny(warnings, missing_docs, unsafe_code)]\n/// The model.\npub mod {model};\n"
        );
        compilers::write(&folder, "user.rs", &library);
        compilers::rustc("--crate-type lib").must(&["user.rs"], &folder);
    }
    // Through include!, in a private module of which one function is used.
    let unit = &cases[0].unit;
    let function = &unit.functions[0];
    let arguments = vec!["0.5"; function.inputs.len()].join(", ");
    let text = format!(
        "#![deny(warnings)]\nmod model {{\n    include!(\"{}.rs\");\n}}\nfn main() {{\n    println!(\"{{}}\", model::{}({arguments}));\n}}\n",
        unit.model,
        function.rust_name()
    );
    compilers::write(&folder, "included.rs", &text);
    compilers::rustc("").must(&["included.rs"], &folder);
}

#[test]
fn emitted_text_is_ascii_ends_with_a_newline_and_does_not_change() {
    for (case, again) in all_cases().iter().zip(all_cases()) {
        let c = rsm_core::emit::c::emit(&case.unit);
        let rust = rsm_core::emit::rust::emit(&case.unit);
        assert_eq!(c, rsm_core::emit::c::emit(&again.unit));
        assert_eq!(rust, rsm_core::emit::rust::emit(&again.unit));
        for text in [&c.header, &c.source, &rust] {
            assert!(text.is_ascii() && text.ends_with('\n') && !text.ends_with("\n\n"), "{}", case.unit.model);
            assert!(text.contains("generated by rsm") && text.contains("Do not edit"));
            assert!(text.lines().all(|line| line.trim_end() == line), "{}: blanks at the end of a line", case.unit.model);
        }
    }
}

//! A name that the rules accept is not a macro of a C compiler. The test gets the macros from the compilers.

use std::collections::BTreeSet;
use std::path::Path;

use rsm_core::names;
use rsm_tests::compilers::{self, Compiler};

/// Every macro that the headers of emitted C define, or a compiler by itself, in the languages in which it may be compiled.
fn macros() -> BTreeSet<String> {
    let folder = compilers::fresh(Path::new(env!("CARGO_TARGET_TMPDIR")), "names");
    compilers::write(&folder, "headers.c", "#include <float.h>\n#include <stdint.h>\n#include <string.h>\n");
    let mut found = BTreeSet::new();
    for compiler in ["gcc", "clang"].iter().flat_map(|family| compilers::installed(family)) {
        // A numbered gcc may come without its C++.
        let is_plain = !compiler.contains('-');
        let c_plus_plus = is_plain.then_some("-x c++ -std=gnu++17");
        for language in ["-std=c99", "-std=gnu17", "-std=gnu2x", "-std=c99 -D_GNU_SOURCE"].into_iter().chain(c_plus_plus) {
            let output = Compiler::new(&format!("{compiler} {language}")).run(&["-E", "-dM", "headers.c"], &folder);
            assert!(output.status.success(), "{compiler} {language}: {}", String::from_utf8_lossy(&output.stderr));
            let text = String::from_utf8_lossy(&output.stdout).into_owned();
            let of_line = |line: &str| line.strip_prefix("#define ")?.split([' ', '(']).next().map(str::to_string);
            found.extend(text.lines().filter_map(of_line));
        }
    }
    found
}

#[test]
fn no_macro_of_the_headers_passes_as_a_name() {
    let macros = macros();
    for known in ["DBL_MAX", "FLT_RADIX", "INT32_MAX", "unix"] {
        assert!(macros.contains(known), "the compilers do not tell of {known}");
    }
    let passing: Vec<&String> = macros.iter().filter(|name| names::refuse(name).is_none()).collect();
    assert!(passing.is_empty(), "{passing:?}");
}

#[test]
fn ordinary_names_in_capitals_pass() {
    for name in ["INT", "INT_TEMP", "MAX", "SIZE", "SIZE_A", "M_D", "UINT8", "Ud", "FLOAT_MAX", "DBLX_1", "DEC"] {
        assert_eq!(names::refuse(name), None, "{name}");
    }
}

//! With options that do not keep IEEE 754 the emitted C does not compile, and says why. The self-test detects the options that the preprocessor
//! cannot see.

use std::path::{Path, PathBuf};

use rsm_tests::backend::Loaded;
use rsm_tests::cases;
use rsm_tests::compilers::{self, Compiler};

/// One random model has every helper; which one does not matter.
fn folder(name: &str) -> (PathBuf, String) {
    let folder = compilers::fresh(Path::new(env!("CARGO_TARGET_TMPDIR")), name);
    let case = cases::random().into_iter().next().expect("there are models");
    compilers::write_c([&case.unit], &folder);
    (folder, case.unit.model)
}

fn refusal(line: &str, folder: &Path, model: &str) -> String {
    let output = Compiler::new(line).run(&["-c", &format!("{model}.c"), "-o", "refused.o"], folder);
    assert!(!output.status.success(), "{line} compiles");
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn fast_math_does_not_compile() {
    let (folder, model) = folder("refuses-fast-math");
    for line in [
        "gcc -O2 -ffast-math",
        "gcc -Ofast",
        "gcc -O2 -funsafe-math-optimizations",
        "gcc -O2 -ffinite-math-only",
        "gcc -O2 -fassociative-math -fno-signed-zeros -fno-trapping-math",
        "gcc -O2 -freciprocal-math",
        "gcc -O2 -fno-signed-zeros",
        "clang -O2 -ffast-math",
        "clang -Ofast",
        "clang -O2 -ffinite-math-only",
        "clang -O2 -ffp-model=fast",
    ] {
        let said = refusal(line, &folder, &model);
        assert!(
            said.contains("-ffast-math, -Ofast and the options that they are made of change the results"),
            "{line}\n{said}"
        );
    }
}

#[test]
fn excess_precision_does_not_compile() {
    let (folder, model) = folder("refuses-excess");
    // -m32 has the x87 unit by default; no C library for it is needed, the source includes only headers of the compiler.
    for line in ["gcc -O2 -mfpmath=387", "gcc -O2 -m32 -ffreestanding", "clang -O2 -m32 -mno-sse -ffreestanding"] {
        let said = refusal(line, &folder, &model);
        assert!(said.contains("the x87 unit rounds twice"), "{line}\n{said}");
        assert!(said.contains("float is evaluated with excess precision"), "{line}\n{said}");
    }
}

#[test]
fn constants_in_single_precision_do_not_compile() {
    let (folder, model) = folder("refuses-single");
    let said = refusal("gcc -O2 -fsingle-precision-constant", &folder, &model);
    assert!(said.contains("rsm_constants_are_double"), "{said}");
}

#[test]
fn self_test_passes_where_the_bits_are_kept_and_fails_where_they_are_not() {
    let folder = compilers::fresh(Path::new(env!("CARGO_TARGET_TMPDIR")), "self-test");
    let cases = cases::random();
    compilers::write_c(cases.iter().map(|case| &case.unit), &folder);
    // As with a compiler that has no barrier, or that fuses in spite of it.
    let without_barrier = "gcc -O2 -mfma -ffp-contract=fast -DRSM_BARRIER(product)=(product)";
    for (line, keeps) in [("gcc -O2", true), ("clang -O2 -mfma -ffp-contract=fast", true), (without_barrier, false)] {
        let library = compilers::c_library(&Compiler::new(line), &folder, if keeps { &line[..3] } else { "fused" });
        let library = Loaded::open(line, &library);
        for case in &cases {
            let model = &case.unit.model;
            let failures = library.call(&format!("{model}_self_test"));
            let source = std::fs::read_to_string(folder.join(format!("{model}.c"))).expect("written above");
            let can_tell = source.contains("other bits if fused");
            assert_eq!(failures == 0, keeps || !can_tell, "{line}: {model}_self_test gives {failures}");
        }
    }
}

#[test]
fn nearly_every_self_test_can_tell_a_fused_operation() {
    // A model of clamps alone has none; the random ones have products that feed sums.
    let cases = cases::every_random();
    let can_tell =
        cases.iter().filter(|case| rsm_core::emit::c::emit(&case.unit).source.contains("other bits if fused")).count();
    assert!(can_tell * 10 >= cases.len() * 9, "{can_tell} of {}", cases.len());
}

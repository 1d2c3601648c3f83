use rsm_core::source::{Collector, Source};

use super::tree::{EquationKind, Kind};
use super::{read, tree};

fn good(text: &str) -> tree::Text {
    let mut faults = Collector::new();
    let read = read(&Source::new("m.mo", text), &mut faults);
    faults.finish(Some(read)).unwrap_or_else(|faults| panic!("{faults}"))
}

/// The faults of a text.
fn told(text: &str) -> String {
    let mut faults = Collector::new();
    read(&Source::new("m.mo", text), &mut faults);
    faults.finish(Some(())).unwrap_err().to_string()
}

/// A model with these equations.
fn with(equations: &str) -> String {
    format!("model M\n  Real x;\nequation\n{equations}\nend M;\n")
}

#[test]
fn both_forms_of_a_package_are_read() {
    let bare = good("// rumoca\n\nmodel M\n  Real motor.w(start = 0.0);\nequation\n  der(motor.w) = 1;\nend M;\n");
    let quoted = good(
        "//! base 0.1.0\npackage 'M'\n  type 'V' = Real(unit = \"V\");\n  constant Real 'g' = 9.81;\n  function 'f'\n    input Real 'a';\n    \
         output Real 'b';\n  algorithm\n    'b' := 'a'^2;\n  end 'f';\n  model 'M' \"m\"\n    Real[3] 'motor.w'(each start = 0.0) \"w\" \
         annotation(Evaluate = false);\n  initial equation\n    'motor.w' = {1.0, 2.0, 3.0};\n  equation\n    der('motor.w') = 1 @3;\n    \
         annotation(experiment(StopTime = 1.0));\n  end 'M';\nend 'M';\n",
    );
    assert_eq!(bare.models[0].declarations[0].name, "motor.w");
    assert_eq!(quoted.models[0].declarations[0].name, "motor.w");
    assert_eq!(quoted.models[0].description, "m");
    assert_eq!((quoted.types.len(), quoted.functions.len(), quoted.constants.len()), (1, 1, 1));
    assert_eq!((quoted.models[0].equations.len(), quoted.models[0].initial_equations.len()), (1, 1));
}

#[test]
fn operators_bind_as_the_language_has_it() {
    let text = good(&with("  x = -2*x^2 + x/3/4;"));
    let EquationKind::Equal(_, right) = &text.models[0].equations[0].kind else { panic!("an equation") };
    let Kind::Sum(terms) = &right.kind else { panic!("a sum") };
    assert_eq!(terms.iter().map(|(is_minus, _)| *is_minus).collect::<Vec<_>>(), [true, false]);
    // Minus applies to the whole product.
    let Kind::Product(first) = &terms[0].1.kind else { panic!("a product") };
    assert!(matches!(first[0].1.kind, Kind::Number(..)) && matches!(first[1].1.kind, Kind::Power(..)));
    let Kind::Product(second) = &terms[1].1.kind else { panic!("a product") };
    assert_eq!(second.len(), 3);
}

#[test]
fn every_fault_is_told_at_once_with_its_place() {
    let text = "model M\n  Real x = ;\n  flow Real y;\n  Real ok;\nequation\n  x = 1 +;\n  ok = 2;\n  x := 3;\n  connect(a, b);\n  \
                if x > 1 then\n    x = * 2;\n  end if;\nend N;\n";
    let told = told(text);
    for place in [
        "m.mo:2:12: found `;`",
        "m.mo:3:3: `flow`",
        "m.mo:6:10: found `;`",
        "m.mo:8:5: found `:=`",
        "m.mo:9:3: `connect`",
        "m.mo:11:9: found `*`",
        "m.mo:13:5: found `end N`",
    ] {
        assert!(told.contains(place), "{place} is missing in\n{told}");
    }
    assert_eq!(told.matches("m.mo:").count(), 7, "{told}");
}

#[test]
fn what_is_not_read_says_what_to_do_instead() {
    for (text, construct, advice) in [
        ("package P\nrecord R\n Real a;\nend R;\nmodel M\nend M;\nend P;", "`record`", "variables"),
        ("operator record R\n Real a;\nend R;", "operator record", "equations"),
        ("function f\n input Real a;\n output Real b;\nexternal \"C\";\nend f;", "external", "response surface"),
        ("type E = enumeration(a, b);", "enumeration", "Integer"),
        ("model M\nClock c;\nend M;", "clocks", "sample"),
        ("model M\nReal x;\nalgorithm\n x := 1;\nend M;", "algorithm", "equations"),
        ("model M\nReal x if true;\nend M;", "conditional", "if-expressions"),
        ("model M\nparameter equation guess(x) = 1;\nend M;", "parameter equation", "value"),
        ("model M\nextends N;\nend M;", "extends", "flatten"),
        ("block M\nend M;", "block", "`model`"),
        (
            "function f\n input Real a;\n output Real b;\nalgorithm\n while a > 1 loop\n b := 1;\n end while;\nend f;",
            "while",
            "`for`",
        ),
        ("model M\nReal x;\nequation\n x = a*-2;\nend M;", "`-`", "parentheses"),
        ("model M\nReal x;\nequation\n x = 2^3^4;\nend M;", "power", "parentheses"),
    ] {
        let told = told(text);
        assert!(told.contains(construct) && told.contains(advice), "{text}\n{told}");
    }
}

#[test]
fn a_text_without_end_is_a_fault_and_not_a_hang() {
    for text in [
        "",
        "model",
        "model M",
        "model M Real x",
        "model M equation if",
        "package P",
        "/* ",
        "model M equation x = (((",
        "end end end",
    ] {
        let mut faults = Collector::new();
        read(&Source::new("m.mo", text), &mut faults);
        assert_eq!(faults.is_clean(), text.is_empty(), "{text}");
    }
    let deep = with(&format!("  x = {}1{};", "(".repeat(5000), ")".repeat(5000)));
    assert!(told(&deep).contains("levels"));
    // Sums are lists, so a long sum has a small depth.
    good(&with(&format!("  x = {}1;", "x + ".repeat(50_000))));
}

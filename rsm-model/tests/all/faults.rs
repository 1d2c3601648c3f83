//! The messages for a system that cannot be solved.

use rsm_core::source::Source;
use rsm_model::flat::{Flat, Options};
use rsm_model::system::System;

fn told(declarations: &str, equations: &str) -> String {
    let text = format!("model M\n{declarations}\nequation\n{equations}\nend M;\n");
    let flat = Flat::read(&Source::new("m.mo", text), &Options::default()).unwrap_or_else(|faults| panic!("{faults}"));
    match System::new(&flat) {
        Ok(mut system) => system.start(&[], &[]).map(|_| ()).unwrap_err().to_string(),
        Err(faults) => faults.to_string(),
    }
}

#[test]
fn an_unknown_without_an_equation_is_named() {
    let told = told("  Real x, y;\n  Real z;\n  discrete Real u;", "  x = 1;\n  x + y = z;");
    assert!(
        told.contains("m.mo:3:8: no equation is left that determines `z`: the equations that contain it (lines 7) determine other unknowns"),
        "{told}"
    );
    assert!(told.contains("m.mo:4:17: no equation is left that determines `u`: it is in no equation"), "{told}");
    assert!(told.contains("a text from rumoca leaves `when` out"), "{told}");
}

#[test]
fn an_equation_too_many_is_named_with_those_it_competes_with() {
    let told = told("  Real x, y;\n  parameter Real p = 1;", "  x + y = 1;\n  x - 2*y = 2;\n  3*x = 4 + y*p;");
    assert!(
        told.contains("m.mo:7:3: one equation too many: the 3 equations of lines 5, 6, 7 contain only 2 unknowns"),
        "{told}"
    );
}

#[test]
fn an_equation_without_unknowns_is_named() {
    assert!(
        told("  Real x;\n  parameter Real p = 1;", "  x = 1;\n  p = 2;")
            .contains("m.mo:6:3: this equation contains no unknown")
    );
}

#[test]
fn equations_that_say_the_same_are_named() {
    let told = told("  Real x, y;\n  input Real u;", "  x + 2*y = u;\n  2*x + 4*y = 3;");
    assert!(
        told.contains("the equations of lines 5, 6 do not determine `x`, `y`") || told.contains("do not determine `y`, `x`"),
        "{told}"
    );
}

#[test]
fn an_input_that_would_have_to_be_derived_is_named() {
    let told = told("  input Real u;\n  Real x, v, f;", "  x = 2*u;\n  v = der(x);\n  f = der(v);");
    assert!(told.contains("m.mo:5:3: the time derivative of this equation is needed, but it contains the input `u`"), "{told}");
    let told = self::told("  input Real u;\n  Real x, v;", "  x = u;\n  v = der(x);");
    assert!(told.contains("which is the input `u`"), "{told}");
}

#[test]
fn a_start_that_is_demanded_twice_is_named() {
    let told = told(
        "  Real x(start = 1, fixed = true);\n  Real y(start = 2, fixed = true);\n  Real v, w;",
        "  y = 3*x;\n  v = der(x);\n  w = der(y);\n  v + w = 1;",
    );
    // The start of `y` is used, so the start of `x` is redundant: y = 3 x.
    assert!(told.contains("`x` is one condition too many: the other conditions determine it as 0.666"), "{told}");
}

#[test]
fn a_parameter_that_depends_on_itself_is_named() {
    assert!(
        told("  parameter Real a = b + 1;\n  parameter Real b = 2*a;\n  Real x;", "  x = a;").contains("depends on itself")
    );
}

#[test]
fn a_boolean_that_depends_on_itself_is_named() {
    let told = told("  Boolean a, b;", "  a = not b;\n  b = a;");
    assert!(told.contains("m.mo:4:3") || told.contains("`a`"), "{told}");
}

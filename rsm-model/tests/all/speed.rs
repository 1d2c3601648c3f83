//! A text of a thousand equations compiles in a short time.

use std::fmt::Write as _;
use std::time::Instant;

use rsm_core::source::Source;
use rsm_model::flat::{Flat, Options};
use rsm_model::system::System;

/// A chain of masses with springs and dampers, in the form of a flattened text: ten equations for each mass.
fn chain(masses: usize) -> String {
    let mut text = String::from("model Chain\n  input Real force(unit = \"N\");\n");
    for k in 0..masses {
        let _ = write!(
            text,
            "  parameter Real m{k}.mass(unit = \"kg\") = {}.5;\n  parameter Real s{k}.c(unit = \"N/m\") = 1000;\n  parameter Real s{k}.d(unit = \"N.s/m\") = 3;\n  \
             Real m{k}.x(unit = \"m\", start = 0.0);\n  Real m{k}.v(unit = \"m/s\", start = 0.0);\n  Real m{k}.left.f(unit = \"N\");\n  Real m{k}.right.f(unit = \"N\");\n  \
             Real m{k}.left.x(unit = \"m\");\n  Real m{k}.right.x(unit = \"m\");\n  Real s{k}.left.x(unit = \"m\");\n  Real s{k}.right.x(unit = \"m\");\n  \
             Real s{k}.f(unit = \"N\");\n  Real s{k}.stretch(unit = \"m\");\n",
            k + 1
        );
    }
    text.push_str("equation\n");
    for k in 0..masses {
        let before = if k == 0 { "force".to_string() } else { format!("s{}.f", k - 1) };
        let next = if k + 1 < masses { format!("m{}.left.x", k + 1) } else { "0".to_string() };
        let _ = write!(
            text,
            "  m{k}.v = der(m{k}.x);\n  m{k}.mass*der(m{k}.v) = m{k}.left.f + m{k}.right.f;\n  m{k}.left.x = m{k}.x;\n  m{k}.right.x = m{k}.x;\n  \
             m{k}.left.f = {before};\n  m{k}.right.f + s{k}.f = 0;\n  s{k}.left.x = m{k}.right.x;\n  s{k}.right.x = {next};\n  \
             s{k}.stretch = s{k}.left.x - s{k}.right.x;\n  s{k}.f = s{k}.c*s{k}.stretch + s{k}.d*der(s{k}.stretch);\n"
        );
    }
    text.push_str("end Chain;\n");
    text
}

/// The goal is 0.5 s in a released build. Here the crate is optimised, not all of its dependencies are, and the machine may be busy: four times that.
#[test]
fn a_thousand_equations_compile_in_time() {
    let source = Source::new("chain.mo", chain(100));
    let start = Instant::now();
    let flat = Flat::read(&source, &Options::default()).unwrap_or_else(|faults| panic!("{faults}"));
    assert_eq!(flat.equations.len(), 1000);
    let system = System::new(&flat).unwrap_or_else(|faults| panic!("{faults}"));
    assert_eq!(system.states().len(), 200);
    let seconds = start.elapsed().as_secs_f64();
    assert!(seconds < 2.0, "{seconds} s");
}

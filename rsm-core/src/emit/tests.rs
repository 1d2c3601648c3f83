//! Tests that emitted code has the names of the model: the term beside each constant that comes from a term.

use crate::check::Checked;
use crate::compile;
use crate::number::Precision;
use crate::source::Source;

use super::{c, plain, rust};

const MODEL: &str = "format = 1\nmodel = \"m\"\n[inputs.torque]\nunit = \"N*m\"\nrange = [-2.0, 2.0]\n[inputs.speed]\nunit = \"rad/s\"\nrange = [10.0, 30.0]\n\
    [surfaces.angle]\nunit = \"deg\"\ninputs = [\"torque\", \"speed\"]\nterms = [\n\
    { powers = [0, 0], coefficient = 7.25 },\n{ powers = [1, 1], coefficient = 3.75 },\n{ powers = [0, 2], coefficient = 1234567.5 },\n\
    { powers = [2, 0], coefficient = 29.0 },\n]\n";

fn emitted(text: &str) -> [String; 2] {
    let checked = Checked::read(&Source::new("m.toml", text)).unwrap();
    let unit = compile::unit(&checked, &[Precision::F64]).unwrap();
    [c::emit(&unit).source, rust::emit(&unit)]
}

#[test]
fn a_constant_has_its_term_beside_it() {
    let [c, rust] = emitted(MODEL);
    // Half of the ranges are 2 and 10: 3.75/(2*10), 1234567.5/100, 29/4 = 7.25; the constant term is 7.25 too.
    let expected = [
        ("0.1875", "torque*speed: 3.75 deg"),
        ("12345.675", "speed^2: 1234570.0 deg"),
        ("7.25", "1: 7.25 deg, torque^2: 29.0 deg"),
    ];
    for (value, words) in expected {
        assert!(c.contains(&format!(" = {value}; /* {words} */\n")), "{words} in\n{c}");
        assert!(rust.contains(&format!(": f64 = {value}; // {words}\n")), "{words} in\n{rust}");
    }
    // The bounds of the box and its centre belong to no term.
    for value in ["-2.0", "10.0", "20.0", "30.0"] {
        assert!(c.contains(&format!(" = {value};\n")), "{value} in\n{c}");
    }
}

#[test]
fn a_number_has_no_unit() {
    for none in ["1", ""] {
        let [c, rust] = emitted(&MODEL.replace("unit = \"deg\"", &format!("unit = \"{none}\"")));
        assert!(c.contains(" /* torque*speed: 3.75 */\n") && rust.contains(" // torque*speed: 3.75\n"), "{c}");
    }
}

#[test]
fn a_unit_cannot_end_the_comment() {
    let [c, rust] = emitted(&MODEL.replace("unit = \"deg\"", "unit = \"*/ int x; //\\n\u{b0}\""));
    assert!(c.contains("/* torque*speed: 3.75 * / int x; //U+000AU+00B0 */\n"), "{c}");
    assert!(rust.contains("// torque*speed: 3.75 * / int x; //U+000AU+00B0\n"), "{rust}");
    assert_eq!(plain("/*??/`\\"), "/ *? ?/''");
}

#[test]
fn a_printed_bound_is_a_bound_of_four_digits() {
    for (value, printed) in [
        (0.35, 0.35),
        (0.350_000_1, 0.3501),
        (-0.349_999_9, -0.3499),
        (1.0, 1.0),
        (9.999_1, 10.0),
        (-1.000_01, -1.0),
        (12_345.0, 12_350.0),
        (-12_345.0, -12_340.0),
        (1.2341e-30, 1.235e-30),
        (0.0, 0.0),
    ] {
        assert_eq!(super::four_digits_above(value), printed, "{value}");
    }
}

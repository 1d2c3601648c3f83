//! Tests that every surface has its certificate, in the order of the file.

use super::*;
use crate::source::Source;

const MODEL: &str = r#"format = 1
model = "m"

[inputs.x]
unit = "1"
range = [1.0, 4.0]

[surfaces.small]
unit = "1"
coding = "none"
inputs = ["x"]
terms = [{ powers = [1], coefficient = 0.5 }]

[surfaces.large]
unit = "1"
coding = "none"
inputs = ["x"]
terms = [{ powers = [1], coefficient = 3.0 }]
"#;

fn read(text: &str) -> Checked {
    Checked::read(&Source::new("m.toml", text)).unwrap_or_else(|faults| panic!("{faults}"))
}

#[test]
fn every_surface_has_its_certificate_in_each_precision() {
    let found = surfaces(&read(MODEL), &Precision::ALL).unwrap_or_else(|faults| panic!("{faults}"));
    let names: Vec<&str> = found.iter().map(|it| it.name.as_str()).collect();
    assert_eq!(names, ["small", "large"]);
    for (certificate, factor) in found.iter().zip([0.5, 3.0]) {
        let Interval { low, high } = certificate.range;
        assert!(low <= factor && low > factor - 1e-14, "{low}");
        assert!(high >= 4.0 * factor && high < 4.0 * factor + 1e-14, "{high}");
        let precisions: Vec<Precision> = certificate.tapes.iter().map(|it| it.precision).collect();
        assert_eq!(precisions, Precision::ALL);
        for tape in &certificate.tapes {
            // The factor 1/2 causes no rounding. 3 x is below 16, so its rounding error is at most half of a unit of 2^3: 8 units of roundoff.
            let expected = if factor == 0.5 { 0.0 } else { 8.0 * tape.precision.unit_roundoff() };
            assert_eq!(tape.error, expected, "{tape:?}");
            // Two comparisons and two selections of the clamp to the range, and the product.
            assert_eq!((tape.operations, tape.depth), (5, 5), "{tape:?}");
        }
    }
}

#[test]
fn a_precision_that_cannot_hold_the_model_is_refused() {
    let checked = read(&MODEL.replace("3.0", "1e39"));
    assert!(surfaces(&checked, &[Precision::F64]).is_ok());
    assert!(surfaces(&checked, &[Precision::F64, Precision::F32]).is_err());
}

//! Makes the evaluators of the driveline and of the published damping surface. In: the coefficient files. Out: `driveline.rs` and `throttle.rs` in
//! OUT_DIR; a fault in a file ends the build with the file's line and column.

use rsm_core::number::Precision;

fn main() {
    // f32 for the step; f64 for the test that compares the two.
    rsm_core::build_script::compile("../../generated/coefficients/driveline.toml", &[Precision::F32, Precision::F64]);
    rsm_core::build_script::compile("../../generated/coefficients/throttle.toml", &[Precision::F64]);
}

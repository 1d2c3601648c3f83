//! Makes the evaluators of the driveline, with the step by which its damping follows the car, and of the published damping surface. In: the
//! coefficient files. Out: `driveline.rs` and `throttle.rs` in OUT_DIR; a fault in a file ends the build with the file's line and column.

use rsm_core::compile::Parts;
use rsm_core::lower::Recursive;
use rsm_core::number::Precision;

fn main() {
    // f32 for the step; f64 for the test that compares the two.
    let driveline = "../../generated/coefficients/driveline.toml";
    // The damping that a tip-in shows has an error of 0.01. A memory of 50 tip-ins; the damping may become uncertain by 0.03 where no tip-in was
    // made.
    let settings = Recursive { forgetting: 0.98, noise: 0.01, gate: 5.0, limit: 0.03, start: 0.01 };
    let parts = Parts { recursive: vec![("damping_ratio".to_string(), settings)], ..Parts::default() };
    rsm_core::build_script::compile_with_parts(driveline, &[Precision::F32, Precision::F64], &parts);
    rsm_core::build_script::compile("../../generated/coefficients/throttle.toml", &[Precision::F64]);
}

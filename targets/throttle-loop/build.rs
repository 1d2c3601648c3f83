//! Makes the evaluator of the damping surface. In: the coefficient file. Out: `throttle.rs` in OUT_DIR; a fault in the file ends the build with the
//! file's line and column.

use rsm_core::number::Precision;

fn main() {
    rsm_core::build_script::compile("../../generated/coefficients/throttle.toml", &[Precision::F64]);
}

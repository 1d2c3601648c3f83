//! Measured data: an axis, the flux map of a motor, the rolling records of an outrunner. They are read in their folder and never copied.

mod emps;
mod flux_map;
mod prose;
mod rolling;

use rsm_diagnose::plant::Diagnosis;

use crate::folders::shared as folder;

/// The kinds of causes and helpers, the strongest first. For a real machine with unknown parts, a correct cause may be only a helper.
fn kinds(found: &Diagnosis) -> Vec<&'static str> {
    found.entries().map(|cause| cause.kind).collect()
}

/// Prints the result, for test runs with visible output.
fn tell(what: &str, found: &Diagnosis) {
    println!("{what}: {:?}, gain {:.4}, stopped {:?}", found.verdict, found.gain, found.stopped);
    for it in &found.refused {
        println!("  refused {}: {}", it.cause, it.why);
    }
    for cause in found.entries() {
        let numbers: Vec<String> = cause
            .parameters
            .iter()
            .map(|it| format!("{} {:.5} ({:.5} to {:.5})", it.name, it.value, it.low, it.high))
            .collect();
        println!(
            "  {} {:?} {numbers:?}, confidence {:.2}, alike {:?}",
            cause.kind, cause.subject, cause.confidence, cause.indistinguishable_from
        );
        println!("    rivals {:?}", cause.rivals.iter().take(5).collect::<Vec<_>>());
    }
    for step in &found.steps {
        let errors: Vec<String> =
            step.errors.iter().map(|it| format!("{:.4e} ({:.2} x noise)", it.rmse, it.noise_ratio)).collect();
        println!("  {:?}: {errors:?}, force {:?}", step.causes, step.force_error);
    }
    println!("  what is left looks most like {:?}", found.remaining.iter().take(4).collect::<Vec<_>>());
    for region in found.error_breakdown.before.iter().take(6) {
        println!(
            "  where: output {} {}: {:.2} of the error in {:.2} of the rows",
            region.output, region.region, region.share_of_error, region.share_of_rows
        );
    }
}

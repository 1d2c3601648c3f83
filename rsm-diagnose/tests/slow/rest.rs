//! The diagnosis of an axis whose records contain rest.

use crate::standing::{axis, nominal_axis};
use rsm_diagnose::plant::{Options, Verdict, diagnose};
use rsm_sim::record::Record;

#[test]
fn an_axis_that_sticks_at_rest_has_friction_and_its_rest_is_not_cut_away() {
    // The static friction is a third above the friction in motion.
    let records: Vec<Record> = [4, 5].map(|seed| axis(seed, (16.0, 21.0), 4e-3).record()).to_vec();
    let options = Options { threads: 2, progress: &|_| {} };
    let found = diagnose(&nominal_axis(), &records[..1], &records[1..], &options).unwrap();
    assert!(found.findings.is_empty(), "{:?}", found.findings);
    assert_ne!(found.verdict, Verdict::NoDiscrepancy);
    let names: Vec<&str> = found.entries().map(|it| it.kind).collect();
    assert!(names.iter().any(|kind| kind.ends_with("friction")), "{names:?}");
}

//! `cargo xtask federation`: both loops between processes and hosts, a minute for each way and each fault.
//!
//! In: nothing. Out: the figures of each run, and whether its outcome was the expected one. Two hosts are network namespaces, which need root.

use crate::helics;
use crate::stage::Run;
use crate::workspace::cargo;

/// Runs the campaign: a minute for each run.
pub(crate) fn run() -> bool {
    let mut run = Run::new();
    add(&mut run, 60);
    run.finish()
}

/// Adds the tests of `rsm-cli/tests/hosts`, with this many seconds for each run.
pub(crate) fn add(run: &mut Run, seconds: u32) {
    run.check("helics", helics::ensure).command("federation", {
        let mut test = cargo(&["test", "-p", "rsm-cli", "--test", "hosts", "--", "--nocapture", "--test-threads", "1"]);
        test.env("RSM_HELICS", helics::folder()).env("RSM_FEDERATION_SECONDS", seconds.to_string());
        test
    });
}

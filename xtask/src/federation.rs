//! `cargo xtask federation`: both loops between processes and hosts, a minute for each way and each fault.
//!
//! In: nothing. Out: the figures of each run, and whether its outcome was the stated one. Two hosts are network namespaces, which need root.

use crate::helics;
use crate::stage::Run;
use crate::workspace::cargo;

/// How long each run is, in s.
const SECONDS: &str = "60";

/// Runs the campaign: the tests of `rsm-cli/tests/hosts`, longer.
pub(crate) fn run() -> bool {
    let mut run = Run::new();
    run.check("helics", helics::ensure).command("federation", {
        let mut test = cargo(&["test", "-p", "rsm-cli", "--test", "hosts", "--", "--nocapture", "--test-threads", "1"]);
        test.env("RSM_HELICS", helics::folder()).env("RSM_FEDERATION_SECONDS", SECONDS);
        test
    });
    run.finish()
}

//! What a test says that shows nothing on this machine. Included by path in the tests of other crates too.

use std::io::Write;

/// Says that the calling test shows nothing on this machine, and why. The words go past the test harness, which would keep those of a test that
/// passes; `cargo xtask test` counts such lines.
pub fn skipped(why: &str) {
    let _ = writeln!(std::io::stdout(), "\nSKIPPED: {why}");
}

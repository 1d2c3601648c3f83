//! The library of HELICS for a test, and its turn: one federation at a time, because their processes and their time-outs share the machine.
//! Included by path in the other tests of the command.

use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::skipped::skipped;

/// Where the library is. No other test has one while this is kept.
pub(crate) struct Helics {
    place: PathBuf,
    _turn: MutexGuard<'static, ()>,
}

impl Deref for Helics {
    type Target = Path;

    fn deref(&self) -> &Path {
        &self.place
    }
}

/// The library, by the variable RSM_HELICS, or where `cargo xtask test` puts it; or a loud skip.
pub(crate) fn helics(test: &str) -> Option<Helics> {
    static TURN: Mutex<()> = Mutex::new(());
    let fetched = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/xtask/helics");
    let named = std::env::var_os("RSM_HELICS").map(PathBuf::from);
    let Some(place) = named.or(Some(fetched)).filter(|it| it.exists()) else {
        skipped(&format!("no libhelics (pip install --target target/xtask/helics helics==3.6.1): {test}"));
        return None;
    };
    // A test that failed has left nothing behind that the next one sees.
    Some(Helics { place, _turn: TURN.lock().unwrap_or_else(PoisonError::into_inner) })
}

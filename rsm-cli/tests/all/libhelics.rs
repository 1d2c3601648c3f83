//! The library of HELICS for one test at a time: the processes and time-outs of federations share the machine, so only one may run. The other tests
//! of the command include this file by its path.

use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::skipped::skipped;

/// The place of the library. While this value exists, no other test can have one.
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

/// The library, from the variable RSM_HELICS or from the place where `cargo xtask test` puts it; otherwise the test is skipped with a message.
pub(crate) fn helics(test: &str) -> Option<Helics> {
    static TURN: Mutex<()> = Mutex::new(());
    let fetched = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/xtask/helics");
    let named = std::env::var_os("RSM_HELICS").map(PathBuf::from);
    let Some(place) = named.or(Some(fetched)).filter(|it| it.exists()) else {
        skipped(&format!("no libhelics (pip install --target target/xtask/helics helics==3.6.1): {test}"));
        return None;
    };
    // A failed test leaves nothing that affects the next one.
    Some(Helics { place, _turn: TURN.lock().unwrap_or_else(PoisonError::into_inner) })
}

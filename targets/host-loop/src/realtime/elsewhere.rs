//! Other systems: the loop runs without real time, and the report contains the reason.

const NONE: &str = "asked for on Linux alone";

pub(super) fn lock_memory() -> Result<(), String> {
    Err(NONE.to_owned())
}

pub(super) fn unlock_memory() {}

pub(super) fn raise_priority() -> Result<(i32, i32), String> {
    Err(NONE.to_owned())
}

pub(super) fn restore_priority(_policy: i32, _priority: i32) {}

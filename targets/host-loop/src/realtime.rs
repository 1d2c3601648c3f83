//! What a real-time loop asks of the operating system, for as long as it runs: locked memory and a real-time priority.
//!
//! In: the wish. Out: a [`Grant`] each, with the reason where it was refused. Gives back on drop what it took; never fails.

use std::fmt;

#[cfg(target_os = "linux")]
mod linux;
#[cfg(target_os = "linux")]
use linux as system;
#[cfg(not(target_os = "linux"))]
mod elsewhere;
#[cfg(not(target_os = "linux"))]
use elsewhere as system;

/// What came of one wish.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Grant {
    /// The system granted it.
    Granted,
    /// It was not asked for.
    NotAsked,
    /// The system refused, for this reason.
    Refused(String),
}

impl fmt::Display for Grant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Grant::Granted => write!(f, "yes"),
            Grant::NotAsked => write!(f, "not asked for"),
            Grant::Refused(reason) => write!(f, "no: {reason}"),
        }
    }
}

/// The process while a loop runs in it. Dropping it gives back what was granted.
#[derive(Debug)]
pub(crate) struct RealTime {
    pub(crate) memory: Grant,
    pub(crate) priority: Grant,
    /// The calling thread's policy and priority before.
    before: Option<(i32, i32)>,
}

impl RealTime {
    /// Nothing asked for, nothing to give back.
    pub(crate) fn not_asked() -> Self {
        RealTime { memory: Grant::NotAsked, priority: Grant::NotAsked, before: None }
    }

    /// Asks for both. Call it when everything that the loop touches has been allocated and written to.
    pub(crate) fn ask() -> Self {
        let memory = match system::lock_memory() {
            Ok(()) => Grant::Granted,
            Err(reason) => Grant::Refused(reason),
        };
        let (priority, before) = match system::raise_priority() {
            Ok(before) => (Grant::Granted, Some(before)),
            Err(reason) => (Grant::Refused(reason), None),
        };
        RealTime { memory, priority, before }
    }
}

impl Drop for RealTime {
    fn drop(&mut self) {
        // Both are returns to what was allowed before, so there is nothing to do about a refusal.
        if let Some((policy, priority)) = self.before {
            system::restore_priority(policy, priority);
        }
        if self.memory == Grant::Granted {
            system::unlock_memory();
        }
    }
}

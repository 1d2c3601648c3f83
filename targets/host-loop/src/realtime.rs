//! The requests of a real-time loop to the operating system: locked memory and a real-time priority, as long as the loop runs.
//!
//! In: whether to ask. Out: a [`Grant`] for each, with the reason if it was refused. On drop everything is given back; never fails.

use std::fmt;

#[cfg(target_os = "linux")]
mod linux;
#[cfg(target_os = "linux")]
use linux as system;
#[cfg(not(target_os = "linux"))]
mod elsewhere;
#[cfg(not(target_os = "linux"))]
use elsewhere as system;

/// The result of one request.
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
        // Both return to a state that was allowed before, so a refusal needs no reaction.
        if let Some((policy, priority)) = self.before {
            system::restore_priority(policy, priority);
        }
        if self.memory == Grant::Granted {
            system::unlock_memory();
        }
    }
}

//! The requests of a real-time loop to the operating system: locked memory and a real-time priority while the loop runs.
//!
//! In: whether to make the requests. Out: a [`Grant`] for each, with the reason if it was refused. On drop everything is released; never fails.

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
    /// It was not requested.
    NotAsked,
    /// The system refused it, for this reason.
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

/// The process while a loop runs in it. On drop everything that was granted is released.
#[derive(Debug)]
pub(crate) struct RealTime {
    pub(crate) memory: Grant,
    pub(crate) priority: Grant,
    /// The policy and priority of the calling thread before the request.
    before: Option<(i32, i32)>,
}

impl RealTime {
    /// Without requests.
    pub(crate) fn not_asked() -> Self {
        RealTime { memory: Grant::NotAsked, priority: Grant::NotAsked, before: None }
    }

    /// Makes both requests. Call it after all memory of the loop has been allocated and written.
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
        // Both return to a state that was allowed before, so an error needs no reaction.
        if let Some((policy, priority)) = self.before {
            system::restore_priority(policy, priority);
        }
        if self.memory == Grant::Granted {
            system::unlock_memory();
        }
    }
}

//! What a real-time loop asks of the operating system, for as long as it runs: locked memory and a real-time priority.
//!
//! In: the wish. Out: a [`Grant`] each, with the reason where it was refused. Gives back on drop what it took; never fails.

use std::fmt;

use nix::errno::Errno;
use nix::libc;
use nix::sys::mman::{MlockAllFlags, mlockall, munlockall};

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

/// Above the kernel's threaded interrupt handlers, which run at 50, and below its own watchdogs at 99.
const PRIORITY: i32 = 80;

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
        // MCL_FUTURE is left out on purpose: under a limit on locked memory it makes later allocations of the whole process fail, and
        // the loop makes none.
        let memory = match mlockall(MlockAllFlags::MCL_CURRENT) {
            Ok(()) => Grant::Granted,
            Err(error) => refused(error, "raise the limit on locked memory (ulimit -l) or grant CAP_IPC_LOCK"),
        };
        let (priority, before) = match policy().and_then(|before| set_policy(libc::SCHED_FIFO, PRIORITY).map(|()| before)) {
            Ok(before) => (Grant::Granted, Some(before)),
            Err(error) => (refused(error, "raise the limit on real-time priority (ulimit -r) or grant CAP_SYS_NICE"), None),
        };
        RealTime { memory, priority, before }
    }
}

impl Drop for RealTime {
    fn drop(&mut self) {
        // Both are returns to what was allowed before, so there is nothing to do about a refusal.
        if let Some((policy, priority)) = self.before {
            let _ = set_policy(policy, priority);
        }
        if self.memory == Grant::Granted {
            let _ = munlockall();
        }
    }
}

fn refused(error: Errno, help: &str) -> Grant {
    Grant::Refused(format!("{} ({help})", error.desc()))
}

/// The calling thread's scheduling policy and priority.
fn policy() -> nix::Result<(i32, i32)> {
    let mut parameters = libc::sched_param { sched_priority: 0 };
    // SAFETY: 0 means the calling thread; the pointer is to a live local that the call fills in and does not keep.
    #[allow(unsafe_code)]
    let policy = unsafe {
        Errno::result(libc::sched_getparam(0, &raw mut parameters))?;
        Errno::result(libc::sched_getscheduler(0))?
    };
    Ok((policy, parameters.sched_priority))
}

fn set_policy(policy: i32, priority: i32) -> nix::Result<()> {
    let parameters = libc::sched_param { sched_priority: priority };
    // SAFETY: 0 means the calling thread; the pointer is to a live local that the call reads and does not keep.
    #[allow(unsafe_code)]
    let answer = unsafe { libc::sched_setscheduler(0, policy, &raw const parameters) };
    Errno::result(answer).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_taken_is_given_back() {
        let before = policy().unwrap();
        let real_time = RealTime::ask();
        if real_time.priority == Grant::Granted {
            assert_eq!(policy().unwrap(), (libc::SCHED_FIFO, PRIORITY));
        }
        drop(real_time);
        assert_eq!(policy().unwrap(), before);
    }

    #[test]
    fn a_refusal_says_why_and_what_to_do() {
        let grant = refused(Errno::EPERM, "grant CAP_SYS_NICE");
        assert_eq!(grant.to_string(), "no: Operation not permitted (grant CAP_SYS_NICE)");
        // Priority 1000 is out of range whoever asks.
        assert_eq!(set_policy(libc::SCHED_FIFO, 1000), Err(Errno::EINVAL));
    }
}

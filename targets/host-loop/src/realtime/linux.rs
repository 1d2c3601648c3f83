//! Linux: mlockall and the first-in first-out scheduler.

use nix::errno::Errno;
use nix::libc;
use nix::sys::mman::{MlockAllFlags, mlockall, munlockall};

/// Above the kernel's threaded interrupt handlers (50), and below its watchdogs (99).
const PRIORITY: i32 = 80;

pub(super) fn lock_memory() -> Result<(), String> {
    // MCL_FUTURE is not set: under a limit on locked memory it makes later allocations of the whole process fail, and the loop makes none.
    mlockall(MlockAllFlags::MCL_CURRENT)
        .map_err(|error| told(error, "raise the limit on locked memory (ulimit -l) or grant CAP_IPC_LOCK"))
}

pub(super) fn unlock_memory() {
    let _ = munlockall();
}

/// Sets the real-time policy. Returns the policy and priority of the calling thread before.
pub(super) fn raise_priority() -> Result<(i32, i32), String> {
    policy()
        .and_then(|before| set_policy(libc::SCHED_FIFO, PRIORITY).map(|()| before))
        .map_err(|error| told(error, "raise the limit on real-time priority (ulimit -r) or grant CAP_SYS_NICE"))
}

pub(super) fn restore_priority(policy: i32, priority: i32) {
    let _ = set_policy(policy, priority);
}

fn told(error: Errno, help: &str) -> String {
    format!("{} ({help})", error.desc())
}

/// The calling thread's scheduling policy and priority.
fn policy() -> nix::Result<(i32, i32)> {
    let mut parameters = libc::sched_param { sched_priority: 0 };
    // SAFETY: 0 is the calling thread; the pointer is to a live local variable, which the call writes and does not keep.
    #[allow(unsafe_code)]
    let policy = unsafe {
        Errno::result(libc::sched_getparam(0, &raw mut parameters))?;
        Errno::result(libc::sched_getscheduler(0))?
    };
    Ok((policy, parameters.sched_priority))
}

fn set_policy(policy: i32, priority: i32) -> nix::Result<()> {
    let parameters = libc::sched_param { sched_priority: priority };
    // SAFETY: 0 is the calling thread; the pointer is to a live local variable, which the call reads and does not keep.
    #[allow(unsafe_code)]
    let answer = unsafe { libc::sched_setscheduler(0, policy, &raw const parameters) };
    Errno::result(answer).map(drop)
}

#[cfg(test)]
mod tests {
    use super::super::{Grant, RealTime};
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
        let grant = Grant::Refused(told(Errno::EPERM, "grant CAP_SYS_NICE"));
        assert_eq!(grant.to_string(), "no: Operation not permitted (grant CAP_SYS_NICE)");
        // Priority 1000 is out of range for every user.
        assert_eq!(set_policy(libc::SCHED_FIFO, 1000), Err(Errno::EINVAL));
    }
}

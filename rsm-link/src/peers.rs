//! Checks whether the processes of a federation in shared memory are still running.
//!
//! In: the library's data about the cores of a broker. Out: their processes, and whether one of them has ended. If a process is killed while it holds
//! the lock of a queue in shared memory, the queue stays locked. The broker then receives no messages and no heartbeats, and would never end.

/// The part of a core's name before the number of its process.
const SEPARATOR: &str = "-core-";

/// The name of the core of a federate in this process. A federation has each name only once. The process number distinguishes the core from the rest
/// of a killed process in shared memory.
pub(crate) fn core_name(federate: &str) -> String {
    format!("{federate}{SEPARATOR}{}", std::process::id())
}

/// The process numbers in the names of the cores in a JSON text.
pub(crate) fn processes(text: &str) -> Vec<u32> {
    let number = |name: &str| name.rsplit_once(SEPARATOR).and_then(|(_, number)| number.parse().ok());
    let mut found: Vec<u32> = text.split('"').filter_map(number).collect();
    found.sort_unstable();
    found.dedup();
    found
}

/// Whether a process of this host has ended. Without `/proc` the answer is always no.
pub(crate) fn is_gone(process: u32) -> bool {
    if !std::path::Path::new("/proc/self/stat").exists() {
        return false;
    }
    // The state follows the name of the program. The name is in brackets and may itself contain brackets. A zombie has ended.
    let state = |stat: String| stat.rsplit_once(") ").and_then(|(_, rest)| rest.chars().next());
    let stat = std::fs::read_to_string(format!("/proc/{process}/stat"));
    stat.ok().and_then(state).is_none_or(|state| matches!(state, 'Z' | 'X'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_core_is_named_by_its_federate_and_its_process() {
        let names =
            format!(r#"{{"cores":[{{"name":"{}"}},{{"name":"b-core-4"}},{{"name":"c-core-4"}}]}}"#, core_name("a-core"));
        let mut expected = vec![4, std::process::id()];
        expected.sort_unstable();
        assert_eq!(processes(&names), expected);
        assert!(processes("cores of others: core-7, x-core-y").is_empty());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_killed_process_is_gone_before_and_after_its_status_is_read() {
        assert!(!is_gone(std::process::id()));
        let mut child = std::process::Command::new("sleep").arg("60").spawn().unwrap();
        assert!(!is_gone(child.id()));
        child.kill().unwrap();
        // A process ends a short time after the signal.
        let until = std::time::Instant::now() + std::time::Duration::from_secs(20);
        while !is_gone(child.id()) && std::time::Instant::now() < until {
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        assert!(is_gone(child.id()));
        child.wait().unwrap();
        assert!(is_gone(child.id()));
    }
}

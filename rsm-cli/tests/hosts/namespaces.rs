//! Two hosts on one machine: network namespaces, connected by a link of 100 Mbit/s.
//!
//! In: nothing. Out: two names. Commands run under each of them as on a separate host. If this user may not create namespaces, the test is skipped
//! with a message.

use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};

use crate::skipped::skipped;

pub(crate) struct Hosts {
    pub(crate) names: [String; 2],
    pub(crate) addresses: [&'static str; 2],
}

impl Drop for Hosts {
    fn drop(&mut self) {
        for name in &self.names {
            // This also removes the link.
            let _ = Command::new("ip").args(["netns", "del", name]).stderr(Stdio::null()).status();
        }
    }
}

fn succeeds(line: &str) -> bool {
    let mut words = line.split_whitespace();
    let mut command = Command::new(words.next().unwrap());
    command.args(words).stdout(Stdio::null()).stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}

impl Hosts {
    pub(crate) fn new(test: &str) -> Option<Self> {
        // Tests of this process run side by side. An interface has a name of at most 15 bytes.
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let number = format!("{}-{}", std::process::id(), NEXT.fetch_add(1, Ordering::Relaxed));
        let names = ["a", "b"].map(|it| format!("rsm-{number}-{it}"));
        let hosts = Hosts { names, addresses: ["10.77.0.1", "10.77.0.2"] };
        let [a, b] = &hosts.names;
        let (wire_a, wire_b) = (format!("ra{number}"), format!("rb{number}"));
        if !(succeeds(&format!("ip netns add {a}")) && succeeds(&format!("ip netns add {b}"))) {
            skipped(&format!("network namespaces need root and `ip` (iproute2): {test}"));
            return None;
        }
        assert!(succeeds(&format!("ip link add {wire_a} netns {a} type veth peer name {wire_b} netns {b}")), "a wire");
        for ((name, wire), address) in hosts.names.iter().zip([&wire_a, &wire_b]).zip(hosts.addresses) {
            assert!(succeeds(&format!("ip -n {name} addr add {address}/24 dev {wire}")), "an address");
            assert!(succeeds(&format!("ip -n {name} link set lo up")) && succeeds(&format!("ip -n {name} link set {wire} up")));
            let bucket = format!("tc -n {name} qdisc add dev {wire} root tbf rate 100mbit burst 32kbit latency 50ms");
            if !succeeds(&bucket) {
                skipped(&format!("`tc ... tbf` is not to be had: {test}"));
                return None;
            }
        }
        Some(hosts)
    }

    /// A command on a host.
    pub(crate) fn command(&self, host: usize, program: &str) -> Command {
        let mut command = Command::new("ip");
        command.args(["netns", "exec", &self.names[host], program]);
        command
    }

    /// Moves the calling thread to a host.
    pub(crate) fn enter(&self, host: usize) -> impl FnOnce() + Send + 'static {
        let file = format!("/run/netns/{}", self.names[host]);
        move || {
            let file = std::fs::File::open(file).unwrap();
            nix::sched::setns(file, nix::sched::CloneFlags::CLONE_NEWNET).unwrap();
        }
    }
}

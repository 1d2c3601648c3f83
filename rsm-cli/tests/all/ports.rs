//! Ports of this host for a test that starts servers. The other tests of the command include this file by its path.

use std::net::{TcpListener, UdpSocket};
use std::sync::atomic::{AtomicU16, Ordering};

/// A port that is free now, over TCP and over UDP, with the next two ports also free: HELICS uses them for ZeroMQ. The port is below the range from
/// which the system assigns ports, and each is returned only once in a process.
pub(crate) fn port() -> u16 {
    static NEXT: AtomicU16 = AtomicU16::new(0);
    let first = 10_000 + (std::process::id() % 1000) as u16 * 20;
    let free = |port| TcpListener::bind(("127.0.0.1", port)).is_ok() && UdpSocket::bind(("127.0.0.1", port)).is_ok();
    loop {
        let port = first + 4 * NEXT.fetch_add(1, Ordering::Relaxed);
        if (port..port + 3).all(free) {
            return port;
        }
    }
}

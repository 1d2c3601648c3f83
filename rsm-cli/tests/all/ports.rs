//! Ports of this host for a test that starts servers. Included by path in the other tests of the command.

use std::net::{TcpListener, UdpSocket};
use std::sync::atomic::{AtomicU16, Ordering};

/// A port that nobody has now, over TCP and over UDP, and neither the next two: HELICS takes them for ZeroMQ. Below those that a system gives to whoever asks for any, and never twice in a process.
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

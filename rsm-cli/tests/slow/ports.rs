//! Ports of this host for a test that starts servers. The other tests of the command include this file by its path.

use std::net::{TcpListener, UdpSocket};
use std::sync::atomic::{AtomicU16, Ordering};

/// The ports of one federation with ZeroMQ: HELICS takes two for the broker, and from the fifth after it one for each federate (measured with 3.6.1).
const BLOCK: u16 = 16;

/// A port that is free now, over TCP and over UDP, with the other ports of its block. It is below the range from which the system assigns ports, and
/// each block is returned only once in a process.
pub(crate) fn port() -> u16 {
    static NEXT: AtomicU16 = AtomicU16::new(0);
    // 250 processes with five blocks each: 10,000 to 29,999.
    let first = 10_000 + (std::process::id() % 250) as u16 * 5 * BLOCK;
    let free = |port| TcpListener::bind(("127.0.0.1", port)).is_ok() && UdpSocket::bind(("127.0.0.1", port)).is_ok();
    loop {
        let port = first + BLOCK * NEXT.fetch_add(1, Ordering::Relaxed);
        if (port..port + BLOCK).all(free) {
            return port;
        }
    }
}

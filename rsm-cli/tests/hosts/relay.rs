//! A relay between the two sides of a stream, which loses, delays and duplicates datagrams.
//!
//! In: the fate of each datagram. Out: the addresses to send to. `netem` is not available on every machine; this relay is, and its random numbers
//! come from a seed.

use std::collections::BTreeMap;
use std::net::{SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The fate of a datagram: a delay for every copy that is sent on; an empty list is a loss.
pub(crate) type Fate = Box<dyn FnMut(&mut Draw, Duration) -> Vec<Duration> + Send>;

/// Random numbers by a linear congruential generator of Knuth (MMIX).
pub(crate) struct Draw(u64);

impl Draw {
    /// Uniform between 0 and 1.
    pub(crate) fn share(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

pub(crate) struct Relay {
    over: Arc<AtomicBool>,
    worker: Option<JoinHandle<()>>,
    /// The longest time between two checks of the sockets, in us.
    stood_us: Arc<AtomicU64>,
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Release);
        if let Some(worker) = self.worker.take() {
            let _ = worker.join();
        }
    }
}

impl Relay {
    /// Starts a relay with two addresses: a datagram that arrives at `own[0]` is sent to `sides[0]`, and accordingly for 1. `before` runs first in
    /// the relay's thread, and may move the thread to another host. `fate` gets the time since the first sample, a datagram of about 120 bytes; the
    /// hello datagrams before it do not count.
    pub(crate) fn start(
        own: [SocketAddr; 2],
        sides: [SocketAddr; 2],
        before: impl FnOnce() + Send + 'static,
        mut fate: Fate,
    ) -> Self {
        let over = Arc::new(AtomicBool::new(false));
        let stood_us = Arc::new(AtomicU64::new(0));
        let (ended, stood, (ready, is_ready)) = (Arc::clone(&over), Arc::clone(&stood_us), std::sync::mpsc::channel());
        let worker = std::thread::spawn(move || {
            before();
            let sockets = own.map(|address| {
                let socket = UdpSocket::bind(address).unwrap();
                socket.set_nonblocking(true).unwrap();
                socket
            });
            ready.send(()).unwrap();
            let mut draw = Draw(121);
            let mut since: Option<Instant> = None;
            let mut waiting: BTreeMap<(Instant, u64), (usize, Vec<u8>)> = BTreeMap::new();
            let mut count = 0;
            let mut bytes = [0; 2048];
            let mut looked = Instant::now();
            while !ended.load(Ordering::Acquire) {
                stood.fetch_max(looked.elapsed().as_micros() as u64, Ordering::AcqRel);
                looked = Instant::now();
                for (way, socket) in sockets.iter().enumerate() {
                    while let Ok((length, _)) = socket.recv_from(&mut bytes) {
                        // A datagram with values is longer than a hello datagram, which has 88 bytes.
                        if length > 88 {
                            since.get_or_insert_with(Instant::now);
                        }
                        let now = Instant::now();
                        let time = since.map_or(Duration::ZERO, |since| now - since);
                        for delay in fate(&mut draw, time) {
                            count += 1;
                            waiting.insert((now + delay, count), (way, bytes[..length].to_vec()));
                        }
                    }
                }
                while let Some(entry) = waiting.first_entry().filter(|entry| entry.key().0 <= Instant::now()) {
                    let (way, bytes) = entry.remove();
                    // Sent from the socket of the other direction, so that each side sees only addresses of the relay.
                    let _ = sockets[1 - way].send_to(&bytes, sides[way]);
                }
                std::thread::sleep(Duration::from_micros(200));
            }
        });
        is_ready.recv().expect("the relay can listen");
        Relay { over, worker: Some(worker), stood_us }
    }

    /// The longest time for which the relay itself was inactive, in us.
    pub(crate) fn stood_us(&self) -> f64 {
        self.stood_us.load(Ordering::Acquire) as f64
    }
}

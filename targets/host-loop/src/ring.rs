//! A ring of numbered samples from one thread to another, without a lock.
//!
//! In: samples of N numbers, each with its number in the sequence. Out: the same samples in the same order. One thread pushes and one pops; with more
//! threads samples may be mixed, but memory stays safe. Never waits. Allocates only when it is created.

use std::sync::atomic::{AtomicU64, Ordering};

/// A sample and its number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Numbered<const N: usize> {
    /// Its number in the sequence, from 0.
    pub number: u64,
    /// The sample.
    pub values: [f64; N],
}

struct Slot<const N: usize> {
    number: AtomicU64,
    bits: [AtomicU64; N],
}

/// The ring.
pub struct Ring<const N: usize> {
    slots: Box<[Slot<N>]>,
    /// Number of pushed samples. Only the pushing thread writes it: the release store makes the slot visible to the other thread.
    pushed: AtomicU64,
    /// Number of popped samples. Only the popping thread writes it: the release store makes the slot free again.
    popped: AtomicU64,
}

impl<const N: usize> Ring<N> {
    /// A ring with space for this many samples, at least one.
    #[must_use]
    pub fn new(room: usize) -> Self {
        let slot = || Slot { number: AtomicU64::new(0), bits: [const { AtomicU64::new(0) }; N] };
        Ring { slots: (0..room.max(1)).map(|_| slot()).collect(), pushed: AtomicU64::new(0), popped: AtomicU64::new(0) }
    }

    fn slot(&self, count: u64) -> &Slot<N> {
        &self.slots[(count % self.slots.len() as u64) as usize]
    }

    /// Adds a sample. Returns whether there was space.
    pub fn push(&self, sample: &Numbered<N>) -> bool {
        let pushed = self.pushed.load(Ordering::Relaxed);
        if pushed - self.popped.load(Ordering::Acquire) == self.slots.len() as u64 {
            return false;
        }
        let slot = self.slot(pushed);
        slot.number.store(sample.number, Ordering::Relaxed);
        for (bits, value) in slot.bits.iter().zip(sample.values) {
            bits.store(value.to_bits(), Ordering::Relaxed);
        }
        self.pushed.store(pushed + 1, Ordering::Release);
        true
    }

    /// Removes and returns the oldest sample, if there is one.
    pub fn pop(&self) -> Option<Numbered<N>> {
        let popped = self.popped.load(Ordering::Relaxed);
        if popped == self.pushed.load(Ordering::Acquire) {
            return None;
        }
        let slot = self.slot(popped);
        let number = slot.number.load(Ordering::Relaxed);
        let values = std::array::from_fn(|k| f64::from_bits(slot.bits[k].load(Ordering::Relaxed)));
        self.popped.store(popped + 1, Ordering::Release);
        Some(Numbered { number, values })
    }
}

/// Checks the numbers of a sequence for gaps and repetitions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Sequence {
    next: u64,
    /// Count of missing numbers.
    pub lost: u64,
    /// Count of numbers that came again, or late.
    pub doubled: u64,
}

impl Sequence {
    /// Adds a number.
    pub fn note(&mut self, number: u64) {
        if number < self.next {
            self.doubled += 1;
        } else {
            self.lost += number - self.next;
            self.next = number + 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_come_out_in_order_and_a_full_ring_takes_none() {
        let ring = Ring::new(2);
        let sample = |number| Numbered { number, values: [number as f64, f64::NEG_INFINITY] };
        assert_eq!(ring.pop(), None);
        assert!(ring.push(&sample(7)) && ring.push(&sample(8)) && !ring.push(&sample(9)));
        assert_eq!(ring.pop(), Some(sample(7)));
        assert!(ring.push(&sample(9)));
        assert_eq!((ring.pop(), ring.pop(), ring.pop()), (Some(sample(8)), Some(sample(9)), None));
    }

    #[test]
    fn two_threads_lose_double_and_garble_nothing() {
        const SAMPLES: u64 = 100_000;
        let ring = Ring::new(16);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                for number in 0..SAMPLES {
                    let values = [number as f64, (number as f64).sqrt(), -(number as f64)];
                    while !ring.push(&Numbered { number, values }) {
                        std::thread::yield_now();
                    }
                }
            });
            let mut sequence = Sequence::default();
            let mut seen = 0;
            while seen < SAMPLES {
                let Some(Numbered { number, values }) = ring.pop() else {
                    std::thread::yield_now();
                    continue;
                };
                assert_eq!(values, [number as f64, (number as f64).sqrt(), -(number as f64)]);
                sequence.note(number);
                seen += 1;
            }
            assert_eq!((sequence.lost, sequence.doubled), (0, 0));
        });
    }

    #[test]
    fn gaps_are_lost_and_repetitions_doubled() {
        let mut sequence = Sequence::default();
        for number in [0, 1, 4, 4, 3, 5] {
            sequence.note(number);
        }
        assert_eq!((sequence.lost, sequence.doubled), (2, 2));
    }
}

//! Delayed signals: inputs that follow other signals, and outputs that are read later than they occur.
//!
//! In: the values of a run. Out: the instants at which a value arrives, and the value. This file never advances the time.

use std::collections::VecDeque;

use super::numbers::{DelaySource, Numbers};

/// Two instants are the same if their distance, in periods of the record, is below this: decimals of periods and delays do not agree exactly.
const SAME: f64 = 1e-9;

/// The values on their way to a delayed input.
#[derive(Default)]
struct InTransit {
    /// Values with the instants at which they arrive.
    queue: VecDeque<(f64, f64)>,
    /// The last value that was sent.
    last: Option<f64>,
}

/// All values on their way in a run.
pub(super) struct DelayedSignals<'m> {
    numbers: &'m Numbers,
    /// For each delayed input.
    in_transit: Vec<InTransit>,
    /// For each output with a delayed reading: the row whose reading is taken next, and the readings so far.
    readings: Vec<(usize, Vec<f64>)>,
    time: &'m [f64],
    near: f64,
}

impl<'m> DelayedSignals<'m> {
    pub(super) fn new(numbers: &'m Numbers, time: &'m [f64], period: f64) -> Self {
        let in_transit = numbers.delayed_inputs.iter().map(|_| InTransit::default()).collect();
        let readings = numbers.late_readings.iter().map(|_| (0, Vec::with_capacity(time.len()))).collect();
        DelayedSignals { numbers, in_transit, readings, time, near: SAME * period }
    }

    /// Whether any signal is delayed.
    pub(super) fn has_signals(&self) -> bool {
        self.numbers.has_delayed_signals()
    }

    /// Sends the current values of signals, and stores the values that have arrived. Returns whether an input changed.
    pub(super) fn exchange(&mut self, time: f64, inputs: &mut [[f64; 1]], memories: &[[f64; 1]]) -> bool {
        let mut changed = false;
        for (delayed_input, InTransit { queue, last }) in self.numbers.delayed_inputs.iter().zip(&mut self.in_transit) {
            let now = match delayed_input.of {
                DelaySource::Input(place) => inputs[place][0],
                DelaySource::Memory(place) => memories[place][0],
            };
            if last.is_none() {
                // Before the record a signal had its first value.
                changed |= inputs[delayed_input.input] != [now];
                inputs[delayed_input.input] = [now];
            } else if *last != Some(now) {
                queue.push_back((time + delayed_input.delay, now));
            }
            *last = Some(now);
            while queue.front().is_some_and(|it| it.0 <= time + self.near) {
                if let Some((_, value)) = queue.pop_front() {
                    changed |= inputs[delayed_input.input] != [value];
                    inputs[delayed_input.input] = [value];
                }
            }
        }
        changed
    }

    /// The next instant before an end at which a value arrives or a reading is taken.
    pub(super) fn next(&self, now: f64, end: f64) -> Option<f64> {
        let in_transit = self.in_transit.iter().filter_map(|it| it.queue.front()).map(|it| it.0);
        let reads = self
            .readings
            .iter()
            .zip(&self.numbers.late_readings)
            .filter_map(|((row, _), (_, delay))| self.time.get(*row).map(|time| time - delay));
        let next = in_transit.chain(reads).filter(|it| *it > now + self.near).fold(f64::INFINITY, f64::min);
        (next < end - self.near).then_some(next)
    }

    /// Takes the readings that are due at an instant, from the outputs there.
    pub(super) fn read(&mut self, time: f64, outputs: &[[f64; 1]]) {
        for ((row, taken), (output, delay)) in self.readings.iter_mut().zip(&self.numbers.late_readings) {
            // Before the record an output had its first value.
            while self.time.get(*row).is_some_and(|it| it - delay <= time + self.near) {
                taken.push(outputs[*output][0]);
                *row += 1;
            }
        }
    }

    /// Replaces the outputs at a row by their delayed readings. A reading that is taken only now is the present output.
    pub(super) fn replace(&self, row: usize, time: f64, outputs: &mut [f64]) {
        for ((_, taken), (output, delay)) in self.readings.iter().zip(&self.numbers.late_readings) {
            if let Some(value) = taken.get(row).filter(|_| time - delay < time - self.near) {
                outputs[*output] = *value;
            }
        }
    }

    /// Whether a reading is due at this time.
    pub(super) fn is_read(&self, time: f64) -> bool {
        let due = |((row, _), (_, delay)): (&(usize, Vec<f64>), &(usize, f64))| {
            self.time.get(*row).is_some_and(|it| it - delay <= time + self.near)
        };
        self.readings.iter().zip(&self.numbers.late_readings).any(due)
    }

    /// Replaces the outputs by their delayed readings.
    pub(super) fn finish(self, outputs: &mut [Vec<f64>]) {
        for ((_, taken), (output, _)) in self.readings.into_iter().zip(&self.numbers.late_readings) {
            outputs[*output] = taken;
        }
    }
}

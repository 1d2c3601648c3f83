//! Waves of effort over a position as candidates: whole orders over an angle, and any period over a distance.
//!
//! In: the filters of all records, a base of columns. Out: candidates with their columns. They depend on the nominal plant; the best periods also
//! depend on what the base explains.

use std::ops::Range;

use super::cross_validation::{Base, blocks};
use super::turning::Turning;
use super::{Candidate, Equations};
use crate::engine::angle;
use crate::plant::hypotheses::Hypothesis;
use crate::plant::model::Model;
use crate::plant::waves::{LONGEST_WAVE, MOST, largest_between, peaks};
use rsm_core::threads::in_threads;
use rsm_sim::effect::{Guess, Role};
use rsm_sim::plant_file::Entry;
use rsm_sim::schema::Bound;

/// The highest order of a wave. 36 slots with 42 poles have 252 cycles per turn, but at a hundred turns per second even order four is above a third
/// of a kilohertz. Orders above 120 are beyond what the sampling resolves.
const MOST_ORDER: usize = 120;

/// The number of periods that are refined. Half a line beside its optimum, a wave still has three quarters of its gain.
const REFINED_WAVES: usize = 3;

/// A slow wave over a distance has this many times the period of the first guess.
const SLOW: f64 = 10.0;

/// The guess of a term, if the term is a wave; otherwise `None`.
pub(super) fn order_of(entry: &Entry, hypotheses: &[Hypothesis]) -> Option<(usize, Guess)> {
    let place = hypotheses.iter().position(|it| it.describes(entry))?;
    let wave = Wave::of(&hypotheses[place])?;
    let values: Vec<f64> =
        entry.description.arguments.iter().map(|it| entry.arguments.optional(it.name).unwrap_or(f64::NAN)).collect();
    Some((place, wave.guess(values)))
}

/// The numbers of a wave of effort over a position, by their place among the numbers of an effect.
#[derive(Debug, Clone, Copy)]
pub(super) struct Wave {
    amplitude: usize,
    /// The number of periods per turn, or the length of a period.
    period: usize,
    is_whole: bool,
    phase: usize,
}

impl Wave {
    /// The numbers of a hypothesis, if it is a wave.
    pub(super) fn of(hypothesis: &Hypothesis) -> Option<Wave> {
        if hypothesis.description.declared.role != Role::Waves {
            return None;
        }
        let arguments: Vec<_> = hypothesis.description.arguments.iter().collect();
        let place = |name: &str| arguments.iter().position(|it| it.name == name);
        let period = arguments.iter().position(|it| it.bound == Bound::Count).or_else(|| place("pitch"))?;
        Some(Wave {
            amplitude: place("amplitude")?,
            period,
            is_whole: arguments[period].bound == Bound::Count,
            phase: place("phase")?,
        })
    }

    fn guess(self, values: Vec<f64>) -> Guess {
        Guess { values, neutral: Some((self.amplitude, 0.0)), phase: Some(self.phase) }
    }

    /// Numbers with an amplitude, a number of periods in `base`, and a phase.
    fn values(self, count: usize, amplitude: f64, number: f64, base: f64, phase: f64) -> Vec<f64> {
        let mut values = vec![f64::NAN; count];
        values[self.amplitude] = amplitude;
        values[self.period] = if self.is_whole { number } else { base / number };
        values[self.phase] = phase;
        values
    }
}

/// Motion along the position of a wave hypothesis.
pub(super) struct WaveMotion<'f> {
    hypothesis: usize,
    wave: Wave,
    /// The number of numbers of the effect.
    count: usize,
    /// The period of a slow wave.
    base: f64,
    /// For each record.
    turning: Vec<Turning<'f>>,
}

impl WaveMotion<'_> {
    /// A wave with these columns of each record. `number` is the number of its periods in a slow wave.
    fn candidate(&self, number: f64, waves: Vec<[Vec<Vec<f64>>; 2]>) -> Option<Candidate> {
        let (sin, cos): (Vec<_>, Vec<_>) = waves.into_iter().map(|[sin, cos]| (sin, cos)).unzip();
        let [sin, cos] = [sin, cos].map(|quarter| blocks(quarter.into_iter().flatten().collect()));
        let guess = self.wave.guess(self.wave.values(self.count, 1.0, number, self.base, 0.0));
        Some(Candidate { hypothesis: self.hypothesis, guess, columns: vec![sin?, cos?] })
    }

    /// The largest number of periods of the slow wave in a record.
    fn periods(&self) -> f64 {
        self.turning.iter().map(Turning::turns).fold(0.0, f64::max)
    }
}

/// The number of periods that are tried in addition to whole orders.
pub(super) fn looks(motions: &[WaveMotion<'_>]) -> usize {
    motions.iter().filter(|it| !it.wave.is_whole).count() * 2 * MOST
}

impl Equations<'_> {
    /// The motion along the position of each wave hypothesis.
    pub(super) fn motions(&self, nominal: &Model, hypotheses: &[Hypothesis]) -> Vec<WaveMotion<'_>> {
        let kind = nominal.file.kind;
        let mut list = Vec::new();
        for (place, hypothesis) in hypotheses.iter().enumerate() {
            let Some(wave) = Wave::of(hypothesis) else { continue };
            let Some(first) = hypothesis.guesses.first() else { continue };
            let (count, amplitude) = (first.values.len(), first.values[wave.amplitude]);
            // A row must not take a slow wave through half a period.
            let base = SLOW * first.values[wave.period];
            let with = |number: f64, phase: f64| {
                let values = wave.values(count, amplitude, number, base, phase);
                nominal.joined(nominal, hypothesis.entry(kind, &values))
            };
            let slow = [with(1.0, 0.0), with(1.0, std::f64::consts::FRAC_PI_2), with(2.0, 0.0)];
            let places: Vec<usize> = (0..self.filters.len()).collect();
            let turning = in_threads(&places, self.whitened.threads, |place| {
                let (record, filter) = &self.filters[*place];
                let files = slow.each_ref().map(|it| it.for_record(*record, &filter.prepared.record));
                Turning::new(filter, &files, amplitude)
            });
            if let Some(turning) = turning.into_iter().collect::<Option<Vec<Turning<'_>>>>() {
                list.push(WaveMotion { hypothesis: place, wave, count, base, turning });
            }
        }
        list
    }

    /// A wave as a candidate. `number` is the number of its periods in a slow wave.
    fn wave(&self, motion: &WaveMotion<'_>, number: f64) -> Option<Candidate> {
        motion.candidate(number, motion.turning.iter().map(|it| it.wave(number)).collect())
    }

    /// Waves as candidates, for some multiples of a number of periods.
    fn waves(&self, motion: &WaveMotion<'_>, number: f64, multiples: Range<usize>) -> Vec<Option<Candidate>> {
        let mut each: Vec<_> = motion.turning.iter().map(|it| it.waves(number, multiples.clone()).into_iter()).collect();
        let one =
            |multiple: usize| motion.candidate(multiple as f64 * number, each.iter_mut().filter_map(Iterator::next).collect());
        multiples.map(one).collect()
    }

    /// Waves of effort over an angle, at every whole order that the records resolve.
    pub(super) fn orders(&self, motions: &[WaveMotion<'_>]) -> Vec<Candidate> {
        let mut list = Vec::new();
        // Over less than a turn, an order looks like a smooth torque.
        for motion in motions.iter().filter(|it| it.wave.is_whole && it.periods() >= 1.0) {
            let orders = angle::blocks(1, MOST_ORDER + 1);
            let waves = in_threads(&orders, self.whitened.threads, |block| self.waves(motion, 1.0, block.clone()));
            list.extend(waves.into_iter().flatten().flatten());
        }
        list
    }

    /// Waves of effort over a distance, whose period is no whole number: the best of all periods that fit into the travel, each refined between its
    /// neighbours. They depend on what a base already explains.
    pub(super) fn periods(&self, motions: &[WaveMotion<'_>], base: &Base) -> Vec<Candidate> {
        let gain = |it: Option<Candidate>| it.map_or(0.0, |it| base.with_columns(&it.columns).gain);
        let mut list = Vec::new();
        for motion in motions.iter().filter(|it| !it.wave.is_whole) {
            let travel = motion.turning.iter().map(Turning::travel).fold(0.0, f64::max);
            if travel <= 0.0 {
                continue;
            }
            // A spectral line is half a wave over the travel wide.
            let line = 0.5 / travel;
            let halves = angle::blocks(LONGEST_WAVE, 2 * MOST);
            let gains = in_threads(&halves, self.whitened.threads, |block| {
                self.waves(motion, line, block.clone()).into_iter().map(gain).collect::<Vec<f64>>()
            });
            let gains: Vec<f64> = gains.into_iter().flatten().collect();
            let refined = in_threads(&peaks(&gains, REFINED_WAVES), self.whitened.threads, |&k| {
                let number = (LONGEST_WAVE + k) as f64 * line;
                let ends = [(number - line).max(LONGEST_WAVE as f64 * line), number + line];
                self.wave(motion, largest_between(ends, &|number| gain(self.wave(motion, number))))
            });
            list.extend(refined.into_iter().flatten());
        }
        list
    }
}

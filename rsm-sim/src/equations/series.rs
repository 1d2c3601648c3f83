//! Steps by the series of the solution.
//!
//! In: a walk at an instant, a length. Out: the states after the step, if the last terms of the series show that it was not too long. Terms decrease
//! like powers; if the last two are below a power of the tolerance, the next term is below the tolerance (A. Jorba, M. Zou, "A software package for
//! the numerical integration of ODEs by means of high-order Taylor methods", 2005, section 3). More orders are computed until this is so, or the step
//! is shortened. If the rates are not polynomials, they are also compared at the end of the step with the slope of the series, which detects a kink
//! inside the step.

use super::thresholds::root;
use super::walk::{Walk, larger, scale};
use crate::code::{Slot, Work, lengthen, over_lanes};

/// The permitted difference between the slope of the series and the rates at its end, in units of the order times the tolerance. One more term of the
/// series would change the slope by the order times the tolerance.
const SLOPE: f64 = 4.0;

/// The largest number of iterations for a step length that agrees with the size of the states. One iteration shortens the step by at most a tenth
/// root of the tolerance.
const ROUNDS: usize = 16;

/// A step of a lane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Tried {
    /// The highest order in use.
    pub order: usize,
    /// The share of the step that the terms permit, at most 1.
    pub share: f64,
}

impl<const L: usize> Walk<'_, L> {
    /// Evaluates the series of all lanes over their steps. An error is compared with the largest magnitude of the state so far, or with its change in
    /// the step. The states at the end of the permitted step are written to `behind`. Returns `None` for a lane with a value that is not finite.
    /// Lanes that are not in `asked` do not cause further orders.
    pub(super) fn series(&mut self, steps: [f64; L], asked: [bool; L]) -> [Option<Tried>; L] {
        let layout = self.programs.layout;
        self.slots[layout.step as usize] = steps;
        let count = self.programs.counts.states;
        if count == 0 {
            return asked.map(|asked| asked.then_some(Tried { order: 1, share: 1.0 }));
        }
        let states = layout.states as usize;
        let mut tried: [Option<Tried>; L] = [None; L];
        let mut open = asked;
        for place in 0.. {
            self.programs.part(place);
            lengthen(&mut self.slots, self.programs.slots());
            let part = self.programs.part(place);
            part.code.run(&mut self.slots, &mut self.spare);
            let order = part.order;
            let (last, before) = self.thresholds.of(order);
            let terms = &self.programs.terms;
            let (first_term, last_term, term_before) =
                (terms[0] as usize, terms[order - 1] as usize, terms[order - 2] as usize);
            let end = self.programs.end() as usize;
            let list = |begin: usize| &self.slots[begin..begin + count];
            let check = Check {
                lists: [states, layout.largest as usize, first_term, end, last_term, term_before].map(list),
                limits: [last, before],
            };
            let fit = over_lanes::<L, _>(check);
            let fits: [bool; L] = std::array::from_fn(|lane| open[lane] && fit[lane]);
            for lane in (0..L).filter(|lane| fits[*lane]) {
                tried[lane] = Some(Tried { order, share: 1.0 });
                open[lane] = false;
            }
            if fits == [true; L] {
                self.step_end.copy_from_slice(&self.slots[end..end + count]);
            } else if fits.contains(&true) {
                for k in 0..count {
                    for lane in (0..L).filter(|lane| fits[*lane]) {
                        self.step_end[k][lane] = self.slots[end + k][lane];
                    }
                }
            }
            if !open.contains(&true) || order + 2 > self.thresholds.most() {
                break;
            }
        }
        for lane in (0..L).filter(|lane| open[*lane]) {
            tried[lane] = self.shortened(lane);
        }
        tried
    }

    /// The share of a step that all terms permit, and the states there.
    fn shortened(&mut self, lane: usize) -> Option<Tried> {
        let order = self.thresholds.most();
        let (last, before) = self.thresholds.of(order);
        let (states, count) = (self.programs.layout.states as usize, self.programs.counts.states);
        let mut share = 1.0_f64;
        // The change of a state is estimated from the terms at the current share, so terms that are too large lose influence in each iteration.
        for _ in 0..ROUNDS {
            let at = share;
            let [power_before, power] = self
                .with_moved(|slots, terms, moved| over_lanes::<L, _>(Largest { slots, terms: &terms[..order], share, moved }));
            // For each of the two terms: the smallest permitted change of its size.
            let mut least = [f64::INFINITY; 2];
            for k in 0..count {
                let term = |order: usize| self.slots[self.programs.terms[order - 1] as usize + k][lane].abs();
                let x = self.slots[states + k][lane];
                let scale = scale(x, self.largest(k)[lane], self.moved[k][lane]);
                let found = [term(order) * power, term(order - 1) * power_before];
                for (least, (found, limit)) in least.iter_mut().zip(found.into_iter().zip([last, before])) {
                    if !found.is_finite() {
                        return None;
                    }
                    if found > limit * scale {
                        *least = least.min(limit * scale / found);
                    }
                }
            }
            for (least, degree) in least.into_iter().zip([order, order - 1]) {
                if least < f64::INFINITY {
                    share = share.min(at * root(least, degree));
                }
            }
            if share == at {
                break;
            }
        }
        if share <= 0.0 {
            return None;
        }
        let tried = Tried { order, share: 0.9 * share };
        self.sum_up_to(tried.order, tried.share);
        for k in 0..count {
            self.step_end[k][lane] = self.before[k][lane] + self.moved[k][lane];
        }
        Some(tried)
    }

    /// Computes numbers of all states from the terms of the series, in `moved`.
    fn with_moved<T>(&mut self, work: impl FnOnce(&[[f64; L]], &[Slot], &mut [[f64; L]]) -> T) -> T {
        self.moved.clear();
        self.moved.resize(self.programs.counts.states, [0.0; L]);
        work(&self.slots, &self.programs.terms, &mut self.moved)
    }

    /// Computes the changes of all states up to a share of a step, in `moved`.
    fn sum_up_to(&mut self, order: usize, share: f64) {
        self.with_moved(|slots, terms, moved| {
            over_lanes::<L, _>(Sum { slots, terms: &terms[..order], share, moved });
        });
    }

    /// Moves all lanes to a share of a step whose series have the same order.
    pub(super) fn put_on_series(&mut self, order: usize, share: f64, time: f64) {
        self.sum_up_to(order, share);
        let states = self.programs.layout.states as usize;
        for ((to, begun), moved) in self.slots[states..].iter_mut().zip(&self.before).zip(&self.moved) {
            *to = std::array::from_fn(|lane| begun[lane] + moved[lane]);
        }
        self.slots[self.programs.layout.time as usize] = [time; L];
    }

    /// Moves a lane to a share of its step.
    pub(super) fn put_lane_on_series(&mut self, lane: usize, tried: Option<Tried>, share: f64, time: f64) {
        let Some(tried) = tried else { return };
        self.sum_up_to(tried.order, share);
        let states = self.programs.layout.states as usize;
        for ((to, begun), moved) in self.slots[states..].iter_mut().zip(&self.before).zip(&self.moved) {
            to[lane] = begun[lane] + moved[lane];
        }
        self.slots[self.programs.layout.time as usize][lane] = time;
    }

    /// Stores the states at the start of the step.
    pub(super) fn store_step_start(&mut self) {
        let states = self.programs.layout.states as usize;
        self.before.copy_from_slice(&self.slots[states..states + self.programs.counts.states]);
    }

    /// Whether the rates at the end of the step, where the states are now, agree with the slope of the series.
    pub(super) fn slopes_agree(&mut self, steps: [f64; L], tried: &[Option<Tried>; L]) -> [bool; L] {
        if self.programs.is_polynomial {
            return [true; L];
        }
        self.programs.rates.code.run(&mut self.slots, &mut self.spare);
        let rates = self.programs.rates.results as usize;
        let states = self.programs.layout.states as usize;
        let mut agree = [true; L];
        for lane in 0..L {
            let Some(tried) = tried[lane] else { continue };
            for k in 0..self.programs.counts.states {
                let term = |order: usize| self.slots[self.programs.terms[order - 1] as usize + k][lane];
                let mut slope = 0.0;
                for order in (1..=tried.order).rev() {
                    slope = slope * tried.share + order as f64 * term(order);
                }
                let (end, begin) = (self.slots[states + k][lane], self.before[k][lane]);
                let scale = self.largest(k)[lane].max(begin.abs()).max((end - begin).abs()).max(term(1).abs());
                let off = (steps[lane] * self.slots[rates + k][lane] - slope).abs() * tried.share;
                let allowed = SLOPE * (tried.order + 1) as f64 * self.thresholds.tolerance() * scale;
                agree[lane] &= off <= allowed;
            }
        }
        agree
    }
}

/// Whether the last two terms permit a step. `lists`: the states at its start, their largest magnitudes, the first terms, the states at its end, the
/// last terms, and those before. `limits`: for the last two.
struct Check<'a, const L: usize> {
    lists: [&'a [[f64; L]]; 6],
    limits: [f64; 2],
}

impl<const L: usize> Work for Check<'_, L> {
    type Found = [bool; L];

    #[inline(always)]
    fn run(self) -> [bool; L] {
        let Check { lists: [begin, largest, first, end, one, other], limits: [last, before] } = self;
        let errors = end.iter().zip(one.iter().zip(other));
        // As whole words, comparisons of lanes are vector instructions.
        let mut over = [0_u64; L];
        for ((begin, (largest, first)), (end, (one, other))) in begin.iter().zip(largest.iter().zip(first)).zip(errors) {
            for lane in 0..L {
                let moved = larger((end[lane] - begin[lane]).abs(), first[lane].abs());
                let scale = scale(begin[lane], largest[lane], moved);
                let fits = [one[lane].abs() <= last * scale, other[lane].abs() <= before * scale, end[lane] * 0.0 == 0.0];
                over[lane] |= fits.into_iter().fold(0, |all, it| all | u64::from(!it));
            }
        }
        over.map(|it| it == 0)
    }
}

/// The largest change of all states up to a share of a step by one of the terms. Also the powers of the share in the last two terms.
struct Largest<'a, const L: usize> {
    slots: &'a [[f64; L]],
    /// The first slot of the terms of each order.
    terms: &'a [Slot],
    share: f64,
    moved: &'a mut [[f64; L]],
}

impl<const L: usize> Work for Largest<'_, L> {
    type Found = [f64; 2];

    #[inline(always)]
    fn run(self) -> [f64; 2] {
        let Largest { slots, terms, share, moved } = self;
        let (mut power_before, mut power) = (1.0, 1.0);
        for begin in terms {
            (power_before, power) = (power, power * share);
            for (moved, term) in moved.iter_mut().zip(&slots[*begin as usize..]) {
                for lane in 0..L {
                    moved[lane] = larger(term[lane].abs() * power, moved[lane]);
                }
            }
        }
        [power_before, power]
    }
}

/// The change of all states up to a share of a step.
struct Sum<'a, const L: usize> {
    slots: &'a [[f64; L]],
    /// The first slot of the terms of each order.
    terms: &'a [Slot],
    share: f64,
    moved: &'a mut [[f64; L]],
}

impl<const L: usize> Work for Sum<'_, L> {
    type Found = ();

    #[inline(always)]
    fn run(self) {
        let Sum { slots, terms, share, moved } = self;
        for begin in terms.iter().rev() {
            for (moved, term) in moved.iter_mut().zip(&slots[*begin as usize..]) {
                for lane in 0..L {
                    moved[lane] = (moved[lane] + term[lane]) * share;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether a step fits whose last term may have a quarter of the scale, and the one before half of it.
    fn fits([begin, largest, first, end, one, other]: [f64; 6]) -> bool {
        let lists = [begin, largest, first, end, one, other].map(|it| [[it]]);
        Check { lists: lists.each_ref().map(|it| &it[..]), limits: [0.25, 0.5] }.run() == [true]
    }

    #[test]
    fn both_last_terms_are_compared_with_the_largest_of_four() {
        // In each case another number is the scale, 8.
        for [begin, largest, first, end] in
            [[-8.0, 0.0, 1.0, -7.0], [1.0, 8.0, 1.0, 2.0], [1.0, 0.0, -8.0, 2.0], [1.0, 0.0, 1.0, -7.0]]
        {
            for (one, other, wanted) in [(2.0, -4.0, true), (-2.1, 4.0, false), (2.0, 4.1, false), (0.0, 4.1, false)] {
                assert_eq!(
                    fits([begin, largest, first, end, one, other]),
                    wanted,
                    "{begin} {largest} {first} {end}: {one} {other}"
                );
            }
        }
        for end in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert!(!fits([1.0, 1.0, 1.0, end, 0.0, 0.0]));
        }
    }
}

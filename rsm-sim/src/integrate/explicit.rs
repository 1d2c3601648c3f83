//! The classical Runge-Kutta method of fourth order (M. W. Kutta, 1901), which meets a change of law when it happens.
//!
//! In: a system, its state with the rates there, a step. Out: the state a step later. The laws of joints keep their pieces for the whole step, also a little
//! beyond their ends; where the state at the end belongs to other pieces, the crossing is located on the cubic through both ends, the step is
//! taken up to it, and the rest under the new pieces. Never takes a stage across a kink.

use super::{System, Work};
use crate::plants::Plant;

/// Halvings that place a crossing: 1e-6 of a step, as exact as the cubic itself (a step of a quarter of a radian leaves 0.25^4/384, 1e-5).
const HALVINGS: usize = 20;

/// Crossings in one step; what turns back oftener is chatter between two laws, and the rest of the step is taken under one of them.
const MOST_CROSSINGS: usize = 8;

/// What is left of a step after a crossing is not taken when it is this share of the step: rounding.
const NOTHING: f64 = 1e-9;

/// One step under the pieces that are held; the rates at its start are in place.
pub(super) fn advance<P: Plant>(system: &System<'_, P>, work: &mut Work, held: Option<u32>, time: f64, step: f64) {
    for (k, share) in [(1, 0.5), (2, 0.5), (3, 1.0)] {
        let Work { x, trial, k: rates, outputs, .. } = &mut *work;
        for ((trial, x), rate) in trial.iter_mut().zip(x.iter()).zip(&rates[k - 1]) {
            *trial = x + share * step * rate;
        }
        system.rates(held, time + share * step, trial, &mut rates[k], outputs);
    }
    let Work { x, k: [a, b, c, d], .. } = &mut *work;
    for ((((x, a), b), c), d) in x.iter_mut().zip(&*a).zip(&*b).zip(&*c).zip(&*d) {
        *x += step / 6.0 * (a + 2.0 * (b + c) + d);
    }
}

/// One step in which pieces may change; from and to a state with its rates in place. Answers the pieces at the end.
pub(super) fn across<P: Plant>(system: &System<'_, P>, work: &mut Work, pieces: u32, time: f64, step: f64) -> u32 {
    let (mut pieces, mut time, mut left) = (pieces, time, step);
    for _ in 0..MOST_CROSSINGS {
        work.before.copy_from_slice(&work.x);
        work.first.copy_from_slice(&work.k[0]);
        advance(system, work, Some(pieces), time, left);
        let next = system.rates_here(Some(pieces), time + left, work);
        if next == pieces {
            return pieces;
        }
        let (share, beyond) = crossing(system, work, pieces, next, time, left);
        work.x.copy_from_slice(&work.before);
        work.k[0].copy_from_slice(&work.first);
        advance(system, work, Some(pieces), time, share * left);
        pieces = beyond;
        time += share * left;
        left *= 1.0 - share;
        system.rates_here(Some(pieces), time, work);
        if left <= NOTHING * step {
            return pieces;
        }
    }
    advance(system, work, Some(pieces), time, left);
    system.rates_here(None, time + left, work)
}

/// The share of the step after which other pieces are at work, and which.
fn crossing<P: Plant>(system: &System<'_, P>, work: &mut Work, held: u32, next: u32, time: f64, step: f64) -> (f64, u32) {
    let Work { x, before, first, trial, k: [last, scratch, ..], outputs, .. } = &mut *work;
    let (mut low, mut high, mut beyond) = (0.0, 1.0, next);
    for _ in 0..HALVINGS {
        let s = 0.5 * (low + high);
        // Hermite's cubic through states and rates at both ends.
        let (start, end) = ((1.0 + 2.0 * s) * (1.0 - s) * (1.0 - s), s * s * (3.0 - 2.0 * s));
        let (leave, arrive) = (step * s * (1.0 - s) * (1.0 - s), -step * s * s * (1.0 - s));
        for (i, trial) in trial.iter_mut().enumerate() {
            *trial = start * before[i] + end * x[i] + leave * first[i] + arrive * last[i];
        }
        let found = system.rates(Some(held), time + s * step, trial, scratch, outputs);
        if found == held {
            low = s;
        } else {
            (high, beyond) = (s, found);
        }
    }
    (high, beyond)
}

#[cfg(test)]
mod tests {
    use crate::plant_file::PlantFile;
    use crate::record::Record;
    use crate::simulate::Simulator;
    use rsm_core::source::Source;

    #[test]
    fn a_contact_is_met_when_it_must() {
        // 1 N on a drive of 1 kg, which meets a carriage of 1 kg after 10 mm, at t_c = sqrt(0.02) s with v = t_c: between two rows and inside a step.
        let text = "format = 1\nplant = \"servo-axis\"\n[parameters]\nmass = 2\nforce_gain = 1\nviscous_friction = 0\ncommand_limit = 10\n\
                    [[effects]]\nkind = \"backlash\"\nparameters = { gap = 0.02, mass_ratio = 0.5, stiffness = 400.0, damping = 4.0 }\n";
        let plant = PlantFile::read(&Source::new("axis.toml", text)).unwrap();
        let mut rows = "time[s],command[V],position[m]\n".to_string();
        for row in 0..6 {
            rows += &format!("{},1,0\n", 0.05 * f64::from(row));
        }
        let record = Record::read(&Source::new("in.csv", rows), &plant).unwrap();
        let position = &Simulator::new(&plant, &record).unwrap().run(&record).unwrap().values[0];
        let (meets, decay, rate) = (0.02_f64.sqrt(), 4.0, 28.0);
        for (row, found) in position.iter().enumerate() {
            let t = 0.05 * row as f64;
            // The centre of mass goes t^2/4; half the twist beside it, which is t^2/2 and then 10 mm + z with z'' = 1 - 2 (400 z + 4 z'): about 1/800 with
            // decay 4 and rate sqrt(800 - 16) = 28.
            let s = t - meets;
            let rest = 1.0 / 800.0;
            let swing = -rest * f64::cos(rate * s) + (meets - decay * rest) / rate * f64::sin(rate * s);
            let twist = if s < 0.0 { t * t / 2.0 } else { 0.01 + rest + (-decay * s).exp() * swing };
            let expected = t * t / 4.0 + twist / 2.0;
            // Twelve steps a row of an eighth of a radian leave 0.125^4/120, 2e-6 of 5 mm; the damper's jump of 0.57 N, misplaced by a thirtieth of a step, would
            // leave 1e-6 m.
            assert!((found - expected).abs() < 2e-8, "{t} s: {found} for {expected}");
        }
    }
}

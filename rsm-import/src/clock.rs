//! The times of a record: times of day and dates as seconds, rounded clocks, jitter, gaps, and the constant period.
//!
//! In: the times of the rows as the logger wrote them. Out: the rows that are kept, their times, and what was found. Three faults are distinguished:
//! a *rounded* clock (steps of 0, 1 and 2 ms although the rows are uniform: the times differ from a straight line by at most half a unit of the last
//! decimal), *jitter* (the rows themselves are not uniform), and *gaps* (missing rows).

use rsm_core::number::decimal;

/// Jitter up to this share of the period is not corrected: a record may have it (docs/book/src/reference/plants.md 1.2).
const JITTER: f64 = 0.01;

/// A step longer than this many periods is a gap. In a uniform record one missing row is a gap. With jitter a step of two periods may be one late
/// row.
const GAP_OF_UNIFORM: f64 = 1.5;
const GAP_WITH_JITTER: f64 = 3.0;

/// Up to this many long steps between otherwise uniform rows are gaps: a few may look by chance like the steps of a rounded clock. Five rarely do.
const FEW_GAPS: usize = 4;

/// The instants of a log, in increasing order.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Clock {
    /// Rows of the log that are kept, in order.
    pub rows: Vec<usize>,
    /// Their instants, in s; strictly increasing.
    pub times: Vec<f64>,
    /// The mean step without gaps, in s.
    pub period: f64,
    /// The largest deviation of a step from the period without gaps, in s.
    pub jitter: f64,
    /// Whether the rows are uniform without a correction.
    pub is_uniform: bool,
    /// First and last instant of every gap, in s.
    pub gaps: Vec<[f64; 2]>,
    /// The corrections, in words.
    pub notes: Vec<String>,
}

impl Clock {
    /// Orders the times; NaN is a missing time.
    ///
    /// # Errors
    /// A sentence, with the row (from 0) if there is one.
    pub(crate) fn of(instants: &[f64]) -> Result<Clock, (Option<usize>, String)> {
        let mut notes = Vec::new();
        let present: Vec<usize> = (0..instants.len()).filter(|row| instants[*row].is_finite()).collect();
        if present.len() < instants.len() {
            notes.push(format!("{} rows without an instant are left out", instants.len() - present.len()));
        }
        if present.len() < 3 {
            return Err((None, format!("found {} rows with an instant, expected at least three", present.len())));
        }
        let times: Vec<f64> = present.iter().map(|row| instants[*row]).collect();
        let (rows, times, back) = increasing(&present, &times);
        // Up to one row in a hundred is a fault of the logger. With more the column is not a time.
        if back.len() > 1 + present.len() / 100 {
            let (row, from, to) = back[0];
            return Err((
                Some(row),
                format!("time goes back from {from} s to {to} s, here and in {} more rows", back.len() - 1),
            ));
        }
        if let Some((_, from, to)) = back.first() {
            notes.push(format!("{} rows in which time goes back are left out, the first from {from} s to {to} s", back.len()));
        }
        let as_read = Clock::steady(rows.clone(), times.clone(), GAP_OF_UNIFORM);
        // Steps of 1 and 2 ms are lost rows, or a rounded period of 1.25 ms. If rows are lost at random, the times are not on one straight line.
        let is_clear = as_read.is_uniform && as_read.gaps.len() <= FEW_GAPS;
        let mut clock = match (!is_clear).then(|| rounded(&times)).flatten() {
            None if as_read.is_uniform => as_read,
            Some((quantum, straight)) => {
                notes.push(format!(
                    "instants are rounded to {} s; within this rounding the rows are uniform, and a straight line gives their instants",
                    decimal(quantum)
                ));
                Clock::steady(rows, straight, GAP_OF_UNIFORM)
            }
            None => {
                // Of several rows with the same time the first is kept.
                let distinct: Vec<usize> = (0..times.len()).filter(|k| *k == 0 || times[*k] > times[k - 1]).collect();
                if distinct.len() < times.len() {
                    notes
                        .push(format!("{} rows with the instant of the row before are left out", times.len() - distinct.len()));
                }
                let rows: Vec<usize> = distinct.iter().map(|k| rows[*k]).collect();
                let times: Vec<f64> = distinct.iter().map(|k| times[*k]).collect();
                if times.len() < 3 {
                    return Err((None, format!("found {} different instants, expected at least three", times.len())));
                }
                Clock::steady(rows, times, GAP_WITH_JITTER)
            }
        };
        if !clock.is_uniform {
            notes.push(format!(
                "jitter: steps differ from the period of {} s by up to {} s ({:.0} %)",
                short(clock.period),
                short(clock.jitter),
                100.0 * clock.jitter / clock.period
            ));
        }
        if let Some([from, to]) = clock.gaps.first() {
            let missing: f64 = clock.gaps.iter().map(|gap| gap[1] - gap[0]).sum();
            notes.push(format!(
                "{} gaps of {} s together, the first from {} s to {} s; nothing is filled in",
                clock.gaps.len(),
                short(missing),
                short(*from),
                short(*to)
            ));
        }
        clock.notes = notes;
        Ok(clock)
    }

    fn steady(rows: Vec<usize>, times: Vec<f64>, gap: f64) -> Clock {
        let median = median_step(&times);
        let steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let is_gap = |step: f64| step > gap * median;
        let (sum, count) =
            steps.iter().filter(|step| !is_gap(**step)).fold((0.0, 0), |(sum, count), step| (sum + step, count + 1));
        let period = if count > 0 { sum / f64::from(count) } else { median };
        let jitter = steps.iter().filter(|step| !is_gap(**step)).map(|step| (step - period).abs()).fold(0.0, f64::max);
        let gaps = times.windows(2).filter(|pair| is_gap(pair[1] - pair[0])).map(|pair| [pair[0], pair[1]]).collect();
        Clock { rows, times, period, jitter, is_uniform: period > 0.0 && jitter <= JITTER * period, gaps, notes: Vec::new() }
    }

    /// Times with a constant period over the same span, none within a gap.
    pub(crate) fn grid(&self, period: f64) -> Vec<f64> {
        let (first, last) = (self.times[0], self.times[self.times.len() - 1]);
        // Slightly more, so that rounding does not drop the last time.
        let count = ((last - first) / period * (1.0 + 1e-12) + 1e-6).floor() as usize;
        let inverse = (1.0 / period).round();
        // 0.001 is not an f64 number: k/1000 is rounded once, k*0.001 twice.
        let is_whole = (inverse * period - 1.0).abs() < 4.0 * f64::EPSILON;
        let mut gaps = self.gaps.iter().peekable();
        let mut grid = Vec::with_capacity(count + 1);
        for k in 0..=count {
            let since = if is_whole { k as f64 / inverse } else { k as f64 * period };
            let instant = first + since;
            while gaps.next_if(|gap| gap[1] <= instant).is_some() {}
            if gaps.peek().is_none_or(|gap| instant <= gap[0]) {
                grid.push(instant);
            }
        }
        grid
    }
}

/// A row at which time goes back, with the times before and after.
type Back = (usize, f64, f64);

/// Rows whose times increase, and the rows at which time goes back.
fn increasing(present: &[usize], times: &[f64]) -> (Vec<usize>, Vec<f64>, Vec<Back>) {
    let (mut rows, mut kept, mut back) = (Vec::new(), Vec::new(), Vec::new());
    let mut latest = f64::NEG_INFINITY;
    for (row, time) in present.iter().zip(times) {
        if *time < latest {
            back.push((*row, latest, *time));
        } else {
            latest = *time;
            rows.push(*row);
            kept.push(*time);
        }
    }
    (rows, kept, back)
}

fn median_step(times: &[f64]) -> f64 {
    let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps.sort_by(f64::total_cmp);
    steps[steps.len() / 2]
}

/// The unit of the last decimal of a clock, and the straight line that was rounded to it; `None` if the times are not a rounded straight line.
fn rounded(times: &[f64]) -> Option<(f64, Vec<f64>)> {
    let scale = times.iter().fold(0.0, |scale: f64, time| scale.max(time.abs()));
    // The unit of the last decimal: 1 s to 0.1 us.
    let quantum = (0..8).map(|digits| 10f64.powi(-digits)).find(|quantum| {
        let slack = 1e-6 + 4.0 * f64::EPSILON * scale / quantum;
        times.iter().all(|time| (time / quantum - (time / quantum).round()).abs() <= slack)
    })?;
    let count = times.len();
    // Rows in a piece without gaps are on a line. A piece ends where a step is longer than the typical step by more than rounding and half a period.
    let typical = typical_step(times, quantum);
    let mut straight = Vec::with_capacity(count);
    let mut start = 0;
    let mut pieces: Vec<std::ops::Range<usize>> = Vec::new();
    for k in 1..=count {
        if k == count || times[k] - times[k - 1] > GAP_OF_UNIFORM * typical + quantum {
            pieces.push(start..k);
            start = k;
        }
    }
    // One rate for all pieces: least squares within each.
    let (mut product, mut square) = (0.0, 0.0);
    for piece in &pieces {
        let (index, time) = means(piece, times);
        for k in piece.clone() {
            product += (k as f64 - index) * (times[k] - time);
            square += (k as f64 - index).powi(2);
        }
    }
    let period = product / square;
    if period.is_nan() || period <= 0.0 {
        return None;
    }
    for piece in pieces {
        let (index, time) = means(&piece, times);
        let line = |k: usize| time + period * (k as f64 - index);
        let away = piece.clone().map(|k| times[k] - line(k));
        let (low, high) = away.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), it| (low.min(it), high.max(it)));
        // Rounding, to nearest or down, changes a time by at most one unit of the last decimal. A tenth more allows for the error of the line.
        if high - low > 1.1 * quantum {
            return None;
        }
        // The middle of the range of the deviations; their mean would depend on the distribution of the fractions.
        straight.extend(piece.map(|k| line(k) + (low + high) / 2.0));
    }
    straight.windows(2).all(|pair| pair[1] > pair[0]).then_some((quantum, straight))
}

/// The usual step of a rounded clock: the mean of the middle half of its sorted steps, which contains no gap.
fn typical_step(times: &[f64], quantum: f64) -> f64 {
    let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps.sort_by(f64::total_cmp);
    let median = steps[steps.len() / 2];
    let usual: Vec<f64> = steps.into_iter().filter(|step| *step <= median + 1.5 * quantum).collect();
    usual.iter().sum::<f64>() / usual.len() as f64
}

fn means(piece: &std::ops::Range<usize>, times: &[f64]) -> (f64, f64) {
    let count = piece.len() as f64;
    let index = piece.clone().map(|k| k as f64).sum::<f64>() / count;
    (index, times[piece.clone()].iter().sum::<f64>() / count)
}

/// A period rounded to three digits, which is easy to read; any period near the mean is allowed.
pub(crate) fn readable(period: f64) -> f64 {
    format!("{period:.2e}").parse().unwrap_or(period)
}

/// Four digits for a message.
pub(crate) fn short(value: f64) -> String {
    let rounded: f64 = format!("{value:.3e}").parse().unwrap_or(value);
    decimal(rounded)
}

/// Seconds of a time of day or a date: `12:34:56.789`, `2024-05-01T12:34:56.789Z`, `01.05.2024 12:34:56,789`, `2024/05/01 12:34:56`. Days of a date
/// count from 1970; a time zone is removed.
pub(crate) fn instant(text: &str) -> Option<f64> {
    let text = text.trim().trim_end_matches('Z');
    let (date, time) = match text.split_once(['T', ' ']) {
        Some((date, time)) => (Some(date), time.trim()),
        None => (None, text),
    };
    let (time, zone) = match time.rfind(['+', '-']) {
        Some(at) if at > 0 => (&time[..at], zone(&time[at..])?),
        _ => (time, 0.0),
    };
    let seconds = time_of_day(time)?;
    let days = match date {
        Some(date) => days(date)?,
        None => 0,
    };
    Some(days as f64 * 86400.0 + seconds - zone)
}

fn zone(text: &str) -> Option<f64> {
    let sign = if text.starts_with('-') { -1.0 } else { 1.0 };
    let (hours, minutes) = match text[1..].split_once(':') {
        Some(parts) => parts,
        None if text.len() == 5 && text.is_ascii() => text[1..].split_at(2),
        None => (&text[1..], "0"),
    };
    Some(sign * (f64::from(whole(hours)?) * 3600.0 + f64::from(whole(minutes)?) * 60.0))
}

fn whole(text: &str) -> Option<u32> {
    (text.len() <= 4 && !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit())).then(|| text.parse().ok())?
}

fn time_of_day(text: &str) -> Option<f64> {
    let mut parts = text.split(':');
    let hours = whole(parts.next()?)?;
    let minutes = whole(parts.next()?)?;
    let seconds = parts.next().unwrap_or("0").replace(',', ".");
    let is_plain = seconds.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.');
    let seconds: f64 = seconds.parse().ok().filter(|_| is_plain)?;
    (parts.next().is_none() && minutes < 60 && seconds < 61.0)
        .then(|| f64::from(hours) * 3600.0 + f64::from(minutes) * 60.0 + seconds)
}

/// Days since 1970-01-01 in the Gregorian calendar (Fliegel and van Flandern 1968).
fn days(text: &str) -> Option<i64> {
    let sign = ['-', '/', '.'].into_iter().find(|sign| text.contains(*sign))?;
    let parts: Vec<u32> = text.split(sign).map(whole).collect::<Option<_>>()?;
    let [first, month, last] = parts[..] else { return None };
    // The year has four digits. With points the day comes first. With slashes only a date with the year first is unambiguous.
    let (year, day) = if first > 31 {
        (first, last)
    } else if sign == '.' && last > 31 {
        (last, first)
    } else {
        return None;
    };
    if !(1..=12).contains(&month) || !(1..=31).contains(&day) {
        return None;
    }
    let (year, month, day) = (i64::from(year), i64::from(month), i64::from(day));
    let early = (month - 14) / 12;
    let julian = day - 32075 + 1461 * (year + 4800 + early) / 4 + 367 * (month - 2 - early * 12) / 12
        - 3 * ((year + 4900 + early) / 100) / 4;
    Some(julian - 2_440_588)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_of_day_and_dates() {
        for (text, seconds) in [
            ("00:00:01,5", Some(1.5)),
            ("12:34:56.789", Some(45296.789)),
            ("1970-01-02T00:00:00Z", Some(86400.0)),
            ("2024-02-29T12:00:00.25", Some(1_709_208_000.25)),
            ("29.02.2024 12:00:00,25", Some(1_709_208_000.25)),
            ("2024/02/29 12:00:00.25", Some(1_709_208_000.25)),
            ("2024-02-29T13:00:00.25+01:00", Some(1_709_208_000.25)),
            ("2024-02-29T07:00:00.25-0500", Some(1_709_208_000.25)),
            ("03/04/2024 12:00:00", None),
            ("2024-13-01 12:00:00", None),
            ("12:61:00", None),
            ("1.5", None),
            ("", None),
            ("-", None),
            ("a:b", None),
        ] {
            assert_eq!(instant(text), seconds, "{text}");
        }
    }

    /// Deterministic numbers in [0, 1).
    fn shares(seed: u64, count: usize) -> Vec<f64> {
        let mut random = rsm_fit::random::Random::new(seed);
        (0..count).map(|_| random.share()).collect()
    }

    #[test]
    fn a_rounded_clock_is_straightened_and_jitter_is_not() {
        for (seed, period) in [(1u64, 0.0004), (2, 0.00125), (3, 0.0133), (4, 0.02)] {
            let cut = |digits: f64, time: f64| (time * digits).floor() / digits;
            let truth: Vec<f64> = (0..2000).map(|k| 5.0 + period * f64::from(k)).collect();
            let clock = Clock::of(&truth.iter().map(|time| cut(1000.0, *time)).collect::<Vec<_>>()).unwrap();
            assert!(clock.is_uniform, "period {period}: {clock:?}");
            assert!((clock.period / period - 1.0).abs() < 1e-3, "{}", clock.period);
            // The times are truncated: the offset of half a unit of the last decimal cannot be recovered.
            let worst = clock.times.iter().zip(&truth).map(|(a, b)| (a - b + 0.0005).abs()).fold(0.0, f64::max);
            assert!(worst < 0.00055, "{worst}");
            let late: Vec<f64> =
                truth.iter().zip(shares(seed, 2000)).map(|(time, share)| time + 0.3 * period * share).collect();
            let clock = Clock::of(&late).unwrap();
            assert!(!clock.is_uniform && clock.times == late && clock.gaps.is_empty(), "period {period}");
            assert!(clock.notes.iter().any(|note| note.starts_with("jitter")), "{:?}", clock.notes);
        }
    }

    #[test]
    fn gaps_stay_gaps_and_steps_back_are_left_out() {
        let mut times: Vec<f64> = (0..1000).filter(|k| !(300..340).contains(k)).map(|k| f64::from(k) * 0.01).collect();
        let clock = Clock::of(&times).unwrap();
        assert!(clock.is_uniform && clock.gaps.len() == 1 && (clock.gaps[0][1] - 3.4).abs() < 1e-9, "{:?}", clock.gaps);
        assert!((clock.period - 0.01).abs() < 1e-12, "{}", clock.period);
        let grid = clock.grid(0.01);
        assert_eq!(grid.len(), times.len());
        assert!(grid.iter().zip(&times).all(|(a, b)| (a - b).abs() < 1e-12));
        times[500] = 0.0;
        let clock = Clock::of(&times).unwrap();
        assert_eq!(clock.rows.len(), times.len() - 1);
        assert!(!clock.rows.contains(&500) && clock.notes[0].contains("goes back"), "{:?}", clock.notes);
        let wild: Vec<f64> = shares(7, 1000);
        assert!(Clock::of(&wild).unwrap_err().1.contains("goes back"));
        assert!(Clock::of(&[0.0, f64::NAN, 1.0]).is_err() && Clock::of(&[]).is_err() && Clock::of(&[1.0; 9]).is_err());
    }

    #[test]
    fn instants_of_the_grid_are_rounded_once() {
        let clock = Clock::of(&[0.0, 0.1, 0.2, 0.3]).unwrap();
        assert_eq!(clock.grid(0.1), [0.0, 0.1, 0.2, 0.3]);
        assert_eq!(readable(0.00099999987), 0.001);
        assert_eq!(readable(0.01333333), 0.0133);
    }
}

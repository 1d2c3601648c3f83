//! Aligns the clocks of two loggers: the offset and the rate of the second one, from a signal that both have.
//!
//! In: the samples of one signal in both files. Out: offset and rate of t_first = t_second + offset + rate (t_second - middle), each with a 95 %
//! interval; or a sentence with the reason why there is no result: the signals are not correlated, or they agree equally well at another offset (a
//! periodic signal).
//!
//! Method: both signals are averaged over cells. The normalised cross-correlation over all lags gives a first offset. Then first = bias + gain
//! second(offset, rate) is estimated with instrumental variables. This is repeated on cells half as wide, down to the sampling period. The width with
//! the shortest interval gives the result. Both signals pass the same symmetric filter, so the filter shifts neither signal. The intervals come from
//! the scores of 30 blocks of the residuals (batch means: Law and Kelton, "Simulation Modeling and Analysis"), because neighbouring residuals are not
//! independent.

use nalgebra::{Matrix4, Vector4};

use crate::resample::Samples;

/// Cells of the longer signal in the search over all lags: 2 * 4096^2 products of pairs take a tenth of a second.
const CELLS: usize = 4096;

/// The smallest overlap that is tested, as a share of the shorter signal.
const LEAST_OVERLAP: f64 = 0.25;

/// Below this correlation the two columns are not treated as one signal: three quarters of the variance would have another origin.
const LEAST_CORRELATION: f64 = 0.5;

/// At any other offset the unexplained variance must be larger by this factor. Otherwise the offset is not unique.
const NEXT_BEST: f64 = 1.1;

/// Number of blocks of residuals, and the 95 % quantile of Student's t for it minus the four fitted numbers (26 degrees of freedom).
const BLOCKS: usize = 30;
const STUDENT: f64 = 2.056;

/// The clock of another file relative to that of the first file.
#[derive(Debug, Clone, PartialEq)]
pub struct Alignment {
    /// The further file.
    pub file: String,
    /// The column of the first file.
    pub first: String,
    /// The column of the further file.
    pub second: String,
    /// The offset that is added to its times, in the middle of the overlap, in s.
    pub offset: f64,
    /// Half of the 95 % interval of the offset, in s.
    pub offset_half_width: f64,
    /// The rate of the first clock relative to this clock, as a share (1e-6 is 1 ppm); 0 if its interval contains 0.
    pub rate: f64,
    /// Half of the 95 % interval of the rate.
    pub rate_half_width: f64,
    /// The time of the further file at which the offset is given, in s.
    pub middle: f64,
    /// The correlation of both signals.
    pub correlation: f64,
}

impl Alignment {
    /// Converts an instant of the further file to the clock of the first file, in s.
    #[must_use]
    pub fn to_first(&self, instant: f64) -> f64 {
        instant + self.offset + self.rate * (instant - self.middle)
    }
}

/// A signal on cells of equal width.
struct Cells {
    start: f64,
    width: f64,
    /// NaN if a cell has no sample.
    values: Vec<f64>,
}

impl Cells {
    /// Averages over cells; if a cell is as narrow as the sampling period, the interpolated value at its centre.
    fn of(samples: &Samples, width: f64) -> Cells {
        let (start, end) = samples.span();
        let count = ((end - start) / width).floor() as usize + 1;
        let values = if width < 1.5 * samples.usual() {
            (0..count).map(|k| samples.at(start + width * k as f64, false)).collect()
        } else {
            samples.averages(start - width / 2.0, width, count)
        };
        Cells { start, width, values }
    }

    /// Applies the filter 1/4, 1/2, 1/4 twice. It is symmetric, so it causes no shift.
    fn smooth(mut self) -> Cells {
        for _ in 0..2 {
            let old = self.values.clone();
            for k in 1..old.len().saturating_sub(1) {
                let mean = 0.25 * (old[k - 1] + old[k + 1]) + 0.5 * old[k];
                self.values[k] = mean;
            }
        }
        self
    }

    /// Value and slope at an instant, by linear interpolation between two centres.
    fn at(&self, instant: f64) -> Option<(f64, f64)> {
        let place = (instant - self.start) / self.width;
        // The instant is before the start, or it is NaN.
        if place.is_nan() || place < 0.0 {
            return None;
        }
        let k = place as usize;
        let (low, high) = (*self.values.get(k)?, *self.values.get(k + 1)?);
        let value = low + (high - low) * (place - k as f64);
        value.is_finite().then(|| (value, (high - low) / self.width))
    }
}

/// The fitted parameters.
#[derive(Clone, Copy)]
struct Fit {
    offset: f64,
    rate: f64,
    gain: f64,
    bias: f64,
}

/// Estimates the clock of the second signal relative to that of the first. The caller adds the names of file and columns.
pub(crate) fn align(first: &Samples, second: &Samples) -> Result<Alignment, String> {
    let longer = [first, second].iter().map(|it| it.span().1 - it.span().0).fold(0.0, f64::max);
    let finest = first.usual().max(second.usual());
    if finest <= 0.0 || first.len() < 2 * BLOCKS || second.len() < 2 * BLOCKS {
        return Err(format!("found too few samples, expected at least {} in each file", 2 * BLOCKS));
    }
    let mut width = finest.max(longer / CELLS as f64);
    let found = search(&Cells::of(first, width), &Cells::of(second, width));
    let Some(found) = found else {
        return Err("one of the two signals is constant, or they overlap for too short a time".to_string());
    };
    if found.correlation < LEAST_CORRELATION {
        return Err(format!(
            "the two signals do not agree: found a correlation of {:.2} at best, expected at least {LEAST_CORRELATION}",
            found.correlation
        ));
    }
    if 1.0 - found.next.0.powi(2) < NEXT_BEST * (1.0 - found.correlation.powi(2)) && found.next.0 > 0.0 {
        return Err(format!(
            "the offset is ambiguous: {:.4} s (correlation {:.3}) and {:.4} s ({:.3}) fit equally well; use a signal that does not repeat",
            found.offset, found.correlation, found.next.1, found.next.0
        ));
    }
    // The middle of the overlap, on the clock of the second.
    let start = second.span().0.max(first.span().0 - found.offset);
    let end = second.span().1.min(first.span().1 - found.offset);
    let middle = (start + end) / 2.0;
    let mut fit = Fit { offset: found.offset, rate: 0.0, gain: 1.0, bias: 0.0 };
    let mut best: Option<(Intervals, f64, Fit)> = None;
    loop {
        let signals = (Cells::of(first, width).smooth(), Cells::of(second, width).smooth());
        fit = newton(&signals, fit, middle, true)?;
        let intervals = intervals(&signals, fit, middle)?;
        if best.is_none_or(|(found, ..)| intervals.offset < found.offset) {
            best = Some((intervals, width, fit));
        }
        if width <= finest {
            break;
        }
        width = (width / 2.0).max(finest);
    }
    let Some((intervals, width, mut fit)) = best else { return Err(TOO_LITTLE.to_string()) };
    let signals = (Cells::of(first, width).smooth(), Cells::of(second, width).smooth());
    if fit.rate.abs() <= intervals.rate {
        fit = newton(&signals, Fit { rate: 0.0, ..fit }, middle, false)?;
    }
    let correlation = correlation(&signals, fit, middle);
    if correlation.is_nan() || correlation < LEAST_CORRELATION {
        return Err(format!(
            "the two signals agree in averages over {:.3} s, but not in detail (correlation {correlation:.2}): use a slower signal",
            longer / CELLS as f64
        ));
    }
    Ok(Alignment {
        file: String::new(),
        first: String::new(),
        second: String::new(),
        offset: fit.offset,
        offset_half_width: intervals.offset,
        rate: fit.rate,
        rate_half_width: intervals.rate,
        middle,
        correlation,
    })
}

struct Found {
    offset: f64,
    correlation: f64,
    /// The best other offset: its correlation and its value.
    next: (f64, f64),
}

/// The lag with the largest correlation of two signals.
fn search(first: &Cells, second: &Cells) -> Option<Found> {
    let centred = |cells: &Cells| -> Vec<(f64, f64)> {
        let present: Vec<f64> = cells.values.iter().copied().filter(|value| !value.is_nan()).collect();
        let mean = present.iter().sum::<f64>() / present.len() as f64;
        cells.values.iter().map(|value| if value.is_nan() { (0.0, 0.0) } else { (value - mean, 1.0) }).collect()
    };
    let (one, two) = (centred(first), centred(second));
    // Fewer cells than filters and standard deviations need are no evidence; the shorter signal has more than this in any case.
    let least = (LEAST_OVERLAP * one.len().min(two.len()) as f64).max(16.0) as usize;
    let mut scores: Vec<(i64, f64)> = Vec::new();
    for lag in least as i64 - two.len() as i64..=one.len() as i64 - least as i64 {
        // Cell k of the second signal is compared with cell k + lag of the first.
        let (from, until) = (lag.max(0) as usize, (two.len() as i64 + lag).min(one.len() as i64) as usize);
        let (mut n, mut x, mut y, mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        for (a, b) in one[from..until].iter().zip(&two[(from as i64 - lag) as usize..]) {
            let weight = a.1 * b.1;
            n += weight;
            x += weight * a.0;
            y += weight * b.0;
            xx += weight * a.0 * a.0;
            yy += weight * b.0 * b.0;
            xy += weight * a.0 * b.0;
        }
        if n < least as f64 {
            continue;
        }
        let (xx, yy, xy) = (xx - x * x / n, yy - y * y / n, xy - x * y / n);
        if xx > 0.0 && yy > 0.0 {
            scores.push((lag, xy / (xx * yy).sqrt()));
        }
    }
    let best = scores.iter().enumerate().max_by(|a, b| a.1.1.total_cmp(&b.1.1)).map(|(k, _)| k)?;
    // The peak around the best lag: its limits on both sides.
    let foot = |step: i64| -> usize {
        let mut k = best as i64;
        while let Some(next) = usize::try_from(k + step).ok().and_then(|next| scores.get(next)) {
            // A peak ends where the correlation has decreased enough; noise makes small local minima.
            if next.1 < 0.5 * scores[best].1 {
                break;
            }
            k += step;
        }
        k as usize
    };
    let (left, right) = (foot(-1), foot(1));
    let offset = |lag: i64| first.start - second.start + lag as f64 * first.width;
    let next = scores[..left].iter().chain(&scores[right + 1..]).max_by(|a, b| a.1.total_cmp(&b.1));
    Some(Found {
        offset: offset(scores[best].0),
        correlation: scores[best].1,
        next: next.map_or((0.0, 0.0), |(lag, score)| (*score, offset(*lag))),
    })
}

/// A point at which both signals have a value: the residual, its derivatives with respect to offset, rate, gain and bias, and its instruments.
///
/// The instrument of a derivative is the slope of the other signal. Its noise is independent of the noise of the derivative, because the loggers are
/// independent. Least squares would treat the noise of a slope as signal. Its offsets would be too near to the first guess, and its intervals too
/// short (instrumental variables: Soderstrom and Stoica, "System Identification", ch. 8).
struct Point {
    residual: f64,
    derivatives: Vector4<f64>,
    instruments: Vector4<f64>,
}

fn points(signals: &(Cells, Cells), fit: Fit, middle: f64) -> Vec<Point> {
    let (first, second) = signals;
    let mut points = Vec::with_capacity(first.values.len());
    for (k, three) in first.values.windows(3).enumerate().filter(|(_, three)| three.iter().all(|value| !value.is_nan())) {
        let since = first.start + first.width * (k + 1) as f64 - middle - fit.offset;
        let Some((other, slope)) = second.at(middle + since / (1.0 + fit.rate)) else { continue };
        let by_offset = -fit.gain * slope / (1.0 + fit.rate);
        let own_slope = (three[2] - three[0]) / (2.0 * first.width);
        points.push(Point {
            residual: three[1] - fit.bias - fit.gain * other,
            derivatives: Vector4::new(by_offset, by_offset * since / (1.0 + fit.rate), other, 1.0),
            instruments: Vector4::new(-own_slope, -own_slope * since, three[1], 1.0),
        });
    }
    points
}

/// The matrix of the normal equations, and their right side.
fn normal(points: &[Point], has_rate: bool) -> (Matrix4<f64>, Vector4<f64>) {
    let (mut matrix, mut right) = (Matrix4::zeros(), Vector4::zeros());
    for point in points {
        matrix += point.instruments * point.derivatives.transpose();
        right += point.instruments * point.residual;
    }
    if !has_rate {
        for k in 0..4 {
            matrix[(1, k)] = f64::from(u8::from(k == 1));
            matrix[(k, 1)] = matrix[(1, k)];
        }
        right[1] = 0.0;
    }
    (matrix, right)
}

const TOO_LITTLE: &str = "the two signals do not determine the offset: use a signal that changes";

fn newton(signals: &(Cells, Cells), mut fit: Fit, middle: f64, has_rate: bool) -> Result<Fit, String> {
    // Starting half a cell away, each step is a quarter of the step before. No case of the tests needs 20 steps.
    for _ in 0..20 {
        let points = points(signals, fit, middle);
        if points.len() < 2 * BLOCKS {
            return Err(TOO_LITTLE.to_string());
        }
        let (matrix, right) = normal(&points, has_rate);
        let step = matrix.try_inverse().ok_or(TOO_LITTLE)? * right;
        if step.iter().any(|it| !it.is_finite()) {
            return Err(TOO_LITTLE.to_string());
        }
        // At most two cells in one step: the slopes are not valid beyond that.
        let most = 2.0 * signals.0.width;
        let share = (most / step[0].abs()).min(1.0);
        fit.offset += share * step[0];
        fit.rate += share * step[1];
        fit.gain += step[2];
        fit.bias += step[3];
        // A ten-thousandth of a cell is less than any interval below.
        if step[0].abs() < 1e-4 * signals.0.width {
            break;
        }
    }
    Ok(fit)
}

/// Half of the 95 % intervals.
#[derive(Clone, Copy)]
struct Intervals {
    offset: f64,
    rate: f64,
}

fn intervals(signals: &(Cells, Cells), fit: Fit, middle: f64) -> Result<Intervals, String> {
    let points = points(signals, fit, middle);
    let (matrix, _) = normal(&points, true);
    let inverse = matrix.try_inverse().ok_or(TOO_LITTLE)?;
    let mut meat: Matrix4<f64> = Matrix4::zeros();
    for block in points.chunks(points.len().div_ceil(BLOCKS)) {
        let score: Vector4<f64> = block.iter().map(|point| point.instruments * point.residual).sum();
        meat += score * score.transpose();
    }
    let blocks = BLOCKS as f64;
    let covariance = inverse * meat * inverse.transpose() * (blocks / (blocks - 4.0));
    let half = |k: usize| STUDENT * covariance[(k, k)].max(0.0).sqrt();
    Ok(Intervals { offset: half(0), rate: half(1) })
}

fn correlation(signals: &(Cells, Cells), fit: Fit, middle: f64) -> f64 {
    let points = points(signals, fit, middle);
    let n = points.len() as f64;
    let (mut x, mut y, mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for point in &points {
        let (one, two) = (point.instruments[2], point.derivatives[2]);
        (x, y) = (x + one, y + two);
        (xx, yy, xy) = (xx + one * one, yy + two * two, xy + one * two);
    }
    (xy - x * y / n) / ((xx - x * x / n) * (yy - y * y / n)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rsm_fit::random::Random;

    /// A sum of waves that is not periodic, with steps; the same for both loggers.
    struct Signal {
        waves: Vec<[f64; 3]>,
        steps: Vec<[f64; 2]>,
    }

    impl Signal {
        fn drawn(random: &mut Random, span: f64) -> Signal {
            let waves = (0..12).map(|_| [0.2 + 3.0 * random.share(), 6.3 * random.share(), random.share()]).collect();
            let steps = (0..8).map(|_| [span * (1.4 * random.share() - 0.2), 2.0 * random.share() - 1.0]).collect();
            Signal { waves, steps }
        }

        fn at(&self, time: f64) -> f64 {
            let waves: f64 = self.waves.iter().map(|[rate, phase, size]| size * (rate * time + phase).sin()).sum();
            waves + self.steps.iter().map(|[at, size]| size / (1.0 + (-(time - at) / 0.05).exp())).sum::<f64>()
        }
    }

    fn noise(random: &mut Random) -> f64 {
        // The sum of twelve uniform numbers is close enough to a normal number.
        (0..12).map(|_| random.share()).sum::<f64>() - 6.0
    }

    fn logged(signal: &Signal, from: f64, until: f64, step: f64, level: f64, random: &mut Random) -> (Vec<f64>, Vec<f64>) {
        let count = ((until - from) / step) as usize;
        let times: Vec<f64> = (0..count).map(|k| from + step * (k as f64 + 0.2 * random.share())).collect();
        let values = times.iter().map(|time| signal.at(*time) + level * noise(random)).collect();
        (times, values)
    }

    /// 200 pairs of loggers, drawn from a seed: offsets of minutes, rates of 200 ppm, different sampling, gain and bias, noise.
    #[test]
    fn offsets_are_found_and_their_intervals_hold_them() {
        let mut random = Random::new(20);
        let (mut held, mut held_rate, mut total, mut worst) = (0, 0, 0, 0.0f64);
        for case in 0..200 {
            let span = 20.0 + 60.0 * random.share();
            let signal = Signal::drawn(&mut random, span);
            let offset = 400.0 * (random.share() - 0.5);
            let rate = if case % 2 == 0 { 4e-4 * (random.share() - 0.5) } else { 0.0 };
            let level = [0.02, 0.1, 0.3][case % 3];
            let (times, values) = logged(&signal, 0.0, span, 0.01, level, &mut random);
            let (from, until) = (span * 0.3 * (random.share() - 0.5), span * (1.0 + 0.3 * (random.share() - 0.5)));
            let (truth, other) = logged(&signal, from, until, 0.004 + 0.02 * random.share(), level, &mut random);
            // The second clock: first = second + offset + rate (second - start of the second).
            let second: Vec<f64> = truth.iter().map(|time| (time - offset - rate * offset) / (1.0 + rate)).collect();
            let other: Vec<f64> = other.iter().map(|value| 3.0 - 2.5 * -value).collect();
            let found = align(&Samples::of(&times, &values), &Samples::of(&second, &other))
                .unwrap_or_else(|why| panic!("{case}: {why}"));
            let expected = offset + rate * offset + rate * found.middle;
            total += 1;
            held += usize::from((found.offset - expected).abs() <= found.offset_half_width);
            held_rate += usize::from((found.rate - rate).abs() <= found.rate_half_width);
            worst = worst.max(found.offset_half_width);
        }
        // The noise is a third of the waves, at 100 rows a second for 20 s: the limit is three samples.
        assert!(worst < 0.03, "{worst}");
        // 95 % of 200 is 190, with a standard deviation of 3: the limits are three standard deviations away.
        assert!((181..=199).contains(&held) && total == 200, "{held} of {total} offsets within their intervals");
        assert!((181..=199).contains(&held_rate), "{held_rate} of {total} rates within their intervals");
    }

    #[test]
    fn what_repeats_or_has_nothing_in_common_is_refused() {
        let mut random = Random::new(3);
        let times: Vec<f64> = (0..4000).map(|k| f64::from(k) * 0.01).collect();
        let of = |values: Vec<f64>| Samples::of(&times, &values);
        let mut tone = || of(times.iter().map(|time| (3.0 * time).sin() + 0.01 * noise(&mut random)).collect());
        let (wave, again) = (tone(), tone());
        let said = align(&wave, &again).unwrap_err();
        assert!(said.contains("fit equally well"), "{said}");
        let (one, two): (Vec<f64>, Vec<f64>) = (0..4000).map(|_| (noise(&mut random), noise(&mut random))).unzip();
        let said = align(&of(one), &of(two)).unwrap_err();
        assert!(said.contains("the two signals do not agree"), "{said}");
        assert!(align(&wave, &of(vec![1.0; 4000])).unwrap_err().contains("constant"));
        assert!(align(&wave, &Samples::of(&times[..20], &times[..20])).unwrap_err().contains("at least 60"));
    }
}

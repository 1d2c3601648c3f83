//! Tests whether anything predicts the residual: waves over an angle or a position, of every order that the sampling can show, and powers of the
//! inputs and of the motion.
//!
//! In: a fit along records. Out: the wave or the powers that predict most, if this is more than chance among all that were tried. The octave spectrum
//! ([`super::whiteness`]) shows energy in bands of frequencies. A small wave over an angle is one spectral line among thousands there, and not even a
//! line while the speed changes. Names no cause.
//!
//! A wave is compared with its neighbouring orders, and powers with the same powers at other times of the residual. Coloured noise with a poorly
//! known spectrum raises these levels too, and is not taken for structure.

use rsm_core::order;
use rsm_core::threads::in_threads;
use std::f64::consts::TAU;

use super::levenberg::Fit;
use super::orders::{self, Coordinate, HIGHEST_FREQUENCY};
use super::quantities::{self, rounded};
use super::whitened_residuals::WhitenedResiduals;
use super::whiteness::TESTS;
use crate::engine::angle::Multiples;
use crate::engine::columns::Basis;
use crate::engine::significance::{chi_squared_of, ln_upper_chi_squared, most_significant};

/// The probability that noise alone seems predictable, over all waves and powers of all outputs in both tests of a verdict.
const FALSE_ALARM_OF_PREDICTION: f64 = 0.005;

/// The number of neighbouring orders on either side that give the noise level.
const NEIGHBOURS: usize = 12;

/// With fewer orders, there is no noise level to compare with.
const LEAST_ORDERS: usize = 2 * NEIGHBOURS;

/// The highest power of an input.
const HIGHEST_POWER: i32 = 5;

/// The number of time shifts at which a residual is compared with the same powers. Their mean gain is accurate to a tenth of its scatter.
const SHIFTS: usize = 16;

/// Records with fewer rows that count are not used for waves.
const LEAST_ROWS: usize = 64;

/// A predictor of the residual.
#[derive(Debug, Clone, PartialEq)]
pub struct Predictor {
    /// The output, by its place in the plant.
    pub output: usize,
    /// The predictor in words.
    pub what: String,
    /// The energy that it predicts, divided by the noise energy of all outputs.
    pub excess: f64,
    /// ln of the probability that chance predicts as much anywhere.
    pub ln_p: f64,
}

/// One regression.
struct PredictorRegression {
    output: usize,
    what: String,
    /// The reduction of the squared residual.
    gain: f64,
    /// Its degrees of freedom.
    freedom: usize,
    /// The expected reduction by chance for each degree of freedom, at least one.
    level: f64,
}

impl PredictorRegression {
    fn ln_p(&self) -> f64 {
        ln_upper_chi_squared(self.gain / self.level, self.freedom as f64)
    }
}

/// The best predictor of the residual of a fit; `None` if chance could predict as much.
#[must_use]
pub fn best_predictor(whitened: &WhitenedResiduals, fit: &Fit) -> Option<Predictor> {
    best_among(whitened, fit, &orders::coordinates(whitened, &quantities::site_signals(whitened, fit)))
}

/// The same with waves over these coordinates.
fn best_among(whitened: &WhitenedResiduals, fit: &Fit, ways: &[Coordinate]) -> Option<Predictor> {
    let parts: Vec<_> = (0..whitened.floors.len()).map(|output| parts(whitened, fit, output)).collect();
    let outputs = (0..parts.len()).filter(|output| !parts[*output].is_empty());
    // `None`: powers of signals instead of waves.
    let tests: Vec<(usize, Option<&Coordinate>)> =
        outputs.flat_map(|output| ways.iter().map(Some).chain([None]).map(move |way| (output, way))).collect();
    let tried = in_threads(&tests, whitened.threads, |(output, way)| match way {
        Some(way) => waves(whitened, way, *output, &parts[*output]),
        None => powers(whitened, fit, *output, &parts[*output]),
    });
    let tried: Vec<PredictorRegression> = tried.into_iter().flatten().collect();
    let (ln_p, best) = most_significant(tried.iter().map(|it| (it.ln_p(), it)), TESTS as f64)?;
    let rows: usize = whitened.records.iter().flat_map(|it| &it.used).map(|used| used.iter().filter(|it| **it).count()).sum();
    let excess = (best.gain - best.level * best.freedom as f64) / rows.max(1) as f64;
    (ln_p < FALSE_ALARM_OF_PREDICTION.ln()).then(|| Predictor { output: best.output, what: best.what.clone(), excess, ln_p })
}

/// The residual of an output in each record that holds it: the record, its index there, the residual.
fn parts<'f>(whitened: &WhitenedResiduals, fit: &'f Fit, output: usize) -> Vec<(usize, usize, &'f [f64])> {
    let mut list = Vec::new();
    for (record, prepared) in whitened.records.iter().enumerate() {
        let rows = prepared.record.rows();
        if let Some(k) = prepared.outputs.iter().position(|it| *it == output)
            && prepared.used[k].iter().filter(|used| **used).count() >= LEAST_ROWS
        {
            let first = whitened.first(record) + k * rows;
            list.push((record, k, &fit.residual[first..first + rows]));
        }
    }
    list
}

/// Waves of every order. Each record has its own phase, because the initial angle is not known from a speed.
fn waves(
    whitened: &WhitenedResiduals,
    way: &Coordinate,
    output: usize,
    parts: &[(usize, usize, &[f64])],
) -> Vec<PredictorRegression> {
    let floor = &whitened.floors[output];
    let mut sums = vec![(0.0, 0_usize); way.order.len()];
    for (record, k, residual) in parts {
        let (at, prepared) = (&way.at[*record], &whitened.records[*record]);
        let used = &prepared.used[*k];
        // The change of the coordinate from row to row, which gives the change of phase of a wave.
        let step: Vec<f64> = (0..at.len()).map(|row| (at[(row + 1).min(at.len() - 1)] - at[row.max(1) - 1]).abs()).collect();
        let (mut wave, mut white) = ([vec![0.0; at.len()], vec![0.0; at.len()]], [Vec::new(), Vec::new()]);
        // The orders are the multiples of the first.
        let mut sines = Multiples::new(at.iter().map(|at| TAU * way.order[0] * at).collect(), 0);
        for (sum, order) in sums.iter_mut().zip(&way.order) {
            sines.advance();
            // Except at the ends, the step spans two rows.
            let seen = |row: usize| order * step[row] < 2.0 * HIGHEST_FREQUENCY;
            if (0..at.len()).filter(|row| used[*row] && seen(*row)).count() < LEAST_ROWS {
                continue;
            }
            for (row, sines) in sines.now().iter().enumerate() {
                (wave[0][row], wave[1][row]) = if seen(row) { *sines } else { (0.0, 0.0) };
            }
            for (wave, white) in wave.iter().zip(&mut white) {
                white.clear();
                floor.whiten(wave, used, white);
            }
            let basis = Basis::of(&white);
            (sum.0, sum.1) = (sum.0 + basis.projected_square(residual), sum.1 + basis.rank());
        }
    }
    let reached: Vec<usize> = (0..sums.len()).filter(|k| sums[*k].1 > 0).collect();
    if reached.len() < LEAST_ORDERS {
        return Vec::new();
    }
    let per_freedom: Vec<f64> = reached.iter().map(|k| sums[*k].0 / sums[*k].1 as f64).collect();
    let each = reached.iter().enumerate().map(|(place, k)| {
        let (gain, freedom) = sums[*k];
        let first = place.saturating_sub(NEIGHBOURS).min(reached.len() - 2 * NEIGHBOURS);
        let mut around: Vec<f64> = per_freedom[first..(first + 2 * NEIGHBOURS).min(reached.len())].to_vec();
        order::sort(&mut around);
        let level = (around[around.len() / 2] / median_of_chance(freedom)).max(1.0);
        // A spectral line is as wide as one wave over the whole travel, so three digits are enough for a record with hundreds of waves.
        let what = format!("a wave of order {} over {}", rounded(way.order[*k], 3), way.words());
        PredictorRegression { output, what, gain, freedom, level }
    });
    each.collect()
}

/// The median of chi squared divided by its degrees of freedom.
fn median_of_chance(freedom: usize) -> f64 {
    chi_squared_of(0.5_f64.ln(), freedom as f64) / freedom as f64
}

/// Powers, up to the fifth, of the inputs and of the motion; one quantity at a time.
fn powers(
    whitened: &WhitenedResiduals,
    fit: &Fit,
    output: usize,
    parts: &[(usize, usize, &[f64])],
) -> Vec<PredictorRegression> {
    let floor = &whitened.floors[output];
    let kind = fit.model.file.kind;
    let mut list = Vec::new();
    let simulated = kind.outputs().iter().enumerate().map(|(k, it)| (it.name, false, k));
    let driven = kind.inputs().iter().enumerate().map(|(k, it)| (it.name, true, k));
    for (name, is_input, which) in driven.chain(simulated) {
        let values = |record: usize| -> Option<&[f64]> {
            let prepared = &whitened.records[record];
            if is_input {
                return prepared.record.inputs.get(which).filter(|it| it.len() == prepared.record.rows()).map(Vec::as_slice);
            }
            let k = prepared.outputs.iter().position(|it| *it == which)?;
            Some(&fit.simulated[record][k])
        };
        let Some(all) = parts.iter().map(|it| values(it.0)).collect::<Option<Vec<_>>>() else { continue };
        let ends = all.iter().flat_map(|it| it.iter());
        let (low, high) = order::ends(ends);
        if high <= low {
            continue;
        }
        // One coefficient for all records, so their columns and residuals are joined.
        let mut columns = vec![Vec::new(); HIGHEST_POWER as usize];
        for ((record, k, _), values) in parts.iter().zip(&all) {
            for (power, column) in (1..=HIGHEST_POWER).zip(&mut columns) {
                let raised: Vec<f64> =
                    values.iter().map(|value| ((2.0 * value - low - high) / (high - low)).powi(power)).collect();
                floor.whiten(&raised, &whitened.records[*record].used[*k], column);
            }
        }
        let basis = Basis::of(&columns);
        if basis.rank() == 0 {
            continue;
        }
        let mut left: Vec<f64> = parts.iter().flat_map(|it| it.2.iter().copied()).collect();
        let taken = basis.project_out(&mut left).iter().map(|part| part * part).sum();
        // The same regression on shifted residuals gives the level of noise.
        let lengths: Vec<usize> = parts.iter().map(|it| it.2.len()).collect();
        let elsewhere = |shift: usize| -> f64 {
            let (mut moved, mut first) = (Vec::with_capacity(left.len()), 0);
            for length in &lengths {
                let its = &left[first..first + length];
                let (before, after) = its.split_at(shift * length / (SHIFTS + 1));
                moved.extend(after.iter().chain(before));
                first += length;
            }
            basis.projected_square(&moved)
        };
        let level = (1..=SHIFTS).map(elsewhere).sum::<f64>() / (SHIFTS * basis.rank()) as f64;
        list.push(PredictorRegression {
            output,
            what: format!("powers of {name} up to the fifth"),
            gain: taken,
            freedom: basis.rank(),
            level: level.max(1.0),
        });
    }
    list
}

#[cfg(test)]
mod tests {
    use super::super::model::Model;
    use super::super::noise::NoiseFloor;
    use super::super::whitened_residuals::Prepared;
    use super::*;
    use crate::engine::columns::dot;
    use rsm_core::source::Source;
    use rsm_fit::random::Random;
    use rsm_sim::equation_plant::{SiteKind, SiteSignal};
    use rsm_sim::kind::OUTPUTS;
    use rsm_sim::plant_file::PlantFile;
    use rsm_sim::record::Record;

    const SD: f64 = 0.3;

    /// A motor that runs up and down through 0; its speed has noise of a correlation, and what `more` says from speed, angle and q voltage.
    fn found(seed: u64, correlation: f64, told: f64, more: &dyn Fn(f64, f64, f64) -> f64) -> Option<Predictor> {
        let text = include_str!("../../../rsm-sim/plants/pmac.toml").to_string();
        let file = PlantFile::read(&Source::new("pmac.toml", text)).unwrap();
        let mut random = Random::new(seed);
        let (mut csv, mut smooth) = ("time[s],v_d[V],v_q[V],load_torque[N*m],speed[rad/s]\n".to_string(), Vec::new());
        let (mut angle, mut noise) = (0.3, 0.0);
        for k in 0..4000 {
            let time = f64::from(k) * 1e-3;
            let speed = 150.0 * (TAU * time / 4.0).sin() + 40.0 * (TAU * time / 0.9).sin();
            angle += speed * 1e-3;
            let v_q = 0.25 * speed + 3.0 * (TAU * time / 0.37).sin();
            noise = correlation * noise + SD * (1.0 - correlation * correlation).sqrt() * random.normal();
            smooth.push(speed);
            csv += &format!("{time},0,{v_q},0,{}\n", speed + noise + more(speed, angle, v_q));
        }
        let record = Record::read(&Source::new("r.csv", csv), &file).unwrap();
        let floor = NoiseFloor { correlation: told, ..NoiseFloor::white(SD) };
        let whitened = WhitenedResiduals::new(vec![Prepared::new(record, 3)], [floor; OUTPUTS], 1);
        let model = Model {
            file,
            starts: vec![rsm_sim::kind::StartValues::default()],
            unknowns: Vec::new(),
            at_start: super::super::model::InitialMotion::Steady,
        };
        let of =
            |role, parts| SiteSignal { at: "rotor", kind: SiteKind::Rotation, role, unit: String::new(), parts: vec![parts] };
        let ways = orders::coordinates(&whitened, &[vec![of("speed", smooth.clone())]]);
        let simulated = vec![vec![smooth]];
        let residual = whitened.residual(&simulated);
        let cost = dot(&residual, &residual);
        let fit = Fit { model, simulated, residual, cost, free: Vec::new(), columns: Vec::new(), held: Vec::new() };
        best_among(&whitened, &fit, &ways)
    }

    #[test]
    fn a_wave_that_no_octave_shows_is_found_by_its_order() {
        // Of 3 % of the noise's energy: an octave of a thousand lines scatters by as much.
        for order in [5.0, 9.5, 14.0] {
            let it = found(3, 0.0, 0.0, &|_, angle, _| 0.25 * SD * (order * angle).sin()).unwrap();
            assert!(it.what.starts_with(&format!("a wave of order {order} over ")), "{it:?}");
            // Its energy over the noise's, 0.25^2/2, and three standard deviations of a gain of 4000 times that.
            assert!((it.excess - 0.031).abs() < 3.0 * 2.0 * (0.031_f64 / 4000.0).sqrt(), "{it:?}");
        }
    }

    #[test]
    fn a_bend_over_a_voltage_is_found_and_it_is_none_at_another_time() {
        let it = found(4, 0.0, 0.0, &|_, _, v_q| 0.8 * SD * ((v_q / 40.0).powi(2) - 0.3)).unwrap();
        assert!(it.what.contains("powers of v_q") || it.what.contains("powers of speed"), "{it:?}");
    }

    #[test]
    fn noise_is_predicted_by_nothing_even_where_its_colour_is_known_badly() {
        // 50 looks at half of 0.5 % each, and the colour off by four times what 4000 rows know it to.
        let alarms = (0..50).filter(|seed| found(100 + seed, 0.6, 0.55, &|_, _, _| 0.0).is_some()).count();
        assert!(alarms <= 1, "{alarms}");
    }
}

//! How accurate the simulations of a diagnosis are.
//!
//! In: whitened records. Out: the permitted error of a step. It follows from the noise: more accuracy takes time, and no reading shows it.

use super::whitened_residuals::{FINEST, Prepared, WhitenedResiduals};

/// The permitted error of a step, as a share of the noise over the square root of the number of readings. Along a record, errors of steps add up to
/// some seven permitted errors (an axis with dry friction, 600 rows). So the errors of a simulation change the squared residual by 1 at most, and a
/// cause changes it by some 20.
const IN_SEARCH: f64 = 0.15;

/// The same for numbers that are reported: they move by a tenth of their standard deviation at most.
const IN_RESULTS: f64 = 0.1 * IN_SEARCH;

/// The largest permitted error of a step, relative to the largest reading: noisy sensors do not make a simulation wrong.
const COARSEST: f64 = 1e-5;

/// Fourth differences of white noise have this variance: the squares of 1, 4, 6, 4, 1.
const FOURTH_DIFFERENCE: f64 = 70.0;

/// The permitted error of a step for a search in records: one for all of them and for parts of them. In powers of two times the smallest one, so that
/// it hardly depends on the estimate of the noise.
pub(super) fn in_search(whitened: &WhitenedResiduals) -> f64 {
    permitted(whitened, IN_SEARCH)
}

/// The same for the numbers of a report.
pub(super) fn in_results(whitened: &WhitenedResiduals) -> f64 {
    permitted(whitened, IN_RESULTS)
}

fn permitted(whitened: &WhitenedResiduals, share: f64) -> f64 {
    let of_record = |prepared: &Prepared| {
        (0..prepared.outputs.len()).map(|k| relative_noise(whitened, prepared, k)).fold(f64::INFINITY, f64::min)
    };
    let relative = whitened.records.iter().map(of_record).fold(f64::INFINITY, f64::min);
    let permitted = (share / (whitened.rows().max(1) as f64).sqrt() * relative).min(COARSEST);
    let mut tolerance = FINEST;
    while 2.0 * tolerance <= permitted {
        tolerance *= 2.0;
    }
    tolerance
}

/// The noise of an output relative to its largest reading. While a cause is not in the plant, the noise floor may contain some of its trace, so the
/// scatter from row to row is a second limit.
fn relative_noise(whitened: &WhitenedResiduals, prepared: &Prepared, k: usize) -> f64 {
    let values = prepared.measured(k);
    let largest = values.iter().filter(|it| it.is_finite()).fold(0.0_f64, |most, value| most.max(value.abs()));
    let (mut sum, mut count) = (0.0, 0);
    for five in values.windows(5) {
        let difference = five[0] - 4.0 * five[1] + 6.0 * five[2] - 4.0 * five[3] + five[4];
        if difference.is_finite() {
            sum += difference * difference;
            count += 1;
        }
    }
    let scatter = if count > 0 { (sum / f64::from(count) / FOURTH_DIFFERENCE).sqrt() } else { f64::INFINITY };
    let noise = whitened.floors[prepared.outputs[k]].innovation().min(scatter);
    if largest > 0.0 { noise / largest } else { f64::INFINITY }
}

#[cfg(test)]
mod tests {
    use rsm_core::source::Source;
    use rsm_fit::random::Random;
    use rsm_sim::kind::OUTPUTS;
    use rsm_sim::plant_file::PlantFile;
    use rsm_sim::record::Record;

    use super::super::noise::NoiseFloor;
    use super::*;

    /// 400 rows of a position between 2 m and -2 m with noise.
    fn record(noise: f64) -> Prepared {
        let text = "format = 1\nplant = \"servo-axis\"\n[parameters]\nmass = 2\nforce_gain = 4\nviscous_friction = 0\n\
                    command_limit = 10\n";
        let file = PlantFile::read(&Source::new("axis.toml", text.to_string())).unwrap();
        let mut csv = "time[s],command[V],position[m]\n".to_string();
        let mut random = Random::new(3);
        for k in 0..400 {
            let time = f64::from(k) / 1000.0;
            csv += &format!("{time},0,{}\n", 2.0 * (10.0 * time).cos() + noise * random.normal());
        }
        Prepared::new(Record::read(&Source::new("r.csv", csv), &file).unwrap(), 2)
    }

    #[test]
    fn simulations_are_as_accurate_as_the_noise_asks() {
        let of = |noise: f64, floor: f64| {
            let whitened = WhitenedResiduals::new(vec![record(noise)], [NoiseFloor::white(floor); OUTPUTS], 1);
            (in_search(&whitened) / FINEST, in_results(&whitened) / FINEST)
        };
        // 400 readings, the largest of 2 m: 0.15/20/2 of the noise. For 1e-4 m this is 3.75e-7, and 1e-8 times 32 is the next power of two below.
        assert_eq!(of(2e-4, 1e-4), (32.0, 2.0));
        assert_eq!(of(2e-4, 1.05e-4), (32.0, 2.0));
        // An exact sensor, and one with noise of 2 m.
        assert_eq!(of(1e-9, 1e-9), (1.0, 1.0));
        assert_eq!(of(4.0, 2.0), (512.0, 512.0));
        // A noise floor that contains the trace of a cause: the readings scatter by 1e-4 m.
        assert_eq!(of(1e-4, 0.1).0, 32.0);
        // One exact record among noisy ones.
        let both = WhitenedResiduals::new(vec![record(2e-3), record(1e-9)], [NoiseFloor::white(1e-3); OUTPUTS], 1);
        assert_eq!(in_search(&both), FINEST);
    }
}

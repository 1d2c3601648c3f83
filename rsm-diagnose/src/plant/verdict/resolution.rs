//! Whether rounded readings are the resolution of a logger, or an error of one sensor.
//!
//! In: outputs whose readings are multiples of a step, with the noise floors. Out: the sensors with an error. The others are reported with the noise:
//! a simulation is not wrong because readings are rounded.

use super::super::noise::NoiseFloor;

/// A step of more than this many standard deviations of the noise before rounding is an error of a sensor: its error, step/sqrt(12), is then 1.3
/// times the noise, and in slow motion most readings are repeated. Where an error begins is a convention: steps of up to four standard deviations
/// count as the resolution of a logger.
const COARSE: f64 = 4.5;

/// Of the rounded outputs (place, step), those whose sensor is reported as a cause; `recorded` is the number of outputs in the records. A logger that
/// rounds, rounds every channel.
pub(super) fn reported_as_causes(rounded: &[(usize, f64)], recorded: usize, floors: &[NoiseFloor]) -> Vec<(usize, f64)> {
    if rounded.len() == recorded && recorded > 1 {
        return Vec::new();
    }
    let coarse = |(output, step): &&(usize, f64)| floors[*output].rounding.is_none_or(|it| *step > COARSE * it.noise);
    rounded.iter().filter(coarse).copied().collect()
}

#[cfg(test)]
mod tests {
    use super::super::super::rounding::Rounding;
    use super::*;

    #[test]
    fn one_coarse_sensor_is_blamed_and_a_logger_or_a_fine_step_is_not() {
        let rounding = |noise: f64| NoiseFloor { rounding: Some(Rounding { step: 1.0, noise }), ..NoiseFloor::white(0.4) };
        let floors = [rounding(0.22), rounding(0.23), NoiseFloor::white(0.4)];
        assert_eq!(reported_as_causes(&[(0, 1.0), (1, 1.0)], 3, &floors), [(0, 1.0)]);
        assert_eq!(reported_as_causes(&[(2, 1.0)], 3, &floors), [(2, 1.0)]);
        assert_eq!(reported_as_causes(&[(0, 1.0)], 1, &floors), [(0, 1.0)]);
        assert_eq!(reported_as_causes(&[(0, 1.0), (2, 1.0)], 2, &floors), []);
    }
}

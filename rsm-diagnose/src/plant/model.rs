//! The current plant model of the diagnosis, and its unknowns.
//!
//! In: a plant file, records. Out: the same plant with other values of its unknowns. Independent of residuals and hypotheses.

use crate::engine::columns::dot;
use crate::engine::normal::Normal;
use rsm_sim::configurations;
use rsm_sim::equation_plant::{self, bodies};
use rsm_sim::kind::OUTPUTS;
use rsm_sim::kind::{PlantKind, StartValues};
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;
use rsm_sim::schema::Bound;
use rsm_sim::simulate::{start_of, starting};

/// A positive parameter is searched within this factor of its guess, up and down.
const SEARCH_FACTOR: f64 = 10.0;

/// The number of first rows for the initial speed of an axis. At 1 kHz they take a fiftieth of a second, in which the force hardly changes.
const FIRST_ROWS: usize = 20;

/// An axis moves if its speed exceeds this many standard deviations. A cubic leaves sixteen degrees of freedom of twenty rows; chance then exceeds
/// six once in 50,000 records.
const MOVING: f64 = 6.0;

/// Effects with a memory of the time before a record (a delayed input, a slow sensor, a twisted shaft) change the initial speed that fits best. The
/// prior is therefore this many times as wide as the standard deviation of the estimate.
const EFFECTS_WITH_MEMORY: f64 = 10.0;

/// The initial speed from positions, and its standard deviation: the slope of a cubic through the first rows. The standard deviation includes the
/// residual of the cubic and the difference from the slope of a parabola. `None` if there are fewer rows.
fn speed_at_start(positions: &[f64], period: f64) -> Option<(f64, f64)> {
    let first = positions.get(..FIRST_ROWS)?;
    let [(parabola, _), (cubic, sd)] = [3, 4].map(|terms| slope_at_start(first, terms));
    let seconds = (FIRST_ROWS - 1) as f64 * period;
    Some((cubic / seconds, sd.hypot(cubic - parabola) / seconds))
}

/// The slope of a polynomial with this many terms at the first of evenly spaced values, fitted to all of them, and its standard deviation from the
/// residual.
fn slope_at_start(values: &[f64], terms: usize) -> (f64, f64) {
    let last = (values.len() - 1) as f64;
    let powers: Vec<Vec<f64>> =
        (0..values.len()).map(|k| (0..terms).map(|power| (k as f64 / last).powi(power as i32)).collect()).collect();
    let products =
        |i: usize, with: &dyn Fn(usize) -> f64| powers.iter().enumerate().map(|(k, row)| row[i] * with(k)).sum::<f64>();
    let matrix: Vec<f64> =
        (0..terms).flat_map(|i| (0..terms).map(move |j| (i, j))).map(|(i, j)| products(i, &|k| powers[k][j])).collect();
    let right: Vec<f64> = (0..terms).map(|i| products(i, &|k| values[k] - values[0])).collect();
    let normal = Normal::new(&matrix, terms, 0.0);
    let found = normal.solve(&right);
    let missed: f64 = powers.iter().zip(values).map(|(row, value)| (value - values[0] - dot(row, &found)).powi(2)).sum();
    let mut slope = vec![0.0; terms];
    slope[1] = 1.0;
    let variance = missed / (values.len() - terms) as f64 * normal.solve(&slope)[1];
    (found[1], variance.max(0.0).sqrt())
}

/// The place of an unknown in the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// A nominal parameter with a tolerance.
    Nominal(&'static str),
    /// A parameter of an effect.
    Effect {
        /// The index of the entry in the file.
        entry: usize,
        /// The name of the parameter.
        number: &'static str,
    },
    /// An initial state.
    Start {
        /// The index of the record.
        record: usize,
        /// The index among the plant's start values.
        place: usize,
    },
}

/// Mean and standard deviation of a Gaussian prior, if there is one.
type Prior = Option<(f64, f64)>;

/// A number to be estimated.
#[derive(Debug, Clone)]
pub struct Unknown {
    /// Its place in the model.
    pub place: Place,
    /// Whether it is searched on a logarithmic scale: for positive numbers that span decades.
    pub logarithmic: bool,
    /// The lower bound.
    pub low: f64,
    /// The upper bound.
    pub high: f64,
    /// The unit of a step (in the logarithm if it is logarithmic).
    pub scale: f64,
    /// A Gaussian prior: mean and standard deviation.
    pub prior: Prior,
    /// Whether it is a number of an effect on which no row of the fitted records depends, such as a limit that none of them reaches. Then holdout
    /// records are simulated with the value that they show themselves (`validation.rs`).
    pub open: bool,
}

impl Unknown {
    /// An unknown with the bounds of a parameter, from a start value.
    #[must_use]
    pub fn bounded(place: Place, bound: Bound, start: f64) -> Self {
        let (low, high) = match bound {
            Bound::Any | Bound::Count => (f64::NEG_INFINITY, f64::INFINITY),
            // A factor of ten up and down from a guess. With a stiffness or a time constant further off, a simulation takes thousands of sub-steps
            // per row for a motion that no row shows.
            Bound::Positive => (start / SEARCH_FACTOR, start * SEARCH_FACTOR),
            Bound::NotNegative if start > 0.0 => (0.0, start * SEARCH_FACTOR * SEARCH_FACTOR),
            Bound::NotNegative => (0.0, f64::INFINITY),
            // A share within 2 % of either end is practically none or all.
            Bound::Between(low, high) => (low + 0.02 * (high - low), high - 0.02 * (high - low)),
        };
        let logarithmic = bound == Bound::Positive && start > 0.0;
        let scale = if logarithmic {
            0.1
        } else if start == 0.0 {
            1.0
        } else {
            0.1 * start.abs()
        };
        Unknown { place, logarithmic, low, high, scale, prior: None, open: false }
    }

    /// The standard deviation of its value, from that on the scale of the search. To first order, a step of a logarithm is that share of the value.
    #[must_use]
    pub fn deviation(&self, value: f64, on_search_scale: f64) -> f64 {
        if self.logarithmic { value.abs() * on_search_scale } else { on_search_scale }
    }

    /// Converts a value to the scale of the search.
    #[must_use]
    pub fn to_search_scale(&self, value: f64) -> f64 {
        if self.logarithmic { value.ln() } else { value }
    }

    /// Converts a value of the search to the plant's value, within the bounds.
    #[must_use]
    pub fn plant_value(&self, searched: f64) -> f64 {
        let value = if self.logarithmic { searched.clamp(-700.0, 700.0).exp() } else { searched };
        value.max(self.low).min(self.high)
    }
}

/// The initial motion of records of a car or an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InitialMotion {
    /// Steady: torque and twist of a car follow from its speed; an axis is at rest.
    Steady,
    /// In motion: torque and twist of a car, or the speed of an axis, are unknown. A car forgets them within seconds, so they cannot compensate for
    /// much of a missing cause.
    InMotion,
}

impl InitialMotion {
    /// In motion if the first readings of a position in any record show motion, and no reading gives the speed. Records of other plants count as
    /// steady until a simulation shows the contrary.
    pub fn of<'a>(kind: PlantKind, mut records: impl Iterator<Item = &'a Record>) -> Self {
        let positions = positions_without_speed(kind);
        let moves = |record: &Record| {
            let one = |position: &usize| speed_of(record, *position).is_some_and(|(speed, sd)| speed.abs() > MOVING * sd);
            positions.iter().any(one)
        };
        if records.any(moves) { InitialMotion::InMotion } else { InitialMotion::Steady }
    }
}

fn is_of_equations(file: &PlantFile) -> bool {
    !file.kind.is_first_format
}

/// The outputs that are the position of a body whose speed no reading gives.
fn positions_without_speed(kind: PlantKind) -> Vec<usize> {
    let is_free = |name: &str| kind.free_starts.iter().any(|it| it.name == name);
    bodies(kind).iter().filter(|it| it.speed.is_some_and(is_free)).filter_map(|it| kind.output(it.position?)).collect()
}

/// The initial speed of a body from the readings of its position, and its standard deviation.
fn speed_of(record: &Record, position: usize) -> Option<(f64, f64)> {
    speed_at_start(record.measured[position].as_deref().unwrap_or(&[]), record.period)
}

/// A plant with its initial states.
#[derive(Debug, Clone)]
pub struct Model {
    /// The plant; its effects are the accepted causes.
    pub file: PlantFile,
    /// The initial state of each record.
    pub starts: Vec<StartValues>,
    /// The unknowns.
    pub unknowns: Vec<Unknown>,
    /// The initial motion of the records.
    pub at_start: InitialMotion,
}

impl Model {
    /// The nominal plant: parameters with a tolerance and all initial states are unknown.
    #[must_use]
    pub fn nominal(file: &PlantFile, records: &[&Record], sds: [f64; OUTPUTS]) -> Self {
        Model::with_initial_motion(file, InitialMotion::of(file.kind, records.iter().copied()), records, sds)
    }

    /// The same with a given initial motion.
    #[must_use]
    pub fn with_initial_motion(file: &PlantFile, at_start: InitialMotion, records: &[&Record], sds: [f64; OUTPUTS]) -> Self {
        let mut unknowns = Vec::new();
        for (name, tolerance) in &file.tolerance {
            let (Some(value), true) = (file.parameters.optional(name), *tolerance > 0.0) else { continue };
            let sd = tolerance * value.abs();
            if sd > 0.0 {
                unknowns.push(Unknown {
                    place: Place::Nominal(name),
                    logarithmic: false,
                    // A change by more than two standard deviations is a cause, not calibration (docs/book/src/reference/formats.md 4.3).
                    low: value - 2.0 * sd,
                    high: value + 2.0 * sd,
                    scale: sd,
                    prior: Some((value, sd)),
                    open: false,
                });
            }
        }
        let mut model = Model { file: file.clone(), starts: Vec::new(), unknowns, at_start };
        model.take_starts(records, sds);
        model
    }

    /// Replaces the records. Their initial states are unknown and start from the first readings.
    pub fn take_starts(&mut self, records: &[&Record], sds: [f64; OUTPUTS]) {
        self.unknowns.retain(|unknown| !matches!(unknown.place, Place::Start { .. }));
        self.starts.clear();
        for (k, record) in records.iter().enumerate() {
            let mut start = StartValues::default();
            for place in starting(record, self.file.kind) {
                start[place] = start_of(&self.file, record, place).unwrap_or(0.0);
                let Some((value, scale, prior)) = self.begins(record, place, start[place], sds) else { continue };
                start[place] = value;
                self.unknowns.push(Unknown {
                    place: Place::Start { record: k, place },
                    logarithmic: false,
                    low: f64::NEG_INFINITY,
                    high: f64::INFINITY,
                    scale,
                    prior,
                    open: false,
                });
            }
            self.starts.push(start);
        }
    }

    /// The first value, step and prior of an initial state; `None` if it is known. The first value of an output is near its first reading, which is
    /// one of many. If records begin steadily, a state that no column holds is taken as known: a free unknown without a prior could compensate for a
    /// missing cause in the whole record.
    fn begins(&self, record: &Record, place: usize, at: f64, sds: [f64; OUTPUTS]) -> Option<(f64, f64, Prior)> {
        let name = self.file.kind.starts()[place].name;
        let read =
            self.file.kind.output(name).filter(|output| record.measured[*output].is_some() || !is_of_equations(&self.file));
        if let Some(output) = read {
            return Some((at, sds[output], None));
        }
        if self.at_start == InitialMotion::Steady || record.start(name).is_some() {
            return None;
        }
        let (is_new, kind) = (is_of_equations(&self.file), self.file.kind);
        // Known if the plant file gives it.
        if is_new && self.file.initial.iter().any(|(found, _)| *found == name) {
            return None;
        }
        let body = bodies(kind).into_iter().find(|it| it.speed == Some(name));
        let position = body.and_then(|it| kind.output(it.position?));
        if let Some((speed, sd)) = position.and_then(|it| speed_of(record, it)) {
            return Some((speed, sd, Some((speed, EFFECTS_WITH_MEMORY * sd))));
        }
        let size = kind.start_sizes.iter().find(|it| it.0 == name).map(|it| it.1);
        // Otherwise the standard deviation is the largest value that the nominal plant reaches.
        let largest = || equation_plant::start_scales(&self.file, record).get(place).copied();
        let sd = size.or_else(|| is_new.then(largest).flatten()).unwrap_or(0.0);
        (sd > 0.0).then_some((at, 0.1 * sd, Some((at, sd))))
    }

    /// The value of an unknown.
    ///
    /// # Panics
    /// If the plant has no such parameter. Unknowns are made from the plant's own parameters.
    #[must_use]
    pub fn value(&self, unknown: usize) -> f64 {
        match self.unknowns[unknown].place {
            Place::Nominal(name) => self.file.parameters.number(name),
            Place::Effect { entry, number } => self.file.effects[entry].arguments.number(number),
            Place::Start { record, place } => self.starts[record][place],
        }
    }

    /// Whether an unknown that is no initial state can change a record: whether it acts in the configuration of the record.
    #[must_use]
    pub fn acts_on(&self, place: Place, record: &Record) -> bool {
        let configurations = &self.file.kind.configurations;
        let Some(its) = record.configuration.filter(|_| !configurations.is_empty()) else { return true };
        let name = configurations.list[its].name.as_str();
        let is_parameter = |parameter: &str| {
            configurations::parts(parameter).map_or_else(|| !configurations.has_own(its, parameter), |it| it.1 == name)
        };
        match place {
            Place::Start { .. } => true,
            Place::Nominal(parameter) => is_parameter(parameter),
            Place::Effect { entry, number } => {
                let acts = || self.file.effects[entry].in_configuration(Some(name)).is_some();
                configurations::parts(number).map_or_else(acts, |it| it.1 == name)
            }
        }
    }

    /// The model with some unknowns changed, each on the scale of its search and within its bounds.
    #[must_use]
    pub fn moved(&self, unknowns: &[usize], change: &[f64]) -> Model {
        let mut moved = self.clone();
        for (&k, change) in unknowns.iter().zip(change) {
            let unknown = &self.unknowns[k];
            moved.set(k, unknown.plant_value(unknown.to_search_scale(self.value(k)) + change));
        }
        moved
    }

    /// Sets the value of an unknown.
    pub fn set(&mut self, unknown: usize, value: f64) {
        match self.unknowns[unknown].place {
            Place::Nominal(name) => self.file.parameters.set(name, value),
            Place::Effect { entry, number } => {
                let numbers = &mut self.file.effects[entry].arguments.numbers;
                if let Some(found) = numbers.iter_mut().find(|(name, _)| *name == number) {
                    found.1 = value;
                }
            }
            Place::Start { record, place } => self.starts[record][place] = value,
        }
    }

    /// The plant file for a record, with its initial state under `[initial]`.
    #[must_use]
    pub fn for_record(&self, record: usize, of: &Record) -> PlantFile {
        let mut file = self.file.clone();
        let start = self.starts[record];
        let places = starting(of, file.kind);
        let is_read =
            |place: usize| file.kind.output(file.kind.starts()[place].name).is_some_and(|it| of.measured[it].is_some());
        // A state without a reading starts as the equations define, unless it is an unknown.
        let counts = |place: usize| !is_of_equations(&file) || self.at_start == InitialMotion::InMotion || is_read(place);
        let initial =
            places.into_iter().filter(|place| counts(*place)).map(|place| (file.kind.starts()[place].name, start[place]));
        let mut initial: Vec<_> = initial.collect();
        if is_of_equations(&file) {
            initial
                .extend(file.initial.iter().filter(|own| !initial.iter().any(|it| it.0 == own.0)).copied().collect::<Vec<_>>());
        }
        file.initial = initial;
        file
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rsm_fit::random::Random;

    #[test]
    fn the_first_readings_say_whether_an_axis_moves() {
        let mut random = Random::new(3);
        // 0.5 m/s^2 from rest or from 0.02 m/s, read every millisecond with noise of 1e-6 m.
        let mut begins = |speed: f64| {
            let readings: Vec<f64> = (0..40)
                .map(|k| f64::from(k) / 1000.0)
                .map(|t| 0.3 + speed * t + 0.25 * t * t + 1e-6 * random.normal())
                .collect();
            speed_at_start(&readings, 1e-3).unwrap()
        };
        // The slope at the end of a cubic through 20 rows has 0.39 of the noise a row, here 3.9e-4; the parabola's is another 0.3 of it off, and
        // sixteen degrees of freedom give half to twice that in fifty draws.
        for _ in 0..50 {
            let ((rest, sd), (moving, _)) = (begins(0.0), begins(0.02));
            assert!(rest.abs() < MOVING * sd && (moving - 0.02).abs() < MOVING * sd, "{rest} {moving} {sd}");
            assert!((1.9e-4..1.5e-3).contains(&sd), "{sd}");
        }
        assert_eq!(speed_at_start(&[1.0; 40], 1e-3), Some((0.0, 0.0)));
        assert_eq!(speed_at_start(&[1.0; 19], 1e-3), None);
    }
}

//! The current plant model of the diagnosis, and its unknowns.
//!
//! In: a plant file, records. Out: the same plant with other values of its unknowns. Independent of residuals and hypotheses.

use crate::engine::columns::dot;
use crate::engine::normal::Normal;
use rsm_sim::equation_plant;
use rsm_sim::kind::OUTPUTS;
use rsm_sim::kind::{PlantKind, StartValues};
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;
use rsm_sim::schema::Bound;
use rsm_sim::simulate::{start_of, starting};

/// How far from its guess a positive number is searched, as a factor.
const REACH: f64 = 10.0;

/// Rows that say how fast an axis begins: at a kilohertz a fiftieth of a second, in which the force hardly changes.
const FIRST_ROWS: usize = 20;

/// Standard deviations beyond which it moves: with the sixteen degrees of freedom that a cubic leaves of twenty rows, chance passes six once in 50,000 records.
const MOVES: f64 = 6.0;

/// What effects remember of the time before a record (a delayed input, a lagging sensor, a twisted shaft) changes the speed that fits the rest of it: the estimate is believed to ten of its own
/// standard deviations.
const REMEMBERED: f64 = 10.0;

/// The speed at which positions begin, and its standard deviation: the slope of a cubic through the first rows, by the residual of that cubic and by how far a parabola's slope is from it. `None`
/// for fewer rows.
fn speed_at_start(positions: &[f64], period: f64) -> Option<(f64, f64)> {
    let first = positions.get(..FIRST_ROWS)?;
    let [(parabola, _), (cubic, sd)] = [3, 4].map(|terms| slope_at_start(first, terms));
    let seconds = (FIRST_ROWS - 1) as f64 * period;
    Some((cubic / seconds, sd.hypot(cubic - parabola) / seconds))
}

/// The slope of a polynomial of this many terms at the first of evenly spaced values, over all of them, and its standard deviation by what the polynomial leaves.
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

/// Where an unknown stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// A nominal parameter with a tolerance.
    Nominal(&'static str),
    /// A number of an effect.
    Effect {
        /// Which entry of the file.
        entry: usize,
        /// Its number.
        number: &'static str,
    },
    /// Where a record starts.
    Start {
        /// Which record.
        record: usize,
        /// Which place of the plant's starts.
        place: usize,
    },
}

/// Centre and standard deviation of a Gaussian, where something is known.
type Prior = Option<(f64, f64)>;

/// A number that is to be found.
#[derive(Debug, Clone)]
pub struct Unknown {
    /// Where it stands.
    pub place: Place,
    /// Searched on a logarithmic scale: positive numbers that span decades.
    pub logarithmic: bool,
    /// Lowest value.
    pub low: f64,
    /// Highest value.
    pub high: f64,
    /// What counts as one step of it (of its logarithm, where it is logarithmic).
    pub scale: f64,
    /// A Gaussian prior: centre and standard deviation.
    pub prior: Prior,
}

impl Unknown {
    /// Of a number with a bound, at a start value.
    #[must_use]
    pub fn bounded(place: Place, bound: Bound, start: f64) -> Self {
        let (low, high) = match bound {
            Bound::Any | Bound::Count => (f64::NEG_INFINITY, f64::INFINITY),
            // Two decades about a guess. A stiffness or a time constant further off makes a simulation of thousands of sub-steps a row, of a
            // motion that no row shows.
            Bound::Positive => (start / REACH, start * REACH),
            Bound::NotNegative if start > 0.0 => (0.0, start * REACH * REACH),
            Bound::NotNegative => (0.0, f64::INFINITY),
            // A share of 2 % at either end is as good as nothing or all.
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
        Unknown { place, logarithmic, low, high, scale, prior: None }
    }

    /// A value on the scale of the search.
    #[must_use]
    pub fn inward(&self, value: f64) -> f64 {
        if self.logarithmic { value.ln() } else { value }
    }

    /// A value of the search as the plant has it, within the bounds.
    #[must_use]
    pub fn outward(&self, searched: f64) -> f64 {
        let value = if self.logarithmic { searched.clamp(-700.0, 700.0).exp() } else { searched };
        value.max(self.low).min(self.high)
    }
}

/// How records of a car or an axis begin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AtStart {
    /// A car rolls steadily: torque and twist follow from its speed. An axis rests.
    Steady,
    /// In the middle of a motion: torque and twist of a car, the speed of an axis are unknown. A car forgets them within seconds, so that they can take up little of what a missing cause does.
    InMotion,
}

impl AtStart {
    /// As the records of an axis show: in motion where the first readings of one of them say that it moves. Records of other plants begin steadily, as long as no simulation shows the contrary.
    pub fn of<'a>(kind: PlantKind, mut records: impl Iterator<Item = &'a Record>) -> Self {
        let moves = |record| speed_of(record).is_some_and(|(speed, sd)| speed.abs() > MOVES * sd);
        if kind == PlantKind::ServoAxis && records.any(moves) { AtStart::InMotion } else { AtStart::Steady }
    }
}

fn is_of_equations(file: &PlantFile) -> bool {
    matches!(file.kind, PlantKind::Equations(_))
}

/// The speed at which an axis begins, and its standard deviation.
fn speed_of(record: &Record) -> Option<(f64, f64)> {
    speed_at_start(record.measured[0].as_deref().unwrap_or(&[]), record.period)
}

/// A plant with its starts.
#[derive(Debug, Clone)]
pub struct Model {
    /// The plant; effects are the accepted causes.
    pub file: PlantFile,
    /// Where each record starts.
    pub starts: Vec<StartValues>,
    /// What is searched.
    pub unknowns: Vec<Unknown>,
    /// How records begin.
    pub at_start: AtStart,
}

impl Model {
    /// The nominal plant: parameters with a tolerance and all starts are unknown.
    #[must_use]
    pub fn nominal(file: &PlantFile, records: &[&Record], sds: [f64; OUTPUTS]) -> Self {
        Model::beginning(file, AtStart::of(file.kind, records.iter().copied()), records, sds)
    }

    /// The same, where it is known how records begin.
    #[must_use]
    pub fn beginning(file: &PlantFile, at_start: AtStart, records: &[&Record], sds: [f64; OUTPUTS]) -> Self {
        let mut unknowns = Vec::new();
        for (name, tolerance) in &file.tolerance {
            let (Some(value), true) = (file.parameters.optional(name), *tolerance > 0.0) else { continue };
            let sd = tolerance * value.abs();
            if sd > 0.0 {
                unknowns.push(Unknown {
                    place: Place::Nominal(name),
                    logarithmic: false,
                    // Beyond two standard deviations it is a cause, not calibration (docs/book/src/reference/formats.md 4.3).
                    low: value - 2.0 * sd,
                    high: value + 2.0 * sd,
                    scale: sd,
                    prior: Some((value, sd)),
                });
            }
        }
        let mut model = Model { file: file.clone(), starts: Vec::new(), unknowns, at_start };
        model.take_starts(records, sds);
        model
    }

    /// Replaces the records: their starts are the readings of their first rows, and unknown.
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
                });
            }
            self.starts.push(start);
        }
    }

    /// Where a search of a start begins, what counts as a step of it, and what is known of it; `None` where it is known. An output begins near its first reading, which is one among all others.
    /// What no column holds is known where records begin steadily: an unknown that nothing holds would take up what a missing cause does to the whole record.
    fn begins(&self, record: &Record, place: usize, at: f64, sds: [f64; OUTPUTS]) -> Option<(f64, f64, Prior)> {
        let name = self.file.kind.starts()[place].name;
        let read =
            self.file.kind.output(name).filter(|output| record.measured[*output].is_some() || !is_of_equations(&self.file));
        if let Some(output) = read {
            return Some((at, sds[output], None));
        }
        if self.at_start == AtStart::Steady {
            return None;
        }
        if is_of_equations(&self.file) {
            // Where the plant file says it, it is known. Else it may be as far off as the nominal plant ever is from 0.
            let is_given = self.file.initial.iter().any(|(found, _)| *found == name);
            let sd = equation_plant::start_scales(&self.file, record).get(place).copied().unwrap_or(0.0);
            return (!is_given && sd > 0.0).then_some((at, 0.1 * sd, Some((at, sd))));
        }
        if self.file.kind == PlantKind::Driveline {
            let sd = equation_plant::offset_scales(&self.file.parameters, record.gear)[place];
            return Some((at, 0.1 * sd, Some((0.0, sd))));
        }
        let (speed, sd) = speed_of(record)?;
        Some((speed, sd, Some((speed, REMEMBERED * sd))))
    }

    /// The value of an unknown.
    ///
    /// # Panics
    /// When the plant has no such number: unknowns are made from the plant's own.
    #[must_use]
    pub fn value(&self, unknown: usize) -> f64 {
        match self.unknowns[unknown].place {
            Place::Nominal(name) => self.file.parameters.number(name),
            Place::Effect { entry, number } => self.file.effects[entry].arguments.number(number),
            Place::Start { record, place } => self.starts[record][place],
        }
    }

    /// The model with some unknowns moved, each on the scale of its search and within its bounds.
    #[must_use]
    pub fn moved(&self, unknowns: &[usize], change: &[f64]) -> Model {
        let mut moved = self.clone();
        for (&k, change) in unknowns.iter().zip(change) {
            let unknown = &self.unknowns[k];
            moved.set(k, unknown.outward(unknown.inward(self.value(k)) + change));
        }
        moved
    }

    /// The same plant with another value of an unknown.
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

    /// The plant file of a record: its start stands under `[initial]`.
    #[must_use]
    pub fn for_record(&self, record: usize, of: &Record) -> PlantFile {
        let mut file = self.file.clone();
        let start = self.starts[record];
        let places = starting(of, file.kind);
        let is_read =
            |place: usize| file.kind.output(file.kind.starts()[place].name).is_some_and(|it| of.measured[it].is_some());
        // What no reading gives starts as the equations say, until it is an unknown.
        let counts = |place: usize| !is_of_equations(&file) || self.at_start == AtStart::InMotion || is_read(place);
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
        // The slope at the end of a cubic through 20 rows has 0.39 of the noise a row, here 3.9e-4; the parabola's is another 0.3 of it off, and sixteen
        // degrees of freedom give half to twice that in fifty draws.
        for _ in 0..50 {
            let ((rest, sd), (moving, _)) = (begins(0.0), begins(0.02));
            assert!(rest.abs() < MOVES * sd && (moving - 0.02).abs() < MOVES * sd, "{rest} {moving} {sd}");
            assert!((1.9e-4..1.5e-3).contains(&sd), "{sd}");
        }
        assert_eq!(speed_at_start(&[1.0; 40], 1e-3), Some((0.0, 0.0)));
        assert_eq!(speed_at_start(&[1.0; 19], 1e-3), None);
    }
}

//! A check of the sensors in a control loop with a known law, made before all others: the recorded command of an axis is compared with the law of its
//! controller. No plant model is needed.
//!
//! ```text
//!   u = h (a (r - q) - k v),  a = velocity_gain position_gain,  k = velocity_gain,  and readings m = g q:
//!   u = h (1 - 1/g) [a r] + (h/g) [a (r - m) - k v_m] + a constant
//! ```
//!
//! In: records in closed loop that hold the position and the command. Out: the gains of both sensors from a regression on two terms, the delay of the
//! position reading, and the residual of the command. Friction, mass and load do not enter, so the check is valid even if they are unknown. Runs no
//! simulation.
//!
//! A difference of readings is much noisier than the readings, and noise in a regressor makes its coefficient too small. The same law some rows
//! earlier has independent noise, so it is used as the instrument (P. G. Wright, 1928). Intervals come from leaving out one part of the records at a
//! time (J. W. Tukey, 1958); so does the gain on rows that were not used for the coefficients.

use super::cause::{Cause, Interval};
use super::confidence::EXPLAINED;
use super::whitened_residuals::Prepared;
use rsm_sim::effect::{Arguments, Role};
use rsm_sim::equation_plant;
use rsm_sim::plant_file::{Entry, PlantFile, VelocityFrom};
use rsm_sim::record::Drive;

/// The instrument is taken this many rows earlier, because the velocity uses three readings.
const INSTRUMENT_LAG: usize = 5;

/// The number of parts; one is left out at a time.
const PARTS: usize = 10;

/// 97.5 % of Student's t with nine degrees of freedom.
const T_POINT: f64 = 2.262;

/// The 99.95 % point of the same: a gain is reported as wrong if it differs from 1 by this many standard deviations. Two gains are tested for every
/// loop; with the 95 % point, one in twenty good sensors would be reported.
const SIGNIFICANCE_POINT: f64 = 4.781;

/// The smallest number of rows.
const LEAST_ROWS: usize = 200;

/// The largest tested delay or advance of the position, in rows.
const LARGEST_DELAY: isize = 4;

/// A position counts as late if the law with the delay leaves at most this share of the squares.
const LATE: f64 = 0.25;

/// A gain counts as wrong if the regression leaves less than this share of the squares on rows that were not used for it: two thirds of the r.m.s.
const LEFT_BY_GAINS: f64 = 0.45;

/// The regression must also leave less than this share of the command. The law of another controller would fit badly with any gain.
const LEFT_BY_LAW: f64 = 0.2;

/// A reading of the command above this share of its largest value, or of its limit, is left out: it may be limited, so the law does not hold.
const LIMITED: f64 = 0.9;

/// A number with its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GainEstimate {
    /// The value.
    pub value: f64,
    /// The lower end.
    pub low: f64,
    /// The upper end.
    pub high: f64,
}

impl GainEstimate {
    /// Whether a gain differs significantly from 1.
    fn is_wrong(&self) -> bool {
        let sd = 0.5 * (self.high - self.low) / T_POINT;
        (self.value - 1.0).abs() > SIGNIFICANCE_POINT * sd
    }
}

/// The check of the sensors by the control law.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownLoop {
    /// The gain of the position sensor.
    pub position: GainEstimate,
    /// The gain of the command reading.
    pub command: GainEstimate,
    /// The delay of the position reading in rows; negative if it is early.
    pub late: isize,
    /// Root mean square of the command minus the law as stated in the file and a constant, in V. A sensor bias gives a constant; it is not a gain.
    pub stated: f64,
    /// The same for the regression, on rows that were not used for it.
    pub left: f64,
    /// Root mean square of the command, in V.
    pub size: f64,
}

impl KnownLoop {
    /// Whether the law with these gains is the controller's, and the law as stated is not.
    fn is_confirmed(&self) -> bool {
        self.left * self.left < LEFT_BY_GAINS * self.stated * self.stated && self.left < LEFT_BY_LAW * self.size
    }

    /// The sensors with wrong gains, as entries of the plant.
    #[must_use]
    pub fn entries(&self, file: &PlantFile) -> Vec<Entry> {
        if !self.is_confirmed() || self.late != 0 {
            return Vec::new();
        }
        let off = [("position", &self.position), ("command", &self.command)].into_iter().filter(|(_, gain)| gain.is_wrong());
        off.filter_map(|(name, gain)| {
            let description = equation_plant::with(file.kind, Role::ReadingGain, name)?;
            let numbers = vec![("gain", gain.value)];
            Some(Entry { description, arguments: Arguments { plant: file.kind, subject: Some(name.to_string()), numbers } })
        })
        .collect()
    }

    /// The causes that only the law shows and that a search did not keep, with their entries. In a free run a sensor error may be small beside
    /// unexplained friction; in the law it is the only error. `rows` is the number of rows of the records.
    #[must_use]
    pub fn further_causes(&self, file: &PlantFile, kept: &[Entry], rows: usize) -> Vec<(Cause, Entry)> {
        let is_kept =
            |it: &Entry| kept.iter().any(|kept| self.identifies(file, kept) && kept.arguments.subject == it.arguments.subject);
        let entries = self.entries(file).into_iter().filter(|it| !is_kept(it));
        let each = entries.map(|entry| {
            let subject = entry.arguments.subject.clone().unwrap_or_default();
            let gain = if subject == "position" { self.position } else { self.command };
            let sentence =
                entry.description.sentence.replace("{output}", &subject).replace("{gain}", &format!("{:.4}", gain.value));
            let cause = Cause {
                kind: entry.description.kind,
                subject: Some(subject),
                of: entry.description.subject,
                parameters: vec![Interval {
                    name: "gain",
                    value: gain.value,
                    low: gain.low,
                    high: gain.high,
                    unit: "1".to_string(),
                }],
                confidence: EXPLAINED,
                confidence_of_any: EXPLAINED,
                indistinguishable_from: Vec::new(),
                gain: rows as f64 * ((self.stated / self.left).powi(2) - 1.0),
                rivals: Vec::new(),
                rivals_tested: true,
                sentence: format!("{sentence} The control law shows this, independently of the plant."),
                check: entry.description.check,
                contribution: None,
                only_in: None,
                acts_in: Vec::new(),
                by_holdout: Vec::new(),
            };
            (cause, entry)
        });
        each.collect()
    }

    /// Whether the law alone shows what an entry does. Then no rival of the plant counts against the entry.
    #[must_use]
    pub fn identifies(&self, file: &PlantFile, entry: &Entry) -> bool {
        let same =
            |it: &Entry| it.description.kind == entry.description.kind && it.arguments.subject == entry.arguments.subject;
        let off = |it: &Entry| it.arguments.optional("gain").map(|gain| gain - 1.0);
        let known = self.entries(file).into_iter().find(same);
        let both = known.as_ref().and_then(off).zip(off(entry));
        both.is_some_and(|(known, found)| (found - known).abs() < AGREEMENT * known.abs())
    }
}

/// The allowed difference between the gains of a search and of the law, as a share of the gain error. Unknown effects bias the gain of a search.
const AGREEMENT: f64 = 0.2;

/// A row of the regression: the command and its regressors.
#[derive(Debug, Clone, Copy)]
struct Row {
    command: f64,
    /// The term of the reference.
    reference: f64,
    /// The law as stated in the file.
    law: f64,
    /// The law some rows earlier.
    older: f64,
}

/// The rows of the law if the position is read this many rows late.
fn rows(records: &[Prepared], file: &PlantFile, late: isize) -> Vec<Row> {
    let mut list = Vec::new();
    for prepared in records.iter().filter(|it| it.record.drive == Drive::Closed) {
        let file = file.along(&prepared.record);
        let Some((position_gain, velocity_gain)) =
            file.parameters.optional("position_gain").zip(file.parameters.optional("velocity_gain"))
        else {
            continue;
        };
        let place = |output: usize| prepared.outputs.iter().position(|it| *it == output);
        let (Some(position), Some(command)) = (place(0), place(1)) else { continue };
        let (q, u, reference) = (prepared.measured(position), prepared.measured(command), &prepared.record.inputs[0]);
        let largest = u.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
        let limit = LIMITED * largest.min(file.parameters.number("command_limit"));
        let used = |row: usize| prepared.used[position][row] && prepared.used[command][row];
        let law = |row: usize| -> Option<f64> {
            let at = row.checked_add_signed(late)?;
            let (before, after) = match file.parameters.velocity_from {
                VelocityFrom::Difference => (at.checked_sub(2)?, at),
                VelocityFrom::State => (at.checked_sub(1)?, at + 1),
            };
            if after >= q.len() || !(before..=after).all(used) {
                return None;
            }
            let speed = (q[after] - q[before]) / (2.0 * prepared.record.period);
            Some(velocity_gain * (position_gain * (reference[row] - q[at]) - speed))
        };
        for row in INSTRUMENT_LAG..u.len() {
            if let (true, Some(now), Some(older)) = (used(row) && u[row].abs() < limit, law(row), law(row - INSTRUMENT_LAG)) {
                let reference = velocity_gain * position_gain * reference[row];
                list.push(Row { command: u[row], reference, law: now, older });
            }
        }
    }
    list
}

/// Sums of products of instruments with regressors, and of instruments with the command.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    matrix: [[f64; 3]; 3],
    right: [f64; 3],
}

impl Sums {
    fn of(rows: &[Row]) -> Self {
        let mut sums = Sums::default();
        for row in rows {
            let (instruments, regressors) = ([row.reference, row.older, 1.0], [row.reference, row.law, 1.0]);
            for ((instrument, sum), right) in instruments.iter().zip(&mut sums.matrix).zip(&mut sums.right) {
                *right += instrument * row.command;
                sum.iter_mut().zip(regressors).for_each(|(sum, regressor)| *sum += instrument * regressor);
            }
        }
        sums
    }

    fn without(&self, other: &Sums) -> Sums {
        let mut rest = *self;
        for i in 0..3 {
            rest.right[i] -= other.right[i];
            for j in 0..3 {
                rest.matrix[i][j] -= other.matrix[i][j];
            }
        }
        rest
    }

    /// The two slopes and the constant, by Cramer's rule.
    fn solve(&self) -> Option<[f64; 3]> {
        let determinant = |m: &[[f64; 3]; 3]| {
            m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0])
                + m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0])
        };
        let all = determinant(&self.matrix);
        let mut solved = [0.0; 3];
        for (place, value) in solved.iter_mut().enumerate() {
            let mut with = self.matrix;
            for (row, right) in with.iter_mut().zip(self.right) {
                row[place] = right;
            }
            *value = determinant(&with) / all;
        }
        solved.iter().all(|value| value.is_finite()).then_some(solved)
    }
}

/// The gains of position and command from the two slopes.
fn gains([of_reference, of_law, _]: [f64; 3]) -> [f64; 2] {
    let command = of_reference + of_law;
    [command / of_law, command]
}

/// The mean square of the command minus the law as stated and a constant.
fn mean_square_error(rows: &[Row]) -> f64 {
    let count = rows.len().max(1) as f64;
    let constant = rows.iter().map(|row| row.command - row.law).sum::<f64>() / count;
    rows.iter().map(|row| (row.command - row.law - constant).powi(2)).sum::<f64>() / count
}

/// Checks the law. `None` if no record has the closed loop with both outputs, or if they do not move.
#[must_use]
pub fn check(records: &[Prepared], file: &PlantFile) -> Option<KnownLoop> {
    if file.acting().next().is_some() {
        return None;
    }
    let on_time = rows(records, file, 0);
    if on_time.len() < LEAST_ROWS {
        return None;
    }
    // The residual for different delays shows how late a position is, whatever its gain.
    let left = |rows: &[Row]| -> f64 {
        let Some(slopes) = Sums::of(rows).solve() else { return f64::INFINITY };
        rows.iter().map(|row| residual(row, &slopes).powi(2)).sum::<f64>() / rows.len().max(1) as f64
    };
    let now = left(&on_time);
    let others = (-LARGEST_DELAY..=LARGEST_DELAY).filter(|late| *late != 0).map(|late| (late, rows(records, file, late)));
    let nearest = others.map(|(late, rows)| (left(&rows), late, rows)).min_by(|a, b| a.0.total_cmp(&b.0));
    let (late, rows) = match nearest {
        Some((squared, late, rows)) if squared < LATE * now && rows.len() >= LEAST_ROWS => (late, rows),
        _ => (0, on_time.clone()),
    };
    let all = Sums::of(&rows);
    let [position, command] = gains(all.solve()?);
    let (mut parts, mut squares) = (Vec::new(), 0.0);
    for part in rows.chunks(rows.len().div_ceil(PARTS)) {
        let slopes = all.without(&Sums::of(part)).solve()?;
        squares += part.iter().map(|row| residual(row, &slopes).powi(2)).sum::<f64>();
        parts.push(gains(slopes));
    }
    let known = |which: usize, value: f64| {
        let count = parts.len() as f64;
        let mean = parts.iter().map(|it| it[which]).sum::<f64>() / count;
        let sd = ((count - 1.0) / count * parts.iter().map(|it| (it[which] - mean).powi(2)).sum::<f64>()).sqrt();
        GainEstimate { value, low: value - T_POINT * sd, high: value + T_POINT * sd }
    };
    let size = (rows.iter().map(|row| row.command * row.command).sum::<f64>() / rows.len() as f64).sqrt();
    let left = (squares / rows.len() as f64).sqrt();
    let stated = mean_square_error(&on_time).sqrt();
    (size > 0.0).then(|| KnownLoop { position: known(0, position), command: known(1, command), late, stated, left, size })
}

/// The residual of the regression in a row.
fn residual(row: &Row, slopes: &[f64; 3]) -> f64 {
    row.command - slopes[0] * row.reference - slopes[1] * row.law - slopes[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use rsm_core::source::Source;
    use rsm_fit::random::Random;
    use rsm_sim::record::Record;
    use rsm_sim::simulate::Simulator;

    impl GainEstimate {
        fn holds(&self, value: f64) -> bool {
            self.low <= value && value <= self.high
        }
    }

    /// An axis in closed loop with friction that its file does not have, whose readings are off by these gains and late by this many rows.
    fn found(gains: [f64; 2], late: usize, noise: f64, seed: u64) -> (KnownLoop, PlantFile) {
        found_beside(0.0, gains, late, noise, seed)
    }

    /// The same where the position reads too much as well, by this many metres.
    fn found_beside(bias: f64, gains: [f64; 2], late: usize, noise: f64, seed: u64) -> (KnownLoop, PlantFile) {
        let text = include_str!("../../../rsm-sim/plants/servo-axis.toml").to_string();
        let file = PlantFile::read(&Source::new("axis.toml", text.clone())).unwrap();
        let rubbing = "\n[[effects]]\nkind = \"coulomb-friction\"\nparameters = { force = 40 }\n[[effects]]\nkind = \"constant-load\"\nparameters = { force = -8 }\n";
        let truth = PlantFile::read(&Source::new("true.toml", text + rubbing)).unwrap();
        let mut csv = "time[s],reference[m],position[m],command[V]\n".to_string();
        for k in 0..3000 {
            let time = f64::from(k) / 1000.0;
            csv += &format!("{time},{},0,0\n", 0.05 * (2.1 * time).sin() + 0.02 * (7.3 * time).sin());
        }
        let mut record = Record::read(&Source::new("r.csv", csv), &truth).unwrap();
        let simulated = Simulator::new(&truth, &record).unwrap().run(&record).unwrap();
        let mut random = Random::new(seed);
        for (output, (name, sd)) in [("position", 2e-7), ("command", 0.01)].into_iter().enumerate() {
            let values = simulated.of(name).unwrap();
            let from = |row: usize| values[if output == 0 { row.saturating_sub(late) } else { row }];
            record.measured[output] =
                Some((0..values.len()).map(|row| gains[output] * from(row) + noise * sd * random.normal()).collect());
            if let (0, Some(values)) = (output, &mut record.measured[0]) {
                values.iter_mut().for_each(|value| *value += bias);
            }
        }
        (check(&[Prepared::new(record, 2)], &file).unwrap(), file)
    }

    #[test]
    fn two_lines_find_a_sensor_that_is_off_whatever_the_friction() {
        for (gains, noise) in [([1.05, 1.0], 1.0), ([0.95, 1.0], 4.0), ([1.0, 0.95], 1.0), ([1.02, 1.03], 1.0)] {
            let (found, file) = found(gains, 0, noise, 11);
            let names: Vec<String> = found.entries(&file).iter().map(|it| it.arguments.subject.clone().unwrap()).collect();
            let off: Vec<&str> =
                ["position", "command"].into_iter().zip(gains).filter(|it| it.1 != 1.0).map(|it| it.0).collect();
            assert_eq!(names, off, "{found:?}");
            assert!(found.entries(&file).iter().all(|it| found.identifies(&file, it)), "{found:?}");
            let beside = found.further_causes(&file, &[], 3000);
            assert!(beside.iter().map(|it| it.0.subject.as_deref()).eq(off.iter().map(|name| Some(*name))), "{beside:?}");
            assert!(
                beside
                    .iter()
                    .all(|it| it.0.gain > 3000.0 && found.further_causes(&file, &found.entries(&file), 3000).is_empty())
            );
            // The command follows the law but for its own noise and that of the velocity: parts of a thousand.
            assert!((found.position.value - gains[0]).abs() < 1e-3, "{found:?}");
            assert!((found.command.value - gains[1]).abs() < 1e-2 && found.late == 0, "{found:?}");
        }
    }

    #[test]
    fn intervals_of_the_two_lines_hold_the_truth() {
        let draws = 60;
        let held = (0..draws).filter(|seed| {
            let (found, _) = found([1.05, 0.97], 0, 2.0, 100 + seed);
            found.position.holds(1.05) && found.command.holds(0.97)
        });
        // Two intervals of 95 %, dependent: 0.90 of 60 at least, less three standard deviations of a binomial count.
        let held = held.count();
        assert!(held >= 47, "{held} of {draws}");
    }

    #[test]
    fn a_bias_of_the_position_is_no_gain_of_a_sensor() {
        for seed in 0..40 {
            let (found, file) = found_beside(1e-3, [1.0, 1.0], 0, 1.0, 300 + seed);
            assert!(found.entries(&file).is_empty(), "{seed}: {found:?}");
            // A gain beside it is found all the same.
            let (found, file) = found_beside(1e-3, [1.0, 0.95], 0, 1.0, 300 + seed);
            assert_eq!(found.entries(&file).len(), 1, "{seed}: {found:?}");
        }
    }

    #[test]
    fn a_loop_as_its_file_has_it_is_nothing_and_a_late_position_is_said() {
        let (right, file) = found([1.0, 1.0], 0, 1.0, 12);
        assert!(right.entries(&file).is_empty() && right.stated < 0.05, "{right:?}");
        let (late, file) = found([1.0, 1.0], 2, 1.0, 13);
        assert_eq!((late.late, late.entries(&file).len()), (2, 0), "{late:?}");
    }
}

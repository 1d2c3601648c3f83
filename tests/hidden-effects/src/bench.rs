//! Records as on real test benches: noise that is not Gaussian, and data that a logger damaged.
//!
//! In: columns of a record, a stream of random numbers. Out: noise, damaged columns, and the expected words of a correct report about them. This file
//! does not depend on the plant.

use std::ops::Range;

use serde_json::Value;

use crate::plant::Record;
use crate::random::Random;

/// Noise that differs from the statement of the plant file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Noise {
    /// Student's t with three degrees of freedom, with the stated deviation.
    Tails,
    /// Six times the noise in short bursts, for a twentieth of the time.
    Bursts,
    /// Noise with a correlation of 0.98 from row to row.
    Slow,
    /// Readings are rounded to four times the noise.
    Rounded,
    /// Two and a half times the stated noise.
    Understated,
    /// Two fifths of the stated noise.
    Overstated,
}

impl Noise {
    /// All, with their names in cases.
    pub const ALL: [(&'static str, Noise); 6] = [
        ("tails", Noise::Tails),
        ("bursts", Noise::Bursts),
        ("slow", Noise::Slow),
        ("rounded", Noise::Rounded),
        ("understated", Noise::Understated),
        ("overstated", Noise::Overstated),
    ];

    /// The stated deviation divided by the true one.
    pub fn stated(self) -> f64 {
        match self {
            Noise::Understated => 1.0 / 2.5,
            Noise::Overstated => 2.5,
            _ => 1.0,
        }
    }

    /// The step to which readings are rounded.
    pub fn step(self, sigma: f64) -> Option<f64> {
        (self == Noise::Rounded).then_some(4.0 * sigma)
    }

    /// Adds the noise to a column.
    pub fn add(self, column: &mut [f64], sigma: f64, random: &mut Random) {
        let rows = column.len();
        match self {
            Noise::Tails => {
                for value in column.iter_mut() {
                    // A normal number divided by the root of chi squared/3; its variance is 3.
                    let chi: f64 = (0..3).map(|_| random.normal().powi(2)).sum();
                    *value += sigma * random.normal() / chi.sqrt();
                }
            }
            Noise::Slow => column.iter_mut().zip(random.noise(rows, sigma, 0.98)).for_each(|(value, it)| *value += it),
            _ => column.iter_mut().zip(random.noise(rows, sigma, 0.0)).for_each(|(value, it)| *value += it),
        }
        if self == Noise::Bursts {
            let mut row = 0;
            loop {
                // Bursts of 10 to 30 rows after 200 to 560 other rows.
                row += random.whole(200, 560) as usize;
                let end = row + random.whole(10, 30) as usize;
                if end >= rows {
                    break;
                }
                column[row..end].iter_mut().for_each(|value| *value += 6.0 * sigma * random.normal());
                row = end;
            }
        }
        if let Some(step) = self.step(sigma) {
            column.iter_mut().for_each(|value| *value = step * (*value / step).round());
        }
    }
}

/// A damage by a logger.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Spoiled {
    /// In all records, a column has another unit than its header states.
    Unit,
    /// In all records, two columns have each other's headers.
    Swapped,
    /// In one record, a channel keeps its value for some time.
    Stuck,
    /// In one record, a channel does not exceed a limit.
    Clipped,
    /// In one record, a block of rows occurs twice, the second time instead of the rows after it.
    Doubled,
    /// In one record, a channel is delayed by some rows.
    Offset,
}

impl Spoiled {
    /// All, with their names in cases.
    pub const ALL: [(&'static str, Spoiled); 6] = [
        ("unit", Spoiled::Unit),
        ("swapped", Spoiled::Swapped),
        ("stuck", Spoiled::Stuck),
        ("clipped", Spoiled::Clipped),
        ("doubled", Spoiled::Doubled),
        ("offset", Spoiled::Offset),
    ];

    /// Beginnings of words; a report of the damage contains one of them.
    pub fn words(self) -> &'static [&'static str] {
        match self {
            Spoiled::Unit => &["unit", "scale", "factor", "rpm", "deg", "milli", "km/h", "times"],
            Spoiled::Swapped => &["swap", "exchang", "interchang", "each other"],
            Spoiled::Stuck => &["stuck", "hang", "constant", "frozen", "same value"],
            Spoiled::Clipped => &["clip", "limit", "saturat"],
            Spoiled::Doubled => &["duplicat", "doubl", "twice", "repeat"],
            Spoiled::Offset => &["shift", "late", "offset", "delay", "jump"],
        }
    }

    /// Whether the damage is in all records; otherwise it is in the first one.
    pub fn is_everywhere(self) -> bool {
        matches!(self, Spoiled::Unit | Spoiled::Swapped)
    }
}

/// The damage, and the columns that a report may name.
#[derive(Debug, Clone, PartialEq)]
pub struct Damage {
    /// The kind of damage.
    pub what: Spoiled,
    /// The indices of the outputs; empty if all columns are affected in the same way.
    pub outputs: Vec<usize>,
    /// The factor of a unit.
    pub factor: f64,
    /// The rows of the first record.
    pub rows: Range<usize>,
}

/// A usual factor between the readings and the header's unit: rpm, degrees, millimetres, kilometres per hour, milliamperes.
fn factor(unit: &str) -> f64 {
    match unit {
        "rad/s" => 30.0 / std::f64::consts::PI,
        "rad" => 180.0 / std::f64::consts::PI,
        "m/s" => 3.6,
        _ => 1000.0,
    }
}

/// A random damage for outputs with these units; `None` if the plant has too few.
pub fn damage(what: Spoiled, units: &[&str], rows: usize, random: &mut Random) -> Option<Damage> {
    let one = random.whole(0, units.len() as u64 - 1) as usize;
    let outputs = match what {
        Spoiled::Swapped if units.len() < 2 => return None,
        Spoiled::Swapped => vec![one, (one + 1) % units.len()],
        Spoiled::Doubled => vec![],
        _ => vec![one],
    };
    let first = rows / 4 + random.whole(0, rows as u64 / 4) as usize;
    let length = rows / 40 + random.whole(0, rows as u64 / 40) as usize;
    Some(Damage { what, factor: factor(units[one]), outputs, rows: first..first + length })
}

impl Damage {
    /// Damages a record.
    pub fn spoil(&self, record: &mut Record) {
        let rows = record.inputs[0].len();
        let one = self.outputs.first().copied().unwrap_or(0);
        match self.what {
            Spoiled::Unit => record.outputs[one].iter_mut().for_each(|value| *value *= self.factor),
            Spoiled::Swapped => record.outputs.swap(one, self.outputs[1]),
            Spoiled::Stuck => {
                let value = record.outputs[one][self.rows.start];
                record.outputs[one][self.rows.clone()].fill(value);
            }
            Spoiled::Clipped => {
                let mut sorted = record.outputs[one].clone();
                sorted.sort_by(f64::total_cmp);
                // The upper tenth is cut off.
                let limit = sorted[rows * 9 / 10];
                record.outputs[one].iter_mut().for_each(|value| *value = value.min(limit));
            }
            Spoiled::Doubled => {
                // The logger writes a block of all channels a second time, over the next block.
                for column in record.inputs.iter_mut().chain(&mut record.outputs) {
                    column.copy_within(self.rows.clone(), self.rows.end);
                }
            }
            // A delay of as many rows as the block is long, but no more than 20.
            Spoiled::Offset => {
                let late = self.rows.len().clamp(8, 20);
                record.outputs[one].copy_within(0..rows - late, late);
            }
        }
    }
}

/// Whether an answer reports the damage, and for one of these outputs: as a finding about the data (`data`), a column in another unit (`units`), or a
/// fault of the data with that kind.
pub fn is_told(damage: &Damage, outputs: &[&str], answer: &Value) -> bool {
    let names: Vec<&str> = damage.outputs.iter().map(|place| outputs[*place]).collect();
    let is_column = |it: &Value| names.is_empty() || it.as_str().is_some_and(|it| names.contains(&it));
    let is_what = |it: &Value| {
        let said = it.as_str().unwrap_or_default().to_lowercase();
        damage.what.words().iter().any(|word| said.contains(word))
    };
    let list = |key: &str| answer[key].as_array().into_iter().flatten();
    let in_unit = |it: &Value| it["columns"].as_array().into_iter().flatten().any(is_column);
    let found = |it: &Value| is_what(&it["what"]) && ["channel", "column"].iter().any(|key| is_column(&it[*key]));
    let of_kind = |it: &&Value| it["kind"] == "data-fault";
    damage.what == Spoiled::Unit && list("units").any(in_unit)
        || list("data").any(found)
        || list("causes").chain(list("faults")).chain(list("data_faults")).filter(of_kind).any(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_noise_is_what_it_says() {
        let of = |noise: Noise| {
            let mut column = vec![0.0; 40_000];
            noise.add(&mut column, 0.5, &mut Random::new(4, "bench"));
            column
        };
        let square = |column: &[f64]| column.iter().map(|it| it * it).sum::<f64>() / column.len() as f64;
        for noise in [Noise::Slow, Noise::Understated, Noise::Overstated] {
            // 40000 rows of slow noise are equivalent to 400 independent ones: a standard error of 7 %; the limit is four of them.
            assert!((square(&of(noise)) / 0.25 - 1.0).abs() < 0.28, "{noise:?}");
        }
        // With three degrees of freedom there is no fourth moment, so the share beyond five deviations of the distribution is tested: 0.32 %,
        // compared with 6e-7 for a normal one.
        let far = of(Noise::Tails).iter().filter(|it| it.abs() > 2.5).count();
        assert!((60..250).contains(&far), "{far}");
        // A twentieth of the rows has 37 times the variance.
        let bursts = square(&of(Noise::Bursts)) / 0.25;
        assert!((2.0..4.0).contains(&bursts), "{bursts}");
        assert!(of(Noise::Rounded).iter().all(|it| it % 2.0 == 0.0));
    }

    #[test]
    fn each_damage_leaves_its_mark_and_no_other() {
        let record = || Record {
            period: 1.0,
            inputs: vec![(0..400).map(f64::from).collect()],
            outputs: vec![(0..400).map(|it| f64::from(it) + 0.5).collect(), vec![2.0; 400]],
        };
        for (_, what) in Spoiled::ALL {
            let damage = damage(what, &["rad/s", "m"], 400, &mut Random::new(9, "damage")).expect("two outputs are enough");
            let mut spoiled = record();
            damage.spoil(&mut spoiled);
            if what == Spoiled::Doubled {
                let (start, end) = (damage.rows.start, damage.rows.end);
                assert_eq!(spoiled.inputs[0][end], spoiled.inputs[0][start]);
                assert_eq!(spoiled.outputs[0][end + 1], spoiled.outputs[0][start + 1]);
                continue;
            }
            assert_eq!(spoiled.inputs, record().inputs, "{what:?}");
            let changed = |place: usize| spoiled.outputs[place] != record().outputs[place];
            // The second output is constant: a stuck, clipped or delayed channel is not visible there.
            let shows = damage.outputs.contains(&0) || what == Spoiled::Unit;
            assert_eq!(changed(0) || changed(1), shows, "{what:?}");
        }
        assert_eq!(damage(Spoiled::Swapped, &["m/s"], 400, &mut Random::new(1, "one")), None);
    }
}

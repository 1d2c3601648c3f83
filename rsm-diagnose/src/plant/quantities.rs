//! Operating quantities of a record (speed, current, load, position, time ...) and the classes into which a report divides them.
//!
//! In: records and a simulation along them. Out: a value of each quantity for every row, and classes with the same bounds in all records. Does not
//! use the residual.

use super::model::Model;
use super::whitened_residuals::{Prepared, Simulated, WhitenedResiduals};
use rsm_sim::record::Drive;

/// Below this share of its largest speed, a plant counts as at rest or reversing.
const RESTING: f64 = 0.05;

/// A class with a smaller share of all rows is not reported separately.
const FEWEST: f64 = 0.01;

/// How a quantity is divided.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Division {
    /// By magnitude, in thirds of the rows. Small values are a separate class if the plant is then at rest.
    Size { rests: bool },
    /// By value, in thirds of the rows.
    Value,
    /// By sign, with the words for positive and negative values.
    Sign(&'static str, &'static str),
    /// By value: every value is a class.
    Whole,
}

/// A quantity along all records.
#[derive(Debug, Clone)]
pub struct Quantity {
    /// Its name.
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// A value for each row of each record.
    pub values: Vec<Vec<f64>>,
    division: Division,
}

/// The classes of a quantity.
#[derive(Debug, Clone, PartialEq)]
pub struct Classes {
    /// The quantity.
    pub quantity: &'static str,
    /// The name of each class, with its bounds and their unit.
    pub names: Vec<String>,
    /// The class of each row of each record.
    pub of: Vec<Vec<usize>>,
}

/// The speed of an axis from its positions: one value for each row.
#[must_use]
pub fn speed_of(positions: &[f64], period: f64) -> Vec<f64> {
    let last = positions.len().saturating_sub(1);
    (0..positions.len())
        .map(|k| {
            let (before, after) = (k.saturating_sub(1), (k + 1).min(last));
            if after == before { 0.0 } else { (positions[after] - positions[before]) / ((after - before) as f64 * period) }
        })
        .collect()
}

/// The simulated values of an output, where the record holds it.
#[must_use]
pub fn of_output<'s>(prepared: &Prepared, simulated: &'s Simulated, output: usize) -> Option<&'s [f64]> {
    prepared.outputs.iter().position(|it| *it == output).map(|k| simulated[k].as_slice())
}

/// All quantities by which the rows of a plant's records are divided. Simulated values replace measured ones, because they have no noise.
#[must_use]
pub fn quantities(whitened: &WhitenedResiduals, model: &Model, simulated: &[Simulated]) -> Vec<Quantity> {
    let kind = model.file.kind;
    let each =
        |name: &'static str, unit: &'static str, division: Division, of: &dyn Fn(&Prepared, &Simulated) -> Option<Vec<f64>>| {
            let values: Option<Vec<Vec<f64>>> =
                whitened.records.iter().zip(simulated).map(|(prepared, it)| of(prepared, it)).collect();
            values.map(|values| Quantity { name, unit, values, division })
        };
    let output = |k: usize| move |prepared: &Prepared, it: &Simulated| of_output(prepared, it, k).map(<[f64]>::to_vec);
    let input = |k: usize| move |prepared: &Prepared, _: &Simulated| prepared.record.inputs.get(k).cloned();
    let by_size = Division::Size { rests: false };
    let or_rest = Division::Size { rests: true };
    let mut list = Vec::new();
    match kind {
        _ if kind.is("pmac") => {
            let current = |prepared: &Prepared, it: &Simulated| {
                let i_q = of_output(prepared, it, 1)?;
                let i_d = of_output(prepared, it, 0);
                Some(i_q.iter().enumerate().map(|(k, q)| q.hypot(i_d.map_or(0.0, |d| d[k]))).collect())
            };
            let power = |prepared: &Prepared, it: &Simulated| {
                let (i_q, speed) = (of_output(prepared, it, 1)?, of_output(prepared, it, 2)?);
                Some(i_q.iter().zip(speed).map(|(current, speed)| current * speed).collect())
            };
            let voltage = |prepared: &Prepared, _: &Simulated| {
                let v_q = prepared.record.inputs.get(1)?;
                let v_d = &prepared.record.inputs[0];
                Some(v_q.iter().enumerate().map(|(k, q)| q.hypot(v_d.get(k).copied().unwrap_or(0.0))).collect())
            };
            list.extend(each("speed", "rad/s", or_rest, &output(2)));
            list.extend(each("direction of rotation", "", Division::Sign("turning backward", "turning forward"), &output(2)));
            list.extend(each("current", "A", by_size, &current));
            list.extend(each("direction of torque", "", Division::Sign("torque backward", "torque forward"), &output(1)));
            list.extend(each("flow of power", "", Division::Sign("braking", "motoring"), &power));
            list.extend(each("voltage", "V", by_size, &voltage));
            list.extend(each("load torque", "N*m", Division::Value, &input(2)));
        }
        _ if kind.is("driveline") => {
            let gear =
                |prepared: &Prepared, _: &Simulated| Some(vec![prepared.record.setting("gear")?; prepared.record.rows()]);
            let acceleration = |prepared: &Prepared, it: &Simulated| {
                let road = of_output(prepared, it, 1)?;
                Some(speed_of(road, prepared.record.period))
            };
            list.extend(each("throttle", "1", Division::Value, &input(0)));
            list.extend(each("time since the throttle moved", "s", Division::Value, &since_the_throttle_moved));
            list.extend(each("engine speed", "rad/s", Division::Value, &output(0)));
            list.extend(each("road speed", "m/s", or_rest, &output(1)));
            list.extend(each("direction of force", "", Division::Sign("slowing down", "speeding up"), &acceleration));
            list.extend(each("gear", "", Division::Whole, &gear));
        }
        _ if kind.is("servo-axis") => {
            let speed = |prepared: &Prepared, it: &Simulated| {
                of_output(prepared, it, 0).map(|positions| speed_of(positions, prepared.record.period))
            };
            let command = |prepared: &Prepared, it: &Simulated| match prepared.record.drive {
                Drive::Closed => of_output(prepared, it, 1).map(<[f64]>::to_vec),
                _ => prepared.record.inputs.first().cloned(),
            };
            list.extend(each("speed", "m/s", or_rest, &speed));
            list.extend(each("direction of motion", "", Division::Sign("moving backward", "moving forward"), &speed));
            list.extend(each("position", "m", Division::Value, &output(0)));
            list.extend(each("command", "V", by_size, &command));
            list.extend(each("direction of command", "", Division::Sign("pushing backward", "pushing forward"), &command));
        }
        plant => {
            for (k, signal) in plant.outputs.iter().enumerate() {
                list.extend(each(signal.name, signal.unit, Division::Value, &output(k)));
                let rate = |prepared: &Prepared, it: &Simulated| {
                    of_output(prepared, it, k).map(|values| speed_of(values, prepared.record.period))
                };
                list.extend(each(signal.name, "", Division::Sign("falling", "rising"), &rate));
            }
            for (k, signal) in plant.inputs.iter().enumerate() {
                list.extend(each(signal.name, signal.unit, Division::Value, &input(k)));
            }
        }
    }
    list.extend(each("time", "s", Division::Value, &|prepared: &Prepared, _: &Simulated| {
        let first = prepared.record.time.first().copied().unwrap_or(0.0);
        Some(prepared.record.time.iter().map(|time| time - first).collect())
    }));
    list
}

/// Seconds since the throttle last moved, or since the record began.
fn since_the_throttle_moved(prepared: &Prepared, _: &Simulated) -> Option<Vec<f64>> {
    let throttle = prepared.record.inputs.first()?;
    let mut since = 0.0;
    let each = throttle.iter().enumerate().map(|(k, value)| {
        since = if k > 0 && *value != throttle[k - 1] { 0.0 } else { since + prepared.record.period };
        since
    });
    Some(each.collect())
}

impl Quantity {
    /// The classes of a quantity; `None` if all rows are in one class.
    #[must_use]
    pub fn classes(&self) -> Option<Classes> {
        let all: Vec<f64> = self.values.iter().flatten().copied().collect();
        let (names, class): (Vec<String>, Box<dyn Fn(f64) -> usize>) = match self.division {
            Division::Sign(negative, positive) => {
                (vec![negative.to_string(), positive.to_string()], Box::new(|value| usize::from(value >= 0.0)))
            }
            Division::Whole => {
                let mut values = all.clone();
                values.sort_by(f64::total_cmp);
                values.dedup();
                let names = values.iter().map(|value| format!("{} {value}", self.name)).collect();
                (names, Box::new(move |value| values.iter().position(|it| *it == value).unwrap_or(0)))
            }
            Division::Size { .. } | Division::Value => {
                let is_size = self.division != Division::Value;
                let bounds = self.bounds(&all);
                let names = names(self.name, self.unit, &bounds, self.division == Division::Size { rests: true });
                (names, Box::new(move |value| place(if is_size { value.abs() } else { value }, &bounds)))
            }
        };
        let of: Vec<Vec<usize>> = self.values.iter().map(|values| values.iter().map(|value| class(*value)).collect()).collect();
        let mut counts = vec![0_usize; names.len()];
        of.iter().flatten().for_each(|class| counts[*class] += 1);
        let enough = FEWEST * all.len() as f64;
        (counts.iter().filter(|count| **count as f64 > enough).count() > 1).then_some(Classes {
            quantity: self.name,
            names,
            of,
        })
    }

    /// The bounds between classes, rounded to two significant digits.
    fn bounds(&self, all: &[f64]) -> Vec<f64> {
        let is_size = matches!(self.division, Division::Size { .. });
        let mut values: Vec<f64> = all.iter().map(|value| if is_size { value.abs() } else { *value }).collect();
        values.sort_by(f64::total_cmp);
        let mut bounds = Vec::new();
        let (Some(first), Some(last)) = (values.first().copied(), values.last().copied()) else { return bounds };
        // All values are equal, within the accuracy of a simulation.
        if last - first <= 1e-6 * last.abs().max(first.abs()) {
            return bounds;
        }
        let mut moving = values.as_slice();
        if self.division == (Division::Size { rests: true }) {
            let rest = rounded(RESTING * last, 2);
            let at = values.partition_point(|value| *value < rest);
            if at as f64 > FEWEST * values.len() as f64 {
                bounds.push(rest);
                moving = &values[at..];
            }
        }
        for third in [1, 2] {
            let Some(bound) = moving.get(moving.len() * third / 3).map(|value| rounded(*value, 2)) else { continue };
            if bounds.last().is_none_or(|last| bound > *last) && bound > first && bound < last {
                bounds.push(bound);
            }
        }
        bounds
    }
}

fn place(value: f64, bounds: &[f64]) -> usize {
    bounds.iter().filter(|bound| value >= **bound).count()
}

fn names(name: &str, unit: &str, bounds: &[f64], rests: bool) -> Vec<String> {
    let unit = if unit == "1" { String::new() } else { format!(" {unit}") };
    let count = bounds.len() + 1;
    let (below, above) = if name == "time" { ("before", "after") } else { ("below", "above") };
    (0..count)
        .map(|k| match (k, k + 1 == count) {
            (0, true) => "everywhere".to_string(),
            (0, false) if rests => format!("at rest or reversing, {name} below {}{unit}", bounds[0]),
            (0, false) => format!("{name} {below} {}{unit}", bounds[0]),
            (_, true) => format!("{name} {above} {}{unit}", bounds[k - 1]),
            (_, false) => format!("{name} between {} and {}{unit}", bounds[k - 1], bounds[k]),
        })
        .collect()
}

/// A number rounded to this many significant digits.
#[must_use]
pub fn rounded(value: f64, digits: usize) -> f64 {
    format!("{value:.*e}", digits - 1).parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quantity(values: Vec<f64>, division: Division) -> Quantity {
        Quantity { name: "speed", unit: "rad/s", values: vec![values], division }
    }

    #[test]
    fn classes_say_their_bounds_and_every_row_lies_in_the_one_that_it_is_said_to() {
        // 0 to 300 in steps of one, both signs in turn: rest below 5 % of 300, then thirds of what moves, 110 and 205, the latter
        // rounded to the even digit.
        let values: Vec<f64> = (0..=300).map(|k| if k % 2 == 0 { f64::from(k) } else { -f64::from(k) }).collect();
        let classes = quantity(values, Division::Size { rests: true }).classes().unwrap();
        let expected = [
            "at rest or reversing, speed below 15 rad/s",
            "speed between 15 and 110 rad/s",
            "speed between 110 and 200 rad/s",
            "speed above 200 rad/s",
        ];
        assert_eq!(classes.names, expected);
        assert_eq!([14, 15, 109, 110, 199, 200].map(|row: usize| classes.of[0][row]), [0, 1, 1, 2, 2, 3]);
    }

    #[test]
    fn a_quantity_that_never_moves_has_no_classes() {
        assert_eq!(quantity(vec![3.0; 100], Division::Value).classes(), None);
        assert_eq!(quantity(vec![3.0; 100], Division::Sign("back", "forth")).classes(), None);
        assert_eq!(quantity(vec![2.0; 100], Division::Whole).classes(), None);
    }

    #[test]
    fn a_speed_is_the_slope_of_positions() {
        assert_eq!(speed_of(&[0.0, 1.0, 3.0, 6.0], 0.5), [2.0, 3.0, 5.0, 6.0]);
    }
}

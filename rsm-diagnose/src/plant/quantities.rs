//! Operating quantities of a record (speed, current, load, position, time ...) and the classes into which a report divides them.
//!
//! In: records and a simulation along them. Out: a value of each quantity for every row, and classes with the same bounds in all records. Does not
//! use the residual.

use super::levenberg::Fit;
use super::whitened_residuals::{Prepared, Simulated, WhitenedResiduals};
use rsm_core::order;
use rsm_core::threads::in_threads;
use rsm_sim::equation_plant::{self, SiteKind, SiteSignal};
use rsm_sim::kind::PlantKind;

/// Below this share of its largest speed, a plant counts as at rest or reversing.
const RESTING: f64 = 0.05;

/// A class with a smaller share of all rows is not reported separately.
const FEWEST: f64 = 0.01;

/// How a quantity is divided.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Division {
    /// By magnitude, in thirds of the rows. Small values are a separate class if the plant is then at rest.
    Size { rests: bool },
    /// By value, in thirds of the rows.
    Value,
    /// By sign, with the words for positive and negative values.
    Sign(String, String),
    /// By value: every value is a class.
    Whole,
}

impl Division {
    fn sign(negative: &str, positive: &str) -> Division {
        Division::Sign(negative.to_string(), positive.to_string())
    }
}

/// A quantity along all records.
#[derive(Debug, Clone)]
pub struct Quantity {
    /// Its name.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// A value for each row of each record.
    pub values: Vec<Vec<f64>>,
    division: Division,
}

/// The classes of a quantity.
#[derive(Debug, Clone, PartialEq)]
pub struct Classes {
    /// The quantity.
    pub quantity: String,
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

/// The values of a role of a site along each record: lengths of its vectors, if it has several elements. `None` if a record lacks it.
#[must_use]
pub fn of_role(signals: &[Vec<SiteSignal>], at: &str, role: &str) -> Option<Vec<Vec<f64>>> {
    signals.iter().map(|it| Some(it.iter().find(|it| it.at == at && it.role == role)?.length())).collect()
}

/// All quantities by which the rows of a plant's records are divided. Simulated values replace measured ones, because they have no noise. `signals`
/// are those of the sites along each record.
#[must_use]
pub fn quantities(
    whitened: &WhitenedResiduals,
    kind: PlantKind,
    simulated: &[Simulated],
    signals: &[Vec<SiteSignal>],
) -> Vec<Quantity> {
    let mut list = Collected { list: Vec::new(), whitened };
    let first = signals.first().map_or(&[][..], Vec::as_slice);
    let is_body = |kind: SiteKind| matches!(kind, SiteKind::Rotation | SiteKind::Translation | SiteKind::Vehicle);
    for signal in first {
        let Some(values) = of_role(signals, signal.at, signal.role) else { continue };
        // The site is named if there are several like it.
        let is_like = |it: &&SiteSignal| it.kind == signal.kind || is_body(it.kind) && is_body(signal.kind);
        let is_only = first.iter().filter(is_like).all(|it| it.at == signal.at);
        let named = |name: &str| if is_only { name.to_string() } else { format!("{name} of {}", signal.at) };
        let sign = |words: [&str; 2]| {
            let [negative, positive] = words.map(|it| if is_only { it.to_string() } else { format!("{}: {it}", signal.at) });
            Division::Sign(negative, positive)
        };
        let (unit, or_rest, by_size) = (&signal.unit, Division::Size { rests: true }, Division::Size { rests: false });
        match (signal.kind, signal.role) {
            (SiteKind::Rotation, "speed") => {
                list.add(&named("speed"), unit, or_rest, values.clone());
                list.add(&named("direction of rotation"), "", sign(["turning backward", "turning forward"]), values);
            }
            (SiteKind::Translation, "speed") => {
                list.add(&named("speed"), unit, or_rest, values.clone());
                list.add(&named("direction of motion"), "", sign(["moving backward", "moving forward"]), values);
            }
            (SiteKind::Translation, "position") => list.add(&named("position"), unit, Division::Value, values),
            (SiteKind::Rotation | SiteKind::Translation, "drive") => {
                let speed = of_role(signals, signal.at, "speed").unwrap_or_default();
                let product = |(force, speed): (&Vec<f64>, &Vec<f64>)| force.iter().zip(speed).map(|(a, b)| a * b).collect();
                let power = values.iter().zip(&speed).map(product).collect();
                list.add(&named("direction of drive"), "", sign(["driven backward", "driven forward"]), values);
                list.add(&named("flow of power"), "", sign(["braking", "driving"]), power);
            }
            (SiteKind::Vehicle, "road_speed") => {
                let rates = values.iter().zip(&whitened.records).map(|(it, prepared)| speed_of(it, prepared.record.period));
                let force = sign(["slowing down", "speeding up"]);
                list.add(&named("direction of force"), "", force, rates.collect());
                list.add("road speed", unit, or_rest, values);
            }
            (SiteKind::Winding, "currents") => list.add(&named("current"), unit, by_size, values),
            (SiteKind::Winding, "voltages") => list.add(&named("voltage"), unit, by_size, values),
            (SiteKind::Joint, "effort") => {
                let of = format!("effort in {}", signal.at);
                list.add(&of, "", sign(["joint loaded backward", "joint loaded forward"]), values);
            }
            (SiteKind::Storage, "level") | (SiteKind::Heat, "temperature") => {
                list.add(&named(signal.role), unit, Division::Value, values);
            }
            _ => {}
        }
    }
    for (k, signal) in kind.outputs().iter().enumerate() {
        let each = whitened.records.iter().zip(simulated);
        let values: Option<Vec<Vec<f64>>> =
            each.map(|(prepared, it)| of_output(prepared, it, k).map(<[f64]>::to_vec)).collect();
        // An output that is a quantity of a site has its classes already.
        let Some(values) = values.filter(|it| !list.holds(it)) else { continue };
        let rate = |(values, prepared): (&Vec<f64>, &Prepared)| speed_of(values, prepared.record.period);
        let rates = values.iter().zip(&whitened.records).map(rate).collect();
        list.add(signal.name, signal.unit, Division::Value, values);
        list.add(&format!("direction of {}", signal.name), "", Division::sign("falling", "rising"), rates);
    }
    for (k, signal) in kind.inputs().iter().enumerate() {
        let values: Option<Vec<Vec<f64>>> = whitened.records.iter().map(|it| it.record.inputs.get(k).cloned()).collect();
        let Some(values) = values.filter(|it| !list.holds(it)) else { continue };
        if values.iter().flatten().any(|it| *it < 0.0) {
            let of = format!("direction of {}", signal.name);
            list.add(&of, "", Division::sign("input negative", "input positive"), values.clone());
        }
        let since = values.iter().zip(&whitened.records).map(|(values, it)| since_a_move(values, it.record.period)).collect();
        list.add(signal.name, signal.unit, Division::Value, values);
        list.add(&format!("time since {} moved", signal.name), "s", Division::Value, since);
    }
    for decision in kind.decisions.iter().filter(|it| it.is_whole) {
        let Some(column) = decision.column else { continue };
        let of = |prepared: &Prepared| Some(vec![prepared.record.setting(decision.parameter)?; prepared.record.rows()]);
        if let Some(values) = whitened.records.iter().map(of).collect() {
            list.add(column, "", Division::Whole, values);
        }
    }
    let since_begin = |prepared: &Prepared| {
        let first = prepared.record.time.first().copied().unwrap_or(0.0);
        prepared.record.time.iter().map(|time| time - first).collect()
    };
    list.add("time", "s", Division::Value, whitened.records.iter().map(since_begin).collect());
    list.list
}

/// The signals of the sites along each record of a fit; an empty list for a record that the plant cannot follow.
#[must_use]
pub fn site_signals(whitened: &WhitenedResiduals, fit: &Fit) -> Vec<Vec<SiteSignal>> {
    let places: Vec<usize> = (0..whitened.records.len()).collect();
    in_threads(&places, whitened.threads, |&place| {
        let record = &whitened.records[place].record;
        equation_plant::site_signals(&fit.model.for_record(place, record), record).unwrap_or_default()
    })
}

/// Quantities that have a value at every row of every record.
struct Collected<'k> {
    list: Vec<Quantity>,
    whitened: &'k WhitenedResiduals,
}

/// Two traces of the same variable agree to this share of their largest value: both are integrated to a relative tolerance of 1e-6.
const SAME: f64 = 1e-4;

impl Collected<'_> {
    fn add(&mut self, name: &str, unit: &str, division: Division, values: Vec<Vec<f64>>) {
        let is_whole = values.len() == self.whitened.records.len()
            && values.iter().zip(&self.whitened.records).all(|(values, it)| values.len() == it.record.rows());
        if is_whole {
            self.list.push(Quantity { name: name.to_string(), unit: unit.to_string(), values, division });
        }
    }

    /// Whether a quantity has these values.
    fn holds(&self, values: &[Vec<f64>]) -> bool {
        let is_same = |(a, b): (&Vec<f64>, &Vec<f64>)| {
            let largest = a.iter().fold(0.0_f64, |most, it| most.max(it.abs()));
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= SAME * largest)
        };
        self.list.iter().any(|it| it.values.len() == values.len() && it.values.iter().zip(values).all(is_same))
    }
}

/// Seconds since an input last moved, or since the record began.
fn since_a_move(values: &[f64], period: f64) -> Vec<f64> {
    let mut since = 0.0;
    let each = values.iter().enumerate().map(|(k, value)| {
        since = if k > 0 && *value != values[k - 1] { 0.0 } else { since + period };
        since
    });
    each.collect()
}

impl Quantity {
    /// The classes of a quantity; `None` if all rows are in one class.
    #[must_use]
    pub fn classes(&self) -> Option<Classes> {
        let all: Vec<f64> = self.values.iter().flatten().copied().collect();
        let (names, class): (Vec<String>, Box<dyn Fn(f64) -> usize>) = match &self.division {
            Division::Sign(negative, positive) => {
                (vec![negative.clone(), positive.clone()], Box::new(|value| usize::from(value >= 0.0)))
            }
            Division::Whole => {
                let mut values = all.clone();
                order::sort(&mut values);
                values.dedup();
                let names = values.iter().map(|value| format!("{} {value}", self.name)).collect();
                (names, Box::new(move |value| values.iter().position(|it| *it == value).unwrap_or(0)))
            }
            Division::Size { .. } | Division::Value => {
                let is_size = self.division != Division::Value;
                let (bounds, has_rest) = self.bounds(&all);
                let names = names(&self.name, &self.unit, &bounds, has_rest);
                (names, Box::new(move |value| place(if is_size { value.abs() } else { value }, &bounds)))
            }
        };
        let of: Vec<Vec<usize>> = self.values.iter().map(|values| values.iter().map(|value| class(*value)).collect()).collect();
        let mut counts = vec![0_usize; names.len()];
        of.iter().flatten().for_each(|class| counts[*class] += 1);
        let enough = FEWEST * all.len() as f64;
        (counts.iter().filter(|count| **count as f64 > enough).count() > 1).then_some(Classes {
            quantity: self.name.clone(),
            names,
            of,
        })
    }

    /// The bounds between classes, rounded to two significant digits, and whether the first class is that of rest.
    fn bounds(&self, all: &[f64]) -> (Vec<f64>, bool) {
        let is_size = matches!(self.division, Division::Size { .. });
        let mut values: Vec<f64> = all.iter().map(|value| if is_size { value.abs() } else { *value }).collect();
        order::sort(&mut values);
        let mut bounds = Vec::new();
        let mut has_rest = false;
        let (Some(first), Some(last)) = (values.first().copied(), values.last().copied()) else { return (bounds, has_rest) };
        // All values are equal, within the accuracy of a simulation.
        if last - first <= 1e-6 * last.abs().max(first.abs()) {
            return (bounds, has_rest);
        }
        let mut moving = values.as_slice();
        if self.division == (Division::Size { rests: true }) {
            let rest = rounded(RESTING * last, 2);
            let at = values.partition_point(|value| *value < rest);
            if at as f64 > FEWEST * values.len() as f64 {
                bounds.push(rest);
                has_rest = true;
                moving = &values[at..];
            }
        }
        for third in [1, 2] {
            let Some(bound) = moving.get(moving.len() * third / 3).map(|value| rounded(*value, 2)) else { continue };
            if bounds.last().is_none_or(|last| bound > *last) && bound > first && bound < last {
                bounds.push(bound);
            }
        }
        (bounds, has_rest)
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
        Quantity { name: "speed".to_string(), unit: "rad/s".to_string(), values: vec![values], division }
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
    fn a_plant_that_never_rests_has_no_class_of_rest() {
        let classes = quantity((100..=400).map(f64::from).collect(), Division::Size { rests: true }).classes().unwrap();
        assert_eq!(classes.names[0], "speed below 200 rad/s");
    }

    #[test]
    fn a_quantity_that_never_moves_has_no_classes() {
        assert_eq!(quantity(vec![3.0; 100], Division::Value).classes(), None);
        assert_eq!(quantity(vec![3.0; 100], Division::sign("back", "forth")).classes(), None);
        assert_eq!(quantity(vec![2.0; 100], Division::Whole).classes(), None);
    }

    #[test]
    fn a_speed_is_the_slope_of_positions() {
        assert_eq!(speed_of(&[0.0, 1.0, 3.0, 6.0], 0.5), [2.0, 3.0, 5.0, 6.0]);
    }
}

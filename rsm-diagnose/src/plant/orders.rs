//! Order analysis of the error: components that repeat with the rotation of a shaft, or with the position of an axis.
//!
//! In: simulations before and after, along the same records. Out: for each output a spectrum over orders (waves per turn or waves per metre),
//! averaged over pieces of motion in one direction, and the orders that exceed their neighbours. Names no cause.
//!
//! A piece is weighted by a Hann window over the angle and summed with d(angle), so that a piece of changing speed is sampled evenly over the angle.
//! A row does not count for an order whose frequency there exceeds 0.45 of the sample rate.

use rsm_core::order;
use std::f64::consts::TAU;
use std::ops::Range;

use super::quantities::{of_role, speed_of};
use super::regions::{Region, Side, totals};
use super::spectrum::peaks;
use super::whitened_residuals::{Prepared, Simulated, WhitenedResiduals};
use crate::engine::angle::sin_cos;
use rsm_sim::equation_plant::{SiteKind, SiteSignal};

/// The length of a piece in turns. A window over eight turns separates half orders.
const TURNS_A_PIECE: f64 = 8.0;

/// Below this share of the largest speed, the angle changes too little for an analysis over the angle.
const SLOWEST_TURNING: f64 = 0.05;

/// The highest usable frequency of a wave, as a share of the sample rate.
pub(super) const HIGHEST_FREQUENCY: f64 = 0.45;

/// The largest number of waves over the whole travel of an axis.
const MOST_WAVES: usize = 400;

/// The highest order of a rotation without pole pairs.
const HIGHEST_ORDER: usize = 24;

/// The largest number of orders named for an output.
const NAMED_ORDERS: usize = 3;

/// The orders of an output.
#[derive(Debug, Clone, PartialEq)]
pub struct Orders {
    /// The output, by its place in the plant.
    pub output: usize,
    /// The rotation or travel: the name of a site, "wheel" or "position".
    pub of: &'static str,
    /// Orders in waves per turn or waves per metre.
    pub order: Vec<f64>,
    /// Mean power of the first error over the noise's: 1 is white noise.
    pub before: Vec<f64>,
    /// The same of the second error.
    pub after: Vec<f64>,
    /// The number of pieces averaged in each value.
    pub averages: usize,
    /// The width of a line to either side, in values.
    apart: usize,
    /// The squared amplitude, in units of the noise, of a wave with power one.
    square: f64,
    /// The number of rows in all pieces.
    rows: usize,
    /// The pole pairs of a motor.
    pole_pairs: Option<f64>,
}

/// Motion along one coordinate.
pub(super) struct Coordinate {
    of: &'static str,
    /// The coordinate in turns or metres, for each row of each record.
    pub(super) at: Vec<Vec<f64>>,
    /// The orders to compute, in waves per turn or waves per metre: the multiples of the first.
    pub(super) order: Vec<f64>,
    /// The pieces: record and rows.
    pieces: Vec<(usize, Range<usize>)>,
    apart: usize,
    pole_pairs: Option<f64>,
}

/// The orders of all outputs over all coordinates of the plant.
#[must_use]
pub fn orders(
    whitened: &WhitenedResiduals,
    signals: &[Vec<SiteSignal>],
    before: &[Simulated],
    after: &[Simulated],
) -> Vec<Orders> {
    let mut list = Vec::new();
    for coordinate in coordinates(whitened, signals) {
        for output in 0..whitened.floors.len() {
            list.extend(of_one(whitened, &coordinate, output, before, after));
        }
    }
    list
}

/// All coordinates along which the plant moves in these records. `signals` are those of the sites along each record.
pub(super) fn coordinates(whitened: &WhitenedResiduals, signals: &[Vec<SiteSignal>]) -> Vec<Coordinate> {
    let first = signals.first().map_or(&[][..], Vec::as_slice);
    let each = |at: &str, role: &str| of_role(signals, at, role);
    let turns = |speeds: Vec<Vec<f64>>| -> Vec<Vec<f64>> {
        let one = |(speeds, prepared): (&Vec<f64>, &Prepared)| {
            let mut at = 0.0;
            let each = speeds.iter().map(|speed| {
                at += speed * prepared.record.period / TAU;
                at
            });
            each.collect()
        };
        speeds.iter().zip(&whitened.records).map(one).collect()
    };
    let mut list = Vec::new();
    for signal in first {
        match (signal.kind, signal.role) {
            (SiteKind::Rotation, "speed") => {
                // The rotor of a machine: the machine's angle is the position of this body.
                let position = each(signal.at, "position");
                let is_of_rotor = |it: &&SiteSignal| {
                    it.kind == SiteKind::Machine
                        && it.role == "angle"
                        && position.as_ref().is_some_and(|own| own[0] == it.parts[0])
                };
                let machine = first.iter().find(is_of_rotor).map(|it| it.at);
                let pole_pairs = first.iter().find(|it| Some(it.at) == machine && it.role == "pole_pairs");
                let pole_pairs = pole_pairs.and_then(|it| it.parts[0].first().copied());
                // Twice the sixth electrical order. Cogging with more cycles has little effect.
                let most = pole_pairs.map_or(HIGHEST_ORDER, |it| (24.0 * it).max(48.0) as usize);
                list.extend(each(signal.at, "speed").map(|it| rotation(whitened, signal.at, turns(it), most, pole_pairs)));
            }
            (SiteKind::Vehicle, "wheel_speed") => {
                list.extend(
                    each(signal.at, "wheel_speed").map(|it| rotation(whitened, "wheel", turns(it), HIGHEST_ORDER, None)),
                );
            }
            (SiteKind::Translation, "position") => {
                list.extend(each(signal.at, "position").and_then(|at| travel(whitened, at)));
            }
            _ => {}
        }
    }
    list
}

impl Coordinate {
    /// The coordinate of an order, in words.
    pub(super) fn words(&self) -> String {
        match self.of {
            "position" => "a metre of the position".to_string(),
            of => format!("a turn of the {of} angle"),
        }
    }
}

/// Pieces of whole turns in one direction; orders in halves.
fn rotation(
    whitened: &WhitenedResiduals,
    of: &'static str,
    at: Vec<Vec<f64>>,
    most: usize,
    pole_pairs: Option<f64>,
) -> Coordinate {
    let mut pieces = Vec::new();
    for (record, at) in at.iter().enumerate() {
        let speed = speed_of(at, whitened.records[record].record.period);
        for run in runs(&speed) {
            let mut first = run.start;
            for row in run.clone() {
                if (at[row] - at[first]).abs() >= TURNS_A_PIECE {
                    pieces.push((record, first..row));
                    first = row;
                }
            }
        }
    }
    Coordinate { of, at, order: (1..=2 * most).map(|half| 0.5 * half as f64).collect(), pieces, apart: 0, pole_pairs }
}

/// Strokes of an axis; orders in waves over its whole travel.
fn travel(whitened: &WhitenedResiduals, at: Vec<Vec<f64>>) -> Option<Coordinate> {
    let all = at.iter().flatten();
    let (low, high) = order::ends(all);
    let travel = high - low;
    if travel.is_nan() || travel <= 0.0 {
        return None;
    }
    let mut pieces = Vec::new();
    for (record, at) in at.iter().enumerate() {
        let speed = speed_of(at, whitened.records[record].record.period);
        // A stroke over less than half of the travel gives lines more than twice as wide.
        pieces.extend(
            runs(&speed)
                .into_iter()
                .filter(|run| (at[run.end - 1] - at[run.start]).abs() > 0.5 * travel)
                .map(|run| (record, run)),
        );
    }
    // A line of a Hann window reaches two waves per stroke to either side, which is up to four waves per travel.
    Some(Coordinate {
        of: "position",
        at,
        order: (1..=MOST_WAVES).map(|k| k as f64 / travel).collect(),
        pieces,
        apart: 4,
        pole_pairs: None,
    })
}

/// Rows of motion in one direction.
fn runs(speed: &[f64]) -> Vec<Range<usize>> {
    let least = SLOWEST_TURNING * speed.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
    let mut list = Vec::new();
    let mut first = 0;
    for row in 0..=speed.len() {
        let goes_on = row < speed.len() && speed[row].abs() > least && (row == first || speed[row] * speed[row - 1] > 0.0);
        if !goes_on {
            // With fewer rows, the window has no useful shape.
            if row - first >= 16 && least > 0.0 {
                list.push(first..row);
            }
            first = row + usize::from(row < speed.len() && speed[row].abs() <= least);
        }
    }
    list
}

fn of_one(
    whitened: &WhitenedResiduals,
    coordinate: &Coordinate,
    output: usize,
    before: &[Simulated],
    after: &[Simulated],
) -> Option<Orders> {
    let count = coordinate.order.len();
    let first_order = coordinate.order[0];
    let sd = whitened.floors[output].sd;
    let mut sums = [vec![0.0; count], vec![0.0; count]];
    let mut pieces_of = vec![0_usize; count];
    let mut square = 0.0;
    let (mut averages, mut rows) = (0, 0);
    for (record, piece) in &coordinate.pieces {
        let prepared = &whitened.records[*record];
        let Some(k) = prepared.outputs.iter().position(|it| *it == output) else { continue };
        let (measured, used) = (prepared.measured(k), &prepared.used[k]);
        if used[piece.clone()].iter().any(|used| !used) {
            continue;
        }
        let at = &coordinate.at[*record];
        let (start, length) = (at[piece.start], at[piece.end - 1] - at[piece.start]);
        let period = prepared.record.period;
        let steps: Vec<f64> = piece.clone().map(|row| at[(row + 1).min(at.len() - 1)] - at[row]).collect();
        let fastest = steps.iter().fold(0.0_f64, |most, step| most.max(step.abs())) / period;
        let reach = coordinate.order.partition_point(|order| order * fastest < HIGHEST_FREQUENCY / period);
        let weights: Vec<f64> = piece
            .clone()
            .zip(&steps)
            .map(|(row, step)| (0.5 - 0.5 * (TAU * (at[row] - start) / length).cos()) * step.abs())
            .collect();
        let (plain, energy) = weights.iter().fold((0.0, 0.0), |(plain, energy), w| (plain + w, energy + w * w));
        if plain <= 0.0 {
            continue;
        }
        let mut lines = vec![[0.0; 4]; reach];
        for (row, weight) in piece.clone().zip(&weights) {
            let errors = [before, after].map(|it| weight * (measured[row] - it[*record][k][row]) / sd);
            let (sin, cos) = sin_cos(TAU * first_order * at[row]);
            let (mut re, mut im) = (1.0, 0.0);
            for line in &mut lines {
                (re, im) = (re * cos - im * sin, re * sin + im * cos);
                line[0] += errors[0] * re;
                line[1] += errors[0] * im;
                line[2] += errors[1] * re;
                line[3] += errors[1] * im;
            }
        }
        for (k, line) in lines.iter().enumerate() {
            sums[0][k] += (line[0] * line[0] + line[1] * line[1]) / energy;
            sums[1][k] += (line[2] * line[2] + line[3] * line[3]) / energy;
            pieces_of[k] += 1;
        }
        // A wave of amplitude a has |sum|^2 = (a/2)^2 (sum of weights)^2.
        square += 4.0 * energy / (plain * plain);
        averages += 1;
        rows += piece.len();
    }
    if averages == 0 {
        return None;
    }
    // Orders that at least half of the pieces reach.
    let reached = pieces_of.iter().take_while(|pieces| 2 * **pieces >= averages).count();
    let mean = |sums: &[f64]| sums[..reached].iter().zip(&pieces_of).map(|(sum, pieces)| sum / *pieces as f64).collect();
    Some(Orders {
        output,
        of: coordinate.of,
        order: coordinate.order[..reached].to_vec(),
        before: mean(&sums[0]),
        after: mean(&sums[1]),
        averages,
        apart: coordinate.apart,
        square: square / averages as f64,
        rows,
        pole_pairs: coordinate.pole_pairs,
    })
}

impl Orders {
    /// The power of one side.
    #[must_use]
    pub fn of(&self, side: Side) -> &[f64] {
        if side == Side::Before { &self.before } else { &self.after }
    }

    /// The orders that exceed their neighbours. Shares refer to `all`, the error of all outputs above the noise in squared standard deviations, and
    /// to `own`, that of this output.
    #[must_use]
    pub fn regions(&self, side: Side, own: f64, all: f64) -> Vec<Region> {
        let power = self.of(side);
        let found = peaks(power, self.averages, self.apart).into_iter().take(NAMED_ORDERS);
        found
            .map(|peak| {
                let beyond = power[peak.place] - power[peak.place] / peak.ratio;
                // The energy of a wave is half its squared amplitude for each row.
                let energy = 0.5 * beyond * self.square * self.rows as f64;
                Region {
                    output: self.output,
                    quantity: "order".to_string(),
                    region: self.words(self.order[peak.place]),
                    share_of_error: (energy / all).clamp(0.0, 1.0),
                    share_of_output: (energy / own).clamp(0.0, 1.0),
                    share_of_rows: 1.0 / power.len() as f64,
                }
            })
            .collect()
    }

    /// An order in words.
    fn words(&self, order: f64) -> String {
        match (self.of, self.pole_pairs) {
            ("position", _) => format!("a wave of {:.3} mm over the position", 1e3 / order),
            (of, Some(pole_pairs)) => {
                let electrical = order / pole_pairs;
                let also =
                    if electrical.fract() == 0.0 { format!(", {electrical} of the electrical angle") } else { String::new() };
                format!("order {order} of the {of} angle{also}")
            }
            (of, None) => format!("order {order} of the {of}"),
        }
    }
}

/// The regions from spectra and orders.
#[must_use]
pub fn spectral(
    whitened: &WhitenedResiduals,
    slices: &[super::regions::ErrorSlice],
    spectra: &[super::spectrum::Spectrum],
    orders: &[Orders],
    side: Side,
) -> Vec<Region> {
    let (each, all) = totals(slices, side);
    if all == 0.0 {
        return Vec::new();
    }
    let mut list = Vec::new();
    for spectrum in spectra.iter().filter(|it| each[it.output] > 0.0) {
        let whole = slices.iter().find(|it| it.quantity == "output" && it.output == spectrum.output);
        list.extend(spectrum.regions(
            side,
            whitened.floors[spectrum.output].sd,
            whole.map_or(0, |it| it.rows),
            each[spectrum.output],
            all,
        ));
    }
    for orders in orders.iter().filter(|it| each[it.output] > 0.0) {
        list.extend(orders.regions(side, each[orders.output], all));
    }
    list
}

#[cfg(test)]
mod tests {
    use super::super::noise::NoiseFloor;
    use super::super::whitened_residuals::Prepared;
    use super::*;
    use rsm_core::source::Source;
    use rsm_fit::random::Random;
    use rsm_sim::kind::OUTPUTS;
    use rsm_sim::plant_file::PlantFile;
    use rsm_sim::record::Record;

    /// A motor that runs up and down through 0, its speed with a wave of an order on it, and noise.
    fn found(order: f64, amplitude: f64) -> Vec<Region> {
        let text = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../rsm-sim/plants/pmac.toml")).unwrap();
        let file = PlantFile::read(&Source::new("pmac.toml", text)).unwrap();
        let mut random = Random::new(11);
        let (rows, period) = (6000, 1e-3);
        let mut csv = "time[s],v_d[V],v_q[V],load_torque[N*m],speed[rad/s]\n".to_string();
        let mut smooth = Vec::new();
        let mut angle = 0.3;
        for k in 0..rows {
            let time = f64::from(k) * period;
            let speed = 150.0 * (TAU * time / 4.0).sin() + 40.0 * (TAU * time / 0.9).sin();
            angle += speed * period;
            smooth.push(speed);
            csv += &format!("{time},0,0,0,{}\n", speed + amplitude * (order * angle).sin() + 0.3 * random.normal());
        }
        let record = Record::read(&Source::new("r.csv", csv), &file).unwrap();
        let whitened = WhitenedResiduals::new(vec![Prepared::new(record, 3)], [NoiseFloor::white(0.3); OUTPUTS], 1);
        assert_eq!(whitened.records[0].outputs, [2]);
        let of = |role, parts: Vec<f64>| SiteSignal {
            at: "rotor",
            kind: SiteKind::Rotation,
            role,
            unit: String::new(),
            parts: vec![parts],
        };
        let mut angle = 0.0;
        let turned = smooth.iter().map(|speed| {
            angle += speed * period;
            angle
        });
        let position = of("position", turned.collect());
        let machine = |role, parts| SiteSignal { at: "motor", kind: SiteKind::Machine, ..of(role, parts) };
        let angle = machine("angle", position.parts[0].clone());
        let signals = vec![vec![position, of("speed", smooth.clone()), angle, machine("pole_pairs", vec![4.0; rows as usize])]];
        let simulated = vec![vec![smooth]];
        let found = orders(&whitened, &signals, &simulated, &simulated);
        assert_eq!(found.len(), 1);
        // The wave's energy beyond the noise.
        let all = 0.5 * (amplitude / 0.3).powi(2) * f64::from(rows);
        found[0].regions(Side::Before, all, all)
    }

    #[test]
    fn a_wave_of_the_angle_is_found_by_its_order_through_changes_of_speed_and_direction() {
        for order in [6.0, 1.5] {
            let list = found(order, 0.3);
            assert_eq!(list.len(), 1, "{list:?}");
            assert!(list[0].region.starts_with(&format!("order {order} of the rotor angle")), "{list:?}");
            // Most rows are in pieces of eight turns; the rest reverses or is left over.
            assert!(list[0].share_of_error > 0.4, "{list:?}");
        }
    }

    #[test]
    fn noise_alone_has_no_order() {
        assert_eq!(found(6.0, 0.0), vec![]);
    }
}

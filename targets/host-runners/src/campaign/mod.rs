//! The campaign of faults: every sensor of the motor's loop, with every kind of fault, for 1 to 500 samples, at every operating point and bus
//! voltage.
//!
//! In: the share of the cases to run. Out: a row for each sensor and fault: the longest current, the time until the torque has recovered, how often
//! the bridge opened. The motor and its bridge are simulated in the frame of the stator ([`plant`]). A run with a fault is compared with a run
//! without it.

pub mod cases;
pub mod plant;
pub mod rig;

use rsm_rigs::motor::controller::{self, Controller, Known};
use rsm_rigs::motor::field_oriented::FullController;

use motor_loop::{Demand, Measured};

use cases::{BUSES, DURATIONS, Kind, POINTS, Point, Sensor, Spoiler};
use plant::Plant;
use rig::{Exchanged, PERIOD_S, PERIODS_A_TICK, Rig};

/// Periods before a fault, in which the bridge closes and the currents settle.
const LEAD: u32 = 300;

/// Periods after a fault that are examined; the torque must recover within the first 500 (50 ms).
const AFTER: u32 = 600;

/// The limit of the current vector during a fault, in A: 1.2 times the limit of 60.
pub const MOST_A: f64 = 72.0;

/// The torque must recover within this time after the last bad sample, in ms.
pub const MOST_MS: f64 = 50.0;

/// The torque has recovered if it differs from the torque without the fault by at most this, in N m, plus a twentieth of it.
const BACK_NM: f64 = 0.5;

/// One run of the campaign.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Run {
    /// The longest current vector from the fault on, in A.
    pub longest_a: f64,
    /// From the last bad sample until the bridge stays closed and the torque has recovered, in ms.
    pub back_ms: f64,
    /// Whether the bridge was opened.
    pub opened: bool,
    /// Mean difference from the torque without the fault, during the fault, in N m.
    pub torque_error_nm: f64,
}

/// The results of one sensor and one fault.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// The sensor.
    pub sensor: Sensor,
    /// The fault.
    pub kind: Kind,
    /// Number of runs.
    pub runs: usize,
    /// The largest [`Run::longest_a`].
    pub longest_a: f64,
    /// The largest [`Run::back_ms`].
    pub back_ms: f64,
    /// Number of runs in which the bridge was opened.
    pub opened: usize,
    /// The largest [`Run::torque_error_nm`] for faults of 500 samples in which the bridge stayed closed: the effect of a fault that cannot be
    /// distinguished from the truth.
    pub torque_error_nm: f64,
}

impl Row {
    /// Whether it stays within the limits.
    #[must_use]
    pub fn kept(&self) -> bool {
        self.longest_a <= MOST_A && self.back_ms <= MOST_MS
    }
}

/// A settled loop at a point, and the torques that follow without a fault.
fn settled(point: &Point, bus: f64) -> (Rig, Vec<f64>) {
    let mut plant = Plant::new(point.speed, bus);
    plant.inertia = point.inertia;
    let mut rig = Rig::new(plant);
    while rig.period < LEAD {
        rig.step(point.demand(rig.period), &mut |_, _| ());
    }
    rig.plant.longest = 0.0;
    let mut clean = rig.clone();
    let most = DURATIONS.into_iter().fold(0, u32::max) + AFTER;
    let torques = (0..most)
        .map(|_| {
            clean.step(point.demand(clean.period), &mut |_, _| ());
            clean.plant.torque()
        })
        .collect();
    (rig, torques)
}

/// Applies the fault in a period: gets the number of the period since the fault began, and changes the samples of the steps.
type Fault<'a> = &'a mut dyn FnMut(u32, &mut Demand, &mut Measured);

/// The change of the bus voltage in a period, in V: 60 A from a capacitor of 1 mF.
const BUS_V: f64 = 6.0;

/// Runs one fault of `samples` samples. If `sag` is given, the bus voltage falls to it and rises again. `seen` gets the inputs and outputs of the
/// steps, period by period.
fn one(
    settled: &(Rig, Vec<f64>),
    point: &Point,
    samples: u32,
    sag: Option<f64>,
    fault: Fault<'_>,
    seen: &mut dyn FnMut(&Exchanged),
) -> Run {
    let (rig, torques) = settled;
    let mut rig = rig.clone();
    let whole = rig.plant.bus;
    let mut run = Run { longest_a: 0.0, back_ms: 0.0, opened: false, torque_error_nm: 0.0 };
    for (k, clean) in (0..samples + AFTER).zip(torques) {
        let moved = BUS_V * f64::from((k + 1).min(samples.saturating_sub(k)));
        rig.plant.bus = sag.map_or(whole, |low| low.max(whole - moved));
        let exchanged = rig.step(point.demand(rig.period), &mut |demand, measured| {
            if k < samples {
                fault(k, demand, measured);
            }
        });
        seen(&exchanged);
        run.opened |= !rig.closed();
        let off = (rig.plant.torque() - clean).abs();
        if k < samples {
            run.torque_error_nm += off / f64::from(samples);
        } else if !rig.closed() || off > BACK_NM + 0.05 * clean.abs() {
            run.back_ms = f64::from(k + 1 - samples) * PERIOD_S * 1e3;
        }
    }
    run.longest_a = rig.plant.longest;
    run
}

/// A run of a randomly drawn fault.
#[derive(Debug, Clone, PartialEq)]
pub struct Drawn {
    /// A description of the fault.
    pub words: String,
    /// Whether a sensor drifts from the truth in plausible steps. The control steps cannot detect this, so there is no limit for the current.
    pub runs_away: bool,
    /// The run.
    pub run: Run,
}

/// Faults that make the references unreachable with the voltage: a wrong reading of bus voltage or speed, or a real fall of the bus voltage. Speed,
/// torque, bus voltage, kind, size and length are drawn from the seed.
#[must_use]
pub fn beyond_the_voltage(seed: u64) -> Drawn {
    let mut draw = cases::Draw::new(seed);
    let mut between = |low: f64, high: f64| low + (high - low) * draw.uniform();
    let point = Point { speed: between(-900.0, 900.0), torque: between(-21.6, 21.6) as f32, reversal: 0, inertia: None };
    let bus = between(180.0, 330.0);
    // From one sample to the longest fault of the campaign, uniform in the logarithm.
    let samples = 500f64.powf(between(0.0, 1.0)).round() as u32;
    let sensor = if between(0.0, 1.0) < 0.6 { Sensor::Bus } else { Sensor::Speed };
    let (kind, size) = (between(0.0, 4.0) as u32, between(-1.0, 1.0));
    let mut spoiler = Spoiler::new(sensor, Kind::Wild, seed);
    // At most the largest plausible step; or a much larger one.
    let step = if sensor == Sensor::Bus { 48.0 * size } else { 95.0 * size };
    let far = if sensor == Sensor::Bus { 150.0 * size } else { 600.0 * size };
    let add = |value: f64, demand: &mut Demand, measured: &mut Measured| {
        if sensor == Sensor::Bus {
            measured.bus_voltage_v += value as f32;
            demand.bus_voltage_v = measured.bus_voltage_v;
        } else {
            measured.speed_rad_s += value as f32;
            demand.speed_rad_s = measured.speed_rad_s;
        }
    };
    let low = 160.0 + (bus - 160.0) * size.abs();
    let (word, sag) = match kind {
        0 => ("wild".to_string(), None),
        1 => (format!("off by {step:.0}"), None),
        2 => (format!("runs away to {far:.0} off"), None),
        _ => (format!("true sag to {low:.0} V"), Some(low)),
    };
    let settled = settled(&point, bus);
    let mut fault = |k: u32, demand: &mut Demand, measured: &mut Measured| match kind {
        0 => spoiler.spoil(demand, measured),
        1 => add(step, demand, measured),
        // Over fifty periods: each single change is plausible.
        2 => add(far * (f64::from(k) / 50.0).min(1.0), demand, measured),
        _ => (),
    };
    let run = one(&settled, &point, samples, sag, &mut fault, &mut |_| ());
    let name = if sag.is_some() { "bus" } else { sensor.name() };
    let words = format!(
        "seed {seed}: {:.0} rad/s, {:.1} N m, {bus:.0} V: {name}, {word}, {samples} samples",
        point.speed, point.torque
    );
    Drawn { words, runs_away: kind == 2, run }
}

/// Runs every `every`-th case of the campaign, counted over all cases in a fixed order: 1 is all. Returns a row for each sensor and fault.
#[must_use]
pub fn run(every: usize) -> Vec<Row> {
    run_seen(every, &mut |_| ())
}

/// The same; `seen` gets the inputs and outputs of the steps. The state of the steps is new for each case, and `seen` gets no periods from before the
/// fault.
pub fn run_seen(every: usize, seen: &mut dyn FnMut(&Exchanged)) -> Vec<Row> {
    let mut rows: Vec<Row> = Sensor::ALL
        .into_iter()
        .flat_map(|sensor| Kind::ALL.map(|kind| (sensor, kind)))
        .map(|(sensor, kind)| Row { sensor, kind, runs: 0, longest_a: 0.0, back_ms: 0.0, opened: 0, torque_error_nm: 0.0 })
        .collect();
    let mut case = 0usize;
    for bus in BUSES {
        for point in &POINTS {
            let settled = settled(point, bus);
            for row in &mut rows {
                for samples in DURATIONS {
                    case += 1;
                    if !case.is_multiple_of(every.max(1)) {
                        continue;
                    }
                    let mut spoiler = Spoiler::new(row.sensor, row.kind, case as u64);
                    let (demand, measured) = settled.0.truth(point.demand(settled.0.period));
                    spoiler.whole(&demand, &measured);
                    let mut fault = |_: u32, demand: &mut Demand, measured: &mut Measured| spoiler.spoil(demand, measured);
                    let run = one(&settled, point, samples, None, &mut fault, seen);
                    row.runs += 1;
                    row.longest_a = row.longest_a.max(run.longest_a);
                    row.back_ms = row.back_ms.max(run.back_ms);
                    row.opened += usize::from(run.opened);
                    if samples == 500 && !run.opened {
                        row.torque_error_nm = row.torque_error_nm.max(run.torque_error_nm);
                    }
                }
            }
        }
    }
    rows
}

/// The longest current vector of the exact controller (the circle diagram in closed form, in double precision) without a fault, over all points and
/// bus voltages after it has settled, in A: the reference for the campaign.
#[must_use]
pub fn exact_longest_a() -> f64 {
    let mut longest = 0f64;
    for bus in BUSES {
        for point in &POINTS {
            let mut plant = Plant::new(point.speed, bus);
            plant.inertia = point.inertia;
            let known = Known {
                resistance: plant.resistance,
                inductance: plant.inductance,
                flux_linkage: plant.flux_linkage,
                pole_pairs: plant.pole_pairs,
                current_limit: 60.0,
                bus_voltage: 270.0,
                voltage_margin: 0.05,
                pwm_period: PERIOD_S,
                dead_time: 0.0,
            };
            let mut exact = FullController::full(known);
            let mut duties = [0.5; 3];
            for period in 0..LEAD + 1100 {
                if period == LEAD {
                    plant.longest = 0.0;
                }
                if period % PERIODS_A_TICK == 0 {
                    let torque_nm = f64::from(point.demand(period));
                    exact.references(&controller::Demand { torque_nm, speed_rad_s: plant.speed, bus_voltage_v: bus });
                }
                let next = exact.duties(&controller::Measured {
                    currents_a: plant.phases(),
                    angle_rad: plant.angle,
                    speed_rad_s: plant.speed,
                    bus_voltage_v: bus,
                });
                plant.run(Some(duties), PERIOD_S);
                duties = next;
            }
            longest = longest.max(plant.longest);
        }
    }
    longest
}

//! Excitations of a motor: voltages in the rotor frame, within its current and voltage limits.
//!
//! In: accepted plants and limits. Out: records of v_d, v_q and load torque. The voltages are the model's steady-state voltages, fed forward. With a
//! phase resistance of a few hundredths of an ohm the speed follows the voltage within milliseconds, so no controller is needed to make the record.
//! The bus voltage and the longest current vector are never exceeded.

use super::shapes::{Path, binary};
use super::{Collected, Excitation, Limits, blank, is_within};
use rsm_sim::equation_plant::{SiteKind, bodies, role_names};
use rsm_sim::kind::PlantKind;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;
use rsm_sim::simulate::Outputs;

/// The share of the longest current vector for accelerations and d-axis currents. Friction and load need the rest.
const OF_CURRENT: f64 = 0.7;

/// The largest voltage as a share of V_dc/sqrt 3. The drive leaves the same reserve for its current control.
const OF_VOLTAGE: f64 = 0.95;

/// The longest kind of record has this many times the rows of the others. Windings of a motor of this size heat up in minutes; a fifth of that time
/// constant is recorded.
const LONG: usize = 4;

/// The largest number of rows of such a record.
const LONG_ROWS: usize = 32_000;

struct Motor<'a> {
    limits: &'a Limits,
    holds_direct_current: bool,
    /// The indices of the inputs: the voltages of both axes, the load.
    inputs: [usize; 3],
    /// Lowest and highest load torque in the records, in N m.
    load: [f64; 2],
    resistance: f64,
    inductance: f64,
    flux: f64,
    pole_pairs: f64,
    inertia: f64,
    friction: f64,
    voltage: f64,
    current: f64,
    top: f64,
}

/// The required motion and currents, row by row.
struct Setpoints {
    speed: (Vec<f64>, Vec<f64>),
    direct: (Vec<f64>, Vec<f64>),
    load: Vec<f64>,
    /// Added to both voltages.
    extra: Option<[Vec<f64>; 2]>,
    /// From this row on, both voltages are 0.
    off: usize,
}

impl Motor<'_> {
    fn torque_constant(&self) -> f64 {
        1.5 * self.pole_pairs * self.flux
    }

    /// The largest acceleration, in rad/s^2, that a share of the current can make.
    fn acceleration(&self, share: f64) -> f64 {
        share * OF_CURRENT * self.current * self.torque_constant() / self.inertia
    }

    /// Speeds one after another, with ramps, and equal rests that fill the record.
    fn speeds(&self, targets: &[f64], acceleration: f64, seconds: f64) -> Path {
        let mut last = 0.0;
        let ramps: Vec<f64> = targets
            .iter()
            .map(|target| {
                let ramp = (target - last).abs() / acceleration;
                last = *target;
                ramp
            })
            .collect();
        let rest = ((seconds - ramps.iter().sum::<f64>()) / targets.len() as f64).max(0.0);
        let mut path = Path::from(0.0);
        for (target, ramp) in targets.iter().zip(ramps) {
            path.line_to(*target, ramp);
            path.hold(rest);
        }
        path
    }

    /// Values one after another, each for the same time, with edges of a few milliseconds, so that L di/dt stays at a few volts.
    fn levels(&self, levels: &[f64], seconds: f64) -> Path {
        let each = seconds / levels.len() as f64;
        let edge = (0.1 * each).min(10.0 * self.inductance / self.resistance.max(1e-3));
        let mut path = Path::from(0.0);
        for level in levels {
            path.line_to(*level, edge);
            path.hold(each - edge);
        }
        path
    }

    /// The load that is used for no load: the value nearest to 0 in the records.
    fn idle(&self) -> f64 {
        let [low, high] = self.load;
        if low.is_finite() { 0.0_f64.clamp(low, high) } else { 0.0 }
    }

    fn setpoints(&self, speed: &Path, direct: &Path, rows: usize) -> Setpoints {
        let period = self.limits.period;
        Setpoints {
            speed: speed.sampled(rows, period),
            direct: direct.sampled(rows, period),
            load: vec![self.idle(); rows],
            extra: None,
            off: rows,
        }
    }

    /// v = r i + L di/dt + the induced voltage, (17) and (18), with i_q from (21) and the balance of torques.
    fn record(&self, name: &str, wanted: &Setpoints) -> Option<Record> {
        let rows = wanted.load.len();
        let (k_t, period) = (self.torque_constant(), self.limits.period);
        let i_q: Vec<f64> = (0..rows)
            .map(|row| {
                let (w, dw) = (wanted.speed.0[row], wanted.speed.1[row]);
                (self.inertia * dw + self.friction * w + wanted.load[row]) / k_t
            })
            .collect();
        let mut voltages = [Vec::with_capacity(rows), Vec::with_capacity(rows)];
        for row in 0..rows {
            let w_e = self.pole_pairs * wanted.speed.0[row];
            let (i_d, di_d) = (wanted.direct.0[row], wanted.direct.1[row]);
            // A step of the torque is spread over five rows, so that di/dt stays finite.
            let di_q = if row >= 5 { (i_q[row] - i_q[row - 5]) / (5.0 * period) } else { 0.0 };
            let mut v_d = self.resistance * i_d + self.inductance * di_d - w_e * self.inductance * i_q[row];
            let mut v_q = self.resistance * i_q[row] + self.inductance * di_q + w_e * (self.inductance * i_d + self.flux);
            if let Some([d, q]) = &wanted.extra {
                v_d += d[row];
                v_q += q[row];
            }
            if row >= wanted.off {
                (v_d, v_q) = (0.0, 0.0);
            }
            if v_d.hypot(v_q) > self.voltage {
                return None;
            }
            voltages[0].push(v_d);
            voltages[1].push(v_q);
        }
        let [v_d, v_q] = voltages;
        let v_d = if self.holds_direct_current { vec![0.0; rows] } else { v_d };
        let mut inputs = vec![Vec::new(); 3];
        for (place, values) in self.inputs.into_iter().zip([v_d, v_q, wanted.load.clone()]) {
            inputs[place] = values;
        }
        Some(blank(name, self.limits, rows, inputs))
    }
}

/// Whether the drive of the records holds the direct current at 0: a parameter that the absence of columns determines.
fn holds_direct_current(kind: PlantKind, limits: &Limits) -> bool {
    let is_by_absence = |name: &str| kind.decisions.iter().any(|it| it.parameter == name && it.column.is_none());
    limits.settings.iter().any(|(name, value)| is_by_absence(name) && *value == 1.0)
}

/// The motor of a plant: a machine with two axes, its winding, its rotor, inputs for both voltages and the load.
struct Parts {
    machine: &'static str,
    winding: &'static str,
    rotor: &'static str,
    inputs: [usize; 3],
    /// The indices of the outputs: the currents of both axes, the speed.
    outputs: [usize; 3],
}

impl Parts {
    fn of(kind: PlantKind) -> Option<Parts> {
        let names = role_names(kind);
        let name = |at: &str, role: &str, part| {
            names.iter().find(|it| it.at == at && it.role == role && it.part == part).map(|it| it.name)
        };
        let machine = names.iter().find(|it| it.kind == SiteKind::Machine)?.at;
        let winding = names.iter().find(|it| it.kind == SiteKind::Winding)?.at;
        let angle = name(machine, "angle", 0)?;
        let rotor = bodies(kind).into_iter().find(|it| it.kind == SiteKind::Rotation && it.position == Some(angle))?;
        let input = |name: Option<&str>| kind.inputs().iter().position(|it| Some(it.name) == name);
        let voltage = |part| input(name(machine, "voltages", part));
        let current = |part| kind.output(name(machine, "currents", part)?);
        // Another input would have an unknown purpose.
        let has_three = kind.inputs().len() == 3;
        has_three.then_some(())?;
        Some(Parts {
            machine,
            winding,
            rotor: rotor.at,
            inputs: [voltage(0)?, voltage(1)?, input(name(rotor.at, "load", 0))?],
            outputs: [current(0)?, current(1)?, kind.output(rotor.speed?)?],
        })
    }
}

/// All excitations of a motor; `None` for another plant.
pub(super) fn library(accepted: &[&PlantFile], limits: &Limits) -> Option<Vec<Excitation>> {
    let plant = accepted.first()?;
    let kind = plant.kind;
    let parts = Parts::of(kind)?;
    let parameters = plant.effective_parameters();
    let of = |at, role| limits.role(at, role);
    let [d, q, speed] = parts.outputs;
    let [low, high] = limits.seen[speed];
    let top = if low.is_finite() { low.abs().max(high.abs()) } else { 0.0 };
    // Limits that the plant file does not have are those of the records.
    let recorded = |list: &[[f64; 2]]| {
        let largest = list.iter().map(|[low, high]| if low.is_finite() { low.abs().max(high.abs()) } else { 0.0 });
        largest.map(|it| it * it).sum::<f64>().sqrt()
    };
    let [v_d, v_q, load] = parts.inputs;
    let voltage = parameters.optional("bus_voltage").map(|it| OF_VOLTAGE * it / 3.0_f64.sqrt());
    let current = parameters.optional("current_limit").unwrap_or_else(|| recorded(&[limits.seen[d], limits.seen[q]]));
    let motor = Motor {
        limits,
        holds_direct_current: holds_direct_current(kind, limits),
        inputs: parts.inputs,
        load: limits.inputs[load],
        resistance: of(parts.winding, "resistance")?,
        inductance: of(parts.winding, "inductance")?,
        flux: of(parts.machine, "flux_linkage")?,
        pole_pairs: of(parts.machine, "pole_pairs")?,
        inertia: of(parts.rotor, "inertia")?,
        friction: of(parts.rotor, "viscous_friction").unwrap_or(0.0),
        voltage: voltage.unwrap_or_else(|| recorded(&[limits.inputs[v_d], limits.inputs[v_q]])),
        current,
        top,
    };
    let is_allowed = |_: &PlantFile, outputs: &Outputs| {
        let of = |output: usize| outputs.of(kind.outputs()[output].name).unwrap_or(&[]);
        let is_short = |(k, q): (usize, &f64)| of(d).get(k).copied().unwrap_or(0.0).hypot(*q) <= current;
        // A motor that turned in one direction may turn in the other.
        of(q).iter().enumerate().all(is_short) && is_within(kind, outputs, speed, [-top, top])
    };
    let mut list = Collected::new(accepted, &is_allowed);
    let rows = limits.rows;
    let seconds = rows as f64 * limits.period;
    let none = Path::from(0.0);
    let mut add = |name: &str, words: &'static str, make: &super::RecordMaker<'_>| list.add(name, words, make);
    let turning = |name: &'static str, speeds: Vec<f64>, share: f64| {
        let motor = &motor;
        move |a: f64| {
            let targets: Vec<f64> = speeds.iter().map(|it| a * it * motor.top).collect();
            let path = motor.speeds(&targets, motor.acceleration(share), seconds);
            motor.record(name, &motor.setpoints(&path, &Path::from(0.0), rows))
        }
    };
    add(
        "speed-steps",
        "steps of speed in both directions, up to the highest that was seen",
        &turning("speed-steps", vec![0.25, -0.25, 0.6, -0.6, 0.95, -0.95, 0.1, -0.1], 0.5),
    );
    add(
        "high-speed",
        "steady turning near the highest speed that was seen",
        &turning("high-speed", vec![0.97, 0.93, 0.97, 0.9], 0.5),
    );
    add(
        "hard-accelerations",
        "reversals at high current, without rest",
        &turning("hard-accelerations", vec![0.8, -0.8, 0.8, -0.8, 0.8, -0.8], 1.0),
    );
    add("slow-turns", "slow steady turning in both directions", &turning("slow-turns", vec![0.02, -0.02, 0.05, -0.05], 0.2));
    add("slow-reversals", "slow ramps of speed through zero", &|a| {
        let top = 0.08 * a * motor.top;
        let mut path = Path::from(0.0);
        for _ in 0..3 {
            path.line_to(top, seconds / 12.0);
            path.line_to(-top, seconds / 6.0);
            path.line_to(0.0, seconds / 12.0);
        }
        motor.record("slow-reversals", &motor.setpoints(&path, &none, rows))
    });
    add("run-up", "slow ramps to the highest speed that was seen and back, in both directions", &|a| {
        let top = 0.98 * a * motor.top;
        let mut path = Path::from(0.0);
        for target in [top, 0.0, -top, 0.0] {
            path.line_to(target, seconds / 4.0);
        }
        motor.record("run-up", &motor.setpoints(&path, &none, rows))
    });
    add("short-circuit", "a run-up, then both voltages zero", &|a| {
        let mut path = Path::from(0.0);
        path.line_to(0.9 * a * motor.top, 0.3 * seconds);
        path.hold(seconds);
        let wanted = Setpoints { off: rows / 2, ..motor.setpoints(&path, &none, rows) };
        motor.record("short-circuit", &wanted)
    });
    let [low, high] = motor.load;
    if high - low > 0.0 {
        add("load-steps", "steps of the load between its extremes, at medium speed in both directions", &|a| {
            let targets: Vec<f64> = [0.5, -0.5].iter().map(|it| a * it * motor.top).collect();
            let path = motor.speeds(&targets, motor.acceleration(0.5), seconds);
            let mut wanted = motor.setpoints(&path, &none, rows);
            for (row, load) in wanted.load.iter_mut().enumerate() {
                *load = [high, low, 0.5 * (high + low)][8 * row / rows % 3];
            }
            motor.record("load-steps", &wanted)
        });
    }
    add("binary-voltage", "a binary sequence on the voltages, turning at medium speed", &|a| {
        let path = motor.speeds(&[0.4 * motor.top], motor.acceleration(0.5), seconds);
        let mut wanted = motor.setpoints(&path, &none, rows);
        // Two milliseconds: several of them fit in an electrical time constant of ten milliseconds.
        let hold = (0.002 / limits.period).round().max(1.0) as usize;
        let sequence = |skip| binary(rows, hold, skip).iter().map(|it| 0.08 * a * motor.voltage * it).collect::<Vec<f64>>();
        wanted.extra = Some([sequence(0), sequence(200)]);
        motor.record("binary-voltage", &wanted)
    });
    if motor.holds_direct_current {
        return Some(list.list);
    }
    let levels = [0.4, -0.4, 0.8, -0.8, 0.2, 1.0, -1.0, 0.0];
    let scaled = |levels: &[f64], a: f64| -> Vec<f64> { levels.iter().map(|it| a * it * OF_CURRENT * motor.current).collect() };
    add("direct-current-at-standstill", "steps of the current along the d axis, at standstill", &|a| {
        let direct = motor.levels(&scaled(&levels, a), seconds);
        motor.record("direct-current-at-standstill", &motor.setpoints(&none, &direct, rows))
    });
    add("direct-current-at-speed", "steps of the current along the d axis, turning in both directions", &|a| {
        let direct = motor.levels(&scaled(&[0.0, -0.4, -0.8, 0.3, 0.0, -0.4, -0.8, 0.3], a), seconds);
        let path = motor.speeds(&[0.5 * motor.top, -0.5 * motor.top], motor.acceleration(0.5), seconds);
        motor.record("direct-current-at-speed", &motor.setpoints(&path, &direct, rows))
    });
    let long = (LONG * rows).min(LONG_ROWS);
    add("heating", "a long current along the d axis at standstill, with short pauses", &|a| {
        let mut levels = vec![a * OF_CURRENT * motor.current; 12];
        levels[4] = 0.0;
        levels[8] = 0.0;
        let direct = motor.levels(&levels, long as f64 * limits.period);
        motor.record("heating", &motor.setpoints(&none, &direct, long))
    });
    Some(list.list)
}

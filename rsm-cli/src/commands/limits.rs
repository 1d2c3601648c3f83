//! `rsm check --limits`: whether the motor's loop with the surfaces keeps the limits of voltage and current.
//!
//! In: a checked model, a plant file, the ranges of speed and bus voltage. Out: the answer of `rsm_rigs::motor::limits` in words and as JSON. No
//! mathematics of its own.

use std::path::PathBuf;

use clap::Args;
use rsm_core::check::Checked as Model;
use rsm_core::source::Source;
use rsm_rigs::motor::limits::{self, Limits, Operation, Point, Share, Verdict};
use rsm_sim::plant_file::PlantFile;
use serde_json::{Map, Value, json};

use super::check::Problem;
use crate::outcome::Refusal;

#[derive(Args)]
pub struct LimitsArguments {
    /// Prove |v| <= V/sqrt 3 and |i| <= I in the motor's loop for every torque, speed and bus voltage, or give a point that violates a limit
    #[arg(long, requires = "plant")]
    limits: bool,
    /// The plant file of the motor, for --limits
    #[arg(long, requires = "limits")]
    plant: Option<PathBuf>,
    /// The highest speed for --limits, in rad/s [default: the upper end of the surface's range]
    #[arg(long, requires = "limits", value_name = "RAD_S")]
    speed: Option<f32>,
    /// The lowest and the highest bus voltage for --limits, in V [default: 2/3 and 11/9 of the plant's]
    #[arg(long, requires = "limits", value_name = "LOW,HIGH", value_delimiter = ',', num_args = 1)]
    bus: Vec<f32>,
    /// The largest number of cells that --limits examines; beyond it the result is "not decided"
    #[arg(long, requires = "limits", value_name = "CELLS", default_value_t = limits::WORK)]
    work: usize,
}

/// The default range of a drive whose bus voltage may fall and rise: 180 to 330 V at 270 V nominal.
const BUS: [f64; 2] = [2.0 / 3.0, 11.0 / 9.0];

/// The ranges of the check, and its result.
pub struct Checked {
    operation: Operation,
    found: Limits,
}

/// Runs the check if it was requested.
pub fn check(arguments: &LimitsArguments, model: &Model) -> Result<Option<Checked>, Refusal> {
    let (true, Some(path)) = (arguments.limits, &arguments.plant) else { return Ok(None) };
    let plant = PlantFile::read(&Source::read(path)?)?;
    let refuse = |what: String| Refusal::new(format!("{}: {what}", path.display()));
    if !plant.kind.is("pmac") {
        return Err(refuse(format!("found the plant `{}`, --limits needs a `pmac`", plant.kind.name())));
    }
    if let Some(effect) = plant.effects.first() {
        let kind = effect.description.kind;
        return Err(refuse(format!("found the effect `{kind}`, expected none: --limits is for the nominal motor")));
    }
    // First report a model without the surfaces of the loop: it has no speed range either.
    limits::step::Tapes::new(model)?;
    let top = model.model().input("speed").map_or(0.0, |input| input.range[1]);
    let top_speed_rad_s = arguments.speed.unwrap_or(top as f32);
    let nominal = plant.parameters.number("bus_voltage");
    let bus_voltage_v = match arguments.bus[..] {
        [] => BUS.map(|share| (share * nominal) as f32),
        [low, high] => [low, high],
        _ => return Err(Refusal::new("--bus: expected two numbers, the lowest and the highest voltage, as 180,330")),
    };
    let [low, high] = bus_voltage_v;
    if !(low > 0.0 && low <= high && high.is_finite()) {
        return Err(Refusal::new(format!("--bus: found {low},{high}, expected two positive voltages, the lower one first")));
    }
    if !(top_speed_rad_s > 0.0 && top_speed_rad_s.is_finite()) {
        return Err(Refusal::new(format!("--speed: found {top_speed_rad_s}, expected a positive speed")));
    }
    let trim_a = plant.parameters.number("current_limit") as f32;
    let operation = Operation { top_speed_rad_s, bus_voltage_v, trim_a };
    let found = limits::prove(model, &plant.parameters, &operation, arguments.work)?;
    Ok(Some(Checked { operation, found }))
}

impl Checked {
    /// The property that does not hold or is not decided.
    pub fn problem(&self) -> Option<Problem> {
        let at = |names: &[(&str, Value)]| names.iter().map(|(name, value)| ((*name).to_string(), value.clone())).collect();
        let (what, at): (String, Map<String, Value>) = match &self.found.verdict {
            Verdict::Proved => return None,
            Verdict::VoltageExceeded(point) => {
                let share = 100.0 * self.found.voltage.seen;
                (format!("the voltage limit does not hold: {share:.2} % of V/sqrt 3 {}", place(point)), object(point))
            }
            Verdict::CurrentExceeded(point) => {
                let share = 100.0 * self.found.current.seen;
                (format!("the current limit does not hold: {share:.4} % of I {}", place(point)), object(point))
            }
            Verdict::Undecided(cell) => {
                let range = |[low, high]: [f64; 2], unit: &str| format!("{low:.6} to {high:.6} {unit}");
                let what = format!(
                    "not decided after {} cells: torque {}, speed {}, bus {}; more --work may decide it",
                    self.found.cells,
                    range(cell.torque_nm, "N m"),
                    range(cell.speed_rad_s, "rad/s"),
                    range(cell.bus_voltage_v, "V"),
                );
                let cell = [
                    ("torque", json!(cell.torque_nm)),
                    ("speed", json!(cell.speed_rad_s)),
                    ("bus_voltage", json!(cell.bus_voltage_v)),
                ];
                (what, at(&cell))
            }
        };
        Some(Problem { r#where: "limits".to_string(), what, at })
    }

    /// The answer as JSON.
    pub fn json(&self) -> Value {
        let share = |share: &Share| json!({ "at_most": crate::output::finite(share.at_most), "seen": share.seen, "at": object(&share.at) });
        let verdict = match self.found.verdict {
            Verdict::Proved => "proved",
            Verdict::VoltageExceeded(_) | Verdict::CurrentExceeded(_) => "broken",
            Verdict::Undecided(_) => "not-decided",
        };
        let top = self.operation.top_speed_rad_s;
        json!({
            "verdict": verdict,
            "speed": [-top, top],
            "bus_voltage": self.operation.bus_voltage_v,
            "voltage": share(&self.found.voltage),
            "current": share(&self.found.current),
            "cells": self.found.cells,
        })
    }

    /// The answer in words.
    pub fn lines(&self) -> Vec<String> {
        let [low, high] = self.operation.bus_voltage_v;
        let top = self.operation.top_speed_rad_s;
        let head = match self.found.verdict {
            Verdict::Proved => "proved",
            Verdict::VoltageExceeded(_) | Verdict::CurrentExceeded(_) => "violated at a point",
            Verdict::Undecided(_) => "not decided",
        };
        let line = |what: &str, limit: &str, share: &Share| {
            let (most, seen) = (100.0 * share.at_most, 100.0 * share.seen);
            let most = if most.is_finite() { format!("at most {most:.2} %") } else { "no bound".to_string() };
            format!("  {what}: {most} of {limit}; {seen:.2} % {}", place(&share.at))
        };
        vec![
            format!("limits of the loop: {head} ({} cells)", self.found.cells),
            format!("  over every torque demand, speeds of {top} rad/s both ways, bus {low} to {high} V, every trim of i_d"),
            line("voltage", "V/sqrt 3", &self.found.voltage),
            line("current", "I", &self.found.current),
        ]
    }
}

fn place(point: &Point) -> String {
    format!(
        "at {} rad/s, {} V, demand of {} N m after {} N m, trim {} A: i_d {} A, i_q {} A",
        point.speed_rad_s, point.bus_voltage_v, point.torque_nm, point.last_torque_nm, point.trim_a, point.i_d_a, point.i_q_a
    )
}

fn object(point: &Point) -> Map<String, Value> {
    let numbers = [
        ("torque", point.torque_nm),
        ("speed", point.speed_rad_s),
        ("bus_voltage", point.bus_voltage_v),
        ("last_torque", point.last_torque_nm),
        ("trim", point.trim_a),
        ("i_d", point.i_d_a),
        ("i_q", point.i_q_a),
    ];
    numbers.into_iter().map(|(name, value)| (name.to_string(), json!(value))).collect()
}

//! Plans of tip-in runs: gear, engine speed, and the load that is added to the car.
//!
//! In: a plan file, or levels and a seed. Out: a [`TrackPlan`], a run a row, in the order in which the runs are made. Never simulates.

use std::fmt::Write as _;

use rsm_core::source::{Collector, Faults, Source};
use rsm_fit::plan::Plan;
use rsm_fit::random::Random;

/// rad/s in one rpm.
pub const RPM: f64 = std::f64::consts::PI / 30.0;

/// Engine speeds of the experiment, in rpm: five in each gear between 1200 and 4800 (docs/book/src/reference/paper.md: steps of 5 m/s in every gear
/// would ask for speeds at which no engine runs).
pub const ENGINE_SPEEDS_RPM: [f64; 5] = [1200.0, 2100.0, 3000.0, 3900.0, 4800.0];

/// Engine speeds of the unseen set, in rpm: between those of the experiment.
pub const UNSEEN_ENGINE_SPEEDS_RPM: [f64; 5] = [1400.0, 1800.0, 2600.0, 3500.0, 4500.0];

/// Gears of the car.
const GEARS: usize = 5;

/// One tip-in run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TipIn {
    /// Its number in the plan.
    pub run: u32,
    /// The gear, 1 to 5.
    pub gear: usize,
    /// Engine speed at which it coasts, in rad/s. The road speed follows from the gear.
    pub engine_speed: f64,
    /// Mass added to that of the plant file, in kg.
    pub load: f64,
}

/// Runs in the order in which they are made.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackPlan {
    /// The runs.
    pub runs: Vec<TipIn>,
}

impl TrackPlan {
    /// Every gear with every engine speed (in rpm) and every load (in kg), in the random order of a seed.
    #[must_use]
    pub fn full(engine_speeds_rpm: &[f64], loads: &[f64], seed: u64) -> Self {
        let mut runs = Vec::new();
        for gear in 1..=GEARS {
            for speed in engine_speeds_rpm {
                for load in loads {
                    runs.push(TipIn { run: 0, gear, engine_speed: speed * RPM, load: *load });
                }
            }
        }
        Random::new(seed).shuffle(&mut runs);
        for (k, run) in runs.iter_mut().enumerate() {
            run.run = k as u32 + 1;
        }
        TrackPlan { runs }
    }

    /// The 25 runs of the experiment.
    #[must_use]
    pub fn experiment(seed: u64) -> Self {
        Self::full(&ENGINE_SPEEDS_RPM, &[0.0], seed)
    }

    /// The 25 runs of the unseen set.
    #[must_use]
    pub fn unseen(seed: u64) -> Self {
        Self::full(&UNSEEN_ENGINE_SPEEDS_RPM, &[0.0], seed)
    }

    /// Reads a plan file: `run`, `gear[1]`, `engine_speed[rpm]` in any unit of it, and `load[kg]`, which may be absent.
    ///
    /// # Errors
    /// Every fault with its line: a missing column, a gear that the car does not have, an engine speed or a load that is not positive.
    pub fn read(source: &Source) -> Result<Self, Faults> {
        let plan = Plan::read(source)?;
        let mut faults = Collector::new();
        let mut column = |name: &str, unit: &str| match plan.settings(name, unit) {
            Ok(values) => values,
            Err(fault) => {
                faults.push(fault);
                Vec::new()
            }
        };
        let (gears, speeds) = (column("gear", "1"), column("engine_speed", "rad/s"));
        let loads = if plan.factor("load").is_some() { column("load", "kg") } else { vec![0.0; plan.runs.len()] };
        for factor in plan.factors.iter().filter(|it| !["gear", "engine_speed", "load"].contains(&it.name.as_str())) {
            let what = format!("the track has no factor `{}`: it sets `gear`, `engine_speed` and `load`", factor.name);
            faults.push(plan.fault_of_header(what));
        }
        if !faults.is_clean() {
            return faults.finish(None);
        }
        let mut runs = Vec::new();
        for (row, run) in plan.runs.iter().enumerate() {
            let (gear, engine_speed, load) = (gears[row], speeds[row], loads[row]);
            if !(1..=GEARS).any(|known| known as f64 == gear) {
                faults.push(plan.fault(row, format!("`gear`: found {gear}, expected 1, 2, 3, 4 or 5")));
                continue;
            }
            if engine_speed <= 0.0 {
                let found = engine_speed / RPM;
                faults.push(plan.fault(row, format!("`engine_speed`: found {found:.0} rpm, expected more than 0")));
            }
            if load < 0.0 {
                faults.push(plan.fault(row, format!("`load`: found {load} kg, expected at least 0")));
            }
            runs.push(TipIn { run: *run, gear: gear as usize, engine_speed, load });
        }
        faults.finish(Some(TrackPlan { runs }))
    }

    /// The plan as a file.
    #[must_use]
    pub fn csv(&self) -> String {
        let mut text = "run[1],gear[1],engine_speed[rpm],load[kg]\n".to_string();
        for run in &self.runs {
            // Plans are made in whole rpm.
            let _ = writeln!(text, "{},{},{:.0},{}", run.run, run.gear, run.engine_speed / RPM, run.load);
        }
        text
    }
}

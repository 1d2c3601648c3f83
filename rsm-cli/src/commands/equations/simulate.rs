//! `rsm simulate` of a plant of equations.
//!
//! In: a plant, a record, the method of integration. Out: a CSV of time, inputs and outputs, complete or not written at all.

use std::path::Path;

use rsm_core::number::decimal;
use rsm_core::source::Source;
use rsm_sim::equations::signals::{Failed, spelled};
use rsm_sim::equations::{Machine, Method, Setting, Signals, Stopped, fixed};
use serde_json::{Map, Value, json};

use super::file;
use crate::outcome::{Answer, Outcome, Refusal};
use crate::output;

/// The method of integration as given on the command line.
pub struct Options<'a> {
    pub method: Option<&'a str>,
    pub tolerance: Option<f64>,
    pub fixed_step: Option<f64>,
    /// A folder of further effects.
    pub effects: Option<&'a Path>,
}

impl Options<'_> {
    /// The setting of the integrator for rows of this period.
    pub fn setting(&self, period: f64) -> Result<Setting, Refusal> {
        let mut setting = Setting::default();
        if let Some(tolerance) = self.tolerance {
            // Below about 1e-14 rounding dominates the error of a step; a tolerance above 0.1 is too large to bound the error.
            if !(1e-14..=0.1).contains(&tolerance) {
                return Err(Refusal::new(format!("--tolerance: found {tolerance}, expected 1e-14 to 0.1")));
            }
            setting.tolerance = tolerance;
        }
        setting.method = match (self.method, self.fixed_step) {
            (_, Some(step)) if fixed::steps(step, period).is_some() => Method::Fixed { step },
            (_, Some(step)) => {
                return Err(Refusal::new(format!(
                    "--fixed-step: found {step} s, expected the period of the record, {period} s, or this period divided by a whole number"
                )));
            }
            (Some("explicit"), None) => Method::Explicit,
            (Some("stiff"), None) => Method::Stiff,
            _ => Method::Automatic,
        };
        Ok(setting)
    }
}

/// Runs the subcommand.
pub fn run(path: &Path, record: &Path, out: &Path, options: &Options<'_>, as_json: bool) -> Outcome {
    let table = Source::read(record)?;
    let file = file(path, Some(&table), options.effects)?.of_record(&table)?;
    let mut machine = Machine::new(&file)?;
    let signals = Signals::read(&table, &file, &machine)?;
    let setting = options.setting(signals.period)?;
    let found = signals.simulate(&file, &mut machine, setting).map_err(|failed| match failed {
        Failed::Start(faults) => faults.into(),
        Failed::Run(Stopped::Step(what)) => Refusal::new(format!("--fixed-step: {what}")),
        Failed::Run(stopped) => Refusal::new(format!("{}: {stopped}", record.display())),
    })?;
    let (inputs, outputs) = (machine.inputs(), machine.outputs());
    let named =
        |(name, unit): &(String, String)| if unit.is_empty() { name.clone() } else { format!("{name}[{}]", spelled(unit)) };
    let header: Vec<String> = std::iter::once("time[s]".to_string()).chain(inputs.iter().chain(&outputs).map(named)).collect();
    let mut text = header.join(",") + "\n";
    for row in 0..signals.time.len() {
        let cells = std::iter::once(signals.time[row]).chain(signals.inputs.iter().chain(&found).map(|it| it[row]));
        let cells: Vec<String> = cells.map(decimal).collect();
        text += &(cells.join(",") + "\n");
    }
    output::write_all(&[(out.to_path_buf(), text.as_bytes())])?;
    let name = &machine.system().flat().name;
    if as_json {
        let range = |values: &[f64]| {
            let (low, high) =
                values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), it| (low.min(*it), high.max(*it)));
            json!([output::finite(low), output::finite(high)])
        };
        let each = outputs.iter().zip(&found);
        let ranges: Map<String, Value> =
            each.map(|((name, unit), values)| (name.clone(), json!({ "unit": unit, "range": range(values) }))).collect();
        output::json(&json!({
            "plant": name,
            "rows": signals.time.len(),
            "period": signals.period,
            "effects": file.effects.iter().map(|it| it.kind.as_str()).collect::<Vec<_>>(),
            "outputs": ranges,
            "out": out.display().to_string(),
        }))?;
    } else {
        stderr_line!("{}: {} rows of {name}", out.display(), signals.time.len());
    }
    Ok(Answer::Positive)
}

//! Records of a plant of equations: inputs at every row, and known values of the start.
//!
//! In: a CSV or columns in memory, the plant file. Out: [`Signals`] in the units of the text, or every fault with its line. It never fills a gap and
//! never resamples.

use rsm_core::source::{Collector, Fault, Faults, Source};
use rsm_fit::table::{Table, Wanted};

use super::engine::Setting;
use super::file::{EquationFile, NamedValue};
use super::lanes;
use super::machine::Machine;
use super::rows::{Inputs, Stopped};
use crate::record;

/// A record of a plant of equations.
#[derive(Debug, Clone)]
pub struct Signals {
    /// The name of the record in messages.
    pub file: String,
    /// The instant of each row in s.
    pub time: Vec<f64>,
    /// The mean time between two rows in s.
    pub period: f64,
    /// For each input, in the order of the text: its value at every row.
    pub inputs: Vec<Vec<f64>>,
    /// For each output, in the order of the text: the measured values, if the record has them.
    pub measured: Vec<Option<Vec<f64>>>,
}

/// The reason why a simulation has no result.
#[derive(Debug, Clone)]
pub enum Failed {
    /// The start conditions cannot be satisfied.
    Start(Faults),
    /// The run ended before its last row.
    Run(Stopped),
}

/// The unit of a text in the spelling of other files: `N.m/s2` becomes `N*m/s^2`.
#[must_use]
pub fn spelled(unit: &str) -> String {
    let mut text = String::new();
    let mut last = ' ';
    for sign in unit.chars() {
        match sign {
            '.' => text.push('*'),
            '0'..='9' | '-' if last.is_alphabetic() => {
                text.push('^');
                text.push(sign);
            }
            _ => text.push(sign),
        }
        last = sign;
    }
    text.replace("Ohm", "ohm")
}

impl Signals {
    /// Reads a record: a column `time` in s, one column for every input, and outputs if there are any. Columns are converted to the units of the
    /// text.
    ///
    /// # Errors
    /// Every fault, with its line.
    pub fn read(source: &Source, file: &EquationFile, machine: &Machine) -> Result<Signals, Faults> {
        Self::read_as(&|wanted| Table::read(source, wanted), file, machine)
    }

    /// The same for columns in memory, in the units of the text.
    ///
    /// # Errors
    /// Every fault.
    pub fn in_memory(file: &EquationFile, machine: &Machine, columns: &[(&str, &[f64])]) -> Result<Signals, Faults> {
        Self::read_as(&|wanted| Table::in_memory("record in memory", columns, wanted), file, machine)
    }

    fn read_as(
        open: &dyn Fn(&Wanted) -> Result<Table, Faults>,
        file: &EquationFile,
        machine: &Machine,
    ) -> Result<Signals, Faults> {
        let header = open(&Wanted::default())?;
        let (inputs, outputs) = (machine.inputs(), machine.outputs());
        let has = |signal: &str| header.column(file.column(signal).0).is_some();
        let mut faults = Collector::new();
        let missing: Vec<String> = std::iter::once("time")
            .chain(inputs.iter().map(|it| it.0.as_str()))
            .filter(|it| !has(it) && !file.record_values.absent.iter().any(|name| name == it))
            .map(|it| format!("`{}`", file.column(it).0))
            .collect();
        if !missing.is_empty() {
            let names: Vec<String> = header.columns.iter().map(|it| format!("`{}`", it.name)).collect();
            let what = format!("the record has no column {}; its columns are {}", missing.join(", "), names.join(", "));
            let help = "[columns] in the plant file says under which name a record holds a signal";
            return Err(Faults::one(Fault::at_line(&header.file, header.header_line, 0, what).help(help)));
        }
        let present: Vec<&(String, String)> = outputs.iter().filter(|it| has(&it.0)).collect();
        let given = inputs.iter().filter(|it| has(&it.0));
        let all = std::iter::once("time").chain(given.chain(present).map(|it| it.0.as_str()));
        let numbers = all.map(|it| file.column(it).0.to_string()).collect();
        let table = open(&Wanted { numbers, ..Wanted::default() })?;
        let mut take = |signal: &str, unit: &str| {
            values(&table, file, signal, unit).unwrap_or_else(|fault| {
                faults.push(fault);
                Vec::new()
            })
        };
        let time = take("time", "s");
        // An optional input that the record does not have is 0.
        let values: Vec<Vec<f64>> =
            inputs.iter().map(|(name, unit)| if has(name) { take(name, unit) } else { vec![0.0; time.len()] }).collect();
        let measured = outputs.iter().map(|(name, unit)| has(name).then(|| take(name, unit))).collect();
        let (period, _) = record::uniform(&time, &table, false, &mut faults);
        faults.finish(Some(Signals { file: table.file.clone(), time, period, inputs: values, measured }))
    }

    /// The known values of the start. First: the values of `[initial]`, except those of outputs that determine the start. Second: for each output
    /// that determines the start, the most direct first, its value in `[initial]`, or else its first reading, unless `[initial]` gives the variable
    /// itself.
    #[must_use]
    pub fn start(&self, file: &EquationFile, machine: &Machine) -> (Vec<NamedValue>, Vec<NamedValue>) {
        self.start_from(&file.initial, machine)
    }

    /// The same with other values of `[initial]`.
    #[must_use]
    pub fn start_from(&self, initial: &[NamedValue], machine: &Machine) -> (Vec<NamedValue>, Vec<NamedValue>) {
        let outputs = machine.outputs();
        let mut given: Vec<NamedValue> = initial.to_vec();
        let mut recorded: Vec<NamedValue> = Vec::new();
        for (output, name) in machine.starting() {
            let own = initial.iter().find(|it| it.name == outputs[*output].0).map(|it| it.value);
            let first = self.measured.get(*output).and_then(Option::as_ref).and_then(|it| it.first().copied());
            given.retain(|it| it.name != outputs[*output].0);
            let Some(value) = own.or(first) else { continue };
            if !initial.iter().any(|it| it.name == *name || (own.is_none() && machine.is_same(&it.name, name))) {
                recorded.push(NamedValue { name: name.clone(), value });
            } else if own.is_some() {
                given.push(NamedValue { name: name.clone(), value });
            }
        }
        (given, recorded)
    }

    /// Runs a plant along the record. Returns for each output, in the order of the text, its value at every row.
    ///
    /// # Errors
    /// A start that is not possible; the reason why the run ended early.
    ///
    /// ```
    /// use rsm_core::source::{Faults, Source};
    /// use rsm_sim::equations::{EquationFile, Machine, Setting, Signals};
    ///
    /// let text = "model Cart\n  parameter Real mass(unit = \"kg\") = 2;\n  input Real force(unit = \"N\");\n  Real speed(unit = \"m/s\");\n  \
    ///             output Real position(unit = \"m\");\nequation\n  mass*der(speed) = force;\n  der(position) = speed;\nend Cart;\n";
    /// let open = |name: &str| Ok::<_, Faults>(Source::new(name, text));
    /// let plant = "format = 2\nmodel = \"cart.mo\"\n[parameters]\nmass = 4.0\n";
    /// let file = EquationFile::read(&Source::new("cart.toml", plant), &open)?;
    /// let mut machine = Machine::new(&file)?;
    ///
    /// let columns: [(&str, &[f64]); 2] = [("time", &[0.0, 0.5, 1.0]), ("force", &[8.0; 3])];
    /// let signals = Signals::in_memory(&file, &machine, &columns)?;
    /// let outputs = signals.simulate(&file, &mut machine, Setting::default()).unwrap();
    /// assert!((outputs[0][2] - 1.0).abs() < 1e-12); // 8 N on 4 kg, for 1 s
    /// # Ok::<(), Faults>(())
    /// ```
    pub fn simulate(&self, file: &EquationFile, machine: &mut Machine, setting: Setting) -> Result<Vec<Vec<f64>>, Failed> {
        let inputs = Inputs { time: &self.time, values: &self.inputs };
        let first: Vec<f64> = self.inputs.iter().map(|it| it[0]).collect();
        let (given, recorded) = self.start(file, machine);
        let start = machine.start_along(file, self.time[0], &first, &given, &recorded).map_err(Failed::Start)?;
        lanes::run(machine, start, inputs, setting).map_err(Failed::Run)
    }
}

/// The values of a signal in the unit of the text. If the text gives no unit, the numbers are used without conversion.
fn values(table: &Table, file: &EquationFile, signal: &str, unit: &str) -> Result<Vec<f64>, Fault> {
    let (name, stated) = file.column(signal);
    let column =
        table.column(name).ok_or_else(|| Fault::at_line(&table.file, table.header_line, 0, format!("no column `{name}`")))?;
    let has_unit = column.unit.is_some() || stated.is_some();
    if unit.is_empty() || !has_unit {
        return Ok(column.values.clone());
    }
    match (&column.unit, stated) {
        (None, Some(stated)) => {
            let at = |what: String| {
                Fault::at_line(&table.file, table.header_line, 0, format!("column {} `{name}`: {what}", column.place))
            };
            let way = rsm_fit::units::Conversion::between(stated, &spelled(unit)).map_err(at)?;
            Ok(column.values.iter().map(|it| way.apply(*it)).collect())
        }
        _ => Ok(table.values_in(name, Some(&spelled(unit)))?.0),
    }
}

#[cfg(test)]
mod tests {
    use super::spelled;

    #[test]
    fn units_of_a_text_are_written_as_units_are_elsewhere() {
        let all = ["N.m/s2", "rad/s", "1", "Ohm", "V.s/rad", "m2.kg", "s-1", "kg/(s2.m)"].map(spelled);
        assert_eq!(all, ["N*m/s^2", "rad/s", "1", "ohm", "V*s/rad", "m^2*kg", "s^-1", "kg/(s^2*m)"]);
    }
}

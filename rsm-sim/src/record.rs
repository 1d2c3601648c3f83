//! Records (docs/book/src/reference/plants.md 1.2): reads a CSV for a plant, and writes one.
//!
//! In: a CSV, and the plant file with the names of its columns. Out: a [`Record`] in the units of the code, uniformly sampled; or every fault with
//! its line. It never fills a gap and never resamples.

use rsm_core::order;
use std::borrow::Cow;

use rsm_core::number::decimal;
use rsm_core::source::{Collector, Fault, Faults, Source};
use rsm_fit::table::{Table, Wanted};

pub use crate::kind::Drive;
use crate::kind::{Decision, Described, PlantKind, Signal};
use crate::plant_file::PlantFile;

/// Jitter above this share of the period is a fault (docs/book/src/reference/plants.md 1.2).
const JITTER: f64 = 0.01;

/// A uniformly sampled record.
#[derive(Debug, Clone)]
pub struct Record {
    /// The name of the record in messages.
    pub file: String,
    /// What drives the plant.
    pub drive: Drive,
    /// Instants, in s.
    pub time: Vec<f64>,
    /// The sample period, in s.
    pub period: f64,
    /// The inputs of the equations that simulate the record, in the order of the text.
    pub inputs: Vec<Vec<f64>>,
    /// The first values of columns with start variables that are no outputs.
    pub starts: Vec<(&'static str, f64)>,
    /// The outputs in the order of the plant, if the record has them.
    pub measured: Vec<Option<Vec<f64>>>,
    /// Parameters of a plant of equations that the record determines.
    pub settings: Vec<(&'static str, f64)>,
    /// The index of the configuration of the plant file to which the record belongs.
    pub configuration: Option<usize>,
    /// Rows (from 0) before which time is missing or goes back. A record from [`Record::read`] has none.
    pub breaks: Vec<usize>,
}

impl Record {
    /// Reads a record of a plant.
    ///
    /// # Errors
    /// Every fault, with its line.
    pub fn read(source: &Source, plant: &PlantFile) -> Result<Record, Faults> {
        Self::read_as(&|wanted| Table::read(source, wanted), plant, false)
    }

    /// A record from columns in memory. Each column has the name that a record of this plant gives the signal, and its values in the units of the
    /// simulation (docs/book/src/reference/plants.md). All columns have the same length.
    ///
    /// # Errors
    /// Every fault: a missing column, columns of different lengths, a number that is not finite, a time that is not uniform.
    ///
    /// ```
    /// use rsm_core::source::Source;
    /// use rsm_sim::{plant_file::PlantFile, record::Record, simulate::Simulator};
    ///
    /// let axis = "format = 1\nplant = \"servo-axis\"\n[parameters]\nmass = 2.0\nforce_gain = 4.0\n\
    ///             viscous_friction = 0.0\ncommand_limit = 10.0\n";
    /// let plant = PlantFile::read(&Source::new("axis.toml", axis))?;
    /// // The plant starts where the first reading of the position says.
    /// let columns: [(&str, &[f64]); 3] = [("time", &[0.0, 0.5, 1.0]), ("command", &[1.0; 3]), ("position", &[0.0; 3])];
    /// let record = Record::in_memory(&plant, &columns)?;
    /// let outputs = Simulator::new(&plant, &record)?.run(&record)?;
    /// assert!((outputs.of("position").unwrap()[2] - 1.0).abs() < 1e-12); // 4 N on 2 kg, for 1 s
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn in_memory(plant: &PlantFile, columns: &[(&str, &[f64])]) -> Result<Record, Faults> {
        Self::in_memory_as("record in memory", plant, columns)
    }

    /// The same with a name, from which the configuration follows if the plant file has `[configurations]`.
    ///
    /// # Errors
    /// Those of [`Record::in_memory`]; a name of no configuration, or of two.
    pub fn in_memory_as(name: &str, plant: &PlantFile, columns: &[(&str, &[f64])]) -> Result<Record, Faults> {
        let open = |wanted: &Wanted| {
            let mut table = Table::in_memory(name, columns, wanted)?;
            for signal in plant.kind.columns() {
                let name = name_of(plant, signal.name);
                let column = table.columns.iter_mut().find(|column| column.name == name);
                column.into_iter().for_each(|column| column.unit = Some(signal.unit.to_string()));
            }
            Ok(table)
        };
        Self::read_as(&open, plant, false)
    }

    /// Reads a record that may have gaps, for example of a logger that stopped for a while. The field `breaks` contains their rows. A simulation must
    /// not cross a break.
    ///
    /// # Errors
    /// Every other fault, with its line.
    pub fn read_with_gaps(source: &Source, plant: &PlantFile) -> Result<Record, Faults> {
        Self::read_as(&|wanted| Table::read(source, wanted), plant, true)
    }

    /// `open` returns the wanted columns.
    fn read_as(open: &dyn Fn(&Wanted) -> Result<Table, Faults>, plant: &PlantFile, gaps: bool) -> Result<Record, Faults> {
        let header = open(&Wanted::default())?;
        let columns = Columns { plant, header: &header };
        let mut faults = Collector::new();
        let drive = columns.drive(&mut faults);
        let signals: Vec<Signal> = plant.kind.columns().into_iter().filter(|signal| columns.has(signal.name)).collect();
        let wanted = signals.iter().map(|signal| columns.name(signal.name).to_string()).collect();
        let table = match open(&Wanted { numbers: wanted, ..Wanted::default() }) {
            Ok(table) => table,
            Err(found) => {
                found.list().iter().for_each(|fault| faults.push(fault.clone()));
                return faults.finish(None);
            }
        };
        let mut values: Vec<(&'static str, Vec<f64>)> = Vec::new();
        for signal in &signals {
            match columns.values(&table, signal) {
                Ok(column) => values.push((signal.name, column)),
                Err(fault) => faults.push(fault),
            }
        }
        if !faults.is_clean() {
            return faults.finish(None);
        }
        let take = |name: &str| values.iter().find(|(found, _)| *found == name).map(|(_, column)| column.clone());
        let time = take("time").unwrap_or_default();
        let (period, breaks) = uniform(&time, &table, gaps, &mut faults);
        let settings = columns.settings(plant.kind.0, &table, &take, &mut faults);
        let configuration = plant.kind.configurations.of_record(&table.file).unwrap_or_else(|fault| {
            faults.push(fault);
            None
        });
        // An optional input that a record of a plant of equations does not have is 0.
        let left_out = if drive == Drive::Inputs { vec![0.0; time.len()] } else { Vec::new() };
        let record = Record {
            settings,
            configuration,
            file: table.file.clone(),
            drive,
            period,
            inputs: inputs(plant.kind, drive)
                .iter()
                .map(|signal| take(signal.name).unwrap_or_else(|| left_out.clone()))
                .collect(),
            starts: columns.starts(&take),
            measured: plant.kind.outputs().iter().map(|signal| take(signal.name)).collect(),
            time,
            breaks,
        };
        faults.finish(Some(record))
    }

    /// The time of its first row, in s; 0 without rows (a drive that generates its own inputs).
    #[must_use]
    pub fn first_time(&self) -> f64 {
        self.time.first().copied().unwrap_or(0.0)
    }

    /// The name of its configuration, for the kind of its plant file.
    #[must_use]
    pub fn configuration_name(&self, kind: PlantKind) -> Option<&'static str> {
        kind.0.configurations.list.get(self.configuration?).map(|it| it.name.as_str())
    }

    /// The number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.time.len()
    }

    /// The value of a parameter that the record determines.
    #[must_use]
    pub fn setting(&self, parameter: &str) -> Option<f64> {
        self.settings.iter().find(|it| it.0 == parameter).map(|it| it.1)
    }

    /// The columns of a record in a file, except those of outputs: time, the inputs that it has, and parameters that a column determines.
    #[must_use]
    pub fn given(&self, kind: PlantKind) -> Vec<(Signal, Cow<'_, [f64]>)> {
        let absent = self.absent(kind);
        let mut columns = vec![(Signal { name: "time", unit: "s" }, Cow::Borrowed(&*self.time))];
        let inputs = inputs(kind, self.drive).iter().zip(&self.inputs).filter(|it| !absent.contains(&it.0.name));
        columns.extend(inputs.map(|(signal, values)| (*signal, Cow::Borrowed(&**values))));
        let given = |it: &Decision| Some((it.column?, self.setting(it.parameter)?));
        let decides = kind.decisions.iter().filter_map(given);
        columns.extend(decides.map(|(name, value)| (Signal { name, unit: "1" }, Cow::Owned(vec![value; self.rows()]))));
        columns
    }

    /// The start of a variable that is no output, if a column gives it.
    #[must_use]
    pub fn start(&self, name: &str) -> Option<f64> {
        self.starts.iter().find(|it| it.0 == name).map(|it| it.1)
    }

    /// The columns of a plant of equations that are absent, where this absence determines a parameter.
    #[must_use]
    pub fn absent(&self, kind: PlantKind) -> Vec<&'static str> {
        let is_absent = |it: &&Decision| self.settings.iter().any(|(name, value)| *name == it.parameter && *value == 1.0);
        kind.decisions.iter().filter(is_absent).flat_map(|it| it.without.iter().copied()).collect()
    }

    /// Some of its rows as a separate record. Start values of variables that are no outputs are kept only if the first row is.
    #[must_use]
    pub fn piece(&self, rows: std::ops::Range<usize>) -> Record {
        let cut = |values: &Vec<f64>| values[rows.start.min(values.len())..rows.end.min(values.len())].to_vec();
        Record {
            file: self.file.clone(),
            drive: self.drive,
            time: cut(&self.time),
            period: self.period,
            inputs: self.inputs.iter().map(cut).collect(),
            settings: self.settings.clone(),
            configuration: self.configuration,
            starts: if rows.start == 0 { self.starts.clone() } else { Vec::new() },
            measured: self.measured.iter().map(|values| values.as_ref().map(cut)).collect(),
            breaks: self
                .breaks
                .iter()
                .filter(|row| rows.start < **row && **row < rows.end)
                .map(|row| row - rows.start)
                .collect(),
        }
    }
}

/// The columns of inputs that a simulation reads, in order.
#[must_use]
pub fn inputs(kind: PlantKind, drive: Drive) -> &'static [Signal] {
    kind.driven_by(drive).inputs()
}

/// The name of a signal in the records of a plant.
fn name_of<'n>(plant: &'n PlantFile, signal: &'n str) -> &'n str {
    let renamed = plant.columns.iter().find(|renamed| renamed.signal == signal);
    renamed.map_or(signal, |renamed| renamed.column.as_str())
}

struct Columns<'a> {
    plant: &'a PlantFile,
    header: &'a Table,
}

impl Columns<'_> {
    /// Optional inputs of a plant of equations, if the record has none of their group.
    fn absent(&self, plant: &Described) -> Vec<&'static str> {
        let lists = plant.decisions.iter().map(|it| &it.without);
        lists.filter(|list| list.iter().all(|name| !self.has(name))).flatten().copied().collect()
    }

    /// The first values of start variables that are no outputs.
    fn starts(&self, take: &dyn Fn(&str) -> Option<Vec<f64>>) -> Vec<(&'static str, f64)> {
        let first = |it: &Signal| Some((it.name, take(it.name)?.first().copied()?));
        self.plant.kind.start_columns().iter().filter_map(first).collect()
    }

    /// The parameters of a plant of equations that the record determines.
    fn settings(
        &self,
        plant: &Described,
        table: &Table,
        take: &dyn Fn(&str) -> Option<Vec<f64>>,
        faults: &mut Collector,
    ) -> Vec<(&'static str, f64)> {
        let mut settings = Vec::new();
        for decision in &plant.decisions {
            let Some(column) = decision.column else {
                let is_absent = decision.without.iter().all(|name| !self.has(name));
                settings.push((decision.parameter, f64::from(u8::from(is_absent))));
                continue;
            };
            let Some(values) = take(column) else { continue };
            let Some(first) = values.first().copied() else { continue };
            if !decision.holds(first) {
                let what = format!("`{}`: found {first}, expected {}", self.name(column), decision.words());
                faults.push(Fault::at_line(&table.file, table.lines[0], 0, what));
            }
            if let Some(row) = values.iter().position(|it| *it != first) {
                let name = self.name(column);
                let what = format!("`{name}`: found {} in row {}, it began with {first}", values[row], row + 1);
                let help = format!(
                    "it sets the parameter `{}`, which is one number a record: cut the record there",
                    decision.parameter
                );
                faults.push(Fault::at_line(&table.file, table.lines[row], 0, what).help(help));
            }
            settings.push((decision.parameter, first));
        }
        settings
    }

    /// The name of a signal in this record.
    fn name<'n>(&'n self, signal: &'n str) -> &'n str {
        name_of(self.plant, signal)
    }

    fn has(&self, signal: &str) -> bool {
        self.header.column(self.name(signal)).is_some()
    }

    /// What drives the plant. Reports the columns that are missing for it.
    fn drive(&self, faults: &mut Collector) -> Drive {
        let kind = self.plant.kind;
        let mut needed: Vec<&str> = vec!["time"];
        let has_gains = || self.plant.parameters.values.iter().all(Option::is_some);
        let drive = match kind.open_loop {
            Some(_) if has_gains() && kind.inputs().iter().all(|it| self.has(it.name)) => Drive::Closed,
            Some(_) => Drive::Open,
            None => Drive::Inputs,
        };
        let plant = kind.driven_by(drive).0;
        let absent = self.absent(plant);
        needed.extend(plant.inputs.iter().map(|it| it.name).filter(|it| !absent.contains(it)));
        // In format 1 nothing else determines such a parameter.
        needed.extend(plant.decisions.iter().filter(|_| plant.is_first_format).filter_map(|it| it.column));
        for signal in needed {
            if !self.has(signal) {
                let unit = kind.columns().iter().find(|found| found.name == signal).map_or("", |found| found.unit);
                let what = format!("there is no column `{}`", self.name(signal));
                let names: Vec<&str> = self.header.columns.iter().map(|column| column.name.as_str()).collect();
                let help = format!(
                    "a record of \"{}\" has `{signal}[{unit}]`, or its name under [columns] of the plant file; the columns are {}",
                    kind.name(),
                    names.join(", ")
                );
                faults.push(Fault::at_line(&self.header.file, self.header.header_line, 0, what).help(help));
            }
        }
        drive
    }

    /// The values of a signal in its unit.
    fn values(&self, table: &Table, signal: &Signal) -> Result<Vec<f64>, Fault> {
        let name = self.name(signal.name);
        let renamed = self.plant.columns.iter().find(|renamed| renamed.signal == signal.name);
        let in_header = table.column(name).and_then(|column| column.unit.as_deref());
        let stated = renamed.and_then(|renamed| renamed.unit.as_deref());
        let takes_any = !self.plant.kind.is_first_format;
        match (in_header, stated) {
            // If the text or the record of a plant of equations gives no unit, the numbers are used without conversion.
            (in_header, stated) if takes_any && (signal.unit.is_empty() || in_header.or(stated).is_none()) => {
                Ok(table.column(name).map(|it| it.values.clone()).unwrap_or_default())
            }
            (Some(_), _) => Ok(table.values_in(name, Some(signal.unit))?.0),
            (None, Some(stated)) => {
                let conversion = rsm_fit::units::Conversion::between(stated, signal.unit)
                    .map_err(|why| Fault::at_line(&table.file, table.header_line, 0, why))?;
                Ok(table.values_in(name, Some(stated))?.0.iter().map(|value| conversion.apply(*value)).collect())
            }
            (None, None) => {
                let what = format!("the column `{name}` has no unit");
                let help =
                    format!("write `{name}[{}]` in the header, or `unit` under [columns] of the plant file", signal.unit);
                Err(Fault::at_line(&table.file, table.header_line, 0, what).help(help))
            }
        }
    }
}

/// The period of instants that must be uniform, and the rows after gaps. If gaps are not allowed, the first one is a fault.
pub(crate) fn uniform(time: &[f64], table: &Table, gaps: bool, faults: &mut Collector) -> (f64, Vec<usize>) {
    if time.len() < 2 {
        let what = "a record needs two rows at least: one has no period";
        faults.push(Fault::at_line(&table.file, table.lines.first().copied().unwrap_or(0), 0, what));
        return (0.0, Vec::new());
    }
    let mut steps: Vec<f64> = time.windows(2).map(|pair| pair[1] - pair[0]).collect();
    order::sort(&mut steps);
    // The median: one gap or one step back does not change it.
    let period = steps[steps.len() / 2];
    let mut breaks = Vec::new();
    let mut lasted = 0.0;
    for (k, pair) in time.windows(2).enumerate() {
        let step = pair[1] - pair[0];
        let what = if step <= 0.0 {
            format!("time goes back from {} s to {} s", pair[0], pair[1])
        } else if step > 1.5 * period {
            format!("a gap: time goes from {} s to {} s, the period is {period} s", pair[0], pair[1])
        } else if (step - period).abs() > JITTER * period {
            let what = format!("jitter: {step} s after the row before, the period is {period} s, 1 % is accepted");
            let help = "`rsm import` puts it on a steady clock by a stated rule";
            faults.push(Fault::at_line(&table.file, table.lines[k + 1], 0, what).help(help));
            return (period, breaks);
        } else {
            lasted += step;
            continue;
        };
        if !gaps {
            faults.push(Fault::at_line(&table.file, table.lines[k + 1], 0, what));
            return (period, breaks);
        }
        breaks.push(k + 1);
    }
    // The mean over the whole record, because the decimals of single instants are rounded.
    let period = if breaks.is_empty() {
        (time[time.len() - 1] - time[0]) / (time.len() - 1) as f64
    } else {
        lasted / (time.len() - 1 - breaks.len()) as f64
    };
    (period, breaks)
}

/// A CSV of columns of equal length. Its decimals are read back to the same bits.
#[must_use]
pub fn csv(columns: &[(Signal, &[f64])]) -> String {
    let header: Vec<String> = columns.iter().map(|(signal, _)| format!("{}[{}]", signal.name, signal.unit)).collect();
    let mut text = header.join(",") + "\n";
    let rows = columns.iter().map(|(_, values)| values.len()).min().unwrap_or(0);
    for row in 0..rows {
        for (k, (_, values)) in columns.iter().enumerate() {
            if k > 0 {
                text.push(',');
            }
            text.push_str(&decimal(values[row]));
        }
        text.push('\n');
    }
    text
}

//! Records: the rows of the data files in the units of the model.
//!
//! In: a specification and the names of some of its files. Out: [`Records`] (one list for each variable, all of the same length) with the name, hash
//! and rows of each file, or every fault of every file. If the specification gives no unit, that of the first file with a unit is used. A missing
//! number is NaN, if the specification permits that. Never drops a row while it reads.

use rsm_core::order;
use rsm_core::source::{Collector, Fault, Faults};

use crate::content::Content;
use crate::missing::{self, Missing};
use crate::spec::{Specification, Weights};
use crate::table::{Column, MissingAs, Table, Wanted, is_run};

pub use crate::hash::hash;

/// Every file's faults, in the order in which the files are named. Never empty.
#[derive(Debug, Clone, PartialEq)]
pub struct Refused(pub Vec<Faults>);

impl std::fmt::Display for Refused {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let lines: Vec<String> = self.0.iter().map(ToString::to_string).collect();
        write!(f, "{}", lines.join("\n"))
    }
}

impl std::error::Error for Refused {}

impl From<Faults> for Refused {
    fn from(faults: Faults) -> Self {
        Refused(vec![faults])
    }
}

impl From<Refused> for Faults {
    /// All faults in one list.
    fn from(refused: Refused) -> Self {
        let mut all = Collector::new();
        refused.0.iter().flat_map(Faults::list).for_each(|fault| all.push(fault.clone()));
        all.finish::<()>(None).expect_err("what was refused has a fault")
    }
}

/// A data file, for the evidence.
#[derive(Debug, Clone, PartialEq)]
pub struct DataFile {
    /// The name in the specification.
    pub name: String,
    /// SHA-256 of its bytes, in hexadecimal.
    pub sha256: String,
    /// The number of its rows.
    pub rows: usize,
}

/// The units of a fit: of the inputs, then of the responses, from the specification or from the first file with a unit.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Units(Vec<Option<String>>);

impl Units {
    /// The units in the specification.
    #[must_use]
    pub fn of(specification: &Specification) -> Self {
        let inputs = specification.inputs.iter().map(|input| input.unit.clone());
        Units(inputs.chain(specification.responses.iter().map(|response| response.unit.clone())).collect())
    }

    /// Units that are known: of the inputs, then of the responses.
    pub(crate) fn known(units: Vec<String>) -> Self {
        Units(units.into_iter().map(Some).collect())
    }

    /// The unit of a variable: inputs first, then responses.
    #[must_use]
    pub fn get(&self, variable: usize) -> &str {
        self.0[variable].as_deref().unwrap_or_default()
    }
}

/// The use of rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rows {
    /// Rows to fit, with their weights.
    ToFit,
    /// Rows for evaluation; all count equally.
    Unseen,
}

/// Rows in the units of the model.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Records {
    /// Their files.
    pub files: Vec<DataFile>,
    /// The values of every input, in natural units; NaN where one is missing.
    pub inputs: Vec<Vec<f64>>,
    /// The values of every response.
    pub responses: Vec<Vec<f64>>,
    /// For every response the weights of its rows, proportional to 1/sigma^2; empty if all count equally, and for rows that are not fitted.
    pub weights: Vec<Vec<f64>>,
    /// The cells of every column that keeps rows together ([`Specification::labels`]).
    pub labels: Vec<Vec<String>>,
    /// The place of each row in run order; empty if no column gives it for every row.
    pub order: Vec<f64>,
    /// The number of each row among those that were read, from 0; empty if no row was left out.
    pub numbers: Vec<usize>,
    /// Rows that were left out because no response can use them: their places in run order if it is known, else their numbers.
    pub left_out: Vec<f64>,
    /// The number of the series of each row; empty if no response has autoregressive noise.
    pub series: Vec<usize>,
}

impl Records {
    /// Reads some of the files of a specification. `open` returns the content of the file with a name.
    ///
    /// # Errors
    /// Every fault of every file.
    pub fn read(
        specification: &Specification,
        files: &[String],
        rows: Rows,
        units: &mut Units,
        open: &mut dyn FnMut(&str) -> Result<Content, Faults>,
    ) -> Result<Self, Refused> {
        let wanted = Self::wanted(specification, rows);
        let mut records = Self::without_rows(specification, &wanted);
        let mut refused = Vec::new();
        let mut runs: Vec<String> = Vec::new();
        for name in files {
            let read = open(name).and_then(|content| content.table_and_sha256(&wanted));
            let read = read.and_then(|(table, sha256)| {
                let count = records.add(specification, &table, rows, units)?;
                let of_run = |column: &&Column| is_run(&column.name) && column.labels.len() == table.rows();
                runs.extend(table.columns.iter().find(of_run).into_iter().flat_map(|column| column.labels.iter().cloned()));
                Ok(DataFile { name: name.clone(), sha256, rows: count })
            });
            match read {
                Ok(file) => records.files.push(file),
                Err(faults) => refused.push(faults),
            }
        }
        records.order = in_order(&runs, records.rows(), specification.missing);
        if refused.is_empty() { Ok(records) } else { Err(Refused(refused)) }
    }

    /// The columns that some rows need.
    pub(crate) fn wanted(specification: &Specification, rows: Rows) -> Wanted {
        let mut wanted = wanted(specification, rows);
        let weights = weights_of(specification, rows);
        wanted.numbers.extend(weights.iter().flatten().map(|weights| weights.column().to_string()));
        wanted
    }

    pub(crate) fn without_rows(specification: &Specification, wanted: &Wanted) -> Self {
        Records {
            inputs: vec![Vec::new(); specification.inputs.len()],
            responses: vec![Vec::new(); specification.responses.len()],
            labels: vec![Vec::new(); wanted.labels.len()],
            weights: vec![Vec::new(); specification.responses.len()],
            ..Records::default()
        }
    }

    /// Adds the rows of a table with the wanted columns. Returns their number.
    pub(crate) fn add(
        &mut self,
        specification: &Specification,
        table: &Table,
        rows: Rows,
        units: &mut Units,
    ) -> Result<usize, Faults> {
        let wanted = wanted(specification, rows);
        let count = self.append(table, &wanted.numbers, &wanted.labels, units)?;
        self.append_weights(table, &weights_of(specification, rows))?;
        Ok(count)
    }

    /// Weights are read without units, because only their ratios matter.
    fn append_weights(&mut self, table: &Table, weights: &[Option<Weights>]) -> Result<(), Faults> {
        let mut faults = Collector::new();
        for (target, weights) in self.weights.iter_mut().zip(weights) {
            let Some(weights) = weights else { continue };
            let column = table.column(weights.column()).expect("a wanted column is in the table");
            for (value, line) in column.values.iter().zip(&table.lines) {
                let weight = match weights {
                    Weights::Weight(_) => *value,
                    Weights::StandardError(_) => 1.0 / (value * value),
                };
                if *value <= 0.0 || !(weight.is_normal() || value.is_nan()) {
                    let what = format!("column {} `{}`: found {value}, expected a number above 0", column.place, column.name);
                    let fault = Fault::at_line(&table.file, *line, 0, what);
                    faults.push(fault.help("remove the row from the file if it must not count"));
                }
                target.push(weight);
            }
        }
        faults.finish(Some(()))
    }

    fn append(&mut self, table: &Table, numbers: &[String], labels: &[String], units: &mut Units) -> Result<usize, Faults> {
        let mut faults = Collector::new();
        let mut told: Vec<Fault> = Vec::new();
        let inputs = self.inputs.len();
        let targets = self.inputs.iter_mut().chain(&mut self.responses);
        for (k, ((target, name), unit)) in targets.zip(numbers).zip(&mut units.0).enumerate() {
            let read =
                if k < inputs { table.values_in(name, unit.as_deref()) } else { table.response_in(name, unit.as_deref()) };
            match read {
                Ok((values, found)) => {
                    if target.is_empty() {
                        *target = values;
                    } else {
                        target.extend(values);
                    }
                    *unit = Some(found);
                }
                // A fault in a column that is used for two variables is reported once.
                Err(fault) if told.contains(&fault) => {}
                Err(fault) => {
                    told.push(fault.clone());
                    faults.push(fault);
                }
            }
        }
        for (target, name) in self.labels.iter_mut().zip(labels) {
            target.extend(table.column(name).into_iter().flat_map(|column| column.labels.iter().cloned()));
        }
        faults.finish(Some(table.rows()))
    }

    /// The number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.responses.first().map_or(0, Vec::len)
    }

    /// Some of the rows.
    #[must_use]
    pub fn select(&self, rows: &[usize]) -> Self {
        let of = |columns: &[Vec<f64>]| columns.iter().map(|column| rows.iter().map(|row| column[*row]).collect()).collect();
        let weights = |column: &Vec<f64>| rows.iter().filter_map(|row| column.get(*row).copied()).collect();
        Records {
            files: self.files.clone(),
            inputs: of(&self.inputs),
            responses: of(&self.responses),
            weights: self.weights.iter().map(weights).collect(),
            labels: self.labels.iter().map(|column| rows.iter().map(|row| column[*row].clone()).collect()).collect(),
            order: rows.iter().filter_map(|row| self.order.get(*row).copied()).collect(),
            numbers: rows.iter().filter_map(|row| self.numbers.get(*row).copied()).collect(),
            left_out: self.left_out.clone(),
            series: rows.iter().filter_map(|row| self.series.get(*row).copied()).collect(),
        }
    }

    /// The rows with a number for a response, its weight and its inputs.
    #[must_use]
    pub fn complete(&self, inputs: &[usize], response: usize) -> Vec<usize> {
        let columns = inputs.iter().map(|input| &self.inputs[*input]);
        let weights = self.weights.get(response).filter(|weights| !weights.is_empty());
        let columns: Vec<&Vec<f64>> = columns.chain([&self.responses[response]]).chain(weights).collect();
        // Most files lack no number. This fold looks at many numbers at once.
        let has_nan = |column: &&Vec<f64>| column.iter().fold(false, |has, value| has | value.is_nan());
        if !columns.iter().any(has_nan) {
            return (0..self.rows()).collect();
        }
        (0..self.rows()).filter(|row| columns.iter().all(|column| !column[*row].is_nan())).collect()
    }

    /// The place of a row in run order if it is known, else its number.
    pub(crate) fn place(&self, row: usize) -> f64 {
        let number = || self.numbers.get(row).copied().unwrap_or(row) as f64;
        self.order.get(row).copied().unwrap_or_else(number)
    }

    /// Leaves all but some rows out, and keeps where they were. A run order counts if it is known of all rows that are kept.
    pub(crate) fn leave_out(&mut self, kept: &[usize]) {
        let rows = self.rows();
        if kept.len() < rows {
            let mut out = vec![true; rows];
            kept.iter().for_each(|row| out[*row] = false);
            self.numbers = (0..rows).collect();
            let all = self.clone();
            *self = all.select(kept);
            self.order = distinct(std::mem::take(&mut self.order), kept.len());
            let place = |row: usize| if self.order.is_empty() { row as f64 } else { all.order[row] };
            self.left_out = (0..rows).filter(|row| out[*row]).map(place).filter(|place| !place.is_nan()).collect();
        } else {
            self.order = distinct(std::mem::take(&mut self.order), rows);
        }
    }

    /// The number of rows that have an exact copy in the other records, in every input and every response.
    #[must_use]
    pub(crate) fn copies_of(&self, other: &Records) -> usize {
        let key = |records: &Records, row: usize| -> Vec<u64> {
            // + 0.0 makes both zeros equal.
            records.inputs.iter().chain(&records.responses).map(|column| (column[row] + 0.0).to_bits()).collect()
        };
        let known: std::collections::BTreeSet<Vec<u64>> = (0..other.rows()).map(|row| key(other, row)).collect();
        (0..self.rows()).filter(|row| known.contains(&key(self, *row))).count()
    }
}

/// The cells of the run column as numbers, if all are different; otherwise empty. If rows may be left out, this is decided without them
/// ([`Records::leave_out`]), and NaN is a run that is not known.
fn in_order(cells: &[String], rows: usize, missing: Missing) -> Vec<f64> {
    let number = |cell: &String| cell.parse().ok().filter(|run: &f64| run.is_finite()).unwrap_or(f64::NAN);
    let order: Vec<f64> = cells.iter().map(number).collect();
    match missing {
        Missing::Error => distinct(order, rows),
        Missing::DropRow if order.len() == rows => order,
        Missing::DropRow => Vec::new(),
    }
}

/// The places of rows in an order, if all are different; otherwise empty.
pub(crate) fn distinct(order: Vec<f64>, rows: usize) -> Vec<f64> {
    let mut sorted = order.clone();
    order::sort(&mut sorted);
    sorted.dedup();
    if sorted.len() == rows && order.len() == rows && !order.iter().any(|place| place.is_nan()) { order } else { Vec::new() }
}

/// The weights of each response for some rows.
fn weights_of(specification: &Specification, rows: Rows) -> Vec<Option<Weights>> {
    match rows {
        Rows::ToFit => specification.responses.iter().map(|response| response.weights.clone()).collect(),
        Rows::Unseen => vec![None; specification.responses.len()],
    }
}

fn wanted(specification: &Specification, rows: Rows) -> Wanted {
    let inputs = specification.inputs.iter().map(|input| input.column.clone());
    let numbers = inputs.chain(specification.responses.iter().map(|response| response.column.clone())).collect();
    let labels = match rows {
        Rows::ToFit => specification.labels(),
        Rows::Unseen => specification.groups(),
    };
    let labels = labels.into_iter().map(str::to_string).collect();
    let missing = match specification.missing {
        Missing::Error => MissingAs::Counted(missing::HELP),
        Missing::DropRow => MissingAs::Nan,
    };
    Wanted { numbers, labels, run: true, missing, categories: specification.categories.clone(), ..Wanted::default() }
}

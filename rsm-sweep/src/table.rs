//! Results as one table: one row for each task, in the order of the list.
//!
//! In: tasks with their results. Out: columns, and their CSV. A missing number (of a failed run) is an empty cell.

use serde_json::Value;

use crate::scenario::{Scenario, Simulations, Work};
use crate::tasks::{Task, TaskKind};

/// The results of a list.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// The columns, all of the same length.
    pub columns: Vec<Column>,
}

/// A column.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Its name.
    pub name: String,
    /// The unit of its numbers.
    pub unit: Option<String>,
    /// Its cells.
    pub cells: Cells,
}

/// The cells of a column.
#[derive(Debug, Clone, PartialEq)]
pub enum Cells {
    /// Integers.
    Whole(Vec<Option<u64>>),
    /// Numbers.
    Numbers(Vec<Option<f64>>),
    /// Texts.
    Texts(Vec<Option<String>>),
}

impl Column {
    /// The header: the name with the unit.
    #[must_use]
    pub fn header(&self) -> String {
        self.unit.as_ref().map_or(self.name.clone(), |unit| format!("{}[{unit}]", self.name))
    }
}

/// The column name of a figure.
pub(crate) fn figure(output: &str, statistic: &str) -> String {
    format!("{output}_{statistic}")
}

fn texts(name: &str, cells: impl Iterator<Item = Option<String>>) -> Column {
    Column { name: name.into(), unit: None, cells: Cells::Texts(cells.collect()) }
}

impl Table {
    /// The table of a list. A task without a result has empty cells.
    #[must_use]
    pub fn of(scenario: &Scenario, tasks: &[Task], results: &[Option<Value>]) -> Table {
        let run = (1..=tasks.len() as u64).map(Some).collect();
        let mut columns = vec![Column { name: "run".into(), unit: Some("1".into()), cells: Cells::Whole(run) }];
        let text = |key: &'static str| {
            let of = move |it: &Option<Value>| it.as_ref().and_then(|it| it[key].as_str()).map(String::from);
            texts(key, results.iter().map(of))
        };
        match &scenario.work {
            Work::Simulate(all) => {
                columns.extend([text("plant"), text("record")]);
                columns.extend(settings(all, tasks));
                columns.extend(figures(all, results));
            }
            Work::Diagnose(_) => {
                columns.extend([text("name"), text("plant")]);
                let verdict =
                    |it: &Option<Value>| it.as_ref().and_then(|it| it["diagnosis"]["verdict"].as_str()).map(String::from);
                columns.push(texts("verdict", results.iter().map(verdict)));
                columns.push(texts("causes", results.iter().map(|it| it.as_ref().and_then(causes))));
                let gain = |it: &Option<Value>| it.as_ref().and_then(|it| it["diagnosis"]["gain"].as_f64());
                columns.push(Column {
                    name: "gain".into(),
                    unit: Some("1".into()),
                    cells: Cells::Numbers(results.iter().map(gain).collect()),
                });
            }
        }
        columns.push(text("failed"));
        columns.push(texts("task", tasks.iter().map(|it| Some(it.hash.clone()))));
        Table { columns }
    }

    /// The column with this name.
    #[must_use]
    pub fn column(&self, name: &str) -> Option<&Column> {
        self.columns.iter().find(|it| it.name == name)
    }

    /// The numbers of a column of numbers.
    #[must_use]
    pub fn numbers(&self, name: &str) -> Option<&[Option<f64>]> {
        match &self.column(name)?.cells {
            Cells::Numbers(cells) => Some(cells),
            _ => None,
        }
    }

    /// Number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.columns.first().map_or(0, |it| match &it.cells {
            Cells::Whole(cells) => cells.len(),
            Cells::Numbers(cells) => cells.len(),
            Cells::Texts(cells) => cells.len(),
        })
    }

    /// The table as CSV. Its decimals read back to the same bits.
    ///
    /// # Panics
    /// Never, because a table in memory can be written.
    #[must_use]
    pub fn csv(&self) -> String {
        let mut writer = csv::WriterBuilder::new().from_writer(Vec::new());
        let cell = |it: &Column, row: usize| match &it.cells {
            Cells::Whole(cells) => cells[row].map(|it| it.to_string()),
            Cells::Numbers(cells) => cells[row].map(|it| it.to_string()),
            Cells::Texts(cells) => cells[row].clone(),
        };
        let _ = writer.write_record(self.columns.iter().map(Column::header));
        for row in 0..self.rows() {
            let _ = writer.write_record(self.columns.iter().map(|it| cell(it, row).unwrap_or_default()));
        }
        let bytes = writer.into_inner().unwrap_or_default();
        String::from_utf8(bytes).expect("cells are text")
    }
}

/// The columns of the settings and of the seeds of the noise.
fn settings(all: &Simulations, tasks: &[Task]) -> Vec<Column> {
    let run = |task: &Task| match &task.what {
        TaskKind::Run { values, noise, .. } => (values.clone(), *noise),
        TaskKind::Diagnosis(_) => (Vec::new(), None),
    };
    let runs: Vec<_> = tasks.iter().map(run).collect();
    let one = |(k, factor): (usize, &crate::scenario::Factor)| Column {
        name: factor.name.clone(),
        // Two plants may have different units: then the unit is in each result.
        unit: unit_of(all.plants.iter().map(|it| it.places[k].unit.as_str())),
        cells: Cells::Numbers(runs.iter().map(|it| it.0.get(k).copied()).collect()),
    };
    let mut columns: Vec<Column> = all.factors.iter().enumerate().map(one).collect();
    if all.noise {
        let seeds = Cells::Whole(runs.iter().map(|it| it.1).collect());
        columns.push(Column { name: "noise_seed".into(), unit: Some("1".into()), cells: seeds });
    }
    columns
}

/// The unit, if it is the same for all; `1` for a number without a unit.
fn unit_of<'a>(mut units: impl Iterator<Item = &'a str>) -> Option<String> {
    let first = units.next()?;
    units.all(|it| it == first).then(|| if first.is_empty() { "1" } else { first }.to_string())
}

fn figures(all: &Simulations, results: &[Option<Value>]) -> Vec<Column> {
    let mut columns = Vec::new();
    for (output, statistics) in &all.outputs {
        let units = all.plants.iter().filter_map(|it| it.file.kind.outputs().iter().find(|it| it.name == *output));
        let unit = unit_of(units.map(|it| it.unit));
        for it in statistics {
            let value = |result: &Option<Value>| result.as_ref()?["outputs"][output][it.name()].as_f64();
            let cells = Cells::Numbers(results.iter().map(value).collect());
            columns.push(Column { name: figure(output, it.name()), unit: unit.clone(), cells });
        }
    }
    columns
}

/// The causes of a diagnosis, by their kinds.
fn causes(result: &Value) -> Option<String> {
    let causes = result["diagnosis"]["causes"].as_array()?;
    Some(causes.iter().filter_map(|it| it["kind"].as_str()).collect::<Vec<_>>().join("; "))
}

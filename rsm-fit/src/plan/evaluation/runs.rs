//! The runs that are evaluated.
//!
//! In: a plan, points in memory, or a table with the columns of the factors. Out: [`Runs`]: settings in the units of the factors, with the number and
//! the block of each run.

use std::path::Path;

use rsm_core::source::{Collector, Fault, Faults, Source};

use crate::plan::design::{Factor, MOST_RUNS};
use crate::plan::{BLOCK, DesignSpecification, Existing, Plan, RUN};
use crate::table::{Table, Wanted};

/// The runs of a design.
///
/// ```
/// use rsm_core::source::Source;
/// use rsm_fit::plan::{DesignSpecification, Runs};
///
/// let text = "format = 1\nplan = \"dyno\"\nseed = 7\norder = 1\n[factors.speed]\nunit = \"rad/s\"\nlevels = [100, 200]\n";
/// let specification = DesignSpecification::from_source(Source::new("dyno.toml", text))?;
/// let done = Source::new("done.csv", "run[1],speed[rad/s],power[kW]\n4,100,2.1\n7,200,3.9\n");
/// let runs = Runs::from_source(&done, &specification)?;
/// assert_eq!((runs.points, runs.numbers), (vec![vec![100.0], vec![200.0]], vec![4, 7]));
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Runs {
    /// For each run, one setting for each factor, in the units of the factors.
    pub points: Vec<Vec<f64>>,
    /// The number of each run.
    pub numbers: Vec<u32>,
    /// The block of each run; empty without blocks.
    pub blocks: Vec<u32>,
}

impl Runs {
    /// Runs without blocks, numbered from 1.
    #[must_use]
    pub fn new(points: Vec<Vec<f64>>) -> Runs {
        let numbers = (1..=points.len() as u32).collect();
        Runs { points, numbers, blocks: Vec::new() }
    }

    /// The runs of a plan.
    #[must_use]
    pub fn of(plan: &Plan) -> Runs {
        let point = |row: usize| plan.factors.iter().map(|factor| factor.values[row]).collect();
        Runs { points: (0..plan.runs.len()).map(point).collect(), numbers: plan.runs.clone(), blocks: plan.blocks.clone() }
    }

    /// The runs of a plan that adds to others, after these. If the plan has blocks, the existing runs are a separate block.
    #[must_use]
    pub fn of_augmented(plan: &Plan, existing: &Existing) -> Runs {
        let (mut all, new) = (Runs::new(existing.points.clone()), Runs::of(plan));
        if let Some(last) = new.blocks.iter().max() {
            all.blocks = vec![last + 1; all.points.len()];
        }
        all.points.extend(new.points);
        all.numbers.extend(new.numbers);
        all.blocks.extend(new.blocks);
        all
    }

    /// Reads runs from a CSV file: a column for each factor, and `run` and `block` if they are there. Other columns are ignored.
    ///
    /// # Errors
    /// Every fault of the file: a missing factor, a unit of another kind, a run number or a block that is not a whole number.
    pub fn read(path: &Path, specification: &DesignSpecification) -> Result<Runs, Faults> {
        Runs::from_source(&Source::read(path)?, specification)
    }

    /// The same from the text of a CSV.
    ///
    /// # Errors
    /// Those of [`Runs::read`].
    pub fn from_source(source: &Source, specification: &DesignSpecification) -> Result<Runs, Faults> {
        let factors = &specification.factors;
        let mut wanted: Vec<String> = factors.iter().map(|factor| factor.name.clone()).collect();
        let table = Table::read(source, &Wanted { numbers: wanted.clone(), ..Wanted::default() })?;
        let is_factor = |name: &str| factors.iter().any(|factor| factor.name == name);
        let more: Vec<&str> =
            [RUN, BLOCK].into_iter().filter(|name| table.column(name).is_some() && !is_factor(name)).collect();
        wanted.extend(more.iter().map(ToString::to_string));
        let table =
            if more.is_empty() { table } else { Table::read(source, &Wanted { numbers: wanted, ..Wanted::default() })? };
        let mut faults = Collector::new();
        let columns: Vec<Vec<f64>> = factors.iter().filter_map(|factor| settings(&table, factor, &mut faults)).collect();
        let mut whole = |name: &str| {
            let column = more.contains(&name).then(|| table.column(name)).flatten()?;
            for (value, line) in column.values.iter().zip(&table.lines) {
                if value.fract() != 0.0 || !(1.0..=MOST_RUNS as f64).contains(value) {
                    let what = format!(
                        "column {} `{name}`: found {value}, expected a whole number from 1 to {MOST_RUNS}",
                        column.place
                    );
                    faults.push(Fault::at_line(&table.file, *line, 0, what));
                }
            }
            Some(column.values.iter().map(|value| *value as u32).collect::<Vec<u32>>())
        };
        let rows = table.rows();
        let numbers = whole(RUN).unwrap_or_else(|| (1..=rows as u32).collect());
        let blocks = whole(BLOCK).unwrap_or_default();
        let is_complete = columns.len() == factors.len();
        let points = (0..rows).map(|row| columns.iter().map(|column| column[row]).collect()).collect();
        faults.finish(is_complete.then_some(Runs { points, numbers, blocks }))
    }
}

/// The settings of a factor. A table may omit units; they are then those of the factors.
fn settings(table: &Table, factor: &Factor, faults: &mut Collector) -> Option<Vec<f64>> {
    table.values_in(&factor.name, Some(&factor.unit)).map(|(values, _)| values).map_err(|fault| faults.push(fault)).ok()
}

//! The contrasts of categories, from their columns of text.
//!
//! In: a table with the texts, the wanted categories. Out: the table with a column of numbers for each contrast. A file may have the contrasts
//! themselves; then nothing is computed.

use std::collections::BTreeMap;

use rsm_core::model::Category;
use rsm_core::source::{Collector, Fault, Faults};

use super::{Column, MOST_FAULTS, MissingAs, Table, Wanted};
use crate::missing::is_missing;

impl Wanted {
    /// The columns to read from a file with these columns: the texts of categories in place of their contrasts.
    pub(crate) fn in_file(&self, has: impl Fn(&str) -> bool) -> Wanted {
        let mut wanted = self.clone();
        wanted.categories.retain(|category| {
            category.is_in(&self.numbers) && (has(&category.name) || !category.inputs.iter().all(|name| has(name)))
        });
        for category in &wanted.categories {
            wanted.numbers.retain(|name| !category.inputs.contains(name));
            if !wanted.labels.contains(&category.name) {
                wanted.labels.push(category.name.clone());
            }
        }
        wanted
    }
}

impl Table {
    /// Adds the contrasts of categories, computed from their columns of text.
    ///
    /// # Errors
    /// A text that is no level, once for each text; a missing cell, unless it is read as NaN.
    pub(crate) fn with_contrasts(mut self, wanted: &Wanted) -> Result<Table, Faults> {
        if wanted.categories.is_empty() {
            return Ok(self);
        }
        let mut faults = Collector::new();
        for category in wanted.in_file(|name| self.column(name).is_some()).categories {
            let Some(column) = self.column(&category.name).filter(|column| column.labels.len() == self.rows()) else {
                continue;
            };
            let columns = category.columns(column.labels.iter().map(String::as_str), f64::NAN);
            // Of each text that is no level the first row, and how many cells have it.
            let mut told: BTreeMap<&str, (usize, usize)> = BTreeMap::new();
            let is_known =
                |label: &String| wanted.missing == MissingAs::Nan && is_missing(label) || category.levels.contains(label);
            for (label, line) in column.labels.iter().zip(&self.lines).filter(|(label, _)| !is_known(label)) {
                told.entry(label).or_insert((*line, 0)).1 += 1;
            }
            let mut told: Vec<(&str, (usize, usize))> = told.into_iter().collect();
            told.sort_by_key(|(_, (line, _))| *line);
            for (text, (line, cells)) in told.into_iter().take(MOST_FAULTS) {
                faults.push(self.no_level(&category, column, text, line, cells, wanted.missing));
            }
            let (place, unit) = (column.place, Some("1".to_string()));
            // Columns of the file with these names are not used.
            self.columns.retain(|column| !category.inputs.contains(&column.name));
            for (name, values) in category.inputs.into_iter().zip(columns) {
                self.columns.push(Column { name, unit: unit.clone(), place, values, labels: Vec::new() });
            }
        }
        faults.finish(Some(self))
    }

    fn no_level(
        &self,
        category: &Category,
        column: &Column,
        text: &str,
        line: usize,
        cells: usize,
        missing: MissingAs,
    ) -> Fault {
        let found = if text.is_empty() { "an empty cell".to_string() } else { format!("`{text}`") };
        let more = if cells > 1 { format!("; {cells} cells have it") } else { String::new() };
        let what = format!("found {found}, expected one of {}{more}", category.quoted_levels());
        let who = format!("column {} `{}`", column.place, column.name);
        // A file that is no text has rows in place of lines.
        let fault = match self.header_line {
            0 => Fault::whole_file(&self.file, format!("{who}: row {line}: {what}")),
            _ => Fault::at_line(&self.file, line, 0, format!("{who}: {what}")),
        };
        match missing {
            MissingAs::Counted(help) if is_missing(text) => fault.help(help.to_string()),
            _ => fault,
        }
    }
}

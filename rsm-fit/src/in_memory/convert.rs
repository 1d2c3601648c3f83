//! Converts settings and rows in memory to a specification and records.
//!
//! In: a [`Fit`]. Out: what the same fit of files would have read, or every fault. Fits nothing.

use rsm_core::model::Category;
use rsm_core::source::{Collector, Fault};
use sha2::{Digest, Sha256};

use super::columns::RowWeights;
use super::{Apart, Fit, Inputs, Response, Responses};
use crate::fit::Data;
use crate::hash::hexadecimal;
use crate::missing::Missing;
use crate::records::{DataFile, Records, Units};
use crate::spec::{IN_MEMORY, InputSpec, Specification, Split, Together, Validation};
use crate::table::magnitude_fault;

/// The name of the column of groups in the specification.
const GROUPS: &str = "groups";

/// The name of the column of series.
const SERIES: &str = "series";

/// The name of the column of blocks.
const BLOCKS: &str = "blocks";

/// The name of validation rows in messages.
const VALIDATE: &str = "validation";
const TEST: &str = "test";

impl Fit {
    fn input_names(&self) -> Vec<String> {
        names(self.inputs.columns.iter().map(|column| &column.name), "x", true)
    }

    fn response_names(&self) -> Vec<String> {
        names(self.responses.columns.iter().map(|column| &column.name), "y", self.responses.columns.len() > 1)
    }

    pub(super) fn specification(&self, faults: &mut Collector) -> Option<Specification> {
        let pairs = self.inputs.columns.iter().zip(self.input_names());
        let inputs: Vec<InputSpec> = pairs.map(|(input, name)| input.specification(&name)).collect();
        let mut responses = Vec::new();
        let mut is_whole = true;
        for (response, name) in self.responses.columns.iter().zip(self.response_names()) {
            for what in response.faults(inputs.len(), &self.select) {
                tell(faults, format!("response `{name}`: {what}"));
                is_whole = false;
            }
            for (what, value) in response.numbers().filter(|(_, value)| !value.is_finite()) {
                tell(faults, format!("response `{name}`: {what}: found {value}, expected a finite number"));
                is_whole = false;
            }
            responses.extend(response.specification(&name, &inputs, &self.select));
        }
        for (input, spec) in self.inputs.columns.iter().zip(&inputs) {
            for (what, value) in input.numbers().filter(|(_, value)| !value.is_finite()) {
                tell(faults, format!("input `{}`: {what}: found {value}, expected a finite number", spec.name));
                is_whole = false;
            }
        }
        for name in self.mirror.iter().filter(|name| !inputs.iter().any(|input| input.name == **name)) {
            let known: Vec<String> = inputs.iter().map(|input| format!("`{}`", input.name)).collect();
            let fault = Fault::whole_file(IN_MEMORY, format!("`mirror`: there is no input `{name}`"));
            faults.push(fault.help(format!("the inputs are {}", known.join(", "))));
        }
        if !is_whole || self.inputs.ragged.is_some() || self.responses.ragged.is_some() {
            // Parts with faults would cause further faults in the rules.
            return None;
        }
        let together =
            Together { columns: self.groups.iter().map(|_| GROUPS.to_string()).collect(), mirror: self.mirror.clone() };
        let apart = (self.validation.specification(VALIDATE), self.test.specification(TEST));
        let series = self.series.iter().map(|_| SERIES.to_string()).collect();
        let blocks = self.blocks.iter().map(|_| BLOCKS.to_string()).collect();
        let mut categories: Vec<Category> = Vec::new();
        for (category, _) in self.inputs.columns.iter().filter_map(|input| input.category.as_ref()) {
            if !categories.contains(category) {
                categories.push(category.clone());
            }
        }
        for response in &mut responses {
            let is_used = |category: &&Category| category.is_in(&response.surface.inputs);
            response.surface.categories = categories.iter().filter(is_used).cloned().collect();
        }
        let rows = (together, self.missing, series, blocks);
        Some(Specification::in_memory(self.name.clone(), apart, inputs, responses, rows, categories, faults))
    }

    pub(super) fn data(&self, faults: &mut Collector) -> Data {
        let rows = self.inputs.columns.first().map_or(0, |column| column.values.len());
        let mut fit = self.records("", (&self.inputs, &self.responses), "rows in memory", faults);
        if let Some(groups) = &self.groups {
            same_length(faults, "the groups", groups.len(), rows);
            fit.labels.push(groups.clone());
        }
        if let Some(series) = &self.series {
            same_length(faults, "the series", series.len(), rows);
            fit.labels.push(series.clone());
        }
        if let Some(blocks) = &self.blocks {
            same_length(faults, "the blocks", blocks.len(), rows);
            fit.labels.push(blocks.clone());
        }
        if let Some(order) = &self.run_order {
            same_length(faults, "the run order", order.len(), rows);
            if let Some(bad) = order.iter().find(|place| !self.is_accepted(**place)) {
                tell(faults, format!("the run order: found {bad}, expected a finite number"));
            }
            // If rows may be left out, only the kept ones must be different.
            let is_settled = self.missing == Missing::Error || order.len() != rows;
            fit.order = if is_settled { crate::records::distinct(order.clone(), rows) } else { order.clone() };
        }
        for (response, name) in self.responses.columns.iter().zip(self.response_names()) {
            fit.weights.push(self.weights(response, &name, faults));
        }
        let mut apart = |key: &str, rows: &Apart| match rows {
            Apart::Rows(inputs, responses) => {
                let mut records =
                    self.records(&format!("{key} rows: "), (inputs, responses), &format!("{key} rows in memory"), faults);
                records.weights = vec![Vec::new(); self.responses.columns.len()];
                // Separate rows are in no group with those to fit.
                records.labels = self.groups.iter().map(|_| (0..records.rows()).map(|row| row.to_string()).collect()).collect();
                Some(records)
            }
            _ => None,
        };
        let (validate, test) = (apart(VALIDATE, &self.validation), apart(TEST, &self.test));
        Data { fit, validate, test, units: Units::default() }
    }

    /// Converts columns to records, with a fault for each number that cannot be fitted. `who`: the name of the rows in messages.
    fn records(&self, who: &str, (inputs, responses): (&Inputs, &Responses), name: &str, faults: &mut Collector) -> Records {
        let mut columns = Vec::new();
        for (k, known) in self.input_names().into_iter().enumerate() {
            let Some(column) = inputs.columns.get(k) else { continue };
            columns.push((format!("{who}input `{known}`"), known, &column.name, &column.values, false));
        }
        for (k, known) in self.response_names().into_iter().enumerate() {
            let Some(column) = responses.columns.get(k) else { continue };
            columns.push((format!("{who}response `{known}`"), known, &column.name, &column.values, true));
        }
        let counts = [
            ("inputs", inputs.columns.len(), self.inputs.columns.len(), inputs.ragged),
            ("responses", responses.columns.len(), self.responses.columns.len(), responses.ragged),
        ];
        for (kind, found, expected, ragged) in counts {
            if let Some(ragged) = ragged {
                let (row, found, expected) = (ragged.row, ragged.found, ragged.expected);
                tell(faults, format!("{who}{kind}: row {row}: found {found} values, expected {expected}"));
            } else if found != expected {
                tell(faults, format!("{who}found {found} {kind}, expected {expected}"));
            }
        }
        let rows = columns.first().map_or(0, |(_, _, _, values, _)| values.len());
        if rows == 0 && columns.len() > 1 {
            tell(faults, format!("{who}found no row, expected at least one"));
        }
        let mut told: Vec<String> = Vec::new();
        let mut hash = Sha256::new();
        let mut records = Records::default();
        for (who, known, given, values, is_response) in columns {
            if let Some(given) = given.as_ref().filter(|given| **given != known) {
                tell(faults, format!("{who}: found `{given}` in its place, expected the same order as in the rows to fit"));
            }
            same_length(faults, &who, values.len(), rows);
            let of_category = inputs.columns.iter().find(|input| input.name.as_ref() == Some(&known));
            if let Some((_, Some(fault))) = of_category.and_then(|input| input.category.as_ref()) {
                if !told.contains(fault) {
                    tell(faults, fault.clone());
                    told.push(fault.clone());
                }
                continue;
            }
            if let Some(row) = values.iter().position(|value| !self.is_accepted(*value)) {
                faults.push(not_finite(&who, values, row));
            } else if let Some((row, what, help)) = magnitude_fault(values).filter(|_| is_response) {
                let what = format!("{who}: row {}: found {:?}, {what}", row + 1, values[row]);
                faults.push(Fault::whole_file(IN_MEMORY, what).help(help));
            }
            values.iter().for_each(|value| hash.update(value.to_le_bytes()));
            if is_response { &mut records.responses } else { &mut records.inputs }.push(values.clone());
        }
        let sha256 = hexadecimal(&hash.finalize());
        records.files = vec![DataFile { name: name.to_string(), sha256, rows }];
        records
    }

    /// Whether the value can be in the rows: a finite number, or NaN if rows may be left out.
    fn is_accepted(&self, value: f64) -> bool {
        value.is_finite() || value.is_nan() && self.missing == Missing::DropRow
    }

    fn weights(&self, response: &Response, name: &str, faults: &mut Collector) -> Vec<f64> {
        let (given, weights): (&Vec<f64>, Vec<f64>) = match &response.weights {
            None => return Vec::new(),
            Some(RowWeights::Weights(weights)) => (weights, weights.clone()),
            Some(RowWeights::StandardErrors(sigma)) => (sigma, sigma.iter().map(|sigma| 1.0 / (sigma * sigma)).collect()),
        };
        same_length(faults, &format!("response `{name}`: the weights"), given.len(), response.values.len());
        if let Some(row) = (0..given.len()).find(|row| {
            given[*row] <= 0.0 || !self.is_accepted(given[*row]) || !(given[*row].is_nan() || weights[*row].is_normal())
        }) {
            let what =
                format!("response `{name}`: the weight of row {}: found {}, expected a number above 0", row + 1, given[row]);
            faults.push(Fault::whole_file(IN_MEMORY, what).help("leave the row out if it must not count"));
        }
        weights
    }
}

impl Apart {
    fn specification(&self, key: &str) -> Validation {
        match self {
            Apart::None => Validation::None,
            Apart::Rows(..) => Validation::Files(vec![format!("{key} rows in memory")]),
            Apart::Share(share, seed) => {
                Validation::Split(Split { share: *share, seed: *seed, keep_together: Vec::new(), mirror: Vec::new() })
            }
        }
    }
}

/// The given names; a column without one gets a letter, with a number from 1 if `numbered`.
fn names<'a>(given: impl Iterator<Item = &'a Option<String>>, letter: &str, numbered: bool) -> Vec<String> {
    let own = |k: usize| if numbered { format!("{letter}{}", k + 1) } else { letter.to_string() };
    given.enumerate().map(|(k, name)| name.clone().unwrap_or_else(|| own(k))).collect()
}

/// The fault of the first number that is not finite. Missing ones are counted, with the method that leaves them out.
fn not_finite(who: &str, values: &[f64], row: usize) -> Fault {
    let what = format!("{who}: row {}: found {}, expected a finite number", row + 1, values[row]);
    if !values[row].is_nan() {
        return Fault::whole_file(IN_MEMORY, what);
    }
    let what = match values.iter().filter(|value| value.is_nan()).count() {
        1 => format!("{what}; no other value is NaN"),
        all => format!("{what}; {all} values are NaN"),
    };
    Fault::whole_file(IN_MEMORY, what).help("`Fit::missing(Missing::DropRow)` leaves such rows out")
}

fn same_length(faults: &mut Collector, who: &str, found: usize, expected: usize) {
    if found != expected {
        tell(faults, format!("{who}: found {found} rows, expected {expected}"));
    }
}

fn tell(faults: &mut Collector, what: String) {
    faults.push(Fault::whole_file(IN_MEMORY, what));
}

//! New data for a model: which columns are its inputs and responses, and how the other columns are used.
//!
//! In: the contents of files and a model. Out: [`NewData`], rows in run order in the units of the model, or every fault. A surface is compared if
//! its response is a column. Every other column is kept as numbers, kept as levels, or ignored with a reason. Never drops a row.

use rsm_core::model::{Model, Surface};
use rsm_core::order;
use rsm_core::source::{Collector, Fault, Faults};

use super::sample::ExtraColumn;
use rsm_fit::content::Content;
use rsm_fit::records::{DataFile, Refused, hash};
use rsm_fit::table::{MissingAs, Table, Wanted, is_run};

/// Columns of numbers with these names are levels only.
const BLOCK: [&str; 15] = [
    "block", "blocks", "day", "rig", "batch", "session", "bench", "lot", "shift", "operator", "group", "series", "setup",
    "machine", "week",
];

/// The help at a missing cell of an input or a response.
const MISSING: &str =
    "a diagnosis compares rows in their order and leaves none out: delete the rows from the file, or fill the cells";

/// Why a column of Parquet or Arrow is ignored.
const NO_LABELS: &str = "its type is neither number nor text nor boolean";

/// A column of integers with more distinct values than this is a quantity, not a column of levels.
const MOST_LEVELS: usize = 12;

/// Rows of new data, in run order.
#[derive(Debug, Clone, Default)]
pub struct NewData {
    /// The files.
    pub files: Vec<DataFile>,
    /// The file index and the line of every row.
    pub lines: Vec<(usize, usize)>,
    /// The values of every input of the model; empty for inputs that no compared surface uses.
    pub inputs: Vec<Vec<f64>>,
    /// The response of every surface after its transform, if it has one; `None` if it is not a column.
    pub responses: Vec<Option<Vec<f64>>>,
    /// Columns that are not in the model.
    pub extras: Vec<ExtraColumn>,
    /// The column that gave the run order; otherwise rows are in the order of the files.
    pub ordered_by: Option<String>,
    /// Ignored columns, each with the reason.
    pub ignored: Vec<(String, String)>,
}

impl NewData {
    /// Reads files. `only` gives the surfaces to compare; otherwise they are all surfaces with a response column in every file.
    ///
    /// # Errors
    /// Every fault of every file.
    pub fn read(model: &Model, files: &[Content], only: Option<&[usize]>) -> Result<Self, Refused> {
        Self::read_as(model, &Origin::Files(files), only, &[])
    }

    /// Rows in memory: columns by name, all of the same length, in the units of the model. A column that is neither input nor response is a further
    /// column, a candidate for a cause. A surface is compared if its response is present.
    ///
    /// # Errors
    /// Every fault: columns of different lengths, a number that is not finite, a missing input.
    ///
    /// ```
    /// use rsm_diagnose::surface::{self, Verdict, data::NewData};
    /// use rsm_fit::{Fit, Input, Response};
    ///
    /// use rsm_fit::random::Random;
    ///
    /// // Twelve uniform numbers less six: normal noise of variance 1.
    /// let mut random = Random::new(7);
    /// let mut noise = || (0..12).map(|_| random.share()).sum::<f64>() - 6.0;
    /// let speed: Vec<f64> = (0..80).map(|row| 0.4 * f64::from(row)).collect();
    /// let drag: Vec<f64> = speed.iter().map(|v| 5.0 + 2.0 * v + 0.2 * noise()).collect();
    /// let model = Fit::new(Input::new("speed", &speed), Response::new("drag", &drag)).order(1).fit()?.checked()?;
    ///
    /// // A year later the machine drags more, the faster the more.
    /// let later: Vec<f64> = speed.iter().map(|v| 5.0 + 2.4 * v + 0.2 * noise()).collect();
    /// let data = NewData::in_memory(model.model(), &[("speed", &speed), ("drag", &later)])?;
    /// let found = surface::diagnose(&model, &data, None, &mut |_progress| {})?;
    /// assert_eq!(found.verdict, Verdict::Explained);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn in_memory(model: &Model, columns: &[(&str, &[f64])]) -> Result<Self, Refused> {
        Self::read_as(model, &Origin::Memory(columns), None, &[])
    }

    /// Reads files that evaluate the results of other files. The surfaces are those of the other data, and a further column has the same type as
    /// there: a quantity stays a quantity even if it is constant here, and levels stay levels even if there is only one.
    ///
    /// # Errors
    /// Every fault of every file.
    pub fn read_like(model: &Model, files: &[Content], like: &NewData) -> Result<Self, Refused> {
        let compared: Vec<usize> = (0..model.surfaces.len()).filter(|index| like.responses[*index].is_some()).collect();
        Self::read_as(model, &Origin::Files(files), Some(&compared), &like.extras)
    }

    fn read_as(model: &Model, origin: &Origin<'_>, only: Option<&[usize]>, known: &[ExtraColumn]) -> Result<Self, Refused> {
        let headers: Vec<Result<Table, Faults>> =
            (0..origin.count()).map(|file| origin.table(file, &Wanted::default())).collect();
        let faults: Vec<Faults> = headers.iter().filter_map(|it| it.as_ref().err().cloned()).collect();
        if !faults.is_empty() {
            return Err(Refused(faults));
        }
        let headers: Vec<Table> = headers.into_iter().flatten().collect();
        let compared: Vec<usize> = match only {
            Some(surfaces) => surfaces.to_vec(),
            None => {
                let is_there = |index: &usize| {
                    let name = &model.surfaces[*index].name;
                    headers.iter().any(|table| table.column(name).is_some())
                };
                (0..model.surfaces.len()).filter(is_there).collect()
            }
        };
        if compared.is_empty() {
            let found = headers.iter().map(|table| {
                let names: Vec<String> = table.columns.iter().map(|column| format!("`{}`", column.name)).collect();
                let known: Vec<String> = model.surfaces.iter().map(|surface| format!("`{}`", surface.name)).collect();
                let what = format!("no column is a response of model `{}`: found {}", model.name, names.join(", "));
                let fault = Fault::at_line(&table.file, table.header_line, 0, what);
                Faults::one(fault.help(format!("give one column the name of a surface of the model: {}", known.join(", "))))
            });
            return Err(Refused(found.collect()));
        }
        // The causes are columns of terms.
        let splines: Vec<String> = compared
            .iter()
            .map(|index| &model.surfaces[*index])
            .filter(|surface| surface.spline.is_some())
            .map(|surface| format!("`{}`", surface.name))
            .collect();
        if !splines.is_empty() {
            let what = format!("the surface {} is a spline; only surfaces with terms can be diagnosed", splines.join(", "));
            let file = headers.first().map_or("", |table| &table.file);
            let fault = Fault::whole_file(file, what);
            let help = "compare it with new data by `rsm eval`, or fit terms to the old data and diagnose these";
            return Err(Refused(vec![Faults::one(fault.help(help))]));
        }
        let used = |name: &String| compared.iter().any(|index| model.surfaces[*index].inputs.contains(name));
        let mut data = NewData {
            inputs: vec![Vec::new(); model.inputs.len()],
            responses: (0..model.surfaces.len()).map(|index| compared.contains(&index).then(Vec::new)).collect(),
            ..NewData::default()
        };
        let inputs: Vec<usize> = (0..model.inputs.len()).filter(|k| used(&model.inputs[*k].name)).collect();
        let is_known = |name: &str| {
            let is_input = model.inputs.iter().any(|input| input.name == name);
            let is_category = model.categories().iter().any(|category| category.name == name);
            is_input || is_category || model.surfaces.iter().any(|surface| surface.name == name)
        };
        // A further column is used if every file has it.
        let first = headers.first().map(|table| &table.columns[..]).unwrap_or_default();
        let others: Vec<(String, Option<String>)> = first
            .iter()
            .filter(|column| !is_known(&column.name) && headers.iter().all(|table| table.column(&column.name).is_some()))
            .map(|column| (column.name.clone(), column.unit.clone()))
            .collect();
        let mut lacking: Vec<(String, String)> = Vec::new();
        for column in headers.iter().flat_map(|table| &table.columns).filter(|column| !is_known(&column.name)) {
            let without = headers.iter().find(|table| table.column(&column.name).is_none());
            if let Some(table) = without.filter(|_| !lacking.iter().any(|(name, _)| *name == column.name)) {
                lacking.push((column.name.clone(), format!("{} does not have it", table.file)));
            }
        }
        let mut refused = Vec::new();
        let mut cells: Vec<Vec<String>> = vec![Vec::new(); others.len()];
        for file in 0..origin.count() {
            match data.append(model, origin, file, &inputs, &compared, &others, &mut cells) {
                Ok(()) => {}
                Err(faults) => refused.push(faults),
            }
        }
        if !refused.is_empty() {
            return Err(Refused(refused));
        }
        data.ignored = lacking;
        // A type that holds no labels, in some of the files.
        let (others, without): (Vec<_>, Vec<_>) =
            others.into_iter().zip(cells).partition(|(_, cells)| cells.len() == data.rows());
        data.ignored.extend(without.into_iter().map(|((name, _), _)| (name, NO_LABELS.to_string())));
        let (others, cells): (Vec<_>, Vec<_>) = others.into_iter().unzip();
        data.classify_extra_columns(&others, cells, known);
        Ok(data)
    }

    #[allow(clippy::too_many_arguments)] // one call, and each is another thing
    fn append(
        &mut self,
        model: &Model,
        origin: &Origin<'_>,
        file: usize,
        inputs: &[usize],
        compared: &[usize],
        others: &[(String, Option<String>)],
        cells: &mut [Vec<String>],
    ) -> Result<(), Faults> {
        let names = inputs.iter().map(|k| &model.inputs[*k].name);
        let numbers = names.chain(compared.iter().map(|k| &model.surfaces[*k].name)).cloned().collect();
        let labels = others.iter().map(|(name, _)| name.clone()).collect();
        let categories = model.categories().into_iter().cloned().collect();
        let missing = MissingAs::Counted(MISSING);
        let table =
            origin.table(file, &Wanted { numbers, labels, any_label: true, missing, categories, ..Wanted::default() })?;
        let mut faults = Collector::new();
        let mut take = |values: Result<(Vec<f64>, String), Fault>, target: &mut Vec<f64>| match values {
            Ok((values, _)) => target.extend(values),
            Err(fault) => faults.push(fault),
        };
        for k in inputs {
            let input = &model.inputs[*k];
            take(table.values_in(&input.name, Some(&input.unit)), &mut self.inputs[*k]);
        }
        for k in compared {
            let target = self.responses[*k].as_mut().expect("a compared surface has a response");
            let surface = &model.surfaces[*k];
            take(response_in(&table, surface), target);
        }
        for ((name, _), cells) in others.iter().zip(cells) {
            cells.extend(table.column(name).into_iter().flat_map(|column| column.labels.iter().cloned()));
        }
        self.lines.extend(table.lines.iter().map(|line| (file, *line)));
        self.files.push(DataFile { name: table.file.clone(), sha256: origin.hash(file)?, rows: table.rows() });
        faults.finish(Some(()))
    }

    /// Classifies the further columns, and sorts the rows by the column of the run order.
    fn classify_extra_columns(&mut self, others: &[(String, Option<String>)], cells: Vec<Vec<String>>, known: &[ExtraColumn]) {
        let rows = self.lines.len();
        let mut columns: Vec<(String, Option<String>, Vec<String>)> =
            others.iter().zip(cells).map(|((name, unit), cells)| (name.clone(), unit.clone(), cells)).collect();
        let runs = columns.iter().enumerate().find_map(|(place, (name, _, cells))| {
            let is_run = is_run(name);
            let values = is_run.then(|| numbers(cells)).flatten()?;
            let mut sorted = values.clone();
            order::sort(&mut sorted);
            sorted.windows(2).all(|pair| pair[0] < pair[1]).then_some((place, values))
        });
        if let Some((place, values)) = runs {
            let mut order: Vec<usize> = (0..rows).collect();
            order::ascending(&mut order, |it| values[*it]);
            self.ordered_by = Some(columns.remove(place).0);
            self.lines = order.iter().map(|row| self.lines[*row]).collect();
            let sorted = |column: &Vec<f64>| -> Vec<f64> { order.iter().filter_map(|row| column.get(*row).copied()).collect() };
            self.inputs = self.inputs.iter().map(sorted).collect();
            self.responses = self.responses.iter().map(|response| response.as_ref().map(sorted)).collect();
            for (_, _, cells) in &mut columns {
                *cells = order.iter().map(|row| cells[*row].clone()).collect();
            }
        }
        if self.files.len() > 1 {
            // Each file may be another day or another test rig.
            let names: Vec<String> = self.lines.iter().map(|(file, _)| self.files[*file].name.clone()).collect();
            if !columns.iter().any(|(name, _, _)| name == "file") {
                columns.push(("file".to_string(), None, names));
            }
        }
        for (name, unit, cells) in columns {
            let kind = match known.iter().find(|it| it.name == name) {
                Some(known) => as_known(known, unit.as_deref(), &cells),
                None => column_type(&name, unit.as_deref(), &cells),
            };
            match kind {
                Ok(extra) => self.extras.push(extra),
                Err(why) => self.ignored.push((name, why)),
            }
        }
    }

    /// The number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.lines.len()
    }

    /// `file:line` of a row.
    #[must_use]
    pub fn place_of(&self, row: usize) -> String {
        let (file, line) = self.lines[row];
        format!("{}:{line}", self.files[file].name)
    }
}

/// The response of a surface in the unit of the model, after its transform.
fn response_in(table: &Table, surface: &Surface) -> Result<(Vec<f64>, String), Fault> {
    let (mut values, unit) = table.response_in(&surface.name, Some(&surface.unit))?;
    let Some(transform) = surface.transform else { return Ok((values, unit)) };
    for (row, value) in values.iter_mut().enumerate() {
        *value = transform.transformed(*value).ok_or_else(|| {
            let (name, word, accepted) = (&surface.name, transform.word(), transform.accepted());
            let what = format!("column `{name}`: found {value}, expected {accepted} for `transform` \"{word}\" of the surface");
            Fault::at_line(&table.file, table.lines[row], 0, what).help("delete the row from the file")
        })?;
    }
    Ok((values, unit))
}

/// The source of new data.
enum Origin<'a> {
    /// Files.
    Files(&'a [Content]),
    /// Columns by name.
    Memory(&'a [(&'a str, &'a [f64])]),
}

/// The name of rows in memory in messages.
const IN_MEMORY: &str = "rows in memory";

impl Origin<'_> {
    fn count(&self) -> usize {
        match self {
            Origin::Files(files) => files.len(),
            Origin::Memory(_) => 1,
        }
    }

    /// The requested columns of a file.
    fn table(&self, file: usize, wanted: &Wanted) -> Result<Table, Faults> {
        match self {
            Origin::Files(files) => files[file].table(wanted),
            Origin::Memory(columns) => Table::in_memory(IN_MEMORY, columns, wanted),
        }
    }

    /// SHA-256 of a file; for rows in memory, of their text as a table.
    fn hash(&self, file: usize) -> Result<String, Faults> {
        match self {
            Origin::Files(files) => files[file].sha256(),
            Origin::Memory(columns) => Ok(hash(&format!("{columns:?}"))),
        }
    }
}

fn numbers(cells: &[String]) -> Option<Vec<f64>> {
    cells.iter().map(|cell| cell.parse::<f64>().ok().filter(|value| value.is_finite())).collect()
}

/// A column with the same type as in other data: its numbers, its levels, or both.
fn as_known(known: &ExtraColumn, unit: Option<&str>, cells: &[String]) -> Result<ExtraColumn, String> {
    let unit = unit.unwrap_or("1");
    if unit != known.unit {
        return Err(format!("its unit is {unit}, but {} in the diagnosed data", known.unit));
    }
    let mut names: Vec<String> = Vec::new();
    let of = |cell: &String| {
        names.iter().position(|name| name == cell).unwrap_or_else(|| {
            names.push(cell.clone());
            names.len() - 1
        })
    };
    let of: Vec<usize> = cells.iter().map(of).collect();
    let values = known
        .values
        .as_ref()
        .map(|_| numbers(cells).ok_or("found cells that are not numbers, expected numbers as in the diagnosed data"));
    Ok(ExtraColumn {
        values: values.transpose()?,
        levels: known.levels.as_ref().map(|_| (names, of)),
        clock: false,
        ..known.clone()
    })
}

/// The type of a further column.
fn column_type(name: &str, unit: Option<&str>, cells: &[String]) -> Result<ExtraColumn, String> {
    let mut names: Vec<String> = Vec::new();
    let mut of = Vec::with_capacity(cells.len());
    for cell in cells {
        let level = names.iter().position(|known| known == cell).unwrap_or_else(|| {
            names.push(cell.clone());
            names.len() - 1
        });
        of.push(level);
        if names.len() > cells.len().max(2) / 2 && names.len() > MOST_LEVELS {
            break;
        }
    }
    // Levels need at least two rows each on average; otherwise a level is a single run.
    let may_be_levels = of.len() == cells.len() && names.len() >= 2 && 2 * names.len() <= cells.len();
    let plain = ExtraColumn {
        name: name.to_string(),
        unit: unit.unwrap_or("1").to_string(),
        values: None,
        range: [0.0; 2],
        levels: None,
        clock: false,
    };
    let Some(values) = numbers(cells) else {
        return match may_be_levels {
            true => Ok(ExtraColumn { levels: Some((names, of)), ..plain }),
            false if names.len() == 1 => Err("it has one value only".to_string()),
            false => Err("its cells are neither numbers nor a few levels".to_string()),
        };
    };
    if values.iter().all(|value| *value == values[0]) {
        return Err("it has one value only".to_string());
    }
    if let Some(unit) = unit
        && let Err(why) = rsm_fit::units::check(unit)
    {
        return Err(why);
    }
    let range = <[f64; 2]>::from(order::ends(&values));
    let clock = values.windows(2).all(|pair| pair[0] < pair[1]);
    let whole = values.iter().all(|value| value.fract() == 0.0);
    let bare = unit.is_none_or(|unit| unit == "1");
    let named = BLOCK.iter().any(|block| name.eq_ignore_ascii_case(block));
    let levels = (may_be_levels && bare && (named || whole && names.len() <= MOST_LEVELS)).then_some((names, of));
    let values = if named && levels.is_some() { None } else { Some(values) };
    Ok(ExtraColumn { values, range, levels, clock, ..plain })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kind(name: &str, unit: Option<&str>, cells: &[&str]) -> Result<ExtraColumn, String> {
        column_type(name, unit, &cells.iter().map(ToString::to_string).collect::<Vec<_>>())
    }

    #[test]
    fn further_columns_are_quantities_levels_clocks_or_nothing() {
        let temperature = kind("temperature", Some("degC"), &["20", "25", "20", "25"]).unwrap();
        assert!(temperature.values.is_some() && temperature.levels.is_none());
        let day = kind("day", None, &["1", "1", "2", "2"]).unwrap();
        assert!(day.values.is_none() && day.levels.is_some());
        // Whole numbers without unit or telling name may be either.
        let gear = kind("gear", Some("1"), &["1", "2", "1", "2"]).unwrap();
        assert!(gear.values.is_some() && gear.levels.is_some());
        assert!(kind("time", Some("s"), &["0", "0.5", "7", "8"]).unwrap().clock);
        assert!(kind("rig", None, &["a", "b", "a", "b"]).unwrap().levels.is_some());
        assert!(kind("remark", None, &["a", "", "warm", "late"]).is_err());
        assert!(kind("pressure", Some("bar"), &["1", "1", "1", "1"]).is_err());
    }
}

//! Makes one record of several files.

use rsm_core::number::decimal;
use rsm_core::source::{Fault, Faults};
use rsm_fit::units::Conversion;

use crate::align::{Alignment, align};
use crate::clock::{Clock, readable, short};
use crate::format;
use crate::log::{Log, Raw};
use crate::resample::Samples;
use crate::wishes::{Named, Wishes};

/// A file in memory.
#[derive(Debug, Clone)]
pub struct File {
    /// Its name in messages.
    pub name: String,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

/// A column of a record.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Its name.
    pub name: String,
    /// Its unit, if a file or the user gives one.
    pub unit: Option<String>,
    /// One value for each row.
    pub values: Vec<f64>,
    /// Its origin: the file and the name in the file, or `constant`.
    pub from: String,
}

/// A clean record.
#[derive(Debug, Clone)]
pub struct Record {
    /// Instants, in s.
    pub time: Vec<f64>,
    /// Their period, in s; at gaps the steps are longer.
    pub period: f64,
    /// All columns except the time.
    pub columns: Vec<Column>,
    /// Whether values were interpolated.
    pub is_resampled: bool,
    /// The clocks of further files.
    pub alignments: Vec<Alignment>,
    /// The conversions, in words.
    pub notes: Vec<String>,
}

impl Record {
    /// Number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.time.len()
    }

    /// The record as CSV: the conversions as comments, then `time[s]` and the columns.
    #[must_use]
    pub fn csv(&self) -> String {
        let mut text = String::new();
        for note in &self.notes {
            // A note may quote a name. A line end in the name would end the comment.
            text += &format!("# {}\n", note.replace(['\n', '\r'], " "));
        }
        text += "time[s]";
        for column in &self.columns {
            text += &format!(",{}", column.name);
            if let Some(unit) = &column.unit {
                text += &format!("[{unit}]");
            }
        }
        text.push('\n');
        for (row, time) in self.time.iter().enumerate() {
            text += &decimal(*time);
            for column in &self.columns {
                text.push(',');
                text += &decimal(column.values[row]);
            }
            text.push('\n');
        }
        text
    }
}

/// Names of a time column without its unit, in small letters.
const TIME: [&str; 16] = [
    "time",
    "t",
    "timestamp",
    "time stamp",
    "timestamps",
    "zeit",
    "temps",
    "tiempo",
    "tempo",
    "seconds",
    "sec",
    "elapsed time",
    "relative time",
    "absolute time",
    "datetime",
    "date/time",
];

/// A table with its clock.
struct Timed {
    /// The index of its file. Tables of one file have one clock.
    file: usize,
    log: Log,
    clock: Clock,
    /// The name of the time column.
    time: String,
}

/// Makes one record of one or more files. The record has the clock of the first file.
///
/// # Errors
/// Every fault: a file that cannot be read, a missing column, clocks that cannot be aligned.
pub fn import(files: &[File], wishes: &Wishes) -> Result<Record, Faults> {
    let Some(first) = files.first() else {
        return Err(Faults::one(Fault::whole_file("import", "no file is given")));
    };
    let wanted = |name: &str| wishes.may_need(name, files.len());
    let mut timed: Vec<Timed> = Vec::new();
    for (place, file) in files.iter().enumerate() {
        let logs = format::read(&file.name, &file.bytes, &wanted)?;
        let tables = logs.into_iter().map(|log| with_clock(place, log, wishes)).collect::<Result<Vec<Timed>, Faults>>()?;
        timed.extend(base_first(tables, wishes));
    }
    let mut notes: Vec<String> = Vec::new();
    for it in &timed {
        if !it.log.notes.is_empty() {
            notes.push(format!("from {}: {}", it.log.file, it.log.notes.join("; ")));
        }
        notes.extend(it.clock.notes.iter().map(|note| format!("{}: {note}", it.log.file)));
    }
    let mut alignments = Vec::new();
    let of_first = timed.iter().filter(|it| it.file == 0).count();
    if of_first > 1 {
        notes.push(format!(
            "{}: {of_first} tables of one clock; the instants are those of the table of `{}`",
            first.name,
            timed[0].log.columns.iter().find(|column| column.name != timed[0].time).map_or("time", |column| &column.name)
        ));
    }
    for file in 1..files.len() {
        let found = alignment(&timed, file, wishes)?;
        notes.push(format!(
            "{}: clock aligned by `{}` and `{}` (correlation {:.3}): {} s +- {} s added at {} s, rate {:+.1} ppm +- {:.1} ppm (95 %)",
            found.file,
            found.first,
            found.second,
            found.correlation,
            short(found.offset),
            short(found.offset_half_width),
            short(found.middle),
            1e6 * found.rate,
            1e6 * found.rate_half_width
        ));
        for it in timed.iter_mut().filter(|it| it.file == file) {
            it.clock.times.iter_mut().for_each(|time| *time = found.to_first(*time));
        }
        alignments.push(found);
    }
    let clock = &timed[0].clock;
    let keeps_rows = clock.is_uniform && wishes.period.is_none_or(|period| (period / clock.period - 1.0).abs() < 1e-6);
    let period = match wishes.period {
        Some(period) if !(period.is_finite() && period > 0.0) => {
            return Err(Faults::one(Fault::whole_file(
                &first.name,
                format!("a period of {period} s: expected a number above 0"),
            )));
        }
        Some(period) => period,
        None if clock.is_uniform => clock.period,
        None => readable(clock.period),
    };
    let span = clock.times[clock.times.len() - 1] - clock.times[0];
    // Interpolated rows are limited to a thousand times the rows of the file, to limit the memory.
    if span / period > 1000.0 * clock.times.len() as f64 {
        let what = format!("a period of {period} s gives {:.0} rows for {} of the file", span / period, clock.times.len());
        return Err(Faults::one(Fault::whole_file(&first.name, what)));
    }
    let grid = if keeps_rows { clock.times.clone() } else { clock.grid(period) };
    let mut sampled = Vec::new();
    for chosen in chosen(&timed, wishes, &mut notes)? {
        sampled.push(on_grid(&chosen, (&grid, clock.period), wishes, &mut notes)?);
    }
    let is_resampled = !keeps_rows || sampled.iter().any(|(_, is_as_read)| !is_as_read);
    if is_resampled {
        notes.push(format!(
            "resampled to a period of {} s: values on the straight line between the samples around each instant, held columns from the sample before; no filter",
            decimal(period)
        ));
        if period > 1.5 * clock.period {
            notes.push(
                "the new period is longer than that of the file: frequencies above half the new rate alias to lower ones"
                    .to_string(),
            );
        }
    }
    let mut columns: Vec<Column> = sampled.into_iter().map(|(column, _)| column).collect();
    let time = whole_rows(&grid, &mut columns, &first.name, &mut notes)?;
    for constant in &wishes.constants {
        columns.push(constant_column(constant, time.len(), &columns, &first.name)?);
        notes.push(format!("`{}` is the constant {} in every row; no file has it", constant.name, constant.value));
    }
    Ok(Record { time, period, columns, is_resampled, alignments, notes })
}

/// The tables of a file, first the one with the most instants of those that have a wished column: it gives the instants of the record.
fn base_first(mut tables: Vec<Timed>, wishes: &Wishes) -> Vec<Timed> {
    let is_wished =
        |it: &Timed| wishes.columns.is_empty() || wishes.columns.iter().any(|wish| it.log.column(&wish.value).is_some());
    let rows = |k: &usize| (is_wished(&tables[*k]), tables[*k].clock.times.len(), std::cmp::Reverse(*k));
    if let Some(base) = (0..tables.len()).max_by_key(rows) {
        // What is said about the file comes first.
        let notes = std::mem::take(&mut tables[0].log.notes);
        tables.swap(0, base);
        tables[0].log.notes.splice(0..0, notes);
    }
    tables
}

/// Finds the time column and orders its instants.
fn with_clock(file: usize, mut log: Log, wishes: &Wishes) -> Result<Timed, Faults> {
    let fault = |what: String| Fault::whole_file(&log.file, what);
    let wish = match &wishes.time {
        Some(text) => Some(
            format!("time={text}")
                .parse::<Named>()
                .map_err(|_| Faults::one(fault(format!("found `{text}` for the time, expected COLUMN or COLUMN[unit]"))))?,
        ),
        None => None,
    };
    let found = match &wish {
        Some(wish) => Some(log.column(&wish.value).ok_or_else(|| {
            Faults::one(fault(format!("there is no column `{}` for the time; the columns are {}", wish.value, log.names())))
        })?),
        None => log.columns.iter().find(|column| {
            let name = column.name.to_lowercase();
            TIME.contains(&name.rsplit('.').next().unwrap_or(&name))
        }),
    };
    let Some(column) = found.cloned() else {
        let Some(period) = wishes.period else {
            let what = format!("no column is called time; the columns are {}", log.names());
            let help = "name it with --time COLUMN[unit], or give the period of uniform rows with --period";
            return Err(Faults::one(fault(what).help(help)));
        };
        let rows = log.columns.iter().map(|column| column.values.len()).max().unwrap_or(0);
        let times: Vec<f64> = (0..rows).map(|row| row as f64 * period).collect();
        log.notes.push(format!("no column of time: rows are {} s apart, from --period", decimal(period)));
        let clock = Clock::of(&times).map_err(|(_, what)| Faults::one(fault(what)))?;
        return Ok(Timed { file, log, clock, time: String::new() });
    };
    let unit = wish.and_then(|wish| wish.unit).or_else(|| column.unit.clone());
    let instants: Vec<f64> = if column.texts.is_empty() {
        let unit = unit.unwrap_or_else(|| {
            log.notes.push(format!("`{}` has no unit and is taken as seconds", column.name));
            "s".to_string()
        });
        let conversion =
            Conversion::between(&unit, "s").map_err(|what| Faults::one(fault(format!("`{}`: {what}", column.name))))?;
        column.values.iter().map(|value| conversion.apply(*value)).collect()
    } else {
        let instants: Vec<f64> = column.texts.iter().map(|text| crate::clock::instant(text).unwrap_or(f64::NAN)).collect();
        let Some(begin) = instants.iter().copied().find(|instant| instant.is_finite()) else {
            let found = column.texts.first().map_or("", String::as_str);
            return Err(Faults::one(fault(format!(
                "`{}`: found `{found}`, expected a number or a time such as 12:34:56.789",
                column.name
            ))));
        };
        log.notes.push(format!(
            "time counts from {}",
            column.texts.iter().find(|text| crate::clock::instant(text).is_some()).map_or("", String::as_str)
        ));
        through_midnight(&instants).iter().map(|instant| instant - begin).collect()
    };
    let other: Vec<String> =
        log.columns.iter().filter(|it| it.values.len() != instants.len()).map(|it| format!("`{}`", it.name)).collect();
    if !other.is_empty() {
        log.notes.push(format!(
            "left out, because they do not have the {} rows of `{}`: {}",
            instants.len(),
            column.name,
            other.join(", ")
        ));
        log.columns.retain(|it| it.values.len() == instants.len());
    }
    let clock = Clock::of(&instants).map_err(|(row, what)| {
        let line = row.and_then(|row| log.lines.get(row).copied()).unwrap_or(0);
        let what = format!("`{}`: {what}", column.name);
        Faults::one(if line > 0 { Fault::at_line(&log.file, line, 0, what) } else { fault(what) })
    })?;
    Ok(Timed { file, log, clock, time: column.name })
}

/// Times of day continue after midnight.
fn through_midnight(instants: &[f64]) -> Vec<f64> {
    let mut days = 0.0;
    let mut before = f64::NAN;
    instants
        .iter()
        .map(|instant| {
            // A step back of at least half a day is a new day; a smaller one means that the clock was set.
            if before - instant > 43200.0 && *instant < 86400.0 {
                days += 86400.0;
            }
            if instant.is_finite() {
                before = *instant;
            }
            instant + days
        })
        .collect()
}

fn samples(timed: &Timed, column: &Raw) -> Samples {
    let values: Vec<f64> = timed.clock.rows.iter().map(|row| column.values[*row]).collect();
    Samples::of(&timed.clock.times, &values)
}

/// The clock of another file, from the pair of columns that the user gives, or from the best pair of columns with the same name.
fn alignment(timed: &[Timed], file: usize, wishes: &Wishes) -> Result<Alignment, Faults> {
    let of = |file: usize| timed.iter().filter(move |it| it.file == file);
    let name = |file: usize| of(file).next().map_or("", |it| it.log.file.as_str());
    let fault = |what: String| Fault::whole_file(name(file), what);
    let numbers = |it: &Timed, column: &Raw| column.name != it.time && column.texts.is_empty();
    let column = |file: usize, wanted: &str| {
        let found = of(file).find_map(|it| it.log.column(wanted).filter(|it| it.texts.is_empty()).map(|column| (it, column)));
        found.ok_or_else(|| {
            let known: Vec<String> = of(file).map(|it| it.log.names()).collect();
            let what = format!("there is no column `{wanted}` to align by; the columns are {}", known.join("; "));
            Faults::one(Fault::whole_file(name(file), what))
        })
    };
    let help = "name a signal that both files have with --align FIRST=SECOND";
    let mut pairs: Vec<[(&Timed, &Raw); 2]> = Vec::new();
    match &wishes.align {
        Some(pair) => pairs.push([column(0, &pair.name)?, column(file, &pair.value)?]),
        None => {
            for (one, two) in of(0).flat_map(|one| of(file).map(move |two| (one, two))) {
                let known = one.log.columns.iter().filter(|column| numbers(one, column));
                pairs.extend(known.filter_map(|column| {
                    let is_same = |it: &&Raw| it.name.eq_ignore_ascii_case(&column.name) && numbers(two, it);
                    two.log.columns.iter().find(is_same).map(|other| [(one, column), (two, other)])
                }));
            }
        }
    }
    if pairs.is_empty() {
        let what = format!("its clock is not that of {}, and no column has one name in both", name(0));
        return Err(Faults::one(fault(what).help(help)));
    }
    let mut why = Vec::new();
    let mut found: Vec<Alignment> = Vec::new();
    for [(first, one), (second, two)] in pairs {
        match align(&samples(first, one), &samples(second, two)) {
            Ok(it) => {
                let file = second.log.file.clone();
                found.push(Alignment { file, first: one.name.clone(), second: two.name.clone(), ..it });
            }
            Err(what) => why.push(format!("`{}` and `{}`: {what}", one.name, two.name)),
        }
    }
    found.into_iter().min_by(|a, b| a.offset_half_width.total_cmp(&b.offset_half_width)).ok_or_else(|| {
        Faults::one(fault(format!("its clock cannot be aligned with that of {}: {}", name(0), why.join("; "))).help(help))
    })
}

/// A column of the record, with its source.
struct Chosen<'a> {
    timed: &'a Timed,
    column: &'a Raw,
    name: String,
    unit: Option<String>,
}

fn chosen<'a>(timed: &'a [Timed], wishes: &Wishes, notes: &mut Vec<String>) -> Result<Vec<Chosen<'a>>, Faults> {
    let mut all: Vec<Chosen<'a>> = Vec::new();
    if wishes.columns.is_empty() {
        for it in timed {
            for column in it.log.columns.iter().filter(|column| column.name != it.time) {
                if !column.texts.is_empty() {
                    notes.push(format!("{}: `{}` contains text and is left out", it.log.file, column.name));
                    continue;
                }
                let mut name = column.name.clone();
                let mut number = 2;
                while name == "time" || all.iter().any(|other| other.name == name) {
                    name = format!("{}_{number}", column.name);
                    number += 1;
                }
                if name != column.name {
                    notes.push(format!(
                        "{}: `{}` is called `{name}`, because the name is already in use",
                        it.log.file, column.name
                    ));
                }
                all.push(Chosen { timed: it, column, name, unit: column.unit.clone() });
            }
        }
    }
    for wish in &wishes.columns {
        let found = timed.iter().find_map(|it| it.log.column(&wish.value).map(|column| (it, column)));
        let Some((it, column)) = found else {
            let known: Vec<String> = timed.iter().map(|it| format!("{}: {}", it.log.file, it.log.names())).collect();
            let what = format!("there is no column `{}`; the columns are {}", wish.value, known.join("; "));
            return Err(Faults::one(Fault::whole_file(&timed[0].log.file, what)));
        };
        if !column.texts.is_empty() {
            let what = format!("`{}`: found text such as `{}`, expected numbers", column.name, column.texts[0]);
            return Err(Faults::one(Fault::whole_file(&it.log.file, what)));
        }
        if wish.name == "time" || all.iter().any(|other| other.name == wish.name) {
            let what = format!("found the name `{}` for two columns, expected different names", wish.name);
            return Err(Faults::one(Fault::whole_file(&it.log.file, what)));
        }
        all.push(Chosen {
            timed: it,
            column,
            name: wish.name.clone(),
            unit: wish.unit.clone().or_else(|| column.unit.clone()),
        });
    }
    if all.is_empty() {
        return Err(Faults::one(Fault::whole_file(&timed[0].log.file, "there is no column of numbers beside the time")));
    }
    Ok(all)
}

/// A column at the times of the record, and whether its numbers are unchanged.
fn on_grid(
    chosen: &Chosen<'_>,
    (grid, period): (&[f64], f64),
    wishes: &Wishes,
    notes: &mut Vec<String>,
) -> Result<(Column, bool), Faults> {
    let file = &chosen.timed.log.file;
    let clock = &chosen.timed.clock;
    let is_as_read = clock.times == grid && clock.rows.iter().all(|row| !chosen.column.values[*row].is_nan());
    let mut values: Vec<f64> = if is_as_read {
        clock.rows.iter().map(|row| chosen.column.values[*row]).collect()
    } else {
        let samples = samples(chosen.timed, chosen.column);
        let is_wished = wishes.hold.contains(&chosen.name);
        let holds = is_wished || samples.is_in_steps();
        if holds && !is_wished {
            notes.push(format!("`{}` steps between a few whole numbers and holds its value between samples", chosen.name));
        }
        if samples.usual() > 1.5 * period {
            notes.push(format!("`{}` is sampled every {} s only", chosen.name, short(samples.usual())));
        }
        grid.iter().map(|instant| samples.at(*instant, holds)).collect()
    };
    if let (Some(from), Some(to)) = (&chosen.column.unit, &chosen.unit) {
        if from != to {
            let conversion = Conversion::between(from, to)
                .map_err(|what| Faults::one(Fault::whole_file(file, format!("`{}`: {what}", chosen.column.name))))?;
            values.iter_mut().for_each(|value| *value = conversion.apply(*value));
            notes.push(format!("`{}` is converted from {from} to {to}", chosen.name));
        }
    } else if chosen.unit.is_none() {
        notes
            .push(format!("`{}` has no unit: give it with --column {}={}[unit]", chosen.name, chosen.name, chosen.column.name));
    }
    let from = format!("{file}: {}", chosen.column.name);
    Ok((Column { name: chosen.name.clone(), unit: chosen.unit.clone(), values, from }, is_as_read))
}

/// Leaves out the rows in which a column has no value.
fn whole_rows(grid: &[f64], columns: &mut [Column], file: &str, notes: &mut Vec<String>) -> Result<Vec<f64>, Faults> {
    let whole: Vec<bool> = (0..grid.len()).map(|row| columns.iter().all(|column| !column.values[row].is_nan())).collect();
    let kept = whole.iter().filter(|is| **is).count();
    if 2 * kept < grid.len() || kept < 3 {
        let missing = |column: &Column| column.values.iter().filter(|value| value.is_nan()).count();
        let worst = columns.iter().max_by_key(|column| missing(column));
        let (name, count) = worst.map_or((String::new(), 0), |column| (column.from.clone(), missing(column)));
        let what = format!("{kept} of {} rows have a value in every column; `{name}` has none in {count} of them", grid.len());
        let help = "choose the columns that belong together with --column NAME=COLUMN";
        return Err(Faults::one(Fault::whole_file(file, what).help(help)));
    }
    if kept < grid.len() {
        notes.push(format!("{} rows in which a column has no value are left out", grid.len() - kept));
        for column in columns {
            let mut flags = whole.iter();
            column.values.retain(|_| flags.next().copied().unwrap_or(false));
        }
    }
    Ok(grid.iter().zip(&whole).filter(|(_, is)| **is).map(|(time, _)| *time).collect())
}

fn constant_column(constant: &Named, rows: usize, others: &[Column], file: &str) -> Result<Column, Faults> {
    let fault = |what: String| Faults::one(Fault::whole_file(file, what));
    let value = constant.value.parse::<f64>().ok().filter(|value| value.is_finite());
    let value =
        value.ok_or_else(|| fault(format!("--constant {}: found `{}`, expected a number", constant.name, constant.value)))?;
    let Some(unit) = &constant.unit else {
        return Err(fault(format!("--constant {}: write its unit, {}={}[unit]", constant.name, constant.name, constant.value)));
    };
    rsm_fit::units::check(unit).map_err(|what| fault(format!("--constant {}: {what}", constant.name)))?;
    if constant.name == "time" || others.iter().any(|other| other.name == constant.name) {
        return Err(fault(format!("--constant {}: the record has a column of this name", constant.name)));
    }
    Ok(Column {
        name: constant.name.clone(),
        unit: Some(unit.clone()),
        values: vec![value; rows],
        from: "constant".to_string(),
    })
}

//! A surface follows measured rows: the emitted update step, run by the interpreter.
//!
//! In: a checked model, a surface of it, settings, and tables of rows in the order of time. Out: a [`Tracked`] report and the model with the adapted
//! coefficients. The step is that of `rsm emit --recursive`, bit for bit ([`rsm_core::lower::recursive`]). A missing cell is a sample that is not
//! finite: the step is frozen.

use rsm_core::check::Checked;
use rsm_core::lower::{self, Follower, Frozen, Recursive};
use rsm_core::model::{Evidence, Model};
use rsm_core::number::Precision;
use rsm_core::run::{Interpreter, Scalar};
use rsm_core::source::{Collector, Fault, Faults, Source};
use serde::Serialize;

use crate::evidence::{file_of, residual_sd_of, whole};
use crate::missing::MissingAs;
use crate::table::{Table, Wanted};

/// The data are reported in this number of parts.
const PARTS: usize = 4;

/// What is run.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// The surface, by its index in the model.
    pub surface: usize,
    /// The settings of the update.
    pub settings: Recursive,
    /// The precision of the update, that of the target.
    pub precision: Precision,
}

/// The result of a run over measured rows.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tracked {
    /// The surface.
    pub surface: String,
    /// Its unit: that of the measured response, of errors and of coefficients.
    pub unit: String,
    /// The number of rows.
    pub rows: usize,
    /// The number of rows that were used.
    pub used: usize,
    /// The number of rows that changed nothing, by reason.
    pub frozen: FrozenRows,
    /// The longest run of rows without a used one between, all of them beyond the gate or with other frozen rows between.
    pub longest_beyond_gate: Option<Run>,
    /// The root mean square of the errors before each update, each divided by its standard deviation: 1 if the noise is as given. Of used rows.
    pub error_ratio: Option<f64>,
    /// Errors of the prediction before each update, by parts of the data in the order of time.
    pub parts: Vec<Part>,
    /// The coefficients before and after.
    pub coefficients: Vec<Moved>,
}

/// The number of frozen rows by reason.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct FrozenRows {
    /// A number is missing, NaN or infinite.
    pub not_finite: usize,
    /// Outside the range of an input or the support of the surface.
    pub outside: usize,
    /// The error is above the gate.
    pub beyond_gate: usize,
    /// A next state would not be finite.
    pub state: usize,
}

/// Rows one after another.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Run {
    /// The number of rows beyond the gate.
    pub rows: usize,
    /// The file of the first.
    pub file: String,
    /// The line of the first.
    pub line: usize,
}

/// A part of the data.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Part {
    /// The number of rows.
    pub rows: usize,
    /// The number of used rows; the errors are those of these rows.
    pub used: usize,
    /// The root mean square of the measured response minus the prediction of the coefficients before the update.
    pub rmse: Option<f64>,
    /// The same for the coefficients of the model file, which stay as they are.
    pub rmse_of_file: Option<f64>,
}

/// A coefficient before and after.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Moved {
    /// The term.
    pub term: String,
    /// Its powers.
    pub powers: Vec<u32>,
    /// In the model file.
    pub before: f64,
    /// After the last row.
    pub after: f64,
    /// The standard deviation of `after` in the filter, which expects that the surface changes. If it does not change, that of `after` is smaller, by
    /// sqrt(1 + lambda): weights lambda^age give the variance P (sum lambda^(2 age) phi phi') P, which is P/(1 + lambda) for even excitation.
    pub standard_error: f64,
}

/// The rows of all tables.
#[derive(Debug, Default)]
struct Rows {
    /// Inputs, then the response, in the units of the model.
    values: Vec<Vec<f64>>,
    /// The file and the line of each row.
    places: Vec<(String, usize)>,
}

/// Sums of squares of a part.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    rows: usize,
    used: usize,
    square: f64,
    square_of_file: f64,
}

impl Track {
    /// The noise that a model file gives for a surface: `residual_sd` in its evidence.
    #[must_use]
    pub fn noise_of_file(checked: &Checked, surface: usize) -> Option<f64> {
        residual_sd_of(&checked.model().surfaces[surface])
    }

    /// Runs the update over all rows, the tables in their order.
    ///
    /// # Errors
    /// Every fault of the tables; settings that do not suit; a precision that cannot hold the model.
    ///
    /// ```
    /// use rsm_core::{check::Checked, lower::Recursive, number::Precision, source::Source};
    /// use rsm_fit::track::Track;
    ///
    /// let text = "format = 1\nmodel = \"car\"\n[inputs.speed]\nunit = \"m/s\"\nrange = [0.0, 30.0]\n[surfaces.drag]\nunit = \"N\"\n\
    ///     inputs = [\"speed\"]\nterms = [{ powers = [0], coefficient = 35.0 }, { powers = [1], coefficient = 30.0 }]\n";
    /// let checked = Checked::read(&Source::new("car.toml", text))?;
    /// let rows: String = (0..200).map(|k| format!("{},{}\n", k % 30, 9 + 2 * (k % 30))).collect();
    /// let data = Source::new("day.csv", format!("speed[m/s],drag[N]\n{rows}"));
    /// let track = Track { surface: 0, settings: Recursive::new(1.0), precision: Precision::F64 };
    /// let (found, model) = track.run(&checked, &[data])?;
    /// assert_eq!((found.rows, found.used), (200, 200));
    /// assert!((model.surfaces[0].terms[0].coefficient - 39.0).abs() < 0.1); // 4 N more at every speed
    /// # Ok::<(), rsm_core::source::Faults>(())
    /// ```
    pub fn run(&self, checked: &Checked, data: &[Source]) -> Result<(Tracked, Model), Faults> {
        let surface = &checked.model().surfaces[self.surface];
        if let Some(why) = self.settings.refusal(surface) {
            let what = format!("surface `{}` cannot be updated: {why}", surface.name);
            return Err(Faults::one(Fault::whole_file(checked.file(), what)));
        }
        if let Some(faults) = checked.refusal(self.precision) {
            return Err(faults);
        }
        let rows = self.rows(checked, data)?;
        let follower = lower::recursive(checked, self.surface, self.precision, &self.settings);
        let (tracked, states) = match self.precision {
            Precision::F64 => self.run_in(checked, &follower, &rows, |value| value),
            Precision::F32 => self.run_in(checked, &follower, &rows, |value| value as f32),
        };
        let mut model = checked.model().clone();
        let surface = &mut model.surfaces[self.surface];
        surface.terms.iter_mut().zip(&states).for_each(|(term, state)| term.coefficient = *state);
        surface.evidence = self.evidence(&tracked, data);
        // Coefficients that no file may have, such as those of a compensator that is then outside its range, are told here.
        Checked::from_model(&model)?;
        Ok((tracked, model))
    }

    fn rows(&self, checked: &Checked, data: &[Source]) -> Result<Rows, Faults> {
        let surface = &checked.model().surfaces[self.surface];
        let inputs = checked.inputs_of(surface);
        let mut faults = Collector::new();
        let mut rows = Rows::default();
        let units: Vec<(&str, &str)> = inputs
            .iter()
            .map(|input| (input.name.as_str(), input.unit.as_str()))
            .chain([(surface.name.as_str(), surface.unit.as_str())])
            .collect();
        for source in data {
            let numbers = units.iter().map(|(name, _)| (*name).to_string()).collect();
            let wanted = Wanted { numbers, missing: MissingAs::Nan, ..Wanted::default() };
            let table = match Table::read(source, &wanted) {
                Ok(table) => table,
                Err(found) => {
                    found.list().iter().for_each(|fault| faults.push(fault.clone()));
                    continue;
                }
            };
            let mut columns = vec![];
            for (name, unit) in &units {
                match table.values_in(name, Some(unit)) {
                    Ok((values, _)) => columns.push(values),
                    Err(fault) => faults.push(fault),
                }
            }
            if columns.len() == units.len() {
                rows.values.extend((0..table.rows()).map(|row| columns.iter().map(|column| column[row]).collect::<Vec<f64>>()));
                rows.places.extend(table.lines.iter().map(|line| (table.file.clone(), *line)));
            }
        }
        faults.finish(Some(rows))
    }

    fn run_in<T: Scalar + Into<f64>>(
        &self,
        checked: &Checked,
        follower: &Follower,
        rows: &Rows,
        number: impl Fn(f64) -> T,
    ) -> (Tracked, Vec<f64>) {
        let surface = &checked.model().surfaces[self.surface];
        let terms = surface.terms.len();
        let start: Vec<T> = follower.start.iter().map(|state| number(*state)).collect();
        let mut update = Interpreter::<T>::new(&follower.update);
        update.set_states(&start);
        // It begins every step from the start: the surface of the file.
        let mut of_file = Interpreter::<T>::new(&follower.update);
        let mut frozen = FrozenRows::default();
        let mut sums = [Sums::default(); PARTS];
        let mut ratio = 0.0;
        let (mut run, mut longest): (Option<Run>, Option<Run>) = (None, None);
        for (k, row) in rows.values.iter().enumerate() {
            let at: Vec<T> = row.iter().map(|value| number(*value)).collect();
            of_file.set_states(&start);
            let error_of_file: f64 = of_file.step(&at).into();
            update.step(&at);
            let results: Vec<f64> = update.results().map(Into::into).collect();
            let [error, variance, reason] = results[..] else { panic!("an update has three results") };
            // In 128 bits, because k PARTS may exceed a small usize.
            let part = &mut sums[(k as u128 * PARTS as u128 / rows.values.len() as u128) as usize];
            part.rows += 1;
            match Frozen::of_number(reason) {
                None => {
                    part.used += 1;
                    part.square += error * error;
                    part.square_of_file += error_of_file * error_of_file;
                    ratio += error * error / variance;
                    run = None;
                }
                Some(Frozen::NotFinite) => frozen.not_finite += 1,
                Some(Frozen::Outside) => frozen.outside += 1,
                Some(Frozen::State) => frozen.state += 1,
                Some(Frozen::Error) => {
                    frozen.beyond_gate += 1;
                    let (file, line) = &rows.places[k];
                    let run = run.get_or_insert_with(|| Run { rows: 0, file: file.clone(), line: *line });
                    run.rows += 1;
                    if longest.as_ref().is_none_or(|longest| longest.rows < run.rows) {
                        longest = Some(run.clone());
                    }
                }
            }
        }
        let used = sums.iter().map(|part| part.used).sum::<usize>();
        let rms = |square: f64, count: usize| (count > 0).then(|| (square / count as f64).sqrt());
        let states: Vec<f64> = update.states().iter().map(|state| (*state).into()).collect();
        let variances = lower::variances_of(&states, terms);
        let moved = surface.terms.iter().zip(&states).zip(&variances).map(|((term, after), variance)| Moved {
            term: surface.term_name(&term.powers),
            powers: term.powers.clone(),
            before: term.coefficient,
            after: *after,
            standard_error: self.settings.noise * variance.sqrt(),
        });
        let part = |sums: &Sums| Part {
            rows: sums.rows,
            used: sums.used,
            rmse: rms(sums.square, sums.used),
            rmse_of_file: rms(sums.square_of_file, sums.used),
        };
        let tracked = Tracked {
            surface: surface.name.clone(),
            unit: surface.unit.clone(),
            rows: rows.values.len(),
            used,
            frozen,
            longest_beyond_gate: longest,
            error_ratio: rms(ratio, used).map(|ratio| ratio / self.settings.noise),
            parts: sums.iter().filter(|part| part.rows > 0).map(part).collect(),
            coefficients: moved.collect(),
        };
        (tracked, states)
    }

    /// The evidence of the adapted surface. That of the fit was about other coefficients.
    fn evidence(&self, tracked: &Tracked, data: &[Source]) -> Vec<(String, Evidence)> {
        let Recursive { forgetting, noise, gate, limit, start } = self.settings;
        let mut evidence = vec![
            ("method", Evidence::Text("recursive least squares from the coefficients of another file".to_string())),
            ("rows", whole(tracked.used)),
            ("rows_frozen", whole(tracked.rows - tracked.used)),
            ("data", Evidence::List(data.iter().map(file_of).collect())),
            ("forgetting", Evidence::Number(forgetting)),
            ("gate", Evidence::Number(gate)),
            ("limit", Evidence::Number(limit)),
            ("start", Evidence::Number(start)),
        ];
        // A later run over further rows takes its noise from here.
        evidence.push(("residual_sd", Evidence::Number(tracked.error_ratio.map_or(noise, |ratio| ratio * noise))));
        evidence.into_iter().map(|(name, value)| (name.to_string(), value)).collect()
    }
}

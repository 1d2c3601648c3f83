//! The plant file of format 2: a model text with equations, and the values of one particular plant.
//!
//! In: a [`Source`] and a function that opens the files it names. Out: [`EquationFile`], or every fault with line, column and the accepted names.
//!
//! ```toml
//! format = 2
//! model = "axis.mo"             # or "axis.mo#Axis", where the text holds several, or "rsm:pmac", a shipped text
//! effect_files = ["bell.toml"]  # files of effects that are added to the catalogue
//! [parameters]                  # values in place of those of the text, in its units
//! mass = 95.1
//! [tolerance]                   # relative standard deviations
//! viscous_friction = 0.1
//! [noise]                       # standard deviations of the outputs
//! position = 1e-6
//! [initial]                     # states, outputs, or parameters on which only the start depends
//! speed = 0.0
//! [columns]                     # signals that a record calls otherwise
//! position = { name = "x", unit = "m" }
//! [functions]                   # functions that the text declares without an algorithm
//! engine_map = { model = "engine.toml", surface = "torque" }
//! ```
//!
//! Sites, effects and the rules of `[record]`: [`super::extended`]. `[configurations]`: [`crate::configurations`].

use std::sync::Arc;

use rsm_core::source::{Collector, Faults, Source};
use rsm_core::toml_reader::{TableReader, parse};
use rsm_fit::table::{Table, Wanted};
use rsm_model::effects::{Catalogue, Delay, LateReading, Places, Proposal, Room, Site, extend, propose, rooms, sites_of};
use rsm_model::expression::Symbol;
use rsm_model::flat::{Basic, Flat, Options, Role};
use rsm_model::system::System;

use super::effect_files;
pub use super::extended::NamedValue;
use super::extended::{self, Entry, RecordValues, Rules};
use super::start_parameters::start_parameters;
pub use super::tables::{Column, Function};
use super::tables::{Named, check, columns, functions, numbers, unknown};
use crate::configurations::{self, Configurations, Settable};
use crate::quantity::Bound;

/// A plant file of format 2 with its text, read and sorted.
#[derive(Debug, Clone)]
pub struct EquationFile {
    /// The name of the plant file in messages.
    pub file: String,
    /// The equations, with the parameters and effects of this file.
    pub system: System,
    /// `[parameters]`.
    pub parameters: Vec<NamedValue>,
    /// `[tolerance]`: relative standard deviations of parameters.
    pub tolerance: Vec<NamedValue>,
    /// `[noise]`: standard deviations of outputs.
    pub noise: Vec<NamedValue>,
    /// `[initial]`: values at the start.
    pub initial: Vec<NamedValue>,
    /// `[columns]`.
    pub columns: Vec<Column>,
    /// `[functions]`, in the order in which the text calls them.
    pub functions: Vec<Function>,
    /// `[sites]`: those of the file, and the built-in sites of a shipped text.
    pub sites: Vec<Site>,
    /// `[[effects]]`.
    pub effects: Vec<Entry>,
    /// `[record]`.
    pub rules: Rules,
    /// `[configurations]`.
    pub configurations: Configurations,
    /// The index of the configuration whose values the equations have. Without one, the equations have the values of `[parameters]`, and an effect
    /// with numbers by configuration does not act.
    pub configuration: Option<usize>,
    /// Signals that effects delay.
    pub(super) delays: Vec<Delay>,
    /// Outputs that effects read with a delay.
    pub(super) late_readings: Vec<LateReading>,
    /// Outputs whose first reading is used as the reading of another variable.
    pub(super) read_of: Vec<(Symbol, Symbol)>,
    /// The place of each effect, and the parameters that hold its numbers.
    pub(super) placed: Vec<(String, Vec<(String, Symbol)>)>,
    /// Values that the record determines.
    pub(super) record_values: RecordValues,
    /// The equations without effects.
    plain: Flat,
    origin: Origin,
}

/// The inputs from which a file is rebuilt if a record determines a parameter, or if an effect is added.
#[derive(Debug, Clone)]
struct Origin {
    source: Source,
    text: Source,
    model: Option<String>,
    catalogue: Arc<Catalogue>,
}

/// The format number of a plant file, if it can be read: 1 for a built-in plant, 2 for a text of equations.
#[must_use]
pub fn format(source: &Source) -> Option<i64> {
    let document = parse(source, &mut Collector::new())?;
    let value = document.get_ref().get("format")?;
    value.get_ref().as_integer().and_then(|number| i64::from_str_radix(number.as_str(), number.radix()).ok())
}

/// Whether a file has the key `plant`, which names a plant of format 1. A model of surfaces has none.
#[must_use]
pub fn names_a_plant(source: &Source) -> bool {
    parse(source, &mut Collector::new()).is_some_and(|document| document.get_ref().get("plant").is_some())
}

impl EquationFile {
    /// Reads a plant file. `open` returns the text of a file that it names, relative to the folder of the plant file.
    ///
    /// # Errors
    /// Every fault of the plant file; the faults of the text or of a surface.
    pub fn read(source: &Source, open: &dyn Fn(&str) -> Result<Source, Faults>) -> Result<EquationFile, Faults> {
        Self::read_with(source, open, &Arc::new(Catalogue::shipped()))
    }

    /// The same with another catalogue of effects, for example the shipped one with the user's own effects added.
    ///
    /// # Errors
    /// Those of [`EquationFile::read`].
    pub fn read_with(
        source: &Source,
        open: &dyn Fn(&str) -> Result<Source, Faults>,
        catalogue: &Arc<Catalogue>,
    ) -> Result<EquationFile, Faults> {
        let mut faults = Collector::new();
        let Some(document) = parse(source, &mut faults) else { return faults.finish(None) };
        let mut top = TableReader::document(source, &document);
        if let Some(value) = top.required("format", &mut faults) {
            top.whole("`format`", value, 2, 2, &mut faults);
        }
        let model = top.text("model", &mut faults);
        let mut parameters = numbers(&mut top, "parameters", true, &mut faults);
        let tolerance = numbers(&mut top, "tolerance", false, &mut faults);
        let noise = numbers(&mut top, "noise", false, &mut faults);
        let mut initial = numbers(&mut top, "initial", true, &mut faults);
        let columns = columns(&mut top, &mut faults);
        let functions = functions(&mut top, &mut faults);
        let effect_files = effect_files::read(&mut top, &mut faults);
        let own_sites = match top.optional("sites") {
            Some(value) => Site::read_all(source, value, &mut faults),
            None => Vec::new(),
        };
        let effects = extended::effects(&mut top, &mut faults);
        let rules = extended::rules(&mut top, &mut faults);
        let by_configuration = configurations::read(&mut top, &mut faults);
        top.finish(&mut faults);
        let Some(model) = faults.finish(Some(model))? else { unreachable!("a missing model is a fault") };
        let catalogue = &effect_files::added(catalogue, &effect_files, open)?;
        let (file, name) = model.split_once('#').map_or((model.as_str(), None), |(file, name)| (file, Some(name.to_string())));
        let text = match file.strip_prefix("rsm:") {
            None => open(file)?,
            Some(name) => rsm_model::shipped::text(name).ok_or_else(|| {
                let names: Vec<String> = rsm_model::shipped::names().map(|it| format!("`rsm:{it}`")).collect();
                let what = format!("`model`: no plant `{name}` is shipped");
                Faults::one(source.fault(document.span(), what).help(format!("shipped are {}", names.join(", "))))
            })?,
        };
        let options = Options { model: name.clone(), parameters: Vec::new() };
        let mut faults = Collector::new();
        let plain = Flat::read(&text, &options)?;
        let known = |wanted: &dyn Fn(&rsm_model::flat::Variable) -> bool| -> Vec<String> {
            plain.symbols().map(|it| plain.variable(it)).filter(|it| wanted(it)).map(|it| it.name.clone()).collect()
        };
        let is_parameter = |it: &rsm_model::flat::Variable| it.role == Role::Parameter;
        let names = known(&is_parameter);
        check(source, "parameters", &parameters, &names, "parameter", &mut faults);
        check(source, "tolerance", &tolerance, &names, "parameter", &mut faults);
        let outputs = known(&|it| it.is_output);
        check(source, "noise", &noise, &outputs, "output", &mut faults);
        for rule in &rules.parameters {
            unknown(source, "record", &rule.parameter, &rule.place, &names, "parameter", &mut faults);
        }
        let of_start: Vec<&String> = start_parameters(&plain).into_iter().map(|it| &plain.variable(it).name).collect();
        let (at_start, states) = initial.into_iter().partition(|it| of_start.contains(&&it.given.name));
        initial = states;
        for it in at_start {
            parameters.retain(|own| own.given.name != it.given.name);
            parameters.push(it);
        }
        let mut free = known(&|it| it.role == Role::Unknown && it.basic == Basic::Real);
        free.extend(of_start.iter().map(|it| (*it).clone()));
        check(source, "initial", &initial, &free, "variable", &mut faults);
        let tolerated: Vec<&str> = tolerance.iter().map(|it| it.given.name.as_str()).collect();
        let is_decided = |name: &str| is_of_record(name) || rules.parameters.iter().any(|it| it.parameter == name);
        let configurations = by_configuration.map_or_else(Configurations::default, |it| {
            it.checked(source, &settable(&plain, &|name| !is_decided(name)), &tolerated, &mut faults)
        });
        extended::known_configurations(source, &effects, &configurations, &mut faults);
        let signals = known(&|it| it.is_output || it.role == Role::Input);
        for (column, place) in &columns {
            unknown(source, "columns", &column.signal, place, &signals, "input or output", &mut faults);
        }
        let declared: Vec<String> = plain.surfaces.iter().map(|it| it.name.clone()).collect();
        for it in &functions {
            unknown(source, "functions", &it.name, &it.place, &declared, "function without an algorithm", &mut faults);
        }
        for surface in &plain.surfaces {
            if !functions.iter().any(|it| it.name == surface.name) {
                let what = format!("the function `{}` has no algorithm, and [functions] does not name it", surface.name);
                let help = format!("write `{} = {{ model = \"FILE\", surface = \"NAME\" }}` under [functions]", surface.name);
                faults.push(source.fault(document.span(), what).help(help));
            }
        }
        faults.finish(Some(()))?;
        let functions = plain
            .surfaces
            .iter()
            .filter_map(|surface| functions.iter().find(|it| it.name == surface.name).map(|it| (surface, it)))
            .map(|(surface, it)| it.read(surface, source, open))
            .collect::<Result<Vec<Function>, Faults>>()?;
        let plain_numbers = |list: Vec<Named>| -> Vec<NamedValue> { list.into_iter().map(|it| it.given).collect() };
        let is_shipped = file.starts_with("rsm:");
        let mut sites = if is_shipped { sites_of(&plain.name) } else { Vec::new() };
        sites.retain(|it| !own_sites.iter().any(|own| own.name == it.name));
        sites.extend(own_sites);
        let mut rules = rules;
        if is_shipped {
            let shipped = shipped_rules(&plain.name);
            rules.parameters.extend(
                shipped
                    .parameters
                    .into_iter()
                    .filter(|it| !rules.parameters.iter().any(|own| own.parameter == it.parameter))
                    .collect::<Vec<_>>(),
            );
            if rules.start.is_empty() {
                rules.start = shipped.start;
            }
        }
        let parts = EquationFile {
            file: source.name().to_string(),
            system: System::new(&Flat::read(&Source::new("", "model None\nend None;\n"), &Options::default())?)?,
            parameters: plain_numbers(parameters),
            tolerance: plain_numbers(tolerance),
            noise: plain_numbers(noise),
            initial: plain_numbers(initial),
            columns: columns.into_iter().map(|it| it.0).collect(),
            functions,
            sites,
            effects,
            rules,
            configurations,
            configuration: None,
            delays: Vec::new(),
            late_readings: Vec::new(),
            read_of: Vec::new(),
            placed: Vec::new(),
            record_values: RecordValues::default(),
            plain,
            origin: Origin { source: source.clone(), text, model: name, catalogue: catalogue.clone() },
        };
        parts.probed()?.built()
    }

    /// Reports faults of effects in the configurations in which they act.
    fn probed(self) -> Result<EquationFile, Faults> {
        for place in 0..self.configurations.list.len() {
            let file = EquationFile { configuration: Some(place), ..self.clone() };
            if file.effects.iter().any(Entry::differs) {
                file.built()?;
            }
        }
        Ok(self)
    }

    /// The file with the values of a configuration.
    ///
    /// # Errors
    /// An unknown name.
    pub fn in_configuration(&self, name: &str) -> Result<EquationFile, Faults> {
        let place = self.configurations.of_name(name).map_err(Faults::one)?;
        EquationFile { configuration: Some(place), ..self.clone() }.built()
    }

    /// The name of the configuration whose values the equations have.
    fn configuration_name(&self) -> Option<&str> {
        self.configuration.map(|place| self.configurations.list[place].name.as_str())
    }

    /// The effects that act in the configuration, with its numbers.
    #[must_use]
    pub fn acting(&self) -> Vec<Entry> {
        self.effects.iter().filter_map(|it| it.in_configuration(self.configuration_name())).collect()
    }

    /// Builds the equations again, from the text, its parameters, the values that a record determines, and the effects.
    fn built(mut self) -> Result<EquationFile, Faults> {
        let mut parameters: Vec<(String, f64)> = self.parameters.iter().map(|it| (it.name.clone(), it.value)).collect();
        if let Some(own) = self.configuration.map(|place| &self.configurations.list[place].parameters) {
            parameters.retain(|it| !own.iter().any(|own| own.0 == it.0));
            parameters.extend(own.iter().cloned());
        }
        for (name, value) in &self.record_values.parameters {
            parameters.retain(|it| it.0 != *name);
            parameters.push((name.clone(), *value));
        }
        let Origin { source, text, model, catalogue } = &self.origin;
        let flat = Flat::read(text, &Options { model: model.clone(), parameters })?;
        self.plain = flat.clone();
        let acting = self.acting();
        if acting.is_empty() && self.sites.is_empty() {
            self.system = System::new(&flat)?;
            return Ok(self);
        }
        let placed = extended::placed(source, &acting, catalogue)?;
        let extended = extend(&flat, &self.sites, &placed)?;
        self.system = System::new(&extended.flat)?;
        self.delays = extended.delays;
        self.late_readings = extended.late_readings;
        self.read_of = extended.read_of;
        self.placed = extended.placed;
        Ok(self)
    }

    /// The file with more effects, after its own.
    ///
    /// # Errors
    /// An effect that is not possible at its place.
    pub fn with_effects(&self, more: &[Entry]) -> Result<EquationFile, Faults> {
        let mut file = self.clone();
        file.effects.extend_from_slice(more);
        file.built()
    }

    /// The file with the values that a record determines. These are parameters set by a column or by the absence of columns (`[record]`), and the
    /// sample period and first instant, if the text has the parameters `record_period` and `record_start`.
    ///
    /// # Errors
    /// A column that is not constant; a file that is not a record.
    pub fn of_record(&self, record: &Source) -> Result<EquationFile, Faults> {
        let configuration = self.configurations.of_record(record.name()).map_err(Faults::one)?;
        if configuration == self.configuration {
            return self.of_table(&|wanted| Table::read(record, wanted));
        }
        EquationFile { configuration, ..self.clone() }.built()?.of_table(&|wanted| Table::read(record, wanted))
    }

    /// The same for columns in memory.
    ///
    /// # Errors
    /// Those of [`EquationFile::of_record`].
    pub fn of_columns(&self, columns: &[(&str, &[f64])]) -> Result<EquationFile, Faults> {
        self.of_table(&|wanted| Table::in_memory("record in memory", columns, wanted))
    }

    fn of_table(&self, open: &dyn Fn(&Wanted) -> Result<Table, Faults>) -> Result<EquationFile, Faults> {
        let mut record_values = self.rules.record_values(open, &|it| self.column(it).0.to_string())?;
        let flat = self.system.flat();
        let asks = |name: &str| {
            let is_given = self.parameters.iter().any(|it| it.name == name);
            !is_given && flat.find(name).is_some_and(|it| flat.variable(it).role == Role::Parameter)
        };
        if asks(PERIOD) || asks(BEGIN) {
            let name = self.column("time").0.to_string();
            let table = open(&Wanted { numbers: vec![name.clone()], ..Wanted::default() })?;
            let time = match table.column(&name) {
                Some(column) if column.unit.is_some() => table.values_in(&name, Some("s")).map_err(Faults::one)?.0,
                Some(column) => column.values.clone(),
                None => Vec::new(),
            };
            if let [first, .., last] = time[..] {
                let period = (last - first) / (time.len() - 1) as f64;
                let both = [(PERIOD, period), (BEGIN, first)].into_iter().filter(|it| asks(it.0));
                record_values.parameters.extend(both.map(|(name, value)| (name.to_string(), value)));
            }
        }
        if record_values == self.record_values {
            return Ok(self.clone());
        }
        let mut file = self.clone();
        file.record_values = record_values;
        file.built()
    }

    /// The file with other parameter values, more effects after its own, and parameter values determined by a record.
    ///
    /// # Errors
    /// An effect that is not possible at its place.
    pub fn with(&self, parameters: &[NamedValue], effects: &[Entry], record: &[NamedValue]) -> Result<EquationFile, Faults> {
        let mut file = self.clone();
        file.parameters.retain(|own| !parameters.iter().any(|it| it.name == own.name));
        file.parameters.extend_from_slice(parameters);
        file.effects.extend_from_slice(effects);
        let known = |name: &str| {
            let flat = self.system.flat();
            flat.find(name).is_some_and(|it| flat.variable(it).role == Role::Parameter)
        };
        let record_values =
            record.iter().filter(|it| known(&it.name) && !self.parameters.iter().any(|own| own.name == it.name));
        file.record_values.parameters = record_values.map(|it| (it.name.clone(), it.value)).collect();
        file.built()
    }

    /// The file without its effects.
    ///
    /// # Errors
    /// Faults of the text.
    pub fn without_effects(&self) -> Result<EquationFile, Faults> {
        let mut file = self.clone();
        file.effects.clear();
        (file.delays, file.late_readings, file.read_of, file.placed) = Default::default();
        file.built()
    }

    /// The places where effects are possible, and the effects of the file's catalogue that are possible there.
    ///
    /// # Errors
    /// Sites that do not agree with the equations.
    pub fn places_of_effects(&self) -> Result<Places, Faults> {
        Places::of(&self.plain, &self.sites, &self.origin.catalogue)
    }

    /// The catalogue of effects of this file.
    #[must_use]
    pub fn catalogue(&self) -> &Catalogue {
        &self.origin.catalogue
    }

    /// The plant file as it was written.
    #[must_use]
    pub fn source(&self) -> &Source {
        &self.origin.source
    }

    /// Sites that units and the form of the equations suggest, in addition to those of the file.
    #[must_use]
    pub fn proposals(&self) -> Vec<Proposal> {
        propose(&self.plain, &self.sites)
    }

    /// The effects of the catalogue and the places where each of them is possible.
    ///
    /// # Errors
    /// Sites that do not agree with the equations.
    pub fn rooms(&self) -> Result<Vec<Room>, Faults> {
        rooms(&self.plain, &self.sites, &self.origin.catalogue)
    }

    /// The place of each effect that acts.
    #[must_use]
    pub fn places(&self) -> Vec<&str> {
        self.placed.iter().map(|it| it.0.as_str()).collect()
    }

    /// The place of each effect, also of those that act in some configurations only.
    ///
    /// # Errors
    /// An effect that acts in no configuration.
    pub fn all_places(&self) -> Result<Vec<String>, Faults> {
        if !self.effects.iter().any(Entry::differs) {
            return Ok(self.places().into_iter().map(str::to_string).collect());
        }
        let mut places: Vec<Option<String>> = vec![None; self.effects.len()];
        for name in self.configurations.names() {
            let file = self.in_configuration(name)?;
            let acts = |it: &Entry| it.in_configuration(Some(name)).is_some();
            let acting = places.iter_mut().zip(&file.effects).filter(|(_, entry)| acts(entry));
            acting.zip(file.places()).for_each(|((place, _), at)| *place = Some(at.to_string()));
        }
        let mut faults = Collector::new();
        for (entry, place) in self.effects.iter().zip(&places) {
            if place.is_none() {
                let what = format!("[[effects]]: `{}` has all of its numbers in no configuration", entry.kind);
                faults.push(
                    self.origin
                        .source
                        .fault(entry.place.clone(), what)
                        .help("give each number once, or for the same configurations"),
                );
            }
        }
        faults.finish(Some(places.into_iter().flatten().collect()))
    }

    /// The file of a text alone: the values of the text, no tolerances, no noise.
    ///
    /// # Errors
    /// Faults of the text; a function without an algorithm, because only a plant file can assign a surface to it.
    pub fn of_text(text: &Source) -> Result<EquationFile, Faults> {
        let flat = Flat::read(text, &Options::default())?;
        let system = System::new(&flat)?;
        let origin =
            Origin { source: text.clone(), text: text.clone(), model: None, catalogue: Arc::new(Catalogue::shipped()) };
        if let Some(surface) = system.flat().surfaces.first() {
            let what = format!("the function `{}` has no algorithm", surface.name);
            let help = "write a plant file (`format = 2`) that names a response surface for it under [functions]";
            return Err(Faults::one(text.fault(surface.place.clone(), what).help(help)));
        }
        Ok(EquationFile {
            file: text.name().to_string(),
            system,
            parameters: Vec::new(),
            tolerance: Vec::new(),
            noise: Vec::new(),
            initial: Vec::new(),
            columns: Vec::new(),
            functions: Vec::new(),
            sites: Vec::new(),
            effects: Vec::new(),
            rules: Rules::default(),
            configurations: Configurations::default(),
            configuration: None,
            delays: Vec::new(),
            late_readings: Vec::new(),
            read_of: Vec::new(),
            placed: Vec::new(),
            record_values: RecordValues::default(),
            plain: flat,
            origin,
        })
    }

    /// The column name of a signal in records, and its unit if the header of the record has none.
    #[must_use]
    pub fn column<'a>(&'a self, signal: &'a str) -> (&'a str, Option<&'a str>) {
        match self.columns.iter().find(|it| it.signal == signal) {
            Some(it) => (&it.name, it.unit.as_deref()),
            None => (signal, None),
        }
    }
}

/// Parameters that a record sets to its sample period and to its first instant, if the text has them.
const PERIOD: &str = "record_period";
const BEGIN: &str = "record_start";

/// Whether a record sets this parameter because of its name.
#[must_use]
pub fn is_of_record(parameter: &str) -> bool {
    [PERIOD, BEGIN].contains(&parameter)
}

/// The parameters of a text that a configuration may set, with their bounds: those that do not change the structure of the equations.
fn settable(plain: &Flat, is_free: &dyn Fn(&str) -> bool) -> Vec<Settable> {
    let start: Vec<Symbol> = start_parameters(plain);
    let symbols = plain.symbols().filter(|it| !start.contains(it));
    let variables = symbols.map(|it| plain.variable(it)).filter(|it| it.role == Role::Parameter && !it.is_structural);
    let one = |it: &rsm_model::flat::Variable| Settable { name: it.name.clone(), bound: bound(plain, it) };
    variables.filter(|it| it.basic != Basic::Boolean && is_free(&it.name)).map(one).collect()
}

/// The permitted values of a parameter, from `min` and `max` of the text. A parameter with `min = 0` and a value above 0 stays above 0.
pub(crate) fn bound(flat: &Flat, it: &rsm_model::flat::Variable) -> Bound {
    match (it.basic, it.min, it.value.and_then(|id| flat.pool.value(id))) {
        (Basic::Integer, ..) => Bound::Count,
        (_, Some(min), _) if min < 0.0 && it.max.is_some_and(|max| max > 0.0) => {
            Bound::Between(min, it.max.unwrap_or(f64::INFINITY))
        }
        (_, Some(min), _) if min > 0.0 => Bound::Positive,
        (_, Some(min), Some(value)) if min >= 0.0 && value > 0.0 => Bound::Positive,
        (_, Some(min), _) if min >= 0.0 => Bound::NotNegative,
        _ => Bound::Any,
    }
}

/// The values for a text with these parameters: the period of the rows and their first instant, in s.
#[must_use]
pub fn of_rows(period: f64, first: f64) -> [NamedValue; 2] {
    [(PERIOD, period), (BEGIN, first)].map(|(name, value)| NamedValue { name: name.to_string(), value })
}

/// The `[record]` rules of a text that is shipped with the project.
fn shipped_rules(model: &str) -> Rules {
    let Some(source) = rsm_model::effects::shipped_file(model) else { return Rules::default() };
    let mut faults = Collector::new();
    let rules = parse(&source, &mut faults)
        .map(|document| extended::rules(&mut TableReader::document(&source, &document), &mut faults));
    rules.unwrap_or_default()
}

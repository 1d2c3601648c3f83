//! Plants of equations in the form that plant files, records and the diagnosis use: signals, parameters, effects with their places, runs.
//!
//! ```text
//! plant.toml (format 2) + text --read--> PlantFile of kind Equations
//!     places of effects --describe--> Descriptions     records --scales--> sizes at the places
//!     PlantFile + Record --run--> outputs at every row
//! ```
//!
//! In: a plant file of format 2, or one of format 1 for a shipped text. Out: the types of plant files and records. This module contains no name of an
//! effect.

pub mod added;
mod configured;
mod describe;
mod first_format;
mod observer;
mod plant_file;
mod rates;
mod run;
mod scales;
mod site_signals;

use std::cell::RefCell;
use std::sync::{Arc, OnceLock};

use rsm_core::source::{Fault, Faults, Source};
use rsm_model::effects::{Catalogue, Place, Places, RoleValue};
use rsm_model::expression::Node;
use rsm_model::flat::{Basic, Variable};

use self::first_format::FirstFormat;
use crate::configurations::{self, Configurations};
use crate::effect::declared::Part;
use crate::effect::{Arguments, Description, Role, Subject};
use crate::equations::extended::DeterminedBy;
use crate::equations::file::{EquationFile, NamedValue};
use crate::equations::signals::spelled;
use crate::equations::{self, Machine};
use crate::kind::{Decision, Described, OUTPUTS, PlantKind, STARTS};
use crate::parameters::{Parameters, VelocityFrom};
use crate::plant_file::{Entry, PlantFile, Renamed};
use crate::quantity::{Bound, Nominal, Signal};
use crate::record::Record;

pub use first_format::{driveline, kinds as first_format, pmac, servo_axis};
pub use observer::Observer;
pub use rates::Rates;
pub use rsm_model::effects::SiteKind;
pub use run::{Run, Values, shown, together, unused};
pub use scales::scales;
pub use site_signals::{Body, RoleName, SiteSignal, bodies, role_names, sign_width, site_signals};

/// The number of plants that run side by side at no additional cost: the number of lanes in a vector register.
pub const SIDE_BY_SIDE: usize = crate::code::WIDE;

/// A plant of equations, without effects.
struct Plant {
    file: EquationFile,
    places: Vec<Place>,
    role_names: OnceLock<Vec<RoleName>>,
    descriptions: OnceLock<Vec<&'static Description>>,
    models: run::Models,
    /// The catalogue without the plant's own files of effects.
    given: added::Given,
}

/// The equations of a kind.
///
/// # Panics
/// Never: only this module creates such kinds.
fn plant_of(kind: &'static Described) -> &'static Plant {
    kind.equations.downcast_ref().expect("equations of a kind that was read here")
}

/// A text with the lifetime of the program, like the kind that uses it.
fn kept(text: &str) -> &'static str {
    Box::leak(text.to_string().into_boxed_str())
}

fn signal((name, unit): &(String, String)) -> Signal {
    Signal { name: kept(name), unit: kept(&spelled(unit)) }
}

/// Reads a plant file of format 2. `open` returns the text of a file that it names, relative to the folder of the plant file.
///
/// ```
/// use rsm_core::source::{Faults, Source};
/// use rsm_sim::{equation_plant, record::Record, simulate::Simulator};
///
/// let text = "model Cart\n  parameter Real mass(unit = \"kg\") = 2;\n  input Real force(unit = \"N\");\n  Real speed(unit = \"m/s\");\n  \
///             output Real position(unit = \"m\");\nequation\n  mass*der(speed) = force;\n  der(position) = speed;\nend Cart;\n";
/// let open = |name: &str| Ok::<_, Faults>(Source::new(name, text));
/// let plant = equation_plant::read(&Source::new("cart.toml", "format = 2\nmodel = \"cart.mo\"\n"), &open)?;
/// assert_eq!(plant.kind.outputs()[0].name, "position");
/// let columns: [(&str, &[f64]); 3] = [("time", &[0.0, 0.5, 1.0]), ("force", &[4.0; 3]), ("position", &[0.0; 3])];
/// let record = Record::in_memory(&plant, &columns)?;
/// let outputs = Simulator::new(&plant, &record)?.run(&record)?;
/// assert!((outputs.of("position").unwrap()[2] - 1.0).abs() < 1e-9); // 4 N on 2 kg, for 1 s
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// Those of [`EquationFile::read`]; more outputs than a diagnosis can compare.
pub fn read(source: &Source, open: &dyn Fn(&str) -> Result<Source, Faults>) -> Result<PlantFile, Faults> {
    read_with(source, open, &Arc::new(Catalogue::shipped()))
}

/// The same with another catalogue of effects.
///
/// # Errors
/// Those of [`read`].
pub fn read_with(
    source: &Source,
    open: &dyn Fn(&str) -> Result<Source, Faults>,
    catalogue: &Arc<Catalogue>,
) -> Result<PlantFile, Faults> {
    let opened = RefCell::new(Vec::new());
    let open_and_keep = |name: &str| {
        let text = open(name)?;
        opened.borrow_mut().push((name.to_string(), text.text().to_string()));
        Ok(text)
    };
    let whole = EquationFile::read_with(source, &open_and_keep, catalogue)?;
    let entries = whole.effects.clone();
    let at = whole.all_places()?;
    let kind = described(source, opened, whole.without_effects()?, catalogue.clone(), None)?;
    let kind = configured::kind(kind, &whole.configurations);
    let parameters = kind.nominal();
    let file = &whole;
    let named = |list: &[NamedValue]| list.iter().map(|it| (kept(&it.name), it.value)).collect::<Vec<(&'static str, f64)>>();
    let columns =
        file.columns.iter().map(|it| Renamed { signal: kept(&it.signal), column: it.name.clone(), unit: it.unit.clone() });
    let mut plant_file = PlantFile {
        kind: PlantKind(kind),
        parameters,
        tolerance: configured::tolerances(kind, &named(&file.tolerance)),
        noise: named(&file.noise),
        initial: named(&file.initial),
        given: Vec::new(),
        effects: Vec::new(),
        columns: columns.collect(),
    };
    for (entry, at) in entries.iter().zip(&at) {
        plant_file.effects.extend(configured::entries(kind, &placed(kind, entry, at, source)?));
    }
    Ok(plant_file)
}

/// The kind of an equation file without effects. With `first`, the kind of a plant of format 1.
fn described(
    source: &Source,
    opened: RefCell<Vec<(String, String)>>,
    file: EquationFile,
    given: added::Given,
    first: Option<&FirstFormat>,
) -> Result<&'static Described, Faults> {
    let mut machine = Machine::new(&file)?;
    let outputs: Vec<Signal> = machine.outputs().iter().map(signal).collect();
    if outputs.len() > OUTPUTS {
        let what = format!("the text has {} outputs, a diagnosis compares {OUTPUTS} at most", outputs.len());
        return Err(Faults::one(
            Fault::whole_file(source.name(), what).help("declare those that nobody measures without `output`"),
        ));
    }
    let open_loop = first.and_then(|it| it.open_loop);
    let mut starts: Vec<Signal> = machine.first_readings()?.iter().map(|place| outputs[*place]).collect();
    let of_start = start_parameters(&machine);
    starts.extend(of_start.iter().map(|it| signal(&(it.name.clone(), it.unit.clone().unwrap_or_default()))));
    let start_sizes = of_start.iter().map(|it| (kept(&it.name), it.nominal.unwrap_or(0.0))).collect();
    let states = machine.states();
    // There is a limit of `STARTS` start values. States beyond it always start at the value in the text.
    starts.extend(
        states.iter().filter(|it| !outputs.iter().any(|output| output.name == it.0)).map(signal).take(STARTS - starts.len()),
    );
    let start_values = starts_of_text(&mut machine, &file, &starts);
    let places = file.places_of_effects()?;
    let decisions = decisions(&file, &machine);
    // Variables whose start no reading determines.
    let by_text = machine.start_by(&|_| true).map(|it| it.1).unwrap_or_default();
    let value = |name: &str| {
        let symbol = machine.system().find(name)?;
        machine.system().parameter_value(symbol)
    };
    let mut parameters = nominals(&machine, &decisions, first.is_some());
    // The parameters of a controller may be omitted: then it does not act.
    for it in &mut parameters {
        it.optional = open_loop.is_some_and(|open| !open.0.parameters.iter().any(|own| own.name == it.name));
    }
    let parameter_roles = parameter_roles(&places, &parameters, file.catalogue());
    let list = places.list;
    let is_free = |it: &&Signal| !outputs.contains(it) && by_text.iter().any(|name| name == it.name);
    let free_starts: Vec<Signal> = starts.iter().filter(is_free).copied().collect();
    let plant = Plant {
        places: list,
        role_names: OnceLock::new(),
        descriptions: OnceLock::new(),
        models: run::Models::default(),
        given,
        file,
    };
    let kind: &'static Described = Box::leak(Box::new(Described {
        name: first.map_or_else(|| kept(&machine.system().flat().name), |it| it.name),
        model: kept(&machine.system().flat().name),
        is_first_format: first.is_some(),
        inputs: machine.inputs().iter().map(signal).collect(),
        outputs,
        starts,
        start_values,
        free_starts,
        open_loop,
        start_sizes,
        values: parameters.iter().map(|it| value(it.name).unwrap_or(f64::NAN)).collect(),
        parameters,
        decisions,
        files: opened.into_inner(),
        text: source.text().to_string(),
        configurations: Configurations::default(),
        own: Vec::new(),
        common: None,
        equations: Box::leak(Box::new(plant)),
    }));
    let plant = plant_of(kind);
    plant.descriptions.get_or_init(|| match first {
        None => describe::all(&plant.places, &parameter_roles, plant.file.catalogue()),
        Some(first) => describe::of_first_format(&plant.places, &parameter_roles, plant.file.catalogue(), &first.effects),
    });
    Ok(kind)
}

/// The roles of sites that are a parameter that may be set.
fn parameter_roles(places: &Places, parameters: &[Nominal], catalogue: &Catalogue) -> describe::ParameterRoles {
    let roles = places.list.iter().flat_map(|place| place.roles.iter().map(move |role| (place, role)));
    let one = |(place, role): (&Place, &RoleValue)| {
        let [part] = role.parts[..] else { return None };
        let Node::Symbol(symbol) = places.flat.pool.node(part) else { return None };
        let name = &places.flat.variable(symbol).name;
        let parameter = parameters.iter().find(|it| it.name == name)?;
        Some((place.at.clone(), role.role.clone(), parameter.name))
    };
    let mut offers = places.list.iter().flat_map(|it| &it.effects);
    let error = offers.find(|it| catalogue.find(&it.kind).is_some_and(rsm_model::effects::Effect::is_value));
    describe::ParameterRoles { roles: roles.filter_map(one).collect(), error: error.map_or("", |it| kept(&it.kind)) }
}

impl Described {
    /// The parameters of its plant file.
    fn nominal(&'static self) -> Parameters {
        Parameters {
            kind: PlantKind(self),
            values: self.values.iter().map(|it| Some(*it)).collect(),
            velocity_from: VelocityFrom::State,
        }
    }
}

/// The start values of variables from the text alone, with all inputs 0. A value is 0 if the text gives none.
fn starts_of_text(machine: &mut Machine, file: &EquationFile, starts: &[Signal]) -> Vec<f64> {
    let inputs = vec![0.0; machine.inputs().len()];
    let Ok(point) = machine.start(file, 0.0, &inputs, &[]) else { return vec![0.0; starts.len()] };
    let names = machine.states().into_iter().chain(machine.outputs()).map(|it| it.0);
    let values: Vec<f64> = point.states.iter().copied().chain(machine.outputs_at(&point)).collect();
    let parameters = machine.parameters().into_iter().map(|it| (it.0, it.2));
    let all: Vec<(String, f64)> = names.zip(values).chain(parameters).collect();
    starts.iter().map(|it| all.iter().find(|(name, _)| name == it.name).map_or(0.0, |it| it.1)).collect()
}

/// The largest magnitude of each start variable of a kind along a record; 0 if the plant cannot follow the record.
#[must_use]
pub fn start_scales(file: &PlantFile, record: &Record) -> Vec<f64> {
    let kind = file.kind.driven_by(record.drive).0;
    run::largest(kind, file, record).unwrap_or_else(|_| vec![0.0; kind.starts.len()])
}

/// The parameters on which only the start depends.
fn start_parameters(machine: &Machine) -> Vec<&Variable> {
    let flat = machine.system().flat();
    equations::start_parameters(flat).into_iter().map(|it| flat.variable(it)).collect()
}

/// Parameters that a record determines.
fn decisions(file: &EquationFile, machine: &Machine) -> Vec<Decision> {
    let system = machine.system();
    let one = |rule: &equations::extended::Rule| {
        let declared = system.find(&rule.parameter).map(|it| system.flat().variable(it));
        let (column, without) = match &rule.by {
            DeterminedBy::Column(name) => (Some(kept(name)), Vec::new()),
            DeterminedBy::Without(names) => (None, names.iter().map(|it| kept(it)).collect()),
        };
        Decision {
            parameter: kept(&rule.parameter),
            column,
            without,
            range: declared.and_then(|it| it.min.zip(it.max)).map(|(low, high)| [low, high]),
            is_whole: declared.is_some_and(|it| it.basic == Basic::Integer),
        }
    };
    file.rules.parameters.iter().map(one).collect()
}

/// The parameters of a plant that may be set: those that do not change the structure of the equations and are not determined by a record or by the
/// start.
///
/// Bounds follow from `min`. In a user's text, a parameter with `min = 0` and a value above 0 stays above 0. A plant file of format 1 may set it to
/// 0.
fn nominals(machine: &Machine, decisions: &[Decision], is_first_format: bool) -> Vec<Nominal> {
    let system = machine.system();
    let of_start = start_parameters(machine);
    let is_own = |name: &str| {
        let is_decided = decisions.iter().any(|it| it.parameter == name) || equations::file::is_of_record(name);
        !is_decided && !of_start.iter().any(|it| it.name == name)
    };
    let variables = system.parameters().into_iter().map(|it| system.flat().variable(it));
    let one = |it: &Variable| {
        let bound = match equations::file::bound(system.flat(), it) {
            Bound::Positive if is_first_format && it.min == Some(0.0) => Bound::NotNegative,
            bound => bound,
        };
        Nominal { name: kept(&it.name), unit: kept(&spelled(it.unit.as_deref().unwrap_or_default())), bound, optional: false }
    };
    variables.filter(|it| it.basic != Basic::Boolean && is_own(&it.name)).map(one).collect()
}

/// The effects that are possible on a plant: one description for each effect and each place where it is possible. On a plant of format 1 most effects
/// have one place.
#[must_use]
pub fn effects_on(kind: PlantKind) -> Vec<&'static Description> {
    plant_of(kind.0).descriptions.get().cloned().unwrap_or_default()
}

impl Part {
    /// Its entry in a plant file; `None` if there is no such effect.
    #[must_use]
    pub fn entry(&self, plant: PlantKind) -> Option<Entry> {
        let fits = |it: &&Description| it.kind == self.kind && (it.at.is_none() || it.at == self.subject);
        let description = effects_on(plant).into_iter().find(fits)?;
        let numbers = description.arguments.iter().take(1).map(|it| (it.name, self.value)).collect();
        Some(Entry { description, arguments: Arguments { plant, subject: self.subject.map(str::to_string), numbers } })
    }
}

/// The first effect of a kind that is possible on a plant.
#[must_use]
pub fn effect(kind: PlantKind, name: &str) -> Option<&'static Description> {
    effects_on(kind).into_iter().find(|it| it.kind == name)
}

/// The effect of the shipped catalogue that is a special case of another one of it.
#[must_use]
pub fn special_case(general: &str) -> Option<&'static str> {
    static SHIPPED: OnceLock<Catalogue> = OnceLock::new();
    SHIPPED.get_or_init(Catalogue::shipped).find(general)?.generalises.as_deref()
}

/// The first effect with a role that can act on an output or another subject.
#[must_use]
pub fn with(kind: PlantKind, role: Role, subject: &str) -> Option<&'static Description> {
    let fits = |it: &&Description| it.declared.role == role && it.at.is_none_or(|at| at == subject);
    effects_on(kind).into_iter().find(fits)
}

/// An effect of a plant file with its place.
fn placed(kind: &'static Described, entry: &equations::Entry, at: &str, source: &Source) -> Result<Entry, Faults> {
    let all = effects_on(PlantKind(kind));
    let is_it = |it: &&Description| it.kind == entry.kind && it.at.is_none_or(|place| place == at);
    let Some(description) = all.into_iter().find(is_it) else {
        let what = format!("the effect `{}` stands at `{at}`, which a diagnosis does not vary", entry.kind);
        return Err(Faults::one(Fault::whole_file(source.name(), what)));
    };
    let numbers = description.arguments.iter().flat_map(|argument| {
        // Numbers by configuration stay together.
        let given = entry.numbers.iter().filter(|it| configurations::without(&it.name) == argument.name);
        let named = |it: &NamedValue| (if it.name == argument.name { argument.name } else { kept(&it.name) }, it.value);
        given.map(named).collect::<Vec<_>>()
    });
    let subject = (description.subject != Subject::None).then(|| at.to_string());
    Ok(Entry { description, arguments: Arguments { plant: PlantKind(kind), subject, numbers: numbers.collect() } })
}

/// The indices in [`PlantKind::starts`] that determine the start of a record: the recorded outputs that give independent information about the
/// start, and the variables whose start is that of the text.
pub(crate) fn starting(kind: PlantKind, record: &Record) -> Vec<usize> {
    plant_of(kind.0).models.starting(kind.0, record)
}

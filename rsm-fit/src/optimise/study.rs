//! What shall be optimised: goals of responses, limits of inputs, conditions.
//!
//! In: values in memory, or a file ([`Study::from_source`]). Out: a [`Study`]. Nothing is checked against a model before [`Study::optimise`].

use rsm_core::check::Checked;
use rsm_core::model::{Category, Input};
use rsm_core::places::Places;
use rsm_core::source::{Collector, Fault, Faults, Source};

use super::desirability::Goal;

/// The name of a study in memory in messages.
const IN_MEMORY: &str = "study";

/// The number of searches from a new start, if the study gives none.
pub(super) const STARTS: usize = 32;

/// A response with its goal.
#[derive(Debug, Clone, PartialEq)]
pub struct Wish {
    /// The surface of the model.
    pub response: String,
    /// What it shall be.
    pub goal: Goal,
    /// Its importance among the responses: the exponent of its desirability.
    pub importance: f64,
    /// The lowest value that settings may give, if there is one.
    pub at_least: Option<f64>,
    /// The highest value.
    pub at_most: Option<f64>,
}

/// A weighted sum of inputs, in their units, with a bound.
#[derive(Debug, Clone, PartialEq)]
pub struct Sum {
    /// The weight of each named input.
    pub weights: Vec<(String, f64)>,
    /// The upper bound,
    pub at_most: Option<f64>,
    /// and the lower bound.
    pub at_least: Option<f64>,
}

/// Goals of several responses, with the limits within which settings are searched.
///
/// ```
/// use rsm_core::{check::Checked, source::Source};
/// use rsm_fit::optimise::{Goal, Study};
///
/// let text = "format = 1\nmodel = \"pump\"\n[inputs.speed]\nunit = \"rad/s\"\nrange = [100.0, 300.0]\n\
///     [surfaces.flow]\nunit = \"l/min\"\ninputs = [\"speed\"]\n\
///     terms = [{ powers = [0], coefficient = 40.0 }, { powers = [1], coefficient = 20.0 }]\n\
///     [surfaces.power]\nunit = \"W\"\ninputs = [\"speed\"]\n\
///     terms = [{ powers = [0], coefficient = 500.0 }, { powers = [1], coefficient = 300.0 }]\n";
/// let model = Checked::read(&Source::new("pump.toml", text))?;
/// let found = Study::new("pump")
///     .response("flow", Goal::Maximise { low: 20.0, high: 60.0, weight: 1.0 })
///     .response("power", Goal::Minimise { low: 200.0, high: 800.0, weight: 1.0 })
///     .optimise(&model)?;
/// // Flow rises from 20 to 60 l/min, power from 200 to 800 W: in the middle both desirabilities are 0.5.
/// assert!((found.settings.0[0].1 - 200.0).abs() < 1e-4);
/// assert!((found.desirability - 0.5).abs() < 1e-9);
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
#[derive(Debug, Clone)]
pub struct Study {
    /// Its name.
    pub name: String,
    /// The seed of the starts of the search.
    pub seed: u64,
    /// The number of searches from different starts.
    pub starts: usize,
    /// The responses, each once.
    pub responses: Vec<Wish>,
    /// Operating limits of inputs, in the units of the model; equal limits hold an input.
    pub limits: Vec<(String, [f64; 2])>,
    /// Conditions on the settings.
    pub conditions: Vec<Sum>,
    /// Whether settings must be in the support of every response.
    pub support: bool,
    pub(super) source: Option<Source>,
    pub(super) places: Places,
}

impl Study {
    /// A study without responses, with seed 1.
    #[must_use]
    pub fn new(name: impl Into<String>) -> Study {
        Study {
            name: name.into(),
            seed: 1,
            starts: STARTS,
            responses: Vec::new(),
            limits: Vec::new(),
            conditions: Vec::new(),
            support: true,
            source: None,
            places: Places::default(),
        }
    }

    /// A response with importance 1.
    #[must_use]
    pub fn response(self, response: impl Into<String>, goal: Goal) -> Study {
        self.wish(Wish { response: response.into(), goal, importance: 1.0, at_least: None, at_most: None })
    }

    /// A response with everything.
    #[must_use]
    pub fn wish(mut self, wish: Wish) -> Study {
        self.responses.push(wish);
        self
    }

    /// Operating limits of an input, in the unit of the model; equal limits hold it. Without them, its range in the model.
    #[must_use]
    pub fn limit(mut self, input: impl Into<String>, range: [f64; 2]) -> Study {
        self.limits.push((input.into(), range));
        self
    }

    /// The seed.
    #[must_use]
    pub fn seed(mut self, seed: u64) -> Study {
        self.seed = seed;
        self
    }

    /// A fault at a part of the study, by its dotted path.
    pub(super) fn fault(&self, path: &str, what: impl Into<String>) -> Fault {
        match &self.source {
            Some(source) => source.fault(self.places.place(path), what),
            None => Fault::whole_file(IN_MEMORY, what),
        }
    }

    /// Every fault of the study with a model.
    pub(super) fn check(&self, checked: &Checked) -> Result<(), Faults> {
        let model = checked.model();
        let mut faults = Collector::new();
        if self.responses.is_empty() {
            faults.push(self.fault("responses", "`responses`: found none, expected at least one"));
        }
        if self.starts == 0 {
            faults.push(self.fault("starts", "`starts`: found 0, expected at least 1"));
        }
        for (k, wish) in self.responses.iter().enumerate() {
            self.check_wish(k, wish, checked, &mut faults);
        }
        let is_used = |name: &str| {
            let of = |wish: &Wish| model.surface(&wish.response).is_some_and(|it| it.inputs.iter().any(|input| input == name));
            self.responses.iter().any(of)
        };
        let used: Vec<String> =
            model.inputs.iter().filter(|input| is_used(&input.name)).map(|input| format!("`{}`", input.name)).collect();
        let used = used.join(", ");
        for (k, (name, [low, high])) in self.limits.iter().enumerate() {
            let path = format!("inputs.{name}");
            if self.limits[..k].iter().any(|(earlier, _)| earlier == name) {
                faults.push(self.fault(&path, format!("input `{name}` has limits twice")));
            }
            match model.input(name).filter(|_| is_used(name)) {
                None => {
                    let what = format!("`{name}` is not an input of these responses");
                    faults.push(self.fault(&path, what).help(format!("their inputs are {used}")));
                }
                Some(Input { unit, range: [least, most], .. }) => {
                    // NaN fulfils none of these.
                    if !(least <= low && low <= high && high <= most) {
                        let unit = if unit == "1" { String::new() } else { format!(" {unit}") };
                        let what = format!(
                            "input `{name}`: found {low} to {high}, expected limits within {least} to {most}{unit}, the range of the model"
                        );
                        faults.push(self.fault(&path, what));
                    }
                }
            }
        }
        for category in model.categories() {
            if category.inputs.iter().any(|name| is_used(name)) {
                self.check_level(category, &mut faults);
            }
        }
        for (k, sum) in self.conditions.iter().enumerate() {
            let who = format!("`where`: condition {}", k + 1);
            for (name, weight) in &sum.weights {
                if model.input(name).is_none() || !is_used(name) {
                    let what = format!("{who}: `{name}` is not an input of these responses");
                    faults.push(self.fault("where", what).help(format!("their inputs are {used}")));
                } else if !weight.is_finite() {
                    faults.push(self.fault("where", format!("{who}: found {weight}, expected a finite number")));
                }
            }
            if sum.weights.iter().all(|(_, weight)| *weight == 0.0) {
                faults.push(self.fault("where", format!("{who}: all weights are 0")));
            }
        }
        faults.finish(Some(()))
    }

    /// A category must be held at one of its levels: between two levels there is no setting.
    fn check_level(&self, category: &Category, faults: &mut Collector) {
        let held = |name: &String| {
            let of_name = self.limits.iter().find(|(known, _)| known == name);
            of_name.filter(|(_, [low, high])| low == high).map(|(_, [value, _])| *value)
        };
        let values: Option<Vec<f64>> = category.inputs.iter().map(held).collect();
        let at = |level: &String| category.contrasts(level).filter(|contrasts| values.as_ref() == Some(contrasts));
        if category.levels.iter().any(|level| at(level).is_some()) {
            return;
        }
        let one = |level: &String| {
            let pairs = category.inputs.iter().zip(category.contrasts(level).unwrap_or_default());
            let each: Vec<String> = pairs.map(|(name, value)| format!("{name} = {value}")).collect();
            format!("{level}: {}", each.join(", "))
        };
        let levels: Vec<String> = category.levels.iter().map(one).collect();
        let what = format!("category `{}` is not held at one of its levels", category.name);
        let help = format!("hold its inputs with `value`: {}", levels.join("; "));
        faults.push(self.fault("inputs", what).help(help));
    }

    fn check_wish(&self, k: usize, wish: &Wish, checked: &Checked, faults: &mut Collector) {
        let name = &wish.response;
        let path = format!("responses.{name}");
        let model = checked.model();
        if model.surface(name).is_none() {
            let known: Vec<String> = model.surfaces.iter().map(|surface| format!("`{}`", surface.name)).collect();
            let fault = self.fault(&path, format!("{} has no surface `{name}`", checked.file()));
            faults.push(fault.help(format!("its surfaces are {}", known.join(", "))));
        }
        if self.responses[..k].iter().any(|earlier| earlier.response == *name) {
            faults.push(self.fault(&path, format!("response `{name}` occurs twice")));
        }
        let (values, weights): (Vec<f64>, Vec<f64>) = match wish.goal {
            Goal::Maximise { low, high, weight } | Goal::Minimise { low, high, weight } => (vec![low, high], vec![weight]),
            Goal::Target { low, target, high, weights } => (vec![low, target, high], weights.to_vec()),
            Goal::InRange { low, high } => (low.into_iter().chain(high).collect(), Vec::new()),
        };
        if values.is_empty() {
            faults.push(self.fault(&path, format!("response `{name}`: found neither `low` nor `high`, expected one of them")));
        }
        let listed = |values: &[f64]| values.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
        if values.iter().any(|value| !value.is_finite()) || values.windows(2).any(|pair| pair[0] >= pair[1]) {
            let expected = if values.len() == 3 { "low below target below high" } else { "low below high" };
            faults.push(self.fault(&path, format!("response `{name}`: found {}, expected {expected}", listed(&values))));
        }
        for weight in weights.into_iter().chain([wish.importance]) {
            if !(weight.is_finite() && weight > 0.0) {
                let what = format!("response `{name}`: found a weight or importance of {weight}, expected a number above 0");
                faults.push(self.fault(&path, what));
            }
        }
        let bounds: Vec<f64> = wish.at_least.into_iter().chain(wish.at_most).collect();
        if bounds.iter().any(|bound| !bound.is_finite()) || bounds.windows(2).any(|pair| pair[0] > pair[1]) {
            let what = format!("response `{name}`: found bounds {}, expected `at_least` up to `at_most`", listed(&bounds));
            faults.push(self.fault(&path, what));
        }
    }
}

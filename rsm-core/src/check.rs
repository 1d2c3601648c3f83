//! Checks once that the parts of a model fit together. Only this module makes a [`Checked`].
//!
//! In: a source or a [`Model`]. Out: [`Checked`], or every fault in the order of the file. Later stages take a [`Checked`], so they need no checks
//! and do not fail. Each rule is one function. Whether f32 can represent the model is a separate question: [`Checked::refusal`].

mod compensators;
mod context;
mod fits;
mod forms;
mod in_memory;
mod surfaces;

use self::compensators::check_compensators;
use self::context::{Context, any_under, check_range};
use self::fits::{BEYOND, POLE_FREQUENCY, beyond_ratio, fits_fixed, fits_ratio, fits_sigmoid, schedule};
pub use self::forms::{MOST_COEFFICIENTS, MOST_SPLINE_INPUTS, sigmoid_fits, spline_fits, transform_fits, wave_fits};
use self::surfaces::check_surfaces;
use crate::model::{Compensator, Input, Model, Surface};
use crate::model_file;
use crate::names;
use crate::number::{Precision, exact};
use crate::source::{Collector, Fault, Faults, Source};

/// A model whose parts fit together.
#[derive(Debug, Clone)]
pub struct Checked {
    model: Model,
    /// Positions for faults of one precision only: the file, and the position of each input's range and of each term.
    file: String,
    range_places: Vec<(usize, usize)>,
    term_places: Vec<Vec<(usize, usize)>>,
    /// For each compensator: the positions of its scheduled numbers, in the order of [`Compensator::parts`], and of its sample time.
    compensator_places: Vec<Vec<(usize, usize)>>,
}

impl Checked {
    /// Reads and checks a model file.
    ///
    /// # Errors
    /// Every fault of the file, with line and column, what was found and what is accepted.
    ///
    /// ```
    /// use rsm_core::{check::Checked, source::Source};
    ///
    /// let text = "format = 1\nmodel = \"car\"\n[inputs.speed]\nunit = \"m/s\"\nrange = [30.0, 0.0]\n[surfaces.drag]\nunit = \"N\"\n\
    ///             inputs = [\"speed\"]\nterms = [{ powers = [1], coefficient = 30.0 }]\n";
    /// let faults = Checked::read(&Source::new("car.toml", text)).unwrap_err();
    /// assert_eq!(faults.list()[0].line, 5);
    /// assert_eq!(faults.list()[0].what, "input `speed`: low 30 m/s is above high 0 m/s");
    /// ```
    pub fn read(source: &Source) -> Result<Self, Faults> {
        let mut faults = Collector::new();
        let Some(located) = model_file::read(source, &mut faults) else {
            return faults.finish(None);
        };
        let context = Context { model: &located.model, file: source.name(), text: Some((source, &located.places)) };
        check(&context, &mut faults);
        let checked = checked(&context);
        faults.finish(Some(checked))
    }

    /// Checks a model that was made in memory. Faults name the file `NAME.toml`, although there is none, and have no line.
    ///
    /// # Errors
    /// Every fault: those of a model file with the same content, except those of its text.
    ///
    /// ```
    /// use rsm_core::check::Checked;
    /// use rsm_core::model::{Input, Model, Outside, Surface, Term};
    ///
    /// let speed = Input { name: "speed".into(), unit: "m/s".into(), range: [0.0, 30.0], outside: Outside::Clamp };
    /// let drag = Surface {
    ///     name: "drag".into(),
    ///     unit: "N".into(),
    ///     inputs: vec!["speed".into()],
    ///     terms: vec![Term { powers: vec![0], coefficient: 35.0 }, Term { powers: vec![1], coefficient: 30.0 }],
    ///     ..Surface::default()
    /// };
    /// let model = Model { name: "car".into(), inputs: vec![speed], surfaces: vec![drag], ..Model::default() };
    /// assert!(Checked::from_model(&model).is_ok());
    ///
    /// let without_inputs = Model { inputs: vec![], ..model };
    /// let faults = Checked::from_model(&without_inputs).unwrap_err();
    /// assert_eq!(faults.list()[0].to_string(), "car.toml: `inputs`: found none, expected at least one");
    /// ```
    pub fn from_model(model: &Model) -> Result<Self, Faults> {
        let mut faults = Collector::new();
        let name = if model.name.is_empty() { "model" } else { &model.name };
        let context = Context { model, file: &format!("{name}.toml"), text: None };
        in_memory::check(&context, &mut faults);
        // The rules compare exact numbers, so all numbers must be finite.
        if faults.is_clean() {
            check(&context, &mut faults);
        }
        let checked = checked(&context);
        faults.finish(Some(checked))
    }

    /// The model.
    #[must_use]
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// The name of the file, for messages.
    #[must_use]
    pub fn file(&self) -> &str {
        &self.file
    }

    /// The inputs of a surface, in its order.
    #[must_use]
    pub fn inputs_of(&self, surface: &Surface) -> Vec<Input> {
        let find = |name: &String| self.model.input(name).expect("a checked surface names known inputs").clone();
        surface.inputs.iter().map(find).collect()
    }

    /// The inputs that a compensator's surfaces use, in the order of the file: the arguments of its step after the signal.
    #[must_use]
    pub fn schedule_of(&self, compensator: &Compensator) -> Vec<Input> {
        schedule(&self.model, compensator)
    }

    /// A fault at one of a compensator's scheduled numbers, in the order of [`Compensator::parts`].
    #[must_use]
    pub(crate) fn fault_at_part(&self, compensator: usize, part: usize, what: String) -> Fault {
        let (line, column) = self.compensator_places[compensator][part];
        Fault::at_line(&self.file, line, column, what)
    }

    /// The reason why a precision cannot represent this model, or `None`: a bound or coefficient beyond its largest number, or a range that contains
    /// fewer than two of its numbers.
    #[must_use]
    pub fn refusal(&self, precision: Precision) -> Option<Faults> {
        let name = precision.name();
        let mut faults = Collector::new();
        let at = |(line, column): (usize, usize), what: String| Fault::at_line(&self.file, line, column, what);
        for (input, place) in self.model.inputs.iter().zip(&self.range_places) {
            let [low, high] = input.range.map(exact);
            let (inner_low, inner_high) = (precision.round_up(&low), precision.round_down(&high));
            if [&low, &high].iter().any(|end| !precision.round(end).is_finite()) {
                faults.push(at(*place, format!("input `{}`: the range is wider than {name} can hold", input.name)));
            } else if inner_low >= inner_high {
                let what = format!("input `{}`: {name} has fewer than two numbers in the range", input.name);
                faults.push(at(*place, what).help("use f64, or shift the variable so that its range lies nearer to 0"));
            }
        }
        for (surface, places) in self.model.surfaces.iter().zip(&self.term_places) {
            if let Some([low, high]) = surface.output_range.map(|range| range.map(exact))
                && precision.round_up(&low) > precision.round_down(&high)
            {
                let what = format!("surface `{}`: {name} has no number in the output range", surface.name);
                faults.push(at(places.first().copied().unwrap_or_default(), what));
            }
            for space in &surface.support {
                // The comparison is with the next number above the bound.
                let above = precision.next_up(precision.round_down(&exact(space.bound)));
                if !above.is_finite() || space.normal.iter().any(|entry| !precision.round(&exact(*entry)).is_finite()) {
                    let what = format!("surface `{}`: a number of `support` is larger than {name} can hold", surface.name);
                    faults.push(at(places.first().copied().unwrap_or_default(), what));
                }
            }
            if let Err((what, help)) = transform_fits(surface, &self.inputs_of(surface), precision) {
                let what = format!("surface `{}`: `transform`: {what}", surface.name);
                faults.push(at(places.first().copied().unwrap_or_default(), what).help(help));
            }
            for sigmoid in &surface.sigmoids {
                if let Some(Input { range, .. }) = self.model.input(&sigmoid.input)
                    && !fits_sigmoid(precision, sigmoid, *range)
                {
                    let what =
                        format!("surface `{}`: a sigmoid of `{}` has squares {BEYOND} {name}", surface.name, sigmoid.input);
                    faults.push(at(places.first().copied().unwrap_or_default(), what));
                }
            }
            // The continued coefficients are at most 15 times as large for each of three inputs, and their differences 16 times.
            let fits = |coefficient: &f64| precision.round(&(exact(*coefficient) * exact(16384.0))).is_finite();
            if let Some(spline) = &surface.spline
                && !spline.coefficients.iter().all(fits)
            {
                let what = format!("surface `{}`: a coefficient of `spline` is {BEYOND} {name}", surface.name);
                faults.push(at(places.first().copied().unwrap_or_default(), what));
            }
            for (term, place) in surface.terms.iter().zip(places) {
                if !precision.round(&exact(term.coefficient)).is_finite() {
                    let what = format!(
                        "surface `{}`: the coefficient {:e} is larger than {name} can hold",
                        surface.name, term.coefficient
                    );
                    faults.push(at(*place, what));
                }
            }
        }
        for (compensator, places) in self.model.compensators.iter().zip(&self.compensator_places) {
            let parts = compensator.parts();
            let fixed = parts.into_iter().map(|(key, scheduled)| (key, scheduled.fixed()));
            let numbers = fixed.chain([("sample_time", Some(compensator.sample_time))]).zip(places);
            for ((key, value), place) in numbers.filter_map(|((key, value), place)| Some(((key, value?), place))) {
                if !fits_fixed(precision, value) {
                    faults
                        .push(at(*place, format!("compensator `{}`: `{key}`: {value:e} is {BEYOND} {name}", compensator.name)));
                }
            }
            if !fits_ratio(precision, compensator) {
                faults.push(at(places[POLE_FREQUENCY], beyond_ratio(compensator, name)));
            }
        }
        faults.finish(Some(())).err()
    }
}

/// Runs all rules.
fn check(context: &Context<'_>, faults: &mut Collector) {
    for rule in [check_name, check_inputs, check_surfaces, check_compensators, check_emitted_names] {
        rule(context, faults);
    }
}

/// The model with the positions for faults of one precision only.
fn checked(context: &Context<'_>) -> Checked {
    let model = context.model;
    let position = |path: String| context.text.map_or((0, 0), |(source, places)| source.position(places.place(&path).start));
    let of_terms = |surface: &Surface| {
        let of_one = |k| position(format!("surfaces.{}.terms.{k}", surface.name));
        (0..surface.terms.len()).map(of_one).collect()
    };
    let of_compensator = |it: &Compensator| {
        let keys = it.parts().into_iter().map(|(key, _)| key).chain(["sample_time"]);
        keys.map(|key| position(format!("compensators.{}.{key}", it.name))).collect()
    };
    Checked {
        model: model.clone(),
        file: context.file.to_string(),
        range_places: model.inputs.iter().map(|input| position(format!("inputs.{}.range", input.name))).collect(),
        term_places: model.surfaces.iter().map(of_terms).collect(),
        compensator_places: model.compensators.iter().map(of_compensator).collect(),
    }
}

fn check_name(context: &Context<'_>, faults: &mut Collector) {
    if context.is_broken("model") || context.model().name.is_empty() && context.is_missing("model") {
        return;
    }
    if let Some(reason) = names::refuse_model(&context.model().name) {
        faults.push(context.fault("model", format!("model name `{}` {reason}", context.model().name)));
    }
}

fn check_inputs(context: &Context<'_>, faults: &mut Collector) {
    for input in &context.model().inputs {
        let path = format!("inputs.{}", input.name);
        if let Some(reason) = names::refuse(&input.name) {
            faults.push(context.fault(&path, format!("input name `{}` {reason}", input.name)));
        }
        check_range(context, faults, &format!("input `{}`", input.name), &format!("{path}.range"), input.range, &input.unit);
    }
    if context.model().inputs.is_empty() && !any_under(context, "inputs") {
        faults.push(context.fault("inputs", "`inputs`: found none, expected at least one"));
    }
}

/// Names that differ only in case, or that become equal with the suffixes of the emitters.
fn check_emitted_names(context: &Context<'_>, faults: &mut Collector) {
    let model = context.model();
    let inputs = model.inputs.iter().map(|input| ("inputs", input.name.as_str())).collect::<Vec<_>>();
    let surfaces = model.surfaces.iter().map(|surface| ("surfaces", surface.name.as_str()));
    let emitted = surfaces.chain(model.compensators.iter().map(|it| ("compensators", it.name.as_str()))).collect::<Vec<_>>();
    type Clash = fn(&str, &str) -> Option<String>;
    let groups: [(_, Clash); 2] = [(inputs, names::clash), (emitted, names::clash_of_functions)];
    let is_compensator = |name: &str| model.compensators.iter().any(|compensator| compensator.name == name);
    let states_clash = |earlier: &str, later: &str| {
        let both = is_compensator(earlier) && is_compensator(later);
        both.then(|| names::clash_of_states(earlier, later)).flatten()
    };
    for (group, clash) in groups {
        for (k, (section, name)) in group.iter().enumerate() {
            for (_, earlier) in &group[..k] {
                if let Some(reason) = clash(earlier, name).or_else(|| states_clash(earlier, name)) {
                    let what = format!("{} name `{name}` {reason}", &section[..section.len() - 1]);
                    faults.push(context.fault(&format!("{section}.{name}"), what));
                }
            }
        }
    }
}

//! Checks once that the parts of a model fit together. Only this module makes a [`Checked`].
//!
//! In: a source or a [`Model`]. Out: [`Checked`], or every fault in the order of the file. Later stages take a [`Checked`], so they need no checks
//! and do not fail. Each rule is one function. Whether f32 can represent the model is a separate question: [`Checked::refusal`].

mod in_memory;

use num_traits::Signed as _;

use crate::model::{Coding, Compensator, Input, Model, Outside, Sigmoid, Surface, Symmetry, Wave};
use crate::model_file;
use crate::names;
use crate::number::{Precision, Rational, exact, power_of_two};
use crate::places::Places;
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
        context.check(&mut faults);
        let checked = context.checked();
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
            context.check(&mut faults);
        }
        let checked = context.checked();
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

fn schedule(model: &Model, compensator: &Compensator) -> Vec<Input> {
    let used: Vec<&Surface> = compensator.surfaces().filter_map(|name| model.surface(name)).collect();
    let is_used = |input: &&Input| used.iter().any(|surface| surface.inputs.contains(&input.name));
    model.inputs.iter().filter(is_used).cloned().collect()
}

/// Whether a precision can represent the constants that lowering makes from a fixed number of a compensator. The largest is 1 + g (g + 2 p) < 4 p for
/// large p, because g is below pi/4; the smallest is half of it.
fn fits_fixed(precision: Precision, value: f64) -> bool {
    let largest = precision.round(&(exact(value) * exact(4.0)));
    largest.is_finite() && precision.round(&(exact(value) / exact(2.0))) != 0.0
}

/// Whether a precision can represent the squares in a sigmoid for every argument in the range.
fn fits_sigmoid(precision: Precision, sigmoid: &Sigmoid, range: [f64; 2]) -> bool {
    let width = exact(sigmoid.width);
    let reach = range.map(|end| (exact(end) - exact(sigmoid.at)).abs() + &width);
    let smallest = precision.smallest_exponent() + precision.significand_bits() - 1;
    let holds = |square: Rational| precision.round(&square).is_finite();
    reach.iter().all(|reach| holds(reach * reach * exact(2.0))) && precision.round(&(&width * &width)) >= power_of_two(smallest)
}

/// The index of `pole_frequency` in [`Compensator::parts`].
const POLE_FREQUENCY: usize = 3;

/// Whether a precision can represent the square of the ratio of two fixed frequencies, which is a constant on the tape.
fn fits_ratio(precision: Precision, compensator: &Compensator) -> bool {
    let own = compensator.pole_frequency.as_ref().and_then(|scheduled| scheduled.fixed());
    let (Some(poles), Some(zeros)) = (own, compensator.natural_frequency.fixed()) else { return true };
    if poles <= 0.0 || zeros <= 0.0 {
        return true; // reported already
    }
    let ratio = exact(poles) / exact(zeros);
    precision.round(&(&ratio * &ratio)).is_finite()
}

fn beyond_ratio(compensator: &Compensator, precision: &str) -> String {
    format!(
        "compensator `{}`: `pole_frequency`: its square over that of `natural_frequency` is {BEYOND} {precision}",
        compensator.name
    )
}

/// The message for a number that does not fit.
const BEYOND: &str = "too large or too small for";

/// A model during the check.
struct Context<'a> {
    model: &'a Model,
    /// Its name in messages.
    file: &'a str,
    /// Its text and the positions of its parts; `None` for a model that was made in memory.
    text: Option<(&'a Source, &'a Places)>,
}

impl Context<'_> {
    fn fault(&self, path: &str, what: impl Into<String>) -> Fault {
        match self.text {
            Some((source, places)) => source.fault(places.place(path), what),
            None => Fault::whole_file(self.file, what),
        }
    }

    /// Runs all rules.
    fn check(&self, faults: &mut Collector) {
        for rule in [check_name, check_inputs, check_surfaces, check_compensators, check_emitted_names] {
            rule(self, faults);
        }
    }

    /// The model with the positions for faults of one precision only.
    fn checked(&self) -> Checked {
        let model = self.model;
        let position = |path: String| self.text.map_or((0, 0), |(source, places)| source.position(places.place(&path).start));
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
            file: self.file.to_string(),
            range_places: model.inputs.iter().map(|input| position(format!("inputs.{}.range", input.name))).collect(),
            term_places: model.surfaces.iter().map(of_terms).collect(),
            compensator_places: model.compensators.iter().map(of_compensator).collect(),
        }
    }

    /// Whether a part is in the file but has a wrong shape.
    fn is_broken(&self, path: &str) -> bool {
        self.text.is_some_and(|(_, places)| places.is_broken(path))
    }

    /// Whether a required key is missing.
    fn is_missing(&self, path: &str) -> bool {
        self.text.is_some_and(|(_, places)| places.place(path) == (0..0))
    }

    /// Whether a missing name can be reported: its section could be read, and the entry does not have a wrong shape.
    fn knows_all(&self, section: &str, name: &str) -> bool {
        let read = !self.is_missing(section) && !self.is_broken(section);
        let refused = self.is_broken(&format!("{section}.{name}"));
        // A model without any input is reported only once.
        let nothing_there = section == "inputs" && self.model().inputs.is_empty();
        read && !refused && !nothing_there
    }

    fn model(&self) -> &Model {
        self.model
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

/// Whether some entry of a section has a wrong shape.
fn any_under(context: &Context<'_>, section: &str) -> bool {
    // A section that is missing or empty has no such entry; other faults report it.
    context.is_missing(section) || context.text.is_some_and(|(_, places)| places.has_broken_under(section))
}

/// low < high, and a width that f64 can represent, because half of it is the unit of the coded variable.
fn check_range(context: &Context<'_>, faults: &mut Collector, who: &str, path: &str, [low, high]: [f64; 2], unit: &str) {
    let unit = if unit == "1" || unit.is_empty() { String::new() } else { format!(" {unit}") };
    if low > high {
        let fault = context.fault(path, format!("{who}: low {low}{unit} is above high {high}{unit}"));
        faults.push(fault.help(format!("swap them, or give the range as [{high}, {low}]")));
    } else if low == high {
        faults.push(context.fault(path, format!("{who}: the range is empty: low and high are both {low}{unit}")));
    } else if !(high - low).is_finite() {
        faults.push(context.fault(path, format!("{who}: the range from {low:e} to {high:e} is wider than f64 can hold")));
    }
}

fn check_surfaces(context: &Context<'_>, faults: &mut Collector) {
    for surface in &context.model().surfaces {
        let path = format!("surfaces.{}", surface.name);
        if let Some(reason) = names::refuse_function(&context.model().name, &surface.name) {
            faults.push(context.fault(&path, format!("surface name `{}` {reason}", surface.name)));
        }
        let rules = [
            check_surface_inputs,
            check_terms,
            check_spline,
            check_symmetry,
            check_knots,
            check_sigmoids,
            check_waves,
            check_reciprocal,
            check_support,
        ];
        for rule in rules {
            rule(context, faults, surface, &path);
        }
        if let Some(range) = surface.output_range {
            let who = format!("surface `{}`: `output_range`", surface.name);
            check_range(context, faults, &who, &format!("{path}.output_range"), range, &surface.unit);
        }
    }
    if context.model().surfaces.is_empty() && !any_under(context, "surfaces") {
        faults.push(context.fault("surfaces", "`surfaces`: found none, expected at least one"));
    }
}

fn check_surface_inputs(context: &Context<'_>, faults: &mut Collector, surface: &Surface, path: &str) {
    let who = format!("surface `{}`", surface.name);
    if surface.inputs.is_empty() && !context.is_broken(&format!("{path}.inputs")) {
        faults.push(context.fault(&format!("{path}.inputs"), format!("{who}: `inputs`: found none, expected at least one")));
    }
    for (k, name) in surface.inputs.iter().enumerate() {
        let place = format!("{path}.inputs.{k}");
        if surface.inputs[..k].contains(name) {
            faults.push(context.fault(&place, format!("{who}: input `{name}` is named twice")));
        } else if context.model().input(name).is_none() && context.knows_all("inputs", name) {
            let known: Vec<_> = context.model().inputs.iter().map(|input| format!("`{}`", input.name)).collect();
            let fault = context.fault(&place, format!("{who}: there is no input `{name}`"));
            faults.push(fault.help(format!("the inputs of this model are {}", known.join(", "))));
        }
    }
}

fn check_terms(context: &Context<'_>, faults: &mut Collector, surface: &Surface, path: &str) {
    let who = format!("surface `{}`", surface.name);
    let has_spline = surface.spline.is_some() || context.is_broken(&format!("{path}.spline"));
    if surface.terms.is_empty() && !has_spline && !context.is_broken(&format!("{path}.terms")) {
        faults.push(context.fault(&format!("{path}.terms"), format!("{who}: `terms`: found none, expected at least one")));
    }
    let (inputs, knots, sigmoids) = (surface.inputs.len(), surface.knots.len(), surface.sigmoids.len());
    let waves = surface.waves.len();
    // The number of powers of a term can be checked only if the inputs and the coding could be read.
    let counts = !context.is_broken(&format!("{path}.inputs")) && !context.is_broken(&format!("{path}.basis"));
    for (k, term) in surface.terms.iter().enumerate() {
        let place = format!("{path}.terms.{k}");
        let found = term.powers.len();
        if counts && found != surface.width() {
            let expected = match (knots, sigmoids + waves) {
                (0, 0) => format!("{inputs}, one for each input"),
                (_, 0) => format!("{}: one for each of {inputs} inputs, then one for each of {knots} knots", inputs + knots),
                _ if waves == 0 => format!(
                    "{}: one for each of {inputs} inputs, then of {knots} knots, then of {sigmoids} sigmoids",
                    surface.width()
                ),
                _ => format!(
                    "{}: one for each of {inputs} inputs, then of {knots} knots, then of {sigmoids} sigmoids, then two for each of {waves} waves",
                    surface.width()
                ),
            };
            faults.push(context.fault(&place, format!("{who}: term {}: found {found} powers, expected {expected}", k + 1)));
        }
        if let Some(first) = surface.terms[..k].iter().position(|earlier| earlier.powers == term.powers) {
            let powers = &term.powers;
            let what = format!("{who}: term {}: powers {powers:?} occur twice, first in term {}", k + 1, first + 1);
            faults.push(context.fault(&place, what).help("add the two coefficients and keep one term"));
        }
    }
}

/// The most coefficients of a spline: an index is exact in f32, and a table of f64 is not larger than about 64 kB.
pub const MOST_COEFFICIENTS: usize = 4096;

/// The most inputs of a spline: with four, 256 coefficients would be active.
pub const MOST_SPLINE_INPUTS: usize = 3;

/// The fault of a spline's shape over these inputs, and what to do.
///
/// # Errors
/// If an input extrapolates, if there are too many inputs or coefficients, or if `cells` has another length than the inputs.
///
/// ```
/// use rsm_core::{check, model::{Input, Outside}};
///
/// let speed = Input { name: "speed".into(), unit: "m/s".into(), range: [0.0, 30.0], outside: Outside::Clamp };
/// assert!(check::spline_fits(3, &[8], &[&speed]).is_ok());
/// assert!(check::spline_fits(3, &[8, 8], &[&speed]).unwrap_err().0.contains("one an input"));
/// ```
pub fn spline_fits(degree: u32, cells: &[u32], inputs: &[&Input]) -> Result<(), (String, &'static str)> {
    if cells.len() != inputs.len() {
        let what = format!("`cells`: found {} numbers, expected {}, one an input", cells.len(), inputs.len());
        return Err((what, "give the number of cells along each input"));
    }
    if inputs.len() > MOST_SPLINE_INPUTS {
        let what = format!("found {} inputs, expected at most {MOST_SPLINE_INPUTS}", inputs.len());
        return Err((what, "use terms for a surface of more inputs"));
    }
    if let Some(input) = inputs.iter().find(|input| input.outside == Outside::Extrapolate) {
        return Err((format!("`{}` extrapolates, and a spline ends with its cells", input.name), "use outside = \"clamp\""));
    }
    // A model in memory may have any numbers.
    let count = cells.iter().try_fold(1usize, |product, cells| product.checked_mul(*cells as usize + degree as usize + 1));
    if !matches!(degree, 1 | 3) || cells.iter().any(|cells| !(1..=model_file::MOST_CELLS).contains(cells)) {
        let what = format!(
            "found degree {degree} and cells {cells:?}, expected degree 1 or 3 and 1 to {} cells",
            model_file::MOST_CELLS
        );
        return Err((what, "choose the cells so that each contains data"));
    }
    if count.is_none_or(|count| count > MOST_COEFFICIENTS) {
        let what = format!("cells {cells:?} have more than {MOST_COEFFICIENTS} coefficients");
        return Err((what, "use fewer cells"));
    }
    Ok(())
}

fn check_spline(context: &Context<'_>, faults: &mut Collector, surface: &Surface, path: &str) {
    let Some(spline) = &surface.spline else { return };
    let (who, place) = (format!("surface `{}`: `spline`", surface.name), format!("{path}.spline"));
    let others = [
        ("terms", !surface.terms.is_empty()),
        ("coding", surface.coding != Coding::default()),
        ("symmetry", !surface.symmetry.is_empty()),
        ("knots", !surface.knots.is_empty()),
        ("sigmoids", !surface.sigmoids.is_empty()),
        ("waves", !surface.waves.is_empty()),
        ("reciprocal", !surface.reciprocal.is_empty()),
    ];
    for (key, _) in others.iter().filter(|(_, is_there)| *is_there) {
        let what = format!("{who}: cannot be combined with `{key}`");
        faults.push(context.fault(&place, what).help("a spline is the whole surface, in natural variables"));
    }
    let inputs: Option<Vec<&Input>> = surface.inputs.iter().map(|name| context.model().input(name)).collect();
    // Unknown inputs are reported elsewhere.
    let Some(inputs) = inputs.filter(|inputs| !inputs.is_empty()) else { return };
    if let Err((what, help)) = spline_fits(spline.degree, &spline.cells, &inputs) {
        faults.push(context.fault(&place, format!("{who}: {what}")).help(help));
        return;
    }
    if spline.coefficients.iter().any(|coefficient| coefficient.abs() > 1e300) {
        faults.push(context.fault(&place, format!("{who}: a coefficient is {BEYOND} f64")));
    }
    let (found, expected) = (spline.coefficients.len(), spline.counts().iter().product::<usize>());
    if found != expected {
        let counts: Vec<String> = spline.counts().iter().map(usize::to_string).collect();
        let what = format!("{who}: `coefficients`: found {found} numbers, expected {expected} = {}", counts.join(" x "));
        let help = "cells + degree along each input; those of the last input change fastest";
        faults.push(context.fault(&format!("{place}.coefficients"), what).help(help));
    }
}

fn check_symmetry(context: &Context<'_>, faults: &mut Collector, surface: &Surface, path: &str) {
    let who = format!("surface `{}`", surface.name);
    for (name, symmetry) in &surface.symmetry {
        let place = format!("{path}.symmetry.{name}");
        let Some(index) = surface.inputs.iter().position(|input| input == name) else {
            faults.push(context.fault(&place, format!("{who}: `symmetry`: `{name}` is not an input of this surface")));
            continue;
        };
        if let Some(Input { range: [low, high], .. }) = context.model().input(name)
            && *low != -*high
        {
            let what = format!("{who}: `symmetry` of `{name}`: its range [{low}, {high}] is not symmetric about 0");
            faults.push(context.fault(&place, what));
        }
        if surface.reciprocal.contains(name) {
            faults.push(context.fault(&place, format!("{who}: `{name}` cannot have both `symmetry` and `reciprocal`")));
        }
        if *symmetry == Symmetry::Odd {
            check_odd_terms(context, faults, surface, path, index);
        }
    }
}

/// "odd" gives the result the sign of xi, so the result must be 0 at xi = 0; otherwise it would jump.
fn check_odd_terms(context: &Context<'_>, faults: &mut Collector, surface: &Surface, path: &str, index: usize) {
    let name = &surface.inputs[index];
    let of_sigmoids = surface.sigmoids.iter().map(|sigmoid| sigmoid.input == *name);
    let hinges: Vec<_> = surface.knots.iter().map(|knot| knot.input == *name).chain(of_sigmoids).collect();
    for (k, term) in surface.terms.iter().enumerate() {
        let own = term.powers.get(index).is_none_or(|power| *power > 0);
        // A hinge of this input has its knot above 0 (another rule), and the value of a sigmoid at 0 is subtracted: both are 0 at 0.
        let by_hinge =
            hinges.iter().zip(term.powers.iter().skip(surface.inputs.len())).any(|(of_it, power)| *of_it && *power > 0);
        if !own && !by_hinge {
            let what =
                format!("surface `{}`: term {}: `{name}` is odd, and this term does not contain it", surface.name, k + 1);
            let fault = context.fault(&format!("{path}.terms.{k}"), what);
            faults.push(fault.help(format!("give every term a power of `{name}`, else the surface jumps at {name} = 0")));
        }
    }
}

fn check_knots(context: &Context<'_>, faults: &mut Collector, surface: &Surface, path: &str) {
    let who = format!("surface `{}`", surface.name);
    for (k, knot) in surface.knots.iter().enumerate() {
        let place = format!("{path}.knots.{k}");
        let name = &knot.input;
        if !surface.inputs.contains(name) {
            faults.push(context.fault(&place, format!("{who}: knot {}: `{name}` is not an input of this surface", k + 1)));
            continue;
        }
        if let Some(Input { range: [low, high], .. }) = context.model().input(name) {
            let symmetric = surface.symmetry.iter().any(|(input, _)| input == name);
            let low = if symmetric { 0.0 } else { *low };
            if !(low < knot.at && knot.at < *high) {
                let what =
                    format!("{who}: knot {}: found {name} = {}, expected a value between {low} and {high}", k + 1, knot.at);
                faults.push(context.fault(&place, what));
            }
        }
        if surface.knots[..k].contains(knot) {
            faults.push(context.fault(&place, format!("{who}: knot {}: occurs twice", k + 1)));
        }
    }
}

/// The largest width of a sigmoid relative to the range; the smallest is its inverse.
const WIDEST: f64 = 1e6;

/// The fault of a sigmoid for an input of this range, and what to do.
///
/// # Errors
/// If the centre is far outside of the range, if the width is not between a millionth of the range and a million times the range, or if the squares
/// of the numbers exceed f64.
///
/// ```
/// use rsm_core::{check, model::Sigmoid};
///
/// let at = |at| Sigmoid { input: "speed".into(), at, width: 0.5 }; // m/s
/// assert!(check::sigmoid_fits(&at(3.0), [0.0, 30.0]).is_ok());
/// assert!(check::sigmoid_fits(&at(90.0), [0.0, 30.0]).unwrap_err().0.starts_with("found speed = 90, expected a value from -30 to 60"));
/// ```
pub fn sigmoid_fits(sigmoid: &Sigmoid, [low, high]: [f64; 2]) -> Result<(), (String, &'static str)> {
    let Sigmoid { input, at, width } = sigmoid;
    let span = high - low;
    let (least, most) = (low - span, high + span);
    if !(least <= *at && *at <= most) {
        let what = format!("found {input} = {at}, expected a value from {least} to {most}");
        return Err((what, "a step so far away has no bend inside the range: use powers of the input"));
    }
    if !(span / WIDEST <= *width && *width <= span * WIDEST) {
        let what = format!("`width`: found {width}, expected {:e} to {:e}", span / WIDEST, span * WIDEST);
        return Err((what, "the step rises from -2/3 at `at` - `width` to 2/3 at `at` + `width`"));
    }
    if !fits_sigmoid(Precision::F64, sigmoid, [low, high]) {
        return Err((format!("its squares are {BEYOND} f64"), "give the input a unit in which its numbers are nearer to 1"));
    }
    Ok(())
}

fn check_sigmoids(context: &Context<'_>, faults: &mut Collector, surface: &Surface, path: &str) {
    for (k, Sigmoid { input: name, .. }) in surface.sigmoids.iter().enumerate() {
        let place = format!("{path}.sigmoids.{k}");
        let who = format!("surface `{}`: sigmoid {}", surface.name, k + 1);
        if !surface.inputs.contains(name) {
            faults.push(context.fault(&place, format!("{who}: `{name}` is not an input of this surface")));
            continue;
        }
        if surface.reciprocal.contains(name) {
            let what = format!("{who}: `{name}` cannot have both `sigmoids` and `reciprocal`");
            faults.push(context.fault(&place, what).help("make a sigmoid of an input that enters as it is"));
        }
        if let Some(input) = context.model().input(name)
            && let Err((what, help)) = sigmoid_fits(&surface.sigmoids[k], input.range)
        {
            faults.push(context.fault(&place, format!("{who}: {what}")).help(help));
        }
        if surface.sigmoids[..k].contains(&surface.sigmoids[k]) {
            faults.push(context.fault(&place, format!("{who}: occurs twice")));
        }
    }
}

/// The fault of a wave over this input, and what to do.
///
/// # Errors
/// If the input extrapolates, if the range is wider than a period, or if the period is wider than a million ranges.
///
/// ```
/// use rsm_core::{check, model::{Input, Outside, Wave}};
///
/// let angle = Input { name: "angle".into(), unit: "rad".into(), range: [0.0, 6.0], outside: Outside::Clamp };
/// let wave = |period| Wave { input: "angle".into(), period, order: 12 };
/// assert!(check::wave_fits(&wave(6.5), &angle).is_ok());
/// assert!(check::wave_fits(&wave(3.0), &angle).unwrap_err().0.contains("wider than the period"));
/// ```
pub fn wave_fits(wave: &Wave, input: &Input) -> Result<(), (String, &'static str)> {
    let [low, high] = input.range;
    if input.outside == Outside::Extrapolate {
        let what = format!("`{}` extrapolates, and a wave is known over one period only", input.name);
        return Err((what, "use outside = \"clamp\", and bring the argument into the range before"));
    }
    if wave.period <= 0.0 || high - low > wave.period {
        let what = format!("the range of `{}` from {low} to {high} is wider than the period {}", input.name, wave.period);
        return Err((what, "give the input a range of one period at most"));
    }
    if wave.period > WIDEST * (high - low) {
        let what = format!("the period {} is more than {WIDEST:e} times the range of `{}`", wave.period, input.name);
        return Err((what, "inside the range such a long wave is a straight line: use powers of the input"));
    }
    Ok(())
}

fn check_waves(context: &Context<'_>, faults: &mut Collector, surface: &Surface, path: &str) {
    for (k, wave) in surface.waves.iter().enumerate() {
        let place = format!("{path}.waves.{k}");
        let (who, name) = (format!("surface `{}`: wave {}", surface.name, k + 1), &wave.input);
        if !surface.inputs.contains(name) {
            faults.push(context.fault(&place, format!("{who}: `{name}` is not an input of this surface")));
            continue;
        }
        if surface.reciprocal.contains(name) || surface.is_symmetric(name) {
            let what = format!("{who}: `{name}` cannot have `waves` beside `reciprocal` or `symmetry`");
            faults.push(context.fault(&place, what));
        }
        // The reader of a file rejects it; a model in memory is checked here.
        if !(1..=model_file::HIGHEST_ORDER).contains(&wave.order) {
            let what = format!("{who}: `order`: found {}, expected 1 to {}", wave.order, model_file::HIGHEST_ORDER);
            faults.push(context.fault(&place, what));
        }
        if let Some(input) = context.model().input(name)
            && let Err((what, help)) = wave_fits(wave, input)
        {
            faults.push(context.fault(&place, format!("{who}: {what}")).help(help));
        }
        if surface.waves[..k].contains(wave) {
            faults.push(context.fault(&place, format!("{who}: occurs twice")));
        }
    }
}

fn check_reciprocal(context: &Context<'_>, faults: &mut Collector, surface: &Surface, path: &str) {
    let who = format!("surface `{}`", surface.name);
    for (k, name) in surface.reciprocal.iter().enumerate() {
        let place = format!("{path}.reciprocal.{k}");
        if !surface.inputs.contains(name) {
            faults.push(context.fault(&place, format!("{who}: `reciprocal`: `{name}` is not an input of this surface")));
        } else if surface.reciprocal[..k].contains(name) {
            faults.push(context.fault(&place, format!("{who}: `reciprocal`: `{name}` occurs twice")));
        } else if let Some(Input { range: [low, high], .. }) = context.model().input(name)
            && *low <= 0.0
            && *high >= 0.0
        {
            let what = format!("{who}: `reciprocal` of `{name}`: its range [{low}, {high}] contains 0");
            faults.push(context.fault(&place, what).help("give the input a range on one side of 0"));
        }
    }
}

fn check_support(context: &Context<'_>, faults: &mut Collector, surface: &Surface, path: &str) {
    let who = format!("surface `{}`", surface.name);
    for (k, space) in surface.support.iter().enumerate() {
        let place = format!("{path}.support.{k}");
        let (found, expected) = (space.normal.len(), surface.inputs.len());
        if found != expected {
            let what =
                format!("{who}: half-space {}: found {found} numbers in `normal`, expected {expected}, one an input", k + 1);
            faults.push(context.fault(&place, what));
        } else if space.normal.iter().all(|entry| *entry == 0.0) {
            faults.push(context.fault(&place, format!("{who}: half-space {}: `normal` is zero", k + 1)));
        }
    }
}

fn check_compensators(context: &Context<'_>, faults: &mut Collector) {
    for compensator in &context.model().compensators {
        let path = format!("compensators.{}", compensator.name);
        if let Some(reason) = names::refuse_function(&context.model().name, &compensator.name) {
            faults.push(context.fault(&path, format!("compensator name `{}` {reason}", compensator.name)));
        }
        if compensator.sample_time <= 0.0 {
            let what = format!(
                "compensator `{}`: `sample_time`: found {} s, expected more than 0",
                compensator.name, compensator.sample_time
            );
            faults.push(context.fault(&format!("{path}.sample_time"), what));
        }
        if compensator.sample_time > 0.0 && !fits_fixed(Precision::F64, compensator.sample_time) {
            let what =
                format!("compensator `{}`: `sample_time`: {:e} s is {BEYOND} f64", compensator.name, compensator.sample_time);
            faults.push(context.fault(&format!("{path}.sample_time"), what));
        }
        check_scheduled(context, faults, compensator, &path);
        if !fits_ratio(Precision::F64, compensator) {
            faults.push(context.fault(&format!("{path}.pole_frequency"), beyond_ratio(compensator, "f64")));
        }
        for input in schedule(context.model(), compensator) {
            if let Some(reason) = names::refuse_scheduled(&input.name) {
                let what = format!("compensator `{}`: the input name `{}` {reason}", compensator.name, input.name);
                faults.push(context.fault(&format!("inputs.{}", input.name), what));
            }
        }
    }
}

fn check_scheduled(context: &Context<'_>, faults: &mut Collector, compensator: &Compensator, path: &str) {
    let who = format!("compensator `{}`", compensator.name);
    for (key, scheduled) in compensator.parts() {
        let place = format!("{path}.{key}");
        if let Some(value) = scheduled.fixed()
            && value <= 0.0
        {
            faults.push(context.fault(&place, format!("{who}: `{key}`: found {value}, expected more than 0")));
        } else if let Some(value) = scheduled.fixed()
            && !fits_fixed(Precision::F64, value)
        {
            faults.push(context.fault(&place, format!("{who}: `{key}`: {value:e} is {BEYOND} f64")));
        }
        for name in scheduled.surfaces() {
            if context.model().surface(name).is_some_and(|surface| surface.spline.is_some()) {
                let what = format!("{who}: `{key}`: the surface `{name}` is a spline");
                let help = "the proof of stability is about polynomials: give the surface terms";
                faults.push(context.fault(&place, what).help(help));
            }
            if context.model().surface(name).is_none() && context.knows_all("surfaces", name) {
                faults.push(context.fault(&place, format!("{who}: `{key}`: there is no surface `{name}`")));
            }
        }
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

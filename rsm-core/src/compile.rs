//! The whole compiler in one call: from a model file to source text.
//!
//! The macro, build.rs and the command line all call these functions, so they give the same text and the same errors.

use crate::certificate;
use crate::check::Checked;
use crate::emit::{self, Function, Kept, Kind, Unit};
use crate::interval::Interval;
use crate::lower::{self, Recursive, Saturation};
use crate::model::{Category, Input, Outside, Surface};
use crate::names;
use crate::number::{self, Precision};
use crate::source::{Fault, Faults, Source};
use crate::values::Values;

/// A model as a Rust module.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RustModule {
    /// The name of the model, to be used as the name of the module.
    pub model: String,
    /// The text of the module.
    pub text: String,
}

/// The evaluators of a checked model, ready for a printer. `precisions` empty: every precision that can represent the model.
///
/// # Errors
/// The faults of a requested precision that cannot represent the model; a compensator whose stability is not proved.
///
/// ```
/// # let text = "format = 1\nmodel = \"car\"\n[inputs.speed]\nunit = \"m/s\"\nrange = [0.0, 30.0]\n[surfaces.drag]\nunit = \"N\"\n\
/// #     inputs = [\"speed\"]\nterms = [{ powers = [0], coefficient = 35.0 }, { powers = [1], coefficient = 30.0 }]\n";
/// # let checked = rsm_core::check::Checked::read(&rsm_core::source::Source::new("car.toml", text))?;
/// // A line from 5 N at rest to 65 N at 30 m/s.
/// use rsm_core::{compile, number::Precision};
///
/// let unit = compile::unit(&checked, &[Precision::F64, Precision::F32])?;
/// assert_eq!((unit.model.as_str(), unit.functions.len()), ("car", 2)); // one surface in two precisions
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
pub fn unit(checked: &Checked, precisions: &[Precision]) -> Result<Unit, Faults> {
    unit_with_parts(checked, precisions, &Parts::default())
}

/// The evaluators of a checked model as [`unit()`] gives them, and after each surface the function of its gradient.
///
/// # Errors
/// As [`unit()`]; a surface whose gradient would have the name of another function.
///
/// ```
/// # let text = "format = 1\nmodel = \"car\"\n[inputs.speed]\nunit = \"m/s\"\nrange = [0.0, 30.0]\n[surfaces.drag]\nunit = \"N\"\n\
/// #     inputs = [\"speed\"]\nterms = [{ powers = [0], coefficient = 35.0 }, { powers = [1], coefficient = 30.0 }]\n";
/// # let checked = rsm_core::check::Checked::read(&rsm_core::source::Source::new("car.toml", text))?;
/// // A line from 5 N at rest to 65 N at 30 m/s.
/// use rsm_core::{compile, number::Precision};
///
/// let unit = compile::unit_with_gradients(&checked, &[Precision::F64])?;
/// assert_eq!(unit.functions[1].c_name("car"), "car_drag_gradient");
/// assert_eq!(unit.functions[1].derivatives[0].range.high, 2.0); // N per m/s
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
pub fn unit_with_gradients(checked: &Checked, precisions: &[Precision]) -> Result<Unit, Faults> {
    unit_with_parts(checked, precisions, &Parts { gradient: true, ..Parts::default() })
}

/// Functions of a surface in addition to the surface itself and its support test.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Parts {
    /// The gradient.
    pub gradient: bool,
    /// The surface without its clamps ([`lower::inside`]).
    pub inside: bool,
    /// The rarely changed inputs, whose part `inside` computes once.
    pub once: Vec<String>,
    /// The surfaces that follow measured responses, by name, with their settings.
    pub recursive: Vec<(String, Recursive)>,
}

/// The evaluators of a checked model as [`unit()`] gives them, and after each surface the requested parts.
///
/// # Errors
/// As [`unit()`]; a part with the name of another function; an input of `once` that no surface has, or whose part in a surface is not a single
/// number; a surface that cannot be updated with its settings.
///
/// ```
/// # let text = "format = 1\nmodel = \"car\"\n[inputs.speed]\nunit = \"m/s\"\nrange = [0.0, 30.0]\n[inputs.load]\nunit = \"t\"\nrange = [0.0, 2.0]\n\
/// #     [surfaces.drag]\nunit = \"N\"\ninputs = [\"speed\", \"load\"]\nterms = [{ powers = [1, 0], coefficient = 35.0 }, { powers = [0, 1], coefficient = 30.0 }]\n";
/// # let checked = rsm_core::check::Checked::read(&rsm_core::source::Source::new("car.toml", text))?;
/// // A car is loaded before it drives.
/// use rsm_core::{compile, compile::Parts, number::Precision};
///
/// let parts = Parts { inside: true, once: vec!["load".to_string()], ..Parts::default() };
/// let unit = compile::unit_with_parts(&checked, &[Precision::F64], &parts)?;
/// let names: Vec<String> = unit.functions.iter().map(|function| function.rust_name()).collect();
/// assert_eq!(names, ["drag", "drag_once", "drag_inside"]);
/// assert_eq!(unit.functions[2].tape.inputs, ["speed", "drag_once"]);
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
pub fn unit_with_parts(checked: &Checked, precisions: &[Precision], parts: &Parts) -> Result<Unit, Faults> {
    let model = checked.model();
    let refuse = |what: String, help: &str| Faults::one(Fault::whole_file(checked.file(), what).help(help));
    let surfaces: Vec<&str> = model.surfaces.iter().map(|surface| surface.name.as_str()).collect();
    let compensators = model.compensators.iter().map(|compensator| compensator.name.as_str());
    let functions_of: Vec<&str> = surfaces.iter().copied().chain(compensators).collect();
    let clash_of_gradients = || parts.gradient.then(|| names::clash_of_gradients(&surfaces, &functions_of)).flatten();
    if let Some((surface, why)) = clash_of_gradients() {
        return Err(refuse(format!("surface `{surface}`: {why}"), "rename one of them, or emit without gradients"));
    }
    let clash_of_parts = || parts.inside.then(|| names::clash_of_parts(&surfaces, &functions_of)).flatten();
    if let Some((surface, why)) = clash_of_parts() {
        return Err(refuse(format!("surface `{surface}`: {why}"), "rename one of them, or emit without parts"));
    }
    for name in &parts.once {
        let have = |surface: &Surface| surface.inputs.contains(name);
        if !model.surfaces.iter().any(have) {
            let inputs: Vec<&str> = model.inputs.iter().map(|input| input.name.as_str()).collect();
            return Err(refuse(format!("no surface has the input `{name}`"), &format!("inputs are {}", inputs.join(", "))));
        }
        let own = |surface: &&Surface| surface.inputs.iter().any(|input| *input == format!("{}_once", surface.name));
        if let Some(surface) = model.surfaces.iter().find(own) {
            let what = format!(
                "surface `{0}`: its input `{0}_once` has the name of the argument for what is computed once",
                surface.name
            );
            return Err(refuse(what, "rename the input"));
        }
    }
    let states = parts.recursive.iter().map(|(name, _)| name.as_str());
    let states: Vec<&str> = model.compensators.iter().map(|it| it.name.as_str()).chain(states).collect();
    for (name, settings) in &parts.recursive {
        let Some(surface) = model.surface(name) else {
            return Err(refuse(format!("there is no surface `{name}`"), &format!("surfaces are {}", surfaces.join(", "))));
        };
        let why = settings.refusal(surface).or_else(|| names::clash_of_updates(name, &functions_of, &states));
        if let Some(why) = why {
            return Err(Faults::one(Fault::whole_file(checked.file(), format!("surface `{name}` cannot be updated: {why}"))));
        }
    }
    functions(checked, precisions, parts)
}

/// The functions without clamps of one surface.
fn inside(checked: &Checked, index: usize, precision: Precision, once: &[String]) -> Result<Vec<Function>, Faults> {
    let surface = &checked.model().surfaces[index];
    let parts = lower::inside(checked, index, precision, once).map_err(|count| {
        let what = format!(
            "surface `{}`: the part that depends on {} alone gives {count} numbers, expected one",
            surface.name,
            once.join(", ")
        );
        let help = "an input can be given once where no term multiplies it with another input";
        Faults::one(Fault::whole_file(checked.file(), what).help(help))
    })?;
    let inputs = checked.inputs_of(surface);
    let of_names = |names: &[String]| -> Vec<Input> {
        names.iter().filter_map(|name| inputs.iter().find(|input| input.name == *name).cloned()).collect()
    };
    let function = |kind, inputs, tape| Function {
        surface: surface.name.clone(),
        kind,
        unit: surface.unit.clone(),
        inputs,
        saturation: None,
        derivatives: vec![],
        kept: vec![],
        rules: meanings(surface),
        tape,
    };
    let mut rest = of_names(&parts.rest.inputs);
    let mut all = vec![];
    if let Some(tape) = parts.once {
        let own = of_names(&tape.inputs);
        let cell: Vec<Interval> = own.iter().map(|input| Interval::new(input.range[0], input.range[1])).collect();
        let values = Values::new(&tape).over(&cell);
        rest.push(Input {
            name: tape.name.clone(),
            unit: surface.unit.clone(),
            range: [values.low, values.high],
            outside: Outside::Extrapolate,
        });
        all.push(function(Kind::Once, own, tape));
    }
    all.push(function(Kind::Inside, rest, parts.rest));
    Ok(all)
}

fn functions(checked: &Checked, precisions: &[Precision], parts: &Parts) -> Result<Unit, Faults> {
    let model = checked.model();
    for index in 0..model.compensators.len() {
        certificate::compensator::require_stable(checked, index)?;
    }
    let mut functions = Vec::new();
    for precision in held(checked, precisions)? {
        for (index, surface) in model.surfaces.iter().enumerate() {
            let function = |kind, tape| Function {
                surface: surface.name.clone(),
                kind,
                unit: surface.unit.clone(),
                inputs: checked.inputs_of(surface),
                saturation: if kind == Kind::Support { None } else { lower::saturation(checked, index, precision) },
                derivatives: if kind == Kind::Gradient {
                    certificate::gradient::derivatives(checked, index, precision)
                } else {
                    vec![]
                },
                kept: vec![],
                rules: meanings(surface),
                tape,
            };
            functions.push(function(Kind::Surface, lower::surface(checked, index, precision)));
            if parts.gradient {
                functions.push(function(Kind::Gradient, lower::gradient(checked, index, precision)));
            }
            if parts.inside {
                functions.extend(inside(checked, index, precision, &parts.once)?);
            }
            if let Some((_, settings)) = parts.recursive.iter().find(|(name, _)| *name == surface.name) {
                functions.extend(recursive(checked, index, precision, settings));
            }
            functions.extend(lower::support(checked, index, precision).map(|tape| function(Kind::Support, tape)));
        }
        functions.extend((0..model.compensators.len()).map(|index| step(checked, index, precision)));
    }
    Ok(Unit { model: model.name.clone(), functions })
}

/// The meaning of the inputs that are contrasts of a category, one line each.
fn meanings(surface: &Surface) -> Vec<String> {
    let of_one = |category: &Category| -> Vec<String> {
        let line = |(k, input): (usize, &String)| format!("`{input}`: {}.", emit::plain(&category.words(k)));
        category.inputs.iter().enumerate().map(line).collect()
    };
    surface.categories.iter().flat_map(of_one).collect()
}

/// The update of a surface that follows measured responses, and the evaluator of the adapted surface, for a printer.
fn recursive(checked: &Checked, index: usize, precision: Precision, settings: &Recursive) -> [Function; 2] {
    let surface = &checked.model().surfaces[index];
    let follower = lower::recursive(checked, index, precision, settings);
    let terms =
        surface.terms.iter().map(|term| format!("coefficient of {}, in {}", surface.term_name(&term.powers), surface.unit));
    let about = |name: &str| match name.as_bytes()[0] {
        b'd' => format!("entry {} of the diagonal D of the covariance U D U'", &name[1..]),
        b'u' => format!("entry {} of the factor U", name[1..].replace('_', ", ")),
        _ => "the coefficient that the next step measures".to_string(),
    };
    let names = follower.update.states.iter().skip(surface.terms.len()).map(|state| about(&state.name));
    let kept: Vec<Kept> =
        follower.start.iter().zip(terms.chain(names)).map(|(start, about)| Kept { start: *start, about }).collect();
    // A self-test draws the measured response within one standard deviation of its noise from the prediction.
    let measured = Input {
        name: names::MEASURED.to_string(),
        unit: surface.unit.clone(),
        range: [-settings.noise, settings.noise],
        outside: Outside::Extrapolate,
    };
    let [forgetting, noise, gate, limit] =
        [settings.forgetting, settings.noise, settings.gate, settings.limit].map(number::decimal);
    let unit = emit::unit(&surface.unit);
    let mut rules = meanings(surface);
    let own = [
        "Results: the measured response minus its prediction; the variance of that difference, in units of the noise's; 0 for a".to_string(),
        "step that was used, or why the state was left as it was, bit for bit: 1 a number is not finite, 2 outside the range of an".to_string(),
        format!("input or the support, 3 the difference is above {gate} of its standard deviations, 4 a next state would not be finite."),
        format!("Forgetting factor {forgetting}, noise {noise} in {unit}. No coefficient has a standard deviation above {limit}, whatever the"),
        format!("inputs, and one step moves it by at most {gate} times that."),
    ];
    rules.extend(own);
    let inputs = checked.inputs_of(surface);
    let function = |kind, inputs: Vec<Input>, kept: Vec<Kept>, rules, tape| Function {
        surface: surface.name.clone(),
        kind,
        unit: surface.unit.clone(),
        inputs,
        saturation: surface.output_range.filter(|_| kind == Kind::Adapted).map(|bounds| Saturation {
            bounds,
            below: true,
            above: true,
            values: None,
        }),
        derivatives: vec![],
        kept,
        rules,
        tape,
    };
    let coefficients = kept[..surface.terms.len()].to_vec();
    [
        function(Kind::Update, inputs.iter().cloned().chain([measured]).collect(), kept, rules, follower.update),
        function(Kind::Adapted, inputs, coefficients, meanings(surface), follower.adapted),
    ]
}

/// The step of a compensator, for a printer.
fn step(checked: &Checked, index: usize, precision: Precision) -> Function {
    let compensator = &checked.model().compensators[index];
    // The signal has no range. A self-test uses this one, which suits a pedal or a normalised demand.
    let signal =
        Input { name: lower::SIGNAL.to_string(), unit: String::new(), range: [-1.0, 1.0], outside: Outside::Extrapolate };
    Function {
        surface: compensator.name.clone(),
        kind: Kind::Step,
        unit: format!("every {} s", number::decimal(compensator.sample_time)),
        inputs: std::iter::once(signal).chain(checked.schedule_of(compensator)).collect(),
        saturation: None,
        derivatives: vec![],
        kept: vec![],
        rules: vec![],
        tape: lower::compensator(checked, index, precision),
    }
}

/// The requested precisions, which must all be able to represent the model. If none is requested: those that can. f64 can represent every checked
/// model.
///
/// # Errors
/// The faults of a precision that cannot represent the model.
pub fn held(checked: &Checked, precisions: &[Precision]) -> Result<Vec<Precision>, Faults> {
    if precisions.is_empty() {
        return Ok(Precision::ALL.into_iter().filter(|precision| checked.refusal(*precision).is_none()).collect());
    }
    match precisions.iter().find_map(|precision| checked.refusal(*precision)) {
        Some(faults) => Err(faults),
        None => Ok(precisions.to_vec()),
    }
}

/// A model file as a Rust module.
///
/// # Errors
/// Every fault of the file.
///
/// ```
/// # let text = "format = 1\nmodel = \"car\"\n[inputs.speed]\nunit = \"m/s\"\nrange = [0.0, 30.0]\n[surfaces.drag]\nunit = \"N\"\n\
/// #     inputs = [\"speed\"]\nterms = [{ powers = [0], coefficient = 35.0 }, { powers = [1], coefficient = 30.0 }]\n";
/// # let checked = rsm_core::check::Checked::read(&rsm_core::source::Source::new("car.toml", text))?;
/// // A line from 5 N at rest to 65 N at 30 m/s.
/// use rsm_core::{compile, source::Source};
///
/// let module = compile::rust(&Source::new("car.toml", text), &[])?;
/// assert!(module.text.contains("pub fn drag_f32(speed: f32) -> f32"));
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
pub fn rust(source: &Source, precisions: &[Precision]) -> Result<RustModule, Faults> {
    let unit = unit(&Checked::read(source)?, precisions)?;
    Ok(RustModule { text: emit::rust::emit(&unit), model: unit.model })
}

/// A model file as a Rust module as [`rust`] gives it, and after each surface the function of its gradient.
///
/// # Errors
/// Every fault of the file; a surface whose gradient would have the name of another function.
///
/// ```
/// # let text = "format = 1\nmodel = \"car\"\n[inputs.speed]\nunit = \"m/s\"\nrange = [0.0, 30.0]\n[surfaces.drag]\nunit = \"N\"\n\
/// #     inputs = [\"speed\"]\nterms = [{ powers = [0], coefficient = 35.0 }, { powers = [1], coefficient = 30.0 }]\n";
/// # let checked = rsm_core::check::Checked::read(&rsm_core::source::Source::new("car.toml", text))?;
/// // A line from 5 N at rest to 65 N at 30 m/s.
/// use rsm_core::{compile, source::Source};
///
/// let module = compile::rust_with_gradients(&Source::new("car.toml", text), &[])?;
/// assert!(module.text.contains("pub fn drag_gradient(speed: f64) -> [f64; 1]"));
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
pub fn rust_with_gradients(source: &Source, precisions: &[Precision]) -> Result<RustModule, Faults> {
    rust_with_parts(source, precisions, &Parts { gradient: true, ..Parts::default() })
}

/// A model file as a Rust module as [`rust`] gives it, and after each surface the requested parts.
///
/// # Errors
/// Every fault of the file; as [`unit_with_parts`].
pub fn rust_with_parts(source: &Source, precisions: &[Precision], parts: &Parts) -> Result<RustModule, Faults> {
    let unit = unit_with_parts(&Checked::read(source)?, precisions, parts)?;
    Ok(RustModule { text: emit::rust::emit(&unit), model: unit.model })
}

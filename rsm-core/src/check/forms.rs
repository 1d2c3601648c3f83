//! Rules of the forms of a surface: splines, symmetry, knots, sigmoids, waves.
//!
//! In: a surface of a model. Out: faults at its parts. The rules of one form are also functions of their own, for a fit that makes such a form.

use super::context::Context;
use super::fits::{BEYOND, fits_sigmoid};
use crate::model::{Coding, Input, Outside, Sigmoid, Surface, Symmetry, Wave};
use crate::model_file;
use crate::number::{Precision, exact};
use crate::range;
use crate::source::Collector;

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

pub(super) fn check_spline(context: &Context<'_>, faults: &mut Collector, surface: &Surface, path: &str) {
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

pub(super) fn check_symmetry(context: &Context<'_>, faults: &mut Collector, surface: &Surface, path: &str) {
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
pub(super) fn check_odd_terms(context: &Context<'_>, faults: &mut Collector, surface: &Surface, path: &str, index: usize) {
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

pub(super) fn check_knots(context: &Context<'_>, faults: &mut Collector, surface: &Surface, path: &str) {
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

pub(super) fn check_sigmoids(context: &Context<'_>, faults: &mut Collector, surface: &Surface, path: &str) {
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

pub(super) fn check_waves(context: &Context<'_>, faults: &mut Collector, surface: &Surface, path: &str) {
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

/// The fault of a surface's transform over the box of these inputs, and what to do. No fault without a transform.
///
/// # Errors
/// If a reciprocal may reach 0, or if the responses exceed the precision.
pub fn transform_fits(surface: &Surface, inputs: &[Input], precision: Precision) -> Result<(), (String, &'static str)> {
    let Some(transform) = surface.transform else { return Ok(()) };
    let terms = range::of_terms(surface, inputs);
    if transform.needs_positive() && terms.low <= 0.0 {
        let what = format!("the value of the terms reaches {:.4e} in the box, expected more than 0 everywhere", terms.low);
        return Err((what, "give the inputs narrower ranges, a constraint on the response, or use another transform"));
    }
    let most = transform.over(terms).magnitude();
    if !most.is_finite() || !precision.round(&exact(most)).is_finite() {
        return Err((format!("a response in the box is {BEYOND} {}", precision.name()), "use another unit of the response"));
    }
    Ok(())
}

/// The surface itself is sound.
pub(super) fn check_transform(context: &Context<'_>, faults: &mut Collector, surface: &Surface, path: &str) {
    let Some(transform) = surface.transform else { return };
    let mut fault = |what: String, help: &'static str| {
        let who = format!("surface `{}`: `transform` \"{}\"", surface.name, transform.word());
        faults.push(context.fault(&format!("{path}.transform"), format!("{who}: {what}")).help(help));
    };
    if let Some((odd, _)) = surface.symmetry.iter().find(|(_, symmetry)| *symmetry == Symmetry::Odd) {
        let help = "an odd response changes its sign, and a transform keeps it: use \"even\", or no transform";
        return fault(format!("cannot be combined with the odd input `{odd}`"), help);
    }
    let inputs: Option<Vec<Input>> = surface.inputs.iter().map(|name| context.model().input(name).cloned()).collect();
    // Unknown inputs and empty ranges are reported elsewhere.
    let Some(inputs) = inputs.filter(|inputs| inputs.iter().all(|input| input.range[0] < input.range[1])) else { return };
    if let Some(input) = inputs.iter().find(|input| input.outside == Outside::Extrapolate && transform.needs_positive()) {
        let what = format!("`{}` extrapolates, and nothing keeps the terms above 0 there", input.name);
        return fault(what, "use outside = \"clamp\", or another transform");
    }
    if let Err((what, help)) = transform_fits(surface, &inputs, Precision::F64) {
        fault(what, help);
    }
}

pub(super) fn check_categories(context: &Context<'_>, faults: &mut Collector, surface: &Surface, path: &str) {
    for (k, category) in surface.categories.iter().enumerate() {
        let who = format!("surface `{}`: category `{}`", surface.name, category.name);
        let mut fault = |what: String, help: &str| {
            let fault = context.fault(&format!("{path}.categories.{k}"), format!("{who}: {what}"));
            faults.push(if help.is_empty() { fault } else { fault.help(help.to_string()) });
        };
        let (levels, inputs) = (category.levels.len(), category.inputs.len());
        if levels < 2 || inputs + 1 != levels {
            let what = format!(
                "found {levels} levels and {inputs} inputs, expected at least 2 levels, and an input for each but the last"
            );
            fault(what, "");
        }
        for (place, level) in
            category.levels.iter().enumerate().filter(|(place, level)| category.levels[..*place].contains(level))
        {
            let first = category.levels.iter().position(|known| known == level).unwrap_or(place);
            fault(format!("the level `{level}` is given twice, as number {} and {}", first + 1, place + 1), "");
        }
        for (place, name) in category.inputs.iter().enumerate() {
            let is_twice = category.inputs[..place].contains(name);
            if is_twice || surface.categories[..k].iter().any(|earlier| earlier.inputs.contains(name)) {
                fault(format!("`{name}` is the input of two levels"), "");
            } else if !surface.inputs.contains(name) {
                fault(format!("`{name}` is not an input of this surface"), "");
            } else if let Some(input) = context.model().input(name) {
                let [low, high] = input.range;
                if input.range != [-1.0, 1.0] {
                    fault(format!("the range of `{name}` is [{low}, {high}], expected [-1, 1]"), "");
                }
                if input.outside == Outside::Extrapolate {
                    fault(
                        format!("`{name}` extrapolates"),
                        "beyond its levels a category has no meaning: use outside = \"clamp\"",
                    );
                }
            }
            if surface.has_form(name) {
                fault(
                    format!("`{name}` has `symmetry`, `knots`, `sigmoids`, `waves` or `reciprocal`"),
                    "a contrast has three values only",
                );
            }
        }
    }
}

//! A plant of equations in the form that `rsm emit` prints.
//!
//! In: a machine, its start, the step length. Out: a [`Plant`] for the printers, with names that are valid in C and Rust; or a sentence with the
//! reason why it is not possible.

use rsm_core::emit::plant::{Plant, Signal};
use rsm_core::names;
use rsm_core::number::decimal;
use rsm_model::expression::Symbol;

use super::linear::{Linearised, Pole};
use super::machine::{Machine, Point};
use super::step::{Kept, Step};

/// A step is refused if the method increases a mode by more than this factor in one step: 1 plus rounding.
const GROWTH: f64 = 1.0 + 1e-9;

/// The start at which a plant is emitted.
#[derive(Debug, Clone)]
pub struct Start<'p> {
    /// The point.
    pub point: &'p Point,
    /// Particular conditions of this start, in words; empty if there are none.
    pub words: String,
    /// The linear model at this point.
    pub linear: &'p Linearised,
}

/// The plant to emit: steps of a length in s, from a start. `model` is the prefix of its names; if it is `None`, the plant's own name is used.
///
/// # Errors
/// A sentence: the step does not fit the text, or is too long for the fastest rate at the start.
pub fn plant(machine: &Machine, length: f64, start: &Start<'_>, model: Option<&str>, file: &str) -> Result<Plant, String> {
    let step = Step::new(machine, length)?;
    if let Some((pole, longest)) = too_fast(&start.linear.poles, length) {
        return Err(format!(
            "{} s is too long for the fastest rate at the start, {} 1/s ({}): the classical Runge-Kutta method is stable up to {} s",
            decimal(length),
            short(pole.frequency()),
            described(&pole),
            short(longest)
        ));
    }
    let system = machine.system();
    let name = model.map_or_else(|| names::plant::model(&system.flat().name), str::to_string);
    if let Some(why) = names::refuse_model(&name) {
        return Err(format!("the name `{name}` {why}"));
    }
    let signal = |symbol: Symbol, words: &str| {
        let variable = system.flat().variable(symbol);
        let words = match (variable.description.as_str(), words) {
            ("", words) => words.to_string(),
            (text, "") => text.to_string(),
            (text, words) => format!("{text}; {words}"),
        };
        Signal { unit: variable.unit.clone().unwrap_or_default(), words, range: range(machine, symbol) }
    };
    let mut tape = step.tape.clone();
    tape.inputs = names::plant::signals(system.inputs().iter().map(|it| system.name(*it)));
    let outputs = system.outputs();
    let output_names = names::plant::signals(outputs.iter().map(|it| system.name(*it)));
    tape.outputs.iter_mut().zip(output_names).for_each(|(it, name)| it.name = name);
    let kept: Vec<(String, Signal)> = step.kept.iter().map(|it| described_state(machine, *it, &signal)).collect();
    let state_names = names::plant::signals(kept.iter().map(|it| it.0.as_str()));
    tape.states.iter_mut().zip(state_names).for_each(|(it, name)| it.name = name);
    tape.name.clone_from(&name);
    let values = step.start(machine, start.point);
    let parameters = system
        .parameters()
        .into_iter()
        .zip(machine.values_of_parameters())
        .map(|(it, value)| {
            let variable = system.flat().variable(it);
            (variable.name.clone(), *value, variable.unit.clone().unwrap_or_default())
        })
        .collect();
    let description = &system.flat().description;
    let about = if description.is_empty() { String::new() } else { format!(": {description}") };
    let at = if start.words.is_empty() { String::new() } else { format!(", {}", start.words) };
    Ok(Plant {
        about: format!("The plant `{}` of {file}{about}.", system.flat().name),
        length,
        inputs: system.inputs().into_iter().map(|it| signal(it, "")).collect(),
        outputs: outputs.into_iter().map(|it| signal(it, "")).collect(),
        states: kept.into_iter().map(|it| it.1).zip(values).collect(),
        parameters,
        start: format!("the starts and initial equations of the plant{at}"),
        model: name,
        tape,
    })
}

/// The name of a state of the step, and its description for a reader.
fn described_state(machine: &Machine, kept: Kept, signal: &dyn Fn(Symbol, &str) -> Signal) -> (String, Signal) {
    let system = machine.system();
    let of = |symbol: Symbol, words: &str| (system.name(symbol).to_string(), signal(symbol, words));
    let plain = |name: String, words: String| (name, Signal { words, ..Signal::default() });
    match kept {
        Kept::State(k) => of(system.states()[k], ""),
        Kept::Memory(k) => of(system.memories()[k].variable, "kept from event to event"),
        Kept::Solution(k) => of(system.iterated()[k].unknown, "the last solution"),
        Kept::Held(k) => {
            let switch = &system.switches()[k];
            plain(
                format!("comparison_{}", k + 1),
                format!("1 where {} < {}", system.text(switch.left), system.text(switch.right)),
            )
        }
        Kept::Condition(event, k) => {
            let words = format!("1 where {} was true", system.text(system.events()[event].conditions[k]));
            plain(format!("when_{}_{}", event + 1, k + 1), words)
        }
        Kept::Samples(k) => plain(format!("samples_{}", k + 1), "how many instants of a `sample` are past".to_string()),
        Kept::Steps => plain("steps".to_string(), "how many steps were taken".to_string()),
        Kept::Start => (
            "start".to_string(),
            Signal { unit: "s".to_string(), words: "the time of the first step".to_string(), ..Signal::default() },
        ),
    }
}

/// The range in which a self-test varies an input: its bounds in the text; a missing bound is replaced by the nominal value, or by 1, with its sign.
fn range(machine: &Machine, symbol: Symbol) -> [f64; 2] {
    let variable = machine.system().flat().variable(symbol);
    match (variable.min, variable.max) {
        (Some(low), Some(high)) => [low, high],
        (low, high) => {
            let size = variable.nominal.map_or(1.0, f64::abs);
            [low.unwrap_or(-size), high.unwrap_or(size)]
        }
    }
}

/// The fastest mode for which the step is too long in the classical Runge-Kutta method, and the longest permitted step for it.
fn too_fast(poles: &[Pole], length: f64) -> Option<(Pole, f64)> {
    let fastest = poles.iter().filter(|pole| length > longest(pole)).max_by(|a, b| a.frequency().total_cmp(&b.frequency()))?;
    Some((*fastest, longest(fastest)))
}

/// The longest step, in s, with which the method does not increase a mode that does not grow. A growing mode gets the limit of a decaying mode of the
/// same rate.
fn longest(pole: &Pole) -> f64 {
    let frequency = pole.frequency();
    if frequency == 0.0 {
        return f64::INFINITY;
    }
    // In the direction of the pole, in units of 1/frequency: the region of stability ends at 2.785 on the real axis and at 2.828 on the imaginary
    // axis.
    let (x, y) = (-pole.real.abs() / frequency, pole.imaginary / frequency);
    let shares = (1..4000).map(|k| f64::from(k) * 1e-3);
    let first = shares.take_while(|share| growth(x * share, y * share) <= GROWTH).last();
    first.unwrap_or(0.0) / frequency
}

/// The formula |1 + z + z^2/2 + z^3/6 + z^4/24|: the factor by which a mode grows in one step (E. Hairer, G. Wanner, "Solving Ordinary Differential
/// Equations II", IV.2).
fn growth(x: f64, y: f64) -> f64 {
    // Horner's scheme for complex numbers.
    let [real, imaginary] = [4.0, 3.0, 2.0, 1.0]
        .into_iter()
        .fold([1.0, 0.0], |[a, b], divisor| [1.0 + (a * x - b * y) / divisor, (a * y + b * x) / divisor]);
    f64::hypot(real, imaginary)
}

fn described(pole: &Pole) -> String {
    match pole.damping() {
        Some(damping) if pole.imaginary != 0.0 => format!("an oscillation with a damping ratio of {damping:.3}"),
        _ => format!("a time constant of {} s", short(1.0 / pole.frequency())),
    }
}

/// A number with four digits.
fn short(value: f64) -> String {
    decimal(format!("{value:.3e}").parse().unwrap_or(value))
}

#[cfg(test)]
mod tests {
    use super::{Pole, growth, longest};

    #[test]
    fn the_region_of_stability_ends_where_textbooks_say() {
        // E. Hairer, G. Wanner, IV.2: -2.785 on the real axis, 2 sqrt(2) on the imaginary one.
        let real = longest(&Pole { real: -10.0, imaginary: 0.0 });
        assert!((real - 0.2785).abs() < 1e-4, "{real}");
        let turning = longest(&Pole { real: 0.0, imaginary: 10.0 });
        assert!((turning - 0.28284).abs() < 1e-4, "{turning}");
        assert_eq!(longest(&Pole { real: 0.0, imaginary: 0.0 }), f64::INFINITY);
        // 1 - 1 + 1/2 - 1/6 + 1/24.
        assert!((growth(-1.0, 0.0) - 0.375).abs() < 1e-15);
    }
}

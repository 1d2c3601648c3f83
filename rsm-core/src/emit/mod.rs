//! Emitters: a tape becomes source text.
//!
//! In: a [`Unit`], the tapes of one model with information for readers. Out: text, the same for the same unit, ASCII, with a newline at the end. A
//! printer makes no decision about arithmetic: form, order and constants are on the tape, and registers have the numbers of the tape's listing. It
//! only chooses the idiom with which a machine clamps and selects without a branch.

pub mod c;
mod c_gradient;
mod c_idioms;
pub mod c_plant;
mod c_reads;
pub mod plant;
mod points;
pub mod rust;
pub mod rust_plant;

pub use crate::names::Kind;

use crate::certificate::gradient::Derivative;
use crate::lower::Saturation;
use crate::model::{Input, Outside};
use crate::names;
use crate::number::{self, Precision};
use crate::tape::{Op, Reg, Tape};

/// The parts of one model that the printers print: a header and a source file in C, one module in Rust.
#[derive(Debug, Clone, PartialEq)]
pub struct Unit {
    /// The name of the model: prefix of every C name, module name in Rust.
    pub model: String,
    /// The functions, in the order of the files. Printers of C put those of f64 first.
    pub functions: Vec<Function>,
}

/// One evaluator: a surface, its support test, or the step of a compensator, in the precision of the tape.
#[derive(Debug, Clone, PartialEq)]
pub struct Function {
    /// The name of the surface or of the compensator.
    pub surface: String,
    /// The surface itself, its support test, or a step.
    pub kind: Kind,
    /// The unit of the result, as text; for a step, the sample time in words.
    pub unit: String,
    /// The arguments, at least one, in order. Those of a step begin with the signal; its range is used only by a self-test.
    pub inputs: Vec<Input>,
    /// The bounds of the result at `output_range`.
    pub saturation: Option<Saturation>,
    /// The certificates of the derivatives, one for each input; empty if it is not a gradient.
    pub derivatives: Vec<Derivative>,
    /// The states of the tape at the start, in order; empty if they are 0 and have no description.
    pub kept: Vec<Kept>,
    /// Further rules for the caller, one per line.
    pub rules: Vec<String>,
    /// The tape. A support test ends with exactly 1 or 0.
    pub tape: Tape,
}

/// A state at the start, and its description.
#[derive(Debug, Clone, PartialEq)]
pub struct Kept {
    /// Its value, a number of the tape's precision.
    pub start: f64,
    /// Its description.
    pub about: String,
}

impl Function {
    /// The name in Rust.
    #[must_use]
    pub fn rust_name(&self) -> String {
        names::rust_function(&self.surface, self.kind, self.tape.precision)
    }

    /// The name in C.
    #[must_use]
    pub fn c_name(&self, model: &str) -> String {
        names::c_function(model, &self.surface, self.kind, self.tape.precision)
    }

    /// The type of its state in C.
    fn c_state(&self, model: &str) -> String {
        names::c_state(model, &self.surface, self.tape.precision)
    }

    /// The names of the state's fields.
    fn states(&self) -> Vec<String> {
        self.tape.states.iter().map(|state| state.name.clone()).collect()
    }

    /// The states before the first step.
    #[must_use]
    pub fn start(&self) -> Vec<f64> {
        (0..self.tape.states.len()).map(|k| self.kept.get(k).map_or(0.0, |kept| kept.start)).collect()
    }

    /// Whether it has a state among its arguments.
    #[must_use]
    pub fn has_state(&self) -> bool {
        matches!(self.kind, Kind::Step | Kind::Update | Kind::Adapted)
    }

    /// Whether the type of its state is declared with it. The evaluator of an adapted surface reads the state of its update.
    fn declares_state(&self) -> bool {
        matches!(self.kind, Kind::Step | Kind::Update)
    }

    /// Whether it has several results.
    #[must_use]
    pub fn has_results(&self) -> bool {
        matches!(self.kind, Kind::Gradient | Kind::Update)
    }

    /// The owner of the state, in words.
    fn state_of(&self) -> String {
        let what = if self.kind == Kind::Step { "compensator" } else { "adapted surface" };
        format!("{what} `{}`", self.surface)
    }

    /// What the function for the start does with a state, in words.
    fn put_at_start(&self) -> &'static str {
        if self.kind == Kind::Step { "puts it at rest at 0" } else { "gives it the coefficients of the model" }
    }

    /// Information for the caller, one line each: description, arguments, result, cost.
    fn about(&self) -> Vec<String> {
        let precision = self.tape.precision;
        let mut lines = vec![match self.kind {
            Kind::Surface => format!("`{}` in {}, evaluated in {}.", self.surface, unit(&self.unit), precision.name()),
            Kind::Support => {
                format!("Whether the data support `{}` here: 1 inside, 0 outside, in {}.", self.surface, precision.name())
            }
            Kind::Gradient => format!(
                "The derivatives of `{}` by its inputs, in {} a unit of the input, evaluated in {}.",
                self.surface,
                unit(&self.unit),
                precision.name()
            ),
            Kind::Inside => format!(
                "`{}` in {} before `output_range`, for arguments in their ranges: nothing is clamped. Evaluated in {}.",
                self.surface,
                unit(&self.unit),
                precision.name()
            ),
            Kind::Once => {
                format!(
                    "The part of `{}_inside` that depends only on these inputs: call it when one of them changes. In {}.",
                    self.surface,
                    precision.name()
                )
            }
            Kind::Step => format!("One step of the compensator `{}`, {}, in {}.", self.surface, self.unit, precision.name()),
            Kind::Update => format!(
                "One step of recursive least squares: the coefficients of `{}` follow a measured response, in {}.",
                self.surface,
                precision.name()
            ),
            Kind::Adapted => format!(
                "`{}` in {} with the coefficients of the state, evaluated in {}.",
                self.surface,
                unit(&self.unit),
                precision.name()
            ),
        }];
        lines.push(String::new());
        if self.kind == Kind::Step {
            lines.push(format!("- `{}`: the signal, of any unit, which the result has too", crate::lower::SIGNAL));
        }
        let scheduled = self.inputs.iter().skip(usize::from(self.kind == Kind::Step));
        for input in scheduled {
            let [low, high] = input.range.map(number::decimal);
            let outside = match (self.kind, input.outside) {
                (Kind::Support | Kind::Inside, _) => "",
                (Kind::Update, _) if input.name == names::MEASURED => {
                    lines.push(format!("- `{}` in {}: the measured response", input.name, unit(&input.unit)));
                    continue;
                }
                (Kind::Update, _) => ", outside the step is frozen",
                (Kind::Gradient, Outside::Clamp) => "; outside the derivative by it is 0",
                (_, Outside::Clamp) => ", clamped outside",
                (_, Outside::Extrapolate) => ", extrapolated outside",
            };
            lines.push(format!("- `{}` in {}: {low} to {high}{outside}", input.name, unit(&input.unit)));
        }
        lines.push(String::new());
        lines.extend(self.rules.iter().cloned());
        if self.kind != Kind::Gradient {
            lines.extend(self.saturation.map(|saturation| saturation.words()));
        }
        match self.kind {
            Kind::Surface | Kind::Inside | Kind::Once | Kind::Adapted => lines.push("NaN in gives NaN out.".to_string()),
            Kind::Support | Kind::Update => {}
            Kind::Gradient => {
                lines.extend(self.derivatives.iter().map(certified));
                if let Some(saturation) = self.saturation.filter(|saturation| saturation.below || saturation.above) {
                    let words = saturation.words();
                    lines.push(format!("{words} There all derivatives are 0; the distances above hold elsewhere."));
                }
                lines.push("NaN in gives NaN out.".to_string());
            }
            Kind::Step => {
                lines
                    .push("Where an argument is NaN or infinite the result is NaN, and the state stays as it was.".to_string());
                lines.push("At rest the result is the signal, exactly, also while the other arguments move.".to_string());
            }
        }
        lines.push(format!("{} operations, {} deep, no branch.", self.tape.operation_count(), self.tape.depth()));
        lines
    }
}

/// The smallest number with four digits that is not below a value, so that a printed bound is valid.
fn four_digits_above(value: f64) -> f64 {
    let number = |text: &str| text.parse::<f64>().expect("a printed number is a number");
    let text = format!("{value:.3e}");
    let (nearest, (_, exponent)) = (number(&text), text.split_once('e').expect("it is printed with an exponent"));
    // The next number is larger by a thousandth of the power of ten.
    if nearest >= value { nearest } else { number(&format!("{:.3e}", nearest + 7e-4 * number(&format!("1e{exponent}")))) }
}

/// The certificate of one derivative in words, for arguments in the range of every input.
fn certified(derivative: &Derivative) -> String {
    let Derivative { input, range, error } = derivative;
    let range = if range.low.is_finite() && range.high.is_finite() {
        format!("{} to {}", number::decimal(-four_digits_above(-range.low)), number::decimal(four_digits_above(range.high)))
    } else {
        "of unknown range".to_string()
    };
    let error = if *error == 0.0 {
        "exact".to_string()
    } else if error.is_finite() {
        format!("within {:.1e} of the exact derivative", four_digits_above(*error) * 1.06)
    } else {
        "no bound of the rounding error".to_string()
    };
    format!("- derivative by `{input}`: {range}, {error}")
}

/// A unit in a comment of C and in the documentation of Rust, in backticks.
pub(crate) fn unit(text: &str) -> String {
    if text.is_empty() { "no unit".to_string() } else { format!("`{}`", plain(text)) }
}

/// Text for a comment of C and of Rust: ASCII, without the characters that end a comment.
pub(crate) fn plain(text: &str) -> String {
    let mut plain = String::new();
    for c in text.chars() {
        match c {
            '`' | '\\' => plain.push('\''),
            ' '..='~' => plain.push(c),
            _ => plain.push_str(&format!("U+{:04X}", u32::from(c))),
        }
    }
    // Both marks of a comment, and the trigraph ??/ that is a backslash to old compilers.
    plain.replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?")
}

/// The model terms of a constant, as in a comment: `torque*speed: 3.75 deg`.
fn terms_behind(tape: &Tape, reg: Reg) -> Option<String> {
    let each = tape.notes.iter().filter(|(at, _)| *at == reg).map(|(_, note)| {
        // Six digits are enough to find the line of the model file, which has all digits.
        let short: f64 = format!("{:.5e}", note.coefficient).parse().unwrap_or(note.coefficient);
        let unit = if note.unit.is_empty() || note.unit == "1" { String::new() } else { format!(" {}", plain(&note.unit)) };
        format!("{}: {}{unit}", plain(&note.term), number::decimal(short))
    });
    let all: Vec<String> = each.collect();
    (!all.is_empty()).then(|| all.join(", "))
}

/// The registers on which the results depend. Others are not printed, because an unused local gives a warning.
fn live(tape: &Tape) -> Vec<bool> {
    let mut live = vec![false; tape.ops.len()];
    for reg in tape.results() {
        live[reg.0 as usize] = true;
    }
    for (reg, op) in tape.iter().collect::<Vec<_>>().into_iter().rev() {
        if live[reg.0 as usize] {
            for operand in op.operands() {
                live[operand.0 as usize] = true;
            }
        }
    }
    live
}

/// The arguments that the result does not depend on.
fn unused_inputs<'t>(tape: &'t Tape, live: &[bool]) -> Vec<&'t str> {
    let reads =
        |port: usize| tape.iter().any(|(reg, op)| live[reg.0 as usize] && matches!(op, Op::Input(p) if p.0 as usize == port));
    tape.inputs.iter().enumerate().filter(|(port, _)| !reads(*port)).map(|(_, name)| name.as_str()).collect()
}

/// The operands of the comparison that a select reads.
///
/// # Panics
/// If the condition of the select is not a `Less`.
fn compared(tape: &Tape, condition: Reg) -> (Reg, Reg) {
    match *tape.op(condition) {
        Op::Less(left, right) => (left, right),
        ref other => panic!("the condition of a select is written by `less`, not by {other:?}"),
    }
}

/// A constant of a tape as a literal without suffix, the shortest text that reads back to the same bits.
fn literal(value: f64, precision: Precision) -> String {
    match precision {
        Precision::F64 => number::decimal(value),
        Precision::F32 => number::decimal_f32(value),
    }
}

#[cfg(test)]
mod tests;

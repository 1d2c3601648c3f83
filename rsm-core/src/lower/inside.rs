//! Lowers a surface without its clamps, for a caller that keeps every argument in its range and needs no `output_range`.
//!
//! In: `Checked`, and the inputs that change rarely. Out: a tape for the part of these inputs, run once, and a tape for the rest. For arguments in
//! their ranges both together give the bits of the surface before `output_range`: the clamps, which would not change the arguments, are removed from
//! the tape, and all other operations stay in their order. Outside the ranges the polynomial is extrapolated. A NaN argument gives NaN.
//!
//! ```text
//! current -> clamp -> its part of the polynomial = `..._once`      once, where the current is known
//! torque, speed, `..._once` -> the rest of the polynomial          each step
//! ```
//!
//! Only the operations that depend on the rarely changed inputs alone move to the first tape, and only if they give a single number. Otherwise the
//! step would have to keep several numbers only to add them.

use std::collections::HashMap;

use crate::check::Checked;
use crate::names::{self, Kind};
use crate::number::Precision;
use crate::tape::{Extremum, Op, Port, Reg, Tape, TapeBuilder};

use super::variables::Variables;

/// A surface without clamps, in one or two parts.
#[derive(Debug, Clone, PartialEq)]
pub struct Inside {
    /// The part of the rarely changed inputs, which clamp as in the surface. `None` if the surface has none of them.
    pub once: Option<Tape>,
    /// The surface as a function of its other inputs and, last, of the result of `once`.
    pub rest: Tape,
}

/// The tapes of a surface without clamps. `once`: the names of the rarely changed inputs; names that the surface does not have are ignored.
///
/// # Errors
/// The number of values that the first tape would pass to the rest, if it is not one; 0 if nothing is left for the rest.
///
/// # Panics
/// When the precision cannot represent the model: see [`Checked::refusal`].
///
/// ```
/// # let text = "format = 1\nmodel = \"car\"\n[inputs.speed]\nunit = \"m/s\"\nrange = [0.0, 30.0]\noutside = \"clamp\"\n[surfaces.drag]\nunit = \"N\"\n\
/// #     inputs = [\"speed\"]\nterms = [{ powers = [0], coefficient = 35.0 }, { powers = [1], coefficient = 30.0 }]\n";
/// # let checked = rsm_core::check::Checked::read(&rsm_core::source::Source::new("car.toml", text))?;
/// // A line from 5 N at rest to 65 N at 30 m/s.
/// use rsm_core::{lower, number::Precision, run::Interpreter};
///
/// let inside = lower::inside(&checked, 0, Precision::F64, &[]).expect("one part");
/// let mut drag = Interpreter::<f64>::new(&inside.rest);
/// assert_eq!(drag.eval(&[15.0]), 35.0);
/// assert_eq!(drag.eval(&[45.0]), 95.0); // the surface stops at 65 N
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
pub fn inside(checked: &Checked, index: usize, precision: Precision, once: &[String]) -> Result<Inside, usize> {
    let surface = &checked.model().surfaces[index];
    let inputs = checked.inputs_of(surface);
    let seldom: Vec<bool> = inputs.iter().map(|input| once.contains(&input.name)).collect();
    let mut builder = TapeBuilder::new(precision);
    let arguments = super::arguments(&mut builder, inputs.len());
    let mut variables = Variables::new(surface, &inputs, arguments);
    let output = super::polynomial_of(&mut builder, surface, &inputs, &mut variables);
    let clamped: Vec<Reg> = (0..inputs.len()).map(|k| variables.seen(&mut builder, k)).collect();
    let mut whole = builder.finish(&surface.name, surface.inputs.clone(), output);
    for clamped in clamped.into_iter().zip(&seldom).filter(|(_, seldom)| !**seldom).map(|(clamped, _)| clamped) {
        cut_clamp(&mut whole, clamped);
    }

    let names = |seldom_ones: bool| -> Vec<(Reg, String)> {
        let of_kind = inputs.iter().enumerate().filter(|(k, _)| seldom[*k] == seldom_ones);
        of_kind.map(|(k, input)| (Reg(k as u32), input.name.clone())).collect()
    };
    let mut given = names(false);
    let output = whole.output();
    let name = |kind| names::rust_function(&surface.name, kind, Precision::F64);
    if given.len() == inputs.len() {
        return Ok(Inside { once: None, rest: part(&whole, name(Kind::Inside), given, output) });
    }
    let (seldom_only, handed_over) = handed_over(&whole, &seldom);
    let [only] = handed_over[..] else { return Err(handed_over.len()) };
    if seldom_only[output.0 as usize] {
        return Err(0);
    }
    given.push((only, name(Kind::Once)));
    Ok(Inside {
        once: Some(part(&whole, name(Kind::Once), names(true), only)),
        rest: part(&whole, name(Kind::Inside), given, output),
    })
}

/// Makes every operation that reads a clamped argument read the unclamped one.
fn cut_clamp(tape: &mut Tape, clamped: Reg) {
    let mut bare = clamped;
    while let Some(Extremum::AtLeast { value, .. } | Extremum::AtMost { value, .. }) = tape.extremum(bare) {
        bare = value;
    }
    let instead = |reg| if reg == clamped { bare } else { reg };
    tape.ops.iter_mut().for_each(|op| *op = op.with_operands(instead));
    tape.outputs.iter_mut().for_each(|output| output.reg = instead(output.reg));
}

/// Which registers depend only on rarely changed inputs, and those of them that an operation of the rest reads.
fn handed_over(whole: &Tape, seldom: &[bool]) -> (Vec<bool>, Vec<Reg>) {
    let (mut on_seldom, mut on_others) = (vec![], vec![]);
    for (_, op) in whole.iter() {
        let any = |of: &[bool]| op.operands().iter().any(|operand| of[operand.0 as usize]);
        let port = if let Op::Input(Port(port)) = *op { Some(seldom[port as usize]) } else { None };
        let both = (port == Some(true) || any(&on_seldom), port == Some(false) || any(&on_others));
        on_seldom.push(both.0);
        on_others.push(both.1);
    }
    let only: Vec<bool> = on_seldom.iter().zip(&on_others).map(|(seldom, others)| *seldom && !others).collect();
    let readers = whole.iter().filter(|(reg, _)| on_others[reg.0 as usize]).map(|(_, op)| op);
    let mut read: Vec<Reg> = readers.flat_map(Op::operands).filter(|operand| only[operand.0 as usize]).collect();
    read.sort_unstable();
    read.dedup();
    (only, read)
}

/// The operations between given registers, as arguments with these names, and a result.
fn part(whole: &Tape, name: String, given: Vec<(Reg, String)>, result: Reg) -> Tape {
    let mut needed = vec![false; whole.ops.len()];
    needed[result.0 as usize] = true;
    for (reg, op) in whole.iter().collect::<Vec<_>>().into_iter().rev() {
        if needed[reg.0 as usize] && !given.iter().any(|(at, _)| *at == reg) {
            op.operands().iter().for_each(|operand| needed[operand.0 as usize] = true);
        }
    }
    let mut builder = TapeBuilder::new(whole.precision);
    let arguments = super::arguments(&mut builder, given.len());
    let mut places: HashMap<Reg, Reg> = given.iter().map(|(reg, _)| *reg).zip(arguments).collect();
    for (reg, op) in whole.iter().filter(|(reg, _)| needed[reg.0 as usize]) {
        if !places.contains_key(&reg) {
            let place = builder.push(op.with_operands(|operand| places[&operand]));
            places.insert(reg, place);
        }
    }
    let mut tape = builder.finish(name, given.into_iter().map(|(_, name)| name).collect(), places[&result]);
    let notes = whole.notes.iter().filter(|(reg, _)| needed[reg.0 as usize]);
    tape.notes = notes.filter_map(|(reg, note)| Some((*places.get(reg)?, note.clone()))).collect();
    tape
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::Interpreter;
    use crate::source::Source;

    /// Three inputs. `c` has terms of its own; the other terms have `a` and `b`.
    const MODEL: &str = "format = 1\nmodel = \"m\"\n\
        [inputs.a]\nunit = \"A\"\nrange = [-2.0, 6.0]\noutside = \"clamp\"\n\
        [inputs.b]\nunit = \"V\"\nrange = [-3.0, 3.0]\noutside = \"clamp\"\n\
        [inputs.c]\nunit = \"W\"\nrange = [1.0, 5.0]\noutside = \"clamp\"\n\
        [surfaces.s]\nunit = \"N\"\ninputs = [\"a\", \"b\", \"c\"]\noutput_range = [-1.0, 3.0]\n\
        terms = [{ powers = [0, 0, 0], coefficient = 1.3 }, { powers = [1, 2, 0], coefficient = 0.7 }, { powers = [3, 0, 0], coefficient = -2.1 },\n\
        { powers = [0, 0, 1], coefficient = 0.9 }, { powers = [0, 0, 2], coefficient = -0.4 }]\n";

    fn checked(text: &str) -> Checked {
        Checked::read(&Source::new("m.toml", text)).unwrap_or_else(|faults| panic!("{faults}"))
    }

    /// Points over the box and on its edges; all are numbers of f32.
    fn points() -> Vec<[f64; 3]> {
        let along = |low: f64, high: f64| (0..=12).map(move |k| f64::from((low + (high - low) * f64::from(k) / 12.0) as f32));
        along(-2.0, 6.0).flat_map(|a| along(-3.0, 3.0).flat_map(move |b| along(1.0, 5.0).map(move |c| [a, b, c]))).collect()
    }

    #[test]
    fn both_parts_have_the_bits_of_the_surface_before_its_range() {
        let (whole, free) = (checked(MODEL), checked(&MODEL.replace("output_range = [-1.0, 3.0]\n", "")));
        let [one, two] = [vec![], vec!["c".to_string()]].map(|once| inside(&whole, 0, Precision::F32, &once).expect("parts"));
        assert!(one.once.is_none() && one.rest.inputs == ["a", "b", "c"]);
        let once = two.once.expect("the part of c");
        assert_eq!(
            (once.inputs.as_slice(), two.rest.inputs.as_slice()),
            (&["c".to_string()][..], &["a", "b", "s_once"].map(String::from)[..])
        );
        let surface = super::super::surface(&free, 0, Precision::F32);
        assert!(
            one.rest.operation_count() < surface.operation_count() && two.rest.operation_count() < one.rest.operation_count()
        );
        let [mut surface, mut one, mut once, mut two] = [&surface, &one.rest, &once, &two.rest].map(Interpreter::<f32>::new);
        let (mut below, mut above) = (0, 0);
        for point in points() {
            let [a, b, c] = point.map(|value| value as f32);
            let expected = surface.eval(&[a, b, c]);
            let given = once.eval(&[c]);
            assert_eq!(one.eval(&[a, b, c]).to_bits(), expected.to_bits(), "{point:?}");
            assert_eq!(two.eval(&[a, b, given]).to_bits(), expected.to_bits(), "{point:?}");
            below += i32::from(expected < -1.0);
            above += i32::from(expected > 3.0);
        }
        assert!(below > 0 && above > 0, "the range of the result is passed on both sides");
        // A rarely changed input is clamped; the others are not. NaN gives NaN.
        assert_eq!(once.eval(&[9.0]).to_bits(), once.eval(&[5.0]).to_bits());
        assert_ne!(two.eval(&[7.0, 0.0, 0.0]), two.eval(&[6.0, 0.0, 0.0]));
        assert!(
            two.eval(&[f32::NAN, 0.0, 0.0]).is_nan()
                && two.eval(&[0.0, f32::NAN, 0.0]).is_nan()
                && once.eval(&[f32::NAN]).is_nan()
        );
    }

    #[test]
    fn what_is_not_one_number_is_refused() {
        // c occurs alone and in a product with a and b: the second part would need the variable and the sum of its own terms.
        let crossed = checked(&MODEL.replace("powers = [1, 2, 0]", "powers = [1, 2, 1]"));
        assert_eq!(inside(&crossed, 0, Precision::F64, &["c".to_string()]), Err(2));
        // If all inputs change rarely, no operation is left for the steps.
        let all = ["a", "b", "c"].map(String::from);
        assert_eq!(inside(&checked(MODEL), 0, Precision::F64, &all), Err(0));
    }
}

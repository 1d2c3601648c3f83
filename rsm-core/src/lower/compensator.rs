//! Lowers a compensator to the tape of one step.
//!
//! In: a checked compensator. Out: a tape with two states; its arguments are the signal, `input`, then every input that its surfaces use.
//! Its surfaces are lowered to the same tape, with the same saturation as alone. No branch; never fails.
//!
//! H(s) = (s^2 + 2 z w s + w^2)/(s^2 + 2 p w s + w^2), z the damping of the zeros, p that of the poles, w the natural frequency; s becomes
//! (2/T)(q - 1)/(q + 1) at the sample time T (bilinear transform, no prewarping). H = 1 + 2 (z - p) B with the band-pass
//! B(s) = w s/(s^2 + 2 p w s + w^2), and B is realised by two trapezoidal integrators (a state-variable filter; Zavalishin, "The Art of VA Filter
//! Design", 2012, chapter 4). With g = w T/2 and u = 2 B x:
//!
//! ```text
//! u   = 2 (s1 + g (x - s2))/(1 + g (g + 2 p))
//! y   = x + (z - p) u
//! s1 := u - s1
//! s2 := s2 + g u
//! ```
//!
//! If the poles have a separate natural frequency v: H(s) = (v/w)^2 (s^2 + 2 z w s + w^2)/(s^2 + 2 p v s + v^2). The integrators then use g = v T/2.
//! With r = v/w and the high-pass h = s^2/(s^2 + 2 p v s + v^2) x, which is x - s2 - (p + g/2) u:
//!
//! ```text
//! y   = x + (r z - p) u + (r^2 - 1) h
//! ```
//!
//! These states are better than those of the difference equation: in steady state s1 = 0 and s2 = x for any z, p, w and v. Then u = h = 0 and y = x
//! exactly, also while the coefficients change. The gain at frequency 0 is exactly 1, and a change of gear in steady state changes nothing.
//!
//! From another state, the steady state is reached when g u no longer changes s2. Then y may differ by |z - p|/(2 g) units in the last place of x,
//! about ten for a driveline at 1 kHz.
//!
//! A sample with a NaN or an infinity in any argument gives NaN and does not change the states. a - a is 0 for a number and NaN for anything else, so
//! the sum of these differences over all arguments is 0 or NaN. It is added to y, and the next states are used only if it is less than 1. The
//! differences of the next states are in the same sum, so a state that overflows is not used either.

use crate::check::Checked;
use crate::model::Scheduled;
use crate::names::SIGNAL;
use crate::number::{Precision, Rational, exact, integer};
use crate::tape::{Op, Reg, State, Tape, TapeBuilder};

/// The tape of a compensator's step, by its index in the model.
///
/// # Panics
/// When the precision cannot represent the model: see [`Checked::refusal`].
#[must_use]
pub fn compensator(checked: &Checked, index: usize, precision: Precision) -> Tape {
    let compensator = &checked.model().compensators[index];
    let schedule = checked.schedule_of(compensator);
    let mut tape = TapeBuilder::sharing(precision);
    let arguments = super::arguments(&mut tape, 1 + schedule.len());
    let x = arguments[0];
    let states = [0, 1].map(|k| tape.push(Op::State(State(k))));
    let [s1, s2] = states;

    let mut part = |scheduled: &Scheduled| match scheduled {
        Scheduled::Fixed(value) => Number::Fixed(exact(*value)),
        Scheduled::Surface(_) | Scheduled::Sum(_) => {
            let values = scheduled.surfaces().iter().map(|name| surface(&mut tape, checked, name, &schedule, &arguments[1..]));
            let values: Vec<Reg> = values.collect();
            let sum = values.into_iter().reduce(|sum, value| tape.push(Op::Add(sum, value)));
            Number::Moving(sum.expect("a checked sum names a surface"))
        }
    };
    let w = part(&compensator.natural_frequency);
    let z = part(&compensator.zero_damping);
    let p = part(&compensator.pole_damping);
    let v = compensator.pole_frequency.as_ref().map(part);

    let half_sample = Number::Fixed(exact(compensator.sample_time) / integer(2));
    let g = v.as_ref().unwrap_or(&w).times(&half_sample, &mut tape);
    // 1 + g (g + 2 p)
    let twice_p = p.plus(&p, &mut tape);
    let sum = g.plus(&twice_p, &mut tape);
    let inner = sum.times(&g, &mut tape);
    let denominator = inner.plus(&Number::Fixed(integer(1)), &mut tape);
    let ratio = v.as_ref().map(|v| v.over(&w, &mut tape));
    let z = ratio.as_ref().map_or(z.clone(), |ratio| z.times(ratio, &mut tape));
    let difference = z.minus(&p, &mut tape);

    let error = tape.push(Op::Subtract(x, s2));
    let driven = g.scaled(error, &mut tape);
    let numerator = tape.push(Op::Add(s1, driven));
    let u = match denominator {
        // 2/denominator is a constant: it is rounded once, and a product is much faster than a quotient.
        Number::Fixed(denominator) => tape.times(numerator, integer(2) / denominator),
        Number::Moving(denominator) => {
            let twice = tape.push(Op::Add(numerator, numerator));
            tape.push(Op::Divide(twice, denominator))
        }
    };
    let shaped = difference.scaled(u, &mut tape);
    let mut y = tape.push(Op::Add(x, shaped));
    if let Some(ratio) = ratio {
        let excess = ratio.times(&ratio, &mut tape).minus(&Number::Fixed(integer(1)), &mut tape);
        let half_sum = sum.times(&Number::Fixed(integer(1) / integer(2)), &mut tape);
        let slow = half_sum.scaled(u, &mut tape);
        let high_pass = tape.push(Op::Subtract(error, slow));
        let added = excess.scaled(high_pass, &mut tape);
        y = tape.push(Op::Add(y, added));
    }
    let next_1 = tape.push(Op::Subtract(u, s1));
    let moved = g.scaled(u, &mut tape);
    let next_2 = tape.push(Op::Add(s2, moved));

    let nothing = sum_of_nothings(&mut tape, None, &arguments);
    let output = tape.push(Op::Add(y, nothing));
    let nothing = sum_of_nothings(&mut tape, Some(nothing), &[next_1, next_2]);
    let one = tape.constant(integer(1));
    let condition = tape.push(Op::Less(nothing, one));
    let kept = [(next_1, s1), (next_2, s2)].map(|(then, otherwise)| tape.push(Op::Select { condition, then, otherwise }));

    let names = std::iter::once(SIGNAL.to_string()).chain(schedule.iter().map(|input| input.name.clone())).collect();
    tape.finish_with_states(&compensator.name, names, output, kept.to_vec())
}

/// A surface on the tape of a compensator.
fn surface(tape: &mut TapeBuilder, checked: &Checked, name: &str, schedule: &[crate::model::Input], arguments: &[Reg]) -> Reg {
    let surface = checked.model().surface(name).expect("a checked compensator names known surfaces");
    let place = |input: &String| schedule.iter().position(|scheduled| scheduled.name == *input).expect("the schedule has it");
    let registers = surface.inputs.iter().map(|input| arguments[place(input)]).collect();
    super::value(tape, surface, &checked.inputs_of(surface), registers)
}

/// The sum of a - a over some registers, added to an existing sum: 0, or NaN if any of them is not finite.
fn sum_of_nothings(tape: &mut TapeBuilder, sum: Option<Reg>, registers: &[Reg]) -> Reg {
    let sum = registers.iter().fold(sum, |sum, reg| {
        let nothing = tape.push(Op::Subtract(*reg, *reg));
        Some(sum.map_or(nothing, |sum| tape.push(Op::Add(sum, nothing))))
    });
    sum.expect("a step has an argument")
}

/// A coefficient of the filter: a constant, kept exact until it is used, or computed in every step.
#[derive(Debug, Clone)]
enum Number {
    Fixed(Rational),
    Moving(Reg),
}

impl Number {
    fn register(&self, tape: &mut TapeBuilder) -> Reg {
        match self {
            Number::Fixed(value) => tape.constant(value.clone()),
            Number::Moving(reg) => *reg,
        }
    }

    fn plus(&self, other: &Number, tape: &mut TapeBuilder) -> Number {
        self.with(other, tape, |a, b| a + b, Op::Add)
    }

    fn minus(&self, other: &Number, tape: &mut TapeBuilder) -> Number {
        self.with(other, tape, |a, b| a - b, Op::Subtract)
    }

    fn times(&self, other: &Number, tape: &mut TapeBuilder) -> Number {
        match (self, other) {
            (Number::Fixed(a), Number::Fixed(b)) => Number::Fixed(a * b),
            (Number::Moving(reg), _) => Number::Moving(other.scaled(*reg, tape)),
            (_, Number::Moving(reg)) => Number::Moving(self.scaled(*reg, tape)),
        }
    }

    /// A register times this number.
    fn scaled(&self, reg: Reg, tape: &mut TapeBuilder) -> Reg {
        match self {
            Number::Fixed(value) => tape.times(reg, value.clone()),
            Number::Moving(own) => tape.push(Op::Multiply(reg, *own)),
        }
    }

    fn over(&self, other: &Number, tape: &mut TapeBuilder) -> Number {
        self.with(other, tape, |a, b| a / b, Op::Divide)
    }

    fn with(
        &self,
        other: &Number,
        tape: &mut TapeBuilder,
        exactly: impl Fn(&Rational, &Rational) -> Rational,
        op: impl Fn(Reg, Reg) -> Op,
    ) -> Number {
        if let (Number::Fixed(a), Number::Fixed(b)) = (self, other) {
            return Number::Fixed(exactly(a, b));
        }
        let (a, b) = (self.register(tape), other.register(tape));
        Number::Moving(tape.push(op(a, b)))
    }
}

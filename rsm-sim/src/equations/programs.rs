//! The programs of a machine as code that works on one array of slots.
//!
//! In: a [`Machine`], the number of lanes. Out: [`Programs`]. Values that depend only on parameters are computed once. Values that also depend on
//! inputs, held comparisons and memories are computed when these change. The series of the states is compiled part by part, at its first use. Further
//! programs are those of switches, outputs and events. This file never decides whether a step is valid.

use rsm_core::held::{self, Divided};
use rsm_core::series::{Argument, Series};
use rsm_core::tape::{Op, Tape};

use super::checked::{Check, Checked};
use super::exponential::{self, Block, Shape, StepInputs};
use super::layout::Layout;
use super::machine::{Counts, Machine, Tapes};
use super::placed::Placed;
use crate::code::{Code, Piece, Slot, Way};

/// Values that are constant within a row are computed separately if that saves at least this number of operations. A call costs about as much.
const LEAST_SAVED: usize = 12;

/// The number of orders in the first part of the series, and in each later part.
const FIRST: usize = 3;
const FURTHER: usize = 2;

/// A program and the slot of its first result; the other results are in the next slots.
#[derive(Debug)]
pub(super) struct Program {
    pub code: Code,
    pub results: Slot,
    pub placed: Placed,
}

/// A part of the series: some of its orders.
#[derive(Debug)]
pub(super) struct Orders {
    pub code: Code,
    /// The highest order.
    pub order: usize,
    pub placed: Placed,
}

/// All programs of a machine.
#[derive(Debug)]
pub(super) struct Programs {
    pub layout: Layout,
    pub counts: Counts,
    /// Run once, after the parameters are set.
    pub once: Vec<(Code, Placed)>,
    /// Writes the inputs of a row, without those that follow other signals, and runs what depends on them.
    pub inputs: Code,
    /// Run when inputs, held comparisons or memories change.
    pub row: Vec<(Code, Placed)>,
    pub rates: Program,
    pub output_program: Option<Program>,
    pub sides: Option<Program>,
    pub events: Option<Program>,
    /// Only the conditions of branches.
    pub conditions: Option<Program>,
    /// The rates are sums and products of states and held values. Then the terms of the series alone show whether a step is valid.
    pub is_polynomial: bool,
    /// The Jacobian: its tape, its first slot, its code, which is compiled at its first use.
    slopes: (Option<Tape>, Slot, Option<Code>),
    slope_arguments: Vec<Slot>,
    /// The columns in which a step by a linear part reads phi_2 and phi_3.
    pub curved: Vec<usize>,
    /// The kind of each argument of the rates.
    kinds: Vec<Argument>,
    /// Steps that solve the linear part exactly: their slots, and their code, which is compiled at its first use.
    pub block: Block,
    exponential: Option<Code>,
    /// Steps over a whole row with their checks: of the first part of the series, and by a linear part.
    checked_series: Option<Checked>,
    checked_linear: Option<Checked>,
    refined: Option<Code>,
    confirmed: Option<Code>,
    series: Series,
    parts: Vec<Orders>,
    /// For each order from 1, the slot of the first state's term.
    pub terms: Vec<Slot>,
    /// The number of slots before the series.
    pub common: usize,
    slots: usize,
    lanes: usize,
    way: Way,
}

struct Building {
    layout: Layout,
    next: Slot,
    once: Vec<(Code, Placed)>,
    row: Vec<(Code, Placed)>,
    lanes: usize,
    way: Way,
}

impl Building {
    /// Keeps in a tape only the operations that depend on states and time, and moves the others to `once` and `row`. Returns the tape and the slots
    /// of its arguments.
    fn reduced(&mut self, tape: &Tape, arguments: &[Slot], tapes: &Tapes) -> (Tape, Vec<Slot>) {
        let parameters = self.layout.parameters..self.layout.parameters + tapes.counts.parameters as Slot;
        let held = self.layout.inputs..self.layout.guesses;
        let is_parameter: Vec<bool> = arguments.iter().map(|slot| parameters.contains(slot)).collect();
        let (tape, arguments) = self.divided(&held::turned(tape, &is_parameter), arguments, &is_parameter, 1, true);
        let is_held: Vec<bool> = arguments.iter().map(|slot| held.contains(slot) || *slot >= self.layout.parameters).collect();
        self.divided(&tape, &arguments, &is_held, LEAST_SAVED, false)
    }

    fn divided(&mut self, tape: &Tape, arguments: &[Slot], is_held: &[bool], worth: usize, once: bool) -> (Tape, Vec<Slot>) {
        let Divided { held, rest } = held::divided(tape, is_held);
        let Some(held) = held.filter(|it| operations(it) >= worth) else { return (tape.clone(), arguments.to_vec()) };
        let results: Vec<Slot> = (0..held.outputs.len() as Slot).map(|k| self.next + k).collect();
        self.next += results.len() as Slot;
        let all = arguments.iter().chain(&results).copied().collect();
        let placed = Placed { tape: held, arguments: arguments.to_vec(), results };
        let list = if once { &mut self.once } else { &mut self.row };
        list.push((placed.code(self.lanes, self.way), placed));
        (rest, all)
    }

    fn program(&mut self, tape: Option<&Tape>, at_events: bool, tapes: &Tapes) -> Option<Program> {
        let tape = tape?;
        let arguments = self.layout.arguments(tapes.counts, at_events);
        let (tape, arguments) = self.reduced(tape, &arguments, tapes);
        let begin = self.next;
        self.next += tape.outputs.len() as Slot;
        let placed = Placed { tape, arguments, results: (begin..self.next).collect() };
        Some(Program { code: placed.code(self.lanes, self.way), results: begin, placed })
    }
}

/// The conditions of branches, from the program of events.
fn conditions(machine: &Machine, tapes: &Tapes) -> Option<Tape> {
    let mut tape = tapes.events.clone()?;
    let mut rest = tape.outputs.split_off(tapes.counts.memories).into_iter();
    tape.outputs.clear();
    for (event, places) in machine.system().events().iter().zip(machine.restarted()) {
        tape.outputs.extend(rest.by_ref().skip(places.len()).take(event.conditions.len()));
    }
    (!tape.outputs.is_empty()).then_some(tape)
}

/// The number of operations that the results need.
fn operations(tape: &Tape) -> usize {
    tape.operation_count()
}

impl Programs {
    pub(super) fn new(machine: &Machine, lanes: usize, way: Way) -> Programs {
        let tapes = machine.tapes();
        let layout = Layout::new(tapes.counts);
        let mut building = Building { layout, next: layout.end, once: Vec::new(), row: Vec::new(), lanes, way };
        let sides = building.program(tapes.sides.as_ref(), false, &tapes);
        let output_program = building.program(tapes.output_program.as_ref(), false, &tapes);
        let events = building.program(tapes.events.as_ref(), true, &tapes);
        let conditions = building.program(conditions(machine, &tapes).as_ref(), true, &tapes);
        let arguments = if tapes.rates.inputs.is_empty() { Vec::new() } else { layout.arguments(tapes.counts, false) };
        let (rates, arguments) = match tapes.counts.states {
            0 => (tapes.rates.clone(), arguments),
            _ => building.reduced(&tapes.rates, &arguments, &tapes),
        };
        let begin = building.next;
        building.next += tapes.counts.states as Slot;
        let kinds: Vec<Argument> = arguments
            .iter()
            .map(|slot| {
                if *slot == layout.time {
                    Argument::Time(*slot)
                } else if (layout.states..layout.inputs).contains(slot) {
                    Argument::State(*slot, (*slot - layout.states) as usize)
                } else {
                    Argument::Held(*slot)
                }
            })
            .collect();
        let placed = Placed { tape: rates, arguments, results: (begin..building.next).collect() };
        let (code, rates) = (placed.code(lanes, way), &placed.tape);
        let slopes = building.next;
        building.next += tapes.slopes.as_ref().map_or(0, |tape| tape.outputs.len() as Slot);
        let block = Block::new(tapes.counts.states, building.next);
        let common = building.next as usize;
        let free = building.next + block.slots() as Slot;
        let series = Series::new(rates, &kinds, layout.step, free);
        let is_held: Vec<bool> = kinds.iter().map(|it| matches!(it, Argument::Held(_))).collect();
        let of_row = building.row.iter().map(|it| it.1.piece());
        let given = (0..machine.inputs().len()).map(|k| (k, layout.inputs as usize + k)).collect();
        let inputs = Code::of(std::iter::once(Piece::Spread(given)).chain(of_row).collect(), lanes, way);
        let mut programs = Programs {
            layout,
            counts: tapes.counts,
            inputs,
            is_polynomial: is_polynomial(rates, &is_held),
            rates: Program { code, results: begin, placed },
            output_program,
            sides,
            events,
            conditions,
            slopes: (tapes.slopes, slopes, None),
            slope_arguments: layout.arguments(tapes.counts, false),
            curved: Vec::new(),
            kinds,
            block,
            exponential: None,
            checked_series: None,
            checked_linear: None,
            refined: None,
            confirmed: None,
            series,
            parts: Vec::new(),
            terms: Vec::new(),
            common,
            slots: free as usize,
            once: building.once,
            row: building.row,
            lanes,
            way,
        };
        programs.curved = programs.with_step_inputs(|given| Shape::new(given).columns()).unwrap_or_default();
        programs
    }

    /// The number of slots of an array.
    pub(super) fn slots(&self) -> usize {
        self.slots
    }

    /// The slot of the first state at the end of a whole step.
    pub(super) fn end(&self) -> Slot {
        self.series.end()
    }

    /// The Jacobian: its code, and the slots of its results.
    pub(super) fn slopes(&mut self) -> Option<(&Code, std::ops::Range<usize>)> {
        let (tape, begin, code) = &mut self.slopes;
        let tape = tape.as_ref()?;
        let results: Vec<Slot> = (*begin..*begin + tape.outputs.len() as Slot).collect();
        let range = *begin as usize..*begin as usize + results.len();
        let arguments = &self.slope_arguments;
        Some((code.get_or_insert_with(|| Code::new(tape, arguments, &results, self.lanes, self.way)), range))
    }

    /// The step that solves the linear part exactly. `None` for a plant without states.
    #[inline]
    pub(super) fn exponential(&mut self) -> Option<&Code> {
        if self.exponential.is_none() {
            let code = self.with_step_inputs(|given| exponential::step(given).code(self.lanes, self.way))?;
            self.exponential = Some(code);
        }
        self.exponential.as_ref()
    }

    /// The better estimate of the error of such a step.
    pub(super) fn refined(&mut self) -> Option<&Code> {
        if self.refined.is_none() {
            let code = self.with_step_inputs(|given| exponential::refined(given).code(self.lanes, self.way))?;
            self.refined = Some(code);
        }
        self.refined.as_ref()
    }

    /// The changes of the end of such a step ([`exponential::confirmed`]).
    pub(super) fn confirmed(&mut self) -> Option<&Code> {
        if self.confirmed.is_none() {
            let code = self.with_step_inputs(|given| exponential::confirmed(given).code(self.lanes, self.way))?;
            self.confirmed = Some(code);
        }
        self.confirmed.as_ref()
    }

    /// That step for its derivatives, and which derivatives of the rates exist.
    pub(super) fn without_estimate(&self) -> Option<(Placed, Shape)> {
        self.with_step_inputs(|given| {
            let shape = Shape::new(given);
            (exponential::without_estimate(given, &shape), shape)
        })
    }

    fn with_step_inputs<T>(&self, work: impl FnOnce(&StepInputs<'_>) -> T) -> Option<T> {
        let parameters = self.layout.parameters..self.layout.parameters + self.counts.parameters as Slot;
        let held = self.layout.held..self.layout.memories;
        let is_fixed = |slot: &Slot| parameters.contains(slot) || held.contains(slot);
        Some(work(&StepInputs {
            rates: &self.rates.placed.tape,
            arguments: &self.kinds,
            slopes: self.slopes.0.as_ref()?,
            is_fixed: &self.slope_arguments.iter().map(is_fixed).collect::<Vec<bool>>(),
            step: self.layout.step,
            block: self.block,
        }))
    }

    /// The Jacobian with the slots of its arguments and results.
    pub(super) fn placed_slopes(&self) -> Option<Placed> {
        let (tape, begin, _) = &self.slopes;
        let tape = tape.clone()?;
        let results = (*begin..*begin + tape.outputs.len() as Slot).collect();
        Some(Placed { tape, arguments: self.slope_arguments.clone(), results })
    }

    /// Whether the conditions of branches depend on due samples and on parameters alone, and nothing else changes at an instant.
    pub(super) fn has_sampled_conditions(&self) -> bool {
        let Some(conditions) = &self.conditions else { return false };
        let layout = self.layout;
        let is_once = |slot: Slot| self.once.iter().any(|it| it.1.results.contains(&slot));
        let is_steady = |slot: Slot| (layout.acts..layout.end).contains(&slot) || is_once(slot);
        let Placed { tape, arguments, .. } = &conditions.placed;
        let is_steady_port: Vec<bool> = arguments.iter().map(|slot| is_steady(*slot)).collect();
        let steady = held::of_held(tape, &is_steady_port);
        let are_steady = tape.outputs.iter().all(|output| steady[output.reg.0 as usize]);
        self.counts.held == 0 && self.counts.guesses == 0 && are_steady
    }

    /// The order of the first part of the series, if it is compiled.
    #[inline]
    pub(super) fn first_order(&self) -> Option<usize> {
        self.parts.first().map(|part| part.order)
    }

    /// The first part of the series with its check, and its order, if the part is compiled.
    #[inline]
    pub(super) fn checked_series(&mut self) -> Option<(&Checked, usize)> {
        let part = self.parts.first()?;
        let order = part.order;
        if self.checked_series.is_none() {
            self.write_checked_series();
        }
        Some((self.checked_series.as_ref()?, order))
    }

    #[cold]
    #[inline(never)]
    fn write_checked_series(&mut self) {
        if let Some(part) = self.parts.first() {
            let order = part.order;
            let term = |k: usize| self.terms[k - 1];
            let check = Check {
                layout: self.layout,
                states: self.counts.states,
                ends: self.end(),
                errors: &[(term(order), self.layout.limits), (term(order - 1), self.layout.limits + 1)],
                first: Some(term(1)),
                kept: &[],
            };
            self.checked_series = Some(Checked::new(&part.placed, &check, self.lanes, self.way));
        }
    }

    /// The step by a linear part with its check. `None` for a plant without states.
    #[inline]
    pub(super) fn checked_linear(&mut self) -> Option<&Checked> {
        if self.checked_linear.is_none() {
            self.write_checked_linear();
        }
        self.checked_linear.as_ref()
    }

    #[cold]
    #[inline(never)]
    fn write_checked_linear(&mut self) {
        if let Some(placed) = self.with_step_inputs(exponential::step) {
            let (block, states) = (self.block, self.counts.states);
            let [rates, a, last] = block.inside().map(|it| it as Slot);
            let check = Check {
                layout: self.layout,
                states,
                ends: block.end() as Slot,
                errors: &[(block.error() as Slot, self.layout.limits), (block.hidden() as Slot, self.layout.limits + 1)],
                first: None,
                // The better estimate and the confirmation read these.
                kept: &[block.error() as Slot, block.hidden() as Slot, rates, a, last]
                    .map(|begin| begin..begin + states as Slot)
                    .into_iter()
                    .flatten()
                    .collect::<Vec<Slot>>(),
            };
            self.checked_linear = Some(Checked::new(&placed, &check, self.lanes, self.way));
        }
    }

    /// The parts of the series up to a part that is already compiled.
    pub(super) fn written(&self, last: usize) -> &[Orders] {
        &self.parts[..=last]
    }

    /// A part of the series. It is compiled at its first use.
    pub(super) fn part(&mut self, place: usize) -> &Orders {
        while self.parts.len() <= place {
            let orders = if self.parts.is_empty() { FIRST } else { FURTHER };
            let part = self.series.part(orders);
            let placed = Placed { tape: part.tape, arguments: part.arguments, results: part.results };
            self.slots = self.slots.max(self.series.free() as usize);
            self.terms = part.terms;
            self.parts.push(Orders { code: placed.code(self.lanes, self.way), order: part.order, placed });
        }
        &self.parts[place]
    }
}

/// Whether the rates are sums and products of states. Held values may be combined in any way, and may be conditions of selections.
fn is_polynomial(tape: &Tape, is_held: &[bool]) -> bool {
    let held = held::of_held(tape, is_held);
    tape.iter().all(|(reg, op)| match op {
        Op::Input(_) | Op::Negate(_) | Op::Add(..) | Op::Subtract(..) | Op::Multiply(..) => true,
        Op::Select { condition, .. } => held[condition.0 as usize],
        _ => held[reg.0 as usize],
    })
}

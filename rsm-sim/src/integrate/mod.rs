//! Integration of a plant with its effects over a span in which its inputs are held.
//!
//! In: a plant, hooks, held inputs, a state with its rates. Out: the state at the end of the span. Steps are a whole number of equal ones, chosen from the
//! rates that plant and effects name, never from an error that is seen: so the outputs are smooth in the plant's numbers, which is what finite
//! differences of a fit ask for. Slow plants take the classical method (`explicit`); where that would take many small steps for what is linear, an
//! exponential one does (`exponential`). Never crosses a kink in the law of a joint without placing it.

mod explicit;
mod exponential;
mod phi;

use exponential::{Levels, MOST_STATES, Parts};

use crate::hooks::Hooks;
use crate::plants::Plant;

/// A step is at most this over the fastest rate. The error of fourth order in one time constant is then 0.25^4/120, 3e-5 of
/// what moves that fast; stability alone would allow 2.78.
pub(crate) const STEP_RATE: f64 = 0.25;

/// More steps in a span are not a simulation that anybody waits for: a stiffness or an inertia is wrong by orders.
pub(crate) const MOST_STEPS: f64 = 50_000.0;

/// A step of the exponential method costs two to three of the classical one (nine products of a small matrix beside as many evaluations); it is taken
/// where it saves at least this factor.
const PAYS: f64 = 3.0;

/// As how many steps one of the exponential method counts.
const EXPONENTIAL: usize = 3;

/// A plant with its effects under held inputs.
pub(crate) struct System<'a, P: Plant> {
    /// The plant.
    pub plant: &'a P,
    /// Its effects.
    pub hooks: &'a Hooks,
    /// The inputs as they act.
    pub inputs: [f64; 3],
}

impl<P: Plant> System<'_, P> {
    /// Rates at a state; answers the pieces of the laws of joints that the state belongs to, whichever are held.
    fn rates(&self, held: Option<u32>, time: f64, x: &[f64], dx: &mut [f64], outputs: &mut [f64; 3]) -> u32 {
        let pieces = self.plant.evaluate(self.hooks, held, &self.inputs, x, dx, outputs);
        if self.hooks.reads_with_memory() {
            self.hooks.read(time, x, dx, outputs);
        }
        pieces
    }

    /// The same at the state where the work stands.
    pub(crate) fn rates_here(&self, held: Option<u32>, time: f64, work: &mut Work) -> u32 {
        let Work { x, k: [dx, ..], outputs, .. } = &mut *work;
        self.rates(held, time, x, dx, outputs)
    }
}

/// Everything that the inner loop writes.
#[derive(Debug, Default)]
pub(crate) struct Work {
    /// The state.
    pub x: Vec<f64>,
    /// The rates of four stages; the first are those at the state.
    pub k: [Vec<f64>; 4],
    /// True outputs, or what is read of them.
    pub outputs: [f64; 3],
    before: Vec<f64>,
    first: Vec<f64>,
    trial: Vec<f64>,
    parts: Parts,
}

impl Work {
    /// For so many states.
    #[must_use]
    pub(crate) fn new(states: usize) -> Self {
        let of = || vec![0.0; states];
        let parts = Parts::default();
        Work { x: of(), k: [of(), of(), of(), of()], outputs: [0.0; 3], before: of(), first: of(), trial: of(), parts }
    }

    /// Before a run: nothing is left of another.
    pub(crate) fn restart(&mut self) {
        self.x.fill(0.0);
        self.parts.clear();
    }
}

/// A span: its start and its length, in s.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Span {
    /// When it begins.
    pub start: f64,
    /// How long it is.
    pub length: f64,
}

/// Integrates over a span, from a state with its rates in place, found in `pieces`, in steps `refinement` times as fine as the rates ask. The rates at the end
/// are not computed: the next span has other inputs. Answers how many steps that took, one of the exponential method counting as what it costs.
///
/// # Errors
/// The fastest rate, where it asks for more than [`MOST_STEPS`].
pub(crate) fn hold<P: Plant>(
    system: &System<'_, P>,
    work: &mut Work,
    pieces: u32,
    span: Span,
    refinement: usize,
) -> Result<usize, f64> {
    let rates = system.plant.rates(system.hooks, &work.x, &work.k[0], span.length);
    let steps = |rate: f64| (span.length * rate / STEP_RATE).ceil().max(1.0);
    // A change of law also excites modes that dampers kill at once.
    let fastest = if system.hooks.have_pieces() { rates.struck } else { rates.fastest };
    let (small, large) = (steps(fastest.max(rates.nonlinear)), steps(rates.nonlinear));
    if small > MOST_STEPS || small.is_nan() {
        return Err(fastest);
    }
    if PAYS * large <= small && work.x.len() <= MOST_STATES {
        let level = |steps: f64| (steps * refinement as f64).log2().ceil() as usize;
        let deepest = if system.hooks.have_pieces() { level(small) } else { 0 };
        let levels = Levels { first: level(large), deepest };
        exponential::over(system, work, &rates, pieces, (span.start, span.length), levels);
        return Ok(EXPONENTIAL << levels.first);
    }
    let steps = small as usize * refinement;
    let step = span.length / steps as f64;
    if system.hooks.have_pieces() {
        let mut pieces = pieces;
        for k in 0..steps {
            pieces = explicit::across(system, work, pieces, span.start + k as f64 * step, step);
        }
        return Ok(steps);
    }
    for k in 0..steps {
        let time = span.start + k as f64 * step;
        if k > 0 {
            system.rates_here(None, time, work);
        }
        explicit::advance(system, work, None, time, step);
    }
    Ok(steps)
}

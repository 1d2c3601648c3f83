//! A simple integrator for the tests: the classical Runge-Kutta method with a fixed step, events located by bisection, programs evaluated in double
//! precision.

use rsm_core::source::Source;
use rsm_model::expression::{Id, Symbol};
use rsm_model::flat::{Flat, Options};
use rsm_model::system::{Program, System};

/// A text of `tests/models`.
pub(crate) fn source(name: &str) -> Source {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/models").join(format!("{name}.mo"));
    Source::new(
        format!("{name}.mo"),
        std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display())),
    )
}

pub(crate) fn system(name: &str) -> System {
    let flat = Flat::read(&source(name), &Options::default()).unwrap_or_else(|faults| panic!("{faults}"));
    System::new(&flat).unwrap_or_else(|faults| panic!("{faults}"))
}

pub(crate) fn names(system: &System, symbols: &[Symbol]) -> Vec<String> {
    symbols.iter().map(|symbol| system.name(*symbol).to_string()).collect()
}

/// A running system.
pub(crate) struct Simulator {
    system: System,
    continuous: Program,
    events: Program,
    arguments: Vec<Symbol>,
    at_events: Vec<Symbol>,
    pub(crate) parameters: Vec<f64>,
    pub(crate) time: f64,
    pub(crate) states: Vec<f64>,
    held: Vec<f64>,
    memories: Vec<f64>,
    guesses: Vec<f64>,
    conditions: Vec<f64>,
    /// Instants of `sample`: the next one and the period.
    samples: Vec<(f64, f64)>,
    /// The largest residual that remained in a nonlinear block.
    pub(crate) residual: f64,
    wanted: usize,
}

type Inputs<'f> = &'f dyn Fn(f64) -> Vec<f64>;

fn no_surface(_: u32, _: &[f64], _: &[u8]) -> f64 {
    f64::NAN
}

impl Simulator {
    /// At the start of the text; `wanted` are the names of the observed variables.
    pub(crate) fn new(name: &str, wanted: &[&str], inputs: Inputs<'_>) -> Self {
        Self::of(system(name), wanted, inputs)
    }

    pub(crate) fn of(mut system: System, wanted: &[&str], inputs: Inputs<'_>) -> Self {
        let time = system.find("time").unwrap();
        let switches = system.switches().to_vec();
        let mut arguments = vec![time];
        arguments.extend(system.states());
        arguments.extend(system.inputs());
        arguments.extend(system.parameters());
        let shared = arguments.len();
        arguments.extend(switches.iter().map(|switch| switch.held));
        let mut at_events = arguments.clone();
        arguments.extend(system.memories().iter().map(|memory| memory.held));
        at_events.extend(system.memories().iter().map(|memory| memory.before));
        let guesses: Vec<Symbol> = system.iterated().iter().map(|it| it.guess).collect();
        arguments.extend(&guesses);
        at_events.extend(&guesses);
        at_events.extend(system.events().iter().map(|event| event.acts));
        let count = system.flat().samples.len();
        let samples: Vec<Symbol> = (1..=count).map(|k| system.find(&format!("sample {k}")).unwrap()).collect();
        at_events.extend(&samples);
        // Rates, new guesses, residuals, switches, observed variables.
        let mut results: Vec<Id> = system.rates();
        results.extend(system.iterated().iter().map(|it| it.value));
        results.extend(system.iterated().iter().map(|it| it.residual));
        for switch in &switches {
            results.push(switch.left);
            results.push(switch.right);
        }
        for name in wanted {
            let symbol = system.find(name).unwrap_or_else(|| panic!("{name}"));
            results.push(system.value(symbol));
        }
        let continuous = system.program(&arguments, &results).unwrap_or_else(|symbol| panic!("{}", system.name(symbol)));
        // New values of memories, restarted states, conditions.
        let mut results: Vec<Id> = system.memories().iter().map(|memory| memory.next).collect();
        for event in system.events() {
            results.extend(event.restarted.iter().map(|(_, value)| *value));
            results.extend(&event.conditions);
        }
        let events = system.program(&at_events, &results).unwrap_or_else(|symbol| panic!("{}", system.name(symbol)));
        let start = system.start(&[], &[]).unwrap_or_else(|faults| panic!("{faults}"));
        let parameters: Vec<f64> = system.parameters().iter().map(|p| system.parameter_value(*p).unwrap()).collect();
        let periods: Vec<Id> = system.flat().samples.iter().flat_map(|sample| [sample.start, sample.period]).collect();
        let periods = system.program(&system.parameters(), &periods).unwrap().values(&parameters, &no_surface);
        let mut simulator = Simulator {
            continuous,
            events,
            arguments,
            at_events,
            parameters,
            time: 0.0,
            states: vec![0.0; system.states().len()],
            held: vec![0.0; switches.len()],
            memories: vec![0.0; system.memories().len()],
            guesses: vec![0.0; guesses.len()],
            conditions: Vec::new(),
            samples: periods.chunks(2).map(|pair| (pair[0], pair[1])).collect(),
            residual: 0.0,
            wanted: wanted.len(),
            system,
        };
        // If a `when` assigns a variable, the memory is the variable; otherwise the memory is its start value.
        for (k, memory) in simulator.system.memories().to_vec().into_iter().enumerate() {
            let start = simulator.system.flat().variable(memory.variable).start;
            simulator.memories[k] = start.map_or(0.0, |start| {
                let of = simulator.system.program(&simulator.system.parameters(), &[start]).unwrap();
                of.values(&simulator.parameters, &no_surface)[0]
            });
        }
        let mut known = vec![time];
        known.extend(simulator.system.inputs());
        known.extend(simulator.system.parameters());
        known.extend(switches.iter().map(|switch| switch.held));
        known.extend(simulator.system.memories().iter().filter(|memory| memory.held != memory.variable).map(|m| m.before));
        known.extend(start.iterated.iter().map(|it| it.guess));
        let mut results: Vec<Id> = start.iterated.iter().map(|it| it.value).collect();
        results.extend(start.values.iter().map(|(_, value)| *value));
        let program = simulator.system.program(&known, &results).unwrap_or_else(|s| panic!("{}", simulator.system.name(s)));
        let begins = |iterated: &[rsm_model::system::Iterated], simulator: &Simulator| {
            let starts: Vec<Id> = iterated.iter().map(|it| it.start).collect();
            let of = simulator.system.program(&simulator.system.parameters(), &starts).unwrap();
            of.values(&simulator.parameters, &no_surface)
        };
        let mut guesses: Vec<f64> = begins(&start.iterated, &simulator);
        simulator.guesses = begins(simulator.system.iterated(), &simulator);
        for _ in 0..100 {
            let mut values = vec![0.0];
            values.extend(inputs(0.0));
            values.extend(&simulator.parameters);
            values.extend(&simulator.held);
            let is_before = |k: &usize| simulator.system.memories()[*k].held != simulator.system.memories()[*k].variable;
            values.extend((0..simulator.memories.len()).filter(is_before).map(|k| simulator.memories[k]));
            values.extend(&guesses);
            let found = program.values(&values, &no_surface);
            let count = guesses.len();
            guesses.copy_from_slice(&found[..count]);
            for ((symbol, _), value) in start.values.iter().zip(&found[guesses.len()..]) {
                if let Some(k) = simulator.system.states().iter().position(|state| state == symbol) {
                    simulator.states[k] = *value;
                }
                if let Some(k) = simulator.system.memories().iter().position(|memory| memory.held == *symbol) {
                    simulator.memories[k] = *value;
                }
            }
            simulator.settle(inputs);
            simulator.held = simulator.truths(&simulator.evaluate(0.0, &simulator.states, inputs));
        }
        simulator.conditions = simulator.conditions_now(inputs, &[]);
        let _ = shared;
        simulator.happen(inputs);
        simulator
    }

    fn evaluate(&self, time: f64, states: &[f64], inputs: Inputs<'_>) -> Vec<f64> {
        let mut values = vec![time];
        values.extend(states);
        values.extend(inputs(time));
        values.extend(&self.parameters);
        values.extend(&self.held);
        values.extend(&self.memories);
        values.extend(&self.guesses);
        assert_eq!(values.len(), self.arguments.len());
        self.continuous.values(&values, &no_surface)
    }

    fn count(&self) -> usize {
        self.states.len()
    }

    /// Uses the solution of nonlinear blocks as the next guess.
    fn settle(&mut self, inputs: Inputs<'_>) {
        for _ in 0..20 {
            let found = self.evaluate(self.time, &self.states, inputs);
            let (n, m) = (self.count(), self.guesses.len());
            self.guesses.copy_from_slice(&found[n..n + m]);
        }
        self.look(inputs);
    }

    fn look(&mut self, inputs: Inputs<'_>) {
        let found = self.evaluate(self.time, &self.states, inputs);
        let (n, m) = (self.count(), self.guesses.len());
        self.guesses.copy_from_slice(&found[n..n + m]);
        self.residual = found[n + m..n + 2 * m].iter().fold(self.residual, |worst, r| worst.max(r.abs()));
    }

    fn truths(&self, found: &[f64]) -> Vec<f64> {
        let first = self.count() + 2 * self.guesses.len();
        (0..self.held.len()).map(|k| f64::from(u8::from(found[first + 2 * k] < found[first + 2 * k + 1]))).collect()
    }

    /// The current values of the observed variables.
    pub(crate) fn wanted(&self, inputs: Inputs<'_>) -> Vec<f64> {
        let found = self.evaluate(self.time, &self.states, inputs);
        found[found.len() - self.wanted..].to_vec()
    }

    fn stepped(&self, h: f64, inputs: Inputs<'_>) -> Vec<f64> {
        let n = self.count();
        let along = |k: &[f64], h: f64| -> Vec<f64> { self.states.iter().zip(k).map(|(x, k)| x + h * k).collect() };
        let k1 = self.evaluate(self.time, &self.states, inputs);
        let k2 = self.evaluate(self.time + h / 2.0, &along(&k1[..n], h / 2.0), inputs);
        let k3 = self.evaluate(self.time + h / 2.0, &along(&k2[..n], h / 2.0), inputs);
        let k4 = self.evaluate(self.time + h, &along(&k3[..n], h), inputs);
        (0..n).map(|i| self.states[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])).collect()
    }

    /// Advances to an instant in steps of at most `h`.
    pub(crate) fn run_to(&mut self, end: f64, h: f64, inputs: Inputs<'_>) {
        while self.time < end - 1e-12 {
            let next = self.samples.iter().fold(end, |next, (instant, _)| next.min(*instant));
            let count = ((next - self.time) / h).ceil().max(1.0);
            let mut step = (next - self.time) / count;
            let is_changed = |simulator: &Self, step: f64| {
                let states = simulator.stepped(step, inputs);
                simulator.truths(&simulator.evaluate(simulator.time + step, &states, inputs)) != simulator.held
            };
            let mut happens = false;
            if is_changed(self, step) {
                happens = true;
                let (mut before, mut after) = (0.0, step);
                for _ in 0..60 {
                    let middle = 0.5 * (before + after);
                    if is_changed(self, middle) {
                        after = middle;
                    } else {
                        before = middle;
                    }
                }
                step = after;
            }
            self.states = self.stepped(step, inputs);
            self.time += step;
            self.look(inputs);
            let is_sample = self.samples.iter().any(|(instant, _)| (self.time - instant).abs() < 1e-10);
            if happens || is_sample {
                self.happen(inputs);
            }
        }
    }

    fn event_values(&self, inputs: Inputs<'_>, acts: &[f64], samples: &[f64]) -> Vec<f64> {
        let mut values = vec![self.time];
        values.extend(&self.states);
        values.extend(inputs(self.time));
        values.extend(&self.parameters);
        values.extend(&self.held);
        values.extend(&self.memories);
        values.extend(&self.guesses);
        values.extend(acts);
        values.extend(samples);
        assert_eq!(values.len(), self.at_events.len());
        self.events.values(&values, &no_surface)
    }

    /// The conditions of all branches, before any of them acts. No sample is due except those given.
    fn conditions_now(&self, inputs: Inputs<'_>, samples: &[f64]) -> Vec<f64> {
        let none = vec![0.0; self.samples.len()];
        let samples = if samples.is_empty() { &none[..] } else { samples };
        let found = self.event_values(inputs, &vec![0.0; self.system.events().len()], samples);
        let mut at = self.memories.len();
        let mut conditions = Vec::new();
        for event in self.system.events() {
            at += event.restarted.len();
            conditions.extend(&found[at..at + event.conditions.len()]);
            at += event.conditions.len();
        }
        conditions
    }

    /// Executes the events of an instant until nothing changes.
    fn happen(&mut self, inputs: Inputs<'_>) {
        let mut samples: Vec<f64> =
            self.samples.iter().map(|(instant, _)| f64::from(u8::from((self.time - instant).abs() < 1e-10))).collect();
        for (k, due) in samples.iter().enumerate() {
            if *due == 1.0 {
                self.samples[k].0 += self.samples[k].1;
            }
        }
        for _ in 0..20 {
            let held = self.truths(&self.evaluate(self.time, &self.states, inputs));
            let changed = held != self.held;
            self.held = held;
            let conditions = self.conditions_now(inputs, &samples);
            let mut acts: Vec<f64> = Vec::new();
            let mut at = 0;
            for event in self.system.events() {
                let rises = (at..at + event.conditions.len()).any(|k| conditions[k] != 0.0 && self.conditions[k] == 0.0);
                at += event.conditions.len();
                let free = event.unless.iter().all(|other| acts[*other] == 0.0);
                acts.push(f64::from(u8::from(rises && free)));
            }
            self.conditions = conditions;
            let found = self.event_values(inputs, &acts, &samples);
            let memories = found[..self.memories.len()].to_vec();
            let remembers = memories != self.memories;
            let mut at = self.memories.len();
            for (k, event) in self.system.events().to_vec().into_iter().enumerate() {
                for (state, _) in &event.restarted {
                    if acts[k] == 1.0 {
                        let place = self.system.states().iter().position(|it| it == state).unwrap();
                        self.states[place] = found[at];
                    }
                    at += 1;
                }
                at += event.conditions.len();
            }
            self.memories = memories;
            samples.fill(0.0);
            if !changed && !remembers && acts.iter().all(|acts| *acts == 0.0) {
                break;
            }
        }
        self.conditions = self.conditions_now(inputs, &[]);
        self.settle(inputs);
    }
}

//! A plant along a record: inputs with their effects, the equations, sensors.
//!
//! In: a true plant and its drive. Out: columns without noise, and with the sensor effects. Steps have error control: `flow.rs`.

use super::{Cause, Drive, Law, Slots, System, TIME, Truth};
use crate::flow::{Flow, STATES, State, Stepper};
use crate::plant::{Delay, Record};

/// An effect of an input, in the order of the list.
#[derive(Debug, Clone, Copy)]
enum OnInput {
    Gain(f64),
    Bias(f64),
    Exponent(f64),
    Throttle(f64),
    DeadBand(f64),
    Limit(f64, f64),
    /// Time constant and state index.
    Lag(f64, usize),
}

/// An effect of a sensor without memory, before the noise.
#[derive(Debug, Clone, Copy)]
enum OnOutput {
    Gain(f64),
    Bias(f64),
    Drift(f64),
}

/// A plant with all its effects.
struct Flowing {
    law: Box<dyn Law>,
    inputs: Vec<Vec<OnInput>>,
    /// Output, time constant, state.
    lags: Vec<(usize, f64, usize)>,
    held: Vec<f64>,
    scale: State,
}

impl Flowing {
    fn acting(&self, y: &State) -> [f64; 4] {
        let mut acting = [0.0; 4];
        for ((acting, held), effects) in acting.iter_mut().zip(&self.held).zip(&self.inputs) {
            *acting = effects.iter().fold(*held, |u, effect| match *effect {
                OnInput::Lag(_, state) => y[state],
                _ => at_once(*effect, u),
            });
        }
        acting
    }

    /// Writes the rates of the lags of inputs.
    fn lagged(&self, y: &State, dy: &mut State) {
        for (held, effects) in self.held.iter().zip(&self.inputs) {
            let mut u = *held;
            for effect in effects {
                if let OnInput::Lag(time_constant, state) = *effect {
                    dy[state] = (u - y[state]) / time_constant;
                    u = y[state];
                } else {
                    u = at_once(*effect, u);
                }
            }
        }
    }
}

fn at_once(effect: OnInput, u: f64) -> f64 {
    match effect {
        OnInput::Gain(gain) => gain * u,
        OnInput::Bias(bias) => u + bias,
        OnInput::Exponent(exponent) => u.signum() * u.abs().powf(exponent),
        OnInput::Throttle(exponent) => u.max(0.0).powf(exponent),
        OnInput::DeadBand(width) => u - u.clamp(-0.5 * width, 0.5 * width),
        OnInput::Limit(low, high) => u.min(high).max(low),
        OnInput::Lag(..) => u,
    }
}

impl Flow for Flowing {
    fn regime(&self, y: &State) -> u8 {
        self.law.regime(y)
    }

    fn derivative(&self, y: &State, regime: u8) -> State {
        let mut dy = [0.0; STATES];
        let acting = self.acting(y);
        self.law.rates(&acting, y, regime, &mut dy);
        self.lagged(y, &mut dy);
        if !self.lags.is_empty() {
            let outputs = self.law.outputs(y);
            self.lags
                .iter()
                .for_each(|(output, time_constant, state)| dy[*state] = (outputs[*output] - y[*state]) / time_constant);
        }
        dy[TIME] = 1.0;
        dy
    }

    fn scale(&self) -> &State {
        &self.scale
    }
}

/// A delayed sensor: the output, whole rows, and a rest in seconds.
struct Late {
    output: usize,
    rows: usize,
    rest: f64,
}

/// Effects on one place, in the order of the list.
fn on<'t>(truth: &'t Truth, at: &'t str) -> impl Iterator<Item = &'t Cause> {
    truth.causes.iter().filter(move |it| it.at == at)
}

fn on_inputs(truth: &Truth, slots: &mut Slots) -> Vec<Vec<OnInput>> {
    let one = |cause: &Cause, slots: &mut Slots| {
        let of = |name: &str| cause.get(name).unwrap_or(0.0);
        Some(match cause.kind.as_str() {
            "input-gain" => OnInput::Gain(of("gain")),
            "input-bias" => OnInput::Bias(of("bias")),
            "input-exponent" => OnInput::Exponent(of("exponent")),
            "throttle-nonlinearity" => OnInput::Throttle(of("exponent")),
            "input-dead-band" => OnInput::DeadBand(of("width")),
            "input-limit" => OnInput::Limit(of("low"), of("high")),
            "input-lag" => OnInput::Lag(of("time_constant"), slots.take()),
            _ => return None,
        })
    };
    truth.system.inputs.iter().map(|input| on(truth, input.name).filter_map(|cause| one(cause, slots)).collect()).collect()
}

fn on_outputs(truth: &Truth) -> Vec<(usize, OnOutput)> {
    let one = |cause: &Cause| {
        let output = truth.system.output(&cause.at)?;
        let of = |name: &str| cause.get(name).unwrap_or(0.0);
        Some(match cause.kind.as_str() {
            "sensor-gain" => (output, OnOutput::Gain(of("gain"))),
            "sensor-bias" => (output, OnOutput::Bias(of("bias"))),
            "sensor-drift" => (output, OnOutput::Drift(of("rate"))),
            _ => return None,
        })
    };
    truth.causes.iter().filter_map(one).collect()
}

fn late(truth: &Truth, period: f64) -> Option<Late> {
    let cause = truth.causes.iter().find(|it| it.kind == "sensor-delay")?;
    let delay = cause.get("delay")?;
    // A delay of 3 periods as a decimal must not become 2.9999: a billionth of a period is rounding.
    let rows = (delay / period + 1e-9).floor();
    let rest = delay - rows * period;
    Some(Late {
        output: truth.system.output(&cause.at)?,
        rows: rows as usize,
        rest: if rest > 1e-9 * period { rest } else { 0.0 },
    })
}

/// The effects of sensors on outputs, before the noise.
fn sensed(effects: &[(usize, OnOutput)], mut read: Vec<f64>, time: f64) -> Vec<f64> {
    for (output, effect) in effects {
        let value = &mut read[*output];
        match effect {
            OnOutput::Gain(gain) => *value *= gain,
            OnOutput::Bias(bias) => *value += bias,
            OnOutput::Drift(rate) => *value += rate * time,
        }
    }
    read
}

/// Simulates a true plant from true outputs. `drive` computes the inputs of a row from the last true outputs, like a controller.
pub fn run(truth: &Truth, start: &[f64], rows: usize, drive: &mut Drive) -> Record {
    let system: &System = truth.system;
    let period = system.period;
    let mut slots = Slots::default();
    let law = (system.build)(truth, &mut slots);
    let inputs = on_inputs(truth, &mut slots);
    let lag = |cause: &Cause| Some((system.output(&cause.at)?, cause.get("time_constant")?));
    let lags: Vec<(usize, f64, usize)> = truth
        .causes
        .iter()
        .filter(|it| it.kind == "sensor-lag")
        .filter_map(lag)
        .map(|(output, time_constant)| (output, time_constant, slots.take()))
        .collect();
    let mut scale = [1.0; STATES];
    law.scale(&mut scale);
    lags.iter().for_each(|(output, _, state)| scale[*state] = system.outputs[*output].noise);
    for (input, effects) in system.inputs.iter().zip(&inputs) {
        for effect in effects {
            if let OnInput::Lag(_, state) = effect {
                scale[*state] = 0.01 * (input.range.1 - input.range.0);
            }
        }
    }
    let first = drive(0, start);
    let mut flowing = Flowing { law, inputs, lags, held: first.clone(), scale };
    let mut y = [0.0; STATES];
    // Lags start in equilibrium, with the value of their input.
    for (held, effects) in flowing.held.iter().zip(&flowing.inputs) {
        let mut u = *held;
        for effect in effects {
            match effect {
                OnInput::Lag(_, state) => y[*state] = u,
                _ => u = at_once(*effect, u),
            }
        }
    }
    let acting = flowing.acting(&y);
    flowing.law.start(start, &acting, &mut y);
    let outputs = flowing.law.outputs(&y);
    flowing.lags.iter().for_each(|(output, _, state)| y[*state] = outputs[*output]);

    let delay_of = |name: &str| on(truth, name).find(|it| it.kind == "input-delay").and_then(|it| it.get("delay"));
    let mut delays: Vec<Delay> = system.inputs.iter().map(|it| Delay::new(delay_of(it.name).unwrap_or(0.0), period)).collect();
    let is_late: Vec<bool> = system.inputs.iter().map(|it| delay_of(it.name).is_some()).collect();
    let sensors = on_outputs(truth);
    let late = late(truth, period);
    assert!(late.is_none() || !is_late.contains(&true), "an input and a sensor that are both late are not built");
    assert!(is_late.iter().filter(|it| **it).count() < 2, "two late inputs are not built");

    let mut record = Record { period, inputs: vec![vec![]; system.inputs.len()], outputs: vec![vec![]; system.outputs.len()] };
    let mut stepper = Stepper::new(0.1 * period);
    let mut on_the_way = vec![];
    let read = |flowing: &Flowing, y: &State| {
        let mut outputs = flowing.law.outputs(y);
        flowing.lags.iter().for_each(|(output, _, state)| outputs[*output] = y[*state]);
        outputs
    };
    for row in 0..rows {
        let inputs = if row == 0 { first.clone() } else { drive(row, &flowing.law.outputs(&y)) };
        let outputs = sensed(&sensors, read(&flowing, &y), y[TIME]);
        record.inputs.iter_mut().zip(&inputs).for_each(|(column, value)| column.push(*value));
        record.outputs.iter_mut().zip(outputs).for_each(|(column, value)| column.push(value));
        delays.iter_mut().zip(&inputs).for_each(|(delay, value)| delay.push(vec![*value]));
        let late_input = is_late.iter().position(|it| *it);
        let mut parts = match late_input {
            Some(which) => delays[which].parts(period),
            None => vec![(period, vec![])],
        };
        if let Some(it) = late.as_ref().filter(|it| it.rest > 0.0) {
            parts = vec![(period - it.rest, vec![]), (it.rest, vec![])];
        }
        for (number, (duration, value)) in parts.iter().enumerate() {
            flowing.held.clone_from(&inputs);
            if let (Some(which), Some(value)) = (late_input, value.first()) {
                flowing.held[which] = *value;
            }
            stepper.advance(&flowing, &mut y, *duration);
            if let Some(it) = late.as_ref().filter(|it| it.rest > 0.0 && number == 0) {
                on_the_way.push(sensed(&sensors, read(&flowing, &y), y[TIME])[it.output]);
            }
        }
    }
    if let Some(it) = late {
        let column = &mut record.outputs[it.output];
        let first = column[0];
        let taken = if it.rest > 0.0 { on_the_way } else { column.clone() };
        let rows_late = it.rows + usize::from(it.rest > 0.0);
        column
            .iter_mut()
            .enumerate()
            .for_each(|(row, value)| *value = row.checked_sub(rows_late).map_or(first, |at| taken[at]));
    }
    record
}

/// Simulates another plant with the inputs of a record, from true outputs.
pub fn again(truth: &Truth, start: &[f64], inputs: &[Vec<f64>]) -> Record {
    let columns = inputs.to_vec();
    let mut drive: Drive = Box::new(move |row, _| columns.iter().map(|column| column[row]).collect());
    run(truth, start, inputs[0].len(), &mut drive)
}

/// Applies the effects of coarse, limited and blind sensors to noisy readings.
pub fn finish(truth: &Truth, record: &mut Record) {
    for cause in &truth.causes {
        let Some(output) = truth.system.output(&cause.at) else { continue };
        let of = |name: &str| cause.get(name).unwrap_or(0.0);
        let column = record.outputs[output].iter_mut();
        match cause.kind.as_str() {
            "sensor-quantisation" => column.for_each(|it| *it = of("step") * (*it / of("step")).round()),
            "sensor-limit" => column.for_each(|it| *it = it.min(of("high")).max(of("low"))),
            "sensor-lost-sign" => column.for_each(|it| *it = it.abs()),
            _ => {}
        }
    }
}

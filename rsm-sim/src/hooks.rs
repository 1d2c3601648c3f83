//! All effects of a plant file together: every hook calls each effect in the order of the file.
//!
//! In: the effects of a plant file. Out: their contribution at each fixed place of the plant's equations. Contains the assignment of states to
//! effects; the plant's own states come first. It does not allocate memory after it has been built.

use crate::effect::{Carried, Contact, Currents, Effect, FirstInstant, Joint, Machine, Motion, Scale, Split, Twist};
use crate::plant_file::PlantFile;

struct Active {
    effect: Box<dyn Effect>,
    /// The states of the effect are `first..end`.
    first: usize,
    end: usize,
    /// The share of inertia that the effect moves behind a joint.
    split: Option<f64>,
    /// The position of its two bits in the number with the pieces of all effects.
    shift: u32,
}

/// The bit mask of an effect's piece.
const PIECE: u32 = 3;

impl Active {
    fn held(&self, pieces: Option<u32>) -> Option<u32> {
        pieces.map(|pieces| pieces >> self.shift & PIECE)
    }
}

/// The effects of one simulation.
pub struct Hooks {
    active: Vec<Active>,
    /// The effects that act between rows; the inner loop calls only these. The hooks of the inner loop return early if there are none, because a
    /// plant without effects is simulated thousands of times.
    inner: Vec<usize>,
    states: usize,
    memory: bool,
    pieces: bool,
}

impl Hooks {
    /// The effects of a file, for a plant with `own_states` states without effects.
    #[must_use]
    pub fn new(file: &PlantFile, own_states: usize) -> Self {
        let mut states = own_states;
        let mut memory = false;
        let mut shift = 0;
        let mut active = Vec::new();
        for entry in file.acting() {
            let effect = (entry.description.build)(&entry.arguments);
            let first = states;
            states += effect.states();
            memory |= effect.reads_with_memory();
            let own = shift;
            if effect.has_pieces() {
                shift += PIECE.count_ones();
                // The limit is sixteen joints with free play on one plant. The reader of plant files does not limit the number of effects of one
                // kind.
                assert!(shift < u32::BITS, "the pieces of so many joints have no room");
            }
            active.push(Active { first, end: states, split: effect.split(), shift: own, effect });
        }
        let inner = (0..active.len()).filter(|k| active[*k].effect.acts_between_rows()).collect();
        Hooks { active, inner, states, memory, pieces: shift > 0 }
    }

    fn inner(&self) -> impl DoubleEndedIterator<Item = &Active> {
        self.inner.iter().map(|k| &self.active[*k])
    }

    /// The number of states of plant and effects.
    #[must_use]
    pub fn states(&self) -> usize {
        self.states
    }

    /// Whether the reading of an output has a state.
    #[must_use]
    pub fn reads_with_memory(&self) -> bool {
        self.memory
    }

    /// Whether the law of a joint is defined in pieces.
    #[must_use]
    pub fn have_pieces(&self) -> bool {
        self.pieces
    }

    /// The first input after all effects.
    #[must_use]
    pub fn input(&self, value: f64) -> f64 {
        self.active.iter().fold(value, |value, it| it.effect.input(value))
    }

    /// The delay of the first input, in s.
    #[must_use]
    pub fn delay(&self) -> f64 {
        self.active.iter().map(|it| it.effect.delay()).sum()
    }

    /// The delay of the readings of an output, in s.
    #[must_use]
    pub fn reads_late(&self, output: usize) -> f64 {
        self.active.iter().map(|it| it.effect.reads_late(output)).sum()
    }

    /// Sets the states of all effects at the start.
    pub fn start(&self, start: &FirstInstant, x: &mut [f64]) {
        for it in &self.active {
            it.effect.start(start, &mut x[it.first..it.end]);
        }
    }

    /// Sets the start of the states that depend on outputs, from the true outputs.
    pub fn settle(&self, time: f64, mut outputs: [f64; 3], x: &mut [f64], dx: &mut [f64]) {
        for it in &self.active {
            it.effect.settle(&outputs, &mut x[it.first..it.end]);
            for (k, value) in outputs.iter_mut().enumerate() {
                *value = it.effect.reads(k, *value, time, &x[it.first..it.end], &mut dx[it.first..it.end]);
            }
        }
    }

    /// The fastest rate of all effects, in 1/s.
    #[must_use]
    pub fn fastest_rate(&self, scale: &Scale) -> f64 {
        self.active.iter().map(|it| it.effect.fastest_rate(scale)).fold(0.0, f64::max)
    }

    /// The fastest rate that remains after the linear part is subtracted, in 1/s.
    #[must_use]
    pub fn nonlinear_rate(&self, scale: &Scale) -> f64 {
        self.active.iter().map(|it| it.effect.nonlinear_rate(scale)).fold(0.0, f64::max)
    }

    /// The sum of their rates, in 1/s.
    #[must_use]
    pub fn sum_of_rates(&self, scale: &Scale) -> f64 {
        self.active.iter().map(|it| it.effect.fastest_rate(scale)).sum()
    }

    /// The angle by which the frame of the record is rotated, in rad.
    #[must_use]
    #[inline]
    pub fn frame_angle(&self, theta: f64) -> f64 {
        if self.inner.is_empty() {
            return 0.0;
        }
        self.inner().map(|it| it.effect.frame_angle(theta)).sum()
    }

    /// The voltage at the windings: first the limit of the bus is applied, then the loss of the switches.
    #[must_use]
    #[inline]
    pub fn voltage(&self, voltage: [f64; 2], current: [f64; 2]) -> [f64; 2] {
        if self.inner.is_empty() {
            return voltage;
        }
        let allowed = self.inner().fold(voltage, |voltage, it| it.effect.voltage_limit(voltage));
        self.inner().fold(allowed, |voltage, it| it.effect.voltage_loss(voltage, current))
    }

    /// Sets the parameters of a motor that depend on its state.
    #[inline]
    pub fn machine(&self, at: &Currents, x: &[f64], dx: &mut [f64], machine: &mut Machine) {
        if self.inner.is_empty() {
            return;
        }
        for it in self.inner() {
            it.effect.machine(at, &x[it.first..it.end], &mut dx[it.first..it.end], machine);
        }
    }

    /// The effort on the first body.
    #[must_use]
    #[inline]
    pub fn effort(&self, motion: &Motion) -> f64 {
        if self.inner.is_empty() {
            return 0.0;
        }
        self.inner().map(|it| it.effect.effort(motion)).sum()
    }

    /// The share of inertia that remains at the drive.
    #[must_use]
    pub fn drive_share(&self) -> f64 {
        1.0 - self.inner().filter_map(|it| it.split).sum::<f64>()
    }

    /// The part of a load that reaches the first body. Bodies that are split off form a chain in the order of the file; the load acts on the last
    /// one.
    #[inline]
    pub fn load(&self, body: &Split, x: &[f64], dx: &mut [f64]) -> Carried {
        if self.inner.is_empty() {
            return Carried { effort: body.load, piece: 0 };
        }
        let own = |dx: &mut [f64], it: &Active| it.effect.load(&x[it.first..it.end], &mut dx[it.first..it.end]);
        let mut reaction = self.inner().fold(body.load, |load, it| load + own(dx, it));
        let mut pieces = 0;
        for k in (0..self.active.len()).rev() {
            let it = &self.active[k];
            if it.split.is_none() {
                continue;
            }
            let before = self.active[..k].iter().rfind(|other| other.split.is_some());
            let near = before.map_or(body.near, |other| other.effect.far_motion(&x[other.first..other.end]));
            let split = Split { near, inertia: body.inertia, load: reaction, held: it.held(body.held) };
            let carried = it.effect.passes(&split, &x[it.first..it.end], &mut dx[it.first..it.end]);
            reaction = carried.effort;
            pieces |= carried.piece << it.shift;
        }
        Carried { effort: reaction, piece: pieces }
    }

    /// The effort of a joint, by its law.
    #[must_use]
    #[inline]
    pub fn joint(&self, twist: &Twist, held: Option<u32>) -> Carried {
        let linear = twist.stiffness * twist.angle + twist.damping * twist.rate;
        if self.inner.is_empty() {
            return Carried { effort: linear, piece: 0 };
        }
        let mut carried = Carried { effort: linear, piece: 0 };
        let after = |it: &Active, before: Carried, next: Carried| Carried {
            effort: next.effort,
            piece: before.piece | next.piece << it.shift,
        };
        for it in self.inner() {
            carried = after(it, carried, it.effect.joint(twist, carried.effort, it.held(held)));
        }
        for it in self.inner() {
            carried = after(it, carried, it.effect.joint_limit(twist.joint, carried.effort, it.held(held)));
        }
        carried
    }

    /// The free play of a joint.
    #[must_use]
    pub fn slack(&self, joint: Joint) -> f64 {
        self.inner().map(|it| it.effect.slack(joint)).sum()
    }

    /// The torque of an engine.
    #[must_use]
    #[inline]
    pub fn engine_torque(&self, torque: f64, crank_angle: f64) -> f64 {
        if self.inner.is_empty() {
            return torque;
        }
        self.inner().fold(torque, |torque, it| it.effect.engine_torque(torque, crank_angle))
    }

    /// The speed of the air against the vehicle.
    #[must_use]
    #[inline]
    pub fn air_speed(&self, speed: f64) -> f64 {
        if self.inner.is_empty() {
            return speed;
        }
        self.inner().fold(speed, |speed, it| it.effect.air_speed(speed))
    }

    /// The speed of a vehicle if the wheel can slip.
    #[must_use]
    #[inline]
    pub fn vehicle_speed(&self, x: &[f64]) -> Option<f64> {
        if self.inner.is_empty() {
            return None;
        }
        self.inner().find_map(|it| it.effect.vehicle_speed(&x[it.first..it.end]))
    }

    /// The force between wheel and road, if the wheel can slip.
    #[inline]
    pub fn traction(&self, contact: &Contact, x: &[f64], dx: &mut [f64]) -> Option<f64> {
        if self.inner.is_empty() {
            return None;
        }
        self.inner().find_map(|it| it.effect.traction(contact, &x[it.first..it.end], &mut dx[it.first..it.end]))
    }

    /// Converts true outputs to readings.
    pub fn read(&self, time: f64, x: &[f64], dx: &mut [f64], outputs: &mut [f64; 3]) {
        for it in &self.active {
            for (k, value) in outputs.iter_mut().enumerate() {
                *value = it.effect.reads(k, *value, time, &x[it.first..it.end], &mut dx[it.first..it.end]);
            }
        }
    }

    /// Converts a reading to the true value: the inverse of each effect, the last effect first.
    #[must_use]
    pub fn truth(&self, output: usize, reading: f64, time: f64) -> f64 {
        self.active.iter().rev().fold(reading, |value, it| it.effect.truth(output, value, time))
    }
}

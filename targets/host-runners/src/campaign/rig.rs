//! Both steps in closed loop with the plant of the campaign; a fault can change their samples.
//!
//! In: a speed, a bus voltage, demands, a fault. Out: the plant's state after each PWM period. Of the states of the steps it reads only the command
//! of the bridge.

use motor_loop::{Command, CurrentState, Demand, Drive, Measured, Motor, ReferenceState, Tuning, currents, references};

use super::plant::Plant;

/// The PWM period, in s.
pub const PERIOD_S: f64 = 1e-4;

/// PWM periods in a tick of the outer step.
pub const PERIODS_A_TICK: u32 = 10;

/// The constants of the trial motor for the steps: 10 kHz, a bandwidth of 1/(6 T) in round numbers, no dead time because the bridge has mean
/// voltages.
#[must_use]
pub fn drive() -> Drive {
    let motor = Motor {
        phase_resistance_ohm: 0.08,
        phase_inductance_h: 0.9e-3,
        flux_linkage_wb: 0.06,
        pole_pairs: 4.0,
        bus_voltage_v: 270.0,
        current_limit_a: 60.0,
    };
    let tuning = Tuning { pwm_period_s: PERIOD_S as f32, bandwidth_rad_s: 1500.0, dead_time_s: 0.0, dead_time_current_a: 1.0 };
    Drive::new(&motor, &tuning)
}

/// The inputs and outputs of the steps in one period, for the comparison with another language.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exchanged {
    /// The input of the outer step; `None` in a period without it.
    pub demand: Option<Demand>,
    /// The input of the inner step.
    pub measured: Measured,
    /// The output of the inner step.
    pub command: Command,
}

/// The loop.
#[derive(Debug, Clone)]
pub struct Rig {
    /// The motor.
    pub plant: Plant,
    /// The state of the outer step.
    pub outer: ReferenceState,
    /// The state of the inner step.
    pub inner: CurrentState,
    drive: Drive,
    command: Command,
    /// Periods since the start.
    pub period: u32,
}

impl Rig {
    /// A loop with all steps at rest, and a plant.
    #[must_use]
    pub fn new(plant: Plant) -> Self {
        Rig::with_drive(plant, drive())
    }

    /// The same, with other constants of the steps.
    #[must_use]
    pub fn with_drive(plant: Plant, drive: Drive) -> Self {
        let inner = CurrentState::default();
        Rig { plant, outer: ReferenceState::default(), command: inner.last, inner, drive, period: 0 }
    }

    /// The loop in operation: the bridge is closed, and the state of the inner step agrees with the plant. A test may then set any state.
    pub fn begin(&mut self) {
        while !self.closed() || self.inner.waiting > 0.0 {
            self.step(0.0, &mut |_, _| ());
        }
    }

    /// Whether the bridge is closed in the next period.
    #[must_use]
    pub fn closed(&self) -> bool {
        self.command.closed > 0.5
    }

    /// The readings of intact sensors now.
    #[must_use]
    pub fn truth(&self, torque_nm: f32) -> (Demand, Measured) {
        let (speed_rad_s, bus_voltage_v) = (self.plant.speed as f32, self.plant.bus as f32);
        let currents_a = self.plant.phases().map(|current| current as f32);
        let demand = Demand { torque_nm, speed_rad_s, bus_voltage_v, voltage_share: self.inner.voltage_share };
        (demand, Measured { currents_a, angle_turns: self.plant.turns() as f32, speed_rad_s, bus_voltage_v })
    }

    /// One PWM period at a torque demand; `spoil` may change the inputs of the steps. The command of a period acts in the next.
    pub fn step(&mut self, torque_nm: f32, spoil: &mut dyn FnMut(&mut Demand, &mut Measured)) -> Exchanged {
        let (mut demand, mut measured) = self.truth(torque_nm);
        spoil(&mut demand, &mut measured);
        let ticks = self.period.is_multiple_of(PERIODS_A_TICK);
        if ticks {
            references(&mut self.outer, &self.drive, &demand);
        }
        let command = currents(&mut self.inner, &self.drive, &self.outer.last, &measured);
        let acting = self.closed().then(|| self.command.duties.map(f64::from));
        self.plant.run(acting, PERIOD_S);
        self.command = command;
        self.period += 1;
        Exchanged { demand: ticks.then_some(demand), measured, command }
    }
}

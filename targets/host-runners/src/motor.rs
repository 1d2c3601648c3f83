//! The motor's two steps with a simulated drive: in real time, and as fast as possible.
//!
//! In: the settings of the loop. Out: its report, counts of the samples, and figures of the drive. In real time the 1 kHz step runs in the loop's
//! thread, and the inner step with inverter, motor and encoder in the plant's thread, like a drive with two processors: the inner step cannot wait
//! for the outer one. [`ride`] and [`Outer`] are these two sides, for connections other than a ring: a federation or a network.

use host_loop::{Report, Settings};
use motor_loop::{
    Command, CurrentState, Demand, Drive, Measured, Motor, ReferenceState, References, Tuning, currents, references,
};
use rsm_core::source::Source;
use rsm_rigs::motor::closed_loop::{self, ClosedLoop, Row, Sensed, Task};
use rsm_rigs::motor::controller::{self, Controller, Known};
use rsm_rigs::motor::machine::Truth;
use rsm_sim::plant_file::PlantFile;

use crate::exchange::{self, Exchange, PlantEnd};

/// The trial motor of the project.
const PLANT: &str = include_str!("../../../rsm-sim/plants/pmac.toml");

/// The bandwidth of the current control times the PWM period: 1/6 leaves 75 degrees of phase margin with the dead time of 1.5 periods.
const BANDWIDTH_PERIODS: f64 = 1.0 / 6.0;

/// From this current on the dead time is compensated in full: a few times the ripple at zero crossing, and a sixtieth of the limit.
const DEAD_TIME_CURRENT_A: f32 = 1.0;

/// The constants of the steps from the data that a controller of the simulation gets.
#[must_use]
pub fn drive_of(known: &Known) -> Drive {
    let motor = Motor {
        phase_resistance_ohm: known.resistance as f32,
        phase_inductance_h: known.inductance as f32,
        flux_linkage_wb: known.flux_linkage as f32,
        pole_pairs: known.pole_pairs as f32,
        bus_voltage_v: known.bus_voltage as f32,
        current_limit_a: known.current_limit as f32,
    };
    let tuning = Tuning {
        pwm_period_s: known.pwm_period as f32,
        bandwidth_rad_s: (BANDWIDTH_PERIODS / known.pwm_period) as f32,
        dead_time_s: known.dead_time as f32,
        dead_time_current_a: DEAD_TIME_CURRENT_A,
    };
    Drive::new(&motor, &tuning)
}

/// Both steps as a controller of the simulation.
#[derive(Debug, Clone)]
pub struct Steps {
    drive: Drive,
    outer: ReferenceState,
    inner: CurrentState,
    /// Number of periods in which the bridge would have been open.
    opened: u32,
}

impl Steps {
    /// Steps at rest, from the data that a controller gets.
    #[must_use]
    pub fn new(known: &Known) -> Self {
        Steps { drive: drive_of(known), outer: ReferenceState::default(), inner: CurrentState::default(), opened: 0 }
    }

    fn currents(&mut self, wanted: &References, measured: &controller::Measured) -> [f64; 3] {
        // Reduced in double precision: a unit in the last place of a turn is then 6e-8.
        let angle_turns = (measured.angle_rad / std::f64::consts::TAU).rem_euclid(1.0) as f32;
        let sampled = Measured {
            currents_a: measured.currents_a.map(|current| current as f32),
            angle_turns,
            speed_rad_s: measured.speed_rad_s as f32,
            bus_voltage_v: measured.bus_voltage_v as f32,
        };
        // The simulated inverter has no open bridge, so it starts like a board whose bridge has just closed after ten good samples. A safe state
        // later would be a fault of this program, and is counted.
        if self.inner.bus_voltage_v == 0.0 {
            let a_period = self.drive.turns_per_speed * sampled.speed_rad_s;
            let mut before = Measured { angle_turns: angle_turns - self.drive.limits.good_in_a_row * a_period, ..sampled };
            while self.inner.last.closed < 0.5 {
                currents(&mut self.inner, &self.drive, wanted, &before);
                before.angle_turns = self.inner.angle_turns;
            }
        }
        let command = currents(&mut self.inner, &self.drive, wanted, &sampled);
        self.opened += u32::from(command.closed < 0.5);
        let Command { duties, .. } = command;
        duties.map(f64::from)
    }

    /// Number of periods in which the bridge would have been open.
    #[must_use]
    pub fn opened(&self) -> u32 {
        self.opened
    }
}

fn demand_of(demand: &controller::Demand, voltage_share: f32) -> Demand {
    let controller::Demand { torque_nm, speed_rad_s, bus_voltage_v } = *demand;
    let (torque_nm, speed_rad_s, bus_voltage_v) = (torque_nm as f32, speed_rad_s as f32, bus_voltage_v as f32);
    Demand { torque_nm, speed_rad_s, bus_voltage_v, voltage_share }
}

fn shown(wanted: &References) -> controller::References {
    controller::References { i_d_a: f64::from(wanted.i_d_a), i_q_a: f64::from(wanted.i_q_a) }
}

impl Controller for Steps {
    fn references(&mut self, demand: &controller::Demand) -> controller::References {
        shown(&references(&mut self.outer, &self.drive, &demand_of(demand, self.inner.voltage_share)))
    }

    fn duties(&mut self, measured: &controller::Measured) -> [f64; 3] {
        let wanted = self.outer.last;
        self.currents(&wanted, measured)
    }
}

/// The outer step alone: it gets a sample and returns a command.
#[derive(Debug, Clone)]
pub struct Outer {
    drive: Drive,
    state: ReferenceState,
}

impl Outer {
    /// A step at rest, with the constants of the shipped motor.
    #[must_use]
    pub fn shipped() -> Self {
        let plant = PlantFile::read(&Source::new("pmac.toml", PLANT)).expect("the shipped motor is a plant file");
        Outer::new(&closed_loop::Drive::default().known(&plant))
    }

    fn new(known: &Known) -> Self {
        Outer { drive: drive_of(known), state: ReferenceState::default() }
    }

    /// i_d and i_q, in A, for a sample: torque demand in N m, speed in rad/s, bus voltage in V, and the share of the voltage that the inner step
    /// requests.
    pub fn answer(&mut self, [torque_nm, speed_rad_s, bus_voltage_v, share]: [f64; 4]) -> [f64; 2] {
        let demand = demand_of(&controller::Demand { torque_nm, speed_rad_s, bus_voltage_v }, share as f32);
        let References { i_d_a, i_q_a } = references(&mut self.state, &self.drive, &demand);
        [i_d_a, i_q_a].map(f64::from)
    }

    /// Number of bad samples.
    #[must_use]
    pub fn bad_samples(&self) -> u32 {
        self.state.bad.all
    }
}

/// The plant's side: it contains the inner step; the outer step is on the other side.
struct Remote<E> {
    exchange: E,
    steps: Steps,
    wanted: References,
    period_ns: u64,
    tick: u64,
    ended: bool,
}

impl<E: FnMut([f64; 4]) -> Option<[f64; 2]>> Controller for Remote<E> {
    fn references(&mut self, demand: &controller::Demand) -> controller::References {
        let controller::Demand { torque_nm, speed_rad_s, bus_voltage_v } = *demand;
        let speed = if crate::is_bad_sample(self.tick, self.period_ns) { f64::NAN } else { speed_rad_s };
        let share = f64::from(self.steps.inner.voltage_share);
        match (self.exchange)([torque_nm, speed, bus_voltage_v, share]) {
            Some(answer) => {
                let [i_d_a, i_q_a] = answer.map(|value| value as f32);
                self.wanted = References { i_d_a, i_q_a };
            }
            None => self.ended = true,
        }
        self.tick += 1;
        shown(&self.wanted)
    }

    fn duties(&mut self, measured: &controller::Measured) -> [f64; 3] {
        let wanted = self.wanted;
        self.steps.currents(&wanted, measured)
    }
}

/// The speed rises and falls repeatedly through the whole weakening region in both directions.
struct Shuttle {
    up: bool,
}

/// 7500 rpm is 785 rad/s; the torque reverses a little before that.
const TURN_ABOVE_RAD_S: f64 = 750.0;
const TURN_BELOW_RAD_S: f64 = 50.0;
/// Inside both circles up to the reversal speed (the motor of docs/book/src/reference/plants.md has 21.6 N m at rest).
const TORQUE_NM: f64 = 8.0;

impl Task for Shuttle {
    fn torque_demand(&mut self, sensed: &Sensed) -> Option<f64> {
        self.up = if self.up { sensed.speed < TURN_ABOVE_RAD_S } else { sensed.speed < TURN_BELOW_RAD_S };
        Some(if self.up { TORQUE_NM } else { -TORQUE_NM })
    }

    fn load_torque(&mut self, _time: f64, _truth: &Truth) -> f64 {
        0.0
    }
}

/// Figures of the drive.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Figures {
    /// Mean of |torque - demand| over the run, in N m, including the time after a change of the demand.
    pub torque_error_nm: f64,
    /// The highest true speed, in rad/s.
    pub highest_speed_rad_s: f64,
    /// The longest true current vector, in A.
    pub longest_current_a: f64,
    /// The largest commanded weakening current, in A.
    pub most_weakening_a: f64,
}

/// Runs the task for this many milliseconds with a controller. `goes_on` gets every row, and can end the run.
fn shuttle<C: Controller>(
    plant: &mut ClosedLoop,
    controller: &mut C,
    ticks: u64,
    mut goes_on: impl FnMut(&C, &Row) -> bool,
) -> Figures {
    let mut task = Shuttle { up: true };
    let mut figures = Figures::default();
    for _ in 0..ticks {
        let Some(row) = plant.millisecond(controller, &mut task) else { break };
        if !goes_on(controller, &row) {
            break;
        }
        figures.torque_error_nm += (row.torque - row.demand).abs() / ticks as f64;
        figures.highest_speed_rad_s = figures.highest_speed_rad_s.max(row.truth.speed);
        figures.longest_current_a = figures.longest_current_a.max(row.truth.i_d.hypot(row.truth.i_q));
        figures.most_weakening_a = figures.most_weakening_a.max(-row.references.i_d_a);
    }
    figures
}

fn shipped(load_inertia: f64) -> (ClosedLoop, Known) {
    let plant = PlantFile::read(&Source::new("pmac.toml", PLANT)).expect("the shipped motor is a plant file");
    let drive = closed_loop::Drive::default();
    (ClosedLoop::new(&plant, &drive, load_inertia, 0.0).expect("the shipped motor runs in a loop"), drive.known(&plant))
}

/// Runs the motor's side for this many milliseconds, with a load of this inertia (kg m^2) on its shaft. `exchange` gets the input of
/// [`Outer::answer`] and returns the command for the millisecond that begins, or `None` to end the run. `seen` gets every complete millisecond. One
/// sample a second is bad on purpose.
pub fn ride(
    ticks: u64,
    period_ns: u64,
    load_inertia: f64,
    exchange: impl FnMut([f64; 4]) -> Option<[f64; 2]>,
    mut seen: impl FnMut(&Row),
) -> Figures {
    let (mut plant, known) = shipped(load_inertia);
    let (steps, wanted) = (Steps::new(&known), References::default());
    let mut remote = Remote { exchange, steps, wanted, period_ns, tick: 0, ended: false };
    shuttle(&mut plant, &mut remote, ticks, |remote, row| {
        if !remote.ended {
            seen(row);
        }
        !remote.ended
    })
}

/// The result of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Times and ticks; the compute time is that of the 1 kHz step alone.
    pub report: Report,
    /// Counts of samples.
    pub exchange: Exchange,
    /// Number of ticks with a bad sample, in which the references were held.
    pub bad_samples: u32,
    /// Figures of the drive.
    pub figures: Figures,
}

/// Runs the loop in real time. A tick is a millisecond for the plant, at any rate.
#[must_use]
pub fn run(settings: &Settings) -> Run {
    let (ticks, period_ns) = (settings.ticks, settings.period_ns);
    let mut outer = Outer::shipped();
    let plant = |end: &mut PlantEnd<'_, 4, 2>| ride(ticks, period_ns, 0.0, |sample| Some(end.exchange(sample)), |_| ());
    let (report, exchange, figures) = exchange::run(settings, [0.0; 2], plant, |sample| outer.answer(sample));
    Run { report, exchange, bad_samples: outer.bad_samples(), figures }
}

/// The same drive and task without a clock, both steps in one thread. Returns the figures, and the ratio of simulated to elapsed time.
#[must_use]
pub fn simulate(seconds: f64) -> (Figures, f64) {
    let (mut plant, known) = shipped(0.0);
    let mut steps = Steps::new(&known);
    let began = std::time::Instant::now();
    let ticks = (seconds * 1000.0).round().max(1.0) as u64;
    let figures = shuttle(&mut plant, &mut steps, ticks, |_, _| true);
    (figures, ticks as f64 * 1e-3 / began.elapsed().as_secs_f64())
}

impl Run {
    /// One JSON object.
    #[must_use]
    pub fn json(&self) -> String {
        let Figures { torque_error_nm, highest_speed_rad_s, longest_current_a, most_weakening_a } = self.figures;
        format!(
            r#"{{"loop":"motor","report":{},"exchange":{},"bad_samples":{},"figures":{{"torque_error_nm":{torque_error_nm},"highest_speed_rad_s":{highest_speed_rad_s},"longest_current_a":{longest_current_a},"most_weakening_a":{most_weakening_a}}}}}"#,
            self.report.json(),
            self.exchange.json(),
            self.bad_samples,
        )
    }
}

impl std::fmt::Display for Run {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Figures { torque_error_nm, highest_speed_rad_s, longest_current_a, most_weakening_a } = self.figures;
        writeln!(f, "{}\n{}", self.report, self.exchange)?;
        write!(
            f,
            "drive     up to {highest_speed_rad_s:.0} rad/s, {most_weakening_a:.1} A of weakening, {longest_current_a:.1} A in all, \
             torque off by {torque_error_nm:.3} N m in the mean, {} bad samples held",
            self.bad_samples
        )
    }
}

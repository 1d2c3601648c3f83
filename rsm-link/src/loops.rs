//! The sides of both loops as functions of the data from the other side.
//!
//! In: a run (number of ticks, load on the shaft), and a function that exchanges a sample for a command. Out: tables. A sample contains the sensor
//! readings at the start of tick k. The command that acts in tick k was computed from sample k - 1, in every way to connect the sides. [`alone`]
//! connects them in one process; it is the reference for all other ways.

use host_runners::{motor, throttle};
use rsm_sim::kind::Signal;
use rsm_sim::record;

/// The period of both loops, in ns: 1 kHz as in the paper.
pub const PERIOD_NS: u64 = 1_000_000;

/// The largest number of values in a sample or a command.
pub const WIDEST: usize = 4;

/// One of the two cases.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Loop {
    /// The motor drive: inner step, inverter, motor and encoder on one side, the 1 kHz step on the other.
    Motor,
    /// The car on one side, the step of its throttle on the other.
    Throttle,
}

/// A role in a loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Role {
    /// The plant's side of a loop.
    Plant(Loop),
    /// The step's side of a loop.
    Step(Loop),
    /// Records both sides of a loop.
    Recorder(Loop),
}

const fn signal(name: &'static str, unit: &'static str) -> Signal {
    Signal { name, unit }
}

const TIME: Signal = signal("time", "s");

impl Loop {
    /// Both loops.
    pub const ALL: [Loop; 2] = [Loop::Motor, Loop::Throttle];

    /// The name of the loop.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Loop::Motor => "motor",
            Loop::Throttle => "throttle",
        }
    }

    /// The signals that the plant's side sends every tick.
    #[must_use]
    pub fn sample(self) -> &'static [Signal] {
        const MOTOR: [Signal; 4] = [
            signal("torque_demand", "N*m"),
            signal("speed_measured", "rad/s"),
            signal("bus_voltage", "V"),
            signal("voltage_share", "1"),
        ];
        const THROTTLE: [Signal; 4] =
            [signal("pedal_counts", "1"), signal("plate_counts", "1"), signal("speed_counts", "1"), signal("gear_lines", "1")];
        match self {
            Loop::Motor => &MOTOR,
            Loop::Throttle => &THROTTLE,
        }
    }

    /// The signals that the step's side returns every tick.
    #[must_use]
    pub fn command(self) -> &'static [Signal] {
        const MOTOR: [Signal; 2] = [signal("i_d_wanted", "A"), signal("i_q_wanted", "A")];
        const THROTTLE: [Signal; 1] = [signal("compare", "1")];
        match self {
            Loop::Motor => &MOTOR,
            Loop::Throttle => &THROTTLE,
        }
    }

    /// The command before the first answer: no current for the motor; a closed throttle for the car.
    #[must_use]
    pub fn first_command(self) -> &'static [f64] {
        match self {
            Loop::Motor => &[0.0; 2],
            Loop::Throttle => &throttle::CLOSED,
        }
    }

    fn plant_columns(self) -> Vec<Signal> {
        match self {
            Loop::Motor => vec![
                TIME,
                signal("torque_demand", "N*m"),
                signal("i_d_wanted", "A"),
                signal("i_q_wanted", "A"),
                signal("i_d", "A"),
                signal("i_q", "A"),
                signal("speed", "rad/s"),
                signal("angle", "rad"),
                signal("torque", "N*m"),
                signal("speed_measured", "rad/s"),
                signal("voltage", "V"),
            ],
            Loop::Throttle => vec![
                TIME,
                signal("pedal", "1"),
                signal("gear", "1"),
                signal("throttle", "1"),
                signal("speed", "m/s"),
                signal("acceleration", "m/s^2"),
            ],
        }
    }
}

impl Role {
    /// The role with this name. `listened` is the loop of a recorder.
    #[must_use]
    pub fn of(word: &str, listened: Loop) -> Option<Role> {
        match word {
            "motor" => Some(Role::Plant(Loop::Motor)),
            "controller" => Some(Role::Step(Loop::Motor)),
            "driveline" => Some(Role::Plant(Loop::Throttle)),
            "throttle" => Some(Role::Step(Loop::Throttle)),
            "recorder" => Some(Role::Recorder(listened)),
            _ => None,
        }
    }

    /// The name of the role in files and options.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Role::Plant(Loop::Motor) => "motor",
            Role::Step(Loop::Motor) => "controller",
            Role::Plant(Loop::Throttle) => "driveline",
            Role::Step(Loop::Throttle) => "throttle",
            Role::Recorder(_) => "recorder",
        }
    }

    /// The loop of the role.
    #[must_use]
    pub fn of_loop(self) -> Loop {
        match self {
            Role::Plant(it) | Role::Step(it) | Role::Recorder(it) => it,
        }
    }

    /// A name that no other role of a federation and no other record of a folder has.
    #[must_use]
    pub fn unique_name(self) -> String {
        match self {
            Role::Recorder(it) => format!("recorder-{}", it.name()),
            other => other.name().to_string(),
        }
    }

    /// The empty table of the role.
    #[must_use]
    pub fn table(self) -> Table {
        match self {
            Role::Plant(it) => Table::new(it.plant_columns()),
            Role::Step(it) | Role::Recorder(it) => Table::new([&[TIME], it.sample(), it.command()].concat()),
        }
    }
}

/// Duration and load of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Run {
    /// Duration in ms.
    pub ticks: u64,
    /// Inertia of the load on the motor's shaft, in kg m^2.
    pub load_inertia: f64,
}

/// Rows of numbers in columns with names and units.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    columns: Vec<Signal>,
    values: Vec<Vec<f64>>,
}

impl Table {
    /// A table without rows.
    #[must_use]
    pub fn new(columns: Vec<Signal>) -> Self {
        let values = vec![Vec::new(); columns.len()];
        Table { columns, values }
    }

    /// A table with these columns and further ones, without rows.
    #[must_use]
    pub fn with(self, further: &[Signal]) -> Self {
        Table::new([self.columns.as_slice(), further].concat())
    }

    /// Adds a row. Missing values at its end are NaN.
    pub fn push(&mut self, row: impl IntoIterator<Item = f64>) {
        let mut row = row.into_iter();
        for values in &mut self.values {
            values.push(row.next().unwrap_or(f64::NAN));
        }
    }

    /// Number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.values.first().map_or(0, Vec::len)
    }

    /// The values of a column.
    #[must_use]
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        let index = self.columns.iter().position(|it| it.name == name)?;
        Some(&self.values[index])
    }

    /// The table as CSV. It has the shortest decimals that read back to the same bits, so equal texts mean equal bits.
    #[must_use]
    pub fn csv(&self) -> String {
        let columns: Vec<(Signal, &[f64])> =
            self.columns.iter().zip(&self.values).map(|(signal, values)| (*signal, values.as_slice())).collect();
        record::csv(&columns)
    }
}

/// The time of a tick, in s.
#[must_use]
pub fn time_of(tick: u64) -> f64 {
    tick as f64 * 1e-3
}

/// Runs the plant's side. `exchange` gets a sample and writes the command to its second argument. It returns whether the run continues. `seen` gets
/// every row.
pub fn plant(
    control_loop: Loop,
    run: Run,
    mut exchange: impl FnMut(&[f64], &mut [f64]) -> bool,
    mut on_row: impl FnMut(&[f64]),
) {
    match control_loop {
        Loop::Motor => {
            let exchange = |sample: [f64; 4]| {
                let mut command = [0.0; 2];
                exchange(&sample, &mut command).then_some(command)
            };
            motor::ride(run.ticks, PERIOD_NS, run.load_inertia, exchange, |row| {
                let (truth, references) = (&row.truth, &row.references);
                on_row(&[
                    row.time,
                    row.demand,
                    references.i_d_a,
                    references.i_q_a,
                    truth.i_d,
                    truth.i_q,
                    truth.speed,
                    truth.angle,
                    row.torque,
                    row.speed_measured,
                    row.voltage,
                ]);
            });
        }
        Loop::Throttle => {
            let exchange = |sample: [f64; 4]| {
                let mut command = [0.0; 1];
                exchange(&sample, &mut command).then_some(command)
            };
            let mut tick = 0;
            throttle::ride(run.ticks, PERIOD_NS, exchange, |row| {
                on_row(&[time_of(tick), row.pedal, row.gear as f64, row.throttle, row.speed, row.acceleration]);
                tick += 1;
            });
        }
    }
}

/// The step's side.
#[derive(Debug, Clone)]
pub enum Step {
    /// The motor's 1 kHz step.
    Motor(Box<motor::Outer>),
    /// The throttle's step.
    Throttle(throttle::Step),
}

impl Step {
    /// The step at rest.
    #[must_use]
    pub fn new(control_loop: Loop) -> Self {
        match control_loop {
            Loop::Motor => Step::Motor(Box::new(motor::Outer::shipped())),
            Loop::Throttle => Step::Throttle(throttle::Step::default()),
        }
    }

    /// The command for a sample.
    ///
    /// # Panics
    /// When the length of the sample or the command is not that of the loop.
    pub fn answer(&mut self, sample: &[f64], command: &mut [f64]) {
        let sample = sample.try_into().expect("a sample has four values");
        match self {
            Step::Motor(step) => command.copy_from_slice(&step.answer(sample)),
            Step::Throttle(step) => command.copy_from_slice(&step.answer(sample)),
        }
    }

    /// Number of bad samples.
    #[must_use]
    pub fn bad_samples(&self) -> u32 {
        match self {
            Step::Motor(step) => step.bad_samples(),
            Step::Throttle(step) => step.bad_samples(),
        }
    }
}

/// Runs both sides in one process, without a clock. Returns the table of the plant, and the table of samples and commands, which equals those of the
/// step's side and of a recorder.
/// recorder.
///
/// ```
/// use rsm_link::loops::{Loop, Run, alone};
///
/// let [plant, exchanged] = alone(Loop::Motor, Run { ticks: 50, load_inertia: 0.0 });
/// assert_eq!((plant.rows(), exchanged.rows()), (50, 50));
/// // A command acts a tick after its sample.
/// let (asked, acted) = (exchanged.column("i_q_wanted").unwrap(), plant.column("i_q_wanted").unwrap());
/// assert_eq!(asked[..49], acted[1..]);
/// ```
#[must_use]
pub fn alone(control_loop: Loop, run: Run) -> [Table; 2] {
    let (mut plants, mut exchanged) = (Role::Plant(control_loop).table(), Role::Step(control_loop).table());
    let mut step = Step::new(control_loop);
    let mut command = control_loop.first_command().to_vec();
    let mut tick = 0;
    let exchange = |sample: &[f64], acting: &mut [f64]| {
        acting.copy_from_slice(&command);
        step.answer(sample, &mut command);
        exchanged.push([&[time_of(tick)], sample, &command].concat());
        tick += 1;
        true
    };
    plant(control_loop, run, exchange, |row| plants.push(row.iter().copied()));
    [plants, exchanged]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_role_has_one_word_and_one_name() {
        let words = ["motor", "controller", "driveline", "throttle", "recorder"];
        for word in words {
            assert_eq!(Role::of(word, Loop::Throttle).map(Role::name), Some(word));
        }
        assert_eq!(Role::of("broker", Loop::Motor), None);
        let recorders = Loop::ALL.map(|it| Role::Recorder(it).unique_name());
        assert_eq!(recorders, ["recorder-motor", "recorder-throttle"]);
    }

    #[test]
    fn both_loops_run_alone_and_say_so_twice_with_the_same_bits() {
        for control_loop in Loop::ALL {
            let run = Run { ticks: 300, load_inertia: 0.0 };
            let once = alone(control_loop, run);
            assert_eq!(once.each_ref().map(Table::rows), [300, 300]);
            assert_eq!(once.each_ref().map(Table::csv), alone(control_loop, run).each_ref().map(Table::csv));
            // The plant moves: the motor accelerates under torque, the car slows down on a closing throttle.
            let speed = once[0].column("speed").unwrap();
            assert!((speed[299] - speed[0]).abs() > 0.05, "{control_loop:?}: {} to {}", speed[0], speed[299]);
        }
    }

    #[test]
    fn an_exchange_that_ends_leaves_whole_rows() {
        for control_loop in Loop::ALL {
            let mut rows = 0;
            let mut left = 10;
            let exchange = |_: &[f64], command: &mut [f64]| {
                command.copy_from_slice(control_loop.first_command());
                left -= 1;
                left >= 0
            };
            plant(control_loop, Run { ticks: 300, load_inertia: 0.0 }, exchange, |_| rows += 1);
            assert_eq!(rows, 10, "{control_loop:?}");
        }
    }
}

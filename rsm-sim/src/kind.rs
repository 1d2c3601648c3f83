//! The kinds of plants and their signals (docs/book/src/reference/plants.md 1.2).
//!
//! In: nothing. Out: names and units of inputs and outputs, the same for files, records and simulation. Never holds a value.

/// A plant of section 2 of docs/book/src/reference/plants.md.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PlantKind {
    /// Surface permanent-magnet motor in the rotor frame.
    Pmac,
    /// Engine, clutch, transmission, driveshaft, wheel and vehicle.
    Driveline,
    /// A driven linear axis.
    ServoAxis,
}

/// A start of a simulation: a value for each of [`PlantKind::starts`], 0 beyond them.
pub type StartValues = [f64; 6];

/// A named quantity with its unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Signal {
    /// Its name in a record.
    pub name: &'static str,
    /// Its unit inside the code.
    pub unit: &'static str,
}

const fn signal(name: &'static str, unit: &'static str) -> Signal {
    Signal { name, unit }
}

impl PlantKind {
    /// The kinds with their names in a file.
    pub const NAMES: [(&'static str, PlantKind); 3] =
        [("pmac", PlantKind::Pmac), ("driveline", PlantKind::Driveline), ("servo-axis", PlantKind::ServoAxis)];

    /// The name in a file.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            PlantKind::Pmac => "pmac",
            PlantKind::Driveline => "driveline",
            PlantKind::ServoAxis => "servo-axis",
        }
    }

    /// Everything that can be in a record as an input, in the order of the simulation. The axis has either of its two.
    #[must_use]
    pub fn inputs(self) -> &'static [Signal] {
        const PMAC: &[Signal] = &[signal("v_d", "V"), signal("v_q", "V"), signal("load_torque", "N*m")];
        const DRIVELINE: &[Signal] = &[signal("throttle", "1"), signal("gear", "1")];
        const AXIS: &[Signal] = &[signal("command", "V"), signal("reference", "m")];
        match self {
            PlantKind::Pmac => PMAC,
            PlantKind::Driveline => DRIVELINE,
            PlantKind::ServoAxis => AXIS,
        }
    }

    /// The outputs, in the order of the simulation. The command of the axis is one in closed loop only.
    #[must_use]
    pub fn outputs(self) -> &'static [Signal] {
        const PMAC: &[Signal] = &[signal("i_d", "A"), signal("i_q", "A"), signal("speed", "rad/s")];
        const DRIVELINE: &[Signal] =
            &[signal("engine_speed", "rad/s"), signal("road_speed", "m/s"), signal("acceleration", "m/s^2")];
        const AXIS: &[Signal] = &[signal("position", "m"), signal("command", "V")];
        match self {
            PlantKind::Pmac => PMAC,
            PlantKind::Driveline => DRIVELINE,
            PlantKind::ServoAxis => AXIS,
        }
    }

    /// What can stand under `[initial]`, in the places of a simulation's start: outputs, and what no column holds. Of an axis that is the speed; of a car by how much the engine's torque, the
    /// driveshaft's twist and its speed differ from those of a car that rolls steadily under its pedal.
    #[must_use]
    pub fn starts(self) -> &'static [Signal] {
        const AXIS: &[Signal] = &[signal("position", "m"), signal("speed", "m/s")];
        const DRIVELINE: &[Signal] = &[
            signal("engine_speed", "rad/s"),
            signal("road_speed", "m/s"),
            signal("acceleration", "m/s^2"),
            signal("torque_offset", "N*m"),
            signal("twist_offset", "rad"),
            signal("twist_rate", "rad/s"),
        ];
        match self {
            PlantKind::ServoAxis => AXIS,
            PlantKind::Driveline => DRIVELINE,
            PlantKind::Pmac => self.outputs(),
        }
    }

    /// The place of an output among [`PlantKind::outputs`].
    #[must_use]
    pub fn output(self, name: &str) -> Option<usize> {
        self.outputs().iter().position(|signal| signal.name == name)
    }

    /// Every column that a record of this plant can have.
    #[must_use]
    pub fn columns(self) -> Vec<Signal> {
        let mut columns = vec![signal("time", "s")];
        for signal in self.inputs().iter().chain(self.outputs()) {
            if !columns.contains(signal) {
                columns.push(*signal);
            }
        }
        if self == PlantKind::Pmac {
            columns.push(signal("angle", "rad"));
        }
        columns
    }
}

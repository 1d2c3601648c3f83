//! Six more plants, which a diagnosis gets only as a text and a plant file: `examples/plants/`.
//!
//! In: the equations of those texts and the effects of docs/book/src/reference/plants.md, implemented a second time by hand. Out: records with hidden
//! causes. No text is read for the simulation, so an error of the compiler of texts cannot be on both sides of a comparison.

pub mod body;
pub mod cases;
pub mod coupled_tanks;
pub mod draw;
pub mod examples;
pub mod files;
pub mod gear_motor;
pub mod heated_block;
pub mod judge;
pub mod quadrotor_pitch;
pub mod refit;
pub mod road_vehicle;
pub mod run;
pub mod store;
pub mod two_mass_drive;
pub mod verify;

use crate::flow::{STATES, State};
use crate::random::Random;

/// The index of the state that is the time of the record.
pub const TIME: usize = STATES - 1;

/// The kind of a site.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SiteKind {
    /// A rotating body.
    Rotation,
    /// A body that moves along a line.
    Translation,
    /// A spring between two bodies.
    Joint,
    /// A winding.
    Winding,
    /// A tank.
    Storage,
    /// A heat capacity.
    Heat,
    /// A car on its wheels.
    Vehicle,
}

/// A place of a plant where effects are possible, and the usual magnitudes there.
#[derive(Debug)]
pub struct Site {
    /// Its name in the plant file.
    pub name: &'static str,
    /// Its kind.
    pub kind: SiteKind,
    /// A usual effort or flow, in the unit of its balance; for a winding a usual voltage.
    pub effort: f64,
    /// A usual speed; for a winding a usual current; for a store the range of its level.
    pub speed: f64,
    /// A usual position or twist; for a store its highest level. 0 if the site has no position.
    pub position: f64,
    /// Its inertia or capacity.
    pub inertia: f64,
}

/// An input.
#[derive(Debug)]
pub struct Input {
    /// Its name.
    pub name: &'static str,
    /// Its unit in a record.
    pub unit: &'static str,
    /// The range of the excitation.
    pub range: (f64, f64),
    /// Whether it commands an actuator, which may have a dead band or a limit; otherwise it is a measured disturbance.
    pub commands: bool,
}

/// An output.
#[derive(Debug)]
pub struct Output {
    /// Its name.
    pub name: &'static str,
    /// Its unit in a record.
    pub unit: &'static str,
    /// Standard deviation of its sensor.
    pub noise: f64,
    /// Its usual range.
    pub range: (f64, f64),
}

/// Computes the inputs of a row from the readings just before it.
pub type Drive = Box<dyn FnMut(usize, &[f64]) -> Vec<f64>>;

/// A plant, with the data of its text and its plant file.
pub struct System {
    /// The folder in `examples/plants/`, and the name of the text in it.
    pub name: &'static str,
    /// The text, for the diagnosis.
    pub text: &'static str,
    /// The plant file, for the diagnosis.
    pub file: &'static str,
    /// Inputs.
    pub inputs: &'static [Input],
    /// Outputs.
    pub outputs: &'static [Output],
    /// Parameters, with the values of the plant file.
    pub parameters: &'static [(&'static str, f64)],
    /// Relative standard deviations of some parameters.
    pub tolerance: &'static [(&'static str, f64)],
    /// Sites.
    pub sites: &'static [Site],
    /// Seconds between rows.
    pub period: f64,
    /// Rows of a record.
    pub rows: usize,
    /// Builds the plant with its effects; extra states take slots.
    pub build: fn(&Truth, &mut Slots) -> Box<dyn Law>,
    /// True outputs at the start, and the inputs, from a stream of random numbers.
    pub drive: fn(Random, f64) -> (Vec<f64>, Drive),
    /// The parameter that changes at an instant, for a disturbance that is in no file.
    pub changes: &'static str,
}

impl std::fmt::Debug for System {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name)
    }
}

impl System {
    /// The index of an output.
    pub fn output(&self, name: &str) -> Option<usize> {
        self.outputs.iter().position(|it| it.name == name)
    }

    /// A site by its name.
    pub fn site(&self, name: &str) -> Option<&'static Site> {
        self.sites.iter().find(|it| it.name == name)
    }

    /// The plant file from its sites on: everything except the numbers.
    pub fn sites_text(&self) -> &'static str {
        self.file.find("[sites.").map_or("", |from| &self.file[from..])
    }
}

/// All plants.
pub const ALL: [&System; 6] = [
    &gear_motor::SYSTEM,
    &coupled_tanks::SYSTEM,
    &road_vehicle::SYSTEM,
    &heated_block::SYSTEM,
    &two_mass_drive::SYSTEM,
    &quadrotor_pitch::SYSTEM,
];

/// A cause: an effect at a place, with its numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Cause {
    /// The kind of the effect.
    pub kind: String,
    /// The site, input, output or parameter.
    pub at: String,
    /// Its numbers.
    pub numbers: Vec<(String, f64)>,
}

impl Cause {
    /// A cause.
    pub fn new(kind: &str, at: &str, numbers: &[(&str, f64)]) -> Self {
        let numbers = numbers.iter().map(|(name, value)| ((*name).to_string(), *value)).collect();
        Cause { kind: kind.to_string(), at: at.to_string(), numbers }
    }

    /// A number of it.
    pub fn get(&self, name: &str) -> Option<f64> {
        self.numbers.iter().find(|it| it.0 == name).map(|it| it.1)
    }

    /// `coulomb-friction:shaft`
    pub fn name(&self) -> String {
        format!("{}:{}", self.kind, self.at)
    }
}

/// A true plant.
#[derive(Debug, Clone)]
pub struct Truth {
    /// The plant.
    pub system: &'static System,
    /// Values of its parameters, in order, before any `parameter-error`.
    pub parameters: Vec<f64>,
    /// Effects of the catalogue.
    pub causes: Vec<Cause>,
    /// Effects outside it: `gusts`, `change` and `law`.
    pub outside: Vec<Cause>,
}

impl Truth {
    /// The plant with the values of the plant file.
    pub fn nominal(system: &'static System) -> Self {
        let parameters = system.parameters.iter().map(|it| it.1).collect();
        Truth { system, parameters, causes: vec![], outside: vec![] }
    }

    /// The index of a parameter.
    ///
    /// # Panics
    /// For a name that the plant does not have: names are used only in this package.
    pub fn place(&self, name: &str) -> usize {
        self.system.parameters.iter().position(|it| it.0 == name).unwrap_or_else(|| panic!("no parameter {name}"))
    }

    /// The value of a parameter, including the error by a cause.
    pub fn get(&self, name: &str) -> f64 {
        let errors = self.causes.iter().rev().filter(|it| it.kind == "parameter-error" && it.at == name);
        errors.filter_map(|it| it.get("value")).next().unwrap_or_else(|| self.parameters[self.place(name)])
    }

    /// A number of an effect at a place, if it is there.
    pub fn effect(&self, at: &str, kind: &str, number: &str) -> Option<f64> {
        self.causes.iter().chain(&self.outside).find(|it| it.kind == kind && it.at == at)?.get(number)
    }

    /// The same, or the value that does not change a formula if the effect is absent.
    pub fn or(&self, at: &str, kind: &str, number: &str, absent: f64) -> f64 {
        self.effect(at, kind, number).unwrap_or(absent)
    }
}

/// Indices of states: first the plant's own, then those of its effects.
#[derive(Debug, Default)]
pub struct Slots {
    taken: usize,
}

impl Slots {
    /// The next free index.
    ///
    /// # Panics
    /// If none is free: no case has so many effects.
    pub fn take(&mut self) -> usize {
        assert!(self.taken < TIME, "more states than a flow has");
        self.taken += 1;
        self.taken - 1
    }
}

/// The equations of a plant with its effects.
pub trait Law {
    /// States at the start, from true outputs and the acting inputs.
    fn start(&self, outputs: &[f64], inputs: &[f64], y: &mut State);
    /// Derivatives with the acting inputs.
    fn rates(&self, inputs: &[f64], y: &State, regime: u8, dy: &mut State);
    /// True outputs.
    fn outputs(&self, y: &State) -> Vec<f64>;
    /// The piece that applies, for a law with jumps.
    fn regime(&self, _y: &State) -> u8 {
        0
    }
    /// The usual magnitudes of the states.
    fn scale(&self, scale: &mut State);
}

/// Disturbances that are in no file.
#[derive(Debug, Clone, Default)]
pub struct Outside {
    /// Amplitude and three frequencies in hertz.
    gusts: Option<(f64, [f64; 3])>,
    /// Factor and instant.
    change: Option<(f64, f64)>,
    /// A law that no textbook contains: size, the value of its variable at the origin, the value of its knee from there, and its shape.
    law: Option<(f64, f64, f64, f64)>,
}

impl Outside {
    /// The disturbances of a true plant.
    pub fn new(truth: &Truth) -> Self {
        let of = |kind: &str| truth.outside.iter().find(|it| it.kind == kind);
        let number = |it: &Cause, name: &str| it.get(name).unwrap_or(0.0);
        Outside {
            gusts: of("gusts").map(|it| (number(it, "amplitude"), [number(it, "one"), number(it, "two"), number(it, "three")])),
            change: of("change").map(|it| (number(it, "factor"), number(it, "time"))),
            law: of("law").map(|it| (number(it, "size"), number(it, "origin"), number(it, "knee"), number(it, "shape"))),
        }
    }

    /// A changing effort: three waves of time.
    pub fn gust(&self, time: f64) -> f64 {
        let Some((amplitude, hertz)) = self.gusts else { return 0.0 };
        let wave = |(place, hertz): (usize, &f64)| (std::f64::consts::TAU * hertz * time + place as f64).sin();
        amplitude * hertz.iter().enumerate().map(wave).sum::<f64>()
    }

    /// An effort that depends on a variable of its site: it grows up to a knee, and falls behind it.
    pub fn law(&self, variable: f64) -> f64 {
        let Some((size, origin, knee, shape)) = self.law else { return 0.0 };
        let u = (variable - origin) / knee;
        if shape > 0.5 { -size * u / (1.0 + u.powi(4)) } else { -size * u * (-0.5 * u * u).exp() }
    }

    /// The factor of the changed parameter: from an instant on it has another value.
    pub fn factor(&self, time: f64) -> f64 {
        // The instant is that of a row, and no step crosses a row.
        self.change.map_or(1.0, |(factor, from)| if time < from - 1e-9 { 1.0 } else { factor })
    }
}

/// Changes a value at random instants.
pub struct Steps {
    until: usize,
    value: f64,
}

impl Steps {
    /// Without a value yet.
    pub fn new() -> Self {
        Steps { until: 0, value: 0.0 }
    }

    /// The value at a row; a new random value is drawn after its number of rows (at least 1).
    pub fn at(&mut self, row: usize, random: &mut Random, rows: (f64, f64), value: impl FnOnce(&mut Random) -> f64) -> f64 {
        if row >= self.until {
            self.until = row + (random.uniform(rows.0, rows.1) as usize).max(1);
            self.value = value(random);
        }
        self.value
    }

    /// Requests a new value at the next row.
    pub fn end(&mut self) {
        self.until = 0;
    }
}

impl Default for Steps {
    fn default() -> Self {
        Self::new()
    }
}

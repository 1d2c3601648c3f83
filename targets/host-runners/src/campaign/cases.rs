//! The faults of the campaign: sensor, reading, duration and operating point.
//!
//! In: a case and the number of the period. Out: the false samples. Speed and bus voltage have one sensor each, which both steps read.

use motor_loop::{Demand, Measured};

/// A sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sensor {
    /// Current of a phase, 0 to 2.
    Current(usize),
    /// All three currents: a fault of the converter.
    Currents,
    /// The angle.
    Angle,
    /// The speed, which both steps read.
    Speed,
    /// The bus voltage, which both steps read.
    Bus,
    /// The torque demand.
    Demand,
}

impl Sensor {
    /// All sensors.
    pub const ALL: [Sensor; 8] = [
        Sensor::Current(0),
        Sensor::Current(1),
        Sensor::Current(2),
        Sensor::Currents,
        Sensor::Angle,
        Sensor::Speed,
        Sensor::Bus,
        Sensor::Demand,
    ];

    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Sensor::Current(0) => "current a",
            Sensor::Current(1) => "current b",
            Sensor::Current(_) => "current c",
            Sensor::Currents => "all currents",
            Sensor::Angle => "angle",
            Sensor::Speed => "speed",
            Sensor::Bus => "bus voltage",
            Sensor::Demand => "torque demand",
        }
    }

    /// Full scale: the current limit, a turn, 7500 rpm, the nominal bus, the largest torque.
    fn scale(self) -> f64 {
        match self {
            Sensor::Current(_) | Sensor::Currents => 60.0,
            Sensor::Angle => 1.0,
            Sensor::Speed => 785.4,
            Sensor::Bus => 270.0,
            Sensor::Demand => 21.6,
        }
    }
}

/// The reading of a broken sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Not a number.
    Nan,
    /// Infinity.
    Infinity,
    /// Its last reading before the fault.
    Stuck,
    /// A random value up to three times its full scale, a new one for each sample.
    Wild,
    /// The true value plus 5 % of full scale.
    Bias,
    /// The true value plus normal noise of 5 % of full scale.
    Noise,
}

impl Kind {
    /// All kinds.
    pub const ALL: [Kind; 6] = [Kind::Nan, Kind::Infinity, Kind::Stuck, Kind::Wild, Kind::Bias, Kind::Noise];

    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Kind::Nan => "NaN",
            Kind::Infinity => "infinity",
            Kind::Stuck => "stuck",
            Kind::Wild => "wild",
            Kind::Bias => "bias 5 %",
            Kind::Noise => "noise 5 %",
        }
    }
}

/// Numbers of consecutive false samples.
pub const DURATIONS: [u32; 5] = [1, 5, 10, 100, 500];

/// Bus voltages, in V.
pub const BUSES: [f64; 4] = [180.0, 230.0, 270.0, 330.0];

/// An operating point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Mechanical speed, in rad/s.
    pub speed: f64,
    /// Torque demand, in N m.
    pub torque: f32,
    /// The number of periods after which the demand changes its sign; 0: the demand is constant.
    pub reversal: u32,
    /// Inertia of a free shaft, in kg m^2. `None`: a dynamometer keeps the speed constant.
    pub inertia: Option<f64>,
}

const fn held(speed: f64, torque: f32) -> Point {
    Point { speed, torque, reversal: 0, inertia: None }
}

/// From standstill to above top speed: driving, braking, coasting, backwards; torque that reverses during the fault; a free shaft.
pub const POINTS: [Point; 11] = [
    held(0.0, 18.0),
    held(50.0, 21.6),
    held(300.0, -18.0),
    held(450.0, 12.0),
    held(600.0, 15.0),
    held(785.0, 0.0),
    held(785.0, 21.6),
    held(785.0, -8.0),
    held(-700.0, 8.0),
    Point { speed: 600.0, torque: 15.0, reversal: 70, inertia: None },
    Point { speed: 300.0, torque: 6.0, reversal: 0, inertia: Some(0.01) },
];

impl Point {
    /// The demand in a period, in N m.
    #[must_use]
    pub fn demand(&self, period: u32) -> f32 {
        if self.reversal > 0 && (period / self.reversal) % 2 == 1 { -self.torque } else { self.torque }
    }
}

/// A fault with its state.
#[derive(Debug, Clone)]
pub struct Spoiler {
    sensor: Sensor,
    kind: Kind,
    /// The reading before the fault.
    before: Option<(Demand, Measured)>,
    draw: Draw,
}

/// Random numbers.
#[derive(Debug, Clone)]
pub struct Draw(u64);

impl Draw {
    /// A generator with this seed. Neighbouring seeds give distant states (Vigna's splitmix64).
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let mixed = (seed + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        Draw((mixed ^ (mixed >> 27)) | 1)
    }

    /// Marsaglia's xorshift, scaled to a number from 0 to 1.
    pub fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    /// The sum of twelve uniform numbers minus 6: a standard deviation of 1.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

impl Spoiler {
    /// A fault, before its first sample.
    #[must_use]
    pub fn new(sensor: Sensor, kind: Kind, seed: u64) -> Self {
        Spoiler { sensor, kind, before: None, draw: Draw::new(seed) }
    }

    /// Stores the reading of an intact sensor.
    pub fn whole(&mut self, demand: &Demand, measured: &Measured) {
        self.before = Some((*demand, *measured));
    }

    /// The reading of the broken sensor.
    pub fn spoil(&mut self, demand: &mut Demand, measured: &mut Measured) {
        let (old, was) = self.before.unwrap_or((*demand, *measured));
        match self.sensor {
            Sensor::Current(k) => measured.currents_a[k] = self.say(measured.currents_a[k], was.currents_a[k]),
            Sensor::Currents => {
                for k in 0..3 {
                    measured.currents_a[k] = self.say(measured.currents_a[k], was.currents_a[k]);
                }
            }
            Sensor::Angle => measured.angle_turns = self.say(measured.angle_turns, was.angle_turns),
            Sensor::Speed => {
                measured.speed_rad_s = self.say(measured.speed_rad_s, was.speed_rad_s);
                demand.speed_rad_s = measured.speed_rad_s;
            }
            Sensor::Bus => {
                measured.bus_voltage_v = self.say(measured.bus_voltage_v, was.bus_voltage_v);
                demand.bus_voltage_v = measured.bus_voltage_v;
            }
            Sensor::Demand => demand.torque_nm = self.say(demand.torque_nm, old.torque_nm),
        }
    }

    fn say(&mut self, truth: f32, before: f32) -> f32 {
        let scale = self.sensor.scale();
        match self.kind {
            Kind::Nan => f32::NAN,
            Kind::Infinity => f32::INFINITY,
            Kind::Stuck => before,
            Kind::Wild => (3.0 * scale * (2.0 * self.draw.uniform() - 1.0)) as f32,
            Kind::Bias => truth + (0.05 * scale) as f32,
            Kind::Noise => truth + (0.05 * scale * self.draw.normal()) as f32,
        }
    }
}

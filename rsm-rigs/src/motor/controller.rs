//! What a controller of the motor is for the simulation: two methods at two rates.
//!
//! In: a demand once a millisecond; phase currents, angle and speed once a PWM period. Out: the current references, and the duties of the
//! three legs. A controller never sees the plant's state: everything comes through sensors.

use rsm_sim::plant_file::Parameters;

/// Every so many seconds the references are computed (the 1 kHz of the paper).
pub const REFERENCE_PERIOD_S: f64 = 0.001;

/// What the references are computed from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Demand {
    /// Wanted torque, in N m. Against the speed it brakes.
    pub torque_nm: f64,
    /// Measured mechanical speed, in rad/s.
    pub speed_rad_s: f64,
    /// Measured voltage of the bus, in V.
    pub bus_voltage_v: f64,
}

/// Current references in the rotor frame, peak values, in A.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct References {
    /// Direct axis, not positive: it weakens the magnets' flux.
    pub i_d_a: f64,
    /// Quadrature axis: makes torque (21).
    pub i_q_a: f64,
}

/// What the current control is computed from: sampled together at the start of a PWM period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// Phase currents a, b, c into the motor, in A. Their sum is 0 but for errors of the sensors.
    pub currents_a: [f64; 3],
    /// Electrical angle of the rotor, in rad: that of phase a's axis to the d axis. Not reduced to one turn.
    pub angle_rad: f64,
    /// Mechanical speed, in rad/s.
    pub speed_rad_s: f64,
    /// Voltage of the bus, in V.
    pub bus_voltage_v: f64,
}

/// A source of current references.
pub trait Weakening {
    /// The references for a demand.
    fn references(&mut self, demand: &Demand) -> References;
}

/// A controller of the motor.
pub trait Controller {
    /// Every [`REFERENCE_PERIOD_S`]: the references, which hold until the next call. The controller keeps them for [`Controller::duties`];
    /// they are returned for whoever records.
    fn references(&mut self, demand: &Demand) -> References;

    /// Every PWM period: the shares of the *next* period for which the upper switches of legs a, b, c are on, 0 to 1 (the computation
    /// takes a period, as on a microcontroller whose compare registers are loaded at its end). In a millisecond in which
    /// [`Controller::references`] is called too, that call comes first.
    fn duties(&mut self, measured: &Measured) -> [f64; 3];
}

/// What a controller is told of motor and inverter when it is built: nominal values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Known {
    /// Phase resistance r, in ohm.
    pub resistance: f64,
    /// Phase inductance L, in H.
    pub inductance: f64,
    /// Flux linkage lambda, in Wb.
    pub flux_linkage: f64,
    /// Pole pairs.
    pub pole_pairs: f64,
    /// Longest current vector (20), in A.
    pub current_limit: f64,
    /// Nominal voltage of the bus, in V.
    pub bus_voltage: f64,
    /// The share of the largest voltage V_dc/sqrt 3 that is kept for current control: references are chosen within the rest.
    pub voltage_margin: f64,
    /// PWM period, in s.
    pub pwm_period: f64,
    /// Dead time of a leg, in s.
    pub dead_time: f64,
}

impl Known {
    /// What the nominal parameters of a `pmac` plant say, with what the drive says.
    ///
    /// # Panics
    /// When the parameters are not those of a `pmac` plant.
    #[must_use]
    pub fn new(parameters: &Parameters, voltage_margin: f64, pwm_period: f64, dead_time: f64) -> Self {
        Known {
            resistance: parameters.number("phase_resistance"),
            inductance: parameters.number("phase_inductance"),
            flux_linkage: parameters.number("flux_linkage"),
            pole_pairs: parameters.number("pole_pairs"),
            current_limit: parameters.number("current_limit"),
            bus_voltage: parameters.number("bus_voltage"),
            voltage_margin,
            pwm_period,
            dead_time,
        }
    }

    /// k_t = 1.5 p lambda (21), in N m/A.
    #[must_use]
    pub fn torque_constant(&self) -> f64 {
        1.5 * self.pole_pairs * self.flux_linkage
    }

    /// The speed, in rad/s, from which on the full current in the q axis needs more voltage than references may: with u the electrical speed,
    /// (r I + u lambda)^2 + (u L I)^2 = V^2.
    #[must_use]
    pub fn base_speed(&self) -> f64 {
        let current = self.current_limit;
        let (r, l, flux) = (self.resistance * current, self.inductance * current, self.flux_linkage);
        let voltage = self.reference_voltage(self.bus_voltage);
        let square = flux * flux + l * l;
        (((r * flux).powi(2) - square * (r * r - voltage * voltage)).sqrt() - r * flux) / square / self.pole_pairs
    }

    /// The longest voltage vector that references may need at a bus voltage, in V: V_dc/sqrt 3 (20) less the margin.
    #[must_use]
    pub fn reference_voltage(&self, bus_voltage: f64) -> f64 {
        (1.0 - self.voltage_margin) * bus_voltage / 3f64.sqrt()
    }
}

//! The motor and its bridge for the campaign of faults, in the frame of the stator. It shares nothing with the steps, which use the frame of the
//! rotor.
//!
//! In: duties of three legs, or a bridge whose switches are all off. Out: phase currents, angle, speed. L di/dt = v - r i - e for the two axes of the
//! stator, e = w_e lambda (-sin, cos). With the switches off the diodes conduct the current: a leg whose current flows into the motor is at the lower
//! rail, one whose current flows out is at the upper rail. Voltages are means over a period.

use std::f64::consts::TAU;

/// Integration steps in a period. A step is 1 us: a thousandth of an electrical turn at 1000 rad/s, and two thirds of the time constant L/(V/width)
/// of a blocked leg (below) at 330 V.
const STEPS: u32 = 100;

/// Within this current, in A, a leg of the open bridge changes from one rail to the other. For an ideal diode it is 0; this is the smallest value for
/// 100 steps in a period, and a hundredth of the current limit.
const DIODE_WIDTH_A: f64 = 0.5;

/// The trial motor of the project (`rsm-sim/plants/pmac.toml`), and its state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plant {
    /// Resistance of a phase, in ohm.
    pub resistance: f64,
    /// Inductance of a phase, in H.
    pub inductance: f64,
    /// Flux linkage of the magnets, in Wb.
    pub flux_linkage: f64,
    /// Pole pairs.
    pub pole_pairs: f64,
    /// Currents of the stator's axes, in A.
    pub current: [f64; 2],
    /// Electrical angle, in rad.
    pub angle: f64,
    /// Mechanical speed, in rad/s.
    pub speed: f64,
    /// Voltage of the bus, in V; it does not depend on the current.
    pub bus: f64,
    /// Inertia of the shaft in kg m^2. `None`: a dynamometer keeps the speed constant.
    pub inertia: Option<f64>,
    /// The longest current vector since this field was last set, in A.
    pub longest: f64,
}

impl Plant {
    /// A motor without current at a constant speed.
    #[must_use]
    pub fn new(speed: f64, bus: f64) -> Self {
        Plant {
            resistance: 0.08,
            inductance: 0.9e-3,
            flux_linkage: 0.06,
            pole_pairs: 4.0,
            current: [0.0; 2],
            angle: 0.0,
            speed,
            bus,
            inertia: None,
            longest: 0.0,
        }
    }

    /// Sets the currents by their components along the magnets' flux and across it, in A.
    pub fn set_rotor_currents(&mut self, i_d: f64, i_q: f64) {
        let (sin, cos) = self.angle.sin_cos();
        self.current = [cos * i_d - sin * i_q, sin * i_d + cos * i_q];
    }

    /// The currents' components along the magnets' flux and across it, in A.
    #[must_use]
    pub fn rotor_currents(&self) -> [f64; 2] {
        let (sin, cos) = self.angle.sin_cos();
        [cos * self.current[0] + sin * self.current[1], cos * self.current[1] - sin * self.current[0]]
    }

    /// Torque in the air gap, in N m.
    #[must_use]
    pub fn torque(&self) -> f64 {
        1.5 * self.pole_pairs * self.flux_linkage * self.rotor_currents()[1]
    }

    /// Currents of the phases a, b, c, in A.
    #[must_use]
    pub fn phases(&self) -> [f64; 3] {
        let [alpha, beta] = self.current;
        let side = 0.75f64.sqrt() * beta;
        [alpha, side - 0.5 * alpha, -side - 0.5 * alpha]
    }

    /// The electrical angle in turns, 0 to 1.
    #[must_use]
    pub fn turns(&self) -> f64 {
        (self.angle / TAU).rem_euclid(1.0)
    }

    /// Simulates a period (in s) with these duties; `None`: all switches are off.
    pub fn run(&mut self, duties: Option<[f64; 3]>, period: f64) {
        let dt = period / f64::from(STEPS);
        for _ in 0..STEPS {
            let [a, b, c] = match duties {
                Some(duties) => duties.map(|duty| duty * self.bus),
                None => self.phases().map(|current| self.bus * (0.5 - 0.5 * (current / DIODE_WIDTH_A).clamp(-1.0, 1.0))),
            };
            let voltage = [(2.0 * a - b - c) / 3.0, (b - c) / 3f64.sqrt()];
            let w_e = self.pole_pairs * self.speed;
            // The voltage of the magnets in the middle of the step.
            let (sin, cos) = (self.angle + 0.5 * w_e * dt).sin_cos();
            let emf = [-w_e * self.flux_linkage * sin, w_e * self.flux_linkage * cos];
            for k in [0, 1] {
                self.current[k] += dt / self.inductance * (voltage[k] - self.resistance * self.current[k] - emf[k]);
            }
            self.angle += w_e * dt;
            if let Some(inertia) = self.inertia {
                self.speed += self.torque() / inertia * dt;
            }
            self.longest = self.longest.max(self.current[0].hypot(self.current[1]));
        }
        // The angle is reduced to one turn, so that its sine is equally accurate after any time.
        self.angle = self.angle.rem_euclid(TAU);
    }
}

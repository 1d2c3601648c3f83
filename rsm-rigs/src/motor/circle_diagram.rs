//! Flux weakening on the circle diagram, solved anew for every sample: the answer that a response surface is to replace.
//!
//! In: wanted torque, speed, the voltage that may be used. Out: the references with the smallest weakening current that carry the torque, or
//! as much of it as the limits (20) allow. In closed form, no iteration. Never uses a measured current.
//!
//! In steady state (17), (18) with v_d^2 + v_q^2 = V^2 are a circle in the plane of currents, resistance included:
//!
//! ```text
//!   a (i_d^2 + i_q^2) + 2 b i_d + 2 e i_q + f = V^2      a = r^2 + w_e^2 L^2,  b = w_e^2 L lambda,  e = r w_e lambda,  f = w_e^2 lambda^2
//!   centre (-b/a, -e/a), radius V/sqrt a                 because (b^2 + e^2)/a = f
//! ```
//!
//! The cross terms of i_d i_q cancel. What the drive may do is inside this circle and inside i_d^2 + i_q^2 = I^2. Where the highest point of
//! the voltage circle lies inside the current circle it is the most torque that the voltage carries (maximum torque per volt).

use super::controller::{Demand, Known, References, Weakening};

/// The circle diagram of a motor.
#[derive(Debug, Clone, Copy)]
pub struct CircleDiagram {
    known: Known,
}

/// The voltage circle at a speed.
#[derive(Debug, Clone, Copy)]
struct Circle {
    /// a, b, e, f of the header.
    a: f64,
    b: f64,
    e: f64,
    f: f64,
    voltage: f64,
}

impl Circle {
    fn new(known: &Known, w_e: f64, voltage: f64) -> Self {
        let Known { resistance: r, inductance: l, flux_linkage: lambda, .. } = *known;
        let (reactance, emf) = (w_e * l, w_e * lambda);
        Circle { a: r * r + reactance * reactance, b: reactance * emf, e: r * emf, f: emf * emf, voltage }
    }

    /// The weakening current nearest to 0 at which i_q fits into the voltage; 0 where none is needed, `None` where none suffices.
    fn weakening(&self, i_q: f64) -> Option<f64> {
        let c = self.a * i_q * i_q + 2.0 * self.e * i_q + self.f - self.voltage * self.voltage;
        if c <= 0.0 {
            return Some(0.0);
        }
        let discriminant = self.b * self.b - self.a * c;
        // The root nearer to 0, in the form without a difference of near numbers.
        (discriminant >= 0.0).then(|| -c / (self.b + discriminant.sqrt()))
    }

    /// The lowest and the highest i_q inside both circles, each with its i_d; `None` where they do not meet.
    fn range(&self, limit: f64) -> Option<[References; 2]> {
        let (centre, radius) = ([-self.b / self.a, -self.e / self.a], self.voltage / self.a.sqrt());
        let mut found: Option<[References; 2]> = None;
        let mut consider = |i_d_a: f64, i_q_a: f64| {
            let here = References { i_d_a, i_q_a };
            let [low, high] = found.get_or_insert([here; 2]);
            if i_q_a < low.i_q_a {
                *low = here;
            }
            if i_q_a > high.i_q_a {
                *high = here;
            }
        };
        // The ends of either circle's own range of i_q, where the other does not cut them off.
        for sign in [-1.0, 1.0] {
            let i_q = sign * limit;
            if (i_q - centre[1]).hypot(centre[0]) <= radius {
                consider(0.0, i_q);
            }
            let top = centre[1] + sign * radius;
            if centre[0].hypot(top) <= limit {
                consider(centre[0], top);
            }
        }
        // Where the circles cut each other.
        let distance = centre[0].hypot(centre[1]);
        if distance > 0.0 {
            let along = (limit * limit - radius * radius + distance * distance) / (2.0 * distance);
            if along.abs() <= limit {
                let across = (limit * limit - along * along).sqrt();
                let unit = [centre[0] / distance, centre[1] / distance];
                for across in [-across, across] {
                    consider(along * unit[0] - across * unit[1], along * unit[1] + across * unit[0]);
                }
            }
        }
        found
    }
}

impl CircleDiagram {
    /// The diagram of a motor.
    #[must_use]
    pub fn new(known: Known) -> Self {
        CircleDiagram { known }
    }

    /// The references for a torque in N m at a mechanical speed in rad/s within a voltage vector in V.
    ///
    /// Beyond the speed at which even the whole current limit on the negative d axis does not hold the voltage, that is the answer: no
    /// reference holds it, and this one comes nearest.
    #[must_use]
    pub fn solve(&self, torque_nm: f64, speed_rad_s: f64, voltage_v: f64) -> References {
        let limit = self.known.current_limit;
        // Backwards is forwards seen in a mirror: i_q and torque change sign with the speed, i_d does not.
        let mirror = 1f64.copysign(speed_rad_s);
        let wanted = mirror * torque_nm / self.known.torque_constant();
        let circle = Circle::new(&self.known, self.known.pole_pairs * speed_rad_s.abs(), voltage_v);
        let found = match circle.weakening(wanted) {
            Some(i_d) if i_d * i_d + wanted * wanted <= limit * limit => References { i_d_a: i_d, i_q_a: wanted },
            _ => match circle.range(limit) {
                None => References { i_d_a: -limit, i_q_a: 0.0 },
                Some([low, _]) if wanted <= low.i_q_a => low,
                Some([_, high]) => high,
            },
        };
        References { i_d_a: found.i_d_a, i_q_a: mirror * found.i_q_a }
    }
}

impl Weakening for CircleDiagram {
    fn references(&mut self, demand: &Demand) -> References {
        let voltage = self.known.reference_voltage(demand.bus_voltage_v);
        self.solve(demand.torque_nm, demand.speed_rad_s, voltage)
    }
}

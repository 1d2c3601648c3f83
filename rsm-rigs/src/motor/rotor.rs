//! The motor in the rotor frame without effects, (17), (18), (21): the equations of the shipped text, written by hand for the speed of the rig.
//!
//! In: parameters, a state, voltages and the load torque. Out: the rate of each state. A test compares them with the text.

use rsm_sim::plant_file::Parameters;

/// The motor.
pub(super) struct Rotor {
    resistance: f64,
    inductance: f64,
    flux_linkage: f64,
    pole_pairs: f64,
    inertia: f64,
    viscous_friction: f64,
}

impl Rotor {
    /// The motor with these parameters.
    pub(super) fn new(parameters: &Parameters) -> Self {
        Rotor {
            resistance: parameters.number("phase_resistance"),
            inductance: parameters.number("phase_inductance"),
            flux_linkage: parameters.number("flux_linkage"),
            pole_pairs: parameters.number("pole_pairs"),
            inertia: parameters.number("inertia"),
            viscous_friction: parameters.number("viscous_friction"),
        }
    }

    /// The rates of direct current, quadrature current, speed and angle under v_d, v_q and the load torque.
    pub(super) fn evaluate(&self, [v_d, v_q, load_torque]: [f64; 3], x: &[f64], dx: &mut [f64]) {
        let (i_d, i_q, speed) = (x[0], x[1], x[2]);
        let (r, l, lambda) = (self.resistance, self.inductance, self.flux_linkage);
        let w_e = self.pole_pairs * speed;
        // Equations (17), (18) without the voltages.
        let free_d = -r * i_d + w_e * l * i_q;
        let free_q = -r * i_q - w_e * (l * i_d + lambda);
        dx[0] = (v_d + free_d) / l;
        dx[1] = (v_q + free_q) / l;
        // Equation (21).
        let torque = 1.5 * self.pole_pairs * lambda * i_q;
        dx[2] = (torque - self.viscous_friction * speed - load_torque) / self.inertia;
        dx[3] = speed;
    }

    /// The fastest rate at a speed, in 1/s: the decay of the current and the speed, the oscillation of current against speed, the electrical speed.
    pub(super) fn fastest(&self, speed: f64) -> f64 {
        let own = self.resistance / self.inductance + self.viscous_friction / self.inertia;
        let swing = (1.5 / (self.inductance * self.inertia)).sqrt() * self.pole_pairs * self.flux_linkage;
        own.max(swing.max(self.pole_pairs * speed.abs()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rsm_core::source::Source;
    use rsm_fit::random::Random;
    use rsm_sim::equation_plant::Rates;
    use rsm_sim::plant_file::PlantFile;
    use rsm_sim::record::Record;

    #[test]
    fn the_text_has_the_same_rates() {
        let text = include_str!("../../../rsm-sim/plants/pmac.toml");
        let file = PlantFile::read(&Source::new("pmac.toml", text)).unwrap();
        let zero: &[f64] = &[0.0; 2];
        let names = ["v_d", "v_q", "load_torque", "i_d", "i_q", "speed"];
        let columns: Vec<(&str, &[f64])> =
            [("time", &[0.0, 1.0][..])].into_iter().chain(names.map(|name| (name, zero))).collect();
        let mut text = Rates::new(&file, &Record::in_memory(&file, &columns).unwrap()).unwrap();
        let states = text.states();
        let places = ["current_d", "current_q", "speed", "angle"].map(|name| states.iter().position(|it| it == name).unwrap());
        let rotor = Rotor::new(&file.parameters);
        let mut random = Random::new(7);
        let mut next = || 2.0 * random.uniform() - 1.0;
        for _ in 0..100 {
            let x = [50.0, 50.0, 700.0, 3.0].map(|size| size * next());
            let inputs = [100.0, 100.0, 20.0].map(|size| size * next());
            let (mut wanted, mut at) = ([0.0; 4], vec![0.0; 4]);
            rotor.evaluate(inputs, &x, &mut wanted);
            places.iter().zip(x).for_each(|(place, x)| at[*place] = x);
            let found = text.at(0.0, &at, &inputs);
            for (place, wanted) in places.iter().zip(wanted) {
                // Sums of a handful of terms, in two orders.
                let found = found[*place];
                assert!((found - wanted).abs() <= 1e-10 * wanted.abs().max(1e2), "{}: {found} {wanted}", states[*place]);
            }
        }
    }
}

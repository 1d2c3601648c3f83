//! Integration of a piecewise smooth flow, which changes its law at known surfaces (contact, reversal, slip).
//!
//! In: the derivative in a regime, and the regime of a state. Out: the state some time later. The method is the pair of Dormand and Prince with error
//! control. A step in which the regime changes is halved until the surface is located to 1e-12 of the step, so no step crosses a kink. The step is
//! never fixed.

/// The number of states of the largest plant with every extra state.
pub const STATES: usize = 14;

/// A state; entries that a plant does not use stay 0.
pub type State = [f64; STATES];

/// A flow with constant inputs.
pub trait Flow {
    /// The law that applies at a state. The derivative is smooth within one regime.
    fn regime(&self, y: &State) -> u8;
    /// The derivative dy/dt in a regime, also slightly beyond its end.
    fn derivative(&self, y: &State, regime: u8) -> State;
    /// The scale of each state: errors are compared with it if the state itself is near 0.
    fn scale(&self) -> &State;
}

/// The relative error of a step. The noise of records is at least 1e-6 of their range (an axis of 0.2 m, 2e-7 m), and the errors of about 1e4 steps
/// add up.
const TOLERANCE: f64 = 1e-10;

/// The step length, which is kept from one call to the next.
#[derive(Debug, Clone)]
pub struct Stepper {
    step: f64,
}

impl Stepper {
    /// Starts with this step length.
    pub fn new(step: f64) -> Self {
        Stepper { step }
    }

    /// Advances the state by `duration` seconds.
    pub fn advance(&mut self, flow: &impl Flow, y: &mut State, duration: f64) {
        let mut left = duration;
        let mut regime = flow.regime(y);
        // Rounding leaves a remainder of 1e-12 of an interval, which is negligible.
        while left > 1e-12 * duration {
            let step = self.step.min(left);
            let (next, error) = dormand_prince(flow, y, regime, step);
            assert!(error.is_finite(), "the flow left the numbers at {y:?}");
            let factor = (0.9 * error.max(1e-10).powf(-0.2)).clamp(0.2, 4.0);
            if error > 1.0 {
                self.step = step * factor;
                assert!(self.step > 1e-12 * duration, "the step vanishes at {y:?}");
                continue;
            }
            if flow.regime(&next) == regime {
                *y = next;
                left -= step;
                // A step that was shortened by the end of the interval gives no information about the next one.
                if step == self.step || factor < 1.0 {
                    self.step = step * factor;
                }
                continue;
            }
            let (mut before, mut after) = (0.0, step);
            let mut crossed = next;
            while after - before > 1e-12 * step {
                let middle = 0.5 * (before + after);
                let (state, _) = dormand_prince(flow, y, regime, middle);
                if flow.regime(&state) == regime {
                    before = middle;
                } else {
                    after = middle;
                    crossed = state;
                }
            }
            *y = crossed;
            left -= after;
            regime = flow.regime(y);
        }
    }
}

/// One step of order 5 and its error in units of the tolerance, by the pair of J. Dormand and P. Prince, "A family of embedded Runge-Kutta formulae",
/// J. Comp. Appl. Math. 6 (1980), table 2.
fn dormand_prince(flow: &impl Flow, y: &State, regime: u8, h: f64) -> (State, f64) {
    const A: [[f64; 6]; 6] = [
        [1.0 / 5.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [3.0 / 40.0, 9.0 / 40.0, 0.0, 0.0, 0.0, 0.0],
        [44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0, 0.0, 0.0, 0.0],
        [19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0, 0.0, 0.0],
        [9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0, 0.0],
        [35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0],
    ];
    // The weights of order 5 minus those of order 4.
    const E: [f64; 7] = [71.0 / 57600.0, 0.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339200.0, 22.0 / 525.0, -1.0 / 40.0];
    let mut k = [[0.0; STATES]; 7];
    k[0] = flow.derivative(y, regime);
    let mut point = *y;
    for stage in 0..6 {
        for state in 0..STATES {
            let slope: f64 = (0..=stage).map(|earlier| A[stage][earlier] * k[earlier][state]).sum();
            point[state] = y[state] + h * slope;
        }
        k[stage + 1] = flow.derivative(&point, regime);
    }
    let scale = flow.scale();
    let mut worst = 0.0_f64;
    for state in 0..STATES {
        let error: f64 = h * (0..7).map(|stage| E[stage] * k[stage][state]).sum::<f64>();
        let size = scale[state].max(y[state].abs()).max(point[state].abs());
        if error != 0.0 {
            worst = worst.max(error.abs() / (TOLERANCE * size));
        }
    }
    (point, worst)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ball on a floor with a spring: x'' = -9; in contact, below 0, -1e4 x - 20 x' is added.
    struct Ball;

    impl Flow for Ball {
        fn regime(&self, y: &State) -> u8 {
            u8::from(y[0] < 0.0)
        }
        fn derivative(&self, y: &State, regime: u8) -> State {
            let mut dy = [0.0; STATES];
            dy[0] = y[1];
            dy[1] = -9.0 - if regime == 1 { 1e4 * y[0] + 20.0 * y[1] } else { 0.0 };
            dy
        }
        fn scale(&self) -> &State {
            &[1.0; STATES]
        }
    }

    #[test]
    fn a_fall_meets_the_floor_when_it_must() {
        let mut y = [0.0; STATES];
        y[0] = 2.0;
        let fall = (2.0_f64 * 2.0 / 9.0).sqrt();
        let mut stepper = Stepper::new(0.1);
        stepper.advance(&Ball, &mut y, fall - 1e-3);
        // The value 2 - 4.5 (fall - 0.001)^2 is exact for a method of order 5.
        assert!((y[0] - (2.0 - 4.5 * (fall - 1e-3).powi(2))).abs() < 1e-14);
        stepper.advance(&Ball, &mut y, 1e-3 + 2e-3);
        // In contact: the closed form of the damped oscillator about -9e-4 from x = 0, x' = -9 fall, 2 ms later.
        let (decay, rate, centre) = (10.0_f64, (1e4_f64 - 100.0).sqrt(), -9.0e-4);
        let (start, speed) = (-centre, -9.0 * fall);
        let t = 2e-3_f64;
        let exact =
            centre + (-decay * t).exp() * (start * (rate * t).cos() + (speed + decay * start) / rate * (rate * t).sin());
        assert!((y[0] - exact).abs() < 1e-11, "{} against {exact}", y[0]);
    }
}

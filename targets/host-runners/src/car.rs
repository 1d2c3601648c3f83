//! The simulated car with a gear lever, in ticks of one millisecond.
//!
//! In: throttle and gear. Out: speed and acceleration. The driveline is integrated with the classical Runge-Kutta method. The number of steps in a
//! millisecond depends on the fastest rate. A gear change restarts the driveline in the new gear, at the present road speed and with the clutch
//! closed.

use rsm_core::source::Source;
use rsm_sim::plant_file::PlantFile;

use crate::driveline::{Driveline, STATES};

/// The shipped car.
const PLANT: &str = include_str!("../../../rsm-sim/plants/driveline.toml");

/// The step length is at most this number divided by the fastest rate of the plant. One step then changes a mode with this rate by an error of at
/// most 0.25^5/120 = 8e-6, and the step is far below the stability limit of the method, 2.78 divided by the rate.
const STEP_RATE: f64 = 0.25;

const TICK_S: f64 = 0.001;

/// The car.
pub struct Car {
    file: PlantFile,
    plant: Driveline,
    gear: usize,
    x: [f64; STATES],
    outputs: [f64; 3],
}

impl Car {
    /// The shipped car rolling at a speed (m/s) in a gear, with the throttle closed.
    #[must_use]
    pub fn new(speed: f64, gear: usize) -> Self {
        let file = PlantFile::read(&Source::new("driveline.toml", PLANT)).expect("the shipped car is a plant file");
        let plant = Driveline::new(&file.effective_parameters(), gear);
        let mut car = Car { file, plant, gear, x: [0.0; STATES], outputs: [0.0; 3] };
        car.start(0.0, speed);
        car
    }

    fn start(&mut self, throttle: f64, speed: f64) {
        self.plant.start(speed, throttle, &mut self.x);
        self.outputs = self.plant.evaluate(throttle, &self.x, &mut [0.0; STATES]);
    }

    /// Road speed, in m/s.
    #[must_use]
    pub fn speed(&self) -> f64 {
        self.outputs[1]
    }

    /// Acceleration, in m/s^2.
    #[must_use]
    pub fn acceleration(&self) -> f64 {
        self.outputs[2]
    }

    /// Simulates one millisecond.
    pub fn tick(&mut self, throttle: f64, gear: usize) {
        if gear != self.gear {
            self.gear = gear;
            self.plant = Driveline::new(&self.file.effective_parameters(), gear);
            let speed = self.speed();
            self.start(throttle, speed);
        }
        let Car { plant, x, outputs, .. } = self;
        let mut k = [[0.0; STATES]; 4];
        let steps = (TICK_S * plant.fastest() / STEP_RATE).ceil().max(1.0);
        let step = TICK_S / steps;
        for _ in 0..steps as u64 {
            plant.evaluate(throttle, x, &mut k[0]);
            let mut trial = *x;
            for (stage, share) in [(1, 0.5), (2, 0.5), (3, 1.0)] {
                for ((trial, x), rate) in trial.iter_mut().zip(&*x).zip(&k[stage - 1]) {
                    *trial = x + share * step * rate;
                }
                plant.evaluate(throttle, &trial, &mut k[stage]);
            }
            for (i, x) in x.iter_mut().enumerate() {
                *x += step / 6.0 * (k[0][i] + 2.0 * (k[1][i] + k[2][i]) + k[3][i]);
            }
        }
        *outputs = plant.evaluate(throttle, x, &mut k[0]);
    }
}

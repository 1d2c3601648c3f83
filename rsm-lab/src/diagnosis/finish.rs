//! The last fit: with the noise that it leaves itself, and every number in the form in which people write it.
//!
//! In: the fit of a search. Out: the same causes, fitted with the floors of their own residual. Never adds or removes a cause.

use std::f64::consts::{PI, TAU};

use super::kernel::Kernel;
use super::levenberg::{self, Fit};
use super::model::Model;
use super::noise::Floor;

/// Steps of a fit that begins at its end.
const STEPS: usize = 4;

/// Twice: the residual of a fit gives floors, and those another fit. A third time moves nothing that shows.
const TURNS: usize = 2;

/// Fits again with the noise that is left, and leaves its floors in the kernel.
#[must_use]
pub fn finish(kernel: &mut Kernel, mut fit: Fit, floors: impl Fn(&Kernel, &Fit) -> [Floor; 3]) -> Fit {
    fit.model = plain(fit.model);
    for _ in 0..TURNS {
        let found = floors(kernel, &fit);
        if found == kernel.floors {
            break;
        }
        kernel.floors = found;
        match levenberg::fit(kernel, fit.model.clone(), STEPS) {
            Some(better) => fit = better,
            None => break,
        }
    }
    fit
}

/// Waves with positive amplitudes and phases within half a turn of 0.
fn plain(mut model: Model) -> Model {
    for entry in &mut model.file.effects {
        let numbers = &mut entry.arguments.numbers;
        let place = |name: &str| numbers.iter().position(|it| it.0 == name);
        let (Some(amplitude), Some(phase)) = (place("amplitude"), place("phase")) else { continue };
        if numbers[amplitude].1 < 0.0 {
            numbers[amplitude].1 = -numbers[amplitude].1;
            numbers[phase].1 += PI;
        }
        numbers[phase].1 -= TAU * (numbers[phase].1 / TAU).round();
    }
    model
}

//! Records of a car that begin in the middle of a motion: a torque that lags, a driveshaft that swings.
//!
//! In: a fit whose starts are steady. Out: whether starts that are not explain one of its records far better. Such starts are then unknown in every record; they are forgotten within
//! seconds, and what they take up of a missing cause ends there, too. Never moves anything else.

use super::kernel::Kernel;
use super::levenberg::{self, Fit};
use super::model::{AtStart, Model};
use super::validation;
use crate::kind::PlantKind;
use crate::record::Record;

/// Steps of a fit with starts that are not steady: the plant is nearly linear in them.
const STEPS: usize = 4;

/// Three numbers of a start gain 3 in noise, and 30 once in a million records. Where more than noise is left, so many times that.
const GAINS: f64 = 30.0;

/// Whether a record that is fitted, or one that is not, begins so.
#[must_use]
pub fn shown(kernel: &Kernel, fit: &Fit, unseen: &Kernel) -> bool {
    if fit.model.file.kind != PlantKind::Driveline || fit.model.at_start == AtStart::InMotion {
        return false;
    }
    let free = levenberg::fit(kernel, freed(kernel, &fit.model), STEPS);
    if free.is_some_and(|free| gains(kernel, fit, &free)) {
        return true;
    }
    let Some(steady) = validation::on(unseen, &fit.model) else { return false };
    let mut model = freed(unseen, &steady.model);
    model.unknowns.retain(|it| matches!(it.place, super::model::Place::Start { .. }));
    levenberg::fit(unseen, model, STEPS).is_some_and(|free| gains(unseen, &steady, &free))
}

/// The model with starts that need not be steady, its other starts where they were.
fn freed(kernel: &Kernel, model: &Model) -> Model {
    let mut free = Model { at_start: AtStart::InMotion, ..model.clone() };
    let records: Vec<&Record> = kernel.records.iter().map(|it| &it.record).collect();
    free.take_starts(&records, kernel.floors.map(|floor| floor.sd));
    free.starts.clone_from(&model.starts);
    free
}

fn gains(kernel: &Kernel, steady: &Fit, free: &Fit) -> bool {
    kernel.records.iter().enumerate().any(|(record, prepared)| {
        let first = kernel.first(record);
        let energy = |fit: &Fit| fit.residual[first..first + Kernel::length(prepared)].iter().map(|it| it * it).sum::<f64>();
        let (before, after) = (energy(steady), energy(free));
        let rows: usize = prepared.used.iter().map(|used| used.iter().filter(|used| **used).count()).sum();
        before - after > GAINS * (after / rows.max(1) as f64).max(1.0)
    })
}

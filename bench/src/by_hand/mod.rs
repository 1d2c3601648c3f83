//! The three plants as Rust code, without effects. The engine of equations is compared with them.
//!
//! In: a plant file of format 1 without effects, a record. Out: every output at every row. `plants` contains the equations and their rates, `steps`
//! the classical and the exponential method of fourth order, with step lengths from these rates. Only the benchmark uses this copy.

mod phi;
mod plants;
mod steps;

use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::{Drive, Record};

use plants::{Driveline, Plant, Pmac, ServoAxis};
use steps::Work;

/// Every output at every row, in the order of the plant.
///
/// # Panics
/// For a plant of equations, or one with effects: the copy does not contain them.
#[must_use]
pub fn run(file: &PlantFile, record: &Record) -> Vec<Vec<f64>> {
    assert!(file.acting().next().is_none(), "the plants by hand have no effects");
    match file.kind {
        kind if kind.is("pmac") => along(&Pmac::new(&file.parameters), record),
        kind if kind.is("driveline") => {
            let gear = record.setting("gear").map_or(1, |gear| gear as usize);
            along(&Driveline::new(&file.parameters, gear), record)
        }
        kind if kind.is("servo-axis") => along(&ServoAxis::new(&file.parameters), record),
        kind => panic!("the plant {} is not written by hand", kind.name()),
    }
}

fn along<P: Plant>(plant: &P, record: &Record) -> Vec<Vec<f64>> {
    let first = |output: usize| record.measured[output].as_ref().and_then(|it| it.first().copied()).unwrap_or(0.0);
    let starts: Vec<f64> = (0..record.measured.len()).map(first).collect();
    let mut work = Work::new(P::STATES);
    plant.start(&starts, record.inputs[0][0], &mut work.x);
    let mut values = vec![Vec::with_capacity(record.rows()); record.measured.len()];
    let mut held = [work.x[0]; 3];
    for row in 0..record.rows() {
        let mut inputs = [0.0; 3];
        for (to, from) in inputs.iter_mut().zip(&record.inputs) {
            *to = from[row];
        }
        if record.drive == Drive::Closed {
            held = if row == 0 { held } else { [work.x[0], held[0], held[1]] };
            inputs[0] = plant.command(inputs[0], &work.x, held, record.period);
        }
        let mut outputs = [0.0; 3];
        plant.evaluate(&inputs, &work.x, &mut work.k[0], &mut outputs);
        for (values, value) in values.iter_mut().zip(outputs) {
            values.push(value);
        }
        if row + 1 < record.rows() {
            steps::hold(plant, inputs, &mut work, record.period);
        }
    }
    values
}

#[cfg(test)]
mod tests {
    use super::run;
    use crate::simulation::SUBJECTS;
    use rsm_sim::simulate::Simulator;

    #[test]
    fn they_are_the_plants_that_the_engine_runs() {
        for subject in SUBJECTS {
            let (file, record) = (subject.nominal(), subject.record(1));
            let wanted = Simulator::new(&file, &record).unwrap().run(&record).unwrap();
            for (signal, (found, wanted)) in wanted.signals.iter().zip(run(&file, &record).iter().zip(&wanted.values)) {
                let size = wanted.iter().fold(0.0_f64, |most, it| most.max(it.abs()));
                let off = found.iter().zip(wanted).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
                // Steps of a quarter of a radian have an error of 0.25^4/120, and the errors of oscillations add up.
                assert!(off < 2e-3 * size, "{}, {}: {off} of {size}", subject.plant, signal.name);
            }
        }
    }
}

//! The motor study: every form of surface against the full controller, run-ups, speed. In: the shipped plant, data and specifications.
//! Out: lines. Judges nothing.

use std::error::Error;
use std::path::Path;

use rsm_core::check::Checked;
use rsm_core::lower;
use rsm_core::number::Precision;
use rsm_core::source::Source;
use rsm_fit::fit::fit;
use rsm_fit::spec::Specification;
use rsm_rigs::motor::closed_loop::Drive;
use rsm_rigs::motor::field_oriented::FullController;
use rsm_rigs::motor::figures::{self, Differences};
use rsm_rigs::motor::inverter::Fidelity;
use rsm_rigs::motor::surface::{SurfaceController, Surfaces};
use rsm_sim::plant_file::PlantFile;

/// Profiles that no fit and no choice of terms has seen.
const SEEDS: [u64; 3] = [11, 12, 13];
const SECONDS: f64 = 10.0;

fn line(name: &str, model: &Checked, index: usize, found: &Differences) {
    let operations = lower::surface(model, index, Precision::F64).operation_count();
    println!(
        "{name:28} {:2} terms {operations:3} operations  mean {:6.3} deg  p99 {:6.3} deg  largest {:6.2} deg  spurious {:5.2} A",
        model.model().surfaces[index].terms.len(),
        found.mean(),
        found.quantile(0.99),
        found.quantile(1.0),
        found.spurious
    );
}

fn main() -> Result<(), Box<dyn Error>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let plant = PlantFile::read(&Source::read(&root.join("../rsm-sim/plants/pmac.toml"))?)?;
    let drive = Drive::default();
    let fitted = |name: &str| -> Result<Checked, Box<dyn Error>> {
        let specification = Specification::read(&root.join("../rsm-cli/demo/motor").join(name))?;
        Ok(Checked::from_model(&fit(&specification, &mut |_| {})?.model)?)
    };

    let motor = fitted("fit.toml")?;
    let surfaces = Surfaces::new(&motor)?;
    let found = figures::command_difference(&plant, &drive, &surfaces, &SEEDS, SECONDS)?;
    println!("weakening in {} of {} ms", found.angles.len(), found.ticks);
    line("motor, with its own limit", &motor, 0, &found);
    line(
        "motor, at the same torque",
        &motor,
        0,
        &figures::surface_difference(&plant, &drive, &motor, "weakening_current", &SEEDS, SECONDS)?,
    );
    let study = fitted("study.toml")?;
    for (index, surface) in study.model().surfaces.iter().enumerate() {
        let found = figures::surface_difference(&plant, &drive, &study, &surface.name, &SEEDS, SECONDS)?;
        line(&surface.name, &study, index, &found);
    }

    let known = drive.known(&plant);
    for fidelity in [Fidelity::Averaged, Fidelity::Switched] {
        let drive = Drive { fidelity, ..drive };
        let full = figures::run_up(&plant, &drive, &mut FullController::full(known))?;
        let surface = figures::run_up(&plant, &drive, &mut SurfaceController::with_surfaces(known, &surfaces))?;
        let alike = figures::compare_run_ups(&full, &surface);
        println!(
            "{fidelity:?}: run-up {:.4} s, torque r.m.s. {:.3} %, time {:+.3} %",
            figures::run_up_time(&full),
            alike.torque_rms_percent,
            alike.time_percent
        );
        let seconds = if fidelity == Fidelity::Averaged { 20.0 } else { 5.0 };
        let full = figures::realtime_factor(&plant, &drive, &mut FullController::full(known), 21, seconds)?;
        let mut controller = SurfaceController::with_surfaces(known, &surfaces);
        let surface = figures::realtime_factor(&plant, &drive, &mut controller, 21, seconds)?;
        println!("{fidelity:?}: {full:.0} times real time with the full controller, {surface:.0} with the surfaces");
    }
    Ok(())
}

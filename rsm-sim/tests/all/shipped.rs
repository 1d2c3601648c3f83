//! Shipped plants and short records for the tests of every crate that simulates. The file is included by its path, so it is not part of a library.

#![allow(dead_code, reason = "each crate's tests use their own part of it")]

use std::path::{Path, PathBuf};

use rsm_core::source::Source;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;
use rsm_sim::simulate::{Outputs, Simulator};

/// A file of the crate rsm-sim.
pub(super) fn path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../rsm-sim").join(name)
}

/// A shipped plant, with more text after its own.
pub(super) fn plant(name: &str, more: &str) -> PlantFile {
    let text = std::fs::read_to_string(path(&format!("plants/{name}.toml"))).unwrap();
    PlantFile::read(&Source::new(format!("{name}.toml"), text + more)).unwrap_or_else(|faults| panic!("{faults}"))
}

/// A record from its text.
pub(super) fn record(text: &str, plant: &PlantFile) -> Record {
    Record::read(&Source::new("record.csv", text), plant).unwrap_or_else(|faults| panic!("{faults}"))
}

pub(super) fn run(plant: &PlantFile, record: &Record) -> Outputs {
    Simulator::new(plant, record).unwrap().run(record).unwrap()
}

/// An effect as text.
pub(super) fn effect(kind: &str, parameters: &str) -> String {
    format!("\n[[effects]]\nkind = \"{kind}\"\nparameters = {{ {parameters} }}\n")
}

/// Steps of both voltages and of the load, half a second at 1 kHz.
pub(super) fn motor_record() -> String {
    let mut text = "time[s],v_d[V],v_q[V],load_torque[N*m],i_d[A],i_q[A],speed[rad/s]\n".to_string();
    for k in 0..500 {
        let v_q = if k < 200 { 20.0 } else { -10.0 };
        let v_d = if k < 100 { 0.0 } else { -3.0 };
        let load = if k < 300 { 0.5 } else { 1.5 };
        text += &format!("{},{v_d},{v_q},{load},0,2,10\n", f64::from(k) / 1000.0);
    }
    text
}

/// A tip-in and a tip-out, two seconds at 500 Hz in second gear.
pub(super) fn car_record() -> String {
    let mut text = "time[s],throttle[1],gear[1],engine_speed[rad/s],road_speed[m/s],acceleration[m/s^2]\n".to_string();
    for k in 0..1000 {
        let throttle = if (250..700).contains(&k) { 0.8 } else { 0.05 };
        text += &format!("{},{throttle},2,203,8,0\n", f64::from(k) / 500.0);
    }
    text
}

/// Forward, rest and back with the controller of the measured axis, one second at 1 kHz.
pub(super) fn axis_record() -> String {
    let mut text = "time[s],reference[m],position[m]\n".to_string();
    for k in 0..1000 {
        let t = f64::from(k) / 1000.0;
        let reference = 0.01 * (1.0 - (std::f64::consts::TAU * t).cos());
        text += &format!("{t},{reference},0\n");
    }
    text
}

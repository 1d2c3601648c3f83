//! The campaign of faults through the steps in C: the same samples, the same commands, bit for bit. So the limits that Rust keeps under faults are
//! kept by C.

use host_runners::campaign::cases::{Kind, POINTS, Sensor, Spoiler};
use host_runners::campaign::plant::Plant;
use host_runners::campaign::rig::{Exchanged, Rig};

use super::builds::Build;
use super::drive;

/// Every sensor and fault one after another, 3 to 47 samples each, with good ones between.
fn faults(speed: f64, torque: f32, bus: f64) -> Vec<Exchanged> {
    let mut rig = Rig::with_drive(Plant::new(speed, bus), drive());
    let mut seen = vec![];
    for _ in 0..300 {
        seen.push(rig.step(torque, &mut |_, _| ()));
    }
    for (k, sensor) in Sensor::ALL.into_iter().enumerate() {
        for (j, kind) in Kind::ALL.into_iter().enumerate() {
            let mut spoiler = Spoiler::new(sensor, kind, (10 * k + j) as u64);
            let (demand, measured) = rig.truth(torque);
            spoiler.whole(&demand, &measured);
            for _ in 0..3 + 4 * (k + j) {
                seen.push(rig.step(torque, &mut |demand, measured| spoiler.spoil(demand, measured)));
            }
            for _ in 0..60 {
                seen.push(rig.step(torque, &mut |_, _| ()));
            }
        }
    }
    seen
}

#[test]
fn the_steps_in_c_answer_faults_with_the_bits_of_the_steps_in_rust() {
    let build = Build::new("gcc -std=gnu99 -O2 -mfma", "replay");
    for (point, bus) in POINTS.iter().zip([180.0, 230.0, 270.0, 330.0].into_iter().cycle()) {
        let seen = faults(point.speed, point.torque, bus);
        let mut input = vec![];
        let mut last = None;
        for Exchanged { demand, measured, .. } in &seen {
            input.extend(u32::from(demand.is_some()).to_le_bytes());
            last = demand.or(last);
            let told = last.expect("the first period has a demand");
            let floats = [told.torque_nm, told.speed_rad_s, told.bus_voltage_v, told.voltage_share];
            let [a, b, c] = measured.currents_a;
            let samples = [a, b, c, measured.angle_turns, measured.speed_rad_s, measured.bus_voltage_v];
            input.extend(floats.into_iter().chain(samples).flat_map(f32::to_le_bytes));
        }
        let output = build.on_host_with("replay", &input);
        assert_eq!(output.len(), 16 * seen.len());
        let (mut open, mut closed) = (0, 0);
        for (k, (found, Exchanged { command, .. })) in output.chunks_exact(16).zip(&seen).enumerate() {
            let [a, b, c] = command.duties;
            let expected: Vec<u8> = [a, b, c, command.closed].into_iter().flat_map(f32::to_le_bytes).collect();
            assert_eq!(found, expected, "{point:?}, {bus} V, period {k}: {command:?}");
            open += u32::from(command.closed < 0.5);
            closed += u32::from(command.closed > 0.5);
        }
        assert!(open > 200 && closed > 1000, "{point:?}: open in {open}, closed in {closed}");
    }
}

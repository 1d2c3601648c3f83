//! `programs/rig.c`: both loops of the firmware against plants as code, in one program. The emulated board gives the bits of the host, and both those
//! of a simulation in fixed steps along the inputs that the firmware gave.

use rsm_core::emit::plant::Plant;
use rsm_core::source::{Fault, Faults, Source};
use rsm_sim::equations::file::NamedValue;
use rsm_sim::equations::{EquationFile, Inputs, Machine, Method, Point, Setting, code, linearise, run};

use super::builds::{self, Build, CORTEX_M4F};

/// A plant of the rig.
pub struct Part {
    pub plant: Plant,
    machine: Machine,
    start: Point,
    /// From cycle to cycle of the firmware, and the step, in s.
    cycle: f64,
    step: f64,
}

impl Part {
    pub fn new(name: &str, model: &str, given: &[(&str, f64)], inputs: &[f64], cycle: f64, step: f64) -> Part {
        let open = |file: &str| {
            let path = builds::firmware().join("rig").join(file);
            Source::read(&path).map_err(|_| Faults::one(Fault::whole_file(file, "not there")))
        };
        let text = format!("format = 2\nmodel = \"{model}\"\n");
        let file = EquationFile::read(&Source::new("rig.toml", text), &open).unwrap_or_else(|faults| panic!("{faults}"));
        let mut machine = Machine::new(&file).unwrap_or_else(|faults| panic!("{faults}"));
        let given: Vec<NamedValue> =
            given.iter().map(|(name, value)| NamedValue { name: (*name).to_string(), value: *value }).collect();
        let start = machine.start(&file, 0.0, inputs, &given).unwrap_or_else(|faults| panic!("{faults}"));
        let linear = linearise(&file, &machine, &start).unwrap_or_else(|faults| panic!("{faults}"));
        let from = code::Start { point: &start, words: String::new(), linear: &linear };
        let plant = code::plant(&machine, step, &from, Some(name), "rig.toml").unwrap_or_else(|what| panic!("{name}: {what}"));
        Part { plant, machine, start, cycle, step }
    }

    /// Lines of the program: outputs have the bits of the simulation along the inputs. Gives the outputs.
    pub fn check(&self, name: &str, lines: &[String]) -> Vec<Vec<f64>> {
        let bits = |word: &str| f64::from_bits(u64::from_str_radix(word, 16).expect("16 digits"));
        let rows: Vec<Vec<f64>> = lines
            .iter()
            .filter_map(|line| line.strip_prefix(&format!("{name} ")))
            .map(|line| line.split(' ').map(bits).collect())
            .collect();
        let count = self.machine.inputs().len();
        let time: Vec<f64> = (0..rows.len()).map(|k| k as f64 * self.cycle).collect();
        let values: Vec<Vec<f64>> = (0..count).map(|k| rows.iter().map(|row| row[k]).collect()).collect();
        let setting = Setting::new(Method::Fixed { step: self.step }, 1e-8);
        let inputs = Inputs { time: &time, values: &values };
        let wanted = run(&self.machine, self.start.clone(), inputs, setting).unwrap_or_else(|why| panic!("{name}: {why}"));
        for (k, row) in rows.iter().enumerate() {
            for (wanted, found) in wanted.iter().zip(&row[count..]) {
                assert_eq!(
                    wanted[k].to_bits(),
                    found.to_bits(),
                    "{name}, cycle {k}: {found} in the rig, {} simulated",
                    wanted[k]
                );
            }
        }
        wanted
    }
}

fn parts() -> [Part; 2] {
    [
        Part::new("rig_motor", "motor.mo", &[], &[0.5; 3], 1e-4, 2e-5),
        // In first gear at 5 m/s, rolling steadily at the throttle that the driver holds.
        Part::new("rig_car", "rsm:driveline", &[("road_speed", 5.0)], &[0.2], 1e-3, 1e-4),
    ]
}

/// What the two loops do, as the rows say it.
fn check(parts: &[Part; 2], lines: &[String]) {
    let [motor, car] = parts;
    let motor = motor.check("motor", lines);
    let speed = &motor[4];
    assert_eq!(speed.len(), 400);
    // 20 ms at 6 N m less the start, on 0.0015 kg m^2: towards 80 rad/s; then it brakes.
    assert!(speed[200] > 50.0 && speed[200] < 80.0 && speed[399] < speed[200] - 20.0, "{} {}", speed[200], speed[399]);
    let car = car.check("car", lines);
    assert_eq!(car[1].len(), 600);
    assert!(car[1][99] > 4.5 && car[1][99] < 5.5 && car[1][599] > car[1][99] + 0.3, "{} {}", car[1][99], car[1][599]);
}

#[test]
fn the_rig_on_this_host_has_the_bits_of_a_simulation() {
    let parts = parts();
    let plants = [&parts[0].plant, &parts[1].plant];
    for (name, line) in
        [("rig-gcc", "gcc -std=gnu99 -O2 -mfma"), ("rig-clang", "clang -std=gnu99 -O3 -mfma -ffp-contract=fast")]
    {
        check(&parts, &Build::new(line, name).with_plants(&plants).on_host("rig"));
    }
}

#[test]
fn the_rig_on_a_cortex_m4f_has_the_bits_of_a_simulation() {
    if !builds::emulated() {
        return;
    }
    let parts = parts();
    let build = Build::new(&format!("{CORTEX_M4F} -std=gnu99 -O2"), "rig-arm").with_plants(&[&parts[0].plant, &parts[1].plant]);
    let lines = build.on_board("rig");
    check(&parts, &lines);
    // Double precision is software on this machine: some 60 instructions an operation, some 300 a division. What a step costs is told; beyond that
    // per operation something else than arithmetic would be in it.
    for (name, part) in ["motor", "car"].into_iter().zip(&parts) {
        let found = lines.iter().find_map(|line| line.strip_prefix(&format!("{name}-instructions ")));
        let count: usize = found.expect("the board counts").parse().expect("a number");
        let operations = part.plant.tape.operation_count();
        let (flash, ram) = builds::cortex_size(&build.object(&part.plant.model));
        println!("{name}: {count} instructions a step of {operations} operations, {flash} bytes of flash, {ram} of RAM");
        assert!(
            count > 10 * operations && count < 150 * operations,
            "{name}: {count} instructions for {operations} operations"
        );
    }
}

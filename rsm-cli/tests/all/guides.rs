//! The guides of the book are correct: every block of every page is run, compiled, or named here with the reason why it is not.

use std::process::Command;

use crate::shell::{Block, blocks, of_the_project, read, run};

const DATA: &str = "torque[N*m],speed[rpm],angle[deg]\n0,6500,14.1\n0,7500,34.8\n5,6500,19.2\n5,7500,31.9\n10,6500,27.4\n10,7500,36.5\n\
                    5,7000,25.8\n0,7000,24.7\n10,7000,32.2\n";

/// The languages of the blocks of each page, in order. A new block needs a test, here or where the comment says.
const PAGES: [(&str, &[&str]); 15] = [
    // Its commands test the project itself: `the_commands_for_a_new_effect_exist`.
    ("add-effect.md", &["sh"]),
    ("constrain.md", &["toml"]),
    ("cortex-m.md", &["sh"]),
    // The Rust code of `design.md`, `fit.md`, `optimise.md` and `embed-rust.md` is compiled as documentation tests of the crates `rsm` and
    // `rsm-macros`.
    ("design.md", &["toml", "sh", "toml", "sh", "sh", "rust"]),
    ("diagnose-plant.md", &["toml", "sh", "toml", "sh"]),
    ("diagnose-surface.md", &["sh"]),
    ("embed-c.md", &["sh", "c", "c"]),
    ("embed-rust.md", &["rust,ignore", "rust,ignore", "rust,ignore", "rust"]),
    // `the_guide_to_federations_does_what_it_says`, without the installation; `the_guide_to_streams_does_what_it_says`.
    ("federation.md", &["sh", "sh", "sh", "sh", "sh"]),
    // Its last block is run in `fit_partial.rs`.
    ("fit.md", &["toml", "sh", "toml", "toml", "toml", "c", "toml", "rust", "rust", "toml", "sh", "sh"]),
    ("import.md", &["sh"]),
    ("optimise.md", &["toml", "sh", "sh", "rust"]),
    ("own-plant.md", &["modelica", "toml", "sh", "sh", "toml", "toml", "sh", "sh", "c", "sh"]),
    // The test is `the_guide_to_sweeps_does_what_it_says`, except for the last block, which installs packages and starts hosts. The command of its
    // last line is tested in `sweep.rs`.
    ("sweep.md", &["toml", "sh", "toml", "toml", "sh", "toml", "sh", "sh", "sh", "sh"]),
    ("track.md", &["sh", "sh", "c"]),
];

fn page(name: &str) -> Vec<Block> {
    blocks(&read(&format!("docs/book/src/guides/{name}")))
}

/// The text of a block, by its index on the page.
fn block(name: &str, place: usize) -> String {
    page(name).swap_remove(place).text
}

/// A folder with the model `motor.toml` of the guide to fits, and the output of the fit.
fn fitted() -> (tempfile::TempDir, String) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("dyno.csv"), DATA).unwrap();
    std::fs::write(folder.path().join("fit.toml"), block("fit.md", 0)).unwrap();
    let text = run(&block("fit.md", 1), folder.path());
    (folder, text)
}

#[test]
fn no_block_of_a_guide_is_without_a_test() {
    let mut found: Vec<String> = std::fs::read_dir(of_the_project("docs/book/src/guides"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    found.sort();
    assert_eq!(found, PAGES.map(|it| it.0));
    for (name, languages) in PAGES {
        let found: Vec<String> = page(name).into_iter().map(|it| it.language).collect();
        assert_eq!(found, languages, "{name}");
    }
}

#[test]
fn the_guides_to_fits_constraints_and_designs_do_what_they_say() {
    let (folder, text) = fitted();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    assert!(text.contains("reached (99 % wanted)") && text.contains("error estimate"), "{text}");
    assert!(folder.path().join("report/report.html").is_file());
    // Shards: four rows and five.
    let (header, rows) = DATA.split_once('\n').unwrap();
    let rows: Vec<&str> = rows.lines().collect();
    for (name, rows) in [("monday.csv", &rows[..4]), ("tuesday.csv", &rows[4..])] {
        write(name, &format!("{header}\n{}\n", rows.join("\n")));
    }
    write("shards.toml", &block("fit.md", 9));
    let text = run(&block("fit.md", 10), folder.path());
    assert!(text.contains("3 terms from 9 rows") && text.contains("2 parts"), "{text}");
    // Two recordings of a coasting car, with errors that change slowly.
    let row = |row: usize| {
        let (run, speed) = (row / 40, 20.0 - 0.4 * (row % 40) as f64);
        let slow = 3.0 * (0.3 * row as f64).sin() + 0.5 * ((7 * row) % 5) as f64;
        format!("{run},{speed},{}\n", 150.0 + 0.45 * speed * speed + slow)
    };
    write("coast.csv", &format!("run[1],speed[m/s],force[N]\n{}", (0..80).map(row).collect::<String>()));
    write("coast.toml", &block("fit.md", 2));
    let text = run("rsm fit coast.toml --out drag.toml --report coast-report", folder.path());
    assert!(text.contains("  noise: autoregressive of order ") && text.contains(", 2 series, "), "{text}");
    assert!(std::fs::read_to_string(folder.path().join("drag.toml")).unwrap().contains("noise = \"autoregressive of order "));
    assert!(
        std::fs::read_to_string(folder.path().join("coast-report/report.html")).unwrap().contains("autoregressive of order ")
    );
    // A viscosity over two decades, by Vogel's equation.
    let row = |row: usize| {
        let (t, p) = (20.0 + ((37 * row) % 81) as f64, 20.0 * ((11 * row) % 101) as f64);
        let eta = 0.05 * (1000.0 / (t + 90.0) + 0.0012 * p).exp() * (1.0 + 0.01 * (((7 * row) % 5) as f64 - 2.0));
        format!("{t},{p},{eta}\n")
    };
    write("oil.csv", &format!("temperature[degC],pressure[bar],eta[mPa*s]\n{}", (0..120).map(row).collect::<String>()));
    let head = "format = 1\nmodel = \"oil\"\ndata = [\"oil.csv\"]\n[inputs.temperature]\n[inputs.pressure]\n";
    for (name, response) in [("oil", block("fit.md", 3)), ("chosen", block("fit.md", 3).replace("\"log\"", "\"box-cox\""))] {
        write("oil-fit.toml", &format!("{head}{response}"));
        let text = run(&format!("rsm fit oil-fit.toml --out {name}.toml\nrsm check {name}.toml"), folder.path());
        assert!(text.contains("  transform: log: ") && text.contains(" log(mPa*s), R2 0.999"), "{text}");
        assert!(
            text.contains("  fitted rows: 120 rows (used for the fit), mean error ")
                && text.contains("f32: rounding error at most")
        );
    }
    // An engine with two fuels on two days, the second with an offset.
    let row = |row: usize| {
        let (fuel, slope) = if row.is_multiple_of(3) { ("diesel", 0.08) } else { ("petrol", 0.05) };
        let (day, speed) = (row / 30, 100.0 + 7.0 * ((13 * row) % 60) as f64);
        let torque = 120.0 + slope * speed + 4.0 * day as f64 + 0.2 * ((11 * row) % 7) as f64;
        format!("d{day},{fuel},{speed},{torque}\n")
    };
    write("engine.csv", &format!("day,fuel,speed[rad/s],torque[N*m]\n{}", (0..60).map(row).collect::<String>()));
    let head = format!("format = 1\nmodel = \"engine\"\ndata = [\"engine.csv\"]\n{}[inputs.speed]\n", block("fit.md", 6));
    write("engine-fit.toml", &format!("{head}{}", block("fit.md", 4)));
    let text = run("rsm fit engine-fit.toml --out engine.toml\nrsm emit engine.toml --lang c --out engine-src", folder.path());
    assert!(text.contains("  blocks: 2 of day, effects N*m with sd "), "{text}");
    let header = std::fs::read_to_string(folder.path().join("engine-src/engine.h")).unwrap();
    assert!(header.contains(&block("fit.md", 5)), "{header}");
    // The response of the guide to constraints, within a specification.
    let inputs = "format = 1\nmodel = \"constrained\"\ndata = [\"dyno.csv\"]\n[inputs.torque]\n[inputs.speed]\n\n";
    write("constrained.toml", &format!("{inputs}{}", block("constrain.md", 0)));
    let text = run("rsm fit constrained.toml --out constrained-model.toml", folder.path());
    assert_eq!(text.matches("proven over the whole region").count(), 2, "{text}");
    write("design.toml", &block("design.md", 0));
    let text = run(&block("design.md", 1), folder.path());
    assert!(text.contains("central-composite"), "{text}");
    write("optimal.toml", &block("design.md", 2));
    let text = run(&block("design.md", 3), folder.path());
    assert!(text.contains("40 runs"), "{text}");
    // The design that is made, and the file of its runs.
    let text = run(&block("design.md", 4), folder.path());
    assert!(text.contains("dynamometer, optimal: 40 runs") && text.contains("plan.csv: 40 runs"), "{text}");
}

#[test]
fn the_guide_to_best_settings_does_what_it_says() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(of_the_project("examples/tyre/tyre.toml"), folder.path().join("tyre.toml")).unwrap();
    // The study of the guide is that of the example.
    assert_eq!(block("optimise.md", 0), read("examples/tyre/goals.toml"));
    std::fs::write(folder.path().join("goals.toml"), block("optimise.md", 0)).unwrap();
    let text = run(&block("optimise.md", 1), folder.path());
    assert!(text.contains("total desirability 0.58") && text.contains("of 32 searches ended there"), "{text}");
    run(&block("optimise.md", 2), folder.path());
    let front = std::fs::read_to_string(folder.path().join("front.csv")).unwrap();
    assert!(front.starts_with("silica[1],silane[1],sulphur[1],abrasion[1],"), "{front}");
}

#[test]
fn the_guide_to_surfaces_that_follow_does_what_it_says() {
    let (folder, _) = fitted();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    // A month in which the angle grows by 3 degrees at every point: rows beside the model file's prediction.
    let points = [(1.0, 6600.0), (9.0, 7400.0), (5.0, 7000.0), (2.0, 7300.0), (8.0, 6700.0), (4.0, 6900.0), (7.0, 7200.0)];
    let table = |rows: &[(f64, f64, f64)]| {
        let rows = rows.iter().map(|(torque, speed, angle)| format!("{torque},{speed},{angle}\n")).collect::<String>();
        format!("torque[N*m],speed[rpm],angle[deg]\n{rows}")
    };
    let at: Vec<(f64, f64, f64)> = (0..700).map(|k| (points[k % 7].0, points[k % 7].1, 0.0)).collect();
    write("month.csv", &table(&at));
    let evaluated = run("rsm eval motor.toml --data month.csv", folder.path());
    let predicted = evaluated.lines().skip(1).map(|line| line.rsplit(',').next().unwrap().parse::<f64>().unwrap());
    let rows: Vec<(f64, f64, f64)> =
        at.iter().zip(predicted).enumerate().map(|(k, (at, angle))| (at.0, at.1, angle + 3.0 * k as f64 / 700.0)).collect();
    write("month.csv", &table(&rows));
    let text = run(&block("track.md", 0), folder.path());
    assert!(text.contains("angle: 700 of 700 rows used") && text.contains("written: motor-now.toml"), "{text}");
    run(&block("track.md", 1), folder.path());
    let before = "double torque = 5.0, speed = 733.0, measured = 27.5;";
    let after = "printf(\"%.17g %.17g %g %d\\n\", angle, update[0], update[2], motor_self_test());";
    // Statements between declarations, as in the guide.
    write("main.c", &program(&block("track.md", 2), before, after));
    let printed = run(&format!("{STRICT} -DRSM_SELF_TEST -Isrc main.c src/motor.c -o main\n./main"), folder.path());
    let numbers: Vec<f64> = printed.split_whitespace().map(|word| word.parse().unwrap()).collect();
    let [angle, error, frozen, failures] = numbers[..] else { panic!("{printed}") };
    assert_eq!((frozen, failures), (0.0, 0.0));
    // The sample moved the angle by part of the error.
    let predicted = 27.5 - error;
    assert!(error != 0.0 && (angle - predicted) / error > 0.1 && (angle - predicted) / error < 1.0, "{printed}");
    // `rsm track` has the bits of the step: one row from the start.
    write("month.csv", "torque[N*m],speed[rad/s],angle[deg]\n5,733,27.5\n");
    run(&block("track.md", 0), folder.path());
    let now = run("rsm eval motor-now.toml --at torque=5,speed=733", folder.path());
    // Two orders of summation of the same coefficients: a few roundings of numbers below 64.
    assert!((now.trim().parse::<f64>().unwrap() - angle).abs() < 1e-12, "{now} {angle}");
}

/// A C program whose `main` runs some statements of a guide, between statements of the test.
fn program(shown: &str, before: &str, after: &str) -> String {
    let (includes, statements): (Vec<&str>, Vec<&str>) = shown.lines().partition(|line| line.starts_with("#include"));
    let (includes, statements) = (includes.join("\n"), statements.join("\n"));
    format!("#include <stdio.h>\n{includes}\nint main(void)\n{{\n{before}\n{statements}\n{after}\nreturn 0;\n}}\n")
}

const STRICT: &str = "cc -std=c99 -Wall -Wextra -Werror -O2";

#[test]
fn the_guide_to_c_calls_what_was_emitted() {
    let (folder, _) = fitted();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    run(&block("embed-c.md", 0), folder.path());
    let before = "double torque = 7.0, speed = 740.0;\nfloat torque_f32 = 7.0F;\n(void)torque_f32;";
    let after = "printf(\"%.17g %.17g %d\\n\", angle, (double)angle_f32, motor_self_test());";
    // The arguments of the f32 function have the same names in the guide: C converts them.
    write("main.c", &program(&block("embed-c.md", 1), before, after));
    let compile = format!("{STRICT} -DRSM_SELF_TEST -Isrc main.c src/motor.c -o main\n./main");
    let printed = run(&compile, folder.path());
    let numbers: Vec<f64> = printed.split_whitespace().map(|word| word.parse().unwrap()).collect();
    let at = "rsm eval motor.toml --surface angle --at torque=7,speed=740 --bits";
    let bits = |command: &str| u64::from_str_radix(run(command, folder.path()).trim().trim_start_matches("0x"), 16).unwrap();
    assert_eq!(numbers[0].to_bits(), bits(at));
    let single = bits(&format!("{at} --precision f32"));
    assert_eq!(u64::from((numbers[1] as f32).to_bits()), single);
    assert_eq!(numbers[2], 0.0, "the self-test");
    // The compensator is that of a generated file, which the guide names.
    let generated = of_the_project("generated/c").canonicalize().unwrap();
    let before = "double pedal = 0.25, road_speed = 10.0, gear = 2.0;";
    write(
        "filter.c",
        &program(&format!("#include \"driveline.h\"\n{}", block("embed-c.md", 2)), before, "printf(\"%g\\n\", throttle);"),
    );
    let compile = format!("{STRICT} -I'{0}' filter.c '{0}/driveline.c' -o filter\n./filter", generated.display());
    // After one sample time, a filter that was at rest at 0 has changed by less than its input.
    let throttle: f64 = run(&compile, folder.path()).trim().parse().unwrap();
    assert!(throttle.is_finite() && throttle.abs() < 0.25, "{throttle}");
}

#[test]
fn the_guide_to_a_cortex_m_compiles() {
    if Command::new("arm-none-eabi-gcc").arg("--version").output().is_err() {
        crate::skipped::skipped("arm-none-eabi-gcc is not installed: the guide to a Cortex-M was not compiled");
        return;
    }
    let (folder, _) = fitted();
    run("rsm emit motor.toml --lang c --precision f32 --out src", folder.path());
    run(&block("cortex-m.md", 0), folder.path());
    assert!(folder.path().join("motor.o").is_file());
}

#[test]
fn the_guide_to_the_diagnosis_of_a_surface_runs() {
    let (folder, _) = fitted();
    // The same runs again, from a sensor that reads 2 deg more.
    let again = DATA.lines().map(|line| {
        match line.rsplit_once(',').and_then(|(rest, angle)| Some((rest, angle.parse::<f64>().ok()?))) {
            Some((rest, angle)) => format!("{rest},{}\n", angle + 2.0),
            None => format!("{line}\n"),
        }
    });
    std::fs::write(folder.path().join("new.csv"), again.collect::<String>()).unwrap();
    let text = run(&block("diagnose-surface.md", 0), folder.path());
    assert!(text.contains("angle"), "{text}");
    for name in ["report.html", "diagnosis.json", "extended.toml"] {
        assert!(folder.path().join("found").join(name).is_file(), "{name}\n{text}");
    }
}

#[test]
fn the_guide_to_the_diagnosis_of_a_plant_runs() {
    let folder = tempfile::tempdir().unwrap();
    // The guide's two tables replace the tables in the motor's plant file.
    let shipped = read("rsm-sim/plants/pmac.toml");
    let mut plant = String::new();
    let mut own = false;
    for line in shipped.lines() {
        own = if line.starts_with('[') { line == "[tolerance]" || line == "[noise]" } else { own };
        plant += if own { "" } else { line };
        plant.push('\n');
    }
    std::fs::write(folder.path().join("plant.toml"), format!("{plant}\n{}", block("diagnose-plant.md", 0))).unwrap();
    std::fs::copy(of_the_project("rsm-sim/plants/pmac.csv"), folder.path().join("inputs.csv")).unwrap();
    // Records without noise from the plant itself: there is no fault.
    let records: String = ["train", "choose", "untouched"]
        .map(|name| format!("rsm simulate plant.toml --record inputs.csv --out {name}.csv\n"))
        .concat();
    run(&records, folder.path());
    let text = run(&block("diagnose-plant.md", 1), folder.path());
    assert!(text.contains("no-discrepancy") || text.contains("no discrepancy"), "{text}");
    for name in ["report.html", "diagnosis.json", "extended.toml"] {
        assert!(folder.path().join("found").join(name).is_file(), "{name}\n{text}");
    }
}

#[test]
fn the_guide_to_configurations_finds_a_friction_of_the_loaded_axis() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    let plant = std::fs::read_to_string(of_the_project("rsm-sim/plants/servo-axis.toml")).unwrap();
    let plant = format!("{plant}\n{}", block("diagnose-plant.md", 2));
    write("axis.toml", &plant);
    let friction = "[[effects]]\nkind = \"coulomb-friction\"\nparameters = { force = { loaded = 15.0 } }\n";
    write("machine.toml", &format!("{plant}\n{friction}"));
    let inputs = std::fs::read_to_string(of_the_project("rsm-sim/plants/servo-axis.csv")).unwrap();
    let mut simulate = String::new();
    for name in ["unloaded", "loaded"] {
        write(&format!("{name}-inputs.csv"), &inputs);
        for run in [1, 2] {
            simulate += &format!("rsm simulate machine.toml --record {name}-inputs.csv --out {name}-{run}.csv\n");
        }
    }
    run(&simulate, folder.path());
    let text = run(&block("diagnose-plant.md", 3), folder.path());
    assert!(text.contains("Only in loaded: A dry friction of 15 N is missing from the model."), "{text}");
    let extended = std::fs::read_to_string(folder.path().join("found/extended.toml")).unwrap();
    assert!(extended.contains("force = { loaded = "), "{extended}");
}

/// A MAT file of version 5 with column vectors of doubles (MathWorks, "MAT-File Format", level 5).
fn mat(columns: &[(&str, &[f64])]) -> Vec<u8> {
    let element = |kind: u32, data: &[u8]| {
        let mut bytes = [kind.to_le_bytes(), u32::try_from(data.len()).unwrap().to_le_bytes()].concat();
        bytes.extend_from_slice(data);
        bytes.resize(bytes.len().next_multiple_of(8), 0);
        bytes
    };
    let mut file = b"MATLAB 5.0 MAT-file".to_vec();
    file.resize(124, b' ');
    file.extend_from_slice(&[0x00, 0x01, b'I', b'M']);
    for (name, values) in columns {
        // The types mxDOUBLE_CLASS; miUINT32, miINT32, miINT8, miDOUBLE, inside miMATRIX.
        let rows = i32::try_from(values.len()).unwrap();
        let numbers: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        let inside = [
            element(6, &[6_u32.to_le_bytes(), 0_u32.to_le_bytes()].concat()),
            element(5, &[rows.to_le_bytes(), 1_i32.to_le_bytes()].concat()),
            element(1, name.as_bytes()),
            element(9, &numbers),
        ];
        file.extend(element(14, &inside.concat()));
    }
    file
}

#[test]
fn the_guide_to_imports_makes_one_record_of_two_files() {
    let folder = tempfile::tempdir().unwrap();
    // A run-up in steps, 4 s at 1 kHz. The inverter's clock starts 0.25 s later.
    let speed = |time: f64| 40.0 * (1.3 * time).sin() + 15.0 * (4.1 * time + 1.0).sin() + 6.0 * (9.7 * time * time / 4.0).cos();
    let mut bench = "time[s],Drehzahl,i_q[A]\n".to_string();
    for k in 0..4000 {
        let time = f64::from(k) / 1000.0;
        bench += &format!("{time:.3},{:.6},{:.6}\n", speed(time), (3.0 * time).cos());
    }
    std::fs::write(folder.path().join("bench.csv"), bench).unwrap();
    let clock: Vec<f64> = (0..3500).map(|k| f64::from(k) / 1000.0).collect();
    let omega: Vec<f64> = clock.iter().map(|time| speed(time + 0.25)).collect();
    let voltage: Vec<f64> = clock.iter().map(|time| 20.0 + (2.0 * time).sin()).collect();
    std::fs::write(folder.path().join("inverter.mat"), mat(&[("t", &clock), ("omega", &omega), ("u_q", &voltage)])).unwrap();
    let plants = folder.path().join("rsm-sim/plants");
    std::fs::create_dir_all(&plants).unwrap();
    std::fs::copy(of_the_project("rsm-sim/plants/pmac.toml"), plants.join("pmac.toml")).unwrap();
    let text = run(&block("import.md", 0), folder.path());
    let record = std::fs::read_to_string(folder.path().join("record.csv")).unwrap();
    let header = record.lines().find(|line| !line.starts_with('#')).unwrap();
    for column in ["speed[rad/s]", "i_q[A]", "v_q[V]", "load_torque[N*m]"] {
        assert!(header.contains(column), "{column} is not in {header}\n{text}");
    }
}

#[test]
fn the_guide_to_plants_of_equations_runs() {
    let folder = tempfile::tempdir().unwrap();
    for (name, place) in [("winch.mo", 0), ("winch.toml", 1)] {
        std::fs::write(folder.path().join(name), block("own-plant.md", place)).unwrap();
    }
    let text = run(&block("own-plant.md", 2), folder.path());
    assert!(text.contains("0.34") && text.contains("located in time"), "{text}");
    // The two inertias oscillate against each other: sqrt(120 (1/0.02 + 1/0.34)) = 79.7 rad/s.
    assert!(text.contains("79.7") && text.contains("damping ratio"), "{text}");
    let linear = std::fs::read_to_string(folder.path().join("linear.csv")).unwrap();
    assert!(
        linear.starts_with("row,speed,drum_speed,twist,torque\n") && linear.contains("der(speed),-7.5,7.5,-6000.0,50.0"),
        "{linear}"
    );
    run(&block("own-plant.md", 3), folder.path());
    let simulated = std::fs::read_to_string(folder.path().join("simulated.csv")).unwrap();
    assert!(simulated.starts_with("time[s],torque[N*m],speed[rad/s],drum_speed[rad/s]\n"), "{simulated}");
    assert_eq!(simulated.lines().count(), 6);
    let plant = block("own-plant.md", 1) + "\n" + &block("own-plant.md", 4);
    std::fs::write(folder.path().join("winch.toml"), plant).unwrap();
    std::fs::create_dir(folder.path().join("effects")).unwrap();
    std::fs::write(folder.path().join("effects/felt-brake.toml"), block("own-plant.md", 5)).unwrap();
    let text = run(&block("own-plant.md", 6), folder.path());
    assert!(text.contains("drum (rotation)") && text.contains("felt-brake"), "{text}");
    let braked = std::fs::read_to_string(folder.path().join("braked.csv")).unwrap();
    let last = |text: &str| text.lines().last().unwrap().rsplit(',').next().unwrap().parse::<f64>().unwrap();
    assert!(last(&braked) < last(&simulated), "{braked}{simulated}");
    run(&block("own-plant.md", 7), folder.path());
    std::fs::write(folder.path().join("rig.c"), block("own-plant.md", 8)).unwrap();
    let printed = run(&block("own-plant.md", 9), folder.path());
    // At rest the controller's torque is equal to the load with both brakes: 0.8 (10 - speed) = 1.5 + 0.8 + 0.3 speed/sqrt(speed^2 + 4).
    assert_eq!(printed, "6.765 rad/s\n");
    // The program gives the same results with -O0 and with fused operations.
    let bits = "cc -std=gnu99 -O0 -DRSM_SELF_TEST -c winch.c -o winch.o\nprintf 'int winch_self_test(void); int main(void) { return winch_self_test(); }' > self.c\n\
                cc self.c winch.o -o self\n./self";
    run(bits, folder.path());
    let refused = |arguments: &[&str]| {
        let output = crate::calls::rsm(arguments, folder.path());
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    let message = refused(&["emit", "winch.toml", "--step", "0.1", "--lang", "c", "--effects", "effects", "--out", "long"]);
    // The oscillation of the shaft, 79.7 rad/s as above, with the damping of the drum by its load below the creep speed.
    assert!(
        message.contains("0.1 s is too long for the fastest rate at the start, 79.") && message.contains("is stable up to"),
        "{message}"
    );
    assert!(!folder.path().join("long").exists(), "nothing is written");
    let message = refused(&["emit", "winch.toml", "--lang", "c", "--out", "long"]);
    assert!(message.contains("give the length of its step"), "{message}");
    let message = refused(&[
        "emit",
        "winch.toml",
        "--step",
        "1e-3",
        "--name",
        "while",
        "--lang",
        "c",
        "--effects",
        "effects",
        "--out",
        "long",
    ]);
    assert!(message.contains("the name `while` is a keyword"), "{message}");
}

#[test]
fn the_commands_for_a_new_effect_exist() {
    let text = block("add-effect.md", 0);
    let xtask = read("tests/hidden-effects/src/main.rs");
    for line in text.lines() {
        let words: Vec<&str> = line.split('#').next().unwrap().split_whitespace().collect();
        match words[..] {
            ["cargo", "test", "-p", package] => assert!(of_the_project(package).join("Cargo.toml").is_file(), "{line}"),
            ["cargo", "test", "-p", "rsm-tests", "--test", target, filter] => {
                assert!(read("tests/Cargo.toml").contains(&format!("name = \"{target}\"")), "{line}");
                assert!(of_the_project("tests/all").join(format!("{filter}.rs")).is_file(), "{line}");
            }
            ["cargo", "xtask", "hidden-effects", ref options @ ..] => {
                let options = options.iter().filter(|word| word.starts_with("--"));
                options.for_each(|option| assert!(xtask.contains(&format!("\"{option}\"")), "{line}: {option}"));
            }
            _ => panic!("a command of another kind: {line}"),
        }
    }
}

#[test]
fn the_guide_to_federations_does_what_it_says() {
    let Some(helics) = crate::libhelics::helics("the guide to federations") else { return };
    let folder = tempfile::tempdir().unwrap();
    for name in ["motor.toml", "both-loops.toml", "two-hosts.toml"] {
        std::fs::copy(of_the_project(&format!("examples/federation/{name}")), folder.path().join(name)).unwrap();
    }
    // A federation that loses a process is started again, as in `until_no_peer_is_lost`.
    let again = "rsm() { command rsm \"$@\" || { [ \"$1\" = cosim ] && command rsm \"$@\"; }; }";
    let set = format!("export RSM_HELICS={}\n{again}\n", helics.display());
    let printed = run(&(set.clone() + &block("federation.md", 1)), folder.path());
    assert!(printed.contains("the records are identical, bit by bit, to those of one process"), "{printed}");
    let printed = run(&block("federation.md", 2), folder.path());
    assert!(printed.contains("# on bench") && printed.contains("# on controller"), "{printed}");
    let printed = run(&(set + "rsm cosim both-loops.toml --out both --check"), folder.path());
    assert!(printed.contains("the records are identical, bit by bit, to those of one process"), "{printed}");
}

#[test]
fn the_guide_to_sweeps_does_what_it_says() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    for name in ["pmac.toml", "pmac.csv"] {
        std::fs::copy(of_the_project("rsm-sim/plants").join(name), here.join(name)).unwrap();
    }
    for (name, place) in [("sweep.toml", 0), ("map.toml", 2), ("fit.toml", 3), ("fleet.toml", 5)] {
        std::fs::write(here.join(name), block("sweep.md", place)).unwrap();
    }
    let text = run(&block("sweep.md", 1), here);
    assert!(text.contains("200 tasks, 0 with a result from before, 200 run") && text.contains("i_q_rms [A]"), "{text}");
    let longer = block("sweep.md", 0).replace("runs = 200", "runs = 210");
    std::fs::write(here.join("longer.toml"), longer).unwrap();
    let text = run("rsm sweep longer.toml --out results", here);
    assert!(text.contains("210 tasks, 200 with a result from before, 10 run"), "{text}");
    let text = run(&block("sweep.md", 4), here);
    assert!(text.contains("speed_final") && here.join("final-speed.toml").is_file(), "{text}");
    for record in ["machine-1.csv", "machine-2.csv"] {
        run(&format!("rsm simulate pmac.toml --record pmac.csv --out {record}"), here);
    }
    let text = run(&block("sweep.md", 6), here);
    assert!(text.contains("fleet: 2 tasks"), "{text}");
    // As Slurm starts it.
    std::fs::write(here.join("array.sh"), block("sweep.md", 7)).unwrap();
    run("for k in 1 2 3 4; do SLURM_ARRAY_TASK_ID=$k SLURM_CPUS_PER_TASK=1 sh -e array.sh; done", here);
    let text = run(&block("sweep.md", 8), here);
    assert!(text.contains("200 with a result from before, 0 run") && text.contains("200 merged"), "{text}");
    let table = |folder: &str| std::fs::read(here.join(folder).join("table.csv")).unwrap();
    assert!(table("shared") == table("merged"));
    // The bits are those of a run without shards.
    run("rsm sweep sweep.toml --out results", here);
    assert!(table("shared") == table("results"));
}

#[test]
fn the_guide_to_streams_does_what_it_says() {
    let folder = tempfile::tempdir().unwrap();
    run(&block("federation.md", 3), folder.path());
    // Tests in parallel may keep the machine busy for longer than the buffer lasts, so status 1 is also accepted.
    let printed = run(&block("federation.md", 4).replace("--out records\nwait", "--out records || true\nwait"), folder.path());
    assert!(
        ["motor", "controller"].iter().all(|side| printed.contains(&format!("{side}: 3000 ticks; datagrams: 3000 sent"))),
        "{printed}"
    );
}

//! `targets/firmware`: the steps in C have the bits of the steps in Rust, on this host and on a Cortex-M4F, and cost the same for every input.

pub mod builds;
mod faults;
mod image;
mod linked;
mod readme;
mod rig;
mod rust;
mod sequence;

use std::collections::BTreeMap;
use std::fmt::Write as _;

use builds::{Build, CORTEX_M4F};
use motor_loop::{Band, Drive, Motor, Tuning};
use rsm_sim::plant_file::PlantFile;
use rsm_tests::{cases, object};
use throttle_loop::raw::{Channel, Scaling};

/// The motor of the shipped plant file, current control at 10 kHz with a bandwidth of 1/(6 T) in round numbers, and 1 us of dead time.
fn drive() -> Drive {
    let path = cases::root().join("rsm-sim").join("plants").join("pmac.toml");
    let source = rsm_core::source::Source::read(&path).unwrap_or_else(|faults| panic!("{faults}"));
    let parameters = PlantFile::read(&source).unwrap_or_else(|faults| panic!("{faults}")).effective_parameters();
    let number = |name: &str| parameters.number(name) as f32;
    let motor = Motor {
        phase_resistance_ohm: number("phase_resistance"),
        phase_inductance_h: number("phase_inductance"),
        flux_linkage_wb: number("flux_linkage"),
        pole_pairs: number("pole_pairs"),
        bus_voltage_v: number("bus_voltage"),
        current_limit_a: number("current_limit"),
    };
    Drive::new(&motor, &Tuning { pwm_period_s: 1e-4, bandwidth_rad_s: 1500.0, dead_time_s: 1e-6, dead_time_current_a: 1.0 })
}

const TABLES_H: &str = "\
/* The constants of the two loops: one table each. Written by tests/all/firmware (RSM_BLESS=1) from what the Rust steps use. */
#ifndef TABLES_H
#define TABLES_H

#include \"motor_step.h\"
#include \"throttle_step.h\"

/* The motor of rsm-sim/plants/pmac.toml at 10 kHz. */
extern const motor_drive tables_drive;

/* Everything between the converters and the throttle's step: a board with other sensors has another table. */
extern const throttle_scaling tables_scaling;

#endif
";

/// The shortest decimals that read back to the same f32.
fn literal(value: f32) -> String {
    format!("{value:?}f")
}

fn tables_c() -> String {
    let d = drive();
    let drive = [
        ("newton_metres_per_ampere", d.newton_metres_per_ampere),
        ("amperes_per_newton_metre", d.amperes_per_newton_metre),
        ("current_limit_a", d.current_limit_a),
        ("per_ampere", d.per_ampere),
        ("limit_current_once_a", d.limit_current_once_a),
        ("most_weakening_a", d.most_weakening_a),
        ("nominal_bus_v", d.nominal_bus_v),
        ("weakening_per_speed", d.weakening_per_speed),
        ("resistance_ohm", d.resistance_ohm),
        ("inductance_h", d.inductance_h),
        ("flux_linkage_wb", d.flux_linkage_wb),
        ("pole_pairs", d.pole_pairs),
        ("turned_per_speed", d.turned_per_speed),
        ("turns_per_speed", d.turns_per_speed),
        ("amperes_per_volt", d.amperes_per_volt),
        ("characteristic_current_a", d.characteristic_current_a),
        ("gain_v_per_a", d.gain_v_per_a),
        ("integral_share", d.integral_share),
        ("slew_a", d.slew_a),
        ("slew_v_per_a", d.slew_v_per_a),
        ("advance_turns_s", d.advance_turns_s),
        ("dead_time_share", d.dead_time_share),
        ("per_dead_time_ampere", d.per_dead_time_ampere),
        ("limits.torque_nm", d.limits.torque_nm),
        ("limits.angle_turns", d.limits.angle_turns),
        ("limits.angle_rate_turns", d.limits.angle_rate_turns),
        ("limits.current_sum_a", d.limits.current_sum_a),
        ("limits.current_square_a2", d.limits.current_square_a2),
        ("limits.current_rate_square_a2", d.limits.current_rate_square_a2),
        ("limits.trip_square_a2", d.limits.trip_square_a2),
        ("limits.speed_rad_s", d.limits.speed_rad_s),
        ("limits.speed_rate_rad_s", d.limits.speed_rate_rad_s),
        ("limits.good_in_a_row", d.limits.good_in_a_row),
    ];
    let mut text = String::from("#include \"tables.h\"\n\nconst motor_drive tables_drive = {\n");
    for (name, value) in drive {
        writeln!(text, "    .{name} = {},", literal(value)).expect("text");
    }
    writeln!(text, "    .limits.bad_in_a_row = {}u,", d.limits.bad_in_a_row).expect("text");
    text.push_str("    /* middle and half of the range, and the most from what is expected */\n");
    let Band { middle, half, rate } = d.limits.bus_v;
    writeln!(text, "    .limits.bus_v = {{{}}},", [middle, half, rate].map(literal).join(", ")).expect("text");
    text.push_str("};\n\nconst throttle_scaling tables_scaling = {\n    /* zero in counts, value of a count, lowest and highest counts of a whole wire */\n");
    let s = Scaling::BOARD;
    for (name, channel) in [("pedal", s.pedal), ("plate", s.plate), ("speed", s.speed)] {
        let Channel { zero, per_count, lowest, highest } = channel;
        let numbers = [zero, per_count, lowest, highest].map(literal).join(", ");
        writeln!(text, "    .{name} = {{{numbers}}},").expect("text");
    }
    writeln!(
        text,
        "    .compare_closed = {},\n    .compare_span = {},\n}};",
        literal(s.compare_closed),
        literal(s.compare_span)
    )
    .expect("text");
    text
}

fn blessed(name: &str, text: &str) -> bool {
    let path = builds::firmware().join(name);
    if std::env::var_os("RSM_BLESS").is_some() {
        let beside = path.with_extension("new");
        std::fs::write(&beside, text).and_then(|()| std::fs::rename(&beside, &path)).expect("the folder can be written");
    }
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display())) == text
}

#[test]
fn the_tables_in_c_are_those_of_the_rust_steps() {
    let same = blessed("tables.h", TABLES_H) & blessed("tables.c", &tables_c());
    assert!(same, "targets/firmware/tables.* are stale: run with RSM_BLESS=1 and look at the difference");
}

fn check_bits(name: &str, found: &[String]) {
    let expected = sequence::lines(&drive());
    assert_eq!(found.len(), expected.len(), "{name}: {found:?}");
    if let Some(k) = found.iter().zip(&expected).position(|(found, expected)| found != expected) {
        panic!("{name}: the first difference is before `{}`, C has `{}`", expected[k], found[k]);
    }
}

/// Also where fused operations exist and are used by default.
#[test]
fn the_steps_in_c_have_the_bits_of_the_steps_in_rust_on_this_host() {
    for (name, line) in [
        ("gcc-O2", "gcc -std=gnu99 -O2"),
        ("gcc-Os", "gcc -std=gnu99 -Os"),
        ("gcc-O0", "gcc -std=gnu99 -O0"),
        ("gcc-fma", "gcc -std=gnu99 -O2 -mfma"),
        ("gcc-root", "gcc -std=gnu99 -O2 -DEXACT_ROOT_BY_DIGITS"),
        ("clang-O2", "clang -std=gnu99 -O2"),
        ("clang-fma", "clang -std=gnu99 -O3 -mfma -ffp-contract=fast"),
    ] {
        check_bits(line, &Build::new(line, name).on_host("bits"));
    }
}

/// All warnings under which the emitted C compiles.
#[test]
fn the_steps_in_c_compile_without_a_warning() {
    let warnings = "-O2 -Wall -Wextra -Wconversion -Wdouble-promotion -Wshadow -Wstrict-prototypes -Wmissing-prototypes -Wcast-qual -Wundef -Werror";
    for (name, compiler) in [("gcc", "gcc -std=gnu99"), ("clang", "clang -std=gnu99")] {
        Build::new(&format!("{compiler} {warnings}"), &format!("warnings-{name}")).on_host("bits");
    }
    if builds::emulated() {
        Build::new(&format!("{CORTEX_M4F} -std=gnu99 {warnings}"), "warnings-arm");
    }
}

const STEPS: [(&str, &str); 4] = [
    ("motor_step", "motor_references"),
    ("motor_step", "motor_currents"),
    ("throttle_step", "throttle_step"),
    ("throttle_step", "throttle_raw_step"),
];

#[test]
fn the_steps_in_c_have_no_branch_on_this_host() {
    for (name, line) in [("gcc", "gcc -std=gnu99 -O2"), ("clang", "clang -std=gnu99 -O2")] {
        let build = Build::new(line, &format!("branches-{name}"));
        for (source, step) in STEPS {
            let functions = object::disassemble(&build.object(source));
            let code = &functions[step];
            // Calls of evaluators are allowed: they have a test of their own.
            let jumps: Vec<&str> = code.transfers().into_iter().filter(|line| !line.starts_with("call")).collect();
            assert!(jumps.is_empty() && code.fused().is_empty(), "{line}: {step}: {jumps:?} {:?}", code.fused());
        }
    }
}

#[test]
fn the_bits_on_a_cortex_m4f_are_those_of_the_rust_steps() {
    if !builds::emulated() {
        return;
    }
    for level in ["-O2", "-Os"] {
        let build = Build::new(&format!("{CORTEX_M4F} -std=gnu99 {level}"), &format!("arm{level}"));
        check_bits(level, &build.on_board("bits"));
    }
}

/// Instructions that go elsewhere, by a condition or out of the function. `it` blocks are predication, not branches, and an unconditional branch
/// within the function, which gcc makes around its constants, is taken every time.
fn branches<'l>(function: &str, lines: &'l [String]) -> Vec<&'l String> {
    const CONDITIONS: [&str; 14] = ["eq", "ne", "cs", "cc", "mi", "pl", "vs", "vc", "hi", "ls", "ge", "lt", "gt", "le"];
    let inside = format!("<{function}+");
    let is_branch = |line: &&String| {
        let mnemonic = line.split_whitespace().next().unwrap_or_default();
        let stem = mnemonic.split('.').next().unwrap_or_default();
        let conditional = stem.strip_prefix('b').is_some_and(|condition| CONDITIONS.contains(&condition));
        conditional || (stem == "b" && !line.contains(&inside)) || ["cbz", "cbnz", "tbb", "tbh", "blx"].contains(&stem)
    };
    lines.iter().filter(is_branch).collect()
}

#[test]
fn the_steps_on_a_cortex_m4f_have_no_branch_and_call_evaluators_only() {
    if !builds::emulated() {
        return;
    }
    for level in ["-O2", "-Os"] {
        let build = Build::new(&format!("{CORTEX_M4F} -std=gnu99 {level}"), &format!("arm-object{level}"));
        for object in ["motor_step", "throttle_step"] {
            for (function, lines) in builds::cortex_functions(&build.object(object)) {
                if function.contains("init") || (!function.contains("_f32") && !STEPS.iter().any(|(_, step)| *step == function))
                {
                    continue;
                }
                let branches = branches(&function, &lines);
                assert!(branches.is_empty(), "{level}: {function}: {branches:?}\n{}", lines.join("\n"));
                let fused: Vec<&String> =
                    lines.iter().filter(|line| line.starts_with("vfm") || line.starts_with("vfnm")).collect();
                assert!(fused.is_empty(), "{level}: {function}: {fused:?}");
                for call in lines.iter().filter_map(|line| line.strip_prefix("-> ")) {
                    assert!(call.contains("_f32"), "{level}: {function} calls {call}");
                }
            }
        }
    }
    // The scan itself detects branches.
    let lines = [
        "vmov.f32 s0, s1",
        "bne.n 10 <f+0x10>",
        "bl 0 <g>",
        "it mi",
        "cbz r0, 4",
        "bic.w r0, r1",
        "b.n 8 <g>",
        "b.n 8 <f+0x8>",
    ];
    let lines = lines.map(String::from);
    assert_eq!(branches("f", &lines), [&lines[1], &lines[4], &lines[6]]);
}

/// The allowed cost of a step, `budget.txt`: a line for each step and optimisation level with instructions, with bytes of stack and with bytes of
/// flash; and a line for each object and level with bytes of flash and RAM.
#[test]
fn every_step_costs_the_same_for_every_input_and_no_more_than_its_budget() {
    if !builds::emulated() {
        return;
    }
    let mut found: Vec<(String, Vec<u32>)> = vec![];
    for level in ["-O2", "-Os"] {
        let line = format!("{CORTEX_M4F} -std=gnu99 {level}");
        let nested = image::nested_stack(&image::interrupted(&Build::new(&line, &format!("arm-nested{level}")).with_image()));
        found.push((format!("both-interrupts {level} stack"), vec![nested]));
        let build = Build::new(&line, &format!("arm-count{level}"));
        build.compile_image();
        let mut counts: BTreeMap<String, BTreeMap<u32, Vec<String>>> = BTreeMap::new();
        for line in build.on_board("count") {
            let words: Vec<&str> = line.split_whitespace().collect();
            let count = words[2].parse().expect("a number of instructions");
            counts.entry(words[0].to_string()).or_default().entry(count).or_default().push(words[1].to_string());
        }
        assert_eq!(counts.len(), STEPS.len(), "{counts:?}");
        for (step, kinds) in &counts {
            assert_eq!(kinds.len(), 1, "{level}: {step} costs what its input says: {kinds:?}");
            found.push((format!("{step} {level} instructions"), kinds.keys().copied().collect()));
        }
        for (object, step) in STEPS {
            // The evaluators are inlined, and the constants follow the instructions: frame and section of the step are all that it takes.
            let functions = builds::cortex_functions(&build.object(object));
            let (_, lines) = functions.iter().find(|(function, _)| function == step).expect("the step");
            let calls: Vec<&String> = lines.iter().filter(|line| line.starts_with("-> ") || line.starts_with("bl")).collect();
            assert!(calls.is_empty(), "{level}: {step} calls functions, whose stack and flash are not counted: {calls:?}");
            found.push((format!("{step} {level} stack"), vec![build.stack(object, step)]));
            found.push((
                format!("{step} {level} flash"),
                vec![builds::cortex_section(&build.object(object), &format!(".text.{step}"))],
            ));
        }
        for interrupt in image::INTERRUPTS {
            found.push((format!("{interrupt} {level} stack"), vec![build.stack(builds::IMAGE, interrupt)]));
        }
        for object in builds::OBJECTS.into_iter().chain([builds::IMAGE]) {
            let (flash, ram) = builds::cortex_size(&build.object(object));
            found.push((format!("{object}.o {level} flash-and-ram"), vec![flash, ram]));
        }
    }
    found.sort();
    let mut text = String::from(
        "# What the steps may cost on a Cortex-M4F: instructions of a call, evaluators included, the same for every input; bytes of stack of a call; bytes of flash of a step; bytes of flash and RAM of an object.\n\
         # Counted by tests/all/firmware; RSM_BLESS=1 writes it. arm-none-eabi-gcc 12.2, the evaluators in f32.\n",
    );
    for (name, numbers) in &found {
        let numbers: Vec<String> = numbers.iter().map(u32::to_string).collect();
        writeln!(text, "{name:<40} {}", numbers.join(" ")).expect("text");
    }
    println!("{text}");
    if std::env::var_os("RSM_BLESS").is_some() {
        readme::blessed_budget("budget.txt", &text);
    }
    let budget = std::fs::read_to_string(builds::firmware().join("budget.txt")).expect("the budget");
    for (name, numbers) in &found {
        let line = budget.lines().find_map(|line| line.strip_prefix(name.as_str()));
        let allowed: Vec<u32> = line
            .unwrap_or_else(|| panic!("budget.txt has no line `{name}`"))
            .split_whitespace()
            .map(|word| word.parse().expect("a number"))
            .collect();
        let within = numbers.len() == allowed.len() && numbers.iter().zip(&allowed).all(|(found, allowed)| found <= allowed);
        assert!(within, "{name}: found {numbers:?}, the budget is {allowed:?}");
    }
}

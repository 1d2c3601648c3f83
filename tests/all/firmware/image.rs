//! The firmware as one program: `image.c`, both loops as interrupts on the emulated board.
//!
//! - The outer interrupt is interrupted at every instruction: the data passed between the interrupts are consistent, and the
//!   floating-point registers are restored.
//! - The processor in the loop: the board, by its timers and priorities, against plants as code, has the bits of the host and of a simulation.
//! - The watchdog: a step that does not return, or no longer runs, leads to a reset into the safe state.

use std::collections::BTreeSet;
use std::path::Path;

use super::builds::{self, Build, CORTEX_M4F, FAST};
use super::rig::Part;

/// The functions that the interrupts of a board call.
pub const INTERRUPTS: [&str; 2] = ["image_current_interrupt", "image_reference_interrupt"];

/// Bytes that an interrupt leaves on the stack with room for the floating-point registers: 8 words, s0 to s15, FPSCR, and one that is reserved
/// (Armv7-M, B1.5.7).
const EXTENDED_FRAME: u32 = 4 * (8 + 16 + 1 + 1);

/// ASPEN and LSPEN (Armv7-M, B3.2.21): room for the floating-point registers, filled when the interrupt uses them.
const LAZY: u32 = 0xC000_0000;

/// The number after a word of a line.
fn number(line: &str, word: &str) -> u32 {
    let mut words = line.split(' ').skip_while(|found| *found != word);
    words.nth(1).and_then(|digits| digits.parse().ok()).unwrap_or_else(|| panic!("`{line}` has no number after `{word}`"))
}

fn fpccr(line: &str) -> u32 {
    let digits = line.split(' ').skip_while(|word| *word != "fpccr").nth(1).expect("the register");
    u32::from_str_radix(digits, 16).expect("8 digits")
}

/// The output of `programs/interrupted.c`.
pub struct Interrupted {
    addresses: BTreeSet<u32>,
    /// Which numbers that are handed over differ between before and after: 1 each.
    pub handed_over: String,
    counts: String,
}

impl Interrupted {
    /// Nothing torn, nothing wrong, the floating-point context as after reset; and each instruction of these functions of the program was
    /// interrupted.
    pub fn check(&self, name: &str, program: &Path, is_part: &dyn Fn(&str) -> bool) {
        let counts = &self.counts;
        assert_eq!(number(counts, "wrong"), 0, "{name}: {counts}");
        assert!(number(counts, "before") > 100 && number(counts, "after") > 100, "{name}: {counts}");
        // The outer step had begun to use the floating-point unit, or the program before it had: each interrupt left room for its registers.
        assert_eq!(number(counts, "extended"), number(counts, "hits"), "{name}: {counts}");
        assert_eq!(fpccr(counts) & LAZY, LAZY, "{name}: {counts}");
        let mut instructions = 0;
        for (function, lines) in builds::cortex_instructions(program) {
            if is_part(&function) {
                for (address, text) in &lines {
                    // Padding before a constant is never executed.
                    assert!(
                        text == "nop" || self.addresses.contains(address),
                        "{name}: {function} was not interrupted at {address:x}: {text}"
                    );
                }
                instructions += lines.len();
            }
        }
        println!("{name}: interrupted at each of {instructions} instructions: {counts}");
        assert!(instructions > 500, "{name}: {instructions}");
    }

    /// Of the lines of a program.
    pub fn of(lines: &[String]) -> Interrupted {
        let address = |line: &String| Some(u32::from_str_radix(line.strip_prefix("at ")?, 16).expect("an address"));
        Interrupted {
            addresses: lines.iter().filter_map(address).collect(),
            handed_over: lines.first().expect("lines").clone(),
            counts: lines.last().expect("lines").clone(),
        }
    }
}

pub fn interrupted(build: &Build) -> Interrupted {
    Interrupted::of(&build.on_board("interrupted"))
}

/// Bytes of stack with both interrupts on it. The program calls the outer one as a function: its own frame is added.
pub fn nested_stack(found: &Interrupted) -> u32 {
    number(&found.counts, "stack") + EXTENDED_FRAME
}

#[test]
fn whatever_instruction_is_interrupted_what_is_handed_over_is_whole() {
    if !builds::emulated() {
        return;
    }
    for level in ["-O2", "-Os"] {
        let build = Build::new(&format!("{CORTEX_M4F} -std=gnu99 {level}"), &format!("arm-interrupted{level}")).with_image();
        let found = interrupted(&build);
        // Every number passed differs between before and after, so that a mixture would be noticed.
        assert_eq!(found.handed_over, "handed over: 1 1 1 1 1");
        assert_eq!(number(&found.counts, "torn"), 0, "{level}: {}", found.counts);
        let parts = ["image_reference_interrupt", "motor_references", "throttle_raw_step"];
        found.check(level, &build.program("interrupted"), &|function| parts.contains(&function));
    }
}

/// The test above detects a wrong handover: with the index written first, and with one slot whose words are copied one by one.
#[test]
fn a_broken_handover_is_found() {
    if !builds::emulated() {
        return;
    }
    let text = std::fs::read_to_string(builds::firmware().join("handover.h")).expect("the header");
    let line_with =
        |part: &str| text.lines().find(|line| line.contains(part)).unwrap_or_else(|| panic!("no `{part}`")).to_string();
    let (copy, index) = (line_with("shared->slots[next] = *value;"), line_with("shared->newest = next;"));
    let index_first = text.replace(&copy, "@").replace(&index, &copy).replace('@', &index);
    let words = "for (uint32_t k = 0u; k < sizeof *value / 4u; k++) ((volatile uint32_t *)&shared->slots[next])[k] = ((const volatile uint32_t *)value)[k]; \\";
    let one_slot = text.replace(&copy, words).replace("= shared->newest ^ 1u;", "= shared->newest;");
    for (name, broken) in [("index-first", index_first), ("one-slot", one_slot)] {
        assert_ne!(text, broken, "{name}");
        let line = format!("{CORTEX_M4F} -std=gnu99 -O2");
        let build = Build::new(&line, &format!("arm-broken-{name}")).with_image_and(&broken, "interrupted");
        let counts = interrupted(&build).counts;
        println!("{name}: {counts}");
        assert!(number(&counts, "torn") > 0, "{name}: {counts}");
    }
}

/// As in `rig.rs`, but for the step of the motor's plant: in software double precision a period has room for one.
pub fn parts() -> [Part; 2] {
    [
        Part::new("rig_motor", "motor.mo", &[], &[0.5; 3], 1e-4, 1e-4),
        Part::new("rig_car", "rsm:driveline", &[("road_speed", 5.0)], &[0.2], 1e-3, 1e-4),
    ]
}

/// The lines of `programs/board.c` on this host, where the calls stand in a row.
pub fn on_host(name: &str, define: &str) -> Vec<String> {
    let parts = parts();
    let host = Build::new(&format!("gcc -std=gnu99 -O2 {define}"), &format!("board-host-{name}"));
    host.with_plants(&[&parts[0].plant, &parts[1].plant]).with_image().on_host("board")
}

/// Interrupted often, nothing lost, the floating-point context as after reset.
pub fn check_counts(name: &str, counts: &str) {
    assert!(number(counts, "preempted") > 100 && number(counts, "lost") == 0, "{name}: {counts}");
    assert_eq!(fpccr(counts) & LAZY, LAZY, "{name}: {counts}");
}

#[test]
fn the_processor_in_the_loop_has_the_bits_of_the_host_and_of_a_simulation() {
    if !builds::emulated() {
        return;
    }
    let parts = parts();
    let plants = [&parts[0].plant, &parts[1].plant];
    let mut speeds = vec![];
    for (name, define) in [("aligned", ""), ("preempted", "-DPREEMPTED")] {
        let host = on_host(name, define);
        let board = Build::new(&format!("{CORTEX_M4F} -std=gnu99 -O2 {define}"), &format!("board-arm-{name}"));
        let mut board = board.with_plants(&plants).with_image().on_board_at("board", FAST);
        let counts = board.pop().expect("a line");
        println!("{name}: {counts}");
        check_counts(name, &counts);
        assert_eq!(board.len(), host.len(), "{name}");
        if let Some(k) = board.iter().zip(&host).position(|(board, host)| board != host) {
            panic!("{name}, line {k}: the board has `{}`, the host `{}`", board[k], host[k]);
        }
        let motor = parts[0].check("motor", &board);
        let car = parts[1].check("car", &board);
        assert!(motor[4].len() == 600 && car[1].len() == 60, "{name}");
        // 30 ms at 6 N m less the start, on 0.0015 kg m^2: towards 120 rad/s; then it brakes. The driver tips in after 20 ms.
        let speed = &motor[4];
        assert!(
            speed[300] > 80.0 && speed[300] < 120.0 && speed[599] < speed[300] - 40.0,
            "{name}: {} {}",
            speed[300],
            speed[599]
        );
        assert!(car[1][59] > car[1][20], "{name}");
        speeds.push(speed[599]);
    }
    // With a delay of one period: a different run, so that the second comparison is independent.
    assert_ne!(speeds[0].to_bits(), speeds[1].to_bits());
}

/// The required reaction when something hangs, for both firmwares: `run` gives the lines of its program for a kind of hang.
pub fn check_hangs(run: impl Fn(u32) -> Vec<String>) {
    for (hang, what) in [(1, "the currents"), (2, "the references"), (3, "the timer of the currents")] {
        let lines = run(hang);
        println!("{what}: {lines:?}");
        let [alarm, safe, reset] = lines.as_slice() else { panic!("{what}: {lines:?}") };
        // Until then the loops ran, and the bridge was closed. The alarm comes 3 ms after the last feed: at most so many periods after the 200th.
        assert!(alarm.starts_with("alarm: closed 1 cap 1 "), "{what}: {alarm}");
        assert!((200..=230).contains(&number(alarm, "sampled")), "{what}: {alarm}");
        assert_eq!(safe, "safe: closed 0 cap 0", "{what}");
        assert_eq!(reset, "reset by the watchdog: closed 0 cap 0 sampled 0", "{what}");
    }
    assert_eq!(run(0), ["no alarm in 400 periods: closed 1"]);
}

#[test]
fn a_step_that_does_not_return_leads_to_a_reset_into_the_safe_state() {
    if !builds::emulated() {
        return;
    }
    check_hangs(|hang| {
        let line = format!("{CORTEX_M4F} -std=gnu99 -O2 -DHANG={hang}");
        Build::new(&line, &format!("arm-hang-{hang}")).with_image().on_board_at("hangs", FAST)
    });
}

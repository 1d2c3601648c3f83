//! The watchdog's reaction if a step does not return, or no longer runs: `../../../programs/hangs.c` in Rust, with the same output.
//!
//! In: the last word of the emulator's command line, which is `HANG` in C. 1: the interrupt of the currents does not return. 2: that of the
//! references does not return. 3: the timer of the currents stops. 0: nothing hangs.
#![no_std]
#![no_main]

use core::hint::spin_loop;
use core::panic::PanicInfo;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};

use cortex_m_rt::{entry, exception};
use cortex_m_semihosting::{debug, hprintln, nr, syscall1};
use firmware::image::{Between, Bridge, Driver, PERIODS, Slow, current_interrupt, reference_interrupt, safe_state};
use firmware::own::Own;
use firmware::{board, nominal};
use motor_loop::{Command, CurrentState, Drive, Measured};
use throttle_loop::raw::Counts;

const PERIOD_TICKS: u32 = board::TICKS_A_SECOND / 10_000;
const RUN_PERIODS: u32 = 200;
const SAYS_ALARM: u32 = 0x616C_6172;

static DRIVE: Own<Option<Drive>> = Own::new(None);
static FAST: Own<Option<CurrentState>> = Own::new(None);
static SLOW: Own<Option<Slow>> = Own::new(None);
static BETWEEN: Between = Between::new();
static HANG: AtomicU32 = AtomicU32::new(0);
static SAMPLED: AtomicU32 = AtomicU32::new(0);
static CLOSED: AtomicBool = AtomicBool::new(true);
static CAP: AtomicBool = AtomicBool::new(true);
static DONE: AtomicBool = AtomicBool::new(false);

/// A board reads the cause of a reset from a register; the emulated one has no such register. A reset does not change memory, and the start-up code
/// does not clear this section.
#[unsafe(link_section = ".uninit.left_by_alarm")]
static LEFT_BY_ALARM: AtomicU32 = AtomicU32::new(0);

fn hang() -> ! {
    loop {
        spin_loop();
    }
}

/// Both interfaces of a board on which nothing moves.
struct Still;

impl Bridge for Still {
    fn sample(&mut self) -> Measured {
        let sampled = SAMPLED.load(Relaxed);
        if HANG.load(Relaxed) == 1 && sampled == RUN_PERIODS {
            hang();
        }
        SAMPLED.store(sampled + 1, Relaxed);
        Measured { currents_a: [0.0; 3], angle_turns: 0.0, speed_rad_s: 0.0, bus_voltage_v: 270.0 }
    }

    fn command(&mut self, command: &Command) {
        CLOSED.store(command.closed > 0.5, Relaxed);
    }
}

impl Driver for Still {
    fn torque_demand_nm(&mut self) -> f32 {
        if HANG.load(Relaxed) == 2 && SAMPLED.load(Relaxed) >= RUN_PERIODS {
            hang();
        }
        0.0
    }

    fn counts(&mut self) -> Counts {
        Counts { pedal: 500, plate: 500, speed: 0, lines: 1 }
    }

    fn throttle(&mut self, _compare: u16, cap: f32) {
        CAP.store(cap > 0.5, Relaxed);
    }

    fn feed_watchdog(&mut self) {
        board::feed_watchdog();
    }
}

fn outputs() -> [u8; 2] {
    [&CLOSED, &CAP].map(|output| u8::from(output.load(Relaxed)))
}

fn currents_interrupt() {
    board::clear_timer(0);
    // SAFETY: only this interrupt uses it; nothing writes the drive after main.
    if let (Some(state), Some(drive)) = unsafe { (FAST.of(), DRIVE.of()) } {
        // SAFETY: this is the interrupt.
        unsafe { current_interrupt(state, drive, &BETWEEN, &mut Still) };
    }
    match (HANG.load(Relaxed), SAMPLED.load(Relaxed)) {
        (3, RUN_PERIODS) => board::stop_timer(0),
        (0, sampled) if sampled == 2 * RUN_PERIODS => DONE.store(true, Relaxed),
        _ => {}
    }
}

fn references_interrupt() {
    board::clear_timer(1);
    // SAFETY: only this interrupt uses it; nothing writes the drive after main.
    if let (Some(state), Some(drive)) = unsafe { (SLOW.of(), DRIVE.of()) } {
        // SAFETY: this is the interrupt.
        unsafe { reference_interrupt(state, drive, &BETWEEN, &mut Still) };
    }
}

#[exception]
unsafe fn DefaultHandler(number: i16) {
    match board::TIMERS.iter().position(|timer| *timer == number) {
        Some(0) => currents_interrupt(),
        Some(_) => references_interrupt(),
        None => exit(debug::EXIT_FAILURE),
    }
}

/// The watchdog's first alarm. The watchdog continues to count, and then resets the board.
#[exception]
unsafe fn NonMaskableInt() -> ! {
    let ([closed, cap], sampled) = (outputs(), SAMPLED.load(Relaxed));
    hprintln!("alarm: closed {} cap {} sampled {}", closed, cap, sampled);
    safe_state(&mut Still, &mut Still);
    let [closed, cap] = outputs();
    hprintln!("safe: closed {} cap {}", closed, cap);
    LEFT_BY_ALARM.store(SAYS_ALARM, Relaxed);
    hang();
}

/// The last character of the emulator's command line as a number.
fn asked() -> u32 {
    let mut line = [0u8; 80];
    let mut block = [line.as_mut_ptr() as usize, line.len()];
    // SAFETY: the operation writes a text that ends in 0 to the address in the first word, and its length without the 0 to the second word.
    let failed = unsafe { syscall1(nr::GET_CMDLINE, block.as_mut_ptr() as usize) };
    let last = line.get(block[1].wrapping_sub(1)).filter(|_| failed == 0);
    last.map_or(u32::MAX, |digit| u32::from(digit.wrapping_sub(b'0')))
}

#[entry]
fn main() -> ! {
    if LEFT_BY_ALARM.load(Relaxed) == SAYS_ALARM {
        safe_state(&mut Still, &mut Still);
        let ([closed, cap], sampled) = (outputs(), SAMPLED.load(Relaxed));
        hprintln!("reset by the watchdog: closed {} cap {} sampled {}", closed, cap, sampled);
        exit(debug::EXIT_SUCCESS);
    }
    HANG.store(asked(), Relaxed);
    // SAFETY: no interrupt is enabled yet.
    unsafe {
        *DRIVE.of() = Some(nominal::drive());
        *FAST.of() = Some(CurrentState::default());
        *SLOW.of() = Some(Slow::default());
    }
    board::start_watchdog(3 * board::TICKS_A_SECOND / 1000);
    board::start_timer(0, 0x40, PERIOD_TICKS, PERIOD_TICKS);
    board::start_timer(1, 0x80, PERIOD_TICKS * PERIODS, PERIOD_TICKS * PERIODS);
    while !DONE.load(Relaxed) {}
    hprintln!("no alarm in {} periods: closed {}", SAMPLED.load(Relaxed), outputs()[0]);
    exit(debug::EXIT_SUCCESS)
}

fn exit(status: debug::ExitStatus) -> ! {
    debug::exit(status);
    loop {}
}

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    exit(debug::EXIT_FAILURE)
}

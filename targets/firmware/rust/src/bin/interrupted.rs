//! The interrupt of the references, interrupted by that of the currents at every instruction: `../../../programs/interrupted.c` in Rust.
//!
//! In each trial the same state is restored, a timer is set one tick later than in the trial before, and the outer interrupt runs. At any time of the
//! interruption, the inner interrupt must have the result with the references before the outer step, or with those after it. The outer interrupt must
//! have the result with the samples before or after the inner step. Under `-icount shift=6` an instruction takes 64 ns and a tick 40 ns, so every
//! instruction is tested.
//!
//! Out: a line "at ADDRESS" for every address at which the outer interrupt was interrupted, then the counts, the floating-point context, and bytes of
//! stack.
#![no_std]
#![no_main]

use core::arch::naked_asm;
use core::hint::black_box;
use core::panic::PanicInfo;
use core::sync::atomic::{AtomicU8, AtomicU32, Ordering::Relaxed};

use cortex_m_rt::entry;
use cortex_m_semihosting::{debug, hprintln};
use firmware::image::{Between, Bridge, Driver, PERIODS, Slow, current_interrupt, reference_interrupt};
use firmware::own::Own;
use firmware::{board, nominal, stack};
use motor_loop::{Command, CurrentState, Direction, Drive, Measured};
use throttle_loop::raw::Counts;

/// The test ends after this many trials without an interruption; and the largest address of the code.
const QUIET: u32 = 64;
const CODE: usize = 0x4_0000;
/// Periods before the trials.
const BEFORE: u32 = 40;

/// The whole state of both interrupts.
struct Image {
    fast: CurrentState,
    slow: Slow,
    between: Between,
}

/// Constant samples and a constant demand of a board.
#[derive(Clone, Copy)]
struct Held {
    measured: Measured,
    torque_nm: f32,
}

impl Bridge for Held {
    fn sample(&mut self) -> Measured {
        self.measured
    }

    fn command(&mut self, _: &Command) {}
}

impl Driver for Held {
    fn torque_demand_nm(&mut self) -> f32 {
        self.torque_nm
    }

    fn counts(&mut self) -> Counts {
        Counts { pedal: 2000, plate: 1000, speed: 800, lines: 2 }
    }

    fn throttle(&mut self, compare: u16, cap: f32) {
        black_box((compare, cap));
    }

    fn feed_watchdog(&mut self) {
        board::feed_watchdog();
    }
}

/// The data that the inner interrupt uses: its state, and the two states that are right after a trial.
struct Inner {
    state: CurrentState,
    after: [CurrentState; 2],
    drive: Drive,
    held: Held,
}

static INNER: Own<Option<Inner>> = Own::new(None);
static BETWEEN: Between = Between::new();
static MARKED: [AtomicU8; CODE / 2] = [const { AtomicU8::new(0) }; CODE / 2];
static HITS: AtomicU32 = AtomicU32::new(0);
static FOLLOWED: [AtomicU32; 2] = [AtomicU32::new(0), AtomicU32::new(0)];
static WRONG: AtomicU32 = AtomicU32::new(0);
static EXTENDED: AtomicU32 = AtomicU32::new(0);

fn add(count: &AtomicU32, one: bool) {
    count.store(count.load(Relaxed) + u32::from(one), Relaxed);
}

/// The words of a state, which consists of numbers of four bytes without padding.
fn words<T>(state: &T) -> &[u32] {
    // SAFETY: the words are valid as long as the state, aligned like its numbers, and all initialised.
    unsafe { core::slice::from_raw_parts((&raw const *state).cast(), size_of::<T>() / 4) }
}

fn is_same<T>(left: &T, right: &T) -> bool {
    words(left) == words(right)
}

/// The inner interrupt, with the registers that the core stacked.
///
/// # Safety
/// Only the entry below may call it.
unsafe extern "C" fn interrupted_at(frame: *const u32, exc_return: u32) {
    board::stop_timer(0);
    board::clear_timer(0);
    // SAFETY: the core has stacked eight words; the seventh is the return address.
    let address = unsafe { *frame.add(6) } as usize;
    // SAFETY: while the timer counts, nothing else uses it.
    if let Some(Inner { state, after, drive, held }) = unsafe { INNER.of() } {
        // SAFETY: this is the interrupt.
        unsafe { current_interrupt(state, drive, &BETWEEN, held) };
        let which = after.iter().position(|after| is_same(after, state));
        if let Some(which) = which {
            add(&FOLLOWED[which], true);
        }
        add(&WRONG, which.is_none());
    }
    add(&HITS, true);
    // Armv7-M, B1.5.8: bit 4 is 0 if the frame has space for the floating-point registers.
    add(&EXTENDED, exc_return & 0x10 == 0);
    if let Some(mark) = MARKED.get(address / 2) {
        mark.store(1, Relaxed);
    }
}

/// The handler of every interrupt; only the timer's interrupt is enabled.
#[unsafe(naked)]
#[unsafe(no_mangle)]
unsafe extern "C" fn DefaultHandler() {
    naked_asm!("mov r0, sp", "mov r1, lr", "b {}", sym interrupted_at)
}

/// Angle and currents as the inner step expects them.
fn as_expected(state: &CurrentState, speed_rad_s: f32, bus_voltage_v: f32) -> Measured {
    let (d, q) = (state.expected_d_a, state.expected_q_a);
    let currents_a = [0.0, 1.0, 2.0].map(|k| {
        let Direction { cos, sin } = Direction::of_turns(state.angle_turns - k * (1.0 / 3.0));
        d * cos - q * sin
    });
    Measured { currents_a, angle_turns: state.angle_turns, speed_rad_s, bus_voltage_v }
}

/// Restores the whole state of the interrupts.
///
/// # Safety
/// The timer is stopped.
unsafe fn put_back(start: &Image) {
    // SAFETY: the shared data have no references to other data, and all of them may be written through a shared reference.
    unsafe { core::ptr::copy_nonoverlapping(&raw const start.between, (&raw const BETWEEN).cast_mut(), 1) };
    // SAFETY: see above.
    if let Some(inner) = unsafe { INNER.of() } {
        inner.state = start.fast.clone();
    }
}

fn inner(state: &mut CurrentState, drive: &Drive, held: &mut Held) {
    // SAFETY: no interrupt is enabled.
    unsafe { current_interrupt(state, drive, &BETWEEN, held) };
}

fn outer(state: &mut Slow, drive: &Drive, held: &mut Held) {
    // SAFETY: this is the only caller; an interrupt that interrupts it reads the shared data only through their handovers.
    unsafe { reference_interrupt(state, drive, &BETWEEN, held) };
}

#[entry]
fn main() -> ! {
    let drive = nominal::drive();
    let (mut fast, mut slow) = (CurrentState::default(), Slow::default());
    let mut held = Held { measured: as_expected(&fast, 600.0, 270.0), torque_nm: 9.0 };
    for k in 0..BEFORE {
        held.measured = as_expected(&fast, 600.0, 270.0);
        inner(&mut fast, &drive, &mut held);
        if k % PERIODS == PERIODS - 1 {
            outer(&mut slow, &drive, &mut held);
        }
    }
    // Samples and a demand that change all values that are handed over.
    held = Held { measured: as_expected(&fast, 620.0, 281.0), torque_nm: -4.0 };
    // SAFETY: the data have no references to other data, and no interrupt is enabled.
    let mut start = Image { fast, slow, between: unsafe { core::ptr::read(&BETWEEN) } };
    // Without interruption: the outer interrupt first, then the inner one first.
    let (mut fast, mut slow) = (start.fast.clone(), start.slow.clone());
    outer(&mut slow, &drive, &mut held);
    inner(&mut fast, &drive, &mut held);
    let (outer_first, inner_second) = (slow, fast);
    // SAFETY: no interrupt is enabled.
    unsafe { put_back(&start) };
    let (mut fast, mut slow) = (start.fast.clone(), start.slow.clone());
    inner(&mut fast, &drive, &mut held);
    outer(&mut slow, &drive, &mut held);
    let (outer_after, after) = ([outer_first, slow], [fast, inner_second]);
    let differ = [!is_same(&after[0], &after[1]), !is_same(&outer_after[0].references, &outer_after[1].references)];
    hprintln!("handed over: {} {}", u8::from(differ[0]), u8::from(differ[1]));

    // SAFETY: no interrupt is enabled.
    unsafe { *INNER.of() = Some(Inner { state: start.fast.clone(), after, drive, held }) };
    let mut trials = 0u32;
    let top = stack::paint();
    // Without and with a watchdog that must be fed.
    for periods_before in [BEFORE, BEFORE - PERIODS] {
        start.slow.periods_before = periods_before;
        let (mut ticks, mut quiet) = (1, 0);
        while quiet < QUIET {
            let hits = HITS.load(Relaxed);
            let mut slow = start.slow.clone();
            // SAFETY: the timer is stopped.
            unsafe { put_back(&start) };
            board::start_timer(0, 0x40, ticks, u32::MAX);
            outer(&mut slow, &drive, &mut held);
            board::stop_timer(0);
            board::clear_timer(0);
            add(&WRONG, !outer_after.iter().any(|after| is_same(&after.references, &slow.references)));
            add(&WRONG, !is_same(&outer_after[0].throttle, &slow.throttle));
            trials += 1;
            quiet = if HITS.load(Relaxed) == hits { quiet + 1 } else { 0 };
            ticks += 1;
        }
    }
    let stack = stack::used(top);
    for (k, _) in MARKED.iter().enumerate().filter(|(_, mark)| mark.load(Relaxed) != 0) {
        hprintln!("at {:x}", 2 * k);
    }
    let [hits, wrong, extended] = [&HITS, &WRONG, &EXTENDED].map(|count| count.load(Relaxed));
    let [before, after] = [&FOLLOWED[0], &FOLLOWED[1]].map(|count| count.load(Relaxed));
    hprintln!(
        "trials {} hits {} before {} after {} wrong {} extended {} fpccr {:08x} stack {}",
        trials,
        hits,
        before,
        after,
        wrong,
        extended,
        board::fpccr(),
        stack
    );
    debug::exit(debug::EXIT_SUCCESS);
    loop {}
}

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    debug::exit(debug::EXIT_FAILURE);
    loop {}
}

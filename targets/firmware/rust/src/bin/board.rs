//! The processor in the loop: `../../../programs/board.c` in Rust. The image on the emulated board, with its timers and priorities, runs against the
//! same plants as code.
//!
//! `RSM_RIG_PLANTS` is the folder with `rig_motor.rs` and `rig_car.rs`, written by `rsm emit --lang rust --step`. Out: the same lines as `board.c`.
#![no_std]
#![no_main]

use core::panic::PanicInfo;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use cortex_m_rt::{entry, exception};
use cortex_m_semihosting::{debug, hprint, hprintln};
use firmware::image::{Between, Bridge, Driver, PERIODS, Slow, current_interrupt, reference_interrupt};
use firmware::own::Own;
use firmware::{board, nominal};
use motor_loop::{Command, CurrentState, Drive, Measured};
use throttle_loop::raw::Counts;

mod rig_motor {
    include!(concat!(env!("RSM_RIG_PLANTS"), "/rig_motor.rs"));
}
mod rig_car {
    include!(concat!(env!("RSM_RIG_PLANTS"), "/rig_car.rs"));
}

const ROWS: usize = 600;
const CAR_ROWS: usize = ROWS / PERIODS as usize;
const CAR_STEPS: usize = 10;
const PERIOD_TICKS: u32 = board::TICKS_A_SECOND / 10_000;

/// The motor's plant, in place of converters and power stage: it advances when the firmware samples.
struct MotorRig {
    plant: rig_motor::State,
    duties: [f64; 3],
    next_duties: [f64; 3],
    rows: [[f64; 8]; ROWS],
    sampled: usize,
}

impl Bridge for MotorRig {
    fn sample(&mut self) -> Measured {
        self.duties = self.next_duties;
        let [a, b, c] = self.duties;
        let shown = rig_motor::step(&mut self.plant, a, b, c);
        self.rows[self.sampled] = [a, b, c, shown.current_a, shown.current_b, shown.current_c, shown.turns, shown.speed];
        self.sampled += 1;
        Measured {
            currents_a: [shown.current_a as f32, shown.current_b as f32, shown.current_c as f32],
            angle_turns: shown.turns as f32,
            speed_rad_s: shown.speed as f32,
            bus_voltage_v: 270.0,
        }
    }

    fn command(&mut self, command: &Command) {
        self.next_duties = command.duties.map(|duty| if command.closed > 0.5 { f64::from(duty) } else { 0.5 });
    }
}

/// The car's plant, in the same way.
struct CarRig {
    plant: rig_car::State,
    throttle: f64,
    next_throttle: f64,
    compare: u16,
    rows: [[f64; 4]; CAR_ROWS],
    counted: usize,
}

impl Driver for CarRig {
    fn torque_demand_nm(&mut self) -> f32 {
        if self.counted < 30 { 6.0 } else { -4.0 }
    }

    fn counts(&mut self) -> Counts {
        if self.counted > 0 {
            for _ in 1..CAR_STEPS {
                rig_car::step(&mut self.plant, self.throttle);
            }
        }
        self.throttle = self.next_throttle;
        let shown = rig_car::step(&mut self.plant, self.throttle);
        let counts = Counts {
            // 12 bits for 60 m/s; the pedal from 20 % to 80 %; the plate at its commanded position; first gear.
            speed: (shown.road_speed * (4095.0 / 60.0) + 0.5) as u16,
            pedal: if self.counted < 20 { 1065 } else { 3030 },
            plate: ((u32::from(self.compare) - 180) * 3276 / 3240 + 410) as u16,
            lines: 1,
        };
        if let Some(row) = self.rows.get_mut(self.counted) {
            *row = [self.throttle, shown.engine_speed, shown.road_speed, shown.acceleration];
        }
        self.counted += 1;
        counts
    }

    fn throttle(&mut self, compare: u16, _cap: f32) {
        self.compare = compare;
        self.next_throttle = f64::from(compare - 180) / 3240.0;
    }

    fn feed_watchdog(&mut self) {
        board::feed_watchdog();
    }
}

/// The data that an interrupt owns: its state and its plant.
struct Fast(CurrentState, MotorRig);
struct Late(Slow, CarRig);

static DRIVE: Own<Option<Drive>> = Own::new(None);
static FAST: Own<Option<Fast>> = Own::new(None);
static LATE: Own<Option<Late>> = Own::new(None);
static BETWEEN: Between = Between::new();
static DONE: AtomicBool = AtomicBool::new(false);
static IN_REFERENCES: AtomicBool = AtomicBool::new(false);
static PREEMPTED: AtomicU32 = AtomicU32::new(0);
static LOST: AtomicU32 = AtomicU32::new(0);

fn currents_interrupt() {
    board::clear_timer(0);
    if IN_REFERENCES.load(Ordering::Relaxed) {
        PREEMPTED.store(PREEMPTED.load(Ordering::Relaxed) + 1, Ordering::Relaxed);
    }
    // SAFETY: only this interrupt uses it; nothing writes the drive after main.
    let (fast, drive) = unsafe { (FAST.of(), DRIVE.of()) };
    if let (Some(Fast(state, rig)), Some(drive)) = (fast, drive)
        && rig.sampled < ROWS
    {
        // SAFETY: this is the interrupt.
        unsafe { current_interrupt(state, drive, &BETWEEN, rig) };
    } else {
        DONE.store(true, Ordering::Relaxed);
    }
    count_lost(0);
}

fn references_interrupt() {
    board::clear_timer(1);
    IN_REFERENCES.store(true, Ordering::Relaxed);
    // SAFETY: only this interrupt uses it; nothing writes the drive after main.
    let (late, drive) = unsafe { (LATE.of(), DRIVE.of()) };
    if let (Some(Late(state, rig)), Some(drive), false) = (late, drive, DONE.load(Ordering::Relaxed)) {
        // SAFETY: this is the interrupt.
        unsafe { reference_interrupt(state, drive, &BETWEEN, rig) };
    }
    IN_REFERENCES.store(false, Ordering::Relaxed);
    count_lost(1);
}

/// Counts a request that is already pending: the interrupt took longer than its period.
fn count_lost(timer: usize) {
    if board::asks_again(timer) {
        LOST.store(LOST.load(Ordering::Relaxed) + 1, Ordering::Relaxed);
    }
}

#[exception]
unsafe fn DefaultHandler(number: i16) {
    match board::TIMERS.iter().position(|timer| *timer == number) {
        Some(0) => currents_interrupt(),
        Some(_) => references_interrupt(),
        None => fail(),
    }
}

/// The watchdog's alarm. Here it would be a fault.
#[exception]
unsafe fn NonMaskableInt() {
    fail();
}

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    fail()
}

fn fail() -> ! {
    debug::exit(debug::EXIT_FAILURE);
    loop {}
}

fn print(name: &str, row: &[f64]) {
    hprint!("{}", name);
    for value in row {
        hprint!(" {:016x}", value.to_bits());
    }
    hprintln!();
}

#[entry]
fn main() -> ! {
    let half = [0.5; 3];
    // SAFETY: no interrupt is enabled yet.
    unsafe {
        *DRIVE.of() = Some(nominal::drive());
        let motor = MotorRig { plant: rig_motor::init(), duties: half, next_duties: half, rows: [[0.0; 8]; ROWS], sampled: 0 };
        *FAST.of() = Some(Fast(CurrentState::default(), motor));
        let car = CarRig {
            plant: rig_car::init(),
            throttle: 0.2,
            next_throttle: 0.2,
            compare: 828,
            rows: [[0.0; 4]; CAR_ROWS],
            counted: 0,
        };
        *LATE.of() = Some(Late(Slow::default(), car));
    }
    board::start_watchdog(3 * board::TICKS_A_SECOND / 1000);
    board::start_timer(0, 0x40, PERIOD_TICKS - 1, PERIOD_TICKS);
    board::start_timer(1, 0x80, PERIOD_TICKS, PERIOD_TICKS * PERIODS);
    while !DONE.load(Ordering::Relaxed) {}
    board::stop_timer(0);
    board::stop_timer(1);
    board::stop_watchdog();
    // SAFETY: the timers are stopped, so no interrupt uses these data any more.
    if let (Some(Fast(_, motor)), Some(Late(_, car))) = unsafe { (FAST.of(), LATE.of()) } {
        motor.rows.iter().for_each(|row| print("motor", row));
        car.rows.iter().for_each(|row| print("car", row));
    }
    let (preempted, lost) = (PREEMPTED.load(Ordering::Relaxed), LOST.load(Ordering::Relaxed));
    hprintln!("board preempted {} lost {} fpccr {:08x}", preempted, lost, board::fpccr());
    debug::exit(debug::EXIT_SUCCESS);
    loop {}
}

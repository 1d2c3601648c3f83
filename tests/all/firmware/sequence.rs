//! The sequence of `targets/firmware/programs/bits.c` through the Rust steps, and the lines that the program is to print.

use motor_loop::{CurrentState, Demand, Drive, Measured, ReferenceState, currents, references};
use throttle_loop::raw::{Counts, RawState, Scaling, raw_step};
use throttle_loop::{Inputs, State, step};

const TICKS: u32 = 65536;
const TICKS_A_LINE: u32 = 2048;

/// Numbers, the hash, and the lines so far.
struct Run {
    random: u32,
    hash: u32,
    lines: Vec<String>,
}

impl Run {
    /// Marsaglia's xorshift.
    fn next(&mut self) -> u32 {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 17;
        self.random ^= self.random << 5;
        self.random
    }

    fn number(&mut self, low: f32, span: f32) -> f32 {
        let kind = self.next() & 31;
        let bits = self.next();
        if kind == 0 {
            return f32::from_bits(bits);
        }
        low + (bits >> 8) as f32 / 16_777_216.0 * span
    }

    /// FNV-1a by words.
    fn word(&mut self, word: u32) {
        self.hash = (self.hash ^ word).wrapping_mul(16777619);
    }

    fn floats(&mut self, values: &[f32]) {
        for value in values {
            self.word(value.to_bits());
        }
    }

    fn line(&mut self, name: &str, tick: u32) {
        if (tick + 1).is_multiple_of(TICKS_A_LINE) {
            self.lines.push(format!("{name} {} {:08x}", tick + 1, self.hash));
        }
    }

    fn motor(&mut self, drive: &Drive) {
        let (mut outer, mut inner) = (ReferenceState::default(), CurrentState::default());
        for tick in 0..TICKS {
            if tick % 10 == 0 {
                let torque_nm = self.number(-25.0, 50.0);
                let speed_rad_s = self.number(-850.0, 1700.0);
                let bus_voltage_v = self.number(200.0, 100.0);
                let wanted = references(&mut outer, drive, &Demand { torque_nm, speed_rad_s, bus_voltage_v });
                self.floats(&[wanted.i_d_a, wanted.i_q_a, wanted.resistive_d_v, wanted.resistive_q_v]);
            }
            let currents_a = [(); 3].map(|()| self.number(-70.0, 140.0));
            let angle_turns = self.number(-2.0, 5.0);
            let speed_rad_s = self.number(-850.0, 1700.0);
            let bus_voltage_v = self.number(200.0, 100.0);
            let measured = Measured { currents_a, angle_turns, speed_rad_s, bus_voltage_v };
            let duties = currents(&mut inner, drive, &outer.last, &measured);
            self.floats(&[inner.integral_d_v, inner.integral_q_v]);
            self.floats(&duties);
            self.word(outer.bad.all);
            self.word(inner.bad.all);
            self.word(inner.bad.in_a_row);
            self.line("motor", tick);
        }
        // The hard numbers were among them, and were no more than that.
        assert!(inner.bad.all > TICKS / 1000 && inner.bad.all < TICKS / 20, "{inner:?}");
    }

    fn throttle(&mut self) {
        let mut state = State::default();
        let (mut gear, mut clutch) = (0, false);
        let mut full = 0;
        for tick in 0..TICKS {
            let pedal = self.number(-0.1, 1.2);
            let speed_m_s = self.number(0.0, 40.0);
            if self.next() & 255 == 0 {
                gear = (self.next() & 7) as u8;
                clutch = self.next() & 1 == 1;
            }
            let outputs = step(&mut state, &Inputs { pedal, speed_m_s, gear, clutch });
            full += u32::from(outputs.share > 0.5);
            self.floats(&[outputs.throttle, outputs.share]);
            self.word(state.bad.all);
            self.word(state.bad.in_a_row);
            self.line("throttle", tick);
        }
        assert!(full > TICKS / 20, "the compensator was hardly ever in the throttle: {full} ticks of {TICKS}");
    }

    fn raw(&mut self) {
        let mut state = RawState::default();
        let mut lines = 0;
        for tick in 0..TICKS {
            let wide = if self.next() & 31 == 0 { 0xFFFF } else { 0xFFF };
            let [pedal, plate, speed] = [(); 3].map(|()| (self.next() & wide) as u16);
            if self.next() & 255 == 0 {
                let one = 1 << (self.next() % 6);
                let any = self.next();
                lines = if self.next() & 3 != 0 { one } else { any };
            }
            let compare = raw_step(&mut state, &Scaling::BOARD, &Counts { pedal, plate, speed, lines });
            self.word(u32::from(compare));
            self.word(state.step.bad.all);
            self.word(state.plate.all);
            self.word(state.plate.in_a_row);
            self.line("raw", tick);
        }
    }
}

/// The lines that the program is to print.
pub fn lines(drive: &Drive) -> Vec<String> {
    let mut run = Run { random: 0x2545_F491, hash: 2_166_136_261, lines: vec![] };
    run.motor(drive);
    run.throttle();
    run.raw();
    run.lines
}

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

    /// A number that stays what it is nearly always, and then moves by up to half of `span` either way, or is any bit pattern for one sample.
    fn wander(&mut self, held: &mut f32, low: f32, high: f32, span: f32) -> f32 {
        let kind = self.next() & 255;
        let bits = self.next();
        if kind == 0 {
            return f32::from_bits(bits);
        }
        *held = (*held + ((bits >> 8) as f32 / 16_777_216.0 - 0.5) * span).clamp(low, high);
        *held
    }

    fn motor(&mut self, drive: &Drive) {
        let (mut outer, mut inner) = (ReferenceState::default(), CurrentState::default());
        let (mut torque, mut wide_speed, mut speed, mut bus, mut angle) = (0.0, 0.0, 0.0, 270.0, 0.0);
        let (mut any_currents, mut open) = (false, 0);
        for tick in 0..TICKS {
            if tick % 10 == 0 {
                let torque_nm = self.wander(&mut torque, -30.0, 30.0, 10.0);
                let speed_rad_s = self.wander(&mut wide_speed, -1050.0, 1050.0, 60.0);
                let bus_voltage_v = self.wander(&mut bus, 140.0, 370.0, 20.0);
                let voltage_share = self.number(0.0, 1.3);
                let wanted = references(&mut outer, drive, &Demand { torque_nm, speed_rad_s, bus_voltage_v, voltage_share });
                self.floats(&[wanted.i_d_a, wanted.i_q_a, outer.trim_a, outer.speed_rad_s]);
            }
            if tick % 64 == 0 {
                // Now and then anything, else what the model expects.
                any_currents = self.next() & 15 == 0;
            }
            // Any vector of up to 40 A; or the expected one and a little beside it: so the bridge stays closed.
            let currents_a = if any_currents {
                [(); 3].map(|()| self.number(-40.0, 80.0))
            } else {
                let beside = inner.expected_d_a + self.number(-1.0, 2.0);
                let b = 0.866_025_4 * inner.expected_q_a - 0.5 * inner.expected_d_a;
                [beside, b, -b - inner.expected_d_a]
            };
            let speed_rad_s = self.wander(&mut speed, -30.0, 30.0, 4.0);
            let bus_voltage_v = self.wander(&mut bus, 140.0, 370.0, 4.0);
            let angle_turns = self.wander(&mut angle, -0.02, 0.02, 0.004);
            let measured = Measured { currents_a, angle_turns, speed_rad_s, bus_voltage_v };
            let command = currents(&mut inner, drive, &outer.last, &measured);
            self.floats(&[inner.integral_d_v, inner.integral_q_v, inner.expected_d_a, inner.voltage_share]);
            self.floats(&command.duties);
            self.floats(&[command.closed]);
            open += u32::from(command.closed < 0.5);
            self.word(open);
            self.word(outer.bad.all);
            self.word(inner.bad.all);
            self.word(inner.bad.in_a_row);
            self.line("motor", tick);
        }
        // Closed and open, good and bad, all of them often.
        assert!(open > TICKS / 100 && open < TICKS / 2, "open in {open} of {TICKS}");
        assert!(inner.bad.all > TICKS / 100 && inner.bad.all < TICKS / 2, "{inner:?}");
        assert!(outer.bad.all > TICKS / 2000, "{outer:?}");
    }

    fn throttle(&mut self) {
        let mut state = State::default();
        let (mut gear, mut clutch, mut torn) = (0, false, false);
        let mut speed = 10.0;
        let (mut full, mut closed) = (0, 0);
        for tick in 0..TICKS {
            let mut pedal = self.number(-0.1, 1.2);
            let speed_m_s = self.wander(&mut speed, 0.0, 40.0, 2.5);
            if self.next() & 255 == 0 {
                gear = (self.next() & 7) as u8;
                clutch = self.next() & 1 == 1;
                torn = self.next() & 7 == 0;
            }
            if torn {
                pedal = 3.0;
            }
            let outputs = step(&mut state, &Inputs { pedal, speed_m_s, gear, clutch });
            full += u32::from(outputs.share > 0.5);
            closed += u32::from(state.cap == 0.0);
            self.floats(&[outputs.throttle, outputs.share, state.cap]);
            self.word(state.bad.all);
            self.word(state.bad.in_a_row);
            self.line("throttle", tick);
        }
        assert!(full > TICKS / 20, "the compensator was hardly ever in the throttle: {full} ticks of {TICKS}");
        assert!(closed > TICKS / 100 && closed < TICKS / 2, "the throttle was closed in {closed} ticks of {TICKS}");
    }

    fn raw(&mut self) {
        let mut state = RawState::default();
        let (mut lines, mut torn, mut compare) = (0, false, 180);
        let mut closed = 0;
        for tick in 0..TICKS {
            let wide = if self.next() & 31 == 0 { 0xFFFF } else { 0xFFF };
            let [pedal, speed] = [(); 2].map(|()| (self.next() & wide) as u16);
            if self.next() & 255 == 0 {
                let one = 1 << (self.next() % 6);
                let any = self.next();
                lines = if self.next() & 3 != 0 { one } else { any };
                torn = self.next() & 3 == 0;
            }
            let plate = if torn { 0 } else { ((u32::from(compare) - 180) * 3276 / 3240 + 410) as u16 };
            compare = raw_step(&mut state, &Scaling::BOARD, &Counts { pedal, plate, speed, lines });
            self.word(u32::from(compare));
            self.floats(&[state.step.cap]);
            self.word(state.step.bad.all);
            self.word(state.plate.all);
            self.word(state.plate.in_a_row);
            closed += u32::from(state.step.cap < 0.05);
            self.line("raw", tick);
        }
        assert!(closed > TICKS / 1000 && closed < TICKS / 2, "the throttle was closed in {closed} ticks of {TICKS}");
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

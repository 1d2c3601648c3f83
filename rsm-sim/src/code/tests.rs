//! Compares machine code with the interpreter, bit by bit.

use rsm_core::elementary::{self, Function};
use rsm_core::number::{Precision, exact};
use rsm_core::run::Interpreter;
use rsm_core::tape::{Op, Reg, Tape, TapeBuilder};

use super::{Code, Piece, WIDE, Way};

/// Pseudo-random numbers of a linear congruential generator (D. E. Knuth's MMIX).
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        self.0 >> 20
    }

    fn below(&mut self, count: usize) -> usize {
        (self.next() % count as u64) as usize
    }

    /// Any number: all signs and magnitudes, zeros, infinities, NaN.
    fn any(&mut self) -> f64 {
        match self.below(12) {
            0 => 0.0,
            1 => -0.0,
            2 => f64::INFINITY,
            3 => f64::NAN,
            4 => f64::from_bits(self.next() << 20 | self.next()),
            _ => (self.next() as f64 / (1u64 << 43) as f64 - 1.0) * 10.0,
        }
    }
}

/// A tape with every operation, and with operands at near and far distances: more values than the machine has registers.
fn tape(numbers: &mut Numbers, length: usize) -> Tape {
    let mut builder = TapeBuilder::sharing(Precision::F64);
    let mut values: Vec<Reg> = (0..6).map(|port| builder.input(port)).collect();
    values.push(builder.constant(exact(0.75)));
    values.push(builder.constant(exact(-3.0)));
    for _ in 0..length {
        let mut pick = |near: bool| {
            let first = if near { values.len().saturating_sub(5) } else { 0 };
            values[first + numbers.below(values.len() - first)]
        };
        let (a, b, c, d) = (pick(true), pick(false), pick(false), pick(true));
        let value = match numbers.below(13) {
            0 => builder.negate(a),
            1 => builder.absolute(a),
            2 => builder.add(b, c),
            3 => builder.subtract(a, b),
            4 => builder.multiply(b, a),
            5 => builder.divide(a, d),
            6 => builder.push(Op::Exponent(a)),
            7 => builder.push(Op::PowerOfTwo(a)),
            8 | 9 => builder.select_less(a, b, c, d),
            // The smaller and the larger of two numbers.
            10 => builder.select_less(a, c, a, c),
            11 => builder.select_less(c, a, a, c),
            _ => builder.multiply(a, a),
        };
        values.push(value);
    }
    let results: Vec<(String, Reg)> = values.iter().rev().step_by(7).map(|reg| (format!("{reg}"), *reg)).collect();
    let names = (0..6).map(|k| format!("x{k}")).collect();
    builder.finish_with_results("any", names, results, [] as [(String, Reg); 0])
}

fn same(a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan()
}

fn compare<const L: usize>(tape: &Tape, numbers: &mut Numbers, way: Way) -> bool {
    let inputs = tape.inputs.len() as u32;
    let (arguments, results): (Vec<u32>, Vec<u32>) =
        ((0..inputs).collect(), (0..tape.outputs.len() as u32).map(|k| inputs + k).collect());
    let code = Code::new(tape, &arguments, &results, L, way);
    let mut slots = vec![[0.0; L]; inputs as usize + results.len()];
    let mut reference = Interpreter::<f64>::new(tape);
    let mut expected = vec![0.0; results.len()];
    for _ in 0..20 {
        slots[..inputs as usize].iter_mut().for_each(|slot| *slot = std::array::from_fn(|_| numbers.any()));
        code.run(&mut slots, &mut Vec::new());
        for lane in 0..L {
            let at: Vec<f64> = slots[..inputs as usize].iter().map(|slot| slot[lane]).collect();
            reference.eval_all(&at, &mut expected);
            for (k, expected) in expected.iter().enumerate() {
                let found = slots[inputs as usize + k][lane];
                assert!(same(found, *expected), "lane {lane}, result {k}: {found}, expected {expected}\n{tape}");
            }
        }
    }
    code.is_native()
}

#[test]
fn machine_code_and_interpreter_give_the_same_bits_in_every_lane() {
    let mut numbers = Numbers(1);
    for length in (0..400).step_by(3) {
        let tape = tape(&mut numbers, length);
        let native = compare::<1>(&tape, &mut numbers, Way::Fastest) && compare::<WIDE>(&tape, &mut numbers, Way::Fastest);
        assert!(
            !compare::<1>(&tape, &mut numbers, Way::Interpreted) && !compare::<WIDE>(&tape, &mut numbers, Way::Interpreted)
        );
        #[cfg(target_arch = "x86_64")]
        assert_eq!(native, std::arch::is_x86_feature_detected!("avx2"));
        let _ = native;
    }
}

#[test]
fn elementary_functions_keep_their_bits() {
    for function in Function::ALL {
        let mut builder = TapeBuilder::sharing(Precision::F64);
        let arguments: Vec<Reg> = (0..function.arity() as u32).map(|port| builder.input(port)).collect();
        let result = elementary::write(&mut builder, function, &arguments);
        let names = (0..function.arity()).map(|k| format!("x{k}")).collect();
        let tape = builder.finish(function.name(), names, result);
        compare::<1>(&tape, &mut Numbers(2), Way::Fastest);
        compare::<WIDE>(&tape, &mut Numbers(3), Way::Fastest);
    }
}

#[test]
fn pieces_in_sequence_write_the_same_slots_as_the_interpreter() {
    // More numbers and slots than a short displacement reaches: 127/8 and 127/32.
    const SLOTS: usize = 300;
    let mut numbers = Numbers(4);
    for length in (0..200).step_by(9) {
        let tape = tape(&mut numbers, length);
        let results: Vec<u32> = (0..tape.outputs.len() as u32).map(|k| 100 + k).collect();
        let mut pairs = |count: usize, most: usize| -> Vec<(usize, usize)> {
            (0..count).map(|_| (numbers.below(most), numbers.below(SLOTS))).collect()
        };
        let (spread, first, last) = (pairs(40, 50), pairs(30, SLOTS), pairs(30, SLOTS));
        let pieces = || {
            let arguments: Vec<u32> = (0..tape.inputs.len() as u32).collect();
            let all = [Piece::Spread(spread.clone()), Piece::Copy(first.clone()), Piece::tape(&tape, &arguments, &results)];
            all.into_iter().chain([Piece::Copy(last.clone()), Piece::tape(&tape, &arguments, &results)]).collect()
        };
        let given: Vec<f64> = (0..50).map(|_| numbers.any()).collect();
        let begin: Vec<[f64; WIDE]> = (0..SLOTS).map(|_| std::array::from_fn(|_| numbers.any())).collect();
        let [found, expected] = [Way::Fastest, Way::Interpreted].map(|way| {
            let mut slots = begin.clone();
            Code::of(pieces(), WIDE, way).run_with(&given, &mut slots, &mut Vec::new());
            slots
        });
        for (place, (found, expected)) in found.as_flattened().iter().zip(expected.as_flattened()).enumerate() {
            assert!(same(*found, *expected), "slot {}, lane {}: {found}, expected {expected}", place / WIDE, place % WIDE);
        }
    }
}

#[test]
#[should_panic(expected = "another shape")]
fn pieces_refuse_an_array_that_is_too_short() {
    let code = Code::of(vec![Piece::Spread(vec![(3, 0)])], WIDE, Way::Fastest);
    code.run_with(&[1.0; 3], &mut [[0.0; WIDE]], &mut Vec::new());
}

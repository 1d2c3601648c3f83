//! Tests with random tapes over random boxes, and a search for those that come closest to their bound.

use super::*;

/// A tape that can be changed in small steps: it is made from random numbers, and every random number is valid.
#[derive(Clone)]
struct Plan {
    precision: Precision,
    ranges: Vec<[f64; 2]>,
    /// Values, and their differences from the numbers that they represent.
    constants: Vec<[f64; 2]>,
    /// Whether constants may represent other numbers.
    may_be_off: bool,
    /// An operation, and the numbers that select its operands.
    steps: Vec<[usize; 4]>,
}

impl Plan {
    fn any(random: &mut Random, precision: Precision, may_be_off: bool) -> Plan {
        let mut plan = Plan { precision, ranges: vec![], constants: vec![], may_be_off, steps: vec![] };
        plan.ranges = (0..1 + random.below(3)).map(|_| plan.any_range(random)).collect();
        plan.constants = (0..2 + random.below(3)).map(|_| plan.any_constant(random)).collect();
        plan.steps = (0..2 + random.below(6)).map(|_| any_step(random)).collect();
        plan
    }

    fn any_range(&self, random: &mut Random) -> [f64; 2] {
        let low = random.between(-4.0, 4.0) * power_of_two(random.below(12) as i64 - 6);
        let high = low + random.between(0.0, 3.0) * power_of_two(random.below(10) as i64 - 6);
        crate::adversary::inside(self.precision, [low, high])
    }

    fn any_constant(&self, random: &mut Random) -> [f64; 2] {
        let value = f64::from(random.between(-3.0, 3.0) as f32);
        let by = random.pick(&[0.0, 0.0, value * 1e-9, value / 64.0, -value / 512.0]);
        [value, if self.may_be_off { by } else { 0.0 }]
    }

    /// Another range, constant or step, or a step with another operand.
    fn changed(&self, random: &mut Random) -> Plan {
        let mut plan = self.clone();
        match random.below(4) {
            0 => {
                let k = random.below(plan.ranges.len());
                plan.ranges[k] = plan.any_range(random);
            }
            1 => {
                let k = random.below(plan.constants.len());
                plan.constants[k] = plan.any_constant(random);
            }
            2 => {
                let k = random.below(plan.steps.len());
                plan.steps[k] = any_step(random);
            }
            _ => {
                let k = random.below(plan.steps.len());
                plan.steps[k][1 + random.below(3)] = random.below(1000);
            }
        }
        plan
    }

    fn tape(&self) -> Tape {
        write_tape(self.precision, self.ranges.len(), |builder, x| {
            let mut registers = x.to_vec();
            registers.extend(self.constants.iter().map(|[value, by]| off(builder, *value, *by)));
            for [kind, a, b, c] in &self.steps {
                let any = |k: usize| registers[k % registers.len()];
                // Late registers are selected more often, so that the tape has long chains.
                let (a, b) = (any(*a), if b % 2 == 0 { registers[registers.len() - 1] } else { any(b / 2) });
                let made = match kind {
                    0 | 1 => builder.push(Op::Add(a, b)),
                    2 | 3 => builder.push(Op::Subtract(a, b)),
                    4..=6 => builder.push(Op::Multiply(a, b)),
                    7 => builder.push(Op::Divide(a, b)),
                    8 => builder.push(Op::Negate(b)),
                    9 => builder.push(Op::Absolute(b)),
                    10 => builder.at_least(b, a),
                    11 => builder.at_most(b, a),
                    _ => {
                        let condition = builder.push(Op::Less(x[c % x.len()], any(c / 3)));
                        builder.push(Op::Select { condition, then: a, otherwise: b })
                    }
                };
                registers.push(made);
            }
            registers[registers.len() - 1]
        })
    }
}

fn any_step(random: &mut Random) -> [usize; 4] {
    [random.below(13), random.below(1000), random.below(1000), random.below(1000)]
}

/// The registers on which the result depends.
fn live(tape: &Tape) -> Vec<bool> {
    let mut live = vec![false; tape.ops.len()];
    live[tape.output().0 as usize] = true;
    for k in (0..live.len()).rev() {
        if live[k] {
            tape.ops[k].operands().iter().for_each(|operand| live[operand.0 as usize] = true);
        }
    }
    live
}

/// Whether the result depends on every quotient: in rational arithmetic a tape has no value if any divisor is zero.
fn divides_to_the_end(tape: &Tape) -> bool {
    tape.ops.iter().zip(live(tape)).all(|(op, is_live)| is_live || !matches!(op, Op::Divide(..)))
}

/// The number of sums, products and quotients on which the result depends.
fn roundings(tape: &Tape) -> usize {
    let rounds = |op: &Op| matches!(op, Op::Add(..) | Op::Subtract(..) | Op::Multiply(..) | Op::Divide(..));
    tape.ops.iter().zip(live(tape)).filter(|(op, is_live)| *is_live && rounds(op)).count()
}

#[test]
fn no_tape_errs_by_more_than_its_bound() {
    let mut random = Random(12);
    let (mut promised, mut tight) = (0, 0);
    for round in 0..160 {
        let precision = Precision::ALL[round % 2];
        let draw = || Plan::any(&mut random, precision, true);
        let plan = std::iter::repeat_with(draw).find(|plan| divides_to_the_end(&plan.tape())).unwrap();
        let (tape, ranges) = (plan.tape(), &plan.ranges);
        let bound = error_bound(&tape, ranges);
        let found = worst_ratio(&mut random, &tape, ranges, bound, 60);
        promised += usize::from(bound.is_finite());
        tight += usize::from(found > 0.5);
    }
    // Most tapes have a bound, and for many of them the search finds more than half of it.
    assert!(promised > 80 && tight > 40, "{promised} promised, {tight} tight");
}

/// Changes operations, constants and ranges in small steps, towards the largest ratio of observed error to bound.
#[test]
fn no_tape_that_a_search_finds_errs_by_more_than_its_bound() {
    let mut random = Random(17);
    // A single operation is tight by itself, so at least three are required here.
    let counts = |tape: &Tape| divides_to_the_end(tape) && roundings(tape) >= 3;
    for precision in Precision::ALL {
        for may_be_off in [false, true] {
            let mut worst = 0.0f64;
            for _ in 0..4 {
                let draw = || Plan::any(&mut random, precision, may_be_off);
                let mut plan = std::iter::repeat_with(draw).find(|plan| counts(&plan.tape())).unwrap();
                let mut ratio = 0.0f64;
                for _ in 0..80 {
                    let next = plan.changed(&mut random);
                    let tape = next.tape();
                    if counts(&tape) {
                        let bound = error_bound(&tape, &next.ranges);
                        let found = worst_ratio(&mut random, &tape, &next.ranges, bound, 30);
                        if found >= ratio {
                            (plan, ratio) = (next, found);
                        }
                    }
                }
                worst = worst.max(ratio);
            }
            // The search is effective: for some tape the bound exceeds the largest error by less than a tenth.
            assert!(worst > 0.9 && worst <= 1.0, "{worst} in {}", precision.name());
        }
    }
}

//! Tests of boxes and their cells.

use super::*;

#[test]
fn cells_hold_every_number_of_the_range() {
    let mut random = Random(11);
    for precision in Precision::ALL {
        for _ in 0..300 {
            // Ranges of a few numbers; their ends are numbers of the type or not.
            let mut low = f64::from((random.between(-4.0, 4.0) * power_of_two(random.below(40) as i64 - 20)) as f32);
            let mut numbers = vec![low];
            for _ in 0..random.below(12) {
                low = precision.next_up(low);
                numbers.push(low);
            }
            let mut range = [numbers[0], *numbers.last().unwrap()];
            if precision == Precision::F32 && random.chance(2) {
                range = [range[0].next_down(), range[1].next_up()];
            }
            let n = 1 << random.below(7);
            let sides: Vec<Side> = (0..n).filter_map(|k| side(precision, range, k, n)).collect();
            for number in numbers {
                assert!(sides.iter().any(|[low, high]| *low <= number && number <= *high), "{number} of {range:?} in {n}");
            }
            for [low, high] in sides {
                assert!(range[0] <= low && low <= high && high <= range[1], "{range:?}");
                assert!([low, high].iter().all(|end| precision.round(&exact(*end)) == *end));
            }
        }
    }
    // The range contains no number of f32.
    assert_eq!(side(Precision::F32, [1.0 + 1e-12, 1.0 + 2e-12], 0, 1), None);
    assert_eq!(side(Precision::F64, [0.0, 8.0], 1, 4), Some([2.0, 4.0]));
}

#[test]
fn the_number_of_cells_stays_within_the_budget() {
    let expected = [(0, 10, 256), (1, 10, 256), (2, 10, 64), (3, 10, 16), (4, 10, 8), (6, 10, 4), (12, 10, 2), (13, 10, 1)];
    for (dimensions, operations, side) in expected {
        assert_eq!(cells_per_side(dimensions, operations), side, "{dimensions}");
    }
    // 4096 cells for 1000 operations; longer tapes have fewer cells.
    assert_eq!(cells_per_side(2, 1000), 64);
    assert_eq!(cells_per_side(2, 4000), 32);
    assert_eq!(cells_per_side(1, 1_000_000), 4);
    assert_eq!(cells_per_side(1, 0), 256);
    assert_eq!([cells_per_side(1, 256_000), cells_per_side(1, 256_001)], [16, 8]);
    // So many operations that even one cell exceeds the budget: one cell is used.
    assert_eq!(cells_per_side(1, 10_000_000), 1);
    // As many inputs as a file may have.
    for dimensions in [31, 32, 63, 64, 65, 100, 1000] {
        assert_eq!(cells_per_side(dimensions, 10), 1, "{dimensions}");
    }
}

#[test]
fn the_worst_cell_counts_wherever_it_lies() {
    // The error is the sum of the arguments' magnitudes over 64, so it is largest in one corner.
    for precision in Precision::ALL {
        for arity in 1..=3usize {
            for corner in 0..1 << arity {
                let range = |k: usize| if corner >> k & 1 == 1 { [0.0, 1.0] } else { [-1.0, 0.0] };
                let ranges: Vec<[f64; 2]> = (0..arity).map(range).collect();
                let tape = write_tape(precision, arity, |builder, x| {
                    let factor = off(builder, 1.0, 1.0 / 64.0);
                    let products: Vec<Reg> = x.iter().map(|x| builder.push(Op::Absolute(*x))).collect();
                    let products: Vec<Reg> = products.iter().map(|x| builder.push(Op::Multiply(*x, factor))).collect();
                    products.into_iter().reduce(|sum, product| builder.push(Op::Add(sum, product))).unwrap()
                });
                let found = tightness(&tape, &ranges, 1);
                assert!(found > 0.999, "{found} over {ranges:?}");
            }
        }
        // Cells make the bound tight where a single range does not: x (1 - x) is at most a quarter, but a single range gives 1.
        let hump = write_tape(precision, 1, |builder, x| {
            let (one, factor) = (builder.constant(integer(1)), off(builder, 1.0, 1.0 / 64.0));
            let rest = builder.push(Op::Subtract(one, x[0]));
            let product = builder.push(Op::Multiply(x[0], rest));
            builder.push(Op::Multiply(product, factor))
        });
        let found = tightness(&hump, &[[0.0, 1.0]], 400);
        assert!(found > 0.98, "{found}");
    }
}

//! Standstill is not a fault: records in which a motor stands, an axis sticks or a car waits are accepted, and real faults in the same records are
//! found. Families from seeds.

use crate::random::Random;
use crate::standing::{Recorded, axis, car, motor};
use rsm_diagnose::plant::checks::{self, Finding};
use rsm_diagnose::plant::repeated_blocks;
use rsm_diagnose::plant::row_share::Piece;

fn findings(of: &Recorded) -> Vec<Finding> {
    checks::prepared([Piece::whole(of.record())], &of.file).1
}

fn family(seeds: std::ops::Range<u64>) -> Vec<Recorded> {
    seeds.flat_map(|seed| [motor(seed), axis(seed, (16.0, 22.0), 2e-3), car(seed)]).collect()
}

#[test]
fn a_record_with_rest_in_it_is_in_order() {
    let mut wrong = Vec::new();
    let all = family(0..40);
    for one in &all {
        let found = findings(one);
        if !found.is_empty() {
            let found: Vec<String> =
                found.iter().take(4).map(|it| format!("{} {} {:?}", it.channel, it.what, it.rows)).collect();
            wrong.push(format!("{}: {}", one.what, found.join("; ")));
        }
    }
    assert!(wrong.is_empty(), "{} of {}:\n{}", wrong.len(), all.len(), wrong.join("\n"));
}

#[test]
fn what_is_broken_in_a_record_with_rest_is_found() {
    let mut missed = Vec::new();
    let mut asked = 0;
    for seed in 0..15 {
        for make in [motor as fn(u64) -> Recorded, |seed| axis(seed, (16.0, 22.0), 2e-3), car] {
            let whole = make(seed);
            let noisy = (0..whole.outputs.len()).filter(|k| whole.outputs[*k].2).collect::<Vec<_>>();
            if noisy.is_empty() {
                continue;
            }
            // A sequence of rows in the middle of a motion.
            let Some(at) = whole.moving.windows(60).find(|rows| rows[59] - rows[0] == 59).map(|rows| rows[0]) else { continue };
            for &k in &noisy {
                let mut frozen = make(seed);
                let values = &mut frozen.outputs[k].1;
                let value = values[at + 7];
                values[at + 7..at + 47].fill(value);
                let mut clipped = make(seed);
                let values = &mut clipped.outputs[k].1;
                let (low, high) = values.iter().fold((0.0_f64, 0.0_f64), |(low, high), v| (low.min(*v), high.max(*v)));
                let limit = if high >= -low { 0.7 * high } else { 0.7 * low };
                values.iter_mut().filter(|it| it.abs() > limit.abs() && **it * limit > 0.0).for_each(|it| *it = limit);
                // A limit is visible only if the signal stays at it.
                let stays = values.chunk_by(|a, b| a == b).any(|run| run[0] == limit && run.len() >= 8);
                for (what, broken, is_there) in [("stuck", frozen, true), ("clipped", clipped, stays)] {
                    asked += usize::from(is_there);
                    let channel = broken.outputs[k].0.split('[').next().unwrap_or_default();
                    let found = findings(&broken);
                    if is_there && !found.iter().any(|it| it.channel == channel && it.what == what) {
                        missed.push(format!("{}, {channel} {what}: {found:?}", broken.what));
                    }
                }
            }
            let mut doubled = make(seed);
            for channel in &mut doubled.outputs {
                channel.1.copy_within(at..at + 30, at + 30);
            }
            asked += 1;
            let found = findings(&doubled);
            if !found.iter().any(|it| it.what == "duplicated block" && it.rows.0.abs_diff(at + 30) <= 1) {
                missed.push(format!("{}, a block of 30 rows from {at}: {found:?}", doubled.what));
            }
        }
    }
    assert!(asked > 100, "{asked}");
    assert!(missed.is_empty(), "{} of {asked}:\n{}", missed.len(), missed.join("\n"));
}

#[test]
fn a_long_rest_is_no_block_and_costs_no_more_than_a_motion() {
    // 100,000 rows, of which 60,000 are at rest: all pairs of these would be 2e9, and all their lengths 4e13.
    let mut random = Random::new(10);
    let mut speed: Vec<f64> = (0..100_000).map(|_| random.normal()).collect();
    speed[20_000..80_000].fill(0.0);
    assert_eq!(repeated_blocks::find(&[&speed]), vec![]);
    // A block that was copied into the motion after it. Rows at rest are similar, so 36 equal rows are needed to exclude chance.
    speed.copy_within(90_000..90_060, 95_000);
    assert_eq!(repeated_blocks::find(&[&speed]), vec![(95_000, 95_060)]);
}

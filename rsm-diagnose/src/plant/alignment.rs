//! A second check of the data, made with the calibrated simulation: it finds what the readings alone do not show.
//!
//! In: prepared records and their simulation. Out: findings. A jump that the simulation also has is motion, so its rows count again. A channel that
//! is late or early in one record only is reported and left out of that record. A delay that all records share belongs to the plant or a sensor, so
//! the search handles it. Never corrects a sample.

use super::checks::{Finding, jumps};
use super::whitened_residuals::{Prepared, Simulated};
use rsm_sim::kind::{OUTPUTS, PlantKind};

/// Shifts of up to this many rows, late or early, are tested.
const LARGEST_SHIFT: usize = 50;

/// The smallest shift. One row may be due to the phase of sampling.
const LEAST_SHIFT: usize = 2;

/// A channel is shifted if the shift reduces its mean square error by this factor. Below that, its own slope could explain the error.
const LEAST_IMPROVEMENT: f64 = 4.0;

/// Removes the findings of jumps that the simulation has too; these rows count again.
pub fn remove_motion_findings(records: &mut [Prepared], simulated: &[Simulated], kind: PlantKind, findings: &mut Vec<Finding>) {
    for (prepared, simulated) in records.iter_mut().zip(simulated) {
        for (k, values) in simulated.iter().enumerate() {
            let left: Vec<f64> = prepared.measured(k).iter().zip(values).map(|(measured, value)| measured - value).collect();
            let true_jumps = jumps(&left);
            let mut back = Vec::new();
            findings.retain(|it| match jump(prepared, k, kind, it) {
                Some(row) if !true_jumps.contains(&row) => {
                    back.push(row);
                    false
                }
                _ => true,
            });
            back.into_iter().for_each(|row| prepared.used[k][row] = true);
        }
    }
}

/// The row of a jump in the k-th output of a record, if the finding is such a jump.
fn jump(prepared: &Prepared, k: usize, kind: PlantKind, finding: &Finding) -> Option<usize> {
    let name = kind.outputs()[prepared.outputs[k]].name;
    let here = finding.what == "jump" && finding.channel == name && finding.record == prepared.record.file;
    prepared.row_of(finding.rows.0).filter(|_| here)
}

/// The rows left out as jumps in the k-th output of a record.
#[must_use]
pub fn jumps_of(prepared: &Prepared, k: usize, kind: PlantKind, findings: &[Finding]) -> Vec<usize> {
    findings.iter().filter_map(|it| jump(prepared, k, kind, it)).collect()
}

/// A channel of a record with its delay in rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shift {
    /// The record.
    pub record: usize,
    /// The output, by its place in the record.
    pub output: usize,
    /// Rows; negative if the channel is early.
    pub late: isize,
}

/// Channels that are shifted in time against the same channel of most other records, at least two: with two records in all, it is unknown which one
/// is shifted.
#[must_use]
pub fn shifts(records: &[(&Prepared, &Simulated)]) -> Vec<Shift> {
    let mut found = Vec::new();
    for output in 0..OUTPUTS {
        let of_output = |prepared: &Prepared| prepared.outputs.iter().position(|it| *it == output);
        let have: Vec<(usize, usize)> =
            records.iter().enumerate().filter_map(|(record, (prepared, _))| Some((record, of_output(prepared)?))).collect();
        if have.len() < 3 {
            continue;
        }
        let errors: Vec<Vec<f64>> = have
            .iter()
            .map(|&(record, k)| {
                let (prepared, simulated) = records[record];
                mean_square_errors(prepared.measured(k), &simulated[k], &prepared.used[k])
            })
            .collect();
        let best = |errors: &Vec<f64>| {
            let place = (0..errors.len()).min_by(|a, b| errors[*a].total_cmp(&errors[*b])).unwrap_or(LARGEST_SHIFT);
            place as isize - LARGEST_SHIFT as isize
        };
        let late: Vec<isize> = errors.iter().map(best).collect();
        // A simulation that is not exact fits best at some other shift, so records disagree about it where it hardly matters. A record is shifted if
        // the usual shift does not do for it.
        let mut sorted = late.clone();
        sorted.sort_unstable();
        let usual = sorted[(sorted.len() - 1) / 2];
        let is_shifted = |place: &usize| {
            let at = |late: isize| errors[*place][(late + LARGEST_SHIFT as isize) as usize];
            let apart = (late[*place] - usual).unsigned_abs() >= LEAST_SHIFT && late[*place].unsigned_abs() < LARGEST_SHIFT;
            apart && at(usual) > LEAST_IMPROVEMENT * at(late[*place])
        };
        let shifted: Vec<usize> = (0..have.len()).filter(is_shifted).collect();
        if have.len() - shifted.len() >= 2.max(shifted.len() + 1) {
            let shift = |place: &usize| Shift { record: have[*place].0, output: have[*place].1, late: late[*place] - usual };
            found.extend(shifted.iter().map(shift));
        }
    }
    found
}

/// The mean square difference between the readings and a simulation delayed by -`LARGEST_SHIFT` to `LARGEST_SHIFT` rows, after subtracting the mean.
fn mean_square_errors(measured: &[f64], simulated: &[f64], used: &[bool]) -> Vec<f64> {
    let rows = measured.len();
    if rows < 8 * LARGEST_SHIFT {
        return vec![0.0; 2 * LARGEST_SHIFT + 1];
    }
    (0..=2 * LARGEST_SHIFT)
        .map(|place| {
            let (mut count, mut sum, mut squares) = (0.0, 0.0, 0.0);
            for row in LARGEST_SHIFT..rows - LARGEST_SHIFT {
                if used[row] {
                    let miss = measured[row] - simulated[row + LARGEST_SHIFT - place];
                    (count, sum, squares) = (count + 1.0, sum + miss, squares + miss * miss);
                }
            }
            (squares - sum * sum / f64::max(count, 1.0)) / f64::max(count, 1.0)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rsm_core::source::Source;
    use rsm_fit::random::Random;
    use rsm_sim::plant_file::PlantFile;
    use rsm_sim::record::Record;

    /// Five records of a speed that wanders, late by this many rows; what a simulation says of them is on time.
    fn records(late: [usize; 5], noise: f64) -> Vec<(Prepared, Simulated)> {
        let text = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../rsm-sim/plants/pmac.toml")).unwrap();
        let file = PlantFile::read(&Source::new("pmac.toml", text)).unwrap();
        let mut random = Random::new(5);
        late.iter()
            .map(|late| {
                let mut speed = 0.0;
                let truth: Vec<f64> = (0..1000_usize)
                    .map(|_| {
                        speed = 0.99 * speed + random.normal();
                        speed
                    })
                    .collect();
                let mut csv = "time[s],v_d[V],v_q[V],load_torque[N*m],speed[rad/s]\n".to_string();
                for row in 0..1000_usize {
                    let reading = truth[row.saturating_sub(*late)] + noise * random.normal();
                    csv += &format!("{},0,5,0,{reading}\n", row as f64 / 1000.0);
                }
                let record = Record::read(&Source::new("r.csv", csv), &file).unwrap();
                (Prepared::new(record, 3), vec![truth])
            })
            .collect()
    }

    fn found(late: [usize; 5], noise: f64) -> Vec<(usize, isize)> {
        let records = records(late, noise);
        let pairs: Vec<(&Prepared, &Simulated)> = records.iter().map(|(prepared, simulated)| (prepared, simulated)).collect();
        shifts(&pairs).iter().map(|it| (it.record, it.late)).collect()
    }

    #[test]
    fn a_channel_late_in_one_record_is_found_and_a_delay_of_all_is_not() {
        assert_eq!(found([0, 0, 0, 0, 0], 0.1), vec![]);
        assert_eq!(found([0, 9, 0, 0, 0], 0.1), vec![(1, 9)]);
        assert_eq!(found([6, 6, 6, 6, 6], 0.1), vec![]);
        assert_eq!(found([6, 6, 6, 0, 6], 0.1), vec![(3, -6)]);
        // One row is the phase of sampling.
        assert_eq!(found([0, 0, 0, 0, 1], 0.1), vec![]);
    }

    #[test]
    fn records_that_fit_nearly_as_well_at_another_shift_agree() {
        // Beside so much noise, three rows matter little and twenty do.
        assert_eq!(found([20, 3, 0, 2, 0], 1.0), vec![(0, 18)]);
        assert_eq!(found([0, 3, 0, 2, 0], 1.0), vec![]);
        // Two of five, and two of three kinds.
        assert_eq!(found([20, 0, 0, 20, 0], 0.1), vec![(0, 20), (3, 20)]);
        assert_eq!(found([20, 20, 10, 10, 0], 0.1), vec![]);
    }
}

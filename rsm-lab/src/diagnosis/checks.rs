//! Data before physics: samples that no sensor in order can have read.
//!
//! In: a prepared record. Out: findings, with the rows they concern taken out of every later figure. Gaps, steps back and jitter of time do not come this
//! far: the reader refuses them. Never corrects a sample.

use super::kernel::Prepared;
use super::noise::median;
use crate::plant_file::PlantFile;

/// In a noisy channel two equal readings one after the other are chance; this many are a channel that hangs.
const STUCK: usize = 8;

/// A channel counts as noisy when fewer than this share of its readings equal the one before: rounding to coarse steps repeats far more.
const REPEATS: f64 = 0.02;

/// A sample so many robust standard deviations of second differences off its neighbours' line is a jump: normal noise passes 12 once in 10^32.
const JUMP: f64 = 12.0;

/// What was found in a record.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// The record, as messages speak of it.
    pub record: String,
    /// The channel, or "row".
    pub channel: String,
    /// What it is: "stuck", "clipped", "jump", "duplicated row".
    pub what: &'static str,
    /// First and last row, from 0.
    pub rows: (usize, usize),
}

/// Finds what is wrong with a record and takes those rows out.
pub fn check(prepared: &mut Prepared, file: &PlantFile) -> Vec<Finding> {
    let mut findings = Vec::new();
    let names = file.kind.outputs();
    let record = prepared.record.file.clone();
    let rows = prepared.record.rows();
    let count = prepared.outputs.len();
    let noisy: Vec<bool> = (0..count).map(|k| is_noisy(prepared.measured(k))).collect();

    // A row whose noisy channels all repeat the row before was written twice.
    if count > 1 && noisy.iter().all(|noisy| *noisy) {
        for row in 1..rows {
            let same = |k: usize| prepared.measured(k)[row] == prepared.measured(k)[row - 1];
            if (0..count).all(same)
                && !(row > 1 && (0..count).all(|k| prepared.measured(k)[row - 1] == prepared.measured(k)[row - 2]))
            {
                findings.push(Finding {
                    record: record.clone(),
                    channel: "row".to_string(),
                    what: "duplicated row",
                    rows: (row, row),
                });
            }
        }
    }
    for k in 0..count {
        if !noisy[k] {
            continue;
        }
        let values = prepared.measured(k);
        let (low, high) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(*v), high.max(*v)));
        let channel = names[prepared.outputs[k]].name.to_string();
        let mut first = 0;
        for row in 1..=rows {
            if row < rows && values[row] == values[first] {
                continue;
            }
            let extreme = values[first] == low || values[first] == high;
            // At the end of the range a few equal readings are enough: noise does not repeat its extreme.
            if row - first >= STUCK || (extreme && row - first >= STUCK / 2) {
                let what = if extreme { "clipped" } else { "stuck" };
                findings.push(Finding { record: record.clone(), channel: channel.clone(), what, rows: (first, row - 1) });
            }
            first = row;
        }
        findings.extend(jumps(values).into_iter().map(|row| Finding {
            record: record.clone(),
            channel: channel.clone(),
            what: "jump",
            rows: (row, row),
        }));
    }
    for finding in &findings {
        let whole = finding.channel == "row";
        for k in 0..count {
            if whole || names[prepared.outputs[k]].name == finding.channel {
                prepared.used[k][finding.rows.0..=finding.rows.1].fill(false);
            }
        }
    }
    findings
}

/// Few readings that repeat the one before.
fn is_noisy(values: &[f64]) -> bool {
    // A channel that hangs for a while repeats for that long: what moves between other rows decides.
    let mut repeats = 0;
    let mut runs = 0;
    for k in 1..values.len() {
        if values[k] == values[k - 1] {
            repeats += 1;
            if k < 2 || values[k - 1] != values[k - 2] {
                runs += 1;
            }
        }
    }
    repeats < values.len() / 2 && (runs as f64) < REPEATS * values.len() as f64
}

/// Single samples far off their neighbours.
fn jumps(values: &[f64]) -> Vec<usize> {
    let second: Vec<f64> = values.windows(3).map(|w| w[1] - 0.5 * (w[0] + w[2])).collect();
    let mut sizes: Vec<f64> = second.iter().map(|value| value.abs()).collect();
    // The median of |x| is 0.6745 standard deviations of a normal x.
    let sd = median(&mut sizes) / 0.6745;
    if sd == 0.0 {
        return Vec::new();
    }
    let off = |k: usize| k.checked_sub(1).and_then(|k| second.get(k)).copied().unwrap_or(0.0);
    (1..values.len().saturating_sub(1))
        .filter(|&row| {
            // A spike bends the line at its row one way and at both neighbours half as much the other way; a step or a corner does not.
            let here = off(row);
            let (before, after) = (off(row - 1), off(row + 1));
            here.abs() > JUMP * sd && before * here < -0.16 * here * here && after * here < -0.16 * here * here
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::noise::Random;
    use super::*;
    use crate::record::Record;
    use rsm_core::source::Source;

    fn motor(change: impl Fn(usize, &mut [f64; 3])) -> (Prepared, PlantFile) {
        let text = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/plants/pmac.toml")).unwrap();
        let file = PlantFile::read(&Source::new("pmac.toml", text)).unwrap();
        let mut random = Random::new(3);
        let mut csv = "time[s],v_d[V],v_q[V],load_torque[N*m],i_d[A],i_q[A],speed[rad/s]\n".to_string();
        for k in 0..400 {
            let mut values = [0.0, 5.0, 100.0].map(|value| value + 0.1 * random.normal());
            values[1] += if k > 200 { 3.0 } else { 0.0 };
            change(k, &mut values);
            csv += &format!("{},0,5,0,{},{},{}\n", k as f64 / 1000.0, values[0], values[1], values[2]);
        }
        (Prepared::new(Record::read(&Source::new("r.csv", csv), &file).unwrap(), 3), file)
    }

    fn found(change: impl Fn(usize, &mut [f64; 3])) -> Vec<(String, &'static str, (usize, usize))> {
        let (mut prepared, file) = motor(change);
        let findings = check(&mut prepared, &file);
        for finding in &findings {
            assert!(!prepared.used[prepared.used.len() - 1][finding.rows.0] || finding.channel != "speed");
        }
        findings.into_iter().map(|it| (it.channel, it.what, it.rows)).collect()
    }

    #[test]
    fn a_record_in_order_with_a_step_has_no_findings() {
        assert_eq!(found(|_, _| {}), vec![]);
    }

    #[test]
    fn a_spike_a_hanging_channel_and_a_clipped_one_are_found_where_they_are() {
        let spike = found(|k, values| values[2] += if k == 77 { 5.0 } else { 0.0 });
        assert_eq!(spike, vec![("speed".to_string(), "jump", (77, 77))]);
        let stuck = found(|k, values| {
            if (100..140).contains(&k) {
                values[2] = 100.01;
            }
        });
        assert_eq!(stuck, vec![("speed".to_string(), "stuck", (100, 139))]);
        let clipped = found(|k, values| {
            if (300..330).contains(&k) {
                values[1] = 8.5;
            }
        });
        assert_eq!(clipped, vec![("i_q".to_string(), "clipped", (300, 329))]);
    }
}

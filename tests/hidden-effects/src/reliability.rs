//! Checks that a confidence is a probability: of causes named with 0.9, nine of ten must be correct.
//!
//! In: confidences of named causes, each with whether it is in the truth. Out: a table of bins with counts, mean confidence, share of correct causes
//! and its binomial interval; and whether any bin contradicts its confidence. It does not evaluate answers.

use std::fmt;

/// Lower ends of the bins.
const BINS: [f64; 6] = [0.0, 0.1, 0.3, 0.6, 0.8, 0.95];

/// 95 % of a normal distribution are within this number of standard deviations.
const WITHIN: f64 = 1.96;

/// A named cause.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Named {
    /// The confidence that the answer gives.
    pub confidence: f64,
    /// Whether it is in the truth.
    pub right: bool,
    /// The confidence that the answer gives for the cause and those it cannot distinguish from it, together.
    pub confidence_of_any: f64,
    /// Whether one of these is in the truth.
    pub any_right: bool,
}

impl Named {
    /// The causes of a list, each together with those that the answer cannot distinguish from it.
    pub fn together(list: &[Named]) -> Vec<Named> {
        list.iter().map(|it| Named { confidence: it.confidence_of_any, right: it.any_right, ..*it }).collect()
    }

    /// A cause of an answer. Without a confidence it counts as certain; without a confidence of its equivalents, they add nothing to it.
    pub fn of(cause: &serde_json::Value, right: bool, any_right: bool) -> Self {
        let confidence = cause["confidence"].as_f64().unwrap_or(1.0);
        Named { confidence, right, confidence_of_any: cause["confidence_of_any"].as_f64().unwrap_or(confidence), any_right }
    }
}

/// Causes in a range of confidences.
#[derive(Debug, Clone, PartialEq)]
pub struct Bin {
    /// The lower end of the range.
    pub from: f64,
    /// The upper end of the range.
    pub to: f64,
    /// The number of causes.
    pub count: usize,
    /// The number of correct causes.
    pub right: usize,
    /// Their mean confidence.
    pub said: f64,
}

/// The shares that are compatible with `right` of `count`, at 95 % (E. B. Wilson, 1927).
pub fn wilson(right: usize, count: usize) -> (f64, f64) {
    let n = count as f64;
    let (share, z2) = (right as f64 / n, WITHIN * WITHIN);
    let middle = (share + z2 / (2.0 * n)) / (1.0 + z2 / n);
    let half = WITHIN / (1.0 + z2 / n) * (share * (1.0 - share) / n + z2 / (4.0 * n * n)).sqrt();
    (middle - half, middle + half)
}

impl Bin {
    /// The shares of correct causes that are compatible with the count.
    pub fn interval(&self) -> (f64, f64) {
        wilson(self.right, self.count)
    }

    /// Whether the causes may be correct as often as their confidence states.
    pub fn holds(&self) -> bool {
        let (low, high) = self.interval();
        low <= self.said && self.said <= high
    }
}

/// The table.
#[derive(Debug, Clone, Default)]
pub struct Reliability(pub Vec<Named>);

impl Reliability {
    /// Bins that contain causes.
    pub fn bins(&self) -> Vec<Bin> {
        bins(&self.0)
    }

    /// Whether, as far as its count shows, no bin is correct less often than its confidence states. A cause that is correct more often than stated
    /// misleads nobody; it is visible in the table.
    pub fn held(&self) -> bool {
        let not_too_sure = |list: &[Named]| bins(list).iter().all(|bin| bin.interval().1 >= bin.said);
        not_too_sure(&self.0) && not_too_sure(&Named::together(&self.0))
    }
}

fn bins(list: &[Named]) -> Vec<Bin> {
    let ends = BINS.iter().skip(1).copied().chain([f64::INFINITY]);
    let bins = BINS.iter().zip(ends).map(|(from, to)| {
        let of: Vec<&Named> = list.iter().filter(|it| *from <= it.confidence && it.confidence < to).collect();
        let said = of.iter().map(|it| it.confidence).sum::<f64>() / of.len().max(1) as f64;
        Bin { from: *from, to: to.min(1.0), count: of.len(), right: of.iter().filter(|it| it.right).count(), said }
    });
    bins.filter(|bin| bin.count > 0).collect()
}

impl fmt::Display for Reliability {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        table(f, &self.0, "a cause by itself")?;
        table(f, &Named::together(&self.0), "a cause, or one of those which the answer does not tell from it")
    }
}

/// The table of a list.
fn table(f: &mut fmt::Formatter<'_>, list: &[Named], what: &str) -> fmt::Result {
    writeln!(f, "{what}:\nconfidence     causes  right  mean said  share right  95 % of it")?;
    for bin in bins(list) {
        let (low, high) = bin.interval();
        let mark = if bin.holds() {
            ""
        } else if high < bin.said {
            "  TOO SURE"
        } else {
            "  too modest"
        };
        writeln!(
            f,
            "{:.2} to {:.2} {:>8} {:>6} {:>10.3} {:>12.3}  {low:.3} to {high:.3}{mark}",
            bin.from,
            bin.to,
            bin.count,
            bin.right,
            bin.said,
            bin.right as f64 / bin.count as f64
        )?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(confidence: f64, right: usize, wrong: usize) -> Vec<Named> {
        let one = |right| Named { confidence, right, confidence_of_any: confidence, any_right: right };
        (0..right + wrong).map(|k| one(k < right)).collect()
    }

    #[test]
    fn causes_that_say_nine_of_ten_are_to_be_right_nine_times_in_ten() {
        assert!(Reliability(of(0.9, 18, 2)).held());
        assert!(!Reliability(of(0.9, 10, 10)).held());
        assert!(Reliability(of(0.05, 10, 10)).held() && !Reliability(of(0.05, 10, 10)).bins()[0].holds());
        // 52 of 63 are wrong at 0.99.
        assert!(!Reliability([of(0.99, 11, 52), of(0.2, 5, 20)].concat()).held());
    }

    #[test]
    fn equals_are_judged_together_by_what_is_said_of_all_of_them() {
        let cause = serde_json::json!({ "confidence": 0.24, "confidence_of_any": 0.96 });
        let told = Named { confidence: 0.24, right: false, confidence_of_any: 0.96, any_right: true };
        assert_eq!(Named::of(&cause, false, true), told);
        let together = Named::together(&[told])[0];
        assert_eq!((together.confidence, together.right), (0.96, true));
        let old = Named::of(&serde_json::json!({ "confidence": 0.9 }), true, true);
        assert_eq!((old.confidence_of_any, Named::of(&serde_json::json!({}), true, true).confidence), (0.9, 1.0));
    }

    #[test]
    fn the_interval_is_wilsons() {
        // 8 of 10: 0.490 to 0.943 (Wilson 1927; Newcombe 1998, method 3).
        let (low, high) = Reliability(of(0.7, 8, 2)).bins()[0].interval();
        assert!((low - 0.4902).abs() < 1e-3 && (high - 0.9433).abs() < 1e-3, "{low} {high}");
    }

    #[test]
    fn bins_part_at_their_lower_ends() {
        let bins = Reliability([of(0.95, 1, 0), of(0.9499, 0, 1), of(1.0, 1, 0)].concat()).bins();
        assert_eq!(bins.iter().map(|bin| (bin.from, bin.count, bin.right)).collect::<Vec<_>>(), [(0.8, 1, 0), (0.95, 2, 2)]);
    }
}

//! The verdict on the fit of a response.
//!
//! The outcomes as data, with their sentences. A numerical outcome is not a failure. A ladder has two criteria. C of the paper, (14) and (15), is
//! relative to zero: a constant 350 K with 8 K of noise reaches 99.95 % without a surface, and the same data in degrees Celsius reach less. So the
//! second criterion is relative to the mean, and does not change with the zero of the scale:
//!
//! 1. on rows that were not used for any choice the surface explains at least half of the spread about the mean ([`LEAST_EXPLAINED`]), and
//! 2. C about the mean also reaches the required confidence, or the residual is noise as far as the data show: no significant lack of fit.
//!
//! Noise alone fails the first: on rows that were not used for any choice, no surface is better than the mean, however it was chosen. A plane through
//! clean quadratic data fails the second. A good surface through noisy data passes both: no surface can explain the noise, so this is not required.

use crate::constrain::NotProven;
use crate::selection::ChosenBy;

/// The share of the spread about the mean that must be explained on rows that were not used for any choice. At a half, the surface and its error are
/// of the same size; predictive models count as useful above it (Eriksson and others, Multi- and Megavariate Data Analysis, Q^2 > 0.5).
pub const LEAST_EXPLAINED: f64 = 0.5;

/// The verdict on the fit of a response.
#[derive(Debug, Clone, PartialEq)]
pub enum Verdict {
    /// The terms were given, so there was no confidence to reach.
    Fitted,
    /// The ladder reached its confidence.
    Reached {
        /// C on the judge's data.
        confidence: f64,
        /// The required C.
        wanted: f64,
    },
    /// The ladder reached its confidence, which is relative to zero; relative to the mean the surface is not good enough.
    ReachedAboutZero {
        /// C on the judge's data.
        confidence: f64,
        /// The required C.
        wanted: f64,
        /// The reason.
        why: AboutZero,
    },
    /// No model of the ladder reached it. The best one found is in the model.
    NotReached {
        /// The best C.
        best: f64,
        /// The required C.
        wanted: f64,
    },
    /// No coefficients of the chosen terms meet the constraints. There is no surface.
    Infeasible {
        /// The constraints that contradict one another or the terms.
        constraints: Vec<String>,
    },
    /// Some coefficients may meet the constraints, but there is no proof. There is no surface.
    NotProven(NotProven),
    /// The data do not distinguish some columns. There is no surface.
    IllConditioned {
        /// The norm of a column divided by the norm of its part that is orthogonal to the others.
        condition: f64,
        /// The terms involved, the rejected one last.
        columns: Vec<String>,
    },
}

/// The criteria in addition to C.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Criterion {
    /// The required C in percent.
    pub wanted: f64,
    /// The share explained about the mean on the rows that were used to choose the terms.
    pub centred: Option<f64>,
    /// The same on rows that were not used for any choice; `None` without such rows.
    pub explained: Option<f64>,
    /// Whether a lack of fit is significant.
    pub is_lacking: bool,
    /// Whether all responses are equal, so that there is nothing to explain.
    pub has_no_spread: bool,
}

/// The verdict on a ladder with this C.
pub(crate) fn of_ladder(confidence: Option<f64>, asked: &Criterion) -> Verdict {
    let wanted = asked.wanted;
    let Some(confidence) = confidence.filter(|confidence| *confidence >= wanted) else {
        return Verdict::NotReached { best: confidence.unwrap_or(f64::NEG_INFINITY), wanted };
    };
    if asked.has_no_spread {
        return Verdict::Reached { confidence, wanted };
    }
    match asked.explained {
        None => Verdict::ReachedAboutZero { confidence, wanted, why: AboutZero::NobodyJudges },
        Some(share) if share < LEAST_EXPLAINED => {
            Verdict::ReachedAboutZero { confidence, wanted, why: AboutZero::ExplainsLittle { share } }
        }
        Some(_) => match asked.centred.filter(|share| 100.0 * share < wanted) {
            Some(share) if asked.is_lacking => {
                Verdict::ReachedAboutZero { confidence, wanted, why: AboutZero::LacksFit { centred: 100.0 * share } }
            }
            _ => Verdict::Reached { confidence, wanted },
        },
    }
}

/// The reason why a surface that reaches C is not good enough relative to the mean.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AboutZero {
    /// On rows that were not used for any choice it explains less than [`LEAST_EXPLAINED`] of the spread about the mean.
    ExplainsLittle {
        /// The explained share.
        share: f64,
    },
    /// The residual is systematic, and C about the mean is below the required one.
    LacksFit {
        /// C about the mean, in percent.
        centred: f64,
    },
    /// There are no rows that were not used for any choice.
    NobodyJudges,
}

impl std::fmt::Display for AboutZero {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            AboutZero::ExplainsLittle { share } => {
                write!(
                    f,
                    "on holdout rows it explains {:.1} % of the spread about the mean, {:.0} % required",
                    100.0 * share,
                    100.0 * LEAST_EXPLAINED
                )
            }
            AboutZero::LacksFit { centred } => {
                write!(f, "{centred:.4} % of the spread about it, and a significant lack of fit")
            }
            AboutZero::NobodyJudges => write!(f, "no rows are left that were not used to choose the model"),
        }
    }
}

impl ChosenBy {
    /// The rows of a ladder's C, in words that follow a verdict.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            ChosenBy::Nobody => "given terms",
            ChosenBy::Validation => "validation rows, which chose the terms",
            ChosenBy::LeftOut { .. } => "fitted rows left out in turn, which chose the terms",
            ChosenBy::FittedRows => "fitted rows, which chose the terms",
            ChosenBy::Formula(_) => "fitted rows, which chose the terms by a formula",
        }
    }
}

impl std::fmt::Display for Verdict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Verdict::Fitted => write!(f, "fitted"),
            Verdict::Reached { confidence, wanted } => write!(f, "confidence {confidence:.4} % reached ({wanted} % wanted)"),
            Verdict::ReachedAboutZero { confidence, wanted, why } => {
                write!(f, "confidence {confidence:.4} % about zero ({wanted} % wanted), but not reached about the mean: {why}")
            }
            Verdict::NotReached { best, wanted } => write!(f, "confidence {wanted} % not reached, best {best:.4} %"),
            Verdict::Infeasible { constraints } => {
                write!(f, "infeasible: no coefficients of the chosen terms fulfil: {}", constraints.join("; "))
            }
            Verdict::NotProven(why) => why.fmt(f),
            Verdict::IllConditioned { condition, columns } => write!(
                f,
                "ill-conditioned ({condition:.1e}): the data cannot distinguish the terms {}; vary their inputs independently or drop a term",
                columns.join(", ")
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_verdict_asks_each_criterion_at_its_limit() {
        let good =
            Criterion { wanted: 90.0, centred: Some(0.95), explained: Some(0.75), is_lacking: false, has_no_spread: false };
        let (confidence, wanted) = (95.0, 90.0);
        let reached = Verdict::Reached { confidence, wanted };
        let about_zero = |why| Verdict::ReachedAboutZero { confidence, wanted, why };
        let of = |asked: &Criterion| of_ladder(Some(confidence), asked);
        assert_eq!(of(&good), reached);
        // C about zero: at the wanted one, below it, and none.
        assert_eq!(of_ladder(Some(90.0), &good), Verdict::Reached { confidence: 90.0, wanted });
        assert_eq!(of_ladder(Some(89.5), &good), Verdict::NotReached { best: 89.5, wanted });
        assert_eq!(of_ladder(None, &good), Verdict::NotReached { best: f64::NEG_INFINITY, wanted });
        // On rows that chose nothing: a half, less, and no such rows.
        assert_eq!(of(&Criterion { explained: Some(0.5), ..good }), reached);
        assert_eq!(of(&Criterion { explained: Some(0.4375), ..good }), about_zero(AboutZero::ExplainsLittle { share: 0.4375 }));
        let nobody = Criterion { explained: None, ..good };
        assert_eq!(of(&nobody), about_zero(AboutZero::NobodyJudges));
        assert_eq!(of(&Criterion { has_no_spread: true, ..nobody }), reached, "nothing is to be explained");
        // C about the mean matters only where a lack of fit is significant.
        let below = Criterion { centred: Some(0.875), ..good };
        assert_eq!(of(&below), reached);
        assert_eq!(of(&Criterion { is_lacking: true, ..below }), about_zero(AboutZero::LacksFit { centred: 87.5 }));
        assert_eq!(of(&Criterion { is_lacking: true, centred: Some(0.90625), ..good }), reached);
        assert_eq!(
            of(&Criterion { is_lacking: true, centred: Some(0.75), wanted: 75.0, ..good }),
            Verdict::Reached { confidence, wanted: 75.0 }
        );
        assert_eq!(of(&Criterion { is_lacking: true, centred: None, ..good }), reached);
    }

    #[test]
    fn every_verdict_has_its_words() {
        let told = |verdict: Verdict| verdict.to_string();
        let (confidence, wanted) = (95.0, 90.0);
        assert_eq!(told(Verdict::Fitted), "fitted");
        assert_eq!(told(Verdict::Reached { confidence, wanted }), "confidence 95.0000 % reached (90 % wanted)");
        assert_eq!(told(Verdict::NotReached { best: 81.5, wanted }), "confidence 90 % not reached, best 81.5000 %");
        let about_zero = |why| told(Verdict::ReachedAboutZero { confidence, wanted, why });
        let begin = "confidence 95.0000 % about zero (90 % wanted), but not reached about the mean: ";
        for (why, words) in [
            (
                AboutZero::ExplainsLittle { share: 0.125 },
                "on holdout rows it explains 12.5 % of the spread about the mean, 50 % required",
            ),
            (AboutZero::LacksFit { centred: 87.5 }, "87.5000 % of the spread about it, and a significant lack of fit"),
            (AboutZero::NobodyJudges, "no rows are left that were not used to choose the model"),
        ] {
            assert_eq!(about_zero(why), format!("{begin}{words}"));
        }
        let constraints = vec!["a".to_string(), "b".to_string()];
        assert_eq!(told(Verdict::Infeasible { constraints }), "infeasible: no coefficients of the chosen terms fulfil: a; b");
        assert_eq!(
            told(Verdict::IllConditioned { condition: 2e15, columns: vec!["x".into(), "z".into()] }),
            "ill-conditioned (2.0e15): the data cannot distinguish the terms x, z; vary their inputs independently or drop a term"
        );
        let who = [
            ChosenBy::Nobody,
            ChosenBy::Validation,
            ChosenBy::LeftOut { parts: 5 },
            ChosenBy::FittedRows,
            ChosenBy::Formula("AICc"),
        ];
        assert!(who.iter().enumerate().all(|(k, one)| who[..k].iter().all(|other| other.words() != one.words())));
    }
}

//! How the fit of a response ended, and on what that was judged.
//!
//! Data and their words: numerical outcomes are no failures. Decides nothing.

/// How the fit of a response ended.
#[derive(Debug, Clone, PartialEq)]
pub enum Verdict {
    /// The terms were given; there was nothing to reach.
    Fitted,
    /// The ladder reached its confidence.
    Reached {
        /// C on the data that judge.
        confidence: f64,
        /// The C that was asked for.
        wanted: f64,
    },
    /// No model of the ladder did. The best one found is in the model.
    NotReached {
        /// The best C.
        best: f64,
        /// The C that was asked for.
        wanted: f64,
    },
    /// No coefficients of the chosen terms keep the constraints, or none could be proven to. There is no surface.
    Infeasible {
        /// The constraints that contradict each other or the terms; those without a proof.
        constraints: Vec<String>,
        /// Whether there are none, rather than no proof.
        is_certain: bool,
    },
    /// The data cannot tell some columns apart. There is no surface.
    IllConditioned {
        /// How much larger a column is than the part of it that the others do not make up.
        condition: f64,
        /// The terms involved, the refused one last.
        columns: Vec<String>,
    },
}

/// The data on which C is judged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JudgedOn {
    /// Unseen data.
    Validation,
    /// There are none: the fitted data themselves, which flatter.
    FittedData,
}

impl JudgedOn {
    /// In words.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            JudgedOn::Validation => "validation data",
            JudgedOn::FittedData => "fitted data",
        }
    }
}

impl std::fmt::Display for Verdict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Verdict::Fitted => write!(f, "fitted"),
            Verdict::Reached { confidence, wanted } => write!(f, "confidence {confidence:.4} % reached ({wanted} % wanted)"),
            Verdict::NotReached { best, wanted } => write!(f, "confidence {wanted} % not reached, best {best:.4} %"),
            Verdict::Infeasible { constraints, is_certain: true } => {
                write!(f, "infeasible: no coefficients of the chosen terms keep: {}", constraints.join("; "))
            }
            Verdict::Infeasible { constraints, is_certain: false } => {
                write!(f, "not proven to keep over the whole region: {}", constraints.join("; "))
            }
            Verdict::IllConditioned { condition, columns } => write!(
                f,
                "ill-conditioned ({condition:.1e}): the data cannot tell apart the terms {}; vary their inputs independently or drop a term",
                columns.join(", ")
            ),
        }
    }
}

//! How the terms of a response are chosen.
//!
//! Plain data with their names in a specification; read by [`super::read`].

/// How the terms of a response are chosen.
#[derive(Debug, Clone, PartialEq)]
pub enum Method {
    /// Figure 1 of the paper: add terms until the confidence C is reached.
    Ladder {
        /// The highest order of a candidate.
        max_order: u32,
        /// C in percent.
        confidence: f64,
    },
    /// Exactly these terms.
    Fixed(Vec<Vec<u32>>),
    /// All terms up to an order.
    FixedOrder(u32),
    /// A search among all terms up to an order, by a criterion.
    Search(Search),
}

/// The number of parts of cross-validation: each fit has nine tenths of the rows, and its error is slightly too large (by 1 % in the median over
/// random surfaces).
pub(crate) const PARTS: usize = 10;

/// A search among all terms up to an order.
///
/// ```
/// use rsm_fit::spec::{Criterion, Direction, Search, SearchBy};
///
/// let search = Search { criterion: Some(Criterion::Aicc), ..Search::new(SearchBy::Stepwise(Direction::Both), 3) };
/// assert_eq!(search.parts, 10);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Search {
    /// The method.
    pub by: SearchBy,
    /// The highest order of a candidate.
    pub max_order: u32,
    /// The criterion for the number of terms. `None`: validation rows if there are any, otherwise cross-validation on the fitted rows.
    pub criterion: Option<Criterion>,
    /// Whether a term requires the terms with one power less.
    pub heredity: bool,
    /// Whether to take the fewest terms within one standard error of the best.
    pub one_standard_error: bool,
    /// The number of parts of cross-validation, from 3 to 100.
    pub parts: usize,
}

impl Search {
    /// A search with cross-validation in ten parts, or with validation rows if there are any.
    #[must_use]
    pub fn new(by: SearchBy, max_order: u32) -> Self {
        Search { by, max_order, criterion: None, heredity: false, one_standard_error: false, parts: PARTS }
    }
}

/// How terms are searched.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SearchBy {
    /// Term by term.
    Stepwise(Direction),
    /// The best model of each size, by branch and bound.
    BestSubset,
    /// The path of the LASSO, and of least squares on its terms.
    Lasso,
}

impl SearchBy {
    /// The name in a specification.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            SearchBy::Stepwise(_) => "stepwise",
            SearchBy::BestSubset => "best-subset",
            SearchBy::Lasso => "lasso",
        }
    }
}

/// The direction of stepwise selection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// Terms are added.
    Forward,
    /// Terms are removed from the largest model.
    Backward,
    /// Terms are added, and removed again if that gives a better model of the same size.
    Both,
}

/// The criterion for the number of terms, or for the penalty.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Criterion {
    /// Leave-one-out errors of models that were chosen with all rows.
    Press,
    /// Cross-validation errors, with the choice repeated without each part.
    KFold,
    /// Akaike's criterion with its correction for few rows.
    Aicc,
    /// Errors on validation rows.
    HeldOut,
}

impl Criterion {
    /// The name in a specification.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Criterion::Press => "press",
            Criterion::KFold => "k-fold",
            Criterion::Aicc => "aicc",
            Criterion::HeldOut => "held-out",
        }
    }
}

/// The largest number of candidates for best subsets. With more, branch and bound takes too long for a proof.
pub(crate) const MOST_FOR_SUBSETS: usize = 40;

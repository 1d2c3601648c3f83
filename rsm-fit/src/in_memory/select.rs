//! How the terms of a surface are chosen.
//!
//! In: a method and its numbers. Out: a [`Select`], for a fit or for one response. The numbers are checked when the fit starts.

use crate::spec::{Direction, Method, Search, SearchBy};

/// The default order: that of a quadratic response surface.
const DEFAULT_ORDER: u32 = 2;

/// How terms are chosen.
///
/// ```
/// use rsm_fit::{Fit, Select};
///
/// let x = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0];
/// let y = x.map(|x: f64| 1.0 + 0.5 * x * x + 0.01 * (7.0 * x).sin());
/// let outcome = Fit::new(&x, &y).select(Select::stepwise(4)).fit()?;
/// let error = &outcome.statistics("y").unwrap().cross_validation.as_ref().unwrap().errors;
/// assert!(error.rmse < 0.05); // of rows that were left out with the choice of terms repeated
/// # Ok::<(), rsm_fit::Refused>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct Select {
    pub(super) order: Option<u32>,
    pub(super) confidence: Option<f64>,
    pub(super) terms: Option<Vec<Vec<u32>>>,
    search: Option<Search>,
}

impl Select {
    /// All terms up to this order.
    #[must_use]
    pub fn order(order: u32) -> Self {
        Select { order: Some(order), ..Select::default() }
    }

    /// Exactly these terms. Each has a power for every input, then one for every knot.
    #[must_use]
    pub fn terms<T: Into<Vec<u32>>>(terms: impl IntoIterator<Item = T>) -> Self {
        Select { terms: Some(terms.into_iter().map(Into::into).collect()), ..Select::default() }
    }

    /// A ladder: terms up to this order are added until the confidence C, in percent, is reached.
    #[must_use]
    pub fn ladder(max_order: u32, confidence: f64) -> Self {
        Select { order: Some(max_order), confidence: Some(confidence), ..Select::default() }
    }

    /// Stepwise selection in both directions among all terms up to this order. Cross-validation chooses the number of terms.
    #[must_use]
    pub fn stepwise(max_order: u32) -> Self {
        Select::search(Search::new(SearchBy::Stepwise(Direction::Both), max_order))
    }

    /// The best subset of each size among all terms up to this order, at most 40. Cross-validation chooses the size.
    #[must_use]
    pub fn best_subset(max_order: u32) -> Self {
        Select::search(Search::new(SearchBy::BestSubset, max_order))
    }

    /// The LASSO with all terms up to this order. Cross-validation chooses the penalty and the shrinkage of the coefficients.
    #[must_use]
    pub fn lasso(max_order: u32) -> Self {
        Select::search(Search::new(SearchBy::Lasso, max_order))
    }

    /// A search with other settings: another criterion, heredity, or the one-standard-error rule.
    #[must_use]
    pub fn search(search: Search) -> Self {
        Select { search: Some(search), ..Select::default() }
    }

    /// `None` if both terms and a method to choose them were given.
    pub(super) fn method(&self) -> Option<Method> {
        match (&self.terms, self.order, self.confidence, self.search) {
            (None, None, None, Some(search)) => Some(Method::Search(search)),
            (_, _, _, Some(_)) => None,
            (Some(terms), None, None, None) => Some(Method::Fixed(terms.clone())),
            (Some(_), ..) => None,
            (None, order, Some(confidence), None) => {
                Some(Method::Ladder { max_order: order.unwrap_or(DEFAULT_ORDER), confidence })
            }
            (None, order, None, None) => Some(Method::FixedOrder(order.unwrap_or(DEFAULT_ORDER))),
        }
    }

    /// Faults that a specification file cannot have.
    pub(super) fn faults(&self) -> Vec<String> {
        let mut faults = Vec::new();
        let highest = rsm_core::model_file::HIGHEST_POWER;
        if self.method().is_none() {
            faults.push("found both terms and a method that chooses them, expected one of them".to_string());
        }
        let order = self.order.or(self.search.map(|search| search.max_order));
        if let Some(order) = order.filter(|order| !(1..=highest).contains(order)) {
            faults.push(format!("the order: found {order}, expected a whole number from 1 to {highest}"));
        }
        for power in self.terms.iter().flatten().flatten().filter(|power| **power > highest) {
            faults.push(format!("a term: found the power {power}, expected at most {highest}"));
        }
        faults
    }
}

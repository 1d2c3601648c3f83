//! The path of a search through sets of causes, and the limits at which it ends.
//!
//! In: the steps of a search. Out: whether the next step is allowed. Independent of the causes.

/// The largest number of additions: the four causes that a search may have, two that were removed again, and two more after a pair.
const MOST_ADDITIONS: usize = 8;

/// The largest number of competitions. A competition is a screen with its refinements and fits. Each addition needs one, and each of four causes
/// needs two for its rivals; two are spare. All other work lies between them, and each piece of it removes a cause.
const MOST_COMPETITIONS: usize = 16;

/// The largest number of exchanges of one cause for another. With more, two causes probably alternate.
const MOST_EXCHANGES: usize = 3;

/// The limit that ends a search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Limit {
    /// The largest number of additions was reached.
    Additions,
    /// The largest number of competitions was reached.
    Competitions,
    /// The largest number of exchanges was reached.
    Exchanges,
    /// The largest work of simulations was reached.
    Work,
    /// The search returned to an earlier set of causes.
    Cycle,
}

impl std::fmt::Display for Limit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Limit::Additions => write!(f, "after {MOST_ADDITIONS} additions of a cause"),
            Limit::Competitions => write!(f, "after {MOST_COMPETITIONS} competitions between causes"),
            Limit::Exchanges => write!(f, "after {MOST_EXCHANGES} exchanges of a cause"),
            Limit::Work => write!(f, "at the limit for the work of all simulations"),
            Limit::Cycle => write!(f, "because it returned to an earlier set of causes"),
        }
    }
}

/// The history of a search, so that it ends: the sets of causes it has visited, and counts against the limits.
#[derive(Debug, Default)]
pub struct SearchHistory {
    visited: Vec<Vec<String>>,
    additions: usize,
    competitions: usize,
    exchanges: usize,
    /// The work up to which a competition may begin.
    until: Option<u64>,
    /// The work up to which rivals may be tested.
    until_rivals: Option<u64>,
    stopped: Option<Limit>,
}

impl SearchHistory {
    /// A path whose competitions may begin within this work, and tests of rivals within `for_rivals` more.
    #[must_use]
    pub fn until(work: u64, for_rivals: u64) -> Self {
        SearchHistory { until: Some(work), until_rivals: Some(work + for_rivals), ..SearchHistory::default() }
    }

    /// Whether the search may continue after this work.
    pub fn has_work_left(&mut self, work: u64) -> bool {
        self.until.is_none_or(|until| work <= until) || self.stop(Limit::Work)
    }

    /// Whether work is left to test rivals.
    pub fn has_work_left_for_rivals(&mut self, work: u64) -> bool {
        self.until_rivals.is_none_or(|until| work <= until) || self.stop(Limit::Work)
    }

    /// Records a set of causes; false if the search has visited it before. The order of causes does not matter.
    pub fn visit(&mut self, mut causes: Vec<String>) -> bool {
        causes.sort_unstable();
        let is_new = !self.visited.contains(&causes);
        if is_new {
            self.visited.push(causes);
        }
        is_new
    }

    /// The same for a set of causes to which the search should not return: then it ends.
    pub fn visit_once(&mut self, causes: Vec<String>) -> bool {
        self.visit(causes) || self.stop(Limit::Cycle)
    }

    /// Whether the search has visited a sorted set of causes.
    #[must_use]
    pub fn has_visited(&self, causes: &[String]) -> bool {
        self.visited.iter().any(|known| known == causes)
    }

    /// Whether one more addition is allowed; counts it.
    pub fn may_add(&mut self) -> bool {
        self.additions += 1;
        self.additions <= MOST_ADDITIONS || self.stop(Limit::Additions)
    }

    /// Whether one more competition is allowed; counts it.
    pub fn may_compete(&mut self) -> bool {
        self.competitions += 1;
        self.competitions <= MOST_COMPETITIONS || self.stop(Limit::Competitions)
    }

    /// Whether one more exchange is allowed; counts it.
    pub fn may_exchange(&mut self) -> bool {
        self.exchanges += 1;
        self.exchanges <= MOST_EXCHANGES || self.stop(Limit::Exchanges)
    }

    /// The first limit that was reached.
    #[must_use]
    pub fn stopped(&self) -> Option<Limit> {
        self.stopped
    }

    fn stop(&mut self, limit: Limit) -> bool {
        self.stopped = self.stopped.or(Some(limit));
        false
    }
}

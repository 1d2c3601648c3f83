//! The path of a search through sets of causes, and the limits at which it ends.
//!
//! In: the steps of a search. Out: whether the next step is allowed. Independent of the meaning of a cause.

/// Additions at most: all causes that an effort allows (four), two that a removal undid, and two more after a pair.
const MOST_ADDITIONS: usize = 8;

/// Competitions at most, a competition being a screen with its profiles and fits: every addition, and twice the question what else could stand for each of four
/// causes, with two to spare. All other work lies between them, and each piece of it removes a cause.
const MOST_COMPETITIONS: usize = 16;

/// Exchanges of one cause for another at most; beyond, two causes are likely to take turns.
const MOST_EXCHANGES: usize = 3;

/// What ends a search that would go on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Limit {
    /// Causes were added as often as is allowed.
    Additions,
    /// Competitions were held as often as is allowed.
    Competitions,
    /// Causes were exchanged as often as is allowed.
    Exchanges,
    /// Simulations took as many steps as are allowed.
    Steps,
    /// A set of causes came back that had been left: it goes round in a circle.
    Circle,
}

impl std::fmt::Display for Limit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Limit::Additions => write!(f, "after {MOST_ADDITIONS} additions of a cause"),
            Limit::Competitions => write!(f, "after {MOST_COMPETITIONS} competitions between causes"),
            Limit::Exchanges => write!(f, "after {MOST_EXCHANGES} exchanges of a cause"),
            Limit::Steps => write!(f, "after as many steps of simulations as are allowed"),
            Limit::Circle => write!(f, "at a set of causes that it had been at before"),
        }
    }
}

/// What a search has done, so that it ends: sets of causes where it was, and counts against the limits.
#[derive(Debug, Default)]
pub struct Path {
    visited: Vec<Vec<String>>,
    additions: usize,
    competitions: usize,
    exchanges: usize,
    /// Sub-steps of simulations up to which a competition may begin.
    until: Option<u64>,
    /// Those up to which rivals may be asked.
    until_rivals: Option<u64>,
    stopped: Option<Limit>,
}

impl Path {
    /// A path on which competitions begin until simulations have taken this many sub-steps, and those of rivals until this many more.
    #[must_use]
    pub fn until(steps: u64, for_rivals: u64) -> Self {
        Path { until: Some(steps), until_rivals: Some(steps + for_rivals), ..Path::default() }
    }

    /// Whether simulations that have taken this many sub-steps may go on.
    pub fn has_steps(&mut self, taken: u64) -> bool {
        self.until.is_none_or(|until| taken <= until) || self.stop(Limit::Steps)
    }

    /// Whether there is work left to ask for rivals.
    pub fn has_steps_for_rivals(&mut self, taken: u64) -> bool {
        self.until_rivals.is_none_or(|until| taken <= until) || self.stop(Limit::Steps)
    }

    /// Goes to a set of causes; false where the search was there before. The order of causes is no difference.
    pub fn visit(&mut self, mut causes: Vec<String>) -> bool {
        causes.sort_unstable();
        if self.visited.contains(&causes) {
            return self.stop(Limit::Circle);
        }
        self.visited.push(causes);
        true
    }

    /// Whether the search was at a set of causes, sorted.
    #[must_use]
    pub fn knows(&self, causes: &[String]) -> bool {
        self.visited.iter().any(|known| known == causes)
    }

    /// Whether one more addition is allowed; counts it.
    pub fn adds(&mut self) -> bool {
        self.additions += 1;
        self.additions <= MOST_ADDITIONS || self.stop(Limit::Additions)
    }

    /// Whether one more competition is allowed; counts it.
    pub fn competes(&mut self) -> bool {
        self.competitions += 1;
        self.competitions <= MOST_COMPETITIONS || self.stop(Limit::Competitions)
    }

    /// Whether one more exchange is allowed; counts it.
    pub fn exchanges(&mut self) -> bool {
        self.exchanges += 1;
        self.exchanges <= MOST_EXCHANGES || self.stop(Limit::Exchanges)
    }

    /// The first limit that was met.
    #[must_use]
    pub fn stopped(&self) -> Option<Limit> {
        self.stopped
    }

    fn stop(&mut self, limit: Limit) -> bool {
        self.stopped = self.stopped.or(Some(limit));
        false
    }
}

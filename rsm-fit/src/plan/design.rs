//! Factors, designs and conditions: what a plan is made of.

/// More runs than any bench makes; a plan of a million points by a slip of the keys is refused.
pub const MOST_RUNS: usize = 100_000;

/// A factor of the experiment.
#[derive(Debug, Clone, PartialEq)]
pub struct Factor {
    /// Its name, the name of its column.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// The values at which it is set, in the order of the file; of designs with a range none.
    pub levels: Vec<f64>,
    /// Where the coded -1 and 1 lie: the range, or the least and the greatest level.
    pub range: [f64; 2],
}

/// What an optimal design is best at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Criterion {
    /// The determinant of X'X: the volume of the confidence region of all coefficients is least.
    D,
    /// The mean variance of a prediction over the region.
    I,
    /// The mean variance of a coefficient.
    A,
}

/// Which points.
#[derive(Debug, Clone, PartialEq)]
pub enum Design {
    /// Every combination of levels: of all factors, or within each block.
    FullFactorial {
        /// The levels of each factor, block by block; one block where the file has none.
        blocks: Vec<Vec<Vec<f64>>>,
    },
    /// Cube, axial points, centre.
    CentralComposite {
        /// The coded distance of the axial points.
        alpha: f64,
    },
    /// Middles of edges, centre.
    BoxBehnken,
    /// One run in each slice of each factor.
    LatinHypercube {
        /// How many.
        runs: usize,
    },
    /// Independent points, equally likely everywhere.
    Random {
        /// How many.
        runs: usize,
    },
}

impl Design {
    /// Its name in the file.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Design::FullFactorial { .. } => "full-factorial",
            Design::CentralComposite { .. } => "central-composite",
            Design::BoxBehnken => "box-behnken",
            Design::LatinHypercube { .. } => "latin-hypercube",
            Design::Random { .. } => "random",
        }
    }

    /// How many different points were asked for; `None` where the design itself says how many there are, of which `where` keeps some.
    #[must_use]
    pub fn runs(&self) -> Option<usize> {
        match self {
            Design::LatinHypercube { runs } | Design::Random { runs } => Some(*runs),
            Design::FullFactorial { .. } | Design::CentralComposite { .. } | Design::BoxBehnken => None,
        }
    }
}

/// A half-space in the units of the factors.
#[derive(Debug, Clone, PartialEq)]
pub struct Condition {
    /// A weight a factor.
    pub weights: Vec<f64>,
    /// The weighted sum is at most this,
    pub at_most: Option<f64>,
    /// and at least this.
    pub at_least: Option<f64>,
}

impl Condition {
    /// Whether a point fulfils it.
    #[must_use]
    pub fn holds(&self, point: &[f64]) -> bool {
        let sum: f64 = self.weights.iter().zip(point).map(|(weight, value)| weight * value).sum();
        self.at_most.is_none_or(|most| sum <= most) && self.at_least.is_none_or(|least| sum >= least)
    }
}

//! Factors, designs and conditions: what a plan is made of.

use super::fraction::Fraction;

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

impl Criterion {
    /// Its name in the file.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Criterion::D => "D",
            Criterion::I => "I",
            Criterion::A => "A",
        }
    }
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
    /// A Latin hypercube of slice middles whose least distance between two runs is as large as a search makes it.
    MaximinHypercube {
        /// How many.
        runs: usize,
    },
    /// Points of Sobol's sequence, shifted by random bits.
    Sobol {
        /// How many.
        runs: usize,
    },
    /// Independent points, equally likely everywhere.
    Random {
        /// How many.
        runs: usize,
    },
    /// A fraction of the corners.
    FractionalFactorial(Fraction),
    /// Three levels; main effects are clear of all effects of second order.
    DefinitiveScreening,
    /// The runs that tell given terms apart best.
    Optimal(Optimum),
}

/// What an optimal design is to be. Points are in the units of the factors.
#[derive(Debug, Clone, PartialEq)]
pub struct Optimum {
    /// What it is best at.
    pub criterion: Criterion,
    /// How many runs, `mandatory` among them.
    pub runs: usize,
    /// How many runs each block has; empty: there are no blocks.
    pub block_sizes: Vec<usize>,
    /// Points that are run whatever the criterion says.
    pub mandatory: Vec<Vec<f64>>,
    /// The only points that may be run; none where any within the ranges and `where` may.
    pub candidates: Option<Vec<Vec<f64>>>,
    /// Searches from a new start; none where their number is left to the search.
    pub restarts: Option<usize>,
}

impl Design {
    /// Its name in the file.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Design::FullFactorial { .. } => "full-factorial",
            Design::CentralComposite { .. } => "central-composite",
            Design::BoxBehnken => "box-behnken",
            Design::LatinHypercube { .. } | Design::MaximinHypercube { .. } => "latin-hypercube",
            Design::Sobol { .. } => "sobol",
            Design::Random { .. } => "random",
            Design::FractionalFactorial(_) => "fractional-factorial",
            Design::DefinitiveScreening => "definitive-screening",
            Design::Optimal(_) => "optimal",
        }
    }

    /// Whether it is made for terms of first order.
    pub(super) fn is_of_first_order(&self) -> bool {
        matches!(self, Design::FullFactorial { .. } | Design::FractionalFactorial(_) | Design::DefinitiveScreening)
    }

    /// How many different points were asked for; `None` where the design itself says how many there are, of which `where` keeps some.
    #[must_use]
    pub fn runs(&self) -> Option<usize> {
        match self {
            Design::LatinHypercube { runs }
            | Design::MaximinHypercube { runs }
            | Design::Sobol { runs }
            | Design::Random { runs } => Some(*runs),
            Design::Optimal(wanted) => Some(wanted.runs),
            Design::FullFactorial { .. }
            | Design::CentralComposite { .. }
            | Design::BoxBehnken
            | Design::FractionalFactorial(_)
            | Design::DefinitiveScreening => None,
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

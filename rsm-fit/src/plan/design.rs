//! Factors, designs and conditions: the parts of a plan.

use super::fraction::Fraction;

/// The largest number of runs. Larger plans, usually a typing error, are rejected.
pub const MOST_RUNS: usize = 100_000;

/// A factor of the experiment.
#[derive(Debug, Clone, PartialEq)]
pub struct Factor {
    /// Its name and the name of its column.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// Its levels, in the order of the file; empty for designs with a range.
    pub levels: Vec<f64>,
    /// The values of coded -1 and 1: the range, or the smallest and the largest level.
    pub range: [f64; 2],
}

/// The criterion of an optimal design.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Criterion {
    /// D-optimal: the largest determinant of X'X, so the smallest volume of the confidence region of all coefficients.
    D,
    /// I-optimal: the smallest mean variance of a prediction over the region.
    I,
    /// A-optimal: the smallest mean variance of a coefficient.
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

/// The design.
#[derive(Debug, Clone, PartialEq)]
pub enum Design {
    /// Every combination of levels: of all factors, or within each block.
    FullFactorial {
        /// The levels of each factor, block by block; one block if the file has none.
        blocks: Vec<Vec<Vec<f64>>>,
    },
    /// Corners, axial points and centre.
    CentralComposite {
        /// The coded distance of the axial points.
        alpha: f64,
    },
    /// Middles of edges and centre.
    BoxBehnken,
    /// One run in each slice of each factor.
    LatinHypercube {
        /// The number of runs.
        runs: usize,
    },
    /// A Latin hypercube of slice middles, with the smallest distance between two runs maximised by a search.
    MaximinHypercube {
        /// The number of runs.
        runs: usize,
    },
    /// Points of Sobol's sequence, shifted by random bits.
    Sobol {
        /// The number of runs.
        runs: usize,
    },
    /// Independent points, uniformly distributed.
    Random {
        /// The number of runs.
        runs: usize,
    },
    /// A fraction of the corners.
    FractionalFactorial(Fraction),
    /// Three levels; main effects are not aliased with any second-order effect.
    DefinitiveScreening,
    /// The best runs to estimate given terms.
    Optimal(Optimum),
}

/// The requirements on an optimal design. Points are in the units of the factors.
#[derive(Debug, Clone, PartialEq)]
pub struct Optimum {
    /// What it is best at.
    pub criterion: Criterion,
    /// The number of runs, including `mandatory`.
    pub runs: usize,
    /// The number of runs in each block; empty without blocks.
    pub block_sizes: Vec<usize>,
    /// Points that must be in the design.
    pub mandatory: Vec<Vec<f64>>,
    /// The only allowed points; `None` if all points within the ranges and `where` are allowed.
    pub candidates: Option<Vec<Vec<f64>>>,
    /// The number of searches from a new start; `None` for the default.
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

    /// Whether it is a design for first-order terms.
    pub(super) fn is_of_first_order(&self) -> bool {
        matches!(self, Design::FullFactorial { .. } | Design::FractionalFactorial(_) | Design::DefinitiveScreening)
    }

    /// The number of different points requested; `None` if the design defines its points, of which `where` keeps some.
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
    /// One weight for each factor.
    pub weights: Vec<f64>,
    /// The upper bound of the weighted sum,
    pub at_most: Option<f64>,
    /// and the lower bound.
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

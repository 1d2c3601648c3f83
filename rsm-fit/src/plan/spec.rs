//! The specification of a designed experiment.
//!
//! In: a TOML file. Out: a [`DesignSpecification`] whose parts fit together, or every fault with line and column and what is accepted.
//!
//! ```toml
//! format = 1
//! plan = "dynamometer"
//! seed = 7                        # of the random run order, and of random points
//! # design = "full-factorial"     # | "central-composite" | "box-behnken" | "latin-hypercube" | "random" | "sobol"
//! #                               # | "fractional-factorial" | "definitive-screening" | "optimal"
//! # runs = 40                     # latin-hypercube, random, sobol, optimal: how many, all within `where`; of the other designs `where` keeps some
//! # criterion = "D"               # optimal: | "I" | "A"; latin-hypercube: "maximin"
//! # order = 2                     # the model: or `terms`, or `terms_of = { file = "fit.toml", surface = "angle" }`
//! # candidates = "points.csv"     # optimal; also `block_sizes`, `mandatory`, `restarts`; of any design `support_of`
//! # generators = { d = "a*b*c" }  # fractional-factorial
//! # alpha = "rotatable"           # central-composite: | "face-centred" | a number, the coded place of the axial points
//! # replicates = 2                # every point so many times
//! # centre_points = 3             # the centre so many times, spread over the run order
//! # where = [{ sum = { speed = 1.0, gear = -800.0 }, at_most = 2800.0 }]    # keep points whose weighted sum is `at_most` or
//! #                               # `at_least` this, in the units of the factors
//!
//! [factors.depth]
//! unit = "%"
//! levels = { from = 10, to = 100, step = 10 }     # | { from, to, count } | a list; full-factorial alone
//! [factors.advance]
//! unit = "deg"
//! levels = [0, 10, 20]
//! # range = [0, 170]              # every other design: where the coded -1 and 1 lie
//!
//! [[blocks]]                      # full-factorial: the plan is the union of blocks, a point in two of them is run once
//! depth = [10, 70]                # levels in place of the factor's own
//! ```

use std::path::Path;

use rsm_core::places::Places;
use rsm_core::source::{Collector, Fault, Faults, Source};

use super::design::{Condition, Design, Factor};
use super::read;

/// The specification of an experiment.
#[derive(Debug)]
pub struct DesignSpecification {
    /// The name of the plan.
    pub plan: String,
    /// The seed of the run order and of random points.
    pub seed: u64,
    /// The design.
    pub design: Design,
    /// The factors, in the order of the file.
    pub factors: Vec<Factor>,
    /// The number of runs of every point.
    pub replicates: usize,
    /// The number of runs of the centre point.
    pub centre_points: usize,
    /// The conditions on every point.
    pub conditions: Vec<Condition>,
    /// The terms of the model: a power of each coded factor. Second order if the file has none.
    pub terms: Vec<Vec<u32>>,
    /// Its text; `None` if it was made in memory.
    source: Option<Source>,
    places: Places,
}

/// The name of a design in memory in messages.
pub(super) const IN_MEMORY: &str = "design";

impl DesignSpecification {
    /// Reads a specification from its text.
    ///
    /// # Errors
    /// Every fault of the text.
    ///
    /// ```
    /// use rsm_core::source::Source;
    /// use rsm_fit::plan::{DesignSpecification, Plan};
    ///
    /// let text = "format = 1\nplan = \"dyno\"\nseed = 7\n[factors.gear]\nunit = \"1\"\nlevels = { from = 1, to = 5, step = 1 }\n";
    /// let specification = DesignSpecification::from_source(Source::new("dyno.toml", text))?;
    /// assert_eq!(Plan::make(&specification)?.points(), 5);
    /// # Ok::<(), rsm_core::source::Faults>(())
    /// ```
    pub fn from_source(source: Source) -> Result<Self, Faults> {
        Self::from_source_in(source, Path::new(""))
    }

    /// The same; files in it (`candidates`, `terms_of`, `support_of`) are relative to a folder.
    ///
    /// # Errors
    /// Every fault of the text and of those files.
    pub fn from_source_in(source: Source, folder: &Path) -> Result<Self, Faults> {
        let mut faults = Collector::new();
        let draft = read::read(&source, folder, &mut faults);
        let specification = draft.map(|(draft, places)| {
            let read::Draft { plan, seed, design, factors, replicates, centre_points, conditions, terms } = draft;
            let source = Some(source);
            DesignSpecification { plan, seed, design, factors, replicates, centre_points, conditions, terms, source, places }
        });
        faults.finish(specification)
    }

    /// A specification whose parts are known to fit together.
    pub(super) fn in_memory(
        seed: u64,
        design: Design,
        factors: Vec<Factor>,
        (replicates, centre_points): (usize, usize),
        conditions: Vec<Condition>,
        terms: Vec<Vec<u32>>,
    ) -> Self {
        let (plan, source, places) = (IN_MEMORY.to_string(), None, Places::default());
        DesignSpecification { plan, seed, design, factors, replicates, centre_points, conditions, terms, source, places }
    }

    /// Whether a point, in the units of the factors, fulfils all conditions.
    pub(super) fn allows(&self, point: &[f64]) -> bool {
        self.conditions.iter().all(|condition| condition.holds(point))
    }

    /// A fault at a part of the specification, by its dotted path.
    pub(super) fn fault(&self, path: &str, what: impl Into<String>) -> Fault {
        match &self.source {
            Some(source) => source.fault(self.places.place(path), what),
            None => Fault::whole_file(IN_MEMORY, what),
        }
    }
}

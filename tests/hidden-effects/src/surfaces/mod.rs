//! Surfaces with hidden causes in their new data: model files and CSV files, from code that shares nothing with the diagnosis.
//!
//! In: a seed and the name of a case. Out: [`Case`]: a nominal model file, new data, unseen data, the hidden causes. The nominal coefficients are
//! exact (a published file, without evidence) or fitted here to rows with noise (evidence with their number). The clock is never used; the same seed
//! gives the same files.
//!
//! In a few pairs, the data cannot show both causes; such a case counts as wrong if one cause is named for the two. Let t be the position in the run
//! order from 0 to 1. A bias b and a drift d (t - 1/2) are together b - d/2 + d t. If b is within its standard error of d/2, this is a single drift d
//! t that begins at the correct value. A file that was fitted without a term c m contains c times the constant part p of m. What remains is c (m -
//! p) + b; for b near c p this is the term alone, c m, as in a file that was fitted without this effect. A step at the first run of a block that
//! reaches to the end is the offset of that block: both have the same column. Only in the last case a rival in `indistinguishable_from` counts as
//! correct, because it is one cause for one. The others are about one of 100 pairs, and count as misses in the table.

mod bench;
mod draw;
mod files;
pub mod judge;
pub mod polynomial;
mod swept;

pub use bench::{Fault, FaultKind};
use draw::make;
use swept::Lack;

use crate::random::Random;

/// A hidden cause.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hidden {
    /// A term of the order of the file, or of the next one.
    MissingTerm,
    /// A column has an effect, alone or also with an input.
    MissingInput,
    /// The response changes with the run order.
    Drift,
    /// The response has a step at a run.
    Step,
    /// Levels of a column have offsets.
    Blocks,
    /// A gain error of the response's sensor.
    ResponseGain,
    /// A bias of the response's sensor.
    ResponseBias,
    /// A gain error of an input's sensor.
    InputGain,
    /// A bias of an input's sensor.
    InputBias,
    /// One to four gross errors.
    Outliers,
    /// Noise that increases with the response.
    GrowingNoise,
    /// Correlated noise.
    Following,
    /// A sine, a kink or a bump: not in the catalogue.
    Outside,
}

/// The families of cases.
pub const FAMILIES: [&str; 12] = [
    "singles",
    "nulls",
    "pairs",
    "triples",
    "outside",
    "swept",
    "stuck",
    "clipped",
    "quantised",
    "duplicated",
    "scaled",
    "direction",
];

/// The families of data faults, and the cases of each.
const FAULTS: [(&str, FaultKind); 6] = [
    ("stuck", FaultKind::Stuck),
    ("clipped", FaultKind::Clipped),
    ("quantised", FaultKind::Quantised),
    ("duplicated", FaultKind::Duplicated),
    ("scaled", FaultKind::Scaled),
    ("direction", FaultKind::Direction),
];
const FAULTS_OF_A_KIND: usize = 5;

const SINGLES: [(&str, Hidden); 12] = [
    ("missing-term", Hidden::MissingTerm),
    ("missing-input", Hidden::MissingInput),
    ("drift", Hidden::Drift),
    ("step", Hidden::Step),
    ("blocks", Hidden::Blocks),
    ("response-gain", Hidden::ResponseGain),
    ("response-bias", Hidden::ResponseBias),
    ("input-gain", Hidden::InputGain),
    ("input-bias", Hidden::InputBias),
    ("outliers", Hidden::Outliers),
    ("growing-noise", Hidden::GrowingNoise),
    ("following", Hidden::Following),
];

/// A hidden cause in the form of lists of causes, with the number that a diagnosis should find.
#[derive(Debug, Clone, PartialEq)]
pub struct Truth {
    /// KIND, or KIND:NAME.
    pub label: String,
    /// The name of the number and its value; `None` if there is no single one.
    pub number: Option<(&'static str, f64)>,
}

/// A case.
#[derive(Debug, Clone)]
pub struct Case {
    /// Its name.
    pub name: String,
    /// The correct verdict.
    pub verdict: &'static str,
    /// The hidden causes.
    pub truths: Vec<Truth>,
    /// The nominal model file.
    pub model: String,
    /// New data.
    pub data: String,
    /// Unseen data, with noise.
    pub unseen: String,
    /// The response of the unseen rows without noise, as read by the faulty sensors of the new data.
    pub exact: Vec<f64>,
    /// The nominal model at these rows.
    pub nominal: Vec<f64>,
    /// Whether an extended model file can be better than the nominal one.
    pub in_file: bool,
    /// The fault of the new data.
    pub fault: Option<Fault>,
}

/// The cases of a seed.
pub fn cases(seed: u64, family: Option<&str>) -> Vec<Case> {
    let wanted = |name: &str| family.is_none_or(|family| family == name);
    let mut cases = Vec::new();
    if wanted("singles") {
        cases.extend(SINGLES.map(|(name, hidden)| make(seed, &format!("single-{name}"), &[hidden])));
    }
    if wanted("nulls") {
        cases.extend((0..10).map(|k| make(seed, &format!("null-{k}"), &[])));
    }
    for (family, count, number) in [("pairs", 2, 10), ("triples", 3, 4)] {
        if wanted(family) {
            for k in 0..number {
                let name = format!("{family}-{k}");
                let hidden = several(&mut Random::new(seed, &format!("{name} which")), count);
                cases.push(make(seed, &name, &hidden));
            }
        }
    }
    if wanted("outside") {
        cases.extend((0..6).map(|k| make(seed, &format!("outside-{k}"), &[Hidden::Outside])));
    }
    if wanted("swept") {
        let lacks = [Lack::Teeth, Lack::Order, Lack::Trip, Lack::Nothing, Lack::Noise];
        cases.extend(lacks.map(|lack| swept::make(seed, &format!("swept-{lack:?}").to_lowercase(), lack)));
    }
    for (family, kind) in FAULTS.into_iter().filter(|(family, _)| wanted(family)) {
        cases.extend((0..FAULTS_OF_A_KIND).map(|k| bench::make(seed, &format!("{family}-{k}"), kind)));
    }
    cases
}

/// Different causes without equivalent effects: offsets of blocks, a missing input with an unknown reference value, a step and a bias of the response
/// all shift the whole response.
fn several(random: &mut Random, count: usize) -> Vec<Hidden> {
    const SHIFTS: [Hidden; 4] = [Hidden::Blocks, Hidden::MissingInput, Hidden::Step, Hidden::ResponseBias];
    // Both belong to the straight line of a sensor: to distinguish gain and bias, the range must include zero, which few ranges do.
    const LINES: [[Hidden; 2]; 2] = [[Hidden::ResponseGain, Hidden::ResponseBias], [Hidden::InputGain, Hidden::InputBias]];
    const ORDER: [Hidden; 4] = [Hidden::Drift, Hidden::Step, Hidden::Blocks, Hidden::Following];
    let mut chosen: Vec<Hidden> = Vec::new();
    while chosen.len() < count {
        let hidden = random.one_of(&SINGLES).1;
        let clash = |group: &[Hidden]| group.contains(&hidden) && chosen.iter().any(|other| group.contains(other));
        // Both kinds of noise at once, or a drift with correlated noise, cannot be distinguished in a hundred rows.
        let noises = [Hidden::GrowingNoise, Hidden::Following];
        if !chosen.contains(&hidden)
            && !clash(&SHIFTS)
            && !clash(&ORDER)
            && !clash(&noises)
            && !LINES.iter().any(|line| clash(line))
        {
            chosen.push(hidden);
        }
    }
    chosen
}

//! Surfaces with something hidden in their new data: model files and CSV files, made by code that shares nothing with the diagnosis.
//!
//! In: a seed and the name of a case. Out: [`Case`]: a nominal model file, new data, unseen data, what was hidden. The nominal coefficients are exact (a published file, without evidence) or fitted
//! here to rows with noise (evidence with their number). Never the clock; the same seed gives the same files.
//!
//! A few pairs are drawn that their data cannot show, and count as wrong when one cause is named for two. With t the place in the run order from 0 to 1: a bias b and a drift d (t - 1/2) are b - d/2 + d t, so for b
//! within its standard error of d/2 they are the one drift d t that begins at the right value. A file without a term c m had taken up c times the constant part p of m: what is left, c (m - p) + b, is for b near c p the
//! term alone, c m, which a file that never saw it lacks. And a step at the first run of a block that reaches to the end is the offset of that block: one column. Only the last is told by a rival in
//! `indistinguishable_from`, as it is one cause for one; the others are about one of 100 pairs, and stay in the table as misses.

mod draw;
mod files;
pub mod judge;
pub mod polynomial;
mod swept;

use draw::make;
use swept::Lack;

use crate::random::Random;

/// What can be hidden.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hidden {
    /// A term of the order of the file, or one above.
    MissingTerm,
    /// A column acts, alone or also with an input.
    MissingInput,
    /// The response moves with the run order.
    Drift,
    /// The response jumps at a run.
    Step,
    /// Levels of a column have offsets.
    Blocks,
    /// The response's sensor.
    ResponseGain,
    /// The response's sensor.
    ResponseBias,
    /// An input's sensor.
    InputGain,
    /// An input's sensor.
    InputBias,
    /// One to four gross errors.
    Outliers,
    /// Noise that follows the response.
    GrowingNoise,
    /// Noise that follows itself.
    Following,
    /// A sine, a kink or a bump: in no catalogue.
    Outside,
}

/// The families of cases.
pub const FAMILIES: [&str; 6] = ["singles", "nulls", "pairs", "triples", "outside", "swept"];

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

/// A cause that was hidden, as lists of causes write it, with the number that a diagnosis should find.
#[derive(Debug, Clone, PartialEq)]
pub struct Truth {
    /// KIND, or KIND:NAME.
    pub label: String,
    /// The name of the number and its value; none where there is no single one.
    pub number: Option<(&'static str, f64)>,
}

/// A case.
#[derive(Debug, Clone)]
pub struct Case {
    /// Its name.
    pub name: String,
    /// The verdict that is right.
    pub verdict: &'static str,
    /// What was hidden.
    pub truths: Vec<Truth>,
    /// The nominal model file.
    pub model: String,
    /// New data.
    pub data: String,
    /// Unseen data, with noise.
    pub unseen: String,
    /// The response of the unseen rows without noise, as the faulty sensors of the new data would have it.
    pub exact: Vec<f64>,
    /// The nominal model there.
    pub nominal: Vec<f64>,
    /// Whether an extended model file can be better than the nominal one.
    pub in_file: bool,
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
    cases
}

/// Different causes that do not say the same: offsets of blocks, a missing input whose reference value nobody knows, a step and a bias of the response all shift the response as a whole.
fn several(random: &mut Random, count: usize) -> Vec<Hidden> {
    const SHIFTS: [Hidden; 4] = [Hidden::Blocks, Hidden::MissingInput, Hidden::Step, Hidden::ResponseBias];
    // One line of a sensor: gain and bias apart need a range around zero, which few have.
    const LINES: [[Hidden; 2]; 2] = [[Hidden::ResponseGain, Hidden::ResponseBias], [Hidden::InputGain, Hidden::InputBias]];
    const ORDER: [Hidden; 4] = [Hidden::Drift, Hidden::Step, Hidden::Blocks, Hidden::Following];
    let mut chosen: Vec<Hidden> = Vec::new();
    while chosen.len() < count {
        let hidden = random.one_of(&SINGLES).1;
        let clash = |group: &[Hidden]| group.contains(&hidden) && chosen.iter().any(|other| group.contains(other));
        // Noise of both kinds at once, or drift under correlated noise, is asked of nobody in a hundred rows.
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

//! Plans: the runs of an experiment and their order.
//!
//! In: a [`DesignSpecification`], or a plan file. Out: a [`Plan`] with one row for each run, in random order if it is made from a specification; its
//! CSV `run[1],factor[unit],...`. The same specification gives the same bytes on every machine.
//!
//! The run order is random, so that a drift during the experiment does not look like the effect of a factor. Centre points are equally spaced in it,
//! including its start and its end, where they show such a drift (Montgomery, Design and Analysis of Experiments, 6.8).

mod design;
mod evaluation;
mod experiment;
mod fraction;
mod kept;
mod levels;
mod maximin;
mod optimal;
mod optimum;
mod points;
mod read;
mod read_optimal;
mod rules;
mod screening;
mod sobol;
mod spec;

use std::collections::BTreeSet;

use rsm_core::source::{Collector, Fault, Faults, Source};

pub use design::{Condition, Criterion, Design, Factor, MOST_RUNS, Optimum};
pub use evaluation::{
    Alias, AliasRow, Efficiency, Evaluation, Freedom, Leverage, PredictionVariance, Quantile, Relation, Runs, TermEvaluation,
};
pub use experiment::{Alpha, Experiment};
pub use fraction::{Effect, Fraction};
pub use kept::Kept;
pub use optimum::Existing;
pub use spec::DesignSpecification;

use crate::random::Random;
use crate::table::{Table, Wanted};
use crate::units::Conversion;

/// The column of the run order.
const RUN: &str = "run";

/// The column of the blocks, after that of the run order.
const BLOCK: &str = "block";

/// The number of draws for each requested point after which the region of `where` counts as empty.
const MOST_DRAWS: usize = 1_000_000;

/// The runs of an experiment, in the order in which they are made.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// The number of every run.
    pub runs: Vec<u32>,
    /// The factors, with one setting for each run.
    pub factors: Vec<PlanFactor>,
    /// The effect of `where` on a design with fixed points; `None` if no point was removed.
    pub kept: Option<Kept>,
    /// The block of every run, counted from 1; empty where there are no blocks. A column `block` of the file.
    pub blocks: Vec<u32>,
    /// Its file; `None` if it was made in memory.
    place: Option<Place>,
}

/// A factor of a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanFactor {
    /// Its name.
    pub name: String,
    /// The unit of its settings.
    pub unit: String,
    /// One setting for each run.
    pub values: Vec<f64>,
}

/// The lines of a plan file.
#[derive(Debug, Clone, PartialEq)]
struct Place {
    file: String,
    header_line: usize,
    lines: Vec<usize>,
}

impl Plan {
    /// Makes the runs of a specification.
    ///
    /// # Errors
    /// If `where` leaves no point or fewer than `runs`; for a design with fixed points, if the rest cannot estimate its terms: those of first order
    /// for a factorial, of second order for the others.
    pub fn make(specification: &DesignSpecification) -> Result<Plan, Faults> {
        if let Design::Optimal(wanted) = &specification.design {
            return optimum::plan(specification, wanted, &Existing::default());
        }
        let mut random = Random::new(specification.seed);
        let holds = |point: &Vec<f64>| specification.allows(point);
        let centre: Vec<f64> = specification.factors.iter().map(|factor| physical(factor, 0.0)).collect();
        let (mut kept, mut lost) = (None, 0);
        let mut points = match &specification.design {
            Design::Random { runs } => random_points(specification, *runs, &mut random, &holds),
            Design::LatinHypercube { runs } if !specification.conditions.is_empty() => {
                hypercube_within(specification, *runs, &mut random, &holds)
            }
            Design::Sobol { runs } => sobol_points(specification, *runs, &mut random, &holds),
            other => {
                let mut all = all_points(specification, other, &mut random);
                let mut seen = BTreeSet::new();
                all.retain(|point| seen.insert(bits(point)));
                let points: points::Points = all.iter().filter(|point| holds(point)).cloned().collect();
                if other.runs().is_none() && points.len() < all.len() {
                    let (found, terms) = Kept::of(other, &all, &points, &centre, specification.centre_points);
                    (kept, lost) = (Some(found), terms);
                }
                points
            }
        };
        let mut seen = BTreeSet::new();
        points.retain(|point| seen.insert(bits(point)));
        let mut faults = Collector::new();
        if points.is_empty() {
            faults.push(specification.fault("where", "`where`: no point of the design fulfils it"));
        }
        if let Some(wanted) = specification.design.runs().filter(|wanted| !points.is_empty() && points.len() != *wanted) {
            let what = format!(
                "`where`: found {} different points of the design that fulfil it, expected {wanted} as in `runs`",
                points.len()
            );
            let help = "ask for fewer runs, widen the ranges, or loosen `where`";
            faults.push(specification.fault("where", what).help(help));
        }
        if let Some(kept) = kept.as_ref().filter(|_| lost > 0 && !points.is_empty()) {
            let order = if specification.design.is_of_first_order() { "first" } else { "second" };
            let what = format!(
                "`where`: only {} of {} points of the design fulfil it: {lost} of the terms of {order} order that the complete design can estimate cannot be estimated from them",
                kept.points, kept.of
            );
            let help = "loosen `where`, or ask for a `latin-hypercube`, which is planned within it";
            faults.push(specification.fault("where", what).help(help));
        }
        if specification.centre_points > 0 && !holds(&centre) {
            let what = format!("`where`: the centre ({}) does not fulfil it", list(&centre));
            faults.push(specification.fault("where", what).help("leave `centre_points` out"));
        }
        let mut order: Vec<Vec<f64>> = points.iter().flat_map(|point| vec![point.clone(); specification.replicates]).collect();
        random.shuffle(&mut order);
        spread(&mut order, &centre, specification.centre_points);
        let (runs, factors) = ((1..).take(order.len()).collect(), columns(specification, &order));
        faults.finish(Some(Plan { runs, factors, kept, blocks: Vec::new(), place: None }))
    }

    /// Reads a plan from its CSV. Every column except `run` is a factor with a unit. Runs have ascending numbers from 1, with gaps where rows were
    /// removed.
    ///
    /// # Errors
    /// Every fault of the file.
    ///
    /// ```
    /// use rsm_core::source::Source;
    /// use rsm_fit::plan::Plan;
    ///
    /// let plan = Plan::read(&Source::new("plan.csv", "run[1],speed[rpm]\n1,3000\n2,1500\n"))?;
    /// assert_eq!(plan.settings("speed", "r/min").unwrap(), [3000.0, 1500.0]);
    /// # Ok::<(), rsm_core::source::Faults>(())
    /// ```
    pub fn read(source: &Source) -> Result<Plan, Faults> {
        let table = Table::read(source, &Wanted { numbers: vec![RUN.to_string()], every_number: true, ..Wanted::default() })?;
        let mut faults = Collector::new();
        let place = Place { file: table.file.clone(), header_line: table.header_line, lines: table.lines.clone() };
        let runs = run_numbers(&table, &mut faults);
        let mut factors = Vec::new();
        let blocks = blocks_of(&table);
        let of_plan = |name: &str| name == RUN || (name == BLOCK && blocks.is_some());
        for column in table.columns.iter().filter(|column| !of_plan(&column.name)) {
            if column.unit.is_none() {
                let what = format!("column {} `{}`: it has no unit", column.place, column.name);
                let fault = Fault::at_line(&place.file, place.header_line, 0, what);
                faults.push(fault.help(format!("write `{}[unit]` in the header; `1` is no dimension", column.name)));
                continue;
            }
            match table.values_in(&column.name, None) {
                Ok((values, unit)) => factors.push(PlanFactor { name: column.name.clone(), unit, values }),
                Err(fault) => faults.push(fault),
            }
        }
        let names_a_factor = table.columns.iter().any(|column| !of_plan(&column.name));
        if !names_a_factor {
            let fault = Fault::at_line(&place.file, place.header_line, 0, "there is no factor beside the column `run`");
            faults.push(fault.help("the header of a plan is `run[1],factor[unit],...`"));
        }
        faults.finish(Some(Plan { runs, factors, kept: None, blocks: blocks.unwrap_or_default(), place: Some(place) }))
    }

    /// The factor with this name.
    #[must_use]
    pub fn factor(&self, name: &str) -> Option<&PlanFactor> {
        self.factors.iter().find(|factor| factor.name == name)
    }

    /// The settings of a factor in a unit.
    ///
    /// # Errors
    /// A fault at the header: the plan has no such factor, or its unit is of another kind.
    pub fn settings(&self, name: &str, unit: &str) -> Result<Vec<f64>, Fault> {
        let Some(factor) = self.factor(name) else {
            let known: Vec<String> = self.factors.iter().map(|factor| format!("`{}`", factor.name)).collect();
            let fault = self.fault_of_header(format!("the plan has no factor `{name}`"));
            return Err(fault.help(format!("its factors are {}", known.join(", "))));
        };
        let conversion = Conversion::between(&factor.unit, unit)
            .map_err(|reason| self.fault_of_header(format!("factor `{name}`: {reason}")))?;
        Ok(factor.values.iter().map(|value| conversion.apply(*value)).collect())
    }

    /// A fault at a row, counted from 0: a setting that is not possible.
    #[must_use]
    pub fn fault(&self, row: usize, what: impl Into<String>) -> Fault {
        match &self.place {
            Some(place) => Fault::at_line(&place.file, place.lines[row], 0, what),
            None => Fault::whole_file("plan", format!("run {}: {}", self.runs[row], what.into())),
        }
    }

    /// A fault at the header: a missing factor, or one that cannot be set.
    #[must_use]
    pub fn fault_of_header(&self, what: String) -> Fault {
        match &self.place {
            Some(place) => Fault::at_line(&place.file, place.header_line, 0, what),
            None => Fault::whole_file("plan", what),
        }
    }

    /// The number of different settings.
    #[must_use]
    pub fn points(&self) -> usize {
        let setting = |row: usize| self.factors.iter().map(|factor| factor.values[row].to_bits()).collect::<Vec<u64>>();
        (0..self.runs.len()).map(setting).collect::<BTreeSet<_>>().len()
    }

    /// The text of its file.
    ///
    /// ```
    /// use rsm_fit::plan::{Experiment, Factor};
    ///
    /// let plan = Experiment::full_factorial([Factor::at("gear", "1", [2.0])]).replicates(2).plan()?;
    /// assert_eq!(plan.csv(), "run[1],gear[1]\n1,2\n2,2\n");
    /// # Ok::<(), rsm_core::source::Faults>(())
    /// ```
    #[must_use]
    pub fn csv(&self) -> String {
        let mut text = format!("{RUN}[1]");
        if !self.blocks.is_empty() {
            text += &format!(",{BLOCK}[1]");
        }
        for factor in &self.factors {
            text += &format!(",{}[{}]", factor.name, factor.unit);
        }
        text += "\n";
        for (row, run) in self.runs.iter().enumerate() {
            text += &run.to_string();
            if let Some(block) = self.blocks.get(row) {
                text += &format!(",{block}");
            }
            for factor in &self.factors {
                text += ",";
                // As short as possible for the same bits.
                text += &factor.values[row].to_string();
            }
            text += "\n";
        }
        text
    }
}

/// The settings of the runs, factor by factor.
fn columns(specification: &DesignSpecification, points: &[Vec<f64>]) -> Vec<PlanFactor> {
    let of_factor = |(k, factor): (usize, &Factor)| PlanFactor {
        name: factor.name.clone(),
        unit: factor.unit.clone(),
        values: points.iter().map(|point| point[k]).collect(),
    };
    specification.factors.iter().enumerate().map(of_factor).collect()
}

fn bits(point: &[f64]) -> Vec<u64> {
    point.iter().map(|value| value.to_bits()).collect()
}

fn list(point: &[f64]) -> String {
    point.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
}

/// xi = mid + half x, the inverse of (22); exact at the ends of the range.
fn physical(factor: &Factor, coded: f64) -> f64 {
    let [low, high] = factor.range;
    // The weights sum to 1, and at -1 and 1 one of them is 0. + 0.0 makes both zeros equal.
    low * ((1.0 - coded) / 2.0) + high * ((1.0 + coded) / 2.0) + 0.0
}

fn all_points(specification: &DesignSpecification, design: &Design, random: &mut Random) -> points::Points {
    let factors = &specification.factors;
    let coded = match design {
        Design::FullFactorial { blocks } => return blocks.iter().flat_map(|levels| points::full_factorial(levels)).collect(),
        Design::CentralComposite { alpha } => points::central_composite(factors.len(), *alpha),
        Design::BoxBehnken => {
            points::box_behnken(factors.len()).expect("a read specification has a number of factors with such a design")
        }
        Design::LatinHypercube { runs } => points::latin_hypercube(factors.len(), *runs, random),
        Design::MaximinHypercube { runs } => maximin::hypercube(factors.len(), *runs, random),
        Design::FractionalFactorial(fraction) => fraction.points(),
        Design::DefinitiveScreening => {
            screening::points(factors.len()).expect("a read specification has a number of factors with such a design")
        }
        Design::Sobol { .. } | Design::Optimal(_) => unreachable!("they are made elsewhere"),
        Design::Random { runs } => (0..*runs).map(|_| points::anywhere(factors.len(), random)).collect(),
    };
    let of_point = |point: Vec<f64>| factors.iter().zip(point).map(|(factor, x)| physical(factor, x)).collect();
    coded.into_iter().map(of_point).collect()
}

/// Draws points until enough fulfil the conditions; fewer if the conditions leave almost nothing of the box.
fn random_points(
    specification: &DesignSpecification,
    runs: usize,
    random: &mut Random,
    holds: &dyn Fn(&Vec<f64>) -> bool,
) -> points::Points {
    let mut draw = || all_points(specification, &Design::Random { runs: 1 }, random).remove(0);
    let mut next = || (0..MOST_DRAWS).map(|_| draw()).find(|point| holds(point));
    (0..runs).map_while(|_| next()).collect()
}

/// The first points of Sobol's sequence that fulfil the conditions; fewer if the conditions leave almost nothing of the box.
fn sobol_points(
    specification: &DesignSpecification,
    runs: usize,
    random: &mut Random,
    holds: &dyn Fn(&Vec<f64>) -> bool,
) -> points::Points {
    let factors = &specification.factors;
    let mut sequence = sobol::Sobol::new(factors.len(), random);
    let mut next = || factors.iter().zip(sequence.next()).map(|(factor, x)| physical(factor, x)).collect::<Vec<f64>>();
    (0..MOST_DRAWS).map(|_| next()).filter(|point| holds(point)).take(runs).collect()
}

/// A Latin hypercube of which exactly `runs` points fulfil the conditions, made from one with more slices. Removing points leaves at most one run in
/// each slice of the larger hypercube. The number of remaining points is rarely exactly `runs`, so slices are added until there are enough, and the
/// surplus points are removed at random. Fewer points if no number of slices leaves enough.
fn hypercube_within(
    specification: &DesignSpecification,
    runs: usize,
    random: &mut Random,
    holds: &dyn Fn(&Vec<f64>) -> bool,
) -> points::Points {
    let mut slices = runs;
    let mut best = points::Points::new();
    for _ in 0..MOST_HYPERCUBES {
        let mut points = all_points(specification, &Design::LatinHypercube { runs: slices }, random);
        points.retain(holds);
        if points.len() >= runs {
            random.shuffle(&mut points);
            points.truncate(runs);
            return points;
        }
        // The remaining share gives the number of slices; one more ensures termination.
        let wanted = if points.is_empty() { 4 * slices } else { slices * runs / points.len() + 1 };
        if points.len() > best.len() {
            best = points;
        }
        slices = wanted.clamp(slices + 1, (4 * slices).min(MOST_SLICES).max(slices + 1));
        if slices > MOST_SLICES {
            break;
        }
    }
    best
}

/// The largest number of hypercubes tried for a region, each with more slices than the one before.
const MOST_HYPERCUBES: usize = 60;

/// The largest number of slices of a hypercube: a region of a thousandth of the box still gets a hundred runs.
const MOST_SLICES: usize = MOST_RUNS;

/// Inserts `count` centre points at equal distances, including the first and the last run; a single one is in the middle.
fn spread(order: &mut Vec<Vec<f64>>, centre: &[f64], count: usize) {
    let all = order.len() + count;
    let place = |k: usize| if count == 1 { all / 2 } else { k * (all - 1) / (count - 1) };
    // In ascending order, so that positions before the current one are final.
    for k in 0..count {
        order.insert(place(k), centre.to_vec());
    }
}

/// The column `block` directly after the run number, if it is dimensionless and has integers; otherwise it is a factor with that name.
fn blocks_of(table: &Table) -> Option<Vec<u32>> {
    let place = table.columns.iter().position(|column| column.name == BLOCK)?;
    let column = &table.columns[place];
    let stands = place == 1 && table.columns[0].name == RUN && column.unit.as_deref() == Some("1");
    let is_whole = |value: &f64| value.fract() == 0.0 && (1.0..=MOST_RUNS as f64).contains(value);
    (stands && column.values.iter().all(is_whole)).then(|| column.values.iter().map(|value| *value as u32).collect())
}

/// Ascending integers from 1 without duplicates.
fn run_numbers(table: &Table, faults: &mut Collector) -> Vec<u32> {
    let column = table.column(RUN).expect("a wanted column is in the table");
    let mut runs: Vec<u32> = Vec::new();
    for (value, line) in column.values.iter().zip(&table.lines) {
        let last = runs.last().copied().unwrap_or(0);
        let is_whole = value.fract() == 0.0 && (1.0..=MOST_RUNS as f64).contains(value);
        if !is_whole || *value <= f64::from(last) {
            let expected = match (is_whole, last) {
                (false, _) | (true, 0) => format!("a whole number from 1 to {MOST_RUNS}"),
                _ => format!("a number above {last}, that of the row before"),
            };
            let what = format!("column {} `{RUN}`: found {value}, expected {expected}", column.place);
            faults.push(Fault::at_line(&table.file, *line, 0, what));
        }
        if is_whole {
            runs.push(*value as u32);
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn centre_points_stand_at_the_start_at_the_end_and_between() {
        for (others, count, expected) in [(4, 3, vec![0, 3, 6]), (5, 2, vec![0, 6]), (4, 1, vec![2]), (0, 2, vec![0, 1])] {
            let mut order = vec![vec![1.0]; others];
            spread(&mut order, &[0.0], count);
            let found: Vec<usize> = (0..order.len()).filter(|k| order[*k] == [0.0]).collect();
            assert_eq!(found, expected);
        }
    }
}

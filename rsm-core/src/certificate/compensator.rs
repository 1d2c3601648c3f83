//! The certificate of a compensator, over the whole box of the inputs that its surfaces use.
//!
//! In: `Checked`. Out: enclosures of the natural frequency and of both damping ratios, and every condition that is not proved, with a point of the
//! box that violates it. The certificate is for the true surfaces, with the saturation of the evaluator. For a surface that extrapolates it holds
//! only inside the range. The proof does not sample: points are searched only after an enclosure has failed.
//!
//! The filter and its inverse are stable if damping and frequency are positive, because the bilinear transform maps the left half plane to the unit
//! circle for any sample time. The natural frequencies of the zeros and of the poles must also be below a quarter of the sample rate, w < 2 pi/(4 T).
//! There the transform already distorts the frequency axis by tan(pi/4)/(pi/4) = 1.27, and the filter deviates too far from the specified one.

use crate::basis::Variable;
use crate::check::Checked;
use crate::exact;
use crate::interval::Interval;
use crate::model::{Input, Model, Scheduled, Surface, Symmetry};
use crate::number::{Precision, Rational, exact, integer};
use crate::range::{self, Extent};
use crate::source::{Collector, Faults};

/// The certificate of one compensator.
#[derive(Debug, Clone, PartialEq)]
pub struct CompensatorCertificate {
    /// The compensator.
    pub name: String,
    /// Contains every natural frequency over the box, in rad/s.
    pub natural_frequency: Interval,
    /// Contains every damping ratio of the zeros.
    pub zero_damping: Interval,
    /// Contains every damping ratio of the poles.
    pub pole_damping: Interval,
    /// Contains every natural frequency of the poles, in rad/s, if they have a separate one.
    pub pole_frequency: Option<Interval>,
    /// Conditions that are not proved. Empty: stable over the whole box.
    pub violations: Vec<Violation>,
}

/// A condition that does not hold over the whole box.
#[derive(Debug, Clone, PartialEq)]
pub struct Violation {
    /// The index of the scheduled number in [`crate::model::Compensator::parts`].
    pub part: usize,
    /// Its key in the file.
    pub key: &'static str,
    /// What was found and what is expected.
    pub what: String,
    /// The point in the box: input and value, in the order of the file. Empty for a constant.
    pub at: Vec<(String, f64)>,
}

/// The condition for a scheduled number.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Condition {
    Positive,
    /// Below a limit, which is rounded down.
    Below(f64),
}

/// The certificate of a compensator, by its index in the model.
#[must_use]
pub fn certify(checked: &Checked, index: usize) -> CompensatorCertificate {
    let (model, compensator) = (checked.model(), &checked.model().compensators[index]);
    let limit = quarter_of_sample_rate(compensator.sample_time);
    let mut ranges = vec![];
    let mut violations = vec![];
    for (part, (key, scheduled)) in compensator.parts().into_iter().enumerate() {
        let enclosed = Enclosed::of(model, scheduled);
        let mut conditions = vec![Condition::Positive];
        if key.ends_with("_frequency") {
            conditions.push(Condition::Below(limit));
        }
        for condition in conditions.into_iter().filter(|condition| !condition.holds(enclosed.range)) {
            violations.push(enclosed.violation(model, scheduled, part, key, condition));
        }
        ranges.push(enclosed.range);
    }
    CompensatorCertificate {
        name: compensator.name.clone(),
        natural_frequency: ranges[0],
        zero_damping: ranges[1],
        pole_damping: ranges[2],
        pole_frequency: ranges.get(3).copied(),
        violations,
    }
}

/// 2 pi/(4 T) in rad/s, rounded down: the f64 pi/2 is below pi/2, and the quotient is moved below the exact one.
fn quarter_of_sample_rate(sample_time: f64) -> f64 {
    (std::f64::consts::FRAC_PI_2 / sample_time).next_down()
}

/// Rejects a compensator whose stability over the whole box is not proved.
///
/// # Errors
/// A fault for each condition that does not hold, with the value and the point.
pub fn require_stable(checked: &Checked, index: usize) -> Result<(), Faults> {
    let mut faults = Collector::new();
    for violation in certify(checked, index).violations {
        let what =
            format!("compensator `{}`: `{}`: {}", checked.model().compensators[index].name, violation.key, violation.what);
        let fault = checked.fault_at_part(index, violation.part, what);
        faults.push(fault.help("narrow the ranges of the inputs, or give the surface an `output_range` within these bounds"));
    }
    faults.finish(Some(()))
}

impl Condition {
    fn holds(self, range: Interval) -> bool {
        match self {
            Condition::Positive => range.low > 0.0,
            Condition::Below(limit) => range.high < limit,
        }
    }

    fn expected(self) -> String {
        match self {
            Condition::Positive => "more than 0".to_string(),
            Condition::Below(limit) => format!("less than a quarter of the sample rate, {} rad/s", short(limit)),
        }
    }
}

/// An enclosure of a scheduled number, and points at which its extremes may be.
struct Enclosed {
    range: Interval,
    inputs: Vec<Input>,
    least_at: Vec<Vec<f64>>,
    greatest_at: Vec<Vec<f64>>,
}

impl Enclosed {
    fn of(model: &Model, scheduled: &Scheduled) -> Self {
        let surfaces: Vec<&Surface> =
            scheduled.surfaces().iter().map(|name| model.surface(name).expect("a checked compensator")).collect();
        let inputs: Vec<Input> =
            model.inputs.iter().filter(|input| surfaces.iter().any(|it| it.inputs.contains(&input.name))).cloned().collect();
        if let Some(value) = scheduled.fixed() {
            return Enclosed { range: Interval::point(value), inputs, least_at: vec![vec![]], greatest_at: vec![vec![]] };
        }
        if let Some(sum) = as_one(&surfaces, &inputs) {
            let Extent { range, least_at, greatest_at } = range::extent(&sum, &inputs);
            return Enclosed { range, inputs, least_at: vec![least_at], greatest_at: vec![greatest_at] };
        }
        // Each surface separately: the sum of the ranges contains the sum. Its extremes may be at those of a summand, or at a corner.
        let mut range = Interval::point(0.0);
        let (mut least_at, mut greatest_at) = (corners(&inputs), corners(&inputs));
        for surface in &surfaces {
            let own: Vec<Input> =
                surface.inputs.iter().map(|name| model.input(name).expect("a checked surface").clone()).collect();
            let extent = range::extent(surface, &own);
            range = range + saturated(extent.range, surface.output_range);
            // Inputs that this surface does not have are set to the middle of their range.
            let widened = |point: &[f64]| -> Vec<f64> {
                let of = |input: &Input| own.iter().position(|it| it.name == input.name).map(|k| point[k]);
                inputs.iter().map(|input| of(input).unwrap_or(0.5 * input.range[0] + 0.5 * input.range[1])).collect()
            };
            least_at.push(widened(&extent.least_at));
            greatest_at.push(widened(&extent.greatest_at));
        }
        Enclosed { range, inputs, least_at, greatest_at }
    }

    /// The candidate that violates a condition most, evaluated exactly.
    fn violation(
        &self,
        model: &Model,
        scheduled: &Scheduled,
        part: usize,
        key: &'static str,
        condition: Condition,
    ) -> Violation {
        let candidates = if condition == Condition::Positive { &self.least_at } else { &self.greatest_at };
        let values = candidates.iter().map(|point| (value(model, scheduled, &self.inputs, point), point));
        let worst = match condition {
            Condition::Positive => values.min_by(|a, b| a.0.cmp(&b.0)),
            Condition::Below(_) => values.max_by(|a, b| a.0.cmp(&b.0)),
        };
        let (found, point) = worst.expect("there is always a candidate");
        let broken = match condition {
            Condition::Positive => found <= integer(0),
            Condition::Below(limit) => found >= exact(limit),
        };
        let at: Vec<(String, f64)> = self.inputs.iter().map(|input| input.name.clone()).zip(point.iter().copied()).collect();
        let place: Vec<String> = at.iter().map(|(name, xi)| format!("{name} = {}", short(*xi))).collect();
        let place = if place.is_empty() { String::new() } else { format!(" at {}", place.join(", ")) };
        let (found, expected) = (short(Precision::F64.round(&found)), condition.expected());
        let what = if broken {
            format!("found {found}{place}, expected {expected}")
        } else {
            let [low, high] = [self.range.low, self.range.high].map(short);
            format!("not certain to be {expected}: its enclosure is [{low}, {high}], the worst value found {found}{place}")
        };
        Violation { part, key, what, at }
    }
}

/// A scheduled number at a point, exactly.
fn value(model: &Model, scheduled: &Scheduled, inputs: &[Input], point: &[f64]) -> Rational {
    if let Some(value) = scheduled.fixed() {
        return exact(value);
    }
    scheduled.surfaces().iter().fold(integer(0), |sum, name| {
        let surface = model.surface(name).expect("a checked compensator");
        let own: Vec<Input> = surface.inputs.iter().map(|name| model.input(name).expect("a checked surface").clone()).collect();
        let of = |input: &Input| inputs.iter().position(|it| it.name == input.name).expect("the schedule has it");
        let at: Vec<Rational> = own.iter().map(|input| exact(point[of(input)])).collect();
        sum + exact::value(surface, &own, &at).expect("a checked surface has no pole in its box")
    })
}

/// The sum of surfaces as one polynomial over all their inputs. `None` if their variables differ, or if one saturates, has sigmoids, or has an odd
/// input.
fn as_one(surfaces: &[&Surface], inputs: &[Input]) -> Option<Surface> {
    let coding = surfaces.first()?.coding;
    let odd = |surface: &Surface| surface.symmetry.iter().any(|(_, symmetry)| *symmetry == Symmetry::Odd);
    let bent = |surface: &Surface| surface.width() > surface.inputs.len() + surface.knots.len();
    if surfaces
        .iter()
        .any(|surface| surface.output_range.is_some() || surface.coding != coding || odd(surface) || bent(surface))
    {
        return None;
    }
    let mut sum = Surface { coding, inputs: inputs.iter().map(|input| input.name.clone()).collect(), ..Surface::default() };
    for input in inputs {
        let mut having = surfaces.iter().filter(|surface| surface.inputs.contains(&input.name));
        let first = having.next()?;
        if having.any(|surface| Variable::of(surface, input) != Variable::of(first, input)) {
            return None;
        }
        sum.symmetry.extend(first.symmetry.iter().filter(|(name, _)| *name == input.name).cloned());
        sum.reciprocal.extend(first.reciprocal.iter().filter(|name| **name == input.name).cloned());
    }
    sum.knots = surfaces.iter().flat_map(|surface| surface.knots.iter().cloned()).collect();
    let mut knots_before = 0;
    for surface in surfaces {
        let place = |name: &String| inputs.iter().position(|input| input.name == *name);
        for term in &surface.terms {
            let mut powers = vec![0; inputs.len() + sum.knots.len()];
            for (name, power) in surface.inputs.iter().zip(&term.powers) {
                powers[place(name)?] = *power;
            }
            let own_knots = &term.powers[surface.inputs.len()..];
            powers[inputs.len() + knots_before..][..own_knots.len()].copy_from_slice(own_knots);
            sum.terms.push(crate::model::Term { powers, coefficient: term.coefficient });
        }
        knots_before += surface.knots.len();
    }
    Some(sum)
}

fn saturated(range: Interval, output_range: Option<[f64; 2]>) -> Interval {
    match output_range {
        None => range,
        Some([low, high]) => Interval::new(range.low.clamp(low, high), range.high.clamp(low, high)),
    }
}

/// With more inputs, corners are not tested: 2^8 exact evaluations take a quarter of a second.
const CORNERS_UP_TO: usize = 8;

/// Every corner of a box.
fn corners(inputs: &[Input]) -> Vec<Vec<f64>> {
    let count = if inputs.len() > CORNERS_UP_TO { 0 } else { 1usize << inputs.len() };
    let corner = |index: usize| inputs.iter().enumerate().map(|(k, input)| input.range[index >> k & 1]).collect();
    (0..count).map(corner).collect()
}

/// Six significant digits, for readers.
fn short(value: f64) -> String {
    let rounded: f64 = format!("{value:.5e}").parse().unwrap_or(value);
    let is_handy = rounded == 0.0 || (1e-4..1e7).contains(&rounded.abs());
    if is_handy { format!("{rounded}") } else { format!("{rounded:e}") }
}

#[cfg(test)]
mod tests;

//! Cases: a true plant, a nominal file that lacks something, records, and the correct answer.
//!
//! In: a seed. Out: cases by family. A case depends only on the seed and on its own name. In every case, parameters with a tolerance have errors of
//! up to 1.5 of their standard deviations, so a diagnosis must calibrate before it names a cause.

use crate::bench::{self, Damage, Noise};
use crate::draw::{self, Nominal};
use crate::excitation::excitation;
use crate::outside;
pub use crate::plans::{Family, Fault};
use crate::plans::{Plan, QUICK, plans};
use crate::plant::{self, Effect, Kind, Record, Truth};
use crate::random::Random;
use crate::untidy::Untidy;
use crate::verification::again;

/// One record: with noise for the diagnosis, without noise for the evaluation.
#[derive(Debug, Clone)]
pub struct Run {
    /// The record with sensor noise.
    pub noisy: Record,
    /// The true values.
    pub exact: Record,
    /// Rows that are missing in the file.
    pub left_out: Vec<std::ops::Range<usize>>,
}

/// One case.
#[derive(Debug, Clone)]
pub struct Case {
    /// `pmac-coulomb-friction`
    pub name: String,
    /// The family of the hidden cause.
    pub family: Family,
    /// The file to diagnose. Its parameters have errors within their tolerance; its noise is the true one.
    pub nominal: Nominal,
    /// The noise that the file states; 0 if it states none.
    pub stated: Vec<f64>,
    /// Outputs that are in no record.
    pub without: Vec<String>,
    /// The true plant.
    pub truth: Truth,
    /// The true causes, including the parameter errors.
    pub causes: Vec<Effect>,
    /// The fault, if the data are damaged.
    pub fault: Option<Fault>,
    /// The damage by a logger.
    pub damage: Option<Damage>,
    /// The record that alone has an effect, by its file, and that effect.
    pub own: Option<(String, Effect)>,
    /// Training records.
    pub train: Vec<Run>,
    /// Validation records.
    pub validate: Vec<Run>,
    /// The root mean square of the effect of the causes, divided by the noise, at the output where it is largest: from records with and without the
    /// causes, with the same inputs and parameters. The smaller value of training and validation records.
    pub signal_to_noise: f64,
}

/// Records for training and for validation.
const RUNS: (usize, usize) = (3, 2);

/// The smallest signal to noise of a case, at the best output: averaged over 8000 rows, a third of the noise is determined to a thousandth of its
/// variance, of which calibration and starts take a part. Below this value a correct answer would need luck, so the case is drawn again.
const LEAST_SIGNAL: f64 = 0.3;

/// The number of draws after which a case is abandoned.
const ATTEMPTS: usize = 50;

/// For a distant start of a calibration: the factor of the tolerances, and the range of the parameter errors in standard deviations.
const FAR: (f64, f64, f64) = (4.0, 1.5, 1.9);

/// The requested cases.
#[derive(Debug, Clone, Default)]
pub struct Choice {
    /// Only this family.
    pub family: Option<Family>,
    /// Only the case with this name.
    pub name: Option<String>,
    /// Only the quick subset.
    pub quick: bool,
    /// The number of rows of every record, instead of the plant's own.
    pub rows: Option<usize>,
    /// The correlation of every output's noise from row to row, instead of a random one.
    pub colour: Option<f64>,
    /// The factor between the noise that the plant file states and the true noise; 0: it states none. Absent: unchanged.
    pub stated: Option<f64>,
    /// Irregularities of the records.
    pub untidy: Untidy,
    /// Parameter errors are normally distributed with the tolerance, up to two standard deviations, beyond which an error is a cause; otherwise
    /// uniform within 1.5 of them.
    pub normal: bool,
    /// Of the single effects only every n-th, from this one on.
    pub singles: Option<(usize, usize)>,
    /// Without these families.
    pub without_families: Vec<Family>,
}

/// A run of intervals over this number of consecutive seeds contains every single effect once.
const SINGLES_IN_TURNS: u64 = 10;

impl Choice {
    /// The cases for which intervals are counted: no effect, a symmetry, and some single effects, which change with the seed. Two causes at once and
    /// damaged data need more than correct intervals.
    #[must_use]
    pub fn for_coverage(mut self, seed: u64) -> Self {
        self.without_families =
            vec![Family::Pairs, Family::Outside, Family::Faults, Family::Records, Family::Far, Family::Beyond];
        self.singles = Some((SINGLES_IN_TURNS as usize, (seed % SINGLES_IN_TURNS) as usize));
        self
    }

    fn has(&self, plan: &Plan) -> bool {
        // Records as on real benches are run only if requested, so the table of all other families does not change.
        let is_of_benches = matches!(plan.family, Family::Noise | Family::Data);
        let is_asked = self.family.is_some() || self.name.is_some();
        (is_asked || !is_of_benches)
            && !self.without_families.contains(&plan.family)
            && self.family.is_none_or(|family| family == plan.family)
            && self.name.as_ref().is_none_or(|name| {
                name.strip_suffix('*').map_or(*name == plan.name, |beginning| plan.name.starts_with(beginning))
            })
            && (!self.quick || QUICK.contains(&plan.name.as_str()))
    }
}

/// The cases of a seed. The records of a case are computed when the iterator reaches it.
pub fn cases(seed: u64, choice: Choice) -> impl Iterator<Item = Case> {
    let its_turn = |place: usize, plan: &Plan| match choice.singles {
        Some((every, from)) if plan.family == Family::Singles => place % every == from,
        _ => true,
    };
    let chosen = plans().into_iter().enumerate().filter(|(place, plan)| choice.has(plan) && its_turn(*place, plan));
    let chosen: Vec<Plan> = chosen.map(|it| it.1).collect();
    chosen.into_iter().filter_map(move |plan| case(&plan, seed, &choice))
}

/// The outputs of a plant that the records contain, by index.
fn recorded(kind: Kind, untidy: &Untidy) -> Vec<usize> {
    let is_held = |place: &usize| untidy.without.iter().all(|out| *out != kind.outputs()[*place].0);
    (0..kind.outputs().len()).filter(is_held).collect()
}

/// Draws until the causes are visible: see `LEAST_SIGNAL`. `None` if this is not possible because the necessary outputs are not recorded: for an
/// effect of a sensor that no record contains, or a fault of its column.
fn case(plan: &Plan, seed: u64, choice: &Choice) -> Option<Case> {
    let held = recorded(plan.kind, &choice.untidy);
    let all = plan.kind.outputs().len();
    // Faults affect the last output.
    if held.is_empty() || plan.fault.is_some() && !held.contains(&(all - 1)) {
        return None;
    }
    let mut attempt = 0;
    loop {
        let case = draw_case(plan, Random::new(seed, &format!("{} {attempt}", plan.name)), choice);
        let hides_nothing = plan.effects.is_empty() && plan.outside.is_none();
        if hides_nothing || case.signal_to_noise >= LEAST_SIGNAL {
            return Some(case);
        }
        attempt += 1;
        if attempt == ATTEMPTS && held.len() < all {
            return None;
        }
        assert!(attempt < ATTEMPTS, "{}: {ATTEMPTS} draws, none of which shows", plan.name);
    }
}

fn draw_case(plan: &Plan, mut random: Random, choice: &Choice) -> Case {
    let kind = plan.kind;
    let mut true_plant = draw::nominal(kind, &mut random);
    true_plant.rows = choice.rows.unwrap_or(true_plant.rows);
    // Good and poor sensors: the same magnitude is clearly visible in one case and hardly in another.
    let poor = if kind == Kind::Car { random.spread(0.6, 2.0) } else { random.spread(1.0, 4.0) };
    true_plant.noise.iter_mut().for_each(|sigma| *sigma *= poor);
    let mut parameters = true_plant.parameters.clone();
    let held = recorded(kind, &choice.untidy);
    let causes: Vec<Effect> = plan
        .effects
        .iter()
        .map(|effect| {
            let missing = held.len() < kind.outputs().len();
            let sensor = missing.then(|| held[random.whole(0, held.len() as u64 - 1) as usize]);
            draw::effect(effect, &true_plant, sensor, &mut random)
        })
        .collect();
    let mut nominal = true_plant.clone();
    for (name, sigma) in &true_plant.tolerance {
        let off = if choice.normal { within_two(&mut random) } else { random.uniform(-1.5, 1.5) };
        nominal.parameters.set(name, true_plant.parameters.get(name) / (1.0 + sigma * off));
    }
    if plan.family == Family::Far {
        for (name, sigma) in &mut nominal.tolerance {
            // A relative deviation of at most a half, so that all parameters are above zero.
            *sigma = (FAR.0 * *sigma).min(0.25);
            let off = *sigma * random.sign() * random.uniform(FAR.1, FAR.2);
            nominal.parameters.set(name, true_plant.parameters.get(name) / (1.0 + off));
        }
    }
    for cause in causes.iter().filter(|cause| cause.kind == "parameter-error") {
        // The file keeps the drawn value exactly: the error is only that of the cause, without a tolerance.
        let (_, name) = cause.which.expect("a parameter error names its parameter");
        nominal.parameters.set(name, true_plant.parameters.get(name));
        parameters.set(name, cause.values[0].1);
    }
    let outside = plan.outside.iter().map(|name| outside::disturbance(name, &true_plant, &mut random)).collect();
    let effects = causes.iter().filter(|cause| cause.kind != "parameter-error").cloned().collect();
    let truth = Truth { kind, parameters, effects, outside };
    let own = plan
        .own
        .map(|name| (random.whole(0, (RUNS.0 + RUNS.1 - 1) as u64) as usize, own_effect(name, &true_plant, &mut random)));

    // A third of the cases has correlated noise, for each output separately.
    let colours: Vec<f64> =
        nominal.noise.iter().map(|_| if random.uniform(0.0, 1.0) < 0.33 { random.uniform(0.3, 0.8) } else { 0.0 }).collect();
    let colours: Vec<f64> = colours.into_iter().map(|colour| choice.colour.unwrap_or(colour)).collect();
    let bare = Truth { parameters: without_errors(&truth, &causes, &true_plant), effects: vec![], outside: vec![], kind };
    let mut moved = vec![[(0.0, 0.0); 2]; nominal.noise.len()];
    // Validation uses other gears: an explanation that is valid only in the training gears is not the cause.
    let gears = [2, 3, 4, 2, 3];
    let untidy = &choice.untidy;
    let made: Vec<Made> = (0..RUNS.0 + RUNS.1)
        .map(|run| {
            let stream = Random::new(random.whole(0, u64::from(u32::MAX)), "run");
            let gear = gears[run];
            let (start, mut drive) = excitation(&true_plant, gear, stream.clone());
            let mut truth = truth.clone();
            truth.effects.extend(own.iter().filter(|(its, _)| *its == run).map(|(_, effect)| effect.clone()));
            let exact = plant::run(&truth, start, nominal.period, nominal.rows, &mut drive);
            let without = again(&bare, &exact, &true_plant, gear, &stream);
            // A coarse sensor removes part of the signal, so rounding is included here.
            let mut read = exact.clone();
            plant::quantise(&truth, &mut read);
            for (output, sums) in moved.iter_mut().enumerate() {
                let sum = &mut sums[usize::from(run >= RUNS.0)];
                let pairs = read.outputs[output].iter().zip(&without.outputs[output]);
                sum.0 += pairs.map(|(with, without)| ((with - without) / nominal.noise[output]).powi(2)).sum::<f64>();
                sum.1 += nominal.rows as f64;
            }
            let untidy = Random::new(random.clone().whole(0, u64::from(u32::MAX)), "untidy");
            let outputs = 0..exact.outputs.len();
            let noise = outputs
                .map(|output| match plan.noise {
                    // Rounding is applied to the readings.
                    Some(kind) if kind != Noise::Rounded => {
                        let mut column = vec![0.0; nominal.rows];
                        kind.add(&mut column, nominal.noise[output], &mut random);
                        column
                    }
                    _ => random.noise(nominal.rows, nominal.noise[output], colours[output]),
                })
                .collect();
            Made { truth, exact, noise, untidy }
        })
        .collect();
    let mut runs = read(made, untidy);
    let steps = nominal.noise.iter().map(|sigma| plan.noise.and_then(|it| it.step(*sigma)));
    for (output, step) in steps.enumerate().filter_map(|(output, step)| Some((output, step?))) {
        let columns = runs.iter_mut().flat_map(|run| run.noisy.outputs[output].iter_mut());
        columns.for_each(|value| *value = step * (*value / step).round());
    }
    let units: Vec<&str> = kind.outputs().iter().map(|it| it.1).collect();
    let spoiled = plan.spoiled.and_then(|what| bench::damage(what, &units, nominal.rows, &mut random));
    if let Some(damage) = &spoiled {
        let suffer = if damage.what.is_everywhere() { runs.len() } else { 1 };
        runs.iter_mut().take(suffer).for_each(|run| damage.spoil(&mut run.noisy));
    }
    let validate = runs.split_off(RUNS.0);
    // An effect that no training record shows cannot be found, and one that no validation record shows cannot be confirmed.
    let shown =
        |which: usize| held.iter().map(|place| moved[*place][which]).map(|(sum, rows)| (sum / rows).sqrt()).fold(0.0, f64::max);
    let signal_to_noise = shown(0).min(shown(1));
    let signal_to_noise = signal_to_noise.max(outside::signal_on_readings(&truth, &nominal));
    // For a sensor that is not recorded nothing can be found, whatever other effects are visible.
    let is_held = |cause: &Effect| match cause.which {
        Some(("output", name)) => held.iter().any(|place| kind.outputs()[*place].0 == name),
        _ => true,
    };
    let signal_to_noise = if causes.iter().all(is_held) { signal_to_noise } else { 0.0 };
    match plan.fault {
        Some(Fault::Constant) => runs.iter_mut().for_each(|run| damage(run, Fault::Constant, &mut random)),
        Some(fault) => damage(&mut runs[0], fault, &mut random),
        None => {}
    }
    let own = own.map(|(run, effect)| {
        let file = if run < RUNS.0 { format!("train-{}.csv", run + 1) } else { format!("validate-{}.csv", run - RUNS.0 + 1) };
        (file, effect)
    });
    let name = plan.name.clone();
    let factor = choice.stated.unwrap_or(1.0) * plan.noise.map_or(1.0, Noise::stated);
    let stated = nominal.noise.iter().map(|sigma| sigma * factor).collect();
    Case {
        stated,
        without: untidy.without.clone(),
        name,
        family: plan.family,
        nominal,
        truth,
        causes,
        fault: plan.fault,
        damage: spoiled,
        own,
        train: runs,
        validate,
        signal_to_noise,
    }
}

/// A normal number between -2 and 2.
fn within_two(random: &mut Random) -> f64 {
    loop {
        let off = random.normal();
        if off.abs() < 2.0 {
            return off;
        }
    }
}

/// A run before the sensors read it.
struct Made {
    truth: Truth,
    exact: Record,
    /// The noise, for each output.
    noise: Vec<Vec<f64>>,
    /// The separate stream of random numbers for irregularities.
    untidy: Random,
}

/// Runs as read by the sensors.
fn read(made: Vec<Made>, untidy: &Untidy) -> Vec<Run> {
    let largest = |output: usize| {
        let all = made.iter().flat_map(|it| it.exact.outputs[output].iter());
        all.fold(0.0_f64, |most, value| most.max(value.abs()))
    };
    let outputs = made.first().map_or(0, |it| it.exact.outputs.len());
    let largest: Vec<f64> = (0..outputs).map(largest).collect();
    let one = |made: Made| {
        let Made { truth, exact, noise, untidy: mut own } = made;
        let mut noisy = exact.clone();
        for (output, column) in noisy.outputs.iter_mut().enumerate() {
            let factors = untidy.factors(column, largest[output], &mut own);
            column.iter_mut().zip(&noise[output]).zip(factors).for_each(|((value, noise), factor)| *value += factor * noise);
        }
        let mut left_out = untidy.lost_rows(exact.outputs[0].len(), &mut own);
        left_out.push(0..untidy.late);
        outside::on_readings(&truth, &exact, &mut noisy);
        // A coarse sensor rounds its reading including the noise.
        plant::quantise(&truth, &mut noisy);
        Run { noisy, exact, left_out }
    };
    made.into_iter().map(one).collect()
}

/// An effect of one record only, clearly visible.
fn own_effect(name: &'static str, nominal: &Nominal, random: &mut Random) -> Effect {
    match (name, nominal.kind) {
        ("road-grade", _) => Effect::new("road-grade", &[("grade", random.sign() * random.uniform(0.03, 0.06))]),
        ("headwind", _) => Effect::new("headwind", &[("wind", random.sign() * random.uniform(6.0, 12.0))]),
        (_, Kind::Motor) => Effect::new("constant-load", &[("torque", random.sign() * random.uniform(0.2, 0.6))]),
        _ => Effect::new("constant-load", &[("force", random.sign() * random.uniform(4.0, 12.0))]),
    }
}

fn without_errors(truth: &Truth, causes: &[Effect], true_plant: &Nominal) -> plant::Parameters {
    let mut parameters = truth.parameters.clone();
    for cause in causes.iter().filter(|cause| cause.kind == "parameter-error") {
        let (_, name) = cause.which.expect("a parameter error names its parameter");
        parameters.set(name, true_plant.parameters.get(name));
    }
    parameters
}

/// Damages a record: its last output, in rows of the middle half.
fn damage(run: &mut Run, fault: Fault, random: &mut Random) {
    let rows = run.noisy.outputs[0].len();
    let first = rows / 4 + random.whole(0, rows as u64 / 4) as usize;
    let length = rows / 40 + random.whole(0, rows as u64 / 40) as usize;
    let column = run.noisy.outputs.last_mut().expect("a plant has outputs");
    match fault {
        Fault::Gap => run.left_out.push(first..first + length),
        Fault::Stuck => {
            let value = column[first];
            column[first..first + length].fill(value);
        }
        Fault::Clipped => {
            let mut sorted = column.clone();
            sorted.sort_by(f64::total_cmp);
            // The upper tenth is cut off.
            let limit = sorted[rows * 9 / 10];
            column.iter_mut().for_each(|value| *value = value.min(limit));
        }
        Fault::Duplicated => {
            // The logger writes a block of all channels a second time, over the next block.
            for column in run.noisy.inputs.iter_mut().chain(&mut run.noisy.outputs) {
                column.copy_within(first..first + length, first + length);
            }
        }
        Fault::Frozen => {
            // From the first third on, which is most of the record.
            let first = rows / 10 + first / 2;
            let value = column[first];
            column[first..].fill(value);
        }
        Fault::Constant => {
            let value = column[0];
            column.fill(value);
        }
        Fault::Shifted => {
            let late = 8 + random.whole(0, 12) as usize;
            column.copy_within(0..rows - late, late);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_effect_stands_once_on_each_plant_and_the_other_families_are_ten_or_more() {
        let plans = plans();
        let of = |family| plans.iter().filter(move |plan| plan.family == family);
        let expected: usize = [Kind::Motor, Kind::Car, Kind::OpenAxis].iter().map(|kind| draw::catalogue(*kind).len()).sum();
        assert_eq!(of(Family::Singles).count(), expected);
        let kinds: BTreeSet<&str> = of(Family::Singles).flat_map(|plan| plan.effects.iter().copied()).collect();
        // docs/book/src/reference/plants.md, section 3, lists 33.
        assert_eq!(kinds.len(), 33);
        for family in [Family::Records, Family::Symmetries, Family::Far] {
            assert!(of(family).count() >= 4, "{family:?}");
        }
        for family in [Family::Pairs, Family::Nulls, Family::Outside] {
            assert!(of(family).count() >= 10, "{family:?}");
        }
        let names: BTreeSet<&str> = plans.iter().map(|plan| plan.name.as_str()).collect();
        assert_eq!(names.len(), plans.len(), "two cases of one name would be one folder");
        assert!(QUICK.iter().all(|name| names.contains(name)));
    }

    #[test]
    fn records_of_benches_are_asked_for_by_name_and_are_as_their_names_say() {
        let of = |name: &str| {
            let choice = Choice { name: Some(name.to_string()), rows: Some(600), ..Choice::default() };
            cases(5, choice).next().expect("a case of this name")
        };
        let swapped = of("data-driveline-swapped");
        let damage = swapped.damage.as_ref().expect("it is spoiled");
        let run = &swapped.validate[0];
        let (one, other) = (damage.outputs[0], damage.outputs[1]);
        // Within ten deviations of the coarser sensor: the columns are exchanged.
        let apart = (run.noisy.outputs[one][300] - run.exact.outputs[other][300]).abs();
        assert!(apart < 10.0 * swapped.nominal.noise[other], "{apart}");
        let rounded = of("noise-servo-axis-rounded");
        let step = 4.0 * rounded.nominal.noise[0];
        let reading = rounded.train[0].noisy.outputs[0][400];
        assert!((reading / step - (reading / step).round()).abs() < 1e-6, "{reading}");
        assert_eq!(of("noise-pmac-overstated").stated[0], 2.5 * of("noise-pmac-overstated").nominal.noise[0]);
        let all = Choice::default();
        assert!(plans().iter().filter(|plan| all.has(plan)).all(|plan| plan.noise.is_none() && plan.spoiled.is_none()));
    }

    #[test]
    fn a_case_depends_on_its_seed_and_its_name_alone() {
        let one = |seed| cases(seed, Choice { name: Some("driveline-backlash".to_string()), ..Choice::default() }).next();
        let [first, again, other] = [one(3), one(3), one(4)].map(|case| case.expect("a case of this name"));
        assert_eq!(first.train[0].noisy.outputs, again.train[0].noisy.outputs);
        assert_ne!(first.causes, other.causes);
    }

    #[test]
    fn nominal_parameters_are_off_and_within_their_tolerance() {
        let choice = Choice { name: Some("null-3-driveline".to_string()), ..Choice::default() };
        let case = cases(1, choice).next().expect("a case of this name");
        for (name, sigma) in &case.nominal.tolerance {
            let off = case.truth.parameters.get(name) / case.nominal.parameters.get(name) - 1.0;
            assert!(off != 0.0 && off.abs() <= 1.5 * sigma, "{name}: {off}");
        }
        assert_eq!(case.truth.parameters.get("wheel_radius"), case.nominal.parameters.get("wheel_radius"));
    }

    #[test]
    fn short_records_with_coloured_noise_and_a_file_that_is_silent_about_it() {
        let name = Some("null-3-driveline".to_string());
        let choice = Choice { name, rows: Some(900), colour: Some(0.9), stated: Some(0.0), ..Choice::default() };
        let case = cases(1, choice).next().expect("a case of this name");
        assert!(case.stated.iter().all(|sigma| *sigma == 0.0));
        for run in case.train.iter().chain(&case.validate) {
            for (noisy, exact) in run.noisy.outputs.iter().zip(&run.exact.outputs) {
                let noise: Vec<f64> = noisy.iter().zip(exact).map(|(noisy, exact)| noisy - exact).collect();
                assert_eq!(noise.len(), 900);
                let products: f64 = noise.windows(2).map(|pair| pair[0] * pair[1]).sum();
                let found = products / noise.iter().map(|e| e * e).sum::<f64>();
                // sqrt((1 - 0.81)/900) is 0.015; the limit is four of it, plus the effect of the mean of a short record.
                assert!((found - 0.9).abs() < 0.07, "{found}");
            }
        }
    }

    #[test]
    fn nobody_is_asked_for_a_sensor_that_no_record_holds() {
        let without = vec!["i_d".to_string(), "speed".to_string(), "position".to_string(), "road_speed".to_string()];
        let of = |name: &str, without: &[String]| {
            let untidy = Untidy { without: without.to_vec(), ..Untidy::default() };
            cases(5, Choice { name: Some(name.to_string()), rows: Some(600), untidy, ..Choice::default() }).next()
        };
        for effect in ["sensor-gain", "sensor-bias", "sensor-quantisation"] {
            for (plant, held) in [("pmac", &["i_q"][..]), ("driveline", &["engine_speed", "acceleration"])] {
                let case = of(&format!("{plant}-{effect}"), &without).expect("a sensor is left");
                let (_, sensor) = case.causes[0].which.expect("a sensor's effect names it");
                assert!(held.contains(&sensor), "{plant} {effect}: {sensor}");
                assert!(case.signal_to_noise >= LEAST_SIGNAL);
            }
        }
        // For the axis, only the position can be delayed.
        assert!(of("servo-axis-sensor-delay", &without).is_none());
        assert!(of("fault-stuck-pmac", &without[1..2]).is_none() && of("fault-stuck-driveline", &without).is_some());
        // With all sensors, a case does not change.
        assert_eq!(of("pmac-sensor-gain", &[]).map(|it| it.causes), of("pmac-sensor-gain", &without[3..]).map(|it| it.causes));
    }

    #[test]
    fn damage_stays_in_one_place() {
        let choice = Choice { name: Some("fault-stuck-driveline".to_string()), ..Choice::default() };
        let case = cases(1, choice).next().expect("a case of this name");
        let longest_run = |run: &Run| {
            let (mut longest, mut length) = (1, 1);
            for pair in run.noisy.outputs[2].windows(2) {
                length = if pair[0] == pair[1] { length + 1 } else { 1 };
                longest = longest.max(length);
            }
            longest
        };
        // From a fortieth to a twentieth of 3000 rows; noise never repeats.
        assert!((75..=150).contains(&longest_run(&case.train[0])));
        assert_eq!(longest_run(&case.train[1]), 1);
    }
}

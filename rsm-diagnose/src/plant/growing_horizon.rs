//! A search over a growing horizon: a cause is fitted to the beginning of each record, then followed to its end.
//!
//! In: a fit that leaves structure, and hypotheses without a parameter that scales their effect. Out: fits with one of them, along the whole of all
//! records. Some effects accumulate along a record: after a clutch has slipped, every oscillation depends on all before. The cost then has many
//! narrow local minima, and a first-order step finds none of them. Near the beginning little has accumulated, the minima are wide, and the
//! calibration is not yet biased. Accepts no cause.

use super::candidates::Candidate;
use super::hypotheses::Hypothesis;
use super::levenberg::{self, Fit};
use super::model::Model;
use super::multistart::line_search_escape;
use super::screen::{Screened, screen};
use super::search::Search;
use super::whitened_residuals::WhitenedResiduals;
use rsm_core::order;
use rsm_sim::effect::{Guess, Role};

/// A beginning ends where the squared residual, summed from the first row, exceeds this many times the noise. Then three quarters of it are error.
/// That is enough to fit a parameter, and small enough for a first-order step.
const TIMES_THE_NOISE: f64 = 4.0;

/// The smallest number of rows for this test. With one output and fewer rows, noise alone may reach a large ratio; with these, it exceeds 1.6 once in
/// ten thousand cases.
const LEAST_ROWS: usize = 50;

/// A horizon grows at most by this factor in one stage.
const LARGEST_GROWTH: usize = 2;

/// A plant that cannot follow any record further by this share has failed.
const LEAST_GROWTH: f64 = 0.05;

/// The largest number of stages. From fifty rows, seven doublings exceed 6000, and records need not grow in the same stage.
const STAGES: usize = 24;

/// The number of hypotheses that are followed.
const MOST_HYPOTHESES: usize = 2;

/// If the beginnings hold this share of all rows, they show no more than the whole records.
const NEARLY_ALL: f64 = 0.8;

/// The number of steps of a scan from the lowest to the highest guess of a parameter. A limit that is exceeded in a few rows of a beginning has a
/// minimum a few per cent wide, and the guesses cover half to all of the possible range.
const SCAN: usize = 24;

/// The first rows of the records, as far as a plant follows them, with the plant.
struct Horizon {
    /// Rows of each record.
    ends: Vec<usize>,
    /// The fit to these rows.
    fit: Fit,
}

/// The first rows of each record.
fn cut(whitened: &WhitenedResiduals, ends: &[usize]) -> WhitenedResiduals {
    let records = whitened.records.iter().zip(ends).map(|(record, rows)| record.shortened(*rows)).collect();
    whitened.with_records(records)
}

/// How many rows of each record a plant follows; `None` if it cannot be simulated.
fn rows_followed(whitened: &WhitenedResiduals, model: &Model) -> Option<Vec<usize>> {
    let residual = whitened.residual(&whitened.run(model)?);
    let mut first = 0;
    let each = whitened.records.iter().map(|prepared| {
        let (rows, outputs) = (prepared.record.rows(), prepared.outputs.len());
        let mut squared = 0.0;
        let mut end = rows;
        for row in 0..rows {
            squared += (0..outputs).map(|k| residual[first + k * rows + row].powi(2)).sum::<f64>();
            if row >= LEAST_ROWS && squared > TIMES_THE_NOISE * (outputs * (row + 1)) as f64 {
                end = row + 1;
                break;
            }
        }
        first += rows * outputs;
        end
    });
    Some(each.collect())
}

/// The same, but each record grows at most by the factor `LARGEST_GROWTH` and never shrinks. If the plant cannot be simulated so far, half the growth
/// is tried.
fn extended_rows(whitened: &WhitenedResiduals, model: &Model, ends: &[usize]) -> Option<Vec<usize>> {
    let mut more = (LARGEST_GROWTH - 1) as f64;
    while more > LEAST_GROWTH {
        let each = ends.iter().zip(&whitened.records);
        let wide: Vec<usize> = each.map(|(end, it)| (*end + (*end as f64 * more) as usize).min(it.record.rows())).collect();
        if let Some(found) = rows_followed(&cut(whitened, &wide), model) {
            return Some(found.iter().zip(ends).map(|(found, end)| *found.max(end)).collect());
        }
        more /= 2.0;
    }
    None
}

/// Whether any record has grown enough, or is complete.
fn has_grown(whitened: &WhitenedResiduals, before: &[usize], after: &[usize]) -> bool {
    let mut each = before.iter().zip(after).zip(&whitened.records);
    each.any(|((before, after), it)| {
        after > before && (*after == it.record.rows() || *after as f64 > (1.0 + LEAST_GROWTH) * *before as f64)
    })
}

fn is_whole(whitened: &WhitenedResiduals, ends: &[usize]) -> bool {
    ends.iter().zip(&whitened.records).all(|(end, it)| *end == it.record.rows())
}

/// How far the plant follows the records when it is calibrated to these rows only.
fn first_horizon(whitened: &WhitenedResiduals, model: Model, steps: usize) -> Option<Horizon> {
    let mut ends = rows_followed(whitened, &model)?;
    let mut model = model;
    for _ in 0..STAGES {
        let fit = levenberg::fit(&cut(whitened, &ends), model, steps)?;
        let found = rows_followed(whitened, &fit.model)?;
        let found: Vec<usize> = found.iter().zip(&ends).map(|(found, end)| *found.max(end)).collect();
        if !has_grown(whitened, &ends, &found) {
            return Some(Horizon { ends, fit });
        }
        (ends, model) = (found, fit.model);
    }
    None
}

/// A cause fitted along longer and longer beginnings to the end of all records; `None` if the plant fails to follow them.
fn followed_to_end(
    whitened: &WhitenedResiduals,
    model: Model,
    mut ends: Vec<usize>,
    steps: usize,
    threshold: f64,
) -> Option<Fit> {
    let mut model = model;
    for _ in 0..STAGES {
        let short = cut(whitened, &ends);
        let fit = line_search_escape(&short, levenberg::fit(&short, model, steps)?, steps, threshold);
        if is_whole(whitened, &ends) {
            return Some(fit);
        }
        let found = extended_rows(whitened, &fit.model, &ends)?;
        if !has_grown(whitened, &ends, &found) {
            return None;
        }
        (ends, model) = (found, fit.model);
    }
    None
}

/// The hypotheses without a scaling parameter. Those with one parameter get closely spaced guesses.
fn scanned(hypotheses: &[Hypothesis]) -> Vec<Hypothesis> {
    // Rounding steps have no derivative, and rounding does not accumulate.
    let follows = |it: &&Hypothesis| {
        it.configuration.is_none()
            && it.description.declared.role != Role::Rounding
            && it.guesses.iter().all(|guess| guess.neutral.is_none())
    };
    let nonlinear = hypotheses.iter().filter(follows);
    let each = nonlinear.map(|it| {
        let values: Vec<f64> = it.guesses.iter().filter(|guess| guess.values.len() == 1).map(|guess| guess.values[0]).collect();
        let (low, high) = values.iter().fold((f64::INFINITY, 0.0_f64), |(low, high), it| (low.min(*it), high.max(*it)));
        if values.len() < it.guesses.len() || low <= 0.0 || high <= low {
            return it.clone();
        }
        let at = |k: usize| Guess::at(vec![low * (high / low).powf(k as f64 / SCAN as f64)]);
        Hypothesis { guesses: (0..=SCAN).map(at).collect(), ..it.clone() }
    });
    each.collect()
}

impl Search<'_> {
    /// Adds the results from the beginnings of the records to the candidates of a competition. Of two fits of one hypothesis, the better one is kept.
    pub(super) fn add_from_first_horizon(&self, fit: &Fit, candidates: &mut Vec<Candidate>, threshold: f64) {
        for it in self.at_first_horizon(fit, threshold) {
            let same = candidates.iter().position(|other| other.label == it.label && other.numbers == it.numbers);
            match same {
                Some(place) if candidates[place].score <= it.score => {}
                Some(place) => candidates[place] = it,
                None => candidates.push(it),
            }
        }
        order::ascending(candidates, |it| it.score);
    }

    /// The best additional causes at the beginning of the records, each followed to their end. Empty if the plant already follows nearly the whole of
    /// the records: then the usual search sees the same.
    fn at_first_horizon(&self, fit: &Fit, threshold: f64) -> Vec<Candidate> {
        let limits = self.limits;
        // Calibrated again: a calibration to the whole records is biased by the missing cause.
        let plain = self.nominal.with_effects(self.nominal, fit.model.file.effects.clone());
        let Some(base) = first_horizon(self.whitened, plain, limits.fit_steps) else { return Vec::new() };
        let rows: usize = self.whitened.records.iter().map(|it| it.record.rows()).sum();
        if base.ends.iter().sum::<usize>() as f64 > NEARLY_ALL * rows as f64 {
            return Vec::new();
        }
        (self.progress)("fitting the beginnings of the records");
        let short = cut(self.whitened, &base.ends);
        let unseen = short.with_records(Vec::new());
        let hypotheses = scanned(self.hypotheses);
        let there = Search { whitened: &short, unseen: &unseen, hypotheses: &hypotheses, ..*self };
        let mut screened = screen(&short, &base.fit, self.nominal, &hypotheses);
        screened.iter_mut().for_each(Screened::without_traces);
        let mut found = there.fit_candidates(&base.fit, &screened, threshold);
        found.retain(|it| base.fit.cost - it.fit.cost > threshold);
        found.truncate(MOST_HYPOTHESES);
        let followed = self.side_by_side(&found, |search, it| {
            (self.progress)(&format!("following {}", it.label));
            let model = it.fit.model.clone();
            let whole = followed_to_end(search.whitened, model, base.ends.clone(), limits.fit_steps, threshold)?;
            search.evaluated(fit, whole)
        });
        followed.into_iter().flatten().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::calibration::calibrate;
    use super::super::model::InitialMotion;
    use super::super::noise::NoiseFloor;
    use super::super::whitened_residuals::Prepared;
    use super::super::{axis_under_steps, hypotheses, survey};
    use super::*;
    use rsm_core::source::Source;
    use rsm_fit::random::Random;
    use rsm_sim::kind::by_output;
    use rsm_sim::plant_file::PlantFile;
    use rsm_sim::record::Record;
    use rsm_sim::simulate::Simulator;

    /// A soft clutch that slips under every second push of the pedal and then swings between its limits, in two records of 15 s.
    fn slipping(capacity: f64) -> (WhitenedResiduals, PlantFile) {
        let soft = |text: &str| {
            text.replace("clutch_stiffness = 10000.0", "clutch_stiffness = 1300.0")
                .replace("clutch_damping = 30.0", "clutch_damping = 9.0")
        };
        let nominal = soft(include_str!("../../../rsm-sim/plants/driveline.toml"));
        // Off by half of what the file allows.
        let truth = nominal.replace("mass = 1560.0", "mass = 1576.0")
            + &format!("\n[[effects]]\nkind = \"clutch-slip\"\nparameters = {{ capacity = {capacity} }}\n");
        let file = |text: String| PlantFile::read(&Source::new("car.toml", text)).unwrap();
        let (nominal, truth) = (file(nominal), file(truth));
        let mut random = Random::new(6);
        let sds = by_output(&[0.5, 0.02, 0.05], 1.0);
        let records = [(400, 0.9), (550, 0.85)].map(|(push, pedal)| {
            let mut csv = "time[s],throttle[1],gear[1],engine_speed[rad/s],road_speed[m/s],acceleration[m/s^2]\n".to_string();
            for k in 0..1500 {
                let throttle = match k % push {
                    0..100 => 0.4,
                    200..270 => pedal,
                    _ => 0.03,
                };
                csv += &format!("{},{throttle},2,0,8,0\n", f64::from(k) / 100.0);
            }
            let mut record = Record::read(&Source::new("r.csv", csv), &truth).unwrap();
            let simulated = Simulator::new(&truth, &record).unwrap().run(&record).unwrap();
            for (k, name) in ["engine_speed", "road_speed", "acceleration"].iter().enumerate() {
                let noisy = simulated.of(name).unwrap().iter().map(|value| value + sds[k] * random.normal());
                record.measured[k] = Some(noisy.collect());
            }
            Prepared::new(record, 3)
        });
        (WhitenedResiduals::new(records.to_vec(), sds.map(NoiseFloor::white), 2), nominal)
    }

    #[test]
    fn a_clutch_that_swings_at_its_limit_is_followed_from_its_first_slip() {
        let (mut whitened, file) = slipping(140.0);
        let (nominal, calibrated) = calibrate(&mut whitened, &file, InitialMotion::Steady).unwrap();
        let survey = survey::survey(&whitened, &calibrated);
        let all = hypotheses::all(file.kind, &survey, &[0, 1, 2]);
        let mut slips: Vec<Hypothesis> = all.into_iter().filter(|it| it.description.kind == "clutch-slip").collect();
        // The usual guesses are shares of the largest torque, and one of them is near. These are not.
        for (guess, capacity) in slips.iter_mut().flat_map(|it| &mut it.guesses).zip([300.0, 250.0, 90.0, 70.0]) {
            guess.values = vec![capacity];
        }
        let unseen = whitened.with_records(Vec::new());
        let search = axis_under_steps::search(&whitened, &unseen, &nominal, &slips, &survey);
        let screened = screen(&whitened, &calibrated, &nominal, &slips);
        let mut candidates = search.fit_candidates(&calibrated, &screened, 40.0);
        let rows = calibrated.residual.len() as f64;
        // On the whole nothing comes near: a hundred times the noise is left.
        assert!(
            candidates.iter().all(|it| it.fit.cost > 100.0 * rows),
            "{:?}",
            candidates.iter().map(|it| it.fit.cost / rows).collect::<Vec<_>>()
        );
        search.add_from_first_horizon(&calibrated, &mut candidates, 40.0);
        let best = &candidates[0].fit;
        let capacity = best.model.file.effects[0].arguments.number("capacity");
        // A tenth of a per cent; and what is left is noise, as far as floors that were made beside a slipping clutch say.
        assert!((capacity / 140.0 - 1.0).abs() < 1e-3, "{capacity}");
        assert!(best.cost < 1.5 * rows, "{} of {rows}", best.cost);
    }

    #[test]
    fn a_beginning_ends_where_the_error_is_as_large_as_twice_the_noise() {
        let (whitened, file) = slipping(140.0);
        let records: Vec<&Record> = whitened.records.iter().map(|it| &it.record).collect();
        let mut model = Model::nominal(&file, &records, by_output(&[0.5, 0.02, 0.05], 1.0));
        let mut start = rsm_sim::kind::StartValues::default();
        let road_speed = file.kind.starts().iter().position(|it| it.name == "road_speed").unwrap();
        start[road_speed] = 8.0;
        model.starts = vec![start; 2];
        let ends = rows_followed(&whitened, &model).unwrap();
        // The first push beyond the capacity is at 2 s in both records.
        assert!(ends.iter().all(|end| (200..260).contains(end)), "{ends:?}");
        assert_eq!(extended_rows(&whitened, &model, &[60, 600]).unwrap(), vec![120, 600]);
    }

    #[test]
    fn one_number_is_scanned_between_its_guesses_and_waves_are_not() {
        let hypothesis = |guesses: Vec<Guess>| Hypothesis {
            description: rsm_sim::equation_plant::effect(rsm_sim::equation_plant::driveline(), "clutch-slip").unwrap(),
            subject: None,
            configuration: None,
            guesses,
        };
        let list =
            [hypothesis(vec![Guess::at(vec![100.0]), Guess::at(vec![200.0])]), hypothesis(vec![Guess::scaled(vec![1.0], 0.0)])];
        let scanned = scanned(&list);
        assert_eq!(scanned.len(), 1);
        let values: Vec<f64> = scanned[0].guesses.iter().map(|it| it.values[0]).collect();
        assert_eq!((values.len(), values[0]), (SCAN + 1, 100.0));
        assert!((values[SCAN] - 200.0).abs() < 1e-9 && (values[SCAN / 2] - 141.421_356).abs() < 1e-6);
    }
}

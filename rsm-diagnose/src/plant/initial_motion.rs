//! Records that begin in motion: a car whose torque lags and whose driveshaft oscillates, or an axis whose record was cut out of a longer log.
//!
//! In: a fit with steady initial states. Out: whether other initial states explain any record far better. If so, the initial states of all records
//! are unknown. Their influence ends within seconds, and so does the part of a missing cause that they can compensate for. Changes nothing else.
//!
//! All records of a machine usually come from the same kind of log. If one of them clearly begins in motion, the initial speed is unknown in all of
//! them, because a small speed is not 0. The memory of effects (delayed commands, a slow sensor, a twisted shaft) is unknown too, but soon forgotten:
//! in the first rows the simulation settles, and they are not compared.

use super::levenberg::{self, Fit};
use super::model::{self, InitialMotion, Model};
use super::validation;
use super::whitened_residuals::WhitenedResiduals;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;

/// Steps of a fit with free initial states. The plant is nearly linear in them.
const STEPS: usize = 4;

/// Three free initial values gain 3 on noise, and more than 30 once in a million records. If more than noise is left, the limit is this many times
/// the mean squared residual.
const LEAST_GAIN: f64 = 30.0;

/// The memory in s of an axis with its drive and sensors. Delays and lags are tens of milliseconds, and a position loop with a gain of 30/s forgets
/// in about the same time.
const MEMORY: f64 = 0.1;

/// The rows that are not compared are at most one in this many rows of a record.
const MOST_SHARE: usize = 10;

/// The initial motion of axis records. If they begin in motion, their first rows let the simulation settle and are not compared. Other plants count
/// as steady until a fit shows the contrary.
pub fn of_axis(whitened: &mut WhitenedResiduals, unseen: &mut WhitenedResiduals, file: &PlantFile) -> InitialMotion {
    let records = whitened.records.iter().chain(&unseen.records).map(|it| &it.record);
    let at_start = InitialMotion::of(file.kind, records);
    if at_start == InitialMotion::Steady {
        return at_start;
    }
    for prepared in whitened.records.iter_mut().chain(&mut unseen.records) {
        let rows = prepared.record.rows();
        let first = ((MEMORY / prepared.record.period) as usize).min(rows / MOST_SHARE);
        prepared.set_settling_rows(first);
    }
    at_start
}

/// Whether any training or holdout record begins in motion.
#[must_use]
pub fn is_visible(whitened: &WhitenedResiduals, fit: &Fit, unseen: &WhitenedResiduals) -> bool {
    // The only hidden start of a motor is its angle, the phase of what repeats every turn. It is no motion.
    let plant = fit.model.file.kind;
    let has_hidden = !plant.is_first_format || !plant.start_sizes.is_empty();
    if !has_hidden || fit.model.at_start == InitialMotion::InMotion {
        return false;
    }
    let free = levenberg::fit(whitened, with_free_starts(whitened, &fit.model), STEPS);
    if free.is_some_and(|free| gains(whitened, fit, &free)) {
        return true;
    }
    let Some(steady) = validation::fit_initial_states(unseen, &fit.model) else { return false };
    let mut model = with_free_starts(unseen, &steady.model);
    model.unknowns.retain(|it| matches!(it.place, model::Place::Start { .. }));
    levenberg::fit(unseen, model, STEPS).is_some_and(|free| gains(unseen, &steady, &free))
}

/// The model with free initial states, and the other ones as they were.
fn with_free_starts(whitened: &WhitenedResiduals, model: &Model) -> Model {
    let mut free = Model { at_start: InitialMotion::InMotion, ..model.clone() };
    let records: Vec<&Record> = whitened.records.iter().map(|it| &it.record).collect();
    free.take_starts(&records, whitened.floors.map(|floor| floor.sd));
    free.starts.clone_from(&model.starts);
    free
}

fn gains(whitened: &WhitenedResiduals, steady: &Fit, free: &Fit) -> bool {
    whitened.records.iter().enumerate().any(|(record, prepared)| {
        let first = whitened.first(record);
        let energy =
            |fit: &Fit| fit.residual[first..first + WhitenedResiduals::length(prepared)].iter().map(|it| it * it).sum::<f64>();
        let (before, after) = (energy(steady), energy(free));
        let rows: usize = prepared.used.iter().map(|used| used.iter().filter(|used| **used).count()).sum();
        before - after > LEAST_GAIN * (after / rows.max(1) as f64).max(1.0)
    })
}

#[cfg(test)]
mod tests {
    use rsm_core::source::Source;

    use super::super::noise::NoiseFloor;
    use super::super::whitened_residuals::Prepared;
    use super::*;
    use rsm_fit::random::Random;
    use rsm_sim::kind::OUTPUTS;

    /// Positions of 400 rows at a kilohertz that begin at a speed, m/s, read with 1 um of noise.
    fn axis(file: &PlantFile, speed: f64, seed: u64) -> Prepared {
        let mut random = Random::new(seed);
        let row = |k: usize| {
            let time = k as f64 / 1000.0;
            format!("{time},0,{}\n", speed * time + 1e-6 * random.normal())
        };
        let csv = "time[s],command[V],position[m]\n".to_string() + &(0..400).map(row).collect::<String>();
        Prepared::new(Record::read(&Source::new("r.csv", csv), file).unwrap(), 1)
    }

    /// How records with these speeds begin, the speeds that are unknown, and the rows of each record that judge.
    fn begun(speeds: &[f64]) -> (InitialMotion, usize, Vec<usize>) {
        let text = include_str!("../../../rsm-sim/plants/servo-axis.toml");
        // A record of a command: without the gains of a loop.
        let open: String = text
            .lines()
            .filter(|line| !line.contains("_gain = ") || line.contains("force"))
            .map(|it| format!("{it}\n"))
            .collect();
        let file = PlantFile::read(&Source::new("axis.toml", open)).unwrap();
        let records = speeds.iter().zip(5..).map(|(speed, seed)| axis(&file, *speed, seed)).collect();
        let mut whitened = WhitenedResiduals::new(records, [NoiseFloor::white(1e-6); OUTPUTS], 1);
        let mut unseen = WhitenedResiduals::new(vec![axis(&file, 0.0, 4)], [NoiseFloor::white(1e-6); OUTPUTS], 1);
        let at_start = of_axis(&mut whitened, &mut unseen, &file);
        let records: Vec<&Record> = whitened.records.iter().map(|it| &it.record).collect();
        let model = Model::with_initial_motion(&file, at_start, &records, [1e-6; OUTPUTS]);
        let is_speed = |place: &model::Place| matches!(place, model::Place::Start { place: 1, .. });
        let unknown = model.unknowns.iter().filter(|it| is_speed(&it.place)).count();
        let judging = whitened.records.iter().chain(&unseen.records).map(|it| it.used[0].iter().filter(|used| **used).count());
        (at_start, unknown, judging.collect())
    }

    #[test]
    fn one_record_that_begins_in_motion_says_so_of_all() {
        assert_eq!(begun(&[0.0, 0.0]), (InitialMotion::Steady, 0, vec![400; 3]));
        // The second is too slow for its first rows to show it. A tenth of 400 rows is less than 0.1 s.
        assert_eq!(begun(&[0.2, 0.0005]), (InitialMotion::InMotion, 2, vec![360; 3]));
    }
}

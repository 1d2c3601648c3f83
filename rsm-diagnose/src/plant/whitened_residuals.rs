//! Free-run simulations of a model along all records, on all cores, and their whitened residuals.
//!
//! In: a model and prepared records. Out: residuals with variance one where they are noise, and their derivatives with respect to the unknowns.
//! The bits do not depend on the number of threads: each simulation is one job with its own place in the result.

use super::model::{Model, Place};
use super::noise::NoiseFloor;
pub use super::prepared::Prepared;
use super::prepared::PreparedRecords;
use super::tails::Tails;
use crate::engine::columns::dot;
use crate::engine::work::WorkCount;
use rsm_core::threads::in_threads;
use rsm_sim::equation_plant;
use rsm_sim::equations::Setting;
use rsm_sim::kind::OUTPUTS;
use rsm_sim::plant_file::{Entry, PlantFile};
use rsm_sim::record::Record;
use rsm_sim::simulate::{Outputs, Simulator};

/// The step of a finite difference, in units of an unknown's scale. A law with a kink (free play, a limit) is simulated with the kink at an accuracy
/// of a share of a sub-step, so its outputs jump by 1e-5 of their change. With a step of a thousandth that was a tenth of the derivative. With three
/// hundredths it is negligible, and the error from curvature is as small: fits converge by a factor of thirty in each step, instead of a thousand.
const DIFFERENCE: f64 = 0.03;

/// The largest root mean square change of the outputs by a difference, in standard deviations of the noise. With a larger change, the curvature may
/// be as large as the trace itself, for example if a motion repeats many times after a cause. Errors from kinks are 1e-5 of a signal, a hundredth of
/// this.
const MOST_CHANGE: f64 = 1.0;

/// The largest reduction of the step at a time, because the effect is known only to first order.
const LEAST_SHORTENING: f64 = 0.01;

/// The largest number of reductions: two, down to 3e-6 of a scale.
const SHORTER_STEPS: usize = 2;

/// The work of a step of the series, in the unit of all work here: that of [`Setting::work`].
const STEP: usize = Setting::SERIES as usize;

/// The mean work per row of a record above which a model is not tried. With four steps per radian, it makes ten turns between two rows. An example is
/// a clutch that becomes stiffer and slips at the same time.
const MOST_WORK_A_ROW: usize = 250 * STEP;

/// A candidate may always take this work per row. Three strokes per turn at 500 rad/s are 15 radians in a row of 10 ms, and take 60 steps. Sampling
/// aliases such waves into the band, where they are visible.
const LEAST_ALLOWED: usize = 64 * STEP;

/// A candidate may take this many times the work of the calibrated plant. A cause adds one faster mode; if more steps are needed, a time constant
/// goes to zero.
const TIMES_THE_PLANT: usize = 8;

/// Simulated outputs of one record, in the order of [`Prepared::outputs`].
pub type Simulated = Vec<Vec<f64>>;

/// A derivative of the whitened simulation. It is zero outside its records.
#[derive(Debug, Clone)]
pub struct Column {
    /// Its first index in the stack of all residuals.
    pub first: usize,
    /// The values from there on.
    pub values: Vec<f64>,
}

impl Column {
    /// The inner product with a whole stack.
    #[must_use]
    pub fn dot_stack(&self, stack: &[f64]) -> f64 {
        dot(&self.values, &stack[self.first..self.first + self.values.len()])
    }

    /// The inner product of two columns.
    #[must_use]
    pub fn dot(&self, other: &Column) -> f64 {
        let first = self.first.max(other.first);
        let end = (self.first + self.values.len()).min(other.first + other.values.len());
        if first >= end {
            return 0.0;
        }
        dot(&self.values[first - self.first..end - self.first], &other.values[first - other.first..end - other.first])
    }
}

/// Records and the noise of their outputs.
#[derive(Debug, Clone)]
pub struct WhitenedResiduals {
    /// The records.
    pub records: PreparedRecords,
    /// Noise of each output of the plant.
    pub floors: [NoiseFloor; OUTPUTS],
    /// The distributions by which readings were corrected for heavy tails.
    pub tails: [Option<Tails>; OUTPUTS],
    /// The number of simulations in parallel.
    pub threads: usize,
    /// The work limit of simulations, and the work so far.
    pub work: SimulationWork,
}

/// The work of simulations. A count, not seconds, so that results are the same on every machine.
#[derive(Debug, Clone)]
pub struct SimulationWork {
    /// The mean work per row of a record at which a run is stopped.
    pub most: usize,
    /// The permitted error of a step, as in [`Setting`].
    pub tolerance: f64,
    /// The work of all runs with this value and its clones, and the work at which multistart ends with its best result.
    count: WorkCount,
}

impl Default for SimulationWork {
    fn default() -> Self {
        SimulationWork { most: MOST_WORK_A_ROW, tolerance: Setting::default().tolerance, count: WorkCount::within(u64::MAX) }
    }
}

impl SimulationWork {
    /// The same limit for each run, with a separate count.
    #[must_use]
    pub fn with_new_count(&self) -> Self {
        SimulationWork { most: self.most, tolerance: self.tolerance, ..SimulationWork::default() }
    }

    /// The work so far.
    #[must_use]
    pub fn done(&self) -> u64 {
        self.count.done()
    }

    /// Sets the limit of the work, counted from the beginning. It holds for all clones.
    pub fn set_limit(&self, work: u64) {
        self.count.set_limit(work);
    }

    /// Whether the limit is used up. Call this between runs, never in parallel with them: then the answer does not depend on the number of threads.
    #[must_use]
    pub fn is_limit_reached(&self) -> bool {
        self.count.is_limit_reached()
    }

    /// A separate count for one of several jobs side by side, with what is left of the limit. Then it does not depend on the other jobs when this one
    /// ends.
    #[must_use]
    fn for_one_job(&self) -> Self {
        SimulationWork { count: self.count.remaining(), ..self.clone() }
    }

    /// Adds the work of such a job.
    fn add_job(&self, job: &Self) {
        self.count.add(job.done());
    }

    /// The limits for candidates, relative to a plant whose run over this many rows took this work; and the permitted error of their steps.
    #[must_use]
    pub fn for_candidates(&self, work: u64, rows: usize, tolerance: f64) -> Self {
        let own = usize::try_from(work / rows.max(1) as u64).unwrap_or(usize::MAX);
        SimulationWork {
            most: LEAST_ALLOWED.max(own.saturating_mul(TIMES_THE_PLANT)).min(MOST_WORK_A_ROW.max(own)),
            tolerance,
            ..self.clone()
        }
    }
}

/// The indices of jobs that can run side by side: plants with the same effects in the same order, on one record.
fn joint_jobs(jobs: &[(usize, &Model)]) -> Vec<Vec<usize>> {
    let is_like = |one: &(usize, &Model), other: &(usize, &Model)| {
        let (mut a, mut b) = (one.1.file.acting(), other.1.file.acting());
        let is_one = |a: &Entry, b: &Entry| {
            let names = |it: &Entry| it.arguments.numbers.iter().map(|it| it.0).collect::<Vec<_>>();
            std::ptr::eq(a.description, b.description) && a.arguments.subject == b.arguments.subject && names(a) == names(b)
        };
        let is_alike = loop {
            match (a.next(), b.next()) {
                (None, None) => break true,
                (Some(a), Some(b)) if is_one(a, b) => {}
                _ => break false,
            }
        };
        one.0 == other.0 && is_alike
    };
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (place, job) in jobs.iter().enumerate() {
        let fits = |group: &&mut Vec<usize>| group.len() < equation_plant::SIDE_BY_SIDE && is_like(&jobs[group[0]], job);
        match groups.iter_mut().find(fits) {
            Some(group) => group.push(place),
            None => groups.push(vec![place]),
        }
    }
    groups
}

/// Runs jobs on all threads, those that can run side by side together. `run` gets the indices of such jobs, and returns their results in this order.
pub(super) fn side_by_side<T: Clone + Send>(
    jobs: &[(usize, &Model)],
    threads: usize,
    run: impl Fn(&[usize]) -> Vec<Option<T>> + Sync,
) -> Vec<Option<T>> {
    let groups = joint_jobs(jobs);
    let done = in_threads(&groups, threads, |group| run(group));
    let mut all: Vec<Option<T>> = vec![None; jobs.len()];
    for (place, found) in groups.into_iter().flatten().zip(done.into_iter().flatten()) {
        all[place] = found;
    }
    all
}

impl WhitenedResiduals {
    /// Records without a simulation yet.
    #[must_use]
    pub fn new(records: Vec<Prepared>, floors: [NoiseFloor; OUTPUTS], threads: usize) -> Self {
        WhitenedResiduals { records: records.into(), floors, tails: [None; OUTPUTS], threads, work: SimulationWork::default() }
    }

    /// The same for other records, with a shared count of work.
    #[must_use]
    pub fn with_records(&self, records: Vec<Prepared>) -> Self {
        WhitenedResiduals { records: records.into(), work: self.work.clone(), ..*self }
    }

    /// The results of the same work for several items, side by side, each with these records on its share of the threads. Each item counts its own
    /// work, with what is left of the limit, so its result does not depend on the other items nor on the number of threads.
    pub fn jobs<T: Sync, A: Send>(&self, items: &[T], work: impl Fn(&Self, &T) -> A + Sync) -> Vec<A> {
        let threads = (self.threads / items.len().max(1)).max(1);
        let done = in_threads(items, self.threads, |item| {
            let here = WhitenedResiduals { threads, work: self.work.for_one_job(), ..self.clone() };
            (work(&here, item), here.work)
        });
        let result = |(result, work)| {
            self.work.add_job(&work);
            result
        };
        done.into_iter().map(result).collect()
    }

    /// Runs jobs on all threads; `None` for a job whose simulation failed.
    #[must_use]
    pub fn simulate(&self, jobs: &[(usize, &Model)]) -> Vec<Option<Simulated>> {
        side_by_side(jobs, self.threads, |group| self.group(jobs, group))
    }

    /// The permitted error of a step for simulations that are compared with these records, by their noise ([`Prepared::tolerance`]).
    #[must_use]
    pub fn tolerance(&self) -> f64 {
        let noise = |it: &Prepared| it.outputs.iter().map(|output| self.floors[*output].sd).collect::<Vec<f64>>();
        self.records.iter().map(|it| it.tolerance(&noise(it))).fold(1.0, f64::min)
    }

    /// Runs jobs on one record whose plants run side by side.
    fn group(&self, jobs: &[(usize, &Model)], group: &[usize]) -> Vec<Option<Simulated>> {
        let record = jobs[group[0]].0;
        let prepared = &self.records[record];
        let files: Vec<PlantFile> = group.iter().map(|place| jobs[*place].1.for_record(record, &prepared.record)).collect();
        let (found, work) = equation_plant::together(&files, &prepared.record, self.work.tolerance, self.work.most);
        self.work.count.add(work);
        let shown = |values: Vec<Vec<f64>>| -> Option<Simulated> {
            let shown: Simulated = prepared.outputs.iter().map(|output| values[*output].clone()).collect();
            shown.iter().flatten().all(|value| value.is_finite()).then_some(shown)
        };
        found.into_iter().map(|values| values.and_then(shown)).collect()
    }

    /// All outputs of one model along one record, including those that the record does not hold; `None` if the simulation failed.
    #[must_use]
    pub fn all_outputs(&self, record: usize, model: &Model) -> Option<Outputs> {
        let prepared = &self.records[record];
        let file = model.for_record(record, &prepared.record);
        let mut simulator = Simulator::new(&file, &prepared.record).ok()?.at_most(self.work.most);
        let done = simulator.run(&prepared.record);
        self.work.count.add(simulator.work());
        done.ok()
    }

    /// One model along all records.
    #[must_use]
    pub fn run(&self, model: &Model) -> Option<Vec<Simulated>> {
        let jobs: Vec<(usize, &Model)> = (0..self.records.len()).map(|record| (record, model)).collect();
        self.simulate(&jobs).into_iter().collect()
    }

    /// Several models along all records. Where a model does not change a record, the simulation of the record is that of `from`.
    #[must_use]
    pub fn run_changed(
        &self,
        models: &[Model],
        from: &[Simulated],
        changes: &dyn Fn(usize, &Record) -> bool,
    ) -> Vec<Option<Vec<Simulated>>> {
        let all = (0..models.len()).flat_map(|model| (0..self.records.len()).map(move |record| (model, record)));
        let all: Vec<(usize, usize, bool)> =
            all.map(|(model, record)| (model, record, changes(model, &self.records[record].record))).collect();
        let jobs: Vec<(usize, &Model)> = all.iter().filter(|it| it.2).map(|it| (it.1, &models[it.0])).collect();
        let mut done = self.simulate(&jobs).into_iter();
        let mut found =
            all.into_iter().map(|(_, record, is_run)| if is_run { done.next().flatten() } else { Some(from[record].clone()) });
        models.iter().map(|_| found.by_ref().take(self.records.len()).collect::<Vec<_>>().into_iter().collect()).collect()
    }

    /// Several models along all records.
    #[must_use]
    pub fn run_all(&self, models: &[Model]) -> Vec<Option<Vec<Simulated>>> {
        let count = self.records.len();
        let jobs: Vec<(usize, &Model)> =
            models.iter().flat_map(|model| (0..count).map(move |record| (record, model))).collect();
        let mut done = self.simulate(&jobs).into_iter();
        models.iter().map(|_| done.by_ref().take(count).collect::<Vec<_>>().into_iter().collect()).collect()
    }

    /// Measured minus simulated, whitened, for all records one after another. If a sensor rounds, the mean reading replaces the simulated value.
    /// Derivatives are those of the value itself: they are right on average over a step and have no jumps.
    #[must_use]
    pub fn residual(&self, simulated: &[Simulated]) -> Vec<f64> {
        let mut stack = Vec::with_capacity(self.rows());
        let mut difference = Vec::new();
        for (prepared, simulated) in self.records.iter().zip(simulated) {
            for (k, values) in simulated.iter().enumerate() {
                let floor = &self.floors[prepared.outputs[k]];
                difference.clear();
                difference.extend(
                    prepared.measured(k).iter().zip(values).map(|(measured, value)| measured - floor.mean_reading(*value)),
                );
                floor.scale_to_uniform(prepared.measured(k), &mut difference);
                floor.whiten(&difference, &prepared.used[k], &mut stack);
            }
        }
        stack
    }

    /// The whitened change of a record's simulation, divided by a step.
    #[must_use]
    pub fn change(&self, record: usize, from: &Simulated, to: &Simulated, step: f64) -> Vec<f64> {
        let prepared = &self.records[record];
        let mut stack = Vec::new();
        let mut difference = Vec::new();
        for (k, (from, to)) in from.iter().zip(to).enumerate() {
            difference.clear();
            difference.extend(from.iter().zip(to).map(|(from, to)| (to - from) / step));
            let floor = &self.floors[prepared.outputs[k]];
            floor.scale_to_uniform(prepared.measured(k), &mut difference);
            floor.whiten(&difference, &prepared.used[k], &mut stack);
        }
        stack
    }

    /// The same for all records.
    #[must_use]
    pub fn changes(&self, from: &[Simulated], to: &[Simulated], step: f64) -> Vec<f64> {
        (0..self.records.len()).flat_map(|record| self.change(record, &from[record], &to[record], step)).collect()
    }

    /// The length of the stack.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.records.iter().map(Self::length).sum()
    }

    /// The number of values of a record in the stack.
    #[must_use]
    pub fn length(prepared: &Prepared) -> usize {
        prepared.outputs.len() * prepared.record.rows()
    }

    /// The first index of a record in the stack.
    #[must_use]
    pub fn first(&self, record: usize) -> usize {
        self.records[..record].iter().map(Self::length).sum()
    }

    /// Derivatives of the whitened simulation with respect to the chosen unknowns, on the scale of their search, by forward differences. A difference
    /// that cannot be simulated, or that changes the outputs by more than `MOST_CHANGE`, is computed again with a shorter step.
    #[must_use]
    pub fn derivatives(&self, model: &Model, simulated: &[Simulated], chosen: &[usize]) -> Option<Vec<Column>> {
        let mut columns: Vec<Option<Column>> = vec![None; chosen.len()];
        let mut steps: Vec<f64> = chosen.iter().map(|&k| DIFFERENCE * model.unknowns[k].scale).collect();
        for shorter in 0..=SHORTER_STEPS {
            let open: Vec<usize> = (0..chosen.len()).filter(|at| steps[*at] > 0.0).collect();
            if open.is_empty() {
                break;
            }
            let wanted: Vec<(usize, f64)> = open.iter().map(|&at| (chosen[at], steps[at])).collect();
            for (at, column) in open.into_iter().zip(self.differences(model, simulated, &wanted)) {
                let step = std::mem::take(&mut steps[at]);
                let change = column
                    .as_ref()
                    .map_or(f64::INFINITY, |it| step * (dot(&it.values, &it.values) / it.values.len().max(1) as f64).sqrt());
                if shorter < SHORTER_STEPS && change > MOST_CHANGE {
                    steps[at] = step * (MOST_CHANGE / change).max(LEAST_SHORTENING);
                }
                columns[at] = column.or(columns[at].take());
            }
        }
        columns.into_iter().collect()
    }

    /// The records on which an unknown acts: that of an initial state, those of its configurations otherwise.
    fn changed(&self, model: &Model, unknown: usize) -> Vec<usize> {
        match model.unknowns[unknown].place {
            Place::Start { record, .. } => vec![record],
            place => (0..self.records.len()).filter(|record| model.acts_on(place, &self.records[*record].record)).collect(),
        }
    }

    /// Forward differences for unknowns with their steps; `None` where one cannot be simulated.
    fn differences(&self, model: &Model, simulated: &[Simulated], wanted: &[(usize, f64)]) -> Vec<Option<Column>> {
        let mut moved = Vec::new();
        for &(k, step) in wanted {
            let unknown = &model.unknowns[k];
            let at = unknown.to_search_scale(model.value(k));
            let step = if unknown.plant_value(at + step) >= unknown.high { -step } else { step };
            let mut other = model.clone();
            other.set(k, unknown.plant_value(at + step));
            moved.push((k, step, other));
        }
        let changed: Vec<Vec<usize>> = moved.iter().map(|(k, ..)| self.changed(model, *k)).collect();
        let jobs: Vec<(usize, &Model)> =
            moved.iter().zip(&changed).flat_map(|(it, records)| records.iter().map(|record| (*record, &it.2))).collect();
        let mut done = self.simulate(&jobs).into_iter();
        // For each unknown: the records on which it acts, with their simulations.
        let runs: Vec<Vec<(usize, Option<Simulated>)>> = changed
            .into_iter()
            .map(|records| records.into_iter().map(|record| (record, done.next().flatten())).collect())
            .collect();
        let places: Vec<usize> = (0..moved.len()).collect();
        in_threads(&places, self.threads, |&place| {
            let (k, step, _) = &moved[place];
            self.column(model.unknowns[*k].place, simulated, &runs[place], *step)
        })
    }

    /// The derivative of an unknown from the simulations of the records on which it acts; `None` if one of them failed.
    fn column(&self, place: Place, simulated: &[Simulated], runs: &[(usize, Option<Simulated>)], step: f64) -> Option<Column> {
        let run_of = |record: usize| runs.iter().find(|it| it.0 == record).map(|it| it.1.as_ref());
        if let Place::Start { record, .. } = place {
            let to = run_of(record)??;
            return Some(Column { first: self.first(record), values: self.change(record, &simulated[record], to, step) });
        }
        let mut values = Vec::with_capacity(self.rows());
        for (record, from) in simulated.iter().enumerate() {
            let to = run_of(record).unwrap_or(Some(from))?;
            values.extend(self.change(record, from, to, step));
        }
        Some(Column { first: 0, values })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rsm_core::source::Source;
    use rsm_sim::plant_file::PlantFile;

    #[test]
    fn a_difference_that_moves_more_than_the_noise_is_taken_again_over_a_shorter_step() {
        // An open axis without friction: q = gain u t^2/(2 mass), so that dq/dmass = -q/mass; over 3 % of the mass a difference has 1/1.03 of that.
        let text = "format = 1\nplant = \"servo-axis\"\n[parameters]\nmass = 2\nforce_gain = 4\nviscous_friction = 0\n\
                    command_limit = 10\n[tolerance]\nmass = 1\n";
        let file = PlantFile::read(&Source::new("axis.toml", text.to_string())).unwrap();
        let mut csv = "time[s],command[V],position[m]\n".to_string();
        for k in 0..200 {
            csv += &format!("{},1,0\n", f64::from(k) / 100.0);
        }
        let record = Record::read(&Source::new("r.csv", csv), &file).unwrap();
        let share = |noise: f64| {
            let records = vec![Prepared::new(record.clone(), 2)];
            let whitened = WhitenedResiduals::new(records, [NoiseFloor::white(noise); OUTPUTS], 1);
            let model = Model::nominal(&file, &[&record], [noise; OUTPUTS]);
            let simulated = whitened.run(&model).unwrap();
            let mass = model.unknowns.iter().position(|it| it.place == Place::Nominal("mass")).unwrap();
            let column = &whitened.derivatives(&model, &simulated, &[mass]).unwrap()[0];
            column.values[150] * noise / (-simulated[0][0][150] / 2.0)
        };
        // 3 % of the mass move the end by 0.12 m.
        assert!((share(1.0) - 1.0 / 1.03).abs() < 1e-6, "{}", share(1.0));
        assert!((share(1e-4) - 1.0).abs() < 1e-4, "{}", share(1e-4));
    }
}

//! From tip-in runs to a compensator, in rounds: fit, compensate, drive again, add the missing damping, until it no longer improves.
//!
//! In: a plant file, plans, seeds. Out: a model with the surfaces and the compensator `tip_in`, and the figures of every round. The first round uses
//! the pole damping of a filter of third order. Every later round adds a share of the damping that was missing to 0.7 in the response to the pedal.
//! The surfaces are fitted in memory; [`specification`] and [`data`] are the same fit as files. Never writes.
//!
//! The poles get a natural frequency of their own, a little above the rate of the engine's lag ([`Poles`]). At the shuffle frequency of the high
//! gears, four times the lag's rate, they could have any damping: the lag would dominate and the response stay overdamped (measured: 0.8 to 2.2 in
//! gears 3 to 5 for any pole damping from 0.4 to 0.7). Much slower poles cost acceleration for nothing.

use rsm_core::check::Checked;
use rsm_core::model::{Compensator, Model, Scheduled};
use rsm_core::source::Faults;
use rsm_fit::{Constraint, Fit, Input, Outcome, Response, Select};

use rsm_sim::plant_file::PlantFile;

use super::experiment::{csv, experiment};
use super::measure::{Measured, TARGET};
use super::plan::TrackPlan;
use super::run::{CONTROL_PERIOD, Compensation};

/// The name of the compensator in the model.
pub const COMPENSATOR: &str = "tip_in";

/// Pole damping of the first round: that of Butterworth's filter of third order, whose real pole stands for the engine's lag.
const FIRST_POLE_DAMPING: f64 = 0.5;

/// The share of the missing damping that a round adds. The response gains 0.6 (first gear) to 1.8 (fifth) of what the poles gain, so every
/// error shrinks, at worst to -0.26 or 0.58 of itself.
const SHARE: f64 = 0.7;

/// Rounds at most; the last ones no longer improve.
const MOST_ROUNDS: usize = 8;

/// No more damping than this is asked of the poles: beyond, the slower of the two real ones is what the driver feels.
const MOST_POLE_DAMPING: f64 = 1.2;

/// Powers of speed and gear that leave no more than noise of what is smooth in gear and nearly straight in speed (lack of fit below the standard
/// errors).
const SMOOTH: &[[u32; 2]] = &[[0, 0], [1, 0], [0, 1], [1, 1], [0, 2], [1, 2], [0, 3], [1, 3]];

/// With lash the damping bends much more: at low torque the gap takes longer. These are what the ladder up to fifth order chose on 25 runs with the
/// seed 11 and 30 unseen ones at other speeds. On runs of other seeds and unseen speeds they leave 0.8 % of the mean damping, the eight above 4 to 5
/// %.
const WITH_GAP: &[[u32; 2]] =
    &[[0, 0], [1, 0], [0, 1], [2, 0], [1, 1], [0, 2], [3, 0], [0, 3], [4, 0], [3, 1], [2, 2], [1, 3], [0, 4], [5, 0], [1, 4]];

/// The paper's own form: second order in speed and gear.
pub const SECOND_ORDER: &[[u32; 2]] = &[[0, 0], [1, 0], [0, 1], [2, 0], [1, 1], [0, 2]];

/// Ranges of the model, in m/s and in gears; where the evaluators of both dampings and of the frequency saturate.
const SPEEDS: [f64; 2] = [2.5, 50.0];
const GEARS: [f64; 2] = [1.0, 5.0];
const DAMPINGS: [f64; 2] = [0.05, 1.0];
const DAMPING_ERRORS: [f64; 2] = [-0.04, 1.2];
const FREQUENCIES: [f64; 2] = [8.0, 80.0];

/// Faces of the support: four sides of the box and the two lines of the engine.
const FACES: usize = 6;

/// The text of the specification of the surfaces. Without lash all are smooth in gear and nearly straight in speed, whose slope falls with the gear
/// (it goes with engine speed). Both dampings have the same terms ([`Poles::damping_terms`]), so that the noise of the one leaves their sum.
#[must_use]
pub fn specification(data: &str, unseen: Option<&str>, damping_terms: &[[u32; 2]]) -> String {
    let unseen = unseen.map_or(String::new(), |file| format!("validate = [\"{file}\"]\n"));
    let fixed = "select = { method = \"fixed\" }";
    let (terms, frequency_terms) = (format!("terms = {damping_terms:?}\n{fixed}"), format!("terms = {SMOOTH:?}\n{fixed}"));
    format!(
        r#"# Surfaces of tip-in runs (`rsm experiment driveline`) against road speed and gear.
format = 1
model = "driveline"
data = ["{data}"]
{unseen}
[inputs.speed]
unit = "m/s"
range = {SPEEDS:?}

[inputs.gear]
unit = "1"
range = {GEARS:?}

# The mode behind the engine's lag: what the zeros of the compensator cancel. A damping is positive.
# One support stands for all three surfaces, since they rest on the same rows: the box and the two lines of the engine's speed.
[responses.damping_ratio]
column = "shuffle_damping"
unit = "1"
inputs = ["speed", "gear"]
output_range = {DAMPINGS:?}
constraints = [{{ kind = "bounds", min = 0.0 }}]
support = {{ from = "data", faces = {FACES} }}
{terms}

# What the poles need beyond it. Both lower ends add up to more than 0: the poles are stable wherever the surfaces saturate.
[responses.damping_error]
column = "pole_damping_error"
unit = "1"
inputs = ["speed", "gear"]
output_range = {DAMPING_ERRORS:?}
{terms}

[responses.shuffle_frequency]
unit = "rad/s"
inputs = ["speed", "gear"]
output_range = {FREQUENCIES:?}
{frequency_terms}
"#
    )
}

/// One round.
#[derive(Debug, Clone)]
pub struct Round {
    /// The surfaces and the compensator that were driven.
    pub model: Model,
    /// What was asked of the poles, run by run.
    pub pole_damping: Vec<f64>,
    /// What the compensated car did.
    pub measured: Vec<Measured>,
    /// Mean damping ratio of the response.
    pub zeta_mean: f64,
    /// Largest |zeta - 0.7|.
    pub zeta_max_residual: f64,
    /// Largest overshoot over that of the same run without compensator, of the runs that have one ([`Measured::has_overshoot`]).
    pub overshoot_ratio_worst: f64,
}

/// The rounds of one car.
#[derive(Debug, Clone)]
pub struct Tuned {
    /// The car without compensator.
    pub uncompensated: Vec<Measured>,
    /// The rounds, in order.
    pub rounds: Vec<Round>,
    /// The best one, from 0.
    pub best: usize,
}

impl Tuned {
    /// The model of the best round.
    #[must_use]
    pub fn model(&self) -> &Model {
        &self.rounds[self.best].model
    }
}

/// What is asked of the poles, beyond what the rounds find.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Poles {
    /// Their natural frequency times the engine's lag.
    pub frequency_times_lag: f64,
    /// The least damping that is asked for.
    pub least_damping: f64,
    /// Powers of speed and gear of both damping surfaces, whose sum is the poles' damping.
    pub damping_terms: &'static [[u32; 2]],
}

impl Poles {
    /// For a car without lash: 1.4 times the lag's rate. Slower poles cost acceleration, faster ones leave a damping of the response above 0.7
    /// whatever theirs is. Below a damping of 0.2 they would ring on their own.
    pub const WITHOUT_LASH: Poles = Poles { frequency_times_lag: 1.4, least_damping: 0.2, damping_terms: SMOOTH };

    /// For a car with lash: the slower the torque rises, the softer the gap closes, and a clunk overshoots beyond what the damping says. Measured
    /// over frequencies of 1.0, 1.2 and 1.4 and dampings of 0.6 to 1.0: about 1.1 and 0.65 are the fastest that halve every overshoot.
    pub const WITH_LASH: Poles = Poles { frequency_times_lag: 1.1, least_damping: 0.65, damping_terms: WITH_GAP };
}

/// How a car is tuned.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// The seed of the first experiment; every round has the next one.
    pub seed: u64,
    /// What is asked of the poles.
    pub poles: Poles,
    /// On so many threads.
    pub threads: usize,
}

/// Mean and largest residual to 0.7 of the response's damping ratio.
#[must_use]
pub fn zeta(measured: &[Measured]) -> (f64, f64) {
    let zetas = measured.iter().map(|it| it.response.shape.damping_ratio);
    let mean = zetas.clone().sum::<f64>() / measured.len().max(1) as f64;
    (mean, zetas.map(|zeta| (zeta - TARGET).abs()).fold(0.0, f64::max))
}

/// What a car does in the runs of a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Driven {
    /// Mean damping ratio of the response.
    pub mean: f64,
    /// Largest distance of it from 0.7.
    pub largest_residual: f64,
    /// Mean distance.
    pub mean_residual: f64,
    /// Largest overshoot, as a share.
    pub largest_overshoot: f64,
}

impl Driven {
    /// Of measured runs.
    #[must_use]
    pub fn of(measured: &[Measured]) -> Self {
        let (mean, largest_residual) = zeta(measured);
        let residuals = measured.iter().map(|it| it.damping_error().abs());
        Driven {
            mean,
            largest_residual,
            mean_residual: residuals.sum::<f64>() / measured.len().max(1) as f64,
            largest_overshoot: measured.iter().map(|it| it.overshoot).fold(0.0, f64::max),
        }
    }
}

/// The overshoot of a compensated run over that of the same run without compensator; `None` if that had no significant overshoot.
#[must_use]
pub fn overshoot_ratio(uncompensated: &Measured, compensated: &Measured) -> Option<f64> {
    uncompensated.has_overshoot().then(|| compensated.overshoot / uncompensated.overshoot)
}

/// The largest of these ratios.
#[must_use]
pub fn worst_ratio(uncompensated: &[Measured], compensated: &[Measured]) -> f64 {
    uncompensated.iter().zip(compensated).filter_map(|(before, after)| overshoot_ratio(before, after)).fold(0.0, f64::max)
}

/// What the poles shall have beyond the damping of the mode.
fn pole_damping_errors(measured: &[Measured], pole_damping: &[f64]) -> Vec<f64> {
    measured.iter().zip(pole_damping).map(|(it, pole)| pole - it.mode.shape.damping_ratio).collect()
}

/// The data of [`specification`]: what was measured, and `pole_damping_error`, what the poles shall have beyond the damping of the mode.
#[must_use]
pub fn data(measured: &[Measured], pole_damping: &[f64]) -> String {
    csv(measured, &[("pole_damping_error[1]", &pole_damping_errors(measured, pole_damping))])
}

/// The data of unseen runs. The wanted pole damping of these runs was not measured: the column has the target, and its figures are not used.
#[must_use]
pub fn unseen_data(unseen: &[Measured]) -> String {
    data(unseen, &vec![TARGET; unseen.len()])
}

/// The inputs of runs.
fn inputs(measured: &[Measured]) -> [Input; 2] {
    let speed = measured.iter().map(|it| it.road_speed).collect::<Vec<f64>>();
    let gear = measured.iter().map(|it| it.run.gear as f64).collect::<Vec<f64>>();
    [Input::new("speed", speed).unit("m/s").range(SPEEDS), Input::new("gear", gear).unit("1").range(GEARS)]
}

/// The responses of runs whose poles shall have these dampings, as [`specification`] has them.
fn responses(measured: &[Measured], pole_damping: &[f64], damping_terms: &[[u32; 2]]) -> [Response; 3] {
    let damping: Vec<f64> = measured.iter().map(|it| it.mode.shape.damping_ratio).collect();
    let frequency: Vec<f64> = measured.iter().map(|it| it.mode.shape.natural_frequency).collect();
    let errors = pole_damping_errors(measured, pole_damping);
    [
        Response::new("damping_ratio", damping)
            .output_range(DAMPINGS)
            .constraint(Constraint::Bounds { min: Some(0.0), max: None })
            .supported_by_data(0.0)
            .support_faces(FACES)
            .select(Select::terms(damping_terms.iter().copied())),
        Response::new("damping_error", errors)
            .output_range(DAMPING_ERRORS)
            .select(Select::terms(damping_terms.iter().copied())),
        Response::new("shuffle_frequency", frequency)
            .unit("rad/s")
            .output_range(FREQUENCIES)
            .select(Select::terms(SMOOTH.iter().copied())),
    ]
}

/// Fits the surfaces of runs whose poles shall have these dampings.
///
/// # Errors
/// What the fit refuses.
pub fn fit_surfaces(
    measured: &[Measured],
    pole_damping: &[f64],
    unseen: Option<&[Measured]>,
    damping_terms: &[[u32; 2]],
) -> Result<Outcome, Faults> {
    let runs: Vec<f64> = measured.iter().map(|it| f64::from(it.run.run)).collect();
    let mut fit =
        Fit::new(inputs(measured), responses(measured, pole_damping, damping_terms)).name("driveline").run_order(runs);
    if let Some(unseen) = unseen {
        fit = fit.validate(inputs(unseen), responses(unseen, &vec![TARGET; unseen.len()], damping_terms));
    }
    Ok(fit.fit()?)
}

/// The model of fitted surfaces with the compensator on top.
#[must_use]
pub fn with_compensator(surfaces: &Model, pole_frequency: f64) -> Model {
    let mut model = surfaces.clone();
    model.compensators.push(Compensator {
        name: COMPENSATOR.to_string(),
        sample_time: CONTROL_PERIOD,
        natural_frequency: Scheduled::Surface("shuffle_frequency".to_string()),
        zero_damping: Scheduled::Surface("damping_ratio".to_string()),
        pole_damping: Scheduled::Sum(vec!["damping_ratio".to_string(), "damping_error".to_string()]),
        pole_frequency: Some(Scheduled::Fixed(pole_frequency)),
    });
    model
}

/// Tunes the compensator of a car on a plan.
///
/// # Errors
/// What the track or the fit refuses.
pub fn tune(plant: &PlantFile, plan: &TrackPlan, settings: &Settings) -> Result<Tuned, Faults> {
    let drive = |seed: u64, compensation: Option<&Compensation>| {
        let runs = experiment(plant, plan, seed, compensation, settings.threads)?;
        Ok::<_, Faults>(runs.into_iter().map(|(measured, _)| measured).collect::<Vec<_>>())
    };
    let uncompensated = drive(settings.seed, None)?;
    let lag = plant.effective_parameters().number("torque_lag");
    // To a tenth of a rad/s: easy to read in the file.
    let pole_frequency = (settings.poles.frequency_times_lag / lag * 10.0).round() / 10.0;
    let mut pole_damping = vec![FIRST_POLE_DAMPING.max(settings.poles.least_damping); plan.runs.len()];
    let mut rounds: Vec<Round> = vec![];
    let mut best = 0;
    while rounds.len() < MOST_ROUNDS {
        let outcome = fit_surfaces(&uncompensated, &pole_damping, None, settings.poles.damping_terms)?;
        let model = with_compensator(&outcome.model, pole_frequency);
        let compensation = Compensation::new(&Checked::from_model(&model)?, COMPENSATOR)?;
        let measured = drive(settings.seed + 1 + rounds.len() as u64, Some(&compensation))?;
        let (zeta_mean, zeta_max_residual) = zeta(&measured);
        let next = pole_damping.iter().zip(&measured).map(|(pole, it)| pole + SHARE * it.damping_error());
        let next = next.map(|pole| pole.clamp(settings.poles.least_damping, MOST_POLE_DAMPING)).collect();
        let overshoot_ratio_worst = worst_ratio(&uncompensated, &measured);
        rounds.push(Round { model, pole_damping, measured, zeta_mean, zeta_max_residual, overshoot_ratio_worst });
        pole_damping = next;
        let missing = |round: &Round| round.measured.iter().map(|it| it.damping_error().powi(2)).sum::<f64>();
        if missing(&rounds[rounds.len() - 1]) < missing(&rounds[best]) {
            best = rounds.len() - 1;
        } else if rounds.len() >= best + 3 {
            // Two rounds in a row without a gain: the rest is noise, or these terms cannot represent it.
            break;
        }
    }
    Ok(Tuned { uncompensated, rounds, best })
}

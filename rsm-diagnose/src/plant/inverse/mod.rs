//! The inverse model of a body with one input: the force that a measured motion needs, compared with the force that the drive gave.
//!
//! In: a record with the position of the body and the input, the command. Out: regressions of the force on acceleration, speed and friction, and the
//! relative error of the force, also for any plant file whose effects have no memory. Only filtered derivatives of the measured position are used: no
//! simulation, no loop, no initial state. Never decides about causes: a good fit of the force does not imply a good free run.
//!
//! Source: A. Janot, M. Gautier, M. Brunot, "Data Set and Reference Models of EMPS", 2019: inverse dynamic identification model with least squares
//! (IDIM-LS).

pub mod filter;

use filter::LowPass;

use super::one_body::OneBody;
use crate::engine::normal::Normal;
use rsm_sim::kind::PlantKind;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;

/// The position is filtered with a Butterworth of fourth order both ways. The cutoff as a share of the Nyquist frequency: 100 Hz at 1 kHz in the
/// source.
const CUTOFF: f64 = 0.2;

/// Every tenth row is kept (as in the source), after a Chebyshev filter of eighth order with 0.05 dB ripple up to 0.8 of the new Nyquist frequency,
/// as in the usual decimation.
const EVERY: usize = 10;

/// Rows at each end without a second central difference.
const ENDS: usize = 2;

/// The forces that resist the motion besides inertia. Each variant adds one to the variant before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Friction {
    /// Viscous friction only.
    Viscous,
    /// Also dry friction.
    Coulomb,
    /// Also a constant force.
    Offset,
    /// Different dry and viscous friction forward and backward. The constant is half the difference of the dry frictions.
    Asymmetric,
}

impl Friction {
    /// The regressors at an acceleration and a speed; the first is for the mass.
    #[must_use]
    pub fn row(self, acceleration: f64, speed: f64) -> Vec<f64> {
        // 0 at rest: without a direction there is no dry friction.
        let sign = if speed == 0.0 { 0.0 } else { speed.signum() };
        match self {
            Friction::Viscous => vec![acceleration, speed],
            Friction::Coulomb => vec![acceleration, speed, sign],
            Friction::Offset => vec![acceleration, speed, sign, 1.0],
            Friction::Asymmetric => {
                let (forward, backward) = (f64::from(speed > 0.0), f64::from(speed < 0.0));
                vec![acceleration, speed * forward, forward, speed * backward, -backward]
            }
        }
    }
}

/// Why a record has no inverse model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoMotion {
    /// The plant is no body that one input moves, or the record lacks the position or the command.
    NoBody,
    /// The record has fewer rows than the filters need.
    TooShort,
}

/// A measured motion at the sample rate of the record, without its ends.
#[derive(Debug, Clone)]
pub struct Motion {
    position: Vec<f64>,
    speed: Vec<f64>,
    acceleration: Vec<f64>,
    command: Vec<f64>,
    body: OneBody,
    /// The first rows of the record, without a controller.
    beginning: Record,
}

/// A regression of the force.
#[derive(Debug, Clone, PartialEq)]
pub struct Regression {
    /// Coefficients in the order of [`Friction::row`]: kg, N s/m and N.
    pub coefficients: Vec<f64>,
    /// The norm of the residual force divided by the norm of the force, after decimation.
    pub relative_error: f64,
}

impl Motion {
    /// The motion of a record.
    ///
    /// # Errors
    /// [`NoMotion`], if the record has no such motion.
    pub fn of(record: &Record, kind: PlantKind) -> Result<Motion, NoMotion> {
        let body = OneBody::of(kind).ok_or(NoMotion::NoBody)?;
        let position = record.measured.get(body.position).and_then(Option::as_ref);
        let (Some(position), Some(command)) = (position, body.command_of(record)) else { return Err(NoMotion::NoBody) };
        // After decimation there are ten rows for each of at most five coefficients: fifty rows.
        if position.len() < 50 * EVERY {
            return Err(NoMotion::TooShort);
        }
        let position = LowPass::butterworth(2, CUTOFF).both_ways(position);
        let difference =
            |values: &[f64]| -> Vec<f64> { values.windows(3).map(|w| (w[2] - w[0]) / (2.0 * record.period)).collect() };
        let speed = difference(&position);
        let acceleration = difference(&speed);
        let inner = ENDS..position.len() - ENDS;
        Ok(Motion {
            speed: speed[1..speed.len() - 1].to_vec(),
            acceleration,
            command: command[inner.clone()].to_vec(),
            position: position[inner].to_vec(),
            body,
            beginning: body.without_controller(record, kind),
        })
    }

    /// The regression of the force on mass and friction, by least squares.
    #[must_use]
    pub fn regression(&self, friction: Friction, force_gain: f64) -> Regression {
        let (columns, force) = (self.columns(friction), decimated(&self.force(force_gain)));
        let n = columns.len();
        let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let matrix: Vec<f64> = columns.iter().flat_map(|a| columns.iter().map(move |b| product(a, b))).collect();
        let right: Vec<f64> = columns.iter().map(|column| product(column, &force)).collect();
        let coefficients = Normal::new(&matrix, n, 0.0).solve(&right);
        let relative_error = self.relative_error(friction, &coefficients, force_gain);
        Regression { coefficients, relative_error }
    }

    /// The relative error of the force with given coefficients, for example from another record or a publication.
    #[must_use]
    pub fn relative_error(&self, friction: Friction, coefficients: &[f64], force_gain: f64) -> f64 {
        let mut left = decimated(&self.force(force_gain));
        let whole = length(&left);
        for (column, coefficient) in self.columns(friction).iter().zip(coefficients) {
            left.iter_mut().zip(column).for_each(|(left, value)| *left -= coefficient * value);
        }
        length(&left) / whole
    }

    /// The relative error of the force that a plant file with its effects needs. `None` for a plant or effects with further states (a current, a
    /// second body, a lag): their force does not follow from the motion at one instant.
    #[must_use]
    pub fn relative_error_of(&self, file: &PlantFile) -> Option<f64> {
        let linear = self.body.linear(file, &self.beginning)?;
        let bare = PlantFile { columns: Vec::new(), ..file.along(&self.beginning).into_owned() };
        let (mut rates, speed) = self.body.rates(&bare, &self.beginning)?;
        let mut left = Vec::with_capacity(self.speed.len());
        for k in 0..self.speed.len() {
            let mut states = [self.position[k]; 2];
            states[speed] = self.speed[k];
            let acceleration = rates.at(0.0, &states, &[self.command[k]])[speed];
            left.push(linear.inertia * (acceleration - self.acceleration[k]));
        }
        Some(length(&decimated(&left)) / length(&decimated(&self.force(linear.force_gain))))
    }

    fn force(&self, force_gain: f64) -> Vec<f64> {
        self.command.iter().map(|command| force_gain * command).collect()
    }

    /// The regressors, decimated like the force: both sides of the equation are filtered alike.
    fn columns(&self, friction: Friction) -> Vec<Vec<f64>> {
        let rows: Vec<Vec<f64>> = self.acceleration.iter().zip(&self.speed).map(|(a, v)| friction.row(*a, *v)).collect();
        let width = rows.first().map_or(0, Vec::len);
        (0..width).map(|k| decimated(&rows.iter().map(|row| row[k]).collect::<Vec<f64>>())).collect()
    }
}

fn decimated(values: &[f64]) -> Vec<f64> {
    LowPass::chebyshev(4, 0.05, 0.8 / EVERY as f64).both_ways(values).into_iter().step_by(EVERY).collect()
}

fn length(values: &[f64]) -> f64 {
    values.iter().map(|value| value * value).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rsm_core::source::Source;

    /// 2 kg, 4 N/V, driven so that q = 0.1 sin(w t)^4, w = pi/2 rad/s: u = (2 q'' + 3 q' + 5 sgn q' - 1)/4, exactly. It begins and ends at rest,
    /// without acceleration: whatever continues an end continues this one.
    fn motion(file: &PlantFile, sign: fn(f64) -> f64) -> Motion {
        let mut text = "time[s],command[V],position[m]\n".to_string();
        for k in 0..4000 {
            let t = f64::from(k) / 1000.0;
            let w = std::f64::consts::FRAC_PI_2;
            let (sin, cos) = (w * t).sin_cos();
            let (q, v) = (0.1 * sin.powi(4), 0.4 * w * sin.powi(3) * cos);
            let a = w * w * (1.2 * sin * sin * cos * cos - 0.4 * sin.powi(4));
            let force = 2.0 * a + 3.0 * v + 5.0 * sign(v) - 1.0;
            text += &format!("{t},{},{q}\n", force / 4.0);
        }
        Motion::of(&Record::read(&Source::new("r.csv", text), file).unwrap(), file.kind).unwrap()
    }

    fn axis(more: &str) -> PlantFile {
        let text = format!(
            "format = 1\nplant = \"servo-axis\"\n[parameters]\nmass = 2.0\nforce_gain = 4.0\nviscous_friction = 3.0\ncommand_limit = 10.0\n{more}"
        );
        PlantFile::read(&Source::new("axis.toml", text)).unwrap()
    }

    #[test]
    fn a_known_motion_gives_back_its_mass_and_friction() {
        // At rest, where the sine's fourth power begins, there is no dry friction.
        let motion = motion(&axis(""), |v| if v == 0.0 { 0.0 } else { v.signum() });
        let found = motion.regression(Friction::Offset, 4.0);
        // The filter moves what is left of the reversals by a row or two of four thousand.
        for (found, expected) in found.coefficients.iter().zip([2.0, 3.0, 5.0, -1.0]) {
            assert!((found - expected).abs() < 0.01 * expected.abs(), "{found} {expected}");
        }
        let both = motion.regression(Friction::Asymmetric, 4.0).coefficients;
        // Forward 5 - 1, backward 5 + 1. Viscous and dry friction of one direction have half the rows, and more in common: three times as far off.
        for (found, expected) in both.iter().zip([2.0, 3.0, 4.0, 3.0, 6.0]) {
            assert!((found - expected).abs() < 0.03 * expected, "{found} {expected}");
        }
        let steps =
            [Friction::Viscous, Friction::Coulomb, Friction::Offset].map(|it| motion.regression(it, 4.0).relative_error);
        assert!(steps[0] > steps[1] && steps[1] > 10.0 * steps[2], "{steps:?}");
    }

    #[test]
    fn a_plant_file_is_judged_by_the_force_that_it_asks_for() {
        let motion = motion(&axis(""), |v| (v / rsm_sim::effect::AXIS_SIGN_WIDTH).tanh());
        let friction = "[[effects]]\nkind = \"coulomb-friction\"\nparameters = { force = 5.0 }\n";
        let load = "[[effects]]\nkind = \"constant-load\"\nparameters = { force = -1.0 }\n";
        let error = |more: &str| motion.relative_error_of(&axis(more)).unwrap();
        // The filters move the corners of the dry force alone.
        assert!(error(&format!("{friction}{load}")) < 0.01, "{}", error(&format!("{friction}{load}")));
        assert!(error(friction) > 0.1 && error("") > 0.5);
        let lag =
            "[[effects]]\nkind = \"shaft-compliance\"\nparameters = { inertia_ratio = 0.5, stiffness = 1e5, damping = 10.0 }\n";
        assert_eq!(motion.relative_error_of(&axis(lag)), None);
    }
}

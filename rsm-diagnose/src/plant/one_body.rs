//! A body that one input moves: its linear equation, and that of its controller.
//!
//! In: a kind of plant; a plant file with a record. Out: which signals are position and command, and the coefficients of
//! `inertia dv/dt = force_gain command - damping v` without effects. `None` for every other plant, such as one with a current or a second body.

use rsm_sim::equation_plant::{Rates, SiteKind, bodies, site_signals};
use rsm_sim::kind::PlantKind;
use rsm_sim::plant_file::{PlantFile, VelocityFrom};
use rsm_sim::record::{Drive, Record};
use rsm_sim::simulate::Simulator;

/// The signals of such a plant.
#[derive(Debug, Clone, Copy)]
pub struct OneBody {
    /// The name of the site.
    pub at: &'static str,
    /// The kind of the site.
    pub kind: SiteKind,
    /// The output that is the position.
    pub position: usize,
    /// The state that is the speed.
    speed: &'static str,
    /// The output that is the command, if the plant has a controller.
    pub command: Option<usize>,
}

/// A linear position controller: `command = speed_gain (position_gain (reference - position) - speed)`.
#[derive(Debug, Clone, Copy)]
pub struct Controller {
    /// In 1/s.
    pub position_gain: f64,
    /// In command per unit of speed.
    pub speed_gain: f64,
    /// Whether the speed is a difference of positions.
    pub is_difference: bool,
    /// The largest command that it gives in the record.
    pub limit: f64,
}

/// The linear equation of the body.
#[derive(Debug, Clone, Copy)]
pub struct Linear {
    /// The inertia or the mass.
    pub inertia: f64,
    /// The viscous friction.
    pub damping: f64,
    /// The force or torque by a command of 1.
    pub force_gain: f64,
    /// The controller, if it acts in the record.
    pub controller: Option<Controller>,
}

impl OneBody {
    /// The body of a plant whose only states are its position, which is read, and its speed.
    #[must_use]
    pub fn of(kind: PlantKind) -> Option<OneBody> {
        let open = kind.driven_by(Drive::Open);
        let [input] = open.inputs() else { return None };
        let body = bodies(kind).into_iter().find(|it| matches!(it.kind, SiteKind::Rotation | SiteKind::Translation))?;
        let (position, speed) = (kind.output(body.position?)?, body.speed?);
        let is_free = |name: &str| open.starts().iter().any(|it| it.name == name);
        (open.starts().len() == 2 && is_free(speed) && is_free(body.position?)).then_some(())?;
        Some(OneBody { at: body.at, kind: body.kind, position, speed, command: kind.output(input.name) })
    }

    /// The recorded command.
    #[must_use]
    pub fn command_of(self, record: &Record) -> Option<&Vec<f64>> {
        match record.drive {
            Drive::Closed => record.measured.get(self.command?)?.as_ref(),
            _ => record.inputs.first(),
        }
    }

    /// The first rows of a record as one of the plant without its controller.
    #[must_use]
    pub fn without_controller(self, record: &Record, kind: PlantKind) -> Record {
        let mut first = record.piece(0..2);
        if record.drive == Drive::Closed {
            let rows = first.rows();
            let command = self.command_of(&first).cloned().unwrap_or_else(|| vec![0.0; rows]);
            (first.drive, first.inputs) = (Drive::Open, vec![command]);
            let outputs = kind.driven_by(Drive::Open).outputs();
            for (values, signal) in first.measured.iter_mut().zip(kind.outputs()) {
                if !outputs.iter().any(|it| it.name == signal.name) {
                    *values = None;
                }
            }
        }
        first
    }

    /// Rates of a plant at given states along a record without a controller, and the index of the speed among the states. `None` if effects add
    /// states or delays.
    #[must_use]
    pub fn rates(self, file: &PlantFile, without_controller: &Record) -> Option<(Rates, usize)> {
        let rates = Rates::new(file, without_controller).ok().filter(|it| it.states().len() == 2 && !it.is_late)?;
        let speed = rates.states().iter().position(|it| it == self.speed)?;
        Some((rates, speed))
    }

    /// The linear equation along a record. The effects of the file do not act.
    #[must_use]
    pub fn linear(self, file: &PlantFile, record: &Record) -> Option<Linear> {
        let own = file.along(record).into_owned();
        let bare = PlantFile { effects: Vec::new(), initial: Vec::new(), columns: Vec::new(), ..own };
        let first = self.without_controller(record, file.kind);
        let signals = site_signals(&bare, &first)?;
        let inertia = signals.iter().find(|it| it.at == self.at && it.role == "inertia")?;
        let inertia = *inertia.parts.first()?.first()?;
        let (mut rates, speed) = self.rates(&bare, &first)?;
        // The equation is linear, so a difference over any distance is a derivative.
        let start = rates.start().to_vec();
        let mut faster = start.clone();
        faster[speed] += 1.0;
        let mut at = |states: &[f64], command: f64| rates.at(first.first_time(), states, &[command])[speed];
        let here = at(&start, 0.0);
        let (by_command, by_speed) = (at(&start, 1.0) - here, at(&faster, 0.0) - here);
        let controller = if record.drive == Drive::Closed { Some(self.controller(&bare, record)?) } else { None };
        Some(Linear { inertia, damping: -inertia * by_speed, force_gain: inertia * by_command, controller })
    }

    /// The gains of the controller, from the commands at a start that is a little away from the reference.
    fn controller(self, bare: &PlantFile, record: &Record) -> Option<Controller> {
        // Small, so that no command reaches its limit; the equations are linear there.
        const AWAY: f64 = 1e-6;
        let position = bare.kind.outputs()[self.position].name;
        let mut first = record.piece(0..2);
        first.inputs = vec![vec![0.0; first.rows()]];
        (first.starts, first.measured[self.position]) = (Vec::new(), Some(vec![0.0; first.rows()]));
        let command = |at: f64, speed: f64| {
            let file = PlantFile { initial: vec![(position, at), (self.speed, speed)], ..bare.clone() };
            let outputs = Simulator::new(&file, &first).ok()?.run(&first).ok()?;
            outputs.of(bare.kind.outputs()[self.command?].name)?.first().copied()
        };
        let here = command(0.0, 0.0)?;
        let [by_position, by_speed] = [command(AWAY, 0.0)? - here, command(0.0, AWAY)? - here].map(|change| -change / AWAY);
        let limit = bare.parameters.optional("command_limit").unwrap_or(f64::INFINITY);
        let is_difference = bare.parameters.velocity_from == VelocityFrom::Difference;
        Some(Controller { position_gain: by_position / by_speed, speed_gain: by_speed, is_difference, limit })
            .filter(|it| it.position_gain.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use rsm_core::source::Source;
    use rsm_sim::equation_plant::pmac;

    use super::*;

    const AXIS: &str = "format = 1\nplant = \"servo-axis\"\n[parameters]\nmass = 2\nforce_gain = 4\nviscous_friction = 3\ncommand_limit = 10\n";

    #[test]
    fn an_axis_is_one_body_with_its_numbers_and_its_controller() {
        for gains in ["", "position_gain = 20\nvelocity_gain = 25\n"] {
            let file = PlantFile::read(&Source::new("axis.toml", format!("{AXIS}{gains}"))).unwrap();
            let input = if gains.is_empty() { "command[V],position[m]" } else { "reference[m],position[m],command[V]" };
            let rows = if gains.is_empty() { "0,1,0.1\n0.001,1,0.1\n" } else { "0,0.2,0.1,3\n0.001,0.2,0.1,3\n" };
            let record = Record::read(&Source::new("r.csv", format!("time[s],{input}\n{rows}")), &file).unwrap();
            let found = OneBody::of(file.kind).unwrap().linear(&file, &record).unwrap();
            // Differences of numbers near 1 have 15 digits, those over 1e-6 have 9.
            let near = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-8;
            assert!(near(found.inertia, 2.0) && near(found.damping, 3.0) && near(found.force_gain, 4.0), "{found:?}");
            assert_eq!(found.controller.is_some(), !gains.is_empty());
            if let Some(it) = found.controller {
                assert!(near(it.position_gain, 20.0) && near(it.speed_gain, 25.0) && it.limit == 10.0, "{it:?}");
            }
        }
    }

    #[test]
    fn a_motor_with_currents_is_not_one_body() {
        assert!(OneBody::of(pmac()).is_none());
    }
}

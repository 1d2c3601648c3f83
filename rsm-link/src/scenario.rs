//! The scenario of a co-simulation: roles, processes and hosts.
//!
//! In: TOML. Out: a [`Scenario`] in which both sides of every loop take part, each role once, or faults with line and column. No process is started
//! here: [`Scenario::commands`] gives the commands.
//!
//! ```
//! use rsm_core::source::Source;
//! use rsm_link::scenario::Scenario;
//!
//! let text = r#"
//! format = 1
//! scenario = "motor"
//! seconds = 0.5
//! broker = "127.0.0.1:23500"
//! processes.plant.roles = ["motor"]
//! processes.control.roles = ["controller", "recorder"]
//! "#;
//! let scenario = Scenario::read(&Source::new("motor.toml", text)).unwrap();
//! assert_eq!(scenario.federates(), 3);
//! assert_eq!(scenario.commands("records")[0].arguments[..2], ["federate", "broker"]);
//! ```

use rsm_core::source::{Collector, Faults, Source};
use rsm_core::toml_reader::{self, TableReader};

use crate::helics::{Address, Core};
use crate::loops::{Loop, Role, Run};

/// A day in s: the rows, one for each millisecond, are kept in memory.
const LONGEST_S: f64 = 86_400.0;

/// The limit of `rsm federate --load-inertia`: 1000 kg at a radius of 1 m.
const LARGEST_INERTIA: f64 = 1000.0;

/// A process of a co-simulation.
#[derive(Debug, Clone, PartialEq)]
pub struct Process {
    /// Its name.
    pub name: String,
    /// The roles that run in it.
    pub roles: Vec<Role>,
    /// The host on which it runs, if the file states it.
    pub host: Option<String>,
}

/// A co-simulation.
#[derive(Debug, Clone, PartialEq)]
pub struct Scenario {
    /// Its name.
    pub name: String,
    /// Duration and load of the run.
    pub run: Run,
    /// The transport between the processes.
    pub core: Core,
    /// The address at which the broker listens.
    pub broker: Address,
    /// The host on which the broker runs, if the file states it.
    pub broker_host: Option<String>,
    /// The processes, in the order of the file.
    pub processes: Vec<Process>,
}

/// A command to start a process: the arguments after `rsm`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Start {
    /// The name of the process; the broker is `broker`.
    pub process: String,
    /// The host, if the file states it.
    pub host: Option<String>,
    /// The arguments.
    pub arguments: Vec<String>,
}

impl Scenario {
    /// Reads a file.
    ///
    /// # Errors
    /// All faults with their places.
    pub fn read(source: &Source) -> Result<Self, Faults> {
        let mut faults = Collector::new();
        let document = toml_reader::parse(source, &mut faults);
        let scenario = document.and_then(|document| {
            let mut top = TableReader::document(source, &document);
            let scenario = read(&mut top, &mut faults);
            top.finish(&mut faults);
            scenario
        });
        faults.finish(scenario)
    }

    /// The number of federates: one for each role.
    #[must_use]
    pub fn federates(&self) -> usize {
        self.roles().count()
    }

    /// All roles.
    pub fn roles(&self) -> impl Iterator<Item = Role> {
        self.processes.iter().flat_map(|process| process.roles.iter().copied())
    }

    /// The loops that are run.
    pub fn loops(&self) -> impl Iterator<Item = Loop> {
        Loop::ALL.into_iter().filter(|it| self.roles().any(|role| role == Role::Plant(*it)))
    }

    /// The hosts of the file, each once, that of the broker first.
    #[must_use]
    pub fn hosts(&self) -> Vec<&str> {
        let mut hosts: Vec<&str> = Vec::new();
        for host in self.broker_host.iter().chain(self.processes.iter().filter_map(|process| process.host.as_ref())) {
            if !hosts.contains(&host.as_str()) {
                hosts.push(host);
            }
        }
        hosts
    }

    /// The commands to start the processes, the broker first. Records are written to the folder `out`.
    #[must_use]
    pub fn commands(&self, out: &str) -> Vec<Start> {
        let common = ["--broker".to_string(), self.broker.to_string(), "--core".to_string(), self.core.name().to_string()];
        let broker = ["federate", "broker"].map(String::from).into_iter().chain(common.clone());
        let broker = broker.chain(["--federates".to_string(), self.federates().to_string()]);
        let mut starts = vec![Start { process: "broker".into(), host: self.broker_host.clone(), arguments: broker.collect() }];
        for process in &self.processes {
            let mut arguments = vec!["federate".to_string()];
            arguments.extend(process.roles.iter().map(|role| role.name().to_string()));
            arguments.extend(common.clone());
            // The shortest decimals that read back to the same bits.
            arguments.extend(["--seconds".to_string(), (self.run.ticks as f64 * 1e-3).to_string()]);
            if self.run.load_inertia > 0.0 {
                arguments.extend(["--load-inertia".to_string(), self.run.load_inertia.to_string()]);
            }
            if let Some(Role::Recorder(it)) = process.roles.iter().find(|role| matches!(role, Role::Recorder(_))) {
                arguments.extend(["--loop".to_string(), it.name().to_string()]);
            }
            arguments.extend(["--out".to_string(), out.to_string()]);
            starts.push(Start { process: process.name.clone(), host: process.host.clone(), arguments });
        }
        starts
    }
}

fn read(top: &mut TableReader<'_>, faults: &mut Collector) -> Option<Scenario> {
    if let Some(value) = top.required("format", faults) {
        top.whole("`format`", value, 1, 1, faults);
    }
    let name = top.text("scenario", faults);
    let seconds = top.required("seconds", faults).and_then(|value| {
        let found = top.number("`seconds`", value, faults)?;
        if !(0.001..=LONGEST_S).contains(&found) {
            faults.push(top.fault(value.span(), format!("`seconds`: found {found}, expected 0.001 to {LONGEST_S}")));
        }
        Some(found)
    });
    let load_inertia = top.optional("load_inertia").map_or(Some(0.0), |value| {
        let found = top.number("`load_inertia`", value, faults)?;
        if !(0.0..=LARGEST_INERTIA).contains(&found) {
            let what = format!("`load_inertia`: found {found} kg m^2, expected 0 to {LARGEST_INERTIA}");
            faults.push(top.fault(value.span(), what));
        }
        Some(found)
    });
    let core = match top.optional("core") {
        Some(_) => top.choice("core", &Core::ALL, faults),
        None => Some(Core::default()),
    };
    let broker = top.required("broker", faults).and_then(|value| {
        let address = top.text("broker", faults)?;
        Address::parse(&address).map_err(|what| faults.push(top.fault(value.span(), format!("`broker`: {what}")))).ok()
    });
    let broker_host = top.optional_text("broker_host", faults);
    let value = top.required("processes", faults)?;
    let processes = read_processes(top, value, faults)?;
    let ticks = (seconds? * 1000.0).round() as u64;
    let broker_host = broker_host.or_else(|| processes.iter().find_map(|process| process.host.clone()));
    Some(Scenario {
        name: name?,
        run: Run { ticks, load_inertia: load_inertia? },
        core: core?,
        broker: broker?,
        broker_host,
        processes,
    })
}

fn read_processes(top: &TableReader<'_>, value: toml_reader::Value<'_>, faults: &mut Collector) -> Option<Vec<Process>> {
    let table = TableReader::of(top.source(), value, "`processes`", faults)?;
    let mut processes: Vec<Process> = Vec::new();
    let mut taken: Vec<String> = vec!["broker".to_string()];
    for (name, span, value) in table.entries() {
        let who = format!("process `{name}`");
        let Some(mut reader) = TableReader::of(top.source(), value, who.clone(), faults) else { continue };
        if name == "broker" {
            faults.push(top.fault(
                span,
                "found a process `broker`; the broker starts automatically, outside this list: give the process another name",
            ));
        }
        let host = reader.optional_text("host", faults);
        let listened = reader.choice("loop", &Loop::ALL.map(|it| (it.name(), it)), faults).unwrap_or(Loop::Motor);
        let names = reader.required("roles", faults).and_then(|value| reader.texts("`roles`", value, faults));
        let mut roles = Vec::new();
        for (name, span) in names.into_iter().flatten() {
            let Some(role) = Role::of(&name, listened) else {
                let what = format!("`roles`: found \"{name}\", expected motor, controller, driveline, throttle or recorder");
                faults.push(reader.fault(span, what));
                continue;
            };
            let unique = role.unique_name();
            if taken.contains(&unique) {
                let what = format!("`roles`: found \"{unique}\" twice, expected each role once in all processes");
                let help = "a recorder records the `loop` of its process; write a process for each loop";
                faults.push(reader.fault(span, what).help(help));
            }
            taken.push(unique);
            roles.push(role);
        }
        if roles.is_empty() && faults.is_clean() {
            faults.push(reader.fault(reader.span(), "`roles`: found none, expected at least one"));
        }
        reader.finish(faults);
        processes.push(Process { name: name.to_string(), roles, host });
    }
    let has = |role: Role| processes.iter().any(|process| process.roles.contains(&role));
    for control_loop in Loop::ALL {
        let (plant, step, recorder) = (Role::Plant(control_loop), Role::Step(control_loop), Role::Recorder(control_loop));
        let some = has(plant) || has(step) || has(recorder);
        for missing in [plant, step].into_iter().filter(|role| some && !has(*role)) {
            let what = format!(
                "`processes`: no process has the role \"{}\"; the loop of the {} needs it",
                missing.name(),
                control_loop.name()
            );
            faults.push(top.fault(top.key_span("processes"), what));
        }
    }
    if processes.is_empty() {
        faults.push(top.fault(top.key_span("processes"), "`processes`: found none, expected at least one"));
    }
    Some(processes)
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = r#"format = 1
scenario = "both"
seconds = 0.25
load_inertia = 0.05
core = "zmq"
broker = "10.0.0.1:23500"
broker_host = "left"

[processes.plants]
roles = ["motor", "driveline"]
host = "left"

[processes.steps]
roles = ["throttle", "controller"]
host = "right"

[processes.listener]
roles = ["recorder"]
loop = "throttle"
host = "right"
"#;

    fn refused(text: &str) -> String {
        Scenario::read(&Source::new("s.toml", text)).unwrap_err().to_string()
    }

    #[test]
    fn a_scenario_contains_the_commands_for_each_host() {
        let scenario = Scenario::read(&Source::new("s.toml", GOOD)).unwrap();
        assert_eq!(scenario.run, Run { ticks: 250, load_inertia: 0.05 });
        assert_eq!((scenario.federates(), scenario.loops().count()), (5, 2));
        assert_eq!(scenario.hosts(), ["left", "right"]);
        let starts = scenario.commands("here");
        let lines: Vec<String> =
            starts.iter().map(|it| format!("{}: {}", it.host.as_deref().unwrap(), it.arguments.join(" "))).collect();
        let common = "--broker 10.0.0.1:23500 --core zmq";
        let run = "--seconds 0.25 --load-inertia 0.05";
        assert_eq!(
            lines,
            [
                format!("left: federate broker {common} --federates 5"),
                format!("left: federate motor driveline {common} {run} --out here"),
                format!("right: federate throttle controller {common} {run} --out here"),
                format!("right: federate recorder {common} {run} --loop throttle --out here"),
            ]
        );
    }

    #[test]
    fn what_cannot_run_is_refused_with_its_place() {
        let change = |from: &str, to: &str| refused(&GOOD.replace(from, to));
        assert_eq!(
            change("format = 1", "format = 2"),
            "s.toml:1:10: `format`: found the number 2, expected a whole number from 1 to 1"
        );
        assert!(change("0.25", "0").starts_with("s.toml:3:11: `seconds`: found 0, expected 0.001"), "{}", change("0.25", "0"));
        assert!(change("0.05", "-1").contains("s.toml:4:16: `load_inertia`: found -1 kg m^2"));
        assert!(change("\"zmq\"", "\"tcp\"").contains("expected one of \"tcp_ss\", \"zmq\", \"ipc\""));
        assert!(change("10.0.0.1:23500", "10.0.0.1").contains("s.toml:6:10: `broker`: found `10.0.0.1`, expected HOST:PORT"));
        assert!(change("\"throttle\", \"controller\"", "\"throttle\"").contains("no process has the role \"controller\""));
        assert!(change("\"throttle\", \"controller\"", "\"throttle\", \"throttle\"").contains("expected each role once"));
        assert!(change("[\"recorder\"]", "[\"broker\"]").contains("found \"broker\", expected motor"));
        assert!(change("[\"recorder\"]", "[]").contains("`roles`: found none, expected at least one"));
        assert!(change("loop =", "of =").contains("unknown key `of`"));
        assert!(change("processes.plants", "processes.broker").contains("another name"));
        assert!(refused("format = 1\n").contains("`processes`"));
    }
}

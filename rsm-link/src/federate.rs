//! The sides of a loop in lock-step on HELICS.
//!
//! In: the library, the roles in this process, and the address of the broker. Out: a table and the figures of each role. Simulated time advances when
//! all roles have done their part of a millisecond:
//!
//! ```text
//!   k ms          plant: receives command k - 1, sends sample k, moves for a millisecond
//!   k ms + 0.50   step: receives sample k, sends command k
//!   k ms + 0.75   recorder: receives both
//! ```
//!
//! Every vector begins with the number of its tick. A wrong number is an error, so no wrong record is written. The library notices most lost
//! processes after 2 s. In all other cases a role ends when it has received nothing for the time [`Settings::silence`].

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use host_loop::Summary;

use crate::helics::{Address, Core, Federate, Library, Publication, Subscription};
use crate::loops::{self, Loop, Role, Run, Step, Table, WIDEST, time_of};
use crate::peers;

/// The time within a millisecond at which each role sends or receives, in s.
const STEP_AT: f64 = 0.0005;
const RECORDER_AT: f64 = 0.00075;

/// The settings of a process: transport, run and time limits.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// The address of the broker.
    pub broker: Address,
    /// The transport between the processes.
    pub core: Core,
    /// Duration and load of the run.
    pub run: Run,
    /// The longest time to wait for the broker and the other federates.
    pub wait: Duration,
    /// The longest time without a grant after the simulated time has begun.
    pub silence: Duration,
}

/// The result of a role.
#[derive(Debug, Clone, PartialEq)]
pub struct Done {
    /// The role.
    pub role: Role,
    /// Its complete rows; fewer than requested if the run ended early.
    pub table: Table,
    /// Times from a sample to its command; only for the plant's side.
    pub round_trip: Option<Summary>,
    /// Milliseconds of the loop per second.
    pub steps_per_second: f64,
    /// Number of bad samples; only for the step's side.
    pub bad_samples: Option<u32>,
    /// Whether the simulated time began.
    pub began: bool,
    /// The reason why the run ended early.
    pub lost: Option<String>,
}

/// The data that a worker and its watchdog share.
struct Shared {
    start: Instant,
    /// When the simulated time advanced last, in ns after the start, plus 1; 0 before the simulated time begins.
    moved: AtomicU64,
    /// True after the watchdog has ended the role: later results of the worker are ignored.
    over: AtomicBool,
    round_trips_ns: Mutex<Vec<u64>>,
    done: Mutex<Done>,
}

impl Shared {
    fn note_move(&self) {
        self.moved.store(self.start.elapsed().as_nanos() as u64 + 1, Ordering::Release);
    }

    fn with<T>(&self, change: impl FnOnce(&mut Done) -> T) -> T {
        change(&mut self.done.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// Runs roles until all have ended. Each role has its own thread and its own connection to the broker. `begins` is called when the simulated time of
/// the first role begins, if it does. If a role was lost, threads may still be blocked in the library. Then end the process by
/// [`crate::helics::exit_without_destructors`] after the tables are written.
#[must_use]
pub fn run(library: &'static Library, roles: &[Role], settings: &Settings, begins: impl FnOnce()) -> Vec<Done> {
    let watched: Vec<_> = roles.iter().map(|role| start(library, *role, settings)).collect();
    let mut begins = Some(begins);
    watched.into_iter().map(|(shared, worker)| watch(&shared, &worker, settings, &mut begins)).collect()
}

fn start(library: &'static Library, role: Role, settings: &Settings) -> (Arc<Shared>, std::thread::JoinHandle<()>) {
    let done = Done {
        role,
        table: role.table(),
        round_trip: None,
        steps_per_second: 0.0,
        bad_samples: None,
        began: false,
        lost: None,
    };
    let (start, moved, over) = (Instant::now(), AtomicU64::new(0), AtomicBool::new(false));
    let shared = Arc::new(Shared { start, moved, over, round_trips_ns: Mutex::default(), done: Mutex::new(done) });
    let (settings, worker_shared) = (settings.clone(), Arc::clone(&shared));
    let worker = std::thread::spawn(move || {
        let result = join(library, role, &settings).and_then(|(federate, ends)| {
            let result = take_part(&federate, role, &settings, &ends, &worker_shared);
            // Disconnect also after an error: otherwise all other roles wait for this one, and the broker waits until its heartbeats are missing.
            if let Err(message) = &result {
                worker_shared.with(|done| done.lost = Some(message.clone()));
                federate.fail(message);
            }
            federate.disconnect();
            result
        });
        if !worker_shared.over.load(Ordering::Acquire) {
            worker_shared.with(|done| done.lost = result.err());
        }
    });
    (shared, worker)
}

/// Waits for a worker as long as the simulated time advances.
fn watch<B: FnOnce()>(
    shared: &Shared,
    worker: &std::thread::JoinHandle<()>,
    settings: &Settings,
    begins: &mut Option<B>,
) -> Done {
    /// Time between two checks: a hundredth of the shortest useful `silence`.
    const CHECK_INTERVAL: Duration = Duration::from_millis(10);
    /// The longest time to wait for the end of a worker after an error. The state of the library is unknown then.
    const WORKER_END_TIMEOUT: Duration = Duration::from_millis(500);
    let mut failed: Option<Instant> = None;
    let lost = loop {
        if worker.is_finished() {
            break None;
        }
        if shared.with(|done| done.lost.is_some()) && failed.get_or_insert_with(Instant::now).elapsed() > WORKER_END_TIMEOUT {
            break None;
        }
        let now = shared.start.elapsed();
        let moved = shared.moved.load(Ordering::Acquire);
        if let Some(report) = begins.take_if(|_| moved > 0) {
            report();
        }
        if moved == 0 && now > settings.wait + settings.silence {
            break Some(format!(
                "the federation did not begin within {:.0} s: not all have joined",
                settings.wait.as_secs_f64()
            ));
        }
        if moved > 0 && now.saturating_sub(Duration::from_nanos(moved)) > settings.silence {
            let tick = shared.with(|done| done.table.rows());
            break Some(format!(
                "after tick {tick} the simulated time did not advance for {:.1} s: a peer or the broker at {} has ended or cannot be reached",
                settings.silence.as_secs_f64(),
                settings.broker
            ));
        }
        std::thread::sleep(CHECK_INTERVAL);
    };
    shared.over.store(true, Ordering::Release);
    let mut done = shared.with(|done| done.clone());
    if lost.is_some() {
        done.lost = lost;
    }
    let mut trips = shared.round_trips_ns.lock().unwrap_or_else(PoisonError::into_inner);
    done.round_trip = (!trips.is_empty()).then(|| Summary::of(&mut trips));
    done
}

/// Runs a broker until this many federates have ended, or until one of their processes has ended without notice by the library. `begins` is called
/// when all federates have joined. When this function returns, the library may still wait for a process: end this process by
/// [`crate::helics::exit_without_destructors`].
///
/// # Errors
/// The broker cannot listen; or some federates have not joined in time.
pub fn broker(library: &'static Library, federates: usize, settings: &Settings, begins: impl FnOnce()) -> Result<(), String> {
    let broker = library.broker(settings.core, &settings.broker, federates)?;
    let until = Instant::now() + settings.wait;
    let mut begins = Some(begins);
    let (mut processes, mut gone) = (Vec::new(), None::<Instant>);
    while !broker.ended_within(Duration::from_millis(200))? {
        if let Some(report) = begins.take_if(|_| broker.has_begun()) {
            report();
            // One query only: the library counts every query as activity, so that further queries would hide lost processes. Only with shared memory
            // is it certain that the processes are on this host.
            processes = if settings.core == Core::Ipc { broker.processes() } else { Vec::new() };
        }
        if processes.iter().any(|it| peers::is_gone(*it)) {
            let since = *gone.get_or_insert_with(Instant::now);
            if since.elapsed() > LIBRARY_TIMEOUT {
                return Ok(());
            }
        }
        if begins.is_some() && Instant::now() > until {
            broker.disconnect();
            return Err(format!("not all of {federates} federates have joined within {:.0} s", settings.wait.as_secs_f64()));
        }
    }
    Ok(())
}

/// The library notices most lost peers after 2 s. Half a second more lets it end by itself.
const LIBRARY_TIMEOUT: Duration = Duration::from_millis(2500);

/// The vectors that a role sends and receives.
struct Ends {
    published: Option<Publication>,
    subscribed: Vec<Subscription>,
}

fn sample_name(control_loop: Loop) -> String {
    format!("{}/sample", control_loop.name())
}

fn command_name(control_loop: Loop) -> String {
    format!("{}/command", control_loop.name())
}

fn join(library: &'static Library, role: Role, settings: &Settings) -> Result<(Federate, Ends), String> {
    let until = Instant::now() + settings.wait;
    if !library.has(settings.core) {
        return Err(format!(
            "{}: this build of HELICS has no core `{}`\n  help: use another core, or another build of HELICS",
            library.place.display(),
            settings.core.name()
        ));
    }
    if settings.core != Core::Ipc {
        await_port(&settings.broker, until)?;
    }
    let left = until.saturating_duration_since(Instant::now()).max(Duration::from_secs(1));
    let federate = library.federate(&role.unique_name(), settings.core, &settings.broker, left)?;
    let control_loop = role.of_loop();
    let (sample, command) = (sample_name(control_loop), command_name(control_loop));
    let ends = match role {
        Role::Plant(_) => {
            Ends { published: Some(federate.publication(&sample)?), subscribed: vec![federate.subscription(&command)?] }
        }
        Role::Step(_) => {
            Ends { published: Some(federate.publication(&command)?), subscribed: vec![federate.subscription(&sample)?] }
        }
        Role::Recorder(_) => {
            Ends { published: None, subscribed: vec![federate.subscription(&sample)?, federate.subscription(&command)?] }
        }
    };
    Ok((federate, ends))
}

/// Waits until something listens at the broker's address. The library can wait too, but it prints every refused connection on the terminal, and after
/// a request that comes a moment too early it waits 2 s.
fn await_port(broker: &Address, until: Instant) -> Result<(), String> {
    use std::net::{TcpStream, ToSocketAddrs as _};
    let mut why = String::from("this name has no address");
    loop {
        match (broker.host.as_str(), broker.port).to_socket_addrs() {
            Ok(addresses) => {
                for address in addresses {
                    match TcpStream::connect_timeout(&address, Duration::from_secs(1)) {
                        Ok(_) => return Ok(()),
                        Err(error) => why = error.to_string(),
                    }
                }
            }
            Err(error) => why = error.to_string(),
        }
        if Instant::now() > until {
            return Err(format!(
                "no broker at {broker}: {why}\n  help: start `rsm federate broker` there first, or wait longer with --wait"
            ));
        }
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// Sends a tick and its values.
fn publish_values(federate: &Federate, to: Publication, tick: u64, values: &[f64]) -> Result<(), String> {
    let mut vector = [0.0; WIDEST + 1];
    vector[0] = tick as f64;
    vector[1..=values.len()].copy_from_slice(values);
    federate.publish(to, &vector[..=values.len()])
}

/// Receives the values of a tick.
fn receive(federate: &Federate, from: Subscription, what: &str, tick: u64, values: &mut [f64]) -> Result<(), String> {
    let mut vector = [0.0; WIDEST + 1];
    let length = federate.read(from, &mut vector)?;
    if length != values.len() + 1 {
        return Err(format!("tick {tick}: no value of `{what}` arrived: its sender has ended, or is not in the federation"));
    }
    if vector[0] != tick as f64 {
        return Err(format!("tick {tick}: the last value of `{what}` is that of tick {}: its sender has ended", vector[0]));
    }
    values.copy_from_slice(&vector[1..length]);
    Ok(())
}

fn take_part(federate: &Federate, role: Role, settings: &Settings, ends: &Ends, shared: &Shared) -> Result<(), String> {
    federate.enter()?;
    shared.with(|done| done.began = true);
    shared.note_move();
    let began = Instant::now();
    let control_loop = role.of_loop();
    let result = match (role, ends.published) {
        (Role::Plant(_), Some(published)) => plant(federate, control_loop, settings.run, published, ends.subscribed[0], shared),
        (Role::Step(_), Some(published)) => {
            step(federate, control_loop, settings.run.ticks, published, ends.subscribed[0], shared)
        }
        _ => recorder(federate, control_loop, settings.run.ticks, &ends.subscribed, shared),
    };
    let seconds = began.elapsed().as_secs_f64();
    shared.with(|done| done.steps_per_second = done.table.rows() as f64 / seconds);
    result
}

fn plant(
    federate: &Federate,
    control_loop: Loop,
    run: Run,
    published: Publication,
    subscribed: Subscription,
    shared: &Shared,
) -> Result<(), String> {
    let name = command_name(control_loop);
    let mut tick = 0;
    let mut sent_at = Instant::now();
    let mut failed = None;
    let exchange = |sample: &[f64], command: &mut [f64]| {
        let mut one = || {
            if tick == 0 {
                command.copy_from_slice(control_loop.first_command());
            } else {
                federate.request_time(time_of(tick))?;
                let round_trip = sent_at.elapsed().as_nanos() as u64;
                shared.round_trips_ns.lock().unwrap_or_else(PoisonError::into_inner).push(round_trip);
                receive(federate, subscribed, &name, tick - 1, command)?;
            }
            shared.note_move();
            sent_at = Instant::now();
            publish_values(federate, published, tick, sample)?;
            tick += 1;
            Ok(())
        };
        failed = one().err();
        failed.is_none() && !shared.over.load(Ordering::Acquire)
    };
    loops::plant(control_loop, run, exchange, |row| shared.with(|done| done.table.push(row.iter().copied())));
    failed.map_or(Ok(()), Err)
}

fn step(
    federate: &Federate,
    control_loop: Loop,
    ticks: u64,
    published: Publication,
    subscribed: Subscription,
    shared: &Shared,
) -> Result<(), String> {
    let name = sample_name(control_loop);
    let mut step = Step::new(control_loop);
    let (mut sample, mut command) = (vec![0.0; control_loop.sample().len()], vec![0.0; control_loop.command().len()]);
    for tick in 0..ticks {
        federate.request_time(time_of(tick) + STEP_AT)?;
        receive(federate, subscribed, &name, tick, &mut sample)?;
        shared.note_move();
        step.answer(&sample, &mut command);
        publish_values(federate, published, tick, &command)?;
        shared.with(|done| {
            done.table.push([&[time_of(tick)], sample.as_slice(), &command].concat());
            done.bad_samples = Some(step.bad_samples());
        });
    }
    Ok(())
}

fn recorder(
    federate: &Federate,
    control_loop: Loop,
    ticks: u64,
    subscribed: &[Subscription],
    shared: &Shared,
) -> Result<(), String> {
    let names = [sample_name(control_loop), command_name(control_loop)];
    let (mut sample, mut command) = (vec![0.0; control_loop.sample().len()], vec![0.0; control_loop.command().len()]);
    for tick in 0..ticks {
        federate.request_time(time_of(tick) + RECORDER_AT)?;
        receive(federate, subscribed[0], &names[0], tick, &mut sample)?;
        receive(federate, subscribed[1], &names[1], tick, &mut command)?;
        shared.note_move();
        shared.with(|done| done.table.push([&[time_of(tick)], sample.as_slice(), &command].concat()));
    }
    Ok(())
}

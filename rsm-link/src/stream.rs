//! One side of a loop in real time, connected to the other side by UDP, for hardware in the loop.
//!
//! In: the side, its address and the address of the other side, a key, the length of the play-out buffer. Out: a table and counts. No side waits:
//! each tick uses the value that the buffer plays, and sends its own value. If a value is missing, the last one is held ([`Settings::hold`]); then
//! the safe state applies:
//!
//! - the motor's plant sets its torque reference to zero and keeps the weakening current, the car closes its throttle;
//! - a step gets an invalid sample, and treats it like a bad sample of a sensor.
//!
//! Both sides send hello datagrams until each has received one, so the order of start does not matter. After [`Settings::silence`] without a datagram
//! the peer counts as lost.

use std::net::{SocketAddr, ToSocketAddrs as _, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use host_loop::{Clock as _, Summary, SystemClock};
use rsm_sim::kind::Signal;

use crate::loops::{self, Loop, PERIOD_NS, Role, Run, Step, Table, WIDEST, time_of};
use crate::play_out::{Counts, PlayOut, Played};
use crate::wire::{Datagram, Key, Kind, LONGEST, Rejected, Side, model_hash};

/// The settings of a side.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The loop, and the side that runs here.
    pub side: (Loop, Side),
    /// The address at which this side listens: ADDRESS:PORT.
    pub listen: String,
    /// The address at which the other side listens: HOST:PORT.
    pub peer: String,
    /// The secret key of both sides.
    pub key: Key,
    /// Duration and load of the run.
    pub run: Run,
    /// The length of the play-out buffer.
    pub buffer: Duration,
    /// The time for which the last value is held.
    pub hold: Duration,
    /// After this time without a datagram the peer counts as lost.
    pub silence: Duration,
    /// The longest time to wait for the peer at the start.
    pub wait: Duration,
}

/// Counts of datagrams that were received and ignored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RejectedCounts {
    /// With a wrong authentication code, from the wrong side, or of another run.
    pub foreign: u64,
    /// With the right key, but of another model.
    pub other_model: u64,
}

/// The result of a side.
#[derive(Debug, Clone, PartialEq)]
pub struct Done {
    /// The rows: the columns of the role, then the number that was played and its code (0 waiting, 1 fresh, 2 held, 3 safe).
    pub table: Table,
    /// Datagrams with a sample or a command that were sent.
    pub sent: u64,
    /// Datagrams that the operating system did not accept.
    pub not_sent: u64,
    /// The counts of the buffer.
    pub counts: Counts,
    /// Datagrams that were ignored.
    pub rejected: RejectedCounts,
    /// Round trip times, without the time at the peer.
    pub round_trip: Option<Summary>,
    /// How late the ticks began by the clock.
    pub lateness: Summary,
    /// Ticks that began after the end of their period. They are still computed, one after another.
    pub late_ticks: u64,
    /// Ticks that ended after the end of their period.
    pub deadlines_missed: u64,
    /// The delay of the last tick's beginning, in ns: at the end this side is behind the clock by this time.
    pub skew_ns: u64,
    /// Whether any datagram of the peer arrived.
    pub began: bool,
    /// The reason why the run ended early.
    pub lost: Option<String>,
}

/// The data that the two threads share.
struct Received {
    buffer: PlayOut,
    /// The session of the peer; 0 before its first datagram.
    peer: u64,
    /// The peer has received a datagram of this session.
    session_received: bool,
    ended: bool,
    last_ns: u64,
    /// The peer's time in its last datagram, and the time at which it was received.
    echo: (u64, u64),
    rejected: RejectedCounts,
    round_trips_ns: Vec<u64>,
}

fn locked(received: &Mutex<Received>) -> MutexGuard<'_, Received> {
    received.lock().unwrap_or_else(PoisonError::into_inner)
}

fn now_ns() -> u64 {
    SystemClock.now_ns()
}

/// A random number, never 0, that cannot be guessed: the standard library takes the keys of its hash function from the random numbers of the system.
fn session() -> u64 {
    use std::hash::{BuildHasher as _, RandomState};
    loop {
        let number = RandomState::new().hash_one(now_ns());
        if number != 0 {
            return number;
        }
    }
}

/// The data that do not change during a run.
struct Link<'a> {
    socket: UdpSocket,
    peer: SocketAddr,
    key: &'a Key,
    model: [u8; 16],
    side: Side,
    session: u64,
    start_ns: u64,
}

impl Link<'_> {
    /// Sends a datagram. Returns whether the operating system accepted it.
    fn send(&self, received: &Mutex<Received>, kind: Kind, number: u64, sent: &[f64]) -> bool {
        let (peer_session, (echo_ns, at_ns)) = {
            let received = locked(received);
            (received.peer, received.echo)
        };
        let mut values = [0.0; WIDEST];
        values[..sent.len()].copy_from_slice(sent);
        let now = now_ns();
        let datagram = Datagram {
            kind,
            side: self.side,
            session: self.session,
            peer_session,
            number,
            time_ns: now - self.start_ns,
            echo_ns,
            echo_age_ns: now - at_ns,
            count: sent.len(),
            values,
        };
        let (bytes, length) = datagram.write(&self.model, self.key);
        self.socket.send_to(&bytes[..length], self.peer).is_ok()
    }

    /// Receives until the run is over.
    fn listen(&self, received: &Mutex<Received>, is_over: &AtomicBool) {
        let other = if self.side == Side::Plant { Side::Step } else { Side::Plant };
        // The buffer has one byte more than the longest datagram, so that a longer datagram is noticed.
        let mut bytes = [0; LONGEST + 1];
        while !is_over.load(Ordering::Acquire) {
            // A timeout, or the peer does not listen yet: continue in both cases.
            let Ok((length, _)) = self.socket.recv_from(&mut bytes) else { continue };
            let now = now_ns();
            let read = Datagram::read(&bytes[..length], other, &self.model, self.key);
            self.take(&mut locked(received), read, now);
        }
    }

    fn take(&self, received: &mut Received, read: Result<Datagram, Rejected>, now: u64) {
        let datagram = match read {
            Ok(datagram) => datagram,
            Err(Rejected::OtherModel) => {
                received.rejected.other_model += 1;
                return;
            }
            Err(_) => {
                received.rejected.foreign += 1;
                return;
            }
        };
        // Every sender with the key may send a hello at any time. The first one that contains this session is the peer.
        let answers = datagram.peer_session == self.session;
        let is_first = !received.session_received && (received.peer == 0 || datagram.kind == Kind::Hello || answers);
        if !(is_first || datagram.session == received.peer) || (datagram.kind != Kind::Hello && !answers) {
            received.rejected.foreign += 1;
            return;
        }
        received.peer = datagram.session;
        received.session_received |= answers;
        received.last_ns = now;
        received.echo = (datagram.time_ns, now);
        if answers && datagram.echo_ns > 0 {
            let age = datagram.echo_ns.saturating_add(datagram.echo_age_ns);
            received.round_trips_ns.push((now - self.start_ns).saturating_sub(age));
        }
        match datagram.kind {
            Kind::Hello => {}
            Kind::Data => received.buffer.receive(datagram.number, now, datagram.values),
            Kind::End => received.ended = true,
        }
    }
}

/// Time between two hello datagrams.
const HELLO_INTERVAL: Duration = Duration::from_millis(5);

/// The end of the run is sent this many times, because each datagram may be lost.
const END_DATAGRAMS: u32 = 5;

/// Runs a side.
///
/// # Errors
/// An invalid address, or one on which the socket cannot listen.
pub fn run(settings: &Settings) -> Result<Done, String> {
    let (control_loop, side) = settings.side;
    let peer = settings.peer.to_socket_addrs().map_err(|error| format!("--peer {}: {error}", settings.peer))?.next();
    let peer = peer.ok_or_else(|| format!("--peer {}: this name has no address", settings.peer))?;
    let socket = UdpSocket::bind(&settings.listen).map_err(|error| format!("--listen {}: {error}", settings.listen))?;
    socket
        .set_read_timeout(Some(Duration::from_millis(20)))
        .map_err(|error| format!("--listen {}: {error}", settings.listen))?;
    let (session, start_ns) = (session(), now_ns());
    let link = Link { socket, peer, key: &settings.key, model: model_hash(control_loop), side, session, start_ns };
    let ns = |time: Duration| u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
    let received = Mutex::new(Received {
        buffer: PlayOut::new(PERIOD_NS, ns(settings.buffer), ns(settings.hold)),
        peer: 0,
        session_received: false,
        ended: false,
        last_ns: start_ns,
        echo: (0, start_ns),
        rejected: RejectedCounts::default(),
        round_trips_ns: Vec::with_capacity(usize::try_from(settings.run.ticks).unwrap_or(0).min(1 << 20)),
    });
    let is_over = AtomicBool::new(false);
    let mut done = std::thread::scope(|scope| {
        scope.spawn(|| link.listen(&received, &is_over));
        let _ended = Ended(&is_over);
        let done = Ticks::new(&link, &received, settings).run();
        if done.began {
            for _ in 0..END_DATAGRAMS {
                link.send(&received, Kind::End, settings.run.ticks, &[]);
                std::thread::sleep(Duration::from_millis(1));
            }
        }
        done
    });
    let mut received = locked(&received);
    done.counts = received.buffer.counts();
    done.rejected = received.rejected;
    done.round_trip = (!received.round_trips_ns.is_empty()).then(|| Summary::of(&mut received.round_trips_ns));
    Ok(done)
}

/// Ends the listening thread, also after a panic.
struct Ended<'a>(&'a AtomicBool);

impl Drop for Ended<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Release);
    }
}

fn role(control_loop: Loop, side: Side) -> Role {
    if side == Side::Plant { Role::Plant(control_loop) } else { Role::Step(control_loop) }
}

fn empty_result(control_loop: Loop, side: Side) -> Done {
    let signal = |name| Signal { name, unit: "1" };
    Done {
        table: role(control_loop, side).table().with(&[signal("played_number"), signal("played_how")]),
        sent: 0,
        not_sent: 0,
        counts: Counts::default(),
        rejected: RejectedCounts::default(),
        round_trip: None,
        lateness: Summary::default(),
        late_ticks: 0,
        deadlines_missed: 0,
        skew_ns: 0,
        began: false,
        lost: None,
    }
}

/// Sends hello datagrams until each side has received one of the other.
fn connect(link: &Link<'_>, received: &Mutex<Received>, settings: &Settings) -> Result<(), String> {
    let wait = u64::try_from(settings.wait.as_nanos()).unwrap_or(u64::MAX);
    let from = now_ns();
    loop {
        link.send(received, Kind::Hello, 0, &[]);
        {
            let received = locked(received);
            if received.session_received {
                break;
            }
            if now_ns() - from > wait {
                let RejectedCounts { foreign, other_model } = received.rejected;
                let why = if other_model > 0 {
                    "it runs another model: compare the coefficients and versions of both sides".to_string()
                } else if foreign > 0 {
                    format!("received {foreign} datagrams that have another key or are not of `rsm stream`")
                } else {
                    "nothing was received".to_string()
                };
                return Err(format!(
                    "the peer at {} sent no valid datagram within {:.1} s: {why}",
                    link.peer,
                    settings.wait.as_secs_f64()
                ));
            }
        }
        std::thread::sleep(HELLO_INTERVAL);
    }
    // The peer may still wait for an answer. The datagrams of the ticks contain the answer too.
    link.send(received, Kind::Hello, 0, &[]);
    Ok(())
}

/// The ticks of a run in real time. The clock starts with the first tick: what a side prepares before it, such as a plant that is compiled from its
/// text, delays no tick.
struct Ticks<'a> {
    link: &'a Link<'a>,
    received: &'a Mutex<Received>,
    settings: &'a Settings,
    done: Done,
    first_ns: u64,
    tick: u64,
    lateness_ns: Vec<u64>,
}

impl<'a> Ticks<'a> {
    fn new(link: &'a Link<'a>, received: &'a Mutex<Received>, settings: &'a Settings) -> Self {
        let (control_loop, side) = settings.side;
        let lateness_ns = Vec::with_capacity(usize::try_from(settings.run.ticks).unwrap_or(0).min(1 << 24));
        Ticks { link, received, settings, done: empty_result(control_loop, side), first_ns: 0, tick: 0, lateness_ns }
    }

    fn run(mut self) -> Done {
        let (control_loop, side) = self.settings.side;
        match side {
            Side::Plant => self.plant(control_loop),
            Side::Step => self.step(control_loop),
        }
        self.end_of_tick();
        self.done.skew_ns = self.lateness_ns.last().copied().unwrap_or(0);
        self.done.lateness = Summary::of(&mut self.lateness_ns);
        self.done
    }

    /// Sleeps until the tick begins, and returns what the buffer plays for it; `None` if the peer is lost.
    fn begin(&mut self) -> Option<Played> {
        if !self.done.began {
            // This side is ready. The peer starts when it has received this, so both clocks start together.
            if let Err(message) = connect(self.link, self.received, self.settings) {
                self.done.lost = Some(message);
                return None;
            }
            self.done.began = true;
            self.first_ns = now_ns();
        }
        self.end_of_tick();
        let due = self.first_ns + self.tick * PERIOD_NS;
        SystemClock.sleep_until_ns(due);
        let now = now_ns();
        let late = now.saturating_sub(due);
        self.lateness_ns.push(late);
        self.done.late_ticks += u64::from(late > PERIOD_NS);
        let mut received = locked(self.received);
        let silent = now.saturating_sub(received.last_ns);
        if !received.ended && u128::from(silent) > self.settings.silence.as_nanos() {
            let seconds = self.settings.silence.as_secs_f64();
            self.done.lost = Some(format!("the peer at {} sent no valid datagram for {seconds:.1} s", self.link.peer));
            return None;
        }
        // A late tick is played for its scheduled time, so that catching up does not use up the buffer.
        let played = received.buffer.play(due);
        if received.ended && matches!(played, Played::Safe { .. }) {
            self.done.lost = Some(format!("the peer at {} has ended its run", self.link.peer));
            return None;
        }
        self.tick += 1;
        Some(played)
    }

    fn end_of_tick(&mut self) {
        if self.tick > 0 {
            self.done.deadlines_missed += u64::from(now_ns() > self.first_ns + self.tick * PERIOD_NS);
        }
    }

    fn send(&mut self, values: &[f64]) {
        let taken = self.link.send(self.received, Kind::Data, self.tick - 1, values);
        self.done.sent += u64::from(taken);
        self.done.not_sent += u64::from(!taken);
    }

    fn plant(&mut self, control_loop: Loop) {
        let run = self.settings.run;
        let (ticks, how) = (std::cell::RefCell::new(self), std::cell::Cell::new([f64::NAN, 0.0]));
        let exchange = |sample: &[f64], command: &mut [f64]| {
            let mut ticks = ticks.borrow_mut();
            let Some(played) = ticks.begin() else { return false };
            command.copy_from_slice(&command_of(control_loop, played)[..command.len()]);
            how.set([played.number(), played.code()]);
            ticks.send(sample);
            true
        };
        loops::plant(control_loop, run, exchange, |row| {
            ticks.borrow_mut().done.table.push(row.iter().copied().chain(how.get()));
        });
    }

    fn step(&mut self, control_loop: Loop) {
        let mut step = Step::new(control_loop);
        let mut command = vec![0.0; control_loop.command().len()];
        for tick in 0..self.settings.run.ticks {
            let Some(played) = self.begin() else { break };
            let sample = played.values().unwrap_or([f64::NAN; WIDEST]);
            step.answer(&sample, &mut command);
            let row = [time_of(tick)].into_iter().chain(sample).chain(command.iter().copied());
            self.done.table.push(row.chain([played.number(), played.code()]));
            self.send(&command);
        }
    }
}

/// The command that acts on the plant: the played one, or the safe state.
fn command_of(control_loop: Loop, played: Played) -> [f64; WIDEST] {
    let mut command = [0.0; WIDEST];
    match played {
        Played::Fresh { values, .. } | Played::Held { values, .. } => return values,
        // The torque is zero. The weakening current remains: without it a fast motor would charge the bus.
        Played::Safe { values, .. } if control_loop == Loop::Motor => command[0] = values[0],
        Played::Waiting | Played::Safe { .. } => {
            let first = control_loop.first_command();
            command[..first.len()].copy_from_slice(first);
        }
    }
    command
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_safe_state_has_no_torque_and_a_closed_throttle() {
        let values = [-12.0, 30.0, 0.0, 0.0];
        let safe = |control_loop, values| command_of(control_loop, Played::Safe { number: 9, values });
        assert_eq!(safe(Loop::Motor, values), [-12.0, 0.0, 0.0, 0.0]);
        assert_eq!(safe(Loop::Throttle, [900.0, 0.0, 0.0, 0.0])[..1], host_runners::throttle::CLOSED);
        assert_eq!(command_of(Loop::Motor, Played::Held { number: 9, values }), values);
        assert_eq!(command_of(Loop::Motor, Played::Waiting), [0.0; WIDEST]);
    }

    #[test]
    fn sessions_differ() {
        assert_ne!(session(), session());
    }
}

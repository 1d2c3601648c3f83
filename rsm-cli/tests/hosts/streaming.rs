//! Streaming with a clock: the delays that a buffer compensates, those that it does not, and the reactions to these.

use std::net::SocketAddr;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::namespaces::Hosts;
use crate::ports::port;
use crate::relay::{Fate, Relay};
use crate::skipped::skipped;
use crate::{seconds, with_a_clock};

const RSM: &str = env!("CARGO_BIN_EXE_rsm");

/// The buffer, in ms: three times the longest observed oversleep of a virtual machine.
const BUFFER_MS: f64 = 150.0;
const HOLD_MS: f64 = 100.0;

/// The two sides of a loop with a relay between them.
struct Stream {
    folder: tempfile::TempDir,
    plant: Child,
    step: Child,
    plant_listens: SocketAddr,
    relay: Relay,
}

fn side(mut command: Command, role: &str, listen: &SocketAddr, peer: &SocketAddr, seconds: f64, folder: &Path) -> Child {
    command.args(["stream", role, "--listen", &listen.to_string(), "--peer", &peer.to_string(), "--key", "link.key"]);
    command.args(["--seconds", &seconds.to_string(), "--out", "r", "--json", "--wait", "20"]).current_dir(folder);
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

impl Stream {
    /// On two hosts, or both sides on this one.
    fn start(hosts: Option<&Hosts>, roles: [&str; 2], seconds: f64, fate: Fate) -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("link.key"), "a secret of these tests alone\n").unwrap();
        let addresses = hosts.map_or(["127.0.0.1"; 2], |hosts| hosts.addresses);
        let at = |host: usize| SocketAddr::new(addresses[host].parse().unwrap(), port());
        // The relay runs on the plant's host, so everything crosses the link once.
        let (plant, step, relay) = (at(0), at(1), [at(0), at(0)]);
        let before = hosts.map(|hosts| hosts.enter(0));
        let enter = move || {
            if let Some(before) = before {
                before();
            }
        };
        let relay_thread = Relay::start(relay, [step, plant], enter, fate);
        let on = |host: usize| hosts.map_or_else(|| Command::new(RSM), |hosts| hosts.command(host, RSM));
        let plant_listens = plant;
        let step = side(on(1), roles[1], &step, &relay[1], seconds, folder.path());
        let plant = side(on(0), roles[0], &plant, &relay[0], seconds, folder.path());
        Stream { folder, plant, step, plant_listens, relay: relay_thread }
    }

    /// The reports of both sides, the plant first, and their exit statuses.
    fn end(self) -> Ended {
        let read = |output: Output| {
            let result = serde_json::from_slice(&output.stdout);
            let result = result.unwrap_or_else(|error| panic!("{error}: {}", String::from_utf8_lossy(&output.stderr)));
            (result, output.status.code())
        };
        let (plant, step) = (self.plant.wait_with_output().unwrap(), self.step.wait_with_output().unwrap());
        Ended { folder: self.folder, results: [read(plant), read(step)], stood_us: self.relay.stood_us() }
    }
}

struct Ended {
    folder: tempfile::TempDir,
    results: [(Value, Option<i32>); 2],
    stood_us: f64,
}

fn count(result: &Value, name: &str) -> u64 {
    result[name].as_u64().unwrap_or_else(|| panic!("{name}: {result}"))
}

impl Ended {
    /// Whether both sides and the relay together were late by half of the buffer, so that the run has no meaning. The other half is for the
    /// listening threads, which they cannot observe, and for the jitter of a case.
    fn is_late(&self) -> bool {
        self.sides_late_us() + self.stood_us > BUFFER_MS * 1e3 / 2.0
    }

    fn sides_late_us(&self) -> f64 {
        self.results.iter().map(|(result, _)| result["lateness_us"]["max"].as_f64().unwrap()).sum()
    }

    fn figures(&self, place: &str, what: &str) {
        for (result, _) in &self.results {
            let of = |name: &str| count(result, name);
            println!(
                "figures: stream, {place}, {what}, {}: {} ticks, {} sent, {} heard, {} under-runs ({} held, {} safe), {} lost, {} late, {} doubled, {} foreign, round trip p50 {:.0} us, p99 {:.0} us, ticks late by up to {:.1} ms",
                result["role"].as_str().unwrap(),
                of("ticks"),
                of("sent"),
                of("heard"),
                of("under_runs"),
                of("held"),
                of("safe"),
                of("lost"),
                of("late"),
                of("doubled"),
                of("foreign"),
                result["round_trip_us"]["p50"].as_f64().unwrap(),
                result["round_trip_us"]["p99"].as_f64().unwrap(),
                result["lateness_us"]["max"].as_f64().unwrap() * 1e-3
            );
        }
    }

    /// The columns of a record by name.
    fn record(&self, role: &str) -> Vec<(String, Vec<f64>)> {
        let text = std::fs::read_to_string(self.folder.path().join(format!("r/{role}.csv"))).unwrap();
        let mut lines = text.lines();
        let names = lines.next().unwrap().split(',').map(|name| name.split('[').next().unwrap().to_string());
        let mut columns: Vec<(String, Vec<f64>)> = names.map(|name| (name, Vec::new())).collect();
        for line in lines {
            let cells: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
            assert_eq!(cells.len(), columns.len(), "a row that is not whole");
            for ((_, values), cell) in columns.iter_mut().zip(cells) {
                values.push(cell);
            }
        }
        columns
    }
}

fn column<'a>(record: &'a [(String, Vec<f64>)], name: &str) -> &'a [f64] {
    &record.iter().find(|(it, _)| it == name).unwrap_or_else(|| panic!("no column {name}")).1
}

/// Runs a case on this host and, if two hosts are possible, on two at the same time. A run is repeated if the machine itself was inactive.
fn each(what: &str, roles: [&str; 2], fate: impl Fn() -> Fate + Sync, judge: impl Fn(&Ended, u64) + Sync) {
    let _clock = with_a_clock();
    let ticks = (seconds() * 1000.0).round() as u64;
    let hosts = Hosts::new(what);
    let on = |hosts: Option<&Hosts>| {
        let place = if hosts.is_some() { "two hosts at 100 Mbit/s" } else { "one host" };
        let mut late = vec![];
        let ended = loop {
            let ended = Stream::start(hosts, roles, seconds(), fate()).end();
            if !ended.is_late() {
                break ended;
            }
            late.push((ended.sides_late_us(), ended.stood_us));
            if late.len() == 3 {
                // The relay sleeps for fifths of a tick all the time. Where it was on time, the sides are late by themselves.
                assert!(late.iter().all(|(_, relay)| *relay > BUFFER_MS * 1e3 / 8.0), "late in us, sides and relay: {late:?}");
                skipped(&format!("this machine itself was late by half of the buffer, three times: {what}"));
                return;
            }
        };
        ended.figures(place, what);
        judge(&ended, ticks);
    };
    std::thread::scope(|scope| {
        if hosts.is_some() {
            scope.spawn(|| on(hosts.as_ref()));
        }
        on(None);
    });
}

/// Everything that was due has arrived, and both sides ended normally.
fn nothing_missing(ended: &Ended, ticks: u64) {
    for (result, status) in &ended.results {
        assert_eq!((count(result, "ticks"), count(result, "sent")), (ticks, ticks), "{result}");
        assert_eq!((count(result, "under_runs"), count(result, "lost"), count(result, "late")), (0, 0, 0), "{result}");
        // All values except those that are still in the buffer were played.
        assert!(count(result, "fresh") as f64 > ticks as f64 - 2.0 * BUFFER_MS, "{result}");
        assert_eq!(*status, Some(0), "{result}");
    }
}

#[test]
fn a_connection_without_loss_gives_every_tick_its_values() {
    each(
        "a wire that works",
        ["motor", "controller"],
        || Box::new(|_, _| vec![Duration::ZERO]),
        |ended, ticks| {
            nothing_missing(ended, ticks);
            // The played values have the bits of the sent values, in both directions.
            let (plant, step) = (ended.record("motor"), ended.record("controller"));
            for (name, from, to) in [("torque_demand", &plant, &step), ("i_q_wanted", &step, &plant)] {
                let (sent, played, numbers) = (column(from, name), column(to, name), column(to, "played_number"));
                let mut compared = 0;
                for (row, number) in numbers.iter().enumerate().filter(|(_, number)| number.is_finite()) {
                    assert_eq!(played[row].to_bits(), sent[*number as usize].to_bits(), "{name} in row {row}");
                    compared += 1;
                }
                assert!(compared as f64 > ticks as f64 - 2.0 * BUFFER_MS, "{name}: {compared} rows");
            }
        },
    );
}

#[test]
fn a_jitter_of_20_ms_is_not_noticed() {
    let fate = || -> Fate { Box::new(|draw, _| vec![Duration::from_secs_f64(0.02 * draw.share())]) };
    each("20 ms jitter", ["driveline", "throttle"], fate, nothing_missing);
}

#[test]
fn a_loss_of_1_per_cent_is_held_tick_by_tick() {
    let fate = || -> Fate { Box::new(|draw, _| if draw.share() < 0.01 { vec![] } else { vec![Duration::ZERO] }) };
    each("1 % loss", ["motor", "controller"], fate, |ended, ticks| {
        for (result, status) in &ended.results {
            let lost = count(result, "lost") as f64;
            // For a binomial number with this mean: four standard deviations.
            let mean = 0.01 * ticks as f64;
            assert!((lost - mean).abs() < 4.0 * mean.sqrt() + 2.0, "{lost} lost of {ticks}");
            assert_eq!(
                (count(result, "held"), count(result, "safe"), count(result, "late")),
                (count(result, "lost"), 0, 0),
                "{result}"
            );
            assert_eq!(*status, Some(1), "{result}");
        }
    });
}

#[test]
fn doubled_datagrams_are_counted_and_change_nothing() {
    let fate = || -> Fate {
        Box::new(
            |draw, _| if draw.share() < 0.05 { vec![Duration::ZERO, Duration::from_millis(2)] } else { vec![Duration::ZERO] },
        )
    };
    each("5 % doubled", ["motor", "controller"], fate, |ended, ticks| {
        nothing_missing(ended, ticks);
        for (result, _) in &ended.results {
            let (doubled, mean) = (count(result, "doubled") as f64, 0.05 * ticks as f64);
            assert!((doubled - mean).abs() < 4.0 * mean.sqrt() + 2.0, "{doubled} doubled of {ticks}");
        }
    });
}

#[test]
fn a_cut_of_500_ms_is_held_then_safe_then_over() {
    let fate =
        || -> Fate { Box::new(|_, time| if (800..1300).contains(&time.as_millis()) { vec![] } else { vec![Duration::ZERO] }) };
    each("a 500 ms cut", ["motor", "controller"], fate, |ended, _| {
        for (result, status) in &ended.results {
            let (held, safe) = (count(result, "held") as f64, count(result, "safe") as f64);
            assert_eq!(held, HOLD_MS, "{result}");
            // The cut ends by the relay's clock, and a sender that is behind its schedule at that time sends several datagrams at once.
            assert!((safe - 400.0).abs() <= 50.0, "{result}");
            assert_eq!((count(result, "late"), *status), (0, Some(1)), "{result}");
            assert!(result["peer_lost"].is_null(), "{result}");
        }
        // In the safe state no torque is demanded; afterwards it is demanded again.
        let plant = ended.record("motor");
        let (wanted, how) = (column(&plant, "i_q_wanted"), column(&plant, "played_how"));
        let safe: Vec<usize> = (0..how.len()).filter(|row| how[*row] == 3.0).collect();
        assert!(safe.iter().all(|row| wanted[*row] == 0.0));
        let after = safe.last().unwrap() + 1;
        assert!(how[after..].iter().all(|how| *how == 1.0) && wanted[after..].iter().any(|wanted| *wanted != 0.0));
    });
}

#[test]
fn strangers_are_not_heard_and_a_killed_peer_ends_the_other_within_5_s() {
    let _clock = with_a_clock();
    let stream = Stream::start(None, ["motor", "controller"], 600.0, Box::new(|_, _| vec![Duration::ZERO]));
    let Stream { folder, plant, mut step, plant_listens, relay } = stream;
    std::thread::sleep(Duration::from_millis(1500));
    // Datagrams from an unknown sender are counted and otherwise ignored.
    let stranger = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    for length in [0, 1, 88, 120, 1400] {
        stranger.send_to(&vec![0x52; length], plant_listens).unwrap();
    }
    std::thread::sleep(Duration::from_millis(200));
    step.kill().unwrap();
    step.wait().unwrap();
    let since = Instant::now();
    let output = plant.wait_with_output().unwrap();
    assert!(since.elapsed() < Duration::from_secs(5), "{:?}", since.elapsed());
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("sent no valid datagram for") && message.contains("whole ticks are recorded"), "{message}");
    let result: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(count(&result, "foreign"), 5, "{result}");
    let ended = Ended { folder, results: [(result.clone(), Some(1)), (result, None)], stood_us: relay.stood_us() };
    let record = ended.record("motor");
    let how = column(&record, "played_how");
    assert_eq!(how.last(), Some(&3.0), "it ends in the safe state");
    println!("figures: stream, a killed peer: ended after {:.1} s, {} ticks", since.elapsed().as_secs_f64(), how.len());
}

#[test]
fn a_wrong_key_and_a_silent_peer_are_reported_at_the_start() {
    let _clock = with_a_clock();
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("link.key"), "a secret of these tests alone\n").unwrap();
    std::fs::write(folder.path().join("other.key"), "another secret of these tests\n").unwrap();
    std::fs::write(folder.path().join("short.key"), "short\n").unwrap();
    let start = |role: &str, key: &str, own: u16, other: u16| {
        let (own, other) = (format!("127.0.0.1:{own}"), format!("127.0.0.1:{other}"));
        let mut command = Command::new(RSM);
        command.args(["stream", role, "--listen", &own, "--peer", &other, "--key", key, "--wait", "2", "--out", "r"]);
        command.current_dir(folder.path()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    };
    let refused = |child: Child| {
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(2));
        String::from_utf8(output.stderr).unwrap()
    };
    let (one, other) = (port(), port());
    assert!(
        refused(start("motor", "link.key", one, other)).contains("sent no valid datagram within 2.0 s: nothing was received")
    );
    let (plant, step) = (start("motor", "link.key", one, other), start("controller", "other.key", other, one));
    for child in [plant, step] {
        let message = refused(child);
        assert!(message.contains("have another key"), "{message}");
    }
    let (plant, step) = (start("motor", "link.key", one, other), start("throttle", "link.key", other, one));
    for child in [plant, step] {
        let message = refused(child);
        assert!(message.contains("runs another model"), "{message}");
    }
    assert!(refused(start("motor", "short.key", one, other)).contains("short.key: the key has 5 bytes, expected 16"));
    assert!(!folder.path().join("r").exists());
}

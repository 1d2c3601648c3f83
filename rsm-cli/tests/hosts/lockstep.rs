//! Lock-step between two hosts gives the bits of one process.

use std::process::{Child, Command, Stdio};

use rsm_link::loops::{self, Loop, Run};
use serde_json::Value;

use crate::libhelics::helics;
use crate::namespaces::Hosts;
use crate::ports::port;
use crate::{alone, seconds};

const RSM: &str = env!("CARGO_BIN_EXE_rsm");

fn output_of(child: Child) -> Value {
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn start(mut command: Command, words: &[&str], folder: &std::path::Path) -> Child {
    command.arg("federate").args(words).arg("--json").current_dir(folder);
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Prints the figures of a run in one line.
fn figures(core: &str, place: &str, output: &Value) {
    let motor = &output["roles"][0];
    let (trip, rate) = (&motor["round_trip_us"], motor["steps_per_second"].as_f64().unwrap());
    let of = |name: &str| trip[name].as_f64().unwrap();
    let (ticks, half, most) = (&motor["ticks"], of("p50"), of("p99"));
    println!(
        "figures: lock-step, {core}, {place}: {ticks} ticks, {rate:.0} steps/s, round trip p50 {half:.0} us, p99 {most:.0} us"
    );
}

fn equal_to_one_process(folder: &std::path::Path, ticks: u64) {
    let [plant, exchanged] = loops::alone(Loop::Motor, Run { ticks, load_inertia: 0.0 });
    for (name, expected) in [("motor", &plant), ("controller", &exchanged), ("recorder-motor", &exchanged)] {
        let found = std::fs::read_to_string(folder.join(format!("r/{name}.csv"))).unwrap();
        assert_eq!(found.lines().count() as u64, ticks + 1, "{name}");
        assert!(found == expected.csv(), "{name}: not the bits of one process");
    }
}

#[test]
fn two_hosts_in_lock_step_have_the_bits_of_one_process() {
    let _one = alone();
    let Some(helics) = helics("two hosts") else { return };
    let Some(hosts) = Hosts::new("two hosts in lock-step") else { return };
    let helics = helics.canonicalize().unwrap().display().to_string();
    for core in ["tcp_ss", "zmq"] {
        let folder = tempfile::tempdir().unwrap();
        let broker = format!("{}:23500", hosts.addresses[0]);
        let length = seconds().to_string();
        let common = ["--broker", &broker, "--core", core, "--helics", &helics];
        let run = ["--seconds", length.as_str(), "--out", "r"];
        let on = |host| hosts.command(host, RSM);
        // The broker is started second to last.
        let controller = start(on(1), &[&["controller"][..], &common, &run].concat(), folder.path());
        let recorder = start(on(1), &[&["recorder"][..], &common, &run].concat(), folder.path());
        let broker = start(on(0), &[&["broker", "--federates", "3"][..], &common].concat(), folder.path());
        let motor = start(on(0), &[&["motor"][..], &common, &run].concat(), folder.path());
        figures(core, "two hosts at 100 Mbit/s", &output_of(motor));
        for other in [controller, recorder, broker] {
            output_of(other);
        }
        equal_to_one_process(folder.path(), (seconds() * 1000.0).round() as u64);
    }
}

#[test]
fn the_rate_of_every_core_on_one_host() {
    let _one = alone();
    let Some(helics) = helics("rates of cores") else { return };
    let helics = helics.canonicalize().unwrap().display().to_string();
    for core in ["tcp_ss", "zmq", "ipc"] {
        let folder = tempfile::tempdir().unwrap();
        let broker = format!("127.0.0.1:{}", port());
        let length = seconds().to_string();
        let common = ["--broker", &broker, "--core", core, "--helics", &helics];
        let run = ["--seconds", length.as_str()];
        let on = || Command::new(RSM);
        let broker = start(on(), &[&["broker", "--federates", "2"][..], &common].concat(), folder.path());
        let controller = start(on(), &[&["controller"][..], &common, &run].concat(), folder.path());
        let motor = start(on(), &[&["motor"][..], &common, &run].concat(), folder.path());
        let motor = output_of(motor);
        figures(core, "one host", &motor);
        assert_eq!(motor["roles"][0]["ticks"].as_f64(), Some(seconds() * 1000.0));
        output_of(controller);
        output_of(broker);
    }
}

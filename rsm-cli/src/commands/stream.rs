//! `rsm stream`: a side of a loop in real time, connected to the other side by UDP.
//!
//! In: a side, two addresses, a key. Out: a CSV file with the values used in every tick, and counts. Exit status 1: the peer was lost during the run,
//! or values were missing at some ticks.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use rsm_core::source::Source;
use rsm_link::loops::{PERIOD_NS, Role, Run};
use rsm_link::stream::{self, Done, Settings};
use rsm_link::wire::{Key, Side};
use serde_json::json;

use super::federate::{inertia, micros, seconds};
use crate::outcome::{Answer, Outcome, Refusal};
use crate::output;

#[derive(Args)]
pub struct Arguments {
    /// The side to run: `motor` or `controller` of the motor's loop, `driveline` or `throttle` of the car's loop
    #[arg(value_parser = ["motor", "controller", "driveline", "throttle"])]
    role: String,
    /// The address at which this side listens, ADDRESS:PORT
    #[arg(long, value_name = "ADDRESS:PORT")]
    listen: String,
    /// The address of the other side, HOST:PORT
    #[arg(long, value_name = "HOST:PORT")]
    peer: String,
    /// The file with the secret key of both sides, at least 16 bytes
    #[arg(long, value_name = "FILE")]
    key: PathBuf,
    /// Duration of the run, in s
    #[arg(long, default_value_t = 2.0, value_parser = seconds)]
    seconds: f64,
    /// The length of the play-out buffer, in ms
    #[arg(long, value_name = "MS", default_value_t = 150, value_parser = clap::value_parser!(u16).range(1..=10_000))]
    buffer: u16,
    /// Time for which the last value is held if values are missing, in ms; after it the safe state applies
    #[arg(long, value_name = "MS", default_value_t = 100, value_parser = clap::value_parser!(u16).range(0..=10_000))]
    hold: u16,
    /// Time without a datagram after which the peer counts as lost, in s
    #[arg(long, default_value_t = 3.0, value_parser = seconds)]
    silence: f64,
    /// Time limit for the first datagram of the peer, in s
    #[arg(long, default_value_t = 30.0, value_parser = seconds)]
    wait: f64,
    /// Moment of inertia of the load on the motor's shaft, in kg m^2. Both buffers delay the loop: a shaft of small inertia accelerates too fast for
    /// this delay
    #[arg(long, default_value_t = 0.1, value_parser = inertia)]
    load_inertia: f64,
    /// The folder for the record, ROLE.csv
    #[arg(long)]
    out: Option<PathBuf>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> Outcome {
    let role = Role::of(&arguments.role, rsm_link::loops::Loop::Motor).expect("the arguments know the roles");
    let secret = Source::bytes(&arguments.key)?;
    let key = Key::new(&secret).map_err(|what| {
        Refusal::new(format!(
            "{}: {what}\n  help: head -c 32 /dev/urandom > {}",
            arguments.key.display(),
            arguments.key.display()
        ))
    })?;
    let side = if matches!(role, Role::Plant(_)) { Side::Plant } else { Side::Step };
    let ticks = (arguments.seconds * 1e9 / PERIOD_NS as f64).round() as u64;
    let settings = Settings {
        side: (role.of_loop(), side),
        listen: arguments.listen.clone(),
        peer: arguments.peer.clone(),
        key,
        run: Run { ticks, load_inertia: arguments.load_inertia },
        buffer: Duration::from_millis(u64::from(arguments.buffer)),
        hold: Duration::from_millis(u64::from(arguments.hold)),
        silence: Duration::from_secs_f64(arguments.silence),
        wait: Duration::from_secs_f64(arguments.wait),
    };
    let done = stream::run(&settings).map_err(Refusal)?;
    print_result(arguments, role, &done)
}

fn print_result(arguments: &Arguments, role: Role, done: &Done) -> Outcome {
    let record = arguments.out.as_ref().map(|folder| folder.join(format!("{}.csv", role.name())));
    // A record without rows is not written.
    let record = record.filter(|_| done.table.rows() > 0);
    let files: Vec<_> = record.iter().map(|path| (path.clone(), done.table.csv())).collect();
    output::write_all(&files)?;
    let counts = done.counts;
    if arguments.json {
        output::json(&json!({
            "role": role.name(),
            "loop": role.of_loop().name(),
            "ticks": done.table.rows(),
            "buffer_ms": arguments.buffer,
            "sent": done.sent,
            "not_sent": done.not_sent,
            "heard": counts.heard,
            "fresh": counts.fresh,
            "under_runs": counts.under_runs(),
            "held": counts.held,
            "safe": counts.safe,
            "lost": counts.lost(),
            "late": counts.late,
            "doubled": counts.doubled,
            "ahead": counts.ahead,
            "foreign": done.rejected.foreign,
            "other_model": done.rejected.other_model,
            "round_trip_us": done.round_trip.map(|trip| micros(&trip)),
            "lateness_us": micros(&done.lateness),
            "late_ticks": done.late_ticks,
            "deadlines_missed": done.deadlines_missed,
            "skew_us": done.skew_ns as f64 * 1e-3,
            "record": record.map(|path| path.display().to_string()),
            "peer_lost": done.lost,
        }))?;
    } else if done.began {
        let trip = done.round_trip.map_or(String::new(), |trip| {
            format!(", round trips {:.0} us p50, {:.0} us p99", trip.p50_ns as f64 * 1e-3, trip.p99_ns as f64 * 1e-3)
        });
        stderr_line!(
            "{}: {} ticks; datagrams: {} sent, {} received{trip}",
            role.name(),
            done.table.rows(),
            done.sent,
            counts.heard
        );
        if counts.under_runs() > 0 {
            stderr_line!(
                "  {} ticks had no value of the peer: {} with the last value held, {} in the safe state; datagrams: {} lost, {} late",
                counts.under_runs(),
                counts.held,
                counts.safe,
                counts.lost(),
                counts.late
            );
        }
        let others = [("doubled", counts.doubled), ("too far ahead", counts.ahead), ("foreign", done.rejected.foreign)];
        for (what, count) in others.into_iter().filter(|(_, count)| *count > 0) {
            stderr_line!("  datagrams: {count} {what}");
        }
        stderr_line!(
            "  {} ticks began after their period, {} ended after it; late by {:.0} us p99, {:.0} us at most, {:.0} us behind the clock at the end",
            done.late_ticks,
            done.deadlines_missed,
            done.lateness.p99_ns as f64 * 1e-3,
            done.lateness.max_ns as f64 * 1e-3,
            done.skew_ns as f64 * 1e-3
        );
    }
    if let Some(lost) = &done.lost {
        if !done.began {
            return Err(Refusal::new(lost.clone()));
        }
        stderr_line!("{}: {lost}\n  {} whole ticks are recorded", role.name(), done.table.rows());
    }
    Ok(if done.lost.is_some() || counts.under_runs() > 0 { Answer::Negative } else { Answer::Positive })
}

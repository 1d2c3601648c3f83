//! Runs the throttle's step on this host: `throttle-host --seconds 10 --rate 1000 [--json]`.

use std::process::ExitCode;

fn main() -> ExitCode {
    host_runners::arguments::main(|settings| {
        let run = host_runners::throttle::run(settings);
        (run.to_string(), run.json())
    })
}

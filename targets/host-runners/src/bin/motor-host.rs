//! Runs the motor's step on this host: `motor-host --seconds 10 --rate 1000 [--json]`.

use std::process::ExitCode;

fn main() -> ExitCode {
    host_runners::arguments::main(|settings| {
        let run = host_runners::motor::run(settings);
        (run.to_string(), run.json())
    })
}

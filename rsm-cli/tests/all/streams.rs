//! A reader of the command's streams may close them early, and an input file is never overwritten.

use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

use crate::calls::{folder, rsm, text};
use crate::shell::published;

const DATA: &str = "x[1],y[1]\n0,1\n1,3.1\n2,4.9\n3,7.05\n4,9\n";
const FIT: &str = "format = 1\nmodel = \"m\"\ndata = [\"data.csv\"]\n[inputs.x]\nunit = \"1\"\n[responses.y]\nunit = \"1\"\ninputs = [\"x\"]\n\
    select = { method = \"fixed\", order = 1 }\n";
const DESIGN: &str =
    "format = 1\nplan = \"p\"\nseed = 1\ndesign = \"random\"\nruns = 5\n[factors.a]\nunit = \"1\"\nrange = [0, 1]\n";

fn shipped(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../rsm-sim/plants").join(name).canonicalize().unwrap().display().to_string()
}

fn example(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples").join(name)
}

/// A folder with input files for every subcommand.
fn inputs() -> tempfile::TempDir {
    let here = folder();
    let write = |name: &str, text: &[u8]| std::fs::write(here.path().join(name), text).unwrap();
    write("data.csv", DATA.as_bytes());
    write("fit.toml", FIT.as_bytes());
    write("design.toml", DESIGN.as_bytes());
    write("bench.csv", b"run[1],depth[%],advance[deg]\n1,20,0\n");
    for (name, copy) in [("pmac.toml", "plant.toml"), ("pmac.csv", "record.csv")] {
        write(copy, &std::fs::read(shipped(name)).unwrap());
    }
    write("motor.toml", &std::fs::read(published("motor.toml")).unwrap());
    write("shards.toml", FIT.replace("[inputs.x]\n", "[inputs.x]\nrange = [0.0, 4.0]\n").as_bytes());
    for (arguments, file) in [
        (&["fit", "fit.toml", "--out", "line.toml"][..], "line.toml"),
        (&["fit", "shards.toml", "--partial", "0.rsm"], "0.rsm"),
    ] {
        let output = rsm(arguments, here.path());
        assert!(output.status.success() && here.path().join(file).is_file(), "{}", text(&output.stderr));
    }
    write("tyre.toml", &std::fs::read(example("tyre/tyre.toml")).unwrap());
    write("goals.toml", &std::fs::read(example("tyre/goals.toml")).unwrap());
    here
}

/// Calls of every subcommand that ends within a second, with their status.
const RUNS: &[(&[&str], i32)] = &[
    (&["check", "motor.toml"], 0),
    (&["check", "motor.toml", "--json", "--explain"], 0),
    (&["fit", "fit.toml"], 0),
    (&["fit", "fit.toml", "--json"], 0),
    (&["design", "design.toml", "--out", "plan.csv"], 0),
    (&["emit", "motor.toml", "--lang", "c", "--out", "emitted"], 0),
    (&["eval", "motor.toml", "--surface", "weakening_current", "--at", "torque=1,speed=500"], 0),
    (&["simulate", "plant.toml", "--record", "record.csv", "--out", "out.csv"], 0),
    (&["import", "record.csv", "--out", "imported.csv"], 0),
    (&["fit", "fit.toml", "--out", "fitted.toml", "--report", "report"], 0),
    (&["fit", "shards.toml", "--partial", "part.rsm"], 0),
    (&["fit", "shards.toml", "--partial", "part.rsm", "--json"], 0),
    (&["merge", "0.rsm"], 0),
    (&["merge", "0.rsm", "--json"], 0),
    (&["merge", "0.rsm", "--partial", "all.rsm"], 0),
    (&["optimise", "tyre.toml", "--goals", "goals.toml"], 0),
    (&["optimise", "tyre.toml", "--goals", "goals.toml", "--json"], 0),
    (&["track", "line.toml", "--data", "data.csv"], 0),
    (&["track", "line.toml", "--data", "data.csv", "--json"], 0),
    (&["emit", "motor.toml", "--lang", "rust", "--out", "emitted"], 0),
    (&["emit", "motor.toml", "--lang", "rust"], 2),
    (&["eval", "motor.toml", "--surface", "weakening_current", "--at", "torque=1,speed=500", "--json"], 0),
    (&["simulate", "plant.toml", "--record", "record.csv", "--out", "out.csv", "--json"], 0),
    (&["experiment", "pmac", "--plan", "bench.csv", "--plant", "plant.toml", "--out", "measured.csv"], 0),
    (&["inspect", "plant.toml"], 0),
    (&["effects"], 0),
    (&["effects", "--json"], 0),
    (&["linearise", "plant.toml"], 0),
    (&["completions", "bash"], 0),
    (&["man"], 0),
    (&["diagnose", "line.toml", "--data", "data.csv"], 2),
    (&["check", "fit.toml"], 2),
    (&["fit", "data.csv"], 2),
    (&["merge", "data.csv"], 2),
    (&["optimise", "tyre.toml", "--goals", "fit.toml"], 2),
    (&["sweep", "fit.toml", "--out", "swept"], 2),
    (&["track", "fit.toml", "--data", "data.csv"], 2),
    (&["cosim", "fit.toml", "--out", "records"], 2),
    (&["federate", "nobody"], 2),
    (&["stream", "nobody"], 2),
    (&["diagnose", "none.toml", "--record", "none.csv"], 2),
    (&["nothing"], 2),
    (&["--version"], 0),
    (&["--help"], 0),
    (&["fit", "--help"], 0),
];

#[test]
fn a_reader_that_closes_early_changes_neither_status_nor_files() {
    let (whole, early) = (inputs(), inputs());
    for (arguments, status) in RUNS {
        assert_eq!(rsm(arguments, whole.path()).status.code(), Some(*status), "{arguments:?}");
        for streams in ["both", "out", "err"] {
            // A pipe whose reading end is closed before the command starts: the first byte gives a broken-pipe error.
            let gone = || {
                let (reader, writer) = std::io::pipe().unwrap();
                drop(reader);
                Stdio::from(writer)
            };
            let mut command = Command::new(env!("CARGO_BIN_EXE_rsm"));
            command.args(*arguments).current_dir(early.path()).stdin(Stdio::null());
            command.stdout(if streams == "err" { Stdio::piped() } else { gone() });
            command.stderr(if streams == "out" { Stdio::piped() } else { gone() });
            let output = command.output().unwrap();
            assert_eq!(output.status.code(), Some(*status), "{arguments:?}, {streams} closed: {}", text(&output.stderr));
        }
    }
    for name in ["plan.csv", "out.csv", "emitted/motor.h", "emitted/motor.c"] {
        let read = |folder: &Path| std::fs::read(folder.join(name)).unwrap();
        assert!(read(whole.path()) == read(early.path()), "{name}");
    }
}

/// Every subcommand is among the runs above, so that a new one is tested.
#[test]
fn every_subcommand_is_run_with_closed_streams() {
    // Programs of seconds: `demo` prints as `fit` and `emit` do.
    let exempt = ["demo", "help"];
    let help = text(&rsm(&["--help"], Path::new(".")).stdout);
    let (_, list) = help.split_once("Commands:\n").unwrap();
    let commands = list.lines().take_while(|line| !line.is_empty()).filter_map(|line| line.split_whitespace().next());
    let without: Vec<&str> =
        commands.filter(|name| !exempt.contains(name) && !RUNS.iter().any(|(arguments, _)| arguments.contains(name))).collect();
    assert!(without.is_empty(), "{without:?}");
}

/// A reader that takes a few bytes and goes, as `| head -c 9`: writes fail in the middle of the output.
#[test]
fn a_reader_that_goes_in_the_middle_changes_no_status() {
    let here = inputs();
    for (arguments, status) in RUNS {
        for is_out in [true, false] {
            let mut command = Command::new(env!("CARGO_BIN_EXE_rsm"));
            command.args(*arguments).current_dir(here.path()).stdin(Stdio::null());
            let (mut reader, writer) = std::io::pipe().unwrap();
            if is_out {
                command.stdout(writer).stderr(Stdio::null());
            } else {
                command.stdout(Stdio::null()).stderr(writer);
            }
            let mut running = command.spawn().unwrap();
            // The writing end of this process closes with the command.
            drop(command);
            let mut few = [0; 9];
            let _ = std::io::Read::read(&mut reader, &mut few);
            drop(reader);
            let stream = if is_out { "out" } else { "err" };
            assert_eq!(running.wait().unwrap().code(), Some(*status), "{arguments:?}, {stream}");
        }
    }
}

/// What a command wrote on one stream, each write apart.
#[cfg(unix)]
fn writes(arguments: &[&str], here: &Path, is_out: bool) -> Vec<String> {
    use std::os::unix::net::UnixDatagram;
    // A socket of this kind keeps the bounds of a write.
    let (ours, theirs) = UnixDatagram::pair().unwrap();
    let stream = Stdio::from(std::os::fd::OwnedFd::from(theirs));
    let mut command = Command::new(env!("CARGO_BIN_EXE_rsm"));
    command.args(arguments).current_dir(here).stdin(Stdio::null());
    if is_out {
        command.stdout(stream).stderr(Stdio::null());
    } else {
        command.stdout(Stdio::null()).stderr(stream);
    }
    let mut running = command.spawn().unwrap();
    ours.set_read_timeout(Some(std::time::Duration::from_millis(10))).unwrap();
    let (mut all, mut bytes) = (Vec::new(), vec![0; 1 << 18]);
    loop {
        // Read until nothing comes after the end of the command.
        let has_ended = running.try_wait().unwrap().is_some();
        match ours.recv(&mut bytes) {
            Ok(length) => all.push(text(&bytes[..length])),
            Err(_) if has_ended => return all,
            Err(_) => {}
        }
    }
}

/// Several processes may share a terminal or a log file (`rsm cosim`, both sides of `rsm stream`): no write ends within a line, so lines stay whole.
#[cfg(unix)]
#[test]
fn no_write_ends_within_a_line() {
    let here = inputs();
    let mut written = [0, 0];
    for (arguments, _) in RUNS {
        for is_out in [false, true] {
            let parts = writes(arguments, here.path(), is_out);
            // clap prints help and bad usage piece by piece, before the command does anything.
            if ["Usage: ", "try '--help'"].iter().any(|words| parts.concat().contains(words)) {
                continue;
            }
            for part in parts {
                assert!(part.ends_with('\n'), "{arguments:?}: {part:?}");
                written[usize::from(is_out)] += 1;
            }
        }
    }
    assert!(written.iter().all(|count| *count > 10), "{written:?}");
}

/// Subcommands with an output, and every file that each reads.
const WRITERS: &[(&[&str], &[&str])] = &[
    (&["fit", "fit.toml", "--out"], &["fit.toml", "data.csv"]),
    (&["design", "design.toml", "--out"], &["design.toml"]),
    (&["simulate", "plant.toml", "--record", "record.csv", "--out"], &["plant.toml", "record.csv"]),
    (&["import", "record.csv", "--plant", "plant.toml", "--out"], &["plant.toml", "record.csv"]),
    (&["experiment", "pmac", "--plan", "bench.csv", "--plant", "plant.toml", "--out"], &["bench.csv", "plant.toml"]),
];

/// Every subcommand with one output: over an existing file of another origin, then with `--force`, then over its own output.
#[test]
fn a_file_of_another_origin_is_replaced_only_with_force() {
    for (arguments, _) in WRITERS {
        let here = inputs();
        let out = here.path().join("out");
        let notes = "my own notes\n";
        std::fs::write(&out, notes).unwrap();
        let output = rsm(&[*arguments, &["out"]].concat(), here.path());
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(text(&output.stderr).contains("--force"), "{}", text(&output.stderr));
        assert_eq!(std::fs::read_to_string(&out).unwrap(), notes);
        for more in [&["out", "--force"][..], &["out"]] {
            let output = rsm(&[*arguments, more].concat(), here.path());
            assert_eq!(output.status.code(), Some(0), "{arguments:?} {more:?}: {}", text(&output.stderr));
        }
        assert_ne!(std::fs::read_to_string(&out).unwrap(), notes);
    }
    // Folders of outputs, written twice.
    for arguments in [
        &["emit", "motor.toml", "--lang", "c", "--out", "made"][..],
        &["emit", "motor.toml", "--lang", "rust", "--out", "made"],
        &["fit", "fit.toml", "--out", "model.toml", "--report", "made"],
    ] {
        let here = inputs();
        for _ in 0..2 {
            let output = rsm(arguments, here.path());
            assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", text(&output.stderr));
        }
        let made = std::fs::read_dir(here.path().join("made")).unwrap().next().unwrap().unwrap().path();
        std::fs::write(&made, "my own notes\n").unwrap();
        assert_eq!(rsm(arguments, here.path()).status.code(), Some(2), "{arguments:?}");
    }
}

#[test]
fn what_a_killed_run_left_is_removed_by_the_next() {
    let here = inputs();
    let (old, young) = (here.path().join(".rsm-old.part"), here.path().join(".rsm-young.part"));
    let other = here.path().join(".rsm-notes");
    for path in [&old, &young, &other] {
        std::fs::write(path, "half").unwrap();
    }
    let hours_ago = std::time::SystemTime::now() - std::time::Duration::from_secs(2 * 3600);
    for path in [&old, &other] {
        std::fs::File::options().write(true).open(path).unwrap().set_modified(hours_ago).unwrap();
    }
    assert_eq!(rsm(&["fit", "fit.toml", "--out", "model.toml"], here.path()).status.code(), Some(0));
    assert!(!old.exists() && young.exists() && other.exists());
}

/// A model from a pipe gives the same result as the model from its file.
#[test]
fn a_model_comes_from_standard_input_too() {
    let here = inputs();
    for arguments in [
        &["check", "MODEL", "--json"][..],
        &["eval", "MODEL", "--surface", "weakening_current", "--at", "torque=1,speed=500"],
        &["emit", "MODEL", "--lang", "c", "--out", "made", "--json"],
    ] {
        let with =
            |model: &'static str| arguments.iter().map(|it| if *it == "MODEL" { model } else { *it }).collect::<Vec<_>>();
        let expected = rsm(&with("motor.toml"), here.path());
        let mut command = Command::new(env!("CARGO_BIN_EXE_rsm"));
        command.args(with("-")).current_dir(here.path());
        command.stdin(std::fs::File::open(here.path().join("motor.toml")).unwrap());
        let output = command.output().unwrap();
        assert_eq!((output.status.code(), text(&output.stdout)), (Some(0), text(&expected.stdout)), "{arguments:?}");
    }
    std::fs::write(here.path().join("broken"), "format = 2\n").unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_rsm"));
    command.args(["check", "-"]).stdin(std::fs::File::open(here.path().join("broken")).unwrap());
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("standard input:1"), "{}", text(&output.stderr));
}

#[test]
fn nothing_that_was_read_is_written_over() {
    for (arguments, read) in WRITERS {
        for name in *read {
            for by in ["name", "dots", "link", "hard link"] {
                let here = inputs();
                let before = std::fs::read(here.path().join(name)).unwrap();
                let out = match by {
                    "dots" => format!("./{name}"),
                    "name" => (*name).to_string(),
                    _ => "other".to_string(),
                };
                match by {
                    "link" => std::os::unix::fs::symlink(name, here.path().join("other")).unwrap(),
                    "hard link" => std::fs::hard_link(here.path().join(name), here.path().join("other")).unwrap(),
                    _ => {}
                }
                let output = rsm(&[*arguments, &[out.as_str()]].concat(), here.path());
                let words = text(&output.stderr);
                assert_eq!(output.status.code(), Some(2), "{arguments:?} {out} ({by}): {words}");
                assert!(words.contains("that was read"), "{words}");
                assert!(std::fs::read(here.path().join(name)).unwrap() == before, "{arguments:?} {out} ({by})");
            }
        }
    }
    let here = inputs();
    std::fs::create_dir(here.path().join("made")).unwrap();
    std::fs::rename(here.path().join("data.csv"), here.path().join("made/report.html")).unwrap();
    std::fs::write(here.path().join("fit.toml"), FIT.replace("data.csv", "made/report.html")).unwrap();
    let output = rsm(&["fit", "fit.toml", "--report", "made", "--out", "model.toml"], here.path());
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("that was read"), "{}", text(&output.stderr));
    assert_eq!(std::fs::read(here.path().join("made/report.html")).unwrap(), DATA.as_bytes());
    assert!(!here.path().join("model.toml").exists());
    for name in ["extended.toml", "diagnosis.json"] {
        let here = folder();
        let made = here.path().join("made");
        std::fs::create_dir(&made).unwrap();
        // The model, or its data, with the name of an output.
        let (model, data) =
            if name == "extended.toml" { ("made/extended.toml", "data.csv") } else { ("m.toml", "made/diagnosis.json") };
        std::fs::write(here.path().join(model), crate::diagnose_surface::MODEL).unwrap();
        crate::diagnose_surface::runs(&here.path().join(data), false);
        let before = std::fs::read(made.join(name)).unwrap();
        let output = rsm(&["diagnose", model, "--data", data, "--out", "made"], here.path());
        let words = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{name}: {words}");
        assert!(words.contains("that was read"), "{words}");
        assert!(std::fs::read(made.join(name)).unwrap() == before, "{name}");
        assert_eq!(std::fs::read_dir(&made).unwrap().count(), 1, "{name}: something else was written");
    }
    // A folder of outputs in which one file would overwrite an input.
    let here = inputs();
    std::fs::create_dir(here.path().join("emitted")).unwrap();
    std::fs::rename(here.path().join("motor.toml"), here.path().join("emitted/motor.c")).unwrap();
    let output = rsm(&["emit", "emitted/motor.c", "--lang", "c", "--out", "emitted"], here.path());
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
    assert!(!here.path().join("emitted/motor.h").exists());
}

#[test]
fn links_stay_and_pipes_are_written_through() {
    let here = inputs();
    std::fs::create_dir(here.path().join("store")).unwrap();
    std::os::unix::fs::symlink("store/plan.csv", here.path().join("plan.csv")).unwrap();
    for _ in 0..2 {
        let output = rsm(&["design", "design.toml", "--out", "plan.csv"], here.path());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        assert!(here.path().join("plan.csv").is_symlink());
    }
    let plan = std::fs::read(here.path().join("store/plan.csv")).unwrap();
    assert!(plan.starts_with(b"run[1],a[1]\n"));
    // A device is not replaced by a file.
    let output = rsm(&["design", "design.toml", "--out", "/dev/stdout"], here.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(output.stdout.starts_with(&plan), "{}", text(&output.stdout));
    // A named pipe with a reader.
    let pipe = here.path().join("pipe");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let reader = {
        let pipe = pipe.clone();
        std::thread::spawn(move || std::fs::read(pipe).unwrap())
    };
    let output = rsm(&["design", "design.toml", "--out", "pipe"], here.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert_eq!(reader.join().unwrap(), plan);
    std::io::stdout().flush().unwrap();
}

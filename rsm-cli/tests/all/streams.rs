//! Whoever reads the command's streams may go early, and nothing that was read is written over.

use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

use crate::command::{folder, published, rsm, text};

const DATA: &str = "x[1],y[1]\n0,1\n1,3.1\n2,4.9\n3,7.05\n4,9\n";
const FIT: &str = "format = 1\nmodel = \"m\"\ndata = [\"data.csv\"]\n[inputs.x]\nunit = \"1\"\n[responses.y]\nunit = \"1\"\ninputs = [\"x\"]\n\
    select = { method = \"fixed\", order = 1 }\n";
const DESIGN: &str =
    "format = 1\nplan = \"p\"\nseed = 1\ndesign = \"random\"\nruns = 5\n[factors.a]\nunit = \"1\"\nrange = [0, 1]\n";

fn shipped(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../rsm-lab/plants").join(name).canonicalize().unwrap().display().to_string()
}

/// A folder with something to read for every subcommand.
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
    here
}

/// What every subcommand that ends in a second does, and its status.
const RUNS: &[(&[&str], i32)] = &[
    (&["check", "motor.toml"], 0),
    (&["check", "motor.toml", "--json", "--explain"], 0),
    (&["fit", "fit.toml"], 0),
    (&["fit", "fit.toml", "--json"], 0),
    (&["design", "design.toml", "--out", "plan.csv"], 0),
    (&["emit", "motor.toml", "--lang", "c", "--out", "emitted"], 0),
    (&["eval", "motor.toml", "--surface", "weakening_current", "--at", "torque=1,speed=500"], 0),
    (&["simulate", "plant.toml", "--record", "record.csv", "--out", "out.csv"], 0),
    (&["check", "fit.toml"], 2),
    (&["diagnose", "none.toml", "--record", "none.csv"], 2),
    (&["--help"], 0),
];

#[test]
fn a_reader_that_goes_early_changes_neither_status_nor_files() {
    let (whole, early) = (inputs(), inputs());
    for (arguments, status) in RUNS {
        assert_eq!(rsm(arguments, whole.path()).status.code(), Some(*status), "{arguments:?}");
        for streams in ["both", "out", "err"] {
            // A pipe whose reading end is closed before the command starts: its first byte meets a broken pipe.
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

/// Subcommands with an output, and every file that each reads.
const WRITERS: &[(&[&str], &[&str])] = &[
    (&["fit", "fit.toml", "--out"], &["fit.toml", "data.csv"]),
    (&["design", "design.toml", "--out"], &["design.toml"]),
    (&["simulate", "plant.toml", "--record", "record.csv", "--out"], &["plant.toml", "record.csv"]),
    (&["experiment", "pmac", "--plan", "bench.csv", "--plant", "plant.toml", "--out"], &["bench.csv", "plant.toml"]),
];

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
        // The model, or its data, under the name of an output.
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
    // A folder of outputs into which a file that was read falls.
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
    // A device stays one.
    let output = rsm(&["design", "design.toml", "--out", "/dev/stdout"], here.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(output.stdout.starts_with(&plan), "{}", text(&output.stdout));
    // A pipe with a name, and a reader behind it.
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

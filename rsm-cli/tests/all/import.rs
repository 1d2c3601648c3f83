//! `rsm import`: the other commands can read the record that it writes.

use std::path::Path;

use crate::calls::{folder, json, keys, rsm, text};

fn shipped(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../rsm-sim/plants").join(name);
    path.canonicalize().unwrap().display().to_string()
}

/// The shipped motor's record as a German logger would write it: Latin-1, milliseconds, revolutions per minute, decimal commas, no load. `late` is
/// the jitter in ms.
fn logged(folder: &Path, late: f64) {
    let record = std::fs::read_to_string(shipped("pmac.csv")).unwrap();
    let mut rows = record.lines().filter(|line| !line.starts_with('#'));
    let names: Vec<&str> = rows.next().unwrap().split(',').collect();
    let place = |name: &str| names.iter().position(|found| found.starts_with(name)).unwrap();
    let places = ["time", "v_d", "v_q", "load_torque"].map(place);
    let mut text = "Pr\u{fc}fstand 4\nZeit (ms);u_d (V);u_q (V);Last (Nm);K\u{fc}hlung (\u{b0}C)\n".to_string();
    for (row, line) in rows.enumerate() {
        let cells: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
        let jitter = late * f64::from(u32::try_from(row * 7 % 10).unwrap()) / 10.0;
        let [time, v_d, v_q, load] = places.map(|at| cells[at]);
        text += &format!("{:?};{v_d:?};{v_q:?};{load:?};20\n", 1000.0 * time + jitter).replace('.', ",");
    }
    let latin: Vec<u8> = text.chars().map(|sign| sign as u8).collect();
    std::fs::write(folder.join("log.csv"), latin).unwrap();
}

const COLUMNS: [&str; 6] = ["--column", "v_d=u_d", "--column", "v_q=u_q", "--column", "load_torque=Last[N*m]"];

#[test]
fn an_imported_record_is_simulated() {
    let here = folder();
    logged(here.path(), 0.0);
    let plant = shipped("pmac.toml");
    let import = [&["import", "log.csv", "--plant", &plant, "--out", "record.csv", "--json"][..], &COLUMNS].concat();
    let output = rsm(&import, here.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let report = json(&output);
    assert_eq!(keys(&report), ["alignments", "columns", "notes", "out", "period", "resampled", "rows"]);
    assert_eq!(report["resampled"], false);
    // The inputs are those of the shipped record, bit for bit.
    let numbers = |name: &Path| -> Vec<Vec<f64>> {
        let text = std::fs::read_to_string(name).unwrap();
        let rows = text.lines().filter(|line| !line.starts_with('#')).skip(1);
        rows.map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect()).collect()
    };
    let (made, truth) = (numbers(&here.path().join("record.csv")), numbers(Path::new(&shipped("pmac.csv"))));
    assert_eq!(made.len(), truth.len());
    for (made, truth) in made.iter().zip(&truth) {
        assert_eq!(made[1..], truth[1..4], "at {} s", truth[0]);
        assert!((made[0] - truth[0]).abs() < 1e-9);
    }
    // A record with jitter is resampled, and this is reported. The new record is read without a message.
    logged(here.path(), 0.02);
    let output = rsm(&[&import[..], &["--force"]].concat(), here.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert_eq!(json(&output)["resampled"], true);
    assert!(text(&output.stderr).contains("jitter") && text(&output.stderr).contains("Latin-1"), "{}", text(&output.stderr));
    let again = rsm(&["import", "record.csv", "--out", "again.csv", "--json"], here.path());
    assert_eq!(json(&again)["resampled"], false, "{}", text(&again.stderr));
}

#[test]
fn a_record_that_the_plant_cannot_read_is_not_written() {
    let here = folder();
    logged(here.path(), 0.0);
    let plant = shipped("pmac.toml");
    let output =
        rsm(&[&["import", "log.csv", "--plant", &plant, "--out", "record.csv"][..], &COLUMNS[..4]].concat(), here.path());
    assert_eq!(output.status.code(), Some(2));
    let message = text(&output.stderr);
    assert!(message.contains("`load_torque`") && message.contains("--constant"), "{message}");
    assert!(!here.path().join("record.csv").exists());
    // A motor without load: the user states that there is no load.
    let with = [
        &["import", "log.csv", "--plant", &plant, "--out", "record.csv", "--constant", "load_torque=0[N*m]"][..],
        &COLUMNS[..4],
    ]
    .concat();
    let output = rsm(&with, here.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    for arguments in [&["import", "none.csv", "--out", "x.csv"][..], &["import", "log.csv", "--column", "a", "--out", "x.csv"]]
    {
        assert_eq!(rsm(arguments, here.path()).status.code(), Some(2), "{arguments:?}");
    }
    assert!(!here.path().join("x.csv").exists());
}

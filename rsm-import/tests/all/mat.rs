//! MAT files that scipy 1.17 (versions 5 and 7) and h5py 3 (version 7.3, as MATLAB lays it out) wrote: 40 rows, t = k/100 s, x = sin(7t) rounded to
//! six decimals, u = 3 cos(5t) likewise, in single precision where it is stored alone.

use rsm_import::{File, Record, Wishes, import};

fn file(name: &str) -> File {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name);
    File { name: name.to_string(), bytes: std::fs::read(path).unwrap() }
}

fn read(name: &str) -> Record {
    import(&[file(name)], &Wishes::default()).unwrap_or_else(|faults| panic!("{faults}"))
}

fn column<'a>(record: &'a Record, name: &str) -> &'a [f64] {
    let names: Vec<&str> = record.columns.iter().map(|column| column.name.as_str()).collect();
    &record.columns.iter().find(|column| column.name == name).unwrap_or_else(|| panic!("no `{name}` in {names:?}")).values
}

fn rounded(value: f64) -> f64 {
    format!("{value:.6}").parse().unwrap()
}

fn signals() -> (Vec<f64>, Vec<f64>, Vec<f64>) {
    let time: Vec<f64> = (0..40).map(|k| f64::from(k) * 0.01).collect();
    let x = time.iter().map(|t| rounded((7.0 * t).sin())).collect();
    let u = time.iter().map(|t| rounded(3.0 * (5.0 * t).cos())).collect();
    (time, x, u)
}

fn single(values: &[f64]) -> Vec<f64> {
    values.iter().map(|value| f64::from(*value as f32)).collect()
}

#[test]
fn arrays_of_every_width_in_every_version() {
    let (time, x, u) = signals();
    for name in ["plain.mat", "v73.mat"] {
        let record = read(name);
        assert_eq!(record.time, time, "{name}");
        assert!(!record.is_resampled, "{name}");
        assert_eq!(column(&record, "x"), x, "{name}");
        assert_eq!(column(&record, "u"), single(&u), "{name}");
        assert_eq!((column(&record, "m_1"), column(&record, "m_2")), (&x[..], &u[..]), "{name}");
        // Words and single numbers are no columns.
        assert!(record.columns.iter().all(|column| column.name != "name" && column.name != "fs"), "{name}");
    }
    assert_eq!(column(&read("plain.mat"), "gear"), [2.0; 40]);
    assert_eq!(column(&read("v73.mat"), "drive.i"), u.iter().map(|u| u + 1.0).collect::<Vec<_>>());
}

#[test]
fn structures_as_simulink_logs_them() {
    let (time, x, u) = signals();
    let record = read("simulink.mat");
    assert_eq!((&record.time, column(&record, "speed"), column(&record, "voltage")), (&time, &x[..], &u[..]));
    assert_eq!(column(&record, "drive.bus.v"), u);
}

/// Every file cut off at 150 places, and changed at 150 places: a record or a fault, never a panic.
#[test]
fn damaged_files_are_faults() {
    for name in ["plain.mat", "simulink.mat", "v73.mat"] {
        let whole = file(name);
        let mut faults = 0;
        let step = whole.bytes.len() / 150 + 1;
        for length in (0..whole.bytes.len()).step_by(step) {
            let cut = File { name: name.to_string(), bytes: whole.bytes[..length].to_vec() };
            faults += usize::from(import(&[cut], &Wishes::default()).is_err());
        }
        assert!(faults > 60, "{name}: {faults}");
        for at in (0..whole.bytes.len()).step_by(step) {
            for value in [0, 0xff] {
                let mut bytes = whole.bytes.clone();
                bytes[at] = value;
                let _ = import(&[File { name: name.to_string(), bytes }], &Wishes::default());
            }
        }
    }
}

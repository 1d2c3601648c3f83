//! MAT files that scipy 1.17 (versions 5 and 7) and h5py 3 (version 7.3, as MATLAB lays it out) wrote: 40 rows, t = k/100 s, x = sin(7t) rounded to
//! six decimals, u = 3 cos(5t) likewise, in single precision where it is stored alone.

use rsm_import::{Record, Wishes, import};

use super::{assert_damage_is_a_fault, column, file, rounded};

fn read(name: &str) -> Record {
    import(&[file(name)], &Wishes::default()).unwrap_or_else(|faults| panic!("{faults}"))
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

/// Every file cut off at 150 places, and changed at 150 places.
#[test]
fn damaged_files_are_faults() {
    for name in ["plain.mat", "simulink.mat", "v73.mat"] {
        let whole = file(name);
        assert_damage_is_a_fault(&whole, whole.bytes.len() / 150 + 1);
    }
}

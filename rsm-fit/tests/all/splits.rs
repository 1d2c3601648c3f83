//! A split keeps declared groups of rows on one side, and is the same for the same seed.

use std::path::Path;

use rsm_core::model::Evidence;
use rsm_fit::content::Content;
use rsm_fit::records::{Records, Rows, Units};
use rsm_fit::spec::Validation;
use rsm_fit::split::{Sides, split};

use crate::data::{Files, fitted_in, specification};

/// A map of x from -4 to 4 and z from 0 to 3, in four runs.
fn map() -> Files {
    let files = Files::default();
    let mut text = "x[A],z[V],y[1],run\n".to_string();
    for x in -4i32..=4 {
        for z in 0..=3 {
            text += &format!("{x},{z},{},run {}\n", x * x + 2 * z, (x + 4) % 4);
        }
    }
    files.file("map.csv", &text);
    files
}

fn text(validate: &str) -> String {
    format!(
        "format = 1\nmodel = \"m\"\ndata = [\"map.csv\"]\nvalidate = {validate}\n[inputs.x]\n[inputs.z]\n[responses.y]\n\
         inputs = [\"x\", \"z\"]\nselect = {{ method = \"fixed\", order = 2 }}\n"
    )
}

fn sides(files: &Files, validate: &str) -> (Records, Sides) {
    let specification = specification(&text(validate), Path::new(""));
    let records = {
        let mut open = |name: &str| Ok(Content::from(files.get(name)));
        Records::read(&specification, &specification.data, Rows::ToFit, &mut Units::of(&specification), &mut open).unwrap()
    };
    let Validation::Split(wanted) = &specification.validation else { panic!("a split was asked for") };
    let sides = split(&specification, wanted, &records);
    (records, sides)
}

#[test]
fn mirror_pairs_and_runs_stay_on_one_side() {
    let files = map();
    for seed in 0..20 {
        let (records, sides) = sides(&files, &format!("{{ share = 0.4, seed = {seed}, mirror = [\"x\"] }}"));
        let of = |rows: &[usize]| -> Vec<(u64, u64)> {
            rows.iter().map(|row| (records.inputs[0][*row].abs().to_bits(), records.inputs[1][*row].to_bits())).collect()
        };
        let unseen = of(&sides.validate);
        assert!(of(&sides.fit).iter().all(|point| !unseen.contains(point)), "seed {seed}: a mirror pair on both sides");
        // The share of 0.4 of 36 rows is 14.4; the last pair may add one more.
        assert!((14..=15).contains(&unseen.len()) && sides.fit.len() + unseen.len() == 36);
    }
    let (records, sides) = sides(&files, "{ share = 0.2, seed = 3, keep_together = [\"run\"] }");
    let runs = |rows: &[usize]| -> std::collections::BTreeSet<String> {
        rows.iter().map(|row| records.labels[0][*row].clone()).collect()
    };
    assert!(runs(&sides.fit).is_disjoint(&runs(&sides.validate)));
    assert_eq!(runs(&sides.fit).len() + runs(&sides.validate).len(), 4);
}

#[test]
fn one_seed_is_one_split_and_another_is_another() {
    let files = map();
    let of = |seed: u64| sides(&files, &format!("{{ share = 0.3, seed = {seed} }}")).1;
    assert_eq!(of(7), of(7));
    assert_ne!(of(7), of(8));
    // Must never change: another split would give other coefficients for the same specification.
    assert_eq!(of(7).validate, KNOWN);
}

const KNOWN: [usize; 11] = [0, 6, 12, 15, 22, 23, 24, 26, 28, 31, 34];

#[test]
fn the_evidence_names_data_specification_and_split() {
    let folder = std::env::temp_dir().join(format!("rsm-fit-evidence-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(
        folder.join("map.csv"),
        "x[A],z[V],y[1]\n0,0,1\n1,0,2\n2,0,5\n0,1,3\n1,1,2\n2,1,4\n0,2,2\n1,2,1\n2,2,0\n1,3,2\n",
    )
    .unwrap();
    let outcome = fitted_in(&text("{ share = 0.2, seed = 1 }"), &folder);
    std::fs::remove_dir_all(&folder).unwrap();
    let evidence = &outcome.model.surfaces[0].evidence;
    let keys: Vec<&str> = evidence.iter().map(|(name, _)| name.as_str()).collect();
    let expected =
        ["rows", "data", "specification", "method", "residual_sd", "r2", "r2_predicted", "press", "confidence_c", "validation"];
    assert_eq!(keys, expected);
    let Evidence::List(files) = &evidence[1].1 else { panic!("{:?}", evidence[1]) };
    let Evidence::Table(file) = &files[0] else { panic!("{files:?}") };
    assert_eq!(file[0].1, Evidence::Text("map.csv".into()));
    // The output of sha256sum for the text above.
    assert_eq!(file[2].1, Evidence::Text(SHA256.into()));
    assert!(!format!("{evidence:?}").contains(&folder.display().to_string()), "a path of this machine in the evidence");
}

const SHA256: &str = "895f00c9abfa4dfedd5e8ae55354fb994d3ae64bd4e306cb91d1f398ff7e638d";

//! The support of a surface, through the tape of the emitted test: 1 at every fitted row, 0 in a corner without data.

use rsm_core::check::Checked;
use rsm_core::lower;
use rsm_core::number::Precision;
use rsm_core::run::Interpreter;
use rsm_fit::fit::Outcome;

use crate::data::{Files, fitted};

/// Gears and speeds of a car: the engine runs between 1200 and 4800 rpm, so there are no data for first gear at 30 m/s.
fn tip_in() -> (Files, Vec<[f64; 2]>) {
    let files = Files::default();
    let mut points = Vec::new();
    let mut text = "speed[m/s],gear[1],damping[1]\n".to_string();
    for gear in 1..=5u32 {
        for k in 0..5u32 {
            // The speed is 6.5 m/s in first gear at 4800 rpm, and increases by the same amount with each gear; in thirds, so that no coded value is a
            // short decimal.
            let speed = 6.5 * f64::from(gear) * (1.0 + 3.0 * f64::from(k) / 4.0) / 4.0 / 0.9;
            text += &format!("{speed},{gear},{}\n", 0.1 + 0.05 * f64::from(gear) + 0.002 * speed);
            points.push([speed, f64::from(gear)]);
        }
    }
    files.file("tip-in.csv", &text);
    (files, points)
}

fn fit(files: &Files, rest: &str) -> Outcome {
    let text = format!(
        "format = 1\nmodel = \"car\"\ndata = [\"tip-in.csv\"]\n[inputs.speed]\n[inputs.gear]\n[responses.damping]\n\
         inputs = [\"speed\", \"gear\"]\n{rest}\n{}\n",
        // A hinge and products of its own input are linearly dependent, so the terms are given.
        if rest.contains("knots") { KNOT_TERMS } else { "select = { method = \"fixed\", order = 2 }" }
    );
    fitted(&text, files)
}

const KNOT_TERMS: &str = "select = { method = \"fixed\" }\nterms = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]";

/// The results of the support test of the first surface at points, in both precisions.
fn says(outcome: &Outcome, points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let checked = Checked::from_model(&outcome.model).unwrap();
    let wide = lower::support(&checked, 0, Precision::F64).unwrap();
    let narrow = lower::support(&checked, 0, Precision::F32).unwrap();
    let (mut wide, mut narrow) = (Interpreter::<f64>::new(&wide), Interpreter::<f32>::new(&narrow));
    points.iter().map(|point| [wide.eval(point), f64::from(narrow.eval(&point.map(|x| x as f32)))]).collect()
}

#[test]
fn every_row_is_inside_and_high_speed_in_low_gear_is_not() {
    let (files, points) = tip_in();
    for rest in [
        "support = \"data\"",
        "support = { from = \"data\", faces = 6 }",
        "support = { from = \"data\", margin = 0.05 }",
        "coding = \"none\"\nsupport = \"data\"",
        "reciprocal = [\"speed\"]\nsupport = \"data\"",
        "knots = [{ input = \"speed\", at = 15.0 }]\nsupport = \"data\"",
    ] {
        let outcome = fit(&files, rest);
        assert!(says(&outcome, &points).iter().all(|found| *found == [1.0, 1.0]), "{rest}: {:?}", outcome.model.surfaces[0]);
        // High speed in low gear, low speed in high gear, outside the range of both: there are no data.
        let outside = [[30.0, 1.0], [2.0, 5.0], [25.0, 2.0], [60.0, 6.0], [-5.0, 0.0]];
        assert!(says(&outcome, &outside).iter().all(|found| *found == [0.0, 0.0]), "{rest}: {:?}", says(&outcome, &outside));
        let share = outcome.responses[0].statistics.as_ref().unwrap().support.as_ref().unwrap().share_of_box;
        // A wedge between the lines of 1200 and of 4800 rpm.
        assert!((0.2..0.8).contains(&share), "{rest}: {share}");
    }
}

#[test]
fn unseen_rows_outside_are_counted_and_told_in_the_evidence() {
    let (files, _) = tip_in();
    files.file("unseen.csv", "speed[m/s],gear[1],damping[1]\n30,1,0.2\n12,3,0.28\n3,5,0.4\n");
    let text = "format = 1\nmodel = \"car\"\ndata = [\"tip-in.csv\"]\nvalidate = [\"unseen.csv\"]\n[inputs.speed]\n[inputs.gear]\n\
                [responses.damping]\ninputs = [\"speed\", \"gear\"]\nsupport = \"data\"\nselect = { method = \"fixed\", order = 1 }\n";
    let outcome = fitted(text, &files);
    let support = outcome.responses[0].statistics.as_ref().unwrap().support.as_ref().unwrap();
    assert_eq!(support.unseen_rows_outside, 2);
    assert_eq!(support.half_spaces, outcome.model.surfaces[0].support.len());
    let written = rsm_core::model_file::write(&outcome.model);
    assert!(written.contains("unseen_rows_outside = 2"), "{written}");
    // The written model is read back unchanged.
    let read = Checked::read(&rsm_core::source::Source::new("m.toml", written)).unwrap();
    assert_eq!(read.model().surfaces[0].support, outcome.model.surfaces[0].support);
}

//! Weighted least squares, compared with cases calculated by hand.

use rsm_fit::statistics::ResponseStatistics;

use crate::data::{Files, fitted};

fn fit(data: &str, rest: &str) -> ResponseStatistics {
    let files = Files::of("data.csv", data);
    let text =
        format!("format = 1\nmodel = \"m\"\ndata = [\"data.csv\"]\n[inputs.x]\n[responses.y]\ninputs = [\"x\"]\n{rest}\n");
    fitted(&text, &files).responses[0].statistics.clone().unwrap()
}

const LINE: &str = "select = { method = \"fixed\", order = 1 }";

#[test]
fn a_constant_is_the_weighted_mean() {
    let data = "x[1],y[V],w\n0,1,1\n1,2,2\n2,6,5\n";
    let found = fit(data, "select = { method = \"fixed\" }\nterms = [[0]]\nweights = \"w\"");
    // The mean is (1 + 4 + 30)/8 = 4.375. With weights of mean 1, w_i 3/8: rss = (3/8)(1 * 11.390625 + 2 * 5.640625 + 5 * 2.640625) = 13.453125, with
    // two degrees of freedom. The variance of the mean is the residual variance divided by the sum of the weights, 3.
    let square: f64 = 13.453125 / 2.0;
    assert_eq!(found.terms[0].coefficient, 4.375);
    // One rounding in each root.
    assert!((found.residual_sd.unwrap() - square.sqrt()).abs() < 1e-15 * 3.0);
    assert!((found.terms[0].standard_error.unwrap() - (square / 3.0).sqrt()).abs() < 1e-15 * 3.0);
    // If one row is left out, the means of the others are 34/7, 31/6 and 5/3.
    let press = 0.375 * ((27.0f64 / 7.0).powi(2) + 2.0 * (19.0f64 / 6.0).powi(2) + 5.0 * (13.0f64 / 3.0).powi(2));
    // A few roundings of terms below 36.
    assert!((found.press.unwrap() - press).abs() < 1e-13, "{:?} {press}", found.press);
    // About its own weighted mean a constant explains nothing, to the 106 bits of the sums.
    assert!(found.r2.unwrap().abs() < 1e-30);
}

#[test]
fn a_row_of_weight_two_is_a_row_twice() {
    let once = "x[1],y[V],w\n0,1,1\n1,2.5,2\n2,2.75,1\n3,5,2\n4,4.5,1\n";
    let twice = "x[1],y[V]\n0,1\n1,2.5\n1,2.5\n2,2.75\n3,5\n3,5\n4,4.5\n";
    let (one, two) = (fit(once, &format!("{LINE}\nweights = \"w\"")), fit(twice, LINE));
    // Both ways use 106 bits and round once.
    for (a, b) in one.terms.iter().zip(&two.terms) {
        assert_eq!(a.coefficient, b.coefficient);
    }
    assert!((one.r2.unwrap() - two.r2.unwrap()).abs() < 1e-15, "{:?} {:?}", one.r2, two.r2);
    // Equations (14), (15): replicates and weights have the same effect.
    assert!((one.confidence_c.unwrap() - two.confidence_c.unwrap()).abs() < 1e-12);
}

#[test]
fn standard_errors_weigh_by_their_inverse_square_and_their_scale_does_not_matter() {
    let by_weight = "x[1],y[V],w\n0,1,4\n1,2.5,1\n2,2.75,0.25\n3,5,4\n";
    let weighted = fit(by_weight, &format!("{LINE}\nweights = \"w\""));
    for scale in [1.0, 8.0] {
        let rows: String = [(0.0, 1.0, 0.5), (1.0, 2.5, 1.0), (2.0, 2.75, 2.0), (3.0, 5.0, 0.5)]
            .map(|(x, y, s)| format!("{x},{y},{}\n", s * scale))
            .concat();
        let found = fit(&format!("x[1],y[V],s[V]\n{rows}"), &format!("{LINE}\nweights = {{ standard_error = \"s\" }}"));
        // Powers of two: the weights are the same to the bit.
        assert_eq!(found, weighted);
    }
    // The weights change the result.
    let plain = fit(by_weight, LINE);
    assert!((plain.terms[1].coefficient - weighted.terms[1].coefficient).abs() > 0.01);
}

#[test]
fn unseen_rows_need_no_weights() {
    let files = Files::default();
    files.file("data.csv", "x[1],y[V],w\n0,1,1\n1,2,2\n2,6,5\n").file("unseen.csv", "x[1],y[V]\n1,3\n");
    let text = "format = 1\nmodel = \"m\"\ndata = [\"data.csv\"]\nvalidate = [\"unseen.csv\"]\n[inputs.x]\n[responses.y]\ninputs = [\"x\"]\n\
                weights = \"w\"\nselect = { method = \"ladder\", max_order = 2, confidence = 50.0 }\n";
    let outcome = fitted(text, &files);
    assert_eq!(outcome.responses[0].statistics.as_ref().unwrap().validation.as_ref().unwrap().rows, 1);
    assert!(rsm_core::model_file::write(&outcome.model).contains("weights = \"column w\""));
}

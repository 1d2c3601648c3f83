//! A measured flux map, fitted and validated on held-out rows, compared with results of other tools.
//!
//! The split: 30 % of the rows are held out at random. Mirror pairs (i_q and -i_q) are kept on one side, because one half of the map was computed
//! from the other. The largest error of one such split varies by a tenth and more with the seed (it is the error of one row), so the result is the
//! median over 15 seeds. The published results, in percent of the response's span, are 11.5 and 14.2 at second order, and 7.8 and 7.7 at third order.
//! They are reproduced within a tenth.
//!
//! The 44 mV*s for psi_q with symmetry at third order are reproduced exactly (44.2) by sign(i_q) times the full third-order polynomial of i_d
//! and |i_q|, 10 terms. Four of these terms do not contain i_q: that surface has a jump of up to its own error at i_q = 0, and the model file refuses
//! it. Two similar continuous bases also come within a tenth: i_q times the full third-order polynomial (10 terms), and third order in each variable
//! (12 terms).

use crate::data::fitted_in;
use crate::folders::shared;

const SEEDS: std::ops::RangeInclusive<u64> = 1..=15;

/// The median over the seeds of the largest held-out error of psi_d and psi_q in V*s. `psi_q` contains the other keys of that response's table.
fn held_out(folder: &std::path::Path, psi_d: &str, psi_q: &str) -> [f64; 2] {
    let mut largest: [Vec<f64>; 2] = Default::default();
    for seed in SEEDS {
        let text = format!(
            r#"
format = 1
model = "pmsyrm"
data = ["flux_map.csv"]
validate = {{ share = 0.3, seed = {seed}, mirror = ["i_q"] }}
[inputs.i_d]
column = "i_d_A"
unit = "A"
[inputs.i_q]
column = "i_q_A"
unit = "A"
[responses.psi_d]
column = "psi_d_Vs"
unit = "V*s"
inputs = ["i_d", "i_q"]
{psi_d}
[responses.psi_q]
column = "psi_q_Vs"
unit = "V*s"
inputs = ["i_d", "i_q"]
{psi_q}
"#
        );
        let outcome = fitted_in(&text, folder);
        for (response, largest) in outcome.responses.iter().zip(&mut largest) {
            let validation = response.statistics.as_ref().unwrap().validation.as_ref().unwrap();
            // The share of 0.3 of 567 rows is 170; the last group may be a pair.
            assert!((170..=171).contains(&validation.rows));
            largest.push(validation.max_abs_error);
        }
    }
    largest.map(|mut errors| {
        errors.sort_by(f64::total_cmp);
        errors[errors.len() / 2]
    })
}

fn within_a_tenth(what: &str, found: f64, published: f64) {
    println!("{what:42} {found:8.2}   published {published}");
    assert!((found / published - 1.0).abs() <= 0.1, "{what}: found {found}, published {published}");
}

#[test]
fn plain_second_and_third_order_miss_the_flux_map_by_the_published_figures() {
    let Some(folder) = shared("pmsyrm-flux-map") else { return };
    // The difference of maximum and minimum of the columns.
    let span = [0.913977451 - 0.0845760823, 2.0 * 1.31256653];
    for (order, published) in [(2, [11.5, 14.2]), (3, [7.8, 7.7])] {
        let method = format!("select = {{ method = \"fixed\", order = {order} }}");
        let found = held_out(&folder, &method, &method);
        for (k, name) in ["psi_d", "psi_q"].iter().enumerate() {
            within_a_tenth(&format!("{name}, order {order}, percent of span"), 100.0 * found[k] / span[k], published[k]);
        }
        if order == 3 {
            within_a_tenth("psi_q, order 3, mV*s", 1000.0 * found[1], 203.0);
        }
    }
}

#[test]
fn symmetry_in_the_basis_brings_the_quadrature_flux_to_the_published_figure() {
    let Some(folder) = shared("pmsyrm-flux-map") else { return };
    let third: Vec<[u32; 2]> = (0..=3).flat_map(|d| (0..=3 - d).map(move |q| [d, q])).collect();
    let times_i_q: Vec<[u32; 2]> = third.iter().map(|[d, q]| [*d, q + 1]).collect();
    let each: Vec<[u32; 2]> = (0..=3).flat_map(|d| (1..=3).map(move |q| [d, q])).collect();
    let even = "symmetry = { i_q = \"even\" }\nselect = { method = \"fixed\", order = 3 }";
    for (what, terms) in [("psi_q, i_q times third order, mV*s", times_i_q), ("psi_q, third order in each, mV*s", each)] {
        let odd = format!("symmetry = {{ i_q = \"odd\" }}\nselect = {{ method = \"fixed\" }}\nterms = {terms:?}");
        within_a_tenth(what, 1000.0 * held_out(&folder, even, &odd)[1], 44.0);
    }
}

#[test]
fn the_ladder_finds_a_small_odd_model_of_the_quadrature_flux() {
    let Some(folder) = shared("pmsyrm-flux-map") else { return };
    let text = r#"
format = 1
model = "pmsyrm"
data = ["flux_map.csv"]
validate = { share = 0.3, seed = 1, mirror = ["i_q"] }
[inputs.i_d]
column = "i_d_A"
unit = "A"
[inputs.i_q]
column = "i_q_A"
unit = "A"
[responses.psi_q]
column = "psi_q_Vs"
unit = "V*s"
inputs = ["i_d", "i_q"]
symmetry = { i_q = "odd" }
select = { method = "ladder", max_order = 5, confidence = 99.8 }
"#;
    let outcome = fitted_in(text, &folder);
    let surface = &outcome.model.surfaces[0];
    println!("{}: {} terms", outcome.responses[0].verdict, surface.terms.len());
    assert!(outcome.reached(), "{}", outcome.responses[0].verdict);
    assert!(surface.terms.iter().all(|term| term.powers[1] > 0), "an odd surface with a term that jumps at i_q = 0");
    assert_eq!(outcome.model.inputs[1].range, [-26.0, 26.0]);
    // All 15 odd terms up to order 5 are candidates; the ladder takes fewer.
    assert!(surface.terms.len() <= 8, "{} terms", surface.terms.len());
}

//! Against the same sums written out, and against what must hold for any data. Published cases: `tests/all/textbook.rs`.

use super::*;

fn example() -> (Vec<Vec<f64>>, Vec<f64>) {
    let x: Vec<f64> = (0..12).map(|k| f64::from(k % 4) - 1.5).collect();
    let z: Vec<f64> = (0..12).map(|k| f64::from(k / 4) + 0.1 * f64::from(k % 4)).collect();
    let y = (0..12).map(|k| 3.0 + x[k] - 0.5 * z[k] + 0.2 * f64::from((k * 5 % 7) as u32)).collect();
    (vec![x, z], y)
}

#[test]
fn a_row_left_out_gives_its_studentised_residual_and_distance() {
    let (columns, y) = example();
    let analysis = Analysis::new(&[Group::new("all", &columns)], &y).unwrap();
    let without = |vector: &[f64], out: usize| -> Vec<f64> {
        vector.iter().enumerate().filter(|(row, _)| *row != out).map(|(_, x)| *x).collect()
    };
    let mut press = 0.0;
    for out in 0..12 {
        let rest: Vec<Vec<f64>> = columns.iter().map(|column| without(column, out)).collect();
        let other = Analysis::new(&[Group::new("all", &rest)], &without(&y, out)).unwrap();
        let at = other.predict(&[columns[0][out], columns[1][out]], 0.95);
        let error = y[out] - at.value;
        press += error * error;
        let row = analysis.rows[out];
        // error/(sd of a new measurement there) is the studentised residual.
        let half = (at.prediction[1] - at.prediction[0]) / 2.0 / quantile_t(0.95, 8);
        assert!((row.studentised.unwrap() - error / half).abs() < 1e-9, "{row:?}");
        let moved: f64 = (0..12)
            .map(|k| {
                let point = [columns[0][k], columns[1][k]];
                (analysis.predict(&point, 0.95).value - other.predict(&point, 0.95).value).powi(2)
            })
            .sum();
        assert!((row.cook.unwrap() - moved / (3.0 * analysis.residual_sd.powi(2))).abs() < 1e-10, "{row:?}");
    }
    assert!((analysis.press.unwrap() / press - 1.0).abs() < 1e-12);
}

#[test]
fn sums_of_squares_add_up_and_orthogonal_columns_do_not_inflate() {
    let (columns, y) = example();
    let analysis = Analysis::new(&[Group::new("x", [&columns[0]]), Group::new("z", [&columns[1]])], &y).unwrap();
    let mean = y.iter().sum::<f64>() / 12.0;
    let total: f64 = y.iter().map(|y| (y - mean).powi(2)).sum();
    let sum: f64 = analysis.sequential.iter().take(3).map(|line| line.ss).sum();
    assert!((sum / total - 1.0).abs() < 1e-13);
    // The last group is after all others: its sequential sum is its partial one, and F is the square of t.
    assert!((analysis.sequential[1].ss / analysis.coefficients[2].partial_ss - 1.0).abs() < 1e-12);
    assert!((analysis.sequential[1].f.unwrap() / analysis.coefficients[2].t.powi(2) - 1.0).abs() < 1e-12);
    // VIF = 1/(1 - R^2 of the column on the others).
    let on_others = Analysis::new(&[Group::new("x", [&columns[0]])], &columns[1]).unwrap();
    assert!((analysis.coefficients[2].vif.unwrap() - 1.0 / (1.0 - on_others.r2)).abs() < 1e-12);
    assert_eq!(analysis.coefficients[0].vif, None);
}

#[test]
fn what_cannot_be_analysed_is_refused() {
    let x = [1.0, 2.0, 3.0, 4.0];
    let of = |columns: &[&[f64]], y: &[f64]| Analysis::new(&[Group::new("x", columns)], y).unwrap_err();
    assert_eq!(of(&[&x[..3]], &x), Refusal::Lengths);
    assert_eq!(of(&[&[1.0, f64::NAN, 2.0, 3.0]], &x), Refusal::NotFinite);
    assert_eq!(of(&[&x, &[2.0, 4.0, 6.0, 8.0]], &x), Refusal::Dependent);
    assert_eq!(of(&[&x, &[1.0, 0.0, 0.0, 0.0], &[0.0, 1.0, 0.0, 0.0]], &x), Refusal::Dependent);
    let weighted = Analysis::weighted(&[Group::new("x", [x])], &x, &[1.0, 1.0, 0.0, 1.0]).unwrap_err();
    assert_eq!(weighted, Refusal::NotFinite);
}

#[test]
fn quantiles_are_those_of_tables() {
    // Two-sided 95 %: 12.7062 (1), 2.22814 (10), 1.97993 (120).
    for (freedom, expected) in [(1, 12.706_204_736), (10, 2.228_138_852), (120, 1.979_930_405)] {
        assert!((quantile_t(0.95, freedom) - expected).abs() < 1e-8, "{freedom}: {}", quantile_t(0.95, freedom));
    }
}

#[test]
fn the_steepest_path_is_the_best_of_many_points_at_its_distance() {
    let surface = Quadratic::new(1.0, &[0.3, -0.2], &[&[0.5, 0.4], &[0.4, -1.0]]);
    for ascent in [true, false] {
        for point in surface.steepest(&[0.3, 1.0, 4.0], ascent) {
            assert!((point.at.iter().map(|x| x * x).sum::<f64>().sqrt() / point.distance - 1.0).abs() < 1e-12, "{point:?}");
            for k in 0..3600 {
                let angle = f64::from(k) * std::f64::consts::TAU / 3600.0;
                let other = surface.value(&[point.distance * angle.cos(), point.distance * angle.sin()]);
                assert!(if ascent { other <= point.value + 1e-12 } else { other >= point.value - 1e-12 }, "{point:?} {other}");
            }
        }
    }
    // No slope: the path leaves along the axis of the greatest curvature.
    let bowl = Quadratic::new(0.0, &[0.0, 0.0], &[&[1.0, 0.0], &[0.0, -1.0]]);
    let point = &bowl.steepest(&[2.0], true)[0];
    assert!((point.value - 4.0).abs() < 1e-12, "{point:?}");
}

#[test]
fn the_power_is_that_with_the_least_residual_and_its_interval_drops_as_far_as_it_says() {
    let (columns, y) = example();
    let y: Vec<f64> = y.iter().map(|y| (y + 2.0).powi(2)).collect();
    let found = box_cox(&columns, &y).unwrap();
    let mean = (y.iter().map(|y| y.ln()).sum::<f64>() / 12.0).exp();
    let likelihood = |power: f64| {
        let z: Vec<f64> = y.iter().map(|y| (y.powf(power) - 1.0) / (power * mean.powf(power - 1.0))).collect();
        let analysis = Analysis::new(&[Group::new("all", &columns)], &z).unwrap();
        -6.0 * (analysis.residual_sd.powi(2) * 9.0 / 12.0).ln()
    };
    let best = likelihood(found.power);
    for k in -30..=30 {
        let power = f64::from(k) / 10.0 + 1e-3;
        assert!(likelihood(power) <= best + 1e-9, "{power}");
    }
    for end in found.interval.into_iter().filter(|end| end.abs() < 3.0) {
        assert!((best - likelihood(end) - 1.920_729).abs() < 1e-5, "{end}");
    }
    assert!(box_cox(&columns, &[1.0; 12]).is_none());
}

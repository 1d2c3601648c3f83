//! Climbs whose every step is known: the columns are unit vectors, so that each coefficient is an entry of the response, and a term takes the square
//! of its entry from the residual.

use super::*;
use crate::qr::Compressed;

/// The rows of columns, the response last.
fn triangle(columns: &[Vec<Dd>]) -> Triangle {
    let mut rows = Compressed::new(columns.len());
    for row in 0..columns[0].len() {
        rows.push(columns.iter().map(|column| column[row]));
    }
    rows.finish()
}

fn dd(values: &[f64]) -> Vec<Dd> {
    values.iter().copied().map(Dd::from).collect()
}

/// Unit vectors, then further columns, then the response; two rows of zeros more than unit vectors unless `rows` says how many.
fn units(count: usize, more: &[&[f64]], response: &[f64]) -> Triangle {
    let rows = response.len();
    let unit = |place: usize| (0..rows).map(|k| Dd::from(f64::from(u8::from(k == place)))).collect::<Vec<Dd>>();
    let columns: Vec<Vec<Dd>> =
        (0..count).map(unit).chain(more.iter().map(|column| dd(column))).chain([dd(response)]).collect();
    triangle(&columns)
}

/// Terms of these orders.
fn orders(of: &[u32]) -> Vec<Vec<u32>> {
    of.iter().map(|order| vec![*order]).collect()
}

/// Order, number of terms and C of a step.
type Step = (u32, usize, f64);

/// A climb and all that `progress` heard.
fn climbed(
    fit: &Triangle,
    judge: &Judge,
    terms: &[Vec<u32>],
    max_order: u32,
    wanted: f64,
) -> (Result<LadderModel, Dependent>, Vec<Step>) {
    let mut heard = Vec::new();
    let climb = Ladder::new(fit, judge, terms, max_order, wanted).climb(&mut |order, size, c| heard.push((order, size, c)));
    (climb, heard)
}

fn chosen(fit: &Triangle, judge: &Judge, terms: &[Vec<u32>], max_order: u32, wanted: f64) -> Vec<usize> {
    climbed(fit, judge, terms, max_order, wanted).0.unwrap().chosen
}

/// C where so much is left of so much.
fn c(left: f64, whole: f64) -> f64 {
    100.0 - 100.0 * (left / whole)
}

#[test]
fn the_first_rung_is_the_lowest_order_but_the_constant() {
    assert_eq!([first_rung(&orders(&[0, 1, 2])), first_rung(&orders(&[3, 2, 4])), first_rung(&[])], [1, 2, 1]);
    assert_eq!(first_rung(&orders(&[0, 2])), 1);
}

#[test]
fn a_climb_takes_the_largest_gain_of_the_open_order_until_it_arrives() {
    let response = [10.0, 3.0, -5.0, 8.0, 0.0, 0.0];
    let (fit, terms) = (units(4, &[], &response), orders(&[0, 1, 1, 2]));
    let judge = Judge::new(fit.clone());
    // The squares are 100, 9, 25 and 64: the last has the largest, and its order comes last.
    let whole = 198.0;
    let steps = [(1, 1, c(98.0, whole)), (1, 2, c(73.0, whole)), (1, 3, c(64.0, whole)), (2, 4, c(0.0, whole))];
    // Just so much as two of them reach, and a little more.
    let (climb, heard) = climbed(&fit, &judge, &terms, 2, c(73.0, whole));
    assert_eq!(climb.unwrap(), LadderModel { chosen: vec![0, 2], confidence: c(73.0, whole), centred: None });
    assert_eq!(heard, steps[..2]);
    let (climb, heard) = climbed(&fit, &judge, &terms, 2, c(73.0, whole).next_up());
    // Three reach it, and the last alone takes the place of two and then does without the third.
    assert_eq!(heard, steps[..3]);
    assert_eq!(climb.unwrap().chosen, [0, 3]);
    // The order is limited.
    let (climb, heard) = climbed(&fit, &judge, &terms, 1, 100.0);
    assert_eq!((climb.unwrap().chosen, heard), (vec![0, 1, 2], steps[..3].to_vec()));
    let (climb, heard) = climbed(&fit, &judge, &terms, 2, 100.0);
    assert_eq!((climb.unwrap().chosen, heard), (vec![0, 1, 2, 3], steps.to_vec()));
    // A term that takes as much as another comes after it.
    let equal = units(3, &[], &[10.0, -5.0, 5.0, 0.0]);
    assert_eq!(chosen(&equal, &Judge::new(equal.clone()), &orders(&[0, 1, 1]), 1, c(25.0, 150.0)), [0, 1]);
}

#[test]
fn c_about_the_mean_is_asked_where_it_is_known() {
    let response = [10.0, 3.0, -5.0, 0.0, 0.0];
    let (fit, terms) = (units(3, &[], &response), orders(&[0, 1, 1]));
    // About zero 134, about the mean 40, say.
    let judge = Judge::new(fit.clone()).about_the_mean(Dd::from(40.0));
    let climb = climbed(&fit, &judge, &terms, 1, 70.0).0.unwrap();
    assert_eq!(climb, LadderModel { chosen: vec![0, 2], confidence: c(9.0, 134.0), centred: Some(c(9.0, 40.0)) });
    assert_eq!(chosen(&fit, &judge, &terms, 1, c(9.0, 40.0)), [0, 2]);
    assert_eq!(chosen(&fit, &judge, &terms, 1, c(9.0, 40.0).next_up()), [0, 1, 2]);
    assert_eq!(chosen(&fit, &Judge::new(fit.clone()), &terms, 1, 70.0), [0]);
    // No spread to explain.
    let flat = Judge::new(fit.clone()).about_the_mean(Dd::ZERO);
    assert_eq!(climbed(&fit, &flat, &terms, 1, 70.0).0.unwrap().centred, None);
}

#[test]
fn without_arrival_the_least_error_of_the_judging_rows_stands() {
    // Fitted: 10, 4, 3, 2. Judged: with the second the error falls by 16 to 13, with the third it rises, with the fourth it falls by 4, below
    // neither.
    let fit = units(4, &[], &[10.0, 4.0, 3.0, 2.0, 0.0]);
    let judge = Judge::new(units(4, &[], &[10.0, 4.0, -3.0, 2.0, 0.0]));
    let (climb, heard) = climbed(&fit, &judge, &orders(&[0, 1, 1, 1]), 1, 99.9);
    let whole = 129.0;
    assert_eq!(climb.unwrap(), LadderModel { chosen: vec![0, 1], confidence: c(13.0, whole), centred: None });
    assert_eq!(heard.iter().map(|heard| heard.2).collect::<Vec<_>>(), [29.0, 13.0, 40.0, 36.0].map(|left| c(left, whole)));
}

#[test]
fn a_gain_of_rounding_is_none() {
    // The last term leaves so much less on the rows that judge than the model before it.
    let of = |gain: Dd| {
        let rows = 4;
        let unit = |place: usize| (0..rows).map(|k| Dd::from(f64::from(u8::from(k == place)))).collect::<Vec<Dd>>();
        let columns = |last: Vec<Dd>| triangle(&[unit(0), unit(1), last]);
        let response = vec![Dd::from(2.0), gain.sqrt(), Dd::ZERO, Dd::ZERO];
        // What is left of the constant: 1 with the part of the second term.
        let judged = vec![Dd::from(2.0), gain.sqrt(), (Dd::ONE - gain).sqrt(), Dd::ZERO];
        chosen(&columns(response), &Judge::new(columns(judged)), &orders(&[0, 1]), 1, 99.0)
    };
    assert_eq!(of(Dd::from(1.5e-9)), [0, 1]);
    assert_eq!(of(Dd::from(0.5e-9)), [0]);
    // 1 - 1e-9 in f64 is left: the limit itself.
    assert_eq!(of(Dd::ONE - Dd::from(1.0 - 1e-9)), [0]);
}

#[test]
fn a_row_stays_for_the_residual() {
    let of = |rows: usize| {
        let response: Vec<f64> = (0..rows).map(|k| 5.0 - k as f64).collect();
        let fit = units(4, &[], &response);
        climbed(&fit, &Judge::new(fit.clone()), &orders(&[0, 1, 2, 3]), 3, 100.0).1.last().unwrap().1
    };
    // The lowest orders are asked for independence, so two rows at least.
    assert_eq!([of(2), of(3), of(4), of(5), of(6)], [1, 2, 3, 4, 4]);
    // One row, and one term.
    let one = triangle(&[dd(&[1.0]), dd(&[3.0])]);
    assert_eq!(chosen(&one, &Judge::new(one.clone()), &orders(&[0]), 1, 99.0), [0]);
    assert_eq!(chosen(&one, &Judge::new(one.clone()), &orders(&[1]), 1, 99.0), [0]);
}

#[test]
fn a_surface_without_constant_starts_with_its_largest_term() {
    let fit = units(3, &[], &[1.0, 4.0, 2.0, 0.0]);
    let (climb, heard) = climbed(&fit, &Judge::new(fit.clone()), &orders(&[2, 2, 3]), 3, c(1.0, 21.0));
    // Both of order 2 are taken before that of order 3, and the third alone is asked when it is open.
    assert_eq!(heard, [(2, 1, c(5.0, 21.0)), (2, 2, c(4.0, 21.0)), (3, 3, c(0.0, 21.0))]);
    // The first is then missed least, just so much.
    assert_eq!(climb.unwrap(), LadderModel { chosen: vec![1, 2], confidence: c(1.0, 21.0), centred: None });
}

#[test]
fn columns_that_make_each_other_up_are_refused_on_the_first_rung_and_passed_over_above() {
    let response = [5.0, 3.0, 2.0, 1.0];
    let twice: &[f64] = &[0.0, 2.0, 0.0, 0.0];
    let fit = units(3, &[twice], &response);
    let judge = Judge::new(fit.clone());
    assert_eq!(climbed(&fit, &judge, &orders(&[0, 1, 2, 1]), 2, 100.0).0.unwrap_err().candidates, [1, 3]);
    let constant = units(2, &[&[3.0, 0.0, 0.0, 0.0]], &response);
    let refused = climbed(&constant, &Judge::new(constant.clone()), &orders(&[0, 1, 1]), 1, 100.0).0.unwrap_err();
    assert_eq!(refused.candidates, [0, 2], "a column that is constant");
    let (climb, heard) = climbed(&fit, &judge, &orders(&[0, 1, 2, 2]), 2, 100.0);
    assert_eq!((climb.unwrap().chosen, heard.len()), (vec![0, 1, 2], 3));
}

#[test]
fn terms_leave_while_c_is_reached_the_least_missed_first() {
    // Of order 1 are the entries 3, 2 and 1, of order 2 is 6: C is reached with all, and then 1 and 2 are not needed, 3 is.
    let response = [10.0, 3.0, 2.0, 1.0, 6.0, 0.0];
    let fit = units(5, &[], &response);
    let terms = orders(&[0, 1, 1, 1, 2]);
    let judge = Judge::new(fit.clone());
    let climb = climbed(&fit, &judge, &terms, 2, c(5.0, 150.0)).0.unwrap();
    assert_eq!(climb, LadderModel { chosen: vec![0, 1, 4], confidence: c(5.0, 150.0), centred: None });
    // With room for one of them only, it is the last.
    assert_eq!(chosen(&fit, &judge, &terms, 2, c(4.0, 150.0)), [0, 1, 2, 4]);
    // The constant is not asked, however little it gives.
    let small = units(3, &[], &[0.5, 1.0, 6.0, 0.0]);
    let (climb, heard) = climbed(&small, &Judge::new(small.clone()), &orders(&[0, 1, 2]), 2, c(1.5, 37.25));
    assert_eq!(climb.unwrap().chosen, [0, 2]);
    assert_eq!(heard[0], (1, 1, c(37.0, 37.25)), "and it comes first");
}

#[test]
fn one_term_takes_the_place_of_two_where_it_does_as_well() {
    // (0, 1, 1, 0) of order 2 does what the second and the third do together; a longer one of the same direction does as well and comes after it.
    let response = [10.0, 4.0, 4.0, 1.0, 0.0, 0.0];
    let (both, longer): (&[f64], &[f64]) = (&[0.0, 1.0, 1.0, 0.0, 0.0, 0.0], &[0.0, 2.0, 2.0, 0.0, 0.0, 0.0]);
    let fit = units(4, &[both, longer], &response);
    let terms = orders(&[0, 1, 1, 1, 2, 2]);
    let judge = Judge::new(fit.clone());
    let climb = climbed(&fit, &judge, &terms, 2, c(1.0, 133.0)).0.unwrap();
    assert_eq!(climb, LadderModel { chosen: vec![0, 4], confidence: c(1.0, 133.0), centred: None });
    // With the fourth entry needed too, the one comes behind it in the climb, and is sorted.
    assert_eq!(chosen(&fit, &judge, &terms, 2, 100.0), [0, 3, 4]);
    // Where parts are left out in turn it is not tried. Without order 2 the two stay.
    let left_out = Judge::left_out(vec![(fit.clone(), fit.clone())]);
    assert_eq!(chosen(&fit, &left_out, &terms, 2, c(1.0, 133.0)), [0, 1, 2]);
    // One that does not reach C does not.
    let (weak, alone): (&[f64], &[f64]) = (&[0.0, 1.0, 0.5, 0.0, 0.0, 0.0], &[0.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    let fit = units(4, &[weak, alone], &response);
    assert_eq!(chosen(&fit, &Judge::new(fit.clone()), &terms, 2, c(1.0, 133.0)), [0, 1, 2]);
}

#[test]
fn the_first_of_the_terms_may_take_the_place_of_two() {
    // Without a constant. Fitted: (4, 1), of which the first term, of order 2, gets 2.5 of (1, 1). Judged: (2.5, 2.5), of which it leaves nothing,
    // the other two (-1.5, 1.5).
    let rows = |response: &[f64]| triangle(&[dd(&[1.0, 1.0, 0.0]), dd(&[1.0, 0.0, 0.0]), dd(&[0.0, 1.0, 0.0]), dd(response)]);
    let (fit, judge) = (rows(&[4.0, 1.0, 0.0]), Judge::new(rows(&[2.5, 2.5, 0.0])));
    let (climb, heard) = climbed(&fit, &judge, &orders(&[2, 1, 1]), 2, c(4.5, 12.5));
    assert_eq!(heard, [(1, 1, c(8.5, 12.5)), (1, 2, c(4.5, 12.5))]);
    assert_eq!(climb.unwrap(), LadderModel { chosen: vec![0], confidence: 100.0, centred: None });
}

#[test]
fn after_an_exchange_terms_leave_again() {
    // 4, 3 and 2 of order 1, and one of order 2 that does what the first two do and a part of the third: it takes the place of two, and then the
    // third is not needed.
    let response = [10.0, 4.0, 3.0, 2.0, 0.0, 0.0];
    let most: &[f64] = &[0.0, 4.0, 3.0, 1.5, 0.0, 0.0];
    let fit = units(4, &[most], &response);
    let judge = Judge::new(fit.clone());
    // All three are needed for less than 4; most with its coefficient 28/27.25 leaves 29 - 28^2/27.25 = 0.229.
    let climb = climbed(&fit, &judge, &orders(&[0, 1, 1, 1, 2]), 2, c(0.5, 129.0)).0.unwrap();
    assert_eq!(climb.chosen, [0, 4]);
    let left = 29.0 - 28.0 * 28.0 / 27.25;
    assert!((climb.confidence - c(left, 129.0)).abs() < 1e-12, "{climb:?}");
    // The least missed first, here too: 6, 4, 3, 1.75 and 1.5 of order 1, and one of order 2 for 4, 3 and what nothing else explains, 2. With it one
    // of the last two is not needed.
    let response = [10.0, 6.0, 4.0, 3.0, 1.75, 1.5, 2.0, 0.0];
    let most: &[f64] = &[0.0, 0.0, 4.0, 3.0, 0.0, 0.0, 2.0, 0.0];
    let fit = units(6, &[most], &response);
    let whole = response.iter().map(|y| y * y).sum::<f64>();
    assert_eq!(chosen(&fit, &Judge::new(fit.clone()), &orders(&[0, 1, 1, 1, 1, 1, 2]), 2, c(4.5, whole)), [0, 1, 4, 6]);
}

#[test]
fn large_models_are_left_without_exchange() {
    // The constant, `count` terms of order 1, and one of order 2 that does what the last two do.
    let of = |count: usize| {
        let response: Vec<f64> = (0..count + 3).map(|k| if k <= count { 10.0 } else { 0.0 }).collect();
        let both: Vec<f64> = (0..count + 3).map(|k| if k == count || k + 1 == count { 1.0 } else { 0.0 }).collect();
        let fit = units(count + 1, &[&both], &response);
        let terms: Vec<u32> = (0..count + 2).map(|k| [0, 1, 2][usize::from(k > 0) + usize::from(k > count)]).collect();
        chosen(&fit, &Judge::new(fit.clone()), &orders(&terms), 2, 100.0).len()
    };
    assert_eq!([of(10), of(11), of(12)], [10, 11, 13]);
}

#[test]
fn parts_that_are_left_out_judge_together() {
    // Two parts: what is fitted without each, and its own rows. Each climbs by its own gains.
    let fit = units(3, &[], &[10.0, 4.0, 3.0, 0.0]);
    let terms = orders(&[0, 1, 1]);
    let part = |fitted: &[f64], rows: &[f64]| (units(3, &[], fitted), units(3, &[], rows));
    let parts = vec![part(&[9.0, 4.0, 1.0, 0.0], &[8.0, 4.0, 2.0, 0.0]), part(&[6.0, 1.0, 2.0, 0.0], &[5.0, 2.0, 2.0, 0.0])];
    let judge = Judge::left_out(parts);
    // About zero 84 + 33. With the constants: 1 + 16 + 4 and 1 + 4 + 4. The first then takes its second term, the other its third: 1 + 4 and 1 + 4;
    // at last both have both: 1 + 1 and 1 + 1.
    let whole = 117.0;
    let (climb, heard) = climbed(&fit, &judge, &terms, 1, 99.0);
    assert_eq!(heard, [(1, 1, c(30.0, whole)), (1, 2, c(10.0, whole)), (1, 3, c(4.0, whole))]);
    assert_eq!(climb.unwrap(), LadderModel { chosen: vec![0, 1, 2], confidence: c(4.0, whole), centred: None });
    // Reached at the second step. The ladder's own second term is 4's, with which the second part leaves 1 + 1 + 4.
    let (climb, heard) = climbed(&fit, &judge, &terms, 1, c(11.0, whole));
    assert_eq!((climb.unwrap().chosen, heard.len()), (vec![0, 1], 2));
    // A part whose rows cannot go on ends the climb.
    let short = Judge::left_out(vec![part(&[9.0, 4.0], &[8.0, 4.0, 2.0, 0.0])]);
    let (climb, heard) = climbed(&fit, &short, &terms, 1, 99.9);
    assert_eq!((climb.unwrap().chosen, heard.len()), (vec![0], 1));
}

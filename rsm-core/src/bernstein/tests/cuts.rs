//! Tests of the cells that a search divides, their order, and the work: counted by hand.

use super::*;

/// (t - 1/3)^2 + c over [0, 1]: its coefficients are 1/9, -2/9, 4/9 (plus c). In a cell of width w that contains 1/3, this point is at a third of the
/// width. So the smallest computed value there is w^2/9, and the smallest coefficient is -2 w^2/9, which is w^2/3 less. All other cells are above 0.
/// So one cell of each width is divided, and each division costs 4 * 3 coefficients times 3.
fn cell_of_a_third(c: f64) -> Cell {
    Cell::new(&[&[monomial(&[2], 1.0), monomial(&[1], -2.0 / 3.0), monomial(&[0], 1.0 / 9.0 + c)]], &[Interval::new(0.0, 1.0)])
}

fn cuts_of_a_third(c: f64, enough: f64, budget: usize) -> usize {
    let (_, work) = search_within(&cell_of_a_third(c), &Value, &[], &Search { enough, ..WHOLE_BOX }, budget);
    assert!(work.is_multiple_of(36));
    work / 36
}

#[test]
fn no_cell_is_cut_more_than_the_enclosure_needs() {
    let cuts = |c, enough| cuts_of_a_third(c, enough, BUDGET);
    // w^2/3 <= 10^-9 of a spread of 2/3: 4^-15 = 9.3 10^-10 is below 2 10^-9, 4^-14 = 3.7 10^-9 is not.
    assert_eq!(cuts(0.0, f64::INFINITY), 15);
    // For large values the limit is 10^-12: w^2/3 <= 10^-6, and 4^-10 = 9.5 10^-7 is below 3 10^-6, 4^-9 = 3.8 10^-6 is not.
    assert_eq!([cuts(1e6, f64::INFINITY), cuts(-1e6, f64::INFINITY)], [10, 10]);
    // The minimum is c below `enough`: w^2/3 <= (c - w^2/9)/4, so w^2 <= 9/13 c = 0.9 4^-4.
    let c = 0.9 / 256.0 * 13.0 / 9.0;
    assert_eq!([cuts(-c, 0.0), cuts(2.0 - c, 2.0), cuts(-3.0 - c, -3.0)], [5; 3]);
    // Just deep enough: the smallest computed value is below `enough` by exactly four times the excess of the enclosure.
    let mut is_exact = 0;
    for c in 0..40 {
        let c = f64::from(c) / 64.0;
        let whole = cell_of_a_third(c);
        let seen = whole.coefficients[0].high;
        let missing = seen - whole.bounds().low;
        let enough = seen + 4.0 * missing;
        if enough - seen == 4.0 * missing {
            is_exact += 1;
            assert_eq!(cuts(c, enough), 0, "{c}");
        }
    }
    assert!(is_exact > 4, "{is_exact}");
    // The root's own bound is just enough.
    let whole = cell_of_a_third(0.0).bounds();
    assert_eq!(cuts(0.0, whole.low), 0);
    assert!(cuts(0.0, whole.low.next_up()) > 0);
    // Proof that the minimum 1/256 is above 0: -2 w^2/9 >= -1/256 for w = 1/8.
    assert_eq!(cuts(1.0 / 256.0, 0.0), 3);
    // The first cut is made with any budget; another one is made while the budget is not exceeded.
    assert_eq!([0, 35, 36, 71, 72].map(|budget| cuts_of_a_third(0.0, f64::INFINITY, budget)), [1, 1, 2, 2, 3]);
}

#[test]
fn what_no_cut_improves_is_not_cut() {
    let side = Interval::new(-1.0, 1.0);
    let work = |terms: &[Monomial], sides: &[Interval]| {
        let (found, work) = search_within(&Cell::new(&[terms], sides), &Value, &[], &WHOLE_BOX, BUDGET);
        (found.bound, work)
    };
    // The polynomial is zero, although it is of second degree.
    assert_eq!(work(&[monomial(&[2, 2], 0.0)], &[side, side]), (0.0, 0));
    // Linear along each side, with coefficients that cancel: of 10^16 (x - y) only the outward rounding by 1 or 2 remains.
    let terms = [monomial(&[1, 0], 1e16), monomial(&[0, 1], -1e16), monomial(&[1, 1], 1.0)];
    let around = Interval::new(1.0, 1.0 + 1e-15);
    assert_eq!(work(&terms, &[around, around]).1, 0);
    // Beyond the largest number there is no bound, and division does not give one.
    let huge = [monomial(&[2], -1e308), monomial(&[1], 1e308)];
    assert_eq!(work(&huge, &[Interval::new(0.0, 1e10)]), (f64::NEG_INFINITY, 0));
}

#[test]
fn a_search_spends_its_budget() {
    // A valley along the diagonal: (x - y)^2 as a polynomial of degree 20. The proof would need more cells than the budget allows.
    let terms = [
        monomial(&[2, 0], 1.0),
        monomial(&[1, 1], -2.0),
        monomial(&[0, 2], 1.0),
        monomial(&[20, 0], 0.0),
        monomial(&[0, 20], 0.0),
    ];
    let sides = [Interval::new(-1.0, 1.3), Interval::new(-0.9, 1.2)];
    let root = Cell::new(&[&terms[..]], &sides);
    let [once, twice] = [1, 2].map(|times| {
        let (found, work) = search_within(&root, &Value, &[], &WHOLE_BOX, times * BUDGET);
        let of_one_cut = 4 * 21 * 21 * 21;
        assert!(work > times * BUDGET && work <= times * BUDGET + of_one_cut);
        found
    });
    assert!(once.bound < twice.bound && twice.bound <= 0.0, "{once:?} {twice:?}");
    assert_eq!(least(&terms, &sides, &WHOLE_BOX), once);
    assert_eq!(extent(&terms, &sides).range.low, once.bound);
    assert_eq!(least_measure(&[terms.to_vec()], &sides, &Value, &WHOLE_BOX), once);
    assert_eq!(BUDGET, 20_000_000, "a tenth of a second");
}

#[test]
fn the_bend_of_a_side_is_its_largest_second_difference() {
    // -3 x^2 + 2 x^2 y + x y + 5 z^3 over [0, 2] x [0, 1]^2: the second difference along x is (2 y - 3) 4; along z the coefficients are 0, 0, 0, 5.
    let terms: [([u32; 3], f64); 4] = [([2, 0, 0], -3.0), ([2, 1, 0], 2.0), ([1, 1, 0], 1.0), ([0, 0, 3], 5.0)];
    let sides = [Interval::new(0.0, 2.0), Interval::new(0.0, 1.0), Interval::new(0.0, 1.0)];
    for order in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
        let ordered: Vec<Monomial> =
            terms.iter().map(|(powers, coefficient)| monomial(&order.map(|k| powers[k]), *coefficient)).collect();
        let cell = Cell::new(&[&ordered[..]], &order.map(|k| sides[k]));
        for (axis, k) in order.into_iter().enumerate() {
            // Outward rounding changes coefficients of up to 12 by a few units in the last place.
            let (found, expected) = (cell.bend(axis), [12.0, 0.0, 5.0][k]);
            assert!((found - expected).abs() < 1e-13, "{found} along {k} of {order:?}");
        }
    }
}

#[test]
fn the_side_that_is_bent_most_is_halved_and_at_an_edge_the_longest() {
    // x^2 + y^2/15: second differences along x are 1, 1/4, 1/16, ..., along y 1/15, 1/60, ...
    let terms = [monomial(&[2, 0], 1.0), monomial(&[0, 2], 1.0 / 15.0)];
    let side = Interval::new(0.0, 1.0);
    let mut cell = Cell::new(&[&terms[..]], &[side, side]);
    let mut of_a_partly = Cell { is_partly: true, ..cell.clone() };
    for (bent, longest) in [(0, 0), (0, 1), (1, 0), (0, 1), (1, 0), (0, 1)] {
        assert_eq!([cell.better_cut(0, 1), cell.better_cut(1, 0)], [bent; 2], "{:?}", cell.spans);
        cell = cell.halved(bent).0;
        assert_eq!(of_a_partly.better_cut(0, 1), longest);
        of_a_partly = of_a_partly.halved(longest).1;
    }
    // Of equal sides the first is cut; with equal second differences the longer one.
    let flat = Cell::new(&[&[monomial(&[2, 2], 0.0)]], &[side, side]);
    assert_eq!([flat.better_cut(0, 1), flat.better_cut(1, 0)], [0, 1]);
    let flat = flat.halved(0).0;
    assert_eq!([flat.better_cut(0, 1), flat.better_cut(1, 0)], [1, 1]);
}

#[test]
fn the_edge_of_a_region_is_cut_down_to_the_finest_cell() {
    // -x where x < 0.7. [0, 1] and [1/2, 1] are divided; [1/2, 3/4] has the finest size and counts as inside, [3/4, 1] is outside.
    let place = |cell: &[[f64; 2]]| match (cell[0][1] < 0.7, cell[0][0] < 0.7) {
        (true, _) => Place::Inside,
        (_, true) => Place::Partly,
        _ => Place::Outside,
    };
    let wanted = Search { place: &place, spaces: &[], finest: 0.25, enough: f64::INFINITY };
    let side = Interval::new(0.0, 1.0);
    let (found, work) = search_within(&Cell::new(&[&[monomial(&[1], -1.0)]], &[side]), &Value, &[], &wanted, BUDGET);
    assert_eq!((found.at, work), (vec![0.75], 2 * 4 * 2 * 2));
    assert!((found.bound + 0.75).abs() < 1e-15 && found.seen >= -0.75, "{} {}", found.bound, found.seen);
    // A second side on which only the region depends is divided too: x, y, x of both halves, y of one more. Then the smallest value is known.
    let (found, work) = search_within(&Cell::new(&[&[monomial(&[1, 0], -1.0)]], &[side, side]), &Value, &[], &wanted, BUDGET);
    assert_eq!((found.at[0], work), (0.75, 5 * 4 * 2 * 2));
    // With half of the finest size: 0.7 is in [5/8, 3/4], which has the finest size.
    let finer = Search { finest: 0.125, ..wanted };
    let (found, work) = search_within(&Cell::new(&[&[monomial(&[1], -1.0)]], &[side]), &Value, &[], &finer, BUDGET);
    assert_eq!((found.at, work), (vec![0.75], 3 * 4 * 2 * 2));
}

#[test]
fn a_region_that_turns_out_to_be_empty_has_no_least_value() {
    let place = |cell: &[[f64; 2]]| if cell[0][1] - cell[0][0] > 0.3 { Place::Partly } else { Place::Outside };
    let wanted = Search { place: &place, spaces: &[], finest: 0.01, enough: 0.0 };
    let (found, work) =
        search_within(&Cell::new(&[&[monomial(&[1], -1.0)]], &[Interval::new(0.0, 1.0)]), &Value, &[], &wanted, BUDGET);
    assert_eq!(found, Least { bound: f64::INFINITY, seen: f64::INFINITY, at: vec![0.5] });
    assert_eq!(work, 3 * 4 * 2 * 2);
}

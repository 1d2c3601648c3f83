//! Lists in the order of their numbers, and the ends of lists of numbers.
//!
//! In: a list, and a number for each element. Out: the list in order, or its ends. All lists with numbers share one sort, which the compiler makes
//! once: with a comparison of its own, each list has a sort of its own, and these were an eighth of the code of rsm-fit and rsm-diagnose.

use std::borrow::Borrow;

/// Sorts numbers, smallest first. `-0` comes before `+0`, and NaN after infinity, or before minus infinity if its sign is set (the total order of
/// IEEE 754).
///
/// ```
/// let mut torques = [0.3, -1.0, 0.1]; // N m
/// rsm_core::order::sort(&mut torques);
/// assert_eq!(torques, [-1.0, 0.1, 0.3]);
/// ```
pub fn sort(numbers: &mut [f64]) {
    numbers.sort_unstable_by(f64::total_cmp);
}

/// Sorts a list by a number of each element, smallest first, in the order of [`sort`]. Elements with the same number stay in their order.
///
/// ```
/// let mut list = ["aaa", "b", "cc", "d"];
/// rsm_core::order::ascending(&mut list, |name| name.len() as f64);
/// assert_eq!(list, ["b", "d", "cc", "aaa"]);
/// ```
pub fn ascending<T>(list: &mut [T], number: impl Fn(&T) -> f64) {
    arrange(list, order_of(list.iter().map(number).collect()));
}

/// Sorts a list by a number of each element, largest first. Elements with the same number stay in their order.
///
/// ```
/// let mut gains = [(0, 2.0), (1, 7.0), (2, 2.0)];
/// rsm_core::order::descending(&mut gains, |it| it.1);
/// assert_eq!(gains, [(1, 7.0), (0, 2.0), (2, 2.0)]);
/// ```
pub fn descending<T>(list: &mut [T], number: impl Fn(&T) -> f64) {
    arrange(list, order_of(list.iter().map(|it| -number(it)).collect()));
}

/// The smallest and the largest number; NaN is passed over. Without a number: infinity and minus infinity.
///
/// ```
/// let voltages = [12.0, f64::NAN, -3.0]; // V
/// assert_eq!(rsm_core::order::ends(&voltages), (-3.0, 12.0));
/// ```
pub fn ends(numbers: impl IntoIterator<Item = impl Borrow<f64>>) -> (f64, f64) {
    let wider = |(low, high): (f64, f64), number: f64| (low.min(number), high.max(number));
    numbers.into_iter().fold((f64::INFINITY, f64::NEG_INFINITY), |ends, number| wider(ends, *number.borrow()))
}

/// The index of the element for each place.
fn order_of(numbers: Vec<f64>) -> Vec<usize> {
    let mut pairs: Vec<(f64, usize)> = numbers.into_iter().zip(0..).collect();
    pairs.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    pairs.into_iter().map(|(_, index)| index).collect()
}

/// Moves each element to its place, one cycle of places after the other.
fn arrange<T>(list: &mut [T], mut order: Vec<usize>) {
    for start in 0..order.len() {
        let mut place = start;
        loop {
            let from = std::mem::replace(&mut order[place], place);
            if from == start {
                break;
            }
            list.swap(place, from);
            place = from;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_has_the_order_of_a_stable_sort() {
        let special = [0.0, -0.0, f64::NAN, -f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 5e-324];
        let mut state = 7_u64;
        let mut next = move |below: u64| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) % below
        };
        for length in 0..80 {
            let list: Vec<(f64, u64)> = (0..length)
                .map(|index| {
                    let number = next(12) as f64 - 6.0;
                    (special.get(next(20) as usize).copied().unwrap_or(number), index)
                })
                .collect();
            let bits = |list: &[(f64, u64)]| list.iter().map(|it| (it.0.to_bits(), it.1)).collect::<Vec<_>>();
            let (mut found, mut expected) = (list.clone(), list.clone());
            ascending(&mut found, |it| it.0);
            expected.sort_by(|a, b| a.0.total_cmp(&b.0));
            assert_eq!(bits(&found), bits(&expected));
            let (mut found, mut expected) = (list.clone(), list.clone());
            descending(&mut found, |it| it.0);
            expected.sort_by(|a, b| b.0.total_cmp(&a.0));
            assert_eq!(bits(&found), bits(&expected));
            let mut numbers: Vec<f64> = list.iter().map(|it| it.0).collect();
            sort(&mut numbers);
            assert!(numbers.windows(2).all(|pair| pair[0].total_cmp(&pair[1]).is_le()));
        }
    }
}

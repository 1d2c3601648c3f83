//! Rows with equal keys, such as rows at one point.
//!
//! In: a hash of the key of each row, and whether two rows have equal keys. Out: for each row the first row with its key; groups of rows. The time is
//! linear in the number of rows. Equal hashes of different keys change the time only, never a result.

/// Groups of rows, in the order of their first rows. Within a group, rows are in their order.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Groups {
    /// The rows, group by group.
    rows: Vec<usize>,
    /// Where each group begins in `rows`, and their number.
    starts: Vec<usize>,
}

impl Groups {
    /// The groups of rows whose numbers are equal. The number of a row is at most that of the row, and that of a first row is its own.
    pub(crate) fn of_firsts(firsts: &[usize]) -> Self {
        let mut group_of = vec![0; firsts.len()];
        let mut starts = vec![0];
        for (row, first) in firsts.iter().enumerate() {
            if *first == row {
                group_of[row] = starts.len() - 1;
                starts.push(0);
            } else {
                group_of[row] = group_of[*first];
            }
            starts[group_of[row] + 1] += 1;
        }
        Self::filled(&group_of, starts)
    }

    /// The groups `0..count` of given numbers, in the order of the numbers; some may be empty.
    pub(crate) fn of_numbers(numbers: &[usize], count: usize) -> Self {
        let mut starts = vec![0; count + 1];
        for number in numbers {
            starts[number + 1] += 1;
        }
        Self::filled(numbers, starts)
    }

    /// `starts`: the size of each group, one place further.
    fn filled(group_of: &[usize], mut starts: Vec<usize>) -> Self {
        for group in 1..starts.len() {
            starts[group] += starts[group - 1];
        }
        let mut next = starts.clone();
        let mut rows = vec![0; group_of.len()];
        for (row, group) in group_of.iter().enumerate() {
            rows[next[*group]] = row;
            next[*group] += 1;
        }
        Groups { rows, starts }
    }

    /// The number of groups.
    pub(crate) fn count(&self) -> usize {
        self.starts.len() - 1
    }

    /// The rows of a group.
    pub(crate) fn get(&self, group: usize) -> &[usize] {
        &self.rows[self.starts[group]..self.starts[group + 1]]
    }

    /// All groups.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &[usize]> {
        (0..self.count()).map(|group| self.get(group))
    }
}

/// Mixes a number into a hash: a multiplication by 2^64 over the golden ratio (Knuth, The Art of Computer Programming 3, 6.4), and the higher half
/// of the bits added to the lower one, which alone choose a place.
pub(crate) fn mixed(hash: u64, value: u64) -> u64 {
    let product = (hash.rotate_left(5) ^ value).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    product ^ (product >> 32)
}

/// For each row the first row with an equal key, by a table with linear probing that is at most 4/5 full.
pub(crate) fn firsts(rows: usize, hash: impl Fn(usize) -> u64, is_equal: impl Fn(usize, usize) -> bool) -> Vec<usize> {
    let places = (rows + rows / 4 + 1).next_power_of_two();
    // The higher half of the hash, and the row plus one; 0 is free.
    let mut table = vec![0u64; places];
    let mut firsts = Vec::with_capacity(rows);
    for row in 0..rows {
        let hash = hash(row);
        let own = (hash & !LOWER) | (u64::from(u32::try_from(row).expect("fewer than 2^32 - 1 rows")) + 1);
        let mut place = hash as usize & (places - 1);
        loop {
            let found = table[place];
            if found == 0 {
                table[place] = own;
                firsts.push(row);
                break;
            }
            let other = (found & LOWER) as usize - 1;
            if (found ^ own) & !LOWER == 0 && is_equal(row, other) {
                firsts.push(other);
                break;
            }
            place = (place + 1) & (places - 1);
        }
    }
    firsts
}

const LOWER: u64 = u32::MAX as u64;

/// For each row the first row with equal values in all columns. Both zeros are equal.
pub(crate) fn firsts_of_columns(rows: usize, columns: &[&[f64]]) -> Vec<usize> {
    // + 0.0 makes both zeros equal.
    let bits = |column: &[f64], row: usize| (column[row] + 0.0).to_bits();
    let hash = |row: usize| columns.iter().fold(1, |hash, column| mixed(hash, bits(column, row)));
    firsts(rows, hash, |row, other| columns.iter().all(|column| bits(column, row) == bits(column, other)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn rows_have_the_first_row_with_their_key_whatever_the_hash() {
        let mut random = Random::new(5);
        for rows in [0, 1, 7, 500, 3000] {
            let keys: Vec<u64> = (0..rows).map(|_| random.below(700)).collect();
            let expected: Vec<usize> = keys.iter().map(|key| keys.iter().position(|other| other == key).unwrap()).collect();
            let good = |row: usize| mixed(1, keys[row]);
            assert_eq!(firsts(rows, good, |a, b| keys[a] == keys[b]), expected);
            // Most hashes are equal.
            assert_eq!(firsts(rows, |row| keys[row] % 3, |a, b| keys[a] == keys[b]), expected);
            let groups = Groups::of_firsts(&expected);
            let distinct: Vec<usize> = (0..rows).filter(|row| expected[*row] == *row).collect();
            assert_eq!(groups.iter().map(|group| group[0]).collect::<Vec<_>>(), distinct);
            assert!(groups.iter().all(|group| group.is_sorted() && group.iter().all(|row| expected[*row] == group[0])));
            assert_eq!(groups.iter().map(<[usize]>::len).sum::<usize>(), rows);
            let numbers: Vec<usize> = keys.iter().map(|key| *key as usize % 10).collect();
            let groups = Groups::of_numbers(&numbers, 11);
            assert!(groups.count() == 11 && groups.get(10).is_empty());
            assert!(
                groups.iter().enumerate().all(|(k, group)| group.is_sorted() && group.iter().all(|row| numbers[*row] == k))
            );
        }
        let columns: [&[f64]; 2] = [&[0.0, -0.0, 1.0, 1.0], &[2.0, 2.0, 2.0, 0.0]];
        assert_eq!(firsts_of_columns(4, &columns), [0, 0, 2, 3]);
    }
}

//! Every combination of the strongest causes, for a report in which a reader switches causes on and off.
//!
//! In: names of causes, and the outputs of a model with some of them. Out: [`Combinations`]. Never chooses a cause.

/// The largest number of causes to combine. Four causes have 16 combinations; a fifth, weaker cause changes little.
pub(crate) const MOST: usize = 4;

/// The outputs of a model for each combination of some causes. All other causes stay in the model.
#[derive(Debug, Clone, PartialEq)]
pub struct Combinations<T> {
    /// The causes, the strongest first: at most four.
    pub causes: Vec<String>,
    /// One entry for each set of causes. The index is the set as bits; the first cause is the lowest bit. `None` where the model cannot be simulated.
    pub of: Vec<Option<T>>,
}

impl<T> Default for Combinations<T> {
    fn default() -> Self {
        Combinations { causes: Vec::new(), of: Vec::new() }
    }
}

impl<T> Combinations<T> {
    /// Evaluates each combination. The result is empty if there are no causes. The argument of `with` says for each cause whether it is in the model.
    pub(crate) fn of(causes: Vec<String>, mut with: impl FnMut(&[bool]) -> Option<T>) -> Self {
        if causes.is_empty() {
            return Self::default();
        }
        let is_in = |set: usize| (0..causes.len()).map(|cause| set >> cause & 1 == 1).collect::<Vec<bool>>();
        let of = (0..1 << causes.len()).map(|set| with(&is_in(set))).collect();
        Combinations { causes, of }
    }

    /// The names of the causes of a combination.
    pub fn names(&self, set: usize) -> Vec<&str> {
        self.causes.iter().enumerate().filter(|(cause, _)| set >> cause & 1 == 1).map(|it| it.1.as_str()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_combination_stands_at_the_bits_of_its_causes() {
        let told = Combinations::of(vec!["a".to_string(), "b".to_string()], |is_in| is_in[1].then(|| is_in.to_vec()));
        assert_eq!(told.of, [None, None, Some(vec![false, true]), Some(vec![true, true])]);
        assert_eq!([told.names(0).len(), told.names(3).len()], [0, 2]);
        assert_eq!(told.names(2), ["b"]);
        assert_eq!(Combinations::of(Vec::new(), |_| Some(1)), Combinations::default());
    }
}

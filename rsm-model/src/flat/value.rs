//! Values of expressions while they are translated: arrays of scalar expressions, with a type.

use crate::expression::Id;

use super::Basic;

/// A scalar (no sizes) or an array, row by row.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Value {
    pub(crate) sizes: Vec<usize>,
    pub(crate) items: Vec<Id>,
    pub(crate) basic: Basic,
}

impl Value {
    pub(crate) fn scalar(item: Id, basic: Basic) -> Self {
        Value { sizes: Vec::new(), items: vec![item], basic }
    }

    pub(super) fn is_scalar(&self) -> bool {
        self.sizes.is_empty()
    }

    /// The item, if the value is a scalar.
    pub(crate) fn item(&self) -> Option<Id> {
        if self.is_scalar() { self.items.first().copied() } else { None }
    }

    /// The sizes in words, for messages.
    pub(crate) fn shape(&self) -> String {
        shape(&self.sizes)
    }
}

/// Sizes in words, for messages.
pub(super) fn shape(sizes: &[usize]) -> String {
    match sizes {
        [] => "a scalar".to_string(),
        [n] => format!("a vector of {n}"),
        [n, m] => format!("a matrix of {n} by {m}"),
        more => format!("an array of sizes {more:?}"),
    }
}

impl Basic {
    /// The name in the language.
    pub(super) fn word(self) -> &'static str {
        match self {
            Basic::Real => "Real",
            Basic::Integer => "Integer",
            Basic::Boolean => "Boolean",
        }
    }

    /// Whether a value of type `found` is allowed where this type is expected.
    pub(super) fn takes(self, found: Basic) -> bool {
        self == found || (self == Basic::Real && found == Basic::Integer)
    }
}

/// Every index of an array of some sizes, from 1, in the order of its items.
pub(super) fn indices(sizes: &[usize]) -> Vec<Vec<usize>> {
    let mut all = vec![Vec::new()];
    for size in sizes {
        all = all
            .into_iter()
            .flat_map(|head| {
                (1..=*size).map(move |index| {
                    let mut longer = head.clone();
                    longer.push(index);
                    longer
                })
            })
            .collect();
    }
    all
}

//! The plants that come with the project, as texts.
//!
//! Equations of `docs/book/src/reference/plants.md`, section 2. Parameter values are those of the shipped plant files, for parameters that the user's
//! file does not give.

use rsm_core::source::Source;

/// A name, and the text of that name.
const TEXTS: [(&str, &str); 3] = [
    ("pmac", include_str!("../models/pmac.mo")),
    ("driveline", include_str!("../models/driveline.mo")),
    ("servo-axis", include_str!("../models/servo-axis.mo")),
];

/// The names of the plants.
pub fn names() -> impl Iterator<Item = &'static str> {
    TEXTS.iter().map(|(name, _)| *name)
}

/// The text of a plant.
///
/// ```
/// use rsm_model::{flat::{Flat, Options}, shipped};
///
/// let flat = Flat::read(&shipped::text("pmac").expect("a shipped plant"), &Options::default())?;
/// assert_eq!(flat.name, "Pmac");
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
#[must_use]
pub fn text(name: &str) -> Option<Source> {
    TEXTS.iter().find(|(known, _)| *known == name).map(|(name, text)| Source::new(format!("rsm:{name}"), *text))
}

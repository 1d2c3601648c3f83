//! A model during its check, with the positions of its parts in the text.
//!
//! In: a model, its text. Out: [`Context`], and faults at positions. Contains no rule about a part.

use crate::model::Model;
use crate::places::Places;
use crate::source::{Collector, Fault, Source};

/// A model during the check.
pub(super) struct Context<'a> {
    pub(super) model: &'a Model,
    /// Its name in messages.
    pub(super) file: &'a str,
    /// Its text and the positions of its parts; `None` for a model that was made in memory.
    pub(super) text: Option<(&'a Source, &'a Places)>,
}

impl Context<'_> {
    pub(super) fn fault(&self, path: &str, what: impl Into<String>) -> Fault {
        match self.text {
            Some((source, places)) => source.fault(places.place(path), what),
            None => Fault::whole_file(self.file, what),
        }
    }

    /// Whether a part is in the file but has a wrong shape.
    pub(super) fn is_broken(&self, path: &str) -> bool {
        self.text.is_some_and(|(_, places)| places.is_broken(path))
    }

    /// Whether a required key is missing.
    pub(super) fn is_missing(&self, path: &str) -> bool {
        self.text.is_some_and(|(_, places)| places.place(path) == (0..0))
    }

    /// Whether a missing name can be reported: its section could be read, and the entry does not have a wrong shape.
    pub(super) fn knows_all(&self, section: &str, name: &str) -> bool {
        let read = !self.is_missing(section) && !self.is_broken(section);
        let refused = self.is_broken(&format!("{section}.{name}"));
        // A model without any input is reported only once.
        let nothing_there = section == "inputs" && self.model().inputs.is_empty();
        read && !refused && !nothing_there
    }

    pub(super) fn model(&self) -> &Model {
        self.model
    }
}

/// Whether some entry of a section has a wrong shape.
pub(super) fn any_under(context: &Context<'_>, section: &str) -> bool {
    // A section that is missing or empty has no such entry; other faults report it.
    context.is_missing(section) || context.text.is_some_and(|(_, places)| places.has_broken_under(section))
}

/// low < high, and a width that f64 can represent, because half of it is the unit of the coded variable.
pub(super) fn check_range(
    context: &Context<'_>,
    faults: &mut Collector,
    who: &str,
    path: &str,
    [low, high]: [f64; 2],
    unit: &str,
) {
    let unit = if unit == "1" || unit.is_empty() { String::new() } else { format!(" {unit}") };
    if low > high {
        let fault = context.fault(path, format!("{who}: low {low}{unit} is above high {high}{unit}"));
        faults.push(fault.help(format!("swap them, or give the range as [{high}, {low}]")));
    } else if low == high {
        faults.push(context.fault(path, format!("{who}: the range is empty: low and high are both {low}{unit}")));
    } else if !(high - low).is_finite() {
        faults.push(context.fault(path, format!("{who}: the range from {low:e} to {high:e} is wider than f64 can hold")));
    }
}

//! The positions of the parts of a file, and which parts have a wrong shape.
//!
//! In: the parts that a reader has read. Out: a position for every fault that a rule finds later. Used by all formats of the project. Also reads
//! sections whose keys are free names, and ranges.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use crate::source::{Collector, Source};
use crate::toml_reader::{TableReader, Value};

/// The positions of parts by dotted path, such as `inputs.torque.range`.
#[derive(Debug, Default, Clone)]
pub struct Places {
    spans: BTreeMap<String, Range<usize>>,
    /// The paths of parts with faults. They must not be reported as missing.
    broken: BTreeSet<String>,
}

impl Places {
    /// Records the position of a part.
    pub fn note(&mut self, path: impl Into<String>, span: Range<usize>) {
        self.spans.insert(path.into(), span);
    }

    /// Whether the part itself has a position.
    #[must_use]
    pub fn has(&self, path: &str) -> bool {
        self.spans.contains_key(path)
    }

    /// The position of a part, or of the nearest enclosing part that has one.
    #[must_use]
    pub fn place(&self, path: &str) -> Range<usize> {
        let mut path = path;
        loop {
            if let Some(span) = self.spans.get(path) {
                return span.clone();
            }
            match path.rfind('.') {
                Some(dot) => path = &path[..dot],
                None => return 0..0,
            }
        }
    }

    /// Records that a part has a wrong shape.
    pub fn refuse(&mut self, path: impl Into<String>) {
        self.broken.insert(path.into());
    }

    /// Records that `path.part` has a fault if it could not be read.
    pub fn part<T>(&mut self, path: &str, part: &str, read: Option<T>) -> Option<T> {
        if read.is_none() {
            self.refuse(format!("{path}.{part}"));
        }
        read
    }

    /// Whether a part is present but has a wrong shape.
    #[must_use]
    pub fn is_broken(&self, path: &str) -> bool {
        self.broken.contains(path)
    }

    /// Whether a section or any of its entries has a wrong shape.
    #[must_use]
    pub fn has_broken_under(&self, section: &str) -> bool {
        self.is_broken(section)
            || self.broken.iter().any(|path| path.strip_prefix(section).is_some_and(|rest| rest.starts_with('.')))
    }

    /// Reads the tables of a section whose keys are free names, in the order of the file. `read` gets the path and the name of each. A table that it
    /// cannot read is recorded as having a fault.
    pub fn each_entry<'a>(
        &mut self,
        section: Option<Value<'a>>,
        (key, kind): (&str, &str),
        source: &'a Source,
        faults: &mut Collector,
        mut read: impl FnMut(&str, &str, &mut TableReader<'a>, &mut Places, &mut Collector) -> Option<()>,
    ) {
        let Some(section) = section else { return };
        self.note(key, section.span());
        let Some(entries) = TableReader::of(source, section, format!("`{key}`"), faults) else {
            self.refuse(key);
            return;
        };
        for (name, name_span, value) in entries.entries() {
            let path = format!("{key}.{name}");
            self.note(path.clone(), name_span);
            let whole = TableReader::of(source, value, format!("{kind} `{name}`"), faults).and_then(|mut reader| {
                let made = read(&path, name, &mut reader, self, faults);
                reader.finish(faults);
                made
            });
            if whole.is_none() {
                self.refuse(path);
            }
        }
    }

    /// The range [low, high] of a key: two finite numbers. Rules check their order.
    pub fn range<'a>(
        &mut self,
        path: &str,
        key: &str,
        value: Value<'a>,
        reader: &TableReader<'a>,
        faults: &mut Collector,
    ) -> Option<[f64; 2]> {
        self.note(format!("{path}.{key}"), value.span());
        let numbers = reader.numbers(&format!("`{key}`"), value, faults)?;
        let found = numbers.len();
        let range: Option<[f64; 2]> = numbers.try_into().ok();
        if range.is_none() {
            faults.push(reader.fault(value.span(), format!("`{key}`: found {found} numbers, expected two: [low, high]")));
        }
        range
    }
}

//! Expressions of other files (sites of a plant file, effects) in the names of a flat system.
//!
//! In: an expression with its file. Out: its value in the pool, or faults with lines of that file. A position beyond the end of the model's text
//! belongs to another file.

use std::collections::HashMap;
use std::ops::Range;

use rsm_core::source::{Collector, Fault, Faults, Source};

use crate::syntax::tree::Expression;

use super::translate::Translator;
use super::value::Value;
use super::{Flat, Role, Variable};
use crate::expression::{Id, Symbol};

/// Another file.
#[derive(Debug, Clone)]
pub(super) struct Fragment {
    /// Positions from this one on belong to this file.
    base: usize,
    source: Source,
}

impl Flat {
    /// Adds another file. Returns the offset of its positions.
    pub(crate) fn add_fragment(&mut self, source: &Source) -> usize {
        let known = self.fragments.iter().find(|it| it.source.name() == source.name() && it.source.text() == source.text());
        if let Some(known) = known {
            return known.base;
        }
        let end = |source: &Source, base: usize| base + source.text().len() + 1;
        let base = self.fragments.last().map_or_else(|| end(&self.source, 0), |it| end(&it.source, it.base));
        self.fragments.push(Fragment { base, source: source.clone() });
        base
    }

    fn source_of(&self, offset: usize) -> (&Source, usize) {
        match self.fragments.iter().rfind(|it| it.base <= offset) {
            Some(fragment) => (&fragment.source, fragment.base),
            None => (&self.source, 0),
        }
    }

    /// A fault at a position of the model's text or of another file.
    pub(crate) fn fault(&self, place: &Range<usize>, what: impl Into<String>) -> Fault {
        let (source, base) = self.source_of(place.start);
        source.fault(place.start - base..place.end.max(place.start) - base, what)
    }

    /// The line of a position in its file.
    pub(crate) fn line(&self, place: &Range<usize>) -> usize {
        let (source, base) = self.source_of(place.start);
        source.position(place.start - base).0
    }

    /// The value of an expression of another file. It may use only `names` or, if these are not given, every name of the model.
    ///
    /// # Errors
    /// All faults in it.
    pub(crate) fn expression(
        &mut self,
        source: &Source,
        expression: &Expression,
        names: Option<&HashMap<String, Value>>,
    ) -> Result<Value, Faults> {
        let mut faults = Collector::new();
        let mut translator = Translator::new(source, &mut faults);
        translator.pool = std::mem::take(&mut self.pool);
        translator.variables = std::mem::take(&mut self.variables);
        translator.names = std::mem::take(&mut self.names);
        translator.surfaces = std::mem::take(&mut self.surfaces);
        translator.samples = std::mem::take(&mut self.samples);
        if names.is_none() {
            translator.declared = self.declared.clone();
        }
        if let Some(names) = names {
            translator.scopes.push(super::translate::Scope { values: names.clone(), is_open: true });
        }
        let value = translator.value(expression);
        self.pool = translator.pool;
        self.variables = translator.variables;
        self.names = translator.names;
        self.surfaces = translator.surfaces;
        self.samples = translator.samples;
        faults.finish(value)
    }

    /// Declares another variable. If the name is taken, a number is added to it.
    pub(crate) fn declare(&mut self, name: &str, role: Role, place: Range<usize>) -> Symbol {
        let mut free = name.to_string();
        let mut count = 1;
        while self.names.contains_key(&free) {
            count += 1;
            free = format!("{name} {count}");
        }
        let symbol = Symbol(self.variables.len() as u32);
        self.variables.push(Variable::new(free.clone(), role, super::Basic::Real, place));
        self.names.insert(free, symbol);
        symbol
    }

    /// The scalars of a declared name, with the sizes of an array.
    pub(crate) fn value_of(&mut self, name: &str) -> Option<Value> {
        if let Some(declared) = self.declared.get(name).cloned() {
            let items: Vec<Id> = declared.symbols.iter().map(|symbol| self.pool.symbol(*symbol)).collect();
            return Some(Value { sizes: declared.sizes, items, basic: super::Basic::Real });
        }
        let symbol = self.find(name)?;
        Some(Value::scalar(self.pool.symbol(symbol), super::Basic::Real))
    }
}

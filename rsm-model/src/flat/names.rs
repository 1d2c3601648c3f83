//! Names of a text and their subscripts.

use crate::syntax::tree::{Part, Span, Subscript};

use super::translate::Translator;
use super::value::Value;
use super::{Basic, Role};

impl Translator<'_> {
    /// The joined text of a name whose inner parts may have subscripts, and the subscripts of its last part.
    pub(super) fn joined<'p>(&mut self, parts: &'p [Part]) -> Option<(String, &'p [Subscript])> {
        let mut text = String::new();
        let (last, heads) = parts.split_last()?;
        for part in heads {
            text.push_str(&part.name);
            if !part.subscripts.is_empty() {
                let mut indices = Vec::new();
                for subscript in &part.subscripts {
                    match subscript {
                        Subscript::At(expression) => indices.push(self.whole(expression)?.to_string()),
                        Subscript::All => return None,
                    }
                }
                text.push_str(&format!("[{}]", indices.join(",")));
            }
            text.push('.');
        }
        text.push_str(&last.name);
        Some((text, &last.subscripts))
    }

    pub(super) fn name(&mut self, parts: &[Part], span: &Span) -> Option<Value> {
        let (name, subscripts) = self.joined(parts)?;
        for k in (0..self.scopes.len()).rev() {
            if let Some(value) = self.scopes[k].values.get(&name) {
                let value = value.clone();
                return self.part(value, subscripts, span);
            }
            if !self.scopes[k].is_open {
                // A function may use constants of the package besides its own names.
                let is_constant = self
                    .declared
                    .get(&name)
                    .and_then(|declared| declared.symbols.first())
                    .is_some_and(|symbol| self.variables[symbol.0 as usize].role == Role::Constant);
                if !is_constant {
                    let what = format!("`{name}` is not declared in this function");
                    return self.fault(span, what, "a function can use only its inputs, its own variables and constants");
                }
                break;
            }
        }
        let Some(declared) = self.declared.get(&name).cloned() else {
            let (what, help) = self.unknown(&name);
            return self.fault(span, what, &help);
        };
        let basic = declared.symbols.first().map_or(Basic::Real, |symbol| self.variables[symbol.0 as usize].basic);
        let items = declared.symbols.iter().map(|symbol| self.pool.symbol(*symbol)).collect();
        self.part(Value { sizes: declared.sizes, items, basic }, subscripts, span)
    }

    /// The message for an undeclared name, with a suggestion.
    fn unknown(&self, name: &str) -> (String, String) {
        let inner = self.scopes.iter().flat_map(|scope| scope.values.keys());
        let near = self
            .declared
            .keys()
            .chain(inner)
            .filter(|known| known.eq_ignore_ascii_case(name) || distance(known, name) <= 1 + name.len() / 6)
            .min_by_key(|known| (distance(known, name), (*known).clone()));
        (format!("`{name}` is not declared"), near.map_or_else(String::new, |near| format!("there is `{near}`")))
    }

    /// A part of an array.
    fn part(&mut self, value: Value, subscripts: &[Subscript], span: &Span) -> Option<Value> {
        if subscripts.is_empty() {
            return Some(value);
        }
        if subscripts.len() > value.sizes.len() {
            let what = format!("{} subscripts of {}", subscripts.len(), value.shape());
            return self.fault(span, what, "");
        }
        let mut sizes = Vec::new();
        let mut chosen: Vec<Vec<usize>> = Vec::new();
        for (k, size) in value.sizes.iter().enumerate() {
            match subscripts.get(k) {
                None | Some(Subscript::All) => {
                    sizes.push(*size);
                    chosen.push((0..*size).collect());
                }
                Some(Subscript::At(expression)) => {
                    self.ends.push(*size);
                    let at = self.value(expression);
                    self.ends.pop();
                    let at = at?;
                    let mut places = Vec::new();
                    for item in &at.items {
                        let Some(index) = self.known(*item) else {
                            return self.fault(
                                &expression.span,
                                "a subscript that changes while the model runs is not supported",
                                "write the choice as an if-expression, or as a response surface",
                            );
                        };
                        if index.fract() != 0.0 || index < 1.0 || index > *size as f64 {
                            return self.fault(&expression.span, format!("the subscript is {index}, expected 1 to {size}"), "");
                        }
                        places.push(index as usize - 1);
                    }
                    if !at.is_scalar() {
                        sizes.push(places.len());
                    }
                    chosen.push(places);
                }
            }
        }
        let mut places = vec![0_usize];
        for (k, size) in value.sizes.iter().enumerate() {
            places = places.iter().flat_map(|head| chosen[k].iter().map(move |index| head * size + index)).collect();
        }
        let items = places.into_iter().map(|place| value.items[place]).collect();
        Some(Value { sizes, items, basic: value.basic })
    }
}

/// The edit distance of two names: letters changed, omitted or added.
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, letter) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, other) in b.iter().enumerate() {
            let changed = diagonal + usize::from(letter != *other);
            diagonal = row[j + 1];
            row[j + 1] = changed.min(row[j] + 1).min(row[j + 1] + 1);
        }
    }
    row[b.len()]
}

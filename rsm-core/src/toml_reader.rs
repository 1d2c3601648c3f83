//! Reads a TOML document key by key and collects every fault with its line and column.
//!
//! In: a parsed table with spans. Out: values, and faults in a [`Collector`]. A table reader records the requested keys, and [`TableReader::finish`]
//! reports the others, with the accepted names. Shared by the model file, the fit specification and the plant file, so that all of them report bad
//! input in the same words.

use std::ops::Range;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::source::{Collector, Fault, Source};

/// Parses the text of a source. `None` if it is not valid TOML; then every syntax error is reported.
pub fn parse<'a>(source: &'a Source, faults: &mut Collector) -> Option<Spanned<DeTable<'a>>> {
    let (table, errors) = DeTable::parse_recoverable(source.text());
    for error in &errors {
        let what = error.message().trim().replace('\n', ", ");
        faults.push(source.fault(error.span().unwrap_or(0..0), format!("not valid TOML: {what}")));
    }
    errors.is_empty().then_some(table)
}

/// A value of the document with its position.
pub type Value<'a> = &'a Spanned<DeValue<'a>>;

/// Reads the keys of one table.
pub struct TableReader<'a> {
    source: &'a Source,
    table: &'a DeTable<'a>,
    span: Range<usize>,
    /// The name of this table in messages: `input `torque``, `surface `psi_d``, or empty for the document.
    who: String,
    known: Vec<&'static str>,
}

impl<'a> TableReader<'a> {
    /// A reader of the whole document.
    #[must_use]
    pub fn document(source: &'a Source, table: &'a Spanned<DeTable<'a>>) -> Self {
        TableReader { source, table: table.get_ref(), span: table.span(), who: String::new(), known: Vec::new() }
    }

    /// A reader of a value that must be a table, or `None` and a fault.
    pub fn of(source: &'a Source, value: Value<'a>, who: impl Into<String>, faults: &mut Collector) -> Option<Self> {
        let who = who.into();
        match value.get_ref() {
            DeValue::Table(table) => Some(TableReader { source, table, span: value.span(), who, known: Vec::new() }),
            other => {
                faults.push(source.fault(value.span(), format!("{who}: found {}, expected a table", describe(other))));
                None
            }
        }
    }

    /// The source of this table.
    #[must_use]
    pub fn source(&self) -> &'a Source {
        self.source
    }

    /// The position of the table.
    #[must_use]
    pub fn span(&self) -> Range<usize> {
        self.span.clone()
    }

    /// The name of this table in messages.
    #[must_use]
    pub fn who(&self) -> &str {
        &self.who
    }

    /// `who: ` or empty: the beginning of a message about this table.
    fn prefix(&self) -> String {
        if self.who.is_empty() { String::new() } else { format!("{}: ", self.who) }
    }

    /// A fault at a position in this file, with the name of the table before it.
    #[must_use]
    pub fn fault(&self, span: Range<usize>, what: impl AsRef<str>) -> Fault {
        self.source.fault(span, format!("{}{}", self.prefix(), what.as_ref()))
    }

    /// The value of an optional key.
    pub fn optional(&mut self, key: &'static str) -> Option<Value<'a>> {
        self.known.push(key);
        self.table.get(key)
    }

    /// The value of a required key, or a fault at the table.
    pub fn required(&mut self, key: &'static str, faults: &mut Collector) -> Option<Value<'a>> {
        let found = self.optional(key);
        if found.is_none() {
            faults.push(self.fault(self.span(), format!("`{key}` is missing")));
        }
        found
    }

    /// The position of a key itself.
    #[must_use]
    pub fn key_span(&self, key: &str) -> Range<usize> {
        self.table.get_key_value(key).map_or(self.span(), |(name, _)| name.span())
    }

    /// Every entry of a table whose keys are free names (inputs, surfaces), in the order of the file.
    pub fn entries(&self) -> impl Iterator<Item = (&'a str, Range<usize>, Value<'a>)> {
        self.table.iter().map(|(key, value)| (key.get_ref().as_ref(), key.span(), value))
    }

    /// Reports every key that was not requested, with the accepted ones.
    pub fn finish(self, faults: &mut Collector) {
        for (key, span, _) in self.entries() {
            if !self.known.contains(&key) {
                let accepted = self.known.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
                faults.push(self.fault(span, format!("unknown key `{key}`")).help(format!("accepted here: {accepted}")));
            }
        }
    }

    /// A required text.
    pub fn text(&mut self, key: &'static str, faults: &mut Collector) -> Option<String> {
        let value = self.required(key, faults)?;
        self.as_text(key, value, faults)
    }

    /// An optional text.
    pub fn optional_text(&mut self, key: &'static str, faults: &mut Collector) -> Option<String> {
        let value = self.optional(key)?;
        self.as_text(key, value, faults)
    }

    fn as_text(&self, key: &str, value: Value<'a>, faults: &mut Collector) -> Option<String> {
        match value.get_ref() {
            DeValue::String(text) => Some(text.to_string()),
            other => {
                faults.push(self.fault(value.span(), format!("`{key}`: found {}, expected a text", describe(other))));
                None
            }
        }
    }

    /// An optional choice among fixed words.
    pub fn choice<T: Copy>(&mut self, key: &'static str, options: &[(&str, T)], faults: &mut Collector) -> Option<T> {
        let value = self.optional(key)?;
        let text = self.as_text(key, value, faults)?;
        let found = options.iter().find(|(name, _)| *name == text).map(|(_, option)| *option);
        if found.is_none() {
            let names = options.iter().map(|(name, _)| format!("\"{name}\"")).collect::<Vec<_>>().join(", ");
            faults.push(self.fault(value.span(), format!("`{key}`: found \"{text}\", expected one of {names}")));
        }
        found
    }

    /// A flag: true or false.
    pub fn flag(&self, what: &str, value: Value<'a>, faults: &mut Collector) -> Option<bool> {
        match value.get_ref() {
            DeValue::Boolean(flag) => Some(*flag),
            other => {
                faults.push(self.fault(value.span(), format!("{what}: found {}, expected true or false", describe(other))));
                None
            }
        }
    }

    /// A flag that is false if it is absent.
    pub fn optional_flag(&mut self, key: &'static str, faults: &mut Collector) -> Option<bool> {
        self.optional(key).map_or(Some(false), |value| self.flag(&format!("`{key}`"), value, faults))
    }

    /// A finite number from an integer or a decimal.
    pub fn number(&self, what: &str, value: Value<'a>, faults: &mut Collector) -> Option<f64> {
        match crate::number::from_toml(value.get_ref()) {
            Some(number) if number.is_finite() => Some(number),
            Some(number) => {
                faults.push(self.fault(value.span(), format!("{what}: found {number}, expected a finite number")));
                None
            }
            None => {
                let found = describe(value.get_ref());
                faults.push(self.fault(value.span(), format!("{what}: found {found}, expected a number")));
                None
            }
        }
    }

    /// An integer from `least` to `most`.
    pub fn whole(&self, what: &str, value: Value<'a>, least: i64, most: i64, faults: &mut Collector) -> Option<i64> {
        let found = match value.get_ref() {
            DeValue::Integer(text) => i64::from_str_radix(text.as_str(), text.radix()).ok(),
            _ => None,
        };
        match found {
            Some(number) if (least..=most).contains(&number) => Some(number),
            _ => {
                let found = describe(value.get_ref());
                let what = format!("{what}: found {found}, expected a whole number from {least} to {most}");
                faults.push(self.fault(value.span(), what));
                None
            }
        }
    }

    /// The elements of an array.
    pub fn array(&self, what: &str, value: Value<'a>, faults: &mut Collector) -> Option<Vec<Value<'a>>> {
        match value.get_ref() {
            DeValue::Array(items) => Some(items.iter().collect()),
            other => {
                faults.push(self.fault(value.span(), format!("{what}: found {}, expected an array", describe(other))));
                None
            }
        }
    }

    /// An array of finite numbers.
    pub fn numbers(&self, what: &str, value: Value<'a>, faults: &mut Collector) -> Option<Vec<f64>> {
        let items = self.array(what, value, faults)?;
        let numbers: Vec<_> = items.iter().map(|item| self.number(what, item, faults)).collect();
        numbers.into_iter().collect()
    }

    /// An array of texts.
    pub fn texts(&self, what: &str, value: Value<'a>, faults: &mut Collector) -> Option<Vec<(String, Range<usize>)>> {
        let items = self.array(what, value, faults)?;
        let texts: Vec<_> = items
            .iter()
            .map(|item| match item.get_ref() {
                DeValue::String(text) => Some((text.to_string(), item.span())),
                other => {
                    let what = format!("{what}: found {}, expected a text", describe(other));
                    faults.push(self.fault(item.span(), what));
                    None
                }
            })
            .collect();
        texts.into_iter().collect()
    }
}

/// The description of an unexpected value in a message.
#[must_use]
pub fn describe(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(text) => format!("the text \"{text}\""),
        DeValue::Integer(number) => format!("the number {number}"),
        DeValue::Float(number) => format!("the number {number}"),
        DeValue::Boolean(flag) => format!("{flag}"),
        DeValue::Datetime(when) => format!("the date {when}"),
        DeValue::Array(items) => format!("an array of {}", items.len()),
        DeValue::Table(_) => "a table".to_string(),
    }
}

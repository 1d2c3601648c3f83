//! What a reader sees first: the verdict, three numbers, one plot that shows it.
//!
//! In: words. Out: HTML. Decides nothing.

use super::escaped;

/// How a verdict is coloured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tone {
    /// What was asked for is there.
    Good,
    /// It is there with a reservation.
    Warn,
    /// It is not there.
    Bad,
}

impl Tone {
    fn class(self) -> &'static str {
        match self {
            Tone::Good => "verdict",
            Tone::Warn => "verdict warn",
            Tone::Bad => "verdict bad",
        }
    }
}

/// A number with what it is of and where it is from.
pub struct Number {
    pub of: String,
    pub value: String,
    pub from: String,
}

impl Number {
    pub fn new(of: &str, value: impl Into<String>, from: impl Into<String>) -> Self {
        Number { of: of.to_string(), value: value.into(), from: from.into() }
    }
}

/// The verdict: a word or two of its state, and the sentences, which begin with a capital unless with a name of data (`-` or `_` in its first word).
pub fn verdict(tone: Tone, state: &str, sentences: &str) -> String {
    let first = sentences.split(' ').next().unwrap_or_default();
    let sentences = match sentences.chars().next() {
        Some(letter) if !first.contains(['-', '_']) => format!("{}{}", letter.to_uppercase(), &sentences[letter.len_utf8()..]),
        _ => sentences.to_string(),
    };
    format!("<p class=\"{}\"><span class=\"state\">{}</span> {}</p>\n", tone.class(), escaped(state), escaped(&sentences))
}

/// The numbers in large type.
pub fn numbers(list: &[Number]) -> String {
    let one = |it: &Number| {
        format!(
            "<div><dt>{}</dt><dd class=\"value\">{}</dd><dd class=\"from\">{}</dd></div>\n",
            escaped(&it.of),
            escaped(&it.value),
            escaped(&it.from)
        )
    };
    format!("<dl class=\"numbers\">\n{}</dl>\n", list.iter().map(one).collect::<String>())
}

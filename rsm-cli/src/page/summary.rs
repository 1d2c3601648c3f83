//! The summary of a report: the verdict, three numbers and one plot.
//!
//! In: sentences and numbers. Out: HTML. Decides nothing.

use super::escaped;

/// The colour of a verdict.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tone {
    /// The goal is reached.
    Good,
    /// The goal is reached with a reservation.
    Warn,
    /// The goal is not reached.
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

/// A number with its name and its source.
pub struct Number {
    pub of: String,
    pub value: String,
    pub from: String,
}

impl Number {
    pub fn new(of: &str, value: impl Into<String>, from: impl Into<String>) -> Self {
        Number { of: of.to_string(), value: value.into(), from: from.into() }
    }

    /// The probability of the strongest cause: alone, or together with those that cannot be distinguished from it. The page has `more` further
    /// causes.
    pub fn confidence(label: &str, [own, of_any]: [f64; 2], equals: usize, more: usize) -> Self {
        let below = if more == 0 { String::new() } else { format!("; {more} more below") };
        match equals {
            0 => Number::new("Confidence", format!("{own:.2}"), format!("that {label} is right{below}")),
            _ => Number::new(
                "Confidence",
                format!("{of_any:.2}"),
                format!("that {label} or one of {equals} with the same trace is right; {own:.2} for {label} itself{below}"),
            ),
        }
    }
}

/// The verdict: its state in a word or two, and the sentences. Their first letter becomes a capital, unless the first word is a name of data (with
/// `-` or `_`).
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cause_with_equals_shows_how_probable_they_are_together() {
        let alone = Number::confidence("windage", [0.98, 0.98], 0, 1);
        assert_eq!((alone.value.as_str(), alone.from.as_str()), ("0.98", "that windage is right; 1 more below"));
        let shared = Number::confidence("input-gain", [0.35, 0.98], 2, 0);
        assert_eq!(shared.value, "0.98");
        assert_eq!(shared.from, "that input-gain or one of 2 with the same trace is right; 0.35 for input-gain itself");
    }
}

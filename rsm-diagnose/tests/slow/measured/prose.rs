//! Compares the figures of measured.md with the run that they describe: a sentence is found by its words, and its numbers are compared with the
//! measured values.
//!
//! In: a sentence with `{}` in place of its figures, the measured values in order. Out: nothing, or a failure that prints the correct sentence.

use std::fmt::Write as _;
use std::path::Path;

/// A printed figure: its value and its number of decimals.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Printed {
    value: f64,
    decimals: usize,
}

/// A number at the beginning of a text, and the text after it.
fn printed(text: &str) -> Option<(Printed, &str)> {
    let digits = text.strip_prefix('-').unwrap_or(text);
    let whole = digits.bytes().take_while(u8::is_ascii_digit).count();
    if whole == 0 {
        return None;
    }
    let fraction = digits[whole..].strip_prefix('.').map_or(0, |rest| rest.bytes().take_while(u8::is_ascii_digit).count());
    let length = text.len() - digits.len() + whole + if fraction > 0 { 1 + fraction } else { 0 };
    Some((Printed { value: text[..length].parse().ok()?, decimals: fraction }, &text[length..]))
}

/// The figures at the places `{}` of a sentence; `None` if the text does not contain the sentence.
fn figures(text: &str, sentence: &str) -> Option<Vec<Printed>> {
    let mut parts = sentence.split("{}");
    let first = parts.next().filter(|first| !first.is_empty()).expect("a sentence begins with words");
    let parts: Vec<&str> = parts.collect();
    text.match_indices(first).find_map(|(place, _)| {
        let mut rest = &text[place + first.len()..];
        let mut found = Vec::new();
        for part in &parts {
            let (number, behind) = printed(rest)?;
            found.push(number);
            rest = behind.strip_prefix(part)?;
        }
        Some(found)
    })
}

/// The sentence with these values in place of its figures.
fn filled(sentence: &str, stated: &[Printed], values: &[f64]) -> String {
    let mut parts = sentence.split("{}");
    let mut text = parts.next().unwrap_or_default().to_string();
    for ((part, stated), value) in parts.zip(stated).zip(values) {
        let _ = write!(text, "{value:.*}{part}", stated.decimals);
    }
    text
}

fn is_told(text: &str, sentence: &str, values: &[f64]) -> Result<(), String> {
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    let stated = figures(&text, sentence).ok_or_else(|| format!("measured.md has no sentence \"{sentence}\""))?;
    assert_eq!(stated.len(), values.len(), "a value for each figure of \"{sentence}\"");
    // Half a unit of the last digit is rounding; the other half is a margin for the sine of another library.
    let is_near = |(stated, value): (&Printed, &f64)| (stated.value - value).abs() <= 10_f64.powi(-(stated.decimals as i32));
    if stated.iter().zip(values).all(is_near) {
        return Ok(());
    }
    Err(format!("measured.md does not say what is measured, {values:?}: \"{}\"", filled(sentence, &stated, values)))
}

/// Compares a sentence of measured.md with the measured values: each figure must be within a unit of its last digit. Line breaks of the file count as
/// spaces.
pub(super) fn tells(sentence: &str, values: &[f64]) {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/book/src/results/measured.md");
    let text = std::fs::read_to_string(&page).unwrap_or_else(|error| panic!("{}: {error}", page.display()));
    is_told(&text, sentence, values).unwrap_or_else(|why| panic!("{why}"));
}

#[test]
fn a_figure_that_is_not_what_was_measured_is_refused_with_the_sentence_as_it_ought_to_be() {
    let text = "Of the mass 3 kg. It weighs\n9.81 N, and -2 % of it\nare left.";
    assert_eq!(is_told(text, "It weighs {} N, and {} %", &[9.814, -2.3]), Ok(()));
    let wrong = is_told(text, "It weighs {} N, and {} %", &[9.83, -2.0]).unwrap_err();
    assert!(wrong.ends_with("\"It weighs 9.83 N, and -2 %\""), "{wrong}");
    assert!(is_told(text, "It weighs {} kg", &[9.81]).is_err());
    // If the words occur twice, the place with numbers in the places of the figures is used.
    assert_eq!(is_told("the gain is large; the gain is 4.", "the gain is {}.", &[4.0]), Ok(()));
}

//! Splits a text into tokens.
//!
//! In: the text of a model. Out: tokens with their byte ranges, without comments. A character that starts no token is a fault and is skipped, so that
//! all faults are reported at once.

use std::ops::Range;

use rsm_core::source::{Collector, Source};

/// The kind of a token.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Token {
    /// A name without its quotes, with escapes replaced.
    Name(String),
    /// A keyword of the language.
    Keyword(&'static str),
    /// A number, and whether it is written as an integer.
    Number(f64, bool),
    /// A text in double quotes.
    Text(String),
    /// A sign, such as `<=`.
    Sign(&'static str),
    /// The end of the text.
    End,
}

/// A token with its position.
#[derive(Debug, Clone)]
pub(crate) struct Placed {
    pub(crate) token: Token,
    pub(crate) span: Range<usize>,
}

const KEYWORDS: &[&str] = &[
    "algorithm",
    "and",
    "annotation",
    "block",
    "break",
    "class",
    "connect",
    "connector",
    "constant",
    "constrainedby",
    "der",
    "discrete",
    "each",
    "else",
    "elseif",
    "elsewhen",
    "encapsulated",
    "end",
    "enumeration",
    "equation",
    "expandable",
    "extends",
    "external",
    "false",
    "final",
    "flow",
    "for",
    "function",
    "if",
    "import",
    "impure",
    "in",
    "initial",
    "inner",
    "input",
    "loop",
    "model",
    "not",
    "operator",
    "or",
    "outer",
    "output",
    "package",
    "parameter",
    "partial",
    "protected",
    "public",
    "pure",
    "record",
    "redeclare",
    "replaceable",
    "return",
    "stream",
    "then",
    "true",
    "type",
    "when",
    "while",
    "within",
];

/// A longer sign precedes the signs that it starts with.
const SIGNS: &[&str] = &[
    ":=", "<=", ">=", "==", "<>", ".+", ".-", ".*", "./", ".^", "(", ")", "[", "]", "{", "}", ",", ";", ":", ".", "=", "<",
    ">", "+", "-", "*", "/", "^", "@",
];

/// Cuts a text into tokens. The last one is [`Token::End`].
pub(crate) fn tokens(source: &Source, faults: &mut Collector) -> Vec<Placed> {
    let text = source.text();
    let bytes = text.as_bytes();
    let mut tokens = Vec::with_capacity(bytes.len() / 4);
    // A byte order mark before the text.
    let mut at = if text.starts_with('\u{feff}') { 3 } else { 0 };
    while at < bytes.len() {
        let start = at;
        let byte = bytes[at];
        if byte.is_ascii_whitespace() {
            at += 1;
            continue;
        }
        if text[at..].starts_with("//") {
            at = text[at..].find('\n').map_or(bytes.len(), |length| at + length);
            continue;
        }
        if text[at..].starts_with("/*") {
            match text[at + 2..].find("*/") {
                Some(length) => at += length + 4,
                None => {
                    faults.push(
                        source.fault(start..start + 2, "a comment that does not end: found `/*`, expected `*/` after it"),
                    );
                    at = bytes.len();
                }
            }
            continue;
        }
        let token = match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'_' => {
                while at < bytes.len() && (bytes[at].is_ascii_alphanumeric() || bytes[at] == b'_') {
                    at += 1;
                }
                let word = &text[start..at];
                KEYWORDS
                    .binary_search(&word)
                    .map_or_else(|_| Token::Name(word.to_string()), |place| Token::Keyword(KEYWORDS[place]))
            }
            b'0'..=b'9' => {
                let Some(token) = number(source, &mut at, faults) else { continue };
                token
            }
            b'\'' | b'"' => {
                let Some(inner) = quoted(source, &mut at, faults) else { continue };
                if byte == b'"' { Token::Text(inner) } else { Token::Name(inner) }
            }
            _ => match SIGNS.iter().find(|sign| text[at..].starts_with(**sign)) {
                Some(sign) => {
                    at += sign.len();
                    Token::Sign(sign)
                }
                None => {
                    let symbol = text[at..].chars().next().unwrap_or(' ');
                    at += symbol.len_utf8();
                    let what = format!("found the character `{symbol}`, which no name, number or sign starts with");
                    faults.push(
                        source.fault(start..at, what).help("write a name with other characters in single quotes: 'name'"),
                    );
                    continue;
                }
            },
        };
        tokens.push(Placed { token, span: start..at });
    }
    tokens.push(Placed { token: Token::End, span: bytes.len()..bytes.len() });
    tokens
}

/// A number: digits, optional fraction, optional exponent.
fn number(source: &Source, at: &mut usize, faults: &mut Collector) -> Option<Token> {
    let bytes = source.text().as_bytes();
    let start = *at;
    let digits = |at: &mut usize| {
        while *at < bytes.len() && bytes[*at].is_ascii_digit() {
            *at += 1;
        }
    };
    digits(at);
    let mut is_whole = true;
    // `2.*x` is the elementwise product of 2 and x: the point belongs to the operator.
    let next_is_operator = matches!(bytes.get(*at + 1), Some(b'*' | b'/' | b'^' | b'+' | b'-'));
    if bytes.get(*at) == Some(&b'.') && !next_is_operator {
        is_whole = false;
        *at += 1;
        digits(at);
    }
    if matches!(bytes.get(*at), Some(b'e' | b'E')) {
        let mut ahead = *at + 1;
        if matches!(bytes.get(ahead), Some(b'+' | b'-')) {
            ahead += 1;
        }
        if bytes.get(ahead).is_some_and(u8::is_ascii_digit) {
            is_whole = false;
            *at = ahead;
            digits(at);
        }
    }
    let text = &source.text()[start..*at];
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() => Some(Token::Number(value, is_whole)),
        _ => {
            faults.push(source.fault(start..*at, format!("the number {text} is too large: expected at most 1.8e308")));
            None
        }
    }
}

/// The text in quotes, with escapes replaced.
fn quoted(source: &Source, at: &mut usize, faults: &mut Collector) -> Option<String> {
    let text = source.text();
    let start = *at;
    let quote = text.as_bytes()[start] as char;
    let mut inner = String::new();
    let mut symbols = text[start + 1..].char_indices();
    while let Some((place, symbol)) = symbols.next() {
        if symbol == quote {
            *at = start + 1 + place + 1;
            return Some(inner);
        }
        // A name ends on its line. A text may continue on the next line.
        if symbol == '\n' && quote == '\'' {
            break;
        }
        if symbol == '\\' {
            match symbols.next() {
                Some((_, escaped)) => inner.push(match escaped {
                    'n' => '\n',
                    't' => '\t',
                    'r' => '\r',
                    other => other,
                }),
                None => break,
            }
        } else {
            inner.push(symbol);
        }
    }
    let what = if quote == '"' { "a text that does not end" } else { "a quoted name that does not end on its line" };
    faults.push(source.fault(start..start + 1, format!("{what}: expected a closing {quote}")));
    *at = text[start..].find('\n').map_or(text.len(), |length| start + length);
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Vec<Token> {
        let mut faults = Collector::new();
        let found = tokens(&Source::new("m.mo", text), &mut faults);
        assert!(faults.is_clean());
        found.into_iter().map(|placed| placed.token).collect()
    }

    #[test]
    fn keywords_are_sorted_for_the_search() {
        assert!(KEYWORDS.windows(2).all(|pair| pair[0] < pair[1]));
    }

    #[test]
    fn numbers_names_and_signs_are_told_apart() {
        assert_eq!(
            read("2.*x 1e-3 'a.b\\'c' x.y <= 3. // end\n/* no */ \"t\\\"\""),
            [
                Token::Number(2.0, true),
                Token::Sign(".*"),
                Token::Name("x".into()),
                Token::Number(1e-3, false),
                Token::Name("a.b'c".into()),
                Token::Name("x".into()),
                Token::Sign("."),
                Token::Name("y".into()),
                Token::Sign("<="),
                Token::Number(3.0, false),
                Token::Text("t\"".into()),
                Token::End
            ]
        );
    }

    #[test]
    fn all_bad_characters_are_told_at_once() {
        let mut faults = Collector::new();
        tokens(&Source::new("m.mo", "x = $3;\ny = 'open\nz ? 1e999"), &mut faults);
        let told = faults.finish(Some(())).unwrap_err().to_string();
        for place in ["m.mo:1:5:", "m.mo:2:5:", "m.mo:3:3:", "m.mo:3:5:"] {
            assert!(told.contains(place), "{told}");
        }
    }
}

//! The functions that the parsers of declarations, equations and expressions share: the position in the tokens, faults, recovery.

use rsm_core::source::{Collector, Source};

use super::lexer::{Placed, Token};
use super::tree::Span;

/// A fault was reported; the caller recovers.
#[derive(Debug)]
pub(crate) struct Told;

/// The result, or a reported fault.
pub(crate) type Read<T> = Result<T, Told>;

/// The largest depth of nested parentheses, branches and functions, because each level uses stack.
const DEEPEST: usize = 256;

pub(crate) struct Parser<'s> {
    pub(crate) source: &'s Source,
    pub(crate) faults: &'s mut Collector,
    tokens: Vec<Placed>,
    at: usize,
    depth: usize,
}

impl<'s> Parser<'s> {
    pub(crate) fn new(source: &'s Source, tokens: Vec<Placed>, faults: &'s mut Collector) -> Self {
        Parser { source, faults, tokens, at: 0, depth: 0 }
    }

    pub(crate) fn token(&self) -> &Token {
        &self.tokens[self.at].token
    }

    /// The token after the present one.
    pub(crate) fn ahead(&self) -> &Token {
        &self.tokens[(self.at + 1).min(self.tokens.len() - 1)].token
    }

    pub(crate) fn span(&self) -> Span {
        self.tokens[self.at].span.clone()
    }

    /// The end of the token before the present one.
    pub(crate) fn end_before(&self) -> usize {
        self.tokens[self.at.saturating_sub(1)].span.end
    }

    pub(crate) fn since(&self, start: usize) -> Span {
        start..self.end_before().max(start)
    }

    pub(crate) fn advance(&mut self) {
        if self.at + 1 < self.tokens.len() {
            self.at += 1;
        }
    }

    pub(crate) fn is_sign(&self, sign: &str) -> bool {
        matches!(self.token(), Token::Sign(found) if *found == sign)
    }

    pub(crate) fn is_keyword(&self, word: &str) -> bool {
        matches!(self.token(), Token::Keyword(found) if *found == word)
    }

    pub(crate) fn is_end(&self) -> bool {
        matches!(self.token(), Token::End)
    }

    /// Skips a sign, if it is next.
    pub(crate) fn takes_sign(&mut self, sign: &str) -> bool {
        let is_there = self.is_sign(sign);
        if is_there {
            self.advance();
        }
        is_there
    }

    /// Skips a keyword, if it is next.
    pub(crate) fn takes_keyword(&mut self, word: &str) -> bool {
        let is_there = self.is_keyword(word);
        if is_there {
            self.advance();
        }
        is_there
    }

    /// The current token in words, for messages.
    pub(crate) fn found(&self) -> String {
        match self.token() {
            Token::Name(name) => format!("the name `{name}`"),
            Token::Keyword(word) => format!("`{word}`"),
            Token::Number(..) => format!("the number {}", &self.source.text()[self.span()]),
            Token::Text(_) => "a text in quotes".to_string(),
            Token::Sign(sign) => format!("`{sign}`"),
            Token::End => "the end of the file".to_string(),
        }
    }

    pub(crate) fn fault<T>(&mut self, span: Span, what: impl Into<String>) -> Read<T> {
        self.faults.push(self.source.fault(span, what));
        Err(Told)
    }

    pub(crate) fn fault_with_help<T>(&mut self, span: Span, what: impl Into<String>, help: impl Into<String>) -> Read<T> {
        self.faults.push(self.source.fault(span, what).help(help));
        Err(Told)
    }

    /// Reports an unexpected token.
    pub(crate) fn unexpected<T>(&mut self, expected: &str) -> Read<T> {
        let what = format!("found {}, expected {expected}", self.found());
        self.fault(self.span(), what)
    }

    pub(crate) fn sign(&mut self, sign: &str, context: &str) -> Read<()> {
        if self.takes_sign(sign) { Ok(()) } else { self.unexpected(&format!("`{sign}` {context}")) }
    }

    pub(crate) fn keyword(&mut self, word: &str, context: &str) -> Read<()> {
        if self.takes_keyword(word) { Ok(()) } else { self.unexpected(&format!("`{word}` {context}")) }
    }

    pub(crate) fn name(&mut self, expected: &str) -> Read<String> {
        match self.token().clone() {
            Token::Name(name) => {
                self.advance();
                Ok(name)
            }
            _ => self.unexpected(expected),
        }
    }

    /// A name whose parts are joined by points, without subscripts: of a type or a function.
    pub(crate) fn dotted(&mut self, expected: &str) -> Read<String> {
        self.takes_sign(".");
        let mut name = self.name(expected)?;
        while self.is_sign(".") && matches!(self.ahead(), Token::Name(_)) {
            self.advance();
            name.push('.');
            name.push_str(&self.name(expected)?);
        }
        Ok(name)
    }

    /// Reads one level deeper in a construct that can be nested.
    pub(crate) fn deeper<T>(&mut self, read: impl FnOnce(&mut Self) -> Read<T>) -> Read<T> {
        if self.depth >= DEEPEST {
            let what = format!("found more than {DEEPEST} levels of nested parentheses or branches");
            return self.fault_with_help(
                self.span(),
                what,
                "declare a variable with a separate equation for a part of the expression",
            );
        }
        self.depth += 1;
        let read = read(self);
        self.depth -= 1;
        read
    }

    /// Continues after the next `;`, or before a keyword that opens or closes a section.
    pub(crate) fn recover(&mut self) {
        while !self.is_end() {
            if self.takes_sign(";") {
                return;
            }
            if let Token::Keyword(word) = self.token() {
                match *word {
                    "equation" | "algorithm" | "public" | "protected" => return,
                    "end" if !matches!(self.ahead(), Token::Sign("]" | ")" | "," | "-" | "+" | ":" | "*" | "/")) => return,
                    "initial" if matches!(self.ahead(), Token::Keyword("equation" | "algorithm")) => return,
                    _ => {}
                }
            }
            self.advance();
        }
    }

    /// Continues after `end NAME;`.
    pub(crate) fn skip_class(&mut self, name: &str) {
        while !self.is_end() {
            if self.is_keyword("end") && matches!(self.ahead(), Token::Name(found) if found == name) {
                self.advance();
                self.advance();
                self.takes_sign(";");
                return;
            }
            self.advance();
        }
    }

    /// Skips `@12`, a number for other tools.
    pub(crate) fn skip_decoration(&mut self) {
        while self.is_sign("@") && matches!(self.ahead(), Token::Number(..)) {
            self.advance();
            self.advance();
        }
    }

    /// Skips `annotation(...)`, if present: it is for editors and other tools.
    pub(crate) fn skip_annotation(&mut self) -> Read<()> {
        if !self.takes_keyword("annotation") {
            return Ok(());
        }
        let start = self.span();
        self.sign("(", "after `annotation`")?;
        let mut depth = 1;
        while depth > 0 {
            match self.token() {
                Token::End => return self.fault(start, "an annotation that does not end: expected `)`"),
                Token::Sign("(") => depth += 1,
                Token::Sign(")") => depth -= 1,
                _ => {}
            }
            self.advance();
        }
        Ok(())
    }

    /// A description in quotes and an annotation, if present.
    pub(crate) fn comment(&mut self) -> Read<String> {
        let mut description = String::new();
        while let Token::Text(text) = self.token().clone() {
            description.push_str(&text);
            self.advance();
            if !self.takes_sign("+") {
                break;
            }
        }
        self.skip_annotation()?;
        Ok(description)
    }

    /// Repeats `read` until `is_over`. After a fault it continues at the next `;`.
    pub(crate) fn list<T>(
        &mut self,
        what: &str,
        is_over: impl Fn(&Self) -> bool,
        mut read: impl FnMut(&mut Self) -> Read<T>,
    ) -> Vec<T> {
        let mut items = Vec::new();
        while !self.is_end() && !is_over(self) {
            let before = self.at;
            let item = read(self).and_then(|item| {
                self.sign(";", &format!("at the end of {what}"))?;
                Ok(item)
            });
            match item {
                Ok(item) => items.push(item),
                Err(Told) => {
                    self.recover();
                    // Skips a keyword that closes nothing here; otherwise the loop would not end.
                    if self.at == before {
                        self.advance();
                    }
                }
            }
        }
        items
    }
}

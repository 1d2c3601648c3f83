//! Text to tree: Base Modelica as written by people and tools.
//!
//! In: the text. Out: a tree, and every syntax fault with its place. Names are not resolved here. The grammar is that of proposal MCP-0031 of the
//! Modelica Association, without the parts that straight-line code cannot compute.

mod declarations;
mod equations;
mod expressions;
mod lexer;
mod parser;
pub(crate) mod tree;

use std::ops::Range;

use rsm_core::source::{Collector, Source};

/// Reads a text. Parts with faults are reported in `faults` and left out of the tree.
pub(crate) fn read(source: &Source, faults: &mut Collector) -> tree::Text {
    let tokens = lexer::tokens(source, faults);
    parser::Parser::new(source, tokens, faults).text()
}

/// Reads an expression inside another text, such as a value of a TOML file.
pub(crate) fn expression(source: &Source, place: Range<usize>, faults: &mut Collector) -> Option<tree::Expression> {
    // The text before is replaced by spaces, so that positions are those of the whole text.
    let before: String = source.text()[..place.start].chars().flat_map(blank).collect();
    let masked = Source::new(source.name(), before + &source.text()[place.clone()]);
    let tokens = lexer::tokens(&masked, faults);
    let mut parser = parser::Parser::new(&masked, tokens, faults);
    let read = parser.expression().ok()?;
    if !parser.is_end() {
        let _ = parser.unexpected::<()>("the end of the expression");
        return None;
    }
    Some(read)
}

/// As many spaces as a character has bytes; line ends stay.
fn blank(character: char) -> impl Iterator<Item = char> {
    let (sign, count) = if character == '\n' { ('\n', 1) } else { (' ', character.len_utf8()) };
    std::iter::repeat_n(sign, count)
}

#[cfg(test)]
mod tests;

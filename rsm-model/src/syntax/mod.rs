//! Text to tree: Base Modelica as people and tools write it.
//!
//! In: the text. Out: a tree, and every fault of form, each with its place. Names are not resolved here.
//! The grammar is that of proposal MCP-0031 of the Modelica association, less what a straight line of operations cannot compute.

mod declarations;
mod equations;
mod expressions;
mod lexer;
mod parser;
pub(crate) mod tree;

use rsm_core::source::{Collector, Source};

/// Reads a text. What could not be read is told in `faults` and left out of the tree.
pub(crate) fn read(source: &Source, faults: &mut Collector) -> tree::Text {
    let tokens = lexer::tokens(source, faults);
    parser::Parser::new(source, tokens, faults).text()
}

#[cfg(test)]
mod tests;

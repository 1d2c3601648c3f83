//! Comments of the sources: their width, and lines that rustdoc would read as a list.

use super::{root, tracked};

/// The largest width of a comment in columns: rustfmt formats code to 128 columns and leaves comments as they are.
const WIDTH: usize = 150;

/// A comment line, without its marker.
fn comment(line: &str) -> Option<&str> {
    let line = line.trim_start();
    let text = line.strip_prefix("///").or_else(|| line.strip_prefix("//!")).or_else(|| line.strip_prefix("//"))?;
    Some(text.trim_start())
}

/// The numbers of the lines of a source whose comments are too wide. Code of an example in a comment is not limited.
fn too_wide(source: &str) -> Vec<usize> {
    let mut is_example = false;
    let mut found = Vec::new();
    for (k, line) in source.lines().enumerate() {
        let Some(text) = comment(line) else {
            is_example = false;
            continue;
        };
        if text.starts_with("```") {
            is_example = !is_example;
        } else if !is_example && line.chars().count() > WIDTH {
            found.push(k + 1);
        }
    }
    found
}

#[test]
fn comments_keep_to_their_width() {
    // Emitted code has the model's own words beside its constants.
    let is_source = |file: &&String| file.ends_with(".rs") && !file.starts_with("generated/");
    let mut wrong = Vec::new();
    for file in tracked().iter().filter(is_source) {
        let Ok(source) = std::fs::read_to_string(root().join(file)) else { continue };
        wrong.extend(too_wide(&source).into_iter().map(|line| format!("{file}:{line}")));
    }
    assert!(wrong.is_empty(), "comments of more than {WIDTH} columns:\n{}", wrong.join("\n"));
}

#[test]
fn a_wide_comment_is_found_and_code_and_examples_are_not() {
    let wide = "x".repeat(WIDTH);
    let source =
        format!("/// {wide}\nlet text = \"{wide}\";\n/// ```\n/// let text = \"{wide}\";\n/// ```\n    // {wide}\n// short\n");
    assert_eq!(too_wide(&source), [1, 6]);
}

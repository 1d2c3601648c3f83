//! Mutants that no test can detect, because they do not change the meaning: a comment beside the line gives the argument for each of them.
//!
//! The comment names the change in backquotes after the word mutant, and gives the reason: "// mutant `< to <=`: at equality both branches give the
//! same number". It is on the line of the change, or in the comment directly above it. An argument that a test refutes is an error.

/// Whether the comments at a line (counted from 1) argue that a change has no effect.
pub(crate) fn is_argued(lines: &[&str], line: usize, change: &str) -> bool {
    let wanted = format!("mutant `{change}`");
    let at = line - 1;
    let above = lines[..at].iter().rev().take_while(|text| text.trim_start().starts_with("//"));
    std::iter::once(&lines[at])
        .chain(above)
        .any(|text| text.split_once("//").is_some_and(|(_, comment)| comment.contains(&wanted)))
}

#[cfg(test)]
mod tests {
    use super::is_argued;

    #[test]
    fn an_argument_stands_beside_its_line_or_right_above() {
        let text = [
            "// mutant `< to <=`: equal ends give the same range.",
            "// mutant `+ to -`: b is 0.",
            "let x = a < b + c;",
            "let y = a < b; // mutant `< to >=`: never.",
            "let z = a < b;",
        ];
        assert!(is_argued(&text, 3, "< to <="));
        assert!(is_argued(&text, 3, "+ to -"));
        assert!(!is_argued(&text, 3, "< to >="));
        assert!(is_argued(&text, 4, "< to >="));
        assert!(!is_argued(&text, 5, "< to >="), "an argument is about one line");
    }
}

//! Runs the examples of a document: blocks of a page, commands in a shell.

use std::path::{Path, PathBuf};
use std::process::Command;

/// A fenced block of a page: its language, and its text.
pub struct Block {
    pub language: String,
    pub text: String,
}

/// A file of the project, from its root.
pub fn of_the_project(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

/// The path of a published coefficient file.
pub fn published(name: &str) -> String {
    let path = of_the_project("generated/coefficients").join(name);
    path.canonicalize().unwrap_or_else(|error| panic!("{}: {error}", path.display())).display().to_string()
}

/// The text of a file of the project.
pub fn read(path: &str) -> String {
    let file = of_the_project(path);
    std::fs::read_to_string(&file).unwrap_or_else(|error| panic!("{}: {error}", file.display()))
}

/// All fenced blocks of a page, in order. A block inside a list is indented, and its text loses that indentation.
pub fn blocks(page: &str) -> Vec<Block> {
    let mut blocks: Vec<Block> = Vec::new();
    let mut open: Option<usize> = None;
    for line in page.lines() {
        let indent = line.len() - line.trim_start().len();
        match (open, line.trim_start().strip_prefix("```")) {
            (None, Some(language)) => {
                open = Some(indent);
                blocks.push(Block { language: language.to_string(), text: String::new() });
            }
            (Some(_), Some(_)) => open = None,
            (Some(margin), None) => {
                let block = blocks.last_mut().expect("opened above");
                block.text += line.get(margin..).unwrap_or("");
                block.text.push('\n');
            }
            (None, None) => {}
        }
    }
    blocks
}

/// Runs commands in one shell that stops at the first failure; `rsm` and `cargo rsm` are the command under test. Returns their output, including
/// errors.
pub fn run(script: &str, folder: &Path) -> String {
    let program = Path::new(env!("CARGO_BIN_EXE_rsm"));
    let path = std::env::var_os("PATH").unwrap_or_default();
    let programs = program.parent().unwrap().to_path_buf();
    let path = std::env::join_paths(std::iter::once(programs).chain(std::env::split_paths(&path))).unwrap();
    let script = format!("exec 2>&1\n{}", script.replace("cargo rsm", "rsm"));
    let output = Command::new("sh").args(["-e", "-c", &script]).env("PATH", path).current_dir(folder).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{text}");
    text
}

#[test]
fn blocks_are_read_with_their_language_and_without_their_margin() {
    let found = blocks("a\n```sh\nls\n  x\n```\n1. b\n\n   ```c\n   int x;\n\n     y\n   ```\n```\nz\n```\n");
    let seen: Vec<(&str, &str)> = found.iter().map(|it| (it.language.as_str(), it.text.as_str())).collect();
    assert_eq!(seen, [("sh", "ls\n  x\n"), ("c", "int x;\n\n  y\n"), ("", "z\n")]);
}

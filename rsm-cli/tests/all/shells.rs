//! Completions and manual pages: they contain every subcommand, and the programs that read them accept them.

use std::process::{Command, Output};

fn rsm(words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_rsm")).args(words).output().unwrap()
}

fn printed(words: &[&str]) -> String {
    let output = rsm(words);
    assert!(output.status.success(), "{words:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn completions_contain_every_subcommand_and_its_options() {
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let script = printed(&["completions", shell]);
        for word in ["diagnose", "completions", "validate", "force"] {
            assert!(script.contains(word), "{shell}: {word} is missing");
        }
    }
    let refused = rsm(&["completions", "tcsh"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("bash"), "the shells are named");
}

#[test]
fn bash_completes_a_subcommand_and_an_option() {
    let script = std::env::temp_dir().join(format!("rsm-completions-{}.bash", std::process::id()));
    std::fs::write(&script, printed(&["completions", "bash"])).unwrap();
    let complete = |words: &str, count: usize| {
        let ask = format!(
            "source {}; COMP_WORDS=({words}); COMP_CWORD={count}; _rsm rsm \"${{COMP_WORDS[{count}]}}\" \"${{COMP_WORDS[{count}-1]}}\"; \
             echo \"${{COMPREPLY[@]}}\"",
            script.display()
        );
        let output = Command::new("bash").args(["--norc", "-c", &ask]).output().unwrap();
        String::from_utf8(output.stdout).unwrap().trim().to_string()
    };
    let (subcommand, option) = (complete("rsm diag", 1), complete("rsm diagnose --val", 2));
    std::fs::remove_file(&script).unwrap();
    assert_eq!(subcommand, "diagnose");
    assert_eq!(option, "--validate");
}

#[test]
fn the_manual_has_a_page_for_the_command_and_for_each_subcommand() {
    let page = printed(&["man"]);
    // The title, and the list of subcommands as references to their pages.
    assert!(page.contains(".TH rsm 1"), "{page}");
    assert!(page.contains("rsm\\-fit(1)"), "{page}");
    let page = printed(&["man", "experiment", "pmac"]);
    assert!(page.contains(".TH rsm-experiment-pmac 1"), "{page}");
    assert!(page.contains("\\-\\-plant"), "{page}");
    let refused = rsm(&["man", "experiment", "bicycle"]);
    assert_eq!(refused.status.code(), Some(2));
    let message = String::from_utf8(refused.stderr).unwrap();
    assert_eq!(message.trim(), "found `bicycle`, the subcommands of rsm experiment are: pmac, driveline, help");
}

//! The tutorial of the book (`docs/book/src/first-hour.md`), executed block by block, and the pictures in the tutorial and in the README.
//!
//! In: the page. Its blocks ```sh are run in one shell. A block ```text after one contains the lines that this block prints, in this order; `...`
//! stands for omitted lines. `RSM_BLESS=1` writes the pictures again from the reports of the tutorial.

use std::path::{Path, PathBuf};

use crate::shell::{of_the_project, run};

fn book(name: &str) -> PathBuf {
    of_the_project("docs/book/src").join(name)
}

/// A block of commands with the lines that it prints.
struct Step {
    /// The line of the page.
    line: usize,
    commands: String,
    prints: Vec<String>,
}

fn steps(page: &str) -> Vec<Step> {
    let mut steps: Vec<Step> = Vec::new();
    let mut open: Option<&str> = None;
    for (k, line) in page.lines().enumerate() {
        match (open, line.strip_prefix("```")) {
            (None, Some(language)) => {
                open = Some(language);
                if language == "sh" {
                    steps.push(Step { line: k + 1, commands: String::new(), prints: vec![] });
                } else if language == "text" {
                    let step = steps.last_mut().expect("output follows a block of commands");
                    assert!(step.prints.is_empty(), "line {}: a second block of output", k + 1);
                }
            }
            (Some(_), Some(_)) => open = None,
            (Some("sh"), None) => {
                let step = steps.last_mut().expect("opened above");
                step.commands += line;
                step.commands.push('\n');
            }
            (Some("text"), None) if line != "..." => {
                steps.last_mut().expect("opened above").prints.push(line.trim().to_string());
            }
            _ => {}
        }
    }
    steps
}

/// The first line that a text does not contain, in this order.
fn missing<'a>(prints: &'a [String], text: &str) -> Option<&'a str> {
    let mut rest = text;
    for line in prints {
        match rest.split_once(line.as_str()) {
            Some((_, behind)) => rest = behind,
            None => return Some(line),
        }
    }
    None
}

const MARK: &str = "==== end of block";

#[test]
fn every_block_of_the_first_hour_prints_what_the_page_says() {
    let page = std::fs::read_to_string(book("first-hour.md")).unwrap();
    let steps = steps(&page);
    assert!(steps.len() > 12 && steps.iter().filter(|step| !step.prints.is_empty()).count() > 8);
    // The part of a clone that the tutorial needs.
    let clone = tempfile::tempdir().unwrap();
    let plants = clone.path().join("rsm-sim/plants");
    std::fs::create_dir_all(&plants).unwrap();
    for name in ["servo-axis.toml", "servo-axis.csv"] {
        std::fs::copy(of_the_project("rsm-sim/plants").join(name), plants.join(name)).unwrap();
    }
    let script: String = steps.iter().map(|step| format!("{}echo '{MARK}'\n", step.commands)).collect();
    let text = run(&script, clone.path());
    let printed: Vec<&str> = text.split(MARK).collect();
    assert_eq!(printed.len(), steps.len() + 1);
    for (step, printed) in steps.iter().zip(printed) {
        if let Some(line) = missing(&step.prints, printed) {
            panic!("first-hour.md:{}: \"{line}\" is not in\n{printed}", step.line);
        }
    }
    let example = clone.path().join("example");
    for folder in ["surface", "plant"] {
        let lacking = keys_without_a_word(&example.join(folder).join("diagnosis.json"));
        assert!(lacking.is_empty(), "reference/formats.md does not name these keys of {folder}: {lacking:?}");
    }
    compare("surface.svg", &surface(&example.join("report/report.html")));
    compare("diagnosis.svg", &diagnosis(&example.join("plant/report.html")));
}

#[test]
fn output_that_is_not_printed_in_this_order_is_missed() {
    let page = "```sh\necho a\n```\n\nIt prints:\n\n```text\na\n...\nb c\n```\n```toml\nx\n```\n```sh\nls\n```\n";
    let steps = steps(page);
    assert_eq!((steps.len(), steps[0].line, steps[0].commands.as_str()), (2, 1, "echo a\n"));
    assert_eq!(steps[0].prints, ["a", "b c"]);
    assert_eq!(missing(&steps[0].prints, "x a y b c"), None);
    assert_eq!(missing(&steps[0].prints, "b c a"), Some("b c"));
}

/// Keys of a diagnosis, and of its first cause, that are missing in the reference.
fn keys_without_a_word(file: &Path) -> Vec<String> {
    let page = std::fs::read_to_string(book("reference/formats.md")).unwrap();
    let answer: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap();
    let of = |value: &serde_json::Value| value.as_object().expect("an object").keys().cloned().collect::<Vec<String>>();
    let keys = [of(&answer), of(&answer["causes"][0])].concat();
    assert!(keys.len() > 15, "{keys:?}");
    keys.into_iter().filter(|key| !page.contains(&format!("`{key}`")) && !page.contains(&format!("\"{key}\""))).collect()
}

/// The plots of a report as SVG, each with its title and caption.
fn plots(report: &Path) -> Vec<String> {
    let html = std::fs::read_to_string(report).unwrap();
    let part = |text: &str| text.split_once("</svg>").map(|(svg, _)| format!("<svg{svg}</svg>\n"));
    // Attributes with their default values make up a third of the text.
    html.split("<svg")
        .skip(1)
        .filter_map(part)
        .map(|svg| svg.replace(" opacity=\"1\"", "").replace(" stroke=\"none\"", ""))
        .collect()
}

/// The map of the surface in the report of the fit.
fn surface(report: &Path) -> String {
    plots(report).swap_remove(0)
}

/// From the report of the diagnosis: its title, its first cause, and the remaining error of the position over time and by frequency.
fn diagnosis(report: &Path) -> String {
    let html = std::fs::read_to_string(report).unwrap();
    let between = |from: &str, to: &str| {
        html.split_once(from).and_then(|(_, rest)| rest.split_once(to)).unwrap_or_else(|| panic!("{from}: {html}")).0
    };
    let title = between("<h1>", "</h1>");
    let cause = between("<h3>1. ", "</h3>");
    let sentence = between(&format!("<h3>1. {cause}</h3>\n<p>"), "</p>");
    let of = |words: &str| {
        let found = plots(report).into_iter().find(|svg| svg.contains(words));
        found.unwrap_or_else(|| panic!("no plot \"{words}\""))
    };
    let at = |x: usize, svg: String| svg.replacen("<svg ", &format!("<svg x=\"{x}\" y=\"64\" "), 1);
    let text = |x: usize, y: usize, size: usize, fill: &str, words: &str| {
        format!("<text x=\"{x}\" y=\"{y}\" font-family=\"sans-serif\" font-size=\"{size}\" fill=\"{fill}\">{words}</text>\n")
    };
    let mut svg =
        "<svg width=\"960\" height=\"430\" viewBox=\"0 0 960 430\" xmlns=\"http://www.w3.org/2000/svg\">\n".to_string();
    svg += "<rect width=\"960\" height=\"430\" fill=\"#FFFFFF\"/>\n";
    svg += &text(24, 30, 20, "#000000", title);
    svg += &text(24, 54, 14, "#000000", &format!("{cause}: {sentence}"));
    svg += &at(0, of("measured minus simulated"));
    svg += &at(480, of("residual, by frequency"));
    // The colours of the report's captions.
    svg += &text(60, 420, 13, "#D55E00", "before (calibrated within its tolerances)");
    svg += &text(340, 420, 13, "#0072B2", "after (with the cause)");
    svg += &text(520, 420, 13, "#000000", "noise floor");
    svg + "</svg>\n"
}

/// Compares a picture with the one in the repository.
fn compare(name: &str, made: &str) {
    let path = book("pictures").join(name);
    if std::env::var_os("RSM_BLESS").is_some() {
        std::fs::write(&path, made).unwrap();
    }
    let stands = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(stands == made, "{} is not what the tutorial's report shows; RSM_BLESS=1 writes it", path.display());
}

//! CONTRIBUTING.md names the files that an extension must change: those that now name all effects, all plants, all printers, all formats.

use std::collections::{BTreeMap, BTreeSet};

use rsm_sim::equation_plant;

use super::map::{is_path, is_there, quoted};
use super::{root, tracked};

const PAGE: &str = "CONTRIBUTING.md";

fn page() -> String {
    std::fs::read_to_string(root().join(PAGE)).unwrap_or_else(|error| panic!("{PAGE}: {error}"))
}

/// The lists of a section, in order: the paths that each of them names.
fn lists<'t>(page: &'t str, section: &str) -> Vec<BTreeSet<&'t str>> {
    let mut lists: Vec<BTreeSet<&str>> = vec![];
    let (mut is_section, mut is_list) = (false, false);
    for line in page.lines() {
        if line.starts_with("## ") {
            is_section = line.trim_start_matches("## ") == section;
            is_list = false;
        } else if is_section && line.starts_with("- ") && !is_list {
            lists.push(BTreeSet::new());
            is_list = true;
        } else if line.is_empty() {
            is_list = false;
        }
        if is_section
            && is_list
            && let Some(list) = lists.last_mut()
        {
            list.extend(quoted(line).into_iter().filter(|name| is_path(name)));
        }
    }
    lists
}

/// Whether a text has a word; letters, digits, `_` and `-` make words.
fn has(text: &str, word: &str) -> bool {
    let ends = |symbol: Option<char>| symbol.is_none_or(|it| !(it.is_ascii_alphanumeric() || it == '_' || it == '-'));
    text.match_indices(word).any(|(at, _)| ends(text[..at].chars().next_back()) && ends(text[at + word.len()..].chars().next()))
}

fn has_kind(text: &str, kind: &str) -> bool {
    has(text, kind) || has(text, &kind.replace('-', "_"))
}

/// The effects of plant files of format 1.
fn kinds() -> BTreeSet<&'static str> {
    let plants = equation_plant::first_format();
    plants.iter().flat_map(|(_, kind)| equation_plant::effects_on(*kind)).map(|it| it.kind).collect()
}

/// Sources, documents and cases of the repository with their texts.
fn texts() -> BTreeMap<String, String> {
    let files = tracked().into_iter().filter(|file| [".rs", ".md", ".txt"].iter().any(|ending| file.ends_with(ending)));
    files.filter_map(|file| Some((file.clone(), std::fs::read_to_string(root().join(&file)).ok()?))).collect()
}

/// Files of a list that is complete, but for those that stand for many.
fn named<'t>(lists: &[BTreeSet<&'t str>]) -> BTreeSet<&'t str> {
    lists.iter().flatten().copied().collect()
}

fn lacking(computed: &BTreeSet<&str>, section: &str) {
    let page = page();
    let named = named(&lists(&page, section));
    assert!(computed.len() > 1, "{section}: the search finds {computed:?} alone");
    let lacking: Vec<_> = computed.difference(&named).collect();
    assert!(lacking.is_empty(), "{PAGE}, section {section}, does not name {lacking:?}");
}

#[test]
fn every_file_that_it_names_exists() {
    let plants = equation_plant::first_format().map(|(name, _)| name.replace('-', "_"));
    let kinds = kinds();
    let mut found = 0;
    for name in page().lines().flat_map(quoted).filter(|name| is_path(name)) {
        let all: Vec<String> = if name.contains("KIND") {
            kinds.iter().map(|kind| name.replace("KIND", kind)).collect()
        } else if name.contains("PLANT") {
            plants.iter().map(|plant| name.replace("PLANT", plant)).collect()
        } else {
            vec![name.to_string()]
        };
        found += all.len();
        let missing: Vec<_> = all.iter().filter(|name| !is_there(name)).collect();
        assert!(missing.is_empty(), "{PAGE} names {missing:?}");
    }
    assert!(found > 60, "{found} names: the search finds nothing");
}

#[test]
fn the_files_of_an_effect_are_those_that_name_every_effect() {
    let texts = texts();
    let know_all = texts.iter().filter(|(_, text)| kinds().iter().all(|kind| has_kind(text, kind)));
    let computed: BTreeSet<&str> = know_all.map(|(file, _)| file.as_str()).collect();
    let page = page();
    let lists = lists(&page, "An effect");
    let told: BTreeSet<&str> = lists[0].iter().copied().filter(|name| !name.contains("KIND")).collect();
    assert_eq!(told, computed, "{PAGE}, section An effect: files that name every effect");
    for kind in kinds() {
        let is_twice = lists[1].iter().any(|file| has_kind(&texts[*file], kind));
        assert!(is_twice, "{PAGE}: {kind} is in none of the files of the second simulation: {:?}", lists[1]);
    }
}

/// How many plants a text knows, by the names of `rsm-sim` or by those of the second simulation.
fn plants_known(text: &str) -> usize {
    const NAMES: [&[&str]; 3] = [
        &["pmac", "kind::motor"],
        &["driveline", "kind::car"],
        &["servo-axis", "servo_axis", "servoaxis", "kind::openaxis", "kind::closedaxis"],
    ];
    let text = text.to_lowercase();
    NAMES.iter().filter(|names| names.iter().any(|name| text.contains(name))).count()
}

#[test]
fn the_files_of_a_plant_hold_all_that_name_every_plant() {
    let texts = texts();
    let is_source = |file: &str| file.contains("/src/") && file.ends_with(".rs") && !file.ends_with("/tests.rs");
    let sources = texts.iter().filter(|(file, _)| is_source(file));
    let know_all = sources.filter(|(_, text)| plants_known(text) == equation_plant::first_format().len());
    lacking(&know_all.map(|(file, _)| file.as_str()).collect(), "A plant");
    // And no file that no longer distinguishes the plants.
    let page = page();
    let told = named(&lists(&page, "A plant")).into_iter().filter(|file| file.ends_with(".rs") && !file.contains("PLANT"));
    let stale: Vec<_> = told.filter(|file| texts.get(*file).is_none_or(|text| plants_known(text) < 2)).collect();
    assert!(stale.is_empty(), "{PAGE}, section A plant, names files that know one plant at most: {stale:?}");
}

#[test]
fn the_files_of_a_back_end_hold_all_that_call_every_printer() {
    let texts = texts();
    let this = "tests/all/documents/contributing.rs";
    let calls = texts.iter().filter(|(file, text)| *file != this && has(text, "emit::c") && has(text, "emit::rust"));
    lacking(&calls.map(|(file, _)| file.as_str()).filter(|file| file.ends_with(".rs")).collect(), "A back end");
}

#[test]
fn the_files_of_a_format_hold_all_that_know_a_reader() {
    let texts = texts();
    let knows = texts
        .iter()
        .filter(|(file, text)| file.starts_with("rsm-import/src/") && !file.contains("mat73") && has(text, "mat73"));
    lacking(&knows.map(|(file, _)| file.as_str()).collect(), "A file format");
}

#[test]
fn a_word_is_a_whole_word_and_a_list_ends_at_an_empty_line() {
    assert!(has("a sensor-gain.", "sensor-gain") && !has("sensor-gains", "sensor-gain") && !has("x_windage", "windage"));
    let page = "## A\n\n- `a/b.rs`: of `c d`\n- `e/`\n  and `f.md`\n\nthen\n\n- `g.rs`\n\n## B\n\n- `h.rs`\n";
    assert_eq!(lists(page, "A"), [BTreeSet::from(["a/b.rs", "e/", "f.md"]), BTreeSet::from(["g.rs"])]);
}

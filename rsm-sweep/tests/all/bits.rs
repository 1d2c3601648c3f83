//! The same bits on one thread and on many, in shards, after an interruption, from a bundle; a changed input makes other tasks.

use std::sync::Mutex;

use rsm_core::source::Source;
use rsm_sweep::scenario::Scenario;
use rsm_sweep::store::Store;
use rsm_sweep::table::Table;
use rsm_sweep::tasks::{self, Task};
use rsm_sweep::{bundle, engine, no_diagnosis};

use super::{axis, open, scenario};

const RUNS: usize = 40;

/// Runs what a store lacks; how many that was.
fn run(scenario: &Scenario, tasks: &[&Task], store: &Store, threads: usize) -> usize {
    let left: Vec<&Task> = tasks.iter().copied().filter(|it| store.get(it).is_none()).collect();
    let done = Mutex::new(0);
    engine::run(scenario, &left, store, threads, &no_diagnosis, &|_, _| *done.lock().unwrap() += 1).unwrap();
    assert_eq!(*done.lock().unwrap(), left.len());
    left.len()
}

fn collected(scenario: &Scenario, tasks: &[Task], stores: &[&Store]) -> String {
    let result = |task: &Task| stores.iter().find_map(|it| it.get(task));
    let results: Vec<_> = tasks.iter().map(result).collect();
    assert!(results.iter().all(Option::is_some));
    Table::of(scenario, tasks, &results).csv()
}

#[test]
fn threads_shards_and_an_interruption_leave_the_bits_alone() {
    let scenario = scenario(&axis(RUNS));
    let tasks = tasks::list(&scenario).unwrap();
    let all: Vec<&Task> = tasks.iter().collect();
    let folder = tempfile::tempdir().unwrap();
    let store = |name: &str| Store::open(&folder.path().join(name)).unwrap();
    let one = store("one");
    assert_eq!(run(&scenario, &all, &one, 1), RUNS);
    let expected = collected(&scenario, &tasks, &[&one]);
    assert_eq!(expected.lines().count(), RUNS + 1);
    let two = store("two");
    run(&scenario, &all, &two, 3);
    assert_eq!(collected(&scenario, &tasks, &[&two]), expected);
    let shards = [1, 2, 3].map(|k| store(&format!("shard-{k}")));
    let counts = [1, 2, 3].map(|k| run(&scenario, &tasks::shard(&tasks, [k, 3]), &shards[k - 1], 1));
    assert_eq!(counts, [14, 13, 13]);
    assert_eq!(collected(&scenario, &tasks, &shards.each_ref()), expected);
    // Interrupted in the middle, backwards.
    let interrupted = store("interrupted");
    let last: Vec<&Task> = all.iter().rev().take(15).copied().collect();
    assert_eq!(run(&scenario, &last, &interrupted, 2), 15);
    assert_eq!(run(&scenario, &all, &interrupted, 2), RUNS - 15);
    assert_eq!(collected(&scenario, &tasks, &[&interrupted]), expected);
    // Every task was started once.
    let mut starts: Vec<String> =
        std::fs::read_to_string(folder.path().join("interrupted/starts.log")).unwrap().lines().map(String::from).collect();
    starts.sort();
    let mut hashes: Vec<String> = tasks.iter().map(|it| it.hash.clone()).collect();
    hashes.sort();
    assert_eq!(starts, hashes);
}

#[test]
fn a_bundle_has_the_same_tasks_with_the_same_results() {
    for text in [axis(5), "format = 1\nsweep = \"d\"\n[[diagnose]]\nplant = \"axis.toml\"\nrecords = [\"motion.csv\"]\n".into()]
    {
        let here = scenario(&text);
        let text = bundle::write(&here);
        assert!(bundle::is_one(&text) && !bundle::is_one("format = 1\n"));
        let there = bundle::read(&Source::new("bundle.json", text.clone())).unwrap();
        let (one, other) = (tasks::list(&here).unwrap(), tasks::list(&there).unwrap());
        assert_eq!(one, other);
        let result = |scenario: &Scenario, task: &Task| task.run(scenario, 1, &no_diagnosis).to_string();
        assert_eq!(result(&here, &one[1 % one.len()]), result(&there, &other[1 % one.len()]));
        let cut = bundle::read(&Source::new("bundle.json", &text[..text.len() - 9])).unwrap_err();
        assert!(cut.to_string().contains("not a bundle"), "{cut}");
    }
}

#[test]
fn a_longer_list_holds_the_shorter_one_and_a_changed_input_holds_nothing_of_it() {
    let hashes = |text: &str| -> Vec<String> { tasks::list(&scenario(text)).unwrap().into_iter().map(|it| it.hash).collect() };
    let short = hashes(&axis(10));
    assert_eq!(hashes(&axis(30))[..10], short[..]);
    // The name of the scenario decides nothing.
    assert_eq!(hashes(&axis(10).replace("\"axis\"", "\"other\"")), short);
    let changed = [
        axis(10).replace("runs", "seed = 2\nruns"),
        axis(10).replace("2.0]", "2.5]"),
        axis(10).replace("\"max\", ", ""),
        axis(10).replace("runs", "whole_records = true\nruns"),
    ];
    for text in changed {
        assert!(hashes(&text).iter().all(|it| !short.contains(it)), "{text}");
    }
    // The contents of a file.
    let source = Source::new("sweep.toml", axis(10));
    for (file, from, to) in [("axis.toml", "force_gain = 4.0", "force_gain = 4.5"), ("motion.csv", "0.3,1", "0.3,2")] {
        let other = |name: &str| {
            let source = open(name)?;
            let text = if name == file { source.text().replace(from, to) } else { source.text().to_string() };
            assert!(name != file || text != source.text());
            Ok(Source::new(name, text))
        };
        let found = tasks::list(&Scenario::read(&source, &other).unwrap()).unwrap();
        assert!(found.iter().all(|it| !short.contains(&it.hash)), "{file}");
    }
}

#[test]
fn a_run_that_stops_is_a_result_that_says_why() {
    // A friction of some N s/m on 1e-300 kg has rates that are too fast for any step.
    let text = axis(8).replace("distribution = \"tolerance\"", "distribution = \"list\"\nvalues = [1e-300, 2.0]");
    let scenario = scenario(&text);
    let tasks = tasks::list(&scenario).unwrap();
    let results: Vec<_> = tasks.iter().map(|task| Some(task.run(&scenario, 1, &no_diagnosis))).collect();
    let table = Table::of(&scenario, &tasks, &results);
    let masses = table.numbers("mass").unwrap();
    let finals = table.numbers("position_final").unwrap();
    for row in 0..8 {
        let why = results[row].as_ref().unwrap()["failed"].as_str();
        assert_eq!(
            (finals[row].is_none(), why.is_some()),
            (masses[row] == Some(1e-300), masses[row] == Some(1e-300)),
            "{why:?}"
        );
    }
    assert!(masses.contains(&Some(1e-300)) && masses.contains(&Some(2.0)), "another seed has both: {masses:?}");
}

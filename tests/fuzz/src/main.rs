//! `cargo xtask fuzz`: changed inputs for every reader and the core of every subcommand, in this process.
//!
//! In: how many inputs, a seed, where wanted one subject and the number of one input. Out: a line a subject; the inputs that panic or run too long,
//! as files in the scratch folder; status 1 where there is one. Without coverage of the code: the texts are changed blindly, from valid ones.

mod mutate;
mod subjects;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use mutate::Random;
use subjects::{Ground, Subject};

const USAGE: &str =
    "usage: fuzz --root WORKSPACE --scratch FOLDER [--count INPUTS] [--seed N] [--subject NAME] [--input NUMBER]";

/// A small text that is worked on for longer hangs: a fit of these takes a second on a busy machine, a simulation less.
const PATIENCE: Duration = Duration::from_secs(120);

/// What panicked or hung.
struct Fault {
    subject: &'static str,
    input: u64,
    words: String,
}

/// The text of one input, and the state with which its subject decides how far to go.
fn input(subject: &Subject, seed: u64, number: u64) -> (String, Random) {
    let mut random = Random(seed ^ number.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    let text = mutate::changed(&subject.texts, &mut random);
    (text, random)
}

/// Feeds inputs to a subject; gives those that panicked.
fn feed(
    subject: &Subject,
    ground: &Ground,
    seed: u64,
    numbers: impl Iterator<Item = u64>,
    now: &Mutex<Option<(u64, Instant)>>,
) -> Vec<Fault> {
    let mut faults = Vec::new();
    for number in numbers {
        let (text, mut random) = input(subject, seed, number);
        *now.lock().expect("no panic here") = Some((number, Instant::now()));
        if let Err(panicked) = catch_unwind(AssertUnwindSafe(|| (subject.feed)(ground, &text, &mut random))) {
            let words = panicked.downcast_ref::<String>().cloned();
            let words = words.or_else(|| panicked.downcast_ref::<&str>().map(|words| (*words).to_string()));
            faults.push(Fault { subject: subject.name, input: number, words: words.unwrap_or_default() });
        }
    }
    *now.lock().expect("no panic here") = None;
    faults
}

/// All subjects, each its share of the inputs.
fn run(root: &Path, scratch: &Path, count: u64, seed: u64, only: Option<&str>, one: Option<u64>) -> Result<Vec<Fault>, String> {
    let ground = Ground::new(root);
    let subjects: Vec<Subject> =
        subjects::all(root).into_iter().filter(|subject| only.is_none_or(|name| name == subject.name)).collect();
    if subjects.is_empty() {
        return Err(format!("--subject {}: there is none of that name", only.unwrap_or_default()));
    }
    let share = count.div_ceil(subjects.len() as u64);
    let mut faults = Vec::new();
    for subject in &subjects {
        if subject.texts.is_empty() {
            return Err(format!("{}: no text to change", subject.name));
        }
        let begin = Instant::now();
        let threads = std::thread::available_parallelism().map_or(1, |count| count.get() as u64);
        let done = AtomicU64::new(0);
        let clocks: Vec<Mutex<Option<(u64, Instant)>>> = (0..threads).map(|_| Mutex::new(None)).collect();
        let found = std::thread::scope(|scope| {
            let workers: Vec<_> = (0..threads)
                .zip(&clocks)
                .map(|(thread, now)| {
                    let (ground, done) = (&ground, &done);
                    scope.spawn(move || {
                        let numbers: Box<dyn Iterator<Item = u64>> = match one {
                            Some(number) => Box::new(std::iter::once(number).filter(move |_| thread == 0)),
                            None => Box::new((0..share).filter(move |number| number % threads == thread)),
                        };
                        let found = feed(subject, ground, seed, numbers, now);
                        done.fetch_add(1, Ordering::Relaxed);
                        found
                    })
                })
                .collect();
            while done.load(Ordering::Relaxed) < threads && !workers.iter().all(|worker| worker.is_finished()) {
                std::thread::sleep(Duration::from_millis(5));
                for now in &clocks {
                    if let Some((number, since)) = *now.lock().expect("no panic here")
                        && since.elapsed() > PATIENCE
                    {
                        // A thread cannot be ended: the process is.
                        keep(scratch, subject, seed, number);
                        eprintln!("{}: input {number} has run for {} s and no end", subject.name, PATIENCE.as_secs());
                        std::process::exit(1);
                    }
                }
            }
            workers.into_iter().flat_map(|worker| worker.join().expect("panics are caught inside")).collect::<Vec<_>>()
        });
        println!(
            "{:10} {:>9} inputs from {:>3} texts, {:>3} panics, {:.1} s",
            subject.name,
            if one.is_some() { 1 } else { share },
            subject.texts.len(),
            found.len(),
            begin.elapsed().as_secs_f64()
        );
        for fault in &found {
            keep(scratch, subject, seed, fault.input);
        }
        faults.extend(found);
    }
    Ok(faults)
}

/// Writes an input for a look at it.
fn keep(scratch: &Path, subject: &Subject, seed: u64, number: u64) {
    let written = std::fs::create_dir_all(scratch).and_then(|()| {
        std::fs::write(scratch.join(format!("{}-{seed}-{number}.txt", subject.name)), input(subject, seed, number).0)
    });
    if let Err(error) = written {
        eprintln!("{}: {error}", scratch.display());
    }
}

fn main() -> ExitCode {
    let (mut root, mut scratch, mut only) = (PathBuf::new(), PathBuf::new(), None);
    let (mut count, mut seed, mut one) = (1_000_000, 1, None);
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let value = words.next().unwrap_or_default();
        let number = value.parse::<u64>();
        match (word.as_str(), number) {
            ("--root", _) => root = value.into(),
            ("--scratch", _) => scratch = value.into(),
            ("--subject", _) => only = Some(value),
            ("--count", Ok(number)) => count = number,
            ("--seed", Ok(number)) => seed = number,
            ("--input", Ok(number)) => one = Some(number),
            _ => {
                eprintln!("{word} {value}: not known\n{USAGE}");
                return ExitCode::from(2);
            }
        }
    }
    // Panics are told at the end, once each.
    std::panic::set_hook(Box::new(|_| {}));
    match run(&root, &scratch, count, seed, only.as_deref(), one) {
        Err(why) => {
            eprintln!("{why}\n{USAGE}");
            ExitCode::from(2)
        }
        Ok(faults) => {
            for fault in &faults {
                println!("{}: input {} of seed {seed} panics: {}", fault.subject, fault.input, fault.words);
            }
            println!("{} panics", faults.len());
            if faults.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn root() -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
    }

    /// The quick part: a few hundred inputs of every subject. `cargo xtask fuzz` feeds a million.
    #[test]
    fn no_reader_panics() {
        let scratch = std::env::temp_dir().join(format!("rsm-fuzz-{}", std::process::id()));
        let faults = run(&root(), &scratch, 4000, 20, None, None).unwrap();
        let _ = std::fs::remove_dir_all(scratch);
        let told: Vec<String> =
            faults.iter().map(|fault| format!("{} {}: {}", fault.subject, fault.input, fault.words)).collect();
        assert!(told.is_empty(), "{}", told.join("\n"));
    }

    #[test]
    fn a_panic_is_found_and_an_input_is_always_the_same() {
        let subject = Subject {
            name: "comma",
            texts: vec!["a,b\n1,2\n".into()],
            feed: |_, text, _| assert!(!text.contains(";;"), "two semicolons"),
        };
        let found = feed(&subject, &Ground::new(&root()), 3, 0..3000, &Mutex::new(None));
        assert!(!found.is_empty() && found.iter().all(|fault| fault.words.contains("two semicolons")));
        assert!(input(&subject, 3, found[0].input).0.contains(";;"));
    }

    /// A text that no change spoils is fed whole: most of what a subcommand does is reached.
    #[test]
    fn some_changed_texts_are_still_valid() {
        let ground = Ground::new(&root());
        for subject in subjects::all(&root()) {
            assert!(!subject.texts.is_empty(), "{}", subject.name);
            (subject.feed)(&ground, &subject.texts[0], &mut Random(1));
        }
    }
}

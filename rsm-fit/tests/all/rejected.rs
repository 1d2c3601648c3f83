//! Invalid input is refused with exactly the message in the file beside it.
//!
//! `cases/rejected/NAME.toml` is a fit specification; the data that it names are beside it. `NAME.csv` without a `NAME.toml` is a data file, read
//! with the specification below. `NAME.txt` is the message. `RSM_BLESS=1` rewrites the messages; the difference is reviewed like code.

use std::path::{Path, PathBuf};

use rsm_core::source::Source;
use rsm_fit::fit::fit;
use rsm_fit::spec::Specification;

use crate::refused::{ACCEPTED, assert_beside, files};

/// The specification for the data files of the cases. It gives the unit of x; the header must give that of y.
fn for_data(name: &str) -> String {
    format!(
        "format = 1\nmodel = \"m\"\ndata = [\"{name}.csv\"]\n[inputs.x]\nunit = \"rad/s\"\n[responses.y]\ninputs = [\"x\"]\n\
         select = {{ method = \"fixed\", order = 1 }}\n"
    )
}

fn message(name: &str, text: String, folder: &Path) -> String {
    let specification = Specification::from_source(Source::new(format!("{name}.toml"), text), folder.to_path_buf());
    let message = match specification {
        Err(faults) => faults.to_string(),
        Ok(specification) => match fit(&specification, &mut |_| {}) {
            Err(refused) => refused.to_string(),
            Ok(outcome) => format!("{ACCEPTED}: {:?}", outcome.responses),
        },
    };
    // Names of data files include the folder, which is different on each machine.
    let folder = format!("{}{}", folder.display(), std::path::MAIN_SEPARATOR);
    message.replace(&folder, "")
}

/// The names of the cases with an extension, without this extension.
fn cases(folder: &Path, ending: &str) -> Vec<String> {
    files(folder, &[ending]).iter().map(|name| name.rsplit_once('.').unwrap().0.to_string()).collect()
}

#[test]
fn every_bad_file_gets_the_message_beside_it() {
    let folder: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cases/rejected");
    let specifications = cases(&folder, "toml");
    let data: Vec<String> = cases(&folder, "csv").into_iter().filter(|name| !specifications.contains(name)).collect();
    assert!(specifications.len() >= 12 && data.len() >= 10, "{} and {} cases", specifications.len(), data.len());
    let read = |name: &String| std::fs::read_to_string(folder.join(format!("{name}.toml"))).unwrap();
    let all = specifications.iter().map(|name| (name, read(name))).chain(data.iter().map(|name| (name, for_data(name))));
    assert_beside(&folder, all.map(|(name, text)| (format!("{name}.txt"), message(name, text, &folder))));
}

/// No text may cause a panic in a reader: every case, and a valid specification, cut off or with a missing character at many positions.
#[test]
fn mutilated_files_are_refused_without_a_panic() {
    let folder: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cases/rejected");
    let read = |name: String, ending: &str| std::fs::read(folder.join(format!("{name}.{ending}"))).unwrap();
    let good = for_data("nothing") + "coding = \"range\"\nknots = [{ input = \"x\", at = 1.0 }]\noutput_range = [0, 1]\n";
    let mut texts: Vec<Vec<u8>> = cases(&folder, "toml").into_iter().map(|name| read(name, "toml")).collect();
    texts.push(good.into_bytes());
    for text in texts {
        // A step of 5 keeps the test below a few seconds. Every position was tested once by hand.
        for at in (0..text.len()).step_by(5) {
            let cut = text[..at].to_vec();
            let lost = [&text[..at], &text[at + 1..]].concat();
            for bytes in [cut, lost] {
                let source = Source::new("m.toml", String::from_utf8_lossy(&bytes));
                if let Err(faults) = Specification::from_source(source, folder.clone()) {
                    assert!(!faults.to_string().is_empty());
                }
            }
        }
    }
    for name in cases(&folder, "csv") {
        let text = read(name, "csv");
        for at in 0..text.len() {
            for replaced in [b'"', b'\r', b'#', b'[', b','] {
                let mut bytes = text.clone();
                bytes[at] = replaced;
                let source = Source::new("m.csv", String::from_utf8_lossy(&bytes));
                let wanted = rsm_fit::table::Wanted { every_number: true, ..Default::default() };
                let _ = rsm_fit::table::Table::read(&source, &wanted);
            }
        }
    }
}

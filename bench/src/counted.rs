//! Instructions per evaluation, counted by callgrind.
//!
//! In: subjects, each a C function with its inputs. Out: for each, the number of instructions from the first load of an argument to the return,
//! including the call, if the number is the same at every point of a list (inside, bounds, outside, infinities and NaN); otherwise the points that
//! differ.
//!
//! Method: for every subject, a function `entry_k(const double *in)` in a separate file loads the arguments and calls the evaluator, which is in
//! another file, so nothing is inlined. The peers' benchmark counts from the same kind of entry, but inlines a small evaluator into it, so the count
//! here includes the loads and the call in addition (S1: 20 here, 18 there). A hand-written subject is inlined in both, so its count is the same as
//! there.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

use rsm_core::emit::{Kind, Unit};
use rsm_core::model::Input;
use rsm_core::number::Precision;

use crate::toolchain::{c_number, c_type, gcc, run, write};

/// A C function to be counted.
#[derive(Debug, Clone)]
pub struct Subject {
    /// The name and variant in reports.
    pub key: Key,
    /// Its arguments, in order.
    pub inputs: Vec<Input>,
    /// Its name in C.
    pub c_name: String,
    /// The type of its result in C.
    pub result: &'static str,
    /// The source text.
    pub code: Code,
}

/// The subject of a count.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Key {
    /// The name: `S1`, or model and surface.
    pub name: String,
    /// The variant: `extrapolate`, `clamp`, `horner`, or `generated`.
    pub variant: String,
    /// The scalar type.
    pub precision: Precision,
}

/// The source text of a subject.
#[derive(Debug, Clone)]
pub enum Code {
    /// A separate file with a header: name without extension, header, source.
    File(String, String, String),
    /// A static function of `const REAL *in`, compiled into the entry.
    Inline(String),
}

/// The subjects of an emitted unit. Steps are omitted: they need a state, and there is no other code to compare them with. `name` gives the reported
/// name of a surface; header and source are the emitted texts.
#[must_use]
pub fn subjects(unit: &Unit, variant: &str, name: impl Fn(&str) -> String, header: &str, source: &str) -> Vec<Subject> {
    let subject = |function: &rsm_core::emit::Function| {
        let (suffix, result) = match function.kind {
            Kind::Support => ("_support", "int"),
            // No benchmark emits gradients: a subject has one result.
            _ => ("", c_type(function.tape.precision)),
        };
        Subject {
            key: Key {
                name: name(&function.surface) + suffix,
                variant: variant.to_string(),
                precision: function.tape.precision,
            },
            inputs: function.inputs.clone(),
            c_name: function.c_name(&unit.model),
            result,
            code: Code::File(unit.model.clone(), header.to_string(), source.to_string()),
        }
    };
    unit.functions.iter().filter(|function| !function.has_state()).map(subject).collect()
}

/// The points at which the counts must agree, with their names. All inputs have the same kind of value: a branch on any of them would change the
/// count.
fn points(inputs: &[Input]) -> Vec<(&'static str, Vec<f64>)> {
    let at = |share: f64| inputs.iter().map(|i| i.range[0] + share * (i.range[1] - i.range[0])).collect::<Vec<_>>();
    let all = |value: f64| vec![value; inputs.len()];
    let bound = |which: usize| inputs.iter().map(|input| input.range[which]).collect::<Vec<_>>();
    vec![
        // The point of the peers' count.
        ("inside", at(0.37)),
        ("lower bounds", bound(0)),
        ("upper bounds", bound(1)),
        ("below", at(-1.0)),
        ("above", at(2.0)),
        ("minus infinity", all(f64::NEG_INFINITY)),
        ("infinity", all(f64::INFINITY)),
        ("NaN", all(f64::NAN)),
        ("subnormal", all(1e-310)),
    ]
}

/// Counts all subjects in one run. Writes its files to `folder`.
///
/// # Panics
/// If gcc or valgrind is missing or fails.
pub fn count(folder: &Path, subjects: &[Subject]) -> BTreeMap<Key, Result<u64, String>> {
    let mut sources = vec!["entries.c".to_string(), "main.c".to_string()];
    let mut entries = String::from("/* Loads the arguments and calls. */\n");
    let mut main = String::from("/* One function a subject and point, so that callgrind tells them apart. */\n");
    let mut calls = String::new();
    for (k, Subject { key, inputs, c_name, result, code }) in subjects.iter().enumerate() {
        let float = c_type(key.precision);
        match code {
            Code::Inline(text) => entries.push_str(text),
            Code::File(file, header, source) => {
                // The same model may come in several variants.
                let part = format!("{}/{file}", key.variant);
                write(folder, &format!("{part}.h"), header);
                write(folder, &format!("{part}.c"), source);
                let arguments = vec![float; inputs.len()].join(", ");
                let alias = format!("{}_{c_name}", key.variant);
                // Variants have the same C names of functions, so each function gets a unique name before linking.
                writeln!(entries, "extern {result} {alias}({arguments});").expect("a string takes any text");
                let object = format!("{part}.o");
                if !sources.contains(&object) {
                    run(Command::new("gcc").current_dir(folder).args(["-O2", "-c", &format!("{part}.c"), "-o", &object]));
                    run(Command::new("objcopy")
                        .current_dir(folder)
                        .arg(format!("--prefix-symbols={}_", key.variant))
                        .arg(&object));
                    sources.push(object);
                }
            }
        }
        let call = match code {
            Code::File(..) => {
                let loads: Vec<String> = (0..inputs.len()).map(|input| format!("in[{input}]")).collect();
                format!("{}_{c_name}({})", key.variant, loads.join(", "))
            }
            Code::Inline(_) => format!("{c_name}(in)"),
        };
        let noipa = "__attribute__((noipa))";
        writeln!(entries, "{noipa} {result} entry_{k}(const {float} *in) {{ return {call}; }}")
            .expect("a string takes any text");
        writeln!(main, "{result} entry_{k}(const {float} *); static volatile {result} sink_{k};")
            .expect("a string takes any text");
        for (j, (_, point)) in points(inputs).iter().enumerate() {
            let numbers: Vec<String> = point.iter().map(|value| c_number(*value)).collect();
            writeln!(
                main,
                "static const {float} in_{k}_{j}[] = {{{}}};\n\
                 static {noipa} void at_{k}_{j}(void) {{ sink_{k} = entry_{k}(in_{k}_{j}); }}",
                numbers.join(", ")
            )
            .expect("a string takes any text");
            writeln!(calls, "  at_{k}_{j}();").expect("a string takes any text");
        }
    }
    writeln!(main, "int main(void) {{\n{calls}  return 0;\n}}").expect("a string takes any text");
    write(folder, "entries.c", &entries);
    write(folder, "main.c", &main);
    gcc(folder, &sources, "counted");
    run(Command::new("valgrind").current_dir(folder).args([
        "--quiet",
        "--tool=callgrind",
        "--compress-strings=no",
        "--compress-pos=no",
        "--callgrind-out-file=callgrind.out",
        "./counted",
    ]));
    let profile = std::fs::read_to_string(folder.join("callgrind.out")).expect("callgrind wrote its profile");
    let inclusive = inclusive(&profile);
    let of = |name: String| *inclusive.get(&name).unwrap_or_else(|| panic!("{name} is not in the profile"));

    let mut counts = BTreeMap::new();
    for (k, subject) in subjects.iter().enumerate() {
        let points = points(&subject.inputs);
        let each: Vec<u64> = (0..points.len()).map(|j| of(format!("at_{k}_{j}"))).collect();
        let differs: Vec<String> = points
            .iter()
            .zip(&each)
            .filter(|(_, count)| **count != each[0])
            .map(|((name, _), count)| format!("{:+} at {name}", count.wrapping_sub(each[0]) as i64))
            .collect();
        let count = if differs.is_empty() {
            Ok(of(format!("entry_{k}")) / points.len() as u64)
        } else {
            Err(format!("instructions depend on the input; against those inside: {}", differs.join(", ")))
        };
        counts.insert(subject.key.clone(), count);
    }
    counts
}

/// The inclusive cost of every function in an uncompressed callgrind profile: its own lines, and the lines after `calls=`, which contain the
/// inclusive cost of the call.
fn inclusive(profile: &str) -> BTreeMap<String, u64> {
    let mut costs = BTreeMap::new();
    let mut function = None;
    for line in profile.lines() {
        if let Some(name) = line.strip_prefix("fn=") {
            function = Some(name.to_string());
        } else if line.starts_with(|first: char| first.is_ascii_digit()) {
            let cost = line.split_whitespace().nth(1).and_then(|cost| cost.parse::<u64>().ok()).unwrap_or(0);
            *costs.entry(function.clone().unwrap_or_default()).or_default() += cost;
        }
    }
    costs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inclusive_cost_has_the_calls_in_it() {
        let profile = "events: Ir\nfn=leaf\n3 7\n4 1\n\nfn=entry\n10 2\ncfn=leaf\ncalls=1 3\n10 8\n11 1\ntotals: 11\n";
        let costs = inclusive(profile);
        assert_eq!((costs["leaf"], costs["entry"]), (8, 11));
    }
}

//! A copy of the workspace in which one package contains all its mutants, and its test programs.
//!
//! In: the root of the workspace, a package, its files to change. Out: the mutants that compile, and the test programs. The copy stays in the target
//! folder, so a second run compiles only changed files. The workspace itself is never written.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::Value;
use syn::spanned::Spanned;
use syn::visit::{self, Visit};

use crate::instrument::{Mutant, instrument};

/// The number of compilation rounds: each omits the mutants that the compiler refused. Type errors hide borrowing errors, and these hide others.
const ROUNDS: usize = 20;

/// A package with its mutants.
pub(crate) struct Built {
    pub(crate) mutants: Vec<Mutant>,
    /// Mutants that the compiler refuses.
    pub(crate) refused: usize,
    pub(crate) programs: Vec<PathBuf>,
    /// The package's folder in the copy, where its tests run.
    pub(crate) folder: PathBuf,
}

/// The targets to compile.
#[derive(Clone, Copy)]
pub(crate) struct Targets {
    /// Only the unit tests of the library.
    pub(crate) unit: bool,
    /// Without optimisation. Most unit tests take seconds without it, and a package with its switches takes minutes to optimise.
    pub(crate) plain: bool,
}

/// Copies, changes and compiles into a folder.
pub(crate) fn build(
    root: &Path,
    scratch: &Path,
    folder: &Path,
    package: &str,
    files: &[String],
    targets: Targets,
) -> Result<Built, String> {
    // The copy is in a subfolder, so that the files that the tests read beside the workspace can be beside the copy.
    let tree = scratch.join("tree").join("workspace");
    let beside = scratch.join("tree").join("shared");
    if let Ok(shared) = root.join("../shared").canonicalize()
        && !beside.exists()
    {
        std::fs::create_dir_all(scratch.join("tree")).map_err(|error| error.to_string())?;
        std::os::unix::fs::symlink(shared, &beside).map_err(|error| error.to_string())?;
    }
    let sources = sources(root)?;
    let changed: BTreeSet<&String> = files.iter().collect();
    let library = format!("{package}/src/lib.rs");
    for name in sources.iter().filter(|name| !changed.contains(name) && **name != library) {
        let text = std::fs::read(root.join(name)).map_err(|error| format!("{name}: {error}"))?;
        write(&tree.join(name), &text)?;
    }
    forget_others(&tree, &tree, &sources, package)?;
    let mut left_out = BTreeSet::new();
    for _ in 0..ROUNDS {
        let mut mutants = Vec::new();
        let mut next = 0;
        for name in files {
            let text = std::fs::read_to_string(root.join(name)).map_err(|error| format!("{name}: {error}"))?;
            let (text, found, after) = instrument(&text, name, next, &left_out)?;
            next = after;
            write(&tree.join(name), text.as_bytes())?;
            mutants.extend(found);
        }
        let switch = include_str!("mutant_switch.rs.txt").replace("COUNT", &next.to_string());
        write(&tree.join(package).join("src/mutant_switch.rs"), switch.as_bytes())?;
        let from = if changed.contains(&library) { tree.join(&library) } else { root.join(&library) };
        let text = std::fs::read_to_string(from).map_err(|error| format!("{library}: {error}"))?;
        write(&tree.join(&library), format!("{text}\nmod mutant_switch;\n").as_bytes())?;
        let Compiled { programs, errors } = compile(&tree, scratch, folder, package, targets)?;
        if errors.is_empty() {
            return Ok(Built { mutants, refused: left_out.len(), programs, folder: tree.join(package) });
        }
        let refused = refused(&tree, files, &errors)?;
        println!("   {} mutants do not compile, left out", refused.len());
        left_out.extend(refused);
    }
    Err(format!("after {ROUNDS} rounds some mutants still do not compile"))
}

/// The files that git tracks or does not ignore.
fn sources(root: &Path) -> Result<BTreeSet<String>, String> {
    let output = Command::new("git")
        .args(["ls-files", "--cached", "--others", "--exclude-standard", "-z"])
        .current_dir(root)
        .output()
        .map_err(|error| format!("cannot start git: {error}"))?;
    let text = String::from_utf8(output.stdout).map_err(|error| error.to_string())?;
    Ok(text.split('\0').filter(|name| !name.is_empty() && root.join(name).is_file()).map(str::to_owned).collect())
}

/// Writes a file only if it differs, so that cargo detects exactly the changes.
fn write(file: &Path, text: &[u8]) -> Result<(), String> {
    if std::fs::read(file).is_ok_and(|old| old == text) {
        return Ok(());
    }
    let folder = file.parent().expect("a file has a folder");
    std::fs::create_dir_all(folder)
        .and_then(|()| std::fs::write(file, text))
        .map_err(|error| format!("{}: {error}", file.display()))
}

/// Removes from the copy the files that are no longer source files.
fn forget_others(tree: &Path, folder: &Path, sources: &BTreeSet<String>, package: &str) -> Result<(), String> {
    let ours = format!("{package}/src/mutant_switch.rs");
    for entry in std::fs::read_dir(folder).map_err(|error| error.to_string())?.flatten() {
        let path = entry.path();
        if path.is_dir() {
            forget_others(tree, &path, sources, package)?;
        } else if let Ok(name) = path.strip_prefix(tree)
            && let Some(name) = name.to_str()
            && !sources.contains(name)
            && name != ours
        {
            std::fs::remove_file(&path).map_err(|error| format!("{}: {error}", path.display()))?;
        }
    }
    Ok(())
}

/// The position of a compiler error: file from the root, line, column.
type Place = (String, usize, usize);

/// The result of the compiler: test programs, and errors with their messages and positions.
struct Compiled {
    programs: Vec<PathBuf>,
    errors: Vec<(String, Vec<Place>)>,
}

/// Compiles the tests of the copy.
fn compile(tree: &Path, scratch: &Path, build: &Path, package: &str, of: Targets) -> Result<Compiled, String> {
    let plain = format!("--config=profile.dev.package.{package}.opt-level=0");
    let mut targets = vec!["--lib"];
    if !of.unit {
        targets.push("--tests");
    }
    if of.plain {
        targets.push(&plain);
    }
    // A changed program contains code that a lint refuses: unused results, comparisons that are always true. Cargo keeps the results of a wrapper
    // apart by its path, and only those of the workspace: crates from outside are those of any other build in the same folder.
    let wrapper = scratch.join("rustc-without-lints");
    write(&wrapper, b"#!/bin/sh\nexec \"$@\" --cap-lints allow\n")?;
    std::fs::set_permissions(&wrapper, std::os::unix::fs::PermissionsExt::from_mode(0o755))
        .map_err(|error| format!("{}: {error}", wrapper.display()))?;
    let output = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
        .args(["test", "-p", package, "--no-run", "--message-format=json"])
        .args(targets)
        .current_dir(tree)
        .env("CARGO_TARGET_DIR", build)
        .env("RUSTC_WORKSPACE_WRAPPER", wrapper)
        .stderr(Stdio::piped())
        .output()
        .map_err(|error| format!("cannot start cargo: {error}"))?;
    let (mut programs, mut errors) = (Vec::new(), Vec::new());
    for line in String::from_utf8_lossy(&output.stdout).lines() {
        let Ok(message) = serde_json::from_str::<Value>(line) else { continue };
        let is_test = message["profile"]["test"] == true;
        if message["reason"] == "compiler-artifact"
            && is_test
            && let Some(program) = message["executable"].as_str()
        {
            programs.push(PathBuf::from(program));
        }
        let found = &message["message"];
        if message["reason"] == "compiler-message" && found["level"] == "error" {
            // The error's own position first, then its labels, then its notes. For example, without an assignment a value is moved twice elsewhere,
            // and only a note names the assignment.
            let mut places: Vec<(bool, Place)> = spans(found);
            places.sort();
            places.extend(found["children"].as_array().into_iter().flatten().flat_map(spans));
            let places: Vec<Place> = places.into_iter().map(|(_, place)| place).collect();
            if !places.is_empty() {
                errors.push((found["rendered"].as_str().unwrap_or_default().to_owned(), places));
            }
        }
    }
    if !output.status.success() && errors.is_empty() {
        return Err(format!("cargo failed:\n{}", String::from_utf8_lossy(&output.stderr)));
    }
    Ok(Compiled { programs, errors })
}

/// The positions in a message, each with whether it is secondary.
fn spans(message: &Value) -> Vec<(bool, Place)> {
    let place = |span: &Value| {
        let number = |key: &str| span[key].as_u64().unwrap_or(0) as usize;
        let file = span["file_name"].as_str().unwrap_or_default().to_owned();
        (span["is_primary"] == false, (file, number("line_start"), number("column_start")))
    };
    message["spans"].as_array().into_iter().flatten().map(place).collect()
}

/// The mutants that cause the errors.
fn refused(tree: &Path, files: &[String], errors: &[(String, Vec<Place>)]) -> Result<BTreeSet<usize>, String> {
    let mut switches: BTreeMap<&String, Vec<Switch>> = BTreeMap::new();
    for name in files {
        let text = std::fs::read_to_string(tree.join(name)).map_err(|error| format!("{name}: {error}"))?;
        let parsed = syn::parse_file(&text).map_err(|error| format!("{name}: {error}"))?;
        let mut finder = Finder { found: Vec::new() };
        finder.visit_file(&parsed);
        switches.insert(name, finder.found);
    }
    let mut refused = BTreeSet::new();
    for (words, places) in errors {
        let about = places.iter().find_map(|(file, line, column)| {
            let at = (*line, *column);
            let here = switches.get(file)?;
            let smallest = |range: fn(&Switch) -> Range| {
                here.iter().filter(|switch| holds(range(switch), at)).min_by_key(|switch| size(range(switch)))
            };
            smallest(|switch| switch.changed).or_else(|| smallest(|switch| switch.whole))
        });
        match about {
            Some(switch) => refused.insert(switch.number),
            None => return Err(format!("an error that belongs to no mutant:\n{words}")),
        };
    }
    Ok(refused)
}

/// From line and column to line and column, counted from 1.
type Range = [(usize, usize); 2];

fn holds([from, to]: Range, at: (usize, usize)) -> bool {
    from <= at && at <= to
}

fn size([from, to]: Range) -> (usize, usize) {
    (to.0 - from.0, if to.0 == from.0 { to.1 - from.1 } else { to.1 })
}

fn range(item: &impl Spanned) -> Range {
    let span = item.span();
    [(span.start().line, span.start().column + 1), (span.end().line, span.end().column + 1)]
}

/// A switch in the changed text: the range of its changed branch, and the range of the whole.
struct Switch {
    number: usize,
    changed: Range,
    whole: Range,
}

struct Finder {
    found: Vec<Switch>,
}

/// The number in `crate::mutant_switch::on(7)`, negated or not.
fn number(condition: &syn::Expr) -> Option<usize> {
    match condition {
        syn::Expr::Unary(unary) => number(&unary.expr),
        syn::Expr::Call(call) => {
            let syn::Expr::Path(path) = call.func.as_ref() else { return None };
            if path.path.segments.iter().any(|segment| segment.ident == "mutant_switch")
                && let Some(syn::Expr::Lit(literal)) = call.args.first()
                && let syn::Lit::Int(number) = &literal.lit
            {
                return number.base10_parse().ok();
            }
            None
        }
        _ => None,
    }
}

impl<'ast> Visit<'ast> for Finder {
    fn visit_expr_if(&mut self, choice: &'ast syn::ExprIf) {
        if let Some(number) = number(&choice.cond) {
            self.found.push(Switch { number, changed: range(&choice.then_branch), whole: range(choice) });
        }
        visit::visit_expr_if(self, choice);
    }

    fn visit_arm(&mut self, arm: &'ast syn::Arm) {
        if let Some((_, guard)) = &arm.guard
            && let Some(number) = number(guard)
        {
            self.found.push(Switch { number, changed: range(arm), whole: range(arm) });
        }
        visit::visit_arm(self, arm);
    }
}

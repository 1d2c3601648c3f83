//! Modules of one folder must not use each other in a circle.
//!
//! In: the sources of the library crates. Out: for each folder the groups of modules that use each other in a circle. A module is a file, or a folder
//! with everything in it. It uses the paths in its code that begin with `crate`, `self` or `super`; tests and the items of the parent do not count.
//! Of two modules in a circle, neither can be read, tested or moved without the other.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use proc_macro2::{Delimiter, TokenStream, TokenTree};
use rsm_tests::cases;

/// The library crates.
const CRATES: &[&str] =
    &["rsm-core", "rsm-macros", "rsm-fit", "rsm-import", "rsm-sim", "rsm-model", "rsm-rigs", "rsm-diagnose", "rsm-sweep"];

/// Names from the root of a crate on.
type Names = Vec<String>;

/// The paths that each module of a crate uses.
type Uses = BTreeMap<Names, BTreeSet<Names>>;

/// The tokens without tests: an item after `#[cfg(test)]` or `#[test]` is left out.
fn without_tests(stream: TokenStream) -> Vec<TokenTree> {
    let mut kept = Vec::new();
    let mut tokens = stream.into_iter().peekable();
    while let Some(token) = tokens.next() {
        let is_hash = matches!(&token, TokenTree::Punct(it) if it.as_char() == '#');
        let of_test = match tokens.peek() {
            Some(TokenTree::Group(it)) if is_hash => ["cfg (test)", "test"].contains(&it.stream().to_string().as_str()),
            _ => false,
        };
        if !of_test {
            kept.push(token);
            continue;
        }
        let ends = |it: &TokenTree| match it {
            TokenTree::Punct(it) => it.as_char() == ';',
            TokenTree::Group(it) => it.delimiter() == Delimiter::Brace,
            _ => false,
        };
        while tokens.next().is_some_and(|it| !ends(&it)) {}
    }
    kept
}

/// Whether two colons stand at a place.
fn is_path(tokens: &[TokenTree], at: usize) -> bool {
    let is_colon = |at: usize| matches!(tokens.get(at), Some(TokenTree::Punct(it)) if it.as_char() == ':');
    is_colon(at) && is_colon(at + 1)
}

/// The names of a use tree behind some names, and where it ends.
fn tree(tokens: &[TokenTree], at: usize, before: &Names, found: &mut Vec<Names>) -> usize {
    match tokens.get(at) {
        Some(TokenTree::Ident(name)) => {
            let mut names = before.clone();
            names.push(name.to_string());
            if is_path(tokens, at + 1) {
                return tree(tokens, at + 3, &names, found);
            }
            found.push(names);
            at + 1
        }
        Some(TokenTree::Group(group)) if group.delimiter() == Delimiter::Brace => {
            let inner: Vec<TokenTree> = group.stream().into_iter().collect();
            let mut next = 0;
            while next < inner.len() {
                next = tree(&inner, next, before, found).max(next + 1);
            }
            at + 1
        }
        // `*`, or generic arguments.
        _ => {
            found.push(before.clone());
            at
        }
    }
}

/// All paths of some code: those that begin with `crate`, `self`, `super` or one of the given names.
fn paths(tokens: &[TokenTree], children: &BTreeSet<String>, found: &mut Vec<Names>) {
    let mut at = 0;
    while at < tokens.len() {
        if let TokenTree::Group(group) = &tokens[at] {
            paths(&without_tests(group.stream()), children, found);
        }
        let follows = at >= 2 && is_path(tokens, at - 2);
        let begins = matches!(&tokens[at], TokenTree::Ident(name) if {
            let name = name.to_string();
            ["crate", "self", "super"].contains(&name.as_str()) || children.contains(&name)
        });
        at = if begins && !follows && is_path(tokens, at + 1) {
            tree(tokens, at, &Vec::new(), found).max(at + 1)
        } else {
            at + 1
        };
    }
}

/// A path from the root of the crate on, as seen from a module.
fn absolute(path: &Names, module: &Names) -> Names {
    let mut place = module.clone();
    let mut rest = path.as_slice();
    match rest.first().map(String::as_str) {
        Some("crate") => (place, rest) = (Vec::new(), &rest[1..]),
        Some("self") => rest = &rest[1..],
        _ => {}
    }
    while rest.first().is_some_and(|it| it == "super") {
        place.pop();
        rest = &rest[1..];
    }
    place.extend(rest.iter().cloned());
    place
}

/// Reads the modules of a folder and of the folders in it.
fn read(folder: &Path, module: &Names, uses: &mut Uses) {
    let mut children = BTreeSet::new();
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display())) {
        let path = entry.expect("a folder that can be read").path();
        let stem = path.file_stem().expect("a name").to_string_lossy().into_owned();
        let is_own = ["mod", "lib", "main"].contains(&stem.as_str());
        if !is_own && stem != "tests" {
            children.insert(stem.clone());
            let mut inner = module.clone();
            inner.push(stem);
            if path.is_dir() {
                read(&path, &inner, uses);
            } else if path.extension().is_some_and(|it| it == "rs") {
                files.push((path, inner));
            }
        } else if is_own {
            files.push((path, module.clone()));
        }
    }
    for (path, place) in files {
        let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let stream: TokenStream = text.parse().unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let mut found = Vec::new();
        // A file names its own children without a word before them.
        let own = if place == *module { children.clone() } else { uses_children(&path) };
        paths(&without_tests(stream), &own, &mut found);
        uses.entry(place.clone()).or_default().extend(found.iter().map(|it| absolute(it, &place)));
    }
}

/// The modules in the folder beside a file of the same name.
fn uses_children(file: &Path) -> BTreeSet<String> {
    let folder = file.with_extension("");
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter_map(|it| Some(it.path().file_stem()?.to_string_lossy().into_owned())).collect()
}

/// For each folder: what its modules use of each other.
fn folders(uses: &Uses) -> BTreeMap<Names, BTreeMap<String, BTreeSet<String>>> {
    let mut folders: BTreeMap<Names, BTreeMap<String, BTreeSet<String>>> = BTreeMap::new();
    let modules: BTreeSet<Names> = uses.keys().flat_map(|it| (1..=it.len()).map(|n| it[..n].to_vec())).collect();
    for (from, targets) in uses {
        for target in targets {
            let common = from.iter().zip(target).take_while(|(a, b)| a == b).count();
            if common < from.len() && common < target.len() && modules.contains(&target[..=common]) {
                let folder = folders.entry(from[..common].to_vec()).or_default();
                folder.entry(from[common].clone()).or_default().insert(target[common].clone());
            }
        }
    }
    folders
}

/// All that can be reached from a module.
fn reached<'g>(graph: &'g BTreeMap<String, BTreeSet<String>>, from: &'g str) -> BTreeSet<&'g str> {
    let (mut found, mut open) = (BTreeSet::new(), vec![from]);
    while let Some(module) = open.pop() {
        for next in graph.get(module).into_iter().flatten() {
            if found.insert(next.as_str()) {
                open.push(next);
            }
        }
    }
    found
}

/// Groups of modules that reach each other.
fn circles(graph: &BTreeMap<String, BTreeSet<String>>) -> BTreeSet<Vec<&str>> {
    let reach: BTreeMap<&str, BTreeSet<&str>> = graph.keys().map(|it| (it.as_str(), reached(graph, it))).collect();
    let in_circles = reach.iter().filter(|(module, found)| found.contains(*module));
    in_circles
        .map(|(module, found)| found.iter().copied().filter(|it| reach.get(it).is_some_and(|it| it.contains(module))).collect())
        .collect()
}

/// Of one crate: each circle as its folder and its modules.
fn circles_of(source: &Path, name: &str) -> BTreeSet<(String, Vec<String>)> {
    let mut uses = Uses::new();
    read(source, &Vec::new(), &mut uses);
    let mut found = BTreeSet::new();
    for (folder, graph) in folders(&uses) {
        let place = std::iter::once(format!("{name}/src")).chain(folder).collect::<Vec<_>>().join("/");
        found.extend(circles(&graph).into_iter().map(|it| (place.clone(), it.into_iter().map(str::to_string).collect())));
    }
    found
}

#[test]
fn modules_of_a_folder_do_not_use_each_other_in_a_circle() {
    let root = cases::root();
    let found: BTreeSet<(String, Vec<String>)> =
        CRATES.iter().flat_map(|name| circles_of(&root.join(name).join("src"), name)).collect();
    assert!(found.is_empty(), "circles of modules, each with its folder: {found:#?}");
}

#[test]
fn a_circle_over_three_files_is_found_and_tests_and_parents_make_none() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("cycles");
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(folder.join("inner")).unwrap();
    let files = [
        ("lib.rs", "mod a; mod b; mod inner; mod d; pub struct Item;"),
        ("a.rs", "use crate::b::{self, One}; fn f() { g(super::Item) }"),
        ("b.rs", "pub struct One; fn f() -> i32 { crate::inner::deep::f() }"),
        ("inner/mod.rs", "pub mod deep; mod other; fn f() { other::f() }"),
        ("inner/deep.rs", "pub fn f() -> i32 { vec![super::super::a::f()].len() as i32 }"),
        // Its test uses a file that uses it, and so does nothing else.
        ("inner/other.rs", "pub fn f() {} #[cfg(test)] mod tests { use super::super::deep; }"),
        ("d.rs", "use crate::a; #[cfg(test)] use crate::e;"),
    ];
    for (name, text) in files {
        std::fs::write(folder.join(name), text).unwrap();
    }
    let expected: BTreeSet<(String, Vec<String>)> =
        [("x/src".to_string(), ["a", "b", "inner"].map(str::to_string).to_vec())].into_iter().collect();
    assert_eq!(circles_of(&folder, "x"), expected);
}

//! `cargo xtask book`: builds the book and checks every link of the built pages.
//!
//! In: `docs/book`. Out: HTML in `target/xtask/book`, and whether the target of every link and anchor exists. `tests/all/book.rs` checks the sources
//! without mdbook; this checks the pages that mdbook built.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};
use std::process::{Command, Stdio};

use crate::stage::Run;
use crate::workspace::{cargo, root, scratch};

/// The version of mdbook that is installed if the search path has none. Its first build takes 160 s of processor time.
const MDBOOK: &str = "0.5.4";

/// Builds the book and checks its links.
pub(crate) fn run() -> bool {
    let mut run = Run::new();
    let mdbook = if is_on_the_path() {
        PathBuf::from("mdbook")
    } else {
        let folder = scratch("mdbook");
        let program = folder.join("bin").join(format!("mdbook{}", std::env::consts::EXE_SUFFIX));
        if !program.is_file() {
            run.command("install mdbook", {
                // A separate build, so that nothing of the workspace is compiled again for it.
                let mut install = cargo(&["install", "mdbook", "--version", MDBOOK, "--locked", "--no-default-features"]);
                install.arg("--root").arg(&folder).env_remove("CARGO_TARGET_DIR");
                install
            });
        }
        program
    };
    let pages = scratch("book");
    run.command("build", {
        let mut build = Command::new(mdbook);
        build.current_dir(root()).args(["build", "docs/book", "--dest-dir"]).arg(&pages);
        build
    })
    .check("links", || check_links(&pages));
    let held = run.finish();
    if held {
        println!("\nthe book: {}", pages.join("index.html").display());
    }
    held
}

fn is_on_the_path() -> bool {
    Command::new("mdbook").arg("--version").stdout(Stdio::null()).status().is_ok_and(|status| status.success())
}

/// Checks that every link of every page leads to a file, and to an anchor of it.
fn check_links(folder: &Path) -> Result<(), String> {
    let mut pages = BTreeMap::new();
    collect(folder, &mut pages).map_err(|error| format!("{}: {error}", folder.display()))?;
    if pages.len() < 10 {
        return Err(format!("{} pages in {}: that is not the book", pages.len(), folder.display()));
    }
    let (broken, links) = broken(&pages, |file| file.exists());
    println!("{} pages, {links} links", pages.len());
    if broken.is_empty() { Ok(()) } else { Err(format!("links that lead nowhere:\n    {}", broken.join("\n    "))) }
}

/// The text of every page below a folder. 404.html has links for a server's root.
fn collect(folder: &Path, pages: &mut BTreeMap<PathBuf, String>) -> std::io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            collect(&path, pages)?;
        } else if path.extension().is_some_and(|it| it == "html") && path.file_name().is_some_and(|it| it != "404.html") {
            let text = std::fs::read_to_string(&path)?;
            pages.insert(path, text);
        }
    }
    Ok(())
}

/// Links without a target, each with its page, and the number of links.
fn broken(pages: &BTreeMap<PathBuf, String>, exists: impl Fn(&Path) -> bool) -> (Vec<String>, usize) {
    let anchors: BTreeMap<&Path, BTreeSet<&str>> =
        pages.iter().map(|(path, text)| (path.as_path(), values(text, "id").collect())).collect();
    let mut broken = Vec::new();
    let mut links = 0;
    for (page, text) in pages {
        for link in values(text, "href").chain(values(text, "src")) {
            if link.is_empty() || link.contains(':') || link.starts_with("//") {
                continue;
            }
            links += 1;
            let (file, anchor) = link.split_once('#').unwrap_or((link, ""));
            let file = file.split('?').next().unwrap_or(file);
            let target = if file.is_empty() { page.clone() } else { plain(&page.parent().unwrap_or(Path::new("")).join(file)) };
            let is_there = match anchors.get(target.as_path()) {
                Some(known) => anchor.is_empty() || known.contains(anchor),
                None => exists(&target),
            };
            if !is_there {
                broken.push(format!("{}: {link}", page.display()));
            }
        }
    }
    (broken, links)
}

/// The values of an attribute, as HTML writers print them: in double quotes.
fn values<'a>(text: &'a str, attribute: &str) -> impl Iterator<Item = &'a str> {
    let opening = format!(" {attribute}=\"");
    let length = opening.len();
    let places: Vec<usize> = text.match_indices(&opening).map(|(place, _)| place + length).collect();
    places.into_iter().filter_map(move |place| text[place..].split('"').next())
}

/// A path without `.` and `..`.
fn plain(path: &Path) -> PathBuf {
    let mut plain = PathBuf::new();
    for part in path.components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir => {
                plain.pop();
            }
            part => plain.push(part),
        }
    }
    plain
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_link_to_a_page_or_an_anchor_that_is_not_there_is_found() {
        let page = |name: &str, text: &str| (Path::new("/book").join(name), text.to_string());
        let pages = BTreeMap::from([
            page(
                "a.html",
                "<h1 id=\"top\">A</h1> <a href=\"sub/b.html#one\">b</a> <a href=\"#top\">up</a> <a href=\"https://x.org/\">x</a>",
            ),
            page(
                "sub/b.html",
                "<h2 id=\"one\">B</h2> <a href=\"../a.html#none\">a</a> <a href=\"c.html\">c</a> <img src=\"../style.svg\">",
            ),
        ]);
        let (broken, links) = broken(&pages, |file| file == Path::new("/book/style.svg"));
        assert_eq!(broken, ["/book/sub/b.html: ../a.html#none", "/book/sub/b.html: c.html"]);
        assert_eq!(links, 5);
    }
}

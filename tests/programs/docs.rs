//! What the pages say of the repository is there: links, anchors, images, paths. And a
//! page of the handbook stays short enough to be read.

use std::fs;
use std::path::{Path, PathBuf};

/// Most words of a page of the handbook.
const MOST_WORDS: usize = 1500;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Files below a folder whose names end so, sorted.
fn files(folder: &Path, end: &str) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let mut found = Vec::new();
    for path in entries.map(|entry| entry.unwrap().path()) {
        if path.is_dir() {
            found.extend(files(&path, end));
        } else if path.to_string_lossy().ends_with(end) {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// Every page that a reader of the repository meets.
fn pages() -> Vec<PathBuf> {
    let mut pages = vec![root().join("README.md"), root().join("SECURITY.md"), root().join("fuzz/README.md")];
    ["docs", "bags"].iter().for_each(|folder| pages.extend(files(&root().join(folder), ".md")));
    let crates = fs::read_dir(root().join("crates")).unwrap().map(|entry| entry.unwrap().path().join("README.md"));
    pages.extend(crates.filter(|page| page.exists()));
    pages
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The page without its blocks of code.
fn prose(text: &str) -> String {
    text.split("```").step_by(2).collect()
}

/// Where the links and images of a page go, those to other sites left out.
fn links(text: &str) -> Vec<String> {
    let ends = |rest: &str| rest.split([')', ' ']).next().unwrap_or_default().to_owned();
    text.split("](").skip(1).map(ends).filter(|link| !link.contains("://")).collect()
}

/// The anchor that GitHub gives to a heading.
fn anchor(heading: &str) -> String {
    let kept = heading.to_lowercase();
    kept.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c)).map(|c| if c == ' ' { '-' } else { c }).collect()
}

fn has_anchor(page: &Path, wanted: &str) -> bool {
    prose(&read(page))
        .lines()
        .filter_map(|line| line.trim_start_matches('#').strip_prefix(' ').filter(|_| line.starts_with('#')))
        .any(|heading| anchor(heading) == wanted)
}

#[test]
fn links_and_images_lead_somewhere() {
    let mut broken = Vec::new();
    for page in pages() {
        for link in links(&prose(&read(&page))) {
            let (file, anchor) = link.split_once('#').unwrap_or((link.as_str(), ""));
            let target = if file.is_empty() { page.clone() } else { page.parent().unwrap().join(file) };
            if !target.exists() || !(anchor.is_empty() || has_anchor(&target, anchor)) {
                broken.push(format!("{}: {link}", page.display()));
            }
        }
    }
    assert!(broken.is_empty(), "links that lead nowhere:\n{}", broken.join("\n"));
}

/// Paths of this repository in a text: words that begin with one of its folders and end as a file does.
fn paths(text: &str) -> Vec<String> {
    let folders = ["crates/", "docs/", "examples/", "launch-scripts/", "src/", "tests/"];
    let words = text.split(|c: char| !(c.is_alphanumeric() || "/_.-".contains(c)));
    let file = |word: &&str| {
        folders.iter().any(|f| word.starts_with(f))
            && [".rs", ".md", ".py", ".sh", ".toml", ".yaml"].iter().any(|e| word.ends_with(e))
    };
    words.map(|word| word.trim_end_matches('.')).filter(file).map(ToOwned::to_owned).collect()
}

#[test]
fn paths_that_pages_and_comments_name_exist() {
    let mut wrong = Vec::new();
    let sources = files(&root().join("src"), ".rs").into_iter().chain(files(&root().join("crates"), ".rs"));
    let comments = sources.map(|file| {
        let lines: Vec<String> =
            read(&file).lines().map(str::trim_start).filter(|l| l.starts_with("//")).map(ToOwned::to_owned).collect();
        (file, lines.join("\n"))
    });
    let texts = pages().into_iter().map(|page| {
        let text = read(&page);
        (page, text)
    });
    for (file, text) in texts.chain(comments) {
        // findings for other projects name their files
        if file.components().any(|part| part.as_os_str() == "upstream") {
            continue;
        }
        let inside = root()
            .join("crates")
            .join(file.strip_prefix(root().join("crates")).ok().and_then(|p| p.iter().next()).unwrap_or_default());
        let missing =
            paths(&text).into_iter().filter(|path| !root().join(path).exists() && !inside.join(path).exists());
        wrong.extend(missing.map(|path| format!("{}: {path}", file.display())));
    }
    assert!(wrong.is_empty(), "paths that are not there:\n{}", wrong.join("\n"));
}

#[test]
fn a_page_of_the_handbook_is_short() {
    let handbook =
        files(&root().join("docs"), ".md").into_iter().filter(|page| page.parent() == Some(&root().join("docs")));
    let long: Vec<String> = handbook
        .map(|page| (read(&page).split_whitespace().count(), page))
        .filter(|(words, _)| *words >= MOST_WORDS)
        .map(|(words, page)| format!("{}: {words} words", page.display()))
        .collect();
    assert!(long.is_empty(), "pages of {MOST_WORDS} words and more:\n{}", long.join("\n"));
}

//! What the pages say of the repository is there: links, anchors, images, paths, the table of
//! constants.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

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
    let mut pages = vec![
        root().join("README.md"),
        root().join("SECURITY.md"),
        root().join("CONTRIBUTING.md"),
        root().join("CODE_OF_CONDUCT.md"),
        root().join("CHANGELOG.md"),
        root().join("fuzz/README.md"),
    ];
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
fn no_page_has_what_a_merge_left_behind() {
    let left = |line: &str| ["<<<<<<< ", ">>>>>>> "].iter().any(|mark| line.starts_with(mark)) || line == "=======";
    let pages: Vec<_> = pages().into_iter().filter(|page| read(page).lines().any(left)).collect();
    assert!(pages.is_empty(), "{pages:?}");
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

/// Rows of the table of constants, file, name, value: | `crates/needle_core/src/twin/pace.rs` `LAG` | 6.0 | ...
fn constants() -> Vec<[String; 3]> {
    let page = read(&root().join("docs/constants.md")) + &read(&root().join("docs/lab/constants.md"));
    let row = |line: &str| {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let words: Vec<&str> = cells[1].split('`').skip(1).step_by(2).collect();
        <[&str; 2]>::try_from(words).ok().map(|[file, name]| [file, name, cells[2]].map(ToOwned::to_owned))
    };
    page.lines().filter(|line| line.starts_with("| `")).filter_map(row).collect()
}

/// Value of a constant in a source.
fn value(source: &str, name: &str) -> Option<String> {
    let declaration = format!("const {name}: ");
    let line = source.lines().find(|line| line.contains(&declaration))?;
    line.split_once(" = ").map(|(_, value)| value.trim_end_matches(';').to_owned())
}

#[test]
fn the_table_of_constants_has_the_values_of_the_code() {
    let rows = constants();
    assert!(rows.len() > 60, "only {} rows were found", rows.len());
    let wrong: Vec<String> = rows
        .into_iter()
        .map(|[file, name, page]| (value(&read(&root().join(&file)), &name), file, name, page))
        .filter(|(code, _, _, page)| code.as_ref() != Some(page))
        .map(|(code, file, name, page)| format!("{file} {name}: the page says {page}, the code {code:?}"))
        .collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Names of the constants that are numbers, outside of tests.
fn numbers(source: &str) -> Vec<String> {
    let code = source.split("#[cfg(test)]").next().unwrap_or_default();
    let declarations = code.lines().filter(|line| !line.trim_start().starts_with("//") && line.contains(" = "));
    let named = declarations.filter_map(|line| line.split_once("const ")?.1.split_once(": "));
    let number =
        |kind: &str| ["f64", "u32", "i32", "usize", "[f64", "(f64", "[(f64"].iter().any(|n| kind.starts_with(n));
    named.filter(|(_, kind)| number(kind)).map(|(name, _)| name.to_owned()).collect()
}

#[test]
fn no_constant_of_the_model_is_left_out() {
    let pages = read(&root().join("docs/constants.md")) + &read(&root().join("docs/lab/constants.md"));
    let rooms = [
        "crates/mtled/src",
        "crates/mtled_cloud/src",
        "crates/needle_core/src/twin",
        "crates/needle_core/src/instrument",
        "crates/needle_estimate/src/compare",
    ]
    .map(|room| files(&root().join(room), ".rs"));
    let missing: Vec<String> = rooms
        .into_iter()
        .flatten()
        .flat_map(|file| numbers(&read(&file)).into_iter().map(move |name| (file.clone(), name)))
        .filter(|(_, name)| !pages.contains(&format!("`{name}`")))
        .map(|(file, name)| format!("{}: {name}", file.display()))
        .collect();
    assert!(
        missing.is_empty(),
        "constants on neither docs/constants.md nor docs/lab/constants.md:\n{}",
        missing.join("\n")
    );
}

/// Lines of the blocks of shell commands that run a sub-command, without their comments.
fn commands(text: &str) -> Vec<String> {
    let blocks = text.split("```").skip(1).step_by(2).filter_map(|block| block.strip_prefix("sh\n"));
    let lines = blocks.flat_map(str::lines).map(|line| line.split(" #").next().unwrap_or_default().trim().to_owned());
    lines.filter(|line| line.starts_with("needle_twin ") && !line.contains("--ros-args")).collect()
}

/// What `needle_twin SUB-COMMAND --help` says.
fn help(command: &[&str]) -> String {
    let program = Command::new(env!("CARGO_BIN_EXE_needle_twin")).args(command).arg("--help").output().unwrap();
    assert!(program.status.success(), "needle_twin {command:?} --help: {}", String::from_utf8_lossy(&program.stderr));
    String::from_utf8(program.stdout).unwrap()
}

#[test]
fn commands_of_the_handbook_have_options_that_exist() {
    let lines: BTreeSet<String> = pages().iter().flat_map(|page| commands(&read(page))).collect();
    assert!(lines.len() > 20, "only {} commands were found", lines.len());
    for line in lines {
        let words: Vec<&str> = line.split_whitespace().skip(1).collect();
        let depth = if ["bag", "scene", "study"].contains(&words[0]) { 2 } else { 1 };
        let help = help(&words[..depth]);
        for option in words.iter().filter(|word| word.starts_with("--")) {
            assert!(help.contains(option), "{line}: {option} is no option");
        }
    }
}

#[test]
fn this_version_has_its_release_notes() {
    let text = fs::read_to_string(root().join("CHANGELOG.md")).unwrap();
    let releases: Vec<&str> = text.lines().filter_map(|line| line.strip_prefix("## ")).collect();
    let [Some(next), Some(newest)] = [releases.first(), releases.get(1)] else { panic!("{releases:?}") };
    assert_eq!(*next, "Unreleased");
    let (version, date) = newest.split_once(" - ").unwrap_or_else(|| panic!("{newest}: a version and a date"));
    assert_eq!(version, env!("CARGO_PKG_VERSION"));
    let digits = |part: &str| part.chars().all(|c| c.is_ascii_digit());
    assert!(date.len() == 10 && date.split('-').all(digits) && date.split('-').count() == 3, "{date}: YYYY-MM-DD");
}

#[test]
fn the_book_has_every_page_of_the_handbook() {
    let docs = root().join("docs");
    let entries: BTreeSet<String> = links(&read(&docs.join("SUMMARY.md"))).into_iter().collect();
    let names = fs::read_dir(&docs).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let left_out: Vec<String> =
        names.filter(|name| name.ends_with(".md") && name != "SUMMARY.md" && !entries.contains(name)).collect();
    assert!(left_out.is_empty(), "pages that docs/SUMMARY.md leaves out: {left_out:?}");
}

#[test]
fn repository_and_address_are_those_of_the_manifest() {
    let manifest = read(&root().join("Cargo.toml"));
    let line = |key: &str| manifest.lines().find_map(|line| line.strip_prefix(key)).unwrap();
    let repository = line("repository = ").trim_matches('"');
    let address = line("authors = ").split(['<', '>']).nth(1).unwrap();
    for (file, wanted) in [
        ("CITATION.cff", &[repository, address][..]),
        ("package.xml", &[address]),
        ("CODE_OF_CONDUCT.md", &[address]),
        (".github/ISSUE_TEMPLATE/config.yml", &[repository]),
    ] {
        let text = read(&root().join(file));
        assert!(wanted.iter().all(|wanted| text.contains(wanted)), "{file}: `.ci/publisher` writes them everywhere");
    }
    let citation = read(&root().join("CITATION.cff"));
    assert!(citation.contains(&format!("version: {}\n", env!("CARGO_PKG_VERSION"))), "the version of the citation");
}

#[test]
fn the_paper_cites_what_its_bibliography_has() {
    let (paper, bibliography) = ("docs/paper/paper.md", "docs/paper/paper.bib");
    let [text, entries] = [paper, bibliography].map(|file| read(&root().join(file)));
    let word = |rest: &str| rest.split(|c: char| !(c.is_alphanumeric() || c == '_')).next().unwrap().to_owned();
    let cited: BTreeSet<String> = text.split('@').skip(1).map(word).collect();
    let keys = entries.lines().filter(|line| line.starts_with('@')).filter_map(|line| line.split_once('{'));
    let listed: BTreeSet<String> = keys.map(|(_, key)| key.trim_end_matches(',').to_owned()).collect();
    assert_eq!(cited, listed);
}

/// Reports to others are of use while their patches fit what is in use here.
#[test]
fn patches_for_others_apply_to_the_release_in_the_lock_file() {
    // `cargo metadata` asks for every crate of the lock file, and those of other systems and of the benchmarks were perhaps never downloaded
    let lock = read(&root().join("Cargo.lock"));
    let (_, version) = lock.split_once("name = \"rustdds\"\nversion = \"").unwrap();
    let release = format!("rustdds-{}", version.split('"').next().unwrap());
    let home =
        std::env::var_os("CARGO_HOME").map_or_else(|| std::env::home_dir().unwrap().join(".cargo"), PathBuf::from);
    let registries = fs::read_dir(home.join("registry/src")).unwrap().map(|entry| entry.unwrap().path());
    let sources = registries.map(|registry| registry.join(&release)).find(|sources| sources.is_dir());
    let sources = sources.unwrap_or_else(|| panic!("cargo has no {release} in {}", home.display()));
    let patches = files(&root().join("docs/lab/upstream"), ".diff");
    assert!(patches.len() >= 4, "{patches:?}");
    for patch in patches {
        // outside of any repository, where git would leave out what is not of it
        let folder = tempfile::tempdir().unwrap();
        for file in read(&patch).lines().filter_map(|line| line.strip_prefix("--- a/")) {
            let copy = folder.path().join(file);
            fs::create_dir_all(copy.parent().unwrap()).unwrap();
            fs::copy(sources.join(file), copy).unwrap();
        }
        let check = Command::new("git").args(["apply", "--check"]).arg(&patch).current_dir(folder.path()).output();
        let check = check.unwrap();
        assert!(check.status.success(), "{}: {}", patch.display(), String::from_utf8_lossy(&check.stderr));
    }
}

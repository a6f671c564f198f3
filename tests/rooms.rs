//! The way of the data: a room of `src/` uses only rooms below it, and the inner ring is numbers only. What lies in a
//! crate of its own is held by cargo.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// From the ground up: a room may use those before it. What two rooms share belongs below both.
const ORDER: [&str; 3] = ["live", "ros", "cli"];

/// Folders that are numbers only.
const INNER_RING: [&str; 3] = ["crates/mtled/src", "crates/mtled_cloud/src", "crates/needle_core/src"];

/// What would let time, order of hashing, the machine or the outside world into them.
const FORBIDDEN: [&str; 15] = [
    "std::fs",
    "std::net",
    "std::env",
    "std::io",
    "Instant::now",
    "SystemTime",
    "HashMap",
    "HashSet",
    "AtomicF",
    "tokio",
    "ros2_",
    "rosbag2_",
    "mcap::",
    "rand::rng",
    "thread::spawn",
];

/// A scene and its mesh are files, read once before the first step; a packed mesh is unpacked in memory. What waiting for a
/// thread has cost is told by a clock: it says who computes a part, never what comes out.
const ALLOWED: [(&str, &str); 6] = [
    ("crates/mtled/src/solver/backoff.rs", "Instant::now"),
    ("crates/mtled/src/solver/sync.rs", "Instant::now"),
    ("crates/needle_core/src/scene/file.rs", "std::fs"),
    ("crates/needle_core/src/scene/file.rs", "std::io"),
    ("crates/needle_core/src/mesh/mod.rs", "std::fs"),
    ("crates/needle_core/src/mesh/arrays.rs", "std::io"),
];

fn checkout() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        match path.is_dir() {
            true => found.extend(sources(&path)),
            false if path.extension().is_some_and(|e| e == "rs") => found.push(path),
            false => {}
        }
    }
    found.sort();
    found
}

/// Lines of code with their numbers: neither comments nor the tests at the end of a file, and no file of tests alone.
fn code(file: &Path) -> Vec<(usize, String)> {
    if file.file_stem().is_some_and(|stem| stem == "tests") {
        return Vec::new();
    }
    let text = fs::read_to_string(file).unwrap();
    let of_tests = |line: &str| ["#[cfg(test)]", "#[cfg(all(test,"].iter().any(|attribute| line.starts_with(attribute));
    let lines = (1..).zip(text.lines()).take_while(|(_, line)| !of_tests(line) || !is_module(&text, line));
    lines.filter(|(_, line)| !line.trim_start().starts_with("//")).map(|(n, line)| (n, line.to_owned())).collect()
}

/// Whether what follows the attribute is a module with a body, which stands at the end of a file.
fn is_module(text: &str, attribute: &str) -> bool {
    let rest = &text[attribute.as_ptr() as usize - text.as_ptr() as usize + attribute.len()..];
    let mut lines = rest.lines().skip(1).skip_while(|line| line.trim_start().starts_with("#["));
    lines.next().is_some_and(|line| line.starts_with("mod ") && line.ends_with('{'))
}

/// Rooms that a line names: `crate::a::b`, `crate::{a::b, c}`, and `super` often enough to leave the room.
fn named(line: &str, depth: usize) -> BTreeSet<String> {
    let word = |text: &str| text.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
    let mut rooms = BTreeSet::new();
    let starts = line.match_indices("crate::").filter(|(at, _)| !line[..*at].ends_with(['_', '$']));
    for rest in starts.map(|(at, found)| &line[at + found.len()..]).collect::<Vec<_>>() {
        match rest.strip_prefix('{') {
            None => drop(rooms.insert(word(rest))),
            Some(group) => {
                let mut level = 0;
                let parts = group.split(|c| {
                    level += i32::from(c == '{') - i32::from(c == '}');
                    c == ',' && level == 0
                });
                rooms.extend(parts.map(|part| word(part.trim())));
            }
        }
    }
    for (at, _) in line.match_indices("super::").filter(|(at, _)| !line[..*at].ends_with("super::")) {
        let rest = &line[at..];
        let path = rest.trim_start_matches("super::");
        if (rest.len() - path.len()) / "super::".len() >= depth {
            rooms.insert(word(path));
        }
    }
    rooms
}

/// How many `super` lead from a file of `src/` to the root of the crate.
fn depth(file: &Path) -> usize {
    file.components().count() - usize::from(file.ends_with("mod.rs"))
}

/// Every use of a room by another that does not lie below it.
fn sideways(order: &[&str]) -> Vec<String> {
    let src = checkout().join("src");
    let mut found = Vec::new();
    for (at, room) in order.iter().enumerate() {
        for file in sources(&src.join(room)) {
            let inside = file.strip_prefix(&src).unwrap();
            for (number, line) in code(&file) {
                let wrong = |used: &&String| order.iter().position(|r| r == used).is_some_and(|place| place > at);
                for used in named(&line, depth(inside)).iter().filter(wrong) {
                    found.push(format!("{}:{number}: {room} uses {used}", file.display()));
                }
            }
        }
    }
    found
}

#[test]
fn every_room_uses_only_what_lies_below_it() {
    let folders = fs::read_dir(checkout().join("src")).unwrap().map(|e| e.unwrap().path()).filter(|p| p.is_dir());
    let rooms: BTreeSet<_> = folders.map(|p| p.file_name().unwrap().to_str().unwrap().to_owned()).collect();
    let listed: BTreeSet<_> = ORDER.iter().chain(&["bin"]).map(|r| (*r).to_owned()).collect();
    assert_eq!(rooms, listed, "each room has its place in the order");
    let wrong = sideways(&ORDER);
    assert!(wrong.is_empty(), "what two rooms share belongs below both:\n{}", wrong.join("\n"));
}

#[test]
fn a_use_of_a_room_above_is_found() {
    let turned: Vec<_> = ORDER.iter().rev().copied().collect();
    let found = sideways(&turned);
    for pair in ["cli uses ros", "ros uses live"] {
        assert!(found.iter().any(|line| line.ends_with(pair)), "{pair}");
    }
    let rooms = |line, depth| named(line, depth).into_iter().collect::<Vec<_>>();
    assert_eq!(rooms("use crate::{scene::{Key, Kind}, twin};", 2), ["scene", "twin"]);
    assert_eq!(rooms("let x: crate::rig::Player = $crate::y(); my_crate::z()", 2), ["rig"]);
    assert_eq!(
        (rooms("use super::super::ros;", 2), rooms("use super::super::ros;", 3)),
        (vec!["ros".to_owned()], vec![])
    );
}

#[test]
fn the_inner_ring_is_numbers_only() {
    let mut wrong = Vec::new();
    for folder in INNER_RING {
        let files = sources(&checkout().join(folder));
        assert!(!files.is_empty(), "{folder}");
        for file in files {
            let allowed = |word| ALLOWED.iter().any(|(place, what)| file.ends_with(place) && *what == word);
            for (number, line) in code(&file) {
                let forbidden = FORBIDDEN.iter().filter(|word| line.contains(**word) && !allowed(**word));
                wrong.extend(forbidden.map(|word| format!("{}:{number}: {word} in the inner ring", file.display())));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

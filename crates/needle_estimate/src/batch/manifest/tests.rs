#![allow(clippy::unwrap_used)]
use super::*;

#[test]
fn patterns_and_names() {
    assert!(fits("EF10_0T_A1.csv", "*.csv") && fits("a", "*") && !fits("a.txt", "*.csv") && fits("xayb", "x*y*"));
    assert!(!fits("ab", "ab*b") && fits("aabb", "a*ab*b") && !fits("a", "*b*") && fits("", "**"));
    assert_eq!(filled("{folder}/{name:3}-{name:-1}", "EF10", "x"), "x/EF1-EF1");
    assert_eq!(filled("{name:x} {} {name:-9}{name", "EF10", "x"), "{name:x} {} {name");
}

/// A file's own name is not expanded, and matching a pattern with many stars does not take exponential time.
#[test]
fn names_and_patterns_end() {
    assert_eq!(filled("{name:99}/{name}", "{name:99}{folder}", "x"), "{name:99}{folder}/{name:99}{folder}");
    assert!(!fits(&"a".repeat(250), &("*a".repeat(120) + "b")));
}

#[test]
fn numbers_that_mean_nothing_are_refused() {
    let read = |text: &str| Manifest::from_text(Path::new("m.toml"), text, Some(Path::new("none")));
    for (key, bad) in [("rate_hz", "0.0"), ("rate_hz", "nan"), ("gauge_length_m", "-1.0"), ("time_offset_s", "inf")] {
        let error = read(&format!("[[recordings]]\nfile = \"a.csv\"\n{key} = {bad}\n")).unwrap_err().to_string();
        assert!(error.contains(key) && error.contains("a.csv"), "{error}");
    }
    assert!(read("[[recordings]]\nfile = \"a.csv\"\nrate_hz = 10.0\ntime_offset_s = -1.0\n").is_ok());
}

/// Labs keep one folder per sample with the same file names in each.
#[test]
fn equal_file_names_in_several_folders_are_told_apart() {
    let names = |text: &str| -> Result<Vec<String>, String> {
        let manifest = Manifest::from_text(Path::new("m.toml"), text, Some(Path::new("none")));
        Ok(manifest.map_err(|e| e.to_string())?.recordings.into_iter().filter_map(|r| r.name).collect())
    };
    let recording = |file: &str, more: &str| format!("[[recordings]]\nfile = \"{file}\"\n{more}");
    let two = recording("a/run1.csv", "") + &recording("b/run1.csv", "") + &recording("b/run2.csv", "");
    assert_eq!(names(&two).unwrap(), ["a_run1", "b_run1", "run2"]);
    let named = recording("a/run1.csv", "name = \"x\"\n") + &recording("b/run2.csv", "name = \"x\"\n");
    assert!(names(&named).unwrap_err().contains("two recordings are called x"));
}

// Any text as a parameter file: shared by the fuzz target in `fuzz/` and by `tests/fuzz.rs`.

use ros2_node::names::pattern_matches;
use ros2_node::parameter_file;

/// What is read has names, and a pattern that can be asked.
pub fn exercise(data: &[u8]) {
    let text = String::from_utf8_lossy(data);
    match parameter_file::from_text(&text, std::path::Path::new("fuzz.yaml")) {
        Ok(found) => {
            for one in found {
                assert!(!one.name.is_empty());
                let _ = pattern_matches(&one.node_pattern, "/or1/twin");
            }
        }
        Err(error) => assert!(error.to_string().contains("fuzz.yaml")),
    }
    for line in text.lines().take(20) {
        let _ = parameter_file::scalar(line);
    }
}

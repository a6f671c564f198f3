// Any text as a batch's manifest: shared by the fuzz target in `fuzz/` and by `tests/fuzz.rs`.

use std::path::Path;

use needle_estimate::batch::Manifest;

/// A text that begins with a comment `#csv` is a table. No file is looked at: the folder does not exist.
pub fn exercise(data: &[u8]) {
    let text = String::from_utf8_lossy(data);
    let name = Path::new(if text.starts_with("#csv") { "fuzz.csv" } else { "fuzz.toml" });
    match Manifest::from_text(name, &text, Some(Path::new("no such folder"))) {
        Ok(manifest) => {
            assert!(!manifest.recordings.is_empty() && !manifest.candidates.is_empty());
            for entry in &manifest.recordings {
                assert!(entry.name.is_some() && entry.file.is_some() && entry.sample.is_some());
                let said = entry.selection();
                assert!(said.time_offset_s.is_finite() && said.rate_hz.is_none_or(|hz| hz > 0.0));
                manifest.candidates.iter().for_each(|candidate| drop(entry.wanted(candidate)));
            }
        }
        Err(error) => assert!(error.to_string().contains("fuzz."), "{error}"),
    }
}

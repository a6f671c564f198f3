// Any bytes as a bag or as its metadata, with what is said of it: shared by the fuzz target in `fuzz/` and by `tests/fuzz.rs`.

use needle_recording::Recording;
use rosbag2_mcap::{BagReader, Metadata};

use super::selection;

/// Everything that can be read is read.
pub fn exercise(data: &[u8]) {
    let (said, data) = selection::split(data);
    if !data.starts_with(b"\x89MCAP") {
        let _ = Metadata::parse(&String::from_utf8_lossy(data));
    }
    match BagReader::from_vec("fuzz", data.to_vec()) {
        Ok(bag) => {
            let topics = bag.topics().len();
            assert!(bag.messages().all(|m| m.topic < topics));
            if let Ok(recording) = Recording::of_bag(&bag, &said) {
                assert!(recording.depths.iter().all(|d| d.depth_m.is_finite()));
            }
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

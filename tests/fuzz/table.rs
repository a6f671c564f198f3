// Any bytes as a table of text, with what is said of it: shared by the fuzz target in `fuzz/` and by `tests/fuzz.rs`.

use std::path::Path;

use needle_recording::{Recording, Table};

use super::selection;

/// What comes out is finite and in order.
pub fn exercise(data: &[u8]) {
    let (said, text) = selection::split(data);
    let name = match text {
        [0x93, ..] => "fuzz.npy",
        [b'P', b'K', ..] if text.windows(3).any(|w| w == b"xl/") => "fuzz.xlsx",
        [b'P', b'K', ..] => "fuzz.npz",
        _ => "fuzz.csv",
    };
    let table = match Table::from_bytes(Path::new(name), text.to_vec(), &said, 0) {
        Ok(table) => table,
        Err(error) => return assert!(error.to_string().contains(name), "{error}"),
    };
    match Recording::of_tables(&mut [table], &said) {
        Ok(recording) => {
            assert!(recording.depths.iter().all(|d| d.depth_m.is_finite() && d.time_s.is_finite()));
            assert!(recording.depths.is_sorted_by_key(|d| d.time_s) && recording.forces.is_sorted_by_key(|f| f.time_s));
            assert!(recording.forces.iter().all(|f| f.force_n.iter().all(|x| x.is_finite())));
            assert!(recording.poses.iter().all(|p| p.tip.iter().all(|x| x.is_finite())));
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

//! The needle recording of `bags/`, compiled into the program for `demo`.

use rosbag2_mcap::BagError;
use rosbag2_mcap::BagReader;
use std::fs;
use std::path::Path;

/// The file of `bags/needle_insertion`.
static NEEDLE_INSERTION: &[u8] = include_bytes!("../bags/needle_insertion/needle_insertion_0.mcap");
/// Its metadata.yaml.
static METADATA: &str = include_str!("../bags/needle_insertion/metadata.yaml");

/// The bag, in memory.
///
/// # Errors
/// None in a sound build: [`BagError::NotABag`] if the compiled-in file is not a bag.
pub fn needle_insertion() -> Result<BagReader, BagError> {
    BagReader::from_bytes("needle_insertion", NEEDLE_INSERTION)
}

/// Unpacks the bag to a rosbag2 folder, for programs that open a path.
///
/// # Errors
/// [`BagError::Exists`] if the folder exists and is not empty, [`BagError::Open`] if it can't be written.
pub fn write_needle_insertion(folder: impl AsRef<Path>) -> Result<(), BagError> {
    let folder = folder.as_ref();
    if fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some()) {
        return Err(BagError::Exists { path: folder.to_path_buf() });
    }
    fs::create_dir_all(folder)
        .and_then(|()| fs::write(folder.join("needle_insertion_0.mcap"), NEEDLE_INSERTION))
        .and_then(|()| fs::write(folder.join("metadata.yaml"), METADATA))
        .map_err(|source| BagError::Open { path: folder.to_path_buf(), source })
}

//! Stores numbers that are expensive to compute in files below a folder.
//!
//! The name of a file is the hash of everything that its numbers depend on. The file holds the exact bits of the
//! numbers and a checksum of them. So a value that is read back is identical to the last bit, and a damaged file is
//! computed again. Several processes may share a folder.

use std::path::{Path, PathBuf};
use std::{fs, io};

use xxhash_rust::xxh3::{xxh3_64, xxh3_128};

/// See the module.
#[derive(Clone, Debug)]
pub struct Cache {
    folder: PathBuf,
}

impl Cache {
    /// A cache in the subfolder `name` of a folder.
    #[must_use]
    pub fn below(folder: &Path, name: &str) -> Self {
        Self { folder: folder.join(name) }
    }

    fn path(&self, of: &str) -> PathBuf {
        self.folder.join(format!("{:032x}.bin", xxh3_128(of.as_bytes())))
    }

    /// Stores lists of numbers under the text of everything that they depend on. The file has the length before each
    /// list and the checksum at the end.
    ///
    /// # Errors
    /// If the file can't be written. No partial file remains then.
    pub fn put(&self, of: &str, lists: &[Vec<f64>]) -> io::Result<()> {
        let path = self.path(of);
        let mut bytes = Vec::new();
        for list in lists {
            bytes.extend((list.len() as u64).to_le_bytes());
            list.iter().for_each(|x| bytes.extend(x.to_le_bytes()));
        }
        bytes.extend(xxh3_64(&bytes).to_le_bytes());
        let partial = path.with_extension(format!("{}.partial", std::process::id()));
        let folder = fs::create_dir_all(&self.folder);
        let written = folder.and_then(|()| fs::write(&partial, bytes)).and_then(|()| fs::rename(&partial, path));
        if written.is_err() {
            // the file may not exist
            let _ = fs::remove_file(&partial);
        }
        written
    }

    /// The stored lists; `None` if there are none, or if they are damaged.
    #[must_use]
    pub fn get(&self, of: &str) -> Option<Vec<Vec<f64>>> {
        let bytes = fs::read(self.path(of)).ok()?;
        let (mut left, hash) = bytes.split_last_chunk::<8>()?;
        if xxh3_64(left) != u64::from_le_bytes(*hash) {
            return None;
        }
        let mut lists = Vec::new();
        while let Some((length, rest)) = left.split_first_chunk::<8>() {
            let size = usize::try_from(u64::from_le_bytes(*length)).ok()?.checked_mul(8)?;
            let (list, rest) = rest.split_at_checked(size)?;
            let number = |eight: &[u8]| Some(f64::from_le_bytes(*eight.first_chunk::<8>()?));
            lists.push(list.chunks_exact(8).map(number).collect::<Option<Vec<f64>>>()?);
            left = rest;
        }
        left.is_empty().then_some(lists)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn kept_numbers_come_back_to_the_bit_and_damaged_ones_do_not() {
        let folder = tempfile::tempdir().unwrap();
        let (kept, of) = (Cache::below(folder.path(), "curves"), "scene and keys");
        let lists = vec![vec![0.0, 0.1, 1.0 / 3.0], vec![-0.0, f64::MIN_POSITIVE], Vec::new()];
        assert_eq!(kept.get(of), None);
        kept.put(of, &lists).unwrap();
        let bits =
            |of: &[Vec<f64>]| of.iter().map(|l| l.iter().map(|x| x.to_bits()).collect()).collect::<Vec<Vec<_>>>();
        assert_eq!(bits(&kept.get(of).unwrap()), bits(&lists));
        let whole = fs::read(kept.path(of)).unwrap();
        for place in 0..whole.len() {
            let mut damaged = whole.clone();
            damaged[place] ^= 1;
            fs::write(kept.path(of), damaged).unwrap();
            assert_eq!(kept.get(of), None, "byte {place}");
            fs::write(kept.path(of), &whole[..place]).unwrap();
            assert_eq!(kept.get(of), None, "{place} bytes");
        }
    }
}

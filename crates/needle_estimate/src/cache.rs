//! Numbers that are dear to compute, kept in files below a folder.
//!
//! A file is named by the hash of all that its numbers depend on. It holds them as they are and a hash of them, so that what is read again is the
//! same to the last bit, and what is damaged is computed anew. Several processes may share a folder.

use std::path::{Path, PathBuf};
use std::{fs, io};

use xxhash_rust::xxh3::{xxh3_64, xxh3_128};

/// See the module.
#[derive(Clone, Debug)]
pub struct Cache {
    folder: PathBuf,
}

impl Cache {
    /// What is kept in a folder of this name below another.
    #[must_use]
    pub fn below(folder: &Path, name: &str) -> Self {
        Self { folder: folder.join(name) }
    }

    fn path(&self, of: &str) -> PathBuf {
        self.folder.join(format!("{:032x}.bin", xxh3_128(of.as_bytes())))
    }

    /// Keeps lists of numbers under the text of all that they depend on: each list with its length before it, then their hash.
    ///
    /// # Errors
    /// If the file can't be written; nothing of it is left then.
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
            // it may not even be there
            let _ = fs::remove_file(&partial);
        }
        written
    }

    /// The lists that were kept; `None` without them, or where they are damaged.
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

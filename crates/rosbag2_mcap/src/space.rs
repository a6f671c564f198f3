//! Disk space that is set aside before it is needed, so that a full disk ends a recording and not the file.

use std::fs::File;
use std::io;

/// Space is set aside in steps of this size.
const STEP: u64 = 1 << 20;

/// Space behind the end of a file that is already ours.
///
/// Where the system or the file system can't set space aside, this does nothing, and a full disk shows when a chunk
/// is written.
#[derive(Debug)]
pub(super) struct Reserved {
    file: File,
    /// Bytes from the start of the file.
    until: u64,
    supported: bool,
}

impl Reserved {
    /// Nothing is set aside yet.
    pub(super) fn new(file: File) -> Self {
        Self { file, until: 0, supported: true }
    }

    /// Makes sure that the file can grow to `size` bytes.
    ///
    /// # Errors
    /// The system's, if there is not enough space.
    pub(super) fn up_to(&mut self, size: u64) -> io::Result<()> {
        if size <= self.until || !self.supported {
            return Ok(());
        }
        for target in [size.saturating_add(STEP), size] {
            match allocate(&self.file, target) {
                Ok(()) => {
                    self.until = target;
                    return Ok(());
                }
                Err(e) if !is_full(&e) => {
                    self.supported = false;
                    return Ok(());
                }
                Err(e) if target == size => return Err(e),
                Err(_) => {}
            }
        }
        Ok(())
    }

    /// Gives back what lies behind `size`, and cuts the file there.
    ///
    /// # Errors
    /// The system's.
    pub(super) fn cut(&mut self, size: u64) -> io::Result<()> {
        self.until = size;
        self.file.set_len(size)
    }

    /// Present length of the file.
    ///
    /// # Errors
    /// The system's.
    pub(super) fn len(&self) -> io::Result<u64> {
        Ok(self.file.metadata()?.len())
    }
}

fn is_full(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge)
}

#[cfg(target_os = "linux")]
fn allocate(file: &File, size: u64) -> io::Result<()> {
    use rustix::fs::{FallocateFlags, fallocate};
    fallocate(file, FallocateFlags::KEEP_SIZE, 0, size).map_err(io::Error::from)
}

#[cfg(not(target_os = "linux"))]
fn allocate(_file: &File, _size: u64) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}

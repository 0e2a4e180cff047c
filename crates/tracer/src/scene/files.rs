//! The files that a scene is read from.

use std::cell::RefCell;
use std::io;
use std::path::{Path, PathBuf};

/// The files beside a scene's own, and which of them were read.
#[derive(Debug)]
pub(super) struct Files<'a> {
    directory: &'a Path,
    read: RefCell<Vec<PathBuf>>,
}

impl<'a> Files<'a> {
    /// Those in `directory`, or named from there.
    pub(super) fn beside(directory: &'a Path) -> Self {
        Self { directory, read: RefCell::default() }
    }

    /// Where the file of this name is.
    pub(super) fn path(&self, name: impl AsRef<Path>) -> PathBuf {
        self.directory.join(name)
    }

    /// What is in the file of this name.
    pub(super) fn read(&self, name: impl AsRef<Path>) -> io::Result<Vec<u8>> {
        let path = self.path(name);
        let bytes = std::fs::read(&path)?;
        self.read.borrow_mut().push(path);
        Ok(bytes)
    }

    /// The files that were read, in that order.
    pub(super) fn into_read(self) -> Vec<PathBuf> {
        self.read.into_inner()
    }
}

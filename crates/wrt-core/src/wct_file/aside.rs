//! Replacing a file whole or not at all.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

/// Writes `bytes` beside `path` and renames the result to it, so that `path` is
/// at all times the old file or the new one, even if the machine stops.
///
/// A link stays, and what it points to is replaced; what is no file, as a pipe, is
/// written into.
///
/// # Errors
///
/// What the file system says; `path` is then unchanged and nothing is left
/// beside it.
pub fn write_aside(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let there = fs::metadata(path);
    if there.is_ok_and(|there| !there.is_file() && !there.is_dir()) {
        return OpenOptions::new().write(true).open(path)?.write_all(bytes);
    }
    // Of a link, what it points to, if that is there.
    let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let path = &target;
    let (mut aside, mut file) = Aside::create(path)?;
    file.write_all(bytes)?;
    file.sync_all()?;
    drop(file);
    fs::rename(&aside.path, path)?;
    aside.renamed = true;
    // Without this a crash may forget the new name, though never harm the file;
    // where folders cannot be opened, as on Windows, there is no such call.
    if let Ok(folder) = File::open(folder(path)) {
        let _ = folder.sync_all();
    }
    Ok(())
}

/// A file removed when this is dropped, unless it has its final name.
struct Aside {
    path: PathBuf,
    renamed: bool,
}

impl Aside {
    fn create(path: &Path) -> io::Result<(Self, File)> {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let name = path.file_name().ok_or(io::ErrorKind::InvalidFilename)?;
        loop {
            let mut aside = std::ffi::OsString::from(".");
            aside.push(name);
            let number = NEXT.fetch_add(1, Ordering::Relaxed);
            aside.push(format!(".{}.{number}.partial", std::process::id()));
            let aside = folder(path).join(aside);
            match OpenOptions::new().write(true).create_new(true).open(&aside) {
                Ok(file) => return Ok((Self { path: aside, renamed: false }, file)),
                // Left by a process of the same number that was killed.
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
                Err(error) => return Err(error),
            }
        }
    }
}

impl Drop for Aside {
    fn drop(&mut self) {
        if !self.renamed {
            // The reason is already on its way to the caller.
            let _ = fs::remove_file(&self.path);
        }
    }
}

fn folder(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::{FileTypeExt as _, symlink};

    #[test]
    fn links_and_pipes_stay_what_they_are() {
        let folder = std::env::temp_dir().join(format!("aside-{}", std::process::id()));
        fs::create_dir_all(&folder).expect("a folder");
        let (file, link, pipe) = (folder.join("file"), folder.join("link"), folder.join("pipe"));
        fs::write(&file, "old").expect("a file");
        symlink("file", &link).expect("a link");
        write_aside(&link, b"new").expect("written");
        assert!(fs::symlink_metadata(&link).expect("there").is_symlink());
        assert_eq!(fs::read(&file).expect("there"), b"new");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status().expect("mkfifo");
        assert!(made.success());
        let reader = std::thread::spawn({
            let pipe = pipe.clone();
            move || fs::read(pipe)
        });
        write_aside(&pipe, b"through").expect("written");
        assert_eq!(reader.join().expect("no panic").expect("read"), b"through");
        assert!(fs::metadata(&pipe).expect("there").file_type().is_fifo());
        assert_eq!(fs::read_dir(&folder).expect("there").count(), 3, "nothing is left beside");
        fs::remove_dir_all(&folder).expect("removed");
    }
}

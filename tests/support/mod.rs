//! What several tests need: the program, its scenes, temporary folders, pictures.

pub(crate) mod chapel;
pub(crate) mod picture;

use std::process::{Command, Output};
use std::sync::OnceLock;
use tempfile::TempDir;

/// Runs the program.
pub(crate) fn tracer(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_tracer")).args(args).output().expect("the program to test")
}

/// Runs the program, which must succeed, and returns what it prints.
pub(crate) fn succeed(args: &[&str]) -> String {
    let output = tracer(args);
    assert!(output.status.success(), "tracer {args:?}: {output:?}");
    String::from_utf8(output.stdout).expect("UTF-8 on stdout")
}

/// Runs the program, which must fail with `code`, and returns its complaint.
pub(crate) fn fail(code: i32, args: &[&str]) -> String {
    let output = tracer(args);
    assert_eq!(output.status.code(), Some(code), "tracer {args:?}: {output:?}");
    assert!(output.stdout.is_empty(), "tracer {args:?}: {output:?}");
    String::from_utf8(output.stderr).expect("UTF-8 on stderr")
}

/// A file of the repository.
pub(crate) fn repository(path: &str) -> String {
    format!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../{}"), path)
}

/// A file of a scene, such as `chapel/chapel.gltf`.
pub(crate) fn scene(path: &str) -> String {
    repository(&format!("scenes/{path}"))
}

/// A temporary folder, gone with the value.
pub(crate) struct Folder(TempDir);

impl Folder {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    /// The path of `name` in it.
    pub(crate) fn path(&self, name: &str) -> String {
        self.0.path().join(name).into_os_string().into_string().expect("a UTF-8 path")
    }

    /// The names in it, sorted.
    pub(crate) fn names(&self) -> Vec<String> {
        let entries = self.0.path().read_dir().expect("a readable folder");
        let name = |entry: std::io::Result<std::fs::DirEntry>| {
            entry.expect("a readable entry").file_name().into_string().expect("a UTF-8 name")
        };
        let mut names: Vec<String> = entries.map(name).collect();
        names.sort();
        names
    }
}

/// The chapel's radiance at levels 4 and 5, baked once for all tests.
pub(crate) fn chapel_wct() -> &'static str {
    static BAKED: OnceLock<String> = OnceLock::new();
    BAKED.get_or_init(|| {
        let path = concat!(env!("CARGO_TARGET_TMPDIR"), "/chapel-4-5.wct").to_owned();
        let chapel = scene("chapel/chapel.gltf");
        let levels = ["--level", "4", "--direction-level", "5"];
        succeed(&[&["bake", &chapel, "-o", &path, "--checks", "0"], &levels[..]].concat());
        path
    })
}

//! The order of the modules: one names only those before it.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Bottom to top: what directions, positions and coefficients are; what is made of
/// them; what is looked up, measured and kept.
const WRT_CORE: &[&str] = &[
    "error",
    "index",
    "haar",
    "multiwavelet",
    "sobol",
    "nusselt",
    "hemisphere",
    "convex",
    "chart",
    "polygon",
    "grid",
    "tree",
    "radiometry",
    "emission",
    "transport",
    "interaction",
    "sky",
    "glazing",
    "gather",
    "beams",
    "legendre",
    "sampler",
    "metrics",
    "wct_file",
];

/// Bottom to top: the scene, what rays find in it, what a pixel is, what is baked,
/// what is typed, and what acts on it.
const TRACER: &[&str] = &[
    "threads",
    "scene",
    "accel",
    "camera",
    "phong",
    "emitters",
    "whitted",
    "film",
    "flip",
    "render",
    "wct_texture",
    "plot",
    "report",
    "bake",
    "reference",
    "cli",
    "commands",
];

#[test]
fn modules_of_wrt_core_use_only_lower_modules() {
    assert_eq!(violations("wrt-core", "lib.rs", WRT_CORE), Vec::<String>::new());
}

#[test]
fn modules_of_tracer_use_only_lower_modules() {
    assert_eq!(violations("tracer", "main.rs", TRACER), Vec::<String>::new());
}

/// The core knows no scene, no picture and no terminal: it cannot even name them.
#[test]
fn the_core_depends_on_no_scene_and_no_picture() {
    let manifest = fs::read_to_string(crates().join("wrt-core/Cargo.toml")).expect("a manifest");
    let dependencies = manifest.split("[dependencies]").nth(1).expect("dependencies");
    let dependencies = dependencies.split("\n[").next().expect("at least one part");
    let names = dependencies.lines().filter_map(|line| Some(line.split_once('=')?.0.trim()));
    for name in names {
        let known =
            ["crc32fast", "fearless_simd", "glam", "rayon", "serde", "serde_json", "thiserror"];
        assert!(known.contains(&name), "wrt-core depends on {name}: does it belong there?");
    }
}

fn crates() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Each use of a module by one that is not above it, and each module without a
/// place in the order.
fn violations(name: &str, root: &str, order: &[&str]) -> Vec<String> {
    let src = crates().join(name).join("src");
    let root = fs::read_to_string(src.join(root)).expect("the crate's root");
    let mut found = Vec::new();
    let modules = root
        .lines()
        .filter_map(|line| line.trim_start_matches("pub ").strip_prefix("mod ")?.strip_suffix(';'));
    let rank = |module: &str| order.iter().position(|m| *m == module);
    found.extend(modules.filter(|m| rank(m).is_none()).map(|m| format!("{m} has no place")));
    let homes = homes(&root);
    for (i, module) in order.iter().enumerate() {
        for file in files(&src, module) {
            let text = fs::read_to_string(&file).expect("a source file");
            let depth = file.strip_prefix(&src).expect("within src").components().count();
            let depth = if file.ends_with("mod.rs") { depth - 1 } else { depth };
            for item in from_root(&text, depth) {
                let home = homes.get(&item).unwrap_or(&item);
                if rank(home).is_some_and(|used| used > i) {
                    found.push(format!("{module} uses {item} of {home} ({})", file.display()));
                }
            }
        }
    }
    found
}

/// Which module an item of the crate's root is from, by its `pub use` lines.
fn homes(root: &str) -> BTreeMap<String, String> {
    let mut homes = BTreeMap::new();
    for line in root.split(';') {
        let Some(path) = line.trim().strip_prefix("pub use ") else { continue };
        let Some((module, items)) = path.split_once("::") else { continue };
        for item in items.trim_matches(['{', '}']).split(',') {
            homes.insert(item.trim().to_owned(), module.to_owned());
        }
    }
    homes
}

/// A module's file and those below it.
fn files(src: &Path, module: &str) -> Vec<PathBuf> {
    let mut files = vec![src.join(module).with_extension("rs")];
    let mut folders = vec![src.join(module)];
    while let Some(folder) = folders.pop() {
        let Ok(entries) = folder.read_dir() else { continue };
        for entry in entries {
            let path = entry.expect("a readable entry").path();
            if path.is_dir() { folders.push(path) } else { files.push(path) }
        }
    }
    files.retain(|file| file.is_file() && file.extension().is_some_and(|e| e == "rs"));
    assert!(!files.is_empty(), "no module {module}");
    files
}

/// First names of the paths from the crate's root in a file that is `depth`
/// modules below it: after `crate::`, or after as many `super::`.
fn from_root(text: &str, depth: usize) -> Vec<String> {
    let code = text.lines().filter(|line| !line.trim_start().starts_with("//"));
    let (mut below, mut found) = (0, Vec::new());
    let lines: Vec<&str> = code.collect();
    for (i, line) in lines.iter().enumerate() {
        // rustfmt leaves modules within a file, and their ends, at the margin.
        let opens = line.trim_start_matches("pub(crate) ").trim_start_matches("pub(super) ");
        if opens.starts_with("mod ") && opens.ends_with('{') {
            below = 1;
        } else if *line == "}" {
            below = 0;
        }
        let supers = "super::".repeat(depth + below);
        for prefix in ["crate::", &supers] {
            for (at, _) in line.match_indices(prefix) {
                let before = line[..at].chars().next_back();
                if before.is_some_and(|c| c.is_alphanumeric() || c == '_' || c == ':') {
                    continue;
                }
                let rest = [&line[at + prefix.len()..], &lines[i + 1..].join("\n")].join("\n");
                found.extend(first_names(&rest));
            }
        }
    }
    found
}

/// `a` of `a::b`; `a` and `c` of `{a::b, c::{d, e}}`.
fn first_names(path: &str) -> Vec<String> {
    let name = |text: &str| -> String {
        text.trim_start().chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()
    };
    let Some(group) = path.strip_prefix('{') else { return vec![name(path)] };
    let (mut names, mut depth, mut start) = (Vec::new(), 0, 0);
    for (i, c) in group.char_indices() {
        match c {
            '{' => depth += 1,
            '}' if depth > 0 => depth -= 1,
            ',' | '}' if depth == 0 => {
                names.push(name(&group[start..i]));
                start = i + 1;
                if c == '}' {
                    break;
                }
            }
            _ => {}
        }
    }
    names.retain(|name| !name.is_empty());
    names
}

#[test]
fn paths_from_the_root_are_found() {
    let text = "use crate::{\n    a::{b, c},\n    D,\n};\n// crate::no\nlet x = crate::e::f();\nuse super::g;\nmod tests {\n    use super::*;\n    use super::super::h;\n}\n";
    assert_eq!(from_root(text, 1), ["a", "D", "e", "g", "h"]);
    assert_eq!(from_root(text, 2), ["a", "D", "e"]);
}

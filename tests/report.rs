//! The report: a page that stands alone, and its tables.

use crate::support::{Folder, fail, repository, succeed};
use std::fs;

#[test]
fn a_report_is_one_page_with_a_table_a_section() {
    let folder = Folder::new();
    let (output, scenes) = (folder.path("report"), repository("scenes"));
    let only = ["--only", "compression,hard"];
    let args = ["report", "--quick", "--scenes", &scenes, "-o", &output];
    let printed = succeed(&[&args[..], &only].concat());
    let page = fs::read_to_string(printed.trim()).expect("the page that it names");
    assert!(page.starts_with("<!DOCTYPE html>") && page.ends_with("</html>\n"), "{page}");
    assert!(!page.contains("<script") && !page.contains("<link"), "it needs another file");
    let read = |name: &str| fs::read_to_string(format!("{output}/{name}")).expect("a file");
    for name in ["compression", "hard"] {
        assert!(page.contains(&format!("id=\"{name}\"")), "no section {name}");
        assert!(read(&format!("{name}.csv")).lines().count() > 10, "{name}");
    }
    assert!(read("compression-1.svg").contains("the paper's 5 %"), "its mark");
    // At the finest tolerance, 10⁻¹⁰, integration gives the closed forms.
    let hard = read("hard.csv");
    let finest: Vec<&str> = hard.lines().filter(|line| line.contains(",1e-10,")).collect();
    assert_eq!(finest.len(), 14, "cases");
    for line in finest {
        let error: f64 = line.rsplit(',').nth(3).expect("a column").parse().expect("a number");
        assert!(error <= 1e-10, "{line}");
    }
}

#[test]
fn an_unknown_section_is_answered_with_those_there_are() {
    let folder = Folder::new();
    let output = folder.path("report");
    let complaint = fail(1, &["report", "--only", "speed", "-o", &output]);
    assert!(complaint.contains("no section named \"speed\"; there are: picture"), "{complaint}");
    assert!(folder.names().is_empty(), "nothing was made");
    fail(2, &["report", "--quick"]);
}

//! The page: sections as one HTML file that needs no other.

use super::Section;
use std::fmt::Write as _;

/// All that is shown.
#[derive(Debug)]
pub(crate) struct Page {
    /// What measured it and how: a line each.
    pub(crate) about: Vec<String>,
    pub(crate) sections: Vec<Section>,
}

/// Colours and drawing. The palette is M. Okabe & K. Ito's, *Color Universal
/// Design* (2008), the yellow left out and the rest lighter on black; marks and
/// dashes differ as well.
pub(super) const DRAWING: &str = "
:root { color-scheme: light dark; --back: #fff; --fore: #1a1a1a; --faint: #ddd; --soft: #666;
  --c0: #1a1a1a; --c1: #0072b2; --c2: #d55e00; --c3: #009e73; --c4: #b5548b; --c5: #9a6700; --c6: #2b8cc4; --c7: #777; }
@media screen and (prefers-color-scheme: dark) { :root { --back: #16181b; --fore: #e8e8e8; --faint: #3a3d42; --soft: #a0a0a0;
  --c0: #f0f0f0; --c1: #56b4e9; --c2: #ff8c3a; --c3: #33c79a; --c4: #e29ac4; --c5: #e0b040; --c6: #8fc7ee; --c7: #aaa; } }
@media print { :root { --back: #fff; --fore: #000; --c0: #000; } section { break-inside: auto; } figure, tr { break-inside: avoid; } nav { display: none; } }
svg text { font: 12.5px system-ui, sans-serif; fill: var(--fore); } svg text.note { fill: var(--soft); }
.grid { stroke: var(--faint); fill: none; } .frame { stroke: var(--soft); fill: none; }
path.note { stroke: var(--soft); stroke-dasharray: 2 3; fill: none; }
.line { fill: none; stroke: var(--c); stroke-width: 1.8; } .mark { fill: var(--c); stroke: var(--c); stroke-width: 1.6; } .bar { stroke: var(--c); stroke-width: 3; opacity: .35; }
.s0 { --c: var(--c0); } .s1 { --c: var(--c1); } .s2 { --c: var(--c2); } .s3 { --c: var(--c3); }
.s4 { --c: var(--c4); } .s5 { --c: var(--c5); } .s6 { --c: var(--c6); } .s7 { --c: var(--c7); }
.s2 .line, .s5 .line { stroke-dasharray: 7 4; } .s3 .line, .s6 .line { stroke-dasharray: 2 3; } .s4 .line, .s7 .line { stroke-dasharray: 9 3 2 3; }
";

const LAYOUT: &str = "
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 1rem; max-width: 66rem; background: var(--back); color: var(--fore);
  font: 1rem/1.5 system-ui, sans-serif; overflow-wrap: break-word; }
h1 { font-size: 1.6rem; line-height: 1.25; } h2 { margin-top: 2.5rem; border-top: 1px solid var(--faint); padding-top: 1rem; }
p { max-width: 44rem; } nav ul { columns: 2 14rem; padding-left: 1.2rem; } a { color: var(--c1); }
.about { color: var(--soft); font-size: .9rem; }
.charts { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 27rem), 1fr)); gap: 1rem; align-items: start; }
figure { margin: 1rem 0; max-width: 36rem; } figcaption { font-weight: 600; margin-bottom: .3rem; }
figure svg.chart { width: 100%; height: auto; display: block; }
figure.picture { overflow-x: auto; background: #fff; } figure.picture svg { width: 100%; min-width: 34rem; height: auto; }
figure.picture svg text { fill: #1a1a1a; }
.legend { list-style: none; display: flex; flex-wrap: wrap; gap: .2rem 1.2rem; padding: 0; margin: .4rem 0 0; font-size: .9rem; }
.legend svg { vertical-align: middle; }
.scroll { overflow-x: auto; margin: .3rem 0 1rem; } table { border-collapse: collapse; font-size: .9rem; font-variant-numeric: tabular-nums; }
p.caption { color: var(--soft); font-size: .9rem; margin-bottom: 0; } th, td { padding: .25rem .6rem; border-bottom: 1px solid var(--faint); text-align: right; white-space: nowrap; }
th { vertical-align: bottom; white-space: normal; min-width: 4.5rem; } td.text, th:first-child { text-align: left; }
";

impl Page {
    /// The file.
    pub(crate) fn to_html(&self) -> String {
        let mut html = format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <title>Speed against error</title>\n<style>{DRAWING}{LAYOUT}</style>\n</head>\n<body>\n\
             <h1>Speed against error of every part of tracer</h1>\n"
        );
        for line in &self.about {
            let _ = writeln!(html, "<p class=\"about\">{}</p>", escaped(line));
        }
        html += "<nav aria-label=\"Sections\"><ul>\n";
        for Section { id, title, .. } in &self.sections {
            let _ = writeln!(html, "<li><a href=\"#{id}\">{}</a></li>", escaped(title));
        }
        html += "</ul></nav>\n";
        for section in &self.sections {
            html += &section.to_html();
        }
        html + "</body>\n</html>\n"
    }
}

impl Section {
    fn to_html(&self) -> String {
        let mut html = format!("<section id=\"{}\">\n<h2>{}</h2>\n", self.id, escaped(self.title));
        for paragraph in &self.text {
            let _ = writeln!(html, "<p>{}</p>", escaped(paragraph));
        }
        html += "<div class=\"charts\">\n";
        html.extend(self.charts.iter().map(super::Chart::to_html));
        for picture in &self.pictures {
            let _ = writeln!(html, "<figure class=\"picture\">{picture}</figure>");
        }
        html += "</div>\n";
        html.extend(self.tables.iter().map(super::Table::to_html));
        html + "</section>\n"
    }
}

/// The processor's name, where the system tells it, and how many threads it runs.
pub(crate) fn machine() -> String {
    let name = std::fs::read_to_string("/proc/cpuinfo").ok().and_then(|text| {
        let line = text.lines().find(|line| line.starts_with("model name"))?;
        Some(line.split_once(':')?.1.trim().to_owned())
    });
    let threads = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    format!("{}, {threads} threads", name.unwrap_or_else(|| std::env::consts::ARCH.to_owned()))
}

/// Text as HTML shows it.
pub(super) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_needs_no_other_file_and_names_every_section() {
        let section = Section {
            id: "part",
            title: "A & B",
            text: vec!["x < y".to_owned()],
            ..Section::default()
        };
        let html = Page { about: vec![machine()], sections: vec![section] }.to_html();
        assert!(html.contains("href=\"#part\"") && html.contains("id=\"part\""), "{html}");
        assert!(html.contains("A &amp; B") && html.contains("x &lt; y"), "{html}");
        for outside in ["<script", "<link", "http", "url("] {
            assert!(!html.contains(outside), "{outside} in {html}");
        }
    }
}

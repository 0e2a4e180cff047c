//! What a report is made of: sections of text, tables and charts, which know
//! nothing of the page that shows them.

mod chart;
mod measure;
mod page;
mod table;

pub(crate) use chart::{Chart, Point, Series};
pub(crate) use measure::{Cost, cpu_time, time_to};
pub(crate) use page::{Page, machine};
pub(crate) use table::{Table, Value, short};

/// One part of the program, measured.
#[derive(Debug, Default)]
pub(crate) struct Section {
    /// Of its anchor and its files: lower case, no spaces.
    pub(crate) id: &'static str,
    pub(crate) title: &'static str,
    /// What is measured and how to read it, a paragraph each.
    pub(crate) text: Vec<String>,
    pub(crate) charts: Vec<Chart>,
    /// Finished SVG pictures.
    pub(crate) pictures: Vec<String>,
    pub(crate) tables: Vec<Table>,
}

//! Tables of measurements, as CSV and as HTML.

use super::page::escaped;
use std::fmt::Write as _;

/// One entry.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Value {
    Text(String),
    Count(u64),
    /// Shown with three digits, kept with all.
    Number(f64),
    /// A fraction, shown as a percentage.
    Percent(f64),
    Nothing,
}

impl From<&str> for Value {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl From<String> for Value {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

/// Rows of measurements.
#[derive(Clone, Debug, Default)]
pub(crate) struct Table {
    /// Of its file, without `.csv`.
    pub(crate) name: &'static str,
    pub(crate) caption: String,
    /// Names of the columns, with units.
    pub(crate) head: Vec<&'static str>,
    pub(crate) rows: Vec<Vec<Value>>,
}

impl Table {
    /// RFC 4180, numbers in full.
    pub(crate) fn to_csv(&self) -> String {
        let quoted = |text: &str| {
            if text.contains([',', '"', '\n']) {
                format!("\"{}\"", text.replace('"', "\"\""))
            } else {
                text.to_owned()
            }
        };
        let value = |value: &Value| match value {
            Value::Text(text) => quoted(text),
            Value::Count(count) => count.to_string(),
            Value::Number(x) | Value::Percent(x) => format!("{x:e}"),
            Value::Nothing => String::new(),
        };
        let line = |row: Vec<String>| row.join(",") + "\n";
        let head = line(self.head.iter().map(|name| quoted(name)).collect());
        head + &self
            .rows
            .iter()
            .map(|row| line(row.iter().map(value).collect()))
            .collect::<String>()
    }

    /// A table that scrolls sideways where it does not fit.
    pub(super) fn to_html(&self) -> String {
        let mut html = format!(
            "<p class=\"caption\">{} <a href=\"{name}.csv\">{name}.csv</a></p>\n\
             <div class=\"scroll\"><table>\n",
            escaped(&self.caption),
            name = self.name
        );
        let head: String = self
            .head
            .iter()
            .map(|name| format!("<th scope=\"col\">{}</th>", escaped(name)))
            .collect();
        let _ = writeln!(html, "<thead><tr>{head}</tr></thead>\n<tbody>");
        for row in &self.rows {
            html += "<tr>";
            for value in row {
                let _ = match value {
                    Value::Text(text) => write!(html, "<td class=\"text\">{}</td>", escaped(text)),
                    Value::Count(count) => write!(html, "<td>{}</td>", grouped(*count)),
                    Value::Number(x) => write!(html, "<td>{}</td>", short(*x)),
                    Value::Percent(x) => write!(html, "<td>{} %</td>", short(100.0 * x)),
                    Value::Nothing => write!(html, "<td>–</td>"),
                };
            }
            html += "</tr>\n";
        }
        html + "</tbody></table></div>\n"
    }
}

/// Three significant digits: "0.0123", "12.3", "1.23·10⁻⁷".
pub(crate) fn short(x: f64) -> String {
    if x == 0.0 || !x.is_finite() {
        return x.to_string();
    }
    let exponent = x.abs().log10().floor() as i32;
    if (-4..6).contains(&exponent) {
        return format!("{x:.*}", (2 - exponent).max(0) as usize);
    }
    format!("{:.2}·{}", x / 10.0_f64.powi(exponent), super::chart::power(exponent))
}

/// Thousands apart: "12 345".
fn grouped(count: u64) -> String {
    let digits = count.to_string();
    let mut out = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push('\u{202f}');
        }
        out.push(digit);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn csv_quotes_what_needs_it_and_keeps_all_digits() {
        let table = Table {
            name: "t",
            head: vec!["what", "time, s"],
            rows: vec![
                vec!["a \"b\"".into(), Value::Number(1.0 / 3.0)],
                vec![Value::Count(7), Value::Nothing],
            ],
            ..Table::default()
        };
        let expected = "what,\"time, s\"\n\"a \"\"b\"\"\",3.333333333333333e-1\n7,\n";
        assert_eq!(table.to_csv(), expected);
    }

    #[test]
    fn numbers_are_shown_with_three_digits() {
        let shown = [0.0, 0.012_345, 12.345, 123_456.0, 1.5e-9].map(short);
        assert_eq!(shown, ["0", "0.0123", "12.3", "123456", "1.50·10⁻⁹"]);
        assert_eq!(grouped(1_234_567), "1\u{202f}234\u{202f}567");
    }
}

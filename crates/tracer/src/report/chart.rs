//! Charts with two logarithmic axes, as SVG that takes its colours from the page.

use super::page::escaped;
use std::fmt::Write as _;

/// One point of a series.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Point {
    pub(crate) x: f64,
    pub(crate) y: f64,
    /// Least and most of x over several runs, drawn as a bar.
    pub(crate) range: Option<[f64; 2]>,
}

/// Points joined in their order.
#[derive(Clone, Debug)]
pub(crate) struct Series {
    pub(crate) name: String,
    /// Those without logarithms are left out.
    pub(crate) points: Vec<Point>,
}

/// Series over two logarithmic axes, and vertical lines that mark something.
#[derive(Clone, Debug, Default)]
pub(crate) struct Chart {
    pub(crate) title: String,
    /// Labels of the axes, with units.
    pub(crate) axes: [&'static str; 2],
    pub(crate) series: Vec<Series>,
    pub(crate) lines: Vec<(f64, &'static str)>,
}

/// The drawing's units; a phone shows about three quarters of a pixel each.
const SIZE: [f64; 2] = [480.0, 360.0];
const LEFT: f64 = 62.0;
const TOP: f64 = 14.0;
const FRAME: [f64; 2] = [SIZE[0] - LEFT - 14.0, SIZE[1] - TOP - 48.0];

/// Marks and colours there are: classes `s0` … of the page's style.
const LOOKS: usize = 8;

impl Chart {
    /// The figure: title, drawing, and a legend below it.
    pub(super) fn to_html(&self) -> String {
        let title = escaped(&self.title);
        let Some(svg) = self.to_svg() else {
            return format!(
                "<figure><figcaption>{title}: nothing was measured</figcaption></figure>\n"
            );
        };
        let entry = |(i, series): (usize, &Series)| {
            let mark = mark(i, 12.0, 7.0);
            format!(
                "<li><svg viewBox=\"0 0 24 14\" width=\"24\" height=\"14\" class=\"s{}\" aria-hidden=\"true\">\
                 <path class=\"line\" d=\"M0 7H24\"/>{mark}</svg> {}</li>",
                i % LOOKS,
                escaped(&series.name)
            )
        };
        let legend: String = self.series.iter().enumerate().map(entry).collect();
        format!(
            "<figure><figcaption>{title}</figcaption>\n{svg}<ul class=\"legend\">{legend}</ul></figure>\n"
        )
    }

    /// A file of its own, title and legend included; `None` if there is nothing
    /// to draw.
    pub(crate) fn to_file(&self) -> Option<String> {
        const ROW: f64 = 19.0;
        let drawing = self.to_svg()?;
        let inner = drawing.split_once(">\n")?.1.strip_suffix("</svg>\n")?;
        let height = SIZE[1] + 26.0 + ROW * self.series.len() as f64;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 -24 {} {height}\">\n\
             <style>{}</style>\n\
             <rect x=\"0\" y=\"-24\" width=\"100%\" height=\"100%\" style=\"fill: var(--back)\"/>\n\
             <text x=\"{LEFT}\" y=\"-6\" font-weight=\"bold\">{}</text>\n{inner}",
            SIZE[0],
            super::page::DRAWING,
            escaped(&self.title)
        );
        for (i, series) in self.series.iter().enumerate() {
            let y = SIZE[1] + 8.0 + ROW * i as f64;
            let _ = writeln!(
                svg,
                "<g class=\"s{}\"><path class=\"line\" d=\"M{LEFT} {y}h28\"/>{}</g>\
                 <text x=\"{}\" y=\"{}\">{}</text>",
                i % LOOKS,
                mark(i, LEFT + 14.0, y),
                LEFT + 36.0,
                y + 4.5,
                escaped(&series.name)
            );
        }
        Some(svg + "</svg>\n")
    }

    /// The drawing; `None` if no point has logarithms.
    fn to_svg(&self) -> Option<String> {
        let shown = |p: &&Point| [p.x, p.y].iter().all(|&x| x > 0.0 && x.is_finite());
        let points: Vec<&Point> =
            self.series.iter().flat_map(|s| &s.points).filter(shown).collect();
        let lines = self.lines.iter().map(|line| line.0);
        let x = Axis::of(points.iter().map(|p| p.x).chain(lines))?;
        let y = Axis::of(points.iter().map(|p| p.y))?;
        points.first()?;
        let (right, bottom) = (LEFT + FRAME[0], TOP + FRAME[1]);
        let to_x = |v: f64| LEFT + FRAME[0] * x.at(v);
        let to_y = |v: f64| bottom - FRAME[1] * y.at(v);
        let mut svg = format!(
            "<svg class=\"chart\" viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{}\">\n",
            SIZE[0],
            SIZE[1],
            escaped(&self.title)
        );
        for (value, label) in x.ticks() {
            let at = to_x(value);
            let _ = writeln!(svg, "<path class=\"grid\" d=\"M{at:.1} {TOP}V{bottom}\"/>");
            let _ = writeln!(
                svg,
                "<text x=\"{at:.1}\" y=\"{}\" text-anchor=\"middle\">{label}</text>",
                bottom + 17.0
            );
        }
        for (value, label) in y.ticks() {
            let at = to_y(value);
            let _ = writeln!(svg, "<path class=\"grid\" d=\"M{LEFT} {at:.1}H{right}\"/>");
            let _ = writeln!(
                svg,
                "<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{label}</text>",
                LEFT - 6.0,
                at + 4.0
            );
        }
        let _ = writeln!(
            svg,
            "<rect class=\"frame\" x=\"{LEFT}\" y=\"{TOP}\" width=\"{}\" height=\"{}\"/>",
            FRAME[0], FRAME[1]
        );
        let [x_label, y_label] = self.axes.map(escaped);
        let (centre, middle) = (LEFT + 0.5 * FRAME[0], TOP + 0.5 * FRAME[1]);
        let _ = writeln!(
            svg,
            "<text x=\"{centre}\" y=\"{}\" text-anchor=\"middle\">{x_label}</text>",
            SIZE[1] - 8.0
        );
        let _ = writeln!(
            svg,
            "<text transform=\"translate(14 {middle}) rotate(-90)\" text-anchor=\"middle\">{y_label}</text>"
        );
        for (value, label) in &self.lines {
            let at = to_x(*value);
            let _ = writeln!(svg, "<path class=\"note\" d=\"M{at:.1} {TOP}V{bottom}\"/>");
            let (anchor, from) = if at > centre { ("end", at - 5.0) } else { ("start", at + 5.0) };
            let _ = writeln!(
                svg,
                "<text class=\"note\" x=\"{from:.1}\" y=\"{}\" text-anchor=\"{anchor}\">{}</text>",
                TOP + 15.0,
                escaped(label)
            );
        }
        for (i, series) in self.series.iter().enumerate() {
            let points: Vec<&Point> = series.points.iter().filter(shown).collect();
            let _ = write!(svg, "<g class=\"s{}\"><polyline class=\"line\" points=\"", i % LOOKS);
            for p in &points {
                let _ = write!(svg, "{:.1},{:.1} ", to_x(p.x), to_y(p.y));
            }
            svg += "\"/>\n";
            for p in points {
                let at = to_y(p.y);
                if let Some([low, high]) = p.range.filter(|r| r[0] > 0.0) {
                    let clamp = |v: f64| to_x(v).clamp(LEFT, right);
                    let _ = write!(
                        svg,
                        "<path class=\"bar\" d=\"M{:.1} {at:.1}H{:.1}\"/>",
                        clamp(low),
                        clamp(high)
                    );
                }
                svg += &mark(i, to_x(p.x), at);
                svg += "\n";
            }
            svg += "</g>\n";
        }
        Some(svg + "</svg>\n")
    }
}

/// The mark of series `i` about (x, y): shapes that differ without colour.
fn mark(i: usize, x: f64, y: f64) -> String {
    let path = match i % LOOKS {
        0 => return format!("<circle class=\"mark\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\"/>"),
        1 => "m-4 -4h8v8h-8z",
        2 => "m0 -5l5 9h-10z",
        3 => "m0 -5.5l5 5.5l-5 5.5l-5 -5.5z",
        4 => "m0 5l5 -9h-10z",
        5 => "m-4.5 0h9m-4.5 -4.5v9",
        6 => "m-4 -4l8 8m0 -8l-8 8",
        _ => "m-5 -2.5h10v5h-10z",
    };
    format!("<path class=\"mark\" d=\"M{x:.1} {y:.1}{path}\"/>")
}

/// Decimal logarithms of an axis' ends.
#[derive(Clone, Copy, Debug)]
struct Axis {
    low: f64,
    high: f64,
}

impl Axis {
    /// Holds all values, with a little room.
    fn of(values: impl Iterator<Item = f64>) -> Option<Self> {
        let (low, high) = values
            .filter(|v| *v > 0.0 && v.is_finite())
            .map(f64::log10)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
        let room = 0.05 * (high - low) + 0.06;
        (low <= high).then_some(Self { low: low - room, high: high + room })
    }

    fn at(self, value: f64) -> f64 {
        (value.log10() - self.low) / (self.high - self.low)
    }

    /// Powers of ten; where there are fewer than two, also twice and five times
    /// those; where there are more than seven, every other.
    fn ticks(self) -> Vec<(f64, String)> {
        let exponents: Vec<i32> = (self.low.floor() as i32..=self.high.ceil() as i32).collect();
        let inside = |v: &f64| (self.low..=self.high).contains(&v.log10());
        let whole = exponents.iter().filter(|&&e| inside(&10.0_f64.powi(e))).count();
        let factors: &[f64] = if whole < 2 { &[1.0, 2.0, 5.0] } else { &[1.0] };
        let step = if whole > 7 { 2 } else { 1 };
        let wanted = exponents.iter().filter(|&&e| e.rem_euclid(step) == 0);
        let values = wanted.flat_map(|&e| factors.iter().map(move |f| (f * 10.0_f64.powi(e), e)));
        let label = |(v, e): (f64, i32)| {
            let plain = (-3..4).contains(&e);
            (v, if plain { super::table::short(v) } else { power(e) })
        };
        let label = |pair: (f64, i32)| {
            let (v, text) = label(pair);
            let trimmed = if text.contains('.') {
                text.trim_end_matches('0').trim_end_matches('.').to_owned()
            } else {
                text
            };
            (v, trimmed)
        };
        values.filter(|(v, _)| inside(v)).map(label).collect()
    }
}

/// 10 to an exponent: "10⁻³".
pub(super) fn power(exponent: i32) -> String {
    const RAISED: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    let raise = |c: char| c.to_digit(10).map_or('⁻', |digit| RAISED[digit as usize]);
    "10".chars().chain(exponent.to_string().chars().map(raise)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(points: &[[f64; 2]]) -> Chart {
        let points = points.iter().map(|p| Point { x: p[0], y: p[1], range: None }).collect();
        Chart {
            title: "a < b".to_owned(),
            axes: ["time, s", "error"],
            series: vec![Series { name: "c & d".to_owned(), points }],
            lines: vec![(2.0, "here")],
        }
    }

    #[test]
    fn what_has_no_logarithm_is_left_out() {
        let html = chart(&[[1.0, 1e-3], [2.0, 0.0], [4.0, f64::NAN], [8.0, 1e-4]]).to_html();
        assert!(!html.contains("NaN") && !html.contains("inf"), "{html}");
        assert!(html.contains("a &lt; b") && html.contains("c &amp; d"), "{html}");
        assert_eq!(html.matches("<circle").count(), 3, "two points and the legend: {html}");
        assert!(chart(&[[0.0, 1.0]]).to_html().contains("nothing was measured"));
        assert_eq!(chart(&[[0.0, 1.0]]).to_file(), None);
        let file = chart(&[[1.0, 1e-3]]).to_file().expect("a point");
        assert_eq!(file.matches("<svg").count(), file.matches("</svg>").count(), "{file}");
        assert!(file.contains("c &amp; d"), "its legend: {file}");
    }

    #[test]
    fn a_short_axis_still_has_ticks() {
        let axis = Axis::of([0.3, 0.9].into_iter()).expect("two values");
        let labels: Vec<String> = axis.ticks().into_iter().map(|tick| tick.1).collect();
        assert_eq!(labels, ["0.5", "1"]);
        let long = Axis::of([1e-9, 1.0].into_iter()).expect("two values");
        assert!((4..=7).contains(&long.ticks().len()), "{:?}", long.ticks());
    }
}

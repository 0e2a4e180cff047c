//! Log–log plots as SVG.

use std::fmt::Write;

/// One series of points, joined in their order.
#[derive(Debug)]
pub(crate) struct Curve {
    pub(crate) name: String,
    /// Both coordinates positive; others are left out.
    pub(crate) points: Vec<[f64; 2]>,
    /// Any SVG colour.
    pub(crate) colour: &'static str,
    pub(crate) dashed: bool,
}

/// Curves over two logarithmic axes, with their names at the right.
#[derive(Debug)]
pub(crate) struct Plot {
    pub(crate) title: String,
    /// Labels of the axes, with units.
    pub(crate) labels: [&'static str; 2],
    pub(crate) curves: Vec<Curve>,
    /// Points below it are drawn on the frame, as triangles.
    pub(crate) floor: f64,
}

/// Pixels: the plot's frame and what surrounds it.
const FRAME: [f64; 2] = [620.0, 460.0];
const LEFT: f64 = 80.0;
const TOP: f64 = 40.0;
const SIZE: [f64; 2] = [LEFT + FRAME[0] + 210.0, TOP + FRAME[1] + 60.0];

impl Plot {
    /// The picture, or `None` if no curve has a point.
    pub(crate) fn to_svg(&self) -> Option<String> {
        let shown: Vec<[f64; 2]> = self.curves.iter().flat_map(|c| self.shown(c)).collect();
        let axes = [Axis::of(&shown, 0)?, Axis::of(&shown, 1)?];
        let mut svg = String::new();
        self.draw(&mut svg, axes).expect("writing to a string does not fail");
        Some(svg)
    }

    /// What of a curve has logarithms, nothing below the floor.
    fn shown(&self, curve: &Curve) -> impl Iterator<Item = [f64; 2]> {
        let shown = |p: &&[f64; 2]| p.iter().all(|&x| x > 0.0 && x.is_finite());
        curve.points.iter().filter(shown).map(|p| [p[0], p[1].max(self.floor)])
    }

    fn draw(&self, svg: &mut String, [x, y]: [Axis; 2]) -> std::fmt::Result {
        let [width, height] = SIZE;
        let (right, bottom) = (LEFT + FRAME[0], TOP + FRAME[1]);
        writeln!(
            svg,
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" \
             font-family=\"sans-serif\" font-size=\"13\">"
        )?;
        writeln!(svg, "<rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>")?;
        let middle = LEFT + 0.5 * FRAME[0];
        let title = escaped(&self.title);
        writeln!(
            svg,
            "<text x=\"{middle}\" y=\"24\" text-anchor=\"middle\" font-size=\"15\">{title}</text>"
        )?;
        for (decade, exponent) in x.decades() {
            let at = LEFT + FRAME[0] * decade;
            writeln!(svg, "<path d=\"M{at:.1} {TOP}V{bottom}\" stroke=\"#ddd\"/>")?;
            let base = bottom + 20.0;
            writeln!(
                svg,
                "<text x=\"{at:.1}\" y=\"{base}\" text-anchor=\"middle\">{}</text>",
                power(exponent)
            )?;
        }
        for (decade, exponent) in y.decades() {
            let at = bottom - FRAME[1] * decade;
            writeln!(svg, "<path d=\"M{LEFT} {at:.1}H{right}\" stroke=\"#ddd\"/>")?;
            let (left, base) = (LEFT - 8.0, at + 4.0);
            writeln!(
                svg,
                "<text x=\"{left}\" y=\"{base:.1}\" text-anchor=\"end\">{}</text>",
                power(exponent)
            )?;
        }
        let [x_label, y_label] = self.labels.map(escaped);
        let base = bottom + 46.0;
        writeln!(svg, "<text x=\"{middle}\" y=\"{base}\" text-anchor=\"middle\">{x_label}</text>")?;
        let centre = TOP + 0.5 * FRAME[1];
        writeln!(
            svg,
            "<text transform=\"translate(20 {centre}) rotate(-90)\" text-anchor=\"middle\">\
             {y_label}</text>"
        )?;
        for (row, curve) in self.curves.iter().enumerate() {
            let pixel =
                |p: [f64; 2]| [LEFT + FRAME[0] * x.at(p[0]), bottom - FRAME[1] * y.at(p[1])];
            let points: Vec<[f64; 2]> = self.shown(curve).map(pixel).collect();
            let floor = bottom - FRAME[1] * y.at(self.floor);
            curve.draw(svg, &points, &points, floor)?;
            let (from, at) = (right + 16.0, TOP + 10.0 + 20.0 * row as f64);
            curve.draw(svg, &[[from, at], [from + 30.0, at]], &[[from + 15.0, at]], bottom)?;
            let (text, base) = (from + 38.0, at + 4.0);
            writeln!(svg, "<text x=\"{text}\" y=\"{base}\">{}</text>", escaped(&curve.name))?;
        }
        writeln!(
            svg,
            "<rect x=\"{LEFT}\" y=\"{TOP}\" width=\"{}\" height=\"{}\" fill=\"none\" \
             stroke=\"#555\"/>",
            FRAME[0], FRAME[1]
        )?;
        writeln!(svg, "</svg>")
    }
}

impl Curve {
    /// A line through the pixels `points`, and markers at `marks`: triangles
    /// at or below pixel row `floor`, else circles.
    fn draw(
        &self,
        svg: &mut String,
        points: &[[f64; 2]],
        marks: &[[f64; 2]],
        floor: f64,
    ) -> std::fmt::Result {
        let colour = self.colour;
        let dash = if self.dashed { " stroke-dasharray=\"6 4\"" } else { "" };
        write!(
            svg,
            "<polyline fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.8\"{dash} points=\""
        )?;
        for [x, y] in points {
            write!(svg, "{x:.1},{y:.1} ")?;
        }
        writeln!(svg, "\"/>")?;
        let fill = if self.dashed { "white" } else { colour };
        for &[x, y] in marks {
            if y >= floor {
                writeln!(
                    svg,
                    "<path d=\"M{:.1} {:.1}h10l-5 9z\" fill=\"{fill}\" stroke=\"{colour}\"/>",
                    x - 5.0,
                    y - 4.0
                )?;
            } else {
                writeln!(
                    svg,
                    "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"2.6\" fill=\"{fill}\" \
                     stroke=\"{colour}\"/>"
                )?;
            }
        }
        Ok(())
    }
}

/// Decimal logarithms of an axis' ends.
#[derive(Clone, Copy, Debug)]
struct Axis {
    low: f64,
    high: f64,
}

impl Axis {
    /// Holds coordinate `d` of all `points`, with a little room.
    fn of(points: &[[f64; 2]], d: usize) -> Option<Self> {
        let logs = points.iter().map(|p| p[d].log10());
        let (low, high) = logs
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
        let room = 0.03 * (high - low) + 0.05;
        (low <= high).then_some(Self { low: low - room, high: high + room })
    }

    /// Where `value` is along the axis: 0 at its low end, 1 at its high end.
    fn at(self, value: f64) -> f64 {
        (value.log10() - self.low) / (self.high - self.low)
    }

    /// Where its powers of ten are, and their exponents.
    fn decades(self) -> impl Iterator<Item = (f64, i32)> {
        let exponents = self.low.ceil() as i32..=self.high.floor() as i32;
        exponents.map(move |e| (self.at(10.0_f64.powi(e)), e))
    }
}

/// 10 to an exponent: "10⁻³".
fn power(exponent: i32) -> String {
    const RAISED: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    let raise = |c: char| c.to_digit(10).map_or('⁻', |digit| RAISED[digit as usize]);
    "10".chars().chain(exponent.to_string().chars().map(raise)).collect()
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot(points: Vec<[f64; 2]>) -> Plot {
        let curve = Curve { name: "a < b".to_owned(), points, colour: "red", dashed: false };
        Plot { title: "t".to_owned(), labels: ["x, s", "y"], curves: vec![curve], floor: 1e-9 }
    }

    #[test]
    fn powers_of_ten_are_evenly_spaced() {
        let axis = Axis::of(&[[1e-3, 1.0], [1e3, 1.0]], 0).expect("points");
        let at: Vec<f64> = axis.decades().map(|(at, _)| at).collect();
        assert_eq!(at.len(), 7, "10⁻³ to 10³: {at:?}");
        assert!(at.windows(3).all(|w| (w[0] + w[2] - 2.0 * w[1]).abs() < 1e-12), "{at:?}");
    }

    #[test]
    fn what_has_no_logarithm_is_left_out() {
        let svg = plot(vec![[1.0, 1e-3], [2.0, 0.0], [4.0, 1e-4]]).to_svg().expect("two points");
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        assert!(svg.contains("a &lt; b"), "{svg}");
        assert_eq!(power(-12), "10⁻¹²");
        assert_eq!(plot(vec![[0.0, 1.0]]).to_svg(), None, "nothing to show");
    }
}

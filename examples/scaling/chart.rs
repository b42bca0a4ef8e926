//! Log–log charts as SVG.

use std::fmt::Write as _;

/// One line of a chart.
#[derive(Clone, Debug)]
pub(crate) struct Series {
    /// What it shows.
    pub(crate) label: String,
    /// Its colour, as an index.
    pub(crate) colour: usize,
    /// Its dashes, as an index.
    pub(crate) dashes: usize,
    /// Positive x and y, in ascending order of x.
    pub(crate) points: Vec<(f64, f64)>,
}

const COLOURS: [&str; 6] = ["#0b6e99", "#c8553d", "#4f772d", "#7b4b94", "#b8860b", "#444444"];
const DASHES: [&str; 4] = ["none", "7 4", "2 3", "9 3 2 3"];
/// Width and height of a panel, in pixels.
const PANEL: (f64, f64) = (380.0, 380.0);
/// Room left of a panel, and above and below.
const MARGIN: (f64, f64) = (70.0, 50.0);
/// Room for the key.
const KEY: f64 = 190.0;

/// Panels side by side, with a title each, and one key for all: the series of the first.
pub(crate) fn svg(title: &str, x: &str, y: &str, panels: &[(&str, Vec<Series>)]) -> String {
    let width = panels.len() as f64 * (PANEL.0 + MARGIN.0) + KEY;
    let height = PANEL.1 + 2.0 * MARGIN.1;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" \
         font-family=\"sans-serif\" font-size=\"12\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
    );
    text(&mut svg, (MARGIN.0, 18.0), "start", title);
    let all = panels.iter().flat_map(|(_, series)| series).flat_map(|s| &s.points);
    let (xs, ys): (Vec<f64>, Vec<f64>) = all.copied().unzip();
    let (x_decades, y_decades) = (decades(&xs), decades(&ys));
    for (i, (name, series)) in panels.iter().enumerate() {
        let left = MARGIN.0 + i as f64 * (PANEL.0 + MARGIN.0);
        let frame = Frame { left, x: x_decades, y: y_decades };
        frame.axes(&mut svg, x, &format!("{name}, {y}"));
        series.iter().for_each(|series| frame.series(&mut svg, series));
    }
    let left = width - KEY + 15.0;
    for (i, series) in panels.first().map_or(&[][..], |(_, s)| s).iter().enumerate() {
        let y = MARGIN.1 + 10.0 + 18.0 * i as f64;
        line(&mut svg, series, &format!("{left},{y} {},{y}", left + 30.0));
        text(&mut svg, (left + 36.0, y + 4.0), "start", &series.label);
    }
    svg.push_str("</svg>\n");
    svg
}

/// A panel: where it starts, and the powers of ten between which its axes run.
struct Frame {
    left: f64,
    x: (i32, i32),
    y: (i32, i32),
}

impl Frame {
    fn axes(&self, svg: &mut String, x: &str, y: &str) {
        let (bottom, right) = (MARGIN.1 + PANEL.1, self.left + PANEL.0);
        for decade in self.x.0..=self.x.1 {
            let at = self.place(10f64.powi(decade), 1.0).0;
            grid(svg, (at, MARGIN.1), (at, bottom));
            text(svg, (at, bottom + 16.0), "middle", &format!("1e{decade}"));
        }
        for decade in self.y.0..=self.y.1 {
            let at = self.place(1.0, 10f64.powi(decade)).1;
            grid(svg, (self.left, at), (right, at));
            text(svg, (self.left - 6.0, at + 4.0), "end", &format!("1e{decade}"));
        }
        text(svg, (0.5 * (self.left + right), bottom + 34.0), "middle", x);
        text(svg, (self.left, MARGIN.1 - 8.0), "start", y);
    }

    fn series(&self, svg: &mut String, series: &Series) {
        let places: Vec<_> = series.points.iter().map(|&(x, y)| self.place(x, y)).collect();
        let corners: Vec<_> = places.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
        line(svg, series, &corners.join(" "));
        for (x, y) in places {
            let colour = COLOURS[series.colour % COLOURS.len()];
            // Writing to a string can't fail, here and below.
            let _ =
                writeln!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"2.5\" fill=\"{colour}\"/>");
        }
    }

    fn place(&self, x: f64, y: f64) -> (f64, f64) {
        let part =
            |v: f64, (from, to): (i32, i32)| (v.log10() - f64::from(from)) / f64::from(to - from);
        let (across, up) = (part(x, self.x), part(y, self.y));
        (self.left + across * PANEL.0, MARGIN.1 + (1.0 - up) * PANEL.1)
    }
}

/// The powers of ten that enclose all values, at least one decade.
fn decades(values: &[f64]) -> (i32, i32) {
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(0.0, f64::max);
    if low > high {
        return (0, 1);
    }
    let from = low.log10().floor() as i32;
    (from, (high.log10().ceil() as i32).max(from + 1))
}

fn line(svg: &mut String, series: &Series, corners: &str) {
    let colour = COLOURS[series.colour % COLOURS.len()];
    let dashes = DASHES[series.dashes % DASHES.len()];
    let _ = writeln!(
        svg,
        "<polyline points=\"{corners}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.6\" \
         stroke-dasharray=\"{dashes}\"/>"
    );
}

fn grid(svg: &mut String, from: (f64, f64), to: (f64, f64)) {
    let _ = writeln!(
        svg,
        "<line x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\" stroke=\"#dddddd\"/>",
        from.0, from.1, to.0, to.1
    );
}

fn text(svg: &mut String, (x, y): (f64, f64), anchor: &str, text: &str) {
    let text = text.replace('&', "&amp;").replace('<', "&lt;");
    let _ = writeln!(svg, "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{text}</text>");
}

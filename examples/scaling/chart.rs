//! Log–log charts as SVG: panels in rows of up to three, with the same axes, and one key for all.

use std::fmt::Write as _;

/// A chart.
#[derive(Clone, Debug, Default)]
pub(crate) struct Chart {
    /// What all panels show.
    pub(crate) title: String,
    /// What x is.
    pub(crate) x: String,
    /// What y is.
    pub(crate) y: String,
    /// What a ring says; empty if there are none.
    pub(crate) ring: String,
    /// What a cross says; empty if there are none.
    pub(crate) cross: String,
    /// The panels, row by row.
    pub(crate) panels: Vec<Panel>,
}

/// One panel of a chart.
#[derive(Clone, Debug, Default)]
pub(crate) struct Panel {
    /// What it shows.
    pub(crate) title: String,
    /// Its lines.
    pub(crate) series: Vec<Series>,
    /// Points that have a ring around them.
    pub(crate) rings: Vec<(f64, f64)>,
    /// Points that are crossed out.
    pub(crate) crosses: Vec<(f64, f64)>,
}

/// One line of a panel.
#[derive(Clone, Debug)]
pub(crate) struct Series {
    /// What it shows; series of the same label share an entry of the key.
    pub(crate) label: String,
    /// Its colour, as an index.
    pub(crate) colour: usize,
    /// Its dashes, as an index.
    pub(crate) dashes: usize,
    /// Its width in pixels; 0 for points alone.
    pub(crate) width: f64,
    /// The radius of its points in pixels; 0 for a line alone.
    pub(crate) dots: f64,
    /// Positive x and y, in the order of the line.
    pub(crate) points: Vec<(f64, f64)>,
}

const COLOURS: [&str; 18] = [
    "#0b6e99", "#c8553d", "#4f772d", "#7b4b94", "#b8860b", "#444444", "#e377c2", "#17becf",
    "#8c564b", "#d62728", "#7fb800", "#1f4fff", "#ff9f1c", "#00a878", "#a30059", "#9aa0a6",
    "#5d2e8c", "#2f4b26",
];
const DASHES: [&str; 4] = ["none", "7 4", "2 3", "9 3 2 3"];
/// Width and height of a panel in rows of one, two and three, in pixels.
const PANELS: [(f64, f64); 3] = [(520.0, 400.0), (400.0, 360.0), (262.0, 240.0)];
/// Room left of a panel, for the numbers of its axis, and above and below.
const MARGIN: (f64, f64) = (50.0, 26.0);
/// Room left of all panels, for what y is, and right of them.
const EDGE: f64 = 20.0;
/// Room above the panels.
const TOP: f64 = 26.0;
/// Height of a row of the key.
const KEY_ROW: f64 = 18.0;
/// About how wide a letter is.
const LETTER: f64 = 6.6;

impl Chart {
    /// The chart as a file.
    pub(crate) fn svg(&self) -> String {
        let columns = self.panels.len().clamp(1, PANELS.len());
        let size = PANELS[columns - 1];
        let step = (size.0 + MARGIN.0, size.1 + 2.0 * MARGIN.1);
        let rows = self.panels.len().div_ceil(columns) as f64;
        let width = 2.0 * EDGE + columns as f64 * step.0;
        let key_top = TOP + rows * step.1 + 26.0;
        let (key, key_rows) = self.key(width - 2.0 * EDGE, key_top);
        let height = key_top + KEY_ROW * key_rows as f64;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" \
             font-family=\"sans-serif\" font-size=\"12\">\n\
             <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
        );
        text(&mut svg, (EDGE + MARGIN.0, 18.0), "start", &self.title);
        let points = || self.panels.iter().flat_map(|p| &p.series).flat_map(|s| &s.points);
        let x = decades(points().map(|p| p.0));
        let y = decades(points().map(|p| p.1));
        for (i, panel) in self.panels.iter().enumerate() {
            let (column, row) = (i % columns, i / columns);
            let left = EDGE + MARGIN.0 + column as f64 * step.0;
            let top = TOP + MARGIN.1 + row as f64 * step.1;
            let frame = Frame { left, top, size, x, y };
            frame.axes(&mut svg);
            text(&mut svg, (left, top - 6.0), "start", &panel.title);
            if column == 0 {
                frame.what_y_is(&mut svg, &self.y);
            }
            if i + columns >= self.panels.len() {
                let at = (left + 0.5 * size.0, top + size.1 + 32.0);
                text(&mut svg, at, "middle", &self.x);
            }
            frame.panel(&mut svg, panel);
        }
        svg + &key + "</svg>\n"
    }

    /// The key, as wide as it may be, and its number of rows.
    fn key(&self, width: f64, top: f64) -> (String, usize) {
        let mut series: Vec<&Series> = Vec::new();
        for candidate in self.panels.iter().flat_map(|p| &p.series) {
            if !series.iter().any(|s| s.label == candidate.label) {
                series.push(candidate);
            }
        }
        let marks = [(&self.ring, ring as fn(&mut String, (f64, f64))), (&self.cross, cross)];
        let marks: Vec<_> = marks.into_iter().filter(|(label, _)| !label.is_empty()).collect();
        let labels = series.iter().map(|s| &s.label).chain(marks.iter().map(|(label, _)| *label));
        let longest = labels.clone().map(|l| l.chars().count()).max().unwrap_or(0);
        let cell = 56.0 + LETTER * longest as f64;
        let columns = ((width / cell) as usize).max(1);
        let mut key = String::new();
        for (i, label) in labels.enumerate() {
            let left = EDGE + (i % columns) as f64 * cell;
            let y = top + 4.0 + KEY_ROW * (i / columns) as f64;
            match series.get(i) {
                Some(series) => {
                    line(&mut key, series, &[(left, y), (left + 30.0, y)]);
                    dots(&mut key, series, &[(left + 15.0, y)]);
                }
                None => marks[i - series.len()].1(&mut key, (left + 15.0, y)),
            }
            text(&mut key, (left + 36.0, y + 4.0), "start", label);
        }
        (key, (series.len() + marks.len()).div_ceil(columns))
    }
}

/// Where a panel is, and the powers of ten between which its axes run.
struct Frame {
    left: f64,
    top: f64,
    size: (f64, f64),
    x: (i32, i32),
    y: (i32, i32),
}

impl Frame {
    fn axes(&self, svg: &mut String) {
        let (bottom, right) = (self.top + self.size.1, self.left + self.size.0);
        let named = named(self.x, self.size.0, 42.0);
        for decade in self.x.0..=self.x.1 {
            let at = self.place((10f64.powi(decade), 1.0)).0;
            grid(svg, (at, self.top), (at, bottom));
            if decade % named == 0 {
                text(svg, (at, bottom + 15.0), "middle", &format!("1e{decade}"));
            }
        }
        let named = self::named(self.y, self.size.1, 16.0);
        for decade in self.y.0..=self.y.1 {
            let at = self.place((1.0, 10f64.powi(decade))).1;
            grid(svg, (self.left, at), (right, at));
            if decade % named == 0 {
                text(svg, (self.left - 5.0, at + 4.0), "end", &format!("1e{decade}"));
            }
        }
    }

    fn what_y_is(&self, svg: &mut String, y: &str) {
        let at = (self.left - MARGIN.0 - 2.0, self.top + 0.5 * self.size.1);
        // Writing to a string can't fail, here and below.
        let _ = writeln!(
            svg,
            "<text transform=\"translate({:.1} {:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
            at.0,
            at.1,
            escaped(y)
        );
    }

    fn panel(&self, svg: &mut String, panel: &Panel) {
        for series in &panel.series {
            let places: Vec<_> = series.points.iter().map(|&point| self.place(point)).collect();
            line(svg, series, &places);
            dots(svg, series, &places);
        }
        panel.rings.iter().for_each(|&point| ring(svg, self.place(point)));
        panel.crosses.iter().for_each(|&point| cross(svg, self.place(point)));
    }

    fn place(&self, (x, y): (f64, f64)) -> (f64, f64) {
        let part =
            |v: f64, (from, to): (i32, i32)| (v.log10() - f64::from(from)) / f64::from(to - from);
        let (across, up) = (part(x, self.x), part(y, self.y));
        (self.left + across * self.size.0, self.top + (1.0 - up) * self.size.1)
    }
}

/// The powers of ten that enclose all values, at least one decade.
fn decades(values: impl Iterator<Item = f64> + Clone) -> (i32, i32) {
    let low = values.clone().fold(f64::INFINITY, f64::min);
    let high = values.fold(0.0, f64::max);
    if low > high {
        return (0, 1);
    }
    let from = low.log10().floor() as i32;
    (from, (high.log10().ceil() as i32).max(from + 1))
}

/// Of how many powers of ten one has its number, if numbers need so much room on an axis.
fn named((from, to): (i32, i32), length: f64, room: f64) -> i32 {
    (room * f64::from(to - from) / length).ceil().max(1.0) as i32
}

fn line(svg: &mut String, series: &Series, places: &[(f64, f64)]) {
    if series.width == 0.0 {
        return;
    }
    let corners: Vec<_> = places.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
    let _ = writeln!(
        svg,
        "<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{}\" \
         stroke-dasharray=\"{}\"/>",
        corners.join(" "),
        COLOURS[series.colour % COLOURS.len()],
        series.width,
        DASHES[series.dashes % DASHES.len()]
    );
}

fn dots(svg: &mut String, series: &Series, places: &[(f64, f64)]) {
    if series.dots == 0.0 {
        return;
    }
    let (radius, colour) = (series.dots, COLOURS[series.colour % COLOURS.len()]);
    for (x, y) in places {
        let _ =
            writeln!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\" fill=\"{colour}\"/>");
    }
}

fn ring(svg: &mut String, (x, y): (f64, f64)) {
    let _ = writeln!(
        svg,
        "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"5\" fill=\"none\" stroke=\"#111111\"/>"
    );
}

fn cross(svg: &mut String, (x, y): (f64, f64)) {
    let (l, r, t, b) = (x - 4.5, x + 4.5, y - 4.5, y + 4.5);
    let _ = writeln!(
        svg,
        "<path d=\"M{l:.1} {t:.1} L{r:.1} {b:.1} M{l:.1} {b:.1} L{r:.1} {t:.1}\" stroke=\"#d00000\" \
         stroke-width=\"1.8\"/>"
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
    let text = escaped(text);
    let _ = writeln!(svg, "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{text}</text>");
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_enclose_all_values_and_name_as_many_decades_as_fit() {
        assert_eq!(decades([0.3, 2.0, 700.0].into_iter()), (-1, 3));
        assert_eq!(decades([1.0].into_iter()), (0, 1));
        assert_eq!(decades([].into_iter()), (0, 1));
        assert_eq!(named((0, 4), 400.0, 42.0), 1);
        assert_eq!(named((-16, 0), 262.0, 42.0), 3);
    }

    #[test]
    fn a_label_that_several_panels_have_is_in_the_key_once() {
        let series = Series {
            label: "a < b".into(),
            colour: 0,
            dashes: 0,
            width: 1.0,
            dots: 0.0,
            points: vec![(1.0, 1.0), (10.0, 10.0)],
        };
        let panel = Panel { series: vec![series], ..Panel::default() };
        let chart = Chart { panels: vec![panel.clone(), panel], ..Chart::default() };
        assert_eq!(chart.svg().matches("a &lt; b").count(), 1);
    }
}

//! Charts as SVG, in the colours of the page that they are in.

use std::fmt::Write;

/// Width and height of a chart, and what of it is left to the numbers at its axes.
const WIDTH: f64 = 520.0;
const HEIGHT: f64 = 220.0;
const LEFT: f64 = 56.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 12.0;
const BOTTOM: f64 = 34.0;
/// Bars of a histogram.
const BARS: usize = 48;

/// How many of some numbers lie in each of equal intervals; nothing without a finite number. O(N).
pub(crate) fn histogram(numbers: &[f64], name: &str) -> String {
    let finite = || numbers.iter().copied().filter(|x| x.is_finite());
    let (low, high) = finite()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
    if low > high {
        return String::new();
    }
    // Numbers that are all alike are one bar in the middle.
    let width = high - low;
    let margin = if width > 1e-9 * high.abs().max(low.abs()) { 0.0 } else { 0.5e-3 };
    let (low, high) = (low - margin, high + margin);
    let mut counts = [0usize; BARS];
    for x in finite() {
        let place = (x - low) / (high - low) * BARS as f64;
        counts[(place as usize).min(BARS - 1)] += 1;
    }
    let most = counts.iter().copied().max().unwrap_or(1).max(1);
    let mut svg = begin(&format!("Histogram: {name}"));
    let step = (WIDTH - LEFT - RIGHT) / BARS as f64;
    for (k, &count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
        let height = (count as f64 / most as f64 * inner_height()).max(1.0);
        let (x, y) = (LEFT + k as f64 * step, TOP + inner_height() - height);
        let (from, to) = [k, k + 1].map(|k| low + (high - low) * k as f64 / BARS as f64).into();
        let title = format!("{count} from {from:.4} to {to:.4}");
        let wide = step - 1.0;
        add(
            &mut svg,
            format_args!(
                "<rect class=\"bar\" x=\"{x:.1}\" y=\"{y:.1}\" width=\"{wide:.1}\" height=\"{height:.1}\">\
                 <title>{title}</title></rect>"
            ),
        );
    }
    for k in 0..=4 {
        let share = f64::from(k) / 4.0;
        let x = LEFT + share * (WIDTH - LEFT - RIGHT);
        let anchor = ["start", "middle", "middle", "middle", "end"][k as usize];
        text(&mut svg, [x, HEIGHT - 16.0], anchor, &format!("{:.4}", low + share * (high - low)));
    }
    text(&mut svg, [0.5 * (LEFT + WIDTH - RIGHT), HEIGHT - 1.0], "middle", name);
    text(&mut svg, [LEFT - 6.0, TOP + 10.0], "end", &most.to_string());
    text(&mut svg, [LEFT - 6.0, TOP + inner_height()], "end", "0");
    end(svg)
}

/// Residuals step by step, on a logarithmic scale, down to the one to reach; nothing without a positive one.
pub(crate) fn convergence(curves: &[Vec<(usize, f64)>], goal: f64) -> String {
    let shown = |&&(_, residual): &&(usize, f64)| residual > 0.0 && residual.is_finite();
    let all = || curves.iter().flatten().filter(shown);
    let Some(last) = all().map(|&(step, _)| step).max() else { return String::new() };
    let logs = || all().map(|&(_, residual)| residual.log10()).chain([goal.log10()]);
    let low = logs().fold(f64::INFINITY, f64::min).floor();
    let high = logs().fold(f64::NEG_INFINITY, f64::max).ceil().max(low + 1.0);
    let x = |step: usize| LEFT + step as f64 / last.max(1) as f64 * (WIDTH - LEFT - RIGHT);
    let y = |log: f64| TOP + (high - log) / (high - low) * inner_height();
    let mut svg = begin("Residual by step, on a logarithmic scale");
    let decades = ((high - low) as usize).div_ceil(6).max(1);
    for k in (0..=(high - low) as usize).step_by(decades) {
        let log = low + k as f64;
        let height = y(log);
        let right = WIDTH - RIGHT;
        add(&mut svg, format_args!("<path class=\"axis\" d=\"M{LEFT} {height:.1}H{right}\"/>"));
        text(&mut svg, [LEFT - 6.0, height + 4.0], "end", &format!("1e{log}"));
    }
    for step in [0, last / 2, last] {
        text(&mut svg, [x(step), HEIGHT - 16.0], "middle", &step.to_string());
    }
    text(&mut svg, [0.5 * (LEFT + WIDTH - RIGHT), HEIGHT - 1.0], "middle", "steps");
    let (height, right) = (y(goal.log10()), WIDTH - RIGHT);
    add(&mut svg, format_args!("<path class=\"limit\" d=\"M{LEFT} {height:.1}H{right}\"/>"));
    add(
        &mut svg,
        format_args!(
            "<text class=\"limit-name\" x=\"{right}\" y=\"{:.1}\" text-anchor=\"end\">goal</text>",
            height - 4.0
        ),
    );
    for curve in curves {
        let places = curve.iter().filter(shown).map(|&(step, r)| (x(step), y(r.log10())));
        let places: Vec<_> = places.collect();
        let line: Vec<_> = places.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
        add(&mut svg, format_args!("<polyline class=\"curve\" points=\"{}\"/>", line.join(" ")));
        for (x, y) in places.iter().filter(|_| places.len() <= 40) {
            add(
                &mut svg,
                format_args!("<circle class=\"point\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\"/>"),
            );
        }
    }
    end(svg)
}

fn inner_height() -> f64 {
    HEIGHT - TOP - BOTTOM
}

fn begin(label: &str) -> String {
    let bottom = TOP + inner_height();
    let right = WIDTH - RIGHT;
    format!(
        "<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{label}\">\
         <path class=\"axis\" d=\"M{LEFT} {TOP}V{bottom}H{right}\"/>"
    )
}

fn end(svg: String) -> String {
    svg + "</svg>"
}

fn text(svg: &mut String, [x, y]: [f64; 2], anchor: &str, content: &str) {
    add(
        svg,
        format_args!("<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{content}</text>"),
    );
}

fn add(svg: &mut String, part: std::fmt::Arguments<'_>) {
    svg.write_fmt(part).expect("memory");
}

#[cfg(test)]
mod tests {
    use super::*;

    fn count(svg: &str, what: &str) -> usize {
        svg.matches(what).count()
    }

    #[test]
    fn every_number_is_in_one_bar() {
        let numbers: Vec<f64> = (0..1000).map(|k| f64::from(k) / 999.0).collect();
        let svg = histogram(&numbers, "x");
        let counts = svg.split("<title>").skip(1).map(|rest| {
            rest.split(' ').next().expect("a number").parse::<usize>().expect("a number")
        });
        assert_eq!((counts.clone().count(), counts.sum::<usize>()), (BARS, 1000));
        let alike = histogram(&[1.0, 1.0, f64::NAN], "x");
        assert!(count(&alike, "class=\"bar\"") == 1 && alike.contains("<title>2 from "));
        assert_eq!(histogram(&[f64::NAN], "x"), "");
    }

    #[test]
    fn a_curve_has_a_point_for_every_step_and_ends_at_its_goal() {
        let curve: Vec<_> = (0..5).map(|k| (k, 10f64.powi(-(k as i32)))).collect();
        let svg = convergence(&[curve, vec![(0, 0.0)]], 1e-4);
        assert_eq!(count(&svg, "<circle"), 5);
        let height = format!("{:.1}", TOP + inner_height());
        assert!(svg.contains(&format!("cy=\"{height}\"")), "the last one at the lower end");
        assert!(svg.contains(&format!("<path class=\"limit\" d=\"M{LEFT} {height}H")));
        assert_eq!(convergence(&[vec![(0, 0.0)]], 1e-4), "");
    }
}

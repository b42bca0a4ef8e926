//! The report as a page: pictures, charts, warnings and all figures in one file.

mod charts;

use std::io::{self, Write};

use super::report::Report;

/// What a page shows beside the figures.
pub(crate) struct Exhibits<'a> {
    /// The picture as a data URI, if there is one.
    pub(crate) picture: Option<String>,
    /// The sums of form factors of all elements before closure.
    pub(crate) row_sums: &'a [f64],
    /// The residual that the solver goes down to.
    pub(crate) goal: f64,
}

/// Writes a report as HTML that needs no other file.
///
/// # Errors
/// Those of `file`.
pub(crate) fn write(
    file: &mut impl Write,
    report: &Report,
    exhibits: &Exhibits<'_>,
) -> io::Result<()> {
    let scene = escaped(&report.scene);
    write!(
        file,
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n\
         <title>{scene} – farfield radiosity</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n\
         <header><h1>{scene}</h1><p>{}</p></header>\n<main>\n",
        summary(report)
    )?;
    let warnings: Vec<_> = report.warnings.iter().map(|warning| warning.to_string()).collect();
    list(file, "Warnings", "wide warn", &warnings)?;
    if let Some(uri) = &exhibits.picture {
        let what = format!("Picture of {scene}");
        section(file, "Picture", "", &format!("<img src=\"{uri}\" alt=\"{what}\">"))?;
    }
    section(file, "Figures", "", &figures(report))?;
    let curves = charts::convergence(&report.residuals, exhibits.goal);
    section(file, "Convergence", "", &curves)?;
    let sums = charts::histogram(exhibits.row_sums, "sum of an element’s form factors");
    section(file, "Sums of form factors", "", &sums)?;
    section(file, "Time", "", &phases(report))?;
    list(file, "Mended in the scene", "", &report.repairs)?;
    let links = report.files.iter().map(|name| format!("<li><a href=\"{name}\">{name}</a></li>"));
    section(file, "Files", "", &format!("<ul>{}</ul>", links.collect::<String>()))?;
    writeln!(file, "</main>\n</body>\n</html>")
}

const STYLE: &str = include_str!("style.css");

/// What a run was about, in a line.
fn summary(report: &Report) -> String {
    let error = match report.relative_l2_error.or(report.factor_l2_error) {
        Some(error) => format!("sums off by {error:.1e}, allowed are {:.0e}", report.tolerance),
        None => format!("the error of sums is unknown, allowed are {:.0e}", report.tolerance),
    };
    let bands =
        if report.bands == 1 { "1 band".to_owned() } else { format!("{} bands", report.bands) };
    let total: f64 = report.phases.values().sum();
    let ended = if report.interrupted { ", interrupted" } else { "" };
    format!("{} elements, {bands}, {error}, {total:.1} s{ended}", report.elements)
}

/// A part of the page; nothing if it has no content.
fn section(file: &mut impl Write, title: &str, class: &str, content: &str) -> io::Result<()> {
    if content.is_empty() {
        return Ok(());
    }
    writeln!(file, "<section class=\"{class}\"><h2>{title}</h2>{content}</section>")
}

/// Sentences as a part of the page; nothing if there are none.
fn list(file: &mut impl Write, title: &str, class: &str, items: &[String]) -> io::Result<()> {
    let items: String = items.iter().map(|item| format!("<li>{}</li>", escaped(item))).collect();
    let content = if items.is_empty() { items } else { format!("<ul>{items}</ul>") };
    section(file, title, class, &content)
}

/// All figures, as standard output has them.
fn figures(report: &Report) -> String {
    let rows = report.lines().into_iter().filter(|(name, _)| *name != "mended");
    let rows = rows.map(|(name, value)| {
        format!("<tr><th scope=\"row\">{name}</th><td>{}</td></tr>", escaped(&value))
    });
    format!("<table>{}</table>", rows.collect::<String>())
}

/// The seconds of each phase, the longest first, with bars.
fn phases(report: &Report) -> String {
    let mut phases: Vec<_> = report.phases.iter().collect();
    phases.sort_by(|a, b| b.1.total_cmp(a.1));
    let most = phases.first().map_or(1.0, |(_, seconds)| seconds.max(1e-9));
    let rows = phases.iter().map(|(phase, seconds)| {
        let share = 100.0 * *seconds / most;
        format!(
            "<tr><th scope=\"row\">{phase}</th><td class=\"share\"><span style=\"width:{share:.1}%\">\
             </span></td><td class=\"number\">{seconds:.2} s</td></tr>"
        )
    });
    format!("<table>{}</table>", rows.collect::<String>())
}

/// A text in which no sign means anything to HTML.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

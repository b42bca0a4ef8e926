//! The rows of STABILITY.md.

use std::fmt::Display;

/// Prints the row of the test that runs: what is tried, why it goes wrong, what came of it without a
/// defence and with ours. The page must have it.
pub(crate) fn row(mode: &str, why: &str, naive: impl Display, ours: impl Display) {
    let thread = std::thread::current();
    let test = thread.name().unwrap_or_default();
    let cells = [mode, why, &naive.to_string(), &ours.to_string()];
    let cells = cells.map(|cell| cell.replace('|', "\\|")).join(" | ");
    println!("| {cells} | `{test}` |");
    let page = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../STABILITY.md"));
    let named = page.unwrap().contains(&format!("`{test}`"));
    assert!(named, "STABILITY.md has no row of {test}");
}

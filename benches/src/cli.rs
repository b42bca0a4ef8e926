//! Values on command lines.

use clap::ValueEnum;

/// A floating-point precision.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Precision {
    /// Single
    F32,
    /// Double
    F64,
}

/// The name that a value has on the command line.
pub fn name(value: impl ValueEnum) -> String {
    value.to_possible_value().map_or_else(String::new, |v| v.get_name().to_owned())
}

/// Reads a whole number, which may be written like 1e6.
///
/// # Errors
/// If the text is anything else.
pub fn count(text: &str) -> Result<usize, String> {
    match text.parse::<f64>() {
        Ok(n) if (1.0..=4e9).contains(&n) && n.fract() == 0.0 => Ok(n as usize),
        _ => Err("expected a whole number from 1 to 4e9, such as 100000 or 1e5".into()),
    }
}

/// Reads a relative error to ask for.
///
/// # Errors
/// If the text is not a number between 0 and 1.
pub fn tolerance(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(tolerance) if 0.0 < tolerance && tolerance < 1.0 => Ok(tolerance),
        _ => Err("expected a number between 0 and 1, both excluded".into()),
    }
}

/// Reads a number of threads.
///
/// # Errors
/// If the text is not a whole number from 1 to 512.
pub fn threads(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(count @ 1..=512) => Ok(count),
        _ => Err("expected a whole number from 1 to 512".into()),
    }
}

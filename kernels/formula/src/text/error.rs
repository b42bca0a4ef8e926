//! What is wrong with a text, and where.

use std::fmt;

use crate::text::names::{self, FUNCTIONS};

/// Why a text is no kernel. [`Display`](fmt::Display) writes three lines: what is wrong and what was expected, the
/// part of the text around it, and a caret under the character. If parameters are wrong, the first is all.
#[derive(Clone, Debug, PartialEq)]
pub struct TextError {
    text: String,
    position: Option<usize>,
    problem: Problem,
}

impl TextError {
    pub(crate) fn new(text: &str, position: usize, problem: Problem) -> Self {
        Self { text: text.to_owned(), position: Some(position), problem }
    }

    /// What is wrong with the parameters, and at no place of the text.
    pub(crate) fn of_parameters(text: &str, problem: Problem) -> Self {
        Self { text: text.to_owned(), position: None, problem }
    }

    /// What is wrong.
    pub fn problem(&self) -> &Problem {
        &self.problem
    }

    /// The character that is wrong, counted from 0; the number of characters at the end of the text. `None` where the
    /// parameters are wrong, and not the text.
    pub fn position(&self) -> Option<usize> {
        self.position
    }
}

impl std::error::Error for TextError {}

/// Characters that are shown on either side of the one that is wrong.
const SHOWN: usize = 30;

impl fmt::Display for TextError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(position) = self.position else { return write!(f, "{}", self.problem) };
        let start = position.saturating_sub(SHOWN);
        let shown = self.text.chars().skip(start).take(2 * SHOWN);
        // Every character takes one column, so that the caret is under its own.
        let shown: String = shown.map(|c| if c.is_control() { ' ' } else { c }).collect();
        writeln!(f, "{}, at character {}:", self.problem, position + 1)?;
        writeln!(f, "  {}", shown.trim_end())?;
        write!(f, "  {:>1$}", "^", position - start + 1)
    }
}

/// What is wrong with a text.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Problem {
    /// Something else was expected here.
    #[error("expected {expected}, found {found}")]
    Unexpected {
        /// What could stand here.
        expected: &'static str,
        /// What stands here.
        found: String,
    },
    /// A character that no formula has.
    #[error(
        "{found:?} is no part of a formula: expected a number, a name, an operator or a bracket"
    )]
    Character {
        /// The character.
        found: char,
    },
    /// Digits that are no number.
    #[error("{found:?} is no number: expected one such as 2, 0.5 or 1e-3")]
    Number {
        /// The digits.
        found: String,
    },
    /// A name that stands for nothing.
    #[error(
        "the name {name:?} is unknown: expected {}a parameter with a value, \
         or one of r, r2, d1 d2 d3, x1 x2 x3, y1 y2 y3, pi",
        suggestion(.nearest.as_deref())
    )]
    UnknownName {
        /// The name.
        name: String,
        /// The known one that it is most like.
        nearest: Option<String>,
    },
    /// A function that there is not.
    #[error("there is no function {name:?}: expected {}one of {}", suggestion(.nearest.as_deref()), functions())]
    UnknownFunction {
        /// The name.
        name: String,
        /// The known one that it is most like.
        nearest: Option<String>,
    },
    /// A function without its arguments.
    #[error("{name:?} is a function: expected ( after it")]
    FunctionWithoutArguments {
        /// The function.
        name: String,
    },
    /// Something that is no function has arguments.
    #[error("{name:?} is no function: expected an operator before (, such as {name}*(")]
    NoFunction {
        /// The name.
        name: String,
    },
    /// A function with too few or too many arguments.
    #[error("{function} with {found} arguments: expected {expected}")]
    Arguments {
        /// The function.
        function: &'static str,
        /// How many it takes.
        expected: &'static str,
        /// How many there are.
        found: usize,
    },
    /// The imaginary unit.
    #[error(
        "i stands for the imaginary unit, and formulas here are real: expected a real formula, such as \
         cos(k*r)/r for the real part of exp(i*k*r)/r, and another for the imaginary part"
    )]
    Complex,
    /// A comparison that is not the first argument of `where`.
    #[error(
        "a comparison gives no number: expected it as the first argument of where(a < b, yes, no)"
    )]
    Comparison,
    /// `where` without a comparison.
    #[error("expected one of < <= > >= == != after the first side of a comparison, found {found}")]
    NoComparison {
        /// What stands there instead.
        found: String,
    },
    /// Brackets within brackets within brackets.
    #[error("brackets, signs and powers stand {limit} deep in each other: expected fewer")]
    Depth {
        /// How deep they may.
        limit: usize,
    },
    /// A formula that would take too long.
    #[error("the formula takes more than {limit} operations: expected fewer")]
    Length {
        /// How many it may take.
        limit: usize,
    },
    /// A row of a tensor that is not as long as the first.
    #[error("a row of {found} entries: expected {expected}, as in the first row")]
    Row {
        /// The length of the first row.
        expected: usize,
        /// The length of this one.
        found: usize,
    },
    /// A tensor with too many rows or columns.
    #[error("more than {limit} rows or columns: expected fewer")]
    Size {
        /// How many there may be.
        limit: usize,
    },
    /// A part of the formula that is not finite wherever the points are.
    #[error("this is {found} at all points: expected a finite number")]
    NotFinite {
        /// What it is.
        found: f64,
    },
    /// A parameter has a value, and the text does not use it.
    #[error("the parameter {name:?} does not occur in the text: expected {}", only(.used))]
    UnusedParameter {
        /// Its name.
        name: String,
        /// The parameters that do.
        used: Vec<String>,
    },
    /// A name that can't be a parameter's.
    #[error(
        "a parameter can't have the name {name:?}: expected a word of its own, such as k or length"
    )]
    ParameterName {
        /// The name.
        name: String,
    },
    /// Two values for one parameter.
    #[error("the parameter {name:?} has two values: expected one")]
    ParameterTwice {
        /// Its name.
        name: String,
    },
    /// A value that a ready kernel can't have.
    #[error("the parameter {name:?} of {kernel} is {found}: expected {expected}")]
    ParameterDomain {
        /// Its name.
        name: String,
        /// The kernel.
        kernel: &'static str,
        /// Its value.
        found: f64,
        /// What it must be.
        expected: &'static str,
    },
    /// A value that is no number.
    #[error("the parameter {name:?} is {found}: expected a finite number")]
    ParameterValue {
        /// Its name.
        name: String,
        /// Its value.
        found: f64,
    },
}

impl Problem {
    /// An unknown name, with the known one that is most like it.
    pub(crate) fn unknown<'a>(name: &str, known: impl Iterator<Item = &'a str> + 'a) -> Self {
        let nearest = names::nearest(name, names::known().chain(known));
        Self::UnknownName { name: name.to_owned(), nearest }
    }
}

fn suggestion(nearest: Option<&str>) -> String {
    nearest.map_or_else(String::new, |name| format!("{name} perhaps, or "))
}

fn functions() -> String {
    FUNCTIONS.map(|(name, _)| name).join(" ")
}

fn only(used: &[String]) -> String {
    match used {
        [] => "none, for it has no parameters".to_owned(),
        used => format!("only {}", used.join(", ")),
    }
}

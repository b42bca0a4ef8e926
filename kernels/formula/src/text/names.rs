//! The names that a text may use.

use crate::graph::{Binary, Input, Unary};

/// What a name with arguments stands for.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Function {
    /// A function of one number.
    One(Unary),
    /// A function of any number of numbers.
    Many(Binary),
    /// `where(a < b, yes, no)`
    Where,
}

/// All functions by name.
pub(crate) const FUNCTIONS: [(&str, Function); 12] = [
    ("exp", Function::One(Unary::Exp)),
    ("log", Function::One(Unary::Log)),
    ("sqrt", Function::One(Unary::Sqrt)),
    ("sin", Function::One(Unary::Sin)),
    ("cos", Function::One(Unary::Cos)),
    ("tanh", Function::One(Unary::Tanh)),
    ("erf", Function::One(Unary::Erf)),
    ("erfc", Function::One(Unary::Erfc)),
    ("abs", Function::One(Unary::Abs)),
    ("min", Function::Many(Binary::Min)),
    ("max", Function::Many(Binary::Max)),
    ("where", Function::Where),
];

/// What a name without arguments stands for, but for parameters.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Variable {
    /// r = |x − y|
    Distance,
    /// A coordinate, or r².
    Input(Input),
    /// A number.
    Constant(f64),
}

/// All variables and constants by name.
const VARIABLES: [(&str, Variable); 12] = [
    ("r", Variable::Distance),
    ("r2", Variable::Input(Input::SquaredDistance)),
    ("d1", Variable::Input(Input::Difference(0))),
    ("d2", Variable::Input(Input::Difference(1))),
    ("d3", Variable::Input(Input::Difference(2))),
    ("x1", Variable::Input(Input::Target(0))),
    ("x2", Variable::Input(Input::Target(1))),
    ("x3", Variable::Input(Input::Target(2))),
    ("y1", Variable::Input(Input::Source(0))),
    ("y2", Variable::Input(Input::Source(1))),
    ("y3", Variable::Input(Input::Source(2))),
    ("pi", Variable::Constant(std::f64::consts::PI)),
];

/// The imaginary unit.
pub(crate) const IMAGINARY: &str = "i";

/// The function of that name.
pub(crate) fn function(name: &str) -> Option<(&'static str, Function)> {
    FUNCTIONS.into_iter().find(|(known, _)| *known == name)
}

/// The variable or constant of that name.
pub(crate) fn variable(name: &str) -> Option<Variable> {
    VARIABLES.into_iter().find(|(known, _)| *known == name).map(|(_, variable)| variable)
}

/// Whether a parameter may have that name.
pub(crate) fn may_be_parameter(name: &str) -> bool {
    let mut characters = name.chars();
    let starts = characters.next().is_some_and(starts_name);
    let taken = name == IMAGINARY || variable(name).is_some() || function(name).is_some();
    starts && characters.all(continues_name) && !taken
}

/// Whether a name may begin with a character.
pub(crate) fn starts_name(c: char) -> bool {
    c.is_alphabetic() || c == '_'
}

/// Whether a name may go on with a character.
pub(crate) fn continues_name(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// All names but parameters.
pub(crate) fn known<'a>() -> impl Iterator<Item = &'a str> {
    let variables = VARIABLES.iter().map(|(name, _)| *name);
    variables.chain(FUNCTIONS.iter().map(|(name, _)| *name))
}

/// The name that is most like `name`, if one is like it at all: one change for three characters, or the same in
/// small letters.
pub(crate) fn nearest<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> Option<String> {
    let small = name.to_lowercase();
    let small: Vec<char> = small.chars().take(LONGEST).collect();
    let most = (small.len() + 1) / 3;
    let distances = known.map(|known| (changes(&small, known), known));
    let (distance, nearest) = distances.min()?;
    (distance <= most && small.len() < LONGEST).then(|| nearest.to_owned())
}

/// Names as long as this are like none that is known.
const LONGEST: usize = 40;

/// How many characters have to be changed, put in or left out to make one word of the other (Levenshtein's
/// distance). O(n m).
fn changes(word: &[char], other: &str) -> usize {
    let other: Vec<char> = other.to_lowercase().chars().collect();
    let mut row: Vec<usize> = (0..=other.len()).collect();
    for (i, a) in word.iter().enumerate() {
        let mut corner = row[0];
        row[0] = i + 1;
        for (j, b) in other.iter().enumerate() {
            let changed = corner + usize::from(a != b);
            corner = row[j + 1];
            row[j + 1] = changed.min(corner + 1).min(row[j] + 1);
        }
    }
    row[other.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_name_is_one_that_is_like_it() {
        for (name, expected) in [
            ("sqr", Some("sqrt")),
            ("EXP", Some("exp")),
            ("ex", Some("exp")),
            ("tanhh", Some("tanh")),
            ("whre", Some("where")),
            ("gamma", None),
            ("q", None),
        ] {
            assert_eq!(nearest(name, known()).as_deref(), expected, "{name}");
        }
        assert_eq!(nearest("kapa", ["kappa"].into_iter()).as_deref(), Some("kappa"));
        assert_eq!(nearest(&"r".repeat(1000), known()), None);
    }
}

//! The grammar of formulas.
//!
//! ```text
//! text     = sum | [ row , … ]                 a number, or a tensor by its rows
//! row      = [ sum , … ]
//! sum      = product { (+ | −) product }
//! product  = signed { (* | /) signed }
//! signed   = (− | +) signed | power
//! power    = atom [ ^ signed ]                 from right to left: a^b^c = a^(b^c), −a^b = −(a^b)
//! atom     = number | name | name ( argument , … ) | ( sum )
//! argument = sum | sum (< | <= | > | >= | == | !=) sum      a comparison in `where` only
//! ```
//!
//! It is read by recursive descent, one function a line. That is shorter than what a library for expressions would
//! take to be told about tensors, comparisons and carets, and its depth is bounded: no text overflows the stack. What is
//! read goes straight to the [`Graph`], which folds constants and shares what occurs twice.

use crate::graph::{Binary, Comparison, Graph, Id, Unary};
use crate::text::error::{Problem, TextError};
use crate::text::names::{self, Function, Variable};
use crate::text::parameters::Parameters;
use crate::text::tokens::{Token, tokens};

/// How deep brackets, signs and powers may stand in each other.
const DEPTH: usize = 100;
/// How many operations a formula may take.
const LENGTH: usize = 4096;
/// How many rows and columns a tensor may have.
const SIZE: usize = 16;

/// A text that was read.
#[derive(Debug)]
pub(crate) struct Parsed {
    /// The operations.
    pub(crate) graph: Graph,
    /// The entries, row after row.
    pub(crate) entries: Vec<Id>,
    /// How many rows there are.
    pub(crate) rows: usize,
}

/// Reads a text whose parameters have these values. O(n).
pub(crate) fn parse(text: &str, parameters: &[(&str, f64)]) -> Result<Parsed, TextError> {
    let parameters = Parameters::new(text, parameters)?;
    let mut parser = Parser {
        text,
        tokens: tokens(text)?,
        at: 0,
        depth: 0,
        graph: Graph::default(),
        compared: false,
        parameters,
    };
    let (entries, rows) = parser.text()?;
    parser.end()?;
    if let Some(problem) = parser.parameters.unused() {
        return Err(TextError::of_parameters(text, problem));
    }
    Ok(Parsed { graph: parser.graph, entries, rows })
}

/// What the first argument of `where` asks.
#[derive(Clone, Copy)]
struct Asked {
    comparison: Comparison,
    sides: [Id; 2],
    /// Whether the answer is the other one.
    negated: bool,
}

struct Parser<'a> {
    text: &'a str,
    tokens: Vec<(usize, Token)>,
    at: usize,
    depth: usize,
    graph: Graph,
    /// Whether what is read is a side of a comparison.
    compared: bool,
    parameters: Parameters<'a>,
}

type Parse<T> = Result<T, TextError>;

impl Parser<'_> {
    fn text(&mut self) -> Parse<(Vec<Id>, usize)> {
        if !self.take("[") {
            return Ok((vec![self.sum()?], 1));
        }
        let (mut entries, mut rows) = (Vec::new(), 0);
        let mut first = None;
        loop {
            let place = self.place();
            self.expect("[", "[ at the start of a row, as in [[a, b], [c, d]]")?;
            let before = entries.len();
            loop {
                entries.push(self.sum()?);
                if entries.len() - before > SIZE {
                    return Err(self.error_at(place, Problem::Size { limit: SIZE }));
                }
                if !self.take(",") {
                    break;
                }
            }
            self.expect("]", "an operator, a comma, or ] at the end of the row")?;
            let found = entries.len() - before;
            let expected = *first.get_or_insert(found);
            if found != expected {
                return Err(self.error_at(place, Problem::Row { expected, found }));
            }
            rows += 1;
            if rows > SIZE {
                return Err(self.error_at(place, Problem::Size { limit: SIZE }));
            }
            if !self.take(",") {
                break;
            }
        }
        self.expect("]", "a comma and another row, or ] at the end of the tensor")?;
        Ok((entries, rows))
    }

    fn sum(&mut self) -> Parse<Id> {
        let mut left = self.product()?;
        loop {
            let place = self.place();
            let operator = match self.sign() {
                Some("+") => Binary::Add,
                Some("-") => Binary::Subtract,
                _ => return Ok(left),
            };
            self.at += 1;
            let right = self.product()?;
            left = self.binary(place, operator, left, right)?;
        }
    }

    fn product(&mut self) -> Parse<Id> {
        let mut left = self.signed()?;
        loop {
            let place = self.place();
            if self.take("*") {
                let right = self.signed()?;
                left = self.binary(place, Binary::Multiply, left, right)?;
            } else if self.take("/") {
                let right = self.signed()?;
                let quotient = if self.compared {
                    self.graph.binary(Binary::Divide, left, right)
                } else {
                    self.graph.quotient(left, right)
                };
                left = self.checked(place, quotient)?;
            } else {
                return Ok(left);
            }
        }
    }

    fn signed(&mut self) -> Parse<Id> {
        let place = self.place();
        let sign = self.sign().filter(|sign| ["+", "-"].contains(sign));
        if sign.is_none() {
            return self.power();
        }
        self.at += 1;
        let operand = self.deeper(place, Self::signed)?;
        if sign == Some("+") {
            return Ok(operand);
        }
        self.unary(place, Unary::Negate, operand)
    }

    fn power(&mut self) -> Parse<Id> {
        let base = self.atom()?;
        let place = self.place();
        if !self.take("^") {
            return Ok(base);
        }
        let exponent = self.deeper(place, Self::signed)?;
        self.binary(place, Binary::Power, base, exponent)
    }

    fn atom(&mut self) -> Parse<Id> {
        let place = self.place();
        match self.token().clone() {
            Token::Number(x) => {
                self.at += 1;
                Ok(self.graph.constant(x))
            }
            Token::Name(name) => {
                self.at += 1;
                if self.sign() == Some("(") {
                    self.call(place, &name)
                } else {
                    self.variable(place, &name)
                }
            }
            Token::Sign("(") => {
                self.at += 1;
                let inner = self.deeper(place, Self::sum)?;
                self.refuse_comparison()?;
                self.expect(")", "an operator, or ) for the bracket that was opened")?;
                Ok(inner)
            }
            Token::Sign("[") => Err(self.unexpected(
                "a number, a name or ( here; a tensor is a list of rows, as in [[a, b], [c, d]]",
            )),
            _ => Err(self.unexpected("a number, a name or (")),
        }
    }

    fn variable(&mut self, place: usize, name: &str) -> Parse<Id> {
        match names::variable(name) {
            Some(Variable::Distance) => return Ok(self.graph.distance()),
            Some(Variable::Input(input)) => return Ok(self.graph.input(input)),
            Some(Variable::Constant(x)) => return Ok(self.graph.constant(x)),
            None => {}
        }
        if let Some(value) = self.parameters.take(name) {
            return Ok(self.graph.constant(value));
        }
        let problem = if name == names::IMAGINARY {
            Problem::Complex
        } else if names::function(name).is_some() {
            Problem::FunctionWithoutArguments { name: name.to_owned() }
        } else {
            Problem::unknown(name, self.parameters.names())
        };
        Err(self.error_at(place, problem))
    }

    fn call(&mut self, place: usize, name: &str) -> Parse<Id> {
        let Some((function, kind)) = names::function(name) else {
            let given = self.parameters.has(name);
            let problem = if given || names::variable(name).is_some() || name == names::IMAGINARY {
                Problem::NoFunction { name: name.to_owned() }
            } else {
                let known = names::FUNCTIONS.into_iter().map(|(known, _)| known);
                let nearest = names::nearest(name, known);
                Problem::UnknownFunction { name: name.to_owned(), nearest }
            };
            return Err(self.error_at(place, problem));
        };
        self.at += 1;
        let comparison = match kind {
            Function::Where => {
                let outside = std::mem::replace(&mut self.compared, true);
                let asked = self.deeper(place, Self::comparison)?;
                self.compared = outside;
                Some(asked)
            }
            _ => None,
        };
        let mut arguments = Vec::new();
        if comparison.is_none_or(|_| self.take(",")) && self.sign() != Some(")") {
            loop {
                arguments.push(self.deeper(place, Self::sum)?);
                self.refuse_comparison()?;
                if !self.take(",") {
                    break;
                }
            }
        }
        self.expect(")", "an operator, a comma, or ) after the arguments")?;
        let wrong = |expected, found| Problem::Arguments { function, expected, found };
        match (kind, comparison, &arguments[..]) {
            (Function::One(one), _, [x]) => self.unary(place, one, *x),
            (Function::One(_), _, many) => Err(self.error_at(place, wrong("1", many.len()))),
            (Function::Many(operator), _, [first, second, others @ ..]) => {
                let mut found = self.binary(place, operator, *first, *second)?;
                for other in others {
                    found = self.binary(place, operator, found, *other)?;
                }
                Ok(found)
            }
            (Function::Many(_), _, few) => Err(self.error_at(place, wrong("2 or more", few.len()))),
            (Function::Where, Some(asked), [yes, no]) => {
                let (yes, no) = if asked.negated { (*no, *yes) } else { (*yes, *no) };
                let id = self.graph.select(asked.comparison, asked.sides, yes, no);
                self.checked(place, id)
            }
            (Function::Where, _, others) => {
                Err(self.error_at(place, wrong("3, as in where(r < 1, yes, no)", 1 + others.len())))
            }
        }
    }

    fn comparison(&mut self) -> Parse<Asked> {
        let left = self.sum()?;
        let (comparison, swapped, negated) = match self.sign() {
            Some("<") => (Comparison::Less, false, false),
            Some(">") => (Comparison::Less, true, false),
            Some("<=") => (Comparison::LessOrEqual, false, false),
            Some(">=") => (Comparison::LessOrEqual, true, false),
            Some("==") => (Comparison::Equal, false, false),
            Some("!=") => (Comparison::Equal, false, true),
            _ => {
                let found = self.token().describe();
                return Err(self.error_at(self.place(), Problem::NoComparison { found }));
            }
        };
        self.at += 1;
        let right = self.sum()?;
        self.refuse_comparison()?;
        let sides = if swapped { [right, left] } else { [left, right] };
        Ok(Asked { comparison, sides, negated })
    }

    /// Refuses a comparison where a number was read.
    fn refuse_comparison(&self) -> Parse<()> {
        match self.sign() {
            Some("<" | "<=" | ">" | ">=" | "==" | "!=") => {
                Err(self.error_at(self.place(), Problem::Comparison))
            }
            _ => Ok(()),
        }
    }

    fn end(&self) -> Parse<()> {
        self.refuse_comparison()?;
        match self.token() {
            Token::End => Ok(()),
            _ => Err(self.unexpected("an operator, or the end of the text")),
        }
    }

    /// What is read by `part` one level deeper in brackets, signs or powers.
    fn deeper<T>(&mut self, place: usize, part: impl FnOnce(&mut Self) -> Parse<T>) -> Parse<T> {
        if self.depth == DEPTH {
            return Err(self.error_at(place, Problem::Depth { limit: DEPTH }));
        }
        self.depth += 1;
        let found = part(self);
        self.depth -= 1;
        found
    }

    fn unary(&mut self, place: usize, operator: Unary, x: Id) -> Parse<Id> {
        let id = self.graph.unary(operator, x);
        self.checked(place, id)
    }

    fn binary(&mut self, place: usize, operator: Binary, a: Id, b: Id) -> Parse<Id> {
        let id = self.graph.binary(operator, a, b);
        self.checked(place, id)
    }

    /// Refuses what is too long, and constants that are not finite.
    fn checked(&self, place: usize, id: Id) -> Parse<Id> {
        match self.graph.constant_at(id) {
            _ if self.graph.len() > LENGTH => {
                Err(self.error_at(place, Problem::Length { limit: LENGTH }))
            }
            Some(found) if !found.is_finite() => {
                Err(self.error_at(place, Problem::NotFinite { found }))
            }
            _ => Ok(id),
        }
    }

    fn token(&self) -> &Token {
        // The last token is the end, and is never passed.
        self.tokens.get(self.at).map_or(&Token::End, |(_, token)| token)
    }

    fn sign(&self) -> Option<&'static str> {
        match self.token() {
            Token::Sign(sign) => Some(sign),
            _ => None,
        }
    }

    fn place(&self) -> usize {
        self.tokens.get(self.at).map_or(0, |(place, _)| *place)
    }

    /// Passes a sign if it stands here.
    fn take(&mut self, sign: &str) -> bool {
        let stands = self.sign() == Some(sign);
        self.at += usize::from(stands);
        stands
    }

    fn expect(&mut self, sign: &str, expected: &'static str) -> Parse<()> {
        if self.take(sign) {
            return Ok(());
        }
        self.refuse_comparison()?;
        Err(self.unexpected(expected))
    }

    fn unexpected(&self, expected: &'static str) -> TextError {
        let found = self.token().describe();
        self.error_at(self.place(), Problem::Unexpected { expected, found })
    }

    fn error_at(&self, place: usize, problem: Problem) -> TextError {
        TextError::new(self.text, place, problem)
    }
}

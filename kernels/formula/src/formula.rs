//! A formula that was read from a text.

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

use farfield::Real;

use crate::graph::{Graph, Id};
use crate::machine::program::Program;
use crate::text::error::TextError;
use crate::text::parser::parse;

/// A formula that was read from a text, its parameters replaced by their values.
#[derive(Clone)]
pub struct TextFormula {
    text: Arc<str>,
    graph: Arc<Graph>,
    entries: Arc<[Id]>,
    rows: usize,
    coincident: Coincident,
    /// The name of the ready kernel that it is.
    name: Option<&'static str>,
}

/// What a kernel is between points at the same position.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Coincident {
    /// Such pairs contribute nothing: the usual choice for singular formulas.
    #[default]
    Skip,
    /// This number; for a tensor, times the identity. It has no derivatives.
    Value(f64),
    /// What the formula gives there.
    Formula,
}

impl FromStr for Coincident {
    type Err = String;

    /// `skip`, `formula`, or a finite number; what was expected otherwise.
    fn from_str(text: &str) -> Result<Self, String> {
        match (text, text.parse()) {
            ("skip", _) => Ok(Self::Skip),
            ("formula", _) => Ok(Self::Formula),
            (_, Ok(value)) if f64::is_finite(value) => Ok(Self::Value(value)),
            _ => Err("expected skip, formula or a finite number".into()),
        }
    }
}

impl TextFormula {
    /// Reads a text whose parameters have these values: `TextFormula::new("exp(-k*r)/r", &[("k", 2.0)])`. O(n).
    ///
    /// # Errors
    /// [`TextError`], which points at the character, if the text is not a formula, or its parameters are not those
    /// given.
    pub fn new(text: &str, parameters: &[(&str, f64)]) -> Result<Self, TextError> {
        let parsed = parse(text, parameters)?;
        Ok(Self {
            text: text.into(),
            graph: Arc::new(parsed.graph),
            entries: parsed.entries.into(),
            rows: parsed.rows,
            coincident: Coincident::Skip,
            name: None,
        })
    }

    /// The same formula with another rule for points at the same position.
    pub fn coincident(self, coincident: Coincident) -> Self {
        Self { coincident, ..self }
    }

    /// What holds for points at the same position.
    pub fn at_coincident_points(&self) -> Coincident {
        self.coincident
    }

    /// K(y, x)ᵀ: the kernel of the transposed sums, in which sources and targets change places.
    ///
    /// ```
    /// use farfield_formula::TextFormula;
    ///
    /// let dipoles: TextFormula = "[[d1/r^3, d2/r^3, d3/r^3]]".parse()?;
    /// assert_eq!((dipoles.rows(), dipoles.columns()), (1, 3));
    /// let forces = dipoles.transposed();
    /// assert_eq!((forces.rows(), forces.columns()), (3, 1));
    /// # Ok::<(), farfield_formula::TextError>(())
    /// ```
    pub fn transposed(&self) -> Self {
        let (graph, entries) = self.graph.exchanged(&self.entries);
        let columns = self.columns();
        let transposed = (0..columns)
            .flat_map(|column| entries.iter().skip(column).step_by(columns).copied())
            .collect();
        Self { graph: Arc::new(graph), entries: transposed, rows: columns, ..self.clone() }
    }

    /// The same formula, known as the ready kernel of that name.
    pub(crate) fn named(self, name: &'static str) -> Self {
        Self { name: Some(name), ..self }
    }

    /// Whether it was asked for as the ready kernel of that name.
    pub(crate) fn is_ready(&self, name: &str) -> bool {
        self.name == Some(name)
    }

    /// The text.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// How many fields a target receives: the rows of the tensor.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// How many densities a source sends: the columns of the tensor.
    pub fn columns(&self) -> usize {
        self.entries.len() / self.rows.max(1)
    }

    /// What tells its entries from those of all other formulas: all operations, with every bit of their numbers.
    pub(crate) fn identity(&self) -> String {
        let nodes: Vec<_> = self.graph.nodes().collect();
        format!("text {} {:?} {nodes:?}", self.rows, self.entries)
    }

    /// Instructions for the entries.
    pub(crate) fn program<T: Real>(&self) -> Program<T> {
        Program::new(&self.graph, &self.entries)
    }

    /// Instructions for the entries and their derivatives along the three axes.
    pub(crate) fn program_with_gradient<T: Real>(&self) -> Program<T> {
        let mut graph = (*self.graph).clone();
        let gradients = graph.gradients(&self.entries);
        let all: Vec<Id> = self.entries.iter().copied().chain(gradients.concat()).collect();
        Program::new(&graph, &all)
    }

    /// Instructions for the entries, their first and their six second derivatives.
    pub(crate) fn program_with_hessian<T: Real>(&self) -> Program<T> {
        let mut graph = (*self.graph).clone();
        let gradients = graph.gradients(&self.entries);
        let [[xx, xy, xz], [_, yy, yz], [_, _, zz]] =
            [0, 1, 2].map(|axis| graph.gradients(&gradients[axis]));
        let second = [xx, xy, xz, yy, yz, zz].concat();
        let first = self.entries.iter().copied().chain(gradients.concat());
        Program::new(&graph, &first.chain(second).collect::<Vec<_>>())
    }
}

/// A text without parameters.
impl FromStr for TextFormula {
    type Err = TextError;

    fn from_str(text: &str) -> Result<Self, TextError> {
        Self::new(text, &[])
    }
}

impl fmt::Debug for TextFormula {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("TextFormula")
            .field("text", &self.text)
            .field("coincident", &self.coincident)
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identities_are_those_of_the_entries() {
        let identity = |text: &str, k: f64| {
            let parameters: &[(&str, f64)] = if text.contains('k') { &[("k", k)] } else { &[] };
            TextFormula::new(text, parameters).expect("a formula").identity()
        };
        let one = identity("exp(-k*r)/r", 2.0);
        assert_eq!(one, identity("exp( -k * r ) / r", 2.0));
        for (text, k) in [("exp(-k*r)/r", 2.0f64.next_up()), ("exp(-k*r)", 2.0), ("1/r", 2.0)] {
            assert_ne!(one, identity(text, k), "{text}");
        }
        assert_ne!(identity("[[r, r]]", 0.0), identity("[[r], [r]]", 0.0));
    }
}

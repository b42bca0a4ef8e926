//! The same formula with the target and the source exchanged.

use crate::graph::{Graph, Id, Input, Node, Unary};

impl Graph {
    /// A graph in which x stands where y stood, and the same entries in it. O(operations).
    pub(crate) fn exchanged(&self, entries: &[Id]) -> (Self, Vec<Id>) {
        let (mut graph, mut places) = (Self::default(), Vec::with_capacity(self.len()));
        for (_, node) in self.nodes() {
            let at = |id: Id| -> Id { places[id.index()] };
            let place = match node {
                Node::Constant(bits) => graph.constant(f64::from_bits(bits)),
                Node::Input(Input::Difference(axis)) => {
                    let d = graph.input(Input::Difference(axis));
                    graph.unary(Unary::Negate, d)
                }
                Node::Input(Input::Target(axis)) => graph.input(Input::Source(axis)),
                Node::Input(Input::Source(axis)) => graph.input(Input::Target(axis)),
                Node::Input(square) => graph.input(square),
                Node::Unary(function, x) => graph.unary(function, at(x)),
                Node::Binary(operator, a, b) => graph.binary(operator, at(a), at(b)),
                Node::Select(comparison, [a, b, yes, no]) => {
                    graph.select(comparison, [at(a), at(b)], at(yes), at(no))
                }
            };
            places.push(place);
        }
        let entries = entries.iter().map(|entry| places[entry.index()]).collect();
        (graph, entries)
    }
}

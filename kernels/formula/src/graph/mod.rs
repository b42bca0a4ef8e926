//! A formula as a graph of operations, in which nothing is computed twice.

pub(crate) mod derivatives;
mod exchange;
mod simplify;

use std::collections::HashMap;

/// An operation of a [`Graph`]. Those that it takes its numbers from come before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct Id(u32);

impl Id {
    /// Its place in the graph.
    pub(crate) fn index(self) -> usize {
        self.0 as usize
    }
}

/// What a formula is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Input {
    /// d = x − y along an axis.
    Difference(usize),
    /// |d|²
    SquaredDistance,
    /// x along an axis.
    Target(usize),
    /// y along an axis.
    Source(usize),
}

/// A function of one number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Unary {
    Negate,
    Reciprocal,
    Sqrt,
    Exp,
    Log,
    Sin,
    Cos,
    Tanh,
    Erf,
    Erfc,
    Abs,
}

/// A function of two numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Binary {
    Add,
    Subtract,
    Multiply,
    /// Rounded once, as numbers that are compared have to be: 49 · (1/49) is less than 1. Where that makes no difference
    /// there are [products with reciprocals](Graph::quotient).
    Divide,
    Power,
    Min,
    Max,
}

/// Which of two numbers is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Comparison {
    Less,
    LessOrEqual,
    Equal,
}

/// One operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Node {
    /// The bits of a number.
    Constant(u64),
    Input(Input),
    Unary(Unary, Id),
    Binary(Binary, Id, Id),
    /// The third where the comparison of the first two holds, the fourth elsewhere.
    Select(Comparison, [Id; 4]),
}

impl Node {
    /// What it takes its numbers from.
    pub(crate) fn operands(&self) -> impl Iterator<Item = Id> + use<> {
        let operands = match *self {
            Self::Constant(_) | Self::Input(_) => [None; 4],
            Self::Unary(_, a) => [Some(a), None, None, None],
            Self::Binary(_, a, b) => [Some(a), Some(b), None, None],
            Self::Select(_, all) => all.map(Some),
        };
        operands.into_iter().flatten()
    }
}

/// The operations of a formula. Each occurs once: whoever asks for it again gets the first.
#[derive(Clone, Debug, Default)]
pub(crate) struct Graph {
    nodes: Vec<Node>,
    known: HashMap<Node, Id>,
}

impl Graph {
    /// How many operations there are.
    pub(crate) fn len(&self) -> usize {
        self.nodes.len()
    }

    /// The operation at a place.
    pub(crate) fn node(&self, id: Id) -> Node {
        self.nodes[id.index()]
    }

    /// All operations in order.
    pub(crate) fn nodes(&self) -> impl Iterator<Item = (Id, Node)> + '_ {
        self.nodes.iter().enumerate().map(|(i, node)| (Id(i as u32), *node))
    }

    /// The number of a constant.
    pub(crate) fn constant_at(&self, id: Id) -> Option<f64> {
        match self.node(id) {
            Node::Constant(bits) => Some(f64::from_bits(bits)),
            _ => None,
        }
    }

    /// The operations that some others need, they themselves among them.
    pub(crate) fn needed(&self, roots: &[Id]) -> Vec<bool> {
        let mut needed = vec![false; self.nodes.len()];
        roots.iter().for_each(|root| needed[root.index()] = true);
        for (id, node) in self.nodes.iter().enumerate().rev() {
            if needed[id] {
                node.operands().for_each(|operand| needed[operand.index()] = true);
            }
        }
        needed
    }

    pub(crate) fn constant(&mut self, x: f64) -> Id {
        // There is one zero, not two.
        self.add(Node::Constant((x + 0.0).to_bits()))
    }

    pub(crate) fn input(&mut self, input: Input) -> Id {
        self.add(Node::Input(input))
    }

    /// r
    pub(crate) fn distance(&mut self) -> Id {
        let squared = self.input(Input::SquaredDistance);
        self.unary(Unary::Sqrt, squared)
    }

    /// The operation, which is added unless it is there.
    fn add(&mut self, node: Node) -> Id {
        let Self { nodes, known } = self;
        *known.entry(node).or_insert_with(|| {
            nodes.push(node);
            Id(nodes.len() as u32 - 1)
        })
    }
}

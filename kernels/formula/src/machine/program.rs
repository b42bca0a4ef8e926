//! From a graph of operations to instructions on registers.

use farfield::Real;

use crate::graph::{Binary, Comparison, Graph, Id, Input, Node, Unary};

/// Numbers of a register: that of every instruction for this many pairs goes from cache to cache, and what an
/// instruction costs by itself is shared by them.
pub(crate) const LANES: usize = 256;

/// Instructions in order. A register holds a number for each of some pairs.
#[derive(Clone, Debug)]
pub(crate) struct Program<T> {
    /// What the registers at the start hold, once and for all.
    pub(crate) constants: Vec<T>,
    /// The registers of what pairs bring along, if the formula asks for it.
    pub(crate) inputs: Inputs,
    pub(crate) steps: Vec<Step<T>>,
    /// Constants and instructions before their numbers were rounded.
    pub(crate) exact: Exact,
    /// Whether all of their numbers are within the range of the precision.
    pub(crate) fits: bool,
    /// Where the entries are in the end.
    pub(crate) outputs: Vec<usize>,
    /// How many registers there are.
    pub(crate) registers: usize,
}

/// What a program is in double precision.
#[derive(Clone, Debug, Default)]
pub(crate) struct Exact {
    pub(crate) constants: Vec<f64>,
    pub(crate) steps: Vec<Step<f64>>,
}

/// The registers of what a formula is of.
#[derive(Clone, Debug, Default)]
pub(crate) struct Inputs {
    pub(crate) difference: [Option<usize>; 3],
    pub(crate) squared_distance: Option<usize>,
    pub(crate) target: [Option<usize>; 3],
    pub(crate) source: [Option<usize>; 3],
}

/// One instruction. Its output is none of its operands.
#[derive(Clone, Debug)]
pub(crate) struct Step<T> {
    pub(crate) operation: Operation<T>,
    pub(crate) output: usize,
    pub(crate) operands: [usize; 4],
}

/// What an instruction does with its operands.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Operation<T> {
    Unary(Unary),
    Binary(Binary),
    /// a + c
    AddConstant(T),
    /// c − a
    SubtractFrom(T),
    /// a c
    MultiplyConstant(T),
    /// aᶜ
    PowerConstant(T),
    Select(Comparison),
}

impl<T: Real> Step<T> {
    /// The same instruction, its numbers rounded.
    fn rounded(step: &Step<f64>) -> Self {
        let Step { operation, output, operands } = *step;
        Self { operation: operation.map(T::from_f64), output, operands }
    }
}

impl<T: Copy> Operation<T> {
    /// The number that it holds.
    fn number(self) -> Option<T> {
        match self {
            Self::Unary(_) | Self::Binary(_) | Self::Select(_) => None,
            Self::AddConstant(c)
            | Self::SubtractFrom(c)
            | Self::MultiplyConstant(c)
            | Self::PowerConstant(c) => Some(c),
        }
    }

    fn map<V>(self, of: impl Fn(T) -> V) -> Operation<V> {
        match self {
            Self::Unary(function) => Operation::Unary(function),
            Self::Binary(operator) => Operation::Binary(operator),
            Self::Select(comparison) => Operation::Select(comparison),
            Self::AddConstant(c) => Operation::AddConstant(of(c)),
            Self::SubtractFrom(c) => Operation::SubtractFrom(of(c)),
            Self::MultiplyConstant(c) => Operation::MultiplyConstant(of(c)),
            Self::PowerConstant(c) => Operation::PowerConstant(of(c)),
        }
    }
}

impl<T: Real> Program<T> {
    /// The instructions that give some entries. O(operations).
    pub(crate) fn new(graph: &Graph, entries: &[Id]) -> Self {
        let needed = graph.needed(entries);
        let mut compiler = Compiler {
            graph,
            exact: Exact::default(),
            inputs: Inputs::default(),
            registers: 0,
            places: vec![None; graph.len()],
            last_uses: last_uses(graph, &needed, entries),
            free: Vec::new(),
        };
        // Constants come first, so that their registers are those at the start.
        compiler.constants(&needed, entries);
        compiler.inputs(&needed);
        for (id, node) in graph.nodes().filter(|(id, _)| needed[id.index()]) {
            compiler.step(id, node);
        }
        let Compiler { exact, inputs, registers, places, .. } = compiler;
        let numbers = exact.steps.iter().filter_map(|step| step.operation.number());
        let in_range = |&x: &f64| x == 0.0 || T::from_f64(x).is_normal();
        // Operations on constants alone are left where their results are out of range.
        let folded = |node: Node| node.operands().any(|id| graph.constant_at(id).is_none());
        let of_none = |node: Node| node.operands().next().is_none();
        let mut nodes = graph.nodes().filter(|(id, _)| needed[id.index()]).map(|(_, node)| node);
        Self {
            fits: numbers.chain(exact.constants.iter().copied()).all(|x| in_range(&x))
                && nodes.all(|node| of_none(node) || folded(node)),
            constants: exact.constants.iter().map(|&c| T::from_f64(c)).collect(),
            steps: exact.steps.iter().map(Step::rounded).collect(),
            outputs: entries.iter().filter_map(|entry| places[entry.index()]).collect(),
            exact,
            inputs,
            registers,
        }
    }
}

/// The last operation that takes each operation's numbers; `usize::MAX` for entries.
fn last_uses(graph: &Graph, needed: &[bool], entries: &[Id]) -> Vec<usize> {
    let mut last = vec![0; graph.len()];
    for (id, node) in graph.nodes().filter(|(id, _)| needed[id.index()]) {
        node.operands().for_each(|operand| last[operand.index()] = id.index());
    }
    entries.iter().for_each(|entry| last[entry.index()] = usize::MAX);
    last
}

struct Compiler<'a> {
    graph: &'a Graph,
    exact: Exact,
    inputs: Inputs,
    registers: usize,
    /// The register of each operation.
    places: Vec<Option<usize>>,
    last_uses: Vec<usize>,
    /// Registers whose numbers nothing needs any more.
    free: Vec<usize>,
}

impl Compiler<'_> {
    /// Gives registers to the constants that no instruction holds.
    fn constants(&mut self, needed: &[bool], entries: &[Id]) {
        let mut held = vec![false; self.graph.len()];
        entries.iter().for_each(|entry| held[entry.index()] = true);
        for (_, node) in self.graph.nodes().filter(|(id, _)| needed[id.index()]) {
            match self.with_constant(node) {
                Some((_, operand)) => held[operand.index()] = true,
                None => node.operands().for_each(|operand| held[operand.index()] = true),
            }
        }
        for (id, _) in self.graph.nodes().filter(|(id, _)| held[id.index()] && needed[id.index()]) {
            if let Some(x) = self.graph.constant_at(id) {
                self.exact.constants.push(x);
                self.places[id.index()] = Some(self.register());
            }
        }
    }

    /// Gives registers to the inputs, which keep them: they are filled anew for every block. There is always one for
    /// r², which tells where points coincide.
    fn inputs(&mut self, needed: &[bool]) {
        for (id, node) in self.graph.nodes().filter(|(id, _)| needed[id.index()]) {
            if let Node::Input(input) = node {
                let register = Some(self.register());
                self.places[id.index()] = register;
                let inputs = &mut self.inputs;
                match input {
                    Input::Difference(axis) => inputs.difference[axis] = register,
                    Input::SquaredDistance => inputs.squared_distance = register,
                    Input::Target(axis) => inputs.target[axis] = register,
                    Input::Source(axis) => inputs.source[axis] = register,
                }
            }
        }
        if self.inputs.squared_distance.is_none() {
            self.inputs.squared_distance = Some(self.register());
        }
    }

    fn step(&mut self, id: Id, node: Node) {
        let (operation, operands) = match self.with_constant(node) {
            Some((operation, operand)) => (operation, vec![operand]),
            None => {
                let operation = match node {
                    Node::Constant(_) | Node::Input(_) => return,
                    Node::Unary(function, _) => Operation::Unary(function),
                    Node::Binary(operator, ..) => Operation::Binary(operator),
                    Node::Select(comparison, _) => Operation::Select(comparison),
                };
                (operation, node.operands().collect())
            }
        };
        let mut places = [0; 4];
        for (place, operand) in places.iter_mut().zip(&operands) {
            *place = self.places[operand.index()].unwrap_or(0);
        }
        // Before those of the operands are free: an instruction does not write to what it reads.
        let output = self.free.pop().unwrap_or_else(|| self.register());
        self.places[id.index()] = Some(output);
        for operand in operands {
            let is_kept = matches!(self.graph.node(operand), Node::Constant(_) | Node::Input(_));
            if self.last_uses[operand.index()] == id.index() && !is_kept {
                // An operand that occurs twice is given back once.
                self.last_uses[operand.index()] = usize::MAX;
                self.free.extend(self.places[operand.index()]);
            }
        }
        self.exact.steps.push(Step { operation, output, operands: places });
    }

    /// An operation with a constant, which its instruction holds, and the other operand.
    fn with_constant(&self, node: Node) -> Option<(Operation<f64>, Id)> {
        let Node::Binary(operator, a, b) = node else { return None };
        let constant = |id| self.graph.constant_at(id);
        match (operator, constant(a), constant(b)) {
            (Binary::Add, _, Some(c)) => Some((Operation::AddConstant(c), a)),
            (Binary::Multiply, _, Some(c)) => Some((Operation::MultiplyConstant(c), a)),
            (Binary::Power, _, Some(c)) => Some((Operation::PowerConstant(c), a)),
            (Binary::Subtract, Some(c), _) => Some((Operation::SubtractFrom(c), b)),
            _ => None,
        }
    }

    fn register(&mut self) -> usize {
        self.registers += 1;
        self.registers - 1
    }
}

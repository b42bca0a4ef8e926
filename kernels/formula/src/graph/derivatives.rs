//! Derivatives of a graph with respect to the target, as further operations of it.
//!
//! The engine's dual numbers carry derivatives along for one pair after the other. Here they become operations like
//! all others: shared where they are alike, left out where they are zero, and evaluated side by side. What depends
//! on d through r² alone is differentiated once, and not for every axis: ∂/∂x_k = ∂/∂d_k + ∂/∂x_k + 2 d_k ∂/∂r².
//! Both ways follow the same rules, and tests hold them against each other.

use std::f64::consts::FRAC_2_SQRT_PI;

use crate::graph::{Binary, Comparison, Graph, Id, Input, Node, Unary};

impl Graph {
    /// The derivatives of some entries along the three axes of x. O(operations).
    pub(crate) fn gradients(&mut self, entries: &[Id]) -> [Vec<Id>; 3] {
        let by_square = self.partials(entries, Input::SquaredDistance);
        [0, 1, 2].map(|axis| {
            let by_difference = self.partials(entries, Input::Difference(axis));
            let by_target = self.partials(entries, Input::Target(axis));
            let d = self.input(Input::Difference(axis));
            let d = self.double(d);
            let parts = by_square.iter().zip(by_difference).zip(by_target);
            let total = parts.map(|((square, difference), target)| {
                let radial = self.binary(Binary::Multiply, *square, d);
                let direct = self.binary(Binary::Add, difference, target);
                self.binary(Binary::Add, radial, direct)
            });
            total.collect()
        })
    }

    /// The partial derivatives of some entries with respect to an input, all others held fixed.
    fn partials(&mut self, entries: &[Id], input: Input) -> Vec<Id> {
        let needed = self.needed(entries);
        let zero = self.constant(0.0);
        let mut slopes = vec![zero; needed.len()];
        for place in (0..needed.len()).filter(|place| needed[*place]) {
            slopes[place] = self.partial(Id(place as u32), input, &slopes);
        }
        entries.iter().map(|entry| slopes[entry.index()]).collect()
    }

    /// The partial derivative of an operation, from those of what it takes.
    fn partial(&mut self, id: Id, input: Input, slopes: &[Id]) -> Id {
        let zero = self.constant(0.0);
        let slope = |operand: Id| slopes[operand.index()];
        let node = self.node(id);
        if node.operands().all(|operand| slope(operand) == zero) {
            return self.constant(if node == Node::Input(input) { 1.0 } else { 0.0 });
        }
        match node {
            Node::Constant(_) | Node::Input(_) => zero,
            Node::Unary(function, x) => {
                let factor = self.slope_of(function, x, id);
                self.binary(Binary::Multiply, slope(x), factor)
            }
            Node::Binary(operator, a, b) => self.slope_of_two(operator, [a, b], id, slopes),
            Node::Select(comparison, [a, b, yes, no]) => {
                self.select(comparison, [a, b], slope(yes), slope(no))
            }
        }
    }

    /// f'(x) of a function whose value at x is `value`.
    fn slope_of(&mut self, function: Unary, x: Id, value: Id) -> Id {
        match function {
            Unary::Negate => self.constant(-1.0),
            Unary::Reciprocal => {
                let square = self.binary(Binary::Multiply, value, value);
                self.unary(Unary::Negate, square)
            }
            Unary::Sqrt => {
                let inverse = self.unary(Unary::Reciprocal, value);
                let half = self.constant(0.5);
                self.binary(Binary::Multiply, inverse, half)
            }
            Unary::Exp => value,
            Unary::Log => self.unary(Unary::Reciprocal, x),
            Unary::Sin => self.unary(Unary::Cos, x),
            Unary::Cos => {
                let sine = self.unary(Unary::Sin, x);
                self.unary(Unary::Negate, sine)
            }
            Unary::Tanh => {
                let square = self.binary(Binary::Multiply, value, value);
                let one = self.constant(1.0);
                self.binary(Binary::Subtract, one, square)
            }
            Unary::Erf => self.bell(x, FRAC_2_SQRT_PI),
            Unary::Erfc => self.bell(x, -FRAC_2_SQRT_PI),
            Unary::Abs => {
                let [zero, one, minus_one] = [0.0, 1.0, -1.0].map(|c| self.constant(c));
                self.select(Comparison::Less, [x, zero], minus_one, one)
            }
        }
    }

    /// c exp(−x²)
    fn bell(&mut self, x: Id, c: f64) -> Id {
        let square = self.binary(Binary::Multiply, x, x);
        let minus = self.unary(Unary::Negate, square);
        let bell = self.unary(Unary::Exp, minus);
        let c = self.constant(c);
        self.binary(Binary::Multiply, bell, c)
    }

    fn slope_of_two(&mut self, operator: Binary, [a, b]: [Id; 2], value: Id, slopes: &[Id]) -> Id {
        let [da, db] = [a, b].map(|operand| slopes[operand.index()]);
        match operator {
            Binary::Add | Binary::Subtract => self.binary(operator, da, db),
            Binary::Multiply if a == b => {
                let product = self.binary(Binary::Multiply, a, da);
                self.double(product)
            }
            Binary::Multiply => {
                let left = self.binary(Binary::Multiply, da, b);
                let right = self.binary(Binary::Multiply, a, db);
                self.binary(Binary::Add, left, right)
            }
            Binary::Divide => {
                // (a/b)' = (a' − (a/b) b') / b
                let product = self.binary(Binary::Multiply, value, db);
                let difference = self.binary(Binary::Subtract, da, product);
                self.quotient(difference, b)
            }
            Binary::Power => self.slope_of_power([a, b], [da, db], value),
            Binary::Min => self.select(Comparison::Less, [b, a], db, da),
            Binary::Max => self.select(Comparison::Less, [a, b], db, da),
        }
    }

    /// (aᵇ)' = b aᵇ⁻¹ a' + aᵇ ln a b'
    fn slope_of_power(&mut self, [a, b]: [Id; 2], [da, db]: [Id; 2], value: Id) -> Id {
        let one = self.constant(1.0);
        let less = self.binary(Binary::Subtract, b, one);
        let power = self.binary(Binary::Power, a, less);
        let power = self.binary(Binary::Multiply, power, b);
        let by_base = self.binary(Binary::Multiply, da, power);
        if self.constant_at(db) == Some(0.0) {
            return by_base;
        }
        let log = self.unary(Unary::Log, a);
        let log = self.binary(Binary::Multiply, log, value);
        let by_exponent = self.binary(Binary::Multiply, db, log);
        self.binary(Binary::Add, by_base, by_exponent)
    }

    fn double(&mut self, x: Id) -> Id {
        let two = self.constant(2.0);
        self.binary(Binary::Multiply, x, two)
    }
}

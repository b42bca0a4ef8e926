//! Operations that are added in their simplest form: constants folded, powers as products and roots.

use farfield::math;

use crate::graph::{Binary, Comparison, Graph, Id, Input, Node, Unary};

/// The largest power that is taken by products.
const LARGEST_POWER: f64 = 32.0;

impl Graph {
    /// A function of a number.
    pub(crate) fn unary(&mut self, operator: Unary, x: Id) -> Id {
        if let Some(number) = self.constant_at(x) {
            let result = evaluate_unary(operator, number);
            let may_leave = matches!(operator, Unary::Exp | Unary::Reciprocal);
            if may_leave && has_left_the_range(number, number, result) {
                return self.add(Node::Unary(operator, x));
            }
            return self.constant(result);
        }
        match (operator, self.node(x)) {
            (Unary::Negate, Node::Unary(Unary::Negate, inner)) => inner,
            (Unary::Negate, Node::Binary(Binary::Subtract, a, b)) => {
                self.binary(Binary::Subtract, b, a)
            }
            (Unary::Negate, Node::Binary(Binary::Multiply, a, c))
                if self.constant_at(c).is_some() =>
            {
                let c = self.unary(Unary::Negate, c);
                self.binary(Binary::Multiply, a, c)
            }
            (Unary::Abs, Node::Unary(Unary::Negate, inner)) => self.unary(Unary::Abs, inner),
            _ => self.add(Node::Unary(operator, x)),
        }
    }

    /// A function of two numbers.
    pub(crate) fn binary(&mut self, operator: Binary, a: Id, b: Id) -> Id {
        let constants = [self.constant_at(a), self.constant_at(b)];
        if let [Some(first), Some(second)] = constants {
            let result = evaluate_binary(operator, first, second);
            let may_leave = matches!(operator, Binary::Multiply | Binary::Divide | Binary::Power);
            if may_leave && has_left_the_range(first, second, result) {
                return self.add(Node::Binary(operator, a, b));
            }
            return self.constant(result);
        }
        match operator {
            Binary::Add => self.sum(a, b),
            Binary::Subtract => self.difference(a, b),
            Binary::Multiply => self.product(a, b),
            Binary::Divide => self.add(Node::Binary(operator, a, b)),
            Binary::Power => match constants[1] {
                Some(exponent) => self.power(a, exponent, b),
                None => self.add(Node::Binary(operator, a, b)),
            },
            Binary::Min | Binary::Max if a == b => a,
            Binary::Min | Binary::Max => self.add(Node::Binary(operator, a, b)),
        }
    }

    /// a / b, as the product with a reciprocal, of which there is one for all quotients.
    pub(crate) fn quotient(&mut self, a: Id, b: Id) -> Id {
        if let [Some(a), Some(b)] = [a, b].map(|id| self.constant_at(id)) {
            let result = a / b;
            if !has_left_the_range(a, b, result) {
                return self.constant(result);
            }
        }
        let inverse = self.unary(Unary::Reciprocal, b);
        self.product(a, inverse)
    }

    /// `yes` where a comparison holds, `no` elsewhere.
    pub(crate) fn select(&mut self, comparison: Comparison, sides: [Id; 2], yes: Id, no: Id) -> Id {
        let [a, b] = sides;
        if yes == no {
            return yes;
        }
        if let [Some(a), Some(b)] = sides.map(|side| self.constant_at(side)) {
            let holds = match comparison {
                Comparison::Less => a < b,
                Comparison::LessOrEqual => a <= b,
                Comparison::Equal => a == b,
            };
            return if holds { yes } else { no };
        }
        self.add(Node::Select(comparison, [a, b, yes, no]))
    }

    fn sum(&mut self, a: Id, b: Id) -> Id {
        // A constant comes last, and of two others the one that was there first.
        let (a, b) = if self.constant_at(a).is_some() { (b, a) } else { (a, b) };
        if self.constant_at(b) == Some(0.0) {
            return a;
        }
        match (self.node(a), self.node(b)) {
            (_, Node::Unary(Unary::Negate, b)) => self.difference(a, b),
            (Node::Unary(Unary::Negate, a), _) => self.difference(b, a),
            (_, Node::Constant(_)) => self.add(Node::Binary(Binary::Add, a, b)),
            _ if a == b => {
                let two = self.constant(2.0);
                self.product(a, two)
            }
            _ => self.add(Node::Binary(Binary::Add, a.min(b), a.max(b))),
        }
    }

    fn difference(&mut self, a: Id, b: Id) -> Id {
        if a == b {
            return self.constant(0.0);
        }
        if self.constant_at(a) == Some(0.0) {
            return self.unary(Unary::Negate, b);
        }
        if let Some(b) = self.constant_at(b) {
            let b = self.constant(-b);
            return self.sum(a, b);
        }
        match self.node(b) {
            Node::Unary(Unary::Negate, b) => self.sum(a, b),
            _ => self.add(Node::Binary(Binary::Subtract, a, b)),
        }
    }

    fn product(&mut self, a: Id, b: Id) -> Id {
        let (a, b) = if self.constant_at(a).is_some() { (b, a) } else { (a, b) };
        match self.constant_at(b) {
            Some(0.0) => return b,
            Some(1.0) => return a,
            Some(-1.0) => return self.unary(Unary::Negate, a),
            Some(second) => {
                return match self.node(a) {
                    Node::Unary(Unary::Negate, a) => {
                        let b = self.constant(-second);
                        self.product(a, b)
                    }
                    Node::Binary(Binary::Multiply, a, c) if self.constant_at(c).is_some() => {
                        let both = self.binary(Binary::Multiply, b, c);
                        if self.constant_at(both).is_some() {
                            self.product(a, both)
                        } else {
                            self.add(Node::Binary(Binary::Multiply, a.min(both), a.max(both)))
                        }
                    }
                    _ => self.add(Node::Binary(Binary::Multiply, a, b)),
                };
            }
            None => {}
        }
        match (self.node(a), self.node(b)) {
            // r² needs no root, and has derivatives at r = 0.
            (Node::Unary(Unary::Sqrt, x), _) if a == b && self.is_squared_distance(x) => x,
            (Node::Unary(Unary::Negate, x), _) => {
                let product = self.product(x, b);
                self.unary(Unary::Negate, product)
            }
            (_, Node::Unary(Unary::Negate, x)) => {
                let product = self.product(a, x);
                self.unary(Unary::Negate, product)
            }
            // A constant factor goes to the end, where it meets others.
            (Node::Binary(Binary::Multiply, x, c), _) if self.constant_at(c).is_some() => {
                let product = self.product(x, b);
                self.product(product, c)
            }
            (_, Node::Binary(Binary::Multiply, x, c)) if self.constant_at(c).is_some() => {
                let product = self.product(a, x);
                self.product(product, c)
            }
            _ => self.add(Node::Binary(Binary::Multiply, a.min(b), a.max(b))),
        }
    }

    /// A power with a constant exponent: products, a root and a reciprocal, where it is a half of a whole number.
    fn power(&mut self, base: Id, exponent: f64, exponent_id: Id) -> Id {
        let halves = 2.0 * exponent;
        if halves.fract() != 0.0 || exponent.abs() > LARGEST_POWER {
            return self.add(Node::Binary(Binary::Power, base, exponent_id));
        }
        if exponent == 0.0 {
            return self.constant(1.0);
        }
        if exponent < 0.0 {
            let power = self.power(base, -exponent, exponent_id);
            return self.unary(Unary::Reciprocal, power);
        }
        let halves = halves as u32;
        match self.node(base) {
            // Powers of r are powers of r².
            Node::Unary(Unary::Sqrt, x)
                if self.is_squared_distance(x) && halves.is_multiple_of(2) =>
            {
                self.half_power(x, halves / 2)
            }
            _ => self.half_power(base, halves),
        }
    }

    /// x to so many halves.
    fn half_power(&mut self, x: Id, halves: u32) -> Id {
        let whole = self.whole_power(x, halves / 2);
        if halves.is_multiple_of(2) {
            return whole;
        }
        let root = self.unary(Unary::Sqrt, x);
        self.product(whole, root)
    }

    /// xⁿ by squaring. O(log n).
    fn whole_power(&mut self, x: Id, n: u32) -> Id {
        match n {
            0 => self.constant(1.0),
            1 => x,
            _ => {
                let half = self.whole_power(x, n / 2);
                let square = self.product(half, half);
                if n.is_multiple_of(2) { square } else { self.product(square, x) }
            }
        }
    }

    fn is_squared_distance(&self, x: Id) -> bool {
        self.node(x) == Node::Input(Input::SquaredDistance)
    }
}

/// Whether the result of an operation is 0, infinite or short of digits, and its operands are not.
fn has_left_the_range(a: f64, b: f64, result: f64) -> bool {
    a.is_normal() && b.is_normal() && !result.is_normal()
}

fn evaluate_unary(operator: Unary, x: f64) -> f64 {
    match operator {
        Unary::Negate => -x,
        Unary::Reciprocal => 1.0 / x,
        Unary::Sqrt => x.sqrt(),
        Unary::Exp => math::exp(x),
        Unary::Log => math::ln(x),
        Unary::Sin => math::sin(x),
        Unary::Cos => math::cos(x),
        Unary::Tanh => math::tanh(x),
        Unary::Erf => math::erf(x),
        Unary::Erfc => math::erfc(x),
        Unary::Abs => x.abs(),
    }
}

fn evaluate_binary(operator: Binary, a: f64, b: f64) -> f64 {
    match operator {
        Binary::Add => a + b,
        Binary::Subtract => a - b,
        Binary::Multiply => a * b,
        Binary::Divide => a / b,
        Binary::Power => a.powf(b),
        Binary::Min => a.min(b),
        Binary::Max => a.max(b),
    }
}

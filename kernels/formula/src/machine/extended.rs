//! Programs in numbers whose exponents don't end, where plain ones overflow or vanish on the way.

use farfield::{Extended, Number, OrdinaryDistances, Real};

use crate::graph::{Binary, Comparison, Unary};
use crate::machine::program::{LANES, Operation, Program, Step};

/// Sees to pairs so far apart, or so near each other, that a program goes wrong in plain numbers.
pub(crate) struct Outermost<'a, T> {
    program: &'a Program<T>,
    ordinary: OrdinaryDistances<T>,
}

/// A target and a source.
type Pair<T> = ([T; 3], [T; 3]);

impl<'a, T: Real> Outermost<'a, T> {
    pub(crate) fn new(program: &'a Program<T>) -> Self {
        let ordinary =
            if program.fits { OrdinaryDistances::new() } else { OrdinaryDistances::none() };
        Self { program, ordinary }
    }

    /// Whether plain numbers are known to serve between the least and the greatest r².
    #[inline(always)]
    pub(crate) fn serve(&self, [least, greatest]: [T; 2]) -> bool {
        self.ordinary.hold(least, greatest)
    }

    /// Looks at some pairs whose entries are in the registers, and puts them right where they are wrong.
    #[inline(never)]
    pub(crate) fn see(
        &mut self,
        registers: &mut [T],
        count: usize,
        pair: &dyn Fn(usize) -> Pair<T>,
    ) {
        let distance = |index| {
            let (x, y): Pair<T> = pair(index);
            OrdinaryDistances::between(x, y)
        };
        let apart = || (0..count).map(|index| (index, distance(index))).filter(|(_, r)| *r > 0.0);
        let by_distance = |a: &(usize, f64), b: &(usize, f64)| a.1.total_cmp(&b.1);
        let ends = (apart().min_by(by_distance), apart().max_by(by_distance));
        let (Some(nearest), Some(farthest)) = ends else { return };
        let squared = self.program.inputs.squared_distance.unwrap_or(0) * LANES;
        let [least, greatest] = [nearest.0, farthest.0].map(|index| registers[squared + index]);
        if self.ordinary.hold(least, greatest) {
            return;
        }
        let mut extended = registers_for(self.program);
        let mut agrees = |index| {
            run(self.program, &mut extended, pair(index));
            self.program.outputs.iter().all(|&output| {
                OrdinaryDistances::agree(registers[output * LANES + index], extended[output])
            })
        };
        if agrees(nearest.0) && agrees(farthest.0) {
            self.ordinary.widen(least, greatest);
            return;
        }
        for (index, _) in apart() {
            run(self.program, &mut extended, pair(index));
            for &output in &self.program.outputs {
                registers[output * LANES + index] = extended[output].rounded();
            }
        }
    }
}

/// All entries of a pair, before they are rounded.
pub(crate) fn entries<T: Real>(program: &Program<T>, pair: Pair<T>) -> Vec<Extended<T>> {
    let mut registers = registers_for(program);
    run(program, &mut registers, pair);
    program.outputs.iter().map(|&output| registers[output]).collect()
}

/// Registers for one pair, constants filled in.
fn registers_for<T: Real>(program: &Program<T>) -> Vec<Extended<T>> {
    let constants = program.exact.constants.iter().map(|&c| Extended::constant(c));
    let rest = std::iter::repeat(Extended::constant(0.0));
    constants.chain(rest).take(program.registers).collect()
}

fn run<T: Real>(program: &Program<T>, registers: &mut [Extended<T>], (x, y): Pair<T>) {
    let (x, y) = (x.map(Extended::new), y.map(Extended::new));
    let d = [0, 1, 2].map(|axis| x[axis] - y[axis]);
    let inputs = &program.inputs;
    for axis in 0..3 {
        let all = [(inputs.difference, d), (inputs.target, x), (inputs.source, y)];
        for (register, numbers) in all {
            if let Some(register) = register[axis] {
                registers[register] = numbers[axis];
            }
        }
    }
    if let Some(register) = inputs.squared_distance {
        registers[register] = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    }
    for Step { operation, output, operands } in &program.exact.steps {
        registers[*output] = result(operation, operands.map(|operand| registers[operand]));
    }
}

fn result<T: Real>(operation: &Operation<f64>, [a, b, yes, no]: [Extended<T>; 4]) -> Extended<T> {
    let is_nan = |x: Extended<T>| x.to_f64().is_nan();
    let is_less_or_equal = || !b.less_than(a) && !is_nan(a) && !is_nan(b);
    match *operation {
        Operation::Unary(Unary::Negate) => -a,
        Operation::Unary(Unary::Reciprocal) => a.recip(),
        Operation::Unary(Unary::Sqrt) => a.sqrt(),
        Operation::Unary(Unary::Exp) => a.exp(),
        Operation::Unary(Unary::Log) => a.ln(),
        Operation::Unary(Unary::Sin) => a.sin(),
        Operation::Unary(Unary::Cos) => a.cos(),
        Operation::Unary(Unary::Tanh) => a.tanh(),
        Operation::Unary(Unary::Erf) => a.erf(),
        Operation::Unary(Unary::Erfc) => a.erfc(),
        Operation::Unary(Unary::Abs) => a.abs(),
        Operation::Binary(Binary::Add) => a + b,
        Operation::Binary(Binary::Subtract) => a - b,
        Operation::Binary(Binary::Multiply) => a * b,
        Operation::Binary(Binary::Divide) => a / b,
        Operation::Binary(Binary::Power) => a.powf(b.to_f64()),
        Operation::Binary(Binary::Min) => {
            if b.less_than(a) || is_nan(b) {
                b
            } else {
                a
            }
        }
        Operation::Binary(Binary::Max) => {
            if a.less_than(b) || is_nan(b) {
                b
            } else {
                a
            }
        }
        Operation::AddConstant(c) => a + c,
        Operation::SubtractFrom(c) => Extended::constant(c) - a,
        Operation::MultiplyConstant(c) => a * c,
        Operation::PowerConstant(c) => a.powf(c),
        Operation::Select(Comparison::Less) => {
            if a.less_than(b) {
                yes
            } else {
                no
            }
        }
        Operation::Select(Comparison::LessOrEqual) => {
            if is_less_or_equal() {
                yes
            } else {
                no
            }
        }
        Operation::Select(Comparison::Equal) => {
            if is_less_or_equal() && !a.less_than(b) {
                yes
            } else {
                no
            }
        }
    }
}

//! Instructions, each in a loop that compilers turn into wide registers.

use farfield::{Real, math};

use crate::graph::{Binary, Comparison, Unary};
use crate::machine::program::{LANES, Operation, Program, Step};

/// Registers of a program for [`LANES`] pairs, constants filled in.
pub(crate) fn registers<T: Real>(program: &Program<T>) -> Vec<T> {
    let mut registers = vec![T::from_f64(0.0); LANES * program.registers];
    fill_constants(program, &mut registers);
    registers
}

/// Writes the constants to their registers.
pub(crate) fn fill_constants<T: Real>(program: &Program<T>, registers: &mut [T]) {
    for (register, &c) in registers.chunks_exact_mut(LANES).zip(&program.constants) {
        register.fill(c);
    }
}

/// Runs all instructions for the first `count` pairs of the registers. Call it where it is compiled for wide
/// registers.
#[inline(always)]
pub(crate) fn run<T: Real>(program: &Program<T>, registers: &mut [T], count: usize) {
    for step in &program.steps {
        run_step(step, registers, count);
    }
}

#[inline(always)]
fn run_step<T: Real>(step: &Step<T>, registers: &mut [T], count: usize) {
    let Step { operation, output, operands } = step;
    let (below, rest) = registers.split_at_mut(output * LANES);
    let (to, above) = rest.split_at_mut(LANES);
    let register = |index: usize| {
        let (part, at) =
            if index < *output { (&*below, index) } else { (&*above, index - output - 1) };
        &part[at * LANES..][..count]
    };
    let to = &mut to[..count];
    let a = register(operands[0]);
    // Loops, and no closures: whatever is not inlined is not compiled for wide registers.
    macro_rules! one {
        (|$x:ident| $result:expr) => {
            for (to, &$x) in to.iter_mut().zip(a) {
                *to = $result;
            }
        };
    }
    macro_rules! two {
        (|$x:ident, $y:ident| $result:expr) => {{
            let b = register(operands[1]);
            for ((to, &$x), &$y) in to.iter_mut().zip(a).zip(b) {
                *to = $result;
            }
        }};
    }
    macro_rules! select {
        (|$x:ident, $y:ident| $holds:expr) => {{
            let [b, yes, no] =
                [register(operands[1]), register(operands[2]), register(operands[3])];
            for ((((to, &$x), &$y), &yes), &no) in to.iter_mut().zip(a).zip(b).zip(yes).zip(no) {
                *to = if $holds { yes } else { no };
            }
        }};
    }
    match *operation {
        Operation::Unary(Unary::Negate) => one!(|x| -x),
        Operation::Unary(Unary::Reciprocal) => one!(|x| T::from_f64(1.0) / x),
        Operation::Unary(Unary::Sqrt) => one!(|x| x.sqrt()),
        Operation::Unary(Unary::Exp) => one!(|x| math::exp(x)),
        Operation::Unary(Unary::Log) => one!(|x| math::ln(x)),
        // Angles that are not too large, as nearly always, are worked on side by side.
        Operation::Unary(Unary::Sin) if are_near(a) => one!(|x| x.near_sine()),
        Operation::Unary(Unary::Cos) if are_near(a) => one!(|x| x.near_cosine()),
        Operation::Unary(Unary::Sin) => one!(|x| x.sin()),
        Operation::Unary(Unary::Cos) => one!(|x| x.cos()),
        Operation::Unary(Unary::Tanh) => one!(|x| math::tanh(x)),
        Operation::Unary(Unary::Erf) => one!(|x| math::erf(x)),
        Operation::Unary(Unary::Erfc) => one!(|x| math::erfc(x)),
        Operation::Unary(Unary::Abs) => one!(|x| x.abs()),
        Operation::Binary(Binary::Add) => two!(|x, y| x + y),
        Operation::Binary(Binary::Subtract) => two!(|x, y| x - y),
        Operation::Binary(Binary::Multiply) => two!(|x, y| x * y),
        Operation::Binary(Binary::Divide) => two!(|x, y| x / y),
        Operation::Binary(Binary::Power) => two!(|x, y| math::powf(x, y)),
        // One that is no number passes on, whichever side it is on.
        Operation::Binary(Binary::Min) => two!(|x, y| if y < x || y.is_nan() { y } else { x }),
        Operation::Binary(Binary::Max) => two!(|x, y| if x < y || y.is_nan() { y } else { x }),
        Operation::AddConstant(c) => one!(|x| x + c),
        Operation::SubtractFrom(c) => one!(|x| c - x),
        Operation::MultiplyConstant(c) => one!(|x| x * c),
        Operation::PowerConstant(c) => one!(|x| math::powf(x, c)),
        Operation::Select(Comparison::Less) => select!(|x, y| x < y),
        Operation::Select(Comparison::LessOrEqual) => select!(|x, y| x <= y),
        Operation::Select(Comparison::Equal) => select!(|x, y| x == y),
    }
}

/// Whether all angles are small enough for the functions that have no branch.
#[inline(always)]
fn are_near<T: Real>(angles: &[T]) -> bool {
    let mut near = true;
    for angle in angles {
        near &= angle.is_near();
    }
    near
}

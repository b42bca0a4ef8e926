//! What a pair takes, counted.

use farfield::{DispatchLevel, Real};

use crate::graph::{Binary, Unary};
use crate::machine::program::{Operation, Program};

/// Seconds of one core for one simple operation with a register.
const REGISTER_SECONDS: f64 = 2e-10;
/// Seconds for a quotient or a square root of one number in double precision. Registers of any width take as long.
const SLOW_SECONDS: f64 = 7e-10;
/// Simple operations of every pair beside its instructions: differences, squares, and where they go.
const OTHER_OPERATIONS: f64 = 10.0;

/// About how many seconds one core takes for a pair.
pub(crate) fn pair_seconds<T: Real>(program: &Program<T>, columns: usize) -> f64 {
    let products = (2 * program.outputs.len() * columns) as f64;
    let (mut simple, mut slow) = (OTHER_OPERATIONS + products, 0.0);
    for step in &program.steps {
        let [more, quotients] = operations(&step.operation);
        simple += more + 1.0;
        slow += quotients;
    }
    let bytes = match DispatchLevel::in_force() {
        Ok(DispatchLevel::Avx512) => 64,
        Ok(DispatchLevel::Avx2) => 32,
        _ => 16,
    };
    let single = size_of::<T>() == size_of::<f32>();
    let slow_seconds = if single { SLOW_SECONDS / 2.0 } else { SLOW_SECONDS };
    simple * REGISTER_SECONDS / (bytes / size_of::<T>()) as f64 + slow * slow_seconds
}

/// Simple operations of an instruction, and quotients and roots.
fn operations<T>(operation: &Operation<T>) -> [f64; 2] {
    match operation {
        Operation::Unary(Unary::Reciprocal | Unary::Sqrt) => [0.0, 1.0],
        Operation::Binary(Binary::Divide) => [0.0, 1.0],
        Operation::Unary(Unary::Exp) => [30.0, 0.0],
        Operation::Unary(Unary::Log) => [40.0, 1.0],
        Operation::Unary(Unary::Sin | Unary::Cos) => [40.0, 0.0],
        Operation::Unary(Unary::Tanh) => [50.0, 1.0],
        Operation::Unary(Unary::Erf) => [80.0, 1.0],
        Operation::Unary(Unary::Erfc) => [100.0, 1.0],
        Operation::Binary(Binary::Power) | Operation::PowerConstant(_) => [100.0, 1.0],
        _ => [1.0, 0.0],
    }
}

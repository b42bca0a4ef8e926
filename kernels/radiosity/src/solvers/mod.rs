//! Solvers of the radiosity equation B = E + ρ H(B).

mod solution;
mod residual;
mod floor;
mod watch;
mod jacobi;
mod southwell;
mod reflected;
mod conjugate_gradients;
mod bicgstab;
mod energy;
#[cfg(test)]
mod tests;

pub use bicgstab::bicgstab;
pub use conjugate_gradients::conjugate_gradients;
pub use energy::{EnergyBalance, energy_balance};
pub use jacobi::jacobi;
pub use solution::{Solution, Stop};
pub use southwell::southwell;
pub use watch::Report;

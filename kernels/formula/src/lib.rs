//! Kernels from text for `farfield`.
//!
//! ```
//! use farfield::{Fmm, direct, relative_l2_error};
//! use farfield_formula::TextFormula;
//!
//! let points: Vec<[f64; 3]> = (0..2000).map(f64::from).map(|i| [i.sin(), (1.3 * i).cos(), (0.7 * i).sin()]).collect();
//! let charges = vec![1.0; points.len()];
//!
//! let formula = TextFormula::new("exp(-k*r)/r", &[("k", 2.0)])?;
//! let fmm = Fmm::builder(formula.kernel()).tolerance(1e-6).build(&points, &points)?;
//! let potentials: Vec<f64> = fmm.apply(&charges)?;
//!
//! let exact = direct(&formula.kernel(), &points, &charges, &points)?;
//! assert!(relative_l2_error(&potentials, &exact) < 1e-6);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # What a text may say
//!
//! | | |
//! |---|---|
//! | variables | `r` = \|x − y\|, `r2` = r², `d1 d2 d3` = x − y, the target `x1 x2 x3`, the source `y1 y2 y3` |
//! | numbers | `2`, `0.5`, `1e-3`, `pi`; any other name is a parameter and needs a value |
//! | operators | `+ - * /` and `^` (or `**`), from right to left and before a sign: `-r^2` is −(r²), `2^-3^2` is 2^(−(3²)) |
//! | functions | `exp log sqrt sin cos tanh erf erfc abs`, `min` and `max` of two or more |
//! | choices | `where(r < 1, a, b)`, with `< <= > >= == !=` |
//! | tensors | a list of rows, `[[a, b], [c, d]]`: as many fields as rows, as many densities as columns |
//!
//! Formulas are real. Where a source and a target are at one place, the pair is skipped, unless
//! [`coincident`](TextFormula::coincident) says otherwise: say `Coincident::Formula` for one that is finite there and
//! shall count, such as a Gaussian.
//!
//! A text that speaks of `x1` or `y1` and their like depends on positions. All others depend on x − y alone. The engine
//! finds out for itself.
//!
//! # Ready kernels, and arrays
//!
//! [`READY`] has kernels by name, and [`Ready::or_text`] takes a name or a text. A [`Plan`] sums whatever they give, from
//! plain arrays to plain arrays: for programs that don't know the kernel when they are compiled. A text is never taken
//! for a ready kernel that it happens to be.
//!
//! # How it is evaluated
//!
//! Constants are folded, what occurs twice is computed once, small powers are products and roots, and quotients are
//! products with a shared reciprocal. What is left is a list of instructions, each of which goes through a block of
//! some hundred pairs with the engine's functions ([`farfield::math`]) before the next one does. Derivatives are
//! further instructions.

mod coincidence;
mod columns;
mod formula;
mod graph;
mod kernel;
mod machine;
mod plan;
mod precision;
mod ready;
mod text;

pub use formula::{Coincident, TextFormula};
pub use kernel::TextKernel;
pub use plan::{Derivatives, Options, Plan, direct_sums};
pub use precision::Precision;
pub use ready::{KernelError, Parameter, READY, Ready};
pub use text::error::{Problem, TextError};

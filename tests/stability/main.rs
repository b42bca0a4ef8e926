//! Where sums like these go wrong: each test shows what happens to a method without a defence, and that
//! this one holds, or refuses by name.
//!
//! Every test prints its row of STABILITY.md:
//!
//! ```sh
//! cargo test --test stability -- --nocapture | grep '^|' | sort
//! ```

mod bit_patterns;
mod cancellation;
mod coincident;
mod expansions;
mod geometry;
mod interpolation;
mod kernels;
mod properties;
mod radiosity;
mod repeatability;
mod scales;
mod table;

use farfield::{Error, Fmm, FnKernel, Interpolation, direct, from_fn, relative_l2_error};
use glam::DVec3;

/// A kernel given by its formula. A function pointer, so that all of them are compiled once.
type Formula = fn(DVec3, DVec3) -> f64;
type Plain = FnKernel<Formula, DVec3, f64>;

fn inverse(x: DVec3, y: DVec3) -> f64 {
    1.0 / x.distance(y)
}

fn plain(formula: Formula) -> Plain {
    from_fn(formula).skip_coincident()
}

/// A plan with leaves so small that most pairs go through expansions.
fn build(
    formula: Formula,
    tolerance: f64,
    sources: &[DVec3],
    targets: &[DVec3],
) -> Result<Fmm<Interpolation<Plain>>, Error> {
    Fmm::builder(plain(formula)).tolerance(tolerance).leaf_size(20).build(sources, targets)
}

/// The relative l2 error of a sum over `points`, or why it was refused.
fn error(
    formula: Formula,
    tolerance: f64,
    points: &[DVec3],
    charges: &[f64],
) -> Result<f64, Error> {
    let fmm = build(formula, tolerance, points, points)?;
    assert!(fmm.report().stats.expansion_pairs > 0, "a far field to test");
    let values = fmm.apply(charges)?;
    Ok(relative_l2_error(&values, &direct(&plain(formula), points, charges, points).unwrap()))
}

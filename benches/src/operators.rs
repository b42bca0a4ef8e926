//! The operators that the engine keeps from plan to plan.

use farfield::{Error, Fmm, from_fn};
use glam::DVec3;

/// Makes the engine forget its operators, so that the next plan has to build them: plans for a constant
/// kernel displace them.
///
/// # Errors
/// If one of those plans can't be made.
pub fn forget_operators() -> Result<(), Error> {
    /// More sets of operators than the engine keeps.
    const PLANS: i32 = 32;
    let constant = from_fn(|_: DVec3, _: DVec3| 1.0);
    // Two of them share a corner of the tree, so that the third is well separated from their cells.
    let points = [DVec3::ZERO, DVec3::splat(0.01), DVec3::ONE];
    for i in 1..=PLANS {
        let builder = Fmm::builder(constant).tolerance(0.1 / f64::from(i)).leaf_size(1);
        builder.build(&points, &points)?;
    }
    Ok(())
}

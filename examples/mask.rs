//! Pairs that do not count: charges on either side of a wall do not see each other.
//!
//! A mask answers for two cells at once, so that expansions are used wherever all pairs count, and nothing
//! is computed where none does. Only cells that the wall cuts are asked pair by pair.
//!
//! ```sh
//! cargo run --release --example mask
//! ```

use farfield::glam::DVec3;
use farfield::{
    CellView, Coverage, Fmm, Kernel, Located, Mask, direct_masked, from_fn, relative_l2_error,
};

const POINTS: usize = 5_000;
const TOLERANCE: f64 = 1e-4;

/// A wall in the plane x = `at`.
struct Wall {
    at: f64,
}

impl Wall {
    fn is_left(&self, p: &impl Located<Real = f64>) -> bool {
        p.position().x < self.at
    }

    /// The side on which all of the points are, if it is one.
    fn side(&self, points: &[impl Located<Real = f64>]) -> Option<bool> {
        let left = points.first().map(|p| self.is_left(p))?;
        points.iter().all(|p| self.is_left(p) == left).then_some(left)
    }
}

impl<K: Kernel<Real = f64>> Mask<K> for Wall {
    fn cells(
        &self,
        targets: CellView<'_, K::Target>,
        sources: CellView<'_, K::Source>,
    ) -> Coverage {
        match (self.side(targets.points), self.side(sources.points)) {
            (Some(target), Some(source)) if target == source => Coverage::Full,
            (Some(_), Some(_)) => Coverage::Empty,
            _ => Coverage::Partial,
        }
    }

    fn pair(&self, x: &K::Target, y: &K::Source) -> f64 {
        f64::from(self.is_left(x) == self.is_left(y))
    }
}

fn main() -> Result<(), farfield::Error> {
    let points: Vec<DVec3> = (0..POINTS).map(point).collect();
    let charges: Vec<f64> = (0..POINTS).map(|i| (i as f64).cos()).collect();
    let kernel = from_fn(|x: DVec3, y: DVec3| 1.0 / x.distance(y)).skip_coincident();
    let wall = Wall { at: 0.4 };

    let fmm = Fmm::builder(kernel).tolerance(TOLERANCE).mask(&wall).build(&points, &points)?;
    let potentials = fmm.apply(&charges)?;
    let exact = direct_masked(&kernel, &wall, &points, &charges, &points[..500])?;
    let error = relative_l2_error(&potentials[..500], &exact);
    let stats = fmm.report().stats;
    println!(
        "{POINTS} points, relative l2 error {error:.1e}; {} of {} pairs summed one by one",
        stats.direct_pairs,
        POINTS * POINTS
    );
    assert!(error <= TOLERANCE, "error {error:e}, expected at most {TOLERANCE:e}");
    // Half of the pairs are parted by the wall, or nearly: none of them was summed.
    let counted = stats.direct_pairs + stats.expansion_pairs;
    let left = points.iter().filter(|p| wall.is_left(*p)).count() as u64;
    let right = POINTS as u64 - left;
    assert_eq!(counted, left * left + right * right);
    Ok(())
}

/// The i-th point of a sequence that fills the unit cube evenly: fractions of i times the powers of
/// 1/g, g the root of g⁴ = g + 1.
fn point(i: usize) -> DVec3 {
    const G: f64 = 1.220_744_084_605_759_5;
    (DVec3::new(G.powi(-1), G.powi(-2), G.powi(-3)) * i as f64).fract()
}

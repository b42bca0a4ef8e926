//! Two kernels of your own: one that is a formula, one whose sources carry more than a position.
//!
//! Neither says anything about expansions: the engine interpolates the formula at Chebyshev nodes
//! and chooses the order for the tolerance asked for.
//!
//! ```sh
//! cargo run --release --example new_kernel
//! ```

use farfield::glam::DVec3;
use farfield::{Fmm, Kernel, Located, direct, from_fn, relative_l2_error};

const POINTS: usize = 5_000;
const TOLERANCE: f64 = 1e-4;

fn main() -> Result<(), farfield::Error> {
    let points: Vec<DVec3> = (0..POINTS).map(point).collect();
    let charges: Vec<f64> = (0..POINTS).map(|i| (i as f64).sin()).collect();

    // K(x, y) = exp(−κ|x − y|) / |x − y|: a charge screened over the length 1/κ. A point does not
    // act on itself, where the formula is singular.
    let kappa = 2.0;
    let screened =
        from_fn(move |x: DVec3, y: DVec3| (-kappa * x.distance(y)).exp() / x.distance(y));
    let kernel = screened.skip_coincident();
    let fmm = Fmm::builder(kernel).tolerance(TOLERANCE).build(&points, &points)?;
    let potentials = fmm.apply(&charges)?;
    check("screened charges", &potentials, &direct(&kernel, &points, &charges, &points)?);

    // The same with sources that have a direction.
    let dipoles: Vec<Dipole> = points
        .iter()
        .enumerate()
        .map(|(i, &position)| Dipole { position, direction: (point(i + POINTS) - 0.5).normalize() })
        .collect();
    let fmm = Fmm::builder(DipolePotential).tolerance(TOLERANCE).build(&dipoles, &points)?;
    let potentials = fmm.apply(&charges)?;
    check("dipoles", &potentials, &direct(&DipolePotential, &dipoles, &charges, &points)?);
    Ok(())
}

/// A source with an attribute. Anything with a position can be a source or a target.
#[derive(Clone, Debug)]
struct Dipole {
    position: DVec3,
    /// Unit vector from the negative to the positive pole.
    direction: DVec3,
}

impl Located for Dipole {
    type Real = f64;

    fn position(&self) -> DVec3 {
        self.position
    }
}

/// K(x, y) = p·(x − y) / |x − y|³, the potential at x of a unit dipole of direction p at y.
struct DipolePotential;

/// The attributes are taken out of the formula: K q = Σ_k G_k(x, y) · p_k q, with three densities p q and
/// one row G = (x − y)ᵗ / |x − y|³ that knows positions only. A dipole does not act on itself.
impl Kernel for DipolePotential {
    type Real = f64;
    type Source = Dipole;
    type Target = DVec3;
    type Charge = f64;
    type Value = f64;
    type Entry = f64;

    fn densities(&self) -> usize {
        3
    }

    fn columns(&self) -> usize {
        1
    }

    fn entries(&self, x: DVec3, y: DVec3, g: &mut [f64]) {
        let d = x - y;
        let scale = if d == DVec3::ZERO { 0.0 } else { d.length().powi(-3) };
        g.copy_from_slice(&(d * scale).to_array());
    }

    fn density(&self, y: &Dipole, q: &f64, d: &mut [f64]) {
        d.copy_from_slice(&(y.direction * *q).to_array());
    }
}

/// Prints the error and insists on the tolerance.
fn check(what: &str, values: &[f64], exact: &[f64]) {
    let error = relative_l2_error(values, exact);
    println!("{what:>16}: {POINTS} points, relative l2 error {error:.1e}");
    assert!(error <= TOLERANCE, "{what}: error {error:e}, expected at most {TOLERANCE:e}");
}

/// The i-th point of a sequence that fills the unit cube evenly: fractions of i times the powers of
/// 1/g, g the root of g⁴ = g + 1.
fn point(i: usize) -> DVec3 {
    const G: f64 = 1.220_744_084_605_759_5;
    (DVec3::new(G.powi(-1), G.powi(-2), G.powi(-3)) * i as f64).fract()
}

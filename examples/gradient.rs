//! A potential with its gradient and its second derivatives, from one formula.
//!
//! The formula is written once, in numbers that the engine chooses: several pairs side by side, with
//! derivatives carried along where they are wanted.
//!
//! ```sh
//! cargo run --release --example gradient
//! ```

use farfield::glam::DVec3;
use farfield::{
    Coordinates, Difference, Fmm, Formula, Number, Numbers, direct, from_formula, relative_l2_error,
};

const POINTS: usize = 5_000;
const TOLERANCE: f64 = 1e-4;

/// K(x, y) = exp(−r²/2σ²), r = |x − y|.
#[derive(Clone, Copy)]
struct Gaussian {
    /// The width σ.
    sigma: f64,
}

impl Formula for Gaussian {
    type Of = Difference;
    type Entry<N: Number> = N;

    fn entries<N: Number>(&self, d: Coordinates<N>, g: &mut [N]) {
        g[0] = (d.length_squared() / (-2.0 * self.sigma * self.sigma)).exp();
    }
}

fn main() -> Result<(), farfield::Error> {
    let points: Vec<DVec3> = (0..POINTS).map(point).collect();
    let charges: Vec<f64> = (0..POINTS).map(|i| (i as f64).sin()).collect();
    let gaussian = Gaussian { sigma: 0.5 };

    // Forces: the gradient of the sum, without another formula.
    let kernel = from_formula(gaussian).gradient();
    let fmm = Fmm::builder(kernel).tolerance(TOLERANCE).build(&points, &points)?;
    let sums = fmm.apply(&charges)?;
    let exact = direct(&kernel, &points, &charges, &points[..500])?;
    check("potentials", TOLERANCE, &sums, &exact, |u| u.value);
    check("gradients", TOLERANCE, &sums, &exact, |u| u.gradient);

    // Second derivatives as well.
    let kernel = from_formula(gaussian).hessian();
    let fmm = Fmm::builder(kernel).tolerance(TOLERANCE).build(&points, &points)?;
    let sums = fmm.apply(&charges)?;
    let exact = direct(&kernel, &points, &charges, &points[..500])?;
    check("second derivatives", TOLERANCE, &sums, &exact, |u| u.hessian);

    // At d = (σ, 0, 0) the derivatives are known: the slope along x is −K/σ and the curvature is 0.
    let alone = direct(&kernel, &[DVec3::ZERO], &[1.0], &[DVec3::X * gaussian.sigma])?[0];
    assert!((alone.gradient[0] + alone.value / gaussian.sigma).abs() < 1e-14);
    assert!(alone.hessian[0].abs() < 1e-14);
    Ok(())
}

/// Prints the error of a part of the sums and insists on its bound.
fn check<U, V: Numbers>(what: &str, bound: f64, sums: &[U], exact: &[U], part: fn(&U) -> V) {
    let parts = |of: &[U]| of.iter().map(part).collect::<Vec<V>>();
    let error = relative_l2_error(&parts(&sums[..exact.len()]), &parts(exact));
    println!("{what:>18}: {POINTS} points, relative l2 error {error:.1e}");
    assert!(error <= bound, "{what}: error {error:e}, expected at most {bound:e}");
}

/// The i-th point of a sequence that fills the unit cube evenly: fractions of i times the powers of
/// 1/g, g the root of g⁴ = g + 1.
fn point(i: usize) -> DVec3 {
    const G: f64 = 1.220_744_084_605_759_5;
    (DVec3::new(G.powi(-1), G.powi(-2), G.powi(-3)) * i as f64).fract()
}

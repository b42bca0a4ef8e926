//! An expansion of your own, plugged into the engine from outside.
//!
//! The kernel is a sum over waves, K(x, y) = Σ_k a_k cos(k·(x − y)), as in the reciprocal half of an
//! Ewald sum or in random Fourier features. One complex term per wave expands it exactly:
//!
//! e^{ik·(x−y)} = e^{ik·(x−c_t)} · e^{ik·(c_t−c_s)} · e^{−ik·(y−c_s)}
//!
//! for any centres c_s and c_t. The last factor, summed over charges, is the multipole (P2M), the
//! middle one carries it to another centre (M2L), the first reads it off (L2P); M2M and L2L are
//! shifts by the same law. Five short operators are all that the engine asks for.
//!
//! ```sh
//! cargo run --release --example own_expansion
//! ```

use farfield::conformance::{self, Samples};
use farfield::glam::DVec3;
use farfield::num_complex::Complex;
use farfield::{Cell, Expansion, Fmm, Kernel, direct, relative_l2_error};

const POINTS: usize = 10_000;
const CHECKED: usize = 500;
/// The expansion is exact; this much is left to rounding.
const ROUNDING: f64 = 1e-12;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Before any tree: do the operators obey the laws, each alone and all together?
    let samples = Samples { source: |p, _| p, target: |p, _| p, charge: |i| 1.0 + i as f64 };
    conformance::check(Waves::inside(2), &samples, ROUNDING)?;

    let waves = Waves::inside(2);

    let points: Vec<DVec3> = (0..POINTS).map(point).collect();
    let charges: Vec<f64> = (0..POINTS).map(|i| (i as f64).sin()).collect();
    let exact = direct(&waves, &points, &charges, &points[..CHECKED])?;

    let fmm = Fmm::with_expansion(waves).build(&points, &points)?;
    let values = fmm.apply(&charges)?;
    let error = relative_l2_error(&values[..CHECKED], &exact);
    let stats = fmm.report().stats;
    println!(
        "{POINTS} points, {} waves: {} pairs by expansion, {} directly, relative l2 error {error:.1e}",
        stats.terms_per_cell, stats.expansion_pairs, stats.direct_pairs
    );
    assert!(stats.expansion_pairs > stats.direct_pairs, "the far field was hardly used");
    assert!(error < ROUNDING, "error {error:e}, expected no more than rounding");
    Ok(())
}

/// K(x, y) = Σ_k a_k cos(k·(x − y)), kernel and expansion in one.
struct Waves(Vec<Wave>);

/// One term of the sum over waves.
struct Wave {
    /// Wave vector k, in radians per unit of length.
    k: DVec3,
    /// Its weight a_k.
    amplitude: f64,
}

impl Waves {
    /// All wave vectors with integer components, 0 < |k| ≤ `radius`, weighted by 1/|k|². Of k and
    /// −k, which have the same cosine, only one is kept.
    fn inside(radius: i32) -> Self {
        let axis = || -radius..=radius;
        let grid = axis().flat_map(|x| axis().flat_map(move |y| axis().map(move |z| [x, y, z])));
        let half = grid.filter(|&k| k > [0, 0, 0]).map(|k| DVec3::from(k.map(f64::from)));
        let inside = half.filter(|k| k.length() <= f64::from(radius));
        Self(inside.map(|k| Wave { k, amplitude: 1.0 / k.length_squared() }).collect())
    }

    /// Adds terms shifted by `shift`: each wave only turns its phase.
    fn shift(&self, shift: DVec3, from: &[Complex<f64>], to: &mut [Complex<f64>]) {
        for ((wave, from), to) in self.0.iter().zip(from).zip(to) {
            *to += Complex::cis(wave.k.dot(shift)) * from;
        }
    }
}

impl Kernel for Waves {
    type Real = f64;
    type Source = DVec3;
    type Target = DVec3;
    type Charge = f64;
    type Value = f64;
    type Entry = f64;

    fn entries(&self, x: DVec3, y: DVec3, g: &mut [f64]) {
        g[0] = self.0.iter().map(|w| w.amplitude * w.k.dot(x - y).cos()).sum();
    }
}

impl Expansion for Waves {
    type Kernel = Self;
    type MultipoleTerm = Complex<f64>;
    type LocalTerm = Complex<f64>;

    fn kernel(&self) -> &Self {
        self
    }

    fn multipole_len(&self, _level: usize) -> usize {
        self.0.len()
    }

    fn local_len(&self, _level: usize) -> usize {
        self.0.len()
    }

    /// M_k = Σ_j q_j e^{−ik·(y_j−c)}
    fn p2m(&self, cell: &Cell<f64>, ys: &[DVec3], qs: &[f64], multipole: &mut [Complex<f64>]) {
        for (wave, m) in self.0.iter().zip(multipole) {
            for (y, q) in ys.iter().zip(qs) {
                *m += q * Complex::cis(-wave.k.dot(cell.relative(*y)));
            }
        }
    }

    /// M_k e^{ik·(c_parent−c_child)}
    fn m2m(
        &self,
        child: &Cell<f64>,
        parent: &Cell<f64>,
        from: &[Complex<f64>],
        to: &mut [Complex<f64>],
    ) {
        self.shift(parent.centre() - child.centre(), from, to);
    }

    /// L_k = M_k e^{ik·(c_target−c_source)}
    fn m2l(
        &self,
        source: &Cell<f64>,
        target: &Cell<f64>,
        from: &[Complex<f64>],
        to: &mut [Complex<f64>],
    ) {
        self.shift(target.centre() - source.centre(), from, to);
    }

    /// L_k e^{ik·(c_child−c_parent)}
    fn l2l(
        &self,
        parent: &Cell<f64>,
        child: &Cell<f64>,
        from: &[Complex<f64>],
        to: &mut [Complex<f64>],
    ) {
        self.shift(child.centre() - parent.centre(), from, to);
    }

    /// u(x) = Re Σ_k a_k L_k e^{ik·(x−c)}
    fn l2p(&self, cell: &Cell<f64>, local: &[Complex<f64>], xs: &[DVec3], us: &mut [f64]) {
        for (x, u) in xs.iter().zip(us) {
            let d = cell.relative(*x);
            let terms = self.0.iter().zip(local);
            *u += terms.map(|(w, l)| w.amplitude * (Complex::cis(w.k.dot(d)) * l).re).sum::<f64>();
        }
    }
}

/// The i-th point of a sequence that fills the unit cube evenly: fractions of i times the powers of
/// 1/g, g the root of g⁴ = g + 1.
fn point(i: usize) -> DVec3 {
    const G: f64 = 1.220_744_084_605_759_5;
    (DVec3::new(G.powi(-1), G.powi(-2), G.powi(-3)) * i as f64).fract()
}

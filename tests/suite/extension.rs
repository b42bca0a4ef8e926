//! What an outsider brings: kernels and expansions on the public interface alone.

use farfield::conformance::{self, Samples};
use farfield::{
    Cell, Expansion, Fmm, Kernel, Located, Numbers, Point, Scheme, direct, relative_l2_error,
};
use farfield_testing::clouds::{self, Random};
use glam::DVec3;

/// A source with a direction.
#[derive(Clone, Debug)]
struct Dipole {
    position: DVec3,
    moment: DVec3,
}

impl Located for Dipole {
    type Real = f64;
    fn position(&self) -> DVec3 {
        self.position
    }
}

/// Potential of dipoles: m·(x − y)/|x − y|³.
struct DipolePotential;

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
        g.copy_from_slice(&(d / d.length().powi(3)).to_array());
    }

    fn density(&self, y: &Dipole, q: &f64, d: &mut [f64]) {
        d.copy_from_slice(&(y.moment * *q).to_array());
    }
}

#[test]
fn a_kernel_with_attributes_goes_through_the_black_box() {
    let mut random = Random::new(1);
    let sources: Vec<Dipole> = clouds::cube(2000, 2)
        .into_iter()
        .map(|position| Dipole { position, moment: random.direction() })
        .collect();
    let targets = clouds::cube(1000, 3);
    let charges = clouds::charges(2000, 4);
    let samples = Samples {
        source: |position, i| Dipole { position, moment: DVec3::new(1.0, i as f64, -2.0) },
        target: |p, _| p,
        charge: |i| 1.0 + i as f64,
    };
    conformance::check_kernel(&DipolePotential, &samples, 1e-14).unwrap();
    let exact = direct(&DipolePotential, &sources, &charges, &targets).unwrap();
    let fmm = Fmm::builder(DipolePotential).tolerance(1e-4).leaf_size(40);
    let fmm = fmm.build(&sources, &targets).unwrap();
    let error = relative_l2_error(&fmm.apply(&charges).unwrap(), &exact);
    assert!(error < 1e-4, "{error:e}");
    assert!(fmm.report().stats.expansion_pairs > fmm.report().stats.direct_pairs);
}

/// 1/r and its gradient, through interpolation's derivative.
struct WithGradient;

impl Kernel for WithGradient {
    type Real = f64;
    type Source = DVec3;
    type Target = DVec3;
    type Charge = f64;
    type Value = [f64; 4];
    type Entry = f64;

    fn needs_gradients(&self) -> bool {
        true
    }

    fn entries(&self, x: DVec3, y: DVec3, g: &mut [f64]) {
        g[0] = 1.0 / x.distance(y);
    }

    fn value(&self, _: &DVec3, fields: &[f64], gradients: &[[f64; 3]], u: &mut [f64; 4]) {
        let [x, y, z] = gradients[0];
        u.add_scaled(1.0, &[fields[0], x, y, z]);
    }

    /// It declines to give gradients of single pairs, so the near field is its own.
    fn add_block(
        &self,
        xs: &[DVec3],
        ys: &[DVec3],
        qs: &[f64],
        _tolerance: f64,
        us: &mut [[f64; 4]],
    ) {
        for (x, u) in xs.iter().zip(us) {
            for (y, q) in ys.iter().zip(qs) {
                let d = *x - *y;
                let r = d.length();
                if r > 0.0 {
                    let g = d / -r.powi(3);
                    u.add_scaled(*q, &[1.0 / r, g.x, g.y, g.z]);
                }
            }
        }
    }
}

#[test]
fn gradients_come_from_the_same_local_expansion() {
    // Gradients lose one order, and this kernel declines M2P: unequal leaves are summed directly.
    let sources = clouds::cube(3000, 2);
    let targets = clouds::plummer(1000, 3);
    let charges = clouds::charges(3000, 4);
    let exact = direct(&WithGradient, &sources, &charges, &targets).unwrap();
    let error = |order, scheme| {
        let fmm = Fmm::builder(WithGradient).order(order).leaf_size(30).scheme(scheme);
        let fmm = fmm.build(&sources, &targets).unwrap();
        assert!(fmm.report().stats.expansion_pairs > 0);
        relative_l2_error(&fmm.apply(&charges).unwrap(), &exact)
    };
    let (low, high) = (error(4, Scheme::Fmm), error(8, Scheme::Fmm));
    assert!(low < 1e-2 && high < 1e-3 * low.max(1e-3), "{low:e} {high:e}");
    let treecode = error(4, Scheme::Treecode { m2m: true });
    assert!(treecode < 1e-13, "M2P declines, so everything is direct: {treecode:e}");
}

/// cos(k·(x − y)): an analytic expansion of two terms, exact, that offers neither M2P nor P2L.
struct PlaneWave {
    k: DVec3,
}

impl Kernel for PlaneWave {
    type Real = f64;
    type Source = DVec3;
    type Target = DVec3;
    type Charge = f64;
    type Value = f64;
    type Entry = f64;

    fn entries(&self, x: DVec3, y: DVec3, g: &mut [f64]) {
        g[0] = self.k.dot(x - y).cos();
    }
}

impl PlaneWave {
    /// Turns (cos, sin) moments by the phase k·d.
    fn turn(&self, d: DVec3, from: &[f64], to: &mut [f64]) {
        let (sin, cos) = self.k.dot(d).sin_cos();
        to[0] += cos * from[0] - sin * from[1];
        to[1] += sin * from[0] + cos * from[1];
    }
}

impl Expansion for PlaneWave {
    type Kernel = Self;
    type MultipoleTerm = f64;
    type LocalTerm = f64;

    fn kernel(&self) -> &Self {
        self
    }
    fn multipole_len(&self, _: usize) -> usize {
        2
    }
    fn local_len(&self, _: usize) -> usize {
        2
    }
    fn p2m(&self, cell: &Cell<f64>, ys: &[DVec3], qs: &[f64], m: &mut [f64]) {
        for (y, &q) in ys.iter().zip(qs) {
            self.turn(-cell.relative(*y), &[q, 0.0], m);
        }
    }
    fn m2m(&self, child: &Cell<f64>, parent: &Cell<f64>, from: &[f64], to: &mut [f64]) {
        self.turn(-parent.relative(child.centre()), from, to);
    }
    fn m2l(&self, source: &Cell<f64>, target: &Cell<f64>, from: &[f64], to: &mut [f64]) {
        self.turn(source.relative(target.centre()), from, to);
    }
    fn l2l(&self, parent: &Cell<f64>, child: &Cell<f64>, from: &[f64], to: &mut [f64]) {
        self.turn(parent.relative(child.centre()), from, to);
    }
    fn l2p(&self, cell: &Cell<f64>, local: &[f64], xs: &[Point<f64>], us: &mut [f64]) {
        for (x, u) in xs.iter().zip(us) {
            let mut turned = [0.0; 2];
            self.turn(cell.relative(*x), local, &mut turned);
            *u += turned[0];
        }
    }
}

#[test]
fn declined_operators_lose_no_pair() {
    let wave = || PlaneWave { k: DVec3::new(3.0, -1.0, 2.0) };
    let samples = Samples { source: |p, _| p, target: |p, _| p, charge: |i| 1.0 + i as f64 };
    conformance::check(wave(), &samples, 1e-12).unwrap();
    let dense = clouds::cube(4000, 1);
    let sparse = clouds::plummer(300, 2);
    for (sources, targets) in [(&dense, &sparse), (&sparse, &dense), (&dense, &dense)] {
        let charges = clouds::charges(sources.len(), 3);
        let exact = direct(&wave(), sources, &charges, targets).unwrap();
        for scheme in crate::engine::SCHEMES {
            let fmm = Fmm::with_expansion(wave()).leaf_size(8).scheme(scheme);
            let fmm = fmm.build(sources, targets).unwrap();
            let error = relative_l2_error(&fmm.apply(&charges).unwrap(), &exact);
            assert!(error < 1e-12, "{scheme:?}: {error:e}");
        }
    }
}

//! What an outsider brings: kernels, expansions and masks on the public interface alone.

use farfield::conformance::{self, Samples};
use farfield::{
    Cell, CellView, Coverage, Expansion, Fmm, Kernel, Located, Mask, Numbers, Point, Scheme,
    direct, direct_masked, relative_l2_error,
};
use farfield_testing::clouds::{self, Random};
use glam::DVec3;

use crate::plain;

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

/// Only pairs with x to the right of y count; never certifies anything.
struct ToTheRight;

impl<K: Kernel<Real = f64>> Mask<K> for ToTheRight {
    fn cells(&self, _: CellView<'_, K::Target>, _: CellView<'_, K::Source>) -> Coverage {
        Coverage::Partial
    }
    fn pair(&self, x: &K::Target, y: &K::Source) -> f64 {
        f64::from(x.position().x > y.position().x)
    }
}

#[test]
fn a_mask_that_never_certifies_is_slow_but_right() {
    let points = clouds::cube(700, 1);
    let charges = clouds::charges(700, 2);
    let kernel = plain(|x, y| (x - y).length());
    let exact = direct_masked(&kernel, &ToTheRight, &points, &charges, &points).unwrap();
    let fmm = Fmm::builder(kernel).mask(ToTheRight).leaf_size(9).build(&points, &points).unwrap();
    assert_eq!(fmm.report().stats.expansion_pairs, 0);
    assert_eq!(fmm.report().stats.direct_pairs, 700 * 699 / 2);
    assert!(relative_l2_error(&fmm.apply(&charges).unwrap(), &exact) < 1e-13);
}

/// Well-separated cells of one level count by eighths, all other pairs in full.
struct Weighed(u8);

impl<K: Kernel<Real = f64>> Mask<K> for Weighed {
    fn cells(&self, t: CellView<'_, K::Target>, s: CellView<'_, K::Source>) -> Coverage {
        if t.cell.level() != s.cell.level() || !t.cell.well_separated(s.cell) {
            return Coverage::Partial;
        }
        match self.0 {
            0 => Coverage::Empty,
            8 => Coverage::Full,
            eighths => Coverage::Eighths(eighths),
        }
    }
    fn pair(&self, _: &K::Target, _: &K::Source) -> f64 {
        1.0
    }
}

#[test]
fn eighths_weigh_what_expansions_carry() {
    let points = clouds::cube(3000, 1);
    let charges = clouds::charges(3000, 2);
    // One kernel with operators by offset, one whose M2L goes through the kernel itself.
    let inverse = plain(|x, y| 1.0 / x.distance(y)).skip_coincident();
    let drifting = plain(|x, y| (1.0 + x.x) / (1.0 + x.distance(y)));
    // The latter costs far more, and what is weighed is linear at any accuracy.
    for (kernel, order) in [(inverse, None), (drifting, Some(4))] {
        let sum = |eighths: u8| {
            let builder = Fmm::builder(kernel);
            let builder = match order {
                Some(order) => builder.order(order),
                None => builder.tolerance(1e-6),
            };
            let plan = builder.mask(Weighed(eighths)).leaf_size(10);
            let fmm = plan.build(&points, &points).unwrap();
            assert_eq!(fmm.report().stats.cell_pairs[0] > 0, eighths > 0);
            fmm.apply(&charges).unwrap()
        };
        let (near, all) = (sum(0), sum(8));
        assert!(relative_l2_error(&near, &all) > 0.01);
        for eighths in [1, 3, 7] {
            let weight = f64::from(eighths) / 8.0;
            let mix = |(n, a): (&f64, &f64)| n + weight * (a - n);
            let expected: Vec<f64> = near.iter().zip(&all).map(mix).collect();
            assert!(relative_l2_error(&sum(eighths), &expected) < 1e-9);
        }
    }
}

/// Whether the sum of two positions lies on one side of a plane: the same from either end.
struct Symmetric {
    mirrored: bool,
    asked: std::sync::atomic::AtomicUsize,
}

impl Mask<farfield::FnKernel<fn(DVec3, DVec3) -> f64, DVec3, f64>> for Symmetric {
    fn cells(&self, _: CellView<'_, DVec3>, _: CellView<'_, DVec3>) -> Coverage {
        Coverage::Partial
    }
    fn pair(&self, x: &DVec3, y: &DVec3) -> f64 {
        self.asked.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        f64::from((*x + *y).x > 0.3)
    }
    fn is_mirrored(&self, _: &[DVec3], _: &[DVec3]) -> bool {
        self.mirrored
    }
}

#[test]
fn mirrored_pairs_are_asked_for_once_and_count_twice() {
    let points = clouds::plummer(900, 1);
    let charges = clouds::charges(900, 2);
    let kernel = plain(|x, y| (x - y).length());
    let sum = |mirrored| {
        let mask = Symmetric { mirrored, asked: Default::default() };
        let fmm = Fmm::builder(kernel).mask(&mask).leaf_size(13).build(&points, &points).unwrap();
        (fmm.apply(&charges).unwrap(), mask.asked.into_inner())
    };
    let ((whole, all), (halved, asked)) = (sum(false), sum(true));
    assert_eq!(whole, halved);
    assert_eq!(all, 900 * 900);
    assert!(asked < all * 11 / 20, "{asked}");
}

/// Pairs count in part: by a share that depends on both points, the same from either end.
struct Veiled {
    mirrored: bool,
}

impl Veiled {
    fn share(x: DVec3, y: DVec3) -> f64 {
        let clear = 1.5 * (x.x + y.x) - 0.2;
        clear.clamp(0.0, 1.0)
    }
}

impl<K: Kernel<Real = f64>> Mask<K> for Veiled {
    fn cells(&self, t: CellView<'_, K::Target>, s: CellView<'_, K::Source>) -> Coverage {
        let most = |view: &[f64]| view.iter().copied().fold(f64::MIN, f64::max);
        let least = |view: &[f64]| view.iter().copied().fold(f64::MAX, f64::min);
        let xs: Vec<f64> = t.points.iter().map(|x| x.position().x).collect();
        let ys: Vec<f64> = s.points.iter().map(|y| y.position().x).collect();
        if 1.5 * (least(&xs) + least(&ys)) - 0.2 >= 1.0 {
            Coverage::Full
        } else if 1.5 * (most(&xs) + most(&ys)) - 0.2 <= 0.0 {
            Coverage::Empty
        } else {
            Coverage::Partial
        }
    }
    fn pair(&self, x: &K::Target, y: &K::Source) -> f64 {
        Self::share(x.position(), y.position())
    }
    fn is_mirrored(&self, _: &[K::Target], _: &[K::Source]) -> bool {
        self.mirrored
    }
}

#[test]
fn pairs_that_count_in_part_are_weighed() {
    let points = clouds::cube(1500, 1);
    let charges = clouds::charges(1500, 2);
    let kernel = plain(|x, y| 1.0 / x.distance(y)).skip_coincident();
    let mut exact = vec![0.0; points.len()];
    for (x, u) in points.iter().zip(&mut exact) {
        for (y, q) in points.iter().zip(&charges).filter(|(y, _)| x != *y) {
            *u += Veiled::share(*x, *y) / x.distance(*y) * q;
        }
    }
    let veil = Veiled { mirrored: false };
    let masked = direct_masked(&kernel, &veil, &points, &charges, &points).unwrap();
    assert!(relative_l2_error(&masked, &exact) < 1e-13);
    let sum = |mirrored| {
        let builder = Fmm::builder(kernel).mask(Veiled { mirrored }).tolerance(1e-6).leaf_size(15);
        builder.build(&points, &points).unwrap()
    };
    let fmm = sum(false);
    assert!(fmm.report().stats.expansion_pairs > 0 && fmm.report().stats.mask_bytes > 0);
    let values = fmm.apply(&charges).unwrap();
    assert!(relative_l2_error(&values, &exact) < 1e-6);
    assert_eq!(sum(true).apply(&charges).unwrap(), values, "mirrored answers are the same");
    let (_, certificate) = fmm.apply_certified(&charges).unwrap();
    assert!(certificate.estimate < 1e-6, "shares are seen: {certificate:?}");

    // Sets of their own trees, and leaves in which no pair counts in full.
    let targets = clouds::plummer(400, 3);
    let masked = direct_masked(&kernel, &veil, &points, &charges, &targets).unwrap();
    let fmm = Fmm::builder(kernel).mask(&veil).tolerance(1e-6).leaf_size(15);
    let values = fmm.build(&points, &targets).unwrap().apply(&charges).unwrap();
    assert!(relative_l2_error(&values, &masked) < 1e-6);
}

/// Says of one pair that it counts by something that is not a share.
struct Wrong(f64);

impl<K: Kernel<Real = f64>> Mask<K> for Wrong {
    fn cells(&self, _: CellView<'_, K::Target>, _: CellView<'_, K::Source>) -> Coverage {
        Coverage::Partial
    }
    fn pair(&self, x: &K::Target, y: &K::Source) -> f64 {
        let marked = x.position().x == 7.0 && y.position().x == 3.0;
        if marked { self.0 } else { 1.0 }
    }
}

#[test]
fn what_is_no_share_is_refused_with_its_pair() {
    let points: Vec<DVec3> = (0..100).map(|i| DVec3::new(f64::from(i), 0.0, 0.0)).collect();
    let kernel = plain(|x, y| x.distance(y));
    for wrong in [-0.1, 1.5, f64::NAN, f64::INFINITY] {
        let built = Fmm::builder(kernel).mask(Wrong(wrong)).leaf_size(9).build(&points, &points);
        let refused = built.map(|_| ()).unwrap_err();
        assert!(
            matches!(refused, farfield::Error::InvalidShare { target: 7, from: 3, .. }),
            "{refused}"
        );
    }
}

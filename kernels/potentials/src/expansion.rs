//! The harmonic expansion of the power laws, as the engine wants it.

use farfield::{Cell, Costs, Error, Expansion, LevelPairs, Numbers, Outcome, Point, Real};

use crate::exponent::Exponent;
use crate::harmonic::{Harmonic, Scratch};
use crate::output::{Output, Potential};
use crate::power_law::PowerLaw;

/// The expansion of |x − y|^(−2λ) in solid harmonics, [`harmonic`](crate::harmonic).
///
/// With h the half-width of a cell and all lengths in units of it,
///
/// M_k = Σ_j R_k(y_j) q_j,    u(x) = h^(−2λ) Σ_k S_k(x) M_k    outside,
/// L_k = Σ_j S_k(y_j) q_j,    u(x) = h^(−2λ) Σ_k L_k R_k(x)    inside,
///
/// so that moments and translations are the same at every scale.
#[derive(Clone, Debug)]
pub struct HarmonicExpansion<E: Exponent, T, C = T, O = Potential> {
    kernel: PowerLaw<E, T, C, O>,
    harmonic: Harmonic<T>,
}

impl<E: Exponent, T: Real, C: Numbers<Real = T>, O: Output<T, C>> HarmonicExpansion<E, T, C, O> {
    /// The expansion to degree `order`, at most [`MAX_ORDER`](crate::harmonic::MAX_ORDER).
    ///
    /// # Errors
    /// [`Error::InvalidOrder`].
    pub fn new(kernel: PowerLaw<E, T, C, O>, order: usize) -> Result<Self, Error> {
        Ok(Self { kernel, harmonic: Harmonic::new(E::LAMBDA, order)? })
    }

    /// The order p: the highest degree of the expansion.
    pub fn order(&self) -> usize {
        self.harmonic.order()
    }

    /// The expansion whose order is chosen so that the field of one cell in the nearest cell that is
    /// well separated has a relative l2 error of at most about `tolerance`.
    ///
    /// # Errors
    /// [`Error::InvalidTolerance`] unless 0 < `tolerance` < 1; [`Error::UnreachableTolerance`] if the
    /// precision or the [highest order](crate::harmonic::MAX_ORDER) doesn't suffice.
    pub fn with_tolerance(kernel: PowerLaw<E, T, C, O>, tolerance: f64) -> Result<Self, Error> {
        let rounding = ROUNDING * T::epsilon().as_f64();
        let error = |order| Self::predicted_error(order).max(rounding);
        Self::new(kernel, Harmonic::<T>::order_for(tolerance, 0, error)?)
    }

    /// An upper bound, fitted to measurements for λ = ½, 1 and 2, of the error of whole sums of charges of either
    /// sign: 0.03 · 3^(2λ−1) · 0.46^p for most of two cells with one cell between them,
    /// 10⁻⁵ · 8.5^(2λ−1) · 0.66^p for their corners, and 3 · 10⁻⁵ · 8.5^(1−2λ) · 0.72^p for points in planes on
    /// their faces, as the walls of a room are; 20 or 2.5 p times that for gradients.
    fn predicted_error(order: usize) -> f64 {
        let finite = E::LAMBDA <= 0.0 && E::LAMBDA.fract() == 0.0;
        if finite && order as f64 >= -2.0 * E::LAMBDA {
            return 0.0;
        }
        if order < 4 {
            return 1.0;
        }
        let (p, steepness) = (order as f64, 2.0 * E::LAMBDA - 1.0);
        let inside = 0.03 * 3f64.powf(steepness) * 0.46f64.powf(p);
        let corners = 1e-5 * 8.5f64.powf(steepness) * 0.66f64.powf(p);
        let walls = 3e-5 * 8.5f64.powf(-steepness) * 0.72f64.powf(p);
        (inside + corners.max(walls)) * if O::GRADIENT { (2.5 * p).max(20.0) } else { 1.0 }
    }

    /// h^(−2λ) and h^(−2λ−1).
    fn units(&self, cell: &Cell<T>) -> [T; 2] {
        let h = cell.half_width();
        let unit = h.powf(T::from_f64(-2.0 * E::LAMBDA));
        [unit, unit / h]
    }

    /// Adds Σ_k F_k(x) A_k and its gradient for the terms A of one cell, F regular or singular.
    fn evaluate(
        &self,
        cell: &Cell<T>,
        terms: &[C],
        targets: &[Point<T>],
        values: &mut [O::Value],
        basis: impl Fn(Point<T>, &mut [T], &mut [[T; 3]]),
    ) {
        let [unit, gradient_unit] = self.units(cell);
        let mut functions = vec![T::from_f64(0.0); self.harmonic.len()];
        let mut gradients =
            vec![[T::from_f64(0.0); 3]; if O::GRADIENT { functions.len() } else { 0 }];
        for (x, value) in targets.iter().zip(values) {
            basis(cell.normalised(*x), &mut functions, &mut gradients);
            let mut potential = C::zero();
            for (&function, term) in functions.iter().zip(terms) {
                potential.add_scaled(unit * function, term);
            }
            let mut gradient: [C; 3] = Numbers::zero();
            for (function, term) in gradients.iter().zip(terms) {
                for (component, &f) in gradient.iter_mut().zip(function) {
                    component.add_scaled(gradient_unit * f, term);
                }
            }
            O::add(value, &potential, &gradient);
        }
    }

    /// Adds Σ_j F_k(y_j) q_j, F regular or singular.
    fn moments(
        &self,
        cell: &Cell<T>,
        sources: &[Point<T>],
        charges: &[C],
        terms: &mut [C],
        basis: impl Fn(Point<T>, &mut [T]),
    ) {
        let mut functions = vec![T::from_f64(0.0); self.harmonic.len()];
        for (y, q) in sources.iter().zip(charges) {
            basis(cell.normalised(*y), &mut functions);
            for (&function, term) in functions.iter().zip(terms.iter_mut()) {
                term.add_scaled(function, q);
            }
        }
    }
}

impl<E: Exponent, T: Real, C: Numbers<Real = T>, O: Output<T, C>> Expansion
    for HarmonicExpansion<E, T, C, O>
{
    type Kernel = PowerLaw<E, T, C, O>;
    type MultipoleTerm = C;
    type LocalTerm = C;

    fn kernel(&self) -> &Self::Kernel {
        &self.kernel
    }

    fn multipole_len(&self, _level: usize) -> usize {
        self.harmonic.len()
    }

    fn local_len(&self, _level: usize) -> usize {
        self.harmonic.len()
    }

    fn costs(&self, _level: usize) -> Costs {
        let terms = self.harmonic.len();
        Costs { leaf_seconds: Some(self.harmonic.leaf_seconds(1)), ..Costs::new(terms, terms) }
    }

    fn p2m(&self, cell: &Cell<T>, sources: &[Point<T>], charges: &[C], multipole: &mut [C]) {
        self.moments(cell, sources, charges, multipole, |y, out| self.harmonic.regular(y, out));
    }

    fn m2m(&self, child: &Cell<T>, _parent: &Cell<T>, from: &[C], to: &mut [C]) {
        let mut scratch = Scratch::new(&self.harmonic);
        let centre = Harmonic::centre_in_parent(child);
        self.harmonic.m2m(centre, T::from_f64(0.5), from, to, &mut scratch);
    }

    fn m2l(&self, source: &Cell<T>, target: &Cell<T>, from: &[C], to: &mut [C]) {
        let mut scratch = Scratch::new(&self.harmonic);
        self.harmonic.m2l(Harmonic::<T>::shift(source.offset_to(target)), from, to, &mut scratch);
    }

    fn m2l_level(&self, level: &LevelPairs<'_, T>, multipoles: &[C], locals: &mut [C]) {
        self.harmonic.m2l_level(level, multipoles, locals);
    }

    fn l2l(&self, _parent: &Cell<T>, child: &Cell<T>, from: &[C], to: &mut [C]) {
        let mut scratch = Scratch::new(&self.harmonic);
        let centre = Harmonic::centre_in_parent(child);
        self.harmonic.l2l(centre, T::from_f64(0.5), from, to, &mut scratch);
    }

    fn l2p(&self, cell: &Cell<T>, local: &[C], targets: &[Point<T>], values: &mut [O::Value]) {
        self.evaluate(cell, local, targets, values, |x, out, gradients| {
            if O::GRADIENT {
                self.harmonic.regular_gradient(x, out, gradients);
            } else {
                self.harmonic.regular(x, out);
            }
        });
    }

    fn m2p(
        &self,
        cell: &Cell<T>,
        multipole: &[C],
        targets: &[Point<T>],
        values: &mut [O::Value],
    ) -> Outcome {
        self.evaluate(cell, multipole, targets, values, |x, out, gradients| {
            if O::GRADIENT {
                self.harmonic.singular_gradient(x, out, gradients);
            } else {
                self.harmonic.singular(x, out);
            }
        });
        Outcome::Done
    }

    fn p2l(&self, cell: &Cell<T>, sources: &[Point<T>], charges: &[C], local: &mut [C]) -> Outcome {
        self.moments(cell, sources, charges, local, |y, out| self.harmonic.singular(y, out));
        Outcome::Done
    }
}

/// Rounding errors of a sum, in units of the machine epsilon.
const ROUNDING: f64 = 64.0;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exponent::{MinusFour, MinusOne, MinusTwo, PlusTwo};
    use crate::power_law::InverseDistance;
    use farfield::conformance::{self, Samples};
    use farfield::{Cube, Fmm, Interpolation, Numbers, Scheme, direct, relative_l2_error};
    use farfield_testing::clouds;
    use glam::{DVec3, Vec3};

    /// Points in [−1, 1]³.
    fn points(n: usize, seed: u64) -> Vec<DVec3> {
        clouds::cube(n, seed).into_iter().map(|p| 2.0 * p - 1.0).collect()
    }

    /// Error of the field of one cell in another, by M2L and by M2P.
    fn pair_error<E: Exponent, O: Output<f64, f64>>(
        expansion: &HarmonicExpansion<E, f64, f64, O>,
        offset: [u32; 3],
    ) -> [f64; 2] {
        let root = Cube::new(DVec3::splat(0.7), 2.0);
        let [source, target] = [[0; 3], offset].map(|c| Cell::new(&root, 3, c.map(u64::from)));
        let inside = |cell: &Cell<f64>, seed| -> Vec<DVec3> {
            let inside = |p| cell.centre() + p * cell.half_width();
            points(200, seed).into_iter().map(inside).collect()
        };
        let (ys, xs) = (inside(&source, 1), inside(&target, 2));
        let qs: Vec<_> = points(200, 3).iter().map(|p| p.x.abs()).collect();
        let exact = direct(expansion.kernel(), &ys, &qs, &xs).unwrap();

        let mut multipole = vec![0.0; expansion.multipole_len(3)];
        expansion.p2m(&source, &ys, &qs, &mut multipole);
        let mut local = vec![0.0; expansion.local_len(3)];
        expansion.m2l(&source, &target, &multipole, &mut local);
        let mut by_local = vec![O::Value::zero(); xs.len()];
        expansion.l2p(&target, &local, &xs, &mut by_local);
        let mut by_multipole = vec![O::Value::zero(); xs.len()];
        assert_eq!(expansion.m2p(&source, &multipole, &xs, &mut by_multipole), Outcome::Done);
        [by_local, by_multipole].map(|values| relative_l2_error(&values, &exact))
    }

    #[test]
    fn tolerances_are_met_by_the_nearest_pair() {
        fn check<E: Exponent, O: Output<f64, f64>>(kernel: PowerLaw<E, f64, f64, O>) {
            for tolerance in [0.1, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10] {
                let expansion = HarmonicExpansion::with_tolerance(kernel, tolerance);
                // What is out of reach for steep kernels is met as far as it is offered.
                let (expansion, tolerance) = match expansion {
                    Err(Error::UnreachableTolerance { requested, reachable }) => {
                        let least = if O::GRADIENT { 4e-8 } else { 4e-10 };
                        assert!(E::LAMBDA > 0.5 && requested < reachable && reachable < least);
                        let offered = HarmonicExpansion::with_tolerance(kernel, reachable);
                        (offered.unwrap(), reachable)
                    }
                    expansion => (expansion.unwrap(), tolerance),
                };
                let errors = pair_error(&expansion, [2, 0, 0]);
                assert!(errors.iter().all(|&e| e < tolerance), "{kernel:?}: {errors:?}");
            }
        }
        check(PowerLaw::<MinusOne, f64>::new());
        check(PowerLaw::<MinusTwo, f64>::new());
        check(PowerLaw::<MinusFour, f64>::new());
        check(PowerLaw::<PlusTwo, f64>::new());
        check(PowerLaw::<MinusOne, f64>::new().with_gradient());
        check(PowerLaw::<MinusTwo, f64>::new().with_gradient());
        check(PowerLaw::<MinusFour, f64>::new().with_gradient());
        check(PowerLaw::<PlusTwo, f64>::new().with_gradient());
    }

    #[test]
    fn the_laws_of_expansions_hold() {
        fn check<E: Exponent>(order: usize, bound: f64) {
            let kernel = PowerLaw::<E, f64>::new().with_gradient();
            let samples = Samples {
                source: |p: DVec3, _| p,
                target: |p: DVec3, _| p,
                charge: |i| 1.0 - 0.3 * i as f64,
            };
            let expansion = HarmonicExpansion::new(kernel, order).unwrap();
            conformance::check(expansion, &samples, bound).unwrap();
            // The same kernel through the engine's own expansion, gradients included.
            conformance::check(Interpolation::new(kernel).order(8), &samples, 1e-2).unwrap();
            let kernel = PowerLaw::<E, f64>::new();
            conformance::check_kernel(&kernel, &samples, 1e-14).unwrap();
        }
        check::<MinusOne>(12, 1e-3);
        check::<MinusTwo>(12, 1e-3);
        check::<MinusFour>(12, 1e-3);
        check::<PlusTwo>(2, 1e-12);
    }

    #[test]
    fn the_number_of_threads_does_not_matter() {
        let points = points(3000, 13);
        let charges: Vec<_> = points.iter().map(|p| p.z).collect();
        let sums = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let expansion = HarmonicExpansion::new(InverseDistance::<f64>::new(), 5).unwrap();
                let plan = Fmm::with_expansion(expansion).leaf_size(20);
                plan.build(&points, &points).unwrap().apply(&charges).unwrap()
            })
        };
        assert_eq!(sums(1), sums(5));
    }

    #[test]
    fn high_orders_reach_rounding() {
        let expansion = HarmonicExpansion::new(PowerLaw::<MinusFour, f64>::new(), 40).unwrap();
        assert!(pair_error(&expansion, [2, 2, 1])[0] < 1e-14);
        let expansion = HarmonicExpansion::new(InverseDistance::<f64>::new(), 40).unwrap();
        assert!(pair_error(&expansion, [2, 2, 1])[0] < 1e-14);
    }

    #[test]
    fn whole_sums_in_every_scheme() {
        fn check<E: Exponent>() {
            let points = points(700, 5);
            let charges: Vec<_> = points.iter().map(|p| [p.y, 1.0 + p.z]).collect();
            let kernel = PowerLaw::<E, f64>::new().charges::<[f64; 2]>().with_gradient();
            let exact = direct(&kernel, &points, &charges, &points).unwrap();
            for scheme in
                [Scheme::Fmm, Scheme::Treecode { m2m: true }, Scheme::Treecode { m2m: false }]
            {
                let expansion = HarmonicExpansion::with_tolerance(kernel, 1e-3).unwrap();
                let plan = Fmm::with_expansion(expansion).scheme(scheme).leaf_size(15);
                let values = plan.build(&points, &points).unwrap().apply(&charges).unwrap();
                let error = relative_l2_error(&values, &exact);
                assert!(error < 1e-3, "{kernel:?} {scheme:?}: {error:e}");
            }
        }
        check::<MinusOne>();
        check::<MinusTwo>();
        check::<MinusFour>();
        check::<PlusTwo>();
    }

    #[test]
    fn the_scale_does_not_matter() {
        for scale in [1e-150, 1.0, 1e150] {
            let points: Vec<_> = points(600, 7).into_iter().map(|p| p * scale).collect();
            let charges = vec![1.0; 600];
            let kernel = InverseDistance::<f64>::new();
            let exact = direct(&kernel, &points, &charges, &points).unwrap();
            let expansion = HarmonicExpansion::new(kernel, 20).unwrap();
            let plan = Fmm::with_expansion(expansion).leaf_size(10);
            let values = plan.build(&points, &points).unwrap().apply(&charges).unwrap();
            // Squares of the values overflow.
            let scaled = |u: Vec<f64>| u.iter().map(|u| u * scale).collect::<Vec<_>>();
            assert!(relative_l2_error(&scaled(values), &scaled(exact)) < 1e-9, "{scale:e}");
        }
    }

    #[test]
    fn single_precision_reaches_its_rounding() {
        let points: Vec<Vec3> = points(1000, 9).into_iter().map(|p| p.as_vec3()).collect();
        let kernel = InverseDistance::<f32>::new();
        let exact = direct(&kernel, &points, &vec![1.0; 1000], &points).unwrap();
        let expansion = HarmonicExpansion::with_tolerance(kernel, 1e-5).unwrap();
        let plan = Fmm::with_expansion(expansion).leaf_size(10);
        let values = plan.build(&points, &points).unwrap().apply(&vec![1.0; 1000]).unwrap();
        assert!(relative_l2_error(&values, &exact) < 1e-6);
    }

    #[test]
    fn refusals() {
        let kernel = InverseDistance::<f32>::new();
        let order =
            |tolerance| HarmonicExpansion::with_tolerance(kernel, tolerance).map(|e| e.order());
        for found in [0.0, 1.0, -1.0, f64::INFINITY] {
            assert_eq!(order(found), Err(Error::InvalidTolerance { found }));
        }
        assert!(matches!(order(f64::NAN), Err(Error::InvalidTolerance { .. })));
        assert!(matches!(order(1e-9), Err(Error::UnreachableTolerance { .. })));
        let refused = HarmonicExpansion::new(kernel, 57).map(|e| e.order());
        assert_eq!(refused, Err(Error::InvalidOrder { min: 0, max: 56, found: 57 }));
    }
}

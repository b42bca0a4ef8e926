//! The expansion of the radiosity kernel in 16 moments per harmonic of 1/r⁴.

use farfield::{Cell, Costs, Error, Expansion, Located, Numbers, Outcome, Point, Real, Vector};
use farfield_potentials::harmonic::{Harmonic, Scratch};

use crate::elements::Surfel;
use crate::expansion::irradiance::Irradiance;
use crate::expansion::moments::{receiver_matrix, shifted, source_matrix};

/// The expansion of the *signed* irradiance kernel in 16 moments per harmonic.
///
/// The numerator separates exactly, and 1/r⁴ is the power law λ = 2 of
/// [`harmonic`](farfield_potentials::harmonic):
///
/// ```text
/// π K(x, y) = [n_y·(x − y)] [n_x·(y − x)] / |x − y|⁴ = Σ_c RM_c(x) SM_c(y) · Σ_k S_k(x) R_k(y)
///
///             c = ij (9)     c = i (3)          c = j (3)         c = 0 (1)
/// SM_c(y)     n_yi y_j       n_yi               (y·n_y) y_j       y·n_y          source matrix
/// RM_c(x)     x_i n_xj       −(x·n_x) x_i       −n_xj             x·n_x          receiver matrix
/// ```
///
/// Moments are M_kc = Σ_y R_k(y) SM_c(y) A_y q, local terms the same with S_k. A shift of origin acts
/// on k by the translations of the harmonics and on c by a sparse 16 × 16 matrix TM, independently.
/// With all lengths in units of a cell's half-width h, K is h⁻² times its value in those units.
///
/// At grazing angles the products are much larger than their sum, so that digits cancel.
/// [`Interpolation`](farfield::Interpolation) of the same kernel does not lose them, and needs 3 moments
/// instead of 16. To expand the clamped kernel, combine it with a mask that lets expansions act only
/// between cells that face each other entirely, such as [`Facing`](crate::Facing).
#[derive(Clone, Debug)]
pub struct SixteenMoment<T, C = T> {
    kernel: Irradiance<T, C>,
    harmonic: Harmonic<T>,
}

impl<T: Real, C> SixteenMoment<T, C> {
    /// The expansion with 1/r⁴ to degree `order`, at most
    /// [`MAX_ORDER`](farfield_potentials::harmonic::MAX_ORDER): 16 (p+1)(p+2)(p+3)/6 terms.
    ///
    /// # Errors
    /// [`Error::InvalidOrder`].
    pub fn new(kernel: Irradiance<T, C>, order: usize) -> Result<Self, Error> {
        Ok(Self { kernel, harmonic: Harmonic::new(2.0, order)? })
    }

    /// The expansion whose order is chosen so that sums have a relative l2 error of at most about
    /// `tolerance`.
    ///
    /// # Errors
    /// [`Error::InvalidTolerance`] unless 0 < `tolerance` < 1; [`Error::UnreachableTolerance`] if the
    /// precision or the [highest order](farfield_potentials::harmonic::MAX_ORDER) doesn't suffice.
    pub fn with_tolerance(kernel: Irradiance<T, C>, tolerance: f64) -> Result<Self, Error> {
        let rounding = ROUNDING * T::epsilon().as_f64();
        let error = |order| predicted_error(order).max(rounding);
        Self::new(kernel, Harmonic::<T>::order_for(tolerance, 2, error)?)
    }

    /// The order p of the harmonics.
    pub fn order(&self) -> usize {
        self.harmonic.order()
    }
}

/// An upper bound of the error of whole sums, fitted to those over cubes and spheres: at first
/// it falls with what far cells send, at last with what the corners of the nearest do.
fn predicted_error(order: usize) -> f64 {
    let p = order as i32;
    (0.6 * 0.38f64.powi(p)).max(0.05 * 0.55f64.powi(p))
}

/// Rounding errors of a sum, in units of the machine epsilon: products of the numerator cancel.
const ROUNDING: f64 = 1024.0;

impl<T: Real, C: Numbers<Real = T>> SixteenMoment<T, C> {
    /// Adds Σ_y F_k(y) SM_c(y) A_y q, F regular or singular.
    fn moments(
        &self,
        cell: &Cell<T>,
        sources: &[Surfel<T>],
        charges: &[C],
        terms: &mut [[C; 16]],
        basis: impl Fn(Point<T>, &mut [T]),
    ) {
        let mut functions = vec![T::from_f64(0.0); self.harmonic.len()];
        for (surfel, q) in sources.iter().zip(charges) {
            let y = cell.normalised(surfel.position());
            let matrix = source_matrix(y.to_array(), surfel.normal.to_array());
            let mut moments = <[C; 16]>::zero();
            for (moment, sm) in moments.iter_mut().zip(matrix) {
                moment.add_scaled(sm * surfel.area, q);
            }
            basis(y, &mut functions);
            for (&function, term) in functions.iter().zip(terms.iter_mut()) {
                term.add_scaled(function, &moments);
            }
        }
    }

    /// Adds (π h²)⁻¹ Σ_c RM_c(x) Σ_k F_k(x) A_kc, F regular or singular.
    fn evaluate(
        &self,
        cell: &Cell<T>,
        terms: &[[C; 16]],
        targets: &[Surfel<T>],
        values: &mut [C],
        basis: impl Fn(Point<T>, &mut [T]),
    ) {
        let h = cell.half_width();
        let unit = T::FRAC_1_PI() / h / h;
        let mut functions = vec![T::from_f64(0.0); self.harmonic.len()];
        for (surfel, value) in targets.iter().zip(values) {
            let x = cell.normalised(surfel.position());
            basis(x, &mut functions);
            let mut sums = <[C; 16]>::zero();
            for (&function, term) in functions.iter().zip(terms) {
                sums.add_scaled(function, term);
            }
            let matrix = receiver_matrix(x.to_array(), surfel.normal.to_array());
            for (rm, sum) in matrix.into_iter().zip(&sums) {
                value.add_scaled(unit * rm, sum);
            }
        }
    }
}

impl<T: Real, C: Numbers<Real = T>> Expansion for SixteenMoment<T, C> {
    type Kernel = Irradiance<T, C>;
    type MultipoleTerm = [C; 16];
    type LocalTerm = [C; 16];

    fn kernel(&self) -> &Irradiance<T, C> {
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
        let leaf_seconds = Some(self.harmonic.leaf_seconds(16 * C::LEN));
        Costs { leaf_seconds, ..Costs::new(terms, terms) }
    }

    fn p2m(&self, cell: &Cell<T>, sources: &[Surfel<T>], charges: &[C], multipole: &mut [[C; 16]]) {
        self.moments(cell, sources, charges, multipole, |y, out| self.harmonic.regular(y, out));
    }

    fn m2m(&self, child: &Cell<T>, _parent: &Cell<T>, from: &[[C; 16]], to: &mut [[C; 16]]) {
        let (shift, half) = (Harmonic::centre_in_parent(child), T::from_f64(0.5));
        let from = shifted(from, half, shift.to_array());
        let mut scratch = Scratch::new(&self.harmonic);
        self.harmonic.m2m(shift, half, &from, to, &mut scratch);
    }

    fn m2l(&self, source: &Cell<T>, target: &Cell<T>, from: &[[C; 16]], to: &mut [[C; 16]]) {
        // RM(x + t)·SM(y) depends on x + t − y alone, so it is RM(x)·SM(y − t).
        let shift = Harmonic::<T>::shift(source.offset_to(target));
        let from = shifted(from, T::from_f64(1.0), shift.to_array().map(|t| -t));
        let mut scratch = Scratch::new(&self.harmonic);
        self.harmonic.m2l(shift, &from, to, &mut scratch);
    }

    fn l2l(&self, _parent: &Cell<T>, child: &Cell<T>, from: &[[C; 16]], to: &mut [[C; 16]]) {
        // RM(s x + t)·SM(y) = s² RM(x)·SM((y − t)/s), and h⁻² turns into s² h⁻² in the child: s⁴ in all,
        // which is what `Harmonic::l2l` multiplies by.
        let (shift, half) = (Harmonic::centre_in_parent(child), T::from_f64(0.5));
        let two = T::from_f64(2.0);
        let from = shifted(from, two, shift.to_array().map(|t| -two * t));
        let mut scratch = Scratch::new(&self.harmonic);
        self.harmonic.l2l(shift, half, &from, to, &mut scratch);
    }

    fn l2p(&self, cell: &Cell<T>, local: &[[C; 16]], targets: &[Surfel<T>], values: &mut [C]) {
        self.evaluate(cell, local, targets, values, |x, out| self.harmonic.regular(x, out));
    }

    fn m2p(
        &self,
        cell: &Cell<T>,
        multipole: &[[C; 16]],
        targets: &[Surfel<T>],
        values: &mut [C],
    ) -> Outcome {
        self.evaluate(cell, multipole, targets, values, |x, out| self.harmonic.singular(x, out));
        Outcome::Done
    }

    fn p2l(
        &self,
        cell: &Cell<T>,
        sources: &[Surfel<T>],
        charges: &[C],
        local: &mut [[C; 16]],
    ) -> Outcome {
        self.moments(cell, sources, charges, local, |y, out| self.harmonic.singular(y, out));
        Outcome::Done
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use farfield::conformance::{self, Samples};
    use farfield::{Cube, Fmm, Numbers, Scheme, direct, relative_l2_error};
    use farfield_testing::clouds::Random;
    use glam::DVec3;

    /// Surfels in a cell with random positions and normals.
    fn surfels(random: &mut Random, cell: &Cell<f64>, n: usize) -> Vec<Surfel> {
        let surfel = |_| Surfel {
            position: cell.centre() + (2.0 * random.in_cube() - 1.0) * cell.half_width(),
            normal: random.direction(),
            area: random.between(0.5, 2.5),
            face: Surfel::<f64>::NO_FACE,
        };
        (0..n).map(surfel).collect()
    }

    #[test]
    fn the_numerator_separates_exactly() {
        let random = &mut Random::new(1);
        for _ in 0..20 {
            let [x, y, t]: [DVec3; 3] = std::array::from_fn(|_| 2.0 * random.in_cube() - 1.0);
            let [nx, ny] = [random.direction(), random.direction()];
            let source = source_matrix(y.to_array(), ny.to_array());
            let receiver = receiver_matrix(x.to_array(), nx.to_array());
            let separated: f64 = receiver.iter().zip(&source).map(|(r, s)| r * s).sum();
            assert_relative_eq!(separated, ny.dot(x - y) * nx.dot(y - x), epsilon = 1e-14);

            let moved = shifted(&[source], 0.5, t.to_array());
            let expected = source_matrix((y * 0.5 + t).to_array(), ny.to_array());
            for (found, expected) in moved[0].iter().zip(expected) {
                assert_relative_eq!(*found, expected, epsilon = 1e-14);
            }
        }
    }

    /// Relative Frobenius error of M2L between unit cells at `offset`, over random positions and
    /// normals. (The error of single sums scatters tenfold, since random normals cancel in them.)
    fn pair_error(order: usize, offset: [u32; 3]) -> f64 {
        let root = Cube::new(DVec3::splat(3.0), 4.0);
        // One column per source keeps their fields apart.
        let expansion = SixteenMoment::new(Irradiance::<f64, [f64; 20]>::signed(), order).unwrap();
        let [source, target] = [[0, 0, 0], offset].map(|c| Cell::new(&root, 3, c.map(u64::from)));
        let random = &mut Random::new(7);
        let (mut found, mut exact) = (Vec::new(), Vec::new());
        for _ in 0..20 {
            let (ys, xs) = (surfels(random, &source, 20), surfels(random, &target, 400));
            let qs: Vec<[f64; 20]> = (0..20)
                .map(|j| std::array::from_fn(|i| if i == j { 1.0 / ys[j].area } else { 0.0 }))
                .collect();
            let mut multipole = vec![Numbers::zero(); expansion.multipole_len(3)];
            expansion.p2m(&source, &ys, &qs, &mut multipole);
            let mut local = vec![Numbers::zero(); expansion.local_len(3)];
            expansion.m2l(&source, &target, &multipole, &mut local);
            let mut values = vec![Numbers::zero(); xs.len()];
            expansion.l2p(&target, &local, &xs, &mut values);
            found.extend(values);
            exact.extend(direct(expansion.kernel(), &ys, &qs, &xs).unwrap());
        }
        relative_l2_error(&found, &exact)
    }

    #[test]
    fn errors_of_one_pair_of_unit_cells() {
        // Measured for sums over one set of charges, some two to three times the error of the matrix.
        for (order, offset, of_sums) in [
            (4, [2, 0, 0], 6.9e-2),
            (4, [2, 2, 1], 1.9e-2),
            (6, [2, 0, 0], 2.0e-2),
            (6, [2, 2, 1], 2.0e-3),
            (8, [2, 0, 0], 5.0e-3),
            (8, [2, 2, 1], 2.9e-4),
        ] {
            let error = pair_error(order, offset);
            let expected = of_sums / 4.0..of_sums;
            assert!(expected.contains(&error), "p = {order}, {offset:?}: {error:e}");
        }
    }

    #[test]
    fn the_laws_of_expansions_hold() {
        let surfel = |position: DVec3, i: usize| {
            let normal = DVec3::new(1.0, (i as f64).sin(), (2.0 * i as f64).cos()).normalize();
            Surfel { position, normal, area: 1.0 + i as f64, face: Surfel::<f64>::NO_FACE }
        };
        let samples = Samples { source: surfel, target: surfel, charge: |i| [1.0, i as f64] };
        let expansion = SixteenMoment::new(Irradiance::signed(), 10).unwrap();
        conformance::check(expansion, &samples, 1e-2).unwrap();
    }

    #[test]
    fn shifts_between_levels_are_exact() {
        let root = Cube::new(DVec3::splat(-2.0), 3.0);
        let expansion = SixteenMoment::new(Irradiance::<f64>::signed(), 6).unwrap();
        let parent = Cell::new(&root, 2, [3, 0, 2]);
        let random = &mut Random::new(3);
        for octant in 0..8u32 {
            let coordinates = [6 + (octant & 1), octant >> 1 & 1, 4 + (octant >> 2)];
            let child = Cell::new(&root, 3, coordinates.map(u64::from));
            let surfels = surfels(random, &child, 5);
            let zeros = || vec![<[f64; 16]>::zero(); expansion.multipole_len(3)];

            let [mut of_child, mut of_parent, mut expected] = [zeros(), zeros(), zeros()];
            expansion.p2m(&child, &surfels, &[1.0, -2.0, 3.0, 0.5, 1.0], &mut of_child);
            expansion.p2m(&parent, &surfels, &[1.0, -2.0, 3.0, 0.5, 1.0], &mut expected);
            expansion.m2m(&child, &parent, &of_child, &mut of_parent);
            assert!(relative_l2_error(&of_parent, &expected) < 1e-14);

            let local: Vec<_> =
                zeros().iter().map(|t| t.map(|_| random.between(-1.0, 1.0))).collect();
            let mut of_child = zeros();
            expansion.l2l(&parent, &child, &local, &mut of_child);
            let [mut values, mut expected] = [vec![0.0; 5], vec![0.0; 5]];
            expansion.l2p(&child, &of_child, &surfels, &mut values);
            expansion.l2p(&parent, &local, &surfels, &mut expected);
            assert!(relative_l2_error(&values, &expected) < 1e-13);
        }
    }

    #[test]
    fn multipoles_at_points_and_locals_of_points() {
        let root = Cube::new(DVec3::ZERO, 1e-3);
        let expansion = SixteenMoment::new(Irradiance::<f64>::signed(), 12).unwrap();
        let [source, target] =
            [[0, 0, 0], [3, 3, 2]].map(|coordinates| Cell::new(&root, 2, coordinates));
        let random = &mut Random::new(5);
        let (ys, xs) = (surfels(random, &source, 30), surfels(random, &target, 30));
        let qs = vec![1.0; 30];
        let exact = direct(expansion.kernel(), &ys, &qs, &xs).unwrap();
        let zeros = || vec![<[f64; 16]>::zero(); expansion.multipole_len(2)];

        let (mut multipole, mut values) = (zeros(), vec![0.0; 30]);
        expansion.p2m(&source, &ys, &qs, &mut multipole);
        assert_eq!(expansion.m2p(&source, &multipole, &xs, &mut values), Outcome::Done);
        assert!(relative_l2_error(&values, &exact) < 1e-5);

        let (mut local, mut values) = (zeros(), vec![0.0; 30]);
        assert_eq!(expansion.p2l(&target, &ys, &qs, &mut local), Outcome::Done);
        expansion.l2p(&target, &local, &xs, &mut values);
        assert!(relative_l2_error(&values, &exact) < 1e-5);
    }

    #[test]
    fn whole_sums_in_every_scheme() {
        let root = Cube::new(DVec3::splat(1e4), 2.0);
        let random = &mut Random::new(11);
        let surfels = surfels(random, &Cell::new(&root, 0, [0; 3]), 1500);
        let charges: Vec<_> = surfels.iter().map(|_| [random.between(0.0, 2.0), 1.0]).collect();
        let kernel = Irradiance::<f64, [f64; 2]>::signed();
        let exact = direct(&kernel, &surfels, &charges, &surfels).unwrap();
        for scheme in [Scheme::Fmm, Scheme::Treecode { m2m: true }, Scheme::Treecode { m2m: false }]
        {
            let expansion = SixteenMoment::new(kernel, 8).unwrap();
            let plan = Fmm::with_expansion(expansion).scheme(scheme).leaf_size(20);
            let values = plan.build(&surfels, &surfels).unwrap().apply(&charges).unwrap();
            let error = relative_l2_error(&values, &exact);
            assert!(error < 1e-4, "{scheme:?}: {error:e}");
        }
    }

    #[test]
    fn tolerances_are_met_or_refused() {
        let root = Cube::new(DVec3::ZERO, 1.0);
        let random = &mut Random::new(13);
        let cube = surfels(random, &Cell::new(&root, 0, [0; 3]), 1500);
        let inwards = |surfel: &Surfel| {
            let normal = -surfel.position.normalize();
            Surfel { position: -normal, normal, ..*surfel }
        };
        let sphere: Vec<Surfel> = cube.iter().map(inwards).collect();
        let kernel = Irradiance::<f64>::signed();
        for (cloud, surfels) in [("cube", cube), ("sphere", sphere)] {
            // All of one sign: on a sphere, nothing but their sum arrives.
            let charges: Vec<f64> = surfels.iter().map(|_| random.between(0.5, 2.5)).collect();
            let exact = direct(&kernel, &surfels, &charges, &surfels).unwrap();
            for tolerance in [0.3, 1e-1, 1e-2, 1e-3, 1e-4, 1e-6] {
                let expansion = SixteenMoment::with_tolerance(kernel, tolerance).unwrap();
                let order = expansion.order();
                let plan = Fmm::with_expansion(expansion).leaf_size(20);
                let values = plan.build(&surfels, &surfels).unwrap().apply(&charges).unwrap();
                let error = relative_l2_error(&values, &exact);
                assert!(error <= tolerance, "{cloud}, order {order}: {error:e} for {tolerance:e}");
            }
        }
        let refused = SixteenMoment::with_tolerance(Irradiance::<f32>::signed(), 1e-6);
        let Err(Error::UnreachableTolerance { reachable, .. }) = refused else { panic!() };
        assert!(SixteenMoment::with_tolerance(Irradiance::<f32>::signed(), reachable).is_ok());
        let invalid = SixteenMoment::with_tolerance(kernel, 1.0);
        assert!(matches!(invalid, Err(Error::InvalidTolerance { .. })));
    }
}

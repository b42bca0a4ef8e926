//! Sums whose terms cancel, or differ by more than all digits.

use farfield::{
    Cell, Cube, Expansion, Fmm, Geometry, Interpolation, Level, Numbers, Sampling, direct, from_fn,
    relative_l2_error,
};
use farfield_potentials::harmonic::Harmonic;
use farfield_potentials::{
    HarmonicExpansion, InverseDistance, SquaredDistance, squared_distance_sum,
};
use farfield_radiosity::{Irradiance, SixteenMoment, Surfel};
use farfield_testing::clouds::{self, Random, charges};
use glam::DVec3;

use crate::table::row;
use crate::{Formula, build, error, plain};

#[test]
fn far_from_the_origin_squared_distances_keep_their_digits() {
    let origin = DVec3::new(1e8, -1e8, 1e8);
    let points: Vec<DVec3> = clouds::cube(600, 1).iter().map(|p| *p + origin).collect();
    let charges: Vec<f64> = charges(600, 2).iter().map(|q| q.abs()).collect();
    let kernel = SquaredDistance::<f64>::new();
    let exact = direct(&kernel, &points, &charges, &points).unwrap();
    // |x|² Σ q − 2 x·Σ y q + Σ |y|² q
    let total: f64 = charges.iter().sum();
    let first: DVec3 = points.iter().zip(&charges).map(|(y, &q)| *y * q).sum();
    let second: f64 = points.iter().zip(&charges).map(|(y, q)| y.length_squared() * q).sum();
    let expanded = |x: &DVec3| x.length_squared() * total - 2.0 * x.dot(first) + second;
    let naive: Vec<f64> = points.iter().map(expanded).collect();
    let naive = relative_l2_error(&naive, &exact);

    let expansion = HarmonicExpansion::new(kernel, 2).unwrap();
    let fmm = Fmm::with_expansion(expansion).leaf_size(10).build(&points, &points).unwrap();
    let ours = relative_l2_error(&fmm.apply(&charges).unwrap(), &exact);
    let separable = squared_distance_sum(&points, &charges, &points).unwrap();
    let separable = relative_l2_error(&separable, &exact);
    assert!(naive > 0.1 && ours < 1e-13 && separable < 1e-13, "{naive:e} {ours:e} {separable:e}");
    row(
        "Squared distance at offset 1e8",
        "|x|² − 2x·y + |y|² cancels all digits",
        format!("error {naive:.1}"),
        format!("{ours:.0e} by centred expansions, {separable:.0e} by the separable sum"),
    );
}

#[test]
fn cells_smaller_than_the_spacing_of_coordinates_keep_their_centres() {
    // Coordinates near 2^27 are multiples of 2^−26; centres of the smallest cells lie between them.
    let origin = DVec3::splat((1u64 << 27) as f64);
    let unit = 0.5f64.powi(26);
    let mut random = Random::new(1);
    let points: Vec<DVec3> = (0..600)
        .map(|_| origin + (random.in_cube() * 32.0).floor() * unit)
        .chain([origin, origin + DVec3::splat(31.0 * unit)])
        .collect();
    let charges: Vec<f64> = charges(602, 3).iter().map(|q| q.abs()).collect();
    let kernel = InverseDistance::<f64>::new();
    let exact = direct(&kernel, &points, &charges, &points).unwrap();
    let expansion = HarmonicExpansion::with_tolerance(kernel, 1e-6).unwrap();
    let fmm = Fmm::with_expansion(expansion).leaf_size(8).build(&points, &points).unwrap();
    let ours = relative_l2_error(&fmm.apply(&charges).unwrap(), &exact);

    // One cell seen from far away: its centre as a rounded number, the shift to its parent as an octant.
    let root = Cube::new(origin + DVec3::splat(15.5 * unit), 15.5 * unit);
    let [cell, parent] = [Cell::new(&root, 4, [5; 3]), Cell::new(&root, 3, [2; 3])];
    let ys: Vec<DVec3> = (0..8)
        .map(|k| {
            cell.centre()
                + DVec3::new(f64::from(k % 2), f64::from(k / 2 % 2), f64::from(k / 4)) * unit
        })
        .collect();
    let xs = [parent.centre() + DVec3::X * (40.0 * unit)];
    let harmonic = Harmonic::<f64>::new(0.5, 16).unwrap();
    let field = |place: &dyn Fn(DVec3) -> DVec3| {
        let mut scratch = farfield_potentials::harmonic::Scratch::new(&harmonic);
        let [mut functions, mut m, mut above] = [(); 3].map(|()| vec![0.0; harmonic.len()]);
        for y in &ys {
            harmonic.regular(place(*y), &mut functions);
            m.iter_mut().zip(&functions).for_each(|(m, f)| *m += f);
        }
        harmonic.m2m(DVec3::splat(0.5), 0.5, &m, &mut above, &mut scratch);
        harmonic.singular(parent.normalised(xs[0]), &mut functions);
        let sum: f64 = above.iter().zip(&functions).map(|(m, s)| m * s).sum();
        sum / parent.half_width()
    };
    let exact = direct(&kernel, &ys, &[1.0; 8], &xs).unwrap()[0];
    let rounded = field(&|y| (y - cell.centre()) / cell.half_width());
    let kept = field(&|y| cell.normalised(y));
    let [naive, exact_centre] = [rounded, kept].map(|u| (u / exact - 1.0).abs());
    assert!(
        ours < 1e-6 && exact_centre < 1e-9 && naive > 1e-3,
        "{ours:e} {exact_centre:e} {naive:e}"
    );
    row(
        "Cells as small as the spacing of coordinates",
        "a rounded centre is off by a part of the cell",
        format!("error {naive:.0e} of one cell"),
        format!("{exact_centre:.0e}; whole sums {ours:.0e} at tolerance 1e-6"),
    );
}

#[test]
fn neutral_cells_have_no_centre_of_charge_and_need_none() {
    let mut random = Random::new(4);
    let ys: Vec<DVec3> = (0..40).map(|_| random.in_cube() * 0.25).collect();
    let qs: Vec<f64> = (0..40).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
    let total: f64 = qs.iter().sum();
    let centre: DVec3 = ys.iter().zip(&qs).map(|(y, &q)| *y * q).sum::<DVec3>() / total;
    assert!(!centre.is_finite());

    let points = clouds::cube(1500, 5);
    let charges: Vec<f64> = (0..1500).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
    let kernel = InverseDistance::<f64>::new();
    let exact = direct(&kernel, &points, &charges, &points).unwrap();
    let expansion = HarmonicExpansion::with_tolerance(kernel, 1e-8).unwrap();
    let fmm = Fmm::with_expansion(expansion).leaf_size(10).build(&points, &points).unwrap();
    let ours = relative_l2_error(&fmm.apply(&charges).unwrap(), &exact);
    assert!(ours < 1e-8, "{ours:e}");
    row(
        "Neutral cells",
        "expansions about the centre of charge divide by Σq = 0",
        format!("centre at {centre}"),
        format!("error {ours:.0e} at tolerance 1e-8: centres are the cells'"),
    );
}

#[test]
fn what_cancels_is_certified() {
    // A lattice of alternating charges, as in salt.
    let n = 12;
    let points: Vec<DVec3> = (0..n * n * n)
        .map(|k| DVec3::new(f64::from(k % n), f64::from(k / n % n), f64::from(k / (n * n))))
        .collect();
    let charges: Vec<f64> =
        points.iter().map(|p| if p.element_sum() % 2.0 == 0.0 { 1.0 } else { -1.0 }).collect();
    let softened = |x: DVec3, y: DVec3| 1.0 / (3.0 + x.distance(y));
    let tolerance = 1e-6;
    let fmm = build(softened, tolerance, &points, &points).unwrap();
    let (values, certificate) = fmm.apply_certified(&charges).unwrap();
    let exact = direct(&plain(softened), &points, &charges, &points).unwrap();
    let error = relative_l2_error(&values, &exact);
    let backward = error / certificate.condition;
    assert!(certificate.condition > 100.0 && backward < tolerance, "{certificate:?}");
    assert!(error <= certificate.relative_l2, "{error:e} {certificate:?}");
    row(
        "Alternating charges",
        "a tolerance relative to Σ|K||q| is none relative to the sum",
        format!(
            "tolerance {tolerance:.0e} taken for the error of sums that are off by {error:.0e}"
        ),
        format!(
            "certified: error ≤ {:.0e}, condition {:.0}",
            certificate.relative_l2, certificate.condition
        ),
    );
}

#[test]
fn dipoles_made_of_pairs_keep_the_digits_of_expansions() {
    let mut random = Random::new(6);
    let (mut points, mut charges) = (Vec::new(), Vec::new());
    let gap = 1e-7;
    for _ in 0..700 {
        let p = random.in_cube();
        points.extend([p, p + random.direction() * gap]);
        charges.extend([1.0, -1.0]);
    }
    let targets: Vec<DVec3> = clouds::cube(500, 7).iter().map(|p| *p + DVec3::X * 1.5).collect();
    let exact = direct(&InverseDistance::<f64>::new(), &points, &charges, &targets).unwrap();
    // The charge of a cell at its centre of mass.
    let centre = points.iter().sum::<DVec3>() / points.len() as f64;
    let total: f64 = charges.iter().sum();
    let naive: Vec<f64> = targets.iter().map(|x| total / x.distance(centre)).collect();
    let naive = relative_l2_error(&naive, &exact);

    let expansion = HarmonicExpansion::with_tolerance(InverseDistance::<f64>::new(), 1e-6).unwrap();
    let fmm = Fmm::with_expansion(expansion).leaf_size(10).build(&points, &targets).unwrap();
    let (values, certificate) = fmm.apply_certified(&charges).unwrap();
    let ours = relative_l2_error(&values, &exact);
    assert!(certificate.condition > 1e5, "{certificate:?}");
    // Truncation cancels with the charges; rounding grows by the condition number.
    assert!(ours < 1e-6 * 100.0, "{ours:e}");
    row(
        "Dipoles of two charges 1e-7 apart",
        "the monopoles cancel, and all that is left is differences",
        format!("error {naive:.0e} of monopoles"),
        format!(
            "{ours:.0e} of a sum of condition {:.0e}, at tolerance 1e-6",
            certificate.condition
        ),
    );
}

/// Two cells far apart, in which surfels nearly lie in one plane.
struct Grazing {
    root: Cube<f64>,
    source: Cell<f64>,
    target: Cell<f64>,
}

impl Grazing {
    fn new() -> Self {
        let root = Cube::new(DVec3::ZERO, 8.0);
        let [source, target] = [[0; 3], [4, 3, 0]].map(|c| Cell::new(&root, 3, c));
        Self { root, source, target }
    }

    /// The expansion, ready for this pair of cells.
    fn prepared<E: Expansion<Kernel = Irradiance<f64, f64>>>(&self, mut expansion: E) -> E {
        let level = Level::new(3, 1.0, vec![[4, 3, 0]]);
        expansion.prepare(&Geometry::new(self.root, vec![level])).unwrap();
        expansion
    }

    /// Error of the signed radiosity kernel between surfels whose normals are tilted by up to `tilt`.
    fn error<E>(&self, expansion: &E, tilt: f64) -> f64
    where
        E: Expansion<Kernel = Irradiance<f64, f64>>,
    {
        let Self { source, target, .. } = self;
        let mut random = Random::new(8);
        let mut surfels = |cell: &Cell<f64>| -> Vec<Surfel> {
            let mut surfel = |_| Surfel {
                position: cell.centre()
                    + DVec3::new(random.between(-1.0, 1.0), random.between(-1.0, 1.0), 0.3),
                normal: DVec3::new(tilt * random.unit(), tilt * random.unit(), 1.0).normalize(),
                area: 1.0,
                face: Surfel::<f64>::NO_FACE,
            };
            (0..30).map(&mut surfel).collect()
        };
        let (ys, xs) = (surfels(source), surfels(target));
        let mut m = vec![Numbers::zero(); expansion.multipole_len(3)];
        expansion.p2m(source, &ys, &[1.0; 30], &mut m);
        let mut l = vec![Numbers::zero(); expansion.local_len(3)];
        expansion.m2l(source, target, &m, &mut l);
        let mut values = vec![0.0; 30];
        expansion.l2p(target, &l, &xs, &mut values);
        relative_l2_error(&values, &direct(expansion.kernel(), &ys, &[1.0; 30], &xs).unwrap())
    }
}

#[test]
fn grazing_angles_cost_what_the_numerator_cancels() {
    let cells = Grazing::new();
    let sixteen = cells.prepared(SixteenMoment::new(Irradiance::signed(), 16).unwrap());
    let tensor = cells.prepared(Interpolation::new(Irradiance::<f64>::signed()).order(6));
    let mut lines = Vec::new();
    for tilt in [1.0, 1e-2, 1e-4] {
        let [moments, components] = [cells.error(&sixteen, tilt), cells.error(&tensor, tilt)];
        // The truncated 1/r⁴ multiplies the exact numerator, which is rounded; a tensor's components are
        // truncated one by one.
        assert!(moments < 1e-12 + 1e-16 / (tilt * tilt), "{tilt:e}: {moments:e}");
        assert!(components < 1e-4 / (tilt * tilt), "{tilt:e}: {components:e}");
        lines.push(format!("{tilt:.0e}: {moments:.0e} and {components:.0e}"));
    }
    let lost = cells.error(&sixteen, 1e-8);
    assert!(lost > 1e-3, "{lost:e}");
    row(
        "Numerators at grazing angles",
        "products of size 1 cancel to the square of the angle",
        format!("angle 1e-8: error {lost:.0e} of either form"),
        format!(
            "16 moments and tensor by angle: {}; a loss of digits ∝ 1/angle² is their limit",
            lines.join("; ")
        ),
    );
}

#[test]
fn the_logarithm_of_the_unit_is_not_lost() {
    let logarithm = |x: DVec3, y: DVec3| x.distance(y).ln();
    let mut worst = 0.0f64;
    let mut naive = 0.0f64;
    for scale in [1e-6, 1.0, 1e6] {
        let points: Vec<DVec3> = clouds::cube(1200, 9).iter().map(|p| *p * scale).collect();
        let charges = vec![1.0; 1200];
        worst = worst.max(error(logarithm, 1e-3, &points, &charges).unwrap());
        // In units of the root: log(r/h), as if the kernel were of degree 0.
        let in_units = from_fn(move |x: DVec3, y: DVec3| (x.distance(y) / scale).ln());
        let in_units = in_units.skip_coincident();
        let exact = direct(&plain(logarithm), &points, &charges, &points).unwrap();
        let found = direct(&in_units, &points, &charges, &points).unwrap();
        naive = naive.max(relative_l2_error(&found, &exact));
    }
    assert!(worst < 1e-3 && naive > 0.9, "{worst:e} {naive:e}");
    row(
        "log r with Σq ≠ 0, extents of 1e-6 to 1e6",
        "log is not homogeneous: scaled operators lose Σq log h",
        format!("error {naive:.1}"),
        format!("{worst:.0e} at tolerance 1e-3"),
    );
}

#[test]
fn charges_of_any_size_are_carried() {
    let inverse = |x: DVec3, y: DVec3| 1.0 / x.distance(y);
    let points = clouds::cube(1500, 10);
    let unit = charges(1500, 11);
    let mut worst = 0.0f64;
    // Loose tolerances, for which M2L works in single precision.
    let fmm = build(inverse, 1e-3, &points, &points).unwrap();
    let drawn = Sampling { max_samples: 600, ..Sampling::default() };
    let certificates = |charges: &[f64]| {
        let (values, complete) = fmm.apply_certified(charges).unwrap();
        (values, [complete, fmm.apply_certified_by(charges, &drawn).unwrap().1])
    };
    let (_, usual) = certificates(&unit);
    for size in [1e-300, 1e-160, 1e-60, 1e-30, 1.0, 1e30, 1e60, 1e160, 1e300] {
        let charges: Vec<f64> = unit.iter().map(|q| q * size).collect();
        let (values, found) = certificates(&charges);
        let error = relative_l2_error(
            &values,
            &direct(&plain(inverse), &points, &charges, &points).unwrap(),
        );
        assert!(error < 1e-3, "{size:e}: {error:e}");
        worst = worst.max(error);
        for (found, usual) in found.iter().zip(&usual) {
            assert!(error <= (1.0 + 1e-6) * found.relative_l2, "{size:e}: {error:e} {found:?}");
            let off = [found.relative_l2 / usual.relative_l2, found.condition / usual.condition];
            assert!(off.iter().all(|off| (off - 1.0).abs() < 1e-2), "{size:e}: {found:?}");
        }
    }
    let squares = [1e-300f64, 1e300].map(|q| q * q);
    assert_eq!(squares, [0.0, f64::INFINITY]);
    // Both at once: the small ones are lost beside the large ones, as they are in the sum.
    let mixed: Vec<f64> = unit.iter().enumerate().map(|(i, q)| q * [1e30, 1e-30][i % 2]).collect();
    let mixed = error(inverse, 1e-3, &points, &mixed).unwrap();
    assert!(mixed < 1e-3, "{mixed:e}");
    let single = [1e-60f64, 1e60].map(|q| q as f32);
    assert_eq!(single, [0.0, f32::INFINITY]);
    row(
        "Charges of 1e-300 to 1e300, and of 1e±30 at once",
        "intermediate results in single precision end at 1e±38, squares by which errors are told at 1e±154",
        "1e-60 becomes 0, 1e60 infinite; squares of 1e-300 and 1e300 are 0 and infinite",
        format!(
            "error {worst:.0e} at tolerance 1e-3, the certificate's bound the same at every size; \
             {mixed:.0e} for both at once"
        ),
    );
}

#[test]
fn kernels_of_any_size_are_carried() {
    let formulas: [(f64, Formula); 6] = [
        (1e-50, |x, y| 1e-50 / x.distance(y)),
        (1e50, |x, y| 1e50 / x.distance(y)),
        (1e-170, |x, y| 1e-170 / x.distance(y)),
        (1e170, |x, y| 1e170 / x.distance(y)),
        (1e-200, |x, y| 1e-200 * (-x.distance(y)).exp()),
        (1e200, |x, y| 1e200 * (-x.distance(y)).exp()),
    ];
    let points = clouds::cube(1500, 12);
    let unit = charges(1500, 13);
    let mut worst = 0.0f64;
    for (size, formula) in formulas {
        let charges: Vec<f64> = unit.iter().map(|q| q / size).collect();
        let error = error(formula, 1e-3, &points, &charges);
        let error = error.unwrap_or_else(|e| panic!("{size:e}: {e}"));
        assert!(error < 1e-3, "{size:e}: {error:e}");
        worst = worst.max(error);
    }
    let naive = [1e-50f64, 1e50].map(|k| k as f32);
    assert_eq!(naive, [0.0, f32::INFINITY]);
    let squares = [1e-170f64, 1e170].map(|k| k * k);
    assert_eq!(squares, [0.0, f64::INFINITY]);
    row(
        "Kernels of size 1e±50, 1e±200",
        "operators in single precision end at 1e±38, squares by which they are cut at 1e±154",
        format!("operators {naive:?}, squares {squares:?}"),
        format!("error {worst:.0e} at tolerance 1e-3"),
    );
}

//! The two far fields of radiosity, in 16 and in 3 moments, against direct sums: cell by cell, and
//! behind a mask.

use farfield::{
    Cell, Cube, Expansion, Fmm, Geometry, Interpolation, Level, Numbers, direct, direct_masked,
    relative_l2_error,
};
use farfield_radiosity::{Irradiance, Occluders, SixteenMoment, Surfel, Visibility};
use farfield_testing::clouds::Random;
use glam::DVec3;

use crate::radiosity::{bands, room_with_block};

/// Sources per cell, each with a column of its own, so that errors of single pairs don't cancel.
const SOURCES: usize = 20;

type Kernel = Irradiance<f64, [f64; SOURCES]>;

/// Relative Frobenius error, over random positions and normals, of the signed and unoccluded kernel
/// between two cells at integer distance `offset`.
fn pair_error(
    mut expansion: impl Expansion<Kernel = Kernel, MultipoleTerm: Numbers, LocalTerm: Numbers>,
    offset: [u32; 3],
) -> f64 {
    let root = Cube::new(DVec3::splat(2.0), 4.0);
    let [source, target] = [[0; 3], offset].map(|c| Cell::new(&root, 3, c.map(u64::from)));
    let offsets = vec![offset.map(|o| o as i32)];
    let levels = vec![Level::new(3, source.half_width(), offsets)];
    expansion.prepare(&Geometry::new(root, levels)).unwrap();
    let mut random = Random::new(5);
    let mut surfels = |cell: &Cell<f64>, n: usize| -> Vec<Surfel> {
        let mut surfel = || {
            let inside = random.in_cube() * 2.0 - DVec3::ONE;
            let position = cell.centre() + inside * cell.half_width();
            Surfel { position, normal: random.direction(), area: 1.0, face: Surfel::<f64>::NO_FACE }
        };
        (0..n).map(|_| surfel()).collect()
    };
    let charges: Vec<[f64; SOURCES]> =
        (0..SOURCES).map(|j| std::array::from_fn(|i| f64::from(u8::from(i == j)))).collect();
    let (mut found, mut exact) = (Vec::new(), Vec::new());
    for _ in 0..8 {
        let (ys, xs) = (surfels(&source, SOURCES), surfels(&target, 200));
        let mut multipole = vec![Numbers::zero(); expansion.multipole_len(3)];
        expansion.p2m(&source, &ys, &charges, &mut multipole);
        let mut local = vec![Numbers::zero(); expansion.local_len(3)];
        expansion.m2l(&source, &target, &multipole, &mut local);
        let mut values = vec![Numbers::zero(); xs.len()];
        expansion.l2p(&target, &local, &xs, &mut values);
        found.extend(values);
        exact.extend(direct(expansion.kernel(), &ys, &charges, &xs).unwrap());
    }
    relative_l2_error(&found, &exact)
}

/// The expected errors were measured independently on single sums with random normals, which scatter by
/// a few about those over all pairs; from one order to the next they fall by far more than that.
#[test]
fn both_far_fields_converge_as_expected() {
    let near = |p, expected: f64, error: f64| {
        println!("{p}: {error:.1e}, expected about {expected:.1e}");
        assert!(error < 3.0 * expected && error > 0.2 * expected, "{p}: {error:e}");
    };
    let expected = [(4, 6.9e-2, 1.9e-2), (6, 2.0e-2, 2.0e-3), (8, 5.0e-3, 2.9e-4)];
    for (p, close, diagonal) in expected {
        let expansion = || SixteenMoment::new(Kernel::signed(), p).unwrap();
        near(format!("16 moments, order {p}, (2,0,0)"), close, pair_error(expansion(), [2, 0, 0]));
        let error = pair_error(expansion(), [2, 2, 1]);
        near(format!("16 moments, order {p}, (2,2,1)"), diagonal, error);
    }
    let expected = [(4, 9.0e-3, 4.6e-4), (5, 1.8e-3, 1.0e-4), (6, 5.0e-4, 7.1e-6)];
    for (n, close, diagonal) in expected {
        let expansion = || Interpolation::new(Kernel::signed()).order(n);
        near(format!("3 moments, {n} nodes, (2,0,0)"), close, pair_error(expansion(), [2, 0, 0]));
        let error = pair_error(expansion(), [2, 2, 1]);
        near(format!("3 moments, {n} nodes, (2,2,1)"), diagonal, error);
    }
}

/// Behind a mask of facing and occlusion no pair is lost, whichever expansion carries the rest.
#[test]
fn clamped_and_occluded_sums_are_masked_direct_sums() {
    let scene = room_with_block(8);
    let surfels = &scene.surfels;
    let occluders = Occluders::new(&scene.triangles).unwrap();
    let charges = bands(surfels.len());
    let kernel = Irradiance::<f64, [f64; 3]>::clamped();
    let mask = Visibility::new(&occluders);
    let exact = direct_masked(&kernel, &mask, surfels, &charges, surfels).unwrap();
    let mut errors = Vec::new();
    for order in [2, 4, 6] {
        let builder = Fmm::with_expansion(SixteenMoment::new(kernel, order).unwrap()).mask(&mask);
        let fmm = builder.leaf_size(16).build(surfels, surfels).unwrap();
        assert!(fmm.report().stats.expansion_pairs > 0);
        errors.push(relative_l2_error(&fmm.apply(&charges).unwrap(), &exact));
    }
    println!("16 moments, masked: {errors:?}");
    assert!(errors[1] < 0.3 * errors[0] && errors[2] < 0.3 * errors[1] && errors[2] < 5e-4);
}

//! Furnaces, energy and walls, by the operator with its corrections.

use approx::assert_relative_eq;
use farfield::{Fmm, Mask};
use farfield_radiosity::{
    Corrections, Enclosure, Irradiance, Occluders, RadiosityOperator, Scene, Solution, Stop,
    Visibility, bicgstab, conjugate_gradients, energy_balance, furnace, jacobi, two_rooms,
};
use glam::DVec3;

const TIGHT: Stop = Stop { tolerance: 1e-10, max_iterations: 1000 };

type Rows<const BANDS: usize> = Vec<[f64; BANDS]>;

/// A cube with a turned block in mid-air.
fn room_with_block(n: usize) -> Scene {
    let mut scene = furnace(n);
    let turned = |[x, y]: [f64; 2], z: f64| {
        let (sin, cos) = 0.4f64.sin_cos();
        DVec3::new(0.45 + cos * x - sin * y, 0.55 + sin * x + cos * y, z)
    };
    let (low, high, m) = (0.3, 0.7, n.div_ceil(2));
    let base = [[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]];
    scene.add_quad(base.map(|corner| turned(corner, high)), m, m);
    let [a, b, c, d] = base.map(|corner| turned(corner, low));
    scene.add_quad([a, d, c, b], m, m);
    for k in 0..4 {
        let (from, to) = (base[k], base[(k + 1) % 4]);
        let side = [turned(from, low), turned(to, low), turned(to, high), turned(from, high)];
        scene.add_quad(side, m, m);
    }
    scene
}

/// A cube without its ceiling, which still hides nothing.
fn open_room(n: usize) -> Scene {
    let mut scene = furnace(n);
    scene.elements.retain(|element| element.surfel().face != 5);
    scene.surfels.retain(|surfel| surfel.face != 5);
    scene.triangles.retain(|triangle| triangle.face != 5);
    scene
}

/// The operator by a sum over all pairs of centroids that see each other, its pairs asked for once.
fn operator<const BANDS: usize>(
    scene: &Scene,
    tolerance: f64,
) -> RadiosityOperator<'static, BANDS> {
    let occluders = Occluders::new(&scene.triangles).unwrap();
    let mask = Visibility::new(&occluders);
    let kernel = Irradiance::<f64>::clamped();
    let row = |x| -> Vec<f64> {
        let entry = |y| {
            let visible = Mask::<Irradiance<f64>>::pair(&mask, x, y);
            visible * kernel.factor(x, y) * y.area
        };
        scene.surfels.iter().map(entry).collect()
    };
    let rows: Vec<Vec<f64>> = scene.surfels.iter().map(row).collect();
    let sum = move |b: &[[f64; BANDS]]| {
        let at = |row: &Vec<f64>, k: usize| row.iter().zip(b).map(|(f, b)| f * b[k]).sum();
        Ok(rows.iter().map(|row| std::array::from_fn(|k| at(row, k))).collect())
    };
    let corrections = Corrections::new(&scene.elements, &occluders, tolerance).unwrap();
    RadiosityOperator::new(&scene.elements, sum, corrections).unwrap()
}

fn largest_error(found: &[[f64; 2]], exact: [f64; 2]) -> f64 {
    let error = |b: &[f64; 2]| (0..2).map(|k| (b[k] / exact[k] - 1.0).abs()).fold(0.0, f64::max);
    found.iter().map(error).fold(0.0, f64::max)
}

/// The solution by each of the solvers.
fn solutions(
    scene: &Scene,
    operator: &RadiosityOperator<'_, 2>,
    emission: &Rows<2>,
    reflectance: &Rows<2>,
) -> [Solution<f64, 2>; 3] {
    let apply = |b: &[[f64; 2]]| operator.apply(b);
    let surfels = &scene.surfels;
    [
        jacobi(emission, reflectance, TIGHT, apply, |_, _| ()).unwrap(),
        conjugate_gradients(surfels, emission, reflectance, TIGHT, apply, |_, _| ()).unwrap(),
        bicgstab(emission, reflectance, TIGHT, apply, |_, _| ()).unwrap(),
    ]
}

#[test]
fn a_furnace_glows_evenly() {
    for (name, scene) in [("cube", furnace(5)), ("block", room_with_block(6))] {
        let n = scene.surfels.len();
        let (emission, reflectance) = (vec![[1.0, 2.0]; n], vec![[0.3, 0.9]; n]);
        let exact = [1.0 / 0.7, 2.0 / (1.0 - 0.9)];
        let mut operator = operator(&scene, 1e-3);
        let raw = solutions(&scene, &operator, &emission, &reflectance);
        let closure = operator.close(Enclosure::Closed, 0.5).unwrap();
        let closed = solutions(&scene, &operator, &emission, &reflectance);
        let before = raw.map(|s| largest_error(&s.radiosity, exact));
        for solution in &closed {
            let error = largest_error(&solution.radiosity, exact);
            assert!(error < 1e-5, "{name}: {error}");
        }
        if name == "cube" {
            // Exact factors close a convex room by themselves.
            assert!(before.iter().all(|&error| error < 5e-3), "{before:?}");
        } else {
            // Visibility by centroids doesn't, where something stands in the way.
            assert!(closure.largest > 0.01);
        }
    }
}

#[test]
fn what_is_absorbed_and_emitted_in_balance_makes_a_radiosity_of_one() {
    let scene = room_with_block(6);
    let mut operator = operator(&scene, 1e-3);
    operator.close(Enclosure::Closed, 0.5).unwrap();
    let rho = |i: usize| [0.1 * (i % 10) as f64, 0.05 + 0.15 * (i % 6) as f64];
    let reflectance: Rows<2> = (0..scene.surfels.len()).map(rho).collect();
    let emission: Rows<2> = reflectance.iter().map(|r| r.map(|rho| 1.0 - rho)).collect();
    for solution in solutions(&scene, &operator, &emission, &reflectance) {
        let error = largest_error(&solution.radiosity, [1.0; 2]);
        assert!(error < 1e-5, "{error}");
    }
}

#[test]
fn energy_is_absorbed_or_escapes() {
    for (scene, closed) in [(room_with_block(6), true), (open_room(6), false)] {
        let mut operator = operator(&scene, 1e-3);
        let enclosure = if closed { Enclosure::Closed } else { Enclosure::Open };
        operator.close(enclosure, 0.5).unwrap();
        let row_sums = operator.row_sums().unwrap();
        let surfels = &scene.surfels;
        let emission: Rows<2> =
            surfels.iter().map(|s| if s.face == 4 { [1.0, 3.0] } else { [0.0; 2] }).collect();
        let reflectance: Rows<2> =
            (0..surfels.len()).map(|i| [[0.2, 0.8], [0.0, 0.5], [0.6, 0.9]][i % 3]).collect();
        for solution in solutions(&scene, &operator, &emission, &reflectance) {
            let balance =
                energy_balance(surfels, &emission, &reflectance, &solution, &row_sums).unwrap();
            assert!(balance.residual().iter().all(|r| r.abs() < 1e-8), "{balance:?}");
            for k in 0..2 {
                assert_relative_eq!(balance.emitted[k], [1.0, 3.0][k], max_relative = 1e-12);
                let share = balance.escaped[k] / balance.emitted[k];
                assert!(if closed { share.abs() < 1e-4 } else { share > 0.2 }, "{share}");
            }
        }
    }
}

#[test]
fn no_light_passes_a_wall_of_no_thickness() {
    let scene = two_rooms(6);
    let half = scene.surfels.len() / 2;
    let emission: Rows<1> =
        (0..2 * half).map(|i| [if i < half { 1.0 + (i % 7) as f64 } else { 0.0 }]).collect();
    let reflectance = vec![[0.7]; 2 * half];
    let occluders = Occluders::new(&scene.triangles).unwrap();
    // Fast sums are in single precision where their order is low.
    let stop = Stop::default();
    let dark = |operator: &RadiosityOperator<'_, 1>| {
        let solution =
            jacobi(&emission, &reflectance, stop, |b| operator.apply(b), |_, _| ()).unwrap();
        assert!(solution.radiosity[..half].iter().all(|b| b[0] > 1.0));
        solution.radiosity[half..].iter().all(|b| b[0] == 0.0)
    };
    let exact = operator(&scene, 1e-3);
    assert!(dark(&exact));

    let fast = |mask: &Visibility<'_>| {
        let builder = Fmm::builder(Irradiance::<f64, [f64; 1]>::clamped()).mask(mask).order(4);
        builder.leaf_size(16).build(&scene.surfels, &scene.surfels).unwrap()
    };
    let sampled = Visibility::new(&occluders).fractional(0.1, vec![]).unwrap();
    for mask in [Visibility::new(&occluders), sampled] {
        let fmm = fast(&mask);
        let corrections = Corrections::new(&scene.elements, &occluders, 1e-2).unwrap();
        let mut operator =
            RadiosityOperator::new(&scene.elements, |b| fmm.apply(b), corrections).unwrap();
        assert!(dark(&operator));
        operator.close(Enclosure::Closed, 0.5).unwrap();
        assert!(dark(&operator), "closing moves no light through walls");
    }

    // The wall does it.
    let mut open = scene.clone();
    open.triangles.retain(|t| !t.vertices.iter().all(|v| v.x == 1.0));
    let passed = operator::<1>(&open, 1e-3).apply(&emission).unwrap();
    assert!(passed[half..].iter().map(|h| h[0]).sum::<f64>() > 10.0);
}

#[test]
fn form_factors_lie_between_zero_and_one_however_visibility_is_found() {
    // A closed corrugated band between floor and ceiling: grazing neighbours of all sizes, much of it hidden.
    let mut scene = furnace(6);
    let corner = |k: usize| {
        let (sin, cos) = (k as f64 * std::f64::consts::TAU / 24.0).sin_cos();
        let radius = if k.is_multiple_of(2) { 0.3 } else { 0.22 };
        DVec3::new(0.5 + radius * cos, 0.5 + radius * sin, 0.2)
    };
    for k in 0..24 {
        let [a, b] = [corner(k), corner(k + 1)];
        let up = DVec3::Z * 0.5;
        scene.add_quad([a, b, b + up, a + up], 2, 4);
        scene.add_quad([b, a, a + up, b + up], 2, 4);
    }
    let occluders = Occluders::new(&scene.triangles).unwrap();
    let kernel = Irradiance::<f64, [f64; 1]>::clamped();
    let of_elements = || Visibility::of_elements(&occluders, &scene.elements);
    for mask in [of_elements(), of_elements().fractional(0.3, vec![]).unwrap()] {
        let builder = Fmm::builder(kernel).mask(&mask).order(6).leaf_size(8);
        let fmm = builder.build(&scene.surfels, &scene.surfels).unwrap();
        let corrections = mask.corrections(&scene.elements, 0.3).unwrap();
        let operator =
            RadiosityOperator::new(&scene.elements, |b| fmm.apply(b), corrections).unwrap();
        assert!(operator.reciprocity_error().unwrap() < 1e-4);
        for (j, surfel) in scene.surfels.iter().enumerate() {
            let mut unit = vec![[0.0]; scene.surfels.len()];
            unit[j] = [1.0];
            for (h, receiver) in operator.apply(&unit).unwrap().iter().zip(&scene.surfels) {
                let most = (surfel.area / receiver.area).min(1.0);
                assert!(h[0] > -1e-3 * most, "{h:?}");
                assert!(h[0] < most * (1.0 + 1e-3), "{h:?} {most}");
            }
        }
    }
}

#[test]
fn the_two_sides_of_a_sheet_exchange_nothing() {
    // One over the other, from faces of their own and of one face, turned so that rounding shows.
    let along = DVec3::new(0.798_635_510_047_292_7, 0.601_815_023_152_048_3, 0.0);
    let (front, back) = (
        [DVec3::ZERO, along, along + DVec3::Z, DVec3::Z],
        [DVec3::ZERO, DVec3::Z, along + DVec3::Z, along],
    );
    let mut scene = Scene::new();
    scene.add_quad(front.map(|c| c + 0.3), 7, 7);
    scene.add_quad(back.map(|c| c + 0.3), 7, 7);
    let operator = operator::<1>(&scene, 1e-3);
    let h = operator.apply(&vec![[1.0]; 98]).unwrap();
    assert!(h.iter().all(|h| *h == [0.0]), "{h:?}");
    // Rounding to single precision, as meshes have it, tilts the sides against each other.
    let single = |c: DVec3| (c + 0.3).as_vec3().as_dvec3();
    let mut scene = Scene::new();
    scene.add_quad(front.map(single), 7, 7);
    let [a, b, c, d] = back.map(single);
    scene.add_quad([b, c, d, a], 5, 5);
    let operator = self::operator::<1>(&scene, 1e-3);
    let h = operator.apply(&vec![[1.0]; scene.elements.len()]).unwrap();
    assert!(h.iter().all(|h| h[0] < 1e-6), "{h:?}");
}

//! Configuration factors (Howell, "A Catalog of Radiation Heat Transfer Configuration Factors").

use std::collections::HashMap;
use std::f64::consts::{FRAC_1_PI, PI};

use approx::assert_relative_eq;
use farfield::{Mask, direct};
use farfield_radiosity::{
    Irradiance, Occluders, Patch, Scene, Surfel, Visibility, quad_pieces, quad_triangles,
    sphere_interior,
};
use glam::DVec3;

use crate::bodies::{
    ball, disk, even_rings, extrapolated, mantle, scaled, symmetric_factor, turned,
};

#[test]
fn coaxial_disks() {
    for (radii, height, exact) in [
        ([1.0, 1.0], 1.0, 0.3819660112501052),
        ([1.0, 1.0], 0.1, 0.9048750780274961),
        ([1.0, 1.0], 10.0, 0.0098048640721517),
        ([1.0, 2.0], 1.0, 0.7639320225002103),
    ] {
        let [first, second] = radii;
        let factor = |n: usize| {
            symmetric_factor(&disk(n, first, 0.0, true), &disk(n, second, height, false))
        };
        let back = |n: usize| {
            symmetric_factor(&disk(n, second, height, false), &disk(n, first, 0.0, true))
        };
        let n = if height < 1.0 { 96 } else { 16 };
        assert_relative_eq!(extrapolated(n, factor), exact, max_relative = 1e-7);
        let reciprocal = exact * (first / second).powi(2);
        assert_relative_eq!(extrapolated(n, back), reciprocal, max_relative = 1e-7);
        // Coarse polygons are not the disks.
        assert!((factor(16) / exact - 1.0).abs() > 1e-5);
    }
}

#[test]
fn a_closed_cylinder() {
    let parts = |n: usize| (disk(n, 1.0, 0.0, true), disk(n, 1.0, 1.0, false), mantle(n, 1.0, 1.0));
    let end_to_side = |n: usize| {
        let (floor, _, side) = parts(n);
        symmetric_factor(&floor, &side)
    };
    let side_to_end = |n: usize| {
        let (floor, _, side) = parts(n);
        symmetric_factor(&side, &floor)
    };
    let side_to_side = |n: usize| {
        let (_, _, side) = parts(n);
        symmetric_factor(&side, &side)
    };
    let golden = 0.6180339887498948;
    for (what, factor, exact) in [
        ("end to side", &end_to_side as &dyn Fn(usize) -> f64, golden),
        ("side to end", &side_to_end, 0.3090169943749474),
        ("side to side", &side_to_side, 0.3819660112501052),
    ] {
        let found = extrapolated(16, factor);
        assert!((found / exact - 1.0).abs() < 1e-7, "{what}: {found}");
    }
    // The prism is as closed as the cylinder.
    for n in [3, 8, 32] {
        let (floor, ceiling, _) = parts(n);
        let end = symmetric_factor(&floor, &ceiling) + end_to_side(n);
        assert_relative_eq!(end, 1.0, epsilon = 1e-9);
        assert_relative_eq!(side_to_side(n) + 2.0 * side_to_end(n), 1.0, epsilon = 1e-9);
    }
}

#[test]
fn concentric_spheres() {
    // The inner polyhedron is convex and closed in: what leaves it arrives outside.
    let (r1, r2) = (1.0, 2.0);
    let inner = ball(10, r1, &even_rings(5));
    let outer: Vec<Patch> = inner.iter().map(|patch| turned(&scaled(patch, r2))).collect();
    let area = |body: &[Patch]| body.iter().map(Patch::area).sum::<f64>();
    let exchange: f64 =
        inner.iter().map(|from| outer.iter().map(|to| from.exchange(to)).sum::<f64>()).sum();
    assert_relative_eq!(exchange / area(&inner), 1.0, max_relative = 1e-9);
    assert_relative_eq!(exchange / area(&outer), (r1 / r2).powi(2), max_relative = 1e-9);

    // The outer one sees itself past the inner one.
    let n = 700;
    let surfels = sphere_interior(n, DVec3::ZERO, r2);
    let triangles: Vec<_> = ball(48, r1, &even_rings(23))
        .iter()
        .flat_map(|patch| match *patch.corners() {
            [a, b, c, d] => quad_triangles([a, b, c, d], 0),
            [a, b, c] => quad_triangles([a, b, c, c], 0),
            _ => unreachable!("patches have three or four corners"),
        })
        .collect();
    let occluders = Occluders::new(&triangles).unwrap();
    let sees = |x: &Surfel, y: &Surfel| !occluders.blocked(x.position, y.position, [u32::MAX; 2]);
    let visible: usize =
        surfels.iter().map(|x| surfels.iter().filter(|y| sees(x, y)).count()).sum();
    // By the constant kernel, F_22 is the share of the pairs that see each other.
    let share = visible as f64 / (n * n) as f64;
    assert_relative_eq!(share, 1.0 - (r1 / r2).powi(2), epsilon = 2e-3);
}

#[test]
fn inside_of_a_sphere() {
    let (n, radius) = (500, 3.0);
    let surfels = sphere_interior(n, DVec3::splat(1.0), radius);
    let share = surfels[0].area / (4.0 * PI * radius * radius);
    let mut radiosity = vec![0.0; n];
    radiosity[17] = 1.0;
    let received = direct(&Irradiance::<f64>::clamped(), &surfels, &radiosity, &surfels).unwrap();
    for factor in received.iter().enumerate().filter(|(i, _)| *i != 17).map(|(_, h)| h) {
        assert_relative_eq!(*factor, share, max_relative = 1e-12);
    }
    // Patches of a finer and finer polyhedron.
    let worst = |n: usize| {
        let inside: Vec<Patch> = ball(2 * n, 1.0, &even_rings(n - 1)).iter().map(turned).collect();
        let area: f64 = inside.iter().map(Patch::area).sum();
        // The long triangles at the poles are tilted.
        let middle = |patch: &&Patch| patch.centroid().z.abs() < 0.6;
        let from = inside.iter().find(middle).unwrap();
        let error = |to: &Patch| (from.form_factor(to) * area / to.area() - 1.0).abs();
        let apart = |to: &&Patch| middle(to) && to.centroid().distance(from.centroid()) > 0.5;
        inside.iter().filter(apart).map(error).fold(0.0, f64::max)
    };
    let errors = [8, 16, 32].map(worst);
    assert!(errors[2] < 1e-2 && errors.windows(2).all(|w| w[1] < w[0] / 3.0), "{errors:?}");
}

#[test]
fn a_disk_from_a_point_of_its_axis() {
    for (radius, height) in [(1.0, 1.0), (2.0, 0.5), (0.3, 4.0)] {
        let factor = |n: usize| {
            let pieces = disk(n, radius, height, false);
            pieces.iter().map(|p| p.form_factor_from(DVec3::ZERO, DVec3::Z)).sum()
        };
        let exact = radius * radius / (radius * radius + height * height);
        assert_relative_eq!(extrapolated(32, factor), exact, max_relative = 1e-8);
        assert!((factor(32) / exact - 1.0).abs() > 1e-4);
    }
}

#[test]
fn a_sphere_wholly_above_the_horizon() {
    let radius = 1.5f64;
    for (distance, cosine) in [(2.0f64, 0.9f64), (3.0, 1.0), (10.0, 0.2)] {
        assert!(distance * cosine > radius);
        let normal = DVec3::new((1.0 - cosine * cosine).sqrt(), 0.0, -cosine);
        // A ring runs where the lines of sight touch the sphere.
        let tangent = (radius / distance).acos();
        let rings = [0.5 * tangent, tangent, 0.5 * (tangent + PI)];
        let factor = |n: usize| {
            let pieces = ball(n, radius, &rings);
            pieces.iter().map(|p| p.form_factor_from(DVec3::Z * distance, normal)).sum()
        };
        let exact = (radius / distance).powi(2) * cosine;
        assert_relative_eq!(extrapolated(32, factor), exact, max_relative = 1e-7);
    }
}

/// The factor between two unit squares at distance 1, n × n and m × m pieces each, past a square
/// blocker half-way.
fn past_a_blocker(blocker: Option<(f64, f64)>, [n, m]: [usize; 2]) -> f64 {
    let square = |low: f64, side: f64, z: f64| {
        [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
            .map(|[x, y]| DVec3::new(low + side * x, low + side * y, z))
    };
    let pieces = |corners: [DVec3; 4], n: usize| -> Vec<Patch> {
        quad_pieces(corners, n, n).map(|piece| Patch::new(&piece).unwrap()).collect()
    };
    let mut downwards = square(0.0, 1.0, 1.0);
    downwards.reverse();
    let (floor, ceiling) = (pieces(square(0.0, 1.0, 0.0), n), pieces(downwards, m));
    let triangles = blocker.map(|(low, side)| quad_triangles(square(low, side, 0.5), 0));
    let occluders = Occluders::new(triangles.as_ref().map_or(&[][..], |t| t)).unwrap();
    // Pairs with the same offset but for signs exchange the same.
    let mut known = HashMap::new();
    let mut sum = 0.0;
    for from in &floor {
        for to in &ceiling {
            if !occluders.blocked(from.centroid(), to.centroid(), [u32::MAX; 2]) {
                let offset = (to.centroid() - from.centroid()).abs();
                let key = [offset.x, offset.y].map(|c| (c * (2 * n * m) as f64).round() as usize);
                sum += *known.entry(key).or_insert_with(|| from.exchange(to));
            }
        }
    }
    sum
}

#[test]
fn square_blockers_between_parallel_squares() {
    // Grids whose segments cross the middle plane evenly on both sides of the blocker's border.
    let cases = [
        (None, [[5, 5], [9, 9]], 0.1998248956983874),
        (Some((0.25, 0.5)), [[9, 9], [33, 33]], 0.0995062946),
        (Some((0.375, 0.25)), [[10, 10], [34, 34]], 0.1694742049),
        (Some((0.0, 1.0)), [[9, 9], [17, 17]], 0.0),
        (Some((0.0, 0.5)), [[5, 6], [15, 16]], 0.1498686718),
    ];
    for (blocker, grids, exact) in cases {
        let [coarse, fine] = grids.map(|grid| (past_a_blocker(blocker, grid) - exact).abs());
        assert!(fine <= 1e-4, "{blocker:?}: {fine}");
        assert!(fine < 0.25 * coarse || coarse < 1e-10, "{blocker:?}: {coarse} {fine}");
    }
}

#[test]
fn shadows_converge_however_grids_and_blockers_lie() {
    // The blocker's border lies on the grid, where centroids are all on one side of the shadow's.
    let factor = |n: usize| {
        let [x, y, z] = DVec3::AXES;
        let mut scene = Scene::new();
        scene.add_quad([DVec3::ZERO, x, x + y, y], n, n);
        scene.add_quad([z, z + y, z + x + y, z + x], n, n);
        scene.add_quad([0.0 * x, 0.5 * x, 0.5 * (x + y), 0.5 * y].map(|c| c + 0.5 * z), 0, 0);
        let occluders = Occluders::new(&scene.triangles).unwrap();
        let sum = |mask: &Visibility<'_>| {
            let (floor, ceiling) = scene.elements.split_at(n * n);
            let mut sum = 0.0;
            for (a, b) in floor.iter().flat_map(|a| ceiling.iter().map(move |b| (a, b))) {
                let share = Mask::<Irradiance<f64>>::pair(mask, a.surfel(), b.surfel());
                if share > 0.0 {
                    sum += share * a.as_patch().unwrap().exchange(b.as_patch().unwrap());
                }
            }
            sum - 0.1498686718
        };
        let shares = sum(&Visibility::of_elements(&occluders, &scene.elements));
        (shares.abs(), sum(&Visibility::new(&occluders)).abs())
    };
    for n in [4, 8, 16] {
        let (shares, centroids) = factor(n);
        let bound = 0.05 * (n as f64).powf(-1.5);
        assert!(shares < bound, "{n}: {shares:e}");
        assert!(centroids > bound, "{n}: {centroids:e} without shares");
    }
}

#[test]
fn a_small_piece_is_its_centroid() {
    // Two parallel unit squares far apart exchange as the kernel says.
    let [x, y, z] = DVec3::AXES;
    let floor = Patch::new(&[DVec3::ZERO, x, x + y, y]).unwrap();
    let ceiling = Patch::new(&[DVec3::ZERO, y, x + y, x].map(|c| c + 1e3 * z)).unwrap();
    assert_relative_eq!(floor.form_factor(&ceiling), 1e-6 * FRAC_1_PI, max_relative = 2e-6);
}

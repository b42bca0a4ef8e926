//! Radiosity against exact solutions and direct sums.

use approx::assert_relative_eq;
use farfield::{Error, Fmm, Interpolation, Mask, direct, direct_masked, relative_l2_error};
use farfield_radiosity::{
    Facing, Irradiance, Occluders, Scene, Stop, Surfel, Visibility, energy_balance, furnace,
    jacobi, quad_surfels, quad_triangles, southwell, sphere_interior, two_rooms,
};
use glam::DVec3;

type Plan<C> = Fmm<Interpolation<Irradiance<f64, C>>>;

const TIGHT: Stop = Stop { tolerance: 1e-12, max_iterations: 1000 };

/// What plans of order 4 reach in the scenes of this module.
const ACCURACY: f64 = 5e-4;

/// A plan over the surfels themselves, exact to [`ACCURACY`], with leaves small enough for the far field to
/// matter. The order is given, since what it takes to reach a tolerance is tested elsewhere.
fn plan<C: farfield::Numbers<Real = f64>>(
    surfels: &[Surfel],
    mask: &impl Mask<Irradiance<f64, C>>,
) -> Plan<C> {
    let builder = Fmm::builder(Irradiance::clamped()).mask(mask).order(4);
    let plan = builder.leaf_size(16).build(surfels, surfels).unwrap();
    assert!(plan.report().stats.expansion_pairs > 0, "only a plan with a far field is a test");
    plan
}

/// A room with a block on its floor, turned so that no side is parallel to a wall.
pub(crate) fn room_with_block(n: usize) -> Scene {
    let mut scene = furnace(n);
    let turned = |x: f64, y: f64, z: f64| {
        let (sin, cos) = 0.4f64.sin_cos();
        DVec3::new(0.45 + cos * x - sin * y, 0.55 + sin * x + cos * y, z)
    };
    let base = [[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]];
    let m = n.div_ceil(2);
    scene.add_quad(base.map(|[x, y]| turned(x, y, 0.4)), m, m);
    for k in 0..4 {
        let ([ax, ay], [bx, by]) = (base[k], base[(k + 1) % 4]);
        let side =
            [turned(ax, ay, 0.0), turned(bx, by, 0.0), turned(bx, by, 0.4), turned(ax, ay, 0.4)];
        scene.add_quad(side, m, m);
    }
    scene
}

/// Something different for every surfel and band.
pub(crate) fn bands(n: usize) -> Vec<[f64; 3]> {
    (0..n).map(|i| [1.0, 2.7, 0.3].map(|k| 1.0 + (i as f64 * k).sin())).collect()
}

#[test]
fn inside_a_sphere_the_solution_is_known() {
    let (n, rho) = (800, 0.3);
    let sphere = sphere_interior(n, DVec3::new(1.0, 2.0, 3.0), 1.5);
    let emission: Vec<[f64; 1]> = sphere.iter().map(|s| [1.0 + s.normal.x * s.normal.y]).collect();
    let mean = emission.iter().map(|e| e[0]).sum::<f64>() / n as f64;
    let reflectance = vec![[rho]; n];

    // B = E + ρ⟨E⟩/(1 − ρ) on the sphere; the sum leaves out each surfel's own share, 1/n of it all.
    let share = 1.0 / n as f64;
    let irradiance = mean / (1.0 - rho + rho * share);
    let exact: Vec<[f64; 1]> =
        emission.iter().map(|e| [(e[0] + rho * irradiance) / (1.0 + rho * share)]).collect();
    for (b, e) in exact.iter().zip(&emission) {
        assert_relative_eq!(b[0], e[0] + rho * mean / (1.0 - rho), max_relative = 3.0 * share);
    }

    let kernel = Irradiance::clamped();
    let sum = |b: &[[f64; 1]]| Ok::<_, Error>(direct(&kernel, &sphere, b, &sphere).unwrap());
    let solution = jacobi(&emission, &reflectance, TIGHT, sum, |_, _| ()).unwrap();
    assert!(relative_l2_error(&solution.radiosity, &exact) < 1e-11);

    let fmm = plan(&sphere, &Facing);
    let solution =
        jacobi(&emission, &reflectance, Stop::default(), |b| fmm.apply(b), |_, _| ()).unwrap();
    assert!(relative_l2_error(&solution.radiosity, &exact) < ACCURACY);
}

#[test]
fn a_furnace_glows_evenly_whatever_stands_in_it() {
    let scene = room_with_block(8);
    let surfels = &scene.surfels;
    let occluders = Occluders::new(&scene.triangles).unwrap();
    let mask = Visibility::new(&occluders);
    let kernel = Irradiance::<f64>::clamped();
    let row_sums =
        direct_masked(&kernel, &mask, surfels, &vec![1.0; surfels.len()], surfels).unwrap();
    let reflectance: Vec<_> = (0..surfels.len()).map(|i| [0.1 + 0.1 * (i % 6) as f64]).collect();
    // What the enclosure doesn't return is emitted: E = 1 − ρ·(row sum), so that B = 1.
    let emission: Vec<_> =
        reflectance.iter().zip(&row_sums).map(|(rho, sum)| [1.0 - rho[0] * sum]).collect();
    let fmm = plan(surfels, &mask);
    // At this order near pairs are summed in single precision, whose rounding of 6e-8 is the least residual
    // that all machines reach.
    let stop = Stop { tolerance: 1e-6, ..TIGHT };
    let solution = jacobi(&emission, &reflectance, stop, |b| fmm.apply(b), |_, _| ()).unwrap();
    assert!(relative_l2_error(&solution.radiosity, &vec![[1.0]; surfels.len()]) < ACCURACY);
    // Where roundings happen to settle, some reach less. Others say at once that they don't.
    match jacobi(&emission, &reflectance, TIGHT, |b| fmm.apply(b), |_, _| ()) {
        Ok(solution) => assert!(solution.residual <= TIGHT.tolerance),
        Err(farfield_radiosity::Error::Stagnated { iterations, residual, floor, .. }) => {
            assert!(iterations < 100 && residual <= floor && floor < stop.tolerance);
        }
        Err(error) => panic!("{error}"),
    }
}

#[test]
fn centroid_factors_of_a_cube_exceed_closure_and_solvers_say_so() {
    let cube = furnace(8).surfels;
    let row_sums =
        direct(&Irradiance::<f64>::clamped(), &cube, &vec![1.0; cube.len()], &cube).unwrap();
    let least = row_sums.iter().copied().fold(f64::INFINITY, f64::min);
    let greatest = row_sums.iter().copied().fold(0.0, f64::max);
    assert_relative_eq!(least, 1.007, epsilon = 1e-3);
    assert_relative_eq!(greatest, 1.239, epsilon = 1e-3);

    let kernel = Irradiance::clamped();
    let sum = |b: &[[f64; 1]]| Ok::<_, Error>(direct(&kernel, &cube, b, &cube).unwrap());
    let solve = |rho| {
        let emission = vec![[1.0]; cube.len()];
        jacobi(&emission, &vec![[rho]; cube.len()], Stop::default(), sum, |_, _| ())
    };
    assert!(solve(0.8).is_ok());
    let error = solve(0.99).unwrap_err();
    assert!(matches!(error, farfield_radiosity::Error::Diverged { .. }), "{error}");
}

#[test]
fn no_light_passes_a_wall_of_no_thickness() {
    let scene = two_rooms(8);
    let surfels = &scene.surfels;
    let occluders = Occluders::new(&scene.triangles).unwrap();
    let mask = Visibility::new(&occluders);
    let half = surfels.len() / 2;
    let emission: Vec<_> = (0..surfels.len()).map(|i| [f64::from(u8::from(i < half))]).collect();
    let fmm = plan(surfels, &mask);
    let second = |irradiance: &[[f64; 1]]| irradiance[half..].iter().map(|h| h[0]).sum::<f64>();
    let irradiance = fmm.apply(&emission).unwrap();
    assert!(irradiance[..half].iter().all(|h| h[0] > 0.9));
    assert_eq!(second(&irradiance), 0.0);
    // The wall does it, not the normals.
    assert!(second(&plan(surfels, &Facing).apply(&emission).unwrap()) > 1.0);
}

#[test]
fn square_blockers_between_parallel_squares_leave_the_known_factors() {
    let square = |low: [f64; 2], side: f64, z: f64| {
        [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
            .map(|[x, y]| DVec3::new(low[0] + side * x, low[1] + side * y, z))
    };
    // Grids of n and m surfels per side whose segments' crossings straddle the blocker's border.
    let cases = [
        (None, [33, 33], 0.1998248956983874),
        (Some(([0.25; 2], 0.5)), [33, 33], 0.0995062946),
        (Some(([0.375; 2], 0.25)), [34, 34], 0.1694742049),
        (Some(([0.0; 2], 1.0)), [33, 33], 0.0),
        (Some(([0.0; 2], 0.5)), [31, 34], 0.1498686718),
    ];
    for (blocker, [n, m], exact) in cases {
        let floor = quad_surfels(square([0.0; 2], 1.0, 0.0), n, n, 0);
        let mut downwards = square([0.0; 2], 1.0, 1.0);
        downwards.reverse();
        let ceiling = quad_surfels(downwards, m, m, 1);
        let triangles = blocker.map(|(low, side)| quad_triangles(square(low, side, 0.5), 2));
        let occluders = Occluders::new(triangles.as_ref().map_or(&[][..], |t| t)).unwrap();
        let mask = Visibility::new(&occluders);
        let builder = Fmm::builder(Irradiance::<f64>::clamped()).mask(&mask).order(4);
        let fmm = builder.leaf_size(32).build(&floor, &ceiling).unwrap();
        let irradiance = fmm.apply(&vec![1.0; floor.len()]).unwrap();
        let factor = irradiance.iter().sum::<f64>() / irradiance.len() as f64;
        assert!((factor - exact).abs() <= 5e-4 * exact, "{blocker:?}: {factor}, expected {exact}");
    }
}

#[test]
fn a_sphere_from_outside_needs_clamped_cosines() {
    let radius = 1.0;
    let sphere: Vec<Surfel> = sphere_interior(20_000, DVec3::ZERO, radius)
        .into_iter()
        .map(|s| Surfel { normal: -s.normal, ..s })
        .collect();
    let radiosity = vec![1.0; sphere.len()];
    for (h, cos) in [(2.0f64, 1.0), (3.0, 0.8), (10.0, 0.5)] {
        // The sphere stays above the horizon: h cos θ > r.
        let normal = DVec3::new((1.0f64 - cos * cos).sqrt(), 0.0, -cos);
        let receiver =
            Surfel { position: DVec3::Z * h, normal, area: 1.0, face: Surfel::<f64>::NO_FACE };
        let exact = (radius / h).powi(2) * cos;
        let clamped = Irradiance::clamped();
        let irradiance = direct(&clamped, &sphere, &radiosity, &[receiver]).unwrap()[0];
        assert_relative_eq!(irradiance, exact, max_relative = 1e-3);
        let signed = direct(&Irradiance::signed(), &sphere, &radiosity, &[receiver]).unwrap()[0];
        assert!(signed.abs() < 1e-3 * exact, "the far side takes away what the near side gives");

        let builder = Fmm::builder(clamped).mask(Facing).order(4);
        let fmm = builder.leaf_size(50).build(&sphere, &[receiver]).unwrap();
        let irradiance = fmm.apply(&radiosity).unwrap()[0];
        assert_relative_eq!(irradiance, exact, max_relative = 1e-3);
    }
}

#[test]
fn fast_sums_with_visibility_meet_direct_ones_and_count_every_pair_once() {
    let scene = room_with_block(10);
    let surfels = &scene.surfels;
    let occluders = Occluders::new(&scene.triangles).unwrap();
    let radiosity = bands(surfels.len());
    let kernel = Irradiance::<f64, [f64; 3]>::clamped();

    let one_by_one = Visibility::new(&occluders);
    let exact = direct_masked(&kernel, &one_by_one, surfels, &radiosity, surfels).unwrap();
    let mask = Visibility::new(&occluders);
    let fmm = plan(surfels, &mask);
    assert!(relative_l2_error(&fmm.apply(&radiosity).unwrap(), &exact) < ACCURACY);

    let (counts, expected) = (mask.counts(), one_by_one.counts());
    assert_eq!(counts.total(), (surfels.len() * surfels.len()) as u64);
    assert_eq!(counts.facing_away, expected.facing_away);
    assert_eq!(counts.hidden, expected.hidden);
    assert_eq!(counts.unhidden + counts.certified, expected.unhidden);
    assert!(counts.certified > counts.total() / 10);

    // Visibility matters here: without it the sums are far off.
    let unhidden = direct(&kernel, surfels, &radiosity, surfels).unwrap();
    assert!(relative_l2_error(&unhidden, &exact) > 0.05);
}

#[test]
fn single_precision_reaches_its_digits() {
    let scene = room_with_block(8);
    let surfels: Vec<Surfel<f32>> = scene.surfels.iter().map(Surfel::cast).collect();
    let occluders = Occluders::new(&scene.triangles).unwrap();
    let mask = Visibility::new(&occluders);
    let radiosity: Vec<f32> = bands(surfels.len()).iter().map(|b| b[0] as f32).collect();
    let builder = Fmm::builder(Irradiance::<f32>::clamped()).mask(&mask).order(4);
    let fmm = builder.leaf_size(16).build(&surfels, &surfels).unwrap();
    let sums: Vec<f64> = fmm.apply(&radiosity).unwrap().into_iter().map(f64::from).collect();

    let radiosity: Vec<f64> = radiosity.into_iter().map(f64::from).collect();
    let kernel = Irradiance::<f64>::clamped();
    let exact = direct_masked(&kernel, &mask, &scene.surfels, &radiosity, &scene.surfels).unwrap();
    assert!(relative_l2_error(&sums, &exact) < ACCURACY);
}

#[test]
fn shooting_and_gathering_agree_and_conserve_energy() {
    let scene = room_with_block(6);
    let surfels = &scene.surfels;
    let occluders = Occluders::new(&scene.triangles).unwrap();
    let mask = Visibility::new(&occluders);
    let kernel = Irradiance::<f64, [f64; 3]>::clamped();
    // One wall shines.
    let emission: Vec<_> =
        surfels.iter().map(|s| if s.face == 5 { [17.0, 12.0, 4.0] } else { [0.0; 3] }).collect();
    let reflectance: Vec<_> = surfels
        .iter()
        .map(|s| if s.face == 0 { [0.63, 0.065, 0.05] } else { [0.7, 0.6, 0.5] })
        .collect();
    let stop = Stop { tolerance: 1e-5, max_iterations: 100_000 };

    let gather = |b: &[[f64; 3]]| {
        Ok::<_, Error>(direct_masked(&kernel, &mask, surfels, b, surfels).unwrap())
    };
    let gathered = jacobi(&emission, &reflectance, stop, gather, |_, _| ()).unwrap();
    let column = |i: usize| {
        let factor = |x: &Surfel| {
            let visible = Mask::<Irradiance<f64, [f64; 3]>>::pair(&mask, x, &surfels[i]);
            visible * kernel.factor(x, &surfels[i]) * surfels[i].area
        };
        Ok::<_, Error>(surfels.iter().map(factor).collect())
    };
    let shot = southwell(surfels, &emission, &reflectance, stop, column, |_, _| ()).unwrap();
    assert!(relative_l2_error(&shot.radiosity, &gathered.radiosity) < 1e-4);
    assert!(relative_l2_error(&shot.irradiance, &gathered.irradiance) < 1e-4);

    let ones = vec![[1.0; 3]; surfels.len()];
    let row_sums: Vec<f64> = gather(&ones).unwrap().iter().map(|sum| sum[0]).collect();
    for solution in [&gathered, &shot] {
        let balance =
            energy_balance(surfels, &emission, &reflectance, solution, &row_sums).unwrap();
        assert!(balance.residual().iter().all(|r| r.abs() < 1e-4), "{balance:?}");
    }
    let fmm = plan(surfels, &mask);
    let fast = jacobi(&emission, &reflectance, stop, |b| fmm.apply(b), |_, _| ()).unwrap();
    assert!(relative_l2_error(&fast.radiosity, &gathered.radiosity) < ACCURACY);
    let balance = energy_balance(surfels, &emission, &reflectance, &fast, &row_sums).unwrap();
    assert!(balance.residual().iter().all(|r| r.abs() < ACCURACY), "{balance:?}");
}

//! How fast form factors converge as elements get smaller: raw sums, before any row is closed.

use std::f64::consts::{PI, TAU};
use std::ops::Range;

use farfield::Mask;
use farfield_radiosity::{
    Element, Irradiance, Occluders, Patch, Projections, Scene, Surfel, Surroundings, Visibility,
};
use glam::DVec3;

/// A form factor that is known exactly, and the scene that has it, by the number of pieces along an edge.
///
/// Round bodies in flat pieces are off by the square of their size, and so is the edge of a shadow within elements.
/// What else there is comes from near pairs, of which corrections leave about their tolerance however small
/// elements are, and from the rays of partly hidden ones, which err at random. Orders are seen above that alone.
struct Case {
    name: &'static str,
    exact: f64,
    scene: fn(usize) -> Parts,
    sizes: [usize; 3],
    /// What corrections may leave.
    tolerance: f64,
    /// The largest relative errors.
    bounds: [f64; 3],
    /// The least order, if errors are above what corrections leave.
    order: Option<f64>,
}

/// A scene, the elements of it that send, and those that receive.
struct Parts {
    scene: Scene,
    from: Range<usize>,
    to: Range<usize>,
}

const CASES: [Case; 6] = [
    Case {
        name: "squares, a corner of the view blocked",
        exact: 0.149_868_671_8,
        scene: corner_blocker,
        sizes: [5, 9, 13],
        tolerance: 1e-4,
        bounds: [3e-3, 8e-4, 3e-4],
        order: Some(1.5),
    },
    Case {
        name: "box of 10 x 10 x 0.1, floor to ceiling",
        exact: 0.980_416_6,
        scene: thin_box,
        sizes: [8, 16, 32],
        tolerance: 1e-3,
        bounds: [5e-5, 5e-5, 5e-5],
        order: None,
    },
    Case {
        name: "concentric spheres, inner to outer",
        exact: 1.0,
        scene: spheres,
        sizes: [4, 8, 16],
        tolerance: 1e-3,
        bounds: [1e-4, 1e-4, 2e-4],
        order: None,
    },
    Case {
        name: "coaxial cylinders, 1/8 and 1/4",
        exact: 0.910_868,
        scene: |n| cylinders(n, 0.125, 0.25),
        sizes: [8, 16, 32],
        tolerance: 1e-3,
        bounds: [4e-3, 1.2e-3, 3e-4],
        order: Some(1.8),
    },
    Case {
        name: "coaxial cylinders, 1/4 and 1/2",
        exact: 0.825_256,
        scene: |n| cylinders(n, 0.25, 0.5),
        sizes: [8, 16, 32],
        tolerance: 1e-3,
        bounds: [8e-3, 2.5e-3, 5e-4],
        order: Some(1.8),
    },
    Case {
        name: "bowl five times as wide as deep, to itself",
        exact: 4.0 / 29.0,
        scene: bowl,
        sizes: [3, 5, 8],
        tolerance: 1e-4,
        bounds: [3e-3, 1.5e-3, 6e-4],
        order: Some(1.8),
    },
];

#[test]
#[ignore = "a long table; .ci/full runs it"]
fn raw_form_factors_are_those_known_exactly() {
    println!("| form factor | elements | relative error | order |");
    let mut missed = Vec::new();
    for Case { name, exact, scene, sizes, tolerance, bounds, order } in CASES {
        // Rays err at random: the root mean square of three meshes of about the same size.
        let found = sizes.map(|n| {
            let errors = [n, n + 2, n + 4].map(|n| {
                let parts = scene(n);
                (parts.scene.elements.len(), factor(&parts, tolerance) / exact - 1.0)
            });
            let squares = errors.iter().map(|(_, error)| error * error).sum::<f64>();
            (errors[1].0, (squares / 3.0).sqrt())
        });
        let [first, .., last] = found;
        let ratio = (sizes[2] + 2) as f64 / (sizes[0] + 2) as f64;
        let slope = (first.1 / last.1).ln() / ratio.ln();
        let elements = found.map(|(count, _)| count.to_string()).join(", ");
        let errors = found.map(|(_, error)| format!("{error:.1e}")).join(", ");
        println!("| {name} | {elements} | {errors} | {slope:.1} |");
        if order.is_some_and(|order| slope < order) {
            missed.push(format!("{name}: order {slope}"));
        }
        if !found.iter().zip(bounds).all(|((_, error), bound)| *error < bound) {
            missed.push(format!("{name}: {errors}, {slope}"));
        }
    }
    assert!(missed.is_empty(), "{missed:#?}");
}

#[test]
#[ignore = "a long table; .ci/full runs it"]
fn the_error_of_rows_is_what_rays_estimate() {
    type Body = (&'static str, fn(usize) -> Parts, [usize; 2], fn(&[Element], usize) -> f64);
    let bodies: [Body; 4] = [
        ("squares", corner_blocker, [5, 9], |elements, i| past_the_corner(&elements[i])),
        ("box", thin_box, [8, 14], unhidden_row),
        ("spheres", spheres, [4, 8], |_, _| 1.0),
        ("bowl", bowl, [3, 6], unhidden_row),
    ];
    let (mut seen, mut honest) = (0, 0);
    for (name, scene, sizes, exact) in bodies {
        for (n, tolerance) in sizes.into_iter().flat_map(|n| [(n, 1e-1), (n, 1e-2), (n, 1e-3)]) {
            let Parts { scene, .. } = scene(n);
            let elements = &scene.elements;
            let occluders = Occluders::new(&scene.triangles).expect("finite");
            let all = 0..elements.len();
            let rows: Vec<f64> = rows(&scene, &occluders, all.clone(), &all, tolerance)
                .map(|(row, _)| row)
                .collect();
            let around = Surroundings::new(elements, &occluders, 8);
            let estimate = around.row_error(&rows);
            let (mut square, mut area) = (0.0, 0.0);
            for (i, row) in rows.iter().enumerate() {
                let own = elements[i].surfel().area;
                square += own * (row - exact(elements, i)).powi(2);
                area += own;
            }
            let error = (square / area).sqrt();
            println!("{name} {n} {tolerance:e}: {error:.1e}, estimated {estimate:.1e}");
            if error > LEAST_SEEN {
                seen += 1;
                honest += usize::from((1.0 / 3.0..3.0).contains(&(estimate / error)));
            } else {
                assert!(estimate < 3.0 * LEAST_SEEN, "{name} {n} {tolerance:e}: {estimate:e}");
            }
        }
    }
    assert!(seen >= 12 && 10 * honest >= 9 * seen, "{honest} of {seen}");
}

/// Errors of rows that rays can tell.
const LEAST_SEEN: f64 = 3e-4;

/// A row of which nothing is hidden.
fn unhidden_row(elements: &[Element], i: usize) -> f64 {
    let patch = elements[i].as_patch().expect("flat");
    elements.iter().filter_map(Element::as_patch).map(|other| patch.form_factor(other)).sum()
}

/// A row of the squares: what its points see of the other one, less what a corner of that hides, which is the
/// blocker twice as large, away from each point.
fn past_the_corner(element: &Element) -> f64 {
    let patch = element.as_patch().expect("flat");
    let &[a, b, _, d] = patch.corners() else { panic!() };
    let height = if a.z < 0.5 { 1.0 } else { 0.0 };
    let corner = |x: f64, y: f64| {
        let mut corners =
            [[0.0, 0.0], [0.0, y], [x, y], [x, 0.0]].map(|[x, y]| DVec3::new(x, y, height));
        if height == 0.0 {
            corners.reverse();
        }
        Patch::new(&corners).expect("flat")
    };
    const POINTS: usize = 16;
    let seen = |k: usize| {
        let [u, v] = [k / POINTS, k % POINTS].map(|k| (k as f64 + 0.5) / POINTS as f64);
        let point = a + (b - a) * u + (d - a) * v;
        let from = |other: Patch| other.form_factor_from(point, patch.normal());
        from(corner(1.0, 1.0)) - from(corner(1.0 - point.x, 1.0 - point.y))
    };
    (0..POINTS * POINTS).map(seen).sum::<f64>() / (POINTS * POINTS) as f64
}

/// The mean form factor from some elements to others, pair by pair.
fn factor(Parts { scene, from, to }: &Parts, tolerance: f64) -> f64 {
    let occluders = Occluders::new(&scene.triangles).expect("finite");
    let (mut sum, mut area) = (0.0, 0.0);
    for (row, own) in rows(scene, &occluders, from.clone(), to, tolerance) {
        sum += row * own;
        area += own;
    }
    sum / area
}

/// The form factors of some elements to others, each summed, and the areas.
fn rows<'a>(
    scene: &'a Scene,
    occluders: &'a Occluders,
    from: Range<usize>,
    to: &'a Range<usize>,
    tolerance: f64,
) -> impl Iterator<Item = (f64, f64)> + 'a {
    let mask = Visibility::of_elements(occluders, &scene.elements);
    let corrections = mask.corrections(&scene.elements, tolerance).expect("valid");
    from.map(move |i| {
        let x: &Surfel = scene.elements[i].surfel();
        let mut sum = 0.0;
        for j in to.clone().filter(|&j| j != i) {
            let y = scene.elements[j].surfel();
            let pair = Projections::new(x, y);
            if pair.facing() {
                let share = Mask::<Irradiance<f64>>::pair(&mask, x, y);
                sum += share * pair.kernel() * y.area;
            }
        }
        // C is symmetric: what i sends is what it receives, but for the areas.
        let near = corrections.column(i).filter(|(j, _)| to.contains(j));
        let near: f64 = near.map(|(j, value)| value * scene.elements[j].surfel().area).sum();
        (sum + near / x.area, x.area)
    })
}

fn corner_blocker(n: usize) -> Parts {
    let [x, y, z] = DVec3::AXES;
    let mut scene = Scene::new();
    scene.add_quad([DVec3::ZERO, x, x + y, y], n, n);
    scene.add_quad([z, z + y, z + x + y, z + x], n, n);
    let [u, v, middle] = [x, y, z].map(|edge| 0.5 * edge);
    scene.add_quad([middle, middle + u, middle + u + v, middle + v], 0, 0);
    Parts { scene, from: 0..n * n, to: n * n..2 * n * n }
}

fn thin_box(n: usize) -> Parts {
    let [x, y, z] = [DVec3::X * 10.0, DVec3::Y * 10.0, DVec3::Z * 0.1];
    let mut scene = Scene::new();
    scene.add_quad([DVec3::ZERO, x, x + y, y], n, n);
    scene.add_quad([z, z + y, z + x + y, z + x], n, n);
    Parts { scene, from: 0..n * n, to: n * n..2 * n * n }
}

fn spheres(n: usize) -> Parts {
    let mut scene = Scene::new();
    let polar = |row: usize, radius: f64| {
        let (sin, cos) = (PI * row as f64 / n as f64).sin_cos();
        [radius * sin, radius * cos]
    };
    add_round(&mut scene, 2 * n, &(0..=n).map(|row| polar(row, 1.0)).collect::<Vec<_>>(), true);
    let inner = scene.elements.len();
    add_round(&mut scene, 2 * n, &(0..=n).map(|row| polar(row, 1.5)).collect::<Vec<_>>(), false);
    let all = scene.elements.len();
    Parts { scene, from: 0..inner, to: inner..all }
}

fn cylinders(n: usize, small: f64, large: f64) -> Parts {
    let mut scene = Scene::new();
    let mantle = |radius: f64| -> Vec<[f64; 2]> {
        (0..=n).map(|row| [radius, 1.0 - row as f64 / n as f64]).collect()
    };
    add_round(&mut scene, n, &mantle(small), true);
    let inner = scene.elements.len();
    add_round(&mut scene, n, &mantle(large), false);
    let all = scene.elements.len();
    Parts { scene, from: 0..inner, to: inner..all }
}

fn bowl(n: usize) -> Parts {
    // From the rim down to the bottom: tan(θ/2) = 2 depth / width.
    let rim = 2.0 * 0.4f64.atan();
    let polar = |row: usize| {
        let (sin, cos) = (rim * (1.0 - row as f64 / n as f64)).sin_cos();
        [sin, -cos]
    };
    let mut scene = Scene::new();
    add_round(&mut scene, 4 * n, &(0..=n).map(polar).collect::<Vec<_>>(), false);
    let all = scene.elements.len();
    Parts { scene, from: 0..all, to: 0..all }
}

/// A surface of revolution in flat pieces, by the radii and heights of its profile from top to bottom. Its
/// front is outwards, or inwards.
fn add_round(scene: &mut Scene, count: usize, profile: &[[f64; 2]], outwards: bool) {
    let at = |[radius, height]: [f64; 2], k: usize| {
        let (sin, cos) = (TAU * (k % count) as f64 / count as f64).sin_cos();
        DVec3::new(radius * cos, radius * sin, height)
    };
    for rows in profile.windows(2) {
        for k in 0..count {
            let [above, below] = [rows[0], rows[1]];
            let corners = [at(above, k), at(below, k), at(below, k + 1), at(above, k + 1)];
            let corners = if outwards {
                corners
            } else {
                let [a, b, c, d] = corners;
                [d, c, b, a]
            };
            add_piece(scene, corners);
        }
    }
}

/// A quadrilateral of which two corners may be one, at a pole.
fn add_piece(scene: &mut Scene, corners: [DVec3; 4]) {
    let mut found: Vec<DVec3> = Vec::new();
    for corner in corners {
        if found.iter().all(|other| other.distance(corner) > 1e-12) {
            found.push(corner);
        }
    }
    let face = scene.add_quad(corners, 0, 0);
    let patch = Patch::new(&found).expect("flat");
    scene.elements.push(Element::patch(patch, face));
}

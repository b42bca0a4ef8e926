//! Surfaces that touch, nearly touch, lie in one plane or in each other.

use std::f64::consts::PI;

use farfield_radiosity::{
    Error, Irradiance, Occluders, Patch, Scene, Stop, Surfel, Triangle, conjugate_gradients,
    furnace, jacobi, quad_triangles,
};
use farfield_testing::clouds::Random;
use glam::{DQuat, DVec3};

use crate::table::row;

fn patch(corners: [[f64; 3]; 4]) -> Patch {
    Patch::new(&corners.map(DVec3::from)).unwrap()
}

/// The unit square on the floor, seen from above.
fn floor() -> Patch {
    patch([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
}

/// A wall on the edge x = 0 of the floor, between two heights.
fn wall(low: f64, high: f64) -> Patch {
    patch([[0.0, 0.0, low], [0.0, 1.0, low], [0.0, 1.0, high], [0.0, 0.0, high]])
}

/// What the rule of centroids makes of A F.
fn by_centroids(a: &Patch, b: &Patch) -> f64 {
    let [x, y] = [a, b].map(|patch| Surfel {
        position: patch.centroid(),
        normal: patch.normal(),
        area: patch.area(),
        face: Surfel::<f64>::NO_FACE,
    });
    Irradiance::<f64>::clamped().factor(&x, &y) * x.area * y.area
}

/// F of two unit squares at a right angle on a common edge (Howell, C-14).
fn common_edge() -> f64 {
    let root = 2f64.sqrt();
    let logs = 0.25 * ((4.0f64 / 3.0).ln() + 2.0 * (3.0f64 / 4.0).ln());
    (2.0 * 1f64.atan() - root * (1.0 / root).atan() + logs) / PI
}

#[test]
fn patches_that_touch_exchange_exactly() {
    let exact = common_edge();
    let (a, b) = (floor(), wall(0.0, 1.0));
    let error = |found: f64| (found / exact - 1.0).abs();
    let (naive, ours) = (error(by_centroids(&a, &b)), error(a.exchange(&b)));
    assert!(naive > 0.1 && ours < 1e-9, "{naive} {ours:e}");
    row(
        "Patches that share an edge",
        "the kernel is singular along the edge",
        format!("off by {:.0} % by centroids", 100.0 * naive),
        format!("off by {ours:.0e}"),
    );
}

#[test]
fn slivers_add_up() {
    let (square, whole) = (floor(), wall(0.0, 1.0));
    let cuts = [0.0, 1e-6, 1e-3, 1.0];
    let strips: Vec<Patch> = cuts.windows(2).map(|cut| wall(cut[0], cut[1])).collect();
    let sum = |of: &dyn Fn(&Patch) -> f64| strips.iter().map(of).sum::<f64>();
    let exact = common_edge();
    assert!((square.exchange(&whole) / exact - 1.0).abs() < 1e-12);
    let error = (sum(&|strip| square.exchange(strip)) / exact - 1.0).abs();
    let naive = (sum(&|strip| by_centroids(strip, &square)) / exact - 1.0).abs();
    // Next to the edge a strip sees half of what it faces, less what the ends of the floor leave.
    let sliver = square.exchange(&strips[0]) / strips[0].area();
    assert!((0.4999..0.5).contains(&sliver), "{sliver}");
    assert!(error < 1e-9 && naive > 0.05, "{error:e} {naive}");
    row(
        "Slivers of aspect 1e6",
        "their centroid says nothing of their ends; areas of 1e-6 are differences",
        format!("sum of strips off by {:.0} % by centroids", 100.0 * naive),
        format!("off by {error:.0e}; the sliver alone sees {sliver:.3} of the floor"),
    );
}

#[test]
fn light_in_a_corner_reaches_all_walls() {
    // The faces of the unit cube that a lamp on its floor sees.
    let faces = [
        wall(0.0, 1.0),
        patch([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
        patch([[1.0, 0.0, 0.0], [1.0, 0.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 0.0]]),
        patch([[0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, 1.0, 1.0], [0.0, 1.0, 1.0]]),
        patch([[0.0, 0.0, 1.0], [0.0, 1.0, 1.0], [1.0, 1.0, 1.0], [1.0, 0.0, 1.0]]),
    ];
    let (mut naive, mut ours) = (f64::INFINITY, 0.0f64);
    for a in [1e-2, 1e-4, 1e-6] {
        let lamp = patch([[0.0; 3], [a, 0.0, 0.0], [a, a, 0.0], [0.0, a, 0.0]]);
        let off = |sum: f64| (sum / lamp.area() - 1.0).abs();
        naive = naive.min(off(faces.iter().map(|face| by_centroids(&lamp, face)).sum()));
        ours = ours.max(off(faces.iter().map(|face| lamp.exchange(face)).sum()));
        let beside = [0, 1].map(|k| lamp.exchange(&faces[k]) / lamp.area());
        assert!((beside[0] - beside[1]).abs() < 1e-9 && beside[0] > 0.25, "{a}: {beside:?}");
    }
    assert!(naive > 0.1 && ours < 1e-9, "{naive} {ours:e}");
    row(
        "A lamp of 1e-6 in a corner",
        "two walls touch it: they get half of its light, from next to nowhere",
        format!("light lost or made: {:.0} % by centroids", 100.0 * naive),
        format!("{ours:.0e}"),
    );
}

#[test]
fn nearly_coplanar_patches_exchange_next_to_nothing() {
    // Two squares that fold along their common edge by a small angle: strips would exchange θ²/8.
    let turned = |angle: f64, turn: DQuat| {
        let (sin, cos) = angle.sin_cos();
        let corners = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-cos, 1.0, sin], [-cos, 0.0, sin]];
        let [a, b] = [floor(), patch(corners)].map(|patch| {
            let corners: Vec<DVec3> = patch.corners().iter().map(|&p| turn * p).collect();
            Patch::new(&corners).unwrap()
        });
        (a.exchange(&b), b.exchange(&a))
    };
    let folded = |angle: f64| turned(angle, DQuat::IDENTITY);
    // Rounding of either sign, wherever they lie.
    let mut random = Random::new(6);
    for _ in 0..100 {
        let turn = DQuat::from_axis_angle(random.direction(), random.between(0.0, 6.0));
        for angle in [1e-4, 1e-6, 1e-8, 1e-10] {
            let (there, back) = turned(angle, turn);
            let most = angle * angle / 8.0 + 1e-14;
            assert!(
                (0.0..=most).contains(&there) && (0.0..=most).contains(&back),
                "{angle}: {there:e} {back:e}"
            );
            assert_eq!(folded(-angle), (0.0, 0.0), "each below the other's horizon");
        }
    }
    let mut found = Vec::new();
    for angle in [1e-2, 1e-4, 1e-6, 1e-8, 0.0] {
        let (there, back) = folded(angle);
        assert!((there - back).abs() <= 1e-15 + 1e-9 * there, "{angle}: {there:e} {back:e}");
        assert!((0.0..=angle * angle / 8.0 + 1e-14).contains(&there), "{angle}: {there:e}");
        found.push(there);
    }
    // ∫∫ x y / (π |x − y|⁴) over the two squares, in units of θ².
    let flat = 0.077_502_673e-4;
    assert!((found[0] / flat - 1.0).abs() < 1e-4, "{:e}", found[0]);
    let growth = found[0] / found[1] / 1e4;
    assert!((growth - 1.0).abs() < 1e-2, "{growth}");
    row(
        "Patches that fold by 1e-2 … 1e-8",
        "the horizon cuts each at its own edge; angles are differences",
        "negative factors, or factors of rounding",
        format!(
            "A F = {:.0e}, {:.0e}, {:.0e}, {:.0e}, as θ²",
            found[0], found[1], found[2], found[3]
        ),
    );
}

/// Segments through points of a wall.
fn segments(through: impl Fn(&mut Random) -> DVec3) -> Vec<[DVec3; 2]> {
    let mut random = Random::new(3);
    let segment = |_| {
        let point = through(&mut random);
        let step = DVec3::new(random.between(-1.0, 1.0), random.between(-1.0, 1.0), 1.0);
        let reach = random.between(0.1, 2.0);
        [point - step * reach, point + step * reach]
    };
    (0..RAYS).map(segment).collect()
}

const RAYS: usize = 20_000;

/// How many segments nothing stops.
fn leaks(occluders: &Occluders, segments: &[[DVec3; 2]]) -> usize {
    let none = [Surfel::<f64>::NO_FACE; 2];
    segments.iter().filter(|[from, to]| !occluders.blocked(*from, *to, none)).count()
}

/// Whether a segment meets the inside of a triangle, borders left out by a billionth.
fn meets_inside(triangle: &Triangle, [from, to]: &[DVec3; 2]) -> bool {
    let [a, b, c] = triangle.vertices;
    let normal = (b - a).cross(c - a);
    let t = normal.dot(a - *from) / normal.dot(*to - *from);
    let p = *from + (*to - *from) * t;
    let weight = |u: DVec3, v: DVec3| normal.dot((v - u).cross(p - u)) / normal.length_squared();
    [weight(a, b), weight(b, c), weight(c, a)].iter().all(|&weight| weight > 1e-9)
}

/// A rectangle of the plane at a height.
fn quad(low: [f64; 2], high: [f64; 2], z: f64, face: u32) -> [Triangle; 2] {
    let corner = |x: f64, y: f64| DVec3::new(x, y, z);
    let [x, y] = [[low[0], high[0]], [low[1], high[1]]];
    let corners = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(i, j)| corner(x[i], y[j]));
    quad_triangles(corners, face)
}

#[test]
fn walls_do_not_leak() {
    let none = Surfel::<f64>::NO_FACE;
    // Two panes on one side of a seam, three on the other: no common edges.
    let thirds = [-1.0, -0.3, 0.45, 1.0];
    let mut seams = Vec::new();
    seams.extend(quad([-1.0, -1.0], [0.0, 0.1], 0.0, none));
    seams.extend(quad([-1.0, 0.1], [0.0, 1.0], 0.0, none));
    for y in thirds.windows(2) {
        seams.extend(quad([0.0, y[0]], [1.0, y[1]], 0.0, none));
    }
    let mut joined: Vec<Triangle> = quad([-1.0, -1.0], [0.0, 1.0], 0.0, none).to_vec();
    joined.extend(quad([0.0, -1.0], [1.0, 1.0], 0.0, none));

    let at = |x: f64| segments(move |random| DVec3::new(x, random.between(-0.9, 0.9), 0.0));
    let rays = at(0.0);
    let missed = |ray: &&[DVec3; 2]| !joined.iter().any(|triangle| meets_inside(triangle, ray));
    let naive = rays.iter().filter(missed).count();
    let shared = leaks(&Occluders::new(&joined).unwrap(), &rays);
    let missed = |ray: &&[DVec3; 2]| !seams.iter().any(|triangle| meets_inside(triangle, ray));
    let naive_junction = rays.iter().filter(missed).count();
    let panes = Occluders::new(&seams).unwrap();
    let junction = leaks(&panes, &rays);
    let beside = [-1e-12, 1e-12].map(|x| leaks(&panes, &at(x)));
    // Turned, the corners in the seam don't lie on its line any more.
    let turn = DQuat::from_axis_angle(DVec3::new(2.0, 1.0, -3.0).normalize(), 0.7);
    let turned = |triangle: &Triangle| Triangle {
        vertices: triangle.vertices.map(|v| turn * v),
        ..*triangle
    };
    let panes = Occluders::new(&seams.iter().map(turned).collect::<Vec<_>>()).unwrap();
    let rays: Vec<_> = rays.iter().map(|ray| ray.map(|end| turn * end)).collect();
    let turned = leaks(&panes, &rays);

    let mut double = Vec::new();
    double.extend(quad([-1.0, -1.0], [1.0, 1.0], 0.0, 0));
    double.extend(quad([-1.0, -1.0], [1.0, 1.0], 0.0, 1));
    double.extend(quad([-1.0, -1.0], [1.0, 1.0], 1e-13, 2));
    let double = Occluders::new(&double).unwrap();
    let rays = segments(|r| DVec3::new(r.between(-0.9, 0.9), r.between(-0.9, 0.9), 0.0));
    let through = leaks(&double, &rays);
    // A point on one of the walls sees what is before it, and nothing behind.
    let on_wall = DVec3::new(0.3, -0.2, 0.0);
    let skip = [0, none];
    assert!(!double.blocked(on_wall, DVec3::new(0.1, 0.1, 1.0), skip), "acne");
    assert!(double.blocked(DVec3::new(0.3, -0.2, -1e-3), DVec3::Z, skip), "a leak");
    assert_eq!((shared, junction, turned, beside, through), (0, 0, 0, [0, 0], 0));
    assert!(naive > RAYS / 2 && naive_junction > RAYS / 2, "{naive} {naive_junction}");
    row(
        "T-junctions, coincident and 1e-13 thick walls",
        "rays slip between edges that are not shared, or start beyond a wall that is too thin",
        format!("{naive} of {RAYS} rays through a seam meet no inside"),
        format!(
            "{shared} pass a common edge, {through} a double wall, {junction} a T-junction, {turned} one \
             that is turned"
        ),
    );
}

#[test]
fn faces_that_share_edges_do_not_leak_in_any_position() {
    let none = Surfel::<f64>::NO_FACE;
    let mut random = Random::new(4);
    let mut out = 0;
    for _ in 0..50 {
        let turn = DQuat::from_axis_angle(random.direction(), random.between(0.0, 6.0));
        let mut tip = |axis: usize, sign: f64| {
            turn * (DVec3::AXES[axis] * sign + 0.2 * (random.in_cube() - 0.5))
        };
        let tips = [0, 1, 2].map(|axis| [tip(axis, -1.0), tip(axis, 1.0)]);
        let corner = |k: usize| [0, 1, 2].map(|axis| tips[axis][k >> axis & 1]);
        let faces: Vec<Triangle> =
            (0..8).map(|k| Triangle { vertices: corner(k), face: none }).collect();
        let occluders = Occluders::new(&faces).unwrap();
        let rays: Vec<[DVec3; 2]> = (0..2000)
            .map(|i| {
                let [a, b, _] = corner(i % 8);
                let on_edge = a.lerp(b, random.unit());
                let from = (random.in_cube() - 0.5) * 0.2;
                [from, from + (on_edge - from) * random.between(2.0, 4.0)]
            })
            .collect();
        out += leaks(&occluders, &rays);
    }
    assert_eq!(out, 0);
}

#[test]
fn boxes_in_each_other_hide_what_is_behind() {
    let mut scene = Scene::new();
    scene.add_room(DVec3::splat(-1.0), DVec3::splat(0.25), 0);
    scene.add_room(DVec3::splat(-0.25), DVec3::splat(1.0), 0);
    let occluders = Occluders::new(&scene.triangles).unwrap();
    let mut random = Random::new(5);
    let outwards = |_| [(random.in_cube() - 0.5) * 0.4, random.direction() * 3.0];
    let rays: Vec<[DVec3; 2]> = (0..RAYS).map(outwards).collect();
    let out = leaks(&occluders, &rays);
    assert_eq!(out, 0);
    row(
        "Boxes that lie in each other",
        "what is inside one box and inside the other is outside, by parity",
        "an even number of crossings: not hidden",
        format!("{out} of {RAYS} rays leave the common part: any wall hides"),
    );
}

#[test]
fn reflectances_near_one_converge_or_say_so() {
    // Rows by centroids, as they are: in the corners of a closed room their sums exceed 1.
    let scene = furnace(6);
    let kernel = Irradiance::<f64>::clamped();
    let row_of = |x: &Surfel| -> Vec<f64> {
        scene.surfels.iter().map(|y| kernel.factor(x, y) * y.area).collect()
    };
    let rows: Vec<Vec<f64>> = scene.surfels.iter().map(row_of).collect();
    let most = rows.iter().map(|row| row.iter().sum::<f64>()).fold(0.0, f64::max);
    let least = rows.iter().map(|row| row.iter().sum::<f64>()).fold(f64::INFINITY, f64::min);
    let gather = |scale: f64| {
        let rows = rows.clone();
        move |b: &[[f64; 1]]| {
            let sum = |row: &Vec<f64>| row.iter().zip(b).map(|(f, b)| scale * f * b[0]).sum();
            Ok::<_, std::convert::Infallible>(rows.iter().map(|row| [sum(row)]).collect())
        }
    };
    let n = rows.len();
    let (emission, stop) = (vec![[1.0]; n], Stop { tolerance: 1e-6, max_iterations: 400 });
    let solve = |reflectance: f64, scale: f64| {
        jacobi(&emission, &vec![[reflectance]; n], stop, gather(scale), |_, _| ())
    };
    assert!(most > 1.0, "{most}");
    // With sums of about 3 nothing converges, and the solver says so.
    let diverged = solve(0.99, 3.0 / least);
    assert!(matches!(diverged, Err(Error::Diverged { residual, .. }) if residual.is_finite()));
    let tame = solve(0.9, 1.0 / most).unwrap();
    let gradients = conjugate_gradients(
        &scene.surfels,
        &emission,
        &vec![[0.999]; n],
        stop,
        gather(1.0 / most),
        |_, _| (),
    )
    .unwrap();
    row(
        "Reflectance to 1, row sums above 1",
        "gathering multiplies errors by ρ times the row sum",
        format!("row sums to {most:.2}: errors grow"),
        format!(
            "`Diverged`, with the residual; scaled: {} gatherings at ρ = 0.9, {} of conjugate \
             gradients at 0.999",
            tame.iterations, gradients.iterations
        ),
    );
}

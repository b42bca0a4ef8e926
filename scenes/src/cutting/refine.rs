//! Elements as small as a tolerance asks for, and no smaller.

use crate::cutting::mesh::{Mesh, Whole, count, edge_lengths};
use crate::cutting::pieces::{Cuts, piece_count, piece_number};
use crate::cutting::slopes::Slopes;
use crate::scene::Scene;

/// What a tolerance asks of a scene's surfaces.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Refinement {
    /// Into how many pieces to cut each surface.
    pub cuts: Vec<Cuts>,
    /// The estimated relative l2 error of one constant per element, as the mesh is now. None where it
    /// isn't known: the field is zero, or too much of the area is in pieces that have no neighbours.
    pub error: Option<f64>,
}

/// The most that a piece may be longer than wide.
const MOST_ASPECT: f64 = 2.0;

/// How much finer a surface gets at once, at most, along each edge.
const STEP: f64 = 4.0;

/// The share of the area of which nothing may be known for an estimate to stand for the whole.
const UNKNOWN: f64 = 0.05;

impl Refinement {
    /// The cuts that bring the error of one constant per element down to `tolerance`, with at most
    /// `most` elements unless there are more surfaces. `mesh` is that of the scene, and `values` is a field on
    /// it: any number of bands per element, the elements one after the other.
    ///
    /// On a piece of edges a and b, the field is off its mean by ((a ∂_u f)² + (b ∂_v f)²)/12 in the mean
    /// square. The slopes are differences of neighbours, on the same surface or, of a surface in one piece,
    /// beyond its edges. With c that error of a surface at one piece, n pieces leave c/n; the least number
    /// of pieces in all that leave the tolerance has n ∝ √c. What has no neighbours at all is cut into
    /// four, so that something is known next time. A field of zeros asks for nothing.
    pub fn new(scene: &Scene, mesh: &Mesh, values: &[f64], tolerance: f64, most: usize) -> Self {
        let bands = values.len() / mesh.elements.len().max(1);
        let value = |element: usize| &values[element * bands..][..bands];
        let areas = || mesh.elements.iter().map(|element| element.surfel().area);
        let size: f64 = areas()
            .enumerate()
            .map(|(i, area)| area * value(i).iter().map(|v| v * v).sum::<f64>())
            .sum();
        let cuts: Vec<Cuts> =
            mesh.wholes.iter().take(scene.surfaces.len()).map(|whole| whole.cuts).collect();
        let errors = errors(scene, mesh, values);
        let known = errors.iter().flatten();
        let total: f64 = known.flatten().sum();
        let area_of = |whole: u32| errors.get(whole as usize).is_none_or(Option::is_none);
        let of_unknown = areas().zip(&mesh.origin).filter(|&(_, &origin)| area_of(origin));
        let unknown = of_unknown.map(|(area, _)| area).sum::<f64>() / areas().sum::<f64>();
        let is_known = size > 0.0 && unknown <= UNKNOWN;
        let error = is_known.then(|| (total / size).sqrt());
        if size <= 0.0 {
            return Self { cuts, error };
        }

        // What each surface would be off by as one piece along either edge.
        let whole = |k: usize| -> [f64; 2] {
            let known = errors[k].unwrap_or_default();
            std::array::from_fn(|axis| known[axis] * f64::from(cuts[k][axis]).powi(2))
        };
        // As many along either edge as its slopes ask for, but no slivers: they are near to too many.
        let ratio = |k: usize| {
            // A triangle's edges are all cut alike.
            if scene.surfaces[k].corners.len() == 3 {
                return 1.0;
            }
            let ([u, v], [a, b]) = (whole(k), edge_lengths(&scene.corners(&scene.surfaces[k])));
            let ratio = if v > 0.0 { (u / v).sqrt() } else { f64::INFINITY };
            let ratio = if u > 0.0 || v > 0.0 { ratio } else { a / b };
            ratio.clamp(a / b / MOST_ASPECT, a / b * MOST_ASPECT)
        };
        let strengths: Vec<f64> = (0..errors.len())
            .map(|k| (whole(k)[0] / ratio(k) + whole(k)[1] * ratio(k)).sqrt())
            .collect();
        let wanted = strengths.iter().sum::<f64>() / (tolerance.powi(2) * size);
        // Half of all elements at most go to what nothing is known of.
        let asked = 4 * errors.iter().filter(|known| known.is_none()).count();
        let asked = if 2 * asked <= most { asked } else { 0 };
        let cut = |k: usize, per_strength: f64| -> Cuts {
            if errors[k].is_none() {
                return if asked > 0 { [2; 2] } else { [1; 2] };
            }
            let pieces = strengths[k] * per_strength;
            let along = [(pieces * ratio(k)).sqrt(), (pieces / ratio(k)).sqrt()];
            std::array::from_fn(|axis| {
                let now = f64::from(cuts[k][axis]);
                along[axis].clamp(now / STEP, now * STEP).round().max(1.0) as u32
            })
        };
        let cut = &cut;
        let all = |per_strength: f64| (0..errors.len()).map(move |k| cut(k, per_strength));
        let fits = |per_strength: f64| count(scene, all(per_strength)) <= most as f64;
        let strength = strengths.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        let mut high = wanted.min(2.0 * most as f64 / strength);
        if !fits(high) {
            // Cuts are rounded, so that what fits has to be tried.
            let mut low = 0.0;
            for _ in 0..BISECTIONS {
                let middle = 0.5 * (low + high);
                if fits(middle) { low = middle } else { high = middle }
            }
            high = low;
        }
        Self { cuts: all(high).collect(), error }
    }
}

/// How often the number of elements that fit is bisected.
const BISECTIONS: usize = 20;

/// For each surface the mean square deviations from constants along its two edges, times area, both
/// sides together; none for a surface in one piece without neighbours.
fn errors(scene: &Scene, mesh: &Mesh, values: &[f64]) -> Vec<Option<[f64; 2]>> {
    let bands = values.len() / mesh.elements.len().max(1);
    let value = |element: usize| &values[element * bands..][..bands];
    let slopes_between = Slopes::new(scene, mesh, values);
    let of_surface = |(index, whole): (usize, &Whole)| -> Option<[f64; 2]> {
        let Whole { first, cuts } = *whole;
        let surface = &scene.surfaces[index];
        let corners = surface.corners.len();
        let count = piece_count(corners, cuts);
        let two_sided = scene.materials[surface.material].two_sided;
        let mut errors = [0.0; 2];
        for start in [Some(first), two_sided.then_some(first + count)].into_iter().flatten() {
            let along = if count == 1 {
                slopes_between.squares(index, start)?
            } else {
                slopes(corners, cuts, |piece| {
                    let area = mesh.elements[start + piece].surfel().area;
                    (area, value(start + piece))
                })
            };
            errors = [errors[0] + along[0], errors[1] + along[1]];
        }
        // Of a single piece nothing is known along its edge: there the field is taken to change as along
        // the other one.
        let [a, b] = edge_lengths(&scene.corners(surface));
        let [u, v] = errors;
        Some(match cuts {
            [nu @ 2..=u32::MAX, 1] => [u, u * (f64::from(nu) * b / a).powi(2)],
            [1, nv @ 2..=u32::MAX] => [v * (f64::from(nv) * a / b).powi(2), v],
            _ => errors,
        })
    };
    mesh.wholes.iter().take(scene.surfaces.len()).enumerate().map(of_surface).collect()
}

/// The mean square deviations along the two edges, times area, of the pieces of one side of a surface
/// with `corners` corners.
fn slopes<'a>(corners: usize, cuts: Cuts, piece: impl Fn(usize) -> (f64, &'a [f64])) -> [f64; 2] {
    let mut sums = [0.0; 2];
    for i in 0..cuts[0] {
        for j in 0..cuts[1] {
            let Some(here) = piece_number(corners, cuts, [i, j]) else { continue };
            let (area, value) = piece(here);
            for axis in 0..2 {
                let step = |by: i64| {
                    let mut at = [i64::from(i), i64::from(j)];
                    at[axis] += by;
                    let at = [u32::try_from(at[0]).ok()?, u32::try_from(at[1]).ok()?];
                    piece_number(corners, cuts, at).map(|other| piece(other).1)
                };
                let square = |a: &[f64], b: &[f64]| -> f64 {
                    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum()
                };
                let change = match (step(-1), step(1)) {
                    (Some(before), Some(after)) => square(before, after) / 4.0,
                    (Some(other), None) | (None, Some(other)) => square(value, other),
                    (None, None) => 0.0,
                };
                sums[axis] += area * change / 12.0;
            }
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cutting::mesh::even_cuts;
    use crate::scene::material::Material;
    use glam::DVec3;

    /// A floor of 2 × 1 and a triangle beside it.
    fn scene() -> Scene {
        let quad = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]];
        let triangle = [[3.0, 0.0], [5.0, 0.0], [3.0, 2.0]];
        let at = |[x, y]: [f64; 2]| DVec3::new(x, y, 0.0);
        let mut scene = Scene { materials: vec![Material::grey()], ..Scene::default() };
        scene.add(&quad.map(at), 0, 0);
        scene.add(&triangle.map(at), 0, 0);
        scene
    }

    fn refined(elements: usize, tolerance: f64, most: usize) -> (Refinement, f64) {
        let scene = scene();
        let cuts = even_cuts(&scene, elements).expect("cuts");
        let mesh = Mesh::with_cuts(&scene, &cuts).expect("a mesh");
        let field = |p: DVec3| 1.0 + p.x;
        let values: Vec<f64> =
            mesh.elements.iter().map(|element| field(element.surfel().position)).collect();
        // Off the mean of each piece, by a rule that is exact for linear fields.
        let mut squares = [0.0; 2];
        for (element, value) in mesh.elements.iter().zip(&values) {
            let corners = element.as_patch().expect("a patch").corners();
            let area = element.surfel().area;
            // Mean squares of linear functions of mean 0, by their values at the corners.
            let off: f64 = corners.iter().map(|c| (field(*c) - value).powi(2)).sum();
            squares[0] += area * off / 12.0;
            squares[1] += area * value * value;
        }
        let refinement = Refinement::new(&scene, &mesh, &values, tolerance, most);
        (refinement, (squares[0] / squares[1]).sqrt())
    }

    #[test]
    fn the_error_of_constants_is_known_and_falls_to_the_tolerance() {
        let (coarse, error) = refined(60, 0.02, 100_000);
        let found = coarse.error.expect("known");
        assert!((found / error - 1.0).abs() < 0.3, "{found} {error}");
        let scene = scene();
        let mesh = Mesh::with_cuts(&scene, &coarse.cuts).expect("a mesh");
        let values: Vec<f64> =
            mesh.elements.iter().map(|element| 1.0 + element.surfel().position.x).collect();
        let fine = Refinement::new(&scene, &mesh, &values, 0.02, 100_000);
        let found = fine.error.expect("known");
        assert!(found < 0.025 && found > 0.01, "{found}");
    }

    #[test]
    fn the_cap_holds_and_even_light_needs_few_elements() {
        let (capped, _) = refined(60, 1e-4, 400);
        let mesh = Mesh::with_cuts(&scene(), &capped.cuts).expect("a mesh");
        assert!((200..500).contains(&mesh.elements.len()), "{}", mesh.elements.len());
        let scene = scene();
        let cuts = even_cuts(&scene, 60).expect("cuts");
        let mesh = Mesh::with_cuts(&scene, &cuts).expect("a mesh");
        let even = vec![1.0; mesh.elements.len()];
        let refinement = Refinement::new(&scene, &mesh, &even, 0.01, 1000);
        assert_eq!(refinement.error, Some(0.0));
    }

    #[test]
    fn the_error_of_uncut_triangles_is_known_by_their_neighbours_and_they_are_cut() {
        // A square in 200 triangles with vertices of their own, and one of its edges folded up.
        let at = |k: usize, j: usize| {
            let (x, y) = (k as f64 / 10.0, j as f64 / 10.0);
            if k > 8 { DVec3::new(0.8, y, x - 0.8) } else { DVec3::new(x, y, 0.0) }
        };
        let mut scene = Scene { materials: vec![Material::grey()], ..Scene::default() };
        for (k, j) in (0..100).map(|number| (number % 10, number / 10)) {
            scene.add(&[at(k, j), at(k + 1, j), at(k + 1, j + 1)], 0, 0);
            scene.add(&[at(k, j), at(k + 1, j + 1), at(k, j + 1)], 0, 0);
        }
        let cuts = vec![[1, 1]; 200];
        let mesh = Mesh::with_cuts(&scene, &cuts).expect("a mesh");
        let field = |p: DVec3| [1.0 + 2.0 * p.x - p.y + p.z, 0.5];
        let values: Vec<f64> =
            mesh.elements.iter().flat_map(|e| field(e.surfel().position)).collect();
        let mut squares = [0.0; 2];
        for (element, value) in mesh.elements.iter().zip(values.chunks(2)) {
            let corners = element.as_patch().expect("a patch").corners();
            let off: f64 = corners.iter().map(|c| (field(*c)[0] - value[0]).powi(2)).sum();
            squares[0] += element.surfel().area * off / 12.0;
            squares[1] += element.surfel().area * (value[0].powi(2) + value[1].powi(2));
        }
        let error = (squares[0] / squares[1]).sqrt();
        let refinement = Refinement::new(&scene, &mesh, &values, 0.5 * error, 100_000);
        let found = refinement.error.expect("known");
        assert!(found > 0.9 * error && found < 1.4 * error, "{found} {error}");
        assert!(refinement.cuts.iter().filter(|&&cuts| cuts[0] > 1).count() > 150);
        let capped = Refinement::new(&scene, &mesh, &values, 0.5 * error, 300);
        let found = Mesh::with_cuts(&scene, &capped.cuts).expect("a mesh").elements.len();
        assert!((201..=300).contains(&found), "{found}");
    }

    #[test]
    fn slivers_count_by_their_area() {
        // A floor in triangles from one corner, some of them thinner than any light could tell.
        let ends = [0.0, 1e-11, 1e-9, 1e-6, 0.5, 1.0];
        let mut scene = Scene { materials: vec![Material::grey()], ..Scene::default() };
        for pair in ends.windows(2) {
            scene.add(&[DVec3::X * pair[0], DVec3::X * pair[1], DVec3::Y], 0, 0);
        }
        let mesh = Mesh::with_cuts(&scene, &[[1, 1]; 5]).expect("a mesh");
        let error = |first: f64| {
            let values = [first, 2.0, 2.0, 2.0, 2.1];
            Refinement::new(&scene, &mesh, &values, 0.1, 1000).error.expect("known")
        };
        let even = error(2.0);
        assert!(even > 0.01 && even < 0.1, "{even}");
        assert!((error(1.0) / even - 1.0).abs() < 1e-6, "{} {even}", error(1.0));
    }

    #[test]
    fn what_has_no_neighbours_is_unknown_and_cut_into_four() {
        let scene = scene();
        let mesh = Mesh::with_cuts(&scene, &[[1, 1], [1, 1]]).expect("a mesh");
        let refinement = Refinement::new(&scene, &mesh, &[1.0, 2.0], 0.1, 1000);
        assert_eq!((refinement.error, &refinement.cuts[..]), (None, &[[2, 2], [2, 2]][..]));
        let capped = Refinement::new(&scene, &mesh, &[1.0, 2.0], 0.1, 10);
        assert_eq!((capped.error, &capped.cuts[..]), (None, &[[1, 1], [1, 1]][..]));
        let dark = Refinement::new(&scene, &mesh, &[0.0, 0.0], 0.1, 1000);
        assert_eq!((dark.error, &dark.cuts[..]), (None, &[[1, 1], [1, 1]][..]));
        let floor = Mesh::with_cuts(&scene, &[[9, 9], [1, 1]]).expect("a mesh");
        let even = vec![1.0; 82];
        assert_eq!(Refinement::new(&scene, &floor, &even, 0.1, 1000).error, None);
    }
}

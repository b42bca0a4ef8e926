//! A smooth field on all surfaces, from one value per element.

use farfield_radiosity::{Element, Occluders};
use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::pictures::fit::Fit;
use crate::pictures::neighbours::Neighbours;
use crate::pictures::sight::Sight;
use crate::pictures::tone::Rgb;
use crate::pictures::vertices::{LIFT, SMOOTH_COSINE, Vertex, Vertices, size};

/// A field with values at the corners of all elements, the same wherever elements of one smooth
/// surface meet.
#[derive(Clone, Debug)]
pub(crate) struct Smooth {
    vertices: Vertices,
    /// One value per vertex, none negative.
    values: Vec<Rgb>,
}

impl Smooth {
    /// The field of which `values` are the means over the elements, one each: at every vertex a
    /// linear function fitted to the elements around it, by moving least squares. Only elements of
    /// the same smooth surface count, and those that none of the `occluders` hides. Under solids that
    /// stand on a surface, without its being cut there, the field goes on as it is around them, so that
    /// no darkness creeps out. `sight` is that of the same elements.
    pub(crate) fn new(
        elements: &[Element],
        sight: &Sight,
        occluders: &Occluders,
        values: &[Rgb],
    ) -> Self {
        let vertices = Vertices::new(elements, occluders);
        let sites: Vec<Site> =
            elements.par_iter().map(|element| Site::new(element, sight)).collect();
        let neighbours = Neighbours::new(sites.iter().map(|site| (site.position, site.reach)));
        let fit = |vertex: &Vertex, counts: &dyn Fn(&Site) -> bool| {
            let mut fit = Fit::EMPTY;
            neighbours.around(vertex.position, |index| {
                let site = &sites[index];
                let (weight, offset) = site.weight_at(vertex);
                if weight > 0.0 && counts(site) {
                    fit.add(weight, offset, &values[index]);
                }
            });
            fit.value(vertex.size)
        };
        let fitted = vertices.vertices.par_iter().map(|vertex| {
            let owner = &sites[vertex.element];
            let seen = |site: &Site| !site.is_hidden(vertex, owner, occluders);
            let lit = |site: &Site| !site.is_buried;
            let lifted = vertex.inside + LIFT * vertex.size * vertex.normal;
            let value = if sight.is_buried(lifted, vertex.normal) {
                fit(vertex, &lit)
            } else {
                fit(vertex, &|site| lit(site) && seen(site))
            };
            let value = value.or_else(|| fit(vertex, &seen)).unwrap_or(values[vertex.element]);
            value.map(|band| band.max(0.0))
        });
        let values = fitted.collect();
        Self { vertices, values }
    }

    /// The field at a point of an element, with [`parameters`](crate::pictures::sight::Seen::parameters) as a ray
    /// finds them. A disk has the same value everywhere.
    pub(crate) fn at(&self, element: usize, parameters: DVec2) -> Rgb {
        let corners = self.vertices.corners[element].map(|vertex| &self.values[vertex as usize]);
        let weights = corner_weights(parameters);
        [0, 1, 2].map(|band| (0..4).map(|k| weights[k] * corners[k][band]).sum())
    }

    /// The vertices at the corners of an element, as [`Vertices::corners`] has them.
    pub(crate) fn corners(&self, element: usize) -> [u32; 4] {
        self.vertices.corners[element]
    }

    /// Where all vertices are.
    pub(crate) fn positions(&self) -> impl Iterator<Item = DVec3> {
        self.vertices.vertices.iter().map(|vertex| vertex.position)
    }

    /// The values at all vertices.
    pub(crate) fn values(&self) -> &[Rgb] {
        &self.values
    }

    /// The point near `position`, which is at `parameters` of an element, where the smooth surface
    /// would be that the elements stand for, and its unit normal there. Flat surfaces stay as they are.
    pub(crate) fn surface(
        &self,
        element: usize,
        parameters: DVec2,
        position: DVec3,
    ) -> (DVec3, DVec3) {
        let corners = self.vertices.corners[element];
        let vertices = corners.map(|vertex| &self.vertices.vertices[vertex as usize]);
        let weights = corner_weights(parameters);
        let (mut lifted, mut normal) = (position, DVec3::ZERO);
        for (weight, vertex) in weights.into_iter().zip(vertices) {
            // Up to the tangential plane of each vertex where the surface is convex (Hanika, "Hacking
            // the shadow terminator", 2021); otherwise facets would shade their neighbours.
            let below = vertex.normal.dot(vertex.position - position).max(0.0);
            lifted += weight * below * vertex.normal;
            normal += weight * vertex.normal;
        }
        (lifted, normal.normalize_or(vertices[0].normal))
    }
}

/// How far an element's value reaches, relative to its [`size`].
const REACH: f64 = 2.5;
/// By how much elements may be larger than those at a vertex and still reach as far as they are large.
const COARSENING: f64 = 2.0;
/// How well the sum of two normals must be perpendicular to the line between their points, as a cosine:
/// on a plane and on a sphere it is exactly, while planes at two levels miss it by their distance.
const SAME_SURFACE: [f64; 2] = [0.25, 0.5];
/// The cosine between normals from which on elements count in full, 30°.
const FULL_COSINE: f64 = 0.866;

/// The weights of four corners at (u, v).
fn corner_weights(parameters: DVec2) -> [f64; 4] {
    let DVec2 { x: u, y: v } = parameters;
    [(1.0 - u) * (1.0 - v), u * (1.0 - v), u * v, (1.0 - u) * v]
}

/// What the fit needs to know of an element.
#[derive(Clone, Copy, Debug)]
struct Site {
    position: DVec3,
    normal: DVec3,
    face: u32,
    size: f64,
    reach: f64,
    is_buried: bool,
}

impl Site {
    fn new(element: &Element, sight: &Sight) -> Self {
        let (surfel, size) = (element.surfel(), size(element));
        let (position, normal, face) = (surfel.position, surfel.normal, surfel.face);
        let is_buried = sight.is_buried(position + LIFT * size * normal, normal);
        Self { position, normal, face, size, reach: REACH * size, is_buried }
    }

    /// The weight of this site at a vertex, 0 if it doesn't count there, and where it lies on the
    /// tangential plane.
    fn weight_at(&self, vertex: &Vertex) -> (f64, DVec2) {
        let line = self.position - vertex.position;
        let distance = line.length();
        let reach = self.reach.min(REACH * COARSENING * vertex.size);
        if distance >= reach {
            return (0.0, DVec2::ZERO);
        }
        let near = 1.0 - (distance / reach).powi(2);
        let agreement = smooth_step([SMOOTH_COSINE, FULL_COSINE], self.normal.dot(vertex.normal));
        let [full, none] = SAME_SURFACE;
        let step = (self.normal + vertex.normal).dot(line).abs();
        let same = smooth_step([-none, -full], -step / distance.max(f64::MIN_POSITIVE));
        let (u, v) = vertex.normal.any_orthonormal_pair();
        (near.powi(3) * agreement * same, DVec2::new(u.dot(line), v.dot(line)))
    }

    /// Whether anything stands between the site and a vertex of `owner`.
    fn is_hidden(&self, vertex: &Vertex, owner: &Self, occluders: &Occluders) -> bool {
        // The chord between two points of a convex surface runs below it by about an eighth of its
        // length times the angle between the normals: twice that clears its facets, too.
        let turn = self.position.distance(vertex.inside) * self.normal.distance(vertex.normal);
        let lift = LIFT * self.size.min(vertex.size) + 0.25 * turn;
        let (from, to) = (vertex.inside + lift * vertex.normal, self.position + lift * self.normal);
        occluders.blocked(from, to, [owner.face, self.face])
    }
}

/// From 0 below the first bound to 1 above the second, without kinks.
fn smooth_step([low, high]: [f64; 2], x: f64) -> f64 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::pictures::samples::{grid, scene_of, sheet};
    use farfield_radiosity::{Surfel, Triangle};

    /// What every element has if the field is `field`, which must be linear on each.
    fn means(elements: &[Element], field: impl Fn(DVec3) -> f64) -> Vec<Rgb> {
        let value = |element: &Element| field(element.surfel().position);
        elements.iter().map(|e| [value(e), 2.0 * value(e), 1.0]).collect()
    }

    fn open() -> Occluders {
        Occluders::new(&[]).expect("empty")
    }

    /// The field on elements with these occluders.
    pub(crate) fn smoothed(elements: &[Element], occluders: &Occluders, values: &[Rgb]) -> Smooth {
        let (scene, mesh) = scene_of(elements);
        let sight = Sight::new(&scene, &mesh).expect("finite");
        Smooth::new(elements, &sight, occluders, values)
    }

    const CORNERS: [DVec2; 4] = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];

    #[test]
    fn linear_fields_on_a_plane_are_exact_up_to_its_corners() {
        let (u, v) = (DVec3::new(3.0, 1.0, 0.5), DVec3::new(-0.5, 2.0, 1.0));
        let mut elements = grid(DVec3::ONE, u, v, [6, 4], 0);
        elements.extend(grid(DVec3::ONE + u, u, v, [9, 13], 1));
        let field = |p: DVec3| 40.0 + p.dot(DVec3::new(3.0, -2.0, 0.7));
        let smooth = smoothed(&elements, &open(), &means(&elements, field));
        for (index, element) in elements.iter().enumerate() {
            let corners = element.as_patch().expect("a patch").corners();
            for (corner, parameters) in corners.iter().zip(CORNERS) {
                let [value, twice, one] = smooth.at(index, parameters);
                assert!((value / field(*corner) - 1.0).abs() < 1e-10, "{value} at {corner}");
                assert!((twice / value - 2.0).abs() < 1e-10 && (one - 1.0).abs() < 1e-10);
            }
        }
    }

    #[test]
    fn surfaces_cut_differently_meet_without_a_seam() {
        let [x, y] = [DVec3::X, DVec3::Y];
        let (left, right) = (8, 13);
        let mut elements = grid(DVec3::ZERO, x, y, [8, left], 0);
        elements.extend(grid(x, x, y, [12, right], 1));
        let field = |p: DVec3| 2.0 + (3.0 * p.x).sin() * (2.0 * p.y).cos();
        let smooth = smoothed(&elements, &open(), &means(&elements, field));
        for k in 0..=1000 {
            let height = f64::from(k) / 1000.0;
            let value = |first: usize, count: usize, u: f64| {
                let cell = ((height * count as f64) as usize).min(count - 1);
                let v = height * count as f64 - cell as f64;
                smooth.at(first + cell, DVec2::new(u, v))[0]
            };
            let sides = [value(7 * left, left, 1.0), value(8 * left, right, 0.0)];
            assert!((sides[0] - sides[1]).abs() < 0.01, "{sides:?} at {height}");
            assert!((sides[0] - field(x + height * y)).abs() < 0.06, "{sides:?} at {height}");
        }
    }

    #[test]
    fn light_does_not_leak_under_a_wall() {
        let [x, y, z] = DVec3::AXES;
        // Cells end at the thin wall, or some stand on both sides of it.
        for (count, place) in [(20, 0.5), (21, 0.51), (21, 0.49)] {
            let floor = grid(DVec3::ZERO, x, y, [count, 10], 0);
            let wall = Occluders::new(&sheet(place * x, y, 0.4 * z, 1)).expect("finite");
            let lit = |p: DVec3| if p.x < place { 1.0 } else { 0.0 };
            let smooth = smoothed(&floor, &wall, &means(&floor, lit));
            for (index, element) in floor.iter().enumerate() {
                let corners = element.as_patch().expect("a patch").corners();
                let centre = element.surfel().position;
                for (corner, parameters) in corners.iter().zip(CORNERS) {
                    let expected = lit(corner.lerp(centre, 0.01));
                    let found = smooth.at(index, parameters)[0];
                    assert!((found - expected).abs() < 1e-9, "{corner}: {found}");
                }
            }
        }
    }

    #[test]
    fn the_foot_of_a_block_is_not_darkened_by_what_it_stands_on() {
        let [x, y, z] = DVec3::AXES;
        let floor = grid(DVec3::new(-2.0, -2.0, 0.0), 5.0 * x, 5.0 * y, [11, 11], 0);
        let covers = |p: DVec3| p.min_element() >= 0.0 && p.max_element() <= 1.0;
        let sides = [
            grid(DVec3::ZERO, x, z, [1, 1], 1),
            grid(x, y, z, [1, 1], 2),
            grid(x + y, -x, z, [1, 1], 3),
            grid(y, -y, z, [1, 1], 4),
            grid(z, x, y, [1, 1], 5),
        ];
        let elements = [vec![floor.clone()], sides.to_vec()].concat().concat();
        let corners = |e: &Element| e.as_patch().expect("a patch").corners().to_vec();
        let block = sides.iter().flatten().flat_map(|side| {
            let corners = corners(side);
            sheet(corners[0], corners[1] - corners[0], corners[3] - corners[0], side.surfel().face)
        });
        let block = Occluders::new(&block.collect::<Vec<_>>()).expect("finite");
        let field = |p: DVec3| 5.0 + p.x + 0.5 * p.y;
        let lit = |p: DVec3| if covers(p) { 0.0 } else { field(p) };
        let smooth = smoothed(&elements, &block, &means(&elements, lit));
        let mut straddling = 0;
        for (index, element) in floor.iter().enumerate() {
            let corners = corners(element);
            let covered = corners.iter().filter(|&&corner| covers(corner)).count();
            straddling += usize::from((1..4).contains(&covered));
            for (corner, parameters) in corners.iter().zip(CORNERS) {
                let found = smooth.at(index, parameters)[0];
                assert!(covered == 4 || (found - field(*corner)).abs() < 1e-9, "{corner}: {found}");
            }
        }
        assert!(straddling > 4);
    }

    #[test]
    fn a_curved_surface_is_smooth_and_an_edge_is_sharp() {
        let ring = |count: usize| -> Vec<Element> {
            let at = |k: usize| DVec2::from_angle(std::f64::consts::TAU * k as f64 / count as f64);
            let side = |k: usize| {
                let [a, b] = [at(k), at(k + 1)].map(|p| DVec3::new(p.x, p.y, 0.0));
                grid(a, b - a, DVec3::Z, [1, 3], k as u32)
            };
            (0..count).flat_map(side).collect()
        };
        for (count, is_smooth) in [(24, true), (4, false)] {
            let elements = ring(count);
            let sides: Vec<_> = elements
                .iter()
                .flat_map(|e| {
                    let corners = e.as_patch().expect("a patch").corners();
                    [[0, 1, 2], [0, 2, 3]].map(|t| t.map(|k: usize| corners[k]))
                })
                .enumerate()
                .map(|(k, vertices)| Triangle { vertices, face: (k / 6) as u32 })
                .collect();
            let occluders = Occluders::new(&sides).expect("finite");
            let values = means(&elements, |p| 2.0 + p.x);
            let smooth = smoothed(&elements, &occluders, &values);
            let across = smooth.at(1, DVec2::X)[0] - smooth.at(4, DVec2::ZERO)[0];
            assert_eq!(across.abs() < 1e-12, is_smooth, "{count} sides: {across}");
            if is_smooth {
                let edge = 2.0 + (std::f64::consts::TAU / 24.0).cos();
                assert!((smooth.at(1, DVec2::X)[0] - edge).abs() < 0.04);
                let (_, normal) = smooth.surface(1, DVec2::X, DVec3::X);
                let radial = elements[1].as_patch().expect("a patch").corners()[1].with_z(0.0);
                assert!(normal.abs_diff_eq(radial, 1e-9), "{normal} {radial}");
            }
        }
    }

    #[test]
    fn levels_of_a_stair_keep_apart() {
        let [x, y, z] = DVec3::AXES;
        let mut elements = grid(DVec3::ZERO, x, y, [5, 5], 0);
        elements.extend(grid(x + 0.2 * z, x, y, [5, 5], 1));
        let values = means(&elements, |p| if p.z > 0.1 { 1.0 } else { 0.0 });
        let riser = Occluders::new(&sheet(x, y, 0.2 * z, 2)).expect("finite");
        let smooth = smoothed(&elements, &riser, &values);
        for index in 0..50 {
            for parameters in CORNERS {
                let expected = f64::from(u8::from(index >= 25));
                assert!((smooth.at(index, parameters)[0] - expected).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn few_neighbours_and_steep_falls_give_means_and_nothing_negative() {
        let alone = grid(DVec3::ZERO, DVec3::X, DVec3::Y, [1, 1], 0);
        let smooth = smoothed(&alone, &open(), &[[1.0, 2.0, 3.0]]);
        let found = smooth.at(0, DVec2::ONE);
        assert!((found[0] - 1.0).abs() < 1e-12 && (found[2] - 3.0).abs() < 1e-12);
        // A row has a slope along itself only.
        let row = grid(DVec3::ZERO, 4.0 * DVec3::X, DVec3::Y, [4, 1], 0);
        let smooth = smoothed(&row, &open(), &means(&row, |p| 1.0 + p.x));
        assert!((smooth.at(3, DVec2::X)[0] - 5.0).abs() < 1e-12);
        assert!((smooth.at(3, DVec2::ONE)[0] - 5.0).abs() < 1e-12);
        let smooth = smoothed(&row, &open(), &means(&row, |p| (2.0 - p.x).max(0.0)));
        assert_eq!(smooth.at(3, DVec2::X)[0], 0.0);
        let disks: Vec<_> = (0..2)
            .map(|k| {
                let position = f64::from(k) * DVec3::X;
                Element::disk(Surfel { position, normal: DVec3::Z, area: 1.0, face: k as u32 })
            })
            .collect();
        let smooth = smoothed(&disks, &open(), &[[1.0; 3], [2.0; 3]]);
        assert!((smooth.at(0, DVec2::ONE)[0] - 1.0).abs() < 1e-9);
    }
}

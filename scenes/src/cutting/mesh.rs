//! The elements that a scene is cut into.

use farfield_radiosity::{Element, Patch, Surfel, Triangle};
use glam::DVec3;

use crate::cutting::pieces::{Cuts, pieces};
use crate::scene::Scene;
use crate::scene::error::SceneError;
use crate::scene::geometry::{fan, regular_polygon, vector_area};
use crate::scene::place::rounded;
use crate::scene::surface::{ScenePoint, Surface};

/// How many elements a mesh may have.
pub(crate) const MOST_ELEMENTS: usize = 4_000_000;

/// A scene in elements.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct Mesh {
    /// The elements; the two sides of a sheet are two elements with opposite normals.
    pub elements: Vec<Element>,
    /// For each element, the index of its surface, or the number of surfaces plus the index of its point.
    pub origin: Vec<u32>,
    /// For each element, the index of its material.
    pub material: Vec<u32>,
    /// What hides: the surfaces, and hexagons for points, in triangles.
    pub triangles: Vec<Triangle>,
    /// For each triangle, what it is of, as in `origin`.
    pub(crate) owners: Vec<u32>,
    /// What has become of each surface, then of each point.
    pub(crate) wholes: Vec<Whole>,
}

/// A surface or a point in its elements.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Whole {
    /// The first of its elements.
    pub(crate) first: usize,
    /// Into how many pieces it is cut.
    pub(crate) cuts: Cuts,
}

impl Mesh {
    /// A scene in about `elements` elements of nearly equal size, by [`even_cuts`].
    ///
    /// # Errors
    /// Those of [`even_cuts`] and [`Mesh::with_cuts`].
    pub fn new(scene: &Scene, elements: usize) -> Result<Self, SceneError> {
        Self::with_cuts(scene, &even_cuts(scene, elements)?)
    }

    /// A scene whose surfaces are cut as given: quadrilaterals into grids, triangles into rows of similar
    /// ones. First come the elements of surfaces, the backs of one, if it is two-sided, after its fronts
    /// in the same order; then those of points.
    ///
    /// # Errors
    /// What [`Scene::check`] refuses, [`SceneError::Cuts`] unless there is one entry of positive numbers
    /// for each surface, [`SceneError::TooManyElements`], or [`SceneError::Surface`] for a surface whose
    /// pieces aren't flat and convex.
    pub fn with_cuts(scene: &Scene, cuts: &[Cuts]) -> Result<Self, SceneError> {
        scene.check()?;
        if cuts.len() != scene.surfaces.len() || cuts.iter().flatten().any(|&cut| cut == 0) {
            let (found, expected) = (cuts.len(), scene.surfaces.len());
            return Err(SceneError::Cuts { found, expected });
        }
        let found = count(scene, cuts.iter().copied());
        if found > MOST_ELEMENTS as f64 {
            return Err(SceneError::TooManyElements { found, limit: MOST_ELEMENTS });
        }
        let mut mesh = Self::default();
        for (index, (surface, &cuts)) in scene.surfaces.iter().zip(cuts).enumerate() {
            let added = mesh.add_surface(scene, surface, cuts);
            added.map_err(|source| scene.refusal(index, source))?;
        }
        // Disks are faces of their own, after those of the surfaces.
        let faces = scene.surfaces.iter().map(|surface| surface.face);
        let free = faces.filter(|&face| face != Surfel::<f64>::NO_FACE).max().map_or(0, |f| f + 1);
        for (index, point) in scene.points.iter().enumerate() {
            let two_sided = scene.materials[point.material].two_sided;
            mesh.add_point(point, free + index as u32, two_sided);
        }
        Ok(mesh)
    }

    /// An element in words: where it is, and which surface it is of.
    pub fn describe(&self, scene: &Scene, element: usize) -> String {
        let place = self.elements.get(element).map(|element| element.surfel().position);
        let (Some(place), Some(&whole)) = (place, self.origin.get(element)) else {
            return format!("element {element}");
        };
        format!("the element at {} of {}", rounded(place), scene.describe(whole as usize))
    }

    fn add_surface(
        &mut self,
        scene: &Scene,
        surface: &Surface,
        cuts: Cuts,
    ) -> Result<(), farfield_radiosity::Error> {
        self.begin(cuts);
        let corners = scene.corners(surface);
        let pieces = pieces(&corners, cuts);
        let backs = pieces.iter().filter(|_| scene.materials[surface.material].two_sided);
        let backs = backs.map(|piece| piece.iter().rev().copied().collect());
        for piece in pieces.iter().cloned().chain(backs) {
            let element = Element::patch(Patch::new(&piece)?, surface.face);
            self.add(element, surface.material);
        }
        self.add_triangles(&corners, surface.face);
        Ok(())
    }

    fn add_point(&mut self, point: &ScenePoint, face: u32, two_sided: bool) {
        self.begin([1, 1]);
        let ScenePoint { position, normal, area, material } = *point;
        self.add(Element::disk(Surfel { position, normal, area, face }), material);
        if two_sided {
            let back = Surfel { position, normal: -normal, area, face };
            self.add(Element::disk(back), material);
        }
        self.add_triangles(&regular_polygon::<6>(position, normal, area), face);
    }

    fn begin(&mut self, cuts: Cuts) {
        self.wholes.push(Whole { first: self.elements.len(), cuts });
    }

    /// The index of what has begun last.
    fn latest(&self) -> u32 {
        self.wholes.len() as u32 - 1
    }

    fn add_triangles(&mut self, corners: &[DVec3], face: u32) {
        self.triangles.extend(fan(corners).map(|vertices| Triangle { vertices, face }));
        self.owners.resize(self.triangles.len(), self.latest());
    }

    fn add(&mut self, element: Element, material: usize) {
        self.elements.push(element);
        self.origin.push(self.latest());
        self.material.push(material as u32);
    }
}

/// How many sides all surfaces and points have: the least number of elements.
fn sides(scene: &Scene) -> usize {
    count(scene, scene.surfaces.iter().map(|_| [1, 1])) as usize
}

/// How many elements surfaces with these cuts, and points, come to.
pub(crate) fn count(scene: &Scene, cuts: impl Iterator<Item = Cuts>) -> f64 {
    let sides = |material: usize| if scene.materials[material].two_sided { 2.0 } else { 1.0 };
    let of_surface = |(surface, [nu, nv]): (&Surface, Cuts)| {
        let last = if surface.corners.len() == 3 { nu } else { nv };
        sides(surface.material) * f64::from(nu) * f64::from(last)
    };
    let surfaces: f64 = scene.surfaces.iter().zip(cuts).map(of_surface).sum();
    surfaces + scene.points.iter().map(|point| sides(point.material)).sum::<f64>()
}

/// The cuts that make about `elements` elements of nearly equal size: more only if it takes more to have
/// one for every side of every surface and point, and fewer where many surfaces of equal size would go
/// from too few to too many at once.
///
/// Of however many surfaces there are, large ones are cut first: half of `elements` is theirs, beyond
/// one for every side. [`fewest_elements`] says how many take nothing beyond what is asked for.
///
/// # Errors
/// What [`Scene::check`] refuses, and [`SceneError::TooManyElements`] if too many are asked for.
pub fn even_cuts(scene: &Scene, elements: usize) -> Result<Vec<Cuts>, SceneError> {
    if elements > MOST_ELEMENTS {
        let (found, limit) = (elements as f64, MOST_ELEMENTS);
        return Err(SceneError::TooManyElements { found, limit });
    }
    scene.check()?;
    let lengths: Vec<_> = scene.surfaces.iter().map(|s| edge_lengths(&scene.corners(s))).collect();
    let cuts = |edge: f64| lengths.iter().map(move |lengths| lengths.map(|l| pieces_of(l, edge)));
    let most = elements.max(sides(scene) + elements / SHARE);
    let fits = |edge: f64| count(scene, cuts(edge)) <= most as f64;
    // No surface is cut at all if elements may be as long as the longest of them.
    let mut high = lengths.iter().flatten().copied().fold(0.0, f64::max);
    if !fits(high) {
        return Ok(cuts(high).collect());
    }
    let mut low = high;
    while low > 0.0 && fits(low) {
        high = low;
        low *= 0.5;
    }
    for _ in 0..BISECTIONS {
        let edge = 0.5 * (low + high);
        if fits(edge) {
            high = edge;
        } else {
            low = edge;
        }
    }
    // No more than asked for goes to what is no larger than that many equal elements.
    let beyond = count(scene, cuts(high)) > elements as f64;
    let area: f64 = lengths.iter().map(|[a, b]| a * b).sum();
    let even = (area / elements.max(1) as f64).sqrt();
    Ok(cuts(if beyond { high.max(even) } else { high }).collect())
}

/// How many elements [`even_cuts`] has to be asked for so that it makes no more.
///
/// # Errors
/// Those of [`even_cuts`].
pub fn fewest_elements(scene: &Scene) -> Result<usize, SceneError> {
    scene.check()?;
    let least = sides(scene);
    let cuts = even_cuts(scene, least.min(MOST_ELEMENTS))?;
    let are_alike = count(scene, cuts.into_iter()) <= least as f64;
    // What is left when the large surfaces have had their share.
    Ok(if are_alike { least } else { (least * SHARE).div_ceil(SHARE - 1) })
}

/// One part in so many of the elements asked for is kept for cutting large surfaces.
const SHARE: usize = 2;

/// How often the edge of elements is bisected, down to a thousandth.
const BISECTIONS: usize = 10;

/// Into how many pieces of about the length `edge` to cut a length.
fn pieces_of(length: f64, edge: f64) -> u32 {
    // Saturates where there would be more pieces than numbers.
    (length / edge).round().max(1.0) as u32
}

/// Mean lengths of a quadrilateral across and along. For a triangle the edge of the square of
/// the same area, so that its pieces are as large as those of quadrilaterals.
pub(crate) fn edge_lengths(corners: &[DVec3]) -> [f64; 2] {
    match *corners {
        [a, b, c, d] => {
            [0.5 * (a.distance(b) + d.distance(c)), 0.5 * (a.distance(d) + b.distance(c))]
        }
        _ => [vector_area(corners).length().sqrt(); 2],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generators::{GENERATORS, generate};
    use crate::scene::material::Material;

    fn single(corners: &[DVec3], two_sided: bool) -> Scene {
        let material = Material { two_sided, ..Material::grey() };
        let mut scene = Scene { materials: vec![material], ..Scene::default() };
        scene.add(corners, 0, 3);
        scene
    }

    fn rectangle(x: f64, y: f64) -> [DVec3; 4] {
        [DVec3::ZERO, DVec3::X * x, DVec3::new(x, y, 0.0), DVec3::Y * y]
    }

    fn cloud(two_sided: bool) -> Scene {
        let mut scene = single(&rectangle(2.0, 1.0), two_sided);
        let normal = DVec3::new(0.6, 0.0, 0.8);
        let position = DVec3::new(1.0, 2.0, 3.0);
        scene.points = vec![ScenePoint { position, normal, area: 0.7, material: 0 }; 3];
        scene
    }

    #[test]
    fn generated_scenes_keep_their_area_and_have_about_as_many_elements_as_asked_for() {
        for name in GENERATORS {
            let scene = generate(name).expect("listed");
            let sides = |s: &Surface| if scene.materials[s.material].two_sided { 2.0 } else { 1.0 };
            let total: f64 = scene.surfaces.iter().map(|s| sides(s) * scene.area(s)).sum();
            let least = scene.surfaces.iter().map(sides).sum::<f64>() as usize;
            for asked in [1, 3_000, 10_000, 30_000] {
                let mesh = Mesh::new(&scene, asked).expect("valid");
                let found = mesh.elements.len();
                assert!(found <= asked.max(least), "{name} {asked}: {found}");
                // Equal triangles, as in spheres, all go from n² to (n + 1)² pieces at once.
                let few = if ["sphere", "bowl"].contains(&name) { 0.25 } else { 0.85 };
                assert!(found as f64 >= few * asked as f64, "{name} {asked}: {found}");
                let sum: f64 = mesh.elements.iter().map(|e| e.surfel().area).sum();
                assert!((sum / total - 1.0).abs() < 1e-12, "{name} {asked}");
                assert_eq!((mesh.origin.len(), mesh.material.len()), (found, found));
            }
        }
    }

    #[test]
    fn large_surfaces_are_cut_however_many_small_ones_there_are() {
        let small = |k: usize| {
            let at = DVec3::new((k % 40) as f64, (k / 40) as f64, 1.0) / 100.0;
            [at, at + 0.01 * DVec3::X, at + 0.01 * DVec3::Y]
        };
        let mut scene = single(&rectangle(1.0, 1.0), false);
        (0..1200).for_each(|k| scene.add(&small(k), 0, 4));
        assert_eq!(fewest_elements(&scene).expect("valid"), 2402);
        for asked in [100, 600, 1200, 2402, 3000] {
            let mesh = Mesh::new(&scene, asked).expect("valid");
            let of_floor = mesh.origin.iter().filter(|&&origin| origin == 0).count();
            assert!(of_floor as f64 > 0.6 * (asked / 2) as f64, "{asked}: {of_floor}");
            let found = mesh.elements.len();
            assert!(found <= asked.max(1201 + asked / 2), "{asked}: {found}");
        }
        scene.surfaces.remove(0);
        assert_eq!(fewest_elements(&scene).expect("valid"), 1200);
    }

    #[test]
    fn elements_know_their_surface_its_material_and_its_face() {
        let scene = generate("columns").expect("listed");
        let mesh = Mesh::new(&scene, 3_000).expect("valid");
        let mut seen = vec![false; scene.surfaces.len()];
        for ((element, &origin), &material) in
            mesh.elements.iter().zip(&mesh.origin).zip(&mesh.material)
        {
            let surface = &scene.surfaces[origin as usize];
            seen[origin as usize] = true;
            assert_eq!(surface.material, material as usize);
            let surfel = element.surfel();
            assert_eq!(surface.face, surfel.face);
            let corners = scene.corners(surface);
            let normal = vector_area(&corners).normalize();
            assert!(surfel.normal.distance(normal) < 1e-7);
            assert!(normal.dot(surfel.position - corners[0]).abs() < 1e-9);
        }
        assert!(seen.iter().all(|&seen| seen));
        let occluders: f64 = mesh.triangles.iter().map(|t| vector_area(&t.vertices).length()).sum();
        let total: f64 = scene.surfaces.iter().map(|s| scene.area(s)).sum();
        assert!((occluders / total - 1.0).abs() < 1e-12);
    }

    #[test]
    fn elements_are_nearly_square() {
        let mesh = Mesh::new(&single(&rectangle(6.0, 1.0), false), 700).expect("valid");
        let mut sides = mesh.elements.iter().map(|element| {
            let corners = element.as_patch().expect("a patch").corners();
            corners[0].distance(corners[1]) / corners[0].distance(corners[3])
        });
        assert!(sides.all(|ratio| (ratio - 1.0).abs() < 0.1));
    }

    #[test]
    fn two_sided_surfaces_have_backs() {
        for (corners, number) in [(&rectangle(2.0, 1.0)[..], 72), (&rectangle(2.0, 1.0)[..3], 50)] {
            let scene = single(corners, true);
            let mesh = Mesh::new(&scene, number + 1).expect("valid");
            assert_eq!(mesh.elements.len(), number);
            let (fronts, backs) = mesh.elements.split_at(number / 2);
            for (front, back) in fronts.iter().zip(backs) {
                let (front, back) = (front.surfel(), back.surfel());
                assert!(front.normal.distance(DVec3::Z) < 1e-15 && back.normal == -front.normal);
                assert!(front.position.distance(back.position) < 1e-15);
                assert_eq!((front.face, back.face), (3, 3));
            }
            assert_eq!(mesh.triangles.len(), corners.len() - 2);
        }
    }

    #[test]
    fn points_are_disks_that_hide_what_is_behind_them() {
        for two_sided in [false, true] {
            let scene = cloud(two_sided);
            let sides = if two_sided { 2 } else { 1 };
            let mesh = Mesh::new(&scene, 1).expect("valid");
            assert_eq!(mesh.elements.len(), 4 * sides);
            assert_eq!(mesh.origin[4 * sides - 1], 3);
            let disks = &mesh.elements[sides..];
            assert!(disks.iter().all(|disk| disk.as_patch().is_none()));
            let faces: Vec<_> = disks.iter().step_by(sides).map(|d| d.surfel().face).collect();
            assert_eq!(faces, [4, 5, 6]);
            let hexagon: Vec<_> = mesh.triangles.iter().filter(|t| t.face == 5).collect();
            let area: DVec3 = hexagon.iter().map(|t| vector_area(&t.vertices)).sum();
            assert!(area.distance(0.7 * scene.points[1].normal) < 1e-15);
            let centre: DVec3 = hexagon[1].vertices[0] + hexagon[1].vertices[2];
            assert!((0.5 * centre).distance(scene.points[1].position) < 1e-15);
        }
    }

    #[test]
    fn too_many_elements_and_wrong_cuts_are_refused() {
        let scene = single(&rectangle(1.0, 1.0), false);
        let message = |result: Result<Mesh, SceneError>| result.expect_err("refused").to_string();
        let refused = message(Mesh::new(&scene, MOST_ELEMENTS + 1));
        assert_eq!(refused, "4000001 elements: expected 4000000 at most");
        let refused = message(Mesh::with_cuts(&scene, &[[u32::MAX; 2]]));
        assert_eq!(refused, "18446744065119617000 elements: expected 4000000 at most");
        for cuts in [&[][..], &[[1, 0]], &[[1, 1], [1, 1]]] {
            assert!(message(Mesh::with_cuts(&scene, cuts)).starts_with("cuts of "));
        }
        assert!(message(Mesh::new(&Scene::default(), 10)).contains("neither surfaces nor points"));
        let mut bent = scene.clone();
        bent.vertices[2].z = 0.5;
        assert!(message(Mesh::new(&bent, 10)).starts_with("surface 0: "));
        assert!(message(Mesh::with_cuts(&bent, &[[1, 1]])).starts_with("surface 0: "));
        let mut torn = scene.clone();
        torn.vertices.pop();
        assert!(message(Mesh::with_cuts(&torn, &[[1, 1]])).contains("has a corner at vertex 3"));
    }
}

//! Light straight from lamps to a point, gathered over their surfaces.

use std::collections::HashMap;
use std::f64::consts::FRAC_1_PI;

use farfield_radiosity::{Occluders, Patch, Segment};
use glam::DVec3;

use crate::cutting::mesh::Mesh;
use crate::cutting::pieces::{Cuts, pieces};
use crate::pictures::tone::Rgb;
use crate::scene::Scene;
use crate::scene::material::Material;

/// Whether light straight from emitting surfaces is better gathered per pixel: it has sharp shadows
/// then, and needs rays to every lamp. So if lamps are few, of little area, and all of them surfaces.
/// Otherwise the smooth field of a picture must hold all irradiance, not only the indirect part.
pub fn direct_light_by_pixel(scene: &Scene) -> bool {
    let shines = |index: usize| scene.materials.get(index).is_some_and(emits);
    let lamps = || scene.surfaces.iter().filter(|surface| shines(surface.material));
    let points = scene.points.iter().map(|point| point.area).sum::<f64>();
    let whole = scene.surfaces.iter().map(|s| scene.area(s)).sum::<f64>() + points;
    let emitting: f64 = lamps().map(|s| scene.area(s)).sum();
    (1..=MOST_LAMPS).contains(&lamps().count())
        && emitting < MOST_AREA * whole
        && !scene.points.iter().any(|point| shines(point.material))
}

/// Light that a picture gathers pixel by pixel, with sharp shadows.
#[derive(Clone, Debug, PartialEq)]
pub struct ByPixel {
    /// The irradiance \[W/m²\] of all other light, element by element and band by band.
    pub rest: Vec<f64>,
    /// Whether what comes straight from lamps is gathered, which is worth it where [`direct_light_by_pixel`] says so.
    pub lamps: bool,
    /// The direction to the sun, a unit vector, and what a plane across its beam receives \[W/m²\] in every band, if
    /// there is a sun.
    pub sun: Option<(DVec3, f64)>,
}

impl ByPixel {
    /// Only what comes straight from lamps.
    pub fn of_lamps(rest: Vec<f64>) -> Self {
        Self { rest, lamps: true, sun: None }
    }
}

/// Emitting surfaces and the sun, ready to be gathered from.
#[derive(Clone, Debug)]
pub(crate) struct Lamps {
    lamps: Vec<Lamp>,
    /// From any point to beyond everything, towards the sun; and what a plane across its beam receives.
    sun: Option<(DVec3, f64)>,
    /// How many turns a pixel takes.
    turns: usize,
}

/// Where light arrives.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Receiver {
    /// The place, on or slightly above the surface.
    pub(crate) position: DVec3,
    /// Unit normal.
    pub(crate) normal: DVec3,
    /// The face that never hides it.
    pub(crate) face: u32,
}

impl Lamps {
    /// The surfaces of `scene` whose elements emit: `emission` has the exitance of each element of
    /// `mesh` \[W/m²\]. Disks are left out. The lamps' points are distributed over `rays`² turns.
    pub(crate) fn new(scene: &Scene, mesh: &Mesh, emission: &[Rgb], rays: usize) -> Self {
        let mut lamps: Vec<(Patch, Rgb, u32)> = Vec::new();
        let mut known: HashMap<u32, Vec<DVec3>> = HashMap::new();
        for ((element, &origin), exitance) in mesh.elements.iter().zip(&mesh.origin).zip(emission) {
            let (normal, face) = (element.surfel().normal, element.surfel().face);
            let sides = known.entry(origin).or_default();
            if exitance.iter().all(|&band| band <= 0.0) || sides.iter().any(|n| n.dot(normal) > 0.0)
            {
                continue;
            }
            let surface = scene.surfaces.get(origin as usize);
            let whole = surface.and_then(|surface| turned_to(normal, &scene.corners(surface)).ok());
            if whole.is_some() {
                sides.push(normal);
            }
            // What is no patch as a whole still shines piece by piece.
            if let Some(lamp) = whole.or(element.as_patch().copied()) {
                lamps.push((lamp, *exitance, face));
            }
        }
        let whole: f64 = lamps.iter().map(|(lamp, ..)| lamp.area()).sum();
        let lamps = lamps.iter().map(|&(patch, exitance, face)| {
            let count = (PIECES * patch.area() / whole).max(LEAST_PIECES);
            let pieces = pieces(patch.corners(), counts(patch.corners(), count)).into_iter();
            let pieces = pieces.filter_map(|corners| Piece::new(&corners, rays)).collect();
            Lamp { whole: Shape::new(patch), exitance, face, pieces }
        });
        Self { lamps: lamps.collect(), sun: None, turns: rays * rays }
    }

    /// The same, and the sun of a scene in these elements, if there is one.
    pub(crate) fn with_sun(mut self, mesh: &Mesh, sun: Option<(DVec3, f64)>) -> Self {
        let corners = || mesh.triangles.iter().flat_map(|triangle| triangle.vertices);
        let low = corners().fold(DVec3::INFINITY, DVec3::min);
        let high = corners().fold(DVec3::NEG_INFINITY, DVec3::max);
        let reach = low.distance(high).max(f64::MIN_POSITIVE);
        self.sun = sun.map(|(to_sun, irradiance)| (2.0 * reach * to_sun, irradiance));
        self
    }

    /// The irradiance straight from the lamps \[W/m²\] by the points of one turn. Over all turns every
    /// lamp is covered evenly. A lamp counts with its form factor, and its pieces with their shares in it; a piece
    /// is seen as a whole or not at all.
    pub(crate) fn irradiance(&self, receiver: &Receiver, turn: usize, shadows: &Occluders) -> Rgb {
        let turn = turn % self.turns;
        let faced = self.lamps.iter().map(|lamp| (lamp, lamp.whole.form_factor(receiver, FAR)));
        let faced: Vec<_> = faced.filter(|&(_, factor)| factor > 0.0).collect();
        let from = receiver.position;
        let segments = faced.iter().flat_map(|(lamp, _)| {
            let segment = |piece: &Piece| {
                let faces = [receiver.face, lamp.face];
                Segment { ends: [from, piece.points[turn]], faces }
            };
            lamp.pieces.iter().map(segment)
        });
        let segments: Vec<Segment> = segments.collect();
        let mut hidden = vec![false; segments.len()];
        shadows.blocked_each(&segments, |k, is_hidden| hidden[k] = is_hidden);
        let (mut sum, mut rest) = ([self.beam(receiver, shadows); 3], &hidden[..]);
        for (lamp, factor) in faced {
            let (own, others) = rest.split_at(lamp.pieces.len());
            rest = others;
            let factor = factor * if own.contains(&true) { lamp.share(own, receiver) } else { 1.0 };
            sum = [0, 1, 2].map(|band| sum[band] + factor * lamp.exitance[band]);
        }
        sum
    }

    /// The irradiance by the sun.
    fn beam(&self, receiver: &Receiver, shadows: &Occluders) -> f64 {
        let Some((way, irradiance)) = self.sun else { return 0.0 };
        let &Receiver { position, normal, face } = receiver;
        let cosine = normal.dot(way) / way.length();
        let is_lit = cosine > 0.0 && !shadows.blocked(position, position + way, [face; 2]);
        if is_lit { cosine * irradiance } else { 0.0 }
    }
}

/// The most lamps of which light is gathered per pixel.
const MOST_LAMPS: usize = 8;
/// The largest share of a scene's area that they may have.
const MOST_AREA: f64 = 0.1;
/// About how many pieces all lamps have together.
const PIECES: f64 = 16.0;
/// About how many pieces a lamp has at least.
const LEAST_PIECES: f64 = 4.0;
/// Beyond this many times its extent, a shape's form factor is that of its centroid to within a
/// thousandth.
const FAR: f64 = 12.0;
/// Beyond this many, form factors of centroids tell which shares the pieces of a lamp have in its own.
const NOT_NEAR: f64 = 4.0;

/// An emitting surface.
#[derive(Clone, Debug)]
struct Lamp {
    whole: Shape,
    exitance: Rgb,
    face: u32,
    pieces: Vec<Piece>,
}

impl Lamp {
    /// The share of its light that comes to a receiver from those pieces which aren't hidden.
    fn share(&self, hidden: &[bool], receiver: &Receiver) -> f64 {
        let (mut seen, mut all) = (0.0, 0.0);
        for (piece, &is_hidden) in self.pieces.iter().zip(hidden) {
            let factor = piece.shape.form_factor(receiver, NOT_NEAR);
            all += factor;
            seen += if is_hidden { 0.0 } else { factor };
        }
        if all > 0.0 { seen / all } else { 0.0 }
    }
}

/// A piece of a lamp.
#[derive(Clone, Debug)]
struct Piece {
    shape: Shape,
    /// One point per turn.
    points: Vec<DVec3>,
}

impl Piece {
    fn new(corners: &[DVec3], rays: usize) -> Option<Self> {
        let patch = Patch::new(corners).ok()?;
        let parts = pieces(corners, [rays as u32; 2]);
        let points =
            parts.iter().map(|part| part.iter().sum::<DVec3>() / part.len() as f64).collect();
        Some(Self { shape: Shape::new(patch), points })
    }
}

/// What shines as a whole.
#[derive(Clone, Debug)]
struct Shape {
    patch: Patch,
    centroid: DVec3,
    /// The longest of its diagonals and edges.
    extent: f64,
}

impl Shape {
    fn new(patch: Patch) -> Self {
        let corners = patch.corners();
        let reach = |from: &DVec3| corners.iter().map(|to| from.distance(*to)).fold(0.0, f64::max);
        let extent = corners.iter().map(reach).fold(0.0, f64::max);
        Self { patch, centroid: patch.centroid(), extent }
    }

    /// The share of a receiver's view that it fills, each direction by its cosine: of what is `far`, as many
    /// times its extent, by its centroid.
    fn form_factor(&self, receiver: &Receiver, far: f64) -> f64 {
        let line = self.centroid - receiver.position;
        let square = line.length_squared();
        if square < (far * self.extent).powi(2) {
            return self.patch.form_factor_from(receiver.position, receiver.normal);
        }
        let cosines = [receiver.normal.dot(line), -self.patch.normal().dot(line)];
        let [here, there] = cosines.map(|projection| projection.max(0.0) / square);
        here * there * self.patch.area() * FRAC_1_PI
    }
}

/// Whether a material emits in any band.
fn emits(material: &Material) -> bool {
    match material.temperature {
        Some(temperature) => temperature > 0.0,
        None => material.emission.iter().any(|&band| band > 0.0),
    }
}

/// A surface's patch with its front on the side of `normal`.
fn turned_to(normal: DVec3, corners: &[DVec3]) -> Result<Patch, farfield_radiosity::Error> {
    let patch = Patch::new(corners)?;
    if patch.normal().dot(normal) > 0.0 {
        return Ok(patch);
    }
    let reversed: Vec<_> = corners.iter().rev().copied().collect();
    Patch::new(&reversed)
}

/// Into how many parts along its two directions a lamp is cut, for about `count` in all.
fn counts(corners: &[DVec3], count: f64) -> Cuts {
    let &[a, b, c, d] = corners else { return [(count.sqrt().round() as u32).max(1); 2] };
    let (u, v) = (a.distance(b) + d.distance(c), a.distance(d) + b.distance(c));
    let along = (count * u / v).sqrt().round().clamp(1.0, count);
    [along as u32, (count / along).round().max(1.0) as u32]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pictures::samples::{grid, sheet};
    use crate::scene::surface::ScenePoint;
    use farfield_radiosity::Element;

    const UP: DVec3 = DVec3::Z;

    fn material(emission: f64) -> Material {
        Material {
            name: String::new(),
            reflectance: vec![0.5; 3],
            emission: vec![emission; 3],
            temperature: None,
            two_sided: false,
        }
    }

    /// A square lamp of edge 1 that looks down from height 1, and a floor of edge 10.
    fn scene() -> Scene {
        let floor = [[-5.0, -5.0], [5.0, -5.0], [5.0, 5.0], [-5.0, 5.0]];
        let lamp = [[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]];
        let at = |z: f64| move |[x, y]: [f64; 2]| DVec3::new(x, y, z);
        let materials = vec![material(0.0), material(3.0)];
        let mut scene = Scene { materials, ..Scene::default() };
        scene.add(&floor.map(at(0.0)), 0, 0);
        scene.add(&lamp.map(at(1.0)), 1, 1);
        scene
    }

    fn lamps() -> Lamps {
        let elements: Vec<Element> = grid(UP, DVec3::Y, DVec3::X, [5, 5], 1);
        let mesh = Mesh { origin: vec![1; 25], material: vec![1; 25], elements, ..Mesh::default() };
        Lamps::new(&scene(), &mesh, &[[3.0, 2.0, 1.0]; 25], 3)
    }

    fn mean(receiver: &Receiver, shadows: &Occluders) -> Rgb {
        let lamps = lamps();
        let turns = (0..9).map(|turn| lamps.irradiance(receiver, turn, shadows));
        turns.fold([0.0; 3], |sum, h| [0, 1, 2].map(|band| sum[band] + h[band] / 9.0))
    }

    #[test]
    fn unshadowed_light_is_that_of_the_whole_lamp_near_and_far() {
        let open = Occluders::new(&[]).expect("empty");
        let lamp = Patch::new(&[UP, UP + DVec3::Y, UP + DVec3::X + DVec3::Y, UP + DVec3::X]);
        let lamp = lamp.expect("a square");
        for position in [DVec3::ZERO, DVec3::new(0.4, 0.5, 0.999), DVec3::new(-8.0, 3.0, -4.0)] {
            let receiver = Receiver { position, normal: UP, face: 0 };
            let factor = lamp.form_factor_from(position, UP);
            let found = mean(&receiver, &open);
            for (band, exitance) in [3.0, 2.0, 1.0].into_iter().enumerate() {
                let relative = found[band] / (factor * exitance) - 1.0;
                assert!(relative.abs() < 1e-3, "{found:?} {factor}");
            }
        }
    }

    #[test]
    fn half_a_lamp_is_hidden_by_what_covers_half_of_it() {
        let cover = sheet(DVec3::new(-1.0, -1.0, 0.999), 1.5 * DVec3::X, 3.0 * DVec3::Y, 9);
        let cover = Occluders::new(&cover).expect("finite");
        let open = Occluders::new(&[]).expect("empty");
        let receiver = Receiver { position: DVec3::new(0.5, 0.5, 0.0), normal: UP, face: 0 };
        let (half, whole) = (mean(&receiver, &cover)[0], mean(&receiver, &open)[0]);
        assert!((half / whole - 0.5).abs() < 0.1, "{half} of {whole}");
    }

    #[test]
    fn the_sun_reaches_what_faces_it_and_nothing_hides() {
        let roof = sheet(DVec3::new(-1.0, -1.0, 1.0), 2.0 * DVec3::X, 2.0 * DVec3::Y, 9);
        let mesh = Mesh { triangles: roof.clone(), ..Mesh::default() };
        let roof = Occluders::new(&roof).expect("finite");
        let to_sun = DVec3::new(0.6, 0.0, 0.8);
        let lamps =
            Lamps::new(&Scene::default(), &mesh, &[], 3).with_sun(&mesh, Some((to_sun, 10.0)));
        let at = |x: f64, normal| {
            let receiver = Receiver { position: DVec3::X * x, normal, face: 0 };
            lamps.irradiance(&receiver, 4, &roof)
        };
        // The shadow of the roof, from -1.75 to 0.25.
        assert_eq!([at(-1.7, UP), at(0.2, UP)], [[0.0; 3]; 2]);
        for (x, normal, expected) in [(-1.8, UP, 8.0), (0.3, UP, 8.0), (0.3, DVec3::X, 6.0)] {
            assert!(at(x, normal).iter().all(|h| (h - expected).abs() < 1e-12), "at {x}");
        }
        assert_eq!(at(0.3, -DVec3::X), [0.0; 3]);
    }

    #[test]
    fn parts_are_nearly_square() {
        let corners = [DVec3::ZERO, 3.0 * DVec3::X, DVec3::new(3.0, 1.0, 0.0), DVec3::Y];
        assert_eq!(counts(&corners, 16.0), [7, 2]);
        assert_eq!(counts(&corners[..3], 16.0), [4, 4]);
    }

    #[test]
    fn few_small_lamps_are_gathered_per_pixel() {
        assert!(direct_light_by_pixel(&scene()));
        assert!(!direct_light_by_pixel(&Scene::default()));
        let mut many = scene();
        many.surfaces.extend(vec![many.surfaces[1].clone(); 8]);
        assert!(!direct_light_by_pixel(&many));
        let mut large = scene();
        large.vertices[4..].iter_mut().for_each(|corner| *corner *= 4.0);
        assert!(!direct_light_by_pixel(&large));
        let mut warm = scene();
        warm.materials[0].temperature = Some(300.0);
        assert!(!direct_light_by_pixel(&warm));
        let mut sparks = scene();
        let point = ScenePoint { position: DVec3::ZERO, normal: UP, area: 1.0, material: 1 };
        sparks.points.push(point);
        assert!(!direct_light_by_pixel(&sparks));
    }
}

//! A scene: surfaces, oriented points, what they are made of, and from where to look at them.

pub(crate) mod error;
pub(crate) mod geometry;
pub(crate) mod material;
pub(crate) mod place;
pub(crate) mod surface;
pub(crate) mod viewpoint;
pub(crate) mod weld;

use farfield_radiosity::Patch;
use glam::DVec3;

use self::error::SceneError;
use self::geometry::vector_area;
use self::material::Material;
use self::place::{Part, rounded};
use self::surface::{ScenePoint, Surface};
use self::viewpoint::Viewpoint;

/// The Stefan–Boltzmann constant σ \[W m⁻² K⁻⁴].
pub const STEFAN_BOLTZMANN: f64 = 5.670_374_419e-8;

/// What surfaces exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Light: what materials emit.
    Light,
    /// Radiant heat: what materials radiate by their temperature.
    Heat,
}

/// Surfaces and oriented points, their materials, and a camera.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// What surfaces and points are made of; all have the same number of bands.
    pub materials: Vec<Material>,
    /// The vertices of surfaces, which neighbours share.
    pub vertices: Vec<DVec3>,
    /// Flat pieces of surface.
    pub surfaces: Vec<Surface>,
    /// Which of them come from which file, for messages.
    pub parts: Vec<Part>,
    /// Oriented points, each standing for a disk.
    pub points: Vec<ScenePoint>,
    /// From where to look; chosen from the scene's extent if none.
    pub camera: Option<Viewpoint>,
    /// Whether the surfaces close a room without gaps, as far as the maker of the scene knows: then
    /// all light that leaves one of them arrives at another.
    pub closed: bool,
    /// Whether each edge is run through as often one way as the other, so that the surfaces enclose volumes without gaps:
    /// what sees no way out of them has none.
    pub watertight: bool,
    /// What was mended while the scene was read, one sentence each.
    pub repairs: Vec<String>,
    /// What the scene's files name and isn't there, such as material files, one sentence each.
    pub missing: Vec<String>,
    /// What the scene's files may mean otherwise than it was taken, one sentence each.
    pub doubts: Vec<String>,
}

impl Scene {
    /// Checks that there is something in it, that its materials agree in their bands and obey the
    /// laws of nature, and that its surfaces, its points and its camera are what they should be.
    ///
    /// # Errors
    /// The first thing that isn't so; see [`SceneError`].
    pub fn check(&self) -> Result<(), SceneError> {
        if self.surfaces.is_empty() && self.points.is_empty() {
            return Err(SceneError::Empty);
        }
        for material in &self.materials {
            material.check(self.bands())?;
        }
        let known = |kind, index, found| {
            let materials = self.materials.len();
            let error = SceneError::Material { kind, index, found, materials };
            if found < materials { Ok(()) } else { Err(error) }
        };
        for (index, surface) in self.surfaces.iter().enumerate() {
            known("surface", index, surface.material)?;
            let vertices = self.vertices.len();
            if let Some(&found) = surface.corners.iter().find(|&&k| k as usize >= vertices) {
                return Err(SceneError::Vertex { surface: index, found, vertices });
            }
            let patch = Patch::new(&self.corners(surface));
            patch.map_err(|source| self.refusal(index, source))?;
        }
        for (index, point) in self.points.iter().enumerate() {
            known("point", index, point.material)?;
            point.check().map_err(|expected| SceneError::Point { index, expected })?;
        }
        self.camera.as_ref().map_or(Ok(()), Viewpoint::check)
    }

    /// The corners of one of its surfaces, in their order; without those that don't exist, which
    /// [`check`](Self::check) refuses.
    pub fn corners(&self, surface: &Surface) -> Vec<DVec3> {
        surface.corners.iter().filter_map(|&k| self.vertices.get(k as usize).copied()).collect()
    }

    /// A surface or, from the number of surfaces on, a point, in words: which entry of which file it is,
    /// as far as that is known, its material, its centroid and its normal.
    pub fn describe(&self, whole: usize) -> String {
        let (kind, index, material, centroid, normal) = match self.surfaces.get(whole) {
            Some(surface) => {
                let corners = self.corners(surface);
                let centroid = corners.iter().sum::<DVec3>() / corners.len().max(1) as f64;
                let normal = vector_area(&corners).normalize_or_zero();
                ("surface", whole, surface.material, centroid, normal)
            }
            None => {
                let index = whole - self.surfaces.len();
                let Some(point) = self.points.get(index) else { return format!("surface {whole}") };
                ("point", index, point.material, point.position, point.normal)
            }
        };
        let entry = self.parts.iter().find_map(|part| part.entry(whole));
        let entry = entry.unwrap_or_else(|| format!("{kind} {index}"));
        let name = self.materials.get(material).map_or("", |material| material.name.as_str());
        let (place, normal) = (rounded(centroid), rounded(normal));
        format!("{entry}, of material `{name}`, around {place} with the normal {normal}")
    }

    /// The refusal of one of its surfaces, with what and where it is.
    pub(crate) fn refusal(&self, index: usize, source: farfield_radiosity::Error) -> SceneError {
        SceneError::Surface { index, source, place: self.describe(index) }
    }

    /// The area of one of its surfaces.
    pub(crate) fn area(&self, surface: &Surface) -> f64 {
        vector_area(&self.corners(surface)).length()
    }

    /// Adds a surface with vertices of its own.
    pub(crate) fn add(&mut self, corners: &[DVec3], material: usize, face: u32) {
        let first = self.vertices.len() as u32;
        self.vertices.extend(corners);
        let corners = (first..self.vertices.len() as u32).collect();
        self.surfaces.push(Surface { corners, material, face });
    }

    /// How many bands its materials have.
    pub fn bands(&self) -> usize {
        self.materials.first().map_or(0, |material| material.reflectance.len())
    }

    /// The materials that surfaces and points are made of, in their order.
    pub fn materials_in_use(&self) -> Vec<&Material> {
        let mut used = vec![false; self.materials.len()];
        let surfaces = self.surfaces.iter().map(|surface| surface.material);
        for material in surfaces.chain(self.points.iter().map(|point| point.material)) {
            if let Some(used) = used.get_mut(material) {
                *used = true;
            }
        }
        let all = self.materials.iter().zip(used);
        all.filter(|(_, used)| *used).map(|(material, _)| material).collect()
    }

    /// What a material radiates \[W/m²], band by band: for light its emission; for heat (1 − ρ) σ T⁴,
    /// which is nothing for a material without a temperature.
    pub(crate) fn emission(&self, material: usize, quantity: Quantity) -> Vec<f64> {
        let material = &self.materials[material];
        match quantity {
            Quantity::Light => material.emission.clone(),
            Quantity::Heat => {
                let black = STEFAN_BOLTZMANN * material.temperature.unwrap_or(0.0).powi(4);
                material.reflectance.iter().map(|rho| (1.0 - rho) * black).collect()
            }
        }
    }
}

#[cfg(test)]
impl Scene {
    /// The volume that closed surfaces enclose, negative if they look inwards.
    pub(crate) fn volume(&self) -> f64 {
        let corners = self.surfaces.iter().map(|s| self.corners(s));
        corners.map(|corners| vector_area(&corners).dot(corners[0]) / 3.0).sum()
    }

    /// The sum of all vector areas: zero for closed surfaces.
    pub(crate) fn open_area(&self) -> DVec3 {
        self.surfaces.iter().map(|s| vector_area(&self.corners(s))).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(material: Material) -> Scene {
        let mut scene = Scene { materials: vec![material], ..Scene::default() };
        scene.add(&[DVec3::ZERO, DVec3::X, DVec3::Y], 0, 0);
        scene
    }

    fn refusal(scene: &Scene) -> String {
        scene.check().expect_err("not a scene").to_string()
    }

    #[test]
    fn materials_that_break_the_laws_of_nature_are_refused() {
        assert!(scene(Material::grey()).check().is_ok());
        for rho in [1.1, -0.1, f64::NAN] {
            let white = Material::rgb("white", [0.5, rho, 0.5], [0.0; 3]);
            let expected = format!("material `white` has the reflectance {rho} in band 1");
            assert!(refusal(&scene(white)).starts_with(&expected));
        }
        for emission in [-1.0, f64::NAN, f64::INFINITY] {
            let lamp = Material::rgb("lamp", [0.5; 3], [0.0, 0.0, emission]);
            let expected = format!("material `lamp` has the emission {emission} in band 2");
            assert!(refusal(&scene(lamp)).starts_with(&expected));
        }
        let frozen = Material { temperature: Some(-1.0), ..Material::grey() };
        assert!(refusal(&scene(frozen)).contains("temperature -1 K"));
    }

    #[test]
    fn materials_agree_in_their_bands() {
        let mut two = scene(Material::grey());
        let fewer = Material { emission: vec![0.0; 2], ..Material::grey() };
        two.materials.push(Material { name: "two".to_owned(), ..fewer });
        assert_eq!(refusal(&two), "material `two` has 2 bands of emission: expected 3");
        let none = Material { reflectance: vec![], emission: vec![], ..Material::grey() };
        assert!(refusal(&scene(none)).contains("expected 1 or more"));
    }

    #[test]
    fn surfaces_and_points_are_checked() {
        assert!(refusal(&Scene::default()).contains("neither surfaces nor points"));
        let mut scene = scene(Material::grey());
        let position = DVec3::ZERO;
        let point = ScenePoint { position, normal: DVec3::Z, area: 1.0, material: 0 };
        scene.points = vec![point, ScenePoint { material: 1, ..point }];
        assert_eq!(refusal(&scene), "point 1 is of material 1: expected less than 1");
        for (bad, expected) in [
            (ScenePoint { position: DVec3::NAN, ..point }, "finite coordinates"),
            (ScenePoint { normal: DVec3::ONE, ..point }, "a unit normal"),
            (ScenePoint { area: 0.0, ..point }, "a positive finite area"),
            (ScenePoint { area: f64::NAN, ..point }, "a positive finite area"),
        ] {
            scene.points[1] = bad;
            assert_eq!(refusal(&scene), format!("point 1: expected {expected}"));
        }
        scene.surfaces[0].corners[2] = 1;
        assert!(refusal(&scene).starts_with("surface 0: a patch with corners at"));
        scene.surfaces[0].corners[2] = 3;
        assert_eq!(refusal(&scene), "surface 0 has a corner at vertex 3: expected less than 3");
    }

    #[test]
    fn surfaces_are_told_by_file_material_place_and_normal() {
        let mut scene = Scene { materials: vec![Material::grey()], ..Scene::default() };
        for k in 0..3 {
            let at = f64::from(k) * DVec3::Y;
            scene.add(&[at, at + DVec3::Y, at + DVec3::X], 0, 0);
        }
        let numbers = vec![7, 9];
        scene.parts = vec![Part { file: "a.obj".to_owned(), kind: "face", first: 1, numbers }];
        let rest = "of material `grey`, around (0.3333, 2.333, 0) with the normal (0, 0, -1)";
        assert_eq!(scene.describe(2), format!("face 9 of a.obj, {rest}"));
        assert!(scene.describe(0).starts_with("surface 0, of material `grey`, around (0.3333, 0."));
        let point = ScenePoint { position: DVec3::Y, normal: DVec3::Z, area: 1.0, material: 4 };
        scene.points = vec![point];
        let expected = "point 0, of material ``, around (0, 1, 0) with the normal (0, 0, 1)";
        assert_eq!(scene.describe(3), expected);
        assert_eq!(scene.describe(9), "surface 9");
    }

    #[test]
    fn cameras_look_somewhere() {
        let mut scene = scene(Material::grey());
        let [eye, target, up] = [DVec3::ZERO, DVec3::Z, DVec3::Y];
        let view = Viewpoint { eye, target, up, film_over_focal: 1.0 };
        for (camera, expected) in [
            (Viewpoint { eye: DVec3::NAN, ..view }, "its eye at [NaN, NaN, NaN], expected finite"),
            (Viewpoint { target: DVec3::INFINITY, ..view }, "its target at [inf, inf, inf], "),
            (Viewpoint { target: eye, ..view }, "its target at [0, 0, 0], expected somewhere else"),
            (Viewpoint { up: -3.0 * target, ..view }, "up at [-0, -0, -3], expected a direction"),
            (Viewpoint { up: DVec3::ZERO, ..view }, "up at [0, 0, 0], expected a direction"),
            (Viewpoint { up: DVec3::NAN, ..view }, "up at [NaN, NaN, NaN], expected a direction"),
        ] {
            scene.camera = Some(camera);
            let message = refusal(&scene);
            assert!(message.starts_with(&format!("camera: {expected}")), "{message}");
        }
        scene.camera = Some(view);
        assert!(scene.check().is_ok());
    }

    #[test]
    fn a_black_body_at_300_kelvin_radiates_459_watts_per_square_metre() {
        let wall = Material { temperature: Some(300.0), ..Material::grey() };
        let black = Material { reflectance: vec![0.0; 3], ..wall.clone() };
        let lamp = Material::rgb("lamp", [0.5; 3], [1.0, 2.0, 3.0]);
        let scene = Scene { materials: vec![wall, black, lamp], ..Scene::default() };
        assert!((scene.emission(1, Quantity::Heat)[2] - 459.300_327_939).abs() < 1e-6);
        assert!((scene.emission(0, Quantity::Heat)[0] - 0.5 * 459.300_327_939).abs() < 1e-6);
        assert_eq!(scene.emission(0, Quantity::Light), [0.0; 3]);
        assert_eq!(scene.emission(2, Quantity::Heat), [0.0; 3]);
        assert_eq!(scene.emission(2, Quantity::Light), [1.0, 2.0, 3.0]);
    }
}

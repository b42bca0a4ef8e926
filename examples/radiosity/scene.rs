//! A scene: surfaces, oriented points, what they are made of, and from where to look at them.

use farfield_radiosity::Patch;
use glam::DVec3;

use crate::scene_error::SceneError;

/// The Stefan–Boltzmann constant σ \[W m⁻² K⁻⁴].
pub(crate) const STEFAN_BOLTZMANN: f64 = 5.670_374_419e-8;
/// How far the squared length of a unit normal may be off one.
const UNIT_TOLERANCE: f64 = 1e-8;
/// How many bands the materials of generated scenes and of mesh files have: red, green and blue.
pub(crate) const RGB_BANDS: usize = 3;

/// Everything that a run needs to know of a scene.
#[derive(Clone, Debug, Default)]
pub(crate) struct Scene {
    /// What surfaces and points are made of; all have the same number of bands.
    pub(crate) materials: Vec<Material>,
    /// Flat pieces of surface.
    pub(crate) surfaces: Vec<Surface>,
    /// Oriented points, each standing for a disk.
    pub(crate) points: Vec<ScenePoint>,
    /// From where to look; chosen from the scene's extent if none.
    pub(crate) camera: Option<Viewpoint>,
    /// Whether the surfaces close a room without gaps, as far as the maker of the scene knows: then
    /// all light that leaves one of them arrives at another.
    pub(crate) closed: bool,
    /// What was mended while the scene was read, one sentence each.
    pub(crate) repairs: Vec<String>,
}

impl Scene {
    /// Checks that there is something in it, that its materials agree in their bands and obey the
    /// laws of nature, and that its surfaces, its points and its camera are what they should be.
    ///
    /// # Errors
    /// The first thing that isn't so; see [`SceneError`].
    pub(crate) fn check(&self) -> Result<(), SceneError> {
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
            let patch = Patch::new(&surface.corners);
            patch.map_err(|source| SceneError::Surface { index, source })?;
        }
        for (index, point) in self.points.iter().enumerate() {
            known("point", index, point.material)?;
            point.check().map_err(|expected| SceneError::Point { index, expected })?;
        }
        self.camera.as_ref().map_or(Ok(()), Viewpoint::check)
    }

    /// How many bands its materials have.
    pub(crate) fn bands(&self) -> usize {
        self.materials.first().map_or(0, |material| material.reflectance.len())
    }

    /// What a material radiates \[W/m²], band by band: its emission; with `heat`, (1 − ρ) σ T⁴, which
    /// is nothing for a material without a temperature.
    pub(crate) fn emission(&self, material: usize, heat: bool) -> Vec<f64> {
        let material = &self.materials[material];
        if !heat {
            return material.emission.clone();
        }
        let black = STEFAN_BOLTZMANN * material.temperature.unwrap_or(0.0).powi(4);
        material.reflectance.iter().map(|rho| (1.0 - rho) * black).collect()
    }
}

/// What a surface does with light, band by band.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Material {
    /// Its name, for messages.
    pub(crate) name: String,
    /// Diffuse reflectance ρ, in [0, 1).
    pub(crate) reflectance: Vec<f64>,
    /// Emitted exitance E \[W/m²\].
    pub(crate) emission: Vec<f64>,
    /// Its temperature [K], for heat: then E = (1 − ρ) σ T⁴ takes the place of `emission`.
    pub(crate) temperature: Option<f64>,
    /// Whether the back of a surface is like its front; otherwise it neither radiates nor receives.
    pub(crate) two_sided: bool,
}

impl Material {
    /// A one-sided material in three bands, without a temperature.
    pub(crate) fn rgb(name: &str, reflectance: [f64; 3], emission: [f64; 3]) -> Self {
        Self {
            name: name.to_owned(),
            reflectance: reflectance.to_vec(),
            emission: emission.to_vec(),
            temperature: None,
            two_sided: false,
        }
    }

    /// What things are made of that nobody has said anything about.
    pub(crate) fn grey() -> Self {
        Self::rgb("grey", [0.5; 3], [0.0; 3])
    }

    /// Checks its values, and that it has this many bands.
    ///
    /// # Errors
    /// [`SceneError::Bands`], [`SceneError::Reflectance`], [`SceneError::Emission`] or
    /// [`SceneError::Temperature`].
    pub(crate) fn check(&self, bands: usize) -> Result<(), SceneError> {
        let material = || self.name.clone();
        for (what, values) in [("reflectance", &self.reflectance), ("emission", &self.emission)] {
            let found = values.len();
            if found != bands || bands == 0 {
                let expected = if bands == 0 { "1 or more".to_owned() } else { bands.to_string() };
                return Err(SceneError::Bands { material: material(), what, found, expected });
            }
        }
        // Written so that NaN is refused as well.
        let bad_reflectance = |rho: &f64| !(0.0..1.0).contains(rho);
        if let Some(band) = self.reflectance.iter().position(bad_reflectance) {
            let found = self.reflectance[band];
            return Err(SceneError::Reflectance { material: material(), band, found });
        }
        let bad = |value: &f64| !(value.is_finite() && *value >= 0.0);
        if let Some(band) = self.emission.iter().position(bad) {
            let found = self.emission[band];
            return Err(SceneError::Emission { material: material(), band, found });
        }
        match self.temperature.filter(bad) {
            Some(found) => Err(SceneError::Temperature { material: material(), found }),
            None => Ok(()),
        }
    }
}

/// A flat convex piece of surface.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Surface {
    /// Its three or four corners, counter-clockwise around its front.
    pub(crate) corners: Vec<DVec3>,
    /// Index of its material.
    pub(crate) material: usize,
    /// Number of the occluder face it belongs to: surfaces of one face never hide each other's points
    /// (those of one plane, say).
    pub(crate) face: u32,
}

/// An oriented point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ScenePoint {
    /// Where it is.
    pub(crate) position: DVec3,
    /// Unit normal on the side that radiates and receives.
    pub(crate) normal: DVec3,
    /// The area that it stands for.
    pub(crate) area: f64,
    /// Index of its material.
    pub(crate) material: usize,
}

impl ScenePoint {
    /// Checks its place, its normal and its area; otherwise says what was expected.
    fn check(&self) -> Result<(), &'static str> {
        let unit = (self.normal.length_squared() - 1.0).abs() <= UNIT_TOLERANCE;
        if !self.position.is_finite() {
            Err("finite coordinates")
        } else if !unit {
            Err("a unit normal")
        } else if !(self.area > 0.0 && self.area.is_finite()) {
            Err("a positive finite area")
        } else {
            Ok(())
        }
    }
}

/// A pinhole camera's place and direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Viewpoint {
    /// Where the camera is.
    pub(crate) eye: DVec3,
    /// The point in the middle of the picture.
    pub(crate) target: DVec3,
    /// Which way is up in the picture; not along the line of sight.
    pub(crate) up: DVec3,
    /// Edge of the square film over its distance from the lens.
    pub(crate) film_over_focal: f64,
}

impl Viewpoint {
    /// Checks that it looks somewhere, and that what is up isn't there.
    fn check(&self) -> Result<(), SceneError> {
        let refusal = |what, found, expected| Err(SceneError::Camera { what, found, expected });
        for (what, place) in [("its eye", self.eye), ("its target", self.target)] {
            if !place.is_finite() {
                return refusal(what, place, "finite coordinates");
            }
        }
        let Some(sight) = (self.target - self.eye).try_normalize() else {
            return refusal("its target", self.target, "somewhere else than its eye");
        };
        let aside = self.up.try_normalize().map_or(0.0, |up| up.cross(sight).length());
        match aside > LEAST_ASIDE {
            true => Ok(()),
            false => refusal("up", self.up, "a direction that it doesn't look along"),
        }
    }
}

/// The least sine between the line of sight and what is up.
const LEAST_ASIDE: f64 = 1e-6;

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(material: Material) -> Scene {
        let corners = vec![DVec3::ZERO, DVec3::X, DVec3::Y];
        let surfaces = vec![Surface { corners, material: 0, face: 0 }];
        Scene { materials: vec![material], surfaces, ..Scene::default() }
    }

    fn refusal(scene: &Scene) -> String {
        scene.check().expect_err("not a scene").to_string()
    }

    #[test]
    fn materials_that_break_the_laws_of_nature_are_refused() {
        assert!(scene(Material::grey()).check().is_ok());
        for rho in [1.0, -0.1, f64::NAN] {
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
        scene.surfaces[0].corners[2] = DVec3::X;
        assert!(refusal(&scene).starts_with("surface 0: a patch with corners at"));
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
        assert!((scene.emission(1, true)[2] - 459.300_327_939).abs() < 1e-6);
        assert!((scene.emission(0, true)[0] - 0.5 * 459.300_327_939).abs() < 1e-6);
        assert_eq!(scene.emission(0, false), [0.0; 3]);
        assert_eq!(scene.emission(2, true), [0.0; 3]);
        assert_eq!(scene.emission(2, false), [1.0, 2.0, 3.0]);
    }
}

//! Scenes described in TOML: meshes, walls and materials, put together and into generated scenes.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DAffine3, DQuat, DVec3};
use serde::Deserialize;

use crate::generators::{GENERATORS, generate};
use crate::geometry::is_watertight;
use crate::load::read_mesh;
use crate::scene::{Material, RGB_BANDS, Scene, Surface, Viewpoint};
use crate::scene_error::SceneError;
use crate::text::read_text;

/// The scene that a TOML file describes. The names of mesh files start from its folder.
///
/// # Errors
/// [`SceneError::Toml`] for what isn't a description, [`SceneError::File`] for one that makes no
/// sense, or whatever is wrong with a mesh.
pub(crate) fn read(path: &Path) -> Result<Scene, SceneError> {
    let text = read_text(path)?;
    let description: Description = toml::from_str(&text)
        .map_err(|source| SceneError::Toml { path: path.to_owned(), source: Box::new(source) })?;
    Assembly::new(path, &description)?.assemble(description)
}

/// A scene file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Description {
    /// Metres per unit of all coordinates, those of a generated scene included.
    #[serde(default = "one")]
    units: f64,
    /// The generated scene to start from.
    generator: Option<String>,
    /// Whether the surfaces close a room; if it isn't said, the generated scene as long as all that is
    /// put into it is closed or two-sided.
    closed: Option<bool>,
    #[serde(default)]
    mesh: Vec<MeshFile>,
    #[serde(default)]
    quad: Vec<Quad>,
    #[serde(default)]
    materials: BTreeMap<String, Finish>,
    camera: Option<Camera>,
}

/// A mesh file, scaled, then rotated, then translated.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct MeshFile {
    file: String,
    /// Takes the place of all materials in the file.
    material: Option<String>,
    #[serde(default = "one")]
    scale: f64,
    rotate: Option<Rotation>,
    #[serde(default)]
    translate: [f64; 3],
    /// Takes the place of what its material says.
    two_sided: Option<bool>,
}

/// A turn, counter-clockwise as seen from where the axis points to.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Rotation {
    axis: [f64; 3],
    degrees: f64,
}

/// A flat convex wall, its corners counter-clockwise around its front.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Quad {
    corners: [[f64; 3]; 4],
    material: String,
}

/// A material.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Finish {
    reflectance: Vec<f64>,
    /// Nothing in any band if it isn't said.
    emission: Option<Vec<f64>>,
    temperature: Option<f64>,
    #[serde(default)]
    two_sided: bool,
}

/// A camera.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Camera {
    eye: [f64; 3],
    target: [f64; 3],
    #[serde(default = "y_axis")]
    up: [f64; 3],
    /// From the left edge of the picture to the right one.
    #[serde(default = "normal_view")]
    fov_degrees: f64,
}

fn one() -> f64 {
    1.0
}

fn y_axis() -> [f64; 3] {
    [0.0, 1.0, 0.0]
}

/// Somewhat wider than what a camera with a normal lens sees.
fn normal_view() -> f64 {
    50.0
}

/// A described scene in the making.
struct Assembly<'a> {
    path: &'a Path,
    scene: Scene,
    /// Index of the first of the materials that the description defines, which are in the order of
    /// their names.
    first: usize,
    faces: u32,
}

impl<'a> Assembly<'a> {
    /// The generated scene, if any, with the materials of the description.
    fn new(path: &'a Path, description: &Description) -> Result<Self, SceneError> {
        let mut assembly = Self { path, scene: Scene::default(), first: 0, faces: 0 };
        if let Some(name) = &description.generator {
            let generated = generate(name);
            assembly.scene = generated.ok_or_else(|| {
                let names = GENERATORS.join(", ");
                assembly.refusal(format!("one of {names} as generator, found `{name}`"))
            })?;
        }
        let scene = &mut assembly.scene;
        assembly.faces = scene.surfaces.iter().map(|s| s.face + 1).max().unwrap_or(0);
        assembly.first = scene.materials.len();
        scene.materials.extend(description.materials.iter().map(|(name, finish)| Material {
            name: name.clone(),
            reflectance: finish.reflectance.clone(),
            emission:
                finish.emission.clone().unwrap_or_else(|| vec![0.0; finish.reflectance.len()]),
            temperature: finish.temperature,
            two_sided: finish.two_sided,
        }));
        let bands = if assembly.first > 0 { RGB_BANDS } else { scene.bands() };
        scene.materials.iter().try_for_each(|material| material.check(bands))?;
        Ok(assembly)
    }

    /// Adds everything else.
    fn assemble(mut self, description: Description) -> Result<Scene, SceneError> {
        for mesh in &description.mesh {
            self.add_mesh(mesh, &description.materials)?;
        }
        for quad in &description.quad {
            let material = self.named(&quad.material, &description.materials)?;
            self.scene.closed &= self.scene.materials[material].two_sided;
            let corners = quad.corners.map(DVec3::from_array).to_vec();
            self.scene.surfaces.push(Surface { corners, material, face: self.faces });
            self.faces += 1;
        }
        if let Some(camera) = &description.camera {
            self.scene.camera = Some(self.viewpoint(camera)?);
        }
        if let Some(closed) = description.closed {
            self.scene.closed = closed;
        }
        let units = description.units;
        if !(units > 0.0 && units.is_finite()) {
            return Err(
                self.refusal(format!("a positive number of metres as units, found {units}"))
            );
        }
        scale(&mut self.scene, units);
        Ok(self.scene)
    }

    fn add_mesh(
        &mut self,
        mesh: &MeshFile,
        finishes: &BTreeMap<String, Finish>,
    ) -> Result<(), SceneError> {
        let place = self.transform(mesh)?;
        let folder = self.path.parent().unwrap_or(Path::new(""));
        let mut part = read_mesh(&folder.join(&mesh.file))?;
        let first = self.scene.materials.len();
        let material = match &mesh.material {
            Some(name) => Some(self.named(name, finishes)?),
            None => None,
        };
        match (material, mesh.two_sided) {
            (Some(material), None) => self.give(&mut part, |_| material),
            (Some(material), Some(two_sided)) => {
                let finish = self.scene.materials[material].clone();
                self.scene.materials.push(Material { two_sided, ..finish });
                self.give(&mut part, |_| first);
            }
            (None, two_sided) => {
                let own = part.materials.drain(..).map(|material| Material {
                    two_sided: two_sided.unwrap_or(material.two_sided),
                    ..material
                });
                self.scene.materials.extend(own);
                self.give(&mut part, |material| first + material);
            }
        }
        let materials = &self.scene.materials;
        let two_sided = part.surfaces.iter().all(|s| materials[s.material].two_sided)
            && part.points.iter().all(|p| materials[p.material].two_sided);
        // Light that arrives at the back of an open sheet is lost.
        let sealed = part.points.is_empty() && is_watertight(&part.surfaces);
        self.scene.closed &= sealed || two_sided;
        for surface in &mut part.surfaces {
            surface.corners.iter_mut().for_each(|p| *p = place.transform_point3(*p));
            surface.face += self.faces;
        }
        for point in &mut part.points {
            point.position = place.transform_point3(point.position);
            point.normal = place.transform_vector3(point.normal).normalize_or_zero();
            point.area *= mesh.scale * mesh.scale;
        }
        self.faces = part.surfaces.iter().map(|s| s.face + 1).max().unwrap_or(self.faces);
        self.scene.surfaces.append(&mut part.surfaces);
        self.scene.points.append(&mut part.points);
        let repairs = part.repairs.iter().map(|repair| format!("{}: {repair}", mesh.file));
        self.scene.repairs.extend(repairs);
        Ok(())
    }

    /// Changes the materials of all that is in a scene.
    fn give(&self, part: &mut Scene, material: impl Fn(usize) -> usize) {
        part.surfaces.iter_mut().for_each(|s| s.material = material(s.material));
        part.points.iter_mut().for_each(|p| p.material = material(p.material));
    }

    /// Where a mesh goes.
    fn transform(&self, mesh: &MeshFile) -> Result<DAffine3, SceneError> {
        let MeshFile { file, scale, translate, .. } = mesh;
        if !(*scale > 0.0 && scale.is_finite()) {
            return Err(self.refusal(format!("a positive scale of {file}, found {scale}")));
        }
        let translation = DVec3::from_array(*translate);
        if !translation.is_finite() {
            return Err(self.refusal(format!("a finite translation of {file}")));
        }
        let rotation = match &mesh.rotate {
            None => DQuat::IDENTITY,
            Some(Rotation { axis, degrees }) => {
                let axis = DVec3::from_array(*axis).try_normalize();
                match axis.filter(|_| degrees.is_finite()) {
                    Some(axis) => DQuat::from_axis_angle(axis, degrees.to_radians()),
                    None => {
                        let expected = format!("an axis and a finite angle to rotate {file}");
                        return Err(self.refusal(expected));
                    }
                }
            }
        };
        Ok(DAffine3::from_scale_rotation_translation(DVec3::splat(*scale), rotation, translation))
    }

    /// The index of a material of the description or, failing that, of the generated scene.
    fn named(&self, name: &str, finishes: &BTreeMap<String, Finish>) -> Result<usize, SceneError> {
        let own = finishes.keys().position(|own| own == name).map(|k| self.first + k);
        let generated = &self.scene.materials[..self.first];
        let index = own.or_else(|| generated.iter().position(|material| material.name == name));
        index.ok_or_else(|| {
            let known: Vec<_> = finishes
                .keys()
                .chain(generated.iter().map(|m| &m.name))
                .map(String::as_str)
                .collect();
            let expected = format!("one of the materials [{}], found `{name}`", known.join(", "));
            self.refusal(expected)
        })
    }

    fn viewpoint(&self, camera: &Camera) -> Result<Viewpoint, SceneError> {
        let [eye, target, up] = [camera.eye, camera.target, camera.up].map(DVec3::from_array);
        let degrees = camera.fov_degrees;
        let upright = (target - eye).normalize_or_zero().cross(up.normalize_or_zero()).length();
        if !(eye.is_finite() && upright > 1e-6) {
            let expected = "a camera that looks somewhere, and not along `up`";
            return Err(self.refusal(expected.to_owned()));
        }
        if !(degrees > 0.0 && degrees < 180.0) {
            let expected = format!("a field of view between 0 and 180 degrees, found {degrees}");
            return Err(self.refusal(expected));
        }
        let film_over_focal = 2.0 * (0.5 * degrees.to_radians()).tan();
        Ok(Viewpoint { eye, target, up, film_over_focal })
    }

    fn refusal(&self, expected: String) -> SceneError {
        SceneError::File { path: self.path.to_owned(), expected }
    }
}

/// Scales all lengths.
fn scale(scene: &mut Scene, factor: f64) {
    scene.surfaces.iter_mut().flat_map(|s| &mut s.corners).for_each(|p| *p *= factor);
    for point in &mut scene.points {
        point.position *= factor;
        point.area *= factor * factor;
    }
    if let Some(camera) = &mut scene.camera {
        camera.eye *= factor;
        camera.target *= factor;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{area, volume};
    use crate::load::load;
    use std::fs;

    const TETRAHEDRON: &str =
        "OFF\n4 4 6\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";

    /// Loads a description that lies beside a few mesh files.
    fn described(text: &str) -> Result<Scene, SceneError> {
        let folder = tempfile::tempdir().expect("a folder");
        let write = |name: &str, text: &str| {
            fs::write(folder.path().join(name), text).expect("written");
        };
        write("body.off", TETRAHEDRON);
        write("sheet.off", "OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n3 0 1 2\n");
        write(
            "cloud.ply",
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\n\
            property float y\nproperty float z\nproperty float nx\nproperty float ny\n\
            property float nz\nproperty float area\nend_header\n1 2 3 0 0 1 0.5\n",
        );
        write("scene.toml", text);
        load(&folder.path().join("scene.toml").to_string_lossy())
    }

    fn refusal(text: &str) -> String {
        described(text).expect_err(text).to_string()
    }

    #[test]
    fn a_body_in_the_cornell_box_takes_ten_lines() {
        let scene = described(
            r#"
            generator = "cornell"
            [[mesh]]
            file = "body.off"
            material = "porcelain"
            scale = 100.0
            rotate = { axis = [0, 2, 0], degrees = 90 }
            translate = [180, 165, 150]
            [materials.porcelain]
            reflectance = [0.8, 0.75, 0.7]
            "#,
        );
        let scene = scene.expect("valid");
        let body = &scene.surfaces[scene.surfaces.len() - 4..];
        assert!((volume(body) / (1e6 / 6.0) - 1.0).abs() < 1e-9);
        let name = |s: &Surface| scene.materials[s.material].name.clone();
        assert!(body.iter().all(|s| name(s) == "porcelain"));
        // The corner on the x axis has been turned to low z.
        let corner = DVec3::new(180.0, 165.0, 50.0);
        assert!(body.iter().flat_map(|s| &s.corners).any(|p| p.distance(corner) < 1e-9));
        let others = scene.surfaces[..scene.surfaces.len() - 4].iter();
        let highest = others.map(|s| s.face).max().expect("a box");
        assert!(body.iter().map(|s| s.face).eq(highest + 1..=highest + 4));
        assert!(scene.camera.is_some() && !scene.closed);
    }

    #[test]
    fn walls_materials_and_camera_by_hand() {
        let scene = described(
            r#"
            units = 0.5
            closed = true
            quad = [{ corners = [[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]], material = "wall" }]
            mesh = [{ file = "cloud.ply", scale = 3.0, material = "dust", two_sided = true }]
            [materials]
            wall = { reflectance = [0.5], emission = [2.0], temperature = 300.0, two_sided = true }
            dust = { reflectance = [0.25] }
            [camera]
            eye = [0, 0, 8]
            target = [0, 0, 0]
            fov_degrees = 90
            "#,
        );
        let scene = scene.expect("valid");
        assert!(scene.closed);
        assert_eq!(area(&scene.surfaces[0]), 1.0);
        let point = scene.points[0];
        assert_eq!((point.position, point.area), (DVec3::new(1.5, 3.0, 4.5), 0.5 * 9.0 / 4.0));
        let dust = &scene.materials[point.material];
        assert!(dust.two_sided && dust.emission == [0.0] && dust.name == "dust");
        let wall = &scene.materials[scene.surfaces[0].material];
        assert_eq!((wall.temperature, wall.two_sided), (Some(300.0), true));
        let camera = scene.camera.expect("given");
        assert_eq!((camera.eye, camera.up), (DVec3::new(0.0, 0.0, 4.0), DVec3::Y));
        assert!((camera.film_over_focal - 2.0).abs() < 1e-15);
    }

    #[test]
    fn a_closed_room_stays_so_while_no_light_gets_lost() {
        let closed = |more: &str| {
            let scene = described(&format!("generator = \"furnace\"\n{more}"));
            scene.expect("valid").closed
        };
        assert!(closed(""));
        assert!(closed("mesh = [{ file = \"body.off\", scale = 0.1 }]"));
        assert!(!closed("mesh = [{ file = \"sheet.off\", scale = 0.1 }]"));
        assert!(closed("mesh = [{ file = \"sheet.off\", scale = 0.1, two_sided = true }]"));
        assert!(!closed("mesh = [{ file = \"cloud.ply\", scale = 0.1 }]"));
        assert!(!closed("closed = false"));
        let quad = "corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]";
        assert!(!closed(&format!("quad = [{{ {quad}, material = \"wall\" }}]")));
    }

    #[test]
    fn repairs_of_meshes_name_the_file() {
        let scene = described("mesh = [{ file = \"sheet.off\" }]").expect("valid");
        assert_eq!(scene.repairs, ["sheet.off: duplicate faces, dropped: 1"]);
    }

    #[test]
    fn descriptions_that_make_no_sense_are_refused() {
        let quad = "[[quad]]\ncorners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]\n\
            material = \"wall\"\n";
        let camera = "[camera]\neye = [0, 0, 1]\ntarget = [0, 0, 0]\n";
        let wall = "[materials.wall]\nreflectance = [0.5, 0.5]\n";
        for (text, expected) in [
            ("", "neither surfaces nor points"),
            ("color = 3", "unknown field `color`"),
            ("generator = \"cornel\"", "expected one of cornell, furnace, "),
            ("units = 0", "a positive number of metres as units, found 0"),
            ("units = nan", "as units, found NaN"),
            (quad, "expected one of the materials [], found `wall`"),
            (&format!("generator = \"cornell\"\n{quad}"), "materials [white, red, green, lamp]"),
            (&format!("generator = \"cornell\"\n{wall}"), "2 bands of reflectance: expected 3"),
            (&format!("{wall}emission = [1]"), "1 bands of emission: expected 2"),
            (&format!("{quad}{}", wall.replace("0.5]", "1.0]")), "`wall` has the reflectance 1 in"),
            (&format!("{quad}{wall}temperature = -3"), "the temperature -3 K"),
            (&format!("{quad}{wall}emission = [0, nan]"), "the emission NaN in band 1"),
            (&format!("{}{wall}", quad.replace("[1, 1, 0]", "[1, 1, 9]")), "surface 0: "),
            (&format!("{}{wall}", quad.replace("[1, 1, 0]", "[1, nan, 0]")), "surface 0: "),
            (&format!("{}{wall}", quad.replace("[0, 1, 0]]", "]")), "invalid length 3"),
            ("mesh = [{ file = \"none.obj\" }]", "none.obj: "),
            ("mesh = [{ file = \"scene.toml\" }]", "expected one of cornell"),
            ("mesh = [{ file = \"body.off\", scale = -1.0 }]", "a positive scale of body.off"),
            ("mesh = [{ file = \"body.off\", translate = [0, inf, 0] }]", "a finite translation"),
            (
                "mesh = [{ file = \"body.off\", rotate = { axis = [0, 0, 0], degrees = 1 } }]",
                "an axis and a finite angle to rotate body.off",
            ),
            ("mesh = [{ file = \"body.off\", material = \"gold\" }]", "found `gold`"),
            (&format!("{camera}fov_degrees = 180"), "between 0 and 180 degrees, found 180"),
            (&format!("{camera}up = [0, 0, 1]"), "a camera that looks somewhere"),
            (&camera.replace("[0, 0, 0]", "[0, 0, 1]"), "a camera that looks somewhere"),
        ] {
            let message = refusal(text);
            assert!(message.contains(expected), "{text}\n{message}");
        }
        let mixed = format!("mesh = [{{ file = \"body.off\" }}]\n{wall}");
        assert!(refusal(&mixed).contains("material `grey` has 3 bands of reflectance: expected 2"));
    }
}

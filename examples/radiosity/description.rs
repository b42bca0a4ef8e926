//! Scenes described in TOML: meshes, walls and materials, put together and into generated scenes.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use crate::assembly::Assembly;
use crate::scene::Scene;
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
pub(crate) struct Description {
    /// Metres per unit of all coordinates, those of a generated scene included.
    #[serde(default = "one")]
    pub(crate) units: f64,
    /// The generated scene to start from.
    pub(crate) generator: Option<String>,
    /// Whether the surfaces close a room; if it isn't said, the generated scene as long as all that is
    /// put into it is closed or two-sided.
    pub(crate) closed: Option<bool>,
    /// The mesh files in it.
    #[serde(default)]
    pub(crate) mesh: Vec<MeshFile>,
    /// The walls in it.
    #[serde(default)]
    pub(crate) quad: Vec<Quad>,
    /// Its materials by name.
    #[serde(default)]
    pub(crate) materials: BTreeMap<String, Finish>,
    /// From where to look; that of the generated scene if it isn't said.
    pub(crate) camera: Option<Camera>,
}

/// A mesh file, scaled, then rotated, then translated.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MeshFile {
    /// Name of the file, from the folder of the description.
    pub(crate) file: String,
    /// Takes the place of all materials in the file.
    pub(crate) material: Option<String>,
    /// By how much its lengths grow.
    #[serde(default = "one")]
    pub(crate) scale: f64,
    /// How it is turned around the origin.
    pub(crate) rotate: Option<Rotation>,
    /// By how much it is moved.
    #[serde(default)]
    pub(crate) translate: [f64; 3],
    /// Takes the place of what its material says.
    pub(crate) two_sided: Option<bool>,
}

/// A turn, counter-clockwise as seen from where the axis points to.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Rotation {
    /// The axis, of any length but zero.
    pub(crate) axis: [f64; 3],
    /// The angle \[°].
    pub(crate) degrees: f64,
}

/// A flat convex wall, its corners counter-clockwise around its front.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Quad {
    /// The corners.
    pub(crate) corners: [[f64; 3]; 4],
    /// Name of its material.
    pub(crate) material: String,
}

/// A material.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Finish {
    /// Reflectance, band by band.
    pub(crate) reflectance: Vec<f64>,
    /// Nothing in any band if it isn't said.
    pub(crate) emission: Option<Vec<f64>>,
    /// Temperature \[K].
    pub(crate) temperature: Option<f64>,
    /// Whether backs are like fronts.
    #[serde(default)]
    pub(crate) two_sided: bool,
}

/// A camera.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Camera {
    /// Where it is.
    pub(crate) eye: [f64; 3],
    /// What is in the middle of its picture.
    pub(crate) target: [f64; 3],
    /// What is up in its picture.
    #[serde(default = "y_axis")]
    pub(crate) up: [f64; 3],
    /// From the left edge of the picture to the right one.
    #[serde(default = "normal_view")]
    pub(crate) fov_degrees: f64,
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{area, volume};
    use crate::load::load;
    use crate::scene::Surface;
    use glam::DVec3;
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
        let camera = "generator = \"cornell\"\n[camera]\neye = [0, 0, 1]\ntarget = [0, 0, 0]\n";
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
            (&format!("{camera}fov_degrees = nan"), "between 0 and 180 degrees, found NaN"),
            (&format!("{camera}up = [0, 0, 1]"), "a direction that it doesn't look along"),
            (&camera.replace("[0, 0, 0]", "[0, 0, 1]"), "somewhere else than its eye"),
            (&camera.replace("1]", "nan]"), "camera: its eye at [0, 0, NaN]"),
        ] {
            let message = refusal(text);
            assert!(message.contains(expected), "{text}\n{message}");
        }
        let mixed = format!("mesh = [{{ file = \"body.off\" }}]\n{wall}");
        assert!(refusal(&mixed).contains("material `grey` has 3 bands of reflectance: expected 2"));
    }
}

//! Scenes by what the command line says: the name of a generated one, or a file.

use std::path::Path;

use crate::formats::assembly;
use crate::formats::mesh_file::{DESCRIPTION, ending, read_mesh};
use crate::generators::generate;
use crate::scene::Scene;
use crate::scene::error::SceneError;

/// The generated scene of this name or, if there is none, the scene in the file of this name.
///
/// # Errors
/// [`SceneError::Unknown`] if the name is neither, or whatever is wrong with the file or the scene in
/// it.
pub fn load(name: &str) -> Result<Scene, SceneError> {
    let path = Path::new(name);
    let scene = match generate(name) {
        Some(scene) => scene,
        None if ending(path) == DESCRIPTION => assembly::read(path)?,
        None => read_mesh(path)?,
    };
    if scene.surfaces.is_empty() && scene.points.is_empty() && !scene.repairs.is_empty() {
        let expected = format!("surfaces or points, found none; {}", scene.repairs.join("; "));
        return Err(SceneError::File { path: path.to_owned(), expected });
    }
    scene.check()?;
    Ok(scene)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn generated_scenes_come_by_name_and_others_by_file() {
        assert_eq!(load("furnace").expect("generated").surfaces.len(), 6);
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("Mesh.OFF");
        fs::write(&path, "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n").expect("written");
        let scene = load(&path.to_string_lossy()).expect("valid");
        assert_eq!(scene.surfaces.len(), 1);
        assert!(!scene.closed && scene.camera.is_none());
        fs::write(&path, "OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n").expect("written");
        let error = load(&path.to_string_lossy()).expect_err("nothing there");
        assert!(matches!(error, SceneError::Empty));
        fs::write(&path, "OFF\n3 1 0\n0 0 0\n1 0 0\n2 0 0\n3 0 1 2\n").expect("written");
        let message = load(&path.to_string_lossy()).expect_err("flat").to_string();
        let dropped = "expected surfaces or points, found none; faces without area, dropped: 1";
        assert!(message.ends_with(dropped), "{message}");
    }

    #[test]
    fn names_of_nothing_are_refused() {
        for name in ["corneli", "mesh.fbx", "", "obj"] {
            let message = load(name).expect_err(name).to_string();
            let expected = format!(
                "`{name}`: expected one of cornell, furnace, sphere, bowl, two-rooms, canyon, \
                 columns, or a file that ends in .obj, .stl, .ply, .off, .vs3, \
                 .gltf, .glb, .toml"
            );
            assert_eq!(message, expected);
        }
        for name in
            ["no.obj", "no.stl", "no.ply", "no.off", "no.vs3", "no.gltf", "no.glb", "no.toml"]
        {
            let message = load(name).expect_err(name).to_string();
            assert!(message.starts_with(&format!("cannot read {name}: ")), "{message}");
        }
    }
}

#[cfg(test)]
mod descriptions {
    use super::*;
    use crate::generators::GENERATORS;
    use crate::scene::surface::Surface;
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
        let alone = Scene { surfaces: body.to_vec(), ..scene.clone() };
        assert!((alone.volume() / (1e6 / 6.0) - 1.0).abs() < 1e-9);
        let name = |s: &Surface| scene.materials[s.material].name.clone();
        assert!(body.iter().all(|s| name(s) == "porcelain"));
        // The corner on the x axis has been turned to low z.
        let corner = DVec3::new(180.0, 165.0, 50.0);
        assert!(body.iter().flat_map(|s| scene.corners(s)).any(|p| p.distance(corner) < 1e-9));
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
        assert_eq!(scene.area(&scene.surfaces[0]), 1.0);
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

    /// A closed cube of one-sided quads, the ceiling in two; some of them changed.
    fn cube(change: &[(&str, &str)]) -> String {
        let faces = [
            "[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]",
            "[0, 0, 1], [0, 1, 1], [0.5, 1, 1], [0.5, 0, 1]",
            "[0.5, 0, 1], [0.5, 1, 1], [1, 1, 1], [1, 0, 1]",
            "[0, 0, 0], [0, 0, 1], [1, 0, 1], [1, 0, 0]",
            "[0, 1, 0], [1, 1, 0], [1, 1, 1], [0, 1, 1]",
            "[0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]",
            "[1, 0, 0], [1, 0, 1], [1, 1, 1], [1, 1, 0]",
        ];
        let quads = faces.map(|face| format!("{{ corners = [{face}], material = \"w\" }}"));
        let mut text = format!("closed = true\nquad = [{}]\n", quads.join(", "));
        text += "[materials]\nw = { reflectance = [0.5] }\n";
        change.iter().fold(text, |text, (from, to)| text.replacen(from, to, 1))
    }

    #[test]
    fn walls_that_meet_edge_to_edge_leave_no_gaps() {
        let open = [("closed = true", "")];
        // Its ceiling is in two quads, and the walls beside it are in one: there, a gap might be.
        assert!(!described(&cube(&open)).expect("valid").watertight);
        let panels = "[0, 0, 1], [0, 1, 1], [0.5, 1, 1], [0.5, 0, 1]";
        let half =
            "{ corners = [[0.5, 0, 1], [0.5, 1, 1], [1, 1, 1], [1, 0, 1]], material = \"w\" }, ";
        let whole = "[0, 0, 1], [0, 1, 1], [1, 1, 1], [1, 0, 1]";
        let room = [("closed = true", ""), (panels, whole), (half, "")];
        let scene = described(&cube(&room)).expect("valid");
        assert!(scene.watertight && !scene.closed && scene.surfaces.len() == 6);
        let missing =
            "{ corners = [[0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]], material = \"w\" }, ";
        let ajar = [&room[..], &[(missing, "")]].concat();
        assert!(!described(&cube(&ajar)).expect("valid").watertight);
    }

    #[test]
    fn a_panel_of_a_closed_room_that_looks_out_of_it_is_turned_and_said() {
        let panel = "[0.5, 0, 1], [0.5, 1, 1], [1, 1, 1], [1, 0, 1]";
        let turned = "[1, 0, 1], [1, 1, 1], [0.5, 1, 1], [0.5, 0, 1]";
        let right = described(&cube(&[])).expect("valid");
        assert!(right.closed && right.repairs.is_empty());
        let mended = described(&cube(&[(panel, turned)])).expect("valid");
        let said = "surfaces of a closed room that looked out of it, turned round: 1 (quad 3 of \
            scene.toml, of material `w`, around (0.75, 0.5, 1) with the normal (0, 0, -1))";
        assert_eq!(mended.repairs, [said]);
        let open = described(&cube(&[(panel, turned), ("closed = true", "closed = false")]));
        assert!(open.expect("valid").repairs.is_empty());
        for name in GENERATORS {
            let scene = described(&format!("generator = \"{name}\"")).expect("valid");
            assert!(scene.repairs.is_empty(), "{name}: {:?}", scene.repairs);
        }
    }

    #[test]
    fn quads_that_are_nearly_flat_are_cut_and_others_refused_by_place() {
        let roof = "[[quad]]\ncorners = [[0, 0, 2], [4, 0, 2], [4, 3, 3.001], [0, 3, 3]]\n\
            material = \"w\"\n[materials.w]\nreflectance = [0.5]\n";
        let scene = described(roof).expect("valid");
        assert_eq!(scene.surfaces.len(), 2);
        assert_ne!(scene.surfaces[0].face, scene.surfaces[1].face);
        assert_eq!(scene.repairs, ["quads that aren't flat and convex, cut into triangles: 1"]);
        let area = scene.surfaces.iter().map(|s| scene.area(s)).sum::<f64>();
        assert!((area - 4.0 * 10f64.sqrt()).abs() < 0.01, "{area}");
        let message = refusal(&roof.replace("3.001", "7"));
        let place = "; it is quad 1 of scene.toml, of material `w`, around (2, 1.5, 3.5)";
        assert!(message.starts_with("surface 0: ") && message.contains(place), "{message}");
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
            (
                &format!("{quad}{}", wall.replace("0.5]", "1.5]")),
                "`wall` has the reflectance 1.5 in",
            ),
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

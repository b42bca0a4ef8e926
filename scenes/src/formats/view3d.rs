//! Surfaces and controls of View3D (`.vs3`), in the form that lists vertices and surfaces apart (`F 3`).
//!
//! The form is that of the manual: G. N. Walton, "Using the View3D Program", NIST, 2002, and the manual of
//! version 3.3.

use std::collections::HashMap;
use std::path::Path;

use farfield_radiosity::Patch;
use glam::DVec3;

use crate::formats::text::{Line, Lines, read_text};
use crate::scene::Scene;
use crate::scene::error::SceneError;
use crate::scene::material::{Material, RGB_BANDS};
use crate::scene::place::Part;
use crate::scene::surface::Surface;

/// What is in a file of View3D.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct View3d {
    /// A surface for each of the file's, in their order, and a material for each, of the surface's name and one
    /// minus its emissivity as reflectance. What lies on a base looks where the base looks.
    pub scene: Scene,
    /// What the surfaces are to each other.
    pub surfaces: Vec<View3dSurface>,
    /// The controls `out`, `encl` and `emit`.
    pub controls: [u32; 3],
}

/// What View3D says of a surface.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct View3dSurface {
    /// Its name.
    pub name: String,
    /// What it does.
    pub role: View3dRole,
    /// The index of the surface of which it covers a part.
    pub base: Option<usize>,
    /// The index of the surface to which its factors are added.
    pub combined: Option<usize>,
    /// Its emissivity.
    pub emissivity: f64,
}

/// What a surface does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum View3dRole {
    /// It radiates (`S`); on a base, in place of the part of it that it covers.
    Radiating,
    /// It covers a part of its base, which sees only it, as it sees only its base (`M`).
    Mask,
    /// It takes a part of its base away (`N`).
    Null,
    /// It hides, and nothing more (`O`).
    Obstruction,
}

impl View3d {
    /// The surfaces in a file.
    ///
    /// # Errors
    /// [`SceneError::Read`], or [`SceneError::Line`] for the first line that isn't what it should be or if the
    /// line that ends the data is missing; [`SceneError::File`] if there are no surfaces.
    pub fn read(path: &Path) -> Result<Self, SceneError> {
        let text = read_text(path)?;
        let mut reader = Reader::default();
        let mut lines = Lines::new(path, &text).commented(&['!', '/']);
        while reader.read(lines.expect("a line that begins with E and ends the data")?)? {}
        if reader.found.surfaces.is_empty() {
            let expected = "surfaces, found none".to_owned();
            return Err(SceneError::File { path: path.to_owned(), expected });
        }
        let numbers = (1..=reader.found.surfaces.len() as u32).collect();
        reader.found.scene.parts = vec![Part { kind: "surface", numbers, ..Part::default() }];
        Ok(reader.found)
    }

    /// The scene by itself.
    ///
    /// # Errors
    /// [`SceneError::File`] if surfaces lie on others, which a scene doesn't know.
    pub(crate) fn into_scene(self, path: &Path) -> Result<Scene, SceneError> {
        if self.surfaces.iter().any(|surface| surface.base.is_some()) {
            let expected = "no surfaces that lie on a base: only form factors are known of those";
            return Err(SceneError::File { path: path.to_owned(), expected: expected.to_owned() });
        }
        Ok(self.scene)
    }
}

/// What has been read so far.
#[derive(Default)]
struct Reader {
    found: View3d,
    /// The vertices and the surfaces by their numbers.
    vertices: HashMap<u32, u32>,
    numbers: HashMap<u32, usize>,
}

/// The parameters of a control line.
const CONTROLS: [&str; 10] =
    ["out", "encl", "emit", "eps", "maxu", "maxo", "mino", "row", "col", "list"];
/// How far what lies on a base may be off its plane or beyond its edges, relative to the base.
const OFF_BASE: f64 = 1e-4;

impl Reader {
    /// Reads a line; returns whether there are more to be read.
    fn read(&mut self, mut line: Line) -> Result<bool, SceneError> {
        let first = line.words.remove(0);
        let mut characters = first.chars();
        let kind = characters.next().map(|kind| kind.to_ascii_uppercase());
        if matches!(kind, Some('T')) {
            return Ok(true);
        }
        if matches!(kind, Some('E' | '*')) {
            return Ok(false);
        }
        // Data may begin right behind the letter.
        if !characters.as_str().is_empty() {
            line.words.insert(0, characters.as_str());
        }
        match kind {
            Some('C') => self.read_controls(&line)?,
            Some('F') if line.words == ["3"] => (),
            Some('F') => {
                return Err(line.refusal(format!("the geometry 3, found {}", line.quoted())));
            }
            Some('V') => self.read_vertex(&line)?,
            Some('S') => self.read_surface(&line, View3dRole::Radiating)?,
            Some('M') => self.read_surface(&line, View3dRole::Mask)?,
            Some('N') => self.read_surface(&line, View3dRole::Null)?,
            Some('O') => self.read_surface(&line, View3dRole::Obstruction)?,
            _ => {
                let expected =
                    format!("a line that begins with T, C, F, V, S, M, N, O or E, found `{first}`");
                return Err(line.refusal(expected));
            }
        }
        Ok(true)
    }

    fn read_controls(&mut self, line: &Line) -> Result<(), SceneError> {
        for word in &line.words {
            let pair = word.split_once('=').and_then(|(name, value)| {
                let name = CONTROLS.iter().position(|known| name.eq_ignore_ascii_case(known))?;
                let value = value.parse::<f64>().ok().filter(|value| *value >= 0.0)?;
                Some((name, value))
            });
            let Some((name, value)) = pair.filter(|(_, value)| value.is_finite()) else {
                let names = CONTROLS.join(", ");
                return Err(line.refusal(format!("one of {names} = a number, found `{word}`")));
            };
            if let Some(control) = self.found.controls.get_mut(name) {
                *control = value as u32;
            }
        }
        Ok(())
    }

    fn read_vertex(&mut self, line: &Line) -> Result<(), SceneError> {
        let number = number(line, 0)?;
        let place = line.point(1)?;
        if line.words.len() > 4 {
            let found = line.quoted();
            return Err(line.refusal(format!("a number and three coordinates, found {found}")));
        }
        let index = self.found.scene.vertices.len() as u32;
        if number == 0 || self.vertices.insert(number, index).is_some() {
            return Err(line.refusal(format!("a new vertex from 1 on, found {number} again")));
        }
        self.found.scene.vertices.push(place);
        Ok(())
    }

    fn read_surface(&mut self, line: &Line, role: View3dRole) -> Result<(), SceneError> {
        let own = number(line, 0)?;
        let index = self.found.surfaces.len();
        let mut corners = Vec::with_capacity(4);
        for word in 1..=4 {
            let vertex = number(line, word)?;
            match self.vertices.get(&vertex) {
                Some(&vertex) => corners.push(vertex),
                None if vertex == 0 && word == 4 => (),
                None => return Err(line.refusal(format!("vertices from above, found {vertex}"))),
            }
        }
        let other = |word: usize| match number(line, word)? {
            0 => Ok(None),
            other => self.numbers.get(&other).copied().map(Some).ok_or_else(|| {
                line.refusal(format!("0 or the number of a surface from above, found {other}"))
            }),
        };
        let (base, combined) = (other(5)?, other(6)?);
        let emissivity = line.words.get(7).and_then(|word| word.parse::<f64>().ok());
        let Some(emissivity) = emissivity.filter(|e| (0.0..=1.0).contains(e)) else {
            return Err(line.refusal(format!("an emissivity from 0 to 1, found {}", line.quoted())));
        };
        if own == 0 || self.numbers.insert(own, index).is_some() {
            return Err(line.refusal(format!("a new surface from 1 on, found {own} again")));
        }
        let covers = matches!(role, View3dRole::Mask | View3dRole::Null);
        if covers {
            // From where its base looks.
            corners.reverse();
        }
        let places: Vec<DVec3> =
            corners.iter().map(|&k| self.found.scene.vertices[k as usize]).collect();
        let patch = Patch::new(&places)
            .map_err(|error| line.refusal(format!("a flat convex surface: {error}")))?;
        match base {
            Some(base) => self.check_base(line, &patch, base)?,
            None if covers => return Err(line.refusal("the number of a base, found 0")),
            None => (),
        }
        let name = line.words.get(8..).unwrap_or_default();
        // A number there, but for one that may be a name, is one too many before it.
        let is_number = |word: &&str| word.parse::<f64>().is_ok();
        let is_whole = |word: &&str| word.bytes().all(|byte| byte.is_ascii_digit());
        if name.first().is_some_and(|word| is_number(word) && (name.len() > 1 || !is_whole(word))) {
            let found = line.quoted();
            return Err(line.refusal(format!(
                "four vertices, a base, a surface to add to, an emissivity and a name, found {found}"
            )));
        }
        let name = if name.is_empty() { format!("surface-{own}") } else { name.join(" ") };
        let scene = &mut self.found.scene;
        let reflectance = [1.0 - emissivity; RGB_BANDS];
        scene.materials.push(Material::rgb(&name, reflectance, [0.0; RGB_BANDS]));
        scene.surfaces.push(Surface { corners, material: index, face: index as u32 });
        self.found.surfaces.push(View3dSurface { name, role, base, combined, emissivity });
        Ok(())
    }

    /// Checks that a surface lies on its base, and looks as it should.
    fn check_base(&self, line: &Line, patch: &Patch, base: usize) -> Result<(), SceneError> {
        let scene = &self.found.scene;
        let corners = scene.corners(&scene.surfaces[base]);
        let normal = patch.normal();
        let size = corners.iter().map(|corner| corner.distance(corners[0])).fold(0.0, f64::max);
        let beyond = |p: DVec3, a: DVec3, b: DVec3| {
            normal.cross(b - a).normalize_or_zero().dot(p - a) < -OFF_BASE * size
        };
        let off = patch.corners().iter().any(|&p| {
            let edges = corners.iter().zip(corners.iter().cycle().skip(1));
            normal.dot(p - corners[0]).abs() > OFF_BASE * size
                || edges.into_iter().any(|(&a, &b)| beyond(p, a, b))
        });
        if off {
            let name = &self.found.surfaces[base].name;
            let expected = format!(
                "a surface within its base `{name}`, which looks the same way, masks and nulls the other way"
            );
            return Err(line.refusal(expected));
        }
        Ok(())
    }
}

/// A whole number, 0 or more.
fn number(line: &Line, word: usize) -> Result<u32, SceneError> {
    line.words.get(word).and_then(|word| word.parse().ok()).ok_or_else(|| {
        line.refusal(format!("a whole number at place {}, found {}", word + 1, line.quoted()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    const PLANES: &str = "T two planes\nC list=1 encl=0 eps=1.e-5 maxU=8\nF  3\n! # x y z\n\
        V 1 0. 0. 0.\nV 2 1. 0. 0.\nV 3 1. 1. 0. ! a corner\nV 4 0. 1. 0.\n\
        V 5 0 0 1\nV 6 1 0 1\nV 7 1 1 1\nV 8 0 1 1\n\
        V 9 .4 .4 0\nV 10 .6 .4 0\nV 11 .6 .6 0\nV 12 .4 .6 0\n\
        S 1  1 2 3 4  0 0 0.90 bottom\ns 2  8 7 6 5  0 0 0.5 top\n\
        M 3  12 11 10 9  1 0 0.9 mask\nS 4  8 7 6 0  0 2 .5\nO 5 5 6 11 12 0 0 .5 O\nEnd of data\nrubbish\n";

    fn read(text: &str) -> Result<View3d, SceneError> {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("room.vs3");
        fs::write(&path, text).expect("written");
        View3d::read(&path)
    }

    #[test]
    fn surfaces_come_with_their_roles() {
        let found = read(PLANES).expect("valid");
        found.scene.check().expect("valid");
        let names: Vec<_> = found.surfaces.iter().map(|s| &s.name[..]).collect();
        assert_eq!(names, ["bottom", "top", "mask", "surface-4", "O"]);
        let roles: Vec<_> = found.surfaces.iter().map(|s| s.role).collect();
        let [radiating, mask] = [View3dRole::Radiating, View3dRole::Mask];
        assert_eq!(roles, [radiating, radiating, mask, radiating, View3dRole::Obstruction]);
        assert_eq!((found.surfaces[2].base, found.surfaces[3].combined), (Some(0), Some(1)));
        assert_eq!(found.scene.materials[1].reflectance, [0.5; 3]);
        assert_eq!(found.scene.surfaces[3].corners, [7, 6, 5]);
        // The mask is turned to where its base looks.
        let normal = |k: usize| {
            let corners = found.scene.corners(&found.scene.surfaces[k]);
            Patch::new(&corners).expect("flat").normal()
        };
        assert!(normal(2).dot(normal(0)) > 0.99);
        let message = found.into_scene(Path::new("a.vs3")).expect_err("a mask").to_string();
        assert!(message.contains("no surfaces that lie on a base"), "{message}");
    }

    #[test]
    fn names_may_have_spaces_or_be_whole_numbers() {
        let text = PLANES.replace("bottom", "the floor").replace("0.5 top", "0.5 12");
        let found = read(&text).expect("valid");
        let names: Vec<_> = found.surfaces.iter().take(2).map(|s| &s.name[..]).collect();
        assert_eq!(names, ["the floor", "12"]);
    }

    #[test]
    fn a_file_without_surfaces_is_refused_by_name() {
        let message = read("T nothing\nF 3\nV 1 0 0 0\nEnd\n").expect_err("empty").to_string();
        assert!(message.ends_with("room.vs3: expected surfaces, found none"), "{message}");
    }

    #[test]
    fn malformed_files_are_refused_at_the_line() {
        for (from, to, line, expected) in [
            ("F  3", "F 3a", 3, "the geometry 3, found `3a`"),
            ("list=1", "lost=1", 2, "= a number, found `lost=1`"),
            ("list=1", "list=x", 2, "= a number, found `list=x`"),
            ("V 2 1. 0. 0.", "V 2 1. nan 0.", 6, "three finite numbers"),
            ("V 2 1. 0. 0.", "V 1 1. 0. 0.", 6, "a new vertex from 1 on, found 1 again"),
            (
                "V 2 1.",
                "Q 2 1.",
                6,
                "a line that begins with T, C, F, V, S, M, N, O or E, found `Q`",
            ),
            ("S 1  1 2 3 4", "S 1  1 2 3 40", 17, "vertices from above, found 40"),
            ("S 1  1 2 3 4", "S 1  1 0 3 4", 17, "vertices from above, found 0"),
            ("S 1  1 2 3 4", "S 1  1 3 2 4", 17, "a flat convex surface: "),
            ("0 0 0.90", "7 0 0.90", 17, "0 or the number of a surface from above, found 7"),
            ("0 0 0.90", "0 0 1.90", 17, "an emissivity from 0 to 1"),
            ("s 2", "s 1", 18, "a new surface from 1 on, found 1 again"),
            ("12 11 10 9  1 0", "12 11 10 9  0 0", 19, "the number of a base, found 0"),
            ("12 11 10 9  1 0", "9 10 11 12  1 0", 19, "a surface within its base `bottom`"),
            ("12 11 10 9  1 0", "12 11 10 9  2 0", 19, "a surface within its base `top`"),
            ("S 4  8", "S x  8", 20, "a whole number at place 1"),
            ("V 2 1. 0. 0.", "V 2 1. 0. 0. 0.", 6, "a number and three coordinates, found `2 1."),
            ("0 0 0.90 bottom", "0 0 0 0.90 bottom", 17, "four vertices, a base, a surface to add"),
            ("0 2 .5\n", "0 2 0 .5\n", 20, "four vertices, a base, a surface to add to"),
            ("End of data\nrubbish\n", "", 21, "ends the data, found the end of the file"),
        ] {
            let text = PLANES.replacen(from, to, 1);
            assert_ne!(text, PLANES, "{from}");
            let message = read(&text).expect_err(to).to_string();
            let place = format!("room.vs3, line {line}: expected ");
            assert!(message.contains(&place) && message.contains(expected), "{message}");
        }
    }
}

//! Scenes of meshes that are in memory already.

use glam::DVec3;

use crate::repair::soup::Soup;
use crate::scene::Scene;
use crate::scene::error::SceneError;
use crate::scene::material::Material;

impl Scene {
    /// The scene of a mesh: its vertices, and its faces, each with the numbers of its corners, counter-clockwise
    /// around its front, and of its material.
    ///
    /// It is mended as meshes in files are. Vertices at one place become one, faces that aren't flat and convex
    /// with three or four corners are cut into triangles, those without area or that have been there before are
    /// dropped, and faces that disagree with their neighbours about the front are turned round. `repairs` says what
    /// was done, and `parts` which surface is of which face, counted from 0.
    ///
    /// # Errors
    /// [`SceneError::Coordinates`] for a vertex that isn't finite, [`SceneError::Vertex`] for a corner at a vertex that
    /// doesn't exist, and what [`check`](Self::check) refuses.
    pub fn from_faces<'a>(
        vertices: &[DVec3],
        faces: impl IntoIterator<Item = (&'a [u32], usize)>,
        materials: Vec<Material>,
    ) -> Result<Self, SceneError> {
        let mut soup = Soup::default();
        for (vertex, place) in vertices.iter().enumerate() {
            if !place.is_finite() {
                return Err(SceneError::Coordinates { vertex, found: place.to_array() });
            }
            soup.add_vertex(*place);
        }
        for (surface, (corners, material)) in faces.into_iter().enumerate() {
            if !soup.add_polygon(corners, material) {
                let vertices = vertices.len();
                let missing = corners.iter().copied().find(|&k| k as usize >= vertices);
                let found = missing.unwrap_or_default();
                return Err(SceneError::Vertex { surface, found, vertices });
            }
        }
        let mut scene = soup.into_scene(materials);
        for number in scene.parts.iter_mut().flat_map(|part| &mut part.numbers) {
            *number -= 1;
        }
        scene.check()?;
        Ok(scene)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: [DVec3; 4] = [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y];

    #[test]
    fn surfaces_say_which_face_they_are_of() {
        let faces: [&[u32]; 4] = [&[0, 1, 1], &[0, 1, 2, 3], &[1, 2, 3, 0], &[2, 1, 0]];
        let faces = faces.map(|corners| (corners, 0));
        let scene = Scene::from_faces(&SQUARE, faces, vec![Material::grey()]).expect("a scene");
        assert_eq!(scene.parts[0].numbers, [1, 3]);
        assert_eq!(scene.repairs.len(), 2);
        assert!(scene.describe(0).starts_with("face 1, of material `grey`"));
    }

    #[test]
    fn what_is_no_mesh_is_refused() {
        let refusal = |vertices: &[DVec3], corners: &[u32], material: usize| {
            let materials = vec![Material::grey()];
            Scene::from_faces(vertices, [(corners, material)], materials)
                .expect_err("none")
                .to_string()
        };
        let nowhere = [DVec3::ZERO, DVec3::NAN];
        let expected = "vertex 1 is at [NaN, NaN, NaN]: expected finite coordinates";
        assert_eq!(refusal(&nowhere, &[0, 1], 0), expected);
        let expected = "surface 0 has a corner at vertex 7: expected less than 4";
        assert_eq!(refusal(&SQUARE, &[0, 7, 1], 0), expected);
        assert!(refusal(&SQUARE, &[0, 1, 2], 1).contains("of material 1: expected less than 1"));
        assert!(refusal(&SQUARE, &[0, 1], 0).contains("neither surfaces nor points"));
        assert!(refusal(&[], &[], 0).contains("neither surfaces nor points"));
    }
}

//! Where the nodes of a glTF asset are, and what is seen from its camera.

use std::path::Path;

use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3, DVec4};

use crate::formats::gltf::document::{Document, Node, Perspective};
use crate::scene::error::SceneError;
use crate::scene::viewpoint::Viewpoint;

/// A node of the scene, and where it is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Placed {
    /// Its index.
    pub(crate) node: usize,
    /// From its coordinates to those of the scene.
    pub(crate) place: DAffine3,
}

/// All nodes of the scene to show, or of the first one, or, in a document without scenes, of all trees; a node's
/// children follow it in their order.
///
/// # Errors
/// [`SceneError::Gltf`] for what isn't there, for a node in two places, and for a transform that is none.
pub(crate) fn nodes(path: &Path, document: &Document) -> Result<Vec<Placed>, SceneError> {
    let refusal =
        |place: String, expected| SceneError::Gltf { path: path.to_owned(), place, expected };
    let (scenes, index) = (&document.scenes, document.scene.unwrap_or(0));
    let (whose, roots) = match scenes.get(index) {
        Some(scene) => (format!("scene {index}"), scene.nodes.clone()),
        None if document.scene.is_some() => {
            let expected = format!("a scene below {}, found {index}", scenes.len());
            return Err(refusal("scene".to_owned(), expected));
        }
        None => {
            let mut is_child = vec![false; document.nodes.len()];
            for &child in document.nodes.iter().flat_map(|node| &node.children) {
                is_child.get_mut(child).into_iter().for_each(|is_child| *is_child = true);
            }
            let roots = (0..is_child.len()).filter(|&k| !is_child[k]).collect();
            ("document".to_owned(), roots)
        }
    };
    let mut met = vec![false; document.nodes.len()];
    let mut found = Vec::new();
    let mut next: Vec<(usize, DAffine3, Option<usize>)> =
        roots.iter().rev().map(|&root| (root, DAffine3::IDENTITY, None)).collect();
    while let Some((index, outer, parent)) = next.pop() {
        let place = || parent.map_or(whose.clone(), |parent| name(document, parent));
        let Some(node) = document.nodes.get(index) else {
            let expected = format!("nodes below {}, found {index}", met.len());
            return Err(refusal(place(), expected));
        };
        if std::mem::replace(&mut met[index], true) {
            return Err(refusal(place(), format!("nodes in one place each, found {index} again")));
        }
        let place =
            outer * transform(node).map_err(|expected| refusal(name(document, index), expected))?;
        if !place.is_finite() {
            return Err(refusal(name(document, index), "a finite place".to_owned()));
        }
        found.push(Placed { node: index, place });
        next.extend(node.children.iter().rev().map(|&child| (child, place, Some(index))));
    }
    Ok(found)
}

/// A node by its index and its name.
pub(crate) fn name(document: &Document, node: usize) -> String {
    let entry = document.nodes.get(node);
    named("node", node, entry.and_then(|node| node.name.as_deref()))
}

/// An entry by its index and, if it has one, its name.
pub(crate) fn named(kind: &str, index: usize, name: Option<&str>) -> String {
    let name = name.filter(|name| !name.is_empty());
    name.map_or(format!("{kind} {index}"), |name| format!("{kind} {index} `{name}`"))
}

/// From the coordinates of a node to those of its parent.
fn transform(node: &Node) -> Result<DAffine3, String> {
    if let Some(matrix) = node.matrix {
        let matrix = DMat4::from_cols_array(&matrix);
        let last = matrix.row(3);
        if last != DVec4::W {
            return Err(format!("a matrix with the last row 0, 0, 0, 1, found {last}"));
        }
        return Ok(DAffine3::from_mat4(matrix));
    }
    let scale = node.scale.map_or(DVec3::ONE, DVec3::from_array);
    let translation = node.translation.map_or(DVec3::ZERO, DVec3::from_array);
    let rotation = node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
    let turn = DQuat::from_array(rotation);
    let length = turn.length();
    if !(length > 0.0 && length.is_finite()) {
        return Err(format!("a quaternion as rotation, found {rotation:?}"));
    }
    let turn =
        if turn == DQuat::IDENTITY { DMat3::IDENTITY } else { DMat3::from_quat(turn / length) };
    let linear =
        DMat3::from_cols(turn.x_axis * scale.x, turn.y_axis * scale.y, turn.z_axis * scale.z);
    Ok(DAffine3 { matrix3: linear, translation })
}

/// The viewpoint of a camera at a place.
///
/// # Errors
/// What was expected of the camera.
pub(crate) fn viewpoint(place: &DAffine3, camera: &Perspective) -> Result<Viewpoint, String> {
    let (height, aspect) = (camera.yfov, camera.aspect_ratio.unwrap_or(1.0));
    if !(height > 0.0 && height < std::f64::consts::PI) {
        return Err(format!("yfov between 0 and pi, found {height}"));
    }
    if !(aspect > 0.0 && aspect.is_finite()) {
        return Err(format!("a positive aspectRatio, found {aspect}"));
    }
    let eye = place.translation;
    let [up, back] = [place.matrix3.y_axis, place.matrix3.z_axis].map(DVec3::normalize_or_zero);
    // The square in the middle of a wide or tall picture.
    let film_over_focal = 2.0 * (0.5 * height).tan() * aspect.min(1.0);
    Ok(Viewpoint { eye, target: eye - back, up, film_over_focal })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_1_SQRT_2;

    fn placed(text: &str) -> Result<Vec<(usize, DAffine3)>, String> {
        let document: Document = serde_json::from_str(text).expect("valid");
        let nodes = nodes(Path::new("a.gltf"), &document).map_err(|error| error.to_string())?;
        Ok(nodes.iter().map(|placed| (placed.node, placed.place)).collect())
    }

    #[test]
    fn nodes_are_placed_by_scale_then_rotation_then_translation_within_their_parents() {
        let text = format!(
            "{{\"nodes\": [{{\"children\": [2, 1], \"translation\": [10, 0, 0]}}, \
             {{\"matrix\": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 5, 0, 1]}}, \
             {{\"scale\": [2, 3, 4], \"rotation\": [0, 0, {FRAC_1_SQRT_2}, {FRAC_1_SQRT_2}], \
             \"translation\": [0, 0, 1]}}]}}"
        );
        let found = placed(&text).expect("a tree");
        assert_eq!(found.iter().map(|(node, _)| *node).collect::<Vec<_>>(), [0, 2, 1]);
        let at = |k: usize, p: [f64; 3]| found[k].1.transform_point3(p.into());
        assert!(at(1, [1.0, 1.0, 1.0]).abs_diff_eq(DVec3::new(7.0, 2.0, 5.0), 1e-12));
        assert_eq!(at(2, [1.0, 0.0, 0.0]), DVec3::new(11.0, 5.0, 0.0));
    }

    #[test]
    fn what_is_no_tree_and_no_place_is_refused() {
        for (text, expected) in [
            ("\"scene\": 1, \"scenes\": [{}]", "scene: expected a scene below 1, found 1"),
            ("\"scenes\": [{\"nodes\": [7]}]", "scene 0: expected nodes below 0, found 7"),
            (
                "\"scenes\": [{\"nodes\": [0]}], \"nodes\": [{\"children\": [0], \"name\": \"a\"}]",
                "node 0 `a`: expected nodes in one place each, found 0 again",
            ),
            (
                "\"nodes\": [{\"rotation\": [0, 0, 0, 0]}]",
                "node 0: expected a quaternion as rotation, found [0.0, 0.0, 0.0, 0.0]",
            ),
            (
                "\"nodes\": [{\"matrix\": [1, 0, 0, 2, 0, 1, 0, 0, 0, 0, 1, 0, 0, 5, 0, 1]}]",
                "node 0: expected a matrix with the last row 0, 0, 0, 1, found [2, 0, 0, 1]",
            ),
            (
                "\"nodes\": [{\"children\": [1], \"scale\": [1e300, 1, 1]}, {\"scale\": [1e300, 1, 1]}]",
                "node 1: expected a finite place",
            ),
        ] {
            let found = placed(&format!("{{{text}}}")).expect_err(text);
            assert_eq!(found, format!("a.gltf, {expected}"));
        }
    }

    #[test]
    fn cameras_look_along_minus_z_with_the_shorter_edge_as_the_films() {
        let place = DAffine3::from_translation(DVec3::new(1.0, 2.0, 3.0));
        let camera = |yfov, aspect_ratio| viewpoint(&place, &Perspective { yfov, aspect_ratio });
        let right_angle = std::f64::consts::FRAC_PI_2;
        let wide = camera(right_angle, Some(2.0)).expect("valid");
        assert_eq!((wide.target, wide.up), (DVec3::new(1.0, 2.0, 2.0), DVec3::Y));
        assert!((wide.film_over_focal - 2.0).abs() < 1e-12);
        let tall = camera(right_angle, Some(0.5)).expect("valid");
        assert!((tall.film_over_focal - 1.0).abs() < 1e-12);
        assert_eq!(camera(4.0, None).expect_err("turned over"), "yfov between 0 and pi, found 4");
        let flat = camera(1.0, Some(0.0)).expect_err("flat");
        assert_eq!(flat, "a positive aspectRatio, found 0");
    }
}

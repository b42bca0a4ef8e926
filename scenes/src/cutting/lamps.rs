//! Lamps in as many pieces as the edges of their shadows take.

use crate::cutting::mesh::{count, edge_lengths};
use crate::cutting::pieces::{Cuts, piece_count};
use crate::scene::{Quantity, Scene};

/// Surfaces that radiate so many times as much as the mean are lamps.
const BRIGHT: f64 = 4.0;

/// Pieces of a lamp: as many as possible of these.
const PIECES: [u32; 2] = [16, 4];

/// One part in so many of all elements may be added for lamps.
const SHARE: usize = 10;

/// The same cuts, with lamps cut further, as far as there are no more elements than `most` then and a tenth of them at
/// most is added.
///
/// An element that sees part of a lamp is lit by the share that a few rays to each of the lamp's elements find. By rays to
/// one element alone that share comes in quarters: the edges of shadows would be off by as much, and no
/// estimate from differences of neighbours would know.
pub fn with_lamps_cut(
    scene: &Scene,
    quantity: Quantity,
    cuts: Vec<Cuts>,
    most: usize,
) -> Vec<Cuts> {
    let radiates: Vec<f64> = (0..scene.materials.len())
        .map(|material| scene.emission(material, quantity).iter().sum())
        .collect();
    let (mut power, mut area) = (0.0, 0.0);
    for surface in &scene.surfaces {
        let own = scene.area(surface);
        power += own * radiates[surface.material];
        area += own;
    }
    let is_lamp: Vec<bool> = scene
        .surfaces
        .iter()
        .map(|surface| radiates[surface.material] * area > BRIGHT * power)
        .collect();
    let before = count(scene, cuts.iter().copied());
    for pieces in PIECES {
        let finer: Vec<Cuts> = cuts
            .iter()
            .zip(&scene.surfaces)
            .zip(&is_lamp)
            .map(|((&cuts, surface), is_lamp)| {
                let corners = scene.corners(surface);
                if *is_lamp && piece_count(corners.len(), cuts) < pieces as usize {
                    in_pieces(edge_lengths(&corners), pieces)
                } else {
                    cuts
                }
            })
            .collect();
        let after = count(scene, finer.iter().copied());
        if after <= most as f64 && after - before <= (most / SHARE) as f64 {
            return finer;
        }
    }
    cuts
}

/// Cuts of a surface of these edges into about so many pieces, about as long as wide.
fn in_pieces([a, b]: [f64; 2], pieces: u32) -> Cuts {
    let along = (f64::from(pieces) * a / b).sqrt().round().clamp(1.0, f64::from(pieces)) as u32;
    [along, pieces.div_ceil(along)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cutting::mesh::even_cuts;
    use crate::scene::material::Material;
    use glam::DVec3;

    /// A floor of 100, lit by lamps of 1, of .1 × 1.6, and a triangle.
    fn scene() -> Scene {
        let lamp = Material::rgb("lamp", [0.0; 3], [9.0; 3]);
        let mut scene = Scene { materials: vec![Material::grey(), lamp], ..Scene::default() };
        let [x, y, z] = DVec3::AXES;
        let quad = |at: DVec3, x: DVec3, y: DVec3| [at, at + x, at + x + y, at + y];
        scene.add(&quad(DVec3::ZERO, 10.0 * x, 10.0 * y), 0, 0);
        scene.add(&quad(z, y, x), 1, 1);
        scene.add(&quad(2.0 * z, 0.1 * y, 1.6 * x), 1, 2);
        scene.add(&[3.0 * z, 3.0 * z + y, 3.0 * z + x], 1, 3);
        scene
    }

    #[test]
    fn lamps_are_cut_as_far_as_there_is_room_for_it() {
        let scene = scene();
        let cuts = |elements: usize, most: usize| {
            let cuts = even_cuts(&scene, elements).expect("a scene");
            let found = with_lamps_cut(&scene, Quantity::Light, cuts.clone(), most);
            assert_eq!(found[0], cuts[0]);
            (found[1..].to_vec(), found == cuts)
        };
        assert_eq!(cuts(100, 1000).0, [[4, 4], [1, 16], [4, 4]]);
        assert_eq!(cuts(100, 160).0, [[2, 2], [1, 4], [2, 2]]);
        assert!(cuts(100, 90).1, "there is no room");
        assert!(cuts(10_000, 11_000).1, "what is fine enough stays");
    }

    #[test]
    fn what_is_no_brighter_than_the_rest_is_no_lamp() {
        let mut scene = scene();
        scene.materials[0] = scene.materials[1].clone();
        let cuts = even_cuts(&scene, 100).expect("a scene");
        assert_eq!(with_lamps_cut(&scene, Quantity::Light, cuts.clone(), 1000), cuts);
        assert_eq!(with_lamps_cut(&scene, Quantity::Heat, cuts.clone(), 1000), cuts);
    }
}

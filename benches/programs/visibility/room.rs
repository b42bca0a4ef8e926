//! The room that is measured.

use farfield_radiosity::Scene;
use glam::DVec3;

/// How much brighter than everything else the lamp is.
const LAMP: f64 = 50.0;

/// A unit cube with a lamp under its ceiling and two turned blocks, all cut into equal squares.
pub(crate) struct Room {
    pub(crate) scene: Scene,
    lamp: u32,
}

impl Room {
    /// The room with about so many elements.
    pub(crate) fn new(elements: usize) -> Self {
        let mut scene = Scene::new();
        let edge = (AREA / elements as f64).sqrt();
        let pieces = |length: f64| ((length / edge).round() as usize).max(1);
        scene.add_room(DVec3::ZERO, DVec3::ONE, pieces(1.0));
        let lamp = [[0.4, 0.4, 0.999], [0.4, 0.6, 0.999], [0.6, 0.6, 0.999], [0.6, 0.4, 0.999]];
        let lamp = scene.add_quad(lamp.map(DVec3::from), pieces(0.2), pieces(0.2));
        for (corner, u, v, height) in [
            ([0.55, 0.15], [0.28, 0.08], [-0.08, 0.28], 0.3),
            ([0.2, 0.5], [0.28, -0.09], [0.09, 0.28], 0.6),
        ] {
            let [corner, u, v] = [corner, u, v].map(|[x, y]| DVec3::new(x, y, 0.0));
            let up = DVec3::Z * height;
            let base = [corner, corner + u, corner + u + v, corner + v];
            scene.add_quad(base.map(|p| p + up), pieces(u.length()), pieces(v.length()));
            for k in 0..4 {
                let (a, b) = (base[k], base[(k + 1) % 4]);
                scene.add_quad([a, b, b + up, a + up], pieces(a.distance(b)), pieces(height));
            }
        }
        Self { scene, lamp }
    }

    /// How much brighter than the mean each face is.
    pub(crate) fn brightness(&self) -> Vec<f64> {
        (0..=self.lamp).map(|face| if face == self.lamp { LAMP } else { 1.0 }).collect()
    }

    /// A lamp alone, an even room, and both.
    pub(crate) fn radiosity(&self) -> Vec<[f64; 3]> {
        let of = |face: u32| if face == self.lamp { [LAMP, 0.0, LAMP] } else { [0.0, 1.0, 1.0] };
        self.scene.surfels.iter().map(|surfel| of(surfel.face)).collect()
    }
}

/// Of walls, lamp and blocks together.
const AREA: f64 = 7.2;

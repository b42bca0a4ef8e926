//! Vertices that polygons share because they are at one place.

use std::collections::HashMap;

use glam::DVec3;

/// Vertices, no two of them at one place.
#[derive(Clone, Debug, Default)]
pub(crate) struct Weld {
    /// Where they are, in the order in which they were first asked for.
    pub(crate) vertices: Vec<DVec3>,
    numbers: HashMap<[u64; 3], u32>,
}

impl Weld {
    /// The index of the vertex at a place, which is added if there is none yet.
    pub(crate) fn vertex(&mut self, place: DVec3) -> u32 {
        // Adding zero turns −0 into 0.
        let bits = (place + DVec3::ZERO).to_array().map(f64::to_bits);
        *self.numbers.entry(bits).or_insert_with(|| {
            self.vertices.push(place);
            (self.vertices.len() - 1) as u32
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_has_one_vertex_whatever_the_sign_of_its_zeros() {
        let mut weld = Weld::default();
        let places = [DVec3::X, DVec3::Y, DVec3::new(1.0, -0.0, 0.0), DVec3::X * 1.000_000_1];
        assert_eq!(places.map(|place| weld.vertex(place)), [0, 1, 0, 2]);
        assert_eq!(weld.vertices, [places[0], places[1], places[3]]);
    }
}

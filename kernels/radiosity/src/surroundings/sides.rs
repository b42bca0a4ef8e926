//! Which sides of the occluders' faces exchange light.

use std::collections::HashMap;

use glam::DVec3;

use crate::elements::{Element, Surfel};
use crate::occlusion::Facet;

/// The sides of faces on which elements lie, numbered from 0; elements without a face have a side each.
#[derive(Clone, Debug)]
pub(crate) struct Sides {
    /// For each face, the normals of its sides and their numbers.
    faces: HashMap<u32, Vec<(DVec3, u32)>>,
    /// The side of each element.
    of_elements: Vec<u32>,
    count: u32,
}

/// Normals at a cosine of more than this are those of one side.
const SAME: f64 = 0.5;

impl Sides {
    /// Those of some elements.
    pub(crate) fn new(elements: &[Element]) -> Self {
        let mut sides = Self { faces: HashMap::new(), of_elements: Vec::new(), count: 0 };
        for element in elements {
            let Surfel { normal, face, .. } = *element.surfel();
            let side = sides.side(face, normal).unwrap_or_else(|| {
                sides.count += 1;
                let side = sides.count - 1;
                if face != Surfel::<f64>::NO_FACE {
                    sides.faces.entry(face).or_default().push((normal, side));
                }
                side
            });
            sides.of_elements.push(side);
        }
        sides
    }

    /// How many there are.
    pub(crate) fn count(&self) -> usize {
        self.count as usize
    }

    /// The side that an element lies on.
    pub(crate) fn of_element(&self, element: usize) -> u32 {
        self.of_elements[element]
    }

    /// The side of a facet that something looking along `direction` sees; none if that is a back.
    pub(crate) fn seen(&self, facet: &Facet, direction: DVec3) -> Option<u32> {
        let normal = facet.normal;
        let towards = if normal.dot(direction) > 0.0 { -normal } else { normal };
        self.side(facet.face, towards)
    }

    /// The side of a face that looks about along `normal`.
    fn side(&self, face: u32, normal: DVec3) -> Option<u32> {
        let sides = self.faces.get(&face)?;
        sides.iter().find(|(own, _)| own.dot(normal) > SAME).map(|&(_, side)| side)
    }
}

//! The shapes of elements, found by their surfels.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use farfield::{Real, Vector};
use glam::DVec3;

use crate::elements::{Element, Surfel};
use crate::numbers::mixed;
use crate::occlusion::position;

/// An element as rays to it see it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shape {
    /// The number of the element among all.
    pub(crate) number: u32,
    element: Element,
    /// See [`Element::radius`].
    pub(crate) radius: f64,
}

/// The shapes of all elements of a scene.
#[derive(Clone, Debug)]
pub(crate) struct Shapes {
    shapes: Vec<Shape>,
    numbers: HashMap<u64, u32, BuildHasherDefault<Mixed>>,
}

impl Shapes {
    pub(crate) fn new(elements: &[Element]) -> Self {
        let shapes: Vec<Shape> =
            elements.iter().enumerate().map(|(i, element)| Shape::new(i, element)).collect();
        let keys = elements.iter().map(|element| key(element.surfel()));
        Self { shapes, numbers: keys.zip(0..).collect() }
    }

    /// The shape of an element.
    pub(crate) fn get(&self, element: usize) -> Option<&Shape> {
        self.shapes.get(element)
    }

    /// The shape of the element that has this surfel.
    pub(crate) fn of<T: Real>(&self, surfel: &Surfel<T>) -> Option<&Shape> {
        let number = self.numbers.get(&key(surfel))?;
        self.get(*number as usize)
    }
}

impl Shape {
    pub(crate) fn new(number: usize, element: &Element) -> Self {
        Self { number: number as u32, element: *element, radius: element.radius() }
    }

    /// A surfel that no element is known to have: a point.
    pub(crate) fn point<T: Real>(surfel: &Surfel<T>) -> Self {
        let normal = DVec3::from_array(surfel.normal.to_array().map(T::as_f64));
        let surfel = Surfel { position: position(surfel), normal, area: 0.0, face: surfel.face };
        Self { number: u32::MAX, element: Element::disk(surfel), radius: 0.0 }
    }

    /// Its centroid.
    pub(crate) fn centroid(&self) -> DVec3 {
        self.element.surfel().position
    }

    pub(crate) fn normal(&self) -> DVec3 {
        self.element.surfel().normal
    }

    /// Corners of a convex polygon around it.
    pub(crate) fn corners(&self) -> [DVec3; 4] {
        match self.element.as_patch().map(|patch| patch.corners()) {
            Some(&[a, b, c]) => [a, b, c, c],
            Some(&[a, b, c, d]) => [a, b, c, d],
            _ => {
                let (x, y) = self.normal().any_orthonormal_pair();
                let aside = [x + y, x - y, -x - y, y - x];
                aside.map(|corner| self.centroid() + corner * self.radius)
            }
        }
    }

    /// A point of one of its quarters for each point of the unit square, evenly over the quarter's area.
    pub(crate) fn point_of_quarter(&self, quarter: usize, [u, v]: [f64; 2]) -> DVec3 {
        let [row, column] = [quarter / 2, quarter % 2].map(|k| k as f64);
        self.element.point_at([0.5 * (row + u), 0.5 * (column + v)])
    }
}

/// Bits that tell one surfel from all others.
fn key<T: Real>(surfel: &Surfel<T>) -> u64 {
    let numbers = surfel.position.to_array().into_iter().chain(surfel.normal.to_array());
    // Adding zero turns −0 into 0.
    numbers.fold(0, |key, number| mixed(key ^ (number.as_f64() + 0.0).to_bits()))
}

/// Keys are mixed already.
#[derive(Default)]
struct Mixed(u64);

impl Hasher for Mixed {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        self.0 = bytes.iter().fold(self.0, |hash, &byte| mixed(hash ^ u64::from(byte)));
    }

    fn write_u64(&mut self, key: u64) {
        self.0 = key;
    }
}

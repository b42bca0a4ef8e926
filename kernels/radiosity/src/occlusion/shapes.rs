//! The shapes of elements, found by their surfels.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use farfield::{Real, Vector};
use glam::DVec3;

use crate::elements::{Element, Surfel};
use crate::numbers::mixed;
use crate::occlusion::position;

/// Points of an element that rays start from and end at.
pub(crate) const POINTS: usize = 4;

/// Where an element lies, and where rays to it end.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shape {
    /// The number of the element among all.
    pub(crate) number: u32,
    /// Corners of a convex polygon around it.
    pub(crate) corners: [DVec3; 4],
    /// One in each quarter of it, at random there: on no border, and in step with nothing.
    pub(crate) points: [DVec3; POINTS],
    pub(crate) normal: DVec3,
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
    fn new(number: usize, element: &Element) -> Self {
        let radius = element.radius();
        let corners = match element.as_patch().map(|patch| patch.corners()) {
            Some(&[a, b, c]) => [a, b, c, c],
            Some(&[a, b, c, d]) => [a, b, c, d],
            _ => {
                let Surfel { position, normal, .. } = *element.surfel();
                let (x, y) = normal.any_orthonormal_pair();
                [x + y, x - y, -x - y, y - x].map(|corner| position + corner * radius)
            }
        };
        let within = |k: usize| {
            let bits = mixed((number * 2 * POINTS + k) as u64) >> 11;
            bits as f64 / (1u64 << 53) as f64
        };
        let points = std::array::from_fn(|k| {
            let [row, column] = [k / 2, k % 2].map(|k| k as f64);
            element.point_at([0.5 * (row + within(2 * k)), 0.5 * (column + within(2 * k + 1))])
        });
        let normal = element.surfel().normal;
        Self { number: number as u32, corners, points, normal, radius }
    }

    /// A surfel that no element is known to have: a point.
    pub(crate) fn point<T: Real>(surfel: &Surfel<T>) -> Self {
        let at = position(surfel);
        let normal = DVec3::from_array(surfel.normal.to_array().map(T::as_f64));
        Self { number: u32::MAX, corners: [at; 4], points: [at; POINTS], normal, radius: 0.0 }
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

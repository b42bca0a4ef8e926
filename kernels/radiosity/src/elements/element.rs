//! Elements: pieces of surface with one radiosity.

use glam::DVec3;

use crate::elements::patch::Patch;
use crate::elements::surfel::Surfel;

/// A piece of surface with one radiosity: a flat patch, or an oriented point that stands for a disk.
///
/// An element radiates and receives on its front only; a sheet lit on both sides is two elements that
/// share a face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Element {
    surfel: Surfel,
    patch: Option<Patch>,
}

impl Element {
    /// The element of a patch that lies on the occluder face `face`, which never hides it;
    /// [`Surfel::NO_FACE`] if it lies on none.
    pub fn patch(patch: Patch, face: u32) -> Self {
        let (position, normal, area) = (patch.centroid(), patch.normal(), patch.area());
        Self { surfel: Surfel { position, normal, area, face }, patch: Some(patch) }
    }

    /// The element of an oriented point: a disk of the surfel's area around its position.
    pub fn disk(surfel: Surfel) -> Self {
        Self { surfel, patch: None }
    }

    /// The surfel at its centroid, with its normal and area. Distant elements need nothing else of it.
    pub fn surfel(&self) -> &Surfel {
        &self.surfel
    }

    /// Its patch; none if it is a disk.
    pub fn as_patch(&self) -> Option<&Patch> {
        self.patch.as_ref()
    }

    /// A point of it for each point of the unit square, evenly over its area.
    pub(crate) fn point_at(&self, [u, v]: [f64; 2]) -> DVec3 {
        let Some(patch) = &self.patch else {
            let (x, y) = self.surfel.normal.any_orthonormal_pair();
            let (sin, cos) = (std::f64::consts::TAU * v).sin_cos();
            return self.surfel.position + (x * cos + y * sin) * (self.radius() * u.sqrt());
        };
        patch.point_at([u, v])
    }

    /// The radius of the smallest sphere around its centroid that contains it, in scene units.
    pub fn radius(&self) -> f64 {
        match &self.patch {
            Some(patch) => {
                let reach = |corner: &DVec3| corner.distance(self.surfel.position);
                patch.corners().iter().map(reach).fold(0.0, f64::max)
            }
            None => (self.surfel.area * std::f64::consts::FRAC_1_PI).sqrt(),
        }
    }
}

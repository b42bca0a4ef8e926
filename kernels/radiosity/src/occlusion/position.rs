//! Where a surfel is, in the precision of occluders.

use farfield::{Real, Vector};
use glam::DVec3;

use crate::elements::Surfel;

/// Where a surfel is, in the precision of the occluders.
pub(crate) fn position<T: Real>(surfel: &Surfel<T>) -> DVec3 {
    DVec3::from_array(surfel.position.to_array().map(T::as_f64))
}

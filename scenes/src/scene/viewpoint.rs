//! From where to look at a scene.

use glam::DVec3;

use crate::scene::error::SceneError;

/// A pinhole camera's place and direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// Where the camera is.
    pub eye: DVec3,
    /// The point in the middle of the picture.
    pub target: DVec3,
    /// Which way is up in the picture; not along the line of sight.
    pub up: DVec3,
    /// Edge of the square film over its distance from the lens.
    pub film_over_focal: f64,
}

impl Viewpoint {
    /// Checks that it looks somewhere, and that what is up isn't there.
    pub(crate) fn check(&self) -> Result<(), SceneError> {
        let refusal = |what, found, expected| Err(SceneError::Camera { what, found, expected });
        for (what, place) in [("its eye", self.eye), ("its target", self.target)] {
            if !place.is_finite() {
                return refusal(what, place, "finite coordinates");
            }
        }
        let Some(sight) = (self.target - self.eye).try_normalize() else {
            return refusal("its target", self.target, "somewhere else than its eye");
        };
        let aside = self.up.try_normalize().map_or(0.0, |up| up.cross(sight).length());
        if aside > LEAST_ASIDE {
            Ok(())
        } else {
            refusal("up", self.up, "a direction that it doesn't look along")
        }
    }
}

/// The least sine between the line of sight and what is up.
const LEAST_ASIDE: f64 = 1e-6;

//! Which parts of a scene are closed, so that their rows of form factors sum to 1.

use farfield_radiosity::{Closure, Error, RadiosityOperator, Surroundings};
use farfield_scenes::Scene;

/// The most that a form factor may have to change for a row to sum to 1.
const MOST_CLOSURE: f64 = 0.5;

/// Closes the parts of a scene that no ray leaves, if it is said to be closed or its mesh has no gaps, and returns which
/// they are: none where light passes through everything.
///
/// # Errors
/// Those of [`RadiosityOperator::close_parts`]. What is not said to be closed stays open where it can't be closed.
pub(super) fn close<const BANDS: usize>(
    operator: &mut RadiosityOperator<'_, BANDS>,
    scene: &Scene,
    around: &Surroundings<'_>,
    passes: bool,
) -> Result<(Vec<Option<u32>>, Closure), Error> {
    let found = around.closed_parts();
    let open = || vec![None; found.len()];
    let closes = scene.closed || scene.watertight;
    let parts = if closes { found.to_vec() } else { open() };
    if passes {
        return Ok((parts, Closure::default()));
    }
    match operator.close_parts(parts.clone(), MOST_CLOSURE) {
        Err(Error::NotClosable { .. } | Error::NotClosed { .. }) if closes && !scene.closed => {
            Ok((open(), operator.close_parts(open(), MOST_CLOSURE)?))
        }
        closure => Ok((parts, closure?)),
    }
}

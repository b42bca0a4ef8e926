//! What is asked of an interpolation.

use crate::error::Error;
use crate::interpolation::tuning::MAX_ORDER;

/// What decides how much is kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Accuracy {
    /// The relative l2 error to stay below.
    Tolerance(f64),
    /// The number of nodes per axis; everything else is as accurate as it makes sense.
    Order(usize),
}

impl Accuracy {
    pub(crate) fn check(self) -> Result<(), Error> {
        match self {
            Self::Order(found) if found == 0 || found > MAX_ORDER => {
                Err(Error::InvalidOrder { min: 1, max: MAX_ORDER, found })
            }
            Self::Tolerance(found) if !(found > 0.0 && found < 1.0) => {
                Err(Error::InvalidTolerance { found })
            }
            _ => Ok(()),
        }
    }
}

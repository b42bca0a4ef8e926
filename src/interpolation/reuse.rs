//! The operators of a kernel: kept from a plan before, found in a store, or built.

use std::sync::Arc;

use crate::interpolation::accuracy::Accuracy;
use crate::interpolation::budget::SAFE_SHARE;
use crate::interpolation::entries::Entries;
use crate::interpolation::kept::Former;
use crate::interpolation::known::{Identity, Key};
use crate::interpolation::operators::{Operators, Sizes};
use crate::interpolation::order::Refusal;
use crate::interpolation::store::OperatorStore;
use crate::numbers::traits::Scalar;

/// Former operators that still serve, or stored ones, or new ones; and for how many levels they were built.
pub(crate) fn operators<S: Scalar>(
    (store, identity): (&OperatorStore, Identity),
    kernel: &Entries<'_, S>,
    slopes: Option<&Entries<'_, S>>,
    accuracy: Accuracy,
    sizes: &mut Sizes<S::Real>,
    former: Option<Former<'_, S>>,
) -> Result<(Arc<Operators<S>>, usize), Refusal> {
    let levels = sizes.half_widths.len() as f64;
    let most = match accuracy {
        Accuracy::Tolerance(tolerance) => SAFE_SHARE * tolerance / levels.sqrt(),
        Accuracy::Order(_) => f64::INFINITY,
    };
    let mut as_kept = sizes.clone();
    let kept = former.map(|former| {
        let kept = former.keep(kernel, slopes.is_some(), most, &mut as_kept);
        (former.whole(&kept), kept)
    });
    if let Some((Some(operators), _)) = &kept {
        *sizes = as_kept;
        return Ok((Arc::clone(operators), 0));
    }
    let key = Key::new(identity, kernel, slopes.is_some(), accuracy, sizes);
    for (operators, known) in store.candidates::<S>(&key) {
        let is_it = match known {
            Some(known) => operators.digest(kernel, slopes, sizes)? == known,
            None => true,
        };
        if is_it {
            return Ok((operators, 0));
        }
    }
    let kept = kept.map(|(_, kept)| kept).filter(|kept| {
        matches!(accuracy, Accuracy::Tolerance(_)) && kept.missing() < kept.levels.len()
    });
    if let Some(kept) = kept {
        // If they don't go together with what is new, all are.
        if let Ok((all, _)) = Operators::new(kernel, slopes, accuracy, &as_kept, Some(&kept), false)
        {
            *sizes = as_kept;
            return Ok((Arc::new(all), kept.missing()));
        }
    }
    let digested = store.needs_digest(&key);
    let (operators, digest) = Operators::new(kernel, slopes, accuracy, sizes, None, digested)?;
    let digest = digested.then(|| operators.digest_from(digest, kernel, slopes, sizes));
    let operators = Arc::new(operators);
    store.remember(key, Arc::clone(&operators), digest);
    let built = operators.levels.len();
    Ok((operators, built))
}

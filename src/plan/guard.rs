//! Charges that a plan was not made for.

use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, Mutex};

use crate::expansion::geometry::{Geometry, Strength};
use crate::expansion::{ChargeOf, Expansion, RealOf};
use crate::interaction::cell_mask::{PointMask, TreePoints};
use crate::interaction::traversal::{Far, Traversal};
use crate::kernel::mask::Unmasked;
use crate::plan::fmm::Ready;
use crate::plan::norms::{ChargeSums, Norms};
use crate::plan::{Plan, Scheme};

/// Sees to it that a plan whose budget is that of whole sums keeps the tolerance whatever the charges.
pub(crate) struct Guard<E: Expansion> {
    norms: Norms,
    geometry: Geometry<RealOf<E>>,
    /// The plan that was made for other charges last. It serves all charges met so far.
    other: Mutex<Option<Arc<Ready<E>>>>,
    applications: AtomicUsize,
}

impl<E: Expansion> Guard<E> {
    /// For a plan of that geometry.
    pub(crate) fn new(norms: Norms, geometry: Geometry<RealOf<E>>) -> Self {
        Self { norms, geometry, other: Mutex::new(None), applications: AtomicUsize::new(0) }
    }

    /// Whether there are charges that the expansion is too coarse for.
    pub(crate) fn is_needed(&self, expansion: &E) -> bool {
        self.norms.depend_on_charges(|level| expansion.pair_sizes(level))
    }

    /// How often another plan served.
    pub(crate) fn applications(&self) -> usize {
        self.applications.load(Relaxed)
    }

    /// The plan for charges that the usual one is too coarse for.
    pub(crate) fn other_plan(
        &self,
        usual: &Plan<E>,
        charges: &[ChargeOf<E>],
    ) -> Option<Arc<Ready<E>>> {
        let sums = ChargeSums::new(charges, &usual.source_tree.shape.order);
        let forbidden = |plan: &Plan<E>| {
            let far = plan.scheme != Scheme::Direct;
            far && self.norms.forbid(&sums, |level| plan.expansion.pair_sizes(level))
        };
        if !forbidden(usual) {
            return None;
        }
        self.applications.fetch_add(1, Relaxed);
        let last = self.other.lock().unwrap_or_else(|e| e.into_inner()).clone();
        if let Some(last) = last.as_ref().filter(|last| !forbidden(&last.plan)) {
            return Some(Arc::clone(last));
        }
        let expansion = &last.as_ref().map_or(usual, |last| &last.plan).expansion;
        let other = Arc::new(Ready::new(self.plan_of(usual, expansion, &sums)?));
        *self.other.lock().unwrap_or_else(|e| e.into_inner()) = Some(Arc::clone(&other));
        Some(other)
    }

    /// A plan for these charges and for all that `last` serves. Direct where no expansion can be had.
    fn plan_of(&self, usual: &Plan<E>, last: &E, charges: &ChargeSums) -> Option<Plan<E>> {
        let strengths = self.norms.strengths(Some(charges));
        let mut geometry = self.geometry.clone();
        for level in &mut geometry.levels {
            let [values, slopes] = strengths[level.level];
            let sizes = last.pair_sizes(level.level);
            let stricter = |own: Option<Strength>, size: f64| {
                own.map(|own| Strength {
                    size: own.size.min(size),
                    through: own.through.min(size),
                    ..own
                })
            };
            level.values = stricter(values.or(level.values), sizes[0]);
            level.slopes = stricter(slopes.or(level.slopes), sizes[1]);
        }
        let mut expansion = usual.expansion.again()?;
        let trees = usual.trees();
        if expansion.prepare(&geometry).is_ok() {
            return Some(Plan::new(expansion, usual.scheme, trees, usual.lists.clone()));
        }
        let mask: PointMask<'_, E::Kernel, _> = PointMask {
            mask: &Unmasked,
            targets: TreePoints { tree: &trees.target_tree, points: &trees.targets },
            sources: TreePoints { tree: &trees.source_tree, points: &trees.sources },
        };
        let (targets, sources) = (&*trees.target_tree, &*trees.source_tree);
        let lists = Traversal { targets, sources, mask: &mask, far: Far::Nothing }.unmasked();
        Some(Plan::new(usual.expansion.again()?, Scheme::Direct, trees, lists))
    }
}

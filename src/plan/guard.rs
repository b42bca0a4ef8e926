//! Charges that a plan was not made for.

use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, Mutex};

use crate::error::Error;
use crate::expansion::admissibility::Admissibility;
use crate::expansion::geometry::{Geometry, Strength};
use crate::expansion::{ChargeOf, Expansion, RealOf};
use crate::interaction::cell_mask::{PointMask, TreePoints};
use crate::interaction::traversal::{Far, Traversal};
use crate::kernel::mask::Unmasked;
use crate::parallel::watch::Watch;
use crate::plan::charge_sums::ChargeSums;
use crate::plan::norms::{Norms, Strengths, forbid};
use crate::plan::ready::Ready;
use crate::plan::tuning::{LIKE_SIZES, OTHER_PLANS, UNUSUAL};
use crate::plan::{Plan, Scheme};

/// Sees to it that a plan whose budget is that of whole sums keeps the tolerance whatever the charges.
pub(crate) struct Guard<E: Expansion> {
    norms: Norms,
    geometry: Geometry<RealOf<E>>,
    /// The plans that were used last for other charges, with what they were made for.
    others: Mutex<Vec<Other<E>>>,
    applications: AtomicUsize,
}

/// Made for these strengths, or direct where more than the tolerance was left out.
type Other<E> = (Option<Vec<Strengths>>, Arc<Ready<E>>);

impl<E: Expansion> Guard<E> {
    /// For a plan of that geometry, with what operators for other charges may cost.
    pub(crate) fn new(norms: Norms, geometry: Geometry<RealOf<E>>) -> Self {
        Self { norms, geometry, others: Mutex::new(Vec::new()), applications: AtomicUsize::new(0) }
    }

    /// Whether there are charges that the expansion is too coarse for.
    pub(crate) fn is_needed(&self, expansion: &E) -> bool {
        self.norms.depend_on_charges(|level| expansion.pair_sizes(level))
    }

    /// How often another plan served.
    pub(crate) fn applications(&self) -> usize {
        self.applications.load(Relaxed)
    }

    /// The plan for charges that the usual one is too coarse for, if there are any. It depends on the charges alone, not on what
    /// was summed before.
    pub(crate) fn other_plan(
        &self,
        usual: &Plan<E>,
        charges: &[ChargeOf<E>],
        watch: &Watch,
    ) -> Result<Option<Arc<Ready<E>>>, Error> {
        let Some(sums) = ChargeSums::new(charges, &usual.source_tree.shape) else {
            return Ok(None);
        };
        let strengths = self.norms.strengths_for(&sums);
        let leaves_out = self.norms.left_out(&sums) > LIKE_SIZES * usual.pair_tolerance;
        if !leaves_out && !forbid(&strengths, |level| usual.expansion.pair_sizes(level)) {
            return Ok(None);
        }
        self.applications.fetch_add(1, Relaxed);
        let stricter = |(own, usual): (Strengths, &Strengths)| {
            [0, 1].map(|channel| {
                own[channel].zip(usual[channel]).map(|(own, usual)| stricter(own, usual))
            })
        };
        let strengths = strengths.into_iter().zip(&self.norms.usual).map(stricter);
        let strengths: Option<Vec<Strengths>> = (!leaves_out).then(|| strengths.collect());
        let mut others = self.others.lock().unwrap_or_else(|e| e.into_inner());
        let known = others.iter().position(|(known, _)| *known == strengths);
        if let Some(known) = known.map(|known| others.remove(known)) {
            let plan = Arc::clone(&known.1);
            others.push(known);
            return Ok(Some(plan));
        }
        drop(others);
        let expanded = strengths.as_ref().and_then(|own| self.expanded(usual, own, watch));
        let plan = expanded.or_else(|| direct(usual, watch));
        // What was not finished is not kept.
        watch.check()?;
        let Some(plan) = plan else { return Ok(None) };
        let plan = Arc::new(Ready::new(plan));
        let mut others = self.others.lock().unwrap_or_else(|e| e.into_inner());
        others.push((strengths, Arc::clone(&plan)));
        if others.len() > OTHER_PLANS {
            others.remove(0);
        }
        Ok(Some(plan))
    }

    /// With an expansion for these strengths, if one can be had.
    fn expanded(&self, usual: &Plan<E>, strengths: &[Strengths], watch: &Watch) -> Option<Plan<E>> {
        let mut geometry = Geometry { watch: watch.clone(), ..self.geometry.clone() };
        for level in &mut geometry.levels {
            let usual = level.values;
            [level.values, level.slopes] = strengths[level.level];
            // All are less by what the one is that is less by most.
            if let (Some(usual), Some(own)) = (usual, level.values) {
                let sizes = level.fields.iter_mut().chain(&mut level.densities);
                sizes.for_each(|size| *size *= own.size / usual.size);
            }
        }
        let mut expansion = usual.expansion.again()?;
        expansion.prepare(&geometry).ok()?;
        let levels = geometry.levels.iter().map(|level| level.level);
        let admits = |level, offset| expansion.admits(level, offset);
        let is_the_same = geometry.admissibility.with(levels, admits) == geometry.admissibility;
        is_the_same.then(|| Plan::new(expansion, usual.scheme, usual.trees(), usual.lists.clone()))
    }
}

/// Sums directly what another plan sums.
fn direct<E: Expansion>(usual: &Plan<E>, watch: &Watch) -> Option<Plan<E>> {
    let trees = usual.trees();
    let mask: PointMask<'_, E::Kernel, _> = PointMask {
        mask: &Unmasked,
        targets: TreePoints { tree: &trees.target_tree, points: &trees.targets },
        sources: TreePoints { tree: &trees.source_tree, points: &trees.sources },
    };
    let (targets, sources) = (&*trees.target_tree, &*trees.source_tree);
    let (far, admissibility) = (Far::Nothing, &Admissibility::default());
    let lists = Traversal { targets, sources, mask: &mask, far, admissibility, watch }.unmasked();
    // Of lists that were not finished there is no plan.
    if watch.is_stopped() {
        return None;
    }
    Some(Plan::new(usual.expansion.again()?, Scheme::Direct, trees, lists))
}

/// No laxer than usual, and a power of two, so that charges that are much the same share a plan.
fn stricter(own: Strength, usual: Strength) -> Strength {
    let size = |own: f64, usual: f64| {
        let least = (own / UNUSUAL).min(usual);
        if least.is_normal() { least.log2().floor().exp2() } else { least }
    };
    Strength {
        size: size(own.size, usual.size),
        through: size(own.through, usual.through),
        ..usual
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::closure::from_fn;
    use crate::kernel::direct::{direct, relative_l2_error};
    use crate::plan::fmm::Fmm;
    use glam::DVec3;

    #[test]
    fn a_plan_for_other_charges_that_is_stopped_changes_nothing() {
        let step = DVec3::new(0.819_172_5, 0.671_043_6, 0.549_700_5);
        let points: Vec<DVec3> = (0..3000).map(|i| (step * f64::from(i)).fract()).collect();
        let usual: Vec<f64> = (0..3000).map(|i| f64::from(i).sin()).collect();
        let right = |(p, &q): (&DVec3, &f64)| if p.x > 0.7 { q } else { 0.0 };
        let far: Vec<f64> = points.iter().zip(&usual).map(right).collect();
        // Sums of which nothing is carried become direct, others get operators of their own.
        for (width, targets_to, leaf_size, applications) in
            [(2e-4, 0.6, 16, 1), (0.02, 0.3, 30, 1000)]
        {
            let targets: Vec<DVec3> = points.iter().copied().filter(|p| p.x < targets_to).collect();
            let kernel = from_fn(move |x: DVec3, y: DVec3| (-x.distance_squared(y) / width).exp())
                .skip_coincident();
            let builder = Fmm::builder(kernel).tolerance(1e-3).applications(applications);
            let fmm = builder.leaf_size(leaf_size).build(&points, &targets).unwrap();
            let before = fmm.apply(&usual).unwrap();
            assert_eq!(fmm.report().unusual_applications, 0, "{width}");
            let watch = Watch::new();
            watch.stop();
            for charges in [&far, &usual] {
                assert_eq!(fmm.apply_watched(charges, &watch), Err(Error::Stopped), "{width}");
            }
            let sums = fmm.apply(&far).unwrap();
            let exact = direct(&kernel, &points, &far, &targets).unwrap();
            assert!(relative_l2_error(&sums, &exact) <= 1e-2, "{width}");
            assert!(fmm.report().unusual_applications > 0, "{width}");
            assert_eq!(fmm.apply(&usual).unwrap(), before, "{width}");
        }
    }
}

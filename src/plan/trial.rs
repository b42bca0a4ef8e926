//! Plans that do not carry all pairs of cells are held against direct sums before they are used.
//!
//! What a kernel is like between cells is found from samples, and what is found in the way is no longer looked at.
//! A narrow peak, or the corner of a region, may have been seen from some cells and missed from others: sums of the
//! actual points tell.

use crate::expansion::{ChargeOf, Expansion, ValueOf};
use crate::kernel::traits::Kernel;
use crate::numbers::random::Random;
use crate::numbers::traits::{Numbers, Real, l2_norm};
use crate::parallel;
use crate::parallel::watch::Watch;
use crate::plan::tuning::{TRIAL_PAIRS, TRIAL_TARGETS, TRIAL_WORK};
use crate::plan::{Plan, Workspace};

/// Whether sums with charges of either sign are as exact as those of pairs, at some of the targets. An application that
/// evaluates the leaves of these targets only, and O(N) pairs. An expansion that does not say how exact pairs have to be
/// is taken at its word.
pub(crate) fn stands_trial<E: Expansion>(plan: &Plan<E>, watch: &Watch) -> bool {
    if plan.pair_tolerance == 0.0 {
        return true;
    }
    let kernel = plan.expansion.kernel();
    let order = &plan.source_tree.shape.order;
    let mut random = Random::new(1);
    let charges: Vec<ChargeOf<E>> =
        order.iter().map(|_| charge::<E>(kernel, &mut random)).collect();
    let (mut workspace, every) = (Workspace::new(plan), leaves_between(plan));
    plan.run_at_some(&charges, &mut workspace, every, watch);
    let sums = &workspace.values;

    let in_tree_order: Vec<ChargeOf<E>> =
        order.iter().map(|&i| charges[i as usize].clone()).collect();
    let shape = &plan.target_tree.shape;
    let leaves = shape.leaves.iter().step_by(every);
    let summed: Vec<usize> = leaves.flat_map(|&t| shape.nodes[t as usize].points()).collect();
    let step = summed.len().div_ceil(TRIAL_TARGETS).max(1);
    let places: Vec<usize> = summed.iter().copied().step_by(step).collect();
    let errors = parallel::map(places.len(), &|k| {
        let place = places[k];
        if watch.is_stopped() {
            return [0.0; 2];
        }
        let mut exact = [<ValueOf<E> as Numbers>::zero()];
        let target = &plan.targets[place..=place];
        kernel.add_block(target, &plan.sources, &in_tree_order, 0.0, &mut exact);
        let [exact] = exact;
        let mut error = sums[place].clone();
        error.subtract(&exact);
        [error.norm(), exact.norm()]
    });
    let [error, size] = [0, 1].map(|part| l2_norm(errors.iter().map(|pair| pair[part])));
    // Few targets may hold most of all sums.
    let share = places.len() as f64 / summed.len().max(1) as f64;
    let size = size.max(share.sqrt() * l2_norm(summed.iter().map(|&place| sums[place].norm())));
    error <= TRIAL_PAIRS * plan.pair_tolerance * size
}

/// One of how many leaves is evaluated, so that their near fields are no more than a few times the pairs that they are
/// held against.
fn leaves_between<E: Expansion>(plan: &Plan<E>) -> usize {
    let shape = &plan.target_tree.shape;
    let near = |&t: &u32| {
        let runs = plan.lists.near.of(t as usize).iter();
        let sources: f64 = runs.map(|run| f64::from(run.last - run.first)).sum();
        sources * shape.nodes[t as usize].count() as f64
    };
    let pairs: f64 = shape.leaves.iter().map(near).sum();
    let most = TRIAL_WORK * (TRIAL_TARGETS * plan.sources.len()) as f64;
    (pairs / most).max(1.0) as usize
}

/// A charge of random numbers of either sign.
fn charge<E: Expansion>(kernel: &E::Kernel, random: &mut Random) -> ChargeOf<E> {
    let mut charge = <ChargeOf<E> as Numbers>::zero();
    let len = if ChargeOf::<E>::LEN > 0 { ChargeOf::<E>::LEN } else { kernel.charge_len() };
    for i in 0..len {
        charge.set_number(i, Real::from_f64(random.centred()));
    }
    charge
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Fmm, from_fn};
    use glam::DVec3;

    #[test]
    fn some_leaves_have_the_sums_of_an_application() {
        let step = DVec3::new(0.754_877, 0.569_840, 0.430_160);
        let points: Vec<DVec3> = (0..3000).map(|i| (step * f64::from(i)).fract()).collect();
        let charges: Vec<f64> = (0..3000).map(|i| f64::from(i).sin()).collect();
        let kernel = from_fn(|x: DVec3, y: DVec3| (-x.distance(y)).exp());
        let fmm = Fmm::builder(kernel).tolerance(1e-3).leaf_size(20).build(&points, &points);
        let plan = &fmm.expect("a smooth kernel").usual.plan;
        assert_eq!(leaves_between(plan), 1, "few pairs are near");

        let (mut all, mut some) = (Workspace::new(plan), Workspace::new(plan));
        plan.run_at_some(&charges, &mut all, 1, &Watch::default());
        plan.run_at_some(&charges, &mut some, 7, &Watch::default());
        let shape = &plan.target_tree.shape;
        for (number, &leaf) in shape.leaves.iter().enumerate() {
            let points = shape.nodes[leaf as usize].points();
            let is_visited = |u: &f64| if number % 7 == 0 { *u != 0.0 } else { *u == 0.0 };
            assert!(some.values[points.clone()].iter().all(is_visited), "leaf {number}");
            assert!(number % 7 != 0 || some.values[points.clone()] == all.values[points]);
        }
        let sums = plan.run(&charges, &mut Workspace::new(plan), &Watch::default());
        assert_eq!(plan.in_callers_order(&all), sums);
    }
}

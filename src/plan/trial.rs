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
use crate::plan::tuning::{TRIAL_PAIRS, TRIAL_TARGETS};
use crate::plan::{Plan, Workspace};

/// Whether sums with charges of either sign are as exact as those of pairs, at some of the targets. One application,
/// and O(N) pairs. An expansion that does not say how exact pairs have to be is taken at its word.
pub(crate) fn stands_trial<E: Expansion>(plan: &Plan<E>, watch: &Watch) -> bool {
    if plan.pair_tolerance == 0.0 {
        return true;
    }
    let kernel = plan.expansion.kernel();
    let order = &plan.source_tree.shape.order;
    let mut random = Random::new(1);
    let charges: Vec<ChargeOf<E>> =
        order.iter().map(|_| charge::<E>(kernel, &mut random)).collect();
    let sums = plan.run(&charges, &mut Workspace::new(plan), watch);

    let in_tree_order: Vec<ChargeOf<E>> =
        order.iter().map(|&i| charges[i as usize].clone()).collect();
    let step = plan.targets.len().div_ceil(TRIAL_TARGETS).max(1);
    let places: Vec<usize> = (0..plan.targets.len()).step_by(step).collect();
    let errors = parallel::map(places.len(), &|k| {
        let place = places[k];
        if watch.is_stopped() {
            return [0.0; 2];
        }
        let mut exact = [<ValueOf<E> as Numbers>::zero()];
        let target = &plan.targets[place..=place];
        kernel.add_block(target, &plan.sources, &in_tree_order, 0.0, &mut exact);
        let [exact] = exact;
        let mut error = sums[plan.target_tree.shape.order[place] as usize].clone();
        error.subtract(&exact);
        [error.norm(), exact.norm()]
    });
    let [error, size] = [0, 1].map(|part| l2_norm(errors.iter().map(|pair| pair[part])));
    // Few targets may hold most of all sums.
    let share = places.len() as f64 / sums.len().max(1) as f64;
    let size = size.max(share.sqrt() * l2_norm(sums.iter().map(Numbers::norm)));
    error <= TRIAL_PAIRS * plan.pair_tolerance * size
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

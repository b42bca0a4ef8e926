//! M2L, M2P and P2L through the kernel itself, between skeleton points: for offsets that no operator
//! was built for, and for kernels that are not translation invariant.

use num_traits::Float;

use crate::expansion::weights::weigh;
use crate::interpolation::black_box::Interpolation;
use crate::interpolation::entries::zero;
use crate::interpolation::prepared::Prepared;
use crate::kernel::traits::{Kernel, Outcome};
use crate::numbers::traits::{Located, Point, Real, Scalar};
use crate::octree::geometry::Cell;

impl<K: Kernel> Interpolation<K> {
    /// Charges at the source's skeleton, values at the target's, taken by `weight`.
    pub(super) fn m2l_by_kernel(
        &self,
        weight: f64,
        source: &Cell<K::Real>,
        target: &Cell<K::Real>,
        from: &[K::Entry],
        to: &mut [K::Entry],
    ) {
        let [from_basis, to_basis] =
            [self.source_basis(source.level()), self.target_basis(target.level())];
        let (ys, xs) = (&from_basis.skeleton.points, &to_basis.skeleton.points);
        let mut charges = from_basis.skeleton_charges(self.rule(), from);
        weigh(&self.weights(source.level()).densities, false, ys.len(), &mut charges);
        let [fields, densities, columns] = self.sizes();
        let mut values = vec![zero::<K::Entry>(); columns * fields * xs.len()];
        let (origin, centre) = self.seen(source, target.centre());
        let positions: Vec<_> = xs.iter().map(|&x| centre + x * target.half_width()).collect();
        let mut g = vec![zero::<K::Entry>(); xs.len() * fields * densities];
        for (b, &y) in ys.iter().enumerate() {
            self.kernel.entries_block(&positions, &[origin + y * source.half_width()], &mut g);
            for (a, g) in g.chunks_exact(fields * densities).enumerate() {
                for column in 0..columns {
                    for (k, &entry) in g.iter().enumerate() {
                        let (field, density) = (k / densities, k % densities);
                        values[(column * fields + field) * xs.len() + a] +=
                            entry * charges[(column * densities + density) * ys.len() + b];
                    }
                }
            }
        }
        if weight != 1.0 {
            let weight = K::Entry::from_real(K::Real::from_f64(weight));
            values.iter_mut().for_each(|value| *value *= weight);
        }
        weigh(&self.weights(target.level()).fields, false, xs.len(), &mut values);
        to_basis.add_skeleton_values(self.rule(), values, to);
    }

    /// Charges at the source's skeleton, summed at the targets.
    pub(super) fn m2p_by_kernel(
        &self,
        cell: &Cell<K::Real>,
        multipole: &[K::Entry],
        targets: &[K::Target],
        values: &mut [K::Value],
    ) -> Outcome {
        let basis = self.source_basis(cell.level());
        let ys = &basis.skeleton.points;
        let mut charges = basis.skeleton_charges(self.rule(), multipole);
        weigh(&self.weights(cell.level()).densities, false, ys.len(), &mut charges);
        let [fields, densities, columns] = self.sizes();
        let gradient = self.kernel.needs_gradients();
        let entries = fields * densities;
        let mut g = vec![zero::<K::Entry>(); ys.len() * entries];
        let mut positions = Vec::with_capacity(ys.len());
        let mut dg = vec![[zero::<K::Entry>(); 3]; if gradient { entries } else { 0 }];
        let mut received = vec![zero::<K::Entry>(); fields * columns];
        let mut slopes = vec![[zero::<K::Entry>(); 3]; if gradient { fields * columns } else { 0 }];
        for (i, (x, u)) in targets.iter().zip(values).enumerate() {
            let (centre, position) = self.seen(cell, Located::position(x));
            received.fill(zero());
            slopes.fill([zero(); 3]);
            positions.clear();
            positions.extend(ys.iter().map(|&y| centre + y * cell.half_width()));
            self.kernel.entries_block(&[position], &positions, &mut g);
            for (b, (&y, g)) in positions.iter().zip(g.chunks_exact(entries)).enumerate() {
                if gradient
                    && self.kernel.entry_gradients(position, y, &mut dg) == Outcome::Declined
                {
                    if i == 0 && b == 0 {
                        return Outcome::Declined;
                    }
                    // Values have been added already. What is no number is seen by the engine and named.
                    let unknown = K::Entry::from_real(<K::Real as Float>::nan());
                    dg.fill([unknown; 3]);
                }
                for (k, &entry) in g.iter().enumerate() {
                    let (field, density) = (k / densities, k % densities);
                    for column in 0..columns {
                        let charge = charges[(column * densities + density) * ys.len() + b];
                        received[field * columns + column] += entry * charge;
                        if gradient {
                            let sums = &mut slopes[field * columns + column];
                            for (sum, &slope) in sums.iter_mut().zip(&dg[k]) {
                                *sum += slope * charge;
                            }
                        }
                    }
                }
            }
            self.kernel.value(x, &received, &slopes, u);
        }
        Outcome::Done
    }

    /// Values of the sources' field at the target's skeleton.
    pub(super) fn p2l_by_kernel(
        &self,
        cell: &Cell<K::Real>,
        sources: &[K::Source],
        charges: &[K::Charge],
        local: &mut [K::Entry],
    ) {
        let basis = self.target_basis(cell.level());
        let xs = &basis.skeleton.points;
        let [fields, densities, columns] = self.sizes();
        let mut values = vec![zero::<K::Entry>(); columns * fields * xs.len()];
        let mut g = vec![zero::<K::Entry>(); xs.len() * fields * densities];
        let mut sent = vec![zero::<K::Entry>(); densities * columns];
        let mut positions = Vec::with_capacity(xs.len());
        for (y, q) in sources.iter().zip(charges) {
            self.kernel.density(y, q, &mut sent);
            let (centre, position) = self.seen(cell, Located::position(y));
            positions.clear();
            positions.extend(xs.iter().map(|&x| centre + x * cell.half_width()));
            self.kernel.entries_block(&positions, &[position], &mut g);
            for (a, g) in g.chunks_exact(fields * densities).enumerate() {
                for (k, &entry) in g.iter().enumerate() {
                    let (field, density) = (k / densities, k % densities);
                    for column in 0..columns {
                        values[(column * fields + field) * xs.len() + a] +=
                            entry * sent[density * columns + column];
                    }
                }
            }
        }
        weigh(&self.weights(cell.level()).fields, false, xs.len(), &mut values);
        basis.add_skeleton_values(self.rule(), values, local);
    }

    /// How many fields, densities and columns the kernel has.
    fn sizes(&self) -> [usize; 3] {
        [self.kernel.fields(), self.kernel.densities(), self.kernel.columns()]
    }

    /// Where the kernel sees the cell's centre and the point `p`. A translation-invariant kernel sees
    /// them from the centre, which keeps the digits that a far-away origin would cost.
    fn seen(&self, cell: &Cell<K::Real>, p: Point<K::Real>) -> (Point<K::Real>, Point<K::Real>) {
        match &*self.prepared {
            Prepared::Everywhere(_) => (cell.centre(), p),
            Prepared::Invariant(_) => (Point::<K::Real>::default(), cell.relative(p)),
        }
    }
}

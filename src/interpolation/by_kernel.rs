//! M2L, M2P and P2L through the kernel itself, between skeleton points: for offsets that no operator
//! was built for, and for kernels that are not translation invariant.

use crate::interpolation::black_box::Interpolation;
use crate::interpolation::prepared::Prepared;
use crate::interpolation::probe::zero;
use crate::kernel::{Outcome, PointKernel};
use crate::numbers::real::{Additive, Columns, Located, Point, Real, Scalar};
use crate::octree::geometry::Cell;

impl<K: PointKernel> Interpolation<K> {
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
        let charges = from_basis.skeleton_charges(self.rule(), from);
        let mut values = vec![zero::<K::Entry>(); K::Column::WIDTH * K::FIELDS * xs.len()];
        let mut g = vec![zero::<K::Entry>(); K::FIELDS * K::DENSITIES];
        let (origin, centre) = self.seen(source, target.centre());
        for (b, &y) in ys.iter().enumerate() {
            let y = origin + y * source.half_width();
            for (a, &x) in xs.iter().enumerate() {
                self.kernel.entries(centre + x * target.half_width(), y, &mut g);
                for column in 0..K::Column::WIDTH {
                    for (k, &entry) in g.iter().enumerate() {
                        let (field, density) = (k / K::DENSITIES, k % K::DENSITIES);
                        values[(column * K::FIELDS + field) * xs.len() + a] +=
                            entry * charges[(column * K::DENSITIES + density) * ys.len() + b];
                    }
                }
            }
        }
        if weight != 1.0 {
            let weight = K::Entry::from_real(K::Real::from_f64(weight));
            values.iter_mut().for_each(|value| *value *= weight);
        }
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
        let charges = basis.skeleton_charges(self.rule(), multipole);
        let entries = K::FIELDS * K::DENSITIES;
        let mut g = vec![zero::<K::Entry>(); entries];
        let mut dg = vec![[zero::<K::Entry>(); 3]; if K::GRADIENT { entries } else { 0 }];
        let mut fields = vec![K::Column::zero(); K::FIELDS];
        let mut gradients = vec![[K::Column::zero(); 3]; if K::GRADIENT { K::FIELDS } else { 0 }];
        for (x, u) in targets.iter().zip(values) {
            let (centre, position) = self.seen(cell, Located::position(x));
            fields.fill(K::Column::zero());
            gradients.fill([K::Column::zero(); 3]);
            for (b, &y) in ys.iter().enumerate() {
                let y = centre + y * cell.half_width();
                self.kernel.entries(position, y, &mut g);
                if K::GRADIENT
                    && self.kernel.entry_gradients(position, y, &mut dg) == Outcome::Declined
                {
                    return Outcome::Declined;
                }
                for k in 0..entries {
                    let (field, density) = (k / K::DENSITIES, k % K::DENSITIES);
                    for column in 0..K::Column::WIDTH {
                        let charge = charges[(column * K::DENSITIES + density) * ys.len() + b];
                        add(&mut fields[field], column, g[k] * charge);
                        if K::GRADIENT {
                            for (gradient, &slope) in gradients[field].iter_mut().zip(&dg[k]) {
                                add(gradient, column, slope * charge);
                            }
                        }
                    }
                }
            }
            self.kernel.value(x, &fields, &gradients, u);
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
        let mut values = vec![zero::<K::Entry>(); K::Column::WIDTH * K::FIELDS * xs.len()];
        let mut g = vec![zero::<K::Entry>(); K::FIELDS * K::DENSITIES];
        let mut densities = vec![K::Column::zero(); K::DENSITIES];
        for (y, q) in sources.iter().zip(charges) {
            self.kernel.density(y, q, &mut densities);
            let (centre, position) = self.seen(cell, Located::position(y));
            for (a, &x) in xs.iter().enumerate() {
                self.kernel.entries(centre + x * cell.half_width(), position, &mut g);
                for (k, &entry) in g.iter().enumerate() {
                    let (field, density) = (k / K::DENSITIES, &densities[k % K::DENSITIES]);
                    for column in 0..K::Column::WIDTH {
                        values[(column * K::FIELDS + field) * xs.len() + a] +=
                            entry * density.column(column);
                    }
                }
            }
        }
        basis.add_skeleton_values(self.rule(), values, local);
    }

    /// Where the kernel sees the cell's centre and the point `p`. A translation-invariant kernel sees
    /// them from the centre, which keeps the digits that a far-away origin would cost.
    fn seen(&self, cell: &Cell<K::Real>, p: Point<K::Real>) -> (Point<K::Real>, Point<K::Real>) {
        match &self.prepared {
            Prepared::Everywhere(_) => (cell.centre(), p),
            Prepared::Invariant(_) => (Point::<K::Real>::default(), cell.relative(p)),
        }
    }
}

#[inline(always)]
fn add<S: Scalar, C: Columns<S>>(to: &mut C, column: usize, number: S) {
    to.set_column(column, to.column(column) + number);
}

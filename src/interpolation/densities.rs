//! P2M and L2P: from a cell's charges to densities and moments, and from fields to values.

use crate::interpolation::black_box::Interpolation;
use crate::interpolation::lanes::row;
use crate::interpolation::points::{self, Fields, Moments};
use crate::interpolation::scratch::Scratch;
use crate::kernel::PointKernel;
use crate::numbers::real::{Additive, Columns, Real, Scalar};
use crate::octree::geometry::Cell;

impl<K: PointKernel> Interpolation<K> {
    /// P2M.
    pub(super) fn add_moments(
        &self,
        cell: &Cell<K::Real>,
        sources: &[K::Source],
        charges: &[K::Charge],
        multipole: &mut [K::Entry],
    ) {
        let n = self.rule().len();
        let basis = self.source_basis(cell.level());
        self.scratch.with(
            || Scratch::new(n),
            |scratch| {
                scratch.set_points(cell, sources);
                let Scratch { powers, points, numbers, arrays, columns, sums, .. } = scratch;
                let count = K::Column::WIDTH * Self::PARTS * K::DENSITIES;
                reset(numbers, count * sources.len());
                for (j, (y, q)) in sources.iter().zip(charges).enumerate() {
                    self.kernel.density(y, q, &mut columns[..K::DENSITIES]);
                    for array in 0..count {
                        let [column, part, component] = indices::<K>(array, K::DENSITIES);
                        let number = columns[component].column(column).parts()[part];
                        numbers[array * sources.len() + j] = number;
                    }
                }
                reset(arrays, count * n * row(n));
                Moments { basis, powers, points, numbers, arrays, sums, multipole }.add();
            },
        );
    }

    /// L2P.
    pub(super) fn add_values(
        &self,
        cell: &Cell<K::Real>,
        local: &[K::Entry],
        targets: &[K::Target],
        values: &mut [K::Value],
    ) {
        let n = self.rule().len();
        let basis = self.target_basis(cell.level());
        self.scratch.with(
            || Scratch::new(n),
            |scratch| {
                scratch.set_points(cell, targets);
                let Scratch { powers, points, numbers, arrays, columns, gradients, .. } = scratch;
                let count = K::Column::WIDTH * Self::PARTS * K::FIELDS;
                let derivatives = if K::GRADIENT { 4 } else { 1 };
                reset(arrays, count * n * row(n));
                reset(numbers, count * derivatives * targets.len());
                let gradient = K::GRADIENT;
                Fields { basis, powers, points, numbers, arrays, local, gradient }.add();
                let per_length = K::Real::from_f64(1.0) / cell.half_width();
                for (i, (x, u)) in targets.iter().zip(values).enumerate() {
                    let number = |array: usize, derivative: usize| {
                        numbers[(array * derivatives + derivative) * targets.len() + i]
                    };
                    for component in 0..K::FIELDS {
                        for column in 0..K::Column::WIDTH {
                            let at = |derivative| {
                                let array = column * Self::PARTS * K::FIELDS + component;
                                let im = array + (Self::PARTS - 1) * K::FIELDS;
                                K::Entry::from_parts(
                                    number(array, derivative),
                                    number(im, derivative),
                                )
                            };
                            columns[component].set_column(column, at(0));
                            if K::GRADIENT {
                                for (axis, gradient) in gradients[component].iter_mut().enumerate()
                                {
                                    let slope = at(1 + axis) * K::Entry::from_real(per_length);
                                    gradient.set_column(column, slope);
                                }
                            }
                        }
                    }
                    self.kernel.value(x, &columns[..K::FIELDS], gradients, u);
                }
            },
        );
    }

    /// How many real arrays one right-hand side of one component takes.
    const PARTS: usize = points::parts::<K::Entry>();
}

/// Zeros, `len` of them.
fn reset<V: Additive>(numbers: &mut Vec<V>, len: usize) {
    numbers.clear();
    numbers.resize(len, V::zero());
}

/// Column, part and component of an array.
#[inline(always)]
fn indices<K: PointKernel>(array: usize, components: usize) -> [usize; 3] {
    let parts = Interpolation::<K>::PARTS;
    [array / components / parts, array / components % parts, array % components]
}

//! P2M and L2P: from a cell's charges to densities and moments, and from fields to values.

use crate::expansion::weights::weigh;
use crate::interpolation::black_box::Interpolation;
use crate::interpolation::lanes::row;
use crate::interpolation::points::{Fields, Moments};
use crate::interpolation::scratch::Scratch;
use crate::kernel::traits::Kernel;
use crate::numbers::traits::{Numbers, Real, Scalar};
use crate::octree::geometry::Cell;

impl<K: Kernel> Interpolation<K> {
    /// P2M.
    pub(super) fn add_moments(
        &self,
        cell: &Cell<K::Real>,
        sources: &[K::Source],
        charges: &[K::Charge],
        multipole: &mut [K::Entry],
    ) {
        let n = self.rule().len();
        let (basis, weights) = (self.source_basis(cell.level()), self.weights(cell.level()));
        let (components, columns) = (self.kernel.densities(), self.kernel.columns());
        self.scratch.with(
            || Scratch::new(n, &self.kernel),
            |scratch| {
                scratch.set_points(cell, sources);
                let Scratch { powers, points, numbers, arrays, entries, sums, .. } = scratch;
                let count = columns * K::Entry::PARTS * components;
                reset(numbers, count * sources.len());
                let densities = &mut entries[..components * columns];
                for (j, (y, q)) in sources.iter().zip(charges).enumerate() {
                    self.kernel.density(y, q, densities);
                    weigh(&weights.densities, true, columns, densities);
                    for component in 0..components {
                        for column in 0..columns {
                            let parts = densities[component * columns + column].parts();
                            for (part, &number) in parts[..K::Entry::PARTS].iter().enumerate() {
                                let array = (column * K::Entry::PARTS + part) * components;
                                numbers[(array + component) * sources.len() + j] = number;
                            }
                        }
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
        let (basis, weights) = (self.target_basis(cell.level()), self.weights(cell.level()));
        let (components, columns) = (self.kernel.fields(), self.kernel.columns());
        let gradient = self.kernel.needs_gradients();
        self.scratch.with(
            || Scratch::new(n, &self.kernel),
            |scratch| {
                scratch.set_points(cell, targets);
                let Scratch { powers, points, numbers, arrays, entries, gradients, .. } = scratch;
                let count = columns * K::Entry::PARTS * components;
                let derivatives = if gradient { 4 } else { 1 };
                reset(arrays, count * n * row(n));
                reset(numbers, count * derivatives * targets.len());
                Fields { basis, powers, points, numbers, arrays, local, gradient }.add();
                let per_length = K::Real::from_f64(1.0) / cell.half_width();
                let fields = &mut entries[..components * columns];
                for (i, (x, u)) in targets.iter().zip(values).enumerate() {
                    let number = |array: usize, derivative: usize| {
                        numbers[(array * derivatives + derivative) * targets.len() + i]
                    };
                    for component in 0..components {
                        for column in 0..columns {
                            let re = column * K::Entry::PARTS * components + component;
                            let im = re + (K::Entry::PARTS - 1) * components;
                            let at = |derivative| {
                                K::Entry::from_parts(number(re, derivative), number(im, derivative))
                            };
                            fields[component * columns + column] = at(0);
                            if gradient {
                                let slope = &mut gradients[component * columns + column];
                                for (axis, part) in slope.iter_mut().enumerate() {
                                    *part = at(1 + axis) * K::Entry::from_real(per_length);
                                }
                            }
                        }
                    }
                    weigh(&weights.fields, true, columns, fields);
                    let slopes = gradients.as_flattened_mut();
                    weigh(&weights.fields, true, 3 * columns, slopes);
                    self.kernel.value(x, fields, gradients, u);
                }
            },
        );
    }
}

/// Zeros, `len` of them.
fn reset<V: Numbers>(numbers: &mut Vec<V>, len: usize) {
    numbers.clear();
    numbers.resize(len, V::zero());
}

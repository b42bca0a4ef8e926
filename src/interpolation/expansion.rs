//! The operators of interpolation, as the engine calls them.

use std::any::type_name;

use num_traits::Float;

use crate::error::Error;
use crate::expansion::Expansion;
use crate::expansion::costs::Costs;
use crate::expansion::geometry::Geometry;
use crate::expansion::level_cells::{LevelFamilies, LevelPairs};
use crate::interpolation::accuracy::Accuracy;
use crate::interpolation::black_box::Interpolation;
use crate::interpolation::budget::PAIR_SHARE;
use crate::interpolation::cache::KernelName;
use crate::interpolation::cost;
use crate::interpolation::entries::{Entries, zero};
use crate::interpolation::prepared::Prepared;
use crate::interpolation::tuning::ENTRY_PAIRS;
use crate::interpolation::work::Work;
use crate::kernel::traits::{Kernel, Outcome};
use crate::numbers::traits::{Point, Real, Scalar, Vector};
use crate::octree::geometry::Cell;
use crate::parallel::pool::Pool;

impl<K: Kernel> Expansion for Interpolation<K> {
    type Kernel = K;
    type MultipoleTerm = K::Entry;
    type LocalTerm = K::Entry;

    fn kernel(&self) -> &K {
        &self.kernel
    }

    fn multipole_len(&self, level: usize) -> usize {
        self.source_basis(level).rank() * self.kernel.columns()
    }

    fn local_len(&self, level: usize) -> usize {
        self.target_basis(level).rank() * self.kernel.columns()
    }

    fn prepare(&mut self, geometry: &Geometry<K::Real>) -> Result<(), Error> {
        self.accuracy.check()?;
        let kernel = &self.kernel;
        let block = |xs: &[Point<K::Real>], ys: &[Point<K::Real>], g: &mut [K::Entry]| {
            kernel.entries_block(xs, ys, g);
        };
        let work = Work::new(geometry.most_seconds, geometry.pair_seconds);
        let entries =
            Entries::new(kernel.fields(), kernel.densities(), &block).at_expense_of(&work);
        let block = |xs: &[Point<K::Real>], ys: &[Point<K::Real>], g: &mut [K::Entry]| {
            write_slopes(kernel, xs, ys, g);
        };
        let slopes =
            Entries::new(3 * kernel.fields(), kernel.densities(), &block).at_expense_of(&work);
        // A given order is taken as it is.
        let measured = matches!(self.accuracy, Accuracy::Tolerance(_));
        let slopes = (measured && kernel.needs_gradients()).then_some(&slopes);
        let name = KernelName {
            name: type_name::<K>(),
            code: K::entries as *const () as usize,
            has_parameters: kernel.has_parameters(),
        };
        self.prepared = Prepared::new(name, &entries, slopes, self.accuracy, geometry)?;
        self.scratch = Pool::default();
        Ok(())
    }

    fn costs(&self, level: usize) -> Costs {
        let kernel = &self.kernel;
        let (components, columns) = (kernel.fields().max(kernel.densities()), kernel.columns());
        Costs {
            pair_tolerance: match self.accuracy {
                Accuracy::Tolerance(tolerance) => PAIR_SHARE * tolerance,
                Accuracy::Order(_) => 0.0,
            },
            leaf_seconds: Some(cost::leaf_seconds::<K::Entry>(self.accuracy, components, columns)),
            terms: cost::rank(self.accuracy, components) as usize * columns,
            m2p_pairs: ENTRY_PAIRS * self.source_basis(level).skeleton.points.len(),
            p2l_pairs: ENTRY_PAIRS * self.target_basis(level).skeleton.points.len(),
            weighs: true,
        }
    }

    fn p2m(
        &self,
        cell: &Cell<K::Real>,
        sources: &[K::Source],
        charges: &[K::Charge],
        multipole: &mut [K::Entry],
    ) {
        self.add_moments(cell, sources, charges, multipole);
    }

    fn m2m(
        &self,
        child: &Cell<K::Real>,
        _parent: &Cell<K::Real>,
        from: &[K::Entry],
        to: &mut [K::Entry],
    ) {
        self.shift(child, false, from, to);
    }

    fn m2m_level(
        &self,
        families: &LevelFamilies<'_, K::Real>,
        from: &[K::Entry],
        to: &mut [K::Entry],
    ) {
        self.shift_up(families, from, to);
    }

    fn l2l_level(
        &self,
        families: &LevelFamilies<'_, K::Real>,
        from: &[K::Entry],
        to: &mut [K::Entry],
    ) {
        self.shift_down(families, from, to);
    }

    fn m2l(
        &self,
        source: &Cell<K::Real>,
        target: &Cell<K::Real>,
        from: &[K::Entry],
        to: &mut [K::Entry],
    ) {
        if let Prepared::Invariant(invariant) = &self.prepared {
            let (transfers, scale) = invariant.transfers(source.level(), source.half_width());
            if transfers.add(source.offset_to(target), scale, from, to) {
                return;
            }
        }
        self.m2l_by_kernel(1.0, source, target, from, to);
    }

    fn m2l_level(
        &self,
        level: &LevelPairs<'_, K::Real>,
        multipoles: &[K::Entry],
        locals: &mut [K::Entry],
    ) {
        let from = self.multipole_len(level.level);
        let by_kernel = |s: usize, t: usize, local: &mut [K::Entry]| {
            let multipole = &multipoles[s * from..][..from];
            let [source, target] = [&level.sources[s], &level.targets[t]];
            self.m2l_by_kernel(level.weight, source, target, multipole, local);
        };
        let Some(half_width) = level.targets.first().map(Cell::half_width) else { return };
        match &self.prepared {
            Prepared::Everywhere(_) => level.for_each_pair(locals, by_kernel),
            Prepared::Invariant(invariant) => {
                let (transfers, scale) = invariant.transfers(level.level, half_width);
                let columns = self.kernel.columns();
                let scale = scale * K::Real::from_f64(level.weight);
                transfers.add_level(level, scale, columns, multipoles, locals, &by_kernel);
            }
        }
    }

    fn l2l(
        &self,
        _parent: &Cell<K::Real>,
        child: &Cell<K::Real>,
        from: &[K::Entry],
        to: &mut [K::Entry],
    ) {
        self.shift(child, true, from, to);
    }

    fn l2p(
        &self,
        cell: &Cell<K::Real>,
        local: &[K::Entry],
        targets: &[K::Target],
        values: &mut [K::Value],
    ) {
        self.add_values(cell, local, targets, values);
    }

    fn m2p(
        &self,
        cell: &Cell<K::Real>,
        multipole: &[K::Entry],
        targets: &[K::Target],
        values: &mut [K::Value],
    ) -> Outcome {
        self.m2p_by_kernel(cell, multipole, targets, values)
    }

    fn p2l(
        &self,
        cell: &Cell<K::Real>,
        sources: &[K::Source],
        charges: &[K::Charge],
        local: &mut [K::Entry],
    ) -> Outcome {
        self.p2l_by_kernel(cell, sources, charges, local);
        Outcome::Done
    }
}

/// Writes ∂G/∂x for all pairs of a block: as the entries, with three rows for each field. What a kernel
/// declines to say is taken from differences.
fn write_slopes<K: Kernel>(
    kernel: &K,
    xs: &[Point<K::Real>],
    ys: &[Point<K::Real>],
    g: &mut [K::Entry],
) {
    let (fields, densities) = (kernel.fields(), kernel.densities());
    let mut slopes = vec![[zero::<K::Entry>(); 3]; fields * densities];
    let pairs = xs.iter().flat_map(|x| ys.iter().map(move |y| (*x, *y)));
    for ((x, y), g) in pairs.zip(g.chunks_exact_mut(3 * fields * densities)) {
        if kernel.entry_gradients(x, y, &mut slopes) == Outcome::Declined {
            differences(kernel, x, y, &mut slopes);
        }
        for (k, slope) in slopes.iter().enumerate() {
            let (field, density) = (k / densities, k % densities);
            for (axis, &part) in slope.iter().enumerate() {
                g[(3 * field + axis) * densities + density] = part;
            }
        }
    }
}

/// Derivatives to about ε^⅔, by central differences.
fn differences<K: Kernel>(
    kernel: &K,
    x: Point<K::Real>,
    y: Point<K::Real>,
    slopes: &mut [[K::Entry; 3]],
) {
    let [dx, dy, dz] = (x - y).to_array();
    let step = (dx * dx + dy * dy + dz * dz).sqrt() * K::Real::epsilon().cbrt();
    let mut sides = vec![zero::<K::Entry>(); 2 * slopes.len()];
    for axis in 0..3 {
        let mut along = [K::Real::from_f64(0.0); 3];
        along[axis] = step;
        let along = Point::<K::Real>::from_array(along);
        let (before, after) = sides.split_at_mut(slopes.len());
        kernel.entries(x - along, y, before);
        kernel.entries(x + along, y, after);
        let per_length = K::Entry::from_real((step + step).recip());
        for (slope, (&a, &b)) in slopes.iter_mut().zip(before.iter().zip(&*after)) {
            slope[axis] = (b - a) * per_length;
        }
    }
}

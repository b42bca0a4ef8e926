//! The operators of interpolation, as the engine calls them.

use std::sync::Arc;

use crate::error::Error;
use crate::expansion::Expansion;
use crate::expansion::costs::Costs;
use crate::expansion::geometry::Geometry;
use crate::expansion::level_cells::{LevelFamilies, LevelPairs};
use crate::expansion::weights::Weights;
use crate::interpolation::accuracy::Accuracy;
use crate::interpolation::balance;
use crate::interpolation::black_box::Interpolation;
use crate::interpolation::budget::PAIR_SHARE;
use crate::interpolation::cost;
use crate::interpolation::entries::Entries;
use crate::interpolation::known::Identity;
use crate::interpolation::prepared::Prepared;
use crate::interpolation::tuning::ENTRY_PAIRS;
use crate::interpolation::work::Work;
use crate::kernel::mask::Coverage;
use crate::kernel::slopes::write_slopes;
use crate::kernel::traits::{Kernel, Outcome};
use crate::numbers::traits::{Point, Real};
use crate::octree::geometry::{Cell, Cube};
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

    fn weigh(&mut self, root: &Cube<K::Real>) -> Weights {
        let kernel = &*self.kernel;
        let block = |xs: &[Point<K::Real>], ys: &[Point<K::Real>], g: &mut [K::Entry]| {
            kernel.entries_block(xs, ys, g);
        };
        let entries = Entries::new(kernel.fields(), kernel.densities(), &block);
        let weights = balance::weights(&entries, root);
        if weights != self.weights {
            // Operators of what was weighted otherwise are those of another kernel.
            self.former = None;
        }
        self.weights = weights;
        self.weights.clone()
    }

    fn prepare(&mut self, geometry: &Geometry<K::Real>) -> Result<(), Error> {
        self.accuracy.check()?;
        let kernel = &*self.kernel;
        let block = |xs: &[Point<K::Real>], ys: &[Point<K::Real>], g: &mut [K::Entry]| {
            kernel.entries_block(xs, ys, g);
        };
        let work = Work::new(geometry, self.spent);
        let entries =
            Entries::new(kernel.fields(), kernel.densities(), &block).at_expense_of(&work);
        let entries = entries.weighted_by(&self.weights);
        let block = |xs: &[Point<K::Real>], ys: &[Point<K::Real>], g: &mut [K::Entry]| {
            write_slopes(kernel, xs, ys, g);
        };
        let slopes =
            Entries::new(3 * kernel.fields(), kernel.densities(), &block).at_expense_of(&work);
        let slopes = slopes.weighted_by(&self.weights);
        // A given order is taken as it is.
        let measured = matches!(self.accuracy, Accuracy::Tolerance(_));
        let slopes = (measured && kernel.needs_gradients()).then_some(&slopes);
        let identity = match kernel.identity() {
            Some(identity) => Identity::Stated(identity),
            None if kernel.has_parameters() => Identity::Values,
            None => Identity::Code(K::entries as *const () as usize),
        };
        let stored = (&self.store, identity);
        let former = self.former.as_deref();
        let prepared = Prepared::new(stored, &entries, slopes, self.accuracy, geometry, former);
        self.spent = work.seconds();
        let (prepared, admissibility) = prepared?;
        (self.prepared, self.admissibility) = (Arc::new(prepared), admissibility);
        self.scratch = Pool::default();
        Ok(())
    }

    fn admits(&self, level: usize, offset: [i32; 3]) -> Coverage {
        self.admissibility.of(level, offset)
    }

    fn again(&self) -> Option<Self> {
        // A given order is the same for all charges.
        let by_tolerance = matches!(self.accuracy, Accuracy::Tolerance(_));
        by_tolerance.then(|| Self {
            weights: self.weights.clone(),
            ..Self::of(Arc::clone(&self.kernel), self.accuracy, self.store.clone())
        })
    }

    fn pair_sizes(&self, level: usize) -> [f64; 2] {
        match &*self.prepared {
            Prepared::Everywhere(own) => own.pair_sizes.get(level).copied().unwrap_or_default(),
            Prepared::Invariant(invariant) => invariant.pair_sizes(level),
        }
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
        if let Prepared::Invariant(invariant) = &*self.prepared {
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
        match &*self.prepared {
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

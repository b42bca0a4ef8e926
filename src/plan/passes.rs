//! The passes of one application: up the source tree, across, down the target tree, out.
//!
//! Each cell's terms and each target's sum are written by one task, in one fixed order: the result
//! does not depend on the number of threads.

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use crate::expansion::level_cells::{LevelFamilies, LevelPairs};
use crate::expansion::{ChargeOf, Expansion, TargetOf, ValueOf};
use crate::kernel::direct::add_all;
use crate::kernel::traits::{Kernel, Outcome};
use crate::numbers::traits::Numbers;
use crate::parallel;
use crate::parallel::watch::{Phase, Watch};
use crate::plan::layout::for_each_leaf;
use crate::plan::near::{Gathered, Near};
use crate::plan::times::{ApplyTimes, Clock};
use crate::plan::tuning::PIECE;
use crate::plan::upward::Upward;
use crate::plan::{Plan, Scheme, Workspace};

/// What is added up at the targets in one sweep over their leaves.
#[derive(Clone, Copy)]
struct Sweep {
    local: bool,
    multipole: bool,
    near: bool,
    /// One of so many leaves is visited.
    every: usize,
}

impl Sweep {
    const NONE: Self = Self { local: false, multipole: false, near: false, every: 1 };
    const LOCAL: Self = Self { local: true, ..Self::NONE };
    const MULTIPOLE: Self = Self { multipole: true, ..Self::NONE };
    const NEAR: Self = Self { near: true, ..Self::NONE };
    const FAR: Self = Self { local: true, multipole: true, ..Self::NONE };
    const ALL: Self = Self { near: true, ..Self::FAR };
}

impl<E: Expansion> Plan<E> {
    /// The sums for `charges`, in the caller's order. Once `watch` is stopped, they are not to be used.
    pub(crate) fn run(
        &self,
        charges: &[ChargeOf<E>],
        workspace: &mut Workspace<E>,
        watch: &Watch,
    ) -> Vec<ValueOf<E>> {
        let mut values = vec![Numbers::zero(); self.targets.len()];
        self.run_into(charges, workspace, &mut values, watch);
        values
    }

    /// The same, written to `values`, one for each target.
    pub(crate) fn run_into(
        &self,
        charges: &[ChargeOf<E>],
        workspace: &mut Workspace<E>,
        values: &mut [ValueOf<E>],
        watch: &Watch,
    ) {
        let mut unread = ApplyTimes::default();
        self.carry(charges, workspace, &mut Clock::start(), &mut unread, watch);
        self.evaluate(workspace, Sweep::ALL, watch);
        self.write_in_callers_order(workspace, values);
    }

    /// The same sums, to the bit, with the seconds that each operator took.
    pub(crate) fn run_timed(
        &self,
        charges: &[ChargeOf<E>],
        workspace: &mut Workspace<E>,
    ) -> (Vec<ValueOf<E>>, ApplyTimes) {
        let (mut clock, mut times) = (Clock::start(), ApplyTimes::default());
        let watch = &Watch::default();
        self.carry(charges, workspace, &mut clock, &mut times, watch);
        self.evaluate(workspace, Sweep::LOCAL, watch);
        clock.lap(&mut times.l2p);
        self.evaluate(workspace, Sweep::MULTIPOLE, watch);
        clock.lap(&mut times.m2p);
        self.evaluate(workspace, Sweep::NEAR, watch);
        clock.lap(&mut times.near);
        let values = self.in_callers_order(workspace);
        clock.lap(&mut times.permutation);
        (values, times)
    }

    /// The same sums, to the bit, left in the workspace in tree order; also, in the same order, what
    /// was there before the near field was added.
    pub(crate) fn run_parted(
        &self,
        charges: &[ChargeOf<E>],
        workspace: &mut Workspace<E>,
        watch: &Watch,
    ) -> Vec<ValueOf<E>> {
        self.carry(charges, workspace, &mut Clock::start(), &mut ApplyTimes::default(), watch);
        self.evaluate(workspace, Sweep::FAR, watch);
        let far = workspace.values.clone();
        self.evaluate(workspace, Sweep::NEAR, watch);
        far
    }

    /// The same sums, to the bit, at the targets of one of `every` so many leaves, the first one among them; left in the
    /// workspace in tree order.
    pub(crate) fn run_at_some(
        &self,
        charges: &[ChargeOf<E>],
        workspace: &mut Workspace<E>,
        every: usize,
        watch: &Watch,
    ) {
        self.carry(charges, workspace, &mut Clock::start(), &mut ApplyTimes::default(), watch);
        self.evaluate(workspace, Sweep { every, ..Sweep::ALL }, watch);
    }

    /// The sums in tree order, left in the workspace, for the charges and the multipole terms that stand there.
    pub(crate) fn run_given(&self, workspace: &mut Workspace<E>, watch: &Watch) {
        self.translate(workspace, &mut Clock::start(), &mut ApplyTimes::default(), watch);
        self.evaluate(workspace, Sweep::ALL, watch);
    }

    /// The sums in the caller's order.
    pub(crate) fn in_callers_order(&self, workspace: &Workspace<E>) -> Vec<ValueOf<E>> {
        let mut values = vec![Numbers::zero(); self.targets.len()];
        self.write_in_callers_order(workspace, &mut values);
        values
    }

    fn write_in_callers_order(&self, workspace: &Workspace<E>, values: &mut [ValueOf<E>]) {
        let ranks = &self.layout.target_ranks;
        parallel::for_each_piece(values, PIECE, &|piece, values| {
            let places = values.iter_mut().zip(&ranks[PIECE * piece..]);
            places.for_each(|(u, &rank)| u.clone_from(&workspace.values[rank as usize]));
        });
    }

    /// Everything before the values: from charges to multipole and local terms.
    fn carry(
        &self,
        charges: &[ChargeOf<E>],
        workspace: &mut Workspace<E>,
        clock: &mut Clock,
        times: &mut ApplyTimes,
        watch: &Watch,
    ) {
        watch.begin(Phase::Terms, self.source_tree.cells.len() + self.target_tree.cells.len());
        let order = &self.source_tree.shape.order;
        parallel::for_each_piece(&mut workspace.charges, PIECE, &|piece, qs| {
            let places = qs.iter_mut().zip(&order[PIECE * piece..]);
            places.for_each(|(q, &i)| q.clone_from(&charges[i as usize]));
        });
        clock.lap(&mut times.permutation);
        let Workspace { charges, multipoles, .. } = workspace;
        let upward = Upward {
            expansion: &self.expansion,
            tree: &self.source_tree,
            formed: &self.layout.multipole,
            shifts_moments: self.scheme.shifts_moments(),
            watch,
        };
        upward.p2m(&self.sources, charges, multipoles);
        clock.lap(&mut times.p2m);
        if upward.shifts_moments {
            upward.m2m(multipoles);
            clock.lap(&mut times.m2m);
        }
        self.translate(workspace, clock, times, watch);
    }

    /// From multipole to local terms.
    fn translate(
        &self,
        workspace: &mut Workspace<E>,
        clock: &mut Clock,
        times: &mut ApplyTimes,
        watch: &Watch,
    ) {
        if self.scheme == Scheme::Fmm {
            for level in 0..self.target_tree.shape.levels() {
                self.m2l(level, workspace, watch);
                clock.lap(&mut times.m2l);
                self.l2l(level, workspace, watch);
                clock.lap(&mut times.l2l);
                if watch.advance(self.target_tree.shape.level(level).len()) {
                    return;
                }
            }
        }
    }

    /// M2L within one level.
    fn m2l(&self, level: usize, workspace: &mut Workspace<E>, watch: &Watch) {
        let Workspace { multipoles, locals, largest_elsewhere, .. } = workspace;
        let (sources, targets) = (&self.source_tree, &self.target_tree);
        let locals = &mut locals[level];
        if locals.is_empty() {
            return;
        }
        parallel::for_each_piece(locals, PIECE, &|_, terms| terms.fill(Numbers::zero()));
        let cells = targets.shape.level(level);
        for (weight, list) in self.lists.weighed_m2l() {
            let starts = &list.starts[cells.start..=cells.end];
            if starts[0] != starts[cells.len()] {
                let source_cells = sources.shape.level(level);
                let pairs = LevelPairs {
                    level,
                    weight,
                    sources: &sources.cells[source_cells.clone()],
                    targets: &targets.cells[cells.clone()],
                    starts,
                    list: &list.items,
                    first_source: source_cells.start,
                    largest_elsewhere: largest_elsewhere.get(level).copied().unwrap_or(0.0),
                    watch,
                };
                self.expansion.m2l_level(&pairs, &multipoles[level], locals);
            }
        }
    }

    /// L2L and P2L into one level.
    fn l2l(&self, level: usize, workspace: &mut Workspace<E>, watch: &Watch) {
        let Workspace { charges, locals, p2l_declined, .. } = workspace;
        let (sources, targets) = (&self.source_tree, &self.target_tree);
        let (above, tail) = locals.split_at_mut(level);
        if let Some(above) = above.last() {
            let families = LevelFamilies::new(targets, level - 1, &self.layout.local, watch);
            self.expansion.l2l_level(&families, above, &mut tail[0]);
        }
        let p2l = &self.lists.p2l;
        let first = targets.shape.level(level).start;
        let len = self.expansion.local_len(level);
        parallel::for_each_piece(&mut tail[0], len, &|i, local| {
            let t = first + i;
            if watch.is_stopped() {
                return;
            }
            for (k, &s) in p2l.of(t).iter().enumerate() {
                let points = sources.shape.nodes[s as usize].points();
                let (ys, qs) = (&self.sources[points.clone()], &charges[points]);
                let declined =
                    self.expansion.p2l(&targets.cells[t], ys, qs, local) == Outcome::Declined;
                p2l_declined[p2l.starts[t] + k].store(declined, Relaxed);
            }
        });
    }

    /// Adds up what one sweep brings to the values at every target leaf.
    fn evaluate(&self, workspace: &mut Workspace<E>, sweep: Sweep, watch: &Watch) {
        let Workspace { charges, values, multipoles, locals, p2l_declined, gathered, .. } =
            workspace;
        let near = Near {
            kernel: self.expansion.kernel(),
            tolerance: self.pair_tolerance,
            sources: &self.sources,
            charges,
            bits: &self.lists.bits,
            watch,
        };
        if self.scheme == Scheme::Direct && self.layout.is_direct && sweep.near {
            if sweep.local {
                parallel::for_each_piece(values, PIECE, &|_, us| us.fill(Numbers::zero()));
            }
            let Near { kernel, tolerance, .. } = near;
            let sources = (&self.sources[..], &charges[..]);
            return add_all(kernel, sources, &self.targets, tolerance, values, watch);
        }
        watch.begin(Phase::Values, self.target_tree.shape.leaves.len());
        let at_leaf = |leaf: usize, us: &mut [ValueOf<E>]| {
            let tree = &self.target_tree;
            if !leaf.is_multiple_of(sweep.every) {
                return;
            }
            let t = tree.shape.leaves[leaf] as usize;
            let xs = &self.targets[tree.shape.nodes[t].points()];
            if watch.advance(1) {
                return;
            }
            if sweep.local {
                us.fill(Numbers::zero());
            }
            if sweep.local && self.layout.local[t] {
                let cell = &tree.cells[t];
                let len = self.expansion.local_len(cell.level());
                let local =
                    terms(&locals[cell.level()], t - tree.shape.level(cell.level()).start, len);
                self.expansion.l2p(cell, local, xs, us);
            }
            if sweep.multipole {
                let far = Far { plan: self, charges, multipoles };
                for &s in self.lists.m2p.of(t) {
                    far.m2p(s, xs, us);
                }
                self.inherited(t, &far, p2l_declined, xs, us);
            }
            if sweep.near {
                let runs = self.lists.near.of(t);
                gathered.with(Gathered::default, |gathered| near.add(runs, gathered, xs, us));
                let first = tree.shape.nodes[t].points().start;
                near.add_shares(self.lists.shares_of(t), first, xs, us);
            }
        };
        for_each_leaf(&self.target_tree.shape, &self.layout.tasks, values, &at_leaf);
    }

    /// What the cells above a target leaf, and the leaf itself, have not put into local expansions:
    /// the M2L list of a treecode, and what P2L declined.
    fn inherited(
        &self,
        leaf: usize,
        far: &Far<'_, E>,
        p2l_declined: &[AtomicBool],
        xs: &[TargetOf<E>],
        us: &mut [ValueOf<E>],
    ) {
        let treecode = self.scheme != Scheme::Fmm;
        let p2l = &self.lists.p2l;
        for t in self.target_tree.shape.path_to_root(leaf) {
            if treecode {
                for &s in self.lists.m2l.of(t) {
                    far.m2p(s, xs, us);
                }
            }
            for (k, &s) in p2l.of(t).iter().enumerate() {
                if p2l_declined[p2l.starts[t] + k].load(Relaxed) {
                    far.direct(s, xs, us);
                }
            }
        }
    }
}

/// What is needed to bring a source cell's field straight to targets.
struct Far<'a, E: Expansion> {
    plan: &'a Plan<E>,
    charges: &'a [ChargeOf<E>],
    multipoles: &'a [Vec<E::MultipoleTerm>],
}

impl<E: Expansion> Far<'_, E> {
    fn m2p(&self, s: u32, xs: &[TargetOf<E>], us: &mut [ValueOf<E>]) {
        let (plan, tree) = (self.plan, &self.plan.source_tree);
        let cell = &tree.cells[s as usize];
        let len = plan.expansion.multipole_len(cell.level());
        let index = s as usize - tree.shape.level(cell.level()).start;
        let multipole = terms(&self.multipoles[cell.level()], index, len);
        if plan.expansion.m2p(cell, multipole, xs, us) == Outcome::Declined {
            self.direct(s, xs, us);
        }
    }

    fn direct(&self, s: u32, xs: &[TargetOf<E>], us: &mut [ValueOf<E>]) {
        let points = self.plan.source_tree.shape.nodes[s as usize].points();
        let (ys, qs) = (&self.plan.sources[points.clone()], &self.charges[points]);
        let expansion = &self.plan.expansion;
        expansion.kernel().add_block(xs, ys, qs, self.plan.pair_tolerance, us);
    }
}

/// The terms of one cell of a level.
fn terms<V>(level: &[V], index: usize, len: usize) -> &[V] {
    &level[index * len..][..len]
}

//! The passes of one application: up the source tree, across, down the target tree, out.
//!
//! Each cell's terms and each target's sum are written by one task, in one fixed order: the result
//! does not depend on the number of threads.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use rayon::prelude::*;

use crate::expansion::{ChargeOf, Expansion, LevelPairs, RealOf, SourceOf, TargetOf, ValueOf};
use crate::kernel::{Kernel, Outcome};
use crate::lists::{ALL, Lists, Run, for_each_set_bit};
use crate::real::Additive;
use crate::tree::Tree;

/// How a plan sums. All schemes give the same sums; they differ in cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scheme {
    /// Every pair: O(N²).
    Direct,
    /// Multipoles evaluated at every target: O(N log N).
    Treecode {
        /// Whether parents take their moments from their children (M2M) instead of from their
        /// sources.
        m2m: bool,
    },
    /// Multipoles turned into local expansions, evaluated once per target: O(N).
    #[default]
    Fmm,
}

/// What a sum needs besides charges.
pub(crate) struct Plan<E: Expansion> {
    pub(crate) expansion: E,
    pub(crate) scheme: Scheme,
    pub(crate) source_tree: Arc<Tree<RealOf<E>>>,
    pub(crate) target_tree: Arc<Tree<RealOf<E>>>,
    /// Sources in tree order.
    pub(crate) sources: Vec<SourceOf<E>>,
    /// Targets in tree order.
    pub(crate) targets: Vec<TargetOf<E>>,
    pub(crate) lists: Lists,
    /// Leaves of the target tree in the order of their targets.
    pub(crate) target_leaves: Vec<u32>,
}

/// Everything that one application writes to, kept from one to the next.
pub(crate) struct Workspace<E: Expansion> {
    charges: Vec<ChargeOf<E>>,
    /// Values in tree order.
    pub(crate) values: Vec<ValueOf<E>>,
    /// Multipole terms, level by level, cell after cell.
    multipoles: Vec<Vec<E::MultipoleTerm>>,
    /// Local terms, likewise.
    locals: Vec<Vec<E::LocalTerm>>,
    /// For every entry of the P2L list, whether the expansion declined it.
    p2l_declined: Vec<AtomicBool>,
    uses: Uses,
}

/// Which cells take part in the far field.
struct Uses {
    multipole: Vec<bool>,
    local: Vec<bool>,
}

impl<E: Expansion> Workspace<E> {
    pub(crate) fn new(plan: &Plan<E>) -> Self {
        let uses = Uses::new(plan);
        let expansion = &plan.expansion;
        let lens = |levels,
                    used: &[bool],
                    level_of: &dyn Fn(usize) -> Range<usize>,
                    len: &dyn Fn(usize) -> usize| {
            (0..levels)
                .map(|level| {
                    let cells = level_of(level);
                    if used[cells.clone()].contains(&true) { cells.len() * len(level) } else { 0 }
                })
                .collect::<Vec<usize>>()
        };
        let (sources, targets) = (&plan.source_tree, &plan.target_tree);
        let multipoles = lens(sources.levels(), &uses.multipole, &|l| sources.level(l), &|l| {
            expansion.multipole_len(l)
        });
        let locals =
            lens(targets.levels(), &uses.local, &|l| targets.level(l), &|l| expansion.local_len(l));
        Self {
            charges: Vec::with_capacity(plan.sources.len()),
            values: vec![Additive::zero(); plan.targets.len()],
            multipoles: multipoles.into_iter().map(|n| vec![Additive::zero(); n]).collect(),
            locals: locals.into_iter().map(|n| vec![Additive::zero(); n]).collect(),
            p2l_declined: plan.lists.p2l.items.iter().map(|_| AtomicBool::new(false)).collect(),
            uses,
        }
    }
}

impl Uses {
    fn new<E: Expansion>(plan: &Plan<E>) -> Self {
        let (sources, targets, lists) = (&plan.source_tree, &plan.target_tree, &plan.lists);
        let mut multipole = vec![false; sources.cells.len()];
        for &s in lists.m2l.items.iter().chain(&lists.m2p.items) {
            multipole[s as usize] = true;
        }
        if plan.scheme != (Scheme::Treecode { m2m: false }) {
            for s in 1..multipole.len() {
                multipole[s] |= multipole[sources.nodes[s].parent as usize];
            }
        }
        let mut local = vec![false; targets.cells.len()];
        if plan.scheme == Scheme::Fmm {
            for t in 0..local.len() {
                local[t] = local[targets.nodes[t].parent as usize]
                    || !lists.m2l.of(t).is_empty()
                    || !lists.p2l.of(t).is_empty();
            }
        }
        Self { multipole, local }
    }
}

impl<E: Expansion> Plan<E> {
    /// Leaves the sums in `workspace.values`, in tree order.
    pub(crate) fn run(&self, charges: &[ChargeOf<E>], workspace: &mut Workspace<E>) {
        workspace.charges.clear();
        workspace.charges.extend(self.source_tree.order.iter().map(|&i| charges[i as usize]));
        self.upward(workspace);
        if self.scheme == Scheme::Fmm {
            self.downward(workspace);
        }
        self.evaluate(workspace);
    }

    /// P2M at the leaves, M2M above them.
    fn upward(&self, workspace: &mut Workspace<E>) {
        let Workspace { charges, multipoles, uses, .. } = workspace;
        let tree = &self.source_tree;
        let shift_moments = self.scheme != (Scheme::Treecode { m2m: false });
        for level in (0..tree.levels()).rev() {
            let (head, below) = multipoles.split_at_mut(level + 1);
            let len = self.expansion.multipole_len(level);
            let first = tree.level(level).start;
            cells_mut(&mut head[level], len).for_each(|(i, multipole)| {
                let s = first + i;
                if !uses.multipole[s] {
                    return;
                }
                multipole.fill(Additive::zero());
                let (cell, node) = (&tree.cells[s], &tree.nodes[s]);
                if node.is_leaf() || !shift_moments {
                    let points = node.points();
                    let (ys, qs) = (&self.sources[points.clone()], &charges[points]);
                    self.expansion.p2m(cell, ys, qs, multipole);
                } else {
                    let child_len = self.expansion.multipole_len(level + 1);
                    let first_child = tree.level(level + 1).start;
                    for c in node.children() {
                        let child = terms(&below[0], c - first_child, child_len);
                        self.expansion.m2m(&tree.cells[c], cell, child, multipole);
                    }
                }
            });
        }
    }

    /// M2L and P2L at every level, L2L from one to the next.
    fn downward(&self, workspace: &mut Workspace<E>) {
        let Workspace { charges, multipoles, locals, p2l_declined, uses, .. } = workspace;
        let (sources, targets) = (&self.source_tree, &self.target_tree);
        let p2l = &self.lists.p2l;
        for level in 0..targets.levels() {
            let (above, tail) = locals.split_at_mut(level);
            let locals = &mut tail[0];
            if locals.is_empty() {
                continue;
            }
            locals.par_iter_mut().for_each(|term| *term = Additive::zero());

            let cells = targets.level(level);
            let starts = &self.lists.m2l.starts[cells.start..=cells.end];
            if starts[0] != starts[cells.len()] {
                let source_cells = sources.level(level);
                let pairs = LevelPairs {
                    level,
                    sources: &sources.cells[source_cells.clone()],
                    targets: &targets.cells[cells.clone()],
                    starts,
                    list: &self.lists.m2l.items,
                    first_source: source_cells.start,
                };
                self.expansion.m2l_level(&pairs, &multipoles[level], locals);
            }

            let len = self.expansion.local_len(level);
            let first = cells.start;
            cells_mut(locals, len).for_each(|(i, local)| {
                let t = first + i;
                let (cell, parent) = (&targets.cells[t], targets.nodes[t].parent as usize);
                if level > 0 && uses.local[parent] {
                    let parent_len = self.expansion.local_len(level - 1);
                    let first_parent = targets.level(level - 1).start;
                    let from = terms(&above[level - 1], parent - first_parent, parent_len);
                    self.expansion.l2l(&targets.cells[parent], cell, from, local);
                }
                for (k, &s) in p2l.of(t).iter().enumerate() {
                    let points = sources.nodes[s as usize].points();
                    let (ys, qs) = (&self.sources[points.clone()], &charges[points]);
                    let declined = self.expansion.p2l(cell, ys, qs, local) == Outcome::Declined;
                    p2l_declined[p2l.starts[t] as usize + k].store(declined, Relaxed);
                }
            });
        }
    }

    /// L2P, M2P and the near field at every target leaf.
    fn evaluate(&self, workspace: &mut Workspace<E>) {
        let Workspace { charges, values, multipoles, locals, p2l_declined, uses } = workspace;
        let tree = &self.target_tree;
        let mut rest = &mut values[..];
        let mut leaves = Vec::with_capacity(self.target_leaves.len());
        for &t in &self.target_leaves {
            let (head, tail) = rest.split_at_mut(tree.nodes[t as usize].count());
            leaves.push((t as usize, head));
            rest = tail;
        }
        let far = Far { plan: self, charges, multipoles };
        leaves.into_par_iter().for_each(|(t, us)| {
            us.fill(Additive::zero());
            let xs = &self.targets[tree.nodes[t].points()];
            if uses.local[t] {
                let cell = &tree.cells[t];
                let len = self.expansion.local_len(cell.level());
                let local = terms(&locals[cell.level()], t - tree.level(cell.level()).start, len);
                self.expansion.l2p(cell, local, xs, us);
            }
            for &s in self.lists.m2p.of(t) {
                far.m2p(s, xs, us);
            }
            if self.scheme != Scheme::Direct {
                self.inherited(t, &far, p2l_declined, xs, us);
            }
            for run in self.lists.near.of(t) {
                self.near(*run, charges, xs, us);
            }
        });
    }

    /// What the cells above a target leaf, and the leaf itself, have not put into local expansions:
    /// in a treecode all of it, otherwise what P2L declined.
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
        let mut t = leaf;
        loop {
            if treecode {
                for &s in self.lists.m2l.of(t) {
                    far.m2p(s, xs, us);
                }
            }
            for (k, &s) in p2l.of(t).iter().enumerate() {
                if treecode || p2l_declined[p2l.starts[t] as usize + k].load(Relaxed) {
                    far.direct(s, xs, us);
                }
            }
            if t == 0 {
                return;
            }
            t = self.target_tree.nodes[t].parent as usize;
        }
    }

    /// One run of near sources, pair by pair where some are masked.
    fn near(&self, run: Run, charges: &[ChargeOf<E>], xs: &[TargetOf<E>], us: &mut [ValueOf<E>]) {
        let kernel = self.expansion.kernel();
        let points = run.first as usize..run.last as usize;
        let (ys, qs) = (&self.sources[points.clone()], &charges[points]);
        if run.bits == ALL {
            return kernel.add_block(xs, ys, qs, self.expansion.pair_tolerance(), us);
        }
        let bits = &self.lists.bits[run.bits as usize..];
        for (i, (x, u)) in xs.iter().zip(us).enumerate() {
            for_each_set_bit(bits, i, ys.len(), |j| kernel.add(x, &ys[j], &qs[j], u));
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
        let index = s as usize - tree.level(cell.level()).start;
        let multipole = terms(&self.multipoles[cell.level()], index, len);
        if plan.expansion.m2p(cell, multipole, xs, us) == Outcome::Declined {
            self.direct(s, xs, us);
        }
    }

    fn direct(&self, s: u32, xs: &[TargetOf<E>], us: &mut [ValueOf<E>]) {
        let points = self.plan.source_tree.nodes[s as usize].points();
        let (ys, qs) = (&self.plan.sources[points.clone()], &self.charges[points]);
        let expansion = &self.plan.expansion;
        expansion.kernel().add_block(xs, ys, qs, expansion.pair_tolerance(), us);
    }
}

/// The terms of one cell of a level.
fn terms<V>(level: &[V], index: usize, len: usize) -> &[V] {
    &level[index * len..][..len]
}

/// The terms of every cell of a level, with the cells' indices.
fn cells_mut<V: Send>(
    level: &mut [V],
    len: usize,
) -> impl IndexedParallelIterator<Item = (usize, &mut [V])> {
    level.par_chunks_mut(len.max(1)).enumerate()
}

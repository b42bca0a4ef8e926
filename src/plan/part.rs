//! The part of a plan that one of several processes has, when the points of one sum are spread over all of them.
//!
//! The processes share one tree over all sources, and one over all targets; each holds what its own targets need of them.
//! What that is, a part finds out; bringing it is for others: nothing here knows of processes.

use std::ops::Range;
use std::sync::Arc;

use crate::error::{Error, PointSet};
use crate::expansion::admissibility::Admissibility;
use crate::expansion::geometry::Level;
use crate::expansion::{ChargeOf, Expansion, SourceOf, TargetOf, ValueOf};
use crate::interaction::cell_mask::Everything;
use crate::interaction::lists::{Lists, first_level_of_many};
use crate::interaction::traversal::{Far, Traversal};
use crate::kernel::traits::Kernel;
use crate::numbers::traits::{Numbers, Real};
use crate::octree::geometry::Cube;
use crate::octree::shape::Given;
use crate::octree::tree::Tree;
use crate::octree::trees::Trees;
use crate::parallel::watch::Watch;
use crate::plan::ready::Ready;
use crate::plan::upward::Upward;
use crate::plan::{Plan, Scheme, levels};

/// A cell of a tree of which one process knows a part.
///
/// Cells are given level by level from the root on, those of a level along the Morton curve, each after its parent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PartCell {
    /// Its level; the root's is 0.
    pub level: usize,
    /// Its integer coordinates among the 2^level cells per axis.
    pub coordinates: [u64; 3],
    /// The places of its points along the curve: among all sources for a cell of sources, among those targets that are
    /// here for a cell of targets.
    pub points: Range<u32>,
    /// How many points it has, here or elsewhere.
    pub count: u32,
    /// Whether some of its children are not given.
    pub closed: bool,
}

/// How the targets that are here meet all sources: the interaction lists of a part.
#[derive(Debug)]
pub struct PartLists<T: Real> {
    root: Cube<T>,
    targets: Tree<T>,
    sources: Tree<T>,
    lists: Lists,
}

impl<T: Real> PartLists<T> {
    /// Finds the lists of the cells that have targets here, as far as they can be told from the sources' cells that are
    /// given. Where the children of a cell are [wanted](Self::wanted), it is called again with more of them: from the
    /// root alone, one more level each time.
    ///
    /// # Errors
    /// [`Error::InvalidCell`] if cells don't make a tree.
    pub fn new(
        root: Cube<T>,
        targets: &[PartCell],
        sources: &[PartCell],
        admissibility: &Admissibility,
    ) -> Result<Self, Error> {
        let here = targets.first().map_or(0, |root| root.points.end);
        let targets = tree(&root, PointSet::Targets, targets, (0..here).collect())?;
        let sources = tree(&root, PointSet::Sources, sources, Vec::new())?;
        let watch = &Watch::default();
        let (mask, far) = (&Everything, Far::Whole);
        let [t, s] = [&targets, &sources];
        let lists =
            Traversal { targets: t, sources: s, mask, far, admissibility, watch }.unmasked();
        Ok(Self { root, targets, sources, lists })
    }

    /// Source cells whose children are needed and not given, by their indices.
    pub fn wanted(&self) -> &[u32] {
        &self.lists.wanted
    }

    /// How many pairs of points are summed directly, and how many meet through each level, those of targets that are here.
    pub fn pairs_of_points(&self) -> (u64, Vec<u64>) {
        self.lists.pairs_of_points(&self.targets.shape, &self.sources.shape)
    }

    /// Sums directly what comes through the coarsest levels, if that is next to nothing beside the rest: told by the
    /// [pairs](Self::pairs_of_points) of all parts, added up.
    pub fn sum_few_directly(&mut self, near: u64, by_level: &[u64]) {
        let first = first_level_of_many(near, by_level);
        self.lists.sum_directly_above(first, &self.targets.shape, &self.sources.shape);
    }

    /// The levels at which this part needs expansions, with the offsets of its M2L pairs and their number.
    pub fn levels(&self) -> Vec<Level<T>> {
        levels(&self.lists, &self.sources, &self.targets, Scheme::Fmm)
    }

    /// How many source cells act on a target cell by M2L.
    pub fn m2l_pairs(&self, target: usize) -> usize {
        self.lists.m2l.of(target).len()
    }

    /// The plan of these lists, for an expansion that is prepared for the levels of all parts, and the targets that are
    /// here in the order of the curve.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`] if there are not as many targets as the cells hold.
    pub fn plan<E: Expansion>(
        self,
        expansion: E,
        targets: Vec<TargetOf<E>>,
    ) -> Result<Part<E>, Error>
    where
        E::Kernel: Kernel<Real = T>,
    {
        expected("targets", self.targets.shape.order.len(), targets.len())?;
        let trees = Trees {
            root: self.root,
            leaf_size: 0,
            source_tree: Arc::new(self.sources),
            target_tree: Arc::new(self.targets),
            sources: Vec::new(),
            targets,
        };
        Ok(Part::new(Plan::new(expansion, Scheme::Fmm, trees, self.lists)))
    }
}

/// The part of a plan that sums at the targets that are here.
///
/// It is given the multipole terms of the source cells that it [needs](Self::multipoles), and the sources at the
/// [places](Self::places) that it needs with their charges, wherever they come from. Sums have the same bits as those
/// of a plan that has all points.
pub struct Part<E: Expansion> {
    ready: Ready<E>,
    multipoles: Vec<u32>,
    places: Vec<Range<u32>>,
}

impl<E: Expansion> Part<E> {
    fn new(mut plan: Plan<E>) -> Self {
        let mut multipoles = [&plan.lists.m2l.items[..], &plan.lists.m2p.items].concat();
        multipoles.sort_unstable();
        multipoles.dedup();
        // M2P may be declined.
        let by_cell = [&plan.lists.p2l.items[..], &plan.lists.m2p.items].concat();
        let nodes = &plan.source_tree.shape.nodes;
        let of_cell = |&s: &u32| {
            let points = nodes[s as usize].points();
            points.start as u32..points.end as u32
        };
        let runs = plan.lists.near.items.iter().map(|run| run.first..run.last);
        let places = joined(runs.chain(by_cell.iter().map(of_cell)).collect());

        let starts: Vec<u32> = places
            .iter()
            .scan(0, |next, run| {
                let start = *next;
                *next += run.end - run.start;
                Some(start)
            })
            .collect();
        let moved = |place: u32| {
            let run = places.partition_point(|run| run.end <= place);
            starts[run] + (place - places[run].start)
        };
        for run in &mut plan.lists.near.items {
            (run.first, run.last) = (moved(run.first), moved(run.first) + (run.last - run.first));
        }
        let nodes = &mut Arc::make_mut(&mut plan.source_tree).shape.nodes;
        let mut by_cell = by_cell;
        by_cell.sort_unstable();
        by_cell.dedup();
        for s in by_cell {
            let node = &mut nodes[s as usize];
            node.move_points(moved(node.points().start as u32));
        }
        Self { ready: Ready::new(plan), multipoles, places }
    }

    /// The expansion.
    pub fn expansion(&self) -> &E {
        &self.ready.plan.expansion
    }

    /// The source cells whose multipole terms are needed, by their indices, ascending.
    pub fn multipoles(&self) -> &[u32] {
        &self.multipoles
    }

    /// The places of the sources that are needed, ascending and apart.
    pub fn places(&self) -> &[Range<u32>] {
        &self.places
    }

    /// Takes the sources at the needed places, in their order.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`] if there are more or fewer.
    pub fn set_sources(&mut self, sources: Vec<SourceOf<E>>) -> Result<(), Error> {
        expected("sources", self.sources(), sources.len())?;
        self.ready.plan.sources = sources;
        Ok(())
    }

    /// The sums at the targets that are here, in their order, for the charges at the needed places and the multipole terms
    /// of the needed cells, one cell after the other. No multipole term of a level is larger than `largest` says, whichever
    /// part formed it.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`] if there are more or fewer charges, terms or, yet, sources.
    pub fn apply(
        &self,
        charges: &[ChargeOf<E>],
        multipoles: &[E::MultipoleTerm],
        largest: &[f64],
    ) -> Result<Vec<ValueOf<E>>, Error> {
        let plan = &self.ready.plan;
        let level = |s: u32| plan.source_tree.shape.nodes[s as usize].level();
        let len = |s: &u32| plan.expansion.multipole_len(level(*s));
        expected("sources", self.sources(), plan.sources.len())?;
        expected("charges", self.sources(), charges.len())?;
        expected("multipole terms", self.multipoles.iter().map(len).sum(), multipoles.len())?;
        Ok(self.ready.with_workspace(|workspace| {
            workspace.charges.clone_from_slice(charges);
            workspace.largest_elsewhere = largest.to_vec();
            let mut rest = multipoles;
            for &s in &self.multipoles {
                let (own, others) = rest.split_at(len(&s));
                let index = s as usize - plan.source_tree.shape.level(level(s)).start;
                let to = &mut workspace.multipoles[level(s)][index * own.len()..][..own.len()];
                to.clone_from_slice(own);
                rest = others;
            }
            plan.run_given(workspace, &Watch::default());
            workspace.values.clone()
        }))
    }

    fn sources(&self) -> usize {
        self.places.iter().map(|run| (run.end - run.start) as usize).sum()
    }
}

/// The cells of the source tree that have points here, of which multipole terms are formed here where all points are.
#[derive(Debug)]
pub struct PartMoments<T: Real> {
    tree: Tree<T>,
    formed: Vec<bool>,
}

impl<T: Real> PartMoments<T> {
    /// For cells whose points are here, with places from 0 on; a cell that is closed has others elsewhere.
    ///
    /// # Errors
    /// [`Error::InvalidCell`] if cells don't make a tree.
    pub fn new(root: Cube<T>, cells: &[PartCell]) -> Result<Self, Error> {
        let tree = tree(&root, PointSet::Sources, cells, Vec::new())?;
        let formed = tree.shape.nodes.iter().map(|node| !node.is_closed()).collect();
        Ok(Self { tree, formed })
    }

    /// The multipole terms of all cells from level `coarsest` on, level by level and cell after cell; zeros for closed
    /// cells. Sources and charges are those that are here, in the order of the curve.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`] if there are not as many sources or charges as the cells hold.
    pub fn form<E: Expansion>(
        &self,
        expansion: &E,
        coarsest: usize,
        sources: &[SourceOf<E>],
        charges: &[ChargeOf<E>],
    ) -> Result<Vec<Vec<E::MultipoleTerm>>, Error>
    where
        E::Kernel: Kernel<Real = T>,
    {
        let shape = &self.tree.shape;
        let points = shape.nodes.first().map_or(0, |root| root.points().len());
        expected("sources", points, sources.len())?;
        expected("charges", points, charges.len())?;
        let terms = |level: usize| {
            let cells = if level < coarsest { 0 } else { shape.level(level).len() };
            vec![Numbers::zero(); cells * expansion.multipole_len(level)]
        };
        let mut multipoles: Vec<Vec<E::MultipoleTerm>> = (0..shape.levels()).map(terms).collect();
        let (tree, formed, watch) = (&self.tree, &self.formed[..], &Watch::default());
        let upward = Upward { expansion, tree, formed, shifts_moments: true, watch };
        upward.p2m(sources, charges, &mut multipoles);
        upward.m2m(&mut multipoles);
        Ok(multipoles)
    }
}

/// The tree of given cells.
fn tree<T: Real>(
    root: &Cube<T>,
    set: PointSet,
    cells: &[PartCell],
    order: Vec<u32>,
) -> Result<Tree<T>, Error> {
    let given = |cell: &PartCell| {
        let PartCell { level, ref points, count, closed, .. } = *cell;
        Given { level, points: points.clone(), count, closed }
    };
    let given: Vec<Given> = cells.iter().map(given).collect();
    let coordinates: Vec<[u64; 3]> = cells.iter().map(|cell| cell.coordinates).collect();
    Tree::of_cells(root, &given, &coordinates, order)
        .map_err(|index| Error::InvalidCell { set, index })
}

/// Ranges that touch or overlap, made one.
fn joined(mut ranges: Vec<Range<u32>>) -> Vec<Range<u32>> {
    ranges.sort_unstable_by_key(|range| range.start);
    let mut joined: Vec<Range<u32>> = Vec::new();
    for range in ranges.into_iter().filter(|range| !range.is_empty()) {
        match joined.last_mut() {
            Some(last) if range.start <= last.end => last.end = last.end.max(range.end),
            _ => joined.push(range),
        }
    }
    joined
}

fn expected(what: &'static str, expected: usize, found: usize) -> Result<(), Error> {
    if expected == found { Ok(()) } else { Err(Error::LengthMismatch { what, expected, found }) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn cell(level: usize, coordinates: [u64; 3], points: Range<u32>) -> PartCell {
        PartCell { level, coordinates, count: points.end - points.start, points, closed: false }
    }

    fn lists(targets: &[PartCell], sources: &[PartCell]) -> Result<PartLists<f64>, Error> {
        PartLists::new(Cube::new(DVec3::ZERO, 1.0), targets, sources, &Admissibility::default())
    }

    #[test]
    fn ranges_of_places_are_joined_where_they_touch() {
        assert_eq!(joined(vec![7..9, 0..2, 2..3, 8..12, 5..5, 1..2]), [0..3, 7..12]);
        assert!(joined(Vec::new()).is_empty());
    }

    #[test]
    fn closed_cells_are_wanted_until_their_children_are_given() {
        let targets = [cell(0, [0; 3], 0..5), cell(1, [0; 3], 0..5)];
        let mut sources = vec![cell(0, [0; 3], 0..90)];
        sources[0].closed = true;
        assert_eq!(lists(&targets, &sources).unwrap().wanted(), [0]);
        sources[0].closed = false;
        sources.extend([cell(1, [0; 3], 0..40), cell(1, [1, 0, 0], 40..90)]);
        sources[2].closed = true;
        let some = lists(&targets, &sources).unwrap();
        assert_eq!(some.wanted(), [2]);
        sources[2].closed = false;
        let all = lists(&targets, &sources).unwrap();
        assert_eq!((all.wanted(), all.pairs_of_points().0), (&[][..], 5 * 90));
    }

    #[test]
    fn cells_that_make_no_tree_are_named() {
        let (root, wrong) = (cell(0, [0; 3], 0..5), cell(1, [2, 0, 0], 0..5));
        let refused = |targets: &[PartCell], sources: &[PartCell]| lists(targets, sources).err();
        let cells = [root.clone(), wrong];
        let named = |set| Some(Error::InvalidCell { set, index: 1 });
        assert_eq!(refused(&cells, std::slice::from_ref(&root)), named(PointSet::Targets));
        assert_eq!(refused(&[root], &cells), named(PointSet::Sources));
        assert!(lists(&[], &[]).unwrap().levels().is_empty());
    }
}

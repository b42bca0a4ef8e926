//! Which matrix belongs to an offset: groups of directions one after the other, and the cores of each.

use crate::expansion::offset_map::OffsetMap;
use crate::interpolation::directions::{Digits, Place};
use crate::interpolation::means::{INTERACTION_OFFSETS, interaction_offsets, weight};
use crate::numbers::traits::Scalar;

/// The groups of directions of a level with their matrices, and where in them an offset's is.
#[derive(Debug)]
pub(crate) struct Numbering<S: Scalar> {
    pub(crate) groups: Vec<Digits<S>>,
    /// Directions are numbered group by group: those of one from its entry up to the next.
    pub(crate) firsts: Vec<usize>,
    pub(crate) places: OffsetMap<Place>,
    /// Places of offsets up to [`NEAR`], by [`near_index`].
    near: Vec<Option<Place>>,
    /// Where each group's coordinates stand among those of one cell, in its digits, filled up to whole
    /// registers.
    pub(crate) starts: Vec<usize>,
    /// How many coordinates one cell has in all directions: in full digits, in single ones; likewise.
    pub(crate) coordinates: [usize; 2],
    /// How many cores the directions before one have.
    pub(crate) core_starts: Vec<usize>,
}

/// Offsets of an unmasked tree have no component larger than this.
const NEAR: i32 = 3;

impl<S: Scalar> Numbering<S> {
    pub(crate) fn new(groups: Vec<Digits<S>>, places: OffsetMap<Place>) -> Self {
        let (mut coordinates, mut starts) = ([0; 2], Vec::new());
        let (mut firsts, mut core_starts) = (vec![0], vec![0]);
        for digits in &groups {
            let (kind, members, height, cores) = match digits {
                Digits::Full(own) => (0, own.members(), own.heights[0], own.cores.len()),
                Digits::Single(own) => (1, own.members(), own.heights[0], own.cores.len()),
            };
            starts.push(coordinates[kind]);
            coordinates[kind] += members * height;
            let first_core = core_starts[core_starts.len() - 1];
            core_starts.extend((1..=members).map(|member| first_core + member * cores));
            firsts.push(firsts[firsts.len() - 1] + members);
        }
        let range = -NEAR..=NEAR;
        let mut near = Vec::new();
        for x in range.clone() {
            for y in range.clone() {
                near.extend(range.clone().map(|z| places.get([x, y, z]).copied()));
            }
        }
        Self { groups, firsts, places, near, starts, coordinates, core_starts }
    }

    /// The place of an offset that is known.
    #[inline]
    pub(crate) fn find(&self, offset: [i32; 3]) -> Option<Place> {
        match near_index(offset) {
            Some(near) => self.near[near],
            None => self.places.get(offset).copied(),
        }
    }

    /// The number of a place's direction.
    #[inline]
    pub(crate) fn direction(&self, place: Place) -> usize {
        self.firsts[usize::from(place.group)] + usize::from(place.member)
    }

    /// Multiply-adds for one target cell in a uniform tree, its share of what sources send included.
    pub(crate) fn multiply_adds(&self) -> f64 {
        let sides = self.groups.iter().map(|digits| match digits {
            Digits::Full(group) => group.side_multiply_adds(),
            Digits::Single(group) => group.side_multiply_adds(),
        });
        let cores = interaction_offsets().map(|offset| {
            let [y, z] = self.find(offset).map_or([0; 2], |place| self.ranks(place));
            weight(offset) * (y * z) as f64
        });
        sides.sum::<usize>() as f64 + 189.0 / INTERACTION_OFFSETS as f64 * cores.sum::<f64>()
    }

    /// Mean number of coordinates of a direction, each offset counted.
    pub(crate) fn mean_rank(&self) -> f64 {
        let places = self.places.values();
        let ranks: usize = places.iter().map(|&place| self.ranks(place)[0]).sum();
        ranks as f64 / places.len().max(1) as f64
    }

    /// The coordinates y and z of a place's direction.
    fn ranks(&self, place: Place) -> [usize; 2] {
        match &self.groups[usize::from(place.group)] {
            Digits::Full(group) => group.ranks,
            Digits::Single(group) => group.ranks,
        }
    }
}

/// Where an offset stands in [`Numbering::near`], if it is near.
#[inline]
fn near_index(offset: [i32; 3]) -> Option<usize> {
    let near = offset.iter().all(|o| (-NEAR..=NEAR).contains(o));
    near.then(|| offset.iter().fold(0, |index, o| index * (2 * NEAR + 1) + (o + NEAR)) as usize)
}

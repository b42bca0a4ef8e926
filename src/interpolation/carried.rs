//! Which offsets of the interaction list a level's expansions carry, and those of the levels above it.

use crate::expansion::admissibility::Admissibility;
use crate::expansion::geometry::Level;
use crate::interpolation::means::{INTERACTION_OFFSETS, interaction_offsets};
use crate::kernel::mask::Coverage;
use crate::numbers::traits::Real;

/// What comes to a cell through expansions.
#[derive(Clone, Debug, Default, Hash, PartialEq)]
pub(crate) struct Carried {
    /// A bit for each of the 343 offsets of up to three cells, for cells of one level and then for those above
    /// it. Empty if everything is carried.
    levels: Vec<[bool; 343]>,
}

impl Carried {
    /// What is carried at each of some levels, from the coarsest; for a homogeneous kernel what is on all of them.
    pub(crate) fn of_levels<T: Real>(
        admissibility: &Admissibility,
        levels: &[Level<T>],
        homogeneous: bool,
    ) -> Vec<Self> {
        let count = if homogeneous { levels.len().min(1) } else { levels.len() };
        if admissibility.is_whole() {
            return vec![Self::default(); count];
        }
        let own = |level: &Level<T>| {
            std::array::from_fn(|k| {
                // Where next to nothing is sent, what passes on to other cells is smooth all the same.
                admissibility.of(level.level, offset(k)) != Coverage::Partial
            })
        };
        let own: Vec<[bool; 343]> = levels.iter().map(own).collect();
        if homogeneous {
            let any = std::array::from_fn(|k| own.iter().any(|level| level[k]));
            return vec![Self { levels: vec![any; own.len()] }; count];
        }
        (0..count).map(|l| Self { levels: own[..=l].iter().rev().copied().collect() }).collect()
    }

    /// Whether everything is.
    pub(crate) fn is_whole(&self) -> bool {
        self.levels.is_empty()
    }

    /// Whether pairs of cells of the level itself at that offset are.
    pub(crate) fn has(&self, offset: [i32; 3]) -> bool {
        self.levels.first().is_none_or(|own| own[number(offset)])
    }

    /// The offsets of the interaction list that are.
    pub(crate) fn offsets(&self) -> Vec<[i32; 3]> {
        interaction_offsets().filter(|&offset| self.has(offset)).collect()
    }

    /// How many offsets of the interaction list there would be if those that are not carried counted for nothing.
    pub(crate) fn weight(&self, weight: fn([i32; 3]) -> f64) -> f64 {
        if self.is_whole() {
            return INTERACTION_OFFSETS as f64;
        }
        self.offsets().into_iter().map(weight).sum()
    }

    /// Whether what comes from a place, in half-widths of the cell, comes through a level above it; for cells
    /// that lie in their parents as the bits of `octants` say.
    pub(crate) fn comes_from_above(&self, place: [f64; 3], octants: usize) -> bool {
        if self.is_whole() {
            return true;
        }
        let mut centre = [0.0; 3];
        let mut half_width = 1.0;
        for (above, own) in self.levels.iter().enumerate().skip(1) {
            for (axis, centre) in centre.iter_mut().enumerate() {
                let side = octants >> ((3 * above + axis) % usize::BITS as usize) & 1;
                *centre += if side == 0 { half_width } else { -half_width };
            }
            half_width *= 2.0;
            let cells: [f64; 3] = std::array::from_fn(|axis| {
                ((place[axis] - centre[axis]) / (2.0 * half_width)).round()
            });
            let farthest = cells.iter().fold(0.0f64, |a, cells| a.max(cells.abs()));
            if (2.0..=3.0).contains(&farthest) {
                return own[number(cells.map(|cells| cells as i32))];
            }
        }
        false
    }
}

/// The offset with that number.
fn offset(number: usize) -> [i32; 3] {
    [number / 49, number / 7 % 7, number % 7].map(|o| o as i32 - 3)
}

/// The number of an offset of up to three cells, below 343.
pub(crate) fn number(offset: [i32; 3]) -> usize {
    offset.iter().fold(0, |number, o| 7 * number + (o + 3) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_carried_above_does_not_come() {
        let right = |level: usize, offset: [i32; 3]| {
            if level == 3 && offset == [2, 0, 0] { Coverage::Partial } else { Coverage::Full }
        };
        let levels = [3, 4].map(|level| Level::new(level, 0.5f64.powi(level as i32), Vec::new()));
        let carried =
            Carried::of_levels(&Admissibility::default().with(3..5, right), &levels, false);
        assert!(!carried[0].has([2, 0, 0]) && carried[0].has([-2, 0, 0]));
        assert!(carried[1].has([2, 0, 0]) && carried[1].offsets().len() == INTERACTION_OFFSETS);
        // In the lower octant of its parent, whose centre is at (1, 1, 1).
        assert!(!carried[1].comes_from_above([9.0, 1.0, 1.0], 0));
        assert!(carried[1].comes_from_above([-7.0, 1.0, 1.0], 0));
        assert!(!carried[1].comes_from_above([4.0, 1.0, 1.0], 0), "the parents touch");
        assert!(!carried[1].comes_from_above([99.0, 1.0, 1.0], 0), "nothing comes from beyond");
        assert!(Carried::default().comes_from_above([99.0, 1.0, 1.0], 0));
    }
}

//! Which pairs of well-separated cells an expansion carries.

use crate::kernel::mask::Coverage;

/// What an expansion does for the pairs of cells of each level and offset: see
/// [`Expansion::admits`](crate::Expansion::admits).
///
/// Only offsets of up to three cells along an axis are asked for, those of an unmasked tree. Cells that are
/// farther apart, or of different levels, are carried if everything is on the levels between which they lie.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Admissibility {
    /// By level, and by the [number](index) of the offset; none for a level of which everything is carried.
    levels: Vec<Option<Vec<Coverage>>>,
}

/// Offsets of an unmasked tree have no component larger than this.
const REACH: i32 = 3;
/// Offsets of one axis.
const SIDE: i32 = 2 * REACH + 1;

impl Admissibility {
    /// The same but for some levels, of which `admits` says what is done at every offset.
    pub fn with(
        &self,
        levels: impl IntoIterator<Item = usize>,
        admits: impl Fn(usize, [i32; 3]) -> Coverage,
    ) -> Self {
        let mut all = self.clone();
        for level in levels {
            for offset in offsets() {
                all.set(level, offset, admits(level, offset));
            }
        }
        all
    }

    /// Whether every pair of cells is carried.
    pub fn is_whole(&self) -> bool {
        self.levels.iter().all(Option::is_none)
    }

    /// What is done for pairs of cells of `level` at an offset, in cells from source to target.
    #[inline]
    pub fn of(&self, level: usize, offset: [i32; 3]) -> Coverage {
        // Asked for every pair of cells, and mostly of a whole.
        if self.levels.is_empty() {
            return Coverage::Full;
        }
        match (self.restricted(level), index(offset)) {
            (_, None) => {
                // On which level above they would be an unmasked tree's.
                let farthest = offset.iter().map(|o| o.unsigned_abs()).max().unwrap_or(0);
                let above = (farthest.div_ceil(REACH as u32)).next_power_of_two().ilog2() as usize;
                let is_whole = (level.saturating_sub(above)..=level)
                    .all(|level| self.restricted(level).is_none());
                if is_whole { Coverage::Full } else { Coverage::Partial }
            }
            (None, _) => Coverage::Full,
            (Some(known), Some(index)) => known[index],
        }
    }

    /// Whether cells of these levels that touch on the coarser one are carried where they are well separated.
    pub(crate) fn between(&self, coarser: usize, finer: usize) -> bool {
        (coarser + 1..=finer).all(|level| self.restricted(level).is_none())
    }

    /// Says what is done for pairs of cells; shares of them can't be carried.
    pub(crate) fn set(&mut self, level: usize, offset: [i32; 3], coverage: Coverage) {
        let Some(index) = index(offset) else { return };
        if coverage == Coverage::Full && self.restricted(level).is_none() {
            return;
        }
        if self.levels.len() <= level {
            self.levels.resize(level + 1, None);
        }
        let known =
            self.levels[level].get_or_insert_with(|| vec![Coverage::Full; SIDE.pow(3) as usize]);
        known[index] =
            if let Coverage::Eighths(_) = coverage { Coverage::Partial } else { coverage };
    }

    fn restricted(&self, level: usize) -> Option<&[Coverage]> {
        self.levels.get(level)?.as_deref()
    }
}

/// The offsets of an unmasked tree.
fn offsets() -> impl Iterator<Item = [i32; 3]> {
    let offset = |k: i32| [k / (SIDE * SIDE), k / SIDE % SIDE, k % SIDE].map(|o| o - REACH);
    (0..SIDE.pow(3)).map(offset).filter(|offset| offset.iter().any(|o| o.abs() > 1))
}

/// The number of an offset of an unmasked tree.
fn index(offset: [i32; 3]) -> Option<usize> {
    let near = offset.iter().all(|o| (-REACH..=REACH).contains(o));
    near.then(|| offset.iter().fold(0, |index, o| index * SIDE + o + REACH) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_restricted_restricts_what_lies_between() {
        let admits = |level: usize, offset: [i32; 3]| {
            if level == 4 && offset == [2, 0, 0] { Coverage::Partial } else { Coverage::Full }
        };
        let all = Admissibility::default();
        let asked = all.with(2..7, admits);
        assert!(!asked.is_whole() && all.with(5..7, admits).is_whole());
        assert_eq!(asked.with(5..7, admits), asked);
        assert_eq!(asked.of(4, [2, 0, 0]), Coverage::Partial);
        assert_eq!(asked.of(4, [0, 2, 0]), Coverage::Full);
        assert_eq!(asked.of(9, [3, 3, 3]), Coverage::Full, "nothing is known");
        // Four cells away on level 5 are two cells away on level 4.
        assert_eq!(asked.of(5, [4, 0, 0]), Coverage::Partial);
        assert_eq!(asked.of(6, [6, 0, 0]), Coverage::Full, "on level 5, three");
        assert_eq!(asked.of(6, [i32::MIN, 0, 0]), Coverage::Partial);
        assert!(asked.between(4, 6) && !asked.between(3, 4) && !asked.between(2, 6));
    }
}

//! Pairs of cells that send too little to be counted.

use crate::expansion::geometry::{Level, Strength};
use crate::interpolation::budget::PAIR_SHARE;
use crate::interpolation::entries::{Entries, PointOf, norm_squared};
use crate::interpolation::means::{interaction_offsets, weight};
use crate::interpolation::order::{Refusal, Restriction};
use crate::interpolation::tuning::WORTH_LEAVING;
use crate::kernel::mask::Coverage;
use crate::numbers::traits::{Real, Scalar, Vector};
use crate::parallel;

/// Asks for the offsets to be left out at which all that a kernel and its derivatives can send is within a share of
/// the tolerance, if there are many of them on some level.
///
/// Errors of pairs are relative to a size under which those of different cells do not add up. What is left out may
/// have one sign everywhere: then it does.
pub(crate) fn leave_out<S: Scalar>(
    kernel: &Entries<'_, S>,
    slopes: Option<&Entries<'_, S>>,
    unit: f64,
    tolerance: f64,
    levels: &[Level<S::Real>],
) -> Result<(), Refusal> {
    let share = PAIR_SHARE * tolerance / levels.len() as f64;
    let most = |strength: Option<Strength>| {
        let Strength { cells, size, through, .. } = strength?;
        let size = size.min(through);
        size.is_finite().then(|| share * size / unit / cells.max(1.0).sqrt())
    };
    let offsets: Vec<Vec<bool>> = parallel::map(levels.len(), &|index| {
        let level = &levels[index];
        let values = most(level.values);
        let derivatives = slopes.map(|slopes| (slopes, most(level.slopes)));
        let is_little = |offset: [i32; 3]| {
            values.is_some_and(|most| is_below(kernel, level.half_width, offset, most))
                && derivatives.as_ref().is_none_or(|(slopes, most)| {
                    most.is_some_and(|most| is_below(slopes, level.half_width, offset, most))
                })
        };
        interaction_offsets().map(is_little).collect()
    });
    let all: f64 = interaction_offsets().map(weight).sum();
    let share = |level: &Vec<bool>| {
        let left_out = interaction_offsets().zip(level).filter(|(_, own)| **own);
        left_out.map(|(offset, _)| weight(offset)).sum::<f64>() / all
    };
    if offsets.iter().any(|level| share(level) >= WORTH_LEAVING) {
        return Err(Refusal::Restricted(Restriction { coverage: Coverage::Empty, offsets }));
    }
    Ok(())
}

/// Whether no entry between the centres and the corners of two cells is larger than `most`.
fn is_below<S: Scalar>(
    kernel: &Entries<'_, S>,
    half_width: S::Real,
    offset: [i32; 3],
    most: f64,
) -> bool {
    let step = offset.map(|o| S::Real::from_f64(2.0 * f64::from(o)));
    let source = PointOf::<S>::from_array(step);
    // Differences of corners lie on a grid of half-widths.
    let grid: Vec<PointOf<S>> = (0..27i32)
        .map(|k| [k / 9, k / 3 % 3, k % 3].map(|c| S::Real::from_f64(2.0 * f64::from(c) - 2.0)))
        .map(|d| (source + PointOf::<S>::from_array(d)) * half_width)
        .collect();
    let below =
        |d: &PointOf<S>| norm_squared(&kernel.at(PointOf::<S>::default(), *d)).sqrt() <= most;
    // Most are seen at the centres.
    below(&grid[13]) && grid.iter().all(below)
}

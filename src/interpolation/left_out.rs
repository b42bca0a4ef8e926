//! Pairs of cells that send too little to be counted.

use crate::expansion::geometry::{Level, Strength};
use crate::interpolation::budget::PAIR_SHARE;
use crate::interpolation::entries::{Entries, PointOf, norm_squared, zero};
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
        let values = below(kernel, level.half_width, most(level.values));
        let Some(slopes) = slopes else { return values };
        let slopes = below(slopes, level.half_width, most(level.slopes));
        values.into_iter().zip(slopes).map(|(values, slopes)| values && slopes).collect()
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

/// For each offset, whether no entry between the centres and the corners of two cells is larger than `most`.
fn below<S: Scalar>(kernel: &Entries<'_, S>, half_width: S::Real, most: Option<f64>) -> Vec<bool> {
    let Some(most) = most else { return interaction_offsets().map(|_| false).collect() };
    let place = |steps: [i32; 3]| {
        PointOf::<S>::from_array(steps.map(|c| S::Real::from_f64(f64::from(c)))) * half_width
    };
    let len = kernel.fields * kernel.densities;
    let are_below = |places: &[PointOf<S>]| {
        let mut entries = vec![zero::<S>(); places.len() * len];
        kernel.write(places, PointOf::<S>::default(), &mut entries);
        let below = entries.chunks_exact(len).map(|entries| norm_squared(entries).sqrt() <= most);
        below.collect::<Vec<bool>>()
    };
    let centres: Vec<_> = interaction_offsets().map(|o| place(o.map(|o| -2 * o))).collect();
    // Most are seen at the centres.
    let at_centres = are_below(&centres);
    interaction_offsets()
        .zip(at_centres)
        .map(|(offset, is_below)| {
            // Differences of corners lie on a grid of half-widths.
            let corner = |k: i32| [k / 9, k / 3 % 3, k % 3].map(|c| 2 * c - 2);
            let corners = (0..27).map(|k| {
                let corner = corner(k);
                place(std::array::from_fn(|axis| corner[axis] - 2 * offset[axis]))
            });
            is_below && are_below(&corners.collect::<Vec<_>>()).into_iter().all(|below| below)
        })
        .collect()
}

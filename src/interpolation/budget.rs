//! The error budget: who may use how much of the tolerance.
//!
//! An application's error is the sum of what its stages leave out. Each stage gets a share of the relative
//! l2 tolerance ε, or of a cut-off that was derived from it. Independent errors add as squares, so the
//! shares may add to more than 1.
//!
//! | stage | may use | of | used in |
//! |---|---|---|---|
//! | interpolation at n nodes per axis | [`INTERPOLATION_SHARE`] | ε | `operators` |
//! | each truncation, at first | [`truncation_share`] | ε | `level` |
//! | the same where derivatives count | [`SLOPE_SHARE`] | that share | `level` |
//! | derivatives, measured, level by level | 1 / [`SLOPE_WEIGHT`] | what values may | `operators`, `check` |
//! | each truncation, if the order is given | [`ORDER_TRUNCATION_SHARE`] | interpolation's error | `operators` |
//! | the same where all that comes passes through from coarser levels | [`PASSING_SHARE`] | that share | `level` |
//! | nodes of a skeleton | [`SKELETON_SHARE`] | the basis's cut-off | `basis` |
//! | each side of a direction | [`SIDE_SHARE`] | the basis's cut-off | `ranges` |
//! | single precision in M2L | [`ROUNDING_SHARE`] | the basis's cut-off | `directions` |
//! | a level as built, measured | [`ACCEPTED_SHARE`], [`ACCEPTED_LEVEL_SHARE`] | ε of the level | `operators`, `level` |
//! | all levels, measured | [`SAFE_SHARE`], [`LIMITING_SHARE`] | ε | `operators` |
//! | one pair of the near field | [`PAIR_SHARE`] | ε | `expansion` |
//! | a far field that has died out | [`NEIGHBOUR_SHARE`] | the neighbours' fields | `far_field` |
//! | a level that serves fewer than [`FEW`] cells, but more than [`ONE`] | 1 / [`SPARE`] | ε of whole sums | `scale` |
//! | operators that are kept for other points | 1 / [`KEPT`] to all | ε of whole sums | `scale`, `kept` |
//! | sizes that operators are shared for | 2 to the power of [`ROUNDED_UP`] | ε of whole sums | `scale` |
//!
//! The numbers were found by trial on 1/r, 1/r⁴, Yukawa's kernel and the radiosity tensor at tolerances of
//! 1e-2 to 1e-11: with them, delivered errors lie between a thirtieth and all of what was asked
//! (`benches/charts/contract.txt`).

/// The share of the tolerance that interpolation alone may use.
pub(crate) const INTERPOLATION_SHARE: f64 = 0.25;

/// What is left of the share of a truncation where derivatives have to be accurate too: functions of high
/// degree are steep.
pub(crate) const SLOPE_SHARE: f64 = 0.3;

/// What is left of the share of a truncation at levels that carry no pairs of their own, between which errors could
/// be measured.
pub(crate) const PASSING_SHARE: f64 = 0.25;

/// How much the error of derivatives counts where every level has operators of its own: what a cell drops of
/// the fields of those above it is not measured then, and is steep.
pub(crate) const SLOPE_WEIGHT: f64 = 2.0;

/// With a given order, the share of interpolation's own error that truncation may add.
pub(crate) const ORDER_TRUNCATION_SHARE: f64 = 0.03;

/// The share of a basis's cut-off that its skeleton may leave out.
pub(crate) const SKELETON_SHARE: f64 = 0.05;

/// The share of a basis's cut-off that each of the two sides of a direction may leave out.
pub(crate) const SIDE_SHARE: f64 = 2.0;

/// The relative error of products in single precision, root mean square.
pub(crate) const SINGLE_ROUNDING: f64 = 4e-8;

/// The share of a basis's cut-off that rounding to single precision may add.
pub(crate) const ROUNDING_SHARE: f64 = 1.0;

/// The share of its tolerance that a level's error, measured between sample points, may reach if one
/// level's operators serve all.
pub(crate) const ACCEPTED_SHARE: f64 = 0.4;

/// The same if every level has operators of its own, among which the tolerance is divided.
pub(crate) const ACCEPTED_LEVEL_SHARE: f64 = 0.5;

/// The share of the tolerance that the measured error of all levels may reach before a higher order is
/// tried.
pub(crate) const SAFE_SHARE: f64 = 0.8;

/// The share of the tolerance below which interpolation has no part in an error, so that a higher order
/// would not help.
pub(crate) const LIMITING_SHARE: f64 = 0.1;

/// The share of the tolerance that one pair of the near field may be off by.
pub(crate) const PAIR_SHARE: f64 = 0.1;

/// A far field smaller than this fraction of what neighbouring cells exchange is held to that fraction, not
/// to its own size: a kernel that has died out needs no digits.
pub(crate) const NEIGHBOUR_SHARE: f64 = 0.1;

/// Where fewer cells than these share a field, they may all be among the nearest, whose errors are then measured
/// by themselves; and with no more than one, all points may be in corners.
pub(crate) const FEW: f64 = 4.5;
pub(crate) const ONE: f64 = 1.5;

/// By how much smaller errors have to be with few cells; with one, those between corners are measured.
pub(crate) const SPARE: f64 = 3.0;

/// By which power of two sizes that errors are relative to may be rounded up.
pub(crate) const ROUNDED_UP: f64 = 0.25;

/// By how much more exact than they need be operators may be that are kept for points that have moved.
pub(crate) const KEPT: f64 = 4.0;

/// The share of the tolerance that each truncation may use at first.
///
/// It is such that all truncations together are found to make the error that is accepted: a little less for
/// every digit, and less for far fields that are not sampled eight times over by their reflections.
pub(crate) fn truncation_share(tolerance: f64, reflected: bool) -> f64 {
    (0.11 + 0.002 * tolerance.log10()) * if reflected { 1.0 } else { 0.6 }
}

//! The tuned constants of interpolation that are not shares of the tolerance.
//!
//! Times and block sizes were measured on two cores of one AVX-512 machine with 1/r at 1e5 points.
//! Sample sizes are the smallest at which the measured errors of the contract's kernels no longer changed
//! in their first digit.

/// The largest number of nodes per axis.
pub const MAX_ORDER: usize = 16;

/// How many orders more than interpolation alone seems to need are tried.
pub(crate) const MORE_ORDERS: usize = 2;

/// The share of the pairs of cells that has to be smooth enough for any to be expanded.
pub(crate) const SMOOTH_SHARE: f64 = 0.1;

/// No more nodes are taken once this share of the pairs is smooth enough that would be with the most.
pub(crate) const WORTH_A_NODE: f64 = 0.9;

/// A smooth kernel's errors fall at least to this with a node more.
pub(crate) const CONVERGING: f64 = 0.75;

/// What is little is left out if this share of a level's pairs is.
pub(crate) const WORTH_LEAVING: f64 = 0.5;

/// By how much the error of one source may be larger than the mean over cells, at its worst.
pub(crate) const CLOSER: f64 = 32.0;

/// What is in the way at a smaller share of the pairs is a matter of luck to samples: then nothing is expanded.
pub(crate) const UNEVEN_SHARE: f64 = 0.1;

/// How often the cut-offs of a level are chosen anew.
pub(crate) const ATTEMPTS: usize = 3;

/// How many of them are foretold: the first is seldom the last.
pub(crate) const FORETOLD_ATTEMPTS: f64 = 2.0;

/// Cut-offs are not chosen anew where that left more than this of an error: it is not theirs.
pub(crate) const TIGHTENED: f64 = 0.9;

/// How many bytes of operators the process remembers.
pub(crate) const STORE_BYTES: usize = 1 << 29;

/// How far away the sources of a homogeneous kernel are sampled along an axis, in half-widths.
pub(crate) const SAMPLED_REACH: f64 = 256.0;

/// How many times the samples are taken of a far field that does not fall into parities.
pub(crate) const WHOLE_DENSITY: usize = 2;

/// Sample sources per offset, and in cells within two, whose fields differ most from place to place.
pub(crate) const PER_OFFSET: usize = 3;
pub(crate) const PER_NEAR_OFFSET: usize = 12;

/// Sample sources in each shell beyond the interaction list.
pub(crate) const PER_SHELL: usize = 48;

/// How much more a shell counts than one offset: about as much as all of them. For a kernel that does
/// not decay, most of the sum comes from there, through the levels above.
pub(crate) const SHELL_WEIGHT: f64 = 300.0;

/// Sample targets in the cell at which the order is tested.
pub(crate) const TEST_TARGETS: usize = 48;

/// Pairs of points on each level at which a kernel of positions is tested.
pub(crate) const PLACED_PAIRS: usize = 256;

/// Sample sources whose fields are interpolated together.
pub(crate) const TEST_SOURCES: usize = 16;

/// Sample pairs per question that is asked of a kernel.
pub(crate) const PROBE_PAIRS: usize = 12;

/// Sample pairs at which entries are held against each other.
pub(crate) const BALANCED_PAIRS: usize = 32;

/// By how many binary orders rows, or columns, have to differ to be weighted: by more than units of like size make them.
pub(crate) const BALANCED_RANGE: f64 = 5.0;

/// By how much the sizes of fields or densities have to differ at a level to be weighted there.
pub(crate) const LIGHTER: f64 = 4.0;

/// How often rows are brought to one size, and columns.
pub(crate) const BALANCE_STEPS: usize = 16;

/// Sample pairs at which a kernel has to be homogeneous.
pub(crate) const SCALED_PAIRS: usize = 4096;

/// Random points per cell at which a level's operators are checked.
pub(crate) const CHECK_POINTS: usize = 32;

/// How many levels of children are checked between corners: a cluster in a corner goes through all of them.
pub(crate) const CORNER_LEVELS: usize = 4;

/// How many levels of children are checked for derivatives: what a small cell drops of the field of a large
/// one is steep there.
pub(crate) const SLOPE_LEVELS: usize = 3;

/// Larger offsets, which only masks ask for, add nothing to the ranges of their directions: their fields
/// are combinations of the nearer ones.
pub(crate) const RANGE_REACH: i32 = 5;

/// Random vectors beyond the number of columns that they are to find. With fewer, it is a matter of luck
/// whether what only a few rows hold is found.
pub(crate) const MORE_VECTORS: usize = 16;

/// Bytes of M2L matrices for offsets that only masks ask for, at most. Further offsets are applied through
/// the kernel, which takes some fifty times as long.
pub(crate) const EXTENDED_BYTES: usize = 1 << 30;

/// One evaluation of the kernel's entries costs about as much as this many pairs of a near field.
pub(crate) const ENTRY_PAIRS: usize = 4;

/// Seconds of one core for set-up, fitted to plans of seven formulas at 1e-3, 1e-6 and 1e-9 on one AVX-512 machine: for an
/// entry, so many pairs of a near field to evaluate it, and so much to move, transform and compare it; and a multiply-add
/// of factorisations and products, as they are counted. They took .85 to 1.55 times what is counted so.
pub(crate) const SET_UP_PAIRS: f64 = 2.5;
pub(crate) const SET_UP_ENTRY: f64 = 1.4e-8;
pub(crate) const SET_UP_PRODUCT: f64 = 1.7e-10;

/// The share of set-up that may go into finding out how much it takes.
pub(crate) const PROBING_SHARE: f64 = 0.125;

/// M2L works in single precision up to this number of digits.
pub(crate) const SINGLE_DIGITS: f64 = 7.0;

/// Seconds to read or write one number in a core's cache.
pub(crate) const MOVE_SECONDS: f64 = 1.5e-10;

/// Seconds to find the matrix of a pair of cells and to put the pair in order.
pub(crate) const SORT_SECONDS: f64 = 2.8e-8;

/// Seconds that P2M, M2M, L2L and L2P take for any cell, beyond their products.
pub(crate) const CELL_SECONDS: f64 = 1.5e-6;

/// The share of M2L's rate that the products of the other operators reach.
pub(crate) const OTHER_SHARE: f64 = 0.3;

/// Source cells whose coordinates in a direction are computed together.
pub(crate) const EXCHANGE_BLOCK: usize = 128;

/// Cells that are shifted together: enough to make a product worth while, few enough for a cache.
pub(crate) const SHIFTED_TOGETHER: usize = 96;

/// Points whose products T̂_j(y) T̂_k(z) are kept at once: a multiple of the lanes.
pub(crate) const POINTS_TOGETHER: usize = 32;

/// Rows of coefficients, or sums over them, that share what they are multiplied by.
pub(crate) const ROWS_TOGETHER: usize = 4;

/// Bytes of the local expansions of one task of M2L.
pub(crate) const TASK_BYTES: usize = 1 << 19;

/// Numbers per task of a sweep over all of them.
pub(crate) const SWEEP_CHUNK: usize = 1 << 14;

/// How many times the machine epsilon a value in a cell is off by rounding, as its derivatives see it: about as
/// many as there are nodes per axis.
pub(crate) const SLOPE_ROUNDING: f64 = 8.0;

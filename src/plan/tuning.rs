//! The tuned constants of plans and their applications.
//!
//! Times and sizes were measured on two cores of one AVX-512 machine with 1/r at 1e5 and 1e6 points.

/// Expansions may take this many times as long as forecast.
pub(crate) const DOUBT: f64 = 16.0;

/// A plan and its applications may take this many times as long as direct sums would.
pub(crate) const BARGAIN: f64 = 1.2;

/// Seconds of one core of set-up that are never too many. Not of all cores: their number decides nothing.
pub(crate) const SET_UP_SECONDS: f64 = 0.01;

/// Where an expansion is asked for, set-up may take so many seconds of one core, and so many direct sums.
pub(crate) const ASKED_SECONDS: f64 = 40.0;
pub(crate) const ASKED_SUMS: f64 = 20.0;

/// The relative error of direct sums, in units of rounding.
pub(crate) const DIRECT_DIGITS: f64 = 16.0;

/// Targets at which the kernel's magnitudes are sampled, at most.
pub(crate) const NORM_TARGETS: usize = 32;

/// Points at which the magnitude of a cell's field is sampled, at most.
pub(crate) const PART_POINTS: usize = 2;

/// Parts into which the near sources of a target are divided, about, if there are so many.
pub(crate) const NEAR_PARTS: usize = 1024;

/// The share of other sums that targets with next to none are held against.
pub(crate) const ISOLATED_SHARE: f64 = 1.0 / 16.0;

/// By how much more errors may add up if charges have one sign.
pub(crate) const ONE_SIGN: f64 = 2.0;

/// By how much smaller errors have to be for charges of unlike size: two points do not tell what all of a cell's
/// sources send.
pub(crate) const UNUSUAL: f64 = 4.0;

/// How many plans for charges of unlike size are kept.
pub(crate) const OTHER_PLANS: usize = 4;

/// By what factor errors may grow with charges of unlike size before an expansion is prepared for them.
pub(crate) const LIKE_SIZES: f64 = 2.0;

/// Points of either set that an expansion is shown, at most.
pub(crate) const SHOWN_POINTS: usize = 512;

/// How often a plan is applied at most to see how long that takes.
pub(crate) const APPLY_REPETITIONS: usize = 4;

/// After how many seconds a plan is no longer applied to see how long that takes.
pub(crate) const APPLY_BUDGET: f64 = 0.05;

/// How often an expansion may find that it carries fewer pairs of cells.
pub(crate) const RESTRICTIONS: usize = 4;

/// Targets at which a plan is tried, about.
pub(crate) const TRIAL_TARGETS: usize = 64;

/// How many times the pairs that it is held against a trial may sum.
pub(crate) const TRIAL_WORK: f64 = 8.0;

/// Sums may then be off by this many times what a near pair may: the tolerance of interpolation.
pub(crate) const TRIAL_PAIRS: f64 = 10.0;

/// Values per task of a check.
pub(crate) const CHECK_CHUNK: usize = 4096;

/// Cells of an interaction list in the midst of a volume: what leaf sizes are chosen for.
pub(crate) const FULL_LIST: f64 = 189.0;

/// M2P at a target costs about as much as this many pairs for each term, as does P2L of a source.
pub(crate) const TERM_PAIRS: usize = 4;

/// The share of M2L in what an expansion takes with full lists.
pub(crate) const M2L_SHARE: f64 = 2.0 / 3.0;

/// About how many tasks the leaves are cut into: enough to keep many threads evenly busy.
pub(crate) const TASKS: u64 = 1024;

/// Bytes of sources and charges that are gathered: they stay in the fastest cache while groups of
/// targets pass.
pub(crate) const GATHERED_BYTES: usize = 1 << 15;

/// Sources that a leaf is summed with before it is asked whether to stop.
pub(crate) const RUN_SOURCES: usize = 1 << 14;

/// Plans for fewer points than this are not worth a measurement.
pub(crate) const WORTHWHILE: usize = 512;

/// What is taken for a pair that has not been measured.
pub(crate) const NOMINAL_SECONDS: f64 = 1e-9;

/// The most points of a kind in one measurement: about what a leaf meets.
pub(crate) const PAIR_SAMPLE: usize = 256;

/// How long measurements of a pair go on, in seconds.
pub(crate) const PAIR_BUDGET: f64 = 1e-3;

/// How often the largest block is timed at most.
pub(crate) const PAIR_REPETITIONS: usize = 8;

/// Items per task where each takes no time.
pub(crate) const PIECE: usize = 4096;

//! What an expansion costs, so that the engine can choose.

/// What the operators of an expansion cost, and how exact the sums beside it have to be.
///
/// Everything has a default, see [`Costs::new`]. Sums are right whatever is said here; better figures make
/// them faster.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Costs {
    /// The relative error that [`Kernel::add_block`](crate::Kernel::add_block) may make in a pair of the
    /// near field; 0, the default, asks for all digits.
    pub pair_tolerance: f64,
    /// Seconds of one core that translations take for a leaf and its share of the cells above it, if
    /// its interaction list is full. The leaf size follows from it: near and far field then cost the
    /// same. By default leaves hold up to 64 points.
    pub leaf_seconds: Option<f64>,
    /// About how many terms a multipole or local expansion will have. Asked before
    /// [`prepare`](crate::Expansion::prepare), to foretell what a plan needs.
    pub terms: usize,
    /// How many pairs summed directly cost as much as M2P at one target. Cells with fewer sources are
    /// summed directly.
    pub m2p_pairs: usize,
    /// How many pairs summed directly cost as much as P2L of one source. Target cells with fewer
    /// targets are summed directly.
    pub p2l_pairs: usize,
    /// Whether [`m2l_level`](crate::Expansion::m2l_level) heeds
    /// [`LevelPairs::weight`](crate::LevelPairs::weight). By default it doesn't, and the engine asks for no
    /// weights but 1.
    pub weighs: bool,
}

impl Costs {
    /// The defaults for an expansion of so many multipole and local terms per cell.
    pub fn new(multipole_terms: usize, local_terms: usize) -> Self {
        Self {
            pair_tolerance: 0.0,
            leaf_seconds: None,
            terms: multipole_terms,
            m2p_pairs: multipole_terms,
            p2l_pairs: local_terms,
            weighs: false,
        }
    }

    /// How many points a leaf may hold if a pair summed directly takes `pair_seconds` of one core.
    ///
    /// A cell of s points is worth splitting into eight when 27 s² pairs take longer than 27 s²/8 pairs
    /// and the translations for eight leaves.
    pub fn leaf_size(&self, pair_seconds: f64) -> usize {
        let Some(leaf_seconds) = self.leaf_seconds else { return DEFAULT_LEAF_SIZE };
        let largest = (8.0 * leaf_seconds / (27.0 * pair_seconds)).sqrt();
        (largest as usize).clamp(SMALLEST_LEAF_SIZE, LARGEST_LEAF_SIZE)
    }
}

/// Points of a leaf where nothing is known of costs.
const DEFAULT_LEAF_SIZE: usize = 64;
/// The least and the most that follow from costs.
const SMALLEST_LEAF_SIZE: usize = 16;
const LARGEST_LEAF_SIZE: usize = 2048;

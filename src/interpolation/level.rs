//! The operators of one level: bases and M2L matrices as small as the tolerance allows, and proof of it.

use std::sync::Arc;

use crate::error::Error;
use crate::interpolation::bases::Bases;
use crate::interpolation::basis::Spectrum;
use crate::interpolation::budget::{PASSING_SHARE, SLOPE_SHARE, truncation_share};
use crate::interpolation::chebyshev::Chebyshev;
use crate::interpolation::entries::Entries;
use crate::interpolation::far_field::FarField;
use crate::interpolation::means::INTERACTION_OFFSETS;
use crate::interpolation::probe::{self, Parities};
use crate::interpolation::scale::Scale;
use crate::interpolation::slopes::Slopes;
use crate::interpolation::transfer::Transfers;
use crate::interpolation::tuning::{ATTEMPTS, CHECK_POINTS};
use crate::numbers::traits::Scalar;

/// Operators between cells of one size.
#[derive(Debug)]
pub(crate) struct LevelOperators<S: Scalar> {
    pub(crate) bases: Bases<S>,
    pub(crate) transfers: Transfers<S>,
    /// The largest relative error seen between sample points.
    pub(crate) error: f64,
}

/// What one level's operators have to do.
pub(crate) struct Request<'a, S: Scalar> {
    pub(crate) kernel: &'a Entries<'a, S>,
    pub(crate) rule: &'a Chebyshev<S::Real>,
    pub(crate) symmetric: bool,
    /// Whether cells of all sizes have the same operators.
    pub(crate) homogeneous: bool,
    pub(crate) far: &'a FarField<S::Real>,
    pub(crate) scale: Scale,
    /// Where derivatives have to be accurate too.
    pub(crate) slopes: Option<&'a Slopes<'a, S>>,
    pub(crate) tolerance: f64,
    /// The share of the tolerance that errors between sample points may reach.
    pub(crate) accepted: f64,
}

impl<S: Scalar> Request<'_, S> {
    /// Bases and M2L matrices, with the cut-offs tightened until sample pairs are accurate enough.
    pub(crate) fn build(&self) -> Result<LevelOperators<S>, Error> {
        let half_width = self.far.half_width();
        let parities = probe::parities(self.kernel, half_width);
        let spectrum = |kernel: &Entries<'_, S>, of: fn(&Parities) -> &[u8]| {
            let parities = parities.as_ref().map(of);
            Spectrum::new(kernel, parities, self.far, self.rule, self.scale)
        };
        let targets = spectrum(self.kernel, |p| &p.fields)?;
        // A basis serves both sides only if its functions have the same signs on both: dx·dy is symmetric, but
        // its field is odd and its density even, or the other way round.
        let alike = parities.as_ref().is_none_or(|p| p.fields == p.densities);
        let sources = if self.symmetric && alike {
            None
        } else {
            Some(spectrum(&self.kernel.transpose(), |p| &p.densities)?)
        };
        let offsets = self.far.carried().offsets();
        let mut share = truncation_share(self.tolerance, parities.is_some());
        if self.slopes.is_some() {
            share *= SLOPE_SHARE;
        }
        // What only passes through is not checked.
        if offsets.is_empty() {
            share *= PASSING_SHARE;
        }
        let mut attempt = 0;
        loop {
            let cut = share * self.tolerance * self.scale.size;
            let rank = targets.rank(cut);
            let [evaluations, multiply_adds] =
                operator_costs(self.kernel, self.rule.len(), rank, parities.is_some());
            // The first attempt is seldom the last.
            let attempts = if attempt == 0 { 2.0 } else { 1.0 };
            self.kernel.afford(attempts * evaluations, attempts * multiply_adds)?;
            self.kernel.spend(multiply_adds)?;
            let target = Arc::new(targets.basis(cut, self.rule));
            let source = match &sources {
                Some(sources) => Arc::new(sources.basis(cut, self.rule)),
                None => Arc::clone(&target),
            };
            let reflected = parities.is_some();
            let bases = Bases { half_width, source, target, reflected, cut };
            let transfers = Transfers::new(self.kernel, &bases, &offsets);
            let mut level = LevelOperators { bases, transfers, error: f64::INFINITY };
            level.error = self.check(&level).mean;
            let accepted = self.accepted * self.tolerance;
            attempt += 1;
            if level.error <= accepted || attempt == ATTEMPTS {
                return Ok(level);
            }
            share *= (0.9 * accepted / level.error).clamp(0.2, 0.75);
        }
    }
}

/// The evaluations and multiply-adds that turn a basis of so many functions into operators, and check them.
pub(crate) fn operator_costs<S: Scalar>(
    kernel: &Entries<'_, S>,
    n: usize,
    rank: usize,
    reflected: bool,
) -> [f64; 2] {
    let Entries { fields, densities, .. } = *kernel;
    let (rank, nodes) = (rank as f64, (n.pow(3) * fields) as f64);
    let images = if reflected { 56.0 } else { INTERACTION_OFFSETS as f64 };
    let checked = (INTERACTION_OFFSETS * CHECK_POINTS * CHECK_POINTS) as f64;
    let evaluations = images * (rank / fields as f64).powi(2) + checked;
    let skeleton = 2.0 * rank * rank * nodes;
    // Sketches and cores of all directions.
    let transfers = 2.0 / 3.0 * images * rank.powi(3);
    let sums = (INTERACTION_OFFSETS * CHECK_POINTS * densities) as f64 * rank * rank / 4.0;
    [evaluations, skeleton + transfers + sums]
}

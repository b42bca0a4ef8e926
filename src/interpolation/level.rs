//! The operators of one level: bases and M2L matrices as small as the tolerance allows, and proof of it.

use std::sync::Arc;

use crate::error::Error;
use crate::interpolation::bases::Bases;
use crate::interpolation::basis::Spectrum;
use crate::interpolation::budget::{PASSING_SHARE, SLOPE_SHARE, truncation_share};
use crate::interpolation::chebyshev::Chebyshev;
use crate::interpolation::entries::Entries;
use crate::interpolation::far_field::FarField;
use crate::interpolation::hashing::Digest;
use crate::interpolation::means::INTERACTION_OFFSETS;
use crate::interpolation::probe::{self, Parities};
use crate::interpolation::scale::Scale;
use crate::interpolation::slopes::Slopes;
use crate::interpolation::transfer::Transfers;
use crate::interpolation::tuning::{ATTEMPTS, CHECK_POINTS, FORETOLD_ATTEMPTS, TIGHTENED};
use crate::numbers::traits::Scalar;
use crate::parallel;

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
    /// Whether it has to be known which values the operators were made from.
    pub(crate) digested: bool,
}

/// The operators of a level, and the values of the kernel that they were made from, if these have to be known.
pub(crate) struct Built<S: Scalar> {
    pub(crate) operators: LevelOperators<S>,
    pub(crate) digest: Digest,
}

/// The operators of some levels, with cut-offs tightened until sample pairs of all levels together are accurate
/// enough: the squares of their errors add up, so that one level may err more where others err less.
///
/// # Errors
/// What can't be afforded.
pub(crate) fn build_levels<S: Scalar>(requests: &[Request<'_, S>]) -> Result<Vec<Built<S>>, Error> {
    let spectra = parallel::map(requests.len(), &|k| requests[k].spectra());
    let spectra: Vec<Spectra<S>> = spectra.into_iter().collect::<Result<_, _>>()?;
    // What all levels take is known before any is built.
    let mut needed = [0.0; 2];
    for (request, spectra) in requests.iter().zip(&spectra) {
        let costs = request.costs(spectra, request.cut(request.first_share(spectra)));
        needed = [0, 1].map(|k| needed[k] + FORETOLD_ATTEMPTS * costs[k]);
    }
    if let Some(request) = requests.first() {
        request.kernel.afford(needed[0], needed[1])?;
    }
    let first = parallel::map(requests.len(), &|k| {
        let (request, spectra) = (&requests[k], &spectra[k]);
        request.operators(spectra, request.first_share(spectra), FORETOLD_ATTEMPTS)
    });
    let first = requests.iter().zip(spectra).zip(first);
    let first =
        first.map(|((request, spectra), built)| Ok(Attempt::first(request, spectra, built?)));
    let mut attempts: Vec<Attempt<'_, S>> = first.collect::<Result<_, Error>>()?;
    let accepted: f64 = requests.iter().map(|request| request.accepted_error().powi(2)).sum();
    for _ in 1..ATTEMPTS {
        let squares = attempts.iter().map(|attempt| attempt.built.operators.error.powi(2));
        if squares.sum::<f64>() <= accepted {
            break;
        }
        let next = parallel::map(attempts.len(), &|k| attempts[k].tightened());
        for (attempt, next) in attempts.iter_mut().zip(next) {
            if let Some((share, built)) = next? {
                attempt.take(share, built);
            }
        }
    }
    Ok(attempts.into_iter().map(|attempt| attempt.built).collect())
}

/// The operators of a level with one choice of its cut-offs.
struct Attempt<'a, S: Scalar> {
    request: &'a Request<'a, S>,
    /// None once they are not needed any more, since they are large: the level's own error is accepted, or has other
    /// causes than truncations.
    spectra: Option<Spectra<S>>,
    /// The share of the tolerance that truncations have.
    share: f64,
    built: Built<S>,
}

impl<'a, S: Scalar> Attempt<'a, S> {
    fn first(request: &'a Request<'a, S>, spectra: Spectra<S>, built: Built<S>) -> Self {
        let share = request.first_share(&spectra);
        let spectra = (built.operators.error > request.accepted_error()).then_some(spectra);
        Self { request, spectra, share, built }
    }

    /// A smaller share and what comes of it; none if that would bring nothing.
    fn tightened(&self) -> Result<Option<(f64, Built<S>)>, Error> {
        let Some(spectra) = &self.spectra else { return Ok(None) };
        let excess = self.built.operators.error / self.request.accepted_error();
        let share = self.share * (0.9 / excess).clamp(0.2, 0.75);
        Ok(Some((share, self.request.operators(spectra, share, 1.0)?)))
    }

    fn take(&mut self, share: f64, built: Built<S>) {
        let error = built.operators.error;
        let is_truncation = error <= TIGHTENED * self.built.operators.error;
        if error <= self.request.accepted_error() || !is_truncation {
            self.spectra = None;
        }
        (self.share, self.built) = (share, built);
    }
}

/// What the bases of a level are cut from.
struct Spectra<S: Scalar> {
    targets: Spectrum<S>,
    /// None if they are those of the targets.
    sources: Option<Spectrum<S>>,
    reflected: bool,
    /// The values that those of the targets are made from.
    digest: Digest,
}

impl<S: Scalar> Request<'_, S> {
    /// The error between sample points that the level may have if all others have theirs.
    fn accepted_error(&self) -> f64 {
        self.accepted * self.tolerance
    }

    fn spectra(&self) -> Result<Spectra<S>, Error> {
        let parities = probe::parities(self.kernel, self.far.half_width());
        let scale = Scale { slopes: self.slopes.is_some(), ..self.scale };
        let spectrum = |kernel: &Entries<'_, S>, of: fn(&Parities) -> &[u8]| {
            let parities = parities.as_ref().map(of);
            Spectrum::new(kernel, parities, self.far, self.rule, scale)
        };
        let digest = Digest::default();
        let digested = self.kernel.digested_by(self.digested.then_some(&digest));
        let targets = spectrum(&digested, |p| &p.fields)?;
        // A basis serves both sides only if its functions have the same signs on both: dx·dy is symmetric, but
        // its field is odd and its density even, or the other way round.
        let alike = parities.as_ref().is_none_or(|p| p.fields == p.densities);
        let sources = if self.symmetric && alike {
            None
        } else {
            Some(spectrum(&self.kernel.transpose(), |p| &p.densities)?)
        };
        Ok(Spectra { targets, sources, reflected: parities.is_some(), digest })
    }

    /// The share of the tolerance that truncations have at first.
    fn first_share(&self, spectra: &Spectra<S>) -> f64 {
        let mut share = truncation_share(self.tolerance, spectra.reflected);
        if self.slopes.is_some() {
            share *= SLOPE_SHARE;
        }
        // What only passes through is not checked.
        if self.far.carried().offsets().is_empty() {
            share *= PASSING_SHARE;
        }
        share
    }

    /// What is cut off if truncations have that share of the tolerance.
    fn cut(&self, share: f64) -> f64 {
        share * self.tolerance * self.scale.size
    }

    /// The evaluations and multiply-adds that operators take.
    fn costs(&self, spectra: &Spectra<S>, cut: f64) -> [f64; 2] {
        operator_costs(self.kernel, self.rule.len(), spectra.targets.rank(cut), spectra.reflected)
    }

    /// Bases and M2L matrices, if so many times their costs can be afforded.
    fn operators(&self, spectra: &Spectra<S>, share: f64, times: f64) -> Result<Built<S>, Error> {
        let cut = self.cut(share);
        let [evaluations, multiply_adds] = self.costs(spectra, cut);
        self.kernel.afford(times * evaluations, times * multiply_adds)?;
        self.kernel.spend(multiply_adds)?;
        let target = Arc::new(spectra.targets.basis(cut, self.rule));
        let source = match &spectra.sources {
            Some(sources) => Arc::new(sources.basis(cut, self.rule)),
            None => Arc::clone(&target),
        };
        let (half_width, reflected) = (self.far.half_width(), spectra.reflected);
        let bases = Bases { half_width, source, target, reflected, cut };
        let digest = Digest::default();
        digest.join(&spectra.digest);
        let kernel = self.kernel.digested_by(self.digested.then_some(&digest));
        let transfers = Transfers::new(&kernel, &bases, &self.far.carried().offsets());
        let mut operators = LevelOperators { bases, transfers, error: f64::INFINITY };
        operators.error = self.check(&operators).mean;
        Ok(Built { operators, digest })
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

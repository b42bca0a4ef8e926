//! From a tolerance to operators: order, bases, M2L matrices and shifts, for the levels that occur.

use std::sync::Arc;

use num_traits::Float;
use rayon::prelude::*;

use crate::chebyshev::{Chebyshev, contract};
use crate::dense::Matrix;
use crate::error::Error;
use crate::interpolation::MAX_ORDER;
use crate::interpolation::basis::{Basis, Spectrum, adjoint, product};
use crate::interpolation::far_field::{FarField, interaction_offsets, weight};
use crate::interpolation::transfer::Transfers;
use crate::probe::{self, Formula, Parities, sample, zero};
use crate::real::{Additive, Point, Real, Scalar, Vector};

/// What decides how much is kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Accuracy {
    /// The relative l2 error to stay below.
    Tolerance(f64),
    /// The number of nodes per axis; everything else is as accurate as it makes sense.
    Order(usize),
}

/// The operators of a translation-invariant kernel.
#[derive(Debug)]
pub(crate) struct Operators<S: Scalar> {
    pub(crate) rule: Chebyshev<S::Real>,
    /// The largest relative error seen between sample points.
    pub(crate) error: f64,
    /// Level by level from the coarsest; one for all if the kernel is homogeneous.
    pub(crate) levels: Vec<LevelOperators<S>>,
    /// From each level to the next finer one; one for all if the kernel is homogeneous.
    pub(crate) shifts: Vec<Shifts<S>>,
}

/// Operators between cells of one size.
#[derive(Debug)]
pub(crate) struct LevelOperators<S: Scalar> {
    pub(crate) half_width: S::Real,
    pub(crate) source: Arc<Basis<S>>,
    pub(crate) target: Arc<Basis<S>>,
    pub(crate) transfers: Transfers<S>,
    /// What M2L matrices may leave out.
    pub(crate) cut: f64,
    pub(crate) reflected: bool,
}

/// M2M and L2L between a cell and its eight children, or the first of them if the others follow by
/// reflection.
#[derive(Debug)]
pub(crate) struct Shifts<S> {
    pub(crate) m2m: Vec<Matrix<S>>,
    pub(crate) l2l: Vec<Matrix<S>>,
}

/// Cell sizes: levels for a kernel that depends on scale, one for a homogeneous kernel.
pub(crate) struct Sizes<T> {
    pub(crate) half_widths: Vec<T>,
    /// How far sources may be, in half-widths.
    pub(crate) extent: f64,
}

/// The share of the tolerance that interpolation, and then each truncation, may use up.
const SHARE: f64 = 0.25;

/// The share of the tolerance that errors between sample points may reach.
const ACCEPTED: f64 = 0.4;

/// With a given order, the share of its error that truncation may add.
const ORDER_SHARE: f64 = 0.1;

/// Random points per cell, and pairs of them per offset, between which errors are measured.
const TEST_POINTS: usize = 48;
const PAIRS_PER_OFFSET: usize = 8;

/// How often cut-offs are tightened before giving up.
const ATTEMPTS: usize = 4;

impl Accuracy {
    pub(crate) fn check(self) -> Result<(), Error> {
        match self {
            Self::Order(found) if found == 0 || found > MAX_ORDER => {
                Err(Error::InvalidOrder { min: 1, max: MAX_ORDER, found })
            }
            Self::Tolerance(found) if !(found > 0.0 && found < 1.0) => {
                Err(Error::InvalidTolerance { found })
            }
            _ => Ok(()),
        }
    }
}

impl<S: Scalar> Operators<S> {
    pub(crate) fn new(
        kernel: &Formula<'_, S>,
        accuracy: Accuracy,
        sizes: &Sizes<S::Real>,
    ) -> Result<Self, Error> {
        let fields: Vec<FarField<S::Real>> =
            sizes.half_widths.iter().map(|&h| FarField::new(h, sizes.extent)).collect();
        let scales = scales(kernel, sizes, &fields)?;
        let first = sizes.half_widths.first().copied().unwrap_or(S::Real::from_f64(1.0));
        let symmetric = probe::symmetric(kernel, first);
        let mut sides = vec![(kernel.transpose(), 0)];
        if !symmetric {
            sides.push((kernel.transpose().transpose(), 1));
        }
        let worst = |rule: &Chebyshev<S::Real>| {
            let mut worst = 0.0f64;
            for (far, &scale) in fields.iter().zip(&scales) {
                for (side, _) in &sides {
                    worst = worst.max(far.interpolation_error(side, rule, scale));
                }
            }
            worst
        };
        let floor = 16.0 * <S::Real as Float>::epsilon().as_f64();
        let (rule, tolerance) = match accuracy {
            Accuracy::Order(order) => {
                let rule = Chebyshev::new(order);
                let error = worst(&rule);
                (rule, (ORDER_SHARE * error / SHARE).max(floor))
            }
            Accuracy::Tolerance(requested) => {
                let mut reachable = f64::INFINITY;
                let rule = (1..=MAX_ORDER).map(Chebyshev::new).find(|rule| {
                    let error = worst(rule);
                    reachable = reachable.min(error / SHARE);
                    error <= SHARE * requested
                });
                let rule = rule.ok_or(Error::UnreachableTolerance { requested, reachable })?;
                (rule, requested)
            }
        };

        let accepted = match accuracy {
            Accuracy::Tolerance(_) => ACCEPTED,
            Accuracy::Order(_) => f64::INFINITY,
        };
        // What a level leaves out is passed on to all levels above and below it.
        let passed_on = (fields.len() as f64).sqrt();
        let built: Vec<(LevelOperators<S>, f64)> = fields
            .par_iter()
            .zip(&scales)
            .map(|(far, &scale)| {
                let (half_width, tolerance) = (far.half_width(), tolerance / passed_on);
                let rule = &rule;
                Request { kernel, rule, symmetric, half_width, scale, tolerance, accepted }
                    .level(far)
            })
            .collect::<Result<_, _>>()?;
        let error = passed_on * built.iter().map(|(_, error)| *error).fold(0.0, f64::max);
        let levels: Vec<LevelOperators<S>> = built.into_iter().map(|(level, _)| level).collect();
        if let Accuracy::Tolerance(requested) = accuracy
            && error > requested
        {
            return Err(Error::UnreachableTolerance { requested, reachable: error });
        }
        let shifts = if levels.len() == 1 {
            vec![Shifts::new(&rule, &levels[0], &levels[0])]
        } else {
            levels.windows(2).map(|pair| Shifts::new(&rule, &pair[0], &pair[1])).collect()
        };
        Ok(Self { rule, error, levels, shifts })
    }
}

/// The size of one pair that errors of each level are relative to. A level whose far field is weaker
/// than a finer one's, its greater reach included, needs fewer digits.
fn scales<S: Scalar>(
    kernel: &Formula<'_, S>,
    sizes: &Sizes<S::Real>,
    fields: &[FarField<S::Real>],
) -> Result<Vec<f64>, Error> {
    let mut scales = Vec::with_capacity(fields.len());
    for far in fields {
        let size = far.size(kernel);
        if !size.is_finite() {
            return Err(Error::NonFiniteKernel);
        }
        scales.push(size);
    }
    // The l2 norm of a far field of random charges: sources in reach grow as the cube of the size.
    let reach = |h: S::Real| h.as_f64().powf(1.5);
    let mut strongest = 0.0f64;
    for (scale, &h) in scales.iter_mut().zip(&sizes.half_widths).rev() {
        strongest = strongest.max(*scale * reach(h));
        *scale = strongest / reach(h);
    }
    Ok(scales)
}

/// What one level's operators have to do.
struct Request<'a, S: Scalar> {
    kernel: &'a Formula<'a, S>,
    rule: &'a Chebyshev<S::Real>,
    symmetric: bool,
    half_width: S::Real,
    scale: f64,
    tolerance: f64,
    /// The share of the tolerance that errors between sample points may reach.
    accepted: f64,
}

impl<S: Scalar> Request<'_, S> {
    /// Bases and M2L matrices, with the cut-offs tightened until sample pairs are accurate enough;
    /// the error that is left.
    fn level(&self, far: &FarField<S::Real>) -> Result<(LevelOperators<S>, f64), Error> {
        let parities = probe::parities(self.kernel, self.half_width);
        let spectrum = |kernel: &Formula<'_, S>, of: fn(&Parities) -> &[u8]| {
            Spectrum::new(kernel, parities.as_ref().map(of), far, self.rule, self.scale)
        };
        let targets = spectrum(self.kernel, |p| &p.fields)?;
        let sources = match self.symmetric {
            true => None,
            false => Some(spectrum(&self.kernel.transpose(), |p| &p.densities)?),
        };
        let mut share = SHARE;
        let mut attempt = 0;
        loop {
            let cut = share * self.tolerance * self.scale;
            let target = Arc::new(targets.basis(cut, self.rule));
            let source = match &sources {
                Some(sources) => Arc::new(sources.basis(cut, self.rule)),
                None => Arc::clone(&target),
            };
            let transfers = Transfers::new(
                self.kernel,
                self.half_width,
                &source,
                &target,
                parities.is_some(),
                interaction_offsets(),
                cut,
            );
            let half_width = self.half_width;
            let reflected = parities.is_some();
            let level = LevelOperators { half_width, source, target, transfers, cut, reflected };
            let error = self.error(&level);
            attempt += 1;
            if error <= self.accepted * self.tolerance || attempt == ATTEMPTS {
                return Ok((level, error));
            }
            share *= (0.9 * self.accepted * self.tolerance / error).min(0.7);
        }
    }

    /// The root mean square error of P2M, M2L and L2P together between random points, relative to
    /// the scale.
    fn error(&self, level: &LevelOperators<S>) -> f64 {
        let n = self.rule.len();
        let point = |i: usize| sample::<S::Real>(1000 + i);
        let moments = |basis: &Basis<S>, components: usize, first: usize| -> Vec<Vec<S>> {
            (0..TEST_POINTS * components)
                .into_par_iter()
                .map(|k| basis.moments_at(point(first + k / components), k % components, n))
                .collect()
        };
        let (fields, densities) = (self.kernel.fields, self.kernel.densities);
        let sources = moments(&level.source, densities, 0);
        let targets = moments(&level.target, fields, TEST_POINTS);
        let offsets: Vec<[i32; 3]> = interaction_offsets().collect();
        let errors: Vec<f64> = offsets
            .par_iter()
            .enumerate()
            .map(|(i, &offset)| {
                let step = offset.map(|o| S::Real::from_f64(2.0 * f64::from(o)));
                let step = Point::<S::Real>::from_array(step);
                let pairs = (0..PAIRS_PER_OFFSET).map(|k| {
                    // Every offset takes other pairs of points.
                    let k = i * PAIRS_PER_OFFSET + k;
                    let (a, b) = (k % TEST_POINTS, k / TEST_POINTS * 5 % TEST_POINTS);
                    let (x, y) = (point(TEST_POINTS + a) + step, point(b));
                    let exact = self.kernel.at(x * self.half_width, y * self.half_width);
                    let values = &targets[a * fields..][..fields];
                    let moments = &sources[b * densities..][..densities];
                    squared_error(&exact, &level.transfers, offset, moments, values)
                });
                weight(offset) * pairs.sum::<f64>()
            })
            .collect();
        let sum: f64 = errors.iter().sum();
        let pairs = offsets.len() * PAIRS_PER_OFFSET;
        if sum == 0.0 { 0.0 } else { (sum / pairs as f64).sqrt() / self.scale }
    }
}

/// Σ |exact − values · C moments|² over the entries of one pair.
fn squared_error<S: Scalar>(
    exact: &[S],
    transfers: &Transfers<S>,
    offset: [i32; 3],
    moments: &[Vec<S>],
    values: &[Vec<S>],
) -> f64 {
    let mut errors = 0.0;
    for (density, m) in moments.iter().enumerate() {
        let mut local = vec![zero::<S>(); values[0].len()];
        transfers.add(offset, S::Real::from_f64(1.0), m, &mut local);
        for (field, values) in values.iter().enumerate() {
            let found = values.iter().zip(&local).fold(zero::<S>(), |sum, (&t, &l)| sum + t * l);
            errors += Additive::norm_squared(&(found - exact[field * moments.len() + density]));
        }
    }
    errors
}

impl<S: Scalar> LevelOperators<S> {
    /// Transfers that know these offsets as well.
    pub(crate) fn extended(&self, kernel: &Formula<'_, S>, offsets: &[[i32; 3]]) -> Transfers<S> {
        let Self { half_width, source, target, transfers, cut, .. } = self;
        transfers.extended(kernel, *half_width, source, target, offsets, *cut)
    }
}

impl<S: Scalar> Shifts<S> {
    fn new(
        rule: &Chebyshev<S::Real>,
        parent: &LevelOperators<S>,
        child: &LevelOperators<S>,
    ) -> Self {
        let octants = if parent.reflected && child.reflected { 0..1 } else { 0..8 };
        let m2m = |octant| {
            // m_parent = V_parentᵀ A conj(V_child) m_child
            let moments = child.source.functions.map(S::conjugate);
            let moments = shift(rule, octant, false, &moments);
            product(&parent.source.functions.transpose(), &moments)
        };
        let l2l = |octant| {
            // l_child = U_childᴴ Aᵀ U_parent l_parent
            let fields = shift(rule, octant, true, &parent.target.functions);
            product(&adjoint(&child.target.functions), &fields)
        };
        Self { m2m: octants.clone().map(m2m).collect(), l2l: octants.map(l2l).collect() }
    }
}

/// Applies the matrices of an octant's halves, or their transposes, to every component of every
/// column: moments of the child to those of the parent, or a field of the parent to that of the child.
fn shift<S: Scalar>(
    rule: &Chebyshev<S::Real>,
    octant: usize,
    transposed: bool,
    columns: &Matrix<S>,
) -> Matrix<S> {
    let mut shifted = columns.clone();
    shift_in_place(rule, octant, transposed, &mut shifted.data);
    shifted
}

/// [`shift`] for arrays of n³ coefficients one after the other.
pub(crate) fn shift_in_place<S: Scalar>(
    rule: &Chebyshev<S::Real>,
    octant: usize,
    transposed: bool,
    arrays: &mut [S],
) {
    let n = rule.len();
    let mut from = vec![zero::<S>(); arrays.len()];
    for (axis, inner) in [n * n, n, 1].into_iter().enumerate() {
        from.copy_from_slice(arrays);
        arrays.fill(zero::<S>());
        contract(rule.half(octant >> axis & 1), transposed, n, inner, &from, arrays);
    }
}

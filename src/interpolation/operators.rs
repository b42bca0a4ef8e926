//! From a tolerance to operators: order, bases, M2L matrices and shifts, for the levels that occur.

use std::sync::Arc;

use num_traits::Float;

use crate::error::Error;
use crate::expansion::weights::{Weights, weigh};
use crate::interpolation::accuracy::Accuracy;
use crate::interpolation::basis::{adjoint, product, spectrum_costs};
use crate::interpolation::budget::{
    ACCEPTED_LEVEL_SHARE, ACCEPTED_SHARE, INTERPOLATION_SHARE, LIMITING_SHARE,
    ORDER_TRUNCATION_SHARE, SAFE_SHARE, SLOPE_WEIGHT,
};
use crate::interpolation::carried::Carried;
use crate::interpolation::chebyshev::Chebyshev;
use crate::interpolation::cost;
use crate::interpolation::entries::Entries;
use crate::interpolation::far_field::FarField;
use crate::interpolation::hashing::Digest;
use crate::interpolation::level::{LevelOperators, Request, build_levels, operator_costs};
use crate::interpolation::means::largest;
use crate::interpolation::offset_errors::{OffsetErrors, test_costs};
use crate::interpolation::order::{Refusal, order_of};
use crate::interpolation::probe;
use crate::interpolation::scale::Scale;
use crate::interpolation::slopes::Slopes;
use crate::interpolation::tuning::{FORETOLD_ATTEMPTS, MAX_ORDER, MORE_ORDERS, WHOLE_DENSITY};
use crate::linalg::matrix::Matrix;
use crate::numbers::traits::{Real, Scalar};
use crate::parallel;

/// The operators of a translation-invariant kernel.
#[derive(Debug)]
pub(crate) struct Operators<S: Scalar> {
    pub(crate) rule: Chebyshev<S::Real>,
    /// The largest relative error seen between sample points.
    pub(crate) error: f64,
    /// Level by level from the coarsest; one for all if the kernel is homogeneous.
    pub(crate) levels: Vec<Arc<LevelOperators<S>>>,
    /// From each level to the next finer one; one for all if the kernel is homogeneous.
    pub(crate) shifts: Vec<Shifts<S>>,
}

/// M2M and L2L between a cell and its eight children, or the first of them if the others follow by
/// reflection.
#[derive(Debug)]
pub(crate) struct Shifts<S> {
    pub(crate) m2m: Vec<Matrix<S>>,
    pub(crate) l2l: Vec<Matrix<S>>,
}

/// Cell sizes: levels for a kernel that depends on scale, one for a homogeneous kernel.
#[derive(Clone)]
pub(crate) struct Sizes<T> {
    pub(crate) half_widths: Vec<T>,
    /// Whether cells of all sizes have the same operators.
    pub(crate) homogeneous: bool,
    /// How far along an axis sources may be from a cell's centre on each level, in half-widths.
    pub(crate) reaches: Vec<f64>,
    /// What errors of values are relative to.
    pub(crate) scales: Vec<Scale>,
    /// Likewise of derivatives in half-widths, where they have to be accurate too.
    pub(crate) slope_scales: Vec<Scale>,
    /// What is carried on each level.
    pub(crate) carried: Vec<Carried>,
    /// What the kernel's rows and columns are multiplied by on each level.
    pub(crate) weights: Vec<Weights>,
}

/// Levels that need no operators of their own any more.
pub(crate) struct Kept<S: Scalar> {
    /// Nodes per axis, which all levels have in common.
    pub(crate) order: usize,
    /// By level, with how many times as large errors are as they were measured; none where there are none that serve.
    pub(crate) levels: Vec<Option<(Arc<LevelOperators<S>>, f64)>>,
}

impl<T: Real> Sizes<T> {
    /// The far field on a level; without parities it is sampled more densely.
    pub(crate) fn far_field(&self, level: usize, reflected: bool) -> FarField<T> {
        self.sampled(level, if reflected { 1 } else { WHOLE_DENSITY })
    }

    /// The same without samples of what comes from there.
    pub(crate) fn offsets(&self, level: usize) -> FarField<T> {
        self.sampled(level, 0)
    }

    fn sampled(&self, level: usize, density: usize) -> FarField<T> {
        let carried = self.carried[level].clone();
        FarField::new(self.half_widths[level], self.reaches[level], density, carried)
    }
}

impl<S: Scalar> Kept<S> {
    /// How many levels there are still to be made.
    pub(crate) fn missing(&self) -> usize {
        self.levels.iter().filter(|level| level.is_none()).count()
    }
}

impl<S: Scalar> Operators<S> {
    /// For all levels, but for those that are kept, if there are any; with the values of the kernel that new ones were made
    /// from, if they are to be `digested`.
    pub(crate) fn new(
        kernel: &Entries<'_, S>,
        slopes: Option<&Entries<'_, S>>,
        accuracy: Accuracy,
        sizes: &Sizes<S::Real>,
        kept: Option<&Kept<S>>,
        digested: bool,
    ) -> Result<(Self, Digest), Refusal> {
        let known = |level: usize| kept.and_then(|kept| kept.levels[level].as_ref());
        let factor = |level: usize| known(level).map_or(1.0, |(_, factor)| *factor);
        let is_new = |level: &usize| known(*level).is_none();
        let fields: Vec<FarField<S::Real>> = parallel::map(sizes.half_widths.len(), &|level| {
            let reflected = probe::parities(kernel, sizes.half_widths[level]).is_some();
            sizes.far_field(level, reflected)
        });
        let scales = &sizes.scales;
        let kernels: Vec<Entries<'_, S>> =
            sizes.weights.iter().map(|weights| kernel.weighted_by(weights)).collect();
        let symmetric = fields.iter().zip(&kernels);
        let symmetric =
            symmetric.into_iter().all(|(far, kernel)| probe::symmetric(kernel, far.half_width()));
        let with_slopes = slopes.is_some();
        // Derivatives are measured in half-widths, like all else.
        let weight = if sizes.homogeneous { 1.0 } else { SLOPE_WEIGHT };
        let slopes_of = |level: usize| {
            slopes.map(|slopes| Slopes {
                entries: slopes.weighted_by(&sizes.weights[level]).times(sizes.half_widths[level]),
                scale: sizes.slope_scales[level],
                weight,
            })
        };
        let slopes: Vec<Option<Slopes<'_, S>>> = (0..fields.len()).map(slopes_of).collect();
        let errors = |rule: &Chebyshev<S::Real>| -> Vec<OffsetErrors> {
            let of_level = |level: usize| {
                let (far, scale, slopes) = (&fields[level], scales[level], &slopes[level]);
                let kernel = &kernels[level];
                let mut errors = far.interpolation_error(kernel, rule, scale);
                if !symmetric {
                    let sources = far.interpolation_error(&kernel.transpose(), rule, scale);
                    errors = errors.join(&sources, 1.0);
                }
                if let Some(Slopes { entries, scale, weight }) = slopes {
                    let targets = far.slope_error(kernel, entries, rule, *scale);
                    let sources = far.interpolation_error(&entries.transpose(), rule, *scale);
                    errors = errors.join(&targets, *weight).join(&sources, *weight);
                }
                errors
            };
            (0..fields.len()).filter(is_new).map(of_level).collect()
        };
        let worst =
            |rule: &Chebyshev<S::Real>| largest(errors(rule).iter().map(|level| level.mean));
        let sides = if symmetric { 1.0 } else { 2.0 };
        let tests = (sides + if with_slopes { 6.0 } else { 0.0 }) * fields.len() as f64;
        let afford = |n: usize| {
            let [evaluations, products] = test_costs(kernel, n);
            kernel.afford_probes(tests * evaluations, tests * products)
        };
        let (orders, tolerance, accepted, needed) = match accuracy {
            Accuracy::Order(order) => {
                let floor = 16.0 * <S::Real as Float>::epsilon().as_f64();
                let tolerance =
                    ORDER_TRUNCATION_SHARE * worst(&Chebyshev::new(order)) / INTERPOLATION_SHARE;
                (order..=order, tolerance.max(floor), f64::INFINITY, f64::INFINITY)
            }
            Accuracy::Tolerance(requested) => {
                let closer = |rule: &Chebyshev<S::Real>| {
                    let costs = fields.iter().map(|far| far.closer_costs(kernel, rule.len()));
                    let [evaluations, products] =
                        costs.fold([0.0; 2], |[e, p], [x, y]| [e + x, p + y]);
                    kernel.afford_probes(evaluations, products)?;
                    let of_level = |((far, &scale), kernel): ((&FarField<_>, &Scale), _)| {
                        far.closer_errors(kernel, rule, scale)
                    };
                    Ok(fields.iter().zip(scales).zip(&kernels).map(of_level).collect())
                };
                let accepted =
                    if sizes.homogeneous { ACCEPTED_SHARE } else { ACCEPTED_LEVEL_SHARE };
                let orders = match kept {
                    Some(kept) => kept.order..=kept.order,
                    None => {
                        let order = order_of(requested, &fields, afford, errors, closer)?;
                        order..=MAX_ORDER.min(order + MORE_ORDERS)
                    }
                };
                (orders, requested, accepted, requested)
            }
        };
        let new: Vec<usize> = (0..fields.len()).filter(is_new).collect();
        let begun = new.iter().map(|&level| &fields[level]);
        foretell(kernel, accuracy, *orders.start(), sides, begun)?;
        // The squares of the levels' errors add up.
        let levels = (fields.len() as f64).sqrt();
        let mut reachable = f64::INFINITY;
        let last = *orders.end();
        for order in orders {
            let rule = Chebyshev::new(order);
            let request = |level: usize| Request {
                kernel: &kernels[level],
                rule: &rule,
                symmetric,
                homogeneous: sizes.homogeneous,
                far: &fields[level],
                scale: scales[level],
                slopes: slopes[level].as_ref(),
                tolerance: tolerance / levels,
                accepted,
                digested,
            };
            // What an order that is given leaves out of new levels, others would not.
            if kept.is_some() && worst(&rule) > INTERPOLATION_SHARE * needed {
                break;
            }
            let requests: Vec<Request<'_, S>> = new.iter().map(|&level| request(level)).collect();
            let digest = Digest::default();
            let built = build_levels(&requests)?;
            built.iter().for_each(|built| digest.join(&built.digest));
            let mut built = built.into_iter().map(|built| Arc::new(built.operators));
            let levels = (0..fields.len()).filter_map(|level| match known(level) {
                Some((known, _)) => Some(Arc::clone(known)),
                None => built.next(),
            });
            let levels: Vec<Arc<LevelOperators<S>>> = levels.collect();
            let errors = levels.iter().enumerate().map(|(l, level)| factor(l) * level.error);
            let squares = errors.map(|error| error * error);
            let error = squares.sum::<f64>().sqrt();
            // One order more, rather than an error that sampling may have got wrong; but only if
            // interpolation has a part in it.
            let try_next = error > SAFE_SHARE * needed
                && order < last
                && worst(&rule) > LIMITING_SHARE * needed;
            if error <= needed && !try_next {
                let shifts = shifts(&rule, &levels, &sizes.weights);
                return Ok((Self { rule, error, levels, shifts }, digest));
            }
            reachable = reachable.min(error);
            if !try_next {
                break;
            }
        }
        Err(Error::UnreachableTolerance { requested: tolerance, reachable }.into())
    }
}

/// Refuses operators of so many levels if not even those of the lowest order can be afforded: a test of each level, and
/// operators of it.
pub(crate) fn afford_any<S: Scalar>(
    kernel: &Entries<'_, S>,
    accuracy: Accuracy,
    levels: usize,
) -> Result<(), Error> {
    let [evaluations, products] = test_costs(kernel, 1).map(|cost| levels as f64 * cost);
    kernel.afford_probes(evaluations, products)?;
    let rank = cost::rank(accuracy, kernel.fields.min(kernel.densities)) as usize;
    let all = FORETOLD_ATTEMPTS * levels as f64;
    let [evaluations, products] = operator_costs(kernel, 1, rank, true).map(|cost| all * cost);
    kernel.afford(evaluations, products)
}

/// Refuses operators of order `n`, with so many sides of their own, that can't be afforded, before they are
/// begun.
fn foretell<'a, S: Scalar>(
    kernel: &Entries<'_, S>,
    accuracy: Accuracy,
    n: usize,
    sides: f64,
    fields: impl Iterator<Item = &'a FarField<S::Real>>,
) -> Result<(), Error> {
    let (mut evaluations, mut multiply_adds) = (0.0, 0.0);
    for far in fields {
        let parities = probe::parities(kernel, far.half_width());
        let parts = if parities.is_some() { 8.0 } else { 1.0 };
        let [samples, columns] = spectrum_costs(kernel, far, n, parts);
        // The rank of 1/r is that of a smooth kernel; others have more.
        let rank = cost::rank(accuracy, kernel.fields.min(kernel.densities)) as usize;
        let [own, products] = operator_costs(kernel, n, rank, parities.is_some());
        evaluations += sides * samples + FORETOLD_ATTEMPTS * own;
        multiply_adds += sides * columns + FORETOLD_ATTEMPTS * products;
    }
    kernel.afford(evaluations, multiply_adds)
}

fn shifts<S: Scalar>(
    rule: &Chebyshev<S::Real>,
    levels: &[Arc<LevelOperators<S>>],
    weights: &[Weights],
) -> Vec<Shifts<S>> {
    let between = |parent: usize, child: usize| {
        let levels = [parent, child].map(|level| &*levels[level]);
        Shifts::new(rule, levels, [parent, child].map(|level| &weights[level]))
    };
    match levels {
        [_] => vec![between(0, 0)],
        _ => (1..levels.len()).map(|child| between(child - 1, child)).collect(),
    }
}

impl<S: Scalar> Shifts<S> {
    fn new(
        rule: &Chebyshev<S::Real>,
        [parent, child]: [&LevelOperators<S>; 2],
        [above, below]: [&Weights; 2],
    ) -> Self {
        let nodes = rule.len().pow(3);
        // From moments and fields under the weights of one level to those under the other's.
        let reweigh = |of: fn(&Weights) -> &[f64], mut columns: Matrix<S>| {
            weigh(of(above), true, nodes, &mut columns.data);
            weigh(of(below), false, nodes, &mut columns.data);
            columns
        };
        let octants = if parent.bases.reflected && child.bases.reflected { 0..1 } else { 0..8 };
        let m2m = |octant| {
            // m_parent = V_parentᵀ b_parent⁻¹ A b_child conj(V_child) m_child
            let moments = child.bases.source.functions.map(S::conjugate);
            let moments = reweigh(|own| &own.densities, shift(rule, octant, false, &moments));
            product(&parent.bases.source.functions.transpose(), &moments)
        };
        let l2l = |octant| {
            // l_child = U_childᴴ a_child Aᵀ a_parent⁻¹ U_parent l_parent
            let fields = shift(rule, octant, true, &parent.bases.target.functions);
            let fields = reweigh(|own| &own.fields, fields);
            product(&adjoint(&child.bases.target.functions), &fields)
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
    rule.shift(octant, transposed, &mut shifted.data);
    shifted
}

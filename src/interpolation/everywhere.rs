//! Kernels that look different from place to place: all polynomials, and the kernel itself between their
//! nodes.

use num_traits::Float;

use crate::error::Error;
use crate::expansion::geometry::{Geometry, Level, Strength};
use crate::interpolation::accuracy::Accuracy;
use crate::interpolation::basis::Basis;
use crate::interpolation::chebyshev::Chebyshev;
use crate::interpolation::entries::{Entries, PointOf, zero};
use crate::interpolation::far_field::{products, slope_products};
use crate::interpolation::means::largest;
use crate::interpolation::order::fewest_nodes;
use crate::interpolation::probe::{power_of_two, sample};
use crate::interpolation::tuning::PLACED_PAIRS;
use crate::numbers::traits::{Numbers, Point, Real, Scalar, Vector, l2_norm};
use crate::octree::geometry::Cube;
use crate::parallel;

/// The polynomials of a kernel that is not translation invariant.
pub(crate) struct Everywhere<S: Scalar> {
    pub(crate) rule: Chebyshev<S::Real>,
    pub(crate) source: Basis<S>,
    pub(crate) target: Basis<S>,
    /// What errors of a pair's values and derivatives are relative to, level by level from the root.
    pub(crate) pair_sizes: Vec<[f64; 2]>,
}

impl<S: Scalar> Everywhere<S> {
    pub(crate) fn with_order(n: usize, fields: usize, densities: usize) -> Self {
        let rule = Chebyshev::new(n);
        let (source, target) = (Basis::full(&rule, densities), Basis::full(&rule, fields));
        Self { rule, source, target, pair_sizes: Vec::new() }
    }

    /// The order is the smallest that serves between points of the sums themselves: what the kernel does
    /// elsewhere is nothing to them.
    pub(crate) fn new(
        kernel: &Entries<'_, S>,
        slopes: Option<&Entries<'_, S>>,
        accuracy: Accuracy,
        geometry: &Geometry<S::Real>,
    ) -> Result<Self, Error> {
        let requested = match accuracy {
            Accuracy::Order(n) => return Ok(Self::with_order(n, kernel.fields, kernel.densities)),
            Accuracy::Tolerance(requested) => requested,
        };
        let placed = |level: &Level<S::Real>| placed(kernel, slopes, geometry, level);
        let levels: Vec<Vec<Placed<S>>> = geometry.levels.iter().map(placed).collect();
        let tests: usize = levels.iter().map(Vec::len).sum();
        let m2l_pairs: usize = geometry.levels.iter().map(|level| level.pairs).sum();
        let afford = |n: usize| {
            let sides = if slopes.is_some() { 5 } else { 2 };
            kernel.afford_probes((sides * tests * n.pow(3)) as f64, 0.0)?;
            // Every application evaluates the kernel between all nodes.
            kernel.afford_application(m2l_pairs as f64 * n.pow(6) as f64)
        };
        // By how much each level's errors count in whole sums.
        let weight = |strength: Option<Strength>| strength.map_or(1.0, |own| own.pair / own.size);
        let weights = |level: &Level<_>| [level.values, level.slopes].map(weight);
        let weights: Vec<[f64; 2]> = geometry.levels.iter().map(weights).collect();
        let rule = fewest_nodes(requested, afford, |rule| {
            let errors = |pairs: &Vec<_>| relative_errors(kernel, slopes, rule, pairs);
            let errors: Vec<[f64; 2]> = levels.iter().map(errors).collect();
            let total = |part: usize| {
                l2_norm(
                    errors.iter().zip(&weights).map(|(error, weight)| error[part] * weight[part]),
                )
            };
            largest([total(0), total(1)])
        })?;
        let mut everywhere = Self::with_order(rule.len(), kernel.fields, kernel.densities);
        let total = [0, 1].map(|part| l2_norm(weights.iter().map(|weight| weight[part])));
        for level in &geometry.levels {
            everywhere.pair_sizes.resize(level.level + 1, [0.0; 2]);
            let pairs = [level.values, level.slopes].map(|own| own.map_or(0.0, |own| own.pair));
            everywhere.pair_sizes[level.level] = [pairs[0] / total[0], pairs[1] / total[1]];
        }
        Ok(everywhere)
    }
}

/// A pair of points whose cells meet through M2L.
struct Placed<S: Scalar> {
    /// Target and source, with the centres of their cells.
    points: [PointOf<S>; 2],
    centres: [PointOf<S>; 2],
    half_width: S::Real,
    exact: Vec<S>,
    /// Derivatives, where they are asked for.
    slopes: Vec<S>,
}

/// Pairs of a level, spread over the points.
fn placed<S: Scalar>(
    kernel: &Entries<'_, S>,
    slopes: Option<&Entries<'_, S>>,
    geometry: &Geometry<S::Real>,
    level: &Level<S::Real>,
) -> Vec<Placed<S>> {
    let root = &geometry.root;
    let half_width = level.half_width;
    // Without points, any place will do.
    let anywhere: Vec<PointOf<S>>;
    let [sources, targets] = if geometry.sources.is_empty() || geometry.targets.is_empty() {
        let point = |k| root.centre() + sample::<S::Real>(k) * root.half_width();
        anywhere = (0..PLACED_PAIRS).map(point).collect();
        [&anywhere; 2]
    } else {
        [&geometry.sources, &geometry.targets]
    };
    let place = |p: &PointOf<S>| cell_of(root, half_width, *p);
    let [from, to] = [sources, targets].map(|points| points.iter().map(place).collect::<Vec<_>>());
    let (mut pairs, mut step) = (Vec::new(), 0);
    // A different target for each source before any comes again.
    while step < targets.len() && pairs.len() < PLACED_PAIRS {
        for (j, y) in sources.iter().enumerate() {
            let i = (j + step) % targets.len();
            if pairs.len() < PLACED_PAIRS && meet(to[i], from[j]) {
                let centre = |cell: [f64; 3]| {
                    let corner =
                        root.centre() - Point::<S::Real>::from_array([root.half_width(); 3]);
                    let in_cells = cell.map(|k| half_width * S::Real::from_f64(2.0 * k + 1.0));
                    corner + Point::<S::Real>::from_array(in_cells)
                };
                pairs.push(Placed {
                    points: [targets[i], *y],
                    centres: [centre(to[i]), centre(from[j])],
                    half_width,
                    exact: kernel.at(targets[i], *y),
                    slopes: slopes.map_or(vec![], |slopes| slopes.at(targets[i], *y)),
                });
            }
        }
        step += 1;
    }
    pairs
}

/// Which cell of this size a point is in, counted from the root's corner.
fn cell_of<T: Real>(root: &Cube<T>, half_width: T, p: Point<T>) -> [f64; 3] {
    let corner = root.centre() - Point::<T>::from_array([root.half_width(); 3]);
    (p - corner).to_array().map(|x| (x.as_f64() / (2.0 * half_width.as_f64())).floor())
}

/// Whether two cells are on each other's interaction lists.
fn meet(a: [f64; 3], b: [f64; 3]) -> bool {
    let largest =
        |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let parent = |cell: [f64; 3]| cell.map(|k| (k / 2.0).floor());
    largest(a, b) > 1.0 && largest(parent(a), parent(b)) <= 1.0
}

/// The errors of interpolating on either side of all pairs, relative to their size: that of values and that of
/// derivatives.
fn relative_errors<S: Scalar>(
    kernel: &Entries<'_, S>,
    slopes: Option<&Entries<'_, S>>,
    rule: &Chebyshev<S::Real>,
    pairs: &[Placed<S>],
) -> [f64; 2] {
    // No square leaves the range of numbers.
    let all = pairs.iter().flat_map(|pair| pair.exact.iter().chain(&pair.slopes));
    let parts = all.flat_map(|entry| entry.parts()).map(Float::abs);
    let unit = power_of_two(parts.fold(S::Real::from_f64(0.0), Float::max)).recip();
    let kernel = &kernel.times(unit);
    let slopes = slopes.map(|slopes| slopes.times(unit));
    let errors = parallel::map(pairs.len(), &|k| {
        let Placed { points: [x, y], centres: [at_x, at_y], half_width, .. } = &pairs[k];
        let (n, inverse) = (rule.len(), S::Real::from_f64(1.0) / *half_width);
        let [in_x, in_y] = [(*x - *at_x) * inverse, (*y - *at_y) * inverse];
        let error = |kernel: &Entries<'_, S>, y, centre, weights: Vec<_>, exact: Vec<S>| {
            interpolation_error(kernel, rule, y, (centre, *half_width), weights, exact)
        };
        let of_source = |kernel: &Entries<'_, S>| {
            let mirrored = kernel.transpose();
            error(&mirrored, *x, *at_y, vec![products(in_y, n)], mirrored.at(*y, *x))
        };
        let target = error(kernel, *y, *at_x, vec![products(in_x, n)], kernel.at(*x, *y));
        let values = target + of_source(kernel);
        let Some(slopes) = &slopes else { return [values, 0.0] };
        let slopes = slopes.times(*half_width);
        let along = [0, 1, 2].map(|axis| slope_products(in_x, n, axis)).to_vec();
        let target = error(kernel, *y, *at_x, along, slopes.at(*x, *y));
        let lengths = half_width.as_f64().powi(2);
        [values, (target + of_source(&slopes)) / lengths]
    });
    let squares = |numbers: &[S]| {
        numbers.iter().map(|&number| (number * S::from_real(unit)).norm_squared()).sum::<f64>()
    };
    let relative = |part: usize, of: fn(&Placed<S>) -> &[S]| {
        let error: f64 = errors.iter().map(|errors| errors[part]).sum();
        let size: f64 = pairs.iter().map(|pair| squares(of(pair))).sum();
        if error == 0.0 { 0.0 } else { (error / size).sqrt() }
    };
    [relative(0, |pair| &pair.exact), relative(1, |pair| &pair.slopes)]
}

/// The squared error of interpolating the field of y between the nodes of a cell, for each row of weights
/// of the polynomials.
fn interpolation_error<S: Scalar>(
    kernel: &Entries<'_, S>,
    rule: &Chebyshev<S::Real>,
    y: PointOf<S>,
    (centre, half_width): (PointOf<S>, S::Real),
    mut weights: Vec<Vec<S::Real>>,
    exact: Vec<S>,
) -> f64 {
    weights.iter_mut().for_each(|weights| rule.node_weights(weights));
    let nodes: Vec<PointOf<S>> = rule.grid().map(|node| centre + node * half_width).collect();
    let (len, densities) = (kernel.fields * kernel.densities, kernel.densities);
    let axes = weights.len();
    let mut values = vec![zero::<S>(); nodes.len() * len];
    kernel.write(&nodes, y, &mut values);
    let mut errors = exact;
    for (node, values) in values.chunks_exact(len).enumerate() {
        for (k, &value) in values.iter().enumerate() {
            let (field, density) = (k / densities, k % densities);
            for (row, weights) in weights.iter().enumerate() {
                let place = (field * axes + row) * densities + density;
                errors[place] -= S::from_real(weights[node]) * value;
            }
        }
    }
    errors.iter().map(Numbers::norm_squared).sum()
}

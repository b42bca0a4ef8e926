//! Kernels that look different from place to place: all polynomials, and the kernel itself between their
//! nodes.

use crate::error::Error;
use crate::expansion::{Geometry, Level};
use crate::interpolation::basis::Basis;
use crate::interpolation::chebyshev::Chebyshev;
use crate::interpolation::far_field::products;
use crate::interpolation::operators::{Accuracy, fewest_nodes, largest};
use crate::interpolation::probe::{Entries, PointOf, norm_squared, sample, zero};
use crate::interpolation::tuning::PLACED_PAIRS;
use crate::numbers::traits::{Numbers, Point, Real, Scalar, Vector};
use crate::octree::geometry::Cube;
use crate::parallel;

/// The polynomials of a kernel that is not translation invariant.
pub(crate) struct Everywhere<S: Scalar> {
    pub(crate) rule: Chebyshev<S::Real>,
    pub(crate) source: Basis<S>,
    pub(crate) target: Basis<S>,
}

impl<S: Scalar> Everywhere<S> {
    pub(crate) fn with_order(n: usize, fields: usize, densities: usize) -> Self {
        let rule = Chebyshev::new(n);
        let (source, target) = (Basis::full(&rule, densities), Basis::full(&rule, fields));
        Self { rule, source, target }
    }

    /// The order is the smallest that serves between points of the sums themselves: what the kernel does
    /// elsewhere is nothing to them.
    pub(crate) fn new(
        kernel: &Entries<'_, S>,
        accuracy: Accuracy,
        geometry: &Geometry<S::Real>,
    ) -> Result<Self, Error> {
        let requested = match accuracy {
            Accuracy::Order(n) => return Ok(Self::with_order(n, kernel.fields, kernel.densities)),
            Accuracy::Tolerance(requested) => requested,
        };
        let levels: Vec<Vec<Placed<S>>> = geometry
            .levels
            .iter()
            .map(|level| placed(kernel, geometry, level))
            .collect::<Result<_, _>>()?;
        let tests: usize = levels.iter().map(Vec::len).sum();
        let m2l_pairs: usize = geometry.levels.iter().map(|level| level.pairs).sum();
        let afford = |n: usize| {
            kernel.afford_probes((2 * tests * n.pow(3)) as f64, 0.0)?;
            // Every application evaluates the kernel between all nodes.
            kernel.afford(m2l_pairs as f64 * n.pow(6) as f64, 0.0)
        };
        let rule = fewest_nodes(requested, afford, |rule| {
            largest(levels.iter().map(|pairs| relative_error(kernel, rule, pairs)))
        })?;
        Ok(Self::with_order(rule.len(), kernel.fields, kernel.densities))
    }
}

/// A pair of points whose cells meet through M2L.
struct Placed<S: Scalar> {
    /// Target and source, with the centres of their cells.
    points: [PointOf<S>; 2],
    centres: [PointOf<S>; 2],
    half_width: S::Real,
    exact: Vec<S>,
}

/// Pairs of a level, spread over the points.
fn placed<S: Scalar>(
    kernel: &Entries<'_, S>,
    geometry: &Geometry<S::Real>,
    level: &Level<S::Real>,
) -> Result<Vec<Placed<S>>, Error> {
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
                });
            }
        }
        step += 1;
    }
    Ok(pairs)
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

/// The error of interpolating on either side of all pairs, relative to their size.
fn relative_error<S: Scalar>(
    kernel: &Entries<'_, S>,
    rule: &Chebyshev<S::Real>,
    pairs: &[Placed<S>],
) -> f64 {
    let errors = parallel::map(pairs.len(), &|k| {
        let Placed { points: [x, y], centres: [at_x, at_y], half_width, exact } = &pairs[k];
        let side = |kernel: &Entries<'_, S>, x, y, centre, exact: &[S]| {
            interpolation_error(kernel, rule, [x, y], centre, *half_width, exact)
        };
        let transposed = kernel.transpose();
        let mirrored = transposed.at(*y, *x);
        side(kernel, *x, *y, *at_x, exact) + side(&transposed, *y, *x, *at_y, &mirrored)
    });
    let size: f64 = pairs.iter().map(|pair| norm_squared(&pair.exact)).sum();
    let error: f64 = errors.into_iter().sum();
    if error == 0.0 { 0.0 } else { (error / size).sqrt() }
}

/// The squared error at x of interpolating the field of y between the nodes of a cell.
fn interpolation_error<S: Scalar>(
    kernel: &Entries<'_, S>,
    rule: &Chebyshev<S::Real>,
    [x, y]: [PointOf<S>; 2],
    centre: PointOf<S>,
    half_width: S::Real,
    exact: &[S],
) -> f64 {
    let inverse = S::Real::from_f64(1.0) / half_width;
    let mut weights = products((x - centre) * inverse, rule.len());
    rule.node_weights(&mut weights);
    let nodes: Vec<PointOf<S>> = rule.grid().map(|node| centre + node * half_width).collect();
    let mut values = vec![zero::<S>(); nodes.len() * exact.len()];
    kernel.write(&nodes, y, &mut values);
    let mut errors = exact.to_vec();
    for (value, weight) in values.chunks_exact(exact.len()).zip(weights) {
        for (error, &value) in errors.iter_mut().zip(value) {
            *error -= S::from_real(weight) * value;
        }
    }
    errors.iter().map(Numbers::norm_squared).sum()
}

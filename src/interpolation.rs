//! The black-box expansion of any point kernel: interpolation at Chebyshev nodes.

use std::fmt;

use num_traits::Float;

use crate::chebyshev::{Chebyshev, Weights};
use crate::error::Error;
use crate::expansion::{Expansion, Geometry, Level, OffsetMap};
use crate::geometry::{Cell, Cube};
use crate::kernel::{Outcome, PointKernel};
use crate::probe;
use crate::real::{Additive, Linear, Located, Point, Real, Scalar, Vector};

/// The far field of any [`PointKernel`] by interpolation at n × n × n Chebyshev nodes per cell
/// (Fong and Darve, "The black-box fast multipole method", J. Comput. Phys. 228, 2009).
///
/// A multipole term is a column of densities at a node, a local term one of fields. Nothing about the
/// kernel is declared: whether it is translation invariant, whether it is homogeneous, so that one set
/// of operators serves all levels, and which order a tolerance needs, is measured when the plan is
/// built. M2L costs O(n⁶) multiply-adds per pair of cells.
pub struct Interpolation<K: PointKernel> {
    kernel: K,
    accuracy: Accuracy,
    rule: Chebyshev<K::Real>,
    translation_invariant: bool,
    operators: Operators<K>,
}

/// M2L matrices, column after column.
enum Operators<K: PointKernel> {
    /// For each level its own.
    PerLevel(Vec<OffsetMap<Vec<K::Entry>>>),
    /// Those of cells of half-width `half_width`; a factor s in size is a factor s^degree in value.
    Homogeneous { half_width: K::Real, degree: f64, matrices: OffsetMap<Vec<K::Entry>> },
}

/// The largest number of nodes per axis.
pub const MAX_ORDER: usize = 16;

/// Bytes of M2L matrices that are kept; others are evaluated whenever they are used.
const OPERATOR_BYTES: usize = 1 << 30;

#[derive(Clone, Copy, Debug)]
enum Accuracy {
    Tolerance(f64),
    Order(usize),
}

impl<K: PointKernel> Interpolation<K> {
    /// Expands `kernel` to a relative l2 error of 1e-6.
    pub fn new(kernel: K) -> Self {
        let rule = Chebyshev::new(1);
        let accuracy = Accuracy::Tolerance(1e-6);
        Self {
            kernel,
            accuracy,
            rule,
            translation_invariant: false,
            operators: Operators::PerLevel(vec![]),
        }
    }

    /// The relative l2 error to stay below, between 0 and 1. The order is the smallest that meets it
    /// for cells that are barely well separated, at every level that occurs.
    pub fn tolerance(self, tolerance: f64) -> Self {
        Self { accuracy: Accuracy::Tolerance(tolerance), ..self }
    }

    /// A fixed number of nodes per axis, 1 to [`MAX_ORDER`].
    pub fn order(self, order: usize) -> Self {
        Self { accuracy: Accuracy::Order(order), ..self }
    }

    /// Nodes per axis of a prepared expansion.
    pub fn nodes_per_axis(&self) -> usize {
        self.rule.len()
    }

    /// Nodes per cell.
    fn nodes(&self) -> usize {
        self.rule.len().pow(3)
    }

    fn choose_rule(
        &self,
        root: &Cube<K::Real>,
        levels: &[Level<K::Real>],
    ) -> Result<Chebyshev<K::Real>, Error> {
        match self.accuracy {
            Accuracy::Order(found) if found == 0 || found > MAX_ORDER => {
                Err(Error::InvalidOrder { min: 1, max: MAX_ORDER, found })
            }
            Accuracy::Order(order) => Ok(Chebyshev::new(order)),
            Accuracy::Tolerance(found) if !(found > 0.0 && found < 1.0) => {
                Err(Error::InvalidTolerance { found })
            }
            Accuracy::Tolerance(requested) => {
                let mut reachable = f64::INFINITY;
                for n in 1..=MAX_ORDER {
                    let rule = Chebyshev::new(n);
                    let error = probe::interpolation_error(&self.kernel, &rule, root, levels);
                    if error <= requested {
                        return Ok(rule);
                    }
                    reachable = reachable.min(error);
                }
                Err(Error::UnreachableTolerance { requested, reachable })
            }
        }
    }

    fn build_operators(&self, geometry: &Geometry<K::Real>, degree: Option<f64>) -> Operators<K> {
        let mut bytes_left = if self.translation_invariant { OPERATOR_BYTES } else { 0 };
        let mut matrices = |half_width, offsets: &[[i32; 3]]| {
            let entries = self.nodes().pow(2) * K::FIELDS * K::DENSITIES;
            let bytes = entries * size_of::<K::Entry>();
            let count = offsets.len().min(bytes_left / bytes);
            bytes_left -= count * bytes;
            OffsetMap::build(&offsets[..count], |offset| self.matrix(half_width, offset, entries))
        };
        if let (Some(degree), Some(level)) = (degree, geometry.levels.first()) {
            let half_width = level.half_width;
            let matrices = matrices(half_width, &geometry.all_offsets());
            return Operators::Homogeneous { half_width, degree, matrices };
        }
        let mut levels = Vec::new();
        for level in &geometry.levels {
            levels.resize_with(level.level, OffsetMap::default);
            levels.push(matrices(level.half_width, &level.offsets));
        }
        Operators::PerLevel(levels)
    }

    /// The M2L matrix between cells of the given half-width.
    fn matrix(&self, half_width: K::Real, offset: [i32; 3], entries: usize) -> Vec<K::Entry> {
        let two = K::Real::from_f64(2.0);
        let step = offset.map(|o| K::Real::from_f64(f64::from(o)) * two * half_width);
        let (target, source) = (Point::<K::Real>::from_array(step), Point::<K::Real>::default());
        let mut matrix = Vec::with_capacity(entries);
        self.for_each_column(half_width, target, source, |column| matrix.extend_from_slice(column));
        matrix
    }

    /// The prepared matrix between two cells, if there is one, and the factor it is to be taken by.
    fn operator(
        &self,
        source: &Cell<K::Real>,
        target: &Cell<K::Real>,
    ) -> Option<(&[K::Entry], K::Real)> {
        let offset = source.offset_to(target);
        match &self.operators {
            Operators::PerLevel(levels) => {
                Some((levels.get(source.level())?.get(offset)?, K::Real::from_f64(1.0)))
            }
            Operators::Homogeneous { half_width, degree, matrices } => {
                let scale = (source.half_width() / *half_width).powf(K::Real::from_f64(*degree));
                Some((matrices.get(offset)?, scale))
            }
        }
    }

    /// Visits the columns of the matrix that takes densities at the nodes about `source` to fields at
    /// the nodes about `target`.
    fn for_each_column(
        &self,
        half_width: K::Real,
        target: Point<K::Real>,
        source: Point<K::Real>,
        mut visit: impl FnMut(&[K::Entry]),
    ) {
        let rows = self.nodes() * K::FIELDS;
        let mut columns = vec![<K::Entry as Additive>::zero(); rows * K::DENSITIES];
        let mut g = vec![<K::Entry as Additive>::zero(); K::FIELDS * K::DENSITIES];
        for b in 0..self.nodes() {
            let y = source + self.rule.grid_node(b) * half_width;
            for a in 0..self.nodes() {
                self.kernel.entries(target + self.rule.grid_node(a) * half_width, y, &mut g);
                for (k, &entry) in g.iter().enumerate() {
                    let (field, density) = (k / K::DENSITIES, k % K::DENSITIES);
                    columns[density * rows + a * K::FIELDS + field] = entry;
                }
            }
            columns.chunks_exact(rows).for_each(&mut visit);
        }
    }

    /// Where the kernel sees the cell's centre and the point `p`. A translation-invariant kernel sees
    /// them from the centre, which keeps the digits that a far-away origin would cost.
    fn seen(&self, cell: &Cell<K::Real>, p: Point<K::Real>) -> (Point<K::Real>, Point<K::Real>) {
        if self.translation_invariant {
            (Point::<K::Real>::default(), cell.relative(p))
        } else {
            (cell.centre(), p)
        }
    }

    /// Adds shifted terms: along each axis in turn the matrix of the half of the parent in which the
    /// child lies, or its transpose.
    fn shift(
        &self,
        child: &Cell<K::Real>,
        transposed: bool,
        components: usize,
        from: &[K::Column],
        to: &mut [K::Column],
    ) {
        let n = self.rule.len();
        let octant = child.octant();
        let half = |axis: usize| self.rule.half(octant >> axis & 1);
        let mut first = vec![K::Column::zero(); from.len()];
        let mut second = first.clone();
        let axis = |matrix, inner, from: &[K::Column], to: &mut [K::Column]| {
            contract::<K>(matrix, n, transposed, inner, from, to);
        };
        axis(half(0), n * n * components, from, &mut first);
        axis(half(1), n * components, &first, &mut second);
        axis(half(2), components, &second, to);
    }
}

/// to[o, k, i] += Σ_a h[k, a] from[o, a, i] over arrays of shape (·, n, `inner`), where h is the
/// matrix or its transpose.
fn contract<K: PointKernel>(
    matrix: &[K::Real],
    n: usize,
    transposed: bool,
    inner: usize,
    from: &[K::Column],
    to: &mut [K::Column],
) {
    for (from, to) in from.chunks_exact(n * inner).zip(to.chunks_exact_mut(n * inner)) {
        for (k, to) in to.chunks_exact_mut(inner).enumerate() {
            for (a, from) in from.chunks_exact(inner).enumerate() {
                let h = if transposed { matrix[a * n + k] } else { matrix[k * n + a] };
                let h = K::Entry::from_real(h);
                for (to, from) in to.iter_mut().zip(from) {
                    to.add_scaled(h, from);
                }
            }
        }
    }
}

impl<K: PointKernel> Expansion for Interpolation<K> {
    type Kernel = K;
    type MultipoleTerm = K::Column;
    type LocalTerm = K::Column;

    fn kernel(&self) -> &K {
        &self.kernel
    }

    fn multipole_len(&self, _level: usize) -> usize {
        self.nodes() * K::DENSITIES
    }

    fn local_len(&self, _level: usize) -> usize {
        self.nodes() * K::FIELDS
    }

    fn prepare(&mut self, geometry: &Geometry<K::Real>) -> Result<(), Error> {
        let Geometry { root, levels } = geometry;
        self.translation_invariant = probe::translation_invariant(&self.kernel, root);
        let degree = match self.translation_invariant {
            true => probe::homogeneity(&self.kernel, root),
            false => None,
        };
        // Relative errors of a homogeneous kernel are the same at every level.
        let probed = if degree.is_some() { levels.len().min(1) } else { levels.len() };
        self.rule = self.choose_rule(root, &levels[..probed])?;
        self.operators = self.build_operators(geometry, degree);
        Ok(())
    }

    /// About as many points as nodes, more if a node carries several components; the order that a
    /// tolerance will need is guessed as for 1/r.
    fn leaf_size(&self, _pair_seconds: f64) -> usize {
        let order = match self.accuracy {
            Accuracy::Order(order) => order,
            Accuracy::Tolerance(tolerance) => (2.0 - tolerance.log10()) as usize,
        };
        order.clamp(3, 8).pow(3) * (K::FIELDS * K::DENSITIES).isqrt()
    }

    fn p2m(
        &self,
        cell: &Cell<K::Real>,
        sources: &[K::Source],
        charges: &[K::Charge],
        multipole: &mut [K::Column],
    ) {
        let mut weights = Weights::new(self.rule.len());
        let mut density = vec![K::Column::zero(); K::DENSITIES];
        for (y, q) in sources.iter().zip(charges) {
            weights.set(&self.rule, cell.normalised(Located::position(y)));
            self.kernel.density(y, q, &mut density);
            for (terms, weight) in multipole.chunks_exact_mut(K::DENSITIES).zip(weights.products())
            {
                for (term, d) in terms.iter_mut().zip(&density) {
                    term.add_scaled(K::Entry::from_real(weight), d);
                }
            }
        }
    }

    fn m2m(
        &self,
        child: &Cell<K::Real>,
        _parent: &Cell<K::Real>,
        from: &[K::Column],
        to: &mut [K::Column],
    ) {
        self.shift(child, true, K::DENSITIES, from, to);
    }

    fn m2l(
        &self,
        source: &Cell<K::Real>,
        target: &Cell<K::Real>,
        from: &[K::Column],
        to: &mut [K::Column],
    ) {
        let add = |column: &[K::Entry], density: &K::Column, to: &mut [K::Column]| {
            for (term, &g) in to.iter_mut().zip(column) {
                term.add_scaled(g, density);
            }
        };
        if let Some((matrix, scale)) = self.operator(source, target) {
            let scale = K::Entry::from_real(scale);
            for (column, density) in matrix.chunks_exact(to.len()).zip(from) {
                let mut scaled = K::Column::zero();
                scaled.add_scaled(scale, density);
                add(column, &scaled, to);
            }
        } else {
            let (y, x) = self.seen(source, target.centre());
            let mut density = from.iter();
            self.for_each_column(source.half_width(), x, y, |column| {
                if let Some(density) = density.next() {
                    add(column, density, to);
                }
            });
        }
    }

    fn l2l(
        &self,
        _parent: &Cell<K::Real>,
        child: &Cell<K::Real>,
        from: &[K::Column],
        to: &mut [K::Column],
    ) {
        self.shift(child, false, K::FIELDS, from, to);
    }

    fn l2p(
        &self,
        cell: &Cell<K::Real>,
        local: &[K::Column],
        targets: &[K::Target],
        values: &mut [K::Value],
    ) {
        let mut weights = Weights::new(self.rule.len());
        let mut fields = vec![K::Column::zero(); K::FIELDS];
        let mut gradients = vec![[K::Column::zero(); 3]; if K::GRADIENT { K::FIELDS } else { 0 }];
        let per_length = K::Real::from_f64(1.0) / cell.half_width();
        for (x, u) in targets.iter().zip(values) {
            let position = cell.normalised(Located::position(x));
            weights.set(&self.rule, position);
            fields.fill(K::Column::zero());
            for (terms, weight) in local.chunks_exact(K::FIELDS).zip(weights.products()) {
                for (field, term) in fields.iter_mut().zip(terms) {
                    field.add_scaled(K::Entry::from_real(weight), term);
                }
            }
            if K::GRADIENT {
                gradients.fill([K::Column::zero(); 3]);
                for axis in 0..3 {
                    weights.set(&self.rule, position);
                    weights.differentiate(&self.rule, axis, position);
                    for (terms, weight) in local.chunks_exact(K::FIELDS).zip(weights.products()) {
                        let weight = K::Entry::from_real(weight * per_length);
                        for (gradient, term) in gradients.iter_mut().zip(terms) {
                            gradient[axis].add_scaled(weight, term);
                        }
                    }
                }
            }
            self.kernel.value(x, &fields, &gradients, u);
        }
    }

    fn m2p(
        &self,
        cell: &Cell<K::Real>,
        multipole: &[K::Column],
        targets: &[K::Target],
        values: &mut [K::Value],
    ) -> Outcome {
        let entries = K::FIELDS * K::DENSITIES;
        let mut g = vec![<K::Entry as Additive>::zero(); entries];
        let mut dg =
            vec![[<K::Entry as Additive>::zero(); 3]; if K::GRADIENT { entries } else { 0 }];
        let mut fields = vec![K::Column::zero(); K::FIELDS];
        let mut gradients = vec![[K::Column::zero(); 3]; if K::GRADIENT { K::FIELDS } else { 0 }];
        for (x, u) in targets.iter().zip(values) {
            let (centre, position) = self.seen(cell, Located::position(x));
            fields.fill(K::Column::zero());
            gradients.fill([K::Column::zero(); 3]);
            for (b, densities) in multipole.chunks_exact(K::DENSITIES).enumerate() {
                let node = centre + self.rule.grid_node(b) * cell.half_width();
                self.kernel.entries(position, node, &mut g);
                if K::GRADIENT
                    && self.kernel.entry_gradients(position, node, &mut dg) == Outcome::Declined
                {
                    return Outcome::Declined;
                }
                for (k, &entry) in g.iter().enumerate() {
                    fields[k / K::DENSITIES].add_scaled(entry, &densities[k % K::DENSITIES]);
                }
                for (k, gradient) in dg.iter().enumerate() {
                    for (axis, &entry) in gradient.iter().enumerate() {
                        let density = &densities[k % K::DENSITIES];
                        gradients[k / K::DENSITIES][axis].add_scaled(entry, density);
                    }
                }
            }
            self.kernel.value(x, &fields, &gradients, u);
        }
        Outcome::Done
    }

    fn p2l(
        &self,
        cell: &Cell<K::Real>,
        sources: &[K::Source],
        charges: &[K::Charge],
        local: &mut [K::Column],
    ) -> Outcome {
        let mut g = vec![<K::Entry as Additive>::zero(); K::FIELDS * K::DENSITIES];
        let mut density = vec![K::Column::zero(); K::DENSITIES];
        for (y, q) in sources.iter().zip(charges) {
            self.kernel.density(y, q, &mut density);
            let (centre, position) = self.seen(cell, Located::position(y));
            for (a, terms) in local.chunks_exact_mut(K::FIELDS).enumerate() {
                let node = centre + self.rule.grid_node(a) * cell.half_width();
                self.kernel.entries(node, position, &mut g);
                for (k, &entry) in g.iter().enumerate() {
                    terms[k / K::DENSITIES].add_scaled(entry, &density[k % K::DENSITIES]);
                }
            }
        }
        Outcome::Done
    }
}

impl<K: PointKernel> fmt::Debug for Interpolation<K> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Interpolation")
            .field("accuracy", &self.accuracy)
            .field("nodes_per_axis", &self.rule.len())
            .field("translation_invariant", &self.translation_invariant)
            .finish_non_exhaustive()
    }
}

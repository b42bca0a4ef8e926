//! The far field of one cell, and the least number of terms that could carry it.

use faer::Mat;
use farfield::{
    Cell, Cube, Error, Expansion, Geometry, Kernel, Level, Numbers, direct, relative_l2_error,
};
use farfield_benches::clouds;
use glam::DVec3;

use crate::placed::Placed;

/// A cell full of sources, and targets in each of the 316 cells that M2L can reach from it, all at the
/// nodes of Gauss's rule: sums over them are integrals over the cells.
pub(crate) struct FarField<K: Kernel> {
    kernel: K,
    geometry: Geometry<f64>,
    source: Cell<f64>,
    sources: Vec<K::Source>,
    /// Roots of the weights of the rule.
    source_weights: Vec<f64>,
    targets: Vec<(Cell<f64>, Vec<K::Target>)>,
    target_weights: Vec<f64>,
    /// Random signs, weighted, and the exact sums of each, weighted too.
    charges: Vec<Vec<f64>>,
    exact: Vec<f64>,
}

/// How fine a far field is sampled.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sampling {
    /// Nodes per axis of the sources' cell, and of each target's.
    pub(crate) nodes: [usize; 2],
    /// Sources or targets at each node: more than one if they have directions.
    pub(crate) copies: usize,
}

/// How often signs are drawn for the charges.
const DRAWS: usize = 6;
/// A level on which a cell has all offsets, and the coordinates of that cell.
const LEVEL: usize = 3;
const CENTRE: i32 = 3;

impl<K, P> FarField<K>
where
    P: Placed<Real = f64>,
    K: Kernel<Real = f64, Source = P, Target = P, Charge = f64, Value = f64> + Copy,
{
    /// The field by a kernel; cells are 2 wide.
    pub(crate) fn new(kernel: K, sampling: Sampling) -> Self {
        let half_width = 1.0;
        let root = Cube::new(DVec3::ZERO, half_width * f64::from(1u32 << LEVEL));
        let cell = |offset: [i32; 3]| Cell::new(&root, LEVEL, offset.map(|o| (CENTRE + o) as u64));
        let [(from, source_weights), (to, target_weights)] =
            sampling.nodes.map(|nodes| grid(nodes, sampling.copies));
        let inside = |cell: &Cell<f64>, nodes: &[DVec3], first: usize| -> Vec<P> {
            let at = |p: &DVec3| cell.centre() + *p * cell.half_width();
            nodes.iter().enumerate().map(|(i, p)| P::at(at(p), first + i)).collect()
        };
        let source = cell([0; 3]);
        let sources = inside(&source, &from, 0);
        let offsets = offsets();
        let fill = |(i, &offset): (usize, &[i32; 3])| {
            let cell = cell(offset);
            (cell, inside(&cell, &to, from.len() + i * to.len()))
        };
        let targets = offsets.iter().enumerate().map(fill).collect();
        let levels = vec![Level::new(LEVEL, half_width, offsets)];
        let geometry = Geometry::new(root, levels);
        let random = clouds::charges(DRAWS * sources.len());
        let signed = |random: &[f64]| -> Vec<f64> {
            random.iter().zip(&source_weights).map(|(x, w)| x.signum() * w).collect()
        };
        let charges = random.chunks_exact(sources.len()).map(signed).collect();
        let exact = Vec::new();
        let mut field = Self {
            kernel,
            geometry,
            source,
            sources,
            source_weights,
            targets,
            target_weights,
            charges,
            exact,
        };
        field.exact = field.directly();
        field
    }

    /// The relative Frobenius error of the map from charges to this field by P2M, M2L and L2P, and the
    /// expansion that made it. The error of random signs has it as its root mean square.
    ///
    /// # Errors
    /// If the expansion can't be prepared.
    pub(crate) fn error<E: Expansion<Kernel = K>>(
        &self,
        mut expansion: E,
    ) -> Result<(f64, E), Error> {
        expansion.prepare(&self.geometry)?;
        let mut found = Vec::with_capacity(self.exact.len());
        for charges in &self.charges {
            let mut multipole = vec![E::MultipoleTerm::zero(); expansion.multipole_len(LEVEL)];
            expansion.p2m(&self.source, &self.sources, charges, &mut multipole);
            for (target, points) in &self.targets {
                let mut local = vec![E::LocalTerm::zero(); expansion.local_len(LEVEL)];
                expansion.m2l(&self.source, target, &multipole, &mut local);
                let mut values = vec![0.0; points.len()];
                expansion.l2p(target, &local, points, &mut values);
                found.extend(values);
            }
        }
        self.weigh(&mut found);
        Ok((relative_l2_error(&found, &self.exact), expansion))
    }

    /// For each number of terms from 0 on, the least relative Frobenius error of any method with so many:
    /// what is left of the singular values of the map. None if they can't be found.
    pub(crate) fn bound(&self) -> Option<Vec<f64>> {
        let targets: Vec<&P> = self.targets.iter().flat_map(|(_, points)| points).collect();
        let map = Mat::from_fn(targets.len(), self.sources.len(), |i, j| {
            let weight = self.target_weights[i % self.target_weights.len()];
            let mut value = [0.0];
            let x = std::slice::from_ref(targets[i]);
            let (y, q) = (&self.sources[j..=j], &self.source_weights[j..=j]);
            self.kernel.add_block(x, y, q, 0.0, &mut value);
            weight * value[0]
        });
        // A tall matrix has the singular values of its triangular factor.
        let singular = map.qr().thin_R().to_owned().singular_values().ok()?;
        let mut left = 0.0;
        let mut bound: Vec<f64> = Vec::with_capacity(singular.len() + 1);
        bound.push(0.0);
        for sigma in singular.iter().rev() {
            left += sigma * sigma;
            bound.push(left);
        }
        bound.reverse();
        Some(bound.into_iter().map(|rest| (rest / left).sqrt()).collect())
    }

    fn directly(&self) -> Vec<f64> {
        let targets: Vec<P> = self.targets.iter().flat_map(|(_, points)| points.clone()).collect();
        let sums =
            |charges: &Vec<f64>| direct(&self.kernel, &self.sources, charges, &targets).unwrap();
        let mut exact: Vec<f64> = self.charges.iter().flat_map(sums).collect();
        self.weigh(&mut exact);
        exact
    }

    fn weigh(&self, values: &mut [f64]) {
        let weights = self.target_weights.iter().cycle();
        values.iter_mut().zip(weights).for_each(|(value, weight)| *value *= weight);
    }
}

/// All offsets between well-separated children of neighbours: up to 3 along each axis, more than 1 along
/// one.
fn offsets() -> Vec<[i32; 3]> {
    let axis = || -3..=3;
    let all = axis().flat_map(|x| axis().flat_map(move |y| axis().map(move |z| [x, y, z])));
    all.filter(|offset: &[i32; 3]| offset.iter().any(|o| o.abs() > 1)).collect()
}

/// The nodes of a cell, each so many times, and the roots of their weights.
fn grid(n: usize, copies: usize) -> (Vec<DVec3>, Vec<f64>) {
    let rule = gauss(n);
    let nodes = (0..n.pow(3)).map(|k| {
        let axes = [k / (n * n), k / n % n, k % n].map(|i| rule[i]);
        let weight: f64 = axes.iter().map(|&(_, w)| w).product();
        (DVec3::from_array(axes.map(|(x, _)| x)), weight.sqrt())
    });
    nodes.flat_map(|node| std::iter::repeat_n(node, copies)).unzip()
}

/// Gauss's rule on [−1, 1]: nodes and weights, by Newton's method from the nodes' known neighbourhoods.
fn gauss(n: usize) -> Vec<(f64, f64)> {
    let node = |k: usize| {
        let mut x = (std::f64::consts::PI * (k as f64 + 0.75) / (n as f64 + 0.5)).cos();
        let mut slope = 1.0;
        for _ in 0..8 {
            let (mut before, mut at) = (1.0, x);
            for i in 2..=n {
                let i = i as f64;
                (before, at) = (at, ((2.0 * i - 1.0) * x * at - (i - 1.0) * before) / i);
            }
            slope = n as f64 * (x * at - before) / (x * x - 1.0);
            x -= at / slope;
        }
        (x, 2.0 / ((1.0 - x * x) * slope * slope))
    };
    (0..n).map(node).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::terms::least_terms;
    use farfield_potentials::InverseDistance;

    #[test]
    fn there_are_316_offsets() {
        assert_eq!(offsets().len(), 316);
    }

    #[test]
    fn gauss_integrates_polynomials_of_twice_its_degree() {
        for n in 2..=10 {
            let power = 2 * n as i32 - 2;
            let sum: f64 = gauss(n).iter().map(|(x, w)| w * x.powi(power)).sum();
            assert!((sum - 2.0 / f64::from(power + 1)).abs() < 1e-14, "{n}: {sum}");
        }
    }

    #[test]
    fn the_bound_of_the_inverse_distance_is_the_known_one() {
        let sampling = Sampling { nodes: [7, 3], copies: 1 };
        let bound = FarField::new(InverseDistance::<f64>::new(), sampling).bound().unwrap();
        let ranks = [1e-2, 1e-3, 1e-4, 1e-6].map(|error| least_terms(&bound, error));
        assert_eq!(ranks, [8, 17, 36, 99]);
    }
}

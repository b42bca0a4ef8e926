//! A kernel over a lattice, evaluated at differences.

use num_traits::Float;

use crate::error::Error;
use crate::interpolation::chebyshev::Chebyshev;
use crate::interpolation::entries::Entries;
use crate::interpolation::probe::{Parities, parities, sample};
use crate::kernel::traits::Kernel;
use crate::numbers::traits::{Numbers, Point, Real, Scalar, Vector, l2_norm};
use crate::parallel;
use crate::periodic::blocks::Image;
use crate::periodic::lattice::Lattice;

/// A kernel and the lattice that it is summed over.
pub(super) struct Summed<'a, K: Kernel> {
    pub(super) kernel: &'a K,
    pub(super) lattice: &'a Lattice,
}

/// Differences that are looked at together, and images.
const NODES: usize = 64;
const IMAGES: usize = 64;

/// Places at which the kernel's size is measured.
const SAMPLES: usize = 32;

impl<K: Kernel> Summed<'_, K> {
    /// The field of some images less its value at 0, in polynomials, and that value. With the signs that reflections
    /// along the axes bring to each function, it is evaluated in one octant.
    pub(super) fn shell_sum(
        &self,
        images: &[Image],
        order: usize,
        half_widths: [f64; 3],
        signs: Option<&[[f64; 3]]>,
    ) -> Result<(Vec<f64>, Vec<f64>), Error> {
        let rule = Chebyshev::<f64>::new(order);
        let place = |p: Point<f64>| {
            let p = Vector::to_array(p);
            [0, 1, 2].map(|k| p[k] * half_widths[k])
        };
        // Nodes descend from 1 to −1, and so each stands for those that it is reflected to.
        let folded = if signs.is_some() { order.div_ceil(2) } else { order };
        let axes = |k: usize| [k / (order * order), k / order % order, k % order];
        let is_own = |k: &usize| axes(*k).iter().all(|&i| i < folded);
        let own: Vec<usize> = (0..order.pow(3)).filter(is_own).collect();
        let nodes: Vec<[f64; 3]> = own.iter().map(|&k| place(rule.grid_node(k))).collect();
        let ys: Vec<Point<K::Real>> =
            images.iter().map(|(n, _)| point::<K::Real>(self.lattice.place(*n))).collect();
        let weights: Vec<f64> = images.iter().map(|(_, weight)| *weight).collect();
        let parts = parallel::map(nodes.len().div_ceil(NODES), &|part| {
            let own = &nodes[part * NODES..nodes.len().min((part + 1) * NODES)];
            self.differences(own, &ys, &weights)
        });
        let functions = self.functions();
        let mut values = vec![0.0; functions * nodes.len()];
        for (part, sums) in parts.iter().enumerate() {
            let len = sums.0.len() / functions;
            for f in 0..functions {
                values[f * nodes.len() + part * NODES..][..len]
                    .copy_from_slice(&sums.0[f * len..][..len]);
            }
        }
        let constant = parts.first().map_or_else(Vec::new, |part| part.1.clone());
        if !values.iter().chain(&constant).all(|value| value.is_finite()) {
            return Err(Error::NonFiniteKernel);
        }
        let mut all = vec![0.0; functions * order.pow(3)];
        for (f, all) in all.chunks_exact_mut(order.pow(3)).enumerate() {
            for (k, value) in all.iter_mut().enumerate() {
                let (mut sign, mut at) = (1.0, 0);
                for (axis, i) in axes(k).into_iter().enumerate() {
                    let is_reflected = i >= folded;
                    sign *= signs.filter(|_| is_reflected).map_or(1.0, |signs| signs[f][axis]);
                    let i = if is_reflected { order - 1 - i } else { i };
                    at = at * folded + i;
                }
                *value = sign * values[f * nodes.len() + at];
            }
        }
        rule.coefficients(&mut all);
        Ok((all, constant))
    }

    /// Σ_n w_n (K(d − y_n) − K(−y_n)) at some differences, function after function; and Σ_n w_n K(−y_n).
    fn differences(
        &self,
        ds: &[[f64; 3]],
        ys: &[Point<K::Real>],
        weights: &[f64],
    ) -> (Vec<f64>, Vec<f64>) {
        let (len, parts) = (self.kernel.fields() * self.kernel.densities(), K::Entry::PARTS);
        let mut xs: Vec<Point<K::Real>> = ds.iter().map(|d| point::<K::Real>(*d)).collect();
        xs.push(point::<K::Real>([0.0; 3]));
        let mut g = vec![<K::Entry as Numbers>::zero(); xs.len() * IMAGES * len];
        let mut sums = vec![0.0; len * parts * ds.len()];
        let mut constants = vec![0.0; len * parts];
        for (ys, weights) in ys.chunks(IMAGES).zip(weights.chunks(IMAGES)) {
            let g = &mut g[..xs.len() * ys.len() * len];
            self.kernel.entries_block(&xs, ys, g);
            let (g, at_zero) = g.split_at(ds.len() * ys.len() * len);
            for f in 0..len * parts {
                let number = |entry: &K::Entry| entry.parts()[f % parts].as_f64();
                let own = |g: &[K::Entry], k: usize| number(&g[k * len + f / parts]);
                let zeros: Vec<f64> = (0..ys.len()).map(|k| own(at_zero, k)).collect();
                constants[f] += zeros.iter().zip(weights).map(|(zero, w)| w * zero).sum::<f64>();
                let rows = g.chunks_exact(ys.len() * len);
                for (sum, row) in sums[f * ds.len()..][..ds.len()].iter_mut().zip(rows) {
                    let terms = zeros.iter().zip(weights).enumerate();
                    *sum += terms.map(|(k, (zero, w))| w * (own(row, k) - zero)).sum::<f64>();
                }
            }
        }
        (sums, constants)
    }

    /// The kernel's entries at a difference, part by part.
    pub(super) fn at(&self, d: [f64; 3]) -> Vec<f64> {
        let len = self.kernel.fields() * self.kernel.densities();
        let mut g = vec![<K::Entry as Numbers>::zero(); len];
        self.kernel.entries_block(&[point::<K::Real>(d)], &[point::<K::Real>([0.0; 3])], &mut g);
        g.iter()
            .flat_map(|g| g.parts().into_iter().take(K::Entry::PARTS))
            .map(Real::as_f64)
            .collect()
    }

    /// The sign that each function gets if a difference is reflected along an axis, if that is all that changes.
    pub(super) fn signs(&self) -> Option<Vec<[f64; 3]>> {
        let kernel = self.kernel;
        let block = |xs: &[Point<K::Real>], ys: &[Point<K::Real>], g: &mut [K::Entry]| {
            kernel.entries_block(xs, ys, g);
        };
        let entries = Entries::new(kernel.fields(), kernel.densities(), &block);
        let h = self.lattice.half_widths.into_iter().fold(0.0, f64::max);
        let Parities { fields, densities } = parities(&entries, K::Real::from_f64(h))?;
        let pairs = fields.iter().flat_map(|f| densities.iter().map(move |d| f ^ d));
        let sign = |bits: u8| [0, 1, 2].map(|axis| if bits >> axis & 1 == 1 { -1.0 } else { 1.0 });
        Some(pairs.flat_map(|bits| std::iter::repeat_n(sign(bits), K::Entry::PARTS)).collect())
    }

    /// How many functions there are: entries and their parts.
    pub(super) fn functions(&self) -> usize {
        self.kernel.fields() * self.kernel.densities() * K::Entry::PARTS
    }

    /// What the kernel comes to between points of the box: the median, so that no near pair makes it large.
    pub(super) fn size(&self) -> f64 {
        let size = |i: usize| {
            let p = sample::<f64>(i).to_array();
            l2_norm(self.at([0, 1, 2].map(|k| p[k] * self.lattice.half_widths[k])).into_iter())
        };
        let mut sizes: Vec<f64> = (0..SAMPLES).map(size).collect();
        *sizes.select_nth_unstable_by(SAMPLES / 2, f64::total_cmp).1
    }

    /// What rounding of the kernel itself leaves of a sum over the near images.
    pub(super) fn rounding(&self) -> f64 {
        let images = self.lattice.near_places().len() as f64;
        16.0 * images * <K::Real as Float>::epsilon().as_f64() * self.size()
    }
}

/// A place in the precision of a kernel.
fn point<T: Real>(p: [f64; 3]) -> Point<T> {
    Point::<T>::from_array(p.map(T::from_f64))
}

//! The entries of a kernel as set-up sees them.

use crate::error::Error;
use crate::expansion::weights::Weights;
use crate::interpolation::hashing::Digest;
use crate::interpolation::work::Work;
use crate::numbers::traits::{Numbers, Point, Scalar, Vector};

/// The entries of a kernel, G(x, y), with the kernel's type forgotten: what set-up works on.
pub(crate) struct Entries<'a, S: Scalar> {
    /// Rows of G.
    pub(crate) fields: usize,
    /// Columns of G.
    pub(crate) densities: usize,
    block: &'a Block<'a, S>,
    transposed: bool,
    /// What all entries are multiplied by.
    factor: Option<S>,
    /// What all points are multiplied by.
    length: Option<S::Real>,
    /// What rows and columns are multiplied by.
    weights: Option<&'a Weights>,
    work: Option<&'a Work>,
    /// What takes values as they are written.
    digest: Option<&'a Digest>,
}

/// Writes the entries of a block of pairs, as [`Kernel::entries_block`](crate::Kernel::entries_block).
type Block<'a, S> = dyn Fn(&[PointOf<S>], &[PointOf<S>], &mut [S]) + Sync + 'a;

/// A point in the precision of `S`.
pub(crate) type PointOf<S> = Point<<S as Numbers>::Real>;

impl<'a, S: Scalar> Entries<'a, S> {
    pub(crate) fn new(fields: usize, densities: usize, block: &'a Block<'a, S>) -> Self {
        let (factor, length, weights, work, digest) = (None, None, None, None, None);
        let transposed = false;
        Self { fields, densities, block, transposed, factor, length, weights, work, digest }
    }

    /// The same entries, evaluated at the expense of `work`.
    pub(crate) fn at_expense_of(self, work: &'a Work) -> Self {
        Self { work: Some(work), ..self }
    }

    /// The same entries, weighted.
    pub(crate) fn weighted_by<'b>(&'b self, weights: &'b Weights) -> Entries<'b, S> {
        Entries { weights: Some(weights), ..*self }
    }

    /// What rows and columns are multiplied by.
    pub(crate) fn weights(&self) -> Weights {
        self.weights.cloned().unwrap_or_default()
    }

    /// The same entries, of which `digest` takes what is written.
    pub(crate) fn digested_by<'b>(&'b self, digest: Option<&'b Digest>) -> Entries<'b, S> {
        Entries { digest, ..*self }
    }

    /// Refuses work that can't be afforded, see [`Work::spend`].
    pub(crate) fn spend(&self, multiply_adds: f64) -> Result<(), Error> {
        self.work.map_or(Ok(()), |work| work.spend(multiply_adds))
    }

    /// Whether so many probes can be afforded, see [`Work::afford_probes`].
    pub(crate) fn afford_probes(&self, evaluations: f64, multiply_adds: f64) -> Result<(), Error> {
        self.work.map_or(Ok(()), |work| work.afford_probes(evaluations, multiply_adds))
    }

    /// Counts multiply-adds that have been made.
    pub(crate) fn add_products(&self, multiply_adds: f64) {
        if let Some(work) = self.work {
            work.add_products(multiply_adds);
        }
    }

    /// Whether so much more could be afforded, see [`Work::afford`].
    pub(crate) fn afford(&self, evaluations: f64, multiply_adds: f64) -> Result<(), Error> {
        self.work.map_or(Ok(()), |work| work.afford(evaluations, multiply_adds))
    }

    /// Whether an application can afford so many evaluations, see [`Work::afford_application`].
    pub(crate) fn afford_application(&self, evaluations: f64) -> Result<(), Error> {
        self.work.map_or(Ok(()), |work| work.afford_application(evaluations))
    }

    /// The kernel G(y, x)ᵀ: what sources are to targets and targets to sources.
    pub(crate) fn transpose(&self) -> Self {
        let (fields, densities) = (self.densities, self.fields);
        Self { fields, densities, transposed: !self.transposed, ..*self }
    }

    /// The kernel times a number.
    pub(crate) fn times(&self, factor: S::Real) -> Self {
        let factor = S::from_real(factor);
        Self { factor: Some(self.factor.map_or(factor, |own| own * factor)), ..*self }
    }

    /// The kernel with lengths in that unit: G(length x, length y).
    pub(crate) fn in_lengths_of(&self, length: S::Real) -> Self {
        Self { length: Some(self.length.map_or(length, |own| own * length)), ..*self }
    }

    /// Writes the field of a source at points: for each density, for each component of the field, the
    /// values at all points.
    pub(crate) fn write_field(&self, xs: &[PointOf<S>], y: PointOf<S>, field: &mut [S]) {
        let len = self.fields * self.densities;
        if len == 1 {
            return self.write(xs, y, field);
        }
        let mut g = vec![zero::<S>(); xs.len() * len];
        self.write(xs, y, &mut g);
        for (i, g) in g.chunks_exact(len).enumerate() {
            for (k, &entry) in g.iter().enumerate() {
                let (row, column) = (k / self.densities, k % self.densities);
                field[(column * self.fields + row) * xs.len() + i] = entry;
            }
        }
    }

    /// The matrix at (x, y), row after row.
    pub(crate) fn at(&self, x: PointOf<S>, y: PointOf<S>) -> Vec<S> {
        let mut g = vec![zero::<S>(); self.fields * self.densities];
        self.write(&[x], y, &mut g);
        g
    }

    /// Writes the matrices at (x_i, y), one after the other, each row after row.
    pub(crate) fn write(&self, xs: &[PointOf<S>], y: PointOf<S>, g: &mut [S]) {
        if let Some(work) = self.work {
            work.add_evaluations(xs.len());
        }
        match self.length {
            Some(length) => {
                let scaled: Vec<PointOf<S>> = xs.iter().map(|&x| x * length).collect();
                self.write_block(&scaled, y * length, g);
            }
            None => self.write_block(xs, y, g),
        }
        if let Some(factor) = self.factor {
            g.iter_mut().for_each(|entry| *entry *= factor);
        }
        if let Some(digest) = self.digest.filter(|_| Digest::takes(&y.to_array())) {
            digest.add(g);
        }
    }

    fn write_block(&self, xs: &[PointOf<S>], y: PointOf<S>, g: &mut [S]) {
        let weigh = |rows: usize, g: &mut [S]| {
            self.weights.into_iter().for_each(|weights| weights.apply(rows, g));
        };
        if self.transposed {
            (self.block)(&[y], xs, g);
            weigh(self.densities, g);
            self.transpose_each(g);
        } else {
            (self.block)(xs, &[y], g);
            weigh(self.fields, g);
        }
    }

    /// From matrices of the kernel itself to those of its transpose.
    fn transpose_each(&self, g: &mut [S]) {
        let len = self.fields * self.densities;
        if len == 1 {
            return;
        }
        let mut original = vec![zero::<S>(); len];
        for g in g.chunks_exact_mut(len) {
            original.copy_from_slice(g);
            for (k, entry) in g.iter_mut().enumerate() {
                *entry = original[k % self.densities * self.fields + k / self.densities];
            }
        }
    }
}

pub(crate) fn zero<S: Scalar>() -> S {
    <S as Numbers>::zero()
}

pub(crate) fn norm_squared<S: Scalar>(g: &[S]) -> f64 {
    g.iter().map(Numbers::norm_squared).sum()
}

/// The block of a formula that is given pair by pair.
#[cfg(test)]
pub(crate) fn pairwise(
    len: usize,
    pair: impl Fn(glam::DVec3, glam::DVec3, &mut [f64]) + Sync,
) -> impl Fn(&[glam::DVec3], &[glam::DVec3], &mut [f64]) + Sync {
    move |xs, ys, g| {
        let pairs = xs.iter().flat_map(|x| ys.iter().map(move |y| (*x, *y)));
        pairs.zip(g.chunks_exact_mut(len)).for_each(|((x, y), g)| pair(x, y, g));
    }
}

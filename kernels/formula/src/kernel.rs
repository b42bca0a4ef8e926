//! A text as a kernel of the engine.

use std::fmt;
use std::marker::PhantomData;
use std::sync::Arc;

use farfield::{Error, Extended, Kernel, Located, Numbers, Outcome, Point, Real, Vector};

use crate::formula::{Coincident, TextFormula};
use crate::machine::cost::pair_seconds;
use crate::machine::entries::BlockEntries;
use crate::machine::extended;
use crate::machine::program::Program;
use crate::machine::sums::BlockSums;

/// The kernel of a [`TextFormula`]: points of type `P`, charges `Q`, values `U`.
///
/// A charge holds a number for each density of the formula, in every column. A value holds a number for each of its
/// fields in every column; with [`gradient`](Self::gradient), the derivatives of all of them along the first axis
/// follow, then those along the second and the third; with [`hessian`](Self::hessian), six second derivatives as
/// well, in the order of [`WithHessian`](farfield::WithHessian). So [`WithGradient`](farfield::WithGradient), arrays
/// and lists (`Vec`) of as many numbers all serve.
pub struct TextKernel<P: Located, Q, U = Q> {
    formula: TextFormula,
    /// The entries alone.
    entries: Arc<Program<P::Real>>,
    /// The entries, and their derivatives if they are asked for.
    parts: Arc<Program<P::Real>>,
    derivatives: Derivatives,
    columns: Option<usize>,
    types: PhantomData<fn(P, Q) -> U>,
}

/// What is summed beside values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Derivatives {
    None,
    First,
    /// First and second, as further fields.
    Second,
}

impl TextFormula {
    /// The kernel of the formula, for points of type `P`, charges `Q` and values `U`, which follow from what is summed.
    ///
    /// ```
    /// use farfield::direct;
    /// use farfield_formula::TextFormula;
    ///
    /// let yukawa = TextFormula::new("exp(-k*r)/r", &[("k", 2.0)])?.kernel();
    /// let sum: Vec<f64> = direct(&yukawa, &[[0.0; 3]], &[1.0], &[[0.5, 0.0, 0.0]])?;
    /// assert!((sum[0] - 2.0 * f64::exp(-1.0)).abs() < 1e-15);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn kernel<P: Located, Q, U>(&self) -> TextKernel<P, Q, U> {
        TextKernel::new(self.clone())
    }
}

impl<P: Located, Q, U> TextKernel<P, Q, U> {
    fn new(formula: TextFormula) -> Self {
        let entries = Arc::new(formula.program());
        let (parts, derivatives) = (Arc::clone(&entries), Derivatives::None);
        Self { formula, entries, parts, derivatives, columns: None, types: PhantomData }
    }

    /// The same kernel with the gradient of its sum as part of the value. Where a point meets itself, as in sums over
    /// one set of points, pairs are skipped unless the formula [says otherwise](TextFormula::coincident); it has to
    /// have derivatives there then.
    pub fn gradient<V>(self) -> TextKernel<P, Q, V> {
        let parts = Arc::new(self.formula.program_with_gradient());
        self.with(parts, Derivatives::First)
    }

    /// The same kernel with the gradient and the second derivatives of its sum as part of the value. They are summed
    /// as further fields: ten times as many.
    pub fn hessian<V>(self) -> TextKernel<P, Q, V> {
        let parts = Arc::new(self.formula.program_with_hessian());
        self.with(parts, Derivatives::Second)
    }

    /// The number of right-hand sides, for charges that are lists (`Vec<f64>`). Other charges say it by their type.
    pub fn with_columns(self, columns: usize) -> Self {
        Self { columns: Some(columns), ..self }
    }

    fn with<V>(
        self,
        parts: Arc<Program<P::Real>>,
        derivatives: Derivatives,
    ) -> TextKernel<P, Q, V> {
        let Self { formula, entries, columns, .. } = self;
        // Second derivatives are entries like all others.
        let entries = if derivatives == Derivatives::Second { Arc::clone(&parts) } else { entries };
        TextKernel { formula, entries, parts, derivatives, columns, types: PhantomData }
    }

    /// Values and their derivatives, for one value.
    fn parts_of_a_value(&self) -> usize {
        match self.derivatives {
            Derivatives::None => 1,
            Derivatives::First => 4,
            Derivatives::Second => 10,
        }
    }
}

impl<P: Located, Q, U> Clone for TextKernel<P, Q, U> {
    fn clone(&self) -> Self {
        Self {
            formula: self.formula.clone(),
            entries: Arc::clone(&self.entries),
            parts: Arc::clone(&self.parts),
            derivatives: self.derivatives,
            columns: self.columns,
            types: PhantomData,
        }
    }
}

impl<P: Located, Q, U> fmt::Debug for TextKernel<P, Q, U> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("TextKernel")
            .field("text", &self.formula.text())
            .field("derivatives", &self.derivatives)
            .finish_non_exhaustive()
    }
}

impl<P, Q, U> Kernel for TextKernel<P, Q, U>
where
    P: Located,
    Q: Numbers<Real = P::Real>,
    U: Numbers<Real = P::Real>,
{
    type Real = P::Real;
    type Source = P;
    type Target = P;
    type Charge = Q;
    type Value = U;
    type Entry = P::Real;

    fn entries(&self, x: Point<P::Real>, y: Point<P::Real>, g: &mut [P::Real]) {
        self.entries_block(&[x], &[y], g);
    }

    fn fields(&self) -> usize {
        let copies = if self.derivatives == Derivatives::Second { 10 } else { 1 };
        copies * self.formula.rows()
    }

    fn densities(&self) -> usize {
        self.formula.columns()
    }

    fn columns(&self) -> usize {
        if Q::LEN > 0 { Q::LEN / self.densities() } else { self.columns.unwrap_or(0) }
    }

    fn check_sizes(&self) -> Result<(), Error> {
        let (densities, columns) = (self.densities(), self.columns());
        if Q::LEN == 0 && columns == 0 {
            return Err(Error::UnknownColumns);
        }
        if columns == 0 || Q::LEN > 0 && Q::LEN != densities * columns {
            return Err(Error::KernelSize { what: "charge", expected: densities, found: Q::LEN });
        }
        let expected = self.parts_of_a_value() * self.formula.rows();
        if U::LEN == 0 || U::LEN == expected * columns {
            Ok(())
        } else {
            Err(Error::KernelSize { what: "value", expected, found: U::LEN })
        }
    }

    fn value(&self, _: &P, fields: &[P::Real], gradients: &[[P::Real; 3]], u: &mut U) {
        let slopes = (0..3).flat_map(|axis| gradients.iter().map(move |gradient| gradient[axis]));
        add(fields.iter().copied().chain(slopes), u);
    }

    fn needs_gradients(&self) -> bool {
        self.derivatives == Derivatives::First
    }

    fn identity(&self) -> Option<String> {
        let what = self.formula.identity();
        let second = self.derivatives == Derivatives::Second;
        Some(if second { format!("second derivatives of {what}") } else { what })
    }

    fn pair_seconds(&self, _tolerance: f64) -> f64 {
        pair_seconds(&self.parts, self.columns())
    }

    fn sizes(&self, x: Point<P::Real>, y: Point<P::Real>) -> Option<[f64; 2]> {
        match self.formula.at_coincident_points() {
            Coincident::Skip if x == y => return Some([0.0; 2]),
            Coincident::Value(value) if x == y => return Some([value.abs(), 0.0]),
            _ => {}
        }
        let parts = extended::entries(&self.parts, (x.to_array(), y.to_array()));
        let values = self.formula.rows() * self.formula.columns();
        let (values, slopes) = parts.split_at(values.min(parts.len()));
        let largest = |numbers: &[Extended<P::Real>]| {
            numbers.iter().map(|number| number.size()).fold(0.0, f64::max)
        };
        Some([largest(values), largest(slopes)])
    }

    fn entry_gradients(
        &self,
        x: Point<P::Real>,
        y: Point<P::Real>,
        g: &mut [[P::Real; 3]],
    ) -> Outcome {
        if self.derivatives != Derivatives::First {
            return Outcome::Declined;
        }
        let len = g.len();
        let mut entries = vec![P::Real::from_f64(0.0); 4 * len];
        let (xs, ys) = (&[x.to_array()], &[y.to_array()]);
        BlockEntries { program: &self.parts, xs, ys, entries: &mut entries }.write();
        for (k, g) in g.iter_mut().enumerate() {
            *g = [1, 2, 3].map(|part| entries[part * len + k]);
        }
        Outcome::Done
    }

    fn entries_block(&self, xs: &[Point<P::Real>], ys: &[Point<P::Real>], g: &mut [P::Real]) {
        let (xs, ys) = (coordinates(xs), coordinates(ys));
        BlockEntries { program: &self.entries, xs: &xs, ys: &ys, entries: g }.write();
    }

    fn add_block(&self, xs: &[P], ys: &[P], qs: &[Q], _tolerance: f64, us: &mut [U]) {
        let (densities, columns) = (self.densities(), self.columns());
        let zero = P::Real::from_f64(0.0);
        let mut sent = vec![zero; ys.len() * densities * columns];
        for (k, sent) in sent.chunks_exact_mut(ys.len().max(1)).enumerate() {
            sent.iter_mut().zip(qs).for_each(|(sent, q)| *sent = q.number(k));
        }
        let rows = self.parts_of_a_value() * self.formula.rows() * columns;
        let mut sums = vec![zero; xs.len() * rows];
        let coincident = match self.formula.at_coincident_points() {
            Coincident::Skip => Some(zero),
            Coincident::Value(value) => Some(P::Real::from_f64(value)),
            Coincident::Formula => None,
        };
        BlockSums {
            program: &self.parts,
            densities,
            columns,
            coincident,
            xs: &coordinates(xs),
            ys: &coordinates(ys),
            sent: &sent,
            sums: &mut sums,
        }
        .add();
        for (sums, u) in sums.chunks_exact(rows.max(1)).zip(us) {
            add(sums.iter().copied(), u);
        }
    }
}

/// Adds numbers to those of a value.
fn add<U: Numbers>(numbers: impl Iterator<Item = U::Real>, u: &mut U) {
    numbers.enumerate().for_each(|(k, number)| u.set_number(k, u.number(k) + number));
}

fn coordinates<P: Located>(points: &[P]) -> Vec<[P::Real; 3]> {
    points.iter().map(|p| p.position().to_array()).collect()
}

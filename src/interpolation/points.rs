//! P2M and L2P in polynomials: P2M runs along padded rows of coefficients, L2P along points.
//!
//! What is not inlined into the function that `pulp` compiles for the machine runs without its registers;
//! hence loops where closures would be shorter.
//!
//! The array of one column of right-hand sides holds the coefficient of T̂_i(x) T̂_j(y) T̂_k(z) at
//! i · [`row`]`(n)` + j · n + k.

use pulp::{Simd, WithSimd};

use crate::dispatch_level::dispatch;
use crate::interpolation::basis::Basis;
use crate::interpolation::chebyshev::{derivatives_in_lanes, polynomials_in_lanes};
use crate::interpolation::lanes::{fuse, row};
use crate::interpolation::rows::{add_rows, along_rows, multiply};
use crate::interpolation::tuning::{MAX_ORDER, POINTS_TOGETHER, ROWS_TOGETHER};
use crate::numbers::compiled::Compiled;
use crate::numbers::lane::LANES;
use crate::numbers::traits::{Real, Scalar};

/// P2M of a cell.
pub(crate) struct Moments<'a, S: Scalar> {
    pub(crate) basis: &'a Basis<S>,
    pub(crate) powers: &'a mut Powers<S::Real>,
    /// Sources in half-widths.
    pub(crate) points: &'a [[S::Real; 3]],
    /// Densities, an array per right-hand side, part and component.
    pub(crate) numbers: &'a [S::Real],
    /// Zeros; Chebyshev moments afterwards.
    pub(crate) arrays: &'a mut [S::Real],
    pub(crate) sums: &'a mut Vec<S>,
    /// What to add to.
    pub(crate) multipole: &'a mut [S],
}

/// [`Moments::add`].
type AddMoments<S> = fn(Moments<'_, S>);
static ADD_MOMENTS: Compiled<AddMoments<f32>, AddMoments<f64>> = Compiled(add_moments, add_moments);

fn add_moments<S: Scalar>(moments: Moments<'_, S>) {
    dispatch(moments);
}

impl<S: Scalar> Moments<'_, S> {
    pub(crate) fn add(self) {
        let add =
            if const { S::COMPLEX } { add_moments } else { ADD_MOMENTS.of::<AddMoments<S>>() };
        add(self);
    }
}

impl<S: Scalar> WithSimd for Moments<'_, S> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: Simd>(self, _: V) {
        let Self { basis, powers, points, numbers, arrays, sums, multipole } = self;
        if multipole.is_empty() {
            return;
        }
        powers.add_moments::<V>(points, numbers, arrays);
        let len = arrays.len() / (multipole.len() / basis.rank());
        for (m, arrays) in multipole.chunks_exact_mut(basis.rank()).zip(arrays.chunks_exact(len)) {
            let (re, im) = arrays.split_at(len / S::PARTS);
            basis.add_moments::<V>(powers.n, [re, if im.is_empty() { re } else { im }], sums, m);
        }
    }
}

/// L2P of a cell, before attributes are applied.
pub(crate) struct Fields<'a, S: Scalar> {
    pub(crate) basis: &'a Basis<S>,
    pub(crate) powers: &'a mut Powers<S::Real>,
    /// Targets in half-widths.
    pub(crate) points: &'a [[S::Real; 3]],
    /// What to add to: fields, an array per right-hand side, part and component; after each those of
    /// the three derivatives, if asked for.
    pub(crate) numbers: &'a mut [S::Real],
    /// Zeros; coefficients afterwards.
    pub(crate) arrays: &'a mut [S::Real],
    pub(crate) local: &'a [S],
    pub(crate) gradient: bool,
}

/// [`Fields::add`].
type AddFields<S> = fn(Fields<'_, S>);
static ADD_FIELDS: Compiled<AddFields<f32>, AddFields<f64>> = Compiled(add_fields, add_fields);

fn add_fields<S: Scalar>(fields: Fields<'_, S>) {
    dispatch(fields);
}

impl<S: Scalar> Fields<'_, S> {
    pub(crate) fn add(self) {
        let add = if const { S::COMPLEX } { add_fields } else { ADD_FIELDS.of::<AddFields<S>>() };
        add(self);
    }
}

impl<S: Scalar> WithSimd for Fields<'_, S> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: Simd>(self, _: V) {
        let Self { basis, powers, points, numbers, arrays, local, gradient } = self;
        if local.is_empty() {
            return;
        }
        let len = arrays.len() / (local.len() / basis.rank());
        for (l, arrays) in local.chunks_exact(basis.rank()).zip(arrays.chunks_exact_mut(len)) {
            let (re, im) = arrays.split_at_mut(len / S::PARTS);
            basis.add_coefficients::<V>(powers.n, l, [re, im]);
        }
        powers.add_fields::<V>(points, arrays, gradient, numbers);
    }
}

/// The polynomials at some points.
pub(crate) struct Powers<T> {
    n: usize,
    /// T̂_i(x), T̂_j(y), T̂_k(z) at [`LANES`] points, and their derivatives.
    values: [[[T; LANES]; MAX_ORDER]; 3],
    slopes: [[[T; LANES]; MAX_ORDER]; 3],
    /// T̂_i(x) at [`POINTS_TOGETHER`] points, and with densities as factors.
    x: [[T; POINTS_TOGETHER]; MAX_ORDER],
    dx: [[T; POINTS_TOGETHER]; MAX_ORDER],
    /// T̂_j(y) T̂_k(z), a row per point, zeros after each, and room for a register.
    yz: Vec<T>,
}

impl<T: Real> Powers<T> {
    pub(crate) fn new(n: usize) -> Self {
        let zero = T::from_f64(0.0);
        let (values, x) = ([[[zero; LANES]; MAX_ORDER]; 3], [[zero; POINTS_TOGETHER]; MAX_ORDER]);
        let yz = vec![zero; POINTS_TOGETHER * row(n) + MAX_ORDER];
        Self { n, values, slopes: values, x, dx: x, yz }
    }

    /// m̃ += Σ_p T̂(y_p) d_p for every column: `densities` holds the columns of all points one after the
    /// other, `moments` the columns' arrays.
    #[inline(always)]
    pub(crate) fn add_moments<V: Simd>(
        &mut self,
        points: &[[T; 3]],
        densities: &[T],
        moments: &mut [T],
    ) {
        let (n, row) = (self.n, row(self.n));
        for (chunk, together) in points.chunks(POINTS_TOGETHER).enumerate() {
            self.tabulate(together);
            let columns = densities.chunks_exact(points.len());
            for (moments, densities) in moments.chunks_exact_mut(n * row).zip(columns) {
                let densities = &densities[chunk * POINTS_TOGETHER..][..together.len()];
                for (dx, x) in self.dx[..n].iter_mut().zip(&self.x) {
                    for ((dx, &x), &d) in dx.iter_mut().zip(x).zip(densities) {
                        *dx = d * x;
                    }
                }
                let (fours, rest) = self.dx[..n].as_chunks::<ROWS_TOGETHER>();
                let mut moments = moments.chunks_exact_mut(row * ROWS_TOGETHER);
                for (dx, moments) in fours.iter().zip(&mut moments) {
                    add_rows::<V, T, ROWS_TOGETHER>(dx, &self.yz, together.len(), row, moments);
                }
                let moments = moments.into_remainder().chunks_exact_mut(row);
                for (dx, moments) in rest.iter().zip(moments) {
                    let dx = std::array::from_ref(dx);
                    add_rows::<V, T, 1>(dx, &self.yz, together.len(), row, moments);
                }
            }
        }
    }

    /// f_p += Σ T̂(x_p) f̃ for every column of coefficients f̃: `fields` holds the columns of all points
    /// one after the other. With `gradients`, four columns each: f and its derivatives in half-widths.
    #[inline(always)]
    pub(crate) fn add_fields<V: Simd>(
        &mut self,
        points: &[[T; 3]],
        coefficients: &[T],
        gradients: bool,
        fields: &mut [T],
    ) {
        let (n, row) = (self.n, row(self.n));
        let parts: usize = if gradients { 4 } else { 1 };
        let count = points.len();
        for (chunk, side_by_side) in points.chunks(LANES).enumerate() {
            self.set(side_by_side, gradients);
            for (c, coefficients) in coefficients.chunks_exact(n * row).enumerate() {
                let sums = if gradients {
                    self.fields::<V, true>(coefficients)
                } else {
                    self.fields::<V, false>(coefficients)
                };
                for (part, sums) in sums[..parts].iter().enumerate() {
                    let fields = &mut fields[(c * parts + part) * count + chunk * LANES..];
                    let fields = &mut fields[..side_by_side.len()];
                    for (field, &sum) in fields.iter_mut().zip(sums) {
                        *field += sum;
                    }
                }
            }
        }
    }

    /// The polynomials at up to [`LANES`] points; other lanes repeat the last.
    #[inline(always)]
    fn set(&mut self, points: &[[T; 3]], slopes: bool) {
        let n = self.n;
        for (axis, (values, derivatives)) in
            self.values.iter_mut().zip(&mut self.slopes).enumerate()
        {
            let mut at = [T::from_f64(0.0); LANES];
            for (p, at) in at.iter_mut().enumerate() {
                *at = points[p.min(points.len() - 1)][axis];
            }
            polynomials_in_lanes(&at, &mut values[..n]);
            if slopes {
                derivatives_in_lanes(&at, &mut derivatives[..n]);
            }
        }
    }

    /// `x` and `yz` of up to [`POINTS_TOGETHER`] points.
    #[inline(always)]
    fn tabulate(&mut self, points: &[[T; 3]]) {
        let (n, row) = (self.n, row(self.n));
        for (chunk, side_by_side) in points.chunks(LANES).enumerate() {
            self.set(side_by_side, false);
            let [x, y, z] = &self.values;
            for (to, x) in self.x.iter_mut().zip(&x[..n]) {
                to[chunk * LANES..][..LANES].copy_from_slice(x);
            }
            let mut of_point = [[T::from_f64(0.0); MAX_ORDER]; LANES];
            for (k, z) in z[..n].iter().enumerate() {
                for (to, &z) in of_point.iter_mut().zip(z) {
                    to[k] = z;
                }
            }
            for (p, z) in of_point[..side_by_side.len()].iter().enumerate() {
                // Whole registers: what is written too far is a zero or overwritten by the next.
                let yz = &mut self.yz[(chunk * LANES + p) * row..];
                let (low, high) = z.split_at(LANES);
                for (j, y) in y[..n].iter().enumerate() {
                    multiply(y[p], low, &mut yz[j * n..]);
                    if n > LANES {
                        multiply(y[p], high, &mut yz[j * n + LANES..]);
                    }
                }
            }
        }
    }

    /// Σ_ijk c_ijk T̂_i(x) T̂_j(y) T̂_k(z) at [`LANES`] points, and its three derivatives.
    #[inline(always)]
    fn fields<V: Simd, const GRADIENT: bool>(&self, coefficients: &[T]) -> [[T; LANES]; 4] {
        let (n, row) = (self.n, row(self.n));
        let [x, y, z] = &self.values;
        let [dx, dy, dz] = &self.slopes;
        let (y, z, dy, dz) = (&y[..n], &z[..n], &dy[..n], &dz[..n]);
        let zero = [T::from_f64(0.0); LANES];
        let mut sums = [zero; 4];
        for (i, plane) in coefficients.chunks_exact(row).enumerate() {
            // Σ_jk c_ijk T̂_j(y) T̂_k(z), with T̂_j'(y), with T̂_k'(z)
            let mut along = [zero; 3];
            let mut j = 0;
            while j + ROWS_TOGETHER <= n {
                along_rows::<V, T, ROWS_TOGETHER, GRADIENT>(
                    &plane[j * n..],
                    j,
                    [y, dy, z, dz],
                    &mut along,
                );
                j += ROWS_TOGETHER;
            }
            while j < n {
                along_rows::<V, T, 1, GRADIENT>(&plane[j * n..], j, [y, dy, z, dz], &mut along);
                j += 1;
            }
            fuse::<V, T>(&along[0], &x[i], &mut sums[0]);
            if GRADIENT {
                fuse::<V, T>(&along[0], &dx[i], &mut sums[1]);
                fuse::<V, T>(&along[1], &x[i], &mut sums[2]);
                fuse::<V, T>(&along[2], &x[i], &mut sums[3]);
            }
        }
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dispatch_level::DispatchLevel;
    use crate::interpolation::chebyshev::polynomials;

    /// Moments of unit densities, then fields and derivatives of `coefficients`.
    struct Both<'a>(usize, &'a [[f64; 3]], &'a [f64]);

    impl WithSimd for Both<'_> {
        type Output = [Vec<f64>; 2];

        #[inline(always)]
        fn with_simd<V: Simd>(self, _: V) -> [Vec<f64>; 2] {
            let Self(n, points, coefficients) = self;
            let mut powers = Powers::new(n);
            let (mut moments, mut fields) = (vec![0.0; n * row(n)], vec![0.0; 4 * points.len()]);
            powers.add_moments::<V>(points, &vec![1.0; points.len()], &mut moments);
            powers.add_fields::<V>(points, coefficients, true, &mut fields);
            [moments, fields]
        }
    }

    /// T̂_i(x), or its derivative, as plain numbers.
    fn at(n: usize, x: f64, slope: bool) -> Vec<f64> {
        let mut values = vec![0.0; n];
        if slope {
            derivatives_in_lanes(&[x], values.as_chunks_mut().0)
        } else {
            polynomials(x, &mut values)
        }
        values
    }

    #[test]
    fn sums_over_points_are_those_of_the_polynomials() {
        for (n, count) in [(1, 1), (2, 5), (4, 8), (7, 9), (8, 33), (9, 3), (13, 65), (16, 31)] {
            let place = |i: usize, j: usize, k: usize| i * row(n) + j * n + k;
            let number = |k: usize| (0.7 * (k + 1) as f64).sin();
            let points: Vec<[f64; 3]> =
                (0..count).map(|p| [number(3 * p), number(3 * p + 1), number(3 * p + 2)]).collect();
            let coefficients: Vec<f64> = (0..n * row(n)).map(number).collect();
            let (mut moments, mut fields) = (vec![0.0; n * row(n)], vec![0.0; 4 * count]);
            for (p, point) in points.iter().enumerate() {
                for part in 0..4 {
                    let [x, y, z]: [Vec<f64>; 3] =
                        std::array::from_fn(|axis| at(n, point[axis], part == axis + 1));
                    for (i, x) in x.iter().enumerate() {
                        for (j, y) in y.iter().enumerate() {
                            for (k, z) in z.iter().enumerate() {
                                let product = x * y * z;
                                fields[part * count + p] += product * coefficients[place(i, j, k)];
                                if part == 0 {
                                    moments[place(i, j, k)] += product;
                                }
                            }
                        }
                    }
                }
            }
            let both = || Both(n, &points, &coefficients);
            for level in DispatchLevel::available() {
                let got = level.run(both());
                for (got, exact) in got.iter().zip([&moments, &fields]) {
                    let error = crate::relative_l2_error(got, exact);
                    assert!(error < 1e-13, "{level}, order {n}, {count} points: {error:e}");
                }
            }
        }
    }
}

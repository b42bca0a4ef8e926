//! One small matrix times many vectors that lie anywhere: no vector is copied together before, none
//! apart after.
//!
//! For matrices of 10 to 100 rows, as in M2L, the copies cost as much as the products: without them it is
//! 1.3 to 2 times as fast as a general product, which serves larger matrices better.

use num_complex::Complex;
use pulp::{Simd, WithSimd};

use crate::linalg::matrix::Matrix;

/// A matrix whose columns are filled up with zeros to whole registers.
#[derive(Debug)]
pub struct Batched<S> {
    pub(crate) rows: usize,
    pub(crate) columns: usize,
    /// Rows with the zeros that fill them up.
    pub(crate) height: usize,
    /// Column after column.
    pub(crate) entries: Vec<S>,
}

/// Bytes of the widest registers.
const REGISTER_BYTES: usize = 64;

impl<S: Copy + Default> Batched<S> {
    pub(crate) fn new(matrix: &Matrix<S>) -> Self {
        let Matrix { rows, columns, .. } = *matrix;
        let height = Self::height_of(rows);
        let mut entries = Vec::with_capacity(height * columns);
        for j in 0..columns {
            entries.extend_from_slice(matrix.column(j));
            entries.resize((j + 1) * height, S::default());
        }
        Self { rows, columns, height, entries }
    }

    /// How many rows this many are with those that fill them up.
    pub(crate) fn height_of(rows: usize) -> usize {
        rows.next_multiple_of(REGISTER_BYTES / size_of::<S>())
    }
}

/// [`Batched::products`], for the widest registers there are.
pub(crate) struct Products<'a, S> {
    pub(crate) matrix: &'a Batched<S>,
    pub(crate) places: &'a [[usize; 2]],
    pub(crate) add: bool,
    pub(crate) from: &'a [S],
    pub(crate) to: &'a mut [S],
}

/// Registers of one column that are multiplied together.
const STRIP: usize = 3;

impl<S: Registers> WithSimd for Products<'_, S> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: Simd>(mut self, simd: V) {
        let height = self.matrix.height * size_of::<S>() / size_of::<S::Register<V>>();
        let mut first = 0;
        while first < height {
            match height - first {
                1 => self.strip::<V, 1>(simd, first),
                // Four are two and two.
                2 | 4 => self.strip::<V, 2>(simd, first),
                _ => self.strip::<V, STRIP>(simd, first),
            }
            first += if height - first == 4 { 2 } else { STRIP };
        }
    }
}

impl<S: Registers> Products<'_, S> {
    /// H registers of every product, from the `first` of each column on: as many vectors at a time as
    /// the machine has registers for their sums.
    #[inline(always)]
    fn strip<V: Simd, const H: usize>(&mut self, simd: V, first: usize) {
        let places = self.places;
        let rest = if V::REGISTER_COUNT >= 32 {
            self.vectors::<V, H, 8>(simd, first, places)
        } else {
            self.vectors::<V, H, 4>(simd, first, places)
        };
        self.vectors::<V, H, 1>(simd, first, rest);
    }

    /// The same for as many groups of C vectors as there are; the places that are left over.
    #[inline(always)]
    fn vectors<'p, V: Simd, const H: usize, const C: usize>(
        &mut self,
        simd: V,
        first: usize,
        places: &'p [[usize; 2]],
    ) -> &'p [[usize; 2]] {
        let Batched { columns, height, ref entries, .. } = *self.matrix;
        let (groups, rest) = places.as_chunks::<C>();
        for places in groups {
            let mut xs = [&self.from[..columns]; C];
            for (xs, [x, _]) in xs.iter_mut().zip(places) {
                *xs = &self.from[*x..][..columns];
            }
            let sums = tile::<V, S, H, C>(simd, S::registers::<V>(entries), first, xs);
            for ([_, y], sums) in places.iter().zip(&sums) {
                let y = &mut S::registers_mut::<V>(&mut self.to[*y..][..height])[first..][..H];
                for (y, &sum) in y.iter_mut().zip(sums) {
                    *y = if self.add { S::plus(simd, *y, sum) } else { sum };
                }
            }
        }
        rest
    }
}

/// Registers `first` … of A x for C vectors x.
#[inline(always)]
fn tile<V: Simd, S: Registers, const H: usize, const C: usize>(
    simd: V,
    entries: &[S::Register<V>],
    first: usize,
    mut xs: [&[S]; C],
) -> [[S::Register<V>; H]; C] {
    let mut sums = [[S::splat(simd, S::ZERO); H]; C];
    let columns = xs[0].len();
    for x in &mut xs {
        // All have this length; now the compiler knows.
        *x = &x[..columns];
    }
    for (k, column) in entries.chunks_exact((entries.len() / columns.max(1)).max(1)).enumerate() {
        let Some(column) = column[first..].first_chunk::<H>().filter(|_| k < columns) else {
            break;
        };
        for (x, sums) in xs.iter().zip(&mut sums) {
            let x = S::splat(simd, x[k]);
            for (sum, &a) in sums.iter_mut().zip(column) {
                *sum = S::plus_product(simd, a, x, *sum);
            }
        }
    }
    sums
}

/// Numbers with registers of them: f32, f64 and the complex numbers over them.
pub(crate) trait Registers: Copy {
    /// 0
    const ZERO: Self;

    /// Some numbers side by side.
    type Register<V: Simd>: Copy;

    /// `numbers` but for those that fill no register.
    fn registers<V: Simd>(numbers: &[Self]) -> &[Self::Register<V>];

    /// `numbers` but for those that fill no register.
    fn registers_mut<V: Simd>(numbers: &mut [Self]) -> &mut [Self::Register<V>];

    /// The same number everywhere.
    fn splat<V: Simd>(simd: V, a: Self) -> Self::Register<V>;

    /// a + b
    fn plus<V: Simd>(simd: V, a: Self::Register<V>, b: Self::Register<V>) -> Self::Register<V>;

    /// a b + c, rounded once where the processor can do that.
    fn plus_product<V: Simd>(
        simd: V,
        a: Self::Register<V>,
        b: Self::Register<V>,
        c: Self::Register<V>,
    ) -> Self::Register<V>;
}

macro_rules! registers {
    (
        $t:ty, $zero:expr, $register:ident, $as_simd:ident, $as_mut_simd:ident, $splat:ident,
        $add:ident, $mul:ident, $mul_add:ident
    ) => {
        impl Registers for $t {
            const ZERO: Self = $zero;
            type Register<V: Simd> = V::$register;

            #[inline(always)]
            fn registers<V: Simd>(numbers: &[$t]) -> &[V::$register] {
                V::$as_simd(numbers).0
            }
            #[inline(always)]
            fn registers_mut<V: Simd>(numbers: &mut [$t]) -> &mut [V::$register] {
                V::$as_mut_simd(numbers).0
            }
            #[inline(always)]
            fn splat<V: Simd>(simd: V, a: $t) -> V::$register {
                simd.$splat(a)
            }
            #[inline(always)]
            fn plus<V: Simd>(simd: V, a: V::$register, b: V::$register) -> V::$register {
                simd.$add(a, b)
            }
            #[inline(always)]
            fn plus_product<V: Simd>(
                simd: V,
                a: V::$register,
                b: V::$register,
                c: V::$register,
            ) -> V::$register {
                if V::IS_SCALAR {
                    // Complex numbers would be multiplied by calls of a function that rounds once.
                    simd.$add(simd.$mul(a, b), c)
                } else {
                    simd.$mul_add(a, b, c)
                }
            }
        }
    };
}

registers!(
    f32,
    0.0,
    f32s,
    as_simd_f32s,
    as_mut_simd_f32s,
    splat_f32s,
    add_f32s,
    mul_f32s,
    mul_add_e_f32s
);
registers!(
    f64,
    0.0,
    f64s,
    as_simd_f64s,
    as_mut_simd_f64s,
    splat_f64s,
    add_f64s,
    mul_f64s,
    mul_add_e_f64s
);
registers!(
    Complex<f32>,
    Complex::new(0.0, 0.0),
    c32s,
    as_simd_c32s,
    as_mut_simd_c32s,
    splat_c32s,
    add_c32s,
    mul_e_c32s,
    mul_add_c32s
);
registers!(
    Complex<f64>,
    Complex::new(0.0, 0.0),
    c64s,
    as_simd_c64s,
    as_mut_simd_c64s,
    splat_c64s,
    add_c64s,
    mul_e_c64s,
    mul_add_c64s
);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numbers::traits::Scalar;

    /// Against the products of `dense`: shapes below, at and above whole strips and groups; vectors out
    /// of order and apart.
    fn check<S: Scalar>(bound: f64, number: impl Fn(usize) -> S) {
        for (rows, columns) in
            [(3, 0), (1, 1), (5, 3), (16, 7), (17, 40), (48, 9), (63, 25), (130, 11)]
        {
            let a = Matrix::from_fn(rows, columns, |i, j| number(31 * i + 17 * j));
            let padded = Batched::new(&a);
            for count in [1, 3, 8, 21] {
                let from: Vec<S> = (0..count * (columns + 2)).map(|k| number(k * k)).collect();
                let places: Vec<[usize; 2]> = (0..count)
                    .map(|k| [k * (columns + 2) + 1, (count - 1 - k) * padded.height])
                    .collect();
                let mut to = vec![number(3); count * padded.height];
                padded.products(&places, false, &from, &mut to);
                padded.products(&places, true, &from, &mut to);
                for &[x, y] in &places {
                    let mut once = vec![number(0); rows];
                    S::product(&a, &from[x..][..columns], false, &mut once);
                    let twice: Vec<S> = once.iter().map(|&y| y + y).collect();
                    let error = crate::relative_l2_error(&to[y..][..rows], &twice);
                    assert!(error < bound, "{rows} × {columns}, {count} vectors: {error:e}");
                }
            }
        }
    }

    #[test]
    fn products_are_those_of_the_matrix_with_each_vector() {
        let parts = |k: usize| [(k as f64).sin(), (0.3 * k as f64).cos()];
        check(1e-5, |k| parts(k)[0] as f32);
        check(1e-14, |k| parts(k)[0]);
        check(1e-5, |k| Complex::new(parts(k)[0] as f32, parts(k)[1] as f32));
        check(1e-14, |k| Complex::new(parts(k)[0], parts(k)[1]));
    }
}

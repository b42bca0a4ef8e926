//! Some of many right-hand sides, brought to one size.

use farfield::Real;

/// The most right-hand sides that are summed together.
const MOST: usize = 16;

/// So many right-hand sides together, in so many groups. The last group may be filled up with zeros.
pub(crate) fn groups(columns: usize) -> (usize, usize) {
    let groups = columns.div_ceil(MOST).max(1);
    (columns.div_ceil(groups).max(1), groups)
}

/// The columns from `first` on of arrays whose rows hold `columns` numbers; those beyond the last are zero.
#[derive(Clone, Copy)]
pub(crate) struct Columns {
    pub(crate) columns: usize,
    pub(crate) first: usize,
    pub(crate) width: usize,
}

impl Columns {
    /// Rows of their numbers, each column in units of the power of two that is next to its largest; and the units.
    pub(crate) fn taken<T: Real>(self, numbers: &[T]) -> (Vec<T>, Vec<T>) {
        let Self { columns, first, width } = self;
        let mut largest = vec![0.0f64; width];
        for row in numbers.chunks_exact(columns) {
            for (largest, number) in largest.iter_mut().zip(&row[first..]) {
                *largest = largest.max(number.as_f64().abs());
            }
        }
        // Exponents whose inverses are numbers of either precision as well.
        let exponent = |x: f64| if x > 0.0 && x.is_finite() { x.log2().floor() } else { 0.0 };
        let units: Vec<f64> =
            largest.iter().map(|&x| exponent(x).clamp(-126.0, 126.0).exp2()).collect();
        let zero = T::from_f64(0.0);
        let row = |row: &[T]| {
            let own = row[first..].iter().copied().chain(std::iter::repeat(zero));
            let own: Vec<T> =
                own.zip(&units).map(|(number, unit)| number * T::from_f64(unit.recip())).collect();
            own
        };
        let taken = numbers.chunks_exact(columns).flat_map(row).collect();
        (taken, units.iter().map(|&unit| T::from_f64(unit)).collect())
    }

    /// Puts rows of their sums where they belong.
    pub(crate) fn put<T: Real>(self, sums: &[T], units: &[T], to: &mut [T]) {
        let Self { columns, first, width } = self;
        for (sums, to) in sums.chunks_exact(width).zip(to.chunks_exact_mut(columns)) {
            for ((to, sum), unit) in to[first..].iter_mut().zip(sums).zip(units) {
                *to = *sum * *unit;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_come_back_as_they_were() {
        for columns in 1..50 {
            let (width, count) = groups(columns);
            assert!(width <= MOST && width * count >= columns && width * (count - 1) < columns);
            let numbers: Vec<f32> =
                (0..3 * columns).map(|i| 3f32.powi(i as i32 % 70 - 35)).collect();
            let mut back = vec![0.0; numbers.len()];
            for group in 0..count {
                let own = Columns { columns, first: group * width, width };
                let (taken, units) = own.taken(&numbers);
                assert!(taken.len() == 3 * width && taken.iter().all(|x| x.abs() < 2.0));
                own.put(&taken, &units, &mut back);
            }
            assert_eq!(back, numbers);
        }
    }
}

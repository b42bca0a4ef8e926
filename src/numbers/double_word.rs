//! Sums in twice the precision of their terms.

use crate::numbers::traits::Numbers;

/// The unevaluated sum of two words, the second smaller than what rounding the first may cost: double-word
/// arithmetic (Joldes, Muller and Popescu, "Tight and rigorous error bounds for basic building blocks of
/// double-word arithmetic", ACM TOMS 44, 2017), component by component.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DoubleWord<V> {
    pub(crate) high: V,
    low: V,
}

impl<V: Numbers> DoubleWord<V> {
    pub(crate) fn zero() -> Self {
        Self { high: V::zero(), low: V::zero() }
    }

    /// `self += word`, with a relative error of 2 u² for unit round-off u (their algorithm 4).
    #[inline(always)]
    pub(crate) fn accumulate(&mut self, word: &V) {
        let (high, low) = two_sum(&self.high, word);
        (self.high, self.low) = fast_two_sum(&high, &sum(&self.low, &low));
    }

    /// `self += other`, with a relative error of 3 u² or little more (their algorithm 6) where the signs
    /// agree.
    pub(crate) fn add(&mut self, other: &Self) {
        let (high, middle) = two_sum(&self.high, &other.high);
        let (carry, low) = two_sum(&self.low, &other.low);
        let (high, middle) = fast_two_sum(&high, &sum(&middle, &carry));
        (self.high, self.low) = fast_two_sum(&high, &sum(&low, &middle));
    }

    /// `self -= other`; as [`add`](Self::add).
    pub(crate) fn subtract(&mut self, other: &Self) {
        let negated = |word: &V| difference(&V::zero(), word);
        self.add(&Self { high: negated(&other.high), low: negated(&other.low) });
    }

    /// `word - self`, rounded once where the two are close.
    pub(crate) fn subtracted_from(&self, word: &V) -> V {
        difference(&difference(word, &self.high), &self.low)
    }
}

/// a + b, and what rounding it takes away (Knuth's 2Sum).
#[inline(always)]
fn two_sum<V: Numbers>(a: &V, b: &V) -> (V, V) {
    let s = sum(a, b);
    let from_b = difference(&s, a);
    let from_a = difference(&s, &from_b);
    let rounding = sum(&difference(a, &from_a), &difference(b, &from_b));
    (s, rounding)
}

/// a + b, and what rounding it takes away, for |a| ≥ |b| (Dekker's Fast2Sum).
#[inline(always)]
fn fast_two_sum<V: Numbers>(a: &V, b: &V) -> (V, V) {
    let s = sum(a, b);
    let rounding = difference(b, &difference(&s, a));
    (s, rounding)
}

#[inline(always)]
fn sum<V: Numbers>(a: &V, b: &V) -> V {
    let mut sum = a.clone();
    sum.accumulate(b);
    sum
}

#[inline(always)]
fn difference<V: Numbers>(a: &V, b: &V) -> V {
    let mut difference = a.clone();
    difference.subtract(b);
    difference
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numbers::random::Random;
    use glam::Vec3;

    #[test]
    fn sums_of_single_precision_are_those_of_double_precision() {
        let mut random = Random::new(1);
        let mut words = || -> Vec<Vec3> {
            let word = |_| Vec3::from_array(std::array::from_fn(|_| random.centred() as f32));
            (0..10_000).map(word).collect()
        };
        let (a, b) = (words(), words());
        let of = |words: &[Vec3]| {
            let mut total = DoubleWord::<Vec3>::zero();
            words.iter().for_each(|word| total.accumulate(word));
            total
        };
        let exact = |words: &[Vec3]| words.iter().map(|word| f64::from(word.y)).sum::<f64>();
        let check = |found: DoubleWord<Vec3>, exact: f64| {
            let found = f64::from(found.high.y) + f64::from(found.low.y);
            assert!((found - exact).abs() < 1e-9, "{found} instead of {exact}");
        };
        check(of(&a), exact(&a));
        let mut both = of(&a);
        both.add(&of(&b));
        check(both, exact(&a) + exact(&b));
        both.subtract(&of(&a));
        check(both, exact(&b));
        let error = both.subtracted_from(&Vec3::splat(7.0)).y;
        assert!((f64::from(error) - (7.0 - exact(&b))).abs() < 1e-5);
    }
}

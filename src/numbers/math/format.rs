//! The formats of floating-point numbers, as the functions of this folder see them.

use num_traits::Float;

/// The bits of a format, and the coefficients of polynomials that are as accurate as it is.
///
/// Everything is written without branches, calls and conversions to integers, which AVX2 lacks for double
/// precision, so that compilers turn loops around it into wide registers. Nothing is fused: a fused
/// multiply-add is a call where the processor has none, and results have the same bits on every processor.
///
/// Coefficients are those of the polynomials that interpolate at Chebyshev points, found in 60 digits and
/// rounded. They are within a factor of two of the best ones, and exceed the accuracy of the format.
pub(super) trait Format: Float + 'static {
    /// 1.5 · 2^p for numbers of p digits behind the leading one: added to a number x, it rounds x to a whole
    /// number, and leaves that in the last bits.
    const SHIFTER: Self;
    /// The number of digits behind the leading one.
    const DIGITS: Self;
    /// log₂ e
    const LOG2_E: Self;
    /// ln 2 in two parts. The first has so few digits that products with exponents are exact.
    const LN_2: [Self; 2];
    /// Below the first, eˣ rounds to zero; above the second, it overflows.
    const EXP_RANGE: [Self; 2];
    /// From half of this on, tanh x rounds to 1.
    const TWICE_TANH_RANGE: Self;
    /// (eʳ − 1 − r) / r² for |r| ≤ ln 2 / 2, in powers of r.
    const EXP: &'static [Self];
    /// (2 artanh s − 2 s) / s³ for |s| ≤ 3 − √8, in powers of s².
    const LN: &'static [Self];

    /// The number of this format that is nearest to `x`.
    fn rounded(x: f64) -> Self;
    /// 2ᵏ · `self`, rounded once, for a number k that [`SHIFTER`](Self::SHIFTER) was added to, and that is no
    /// farther from zero than twice the largest exponent.
    fn times_power_of_two(self, shifted_k: Self) -> Self;
    /// 2ᵏ for a number k that [`SHIFTER`](Self::SHIFTER) was added to, if 2ᵏ is neither subnormal nor infinite.
    fn power_of_two(shifted_k: Self) -> Self;
    /// The exponent k and the rest m, between √½ and √2, of a number m 2ᵏ that is positive, finite and not subnormal.
    fn exponent_and_rest(self) -> [Self; 2];
}

macro_rules! format {
    ($t:ident, $bits:ident, $digits:literal, $bias:literal, {$($constant:item)*}) => {
        impl Format for $t {
            const SHIFTER: Self = 1.5 * (1u64 << $digits) as $t;
            const DIGITS: Self = $digits as $t;
            const LOG2_E: Self = std::$t::consts::LOG2_E;
            $($constant)*

            #[inline(always)]
            fn rounded(x: f64) -> Self {
                x as $t
            }
            #[inline(always)]
            fn times_power_of_two(self, shifted_k: Self) -> Self {
                // Two factors, as 2ᵏ itself may be out of range where the product is not.
                let both = shifted_k.to_bits().wrapping_add(2 * $bias);
                let first = (both >> 1) & (2 * $bias + 1);
                let second = both.wrapping_sub(first);
                self * $t::from_bits(first << $digits) * $t::from_bits(second << $digits)
            }
            #[inline(always)]
            fn power_of_two(shifted_k: Self) -> Self {
                $t::from_bits(shifted_k.to_bits().wrapping_add($bias) << $digits)
            }
            #[inline(always)]
            fn exponent_and_rest(self) -> [Self; 2] {
                const ROOT: $bits = std::$t::consts::FRAC_1_SQRT_2.to_bits();
                const FRACTION: $bits = (1 << $digits) - 1;
                // The exponent that √½ would have had, if its fraction were zero, becomes the bias.
                let bits = self.to_bits().wrapping_add(($bias << $digits) - ROOT);
                let shifted = $t::from_bits((bits >> $digits) | Self::SHIFTER.to_bits());
                let rest = $t::from_bits((bits & FRACTION).wrapping_add(ROOT));
                [shifted - (Self::SHIFTER + $bias as $t), rest]
            }
        }
    };
}

format!(f32, u32, 23, 127, {
    const LN_2: [Self; 2] = [0.69314575, 1.4286068e-6];
    const EXP_RANGE: [Self; 2] = [-104.5, 89.0];
    const TWICE_TANH_RANGE: Self = 20.0;
    const EXP: &'static [Self] = &[0.5, 0.16666576, 0.041666556, 0.008363203, 0.0013926214];
    const LN: &'static [Self] = &[0.66666687, 0.3998877, 0.295804];
});

format!(f64, u64, 52, 1023, {
    const LN_2: [Self; 2] = [0.6931471804855391, 7.440617110012397e-11];
    const EXP_RANGE: [Self; 2] = [-746.0, 710.0];
    const TWICE_TANH_RANGE: Self = 40.0;
    const EXP: &'static [Self] = &[
        0.5000000000000001,
        0.16666666666666669,
        0.04166666666662399,
        0.008333333333330051,
        0.0013888888917281794,
        0.00019841269863105968,
        2.480152119021773e-05,
        2.7557268378684192e-06,
        2.7620138719733994e-07,
        2.5100424157005067e-08,
    ];
    const LN: &'static [Self] = &[
        0.666666666666667,
        0.3999999999989924,
        0.2857142862609589,
        0.2222221111514416,
        0.18182890556695602,
        0.1533167403016786,
        0.1461703754879165,
    ];
});

/// A polynomial in x with these coefficients, the constant one first.
#[inline(always)]
pub(super) fn polynomial<T: Format>(coefficients: &[T], x: T) -> T {
    let mut sum = T::zero();
    let mut first = true;
    for &c in coefficients.iter().rev() {
        sum = if first { c } else { sum * x + c };
        first = false;
    }
    sum
}

/// The whole number that is nearest to x, and the same with [`Format::SHIFTER`] added to it.
#[inline(always)]
pub(super) fn nearest_whole<T: Format>(x: T) -> [T; 2] {
    let shifted = x + T::SHIFTER;
    [shifted - T::SHIFTER, shifted]
}

//! Exponents of power laws, as types.

use std::fmt::Debug;

use farfield::Real;

/// A power law r^(−2λ), as a type.
pub trait Exponent: Copy + Debug + Default + Send + Sync + 'static {
    /// λ.
    const LAMBDA: f64;
    /// r^(−2λ), given r² > 0.
    fn power<T: Real>(r2: T) -> T;
}

macro_rules! exponent {
    ($(#[$doc:meta])* $name:ident, $lambda:expr, $r2:ident => $power:expr) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default)]
        pub struct $name;

        impl Exponent for $name {
            const LAMBDA: f64 = $lambda;
            #[inline(always)]
            fn power<T: Real>($r2: T) -> T {
                $power
            }
        }
    };
}

exponent!(
    /// 1/r: λ = ½.
    MinusOne, 0.5, r2 => r2.sqrt().recip()
);
exponent!(
    /// 1/r²: λ = 1.
    MinusTwo, 1.0, r2 => r2.recip()
);
exponent!(
    /// 1/r⁴: λ = 2.
    MinusFour, 2.0, r2 => r2.recip() * r2.recip()
);
exponent!(
    /// r²: λ = −1.
    PlusTwo, -1.0, r2 => r2
);

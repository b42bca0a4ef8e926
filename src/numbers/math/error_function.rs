//! The error function and its complement.

use crate::numbers::math::exponential::scaled_exp;
use crate::numbers::math::format::polynomial;
use crate::numbers::math::power::high;

/// Up to this, the error function is a polynomial.
const CENTRE_RANGE: f64 = 0.7;
/// Beyond this, erfc x rounds to zero.
const RANGE: f64 = 28.0;
/// The polynomials of the tail are in 1 / (x + SHIFT) − MIDDLE.
const SHIFT: f64 = 2.5;
const MIDDLE: f64 = 0.1845703125;

/// erf x / x − 1 up to `CENTRE_RANGE`, in powers of x².
const CENTRE: [f64; 10] = [
    0.12837916709551256,
    -0.37612638903183,
    0.1128379167090445,
    -0.026866170631867414,
    0.0052239774489421026,
    -0.0008548313512283057,
    0.0001205470182217529,
    -1.4907327674129658e-5,
    1.613807835065832e-6,
    -1.3129738669415532e-7,
];
/// The same, for results in single precision.
const CENTRE_SINGLE: [f64; 6] = [
    0.12837916641506258,
    -0.3761262889614319,
    0.11283552349218591,
    -0.026845139755112983,
    0.005139740440093349,
    -0.0006962326276297186,
];
/// erfc x e^(x²) (x + SHIFT) from `CENTRE_RANGE` to 27.3, in powers of 1 / (x + SHIFT) − MIDDLE.
const TAIL: [f64; 21] = [
    0.9945782221841314,
    3.688093100830141,
    10.383190668882294,
    20.255511742364398,
    19.477242299164843,
    -19.14321044464367,
    -77.14810937201415,
    -0.04591799578573124,
    278.07883730915466,
    64.37416383962758,
    -1183.8594327191363,
    -0.4673031129548245,
    5703.737120815699,
    -3721.0826728977554,
    -27389.956167144355,
    47685.57034363146,
    111987.94955680353,
    -398006.43645717425,
    -375514.4836223867,
    1954535.2986301335,
    1749179.7061668136,
];
/// The same up to 10.1, for results in single precision.
const TAIL_SINGLE: [f64; 9] = [
    0.9945782217212573,
    3.68809311852916,
    10.383192829776085,
    20.25551683370275,
    19.4758001960623,
    -19.150441042833002,
    -76.81566524200284,
    1.2634479589536036,
    245.90541404915484,
];

/// erf x: x (1 + P(x²)) up to [`CENTRE_RANGE`], and 1 − erfc x beyond.
#[inline(always)]
pub(super) fn erf(x: f64) -> f64 {
    let near = x + x * polynomial(&CENTRE, x * x);
    let far = (1.0 - tail(x.abs())).copysign(x);
    if x.abs() < CENTRE_RANGE { near } else { far }
}

/// As [`erf`], in single precision.
#[inline(always)]
pub(super) fn erf_single(x: f32) -> f32 {
    let x = f64::from(x);
    let near = x + x * polynomial(&CENTRE_SINGLE, x * x);
    let far = (1.0 - tail_single(x.abs())).copysign(x);
    (if x.abs() < CENTRE_RANGE { near } else { far }) as f32
}

/// erfc x.
#[inline(always)]
pub(super) fn erfc(x: f64) -> f64 {
    // 1 − x (1 + P), in an order in which x − ½ is exact where digits cancel.
    let near = 0.5 - ((x - 0.5) + x * polynomial(&CENTRE, x * x));
    let tail = tail(x.abs());
    let far = if x < 0.0 { 2.0 - tail } else { tail };
    if x.abs() < CENTRE_RANGE { near } else { far }
}

/// As [`erfc`], in single precision.
#[inline(always)]
pub(super) fn erfc_single(x: f32) -> f32 {
    let x = f64::from(x);
    let near = 1.0 - (x + x * polynomial(&CENTRE_SINGLE, x * x));
    let tail = tail_single(x.abs());
    let far = if x < 0.0 { 2.0 - tail } else { tail };
    (if x.abs() < CENTRE_RANGE { near } else { far }) as f32
}

/// erfc x from [`CENTRE_RANGE`] on: e^(−x²) P(u) u with u = 1 / (x + [`SHIFT`]).
#[inline(always)]
fn tail(x: f64) -> f64 {
    // The comparison with NaN is false, so that NaN stays.
    let x = if RANGE < x { RANGE } else { x };
    let x_high = high(x);
    let u = 1.0 / (x + SHIFT);
    let scale = u * polynomial(&TAIL, u - MIDDLE);
    // 1 − u (x + SHIFT), with exact products, is the relative error of u. That of e^(x²) erfc x is 1 + 4 u times
    // as large, to a few per cent.
    let u_high = high(u);
    let left = ((1.0 - u_high * SHIFT) - u_high * x_high) - u_high * (x - x_high);
    let error = left - (u - u_high) * (x + SHIFT);
    let correction = error * (1.0 + 4.0 * u);
    scaled_exp(scale, -(x_high * x_high), (x_high - x) * (x_high + x) + correction)
}

/// As [`tail`], with a relative error of 1e-8.
#[inline(always)]
fn tail_single(x: f64) -> f64 {
    let x = if RANGE < x { RANGE } else { x };
    let u = 1.0 / (x + SHIFT);
    scaled_exp(u * polynomial(&TAIL_SINGLE, u - MIDDLE), -(x * x), 0.0)
}

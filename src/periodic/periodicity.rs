//! The sum over all images is periodic: what it lacks to be that, and how far it is from it.

use crate::interpolation::probe::sample;
use crate::kernel::traits::Kernel;
use crate::numbers::traits::Vector;
use crate::periodic::polynomials::Polynomials;
use crate::periodic::summed::Summed;

/// Adds the polynomials of degree 1 and 2 with which the sum over all images is periodic.
///
/// Let G(d) be that sum and P(d) = d·A d + b·d, with A symmetric. G + P is periodic if, for each axis i with period L_i,
/// G(d + L_i e_i) − G(d) = −2 L_i (A d)_i − L_i² A_ii − L_i b_i. The left side is measured at points around a middle.
pub(super) fn made_periodic<K: Kernel>(summed: &Summed<'_, K>, far: &mut Polynomials) {
    let functions = far.functions();
    let half_widths = far.half_widths;
    let Some(periods) = all(summed.lattice.periods) else { return };
    let mut slopes = vec![[[0.0; 3]; 3]; functions];
    let mut middles = vec![[0.0; 3]; functions];
    for axis in 0..3 {
        let middle: [f64; 3] = std::array::from_fn(|k| {
            if k == axis { -0.5 * periods[k] } else { [0.37, 0.41, 0.33][k] * periods[k] }
        });
        for other in 0..3 {
            let step = STEP * periods[other];
            let [above, below] = [step, -step].map(|step| {
                let mut d = middle;
                d[other] += step;
                change(summed, far, d, axis)
            });
            for f in 0..functions {
                slopes[f][axis][other] = (above[f] - below[f]) / (2.0 * step);
                middles[f][axis] += (above[f] + below[f]) / 6.0;
            }
        }
        for f in 0..functions {
            // The value that the linear function has at 0.
            let at_middle: f64 = (0..3).map(|k| slopes[f][axis][k] * middle[k]).sum();
            middles[f][axis] -= at_middle;
        }
    }
    let order = far.order;
    for f in 0..functions {
        let a = |i: usize, j: usize| {
            let [one, other] = [(i, j), (j, i)].map(|(i, j)| -slopes[f][i][j] / (2.0 * periods[i]));
            0.5 * (one + other)
        };
        let own = &mut far.coefficients[f * order.pow(3)..][..order.pow(3)];
        let mut add = |degrees: [usize; 3], value: f64| {
            own[(degrees[0] * order + degrees[1]) * order + degrees[2]] += value;
        };
        // x = T̂_1/√2, x² = ½ + T̂_2/(2√2) and x y = T̂_1 T̂_1/2, in half-widths; constants are left as they are.
        let root = std::f64::consts::SQRT_2;
        for i in 0..3 {
            let b = -middles[f][i] / periods[i] - periods[i] * a(i, i);
            let (mut linear, mut square) = ([0; 3], [0; 3]);
            (linear[i], square[i]) = (1, 2);
            add(linear, b * half_widths[i] / root);
            add(square, a(i, i) * half_widths[i].powi(2) / (2.0 * root));
            for j in 0..i {
                let mut both = [0; 3];
                (both[i], both[j]) = (1, 1);
                add(both, a(i, j) * half_widths[i] * half_widths[j]);
            }
        }
    }
}

/// How far the sum over all images is from being periodic, root mean square over some points, for the function of which
/// that is worst.
pub(super) fn deviation<K: Kernel>(
    summed: &Summed<'_, K>,
    far: &Polynomials,
    samples: usize,
) -> f64 {
    let places = summed.lattice.near_places();
    let (mut squares, mut count) = (vec![0.0; far.functions()], 0);
    for axis in 0..3 {
        let Some(period) = summed.lattice.periods[axis] else { continue };
        for i in 0..samples {
            let p = sample::<f64>(17 * axis + i).to_array();
            let mut d: [f64; 3] = std::array::from_fn(|k| p[k] * far.half_widths[k]);
            d[axis] = 0.5 * (d[axis] - period);
            // Where an image is very near, the kernel is large, and so is its rounding.
            let is_near = |n: &[f64; 3]| {
                let r = (0..3).map(|k| (d[k] - n[k]).abs() / far.half_widths[k]);
                r.fold(0.0, f64::max) < NEAR
            };
            if !places.iter().any(is_near) {
                let off = change(summed, far, d, axis);
                squares.iter_mut().zip(off).for_each(|(sum, off)| *sum += off * off);
                count += 1;
            }
        }
    }
    let worst = squares.into_iter().fold(0.0, |a: f64, b| if b.is_nan() { b } else { a.max(b) });
    (worst / f64::from(count.max(1))).sqrt()
}

/// Of the longest extent, how far points are from the middle at which the sum is measured.
const STEP: f64 = 0.17;

/// What is near an image, in half-widths of the box of differences.
const NEAR: f64 = 0.1;

/// G(d + L e) − G(d), with all images near and far.
fn change<K: Kernel>(
    summed: &Summed<'_, K>,
    far: &Polynomials,
    d: [f64; 3],
    axis: usize,
) -> Vec<f64> {
    let mut moved = d;
    moved[axis] += summed.lattice.periods[axis].unwrap_or(0.0);
    let [here, there] = [d, moved].map(|d| {
        let mut sum = far.at(d);
        for n in summed.lattice.near_places() {
            let entries = summed.at([0, 1, 2].map(|k| d[k] - n[k]));
            sum.iter_mut().zip(entries).for_each(|(sum, g)| *sum += g);
        }
        sum
    });
    here.iter().zip(&there).map(|(here, there)| there - here).collect()
}

fn all(periods: [Option<f64>; 3]) -> Option<[f64; 3]> {
    let [x, y, z] = periods;
    Some([x?, y?, z?])
}

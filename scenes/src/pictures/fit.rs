//! A linear function through scattered values.

use glam::{DMat2, DVec2};

use crate::pictures::tone::Rgb;

/// Weighted sums over neighbours, for a linear function of two coordinates around the origin.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fit {
    /// Σ w.
    weight: f64,
    /// Σ w p, p a neighbour's place.
    offset: DVec2,
    /// Σ w p pᵀ.
    square: DMat2,
    /// Σ w f, f its value.
    value: Rgb,
    /// Σ w f p.
    moment: [DVec2; 3],
}

impl Fit {
    /// The sums over nothing.
    pub(crate) const EMPTY: Self = Self {
        weight: 0.0,
        offset: DVec2::ZERO,
        square: DMat2::ZERO,
        value: [0.0; 3],
        moment: [DVec2::ZERO; 3],
    };

    /// Adds a neighbour at `offset` from the origin.
    pub(crate) fn add(&mut self, weight: f64, offset: DVec2, value: &Rgb) {
        self.weight += weight;
        self.offset += weight * offset;
        self.square += DMat2::from_cols(offset * offset.x, offset * offset.y) * weight;
        for (band, value) in value.iter().enumerate() {
            self.value[band] += weight * value;
            self.moment[band] += weight * value * offset;
        }
    }

    /// The function's value at the origin; none without neighbours. The function is constant in
    /// directions in which there are none, for neighbours of about the given `size`.
    pub(crate) fn value(&self, size: f64) -> Option<Rgb> {
        if self.weight <= 0.0 {
            return None;
        }
        let centre = self.offset / self.weight;
        let spread = self.square * self.weight.recip()
            - DMat2::from_cols(centre * centre.x, centre * centre.y);
        let toward = inverse(&spread, (LEAST_SCATTER * size).powi(2)) * -centre;
        Some([0, 1, 2].map(|band| {
            let mean = self.value[band] / self.weight;
            let covariance = self.moment[band] / self.weight - mean * centre;
            mean + covariance.dot(toward)
        }))
    }
}

/// A direction in which the neighbours scatter by less, relative to the elements' size, has no slope.
const LEAST_SCATTER: f64 = 0.1;

/// The inverse of a symmetric positive matrix in the directions of its eigenvalues above `least`.
fn inverse(matrix: &DMat2, least: f64) -> DMat2 {
    let [a, b, d] = [matrix.x_axis.x, matrix.x_axis.y, matrix.y_axis.y];
    let radius = (0.5 * (a - d)).hypot(b);
    let axis = DVec2::from_angle(0.5 * b.atan2(0.5 * (a - d)));
    let part = |eigenvalue: f64, axis: DVec2| {
        let scale = if eigenvalue > least { eigenvalue.recip() } else { 0.0 };
        DMat2::from_cols(axis * axis.x, axis * axis.y) * scale
    };
    let mean = 0.5 * (a + d);
    part(mean + radius, axis) + part(mean - radius, axis.perp())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_function_is_found_along_the_directions_in_which_there_are_neighbours() {
        let function = |p: DVec2| 3.0 - 2.0 * p.x + 5.0 * p.y;
        let line = [DVec2::new(1.0, 2.0), DVec2::new(2.0, 2.5), DVec2::new(4.0, 3.5)];
        let apart = DVec2::new(1.0, -3.0);
        let fitted = |points: &[DVec2]| {
            let mut fit = Fit::EMPTY;
            for (k, &point) in points.iter().enumerate() {
                fit.add(0.3 + k as f64, point, &[function(point), 1.0, 0.0]);
            }
            fit.value(1.0)
        };
        let [value, one, zero] = fitted(&[&line[..], &[apart]].concat()).expect("neighbours");
        assert!((value - 3.0).abs() < 1e-12 && (one - 1.0).abs() < 1e-12 && zero.abs() < 1e-12);
        // The foot of the perpendicular from the origin to the line.
        let foot = DVec2::new(-0.6, 1.2);
        assert!((fitted(&line).expect("neighbours")[0] - function(foot)).abs() < 1e-12);
        assert!((fitted(&line[..1]).expect("a neighbour")[0] - function(line[0])).abs() < 1e-12);
        assert_eq!(fitted(&[]), None);
    }
}

//! The exact exchange of diffuse light between flat patches.

use std::f64::consts::TAU;

use glam::DVec3;

use crate::elements::Patch;
use crate::form_factors::contour::{Care, contour_integral};
use crate::form_factors::cut::{Cut, edges, mean};

impl Patch {
    /// The form factor from a point of a surface to this patch: the fraction of the light that leaves
    /// it there which arrives here, if nothing is in between. `normal` is the surface's, a unit vector.
    /// What lies below its horizon doesn't count, nor does a patch seen from behind.
    ///
    /// F = 1/(2π) Σ_k β_k n·(r_k × r_{k+1}) / |r_k × r_{k+1}|, with r_k the corners as seen from the
    /// point and β_k the angle between r_k and r_{k+1} (Lambert, "Photometria", 1760; Howell, "A Catalog
    /// of Radiation Heat Transfer Configuration Factors").
    pub fn form_factor_from(&self, point: DVec3, normal: DVec3) -> f64 {
        if self.normal().dot(point - self.corners()[0]) <= 0.0 {
            return 0.0;
        }
        let above = Cut::new(self.corners(), point, normal);
        let corners = above.corners();
        let sum: f64 = edges(corners)
            .map(|(a, b)| {
                let (a, b) = (a - point, b - point);
                let cross = a.cross(b);
                let sine = cross.length();
                // An edge that points at the point covers no angle.
                if sine > 0.0 { sine.atan2(a.dot(b)) * normal.dot(cross) / sine } else { 0.0 }
            })
            .sum();
        // Seen from its front, the corners go clockwise around the line of sight.
        (-sum / TAU).clamp(0.0, 1.0)
    }

    /// The form factor to another patch, visibility aside: the fraction of the light that leaves this
    /// one which arrives at the other.
    pub fn form_factor(&self, other: &Self) -> f64 {
        self.exchange(other) / self.area()
    }

    /// A_1 F_12 = A_2 F_21, the exchange area, in squared scene units: 0 or more, and the same from
    /// either side but for rounding.
    ///
    /// A F = 1/(2π) ∮∮ ln r ds_1·ds_2 over the parts of both that are above the other's horizon
    /// (Sparrow, "A new and simpler formulation for radiative angle factors", J. Heat Transfer 85,
    /// 1963).
    pub fn exchange(&self, other: &Self) -> f64 {
        self.exchange_with(other, Care::full())
    }

    /// [`exchange`](Self::exchange), with some care.
    pub(crate) fn exchange_with(&self, other: &Self, care: Care) -> f64 {
        let own = Cut::new(self.corners(), other.corners()[0], other.normal());
        let theirs = Cut::new(other.corners(), self.corners()[0], self.normal());
        let (own, theirs) = (own.corners(), theirs.corners());
        if own.len() < 3 || theirs.len() < 3 {
            return 0.0;
        }
        // Lengths of about one keep logarithms, and what cancels among them, small.
        let (from, to) = (mean(own), mean(theirs));
        let unit = edges(own)
            .chain(edges(theirs))
            .map(|(a, b)| a.distance(b))
            .fold(from.distance(to), f64::max);
        let mut sum = 0.0;
        for (a, b) in edges(own) {
            for (c, d) in edges(theirs) {
                let [a, b, c, d] = [a, b, c, d].map(|corner| (corner - from) / unit);
                sum += contour_integral([a, b], [c, d], care);
            }
        }
        (sum / TAU * unit * unit).clamp(0.0, self.area().min(other.area()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use farfield_testing::clouds::Random;

    const X: DVec3 = DVec3::X;
    const Y: DVec3 = DVec3::Y;
    const Z: DVec3 = DVec3::Z;

    fn patch(corners: &[DVec3]) -> Patch {
        Patch::new(corners).unwrap()
    }

    /// The parallelogram at `origin` along `u` and `v`, with its front towards u × v.
    fn parallelogram(origin: DVec3, u: DVec3, v: DVec3) -> Patch {
        patch(&[origin, origin + u, origin + u + v, origin + v])
    }

    fn turned(patch: &Patch) -> Patch {
        Patch::new(&patch.corners().iter().rev().copied().collect::<Vec<_>>()).unwrap()
    }

    #[track_caller]
    fn assert_factor(from: &Patch, to: &Patch, exact: f64) {
        assert_relative_eq!(from.form_factor(to), exact, max_relative = 1e-10);
        assert_relative_eq!(to.exchange(from), from.area() * exact, max_relative = 1e-10);
    }

    #[test]
    fn parallel_rectangles() {
        let exact = [
            (0.1, 0.8269945223972566),
            (0.5, 0.4152532835771467),
            (1.0, 0.1998248956983874),
            (2.0, 0.06858958881855245),
            (10.0, 0.003162056838757602),
        ];
        for (distance, factor) in exact {
            let ceiling = parallelogram(Z * distance, Y, X);
            assert_factor(&parallelogram(DVec3::ZERO, X, Y), &ceiling, factor);
        }
        let floor = parallelogram(DVec3::ZERO, 2.0 * X, Y);
        assert_factor(&floor, &parallelogram(Z, Y, 2.0 * X), 0.2858753848507147);
    }

    #[test]
    fn rectangles_that_share_an_edge() {
        for (height, width, factor) in [
            (1.0, 1.0, 0.2000437760754032),
            (2.0, 1.0, 0.2328526027953619),
            (0.1, 1.0, 0.04325136940068586),
            (1.0, 0.1, 0.4325136940068586),
        ] {
            let floor = parallelogram(DVec3::ZERO, width * X, Y);
            let wall = parallelogram(DVec3::ZERO, Y, height * Z);
            assert_factor(&floor, &wall, factor);
        }
    }

    #[test]
    fn faces_of_closed_bodies_that_meet_at_edges_and_corners() {
        let corners = [X + Y + Z, X - Y - Z, Y - X - Z, Z - X - Y];
        let faces = [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]].map(|face| {
            let face = patch(&face.map(|k: usize| corners[k]));
            if face.normal().dot(face.centroid()) < 0.0 { face } else { turned(&face) }
        });
        for (i, from) in faces.iter().enumerate() {
            for (j, to) in faces.iter().enumerate() {
                if i != j {
                    assert_factor(from, to, 1.0 / 3.0);
                }
            }
            assert_eq!(from.exchange(from), 0.0);
        }
    }

    #[test]
    fn a_patch_seen_from_a_point() {
        let above = parallelogram(Z, Y, X);
        let factor = |p: DVec3, normal: DVec3, patch: &Patch| patch.form_factor_from(p, normal);
        assert_relative_eq!(factor(DVec3::ZERO, Z, &above), 0.138_531_605_994_893, epsilon = 1e-15);
        let centred = factor(DVec3::new(0.5, 0.5, 0.0), Z, &above);
        assert_relative_eq!(centred, 0.2394564704607735, epsilon = 1e-15);
        let beside = parallelogram(X, Z, Y);
        assert_relative_eq!(factor(DVec3::ZERO, Z, &beside), 0.0557341970025535, epsilon = 1e-15);
        let triangle = patch(&[Z, Z + Y, Z + X]);
        assert_relative_eq!(
            factor(DVec3::ZERO, Z, &triangle),
            0.096_225_044_864_938,
            epsilon = 1e-15
        );
        assert_eq!(factor(DVec3::ZERO, -Z, &above), 0.0, "below the horizon");
        assert_eq!(factor(2.0 * Z, -Z, &above), 0.0, "from behind");
    }

    #[test]
    fn light_from_a_point_in_a_closed_room_arrives_somewhere() {
        let (low, high) = (DVec3::ZERO, DVec3::ONE);
        let walls = [
            parallelogram(low, X, Y),
            parallelogram(low, Y, Z),
            parallelogram(low, Z, X),
            parallelogram(high, -Y, -X),
            parallelogram(high, -Z, -Y),
            parallelogram(high, -X, -Z),
        ];
        for normal in [Z, DVec3::new(0.6, -0.3, 0.2).normalize(), DVec3::splat(-1.0).normalize()] {
            for point in [DVec3::splat(0.5), DVec3::new(0.01, 0.99, 0.3)] {
                let seen = walls.iter().map(|wall| wall.form_factor_from(point, normal));
                assert_relative_eq!(seen.sum::<f64>(), 1.0, epsilon = 1e-13);
            }
        }
        for wall in &walls {
            let row: f64 = walls.iter().map(|other| wall.form_factor(other)).sum();
            assert_relative_eq!(row, 1.0, epsilon = 1e-11);
        }
    }

    #[test]
    fn what_lies_below_the_horizon_is_cut_off() {
        let floor = parallelogram(DVec3::ZERO, X, Y);
        let through = parallelogram(-Z, Y, 3.0 * Z);
        assert_factor(&floor, &through, 0.2328526027953619);
        let below = parallelogram(-3.0 * Z, Y, 2.0 * Z);
        assert_eq!(floor.exchange(&below), 0.0);
        assert_eq!(floor.exchange(&turned(&parallelogram(Z, Y, X))), 0.0);
        // A plane of the same front, and one that only touches.
        assert_eq!(floor.exchange(&parallelogram(X, X, Y)), 0.0);
    }

    #[test]
    fn edges_that_pass_each_other_closely_are_cut_there() {
        let bar = |angle: f64| {
            let (u, v) = (DVec3::new(angle.cos(), angle.sin(), 0.0), Z);
            let v = v.cross(u) * 0.3;
            parallelogram(-0.5 * (u + v), u, v)
        };
        let floor = bar(0.0);
        for (gap, turn) in [(1e-1, 1.0), (1e-2, 0.3), (1e-4, 1.2)] {
            let raised: Vec<_> =
                bar(turn).corners().iter().map(|&corner| corner + gap * Z).collect();
            let ceiling = turned(&patch(&raised));
            let exchange = floor.exchange(&ceiling);
            assert!(exchange > 0.0);
            assert_relative_eq!(ceiling.exchange(&floor), exchange, max_relative = 1e-9);
        }
    }

    /// The exchange by Gauss's rule over the first patch, `n` × `n` points on each half.
    fn by_points(from: &Patch, to: &Patch, n: usize) -> f64 {
        let a = from.corners()[0];
        let mut sum = 0.0;
        for [b, c] in from.corners()[1..].windows(2).map(|edge| [edge[0], edge[1]]) {
            let twice = (b - a).cross(c - a).length();
            for i in 0..n * n {
                let [u, v] = [i / n, i % n].map(|k| (k as f64 + 0.5) / n as f64);
                let point = a + (b - a) * (u * (1.0 - v)) + (c - a) * (u * v);
                sum += twice * u / (n * n) as f64 * to.form_factor_from(point, from.normal());
            }
        }
        sum
    }

    #[test]
    fn exchange_is_the_mean_over_points_adds_up_and_scales() {
        let pair = |seed: u64| {
            let random = &mut Random::new(seed);
            let c: [DVec3; 6] = std::array::from_fn(|_| 2.0 * random.in_cube() - 1.0);
            let from = Patch::new(&c[..3]).ok()?;
            let offset = from.normal() * random.between(0.1, 2.0);
            let to = Patch::new(&[c[3] + offset, c[4] + offset, c[5] + offset]).ok()?;
            let scale = 10f64.powf(random.between(-3.0, 3.0));
            let large = from.area() > 0.05 && to.area() > 0.05;
            large.then_some((seed, c, from, to, scale))
        };
        for (seed, c, from, to, scale) in (0..).filter_map(pair).take(256) {
            let exchange = from.exchange(&to);
            assert!((exchange - by_points(&from, &to, 64)).abs() < 2e-3, "{seed}");
            assert!((exchange - to.exchange(&from)).abs() < 1e-9, "{seed}");
            // Cut along a line from a corner to the middle of the edge opposite.
            let middle = 0.5 * (c[1] + c[2]);
            let [one, other] =
                [[c[0], c[1], middle], [c[0], middle, c[2]]].map(|half| patch(&half));
            let sum = one.exchange(&to) + other.exchange(&to);
            assert!((sum - exchange).abs() < 1e-9, "{seed}");
            let scaled = |patch: &Patch| {
                Patch::new(&patch.corners().iter().map(|&c| c * scale).collect::<Vec<_>>()).unwrap()
            };
            let large = scaled(&from).exchange(&scaled(&to)) / (scale * scale);
            assert!((large - exchange).abs() < 1e-9, "{seed}");
        }
    }
}

//! The exchange between two patches by points on both.

use glam::DVec3;

use crate::elements::Patch;

/// How many points per edge a rule has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Rule {
    /// Exact for polynomials of degree 2 on triangles, 3 on parallelograms.
    Two,
    /// Degree 4 on triangles, 5 on parallelograms.
    Three,
}

/// A_1 F_12 by a rule on both patches, each wholly in front of the other's plane.
pub(crate) fn exchange(a: &Patch, b: &Patch, rule: Rule) -> f64 {
    let (from, to) = (points(a, rule), points(b, rule));
    let mut sum = 0.0;
    for &(x, wx) in from.as_slice() {
        for &(y, wy) in to.as_slice() {
            let d = x - y;
            let r2 = d.length_squared();
            let (receiver, source) = (-a.normal().dot(d), b.normal().dot(d));
            sum += wx * wy * (receiver.max(0.0) / r2) * (source.max(0.0) / r2);
        }
    }
    sum * std::f64::consts::FRAC_1_PI
}

/// Points with weights, areas included.
struct Points {
    points: [(DVec3, f64); 9],
    count: usize,
}

impl Points {
    fn as_slice(&self) -> &[(DVec3, f64)] {
        &self.points[..self.count]
    }
}

/// √(3/5)/2: the outer nodes of Gauss's rule of three points on [−½, ½].
const OUTER: f64 = 0.387_298_334_620_741_7;
/// 1/(2√3): the nodes of the rule of two.
const INNER: f64 = 0.288_675_134_594_812_9;

/// Dunavant's rule of degree 4 with six points (Int. J. Numer. Meth. Engng 21, 1985): barycentric
/// coordinate of the odd corner, that of the others, weight.
const SIX: [[f64; 3]; 2] = [
    [0.108_103_018_168_070, 0.445_948_490_915_965, 0.223_381_589_678_011],
    [0.816_847_572_980_459, 0.091_576_213_509_771, 0.109_951_743_655_322],
];

fn points(patch: &Patch, rule: Rule) -> Points {
    let mut found = Points { points: [(DVec3::ZERO, 0.0); 9], count: 0 };
    let mut add = |p: DVec3, weight: f64| {
        found.points[found.count] = (p, weight);
        found.count += 1;
    };
    match *patch.corners() {
        [a, b, c] => {
            let corners = [a, b, c];
            let rules: &[[f64; 3]] = match rule {
                Rule::Two => &[[2.0 / 3.0, 1.0 / 6.0, 1.0 / 3.0]],
                Rule::Three => &SIX,
            };
            for &[odd, even, weight] in rules {
                for k in 0..3 {
                    let p = corners[k] * odd + (corners[(k + 1) % 3] + corners[(k + 2) % 3]) * even;
                    add(p, weight * patch.area());
                }
            }
        }
        [a, b, c, d] => {
            let (nodes, weights): (&[f64], &[f64]) = match rule {
                Rule::Two => (&[-INNER, INNER], &[0.5, 0.5]),
                Rule::Three => (&[-OUTER, 0.0, OUTER], &[5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0]),
            };
            for (&u, wu) in nodes.iter().zip(weights) {
                for (&v, wv) in nodes.iter().zip(weights) {
                    let (u, v) = (0.5 + u, 0.5 + v);
                    let along_u = (b - a).lerp(c - d, v);
                    let along_v = (d - a).lerp(c - b, u);
                    let p = a.lerp(b, u).lerp(d.lerp(c, u), v);
                    add(p, wu * wv * along_u.cross(along_v).dot(patch.normal()));
                }
            }
        }
        _ => {}
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    fn shapes() -> [Patch; 3] {
        let [x, y, z] = DVec3::AXES;
        let skew = x * 0.4 + y * 1.1;
        [
            Patch::new(&[DVec3::ZERO, x, x * 0.2 + y]).unwrap(),
            Patch::new(&[z, z + x, z + x + skew, z + skew]).unwrap(),
            Patch::new(&[DVec3::ZERO, x * 1.5, x + y * 0.8, y]).unwrap(),
        ]
    }

    #[test]
    fn weights_add_up_to_the_area_and_the_first_moment() {
        for patch in shapes() {
            for rule in [Rule::Two, Rule::Three] {
                let points = points(&patch, rule);
                let area: f64 = points.as_slice().iter().map(|p| p.1).sum();
                assert_relative_eq!(area, patch.area(), max_relative = 1e-13);
                let mean = points.as_slice().iter().map(|p| p.0 * p.1).sum::<DVec3>() / area;
                assert!(mean.distance(patch.centroid()) < 1e-12, "{patch:?}");
            }
        }
    }

    #[test]
    fn errors_fall_with_distance_by_the_order_of_the_rule() {
        for (rule, power) in [(Rule::Two, 4), (Rule::Three, 6)] {
            for patch in shapes() {
                let error = |distance: f64| {
                    let direction = DVec3::new(0.3, 0.4, 1.0).normalize();
                    let corners: Vec<DVec3> = shapes()[0]
                        .corners()
                        .iter()
                        .rev()
                        .map(|corner| *corner + patch.centroid() + direction * distance)
                        .collect();
                    let other = Patch::new(&corners).unwrap();
                    let exact = patch.exchange(&other);
                    (exchange(&patch, &other, rule) / exact - 1.0).abs()
                };
                for distance in [3.0, 6.0, 12.0] {
                    let scaled = error(distance) * f64::powi(distance, power);
                    assert!(scaled < 2.0, "{rule:?} at {distance}: {scaled}");
                }
                assert!(error(2.0) > 1e-9);
            }
        }
    }
}

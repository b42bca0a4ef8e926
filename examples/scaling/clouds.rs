//! The points and the charges: the same in every run.

use std::f64::consts::TAU;

use clap::ValueEnum;
use glam::DVec3;

/// A distribution of points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Cloud {
    /// Uniform in the unit cube
    Cube,
    /// Uniform on the unit sphere
    Sphere,
    /// Plummer's star cluster, truncated at ten of its radii
    Plummer,
    /// Uniform on a line that is not along an axis
    Line,
    /// Two small balls far apart
    Clusters,
    /// On a tube of one hundredth of its length that winds three times
    Helix,
}

/// A cloud of `n` points.
pub(crate) fn cloud(cloud: Cloud, n: usize) -> Vec<DVec3> {
    let mut random = Random(cloud as u64 + 1);
    let mut point = || match cloud {
        Cloud::Cube => DVec3::new(random.unit(), random.unit(), random.unit()),
        Cloud::Sphere => random.direction(),
        Cloud::Plummer => random.direction() * random.plummer_radius(),
        Cloud::Line => DVec3::new(1.0, 0.6, -0.3) * random.unit(),
        Cloud::Clusters => {
            let side = if random.unit() < 0.5 { -0.5 } else { 0.5 };
            DVec3::new(1.0, 0.4, 0.2) * side + random.direction() * (0.02 * random.unit())
        }
        Cloud::Helix => {
            let along = random.unit();
            let (sin, cos) = (3.0 * TAU * along).sin_cos();
            DVec3::new(0.25 * cos, 0.25 * sin, along) + random.direction() * 0.01
        }
    };
    (0..n).map(|_| point()).collect()
}

/// `n` charges, uniform in [−½, ½].
pub(crate) fn charges(n: usize) -> Vec<f64> {
    let mut random = Random(7);
    (0..n).map(|_| random.unit() - 0.5).collect()
}

/// A reproducible stream of numbers in [0, 1) (SplitMix64).
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn direction(&mut self) -> DVec3 {
        let z = 2.0 * self.unit() - 1.0;
        let (sin, cos) = (TAU * self.unit()).sin_cos();
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * cos, r * sin, z)
    }

    /// A radius of Plummer's model, M(r)/M = (1 + r⁻²)^(−3/2), drawn again beyond 10.
    fn plummer_radius(&mut self) -> f64 {
        loop {
            let radius = 1.0 / (self.unit().max(1e-12).powf(-2.0 / 3.0) - 1.0).sqrt();
            if radius < 10.0 {
                return radius;
            }
        }
    }
}

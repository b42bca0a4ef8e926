//! The point clouds that every scheme has to survive.

use glam::DVec3;

/// A reproducible stream of numbers in [0, 1) (SplitMix64).
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed)
    }

    pub(crate) fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    pub(crate) fn in_cube(&mut self) -> DVec3 {
        DVec3::new(self.unit(), self.unit(), self.unit())
    }

    pub(crate) fn direction(&mut self) -> DVec3 {
        let z = self.between(-1.0, 1.0);
        let (sin, cos) = self.between(0.0, std::f64::consts::TAU).sin_cos();
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * cos, r * sin, z)
    }
}

pub(crate) fn cube(n: usize, seed: u64) -> Vec<DVec3> {
    let mut random = Random::new(seed);
    (0..n).map(|_| random.in_cube()).collect()
}

pub(crate) fn sphere(n: usize, seed: u64) -> Vec<DVec3> {
    let mut random = Random::new(seed);
    (0..n).map(|_| random.direction()).collect()
}

/// Plummer's star cluster, truncated at radius 10.
pub(crate) fn plummer(n: usize, seed: u64) -> Vec<DVec3> {
    let mut random = Random::new(seed);
    let mut points = Vec::with_capacity(n);
    while points.len() < n {
        let radius = 1.0 / (random.unit().max(1e-12).powf(-2.0 / 3.0) - 1.0).sqrt();
        if radius < 10.0 {
            points.push(random.direction() * radius);
        }
    }
    points
}

pub(crate) fn line(n: usize, seed: u64) -> Vec<DVec3> {
    let mut random = Random::new(seed);
    (0..n).map(|_| DVec3::new(1.0, 2.0, -0.5) * random.unit()).collect()
}

pub(crate) fn coincident(n: usize) -> Vec<DVec3> {
    vec![DVec3::new(0.1, -0.2, 0.3); n]
}

/// Two tight clusters far from each other.
pub(crate) fn two_clusters(n: usize, seed: u64) -> Vec<DVec3> {
    let mut random = Random::new(seed);
    (0..n).map(|i| DVec3::X * (1e3 * (i % 2) as f64) + random.in_cube() * 1e-3).collect()
}

/// Every cloud, by name.
pub(crate) fn all(n: usize) -> Vec<(&'static str, Vec<DVec3>)> {
    vec![
        ("cube", cube(n, 1)),
        ("sphere", sphere(n, 2)),
        ("plummer", plummer(n, 3)),
        ("line", line(n, 4)),
        ("coincident", coincident(n)),
        ("two clusters", two_clusters(n, 5)),
    ]
}

/// Charges of either sign.
pub(crate) fn charges(n: usize, seed: u64) -> Vec<f64> {
    let mut random = Random::new(seed);
    (0..n).map(|_| random.between(-1.0, 1.0)).collect()
}

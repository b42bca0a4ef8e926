//! Point clouds and charges from seeded random numbers: the same in every run and on every machine.

use std::f64::consts::TAU;

use glam::DVec3;

/// A reproducible stream of numbers in [0, 1) (SplitMix64).
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// The stream of a seed.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next number in [0, 1).
    pub fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// The next number in [`low`, `high`).
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// The next index below a count.
    pub fn below(&mut self, count: usize) -> usize {
        (self.unit() * count as f64) as usize
    }

    /// A point, uniform in the unit cube.
    pub fn in_cube(&mut self) -> DVec3 {
        DVec3::new(self.unit(), self.unit(), self.unit())
    }

    /// A unit vector, uniform over all directions.
    pub fn direction(&mut self) -> DVec3 {
        let z = self.between(-1.0, 1.0);
        let (sin, cos) = self.between(0.0, TAU).sin_cos();
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * cos, r * sin, z)
    }
}

/// The six clouds that every scheme has to survive, by name, each of `n` points.
pub fn all(n: usize) -> Vec<(&'static str, Vec<DVec3>)> {
    vec![
        ("cube", cube(n, 1)),
        ("sphere", sphere(n, 2)),
        ("plummer", plummer(n, 3)),
        ("line", line(n, 4)),
        ("coincident", coincident(n)),
        ("two clusters", two_clusters(n, 5)),
    ]
}

/// Uniform in the unit cube.
pub fn cube(n: usize, seed: u64) -> Vec<DVec3> {
    let mut random = Random::new(seed);
    (0..n).map(|_| random.in_cube()).collect()
}

/// Uniform on the unit sphere.
pub fn sphere(n: usize, seed: u64) -> Vec<DVec3> {
    let mut random = Random::new(seed);
    (0..n).map(|_| random.direction()).collect()
}

/// Plummer's star cluster, M(r)/M = (1 + r⁻²)^(−3/2), truncated at radius 10.
pub fn plummer(n: usize, seed: u64) -> Vec<DVec3> {
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

/// Uniform on a line that is not along an axis.
pub fn line(n: usize, seed: u64) -> Vec<DVec3> {
    let mut random = Random::new(seed);
    (0..n).map(|_| DVec3::new(1.0, 2.0, -0.5) * random.unit()).collect()
}

/// The same point `n` times.
pub fn coincident(n: usize) -> Vec<DVec3> {
    vec![DVec3::new(0.1, -0.2, 0.3); n]
}

/// Two clusters, a million times smaller than the distance between them.
pub fn two_clusters(n: usize, seed: u64) -> Vec<DVec3> {
    let mut random = Random::new(seed);
    (0..n).map(|i| DVec3::X * (1e3 * (i % 2) as f64) + random.in_cube() * 1e-3).collect()
}

/// Two balls of radius 0.02, about 1 apart and densest at their centres.
pub fn two_balls(n: usize, seed: u64) -> Vec<DVec3> {
    let mut random = Random::new(seed);
    let mut point = || {
        let side = if random.unit() < 0.5 { -0.5 } else { 0.5 };
        DVec3::new(1.0, 0.4, 0.2) * side + random.direction() * (0.02 * random.unit())
    };
    (0..n).map(|_| point()).collect()
}

/// On a tube of radius 0.01 and height 1 that winds three times around the z axis.
pub fn helix(n: usize, seed: u64) -> Vec<DVec3> {
    let mut random = Random::new(seed);
    let mut point = || {
        let along = random.unit();
        let (sin, cos) = (3.0 * TAU * along).sin_cos();
        DVec3::new(0.25 * cos, 0.25 * sin, along) + random.direction() * 0.01
    };
    (0..n).map(|_| point()).collect()
}

/// Charges of either sign, uniform in [−1, 1).
pub fn charges(n: usize, seed: u64) -> Vec<f64> {
    let mut random = Random::new(seed);
    (0..n).map(|_| random.between(-1.0, 1.0)).collect()
}

/// Half the longest side of the bounding box; 1 for a cloud without extent.
pub fn half_width(points: &[DVec3]) -> f64 {
    let Some(&first) = points.first() else { return 1.0 };
    let (low, high) = points.iter().fold((first, first), |(l, h), &p| (l.min(p), h.max(p)));
    let half = 0.5 * (high - low).max_element();
    if half > 0.0 { half } else { 1.0 }
}

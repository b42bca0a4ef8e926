//! Kernels as users write them: smooth and steep, wide and narrow, with jumps, of positions.

use glam::DVec3;

/// K(x, y); pairs at the same position are left out.
pub(crate) type Formula = fn(DVec3, DVec3) -> f64;

/// All kernels by name.
pub(crate) const KERNELS: &[(&str, Formula)] = &[
    ("1/r", |x, y| 1.0 / x.distance(y)),
    ("-log r", |x, y| -x.distance(y).ln()),
    ("r^2 log r", |x, y| 0.5 * x.distance_squared(y) * x.distance_squared(y).ln()),
    ("r log r", |x, y| x.distance(y) * x.distance(y).ln()),
    ("exp(-r)", |x, y| (-x.distance(y)).exp()),
    ("yukawa 2", |x, y| (-2.0 * x.distance(y)).exp() / x.distance(y)),
    ("matern", |x, y| (1.0 + 3.0 * x.distance(y)) * (-3.0 * x.distance(y)).exp()),
    ("multiquadric", |x, y| (x.distance_squared(y) + 0.01).sqrt()),
    ("cos(3r)/r", |x, y| (3.0 * x.distance(y)).cos() / x.distance(y)),
    ("cos(60r)/r", |x, y| (60.0 * x.distance(y)).cos() / x.distance(y)),
    ("gauss 0.3", |x, y| gauss(x, y, 0.3)),
    ("gauss 0.01", |x, y| gauss(x, y, 0.01)),
    ("gauss 0.001", |x, y| gauss(x, y, 0.001)),
    ("r^-4", |x, y| x.distance_squared(y).powi(-2)),
    ("r^-12", |x, y| x.distance_squared(y).powi(-6)),
    ("lennard-jones", |x, y| {
        let s = (0.0025 / x.distance_squared(y)).powi(3);
        s * s - s
    }),
    ("wendland 0.1", |x, y| {
        let r = x.distance(y) / 0.1;
        if r < 1.0 { (1.0 - r).powi(4) * (4.0 * r + 1.0) } else { 0.0 }
    }),
    ("1/r cut at 0.4", |x, y| if x.distance(y) < 0.4 { 1.0 / x.distance(y) } else { 0.0 }),
    ("1/r with a jump", |x, y| (if x.distance(y) < 0.37 { 1.1 } else { 1.0 }) / x.distance(y)),
    ("|x1-y1|", |x, y| (x.x - y.x).abs()),
    ("step", |x, y| f64::from(x.x > y.x)),
    ("anisotropic", |x, y| {
        let d = x - y;
        1.0 / (d.x * d.x + 100.0 * d.y * d.y + 1e4 * d.z * d.z).sqrt()
    }),
    ("cosh 40r", |x, y| (40.0 * x.distance(y)).cosh()),
    ("half space", |x, y| {
        let image = DVec3::new(y.x, y.y, -0.5 - y.z);
        1.0 / x.distance(y) - 1.0 / x.distance(image)
    }),
    ("sin x", |x, y| (1.0 + x.x.sin()) / (0.01 + x.distance(y))),
    ("medium", |x, y| {
        let at = |p: DVec3| 2.0 + (9.0 * p.x).sin() * (7.0 * p.y).cos() + (8.0 * p.z).sin();
        at(x).sqrt() * at(y).sqrt() / x.distance(y)
    }),
];

fn gauss(x: DVec3, y: DVec3, sigma: f64) -> f64 {
    (-x.distance_squared(y) / (2.0 * sigma * sigma)).exp()
}

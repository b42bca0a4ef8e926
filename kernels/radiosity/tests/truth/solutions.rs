//! Whole solutions in closed form: spheres, craters, and the flux of the irradiance vector.

use std::convert::Infallible;
use std::f64::consts::PI;

use approx::assert_relative_eq;
use farfield::direct;
use farfield_radiosity::{Irradiance, Stop, Surfel, jacobi, quad_surfels, sphere_interior};
use glam::DVec3;

const TIGHT: Stop = Stop { tolerance: 1e-13, max_iterations: 1000 };

/// The irradiance inside a sphere of `radius`. A sum leaves out each surfel's own share, since no point
/// sees itself; a piece of a sphere does, by the same kernel.
fn inside(surfels: &[Surfel], radius: f64, b: &[[f64; 1]]) -> Vec<[f64; 1]> {
    let kernel = Irradiance::<f64, [f64; 1]>::clamped();
    let mut irradiance = direct(&kernel, surfels, b, surfels).unwrap();
    for ((h, surfel), b) in irradiance.iter_mut().zip(surfels).zip(b) {
        h[0] += surfel.area * b[0] / (4.0 * PI * radius * radius);
    }
    irradiance
}

#[test]
fn inside_of_a_sphere() {
    let (n, radius, rho) = (600, 2.0, 0.6);
    let sphere = sphere_interior(n, DVec3::new(0.3, -4.0, 1.0), radius);
    let emission: Vec<[f64; 1]> =
        sphere.iter().map(|s| [2.0 + s.normal.x + s.normal.y.powi(3)]).collect();
    let mean = emission.iter().map(|e| e[0]).sum::<f64>() / n as f64;
    let gather = |b: &[[f64; 1]]| Ok::<_, Infallible>(inside(&sphere, radius, b));
    let solution = jacobi(&emission, &vec![[rho]; n], TIGHT, gather, |_, _| ()).unwrap();
    for (b, e) in solution.radiosity.iter().zip(&emission) {
        assert_relative_eq!(b[0], e[0] + rho * mean / (1.0 - rho), max_relative = 1e-11);
    }
}

/// Stefan and Boltzmann's constant, W/(m² K⁴).
const SIGMA: f64 = 5.670374419e-8;

/// A bowl: the part of a sphere below a plane, of depth 1 and diameter D, in bright sunlight.
struct Crater {
    /// Diameter over depth.
    diameter: f64,
    /// Of the sunlight, W/m².
    flux: f64,
    /// Of the sun above the plane of the rim.
    elevation: f64,
    albedo: f64,
    emissivity: f64,
}

impl Crater {
    /// The temperature in shadow, in closed form (Ingersoll, Svitek and Murray, Icarus 100, 1992).
    fn formula(&self) -> f64 {
        let Self { diameter, flux, elevation, albedo, emissivity } = *self;
        let f = 1.0 / (1.0 + (0.5 * diameter).powi(2));
        let scattered = f * (1.0 - albedo) / (1.0 - albedo * f);
        let emitted = flux * elevation.sin() * scattered;
        (emitted * (1.0 + albedo * (1.0 - f) / emissivity) / SIGMA).powf(0.25)
    }

    /// The temperatures in shadow, coldest and warmest, by two solutions over `n` surfels.
    ///
    /// F_ij = A_j/(4πR²) between all parts of the bowl, whose area is f 4πR², and nothing hides but the
    /// rim. Sunlight S_i is reflected: B = A (S + H). What isn't, (1 − A)(S + H), is emitted again, since
    /// no part conducts heat: ε σT⁴ = ε H' + (1 − A)(S + H), H' the infrared received. So B' =
    /// ε σT⁴ + (1 − ε) H' = H' + (1 − A)(S + H): a surface that reflects all infrared. By hand, with
    /// ⟨S⟩ = F0 sin e0 · f (1 − f) summed over the bowl, H = A⟨S⟩/(1 − A f) and
    /// H' = (1 − A)⟨S⟩/((1 − A f)(1 − f)), which is the formula where S = 0.
    fn solved(&self, n: usize) -> [f64; 2] {
        let Self { diameter, flux, elevation, albedo, emissivity } = *self;
        let radius = 0.5 * ((0.5 * diameter).powi(2) + 1.0);
        let centre = DVec3::Z * (radius - 1.0);
        let golden_angle = PI * (3.0 - 5f64.sqrt());
        let surfel = |i: usize| {
            let z = (i as f64 + 0.5) / n as f64;
            let below = DVec3::NEG_Z * (radius - z);
            let around = (radius * radius - (radius - z).powi(2)).sqrt();
            let (sin, cos) = (golden_angle * i as f64).sin_cos();
            let outwards = below + DVec3::new(cos, sin, 0.0) * around;
            Surfel {
                position: centre + outwards,
                normal: -outwards / radius,
                area: 2.0 * PI * radius / n as f64,
                face: Surfel::<f64>::NO_FACE,
            }
        };
        let bowl: Vec<Surfel> = (0..n).map(surfel).collect();
        let sun = DVec3::new(elevation.cos(), 0.0, elevation.sin());
        // The plane of the rim is z = 0. A ray to the sun leaves the sphere above it, or is stopped.
        let sunlight = |s: &Surfel| {
            let cosine = s.normal.dot(sun);
            let exit = s.position + sun * (2.0 * radius * cosine);
            if cosine > 0.0 && exit.z > 0.0 { flux * cosine } else { 0.0 }
        };
        let sunlight: Vec<f64> = bowl.iter().map(sunlight).collect();

        let gather = |b: &[[f64; 1]]| Ok::<_, Infallible>(inside(&bowl, radius, b));
        let emission: Vec<_> = sunlight.iter().map(|s| [albedo * s]).collect();
        let visible = jacobi(&emission, &vec![[albedo]; n], TIGHT, gather, |_, _| ()).unwrap();
        let absorbed: Vec<_> = sunlight
            .iter()
            .zip(&visible.irradiance)
            .map(|(s, h)| [(1.0 - albedo) * (s + h[0])])
            .collect();
        // A reflectance of 1 is half of 2.
        let twice = |b: &[[f64; 1]]| {
            let received = inside(&bowl, radius, b);
            Ok::<_, Infallible>(received.iter().map(|h| [2.0 * h[0]]).collect())
        };
        let infrared = jacobi(&absorbed, &vec![[0.5]; n], TIGHT, twice, |_, _| ()).unwrap();
        let temperature = |i: usize| {
            let emitted = 0.5 * infrared.irradiance[i][0] + absorbed[i][0] / emissivity;
            (emitted / SIGMA).powf(0.25)
        };
        let dark = || (0..n).filter(|&i| sunlight[i] == 0.0).map(temperature);
        assert!(dark().count() > n / 100, "there is shadow");
        [dark().fold(f64::INFINITY, f64::min), dark().fold(0.0, f64::max)]
    }
}

#[test]
fn shadows_in_a_crater() {
    for (diameter, exact) in [(5.0, 155.17554), (10.0, 112.56425)] {
        let crater = Crater {
            diameter,
            flux: 1000.0,
            elevation: 15f64.to_radians(),
            albedo: 0.3,
            emissivity: 0.99,
        };
        assert_relative_eq!(crater.formula(), exact, epsilon = 1e-4);
        let [coldest, warmest] = crater.solved(3000);
        assert_relative_eq!(coldest, warmest, max_relative = 1e-10);
        assert_relative_eq!(coldest, exact, epsilon = 0.01);
    }
}

/// The walls of the box from `low` to `high`, n × n surfels each, the fronts inwards.
fn walls(low: DVec3, high: DVec3, n: usize) -> Vec<Surfel> {
    let mut scene = farfield_radiosity::Scene::new();
    scene.add_room(low, high, n);
    scene.surfels
}

#[test]
fn the_irradiance_vector_has_no_sources_but_surfaces() {
    let sources: Vec<Surfel> = (0..20)
        .map(|i| {
            let t = f64::from(i);
            let position = DVec3::new(t.sin(), t.cos(), -1.0 - 0.05 * t);
            let normal = DVec3::new((2.0 * t).cos(), (3.0 * t).sin(), 0.5).normalize();
            Surfel { position, normal, area: 0.1 + 0.01 * t, face: 0 }
        })
        .collect();
    let radiosity: Vec<f64> = (0..20).map(|i| 1.0 + f64::from(i % 3)).collect();
    let kernel = Irradiance::<f64>::signed();
    let flux = |n: usize| {
        let box_ = walls(DVec3::new(-0.4, -0.3, -0.6), DVec3::new(0.5, 0.6, 0.8), n);
        let h = direct(&kernel, &sources, &radiosity, &box_).unwrap();
        let flux = |size: fn(f64) -> f64| -> f64 {
            box_.iter().zip(&h).map(|(s, &h)| s.area * size(h)).sum()
        };
        (flux(|h| h) / flux(f64::abs)).abs()
    };
    let found = [8, 16, 32, 64].map(flux);
    assert!(found[3] < 1e-4 && found.windows(2).all(|w| w[1] < 0.4 * w[0]), "{found:?}");
}

#[test]
fn walls_around_a_lamp_receive_all_its_light() {
    let normal = DVec3::new(0.3, -0.5, 0.8).normalize();
    let lamp = Surfel { position: DVec3::new(0.1, 0.2, -0.1), normal, area: 0.5, face: 0 };
    let received = |n: usize| -> f64 {
        let box_ = walls(DVec3::NEG_ONE, DVec3::ONE, n);
        let h = direct(&Irradiance::<f64>::clamped(), &[lamp], &[3.0], &box_).unwrap();
        box_.iter().zip(&h).map(|(s, h)| s.area * h).sum()
    };
    let found = [16, 64].map(received);
    assert_relative_eq!(found[1], 1.5, max_relative = 1e-3);
    // A piece of wall with its back to the lamp receives none.
    let corners = [[-1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [1.0, -1.0]];
    let back = quad_surfels(corners.map(|[x, y]| DVec3::new(x, y, 1.0)).map(|c| -c), 4, 4, 1);
    let outwards: Vec<Surfel> =
        back.iter().map(|s| Surfel { normal: DVec3::NEG_Z, ..*s }).collect();
    let h = direct(&Irradiance::<f64>::clamped(), &[lamp], &[3.0], &outwards).unwrap();
    assert!(h.iter().all(|&h| h == 0.0));
}

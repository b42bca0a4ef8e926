//! Measures one gather of red, green and blue on the inside of a sphere, where nothing is hidden, by
//! interpolation and by the 16-moment expansion. Accuracy is asserted before any measurement.

use std::f64::consts::PI;
use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use farfield::{Expansion, Fmm, Scheme, relative_l2_error};
use farfield_radiosity::{Irradiance, SixteenMoment, Surfel};
use glam::DVec3;

const TOLERANCE: f64 = 1e-3;

/// The order at which the 16-moment expansion keeps the tolerance here.
const ORDER: usize = 6;

type Rgb = [f64; 3];
type Kernel = Irradiance<f64, Rgb>;

/// Equal areas along a spiral on the unit sphere, normals inwards.
fn sphere(n: usize) -> Vec<Surfel> {
    let golden_angle = PI * (3.0 - 5f64.sqrt());
    let surfel = |i: usize| {
        let z = 1.0 - (2 * i + 1) as f64 / n as f64;
        let (sin, cos) = (golden_angle * i as f64).sin_cos();
        let position = DVec3::new(cos, sin, 0.0) * (1.0 - z * z).sqrt() + DVec3::Z * z;
        let area = 4.0 * PI / n as f64;
        Surfel { position, normal: -position, area, face: Surfel::<f64>::NO_FACE }
    };
    (0..n).map(surfel).collect()
}

/// Between two points of a unit sphere's inside the kernel is 1/4π, whatever their distance: the
/// irradiance is the mean radiosity, less the share of the receiver itself.
fn exact(radiosities: &[Rgb]) -> Vec<Rgb> {
    let n = radiosities.len() as f64;
    let sum = |band: usize| radiosities.iter().map(|b| b[band]).sum::<f64>();
    let sums: Rgb = std::array::from_fn(sum);
    radiosities.iter().map(|b| std::array::from_fn(|band| (sums[band] - b[band]) / n)).collect()
}

fn gathers(criterion: &mut Criterion) {
    for n in [20_000, 100_000] {
        let surfels = sphere(n);
        let radiosity = |s: &Surfel| [1.0 + 0.5 * s.position.x, s.position.y, s.position.z.powi(2)];
        let radiosities: Vec<Rgb> = surfels.iter().map(radiosity).collect();
        let exact = exact(&radiosities);
        let kernel = Kernel::signed();
        let mut group = criterion.benchmark_group("radiosity");
        group.throughput(Throughput::Elements(n as u64)).sample_size(10);

        let plan = || {
            Fmm::builder(kernel)
                .tolerance(TOLERANCE)
                .scheme(Scheme::Fmm)
                .build(&surfels, &surfels)
                .unwrap()
        };
        let fmm = plan();
        check("interpolation", &fmm, &radiosities, &exact);
        group.bench_function(BenchmarkId::new("interpolation, plan", n), |b| b.iter(plan));
        group.bench_function(BenchmarkId::new("interpolation, gather", n), |b| {
            b.iter(|| fmm.apply(black_box(&radiosities)).unwrap());
        });

        let fmm =
            Fmm::with_expansion(SixteenMoment::new(kernel, ORDER).unwrap()).scheme(Scheme::Fmm);
        let fmm = fmm.build(&surfels, &surfels).unwrap();
        check("16 moments", &fmm, &radiosities, &exact);
        group.bench_function(BenchmarkId::new("16 moments, gather", n), |b| {
            b.iter(|| fmm.apply(black_box(&radiosities)).unwrap());
        });
        group.finish();
    }
}

fn check<E: Expansion<Kernel = Kernel>>(
    name: &str,
    fmm: &Fmm<E>,
    radiosities: &[Rgb],
    exact: &[Rgb],
) {
    let error = relative_l2_error(&fmm.apply(radiosities).unwrap(), exact);
    assert!(error < TOLERANCE, "{name}: {error:e}");
}

criterion_group!(benches, gathers);
criterion_main!(benches);

//! Measures the time of each operator in one application, by the clock of the plan. Accuracy is asserted
//! before any measurement.

use std::time::Duration;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use farfield::{ApplyTimes, Fmm, Scheme, direct, relative_l2_error};
use farfield_benches::clouds;
use farfield_potentials::InverseDistance;

const POINTS: usize = 100_000;

/// Targets that the error is measured at.
const SAMPLES: usize = 500;

/// Reads the seconds of one operator.
type Seconds = fn(&ApplyTimes) -> f64;

fn operators(criterion: &mut Criterion) {
    let points = clouds::even(POINTS);
    let charges: Vec<f64> = points.iter().map(|p| p.x - p.y).collect();
    let kernel = InverseDistance::<f64>::new();
    let exact = direct(&kernel, &points, &charges, &points[..SAMPLES]).unwrap();
    for tolerance in [1e-3, 1e-6, 1e-9] {
        let fmm = Fmm::builder(kernel)
            .tolerance(tolerance)
            .scheme(Scheme::Fmm)
            .build(&points, &points)
            .unwrap();
        let error = relative_l2_error(&fmm.apply(&charges).unwrap()[..SAMPLES], &exact);
        assert!(error <= tolerance, "{tolerance:e}: {error:e}");
        let mut group = criterion.benchmark_group("operators");
        group.throughput(Throughput::Elements(POINTS as u64)).sample_size(10);
        let operators: [(&str, Seconds); 6] = [
            ("P2M", |times| times.p2m),
            ("M2M", |times| times.m2m),
            ("M2L", |times| times.m2l),
            ("L2L", |times| times.l2l),
            ("L2P", |times| times.l2p),
            ("near field", |times| times.near),
        ];
        for (name, seconds) in operators {
            group.bench_function(BenchmarkId::new(name, format!("{tolerance:e}")), |b| {
                b.iter_custom(|count| {
                    let once = || seconds(&fmm.apply_timed(&charges).unwrap().1);
                    Duration::from_secs_f64((0..count).map(|_| once()).sum())
                });
            });
        }
        group.finish();
    }
}

criterion_group!(benches, operators);
criterion_main!(benches);

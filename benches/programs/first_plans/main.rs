//! What the first plan for a kernel takes, and what it takes when another process has saved its operators.
//!
//! ```text
//! cargo run --release -p farfield-benches --example first_plans
//! cargo run --release -p farfield-benches --example first_plans -- --kernels log --clouds cube --points 2e4
//! ```
//!
//! "loaded" is the time to load the operators from a folder and to build the same plan with them. Kernels marked with
//! a star state their identity; of the others a quarter of the values is evaluated again that went into the operators. Every plan's
//! error is checked at sampled targets, relative to what the tolerance is.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use clap::Parser;
use farfield::{
    Coordinates, Difference, Error, Fmm, Formula, Interpolation, Kernel, Number, OperatorStore,
    from_fn, from_formula,
};
use farfield_benches::cli::{count, name};
use farfield_benches::clouds::{self, Cloud};
use farfield_potentials::InverseFourth;
use glam::DVec3;

/// What is measured.
#[derive(Parser)]
struct Args {
    /// Kernels whose names contain one of these
    #[arg(long, value_delimiter = ',')]
    kernels: Vec<String>,
    /// Where the points lie
    #[arg(long, value_enum, value_delimiter = ',', default_value = "cube,helix")]
    clouds: Vec<Cloud>,
    /// Number of points
    #[arg(long, value_parser = count, default_value = "1e5")]
    points: usize,
    /// Where operators are saved for a while
    #[arg(long)]
    folder: Option<PathBuf>,
}

type Function = fn(DVec3, DVec3) -> f64;

/// Kernels that are given by their values alone, with the error asked for.
const FUNCTIONS: [(&str, f64, Function); 6] = [
    ("yukawa", 1e-9, |x, y| (-x.distance(y)).exp() / x.distance(y)),
    ("log r", 1e-9, |x, y| x.distance(y).ln()),
    ("r^2 log r", 1e-9, |x, y| x.distance_squared(y) * x.distance(y).ln()),
    ("gaussian", 1e-9, |x, y| (-x.distance_squared(y)).exp()),
    ("exp(-r)", 1e-9, |x, y| (-x.distance(y)).exp()),
    ("anisotropic", 1e-9, |x, y| {
        let d = x - y;
        (d.x * d.x + 4.0 * d.y * d.y + 9.0 * d.z * d.z).sqrt().recip()
    }),
];

/// exp(−k r)/r, which says what it is.
#[derive(Clone, Copy)]
struct Yukawa {
    k: f64,
}

impl Formula for Yukawa {
    type Of = Difference;
    type Entry<N: Number> = N;

    #[inline(always)]
    fn entries<N: Number>(&self, d: Coordinates<N>, g: &mut [N]) {
        let r = d.length();
        g[0] = (r * N::constant(-self.k)).exp() / r;
    }

    fn identity(&self) -> Option<String> {
        Some(format!("yukawa {}", self.k))
    }
}

fn main() -> ExitCode {
    let args = Args::parse();
    let own = std::env::temp_dir().join(format!("farfield-first-plans-{}", std::process::id()));
    let folder = args.folder.clone().unwrap_or(own);
    println!(
        "{:>12} {:>7} {:>6} {:>9} {:>9} {:>6} {:>8} {:>9}",
        "kernel", "cloud", "asked", "first s", "loaded s", "ratio", "MB", "error"
    );
    let mut failed = false;
    for &cloud in &args.clouds {
        let points = clouds::cloud(cloud, args.points);
        let case =
            Case { cloud: &name(cloud), points: &points, folder: &folder, kernels: &args.kernels };
        for (name, tolerance, function) in FUNCTIONS {
            failed |= !case.measure(name, tolerance, || from_fn(function).skip_coincident());
        }
        let stated = || from_formula::<_, DVec3, f64>(Yukawa { k: 1.0 }).skip_coincident();
        failed |= !case.measure("yukawa*", 1e-9, stated);
        failed |= !case.measure("1/r^4*", 1e-7, InverseFourth::<f64>::new);
    }
    drop(fs::remove_dir_all(&folder));
    if failed { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}

/// The points of a row of the table.
struct Case<'a> {
    cloud: &'a str,
    points: &'a [DVec3],
    folder: &'a Path,
    kernels: &'a [String],
}

impl Case<'_> {
    /// Prints a row; whether the tolerance is kept.
    fn measure<K>(&self, name: &str, tolerance: f64, kernel: impl Fn() -> K) -> bool
    where
        K: Kernel<
                Real = f64,
                Entry = f64,
                Source = DVec3,
                Target = DVec3,
                Charge = f64,
                Value = f64,
            >,
    {
        let is_asked = self.kernels.iter().any(|part| name.contains(&part[..]));
        if !self.kernels.is_empty() && !is_asked {
            return true;
        }
        drop(fs::remove_dir_all(self.folder));
        let found = self.times(tolerance, kernel);
        match found {
            Ok([first, loaded, bytes, error]) => {
                let Self { cloud, .. } = self;
                let (ratio, megabytes) = (loaded / first, bytes / 1e6);
                println!(
                    "{name:>12} {cloud:>7} {tolerance:>6.0e} {first:>9.3} {loaded:>9.3} {ratio:>6.2} {megabytes:>8.1} {error:>9.1e}"
                );
                error <= tolerance
            }
            Err(error) => {
                println!("{name:>12} {:>7} {tolerance:>6.0e} FAILED: {error}", self.cloud);
                false
            }
        }
    }

    /// Seconds of the first plan and of one with loaded operators, bytes of operators, and the error.
    fn times<K>(
        &self,
        tolerance: f64,
        kernel: impl Fn() -> K,
    ) -> Result<[f64; 4], Box<dyn std::error::Error>>
    where
        K: Kernel<
                Real = f64,
                Entry = f64,
                Source = DVec3,
                Target = DVec3,
                Charge = f64,
                Value = f64,
            >,
    {
        let plan = |store: &OperatorStore| -> Result<Fmm<Interpolation<K>>, Error> {
            let builder = Fmm::builder(kernel()).tolerance(tolerance).operator_store(store);
            builder.applications(100).build(self.points, self.points)
        };
        let store = OperatorStore::new(usize::MAX);
        let start = Instant::now();
        drop(plan(&store)?);
        let first = start.elapsed().as_secs_f64();
        store.save(self.folder)?;
        let bytes = store.bytes();

        let start = Instant::now();
        let store = OperatorStore::new(usize::MAX);
        store.load(self.folder)?;
        let fmm = plan(&store)?;
        let loaded = start.elapsed().as_secs_f64();
        let charges = clouds::charges(self.points.len());
        let (values, certificate) = fmm.apply_certified(&charges)?;
        let share = self.share_of_size(&kernel(), &charges, &values);
        Ok([first, loaded, bytes as f64, certificate.estimate * share])
    }

    /// ‖u‖ in units of what a tolerance is relative to: the larger of ‖u‖ and s, s² = Σ (K q)², both at some targets.
    fn share_of_size<K>(&self, kernel: &K, charges: &[f64], values: &[f64]) -> f64
    where
        K: Kernel<Real = f64, Entry = f64, Source = DVec3, Target = DVec3>,
    {
        let mut entries = vec![0.0; self.points.len()];
        let (mut u, mut s) = (0.0, 0.0);
        for i in (0..self.points.len()).step_by(self.points.len().div_ceil(JUDGED)) {
            kernel.entries_block(&self.points[i..=i], self.points, &mut entries);
            let terms = entries.iter().zip(charges).zip(self.points);
            let others = terms.filter(|(_, y)| **y != self.points[i]);
            s += others.map(|((k, q), _)| (k * q).powi(2)).sum::<f64>();
            u += values[i].powi(2);
        }
        if s > u { (u / s).sqrt() } else { 1.0 }
    }
}

/// Targets at which it is measured what a tolerance is relative to.
const JUDGED: usize = 64;

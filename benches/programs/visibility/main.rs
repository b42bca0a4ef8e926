//! Measures what visibility costs: rays, seconds and memory of a gather of red, green and blue in a room
//! with two blocks and a lamp, beside direct summation with the same visibility.
//!
//! ```text
//! cargo run --release -p farfield-benches --example visibility
//! cargo run --release -p farfield-benches --example visibility -- --elements 1e3,1e4 --tolerance 1e-2
//! ```
//!
//! The table goes to standard output, and `visibility.csv` to the folder `--out`, where `benches/draw.py`
//! turns it into charts. Errors are relative in the l2 norm, those of the worst band, against direct sums
//! with exact visibility at sampled elements. A larger error than the tolerance ends the program. Direct
//! summation is timed at the same elements and scaled up.

mod room;

use std::error::Error;
use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use clap::{Parser, ValueEnum};
use farfield::{Fmm, direct_masked, relative_l2_error};
use farfield_benches::cli::{count, name};
use farfield_radiosity::{Irradiance, Occluders, Surfel, Visibility};

use room::Room;

/// Measures what visibility costs.
#[derive(Debug, Parser)]
#[command(name = "visibility")]
struct Args {
    /// Numbers of elements, about
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = count)]
    #[arg(default_value = "1e3,1e4,3e4,1e5,2e5")]
    elements: Vec<usize>,

    /// Ways to find visibility
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_enum)]
    #[arg(default_value = "exact,fractional")]
    visibility: Vec<Way>,

    /// Relative error of sums
    #[arg(long, value_name = "E", default_value = "0.1")]
    tolerance: f64,

    /// The most elements in a leaf
    #[arg(long, value_name = "N", default_value = "128", value_parser = count)]
    leaf_size: usize,

    /// Elements at which errors and direct sums are measured
    #[arg(long, value_name = "N", default_value = "300", value_parser = count)]
    samples: usize,

    /// Folder for visibility.csv
    #[arg(long, value_name = "DIR", default_value = "target/visibility")]
    out: PathBuf,
}

/// A way to find which elements see each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Way {
    /// Ray by ray, where no certificate settles it
    Exact,
    /// By samples, where that adds less than the tolerance
    Fractional,
}

type Rgb = [f64; 3];
type Kernel = Irradiance<f64, Rgb>;

/// What one gather took.
struct Row {
    elements: usize,
    way: Way,
    plan: f64,
    apply: f64,
    /// Visibility and one sum of all pairs, if summed directly.
    direct: f64,
    error: f64,
    uncertainty: f64,
    rays: f64,
    /// Shares of all pairs.
    expansion: f64,
    summed: f64,
    hidden: f64,
    megabytes: f64,
}

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(args: &Args) -> Result<(), Box<dyn Error>> {
    fs::create_dir_all(&args.out).map_err(|error| format!("{}: {error}", args.out.display()))?;
    println!(
        "elements visibility     plan s  apply s  direct s    error  uncertain  rays/element  \
         by expansion  directly  hidden      MB"
    );
    let mut rows = Vec::new();
    for &elements in &args.elements {
        for &way in &args.visibility {
            let row = measure(args, &Room::new(elements), way)?;
            println!(
                "{:8} {:<12} {:9.2} {:8.3} {:9.1} {:8.1e} {:10.1e} {:13.0} {:13.4} {:9.4} {:7.4} {:7.0}",
                row.elements,
                name(way),
                row.plan,
                row.apply,
                row.direct,
                row.error,
                row.uncertainty,
                row.rays,
                row.expansion,
                row.summed,
                row.hidden,
                row.megabytes
            );
            rows.push(row);
        }
    }
    let path = args.out.join("visibility.csv");
    fs::write(&path, csv(&rows, args.tolerance))
        .map_err(|error| format!("{}: {error}", path.display()))?;
    Ok(())
}

fn measure(args: &Args, room: &Room, way: Way) -> Result<Row, Box<dyn Error>> {
    let surfels = &room.scene.surfels;
    let occluders = Occluders::new(&room.scene.triangles)?;
    let mut visibility = Visibility::new(&occluders);
    if way == Way::Fractional {
        visibility = visibility.fractional(args.tolerance, room.brightness())?;
    }
    let (kernel, radiosity) = (Kernel::clamped(), room.radiosity());
    let start = Instant::now();
    let fmm = Fmm::builder(kernel)
        .mask(&visibility)
        .tolerance(args.tolerance)
        .leaf_size(args.leaf_size)
        .build(surfels, surfels)?;
    let plan = start.elapsed().as_secs_f64();
    let mut seconds = Vec::new();
    let mut gathered = Vec::new();
    for _ in 0..3 {
        let start = Instant::now();
        gathered = fmm.apply(&radiosity)?;
        seconds.push(start.elapsed().as_secs_f64());
    }
    seconds.sort_by(f64::total_cmp);

    let sampled: Vec<usize> = (0..args.samples).map(|k| k * surfels.len() / args.samples).collect();
    let targets: Vec<Surfel> = sampled.iter().map(|&i| surfels[i]).collect();
    let start = Instant::now();
    let exact = direct_masked(&kernel, &Visibility::new(&occluders), surfels, &radiosity, &targets)
        .unwrap();
    let direct = start.elapsed().as_secs_f64() * surfels.len() as f64 / targets.len() as f64;
    let band = |values: &dyn Fn(usize) -> Rgb, k: usize| -> Vec<f64> {
        (0..sampled.len()).map(|i| values(i)[k]).collect()
    };
    let errors = (0..3)
        .map(|k| relative_l2_error(&band(&|i| gathered[sampled[i]], k), &band(&|i| exact[i], k)));
    let error = errors.fold(0.0, f64::max);
    if error > args.tolerance {
        return Err(format!("{} elements, {}: error {error:e}", surfels.len(), name(way)).into());
    }

    let (stats, counts) = (fmm.report().stats, visibility.counts());
    let n = surfels.len() as f64;
    let area = surfels.iter().map(|surfel| surfel.area).sum();
    Ok(Row {
        elements: surfels.len(),
        way,
        plan,
        apply: seconds[seconds.len() / 2],
        direct,
        error,
        uncertainty: visibility.uncertainty(area),
        rays: counts.rays as f64 / n,
        expansion: stats.expansion_pairs as f64 / (n * n),
        summed: stats.direct_pairs as f64 / (n * n),
        hidden: counts.hidden as f64 / (n * n),
        megabytes: (stats.plan_bytes() + stats.workspace_bytes) as f64 / 1e6,
    })
}

fn csv(rows: &[Row], tolerance: f64) -> String {
    let mut csv = String::from(
        "elements,visibility,plan_s,apply_s,direct_s,relative_l2_error,uncertainty,\
         rays_per_element,expansion,direct,hidden,megabytes,tolerance\n",
    );
    for row in rows {
        // Writing to a string can't fail.
        let _ = writeln!(
            csv,
            "{},{},{:.3},{:.4},{:.2},{:.3e},{:.3e},{:.1},{:.5},{:.5},{:.5},{:.1},{tolerance}",
            row.elements,
            name(row.way),
            row.plan,
            row.apply,
            row.direct,
            row.error,
            row.uncertainty,
            row.rays,
            row.expansion,
            row.summed,
            row.hidden,
            row.megabytes
        );
    }
    csv
}

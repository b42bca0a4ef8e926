//! Light in the Cornell box, from the scene to its picture: a tutorial on the three crates.
//!
//! B(x) = E(x) + ρ(x) H(x),   H(x) = Σ_y V(x, y) F(x, y) B(y)
//!
//! The radiosity B of an element x is what it emits, E, and the share ρ that it reflects of the
//! irradiance H. That is a sum over all elements y: F says how much of the light of y arrives at x, and
//! V is 0 where something stands between them. `farfield-scenes` cuts the scene into elements and takes
//! the picture, `farfield-radiosity` knows F, V and solvers, and `farfield` sums.
//! Run it by `cargo run --release --example radiosity`.

use std::error::Error;
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use farfield::{Fmm, direct_masked, relative_l2_error};
use farfield_radiosity::{
    Corrections, Enclosure, Irradiance, RadiosityOperator, Stop, Surfel, Visibility,
    conjugate_gradients,
};
use farfield_scenes::{ByPixel, Fields, Mesh, Optics, Output, Picture, Quantity, Sight, load};

const HELP: &str = "\
Light in the Cornell box: solved, checked against direct summation, and pictured.

Usage: radiosity [--elements N] [--out DIR] [--help]

  --elements N  about how many elements to cut the surfaces into, 100 to 4000000 [default: 10000]
  --out DIR     folder for radiosity.png and report.json [default: target/radiosity]
  --help        this text

The full program is `farfield radiosity`, with other scenes, files, solvers and formats:
cargo install --path cli
";

/// The relative l2 error that the irradiance may have.
const TOLERANCE: f64 = 1e-2;
/// Red, green and blue.
type Bands = [f64; 3];

fn main() -> ExitCode {
    match options().and_then(|options| options.map_or(Ok(HELP.to_owned()), run)) {
        Ok(message) => {
            print!("{message}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("radiosity: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run((elements, folder): (usize, PathBuf)) -> Result<String, Box<dyn Error>> {
    let start = Instant::now();
    let mut output = Output::new(&folder)?;

    // Flat elements of nearly equal size. A surfel is what the far field knows of an element.
    let scene = load("cornell")?;
    let mesh = Mesh::new(&scene, elements)?;
    let surfels: Vec<Surfel> = mesh.elements.iter().map(|element| *element.surfel()).collect();
    let optics = Optics::<3>::new(&scene, &mesh, Quantity::Light, scene.bands(), 0);

    // The sum for all elements at once: a kernel, and a mask that leaves out pairs that are hidden.
    let sight = Sight::new(&scene, &mesh)?;
    let walls = sight.occluders();
    let visibility = Visibility::new(walls);
    let kernel = Irradiance::<f64, Bands>::clamped();
    let builder = Fmm::builder(kernel).tolerance(TOLERANCE).mask(&visibility).leaf_size(128);
    let fmm = builder.build(&surfels, &surfels)?;

    // Near elements are no points to each other: corrections replace their pairs by exact form factors.
    // Closing scales rows so that no element receives more light than there is.
    let corrections = Corrections::new(&mesh.elements, walls, TOLERANCE)?;
    let mut operator = RadiosityOperator::new(&mesh.elements, |b| fmm.apply(b), corrections)?;
    let row_sums = operator.row_sums()?;
    operator.close(Enclosure::Open, 0.5)?;
    let plan_s = start.elapsed().as_secs_f64();

    // A few sums solve the equation.
    let stop = Stop { tolerance: 1e-2 * TOLERANCE, ..Stop::default() };
    let (emission, reflectance) = (&optics.emission, &optics.reflectance);
    let gather = |b: &[Bands]| operator.apply(b);
    let solution = conjugate_gradients(&surfels, emission, reflectance, stop, gather, |_, _| ())?;
    let solve_s = start.elapsed().as_secs_f64() - plan_s;

    // The same sums pair by pair, each with a ray of its own, at elements spread by the golden section.
    let scaled = |(j, b): (usize, &Bands)| b.map(|band| operator.scaling(j) * band);
    let scaled: Vec<Bands> = solution.radiosity.iter().enumerate().map(scaled).collect();
    let spread = |k: usize| ((k as f64 * 0.618_034).fract() * surfels.len() as f64) as usize;
    let sample: Vec<usize> = (0..1000).map(spread).collect();
    let targets: Vec<Surfel> = sample.iter().map(|&i| surfels[i]).collect();
    let far = direct_masked(&kernel, &Visibility::new(walls), &surfels, &scaled, &targets)?;
    let mut near = vec![[0.0; 3]; surfels.len()];
    operator.corrections().add(&scaled, &mut near);
    let sum = |(&i, far): (&usize, &Bands)| {
        [0, 1, 2].map(|band| operator.scaling(i) * (near[i][band] + far[band]))
    };
    let exact: Vec<Bands> = sample.iter().zip(&far).map(sum).collect();
    let gathered = operator.apply(&solution.radiosity)?;
    let found: Vec<Bands> = sample.iter().map(|&i| gathered[i]).collect();
    let error = relative_l2_error(&found, &exact);
    if error > TOLERANCE {
        return Err(format!("the irradiance is off by {error:.1e}: expected {TOLERANCE:e}").into());
    }

    // Light straight from the lamp has sharp shadows: the picture gathers it anew at every pixel, and
    // takes from the elements only what they reflect to each other.
    let reflected = |(b, e): (&Bands, &Bands)| [0, 1, 2].map(|band| b[band] - e[band]);
    let reflected: Vec<Bands> = solution.radiosity.iter().zip(emission).map(reflected).collect();
    let by_pixel = ByPixel::of_lamps(operator.apply(&reflected)?.into_flattened());
    let fields = Fields {
        bands: scene.bands(),
        radiosity: solution.radiosity.into_flattened(),
        emission: optics.emission.into_flattened(),
        irradiance: solution.irradiance.into_flattened(),
        row_sums,
    };
    let image = Picture::of_light(&sight, &fields, walls, Some(&by_pixel), Picture::SIZE, |_| ())?;
    let report = serde_json::json!({
        "scene": "cornell", "elements": surfels.len(), "tolerance": TOLERANCE,
        "relative_l2_error": error, "sampled_surfels": sample.len(),
        "iterations": solution.iterations, "residual": solution.residual,
        "plan_s": plan_s, "solve_s": solve_s, "seconds": start.elapsed().as_secs_f64(),
    });
    output.png("radiosity.png", image.size, &image.codes)?;
    output.write("report.json", |file| writeln!(file, "{report:#}"))?;
    output.publish()?;
    Ok(format!("{report:#}\nwrote radiosity.png and report.json to {}\n", folder.display()))
}

/// How many elements, and the folder for output; none if help is asked for.
fn options() -> Result<Option<(usize, PathBuf)>, Box<dyn Error>> {
    let (mut elements, mut folder) = (10_000, PathBuf::from("target/radiosity"));
    let mut arguments = std::env::args().skip(1);
    while let Some(flag) = arguments.next() {
        match (flag.as_str(), arguments.next()) {
            ("--help", _) => return Ok(None),
            ("--elements", Some(count)) => match count.parse() {
                Ok(count @ 100..=4_000_000) => elements = count,
                _ => return Err(format!("--elements {count}: expected 100 to 4000000").into()),
            },
            ("--out", Some(path)) => folder = path.into(),
            _ => return Err(format!("{flag}: expected a flag with its value\n\n{HELP}").into()),
        }
    }
    Ok(Some((elements, folder)))
}

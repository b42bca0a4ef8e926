//! farfield beside other fast multipole methods at equal error: 1/r in double precision.
//!
//! ```text
//! benches/peers/run.sh
//! benches/peers/run.sh --points 2e4 --clouds cube
//! ```
//!
//! `run.sh` makes a virtual environment with fmm3dpy and runs this program. See README.md for what the
//! registries' builds are.

mod args;
mod ferreus;
mod problem;
mod rival;

use std::env;
use std::error::Error;
use std::fmt::{self, Write as _};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::time::Instant;

use clap::Parser;
use farfield::{Fmm, direct};
use farfield_benches::cli::name;
use farfield_benches::clouds::{self, Cloud};
use farfield_benches::operators::forget_operators;
use farfield_potentials::InverseDistance;
use glam::DVec3;

use args::Args;
use problem::Problem;
use rival::Verdict;

/// One sum and what it took, in seconds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Trial {
    /// What sets the accuracy: a tolerance, or an order.
    pub(crate) knob: f64,
    /// Relative l2 error.
    pub(crate) error: f64,
    /// What depends on the points alone; 0 if it can't be had apart.
    pub(crate) plan: f64,
    /// From charges to values.
    pub(crate) apply: f64,
}

/// How a rival tells of its trials, and the columns of the file.
impl fmt::Display for Trial {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:e},{:e},{},{}", self.knob, self.error, self.plan, self.apply)
    }
}

impl Trial {
    /// The inverse of `to_string`.
    pub(crate) fn parse(line: &str) -> Option<Self> {
        let numbers: Vec<f64> =
            line.split(',').map(|x| x.trim().parse()).collect::<Result<_, _>>().ok()?;
        let &[knob, error, plan, apply] = numbers.as_slice() else { return None };
        Some(Self { knob, error, plan, apply })
    }

    fn total(&self) -> f64 {
        self.plan + self.apply
    }
}

fn main() -> ExitCode {
    let words: Vec<String> = env::args().skip(1).collect();
    let done = match words.iter().map(String::as_str).collect::<Vec<_>>().as_slice() {
        // How the program calls itself.
        ["ferreus", folder, tolerance, repeats] => match (tolerance.parse(), repeats.parse()) {
            (Ok(tolerance), Ok(repeats)) => ferreus::run(Path::new(folder), tolerance, repeats),
            _ => Err("expected a tolerance and a number of repeats".into()),
        },
        _ => compare(&Args::parse()),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

/// The middle of some times.
pub(crate) fn median(times: &mut [f64]) -> f64 {
    times.sort_by(f64::total_cmp);
    times.get(times.len() / 2).copied().unwrap_or(f64::NAN)
}

fn compare(args: &Args) -> Result<(), Box<dyn Error>> {
    let threads = args.threads();
    rayon::ThreadPoolBuilder::new().num_threads(threads).build_global()?;
    fs::create_dir_all(&args.out)?;
    let mut csv = String::from("cloud,n,asked,threads,who,knob,error,plan,apply\n");
    println!("1/r, f64, threads: {threads}; total: plan and apply; ratios: rival / farfield");
    println!(
        "{:<8}{:>9}{:>7}  {:<9}{:>9}{:>9}{:>9}{:>9}{:>14}{:>14}",
        "cloud",
        "N",
        "asked",
        "who",
        "knob",
        "error",
        "total",
        "apply",
        "total ratio",
        "apply ratio"
    );
    for &cloud in &args.clouds {
        for &n in &args.points {
            let problem = pose(cloud, n);
            let folder = args.out.join("data");
            problem.write(&folder)?;
            for &tolerance in &args.tolerances {
                let cloud = name(cloud);
                let head = format!("{cloud:<8}{n:>9}{tolerance:>7.0e}");
                let mut note = |who: &str, trial: &Trial| {
                    // Writing to a string can't fail.
                    let _ = writeln!(csv, "{cloud},{n},{tolerance:e},{threads},{who},{trial}");
                };
                let own = farfield_trial(&problem, tolerance, args.repeats)?;
                note("farfield", &own);
                println!("{head}  {}", line("farfield", &own, None));
                for (who, mut command) in rivals(args, &folder, tolerance)? {
                    command.env("OMP_NUM_THREADS", threads.to_string());
                    command.env("RAYON_NUM_THREADS", threads.to_string());
                    match rival::run(&mut command, &folder, tolerance, args.limit)? {
                        Verdict::Kept(trial) => {
                            note(who, &trial);
                            println!("{head}  {}", line(who, &trial, Some(&own)));
                        }
                        Verdict::Missed(why) => println!("{head}  {who:<9} missed: {why}"),
                    }
                }
            }
        }
    }
    let file = args.out.join("peers.csv");
    fs::write(&file, csv)?;
    println!("wrote {}", file.display());
    Ok(())
}

fn pose(cloud: Cloud, n: usize) -> Problem {
    let (points, charges) = (clouds::cloud(cloud, n), clouds::charges(n));
    let step = problem::step(n);
    let targets: Vec<DVec3> = points.iter().step_by(step).copied().collect();
    let exact = direct(&InverseDistance::<f64>::new(), &points, &charges, &targets);
    Problem { points, charges, exact, step }
}

/// The commands of the rivals, in the order of the table.
fn rivals(
    args: &Args,
    folder: &Path,
    tolerance: f64,
) -> Result<Vec<(&'static str, Command)>, Box<dyn Error>> {
    let rest = [tolerance.to_string(), args.repeats.to_string()];
    let mut ferreus = Command::new(env::current_exe()?);
    ferreus.arg("ferreus").arg(folder).args(&rest);
    let here = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let python = env::var_os("PEERS_PYTHON").unwrap_or_else(|| "python3".into());
    let mut fmm3dpy = Command::new(python);
    fmm3dpy.arg(here.join("fmm3d.py")).arg(folder).args(&rest);
    let mut rivals = vec![("ferreus", ferreus), ("fmm3dpy", fmm3dpy)];
    rivals.retain(|(who, _)| !args.without.iter().any(|left_out| left_out == who));
    Ok(rivals)
}

fn farfield_trial(
    problem: &Problem,
    tolerance: f64,
    repeats: usize,
) -> Result<Trial, farfield::Error> {
    let Problem { points, charges, .. } = problem;
    let (mut plans, mut applies, mut error) = (Vec::new(), Vec::new(), 0.0);
    for _ in 0..repeats {
        forget_operators()?;
        let start = Instant::now();
        let kernel = InverseDistance::<f64>::new();
        let fmm = Fmm::builder(kernel).tolerance(tolerance).build(points, points)?;
        plans.push(start.elapsed().as_secs_f64());
        let start = Instant::now();
        let values = fmm.apply(charges)?;
        applies.push(start.elapsed().as_secs_f64());
        error = problem.error(&values);
        // The first application allocates what the next works on, which is the one that rivals with a
        // plan would be asked for again.
        let start = Instant::now();
        fmm.apply(charges)?;
        applies.push(start.elapsed().as_secs_f64());
    }
    let (plan, apply) = (median(&mut plans), median(&mut applies));
    Ok(Trial { knob: tolerance, error, plan, apply })
}

fn line(who: &str, trial: &Trial, own: Option<&Trial>) -> String {
    let ratio = |of: fn(&Trial) -> f64| {
        own.map_or(String::new(), |own| format!("{:.1}", of(trial) / of(own)))
    };
    format!(
        "{who:<9}{:>9.0e}{:>9.1e}{:>9.3}{:>9.3}{:>14}{:>14}",
        trial.knob,
        trial.error,
        trial.total(),
        trial.apply,
        ratio(Trial::total),
        ratio(|t| t.apply)
    )
}

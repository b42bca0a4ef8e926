//! Why `farfield sum` fails.

use std::path::PathBuf;

use farfield_formula::KernelError;

use super::read::ReadError;
use super::write::WriteError;

/// Why there is no result.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Failure {
    /// An input file can't be used.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// An output file can't be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// Values and report would have one name.
    #[error("--out and --report: expected two files, found {} for both", _0.display())]
    SameFile(PathBuf),
    /// The engine refuses the input.
    #[error(transparent)]
    Engine(#[from] farfield::Error),
    /// The folder of operators can't be used.
    #[error("--operators: {0}")]
    Operators(#[from] farfield::StoreError),
    /// The kernel is neither known by name nor a formula.
    #[error(
        "--kernel {name}: {source}; power laws with an expansion of their own are inverse-distance, inverse-square, inverse-fourth, squared-distance"
    )]
    UnknownKernel {
        /// What was given.
        name: String,
        /// Why it is none.
        source: Box<KernelError>,
    },
    /// The kernel's formula is wrong.
    #[error("--kernel: {0}")]
    Kernel(KernelError),
    /// A flag that this kernel does not have.
    #[error("{flag} with --kernel {kernel}: expected it with {expected} only")]
    Flag {
        /// The flag.
        flag: &'static str,
        /// The kernel.
        kernel: String,
        /// The kernels that have it.
        expected: &'static str,
    },
    /// Points and charges do not belong together.
    #[error(
        "{}: {found} charges: expected {expected}, one per point of {}",
        charges.display(),
        points.display()
    )]
    Lengths {
        /// The file of charges.
        charges: PathBuf,
        /// How many it holds.
        found: usize,
        /// The file of points.
        points: PathBuf,
        /// How many it holds.
        expected: usize,
    },
    /// The threads asked for can't be had.
    #[error("{count} threads: {source}")]
    Threads {
        /// How many were asked for.
        count: usize,
        /// Why they can't be had.
        source: rayon::ThreadPoolBuildError,
    },
    /// The system doesn't tell of Ctrl-C.
    #[error("Ctrl-C can't be heard of: {0}")]
    CtrlC(ctrlc::Error),
    /// The sums are not as accurate as asked for.
    #[error(
        "the relative l2 error is {found:.2e}: expected at most {expected:e}, so no values are written"
    )]
    Inaccurate {
        /// The error measured.
        found: f64,
        /// The tolerance.
        expected: f64,
    },
}

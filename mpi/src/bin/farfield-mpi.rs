//! `farfield-mpi sum`: sums over points from files, by all processes that `mpirun` starts.

use std::process::ExitCode;

use farfield_mpi::{MpiTransport, program};
use mpi::Threading;

fn main() -> ExitCode {
    // Only this thread speaks to others; those that sum do not.
    let Some((universe, _)) = mpi::initialize_with_threading(Threading::Funneled) else {
        eprintln!("farfield-mpi: MPI has been initialised already");
        return ExitCode::FAILURE;
    };
    program::main(&MpiTransport::new(universe.world()))
}

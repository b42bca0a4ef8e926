//! `farfield sum`: sums over points from files, for those who do not write Rust.

mod args;
#[cfg(test)]
mod damaged;
mod error;
mod progress;
mod read;
mod report;
mod run;
mod text;
mod write;

pub(crate) use args::{Args, one_line};

use std::process::ExitCode;

use farfield::Watch;

use crate::interrupt::Interrupt;

/// Does what the command line asks for.
pub(crate) fn main(args: &Args) -> ExitCode {
    let interrupt = Interrupt::by_ctrl_c("sum").map_err(error::Failure::CtrlC);
    let run = |interrupt| run::run(&Args { interrupt, watch: Watch::new(), ..args.clone() });
    match interrupt.and_then(run) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

//! The program `farfield-mpi`, for whatever connects its ranks.

mod args;
mod files;
mod sum;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::Parser;

use self::args::{Command, Program};
use crate::transport::Transport;

/// Does what the command line of this process asks for, which all ranks have alike. Rank 0 speaks for all.
pub fn main(ranks: &dyn Transport) -> ExitCode {
    match run(ranks, std::env::args_os()) {
        Ok(report) => {
            if ranks.rank() == 0 {
                print!("{report}");
            }
            ExitCode::SUCCESS
        }
        Err(Failure { message, code }) => {
            if ranks.rank() == 0 {
                if code == 0 { print!("{message}") } else { eprintln!("{}", message.trim_end()) }
            }
            ExitCode::from(code)
        }
    }
}

/// Does what a command line asks for, the program's name first; what is to be said about it on success.
///
/// # Errors
/// What is wrong with the command line, an input or a file, or with what the sums came to. All ranks get the same, and
/// there is no file then.
pub fn run(
    ranks: &dyn Transport,
    line: impl IntoIterator<Item = impl Into<OsString> + Clone>,
) -> Result<String, Failure> {
    let program = Program::try_parse_from(line).map_err(|error| Failure {
        message: error.to_string(),
        code: u8::try_from(error.exit_code()).unwrap_or(2),
    })?;
    let Command::Sum(args) = program.command;
    sum::run(ranks, &args).map_err(|error| {
        let message = format!("farfield-mpi: {error}");
        Failure { message, code: 1 }
    })
}

/// Why the program ends without a result, and the code that it ends with: 2 for a wrong command line, 1 for what was wrong
/// later, 0 where help was asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// What to say.
    pub message: String,
    /// The exit code.
    pub code: u8,
}

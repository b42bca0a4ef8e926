//! `farfield` on the command line: sums over points from files, light or radiant heat in scenes, daylight, and form factors.
//!
//! ```sh
//! farfield radiosity --scene columns --elements 30000
//! farfield factors --scene room.vs3 --out room.txt
//! farfield daylight --scene street.obj --sun times.csv --out daylight.csv
//! farfield sum --points points.npy --charges charges.npy --kernel inverse-distance --out values.npy
//! ```
//!
//! `farfield kernels` lists the kernels that `sum` knows by name; it takes formulas, too. `farfield help`
//! and, say, `farfield radiosity --help` explain every flag.

mod csv;
mod daylight;
mod factors;
mod interrupt;
mod kernels;
mod memory;
mod outdoors;
mod progress;
mod radiosity;
mod sum;

use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{Parser, Subcommand};

/// Fast multipole sums over points from files, light or radiant heat in scenes, daylight, and form factors.
#[derive(Debug, Parser)]
#[command(name = "farfield", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Daylight(Box<daylight::Args>),
    Factors(Box<factors::Args>),
    /// Lists the kernels that `farfield sum` knows by name, with their formulas and parameters
    Kernels,
    Radiosity(Box<radiosity::Args>),
    Sum(Box<sum::Args>),
}

fn main() -> ExitCode {
    match Cli::try_parse() {
        Ok(Cli { command: Command::Daylight(args) }) => daylight::main(&args),
        Ok(Cli { command: Command::Factors(args) }) => factors::main(&args),
        Ok(Cli { command: Command::Kernels }) => kernels::main(),
        Ok(Cli { command: Command::Radiosity(args) }) => radiosity::main(&args),
        Ok(Cli { command: Command::Sum(args) }) => sum::main(&args),
        Err(error) => explain(&error),
    }
}

/// Prints the help that was asked for, or what is wrong with the command line: on one line for `sum`,
/// which other programs call.
fn explain(error: &clap::Error) -> ExitCode {
    let help = matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion);
    if !help && std::env::args_os().nth(1).is_some_and(|command| command == "sum") {
        eprintln!("{}", sum::one_line(error));
    } else {
        // A reader that has gone away changes nothing.
        drop(error.print());
    }
    if help { ExitCode::SUCCESS } else { ExitCode::from(2) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }
}

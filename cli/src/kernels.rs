//! `farfield kernels`: what `farfield sum` knows by name.

use std::io::{self, Write};
use std::process::ExitCode;

use farfield_formula::READY;

/// Longer formulas are those of tensors, which their description says shorter.
const LONGEST: usize = 100;

/// Lists all ready kernels.
pub(crate) fn main() -> ExitCode {
    // A reader that has gone away changes nothing.
    drop(list(&mut io::stdout().lock()));
    ExitCode::SUCCESS
}

fn list(out: &mut impl Write) -> io::Result<()> {
    for ready in READY {
        writeln!(out, "{}", ready.name)?;
        writeln!(out, "    {}", ready.about)?;
        if ready.text.len() <= LONGEST {
            writeln!(out, "    {}", ready.text)?;
        }
        for parameter in ready.parameters {
            writeln!(
                out,
                "    --param {}={}  {}",
                parameter.name, parameter.default, parameter.about
            )?;
        }
    }
    writeln!(out, "\nAny formula serves as well, such as --kernel \"exp(-k*r)/r\" --param k=2.")
}

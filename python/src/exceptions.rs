//! What goes wrong, as exceptions of Python.

use farfield::Error;
use pyo3::import_exception;
use pyo3::prelude::*;

import_exception!(farfield._errors, InputError);
import_exception!(farfield._errors, KernelError);
import_exception!(farfield._errors, SumError);
import_exception!(farfield._errors, ToleranceError);

/// The exception that says the same.
pub(crate) fn exception(error: Error) -> PyErr {
    let words = error.to_string();
    match error {
        Error::UnreachableTolerance { .. } => ToleranceError::new_err(words),
        Error::NonFiniteValue { .. } | Error::NonFiniteKernel => SumError::new_err(words),
        _ => InputError::new_err(words),
    }
}

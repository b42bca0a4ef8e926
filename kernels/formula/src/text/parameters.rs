//! The parameters of a text and their values.

use crate::text::error::{Problem, TextError};
use crate::text::names;

/// Parameters with values, and which of them have occurred.
pub(crate) struct Parameters<'a>(Vec<(&'a str, f64, bool)>);

impl<'a> Parameters<'a> {
    /// The parameters given.
    ///
    /// # Errors
    /// If a name can't be a parameter's or comes twice, or a value is not finite.
    pub(crate) fn new(text: &str, given: &[(&'a str, f64)]) -> Result<Self, TextError> {
        let mut parameters = Self(Vec::new());
        for &(name, found) in given {
            let owned = || name.to_owned();
            let problem = if !names::may_be_parameter(name) {
                Problem::ParameterName { name: owned() }
            } else if parameters.has(name) {
                Problem::ParameterTwice { name: owned() }
            } else if !found.is_finite() {
                Problem::ParameterValue { name: owned(), found }
            } else {
                parameters.0.push((name, found, false));
                continue;
            };
            return Err(TextError::of_parameters(text, problem));
        }
        Ok(parameters)
    }

    /// Whether there is one of that name.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.names().any(|other| other == name)
    }

    /// All names.
    pub(crate) fn names(&self) -> impl Iterator<Item = &'a str> + '_ {
        self.0.iter().map(|(name, ..)| *name)
    }

    /// The value of one that occurs.
    pub(crate) fn take(&mut self, name: &str) -> Option<f64> {
        let (_, value, used) = self.0.iter_mut().find(|(other, ..)| *other == name)?;
        *used = true;
        Some(*value)
    }

    /// The first that has not occurred, as a problem.
    pub(crate) fn unused(&self) -> Option<Problem> {
        let (name, ..) = self.0.iter().find(|(_, _, used)| !used)?;
        let used = self.0.iter().filter(|(_, _, used)| *used);
        let used = used.map(|(name, ..)| (*name).to_owned()).collect();
        Some(Problem::UnusedParameter { name: (*name).to_owned(), used })
    }
}

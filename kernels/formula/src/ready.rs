//! Ready kernels by name.

use crate::formula::{Coincident, TextFormula};
use crate::text::error::{Problem, TextError};
use crate::text::names::{continues_name, nearest};

/// A kernel that has a name.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Ready {
    /// Its name.
    pub name: &'static str,
    /// What it is, on one line.
    pub about: &'static str,
    /// Its formula.
    pub text: &'static str,
    /// Its parameters.
    pub parameters: &'static [Parameter],
    /// What holds for points at the same position.
    pub coincident: Coincident,
}

/// A parameter of a [`Ready`] kernel.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Parameter {
    /// Its name.
    pub name: &'static str,
    /// Its value, unless another is given.
    pub default: f64,
    /// What it is.
    pub about: &'static str,
    /// What it must be.
    pub expected: &'static str,
    /// Whether a number is that.
    is_valid: fn(f64) -> bool,
}

impl Ready {
    /// The kernel of that name.
    pub fn named(name: &str) -> Option<&'static Self> {
        READY.iter().find(|ready| ready.name == name)
    }

    /// The kernel of a name or of a text, with values for some or all parameters.
    ///
    /// # Errors
    /// [`KernelError`] if it is neither, or the parameters are not those of the kernel.
    pub fn or_text(
        name_or_text: &str,
        parameters: &[(&str, f64)],
    ) -> Result<TextFormula, KernelError> {
        let Some(ready) = Self::named(name_or_text.trim()) else {
            return TextFormula::new(name_or_text, parameters).map_err(|error| {
                let name = name_or_text.trim();
                let is_name = name.chars().count() > 1 && name.chars().all(continues_name);
                if is_name && !name.starts_with(|c: char| c.is_ascii_digit()) {
                    KernelError::unknown(name)
                } else {
                    KernelError::Text(error)
                }
            });
        };
        ready.formula(parameters).map_err(KernelError::Text)
    }

    /// The formula, with other values for some of its parameters.
    ///
    /// # Errors
    /// [`TextError`] if a parameter is not one of the kernel's, or its value is not what it must be.
    pub fn formula(&self, parameters: &[(&str, f64)]) -> Result<TextFormula, TextError> {
        let given = |name: &str| parameters.iter().any(|(other, _)| *other == name);
        let defaults = self.parameters.iter().filter(|parameter| !given(parameter.name));
        let defaults = defaults.map(|parameter| (parameter.name, parameter.default));
        let all: Vec<_> = parameters.iter().copied().chain(defaults).collect();
        for Parameter { name, expected, is_valid, .. } in self.parameters {
            let found =
                all.iter().find(|(other, x)| other == name && x.is_finite() && !is_valid(*x));
            if let Some(&(_, found)) = found {
                let name = (*name).to_owned();
                let problem = Problem::ParameterDomain { name, kernel: self.name, found, expected };
                return Err(TextError::of_parameters(self.text, problem));
            }
        }
        Ok(TextFormula::new(self.text, &all)?.coincident(self.coincident).named(self.name))
    }
}

/// Why there is no kernel.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum KernelError {
    /// What is wrong with a text.
    #[error(transparent)]
    Text(#[from] TextError),
    /// A name that no kernel has.
    #[error("there is no kernel {name:?}: expected {}a formula such as \"exp(-k*r)/r\", or one of {}",
        .nearest.as_deref().map_or_else(String::new, |name| format!("{name} perhaps, or ")), names())]
    UnknownKernel {
        /// The name.
        name: String,
        /// The known one that it is most like.
        nearest: Option<String>,
    },
}

impl KernelError {
    fn unknown(name: &str) -> Self {
        let nearest = nearest(name, READY.iter().map(|ready| ready.name));
        Self::UnknownKernel { name: name.to_owned(), nearest }
    }
}

fn names() -> String {
    READY.map(|ready| ready.name).join(", ")
}

const fn positive(name: &'static str, default: f64, about: &'static str) -> Parameter {
    Parameter { name, default, about, expected: "a number above 0", is_valid: |x| x > 0.0 }
}

const fn not_negative(name: &'static str, default: f64, about: &'static str) -> Parameter {
    Parameter { name, default, about, expected: "0 or a number above it", is_valid: |x| x >= 0.0 }
}

const fn scalar(name: &'static str, about: &'static str, text: &'static str) -> Ready {
    Ready { name, about, text, parameters: &[], coincident: Coincident::Skip }
}

impl Ready {
    const fn with(self, parameters: &'static [Parameter]) -> Self {
        Self { parameters, ..self }
    }

    /// 1 at r = 0, where derivatives are zero, or there are none, and the formula gives no number for them.
    const fn one_at_zero(self) -> Self {
        Self { coincident: Coincident::Value(1.0), ..self }
    }

    /// Smooth at r = 0, where it counts.
    const fn everywhere(self) -> Self {
        Self { coincident: Coincident::Formula, ..self }
    }
}

const LENGTH: &[Parameter] = &[positive("length", 1.0, "its length")];
const SHAPE: &[Parameter] = &[positive("c", 1.0, "the distance at which it bends")];
const VISCOSITY: &[Parameter] = &[positive("mu", 1.0, "the viscosity")];

/// All ready kernels. d = x − y points from the source to the target, and r = |d|. Those that are singular or
/// zero at r = 0 skip pairs at the same position; all others count them.
pub const READY: [Ready; 23] = [
    scalar("laplace", "1/r: the potential of charges and masses, without 4π or signs", "1/r"),
    scalar("laplace_dipole", "p·d/r³: the potential of dipoles p, three numbers a source", "[[d1/r^3, d2/r^3, d3/r^3]]"),
    scalar("yukawa", "exp(−k r)/r: the screened potential", "exp(-k*r)/r")
        .with(&[not_negative("k", 1.0, "one over the screening length")]),
    scalar("softened_coulomb", "1/√(r² + eps²): 1/r without its peak; a point does not act on itself", "1/sqrt(r2 + eps^2)")
        .with(&[not_negative("eps", 0.01, "the softening length")]),
    scalar("inverse_power", "r^(−p)", "r^(-p)").with(&[Parameter {
        name: "p",
        default: 2.0,
        about: "the power",
        expected: "any number",
        is_valid: |_| true,
    }]),
    scalar("gaussian", "exp(−(r/length)²)", "exp(-r2/length^2)").with(LENGTH).everywhere(),
    scalar("matern12", "exp(−r/length): Matérn's covariance of smoothness 1/2", "exp(-r/length)").with(LENGTH).one_at_zero(),
    scalar(
        "matern32",
        "(1 + s) exp(−s), s = √3 r/length: Matérn's covariance of smoothness 3/2",
        "(1 + sqrt(3)*r/length)*exp(-sqrt(3)*r/length)",
    )
    .with(LENGTH)
    .one_at_zero(),
    scalar(
        "matern52",
        "(1 + s + s²/3) exp(−s), s = √5 r/length: Matérn's covariance of smoothness 5/2",
        "(1 + sqrt(5)*r/length + 5*r2/(3*length^2))*exp(-sqrt(5)*r/length)",
    )
    .with(LENGTH)
    .one_at_zero(),
    scalar("multiquadric", "√(r² + c²)", "sqrt(r2 + c^2)").with(SHAPE).everywhere(),
    scalar("inverse_multiquadric", "1/√(r² + c²)", "1/sqrt(r2 + c^2)").with(SHAPE).everywhere(),
    scalar("inverse_quadratic", "1/(r² + c²)", "1/(r2 + c^2)").with(SHAPE).everywhere(),
    scalar("r", "r: the biharmonic spline", "r"),
    scalar("r3", "r³: the triharmonic spline", "r^3"),
    scalar("r2logr", "r² log r: the thin plate spline, 0 at r = 0", "r2*log(r)"),
    scalar("logr", "log r", "log(r)"),
    scalar("inverse_square", "1/r²", "1/r2"),
    scalar("inverse_fourth", "1/r⁴", "1/r2^2"),
    scalar(
        "stokeslet",
        "(f + d (d·f)/r²)/(8π mu r): the velocity that forces f cause in a viscous fluid",
        "[[(1/r + d1*d1/r^3)/(8*pi*mu), d1*d2/r^3/(8*pi*mu), d1*d3/r^3/(8*pi*mu)], \
          [d2*d1/r^3/(8*pi*mu), (1/r + d2*d2/r^3)/(8*pi*mu), d2*d3/r^3/(8*pi*mu)], \
          [d3*d1/r^3/(8*pi*mu), d3*d2/r^3/(8*pi*mu), (1/r + d3*d3/r^3)/(8*pi*mu)]]",
    )
    .with(VISCOSITY),
    scalar(
        "rotlet",
        "t × d/(8π mu r³): the velocity that torques t cause in a viscous fluid",
        "[[0, d3/r^3/(8*pi*mu), -d2/r^3/(8*pi*mu)], [-d3/r^3/(8*pi*mu), 0, d1/r^3/(8*pi*mu)], \
          [d2/r^3/(8*pi*mu), -d1/r^3/(8*pi*mu), 0]]",
    )
    .with(VISCOSITY),
    scalar(
        "biot_savart",
        "w × d/(4π r³): the velocity that vorticity w, times its volume, induces",
        "[[0, d3/r^3/(4*pi), -d2/r^3/(4*pi)], [-d3/r^3/(4*pi), 0, d1/r^3/(4*pi)], \
          [d2/r^3/(4*pi), -d1/r^3/(4*pi), 0]]",
    ),
    scalar(
        "kelvin",
        "((3 − 4 nu) f + d (d·f)/r²)/(16π G (1 − nu) r): the displacement that forces f cause in an elastic body",
        "[[((3 - 4*nu)/r + d1*d1/r^3)/(16*pi*G*(1 - nu)), d1*d2/r^3/(16*pi*G*(1 - nu)), d1*d3/r^3/(16*pi*G*(1 - nu))], \
          [d2*d1/r^3/(16*pi*G*(1 - nu)), ((3 - 4*nu)/r + d2*d2/r^3)/(16*pi*G*(1 - nu)), d2*d3/r^3/(16*pi*G*(1 - nu))], \
          [d3*d1/r^3/(16*pi*G*(1 - nu)), d3*d2/r^3/(16*pi*G*(1 - nu)), ((3 - 4*nu)/r + d3*d3/r^3)/(16*pi*G*(1 - nu))]]",
    )
    .with(&[
        positive("G", 1.0, "the shear modulus"),
        Parameter {
            name: "nu",
            default: 0.3,
            about: "Poisson's ratio",
            expected: "a number from -1 to 0.5",
            is_valid: |x| (-1.0..=0.5).contains(&x),
        },
    ]),
    scalar(
        "rpy",
        "Rotne, Prager and Yamakawa's mobility of spheres of radius a, also where they overlap or coincide",
        "[[where(r < 2*a, 1 - 9*r/(32*a) + 3*d1*d1/(32*a*max(r, 1e-30)), \
                          3*a/4*(1/r + 2*a^2/(3*r^3) + d1*d1*(1/r^3 - 2*a^2/r^5)))/(6*pi*mu*a), \
           where(r < 2*a, 3*d1*d2/(32*a*max(r, 1e-30)), 3*a/4*d1*d2*(1/r^3 - 2*a^2/r^5))/(6*pi*mu*a), \
           where(r < 2*a, 3*d1*d3/(32*a*max(r, 1e-30)), 3*a/4*d1*d3*(1/r^3 - 2*a^2/r^5))/(6*pi*mu*a)], \
          [where(r < 2*a, 3*d2*d1/(32*a*max(r, 1e-30)), 3*a/4*d2*d1*(1/r^3 - 2*a^2/r^5))/(6*pi*mu*a), \
           where(r < 2*a, 1 - 9*r/(32*a) + 3*d2*d2/(32*a*max(r, 1e-30)), \
                          3*a/4*(1/r + 2*a^2/(3*r^3) + d2*d2*(1/r^3 - 2*a^2/r^5)))/(6*pi*mu*a), \
           where(r < 2*a, 3*d2*d3/(32*a*max(r, 1e-30)), 3*a/4*d2*d3*(1/r^3 - 2*a^2/r^5))/(6*pi*mu*a)], \
          [where(r < 2*a, 3*d3*d1/(32*a*max(r, 1e-30)), 3*a/4*d3*d1*(1/r^3 - 2*a^2/r^5))/(6*pi*mu*a), \
           where(r < 2*a, 3*d3*d2/(32*a*max(r, 1e-30)), 3*a/4*d3*d2*(1/r^3 - 2*a^2/r^5))/(6*pi*mu*a), \
           where(r < 2*a, 1 - 9*r/(32*a) + 3*d3*d3/(32*a*max(r, 1e-30)), \
                          3*a/4*(1/r + 2*a^2/(3*r^3) + d3*d3*(1/r^3 - 2*a^2/r^5)))/(6*pi*mu*a)]]",
    )
    .with(&[positive("a", 0.01, "the radius"), positive("mu", 1.0, "the viscosity")])
    .everywhere(),
];

//! The radiosities that satisfy B = E + ρH(B).

use std::convert::Infallible;

use farfield::Mask;
use farfield_radiosity::{
    Corrections, Error, Irradiance, RadiosityOperator, Solution, Stop, Surfel, Visibility,
    conjugate_gradients, jacobi, jacobi as bicgstab, southwell,
};
use rayon::prelude::*;

use crate::args::SolverName;
use crate::progress::Progress;
use crate::surfaces::Surfaces;

/// The equation's residual in units of the tolerance: small enough not to add to the error.
const RESIDUAL: f64 = 1e-2;
/// Bounces that a solution may take.
const MAX_BOUNCES: usize = 2000;

/// Everything that decides how elements exchange light.
pub(crate) struct Exchange<'a, const BANDS: usize> {
    /// The surfels of all elements.
    pub(crate) surfels: &'a [Surfel],
    /// From all radiosities to all irradiances.
    pub(crate) operator: &'a RadiosityOperator<'a, BANDS>,
    /// What it adds to a sum over centroids.
    pub(crate) corrections: &'a Corrections,
    /// Which elements see each other, pair by pair.
    pub(crate) visibility: &'a Visibility<'a>,
}

impl<const BANDS: usize> Exchange<'_, BANDS> {
    /// Solves for the radiosities, with a bar for the digits gained.
    ///
    /// # Errors
    /// If the iteration doesn't converge or a sum fails.
    pub(crate) fn solve(
        &self,
        surfaces: &Surfaces<BANDS>,
        solver: SolverName,
        tolerance: f64,
        progress: &Progress,
    ) -> Result<Solution<f64, BANDS>, Error> {
        let tolerance = RESIDUAL * tolerance;
        let bar = progress.bar("solving");
        let report = |_, residual: f64| bar.show(residual.ln() / tolerance.ln());
        let Surfaces { emission, reflectance } = surfaces;
        let shots = if solver == SolverName::Southwell { self.surfels.len() } else { 1 };
        let stop = Stop { tolerance, max_iterations: MAX_BOUNCES * shots };
        let apply = |b: &[[f64; BANDS]]| self.operator.apply(b);
        match solver {
            SolverName::Cg => {
                conjugate_gradients(self.surfels, emission, reflectance, stop, apply, report)
            }
            SolverName::Jacobi => jacobi(emission, reflectance, stop, apply, report),
            SolverName::Bicgstab => bicgstab(emission, reflectance, stop, apply, report),
            SolverName::Southwell => {
                let column = |i: usize| Ok::<_, Infallible>(self.column(i));
                southwell(self.surfels, emission, reflectance, stop, column, report)
            }
        }
    }

    /// The irradiance of every element per unit radiosity of element i.
    fn column(&self, i: usize) -> Vec<f64> {
        let kernel = Irradiance::<f64>::clamped();
        let source = &self.surfels[i];
        let factor = |receiver| {
            let seen = Mask::<Irradiance<f64>>::pair(self.visibility, receiver, source);
            if seen { kernel.factor(receiver, source) * source.area } else { 0.0 }
        };
        let mut column: Vec<f64> = self.surfels.par_iter().with_min_len(256).map(factor).collect();
        for (j, value) in self.corrections.column(i) {
            column[j] += value;
        }
        let scale = self.operator.scaling(i);
        for (j, value) in column.iter_mut().enumerate() {
            *value *= scale * self.operator.scaling(j);
        }
        column
    }
}

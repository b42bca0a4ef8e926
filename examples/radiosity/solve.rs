//! The radiosities that satisfy B = E + ρH(B), and what became of the light.

use std::convert::Infallible;

use farfield::Mask;
use farfield_radiosity::{
    Error, Irradiance, Solution, Stop, Visibility, conjugate_gradients, energy_balance, jacobi,
    southwell,
};
use rayon::prelude::*;

use crate::args::{Args, SolverName};
use crate::gather::Gather;
use crate::progress;
use crate::shading::Rgb;
use crate::surfels::Surfels;

/// The equation's residual in units of the tolerance: small enough not to add to the error.
const RESIDUAL: f64 = 1e-2;
/// Bounces that a solution may take.
const MAX_BOUNCES: usize = 1000;

/// Solves for the radiosities, with a bar for the digits gained.
///
/// # Errors
/// If the iteration doesn't converge or a sum fails.
pub(crate) fn solve(
    surfels: &Surfels,
    gather: &Gather,
    visibility: &Visibility<'_>,
    args: &Args,
) -> Result<Solution<f64, 3>, Error> {
    let tolerance = RESIDUAL * args.tolerance;
    let bar = progress::bar("solving", progress::FINE);
    let report = |_, residual: f64| progress::show(&bar, residual.ln() / tolerance.ln());
    let Surfels { surfels, reflectance, emission, .. } = surfels;
    let solution = match args.solver {
        SolverName::Cg => {
            let stop = Stop { tolerance, max_iterations: MAX_BOUNCES };
            let apply = |b: &[Rgb]| gather.apply(b);
            conjugate_gradients(surfels, emission, reflectance, stop, apply, report)
        }
        SolverName::Jacobi => {
            let stop = Stop { tolerance, max_iterations: MAX_BOUNCES };
            jacobi(emission, reflectance, stop, |b| gather.apply(b), report)
        }
        SolverName::Southwell => {
            let stop = Stop { tolerance, max_iterations: MAX_BOUNCES * surfels.len() };
            let column = |i: usize| Ok::<_, Infallible>(column(surfels, visibility, i));
            southwell(surfels, emission, reflectance, stop, column, report)
        }
    };
    bar.finish_and_clear();
    solution
}

/// The share of the emitted power that is neither absorbed nor escapes, in the worst band.
///
/// The power that escapes is Σ A B (1 − s), where s, the irradiance of a surfel when all have
/// radiosity 1, is the share of its light that other surfels receive.
///
/// # Errors
/// If a sum fails.
pub(crate) fn energy_residual(
    surfels: &Surfels,
    gather: &Gather,
    solution: &Solution<f64, 3>,
) -> Result<f64, Error> {
    let Surfels { surfels, reflectance, emission, .. } = surfels;
    let ones: Vec<Rgb> = vec![[1.0; 3]; surfels.len()];
    let row_sums: Vec<f64> = gather.apply(&ones)?.iter().map(|s| s[0]).collect();
    let balance = energy_balance(surfels, emission, reflectance, solution, &row_sums)?;
    Ok(balance.residual().into_iter().map(f64::abs).fold(0.0, f64::max))
}

/// The irradiance V K A_i of every surfel per unit radiosity of surfel i.
fn column(
    surfels: &[farfield_radiosity::Surfel],
    visibility: &Visibility<'_>,
    i: usize,
) -> Vec<f64> {
    let kernel = Irradiance::<f64>::clamped();
    let source = &surfels[i];
    let factor = |receiver| {
        let seen = Mask::<Irradiance<f64>>::pair(visibility, receiver, source);
        if seen { kernel.factor(receiver, source) * source.area } else { 0.0 }
    };
    surfels.par_iter().with_min_len(256).map(factor).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cornell::Scene;
    use crate::surfels::triangles;
    use clap::Parser;
    use farfield::relative_l2_error;
    use farfield_radiosity::Occluders;

    #[test]
    fn all_solvers_agree_and_keep_the_energy() {
        let scene = Scene::cornell_box();
        let walls = Occluders::new(&triangles(&scene)).expect("finite");
        let visibility = Visibility::new(&walls);
        let surfels = Surfels::new(&scene, 400);
        let solved = ["cg", "jacobi", "southwell"].map(|solver| {
            let mut args = Args::parse_from(["radiosity", "--scheme=direct", "--solver", solver]);
            args.tolerance = 1e-4;
            let gather =
                Gather::plan(&surfels.surfels, &visibility, &args, &|_| ()).expect("planned");
            let solution = solve(&surfels, &gather, &visibility, &args).expect("converges");
            let residual = energy_residual(&surfels, &gather, &solution).expect("finite");
            assert!(residual < 1e-4, "{solver}: {residual:e}");
            solution
        });
        let [cg, jacobi, southwell] = &solved;
        assert!(cg.iterations < jacobi.iterations);
        assert!(southwell.iterations > 10 * jacobi.iterations);
        let lit = jacobi.radiosity.iter().filter(|b| b[0] > 0.1).count();
        assert!(lit > surfels.surfels.len() * 9 / 10, "light reaches nearly every corner: {lit}");
        for other in [cg, southwell] {
            assert!(relative_l2_error(&other.radiosity, &jacobi.radiosity) < 1e-4);
        }
    }
}

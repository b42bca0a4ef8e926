//! The plan for gathering light: one sum over all pairs of surfels that see each other.

use farfield::{Builder, Expansion, Fmm, Progress, Scheme, Stats};
use farfield_radiosity::{Irradiance, SixteenMoment, Surfel, Visibility};

use crate::args::{Args, ExpansionName, SchemeName};
use crate::shading::Rgb;

/// Surfels per leaf: a pair that is summed directly costs little, as whether its surfels see each other
/// is remembered in a bit; the tensor's M2L weighs as much as thousands of pairs.
const LEAF_SIZE: usize = 128;

/// From the radiosity of all surfels to the irradiance of all surfels.
pub(crate) struct Gather {
    apply: Box<Apply>,
    stats: Stats,
}

/// [`Fmm::apply`] of a plan with any expansion.
type Apply = dyn Fn(&[Rgb]) -> Result<Vec<Rgb>, farfield::Error>;

impl Gather {
    /// Plans the sum as `args` ask for; tells `report` how far it has come.
    ///
    /// # Errors
    /// If the expansion can't meet the tolerance.
    pub(crate) fn plan(
        surfels: &[Surfel],
        visibility: &Visibility<'_>,
        args: &Args,
        report: &(dyn Fn(Progress) + Sync),
    ) -> Result<Self, farfield::Error> {
        let kernel = Irradiance::clamped();
        let scheme = match args.scheme {
            SchemeName::Fmm => Scheme::Fmm,
            SchemeName::Treecode => Scheme::Treecode { m2m: true },
            SchemeName::Direct => Scheme::Direct,
        };
        match args.expansion {
            ExpansionName::SixteenMoment => {
                let expansion = SixteenMoment::new(kernel, order(args.tolerance))?;
                let builder = Fmm::with_expansion(expansion);
                Self::build(builder.mask(visibility).scheme(scheme).progress(report), surfels)
            }
            ExpansionName::Interpolation => {
                let builder = Fmm::builder(kernel).tolerance(args.tolerance);
                Self::build(builder.mask(visibility).scheme(scheme).progress(report), surfels)
            }
        }
    }

    /// The irradiance H of each surfel for radiosities B.
    ///
    /// # Errors
    /// Those of [`Fmm::apply`].
    pub(crate) fn apply(&self, radiosity: &[Rgb]) -> Result<Vec<Rgb>, farfield::Error> {
        (self.apply)(radiosity)
    }

    /// What the plan consists of.
    pub(crate) fn stats(&self) -> &Stats {
        &self.stats
    }

    fn build<E>(
        builder: Builder<'_, E, &Visibility<'_>>,
        surfels: &[Surfel],
    ) -> Result<Self, farfield::Error>
    where
        E: Expansion<Kernel = Irradiance<f64, Rgb>> + 'static,
    {
        let fmm = builder.leaf_size(LEAF_SIZE).build(surfels, surfels)?;
        let stats = fmm.stats().clone();
        Ok(Self { apply: Box::new(move |radiosity| fmm.apply(radiosity)), stats })
    }
}

/// The order of the 16-moment expansion for a tolerance.
///
/// In this scene the error of the whole sum was 4.2e-2, 6.2e-3, 9.3e-4 at orders 2, 4, 6: it falls by
/// 0.38 per order. The start 0.6 leaves a factor of 2 to spare.
fn order(tolerance: f64) -> usize {
    const START: f64 = 0.6;
    const FALL: f64 = 0.38;
    ((START / tolerance).ln() / FALL.recip().ln()).ceil().max(1.0) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cornell::Scene;
    use crate::surfels::{Surfels, triangles};
    use clap::Parser;
    use farfield::{direct_masked, relative_l2_error};
    use farfield_radiosity::Occluders;

    #[test]
    fn all_expansions_and_schemes_sum_within_the_tolerance() {
        let scene = Scene::cornell_box();
        let walls = Occluders::new(&triangles(&scene)).expect("finite");
        let Surfels { surfels, reflectance, .. } = Surfels::new(&scene, 1_500);
        let visibility = Visibility::new(&walls);
        let kernel = Irradiance::<f64, Rgb>::clamped();
        let exact = direct_masked(&kernel, &visibility, &surfels, &reflectance, &surfels);
        for (expansion, scheme, tolerance) in [
            ("interpolation", "fmm", 1e-2),
            ("interpolation", "treecode", 1e-2),
            ("interpolation", "direct", 1e-12),
            ("sixteen-moment", "fmm", 1e-2),
            ("sixteen-moment", "fmm", 1e-3),
            ("sixteen-moment", "treecode", 1e-2),
        ] {
            let case = ["radiosity", "--expansion", expansion, "--scheme", scheme];
            let mut args = Args::parse_from(case);
            args.tolerance = tolerance;
            let gather = Gather::plan(&surfels, &visibility, &args, &|_| ()).expect("planned");
            let error = relative_l2_error(&gather.apply(&reflectance).expect("finite"), &exact);
            assert!(error < tolerance, "{case:?}: {error:e}");
            assert!(gather.stats().expansion_pairs > 0 || scheme != "fmm");
        }
    }
}

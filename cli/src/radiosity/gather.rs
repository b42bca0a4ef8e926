//! The plan for gathering light: one sum over all pairs of elements that see each other.

use farfield::{Builder, Expansion, Fmm, Progress, Scheme, Stats};
use farfield_radiosity::{Irradiance, SixteenMoment, Surfel, Visibility};

use super::args::{ExpansionName, SchemeName};

/// Surfels per leaf: a pair that is summed directly costs little, as whether its surfels see each other
/// is remembered in a bit; the tensor's M2L weighs as much as thousands of pairs.
const LEAF_SIZE: usize = 128;

/// From the radiosity of all surfels to the irradiance of all surfels.
pub(crate) struct Gather<const BANDS: usize> {
    apply: Box<Apply<BANDS>>,
    stats: Stats,
}

/// [`Fmm::apply`] of a plan with any expansion.
type Apply<const BANDS: usize> =
    dyn Fn(&[[f64; BANDS]]) -> Result<Vec<[f64; BANDS]>, farfield::Error> + Sync;

/// How to sum.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Method {
    /// The scheme.
    pub(crate) scheme: SchemeName,
    /// The expansion.
    pub(crate) expansion: ExpansionName,
    /// The relative l2 error to stay below.
    pub(crate) tolerance: f64,
}

impl<const BANDS: usize> Gather<BANDS> {
    /// Plans the sum; tells `report` how far it has come.
    ///
    /// # Errors
    /// If the expansion can't meet the tolerance.
    pub(crate) fn plan(
        surfels: &[Surfel],
        visibility: &Visibility<'_>,
        method: Method,
        report: &(dyn Fn(Progress) + Sync),
    ) -> Result<Self, farfield::Error> {
        let kernel = Irradiance::<f64, [f64; BANDS]>::clamped();
        let scheme = match method.scheme {
            SchemeName::Fmm => Scheme::Fmm,
            SchemeName::Treecode => Scheme::Treecode { m2m: true },
            SchemeName::Direct => Scheme::Direct,
        };
        match method.expansion {
            ExpansionName::SixteenMoment => {
                let expansion = SixteenMoment::with_tolerance(kernel, method.tolerance)?;
                let builder = Fmm::with_expansion(expansion);
                Self::build(builder.mask(visibility).scheme(scheme).progress(report), surfels)
            }
            ExpansionName::Interpolation => {
                let builder = Fmm::builder(kernel).tolerance(method.tolerance);
                Self::build(builder.mask(visibility).scheme(scheme).progress(report), surfels)
            }
        }
    }

    /// The irradiance H of each surfel for radiosities B.
    ///
    /// # Errors
    /// Those of [`Fmm::apply`].
    pub(crate) fn apply(
        &self,
        radiosity: &[[f64; BANDS]],
    ) -> Result<Vec<[f64; BANDS]>, farfield::Error> {
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
        E: Expansion<Kernel = Irradiance<f64, [f64; BANDS]>> + 'static,
    {
        let fmm = builder.leaf_size(LEAF_SIZE).build(surfels, surfels)?;
        let stats = fmm.report().stats;
        Ok(Self { apply: Box::new(move |radiosity| fmm.apply(radiosity)), stats })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use farfield::{direct_masked, relative_l2_error};
    use farfield_radiosity::Occluders;
    use farfield_scenes::Mesh;
    use farfield_scenes::generate;

    #[test]
    fn all_expansions_and_schemes_sum_within_the_tolerance() {
        let scene = generate("cornell").expect("a scene");
        let mesh = Mesh::new(&scene, 1_500).expect("a mesh");
        let walls = Occluders::new(&mesh.triangles).expect("finite");
        let surfels: Vec<Surfel> = mesh.elements.iter().map(|e| *e.surfel()).collect();
        let radiosity: Vec<[f64; 3]> =
            (0..surfels.len()).map(|i| [1.0, (i % 7) as f64, (i % 3) as f64]).collect();
        let visibility = Visibility::new(&walls);
        let kernel = Irradiance::<f64, [f64; 3]>::clamped();
        let exact = direct_masked(&kernel, &visibility, &surfels, &radiosity, &surfels)
            .expect("one charge per source");
        for (expansion, scheme, tolerance) in [
            (ExpansionName::Interpolation, SchemeName::Fmm, 1e-2),
            (ExpansionName::Interpolation, SchemeName::Treecode, 1e-2),
            (ExpansionName::Interpolation, SchemeName::Direct, 1e-12),
            (ExpansionName::SixteenMoment, SchemeName::Fmm, 1e-2),
            (ExpansionName::SixteenMoment, SchemeName::Fmm, 1e-3),
            (ExpansionName::SixteenMoment, SchemeName::Treecode, 1e-2),
        ] {
            let method = Method { scheme, expansion, tolerance };
            let gather =
                Gather::<3>::plan(&surfels, &visibility, method, &|_| ()).expect("planned");
            let found = gather.apply(&radiosity).expect("applied");
            let error = relative_l2_error(&found, &exact);
            assert!(error <= tolerance, "{expansion:?} {scheme:?}: {error:e}");
            let expanded = gather.stats().expansion_pairs > 0;
            assert!(
                expanded || (expansion, scheme) != (ExpansionName::Interpolation, SchemeName::Fmm)
            );
        }
    }
}

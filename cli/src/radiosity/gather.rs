//! The plan for gathering light: one sum over all pairs of elements that see each other.

use farfield::{Builder, CellView, Coverage, Expansion, Fmm, Mask, Progress, Scheme, Stats};
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

/// A mask that can be told to end: from then on no pair counts, and no ray is cast. What is planned by it
/// is of no use then, but planned at once.
#[derive(Clone, Copy)]
pub(crate) struct Ending<'a> {
    /// Which elements see each other.
    pub(crate) visibility: &'a Visibility<'a>,
    /// Whether it is to end.
    pub(crate) ends: &'a (dyn Fn() -> bool + Sync),
}

/// The sum that is planned.
type Sum<const BANDS: usize> = Irradiance<f64, [f64; BANDS]>;

impl<const BANDS: usize> Mask<Sum<BANDS>> for Ending<'_> {
    fn cells(&self, targets: CellView<'_, Surfel>, sources: CellView<'_, Surfel>) -> Coverage {
        if (self.ends)() {
            return Coverage::Empty;
        }
        Mask::<Sum<BANDS>>::cells(self.visibility, targets, sources)
    }

    fn pair(&self, x: &Surfel, y: &Surfel) -> f64 {
        if (self.ends)() { 0.0 } else { Mask::<Sum<BANDS>>::pair(self.visibility, x, y) }
    }

    fn pairs(
        &self,
        targets: CellView<'_, Surfel>,
        sources: CellView<'_, Surfel>,
        count: &mut dyn FnMut(usize, usize, f64),
    ) {
        if !(self.ends)() {
            Mask::<Sum<BANDS>>::pairs(self.visibility, targets, sources, count);
        }
    }

    fn is_mirrored(&self, targets: &[Surfel], sources: &[Surfel]) -> bool {
        Mask::<Sum<BANDS>>::is_mirrored(self.visibility, targets, sources)
    }
}

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
        mask: Ending<'_>,
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
                Self::build(builder.mask(mask).scheme(scheme).progress(report), surfels)
            }
            ExpansionName::Interpolation => {
                let builder = Fmm::builder(kernel).tolerance(method.tolerance);
                Self::build(builder.mask(mask).scheme(scheme).progress(report), surfels)
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
        builder: Builder<'_, E, Ending<'_>>,
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
            let mask = Ending { visibility: &visibility, ends: &|| false };
            let gather = Gather::<3>::plan(&surfels, mask, method, &|_| ()).expect("planned");
            let found = gather.apply(&radiosity).expect("applied");
            let error = relative_l2_error(&found, &exact);
            assert!(error <= tolerance, "{expansion:?} {scheme:?}: {error:e}");
            let expanded = gather.stats().expansion_pairs > 0;
            assert!(
                expanded || (expansion, scheme) != (ExpansionName::Interpolation, SchemeName::Fmm)
            );
        }
    }

    #[test]
    fn a_plan_that_ends_asks_for_nothing_more() {
        let scene = generate("cornell").expect("a scene");
        let mesh = Mesh::new(&scene, 1_500).expect("a mesh");
        let walls = Occluders::new(&mesh.triangles).expect("finite");
        let surfels: Vec<Surfel> = mesh.elements.iter().map(|e| *e.surfel()).collect();
        for scheme in [SchemeName::Fmm, SchemeName::Direct] {
            let visibility = Visibility::new(&walls);
            let mask = Ending { visibility: &visibility, ends: &|| true };
            let method =
                Method { scheme, expansion: ExpansionName::Interpolation, tolerance: 1e-2 };
            let gather = Gather::<1>::plan(&surfels, mask, method, &|_| ()).expect("planned");
            assert_eq!((visibility.counts().rays, gather.stats().direct_pairs), (0, 0));
        }
    }
}

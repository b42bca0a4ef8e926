//! What a run reports.

use std::collections::BTreeMap;
use std::fmt;

use farfield::Stats;
use farfield_radiosity::{PairCounts, Zones};
use serde::Serialize;

use super::args::{ExpansionName, QuantityName, SchemeName, SolverName, VisibilityName};
use super::balance::RowSums;
use super::daylight::Origin;
use super::negative::Negative;
use super::warning::Warning;

/// The figures of one run: the contents of report.json.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Report {
    /// The scene's name or file.
    pub(crate) scene: String,
    /// How the pairs were summed.
    pub(crate) scheme: SchemeName,
    /// How the far field was expanded.
    pub(crate) expansion: ExpansionName,
    /// How the equation was solved.
    pub(crate) solver: SolverName,
    /// What was exchanged.
    pub(crate) quantity: QuantityName,
    /// Number of bands.
    pub(crate) bands: usize,
    /// How it was found out which elements see each other.
    pub(crate) visibility: VisibilityName,
    /// Whether surfaces cast shadows.
    pub(crate) occlusion: bool,
    /// Threads used.
    pub(crate) threads: usize,
    /// The error allowed.
    pub(crate) tolerance: f64,
    /// Number of elements.
    pub(crate) elements: usize,
    /// Number of surfels: one per element.
    pub(crate) surfels: usize,
    /// The estimated relative l2 error of one constant radiosity per element; none where it isn't known.
    pub(crate) element_error: Option<f64>,
    /// Whether the tolerance was to hold for that too; if it doesn't, the elements did not suffice.
    pub(crate) adaptive: bool,
    /// What became of the pairs.
    pub(crate) pairs: Pairs,
    /// Segments tested against the occluders to find out which elements see each other.
    pub(crate) rays: u64,
    /// Near pairs by how their form factor was found.
    pub(crate) near_pairs: NearPairs,
    /// The standard error that sampled visibility brings to irradiances, estimated.
    pub(crate) visibility_uncertainty: f64,
    /// Sums of form factors before closure.
    pub(crate) row_sum: RowSums,
    /// How far the rows of form factors are off before closure, in the root mean square over the area, by
    /// rays that know nothing of form factors. It needs no light.
    pub(crate) form_factor_error: f64,
    /// The share of the light of all surfaces, were they equally bright, that ends at backs, by rays.
    pub(crate) to_backs: f64,
    /// And that leaves the scene.
    pub(crate) to_sky: f64,
    /// The power that arrives from the sky, the ground around and the sun [W], in each band; none without these.
    pub(crate) daylight: Option<f64>,
    /// What that is of; none likewise.
    pub(crate) outdoors: Option<Origin>,
    /// Irradiances that came out below zero.
    pub(crate) negative: Negative,
    /// How far the exchange is from A_i F_ij = A_j F_ji.
    pub(crate) reciprocity_error: f64,
    /// The largest relative change that closure made to a form factor.
    pub(crate) closure_correction: f64,
    /// Its root mean square.
    pub(crate) closure_rms: f64,
    /// Seconds to build the plan, visibility included.
    pub(crate) plan_s: f64,
    /// Seconds to solve for the radiosities.
    pub(crate) solve_s: f64,
    /// Seconds that visibility and solution by direct summation would take, extrapolated from the sample.
    pub(crate) direct_s: f64,
    /// Sums over all pairs, or shots (Southwell).
    pub(crate) iterations: usize,
    /// The largest residual of the equation, in units of the emission; none where nothing is solved.
    pub(crate) residual: Option<f64>,
    /// The residual, or an estimate of it, after so many sums or shots, for each group of bands that were solved
    /// for at once.
    pub(crate) residuals: Vec<Vec<(usize, f64)>>,
    /// Whether Ctrl-C ended the run early: the solution, the refinement or the table of form factors.
    pub(crate) interrupted: bool,
    /// The share of the emitted power that is neither absorbed nor escapes; none where nothing is emitted.
    pub(crate) energy_residual: Option<f64>,
    /// Relative l2 error of the irradiance against direct summation at the sampled elements; none where
    /// nothing emits, or no light arrives.
    pub(crate) relative_l2_error: Option<f64>,
    /// Where nothing emits, the same of what arrives when all elements emit alike: of the sums of their form
    /// factors.
    pub(crate) factor_l2_error: Option<f64>,
    /// Number of elements sampled for it.
    pub(crate) sampled_surfels: usize,
    /// The largest amount of memory that was in use; none where the system doesn't tell.
    pub(crate) peak_memory_bytes: Option<u64>,
    /// Seconds by phase.
    pub(crate) phases: BTreeMap<&'static str, f64>,
    /// What may be wrong.
    pub(crate) warnings: Vec<Warning>,
    /// What was mended in the scene.
    pub(crate) repairs: Vec<String>,
    /// The files written.
    #[serde(skip)]
    pub(crate) files: Vec<&'static str>,
}

/// Fractions of all ordered pairs of elements; they sum to 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Pairs {
    /// Carried by an expansion.
    pub(crate) expansion: f64,
    /// Summed directly.
    pub(crate) direct: f64,
    /// At least one of the two looks away.
    pub(crate) facing_away: f64,
    /// They face each other, but something stands between.
    pub(crate) hidden: f64,
}

/// Numbers of near pairs of elements by how their form factor was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct NearPairs {
    /// By contour integrals.
    pub(crate) exact: u64,
    /// By three points per edge.
    pub(crate) three: u64,
    /// By two points per edge.
    pub(crate) two: u64,
    /// With a disk.
    pub(crate) disk: u64,
}

impl From<Zones> for NearPairs {
    fn from(Zones { exact, three, two, disk }: Zones) -> Self {
        Self { exact, three, two, disk }
    }
}

impl Pairs {
    /// The fractions by a plan and by the mask that it was built with.
    pub(crate) fn new(stats: &Stats, counts: &PairCounts) -> Self {
        let all = stats.targets as f64 * stats.sources as f64;
        let fraction = |pairs: u64| pairs as f64 / all;
        Self {
            expansion: fraction(stats.expansion_pairs),
            direct: fraction(stats.direct_pairs),
            facing_away: fraction(counts.facing_away),
            hidden: fraction(counts.hidden),
        }
    }
}

impl Report {
    /// The figures that a reader wants to know, by name.
    pub(crate) fn lines(&self) -> Vec<(&'static str, String)> {
        let Pairs { expansion, direct, facing_away, hidden } = self.pairs;
        let percent = |share: f64| format!("{:.1} %", 100.0 * share);
        let per_element = self.rays as f64 / self.elements.max(1) as f64;
        let RowSums { min, max, rms_error } = self.row_sum;
        let tolerance = self.tolerance;
        let known = |number: Option<f64>| match number {
            Some(number) => format!("{number:.1e}"),
            None => "unknown".to_owned(),
        };
        let what = match self.element_error {
            Some(error) if self.adaptive && error > tolerance => "too few: constants are off by",
            Some(_) => "on which constants are off by",
            None => "the error of constants is",
        };
        let elements = format!("{}, {what} {}", self.elements, known(self.element_error));
        let mut lines = Vec::new();
        let mut line = |name: &'static str, value: String| lines.push((name, value));
        line("elements", elements);
        line("pairs by expansion", percent(expansion));
        line("pairs summed directly", percent(direct));
        line("pairs facing away", percent(facing_away));
        line("pairs hidden", percent(hidden));
        line("rays per element", format!("{per_element:.0}"));
        if self.visibility == VisibilityName::Fractional {
            line("visibility known to", format!("{:.1e}", self.visibility_uncertainty));
        }
        line("row sums", format!("{min:.4} to {max:.4}, off by {rms_error:.1e}"));
        line("form factors off by", format!("{:.1e}, by rays", self.form_factor_error));
        line("light to the sky", percent(self.to_sky));
        line("light to backs", percent(self.to_backs));
        if let Some(power) = self.daylight {
            line("daylight", format!("{power:.4e} W"));
        }
        let Negative { count, largest } = self.negative;
        if count > 0 {
            let what =
                format!("{count} irradiances, by {largest:.1e} of the mean at most: set to 0");
            line("below zero", what);
        }
        line("closed by", format!("{:.1e} at most", self.closure_correction));
        line("reciprocal to", format!("{:.1e}", self.reciprocity_error));
        line("plan", format!("{:.2} s", self.plan_s));
        line("solve", format!("{:.2} s, iterations: {}", self.solve_s, self.iterations));
        if self.interrupted {
            line("interrupted", format!("at a residual of {}", known(self.residual)));
        }
        line(
            "direct summation",
            format!("{:.2} s (extrapolated from {} elements)", self.direct_s, self.sampled_surfels),
        );
        line("energy residual", known(self.energy_residual));
        if let Some(bytes) = self.peak_memory_bytes {
            line("peak memory", format!("{:.2} GiB", bytes as f64 / (1u64 << 30) as f64));
        }
        for repair in &self.repairs {
            line("mended", repair.clone());
        }
        let sampled = self.sampled_surfels;
        let allowed = format!("(tolerance {tolerance:.0e}, at {sampled} elements)");
        let (what, error) = match self.factor_l2_error {
            Some(error) => ("form factors off by", Some(error)),
            None => ("relative l2 error", self.relative_l2_error),
        };
        line(what, format!("{} {allowed}", known(error)));
        lines
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lines = self.lines();
        for (index, (name, value)) in lines.iter().enumerate() {
            let end = if index + 1 < lines.len() { "\n" } else { "" };
            write!(f, "{name:<22}{value}{end}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radiosity::gather::{Ending, Gather, Method};
    use farfield_radiosity::{Occluders, Surfel, Visibility};
    use farfield_scenes::Mesh;
    use farfield_scenes::generate;

    #[test]
    fn the_fractions_of_every_scheme_sum_to_one() {
        let scene = generate("cornell").expect("a scene");
        let mesh = Mesh::new(&scene, 2_000).expect("a mesh");
        let walls = Occluders::new(&mesh.triangles).expect("finite");
        let surfels: Vec<Surfel> = mesh.elements.iter().map(|e| *e.surfel()).collect();
        for scheme in [SchemeName::Fmm, SchemeName::Treecode, SchemeName::Direct] {
            let visibility = Visibility::new(&walls);
            let expansion = ExpansionName::Interpolation;
            let method = Method { scheme, expansion, tolerance: 1e-2 };
            let mask = Ending { visibility: &visibility, ends: &|| false };
            let gather = Gather::<1>::plan(&surfels, mask, method, &|_| ()).expect("planned");
            let pairs = Pairs::new(gather.stats(), &visibility.counts());
            let Pairs { expansion, direct, facing_away, hidden } = pairs;
            let sum = expansion + direct + facing_away + hidden;
            assert!((sum - 1.0).abs() < 1e-12, "{scheme:?}: {pairs:?}");
            assert!(expansion > 0.0 || scheme != SchemeName::Fmm);
            assert!(direct > 0.0 && facing_away > 0.2 && hidden > 0.02, "{scheme:?}: {pairs:?}");
        }
    }
}

//! What a run reports.

use std::fmt;
use std::fs;

use farfield::Stats;
use farfield_radiosity::PairCounts;
use serde::Serialize;

use crate::args::{ExpansionName, SchemeName, SolverName};

/// The figures of one run: the contents of report.json.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Report {
    /// How the pairs were summed.
    pub(crate) scheme: SchemeName,
    /// How the far field was expanded.
    pub(crate) expansion: ExpansionName,
    /// How the equation was solved.
    pub(crate) solver: SolverName,
    /// Whether walls and blocks cast shadows.
    pub(crate) occlusion: bool,
    /// Threads used.
    pub(crate) threads: usize,
    /// The error allowed.
    pub(crate) tolerance: f64,
    /// Number of surfels.
    pub(crate) surfels: usize,
    /// What became of the pairs.
    pub(crate) pairs: Pairs,
    /// Seconds to build the plan, visibility included.
    pub(crate) plan_s: f64,
    /// Seconds to solve for the radiosities.
    pub(crate) solve_s: f64,
    /// Seconds that visibility and solution by direct summation would take, extrapolated from the sample.
    pub(crate) direct_s: f64,
    /// Bounces (Jacobi) or shots (Southwell).
    pub(crate) iterations: usize,
    /// The share of the emitted power that is neither absorbed nor escapes.
    pub(crate) energy_residual: f64,
    /// Relative l2 error of the gathered light against direct summation at the sampled surfels.
    pub(crate) relative_l2_error: f64,
    /// Number of surfels sampled for it.
    pub(crate) sampled_surfels: usize,
    /// The largest amount of memory that was in use; none where the system doesn't tell.
    pub(crate) peak_memory_bytes: Option<u64>,
}

/// Fractions of all ordered pairs of surfels; they sum to 1.
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

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Pairs { expansion, direct, facing_away, hidden } = self.pairs;
        writeln!(f, "surfels               {}", self.surfels)?;
        writeln!(f, "pairs by expansion    {:.1} %", 100.0 * expansion)?;
        writeln!(f, "pairs summed directly {:.1} %", 100.0 * direct)?;
        writeln!(f, "pairs facing away     {:.1} %", 100.0 * facing_away)?;
        writeln!(f, "pairs hidden          {:.1} %", 100.0 * hidden)?;
        writeln!(f, "plan                  {:.2} s", self.plan_s)?;
        writeln!(f, "solve                 {:.2} s", self.solve_s)?;
        writeln!(
            f,
            "direct summation      {:.2} s (extrapolated from {} surfels)",
            self.direct_s, self.sampled_surfels
        )?;
        writeln!(f, "iterations            {}", self.iterations)?;
        writeln!(f, "energy residual       {:.1e}", self.energy_residual)?;
        write!(
            f,
            "relative l2 error     {:.1e} (tolerance {:.0e}, at {} surfels)",
            self.relative_l2_error, self.tolerance, self.sampled_surfels
        )
    }
}

/// The largest amount of memory this process has had in use, in bytes; known on Linux only.
pub(crate) fn peak_memory_bytes() -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(1024 * kibibytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::Args;
    use crate::cornell::Scene;
    use crate::gather::Gather;
    use crate::surfels::{Surfels, triangles};
    use clap::Parser;
    use farfield_radiosity::{Occluders, Visibility};

    #[test]
    fn the_fractions_of_every_scheme_sum_to_one() {
        let scene = Scene::cornell_box();
        let walls = Occluders::new(&triangles(&scene)).expect("finite");
        let Surfels { surfels, .. } = Surfels::new(&scene, 2_000);
        for scheme in ["fmm", "treecode", "direct"] {
            let args = Args::parse_from(["radiosity", "--scheme", scheme]);
            let visibility = Visibility::new(&walls);
            let gather = Gather::plan(&surfels, &visibility, &args, &|_| ()).expect("planned");
            let pairs = Pairs::new(gather.stats(), &visibility.counts());
            let Pairs { expansion, direct, facing_away, hidden } = pairs;
            let sum = expansion + direct + facing_away + hidden;
            assert!((sum - 1.0).abs() < 1e-12, "{scheme}: {pairs:?}");
            assert!(expansion > 0.0 || scheme != "fmm");
            assert!(direct > 0.0 && facing_away > 0.2 && hidden > 0.02, "{scheme}: {pairs:?}");
        }
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn this_process_uses_some_memory() {
        assert!(peak_memory_bytes().expect("VmHWM") > 1 << 20);
    }
}

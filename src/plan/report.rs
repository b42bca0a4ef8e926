//! A plan and its times at one glance.

use std::fmt;

use crate::expansion::Expansion;
use crate::plan::Plan;
use crate::plan::estimate::Estimate;
use crate::plan::fmm::Fmm;
use crate::plan::guard::Guard;
use crate::plan::stats::Stats;
use crate::plan::times::{ApplyTimes, BuildTimes};

/// What a plan consists of and how long it takes. [`Display`](fmt::Display) writes a table; with the
/// feature `serde` it can be serialised.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct Report {
    /// Sizes of tree, lists and memory.
    pub stats: Stats,
    /// Seconds that building took.
    pub build: BuildTimes,
    /// What plan and application were expected to cost, if that was needed to choose a
    /// scheme or to keep a memory budget.
    pub estimate: Option<Estimate>,
    /// Seconds that an application took, if one was [measured](Fmm::apply_timed).
    pub apply: Option<ApplyTimes>,
    /// How many applications were for charges so distributed that another set of operators, or direct sums,
    /// served them.
    pub unusual_applications: usize,
    /// What is on each level of the trees, the root first.
    pub levels: Vec<LevelReport>,
}

/// What is on one level of the trees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct LevelReport {
    /// Number of source cells.
    pub source_cells: usize,
    /// Number of target cells.
    pub target_cells: usize,
    /// Terms of a cell's multipole expansion; 0 if there are none on this level.
    pub multipole_terms: usize,
    /// Terms of a cell's local expansion; 0 if there are none on this level.
    pub local_terms: usize,
    /// Pairs of cells that meet through M2L, or in a treecode through M2P.
    pub m2l_pairs: usize,
}

impl Report {
    /// The same report with the times of an application.
    pub fn with_apply(self, times: ApplyTimes) -> Self {
        Self { apply: Some(times), ..self }
    }
}

impl<E: Expansion> Fmm<E> {
    /// A report on the plan. O(cells).
    ///
    /// ```
    /// use farfield::{Fmm, from_fn};
    /// use glam::DVec3;
    ///
    /// let points: Vec<DVec3> = (0..3000).map(|i| DVec3::splat(f64::from(i)).map(f64::sin)).collect();
    /// let kernel = from_fn(|x: DVec3, y: DVec3| 1.0 / x.distance(y)).skip_coincident();
    /// let fmm = Fmm::builder(kernel).tolerance(1e-3).build(&points, &points)?;
    /// let (_, times) = fmm.apply_timed(&vec![1.0; 3000])?;
    ///
    /// let report = fmm.report().with_apply(times);
    /// assert_eq!(report.levels[0].source_cells, 1);
    /// println!("{report}");
    /// # Ok::<(), farfield::Error>(())
    /// ```
    pub fn report(&self) -> Report {
        let Plan { expansion, source_tree, target_tree, lists, layout, .. } = &self.usual.plan;
        let (sources, targets) = (&source_tree.shape, &target_tree.shape);
        let in_use = |terms: &[usize], level: usize| terms.get(level).is_some_and(|&n| n > 0);
        let level = |level: usize| {
            let cells = targets.level(level);
            let m2l = lists.weighed_m2l();
            LevelReport {
                source_cells: sources.level(level).len(),
                target_cells: cells.len(),
                multipole_terms: if in_use(&layout.multipole_terms, level) {
                    expansion.multipole_len(level)
                } else {
                    0
                },
                local_terms: if in_use(&layout.local_terms, level) {
                    expansion.local_len(level)
                } else {
                    0
                },
                m2l_pairs: m2l.map(|(_, l)| l.starts[cells.end] - l.starts[cells.start]).sum(),
            }
        };
        let levels = (0..sources.levels().max(targets.levels())).map(level).collect();
        Report {
            stats: self.stats.clone(),
            build: self.build_times,
            estimate: self.estimate,
            apply: None,
            unusual_applications: self.guard.as_ref().map_or(0, Guard::applications),
            levels,
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { stats, build, estimate, apply, unusual_applications, levels } = self;
        writeln!(
            f,
            "{}: {} sources, {} targets; {} cells, at most {} points in a leaf",
            stats.scheme, stats.sources, stats.targets, stats.cells, stats.leaf_size
        )?;
        if let Some(fallback) = &stats.fallback {
            writeln!(f, "summed directly: {fallback}")?;
        }
        if *unusual_applications > 0 {
            writeln!(f, "charges of unlike size: {unusual_applications} applications")?;
        }
        writeln!(
            f,
            "{:>6} {:>12} {:>12} {:>10} {:>6} {:>12}",
            "level", "source cells", "target cells", "multipole", "local", "M2L pairs"
        )?;
        for (number, level) in levels.iter().enumerate() {
            let LevelReport { source_cells, target_cells, .. } = level;
            let LevelReport { multipole_terms, local_terms, m2l_pairs, .. } = level;
            writeln!(
                f,
                "{number:>6} {source_cells:>12} {target_cells:>12} {multipole_terms:>10} \
                 {local_terms:>6} {m2l_pairs:>12}"
            )?;
        }
        let [m2l, m2p, p2l] = stats.cell_pairs;
        let pairs = stats.direct_pairs as f64 + stats.expansion_pairs as f64;
        let share = if pairs > 0.0 { 100.0 * stats.direct_pairs as f64 / pairs } else { 0.0 };
        writeln!(f, "lists  M2L {m2l}  M2P {m2p}  P2L {p2l}")?;
        writeln!(f, "pairs  direct {}, {share:.3} % of all", stats.direct_pairs)?;
        let megabytes = |bytes: usize| bytes as f64 / 1e6;
        writeln!(
            f,
            "MB     tree {:.1}  lists {:.1}  mask {:.1}  workspace {:.1}  ({:.0} B per point)",
            megabytes(stats.tree_bytes),
            megabytes(stats.list_bytes),
            megabytes(stats.mask_bytes),
            megabytes(stats.workspace_bytes),
            stats.bytes_per_point()
        )?;
        let BuildTimes { tree, lists, operators } = build;
        write!(f, "s      plan: tree {tree:.3}  lists {lists:.3}  operators {operators:.3}")?;
        if let Some(estimate) = estimate {
            let Estimate { plan_seconds, near_seconds, far_seconds, .. } = estimate;
            write!(
                f,
                "\ns      expected: plan {plan_seconds:.3} without operators, apply {:.3}: near {near_seconds:.3}, \
                 expansions {far_seconds:.3}",
                estimate.apply_seconds()
            )?;
        }
        if let Some(times) = apply {
            let ApplyTimes { permutation, p2m, m2m, m2l, l2l, l2p, m2p, near } = times;
            write!(
                f,
                "\ns      apply {:.3}: order {permutation:.3}  P2M {p2m:.3}  M2M {m2m:.3}  \
                 M2L {m2l:.3}  L2L {l2l:.3}  L2P {l2p:.3}  M2P {m2p:.3}  near {near:.3}",
                times.total()
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::from_fn;
    use glam::DVec3;

    fn report() -> Report {
        let step = DVec3::new(0.754_877_666, 0.569_840_291, 0.411_557_94);
        let points: Vec<DVec3> = (0..3000).map(|i| (step * f64::from(i)).fract()).collect();
        let kernel = from_fn(|x: DVec3, y: DVec3| 1.0 / x.distance(y)).skip_coincident();
        let builder = Fmm::builder(kernel).tolerance(1e-3).leaf_size(10);
        let fmm = builder.build(&points, &points[..1500]).unwrap();
        let (_, times) = fmm.apply_timed(&vec![1.0; 3000]).unwrap();
        fmm.report().with_apply(times)
    }

    #[test]
    fn levels_add_up_to_the_stats() {
        let Report { stats, levels, .. } = report();
        let cells = |level: &LevelReport| level.source_cells + level.target_cells;
        assert_eq!(levels.iter().map(cells).sum::<usize>(), stats.cells);
        assert_eq!(levels.len(), stats.depth + 1);
        let m2l: usize = levels.iter().map(|level| level.m2l_pairs).sum();
        assert_eq!(m2l as u64, stats.cell_pairs[0]);
        assert_eq!(levels[stats.depth].multipole_terms, stats.terms_per_cell);
        assert!(levels[0].multipole_terms == 0 && levels[1].local_terms == 0);
        assert!(levels[2].m2l_pairs > 0 && levels[2].local_terms > 0);
    }

    #[test]
    fn the_table_has_a_line_for_each_level() {
        let report = report();
        let text = report.to_string();
        assert_eq!(text.lines().count(), 2 + report.levels.len() + 5, "{text}");
        assert!(text.starts_with("fmm: 3000 sources, 1500 targets; "));
        let width = text.lines().map(str::len).max();
        assert!(width.is_some_and(|width| width <= 140), "{text}");
        let unmeasured = Report { apply: None, ..report };
        assert!(!unmeasured.to_string().contains("apply"));
    }

    #[cfg(feature = "serde")]
    #[test]
    fn reports_are_serialised() {
        let report = report();
        let json = serde_json::to_value(&report).unwrap();
        assert_eq!(json["stats"]["sources"], 3000);
        assert_eq!(json["levels"][2]["m2l_pairs"], report.levels[2].m2l_pairs);
        assert_eq!(json["apply"]["near"], report.apply.unwrap().near);
    }
}

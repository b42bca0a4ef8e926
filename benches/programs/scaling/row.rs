//! One line of the table, and the file with all of them.

use std::fmt::Write as _;

use farfield::{ApplyTimes, BuildTimes};
use farfield_benches::cli::{Precision, name};
use farfield_benches::clouds::Cloud;

use crate::args::KernelName;

/// What is measured: one set of points, one kernel, one accuracy, one number of threads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Setting {
    /// Number of sources, which are the targets too.
    pub(crate) n: usize,
    /// How they are distributed.
    pub(crate) cloud: Cloud,
    /// What is summed.
    pub(crate) kernel: KernelName,
    /// In which precision.
    pub(crate) precision: Precision,
    /// The relative l2 error asked for.
    pub(crate) tolerance: f64,
    /// Threads computed with.
    pub(crate) threads: usize,
}

/// What came out.
#[derive(Clone, Debug)]
pub(crate) enum Outcome {
    /// The error keeps the tolerance: times count.
    Passed(Box<Row>),
    /// The error, which does not.
    Failed(f64),
    /// The engine says that it can't reach the tolerance.
    Refused(String),
}

/// A row that keeps its tolerance. Times in seconds, rates per second.
#[derive(Clone, Debug)]
pub(crate) struct Row {
    /// Relative l2 error at the sampled targets.
    pub(crate) error: f64,
    /// The first plan, whose operators are not remembered from another.
    pub(crate) plan: f64,
    /// Its parts.
    pub(crate) build: BuildTimes,
    /// A second plan of the same kind.
    pub(crate) replan: f64,
    /// Whether the first plan built its operators: they took it more than twice as long as the second.
    pub(crate) built: bool,
    /// Median of all applications.
    pub(crate) apply: f64,
    /// The parts of one application of median length.
    pub(crate) parts: ApplyTimes,
    /// Nodes per axis.
    pub(crate) nodes: usize,
    /// Terms of a cell at the deepest level.
    pub(crate) rank: usize,
    /// Mean rank of the M2L matrices there.
    pub(crate) m2l_rank: f64,
    /// Most points in a leaf.
    pub(crate) leaf_size: usize,
    /// Bytes of the plan and one workspace, operators apart, per point.
    pub(crate) bytes_per_point: f64,
    /// Pairs summed directly per second and thread, as a fraction of the bare loop's.
    pub(crate) near_fraction: f64,
    /// Operations of M2L per second and thread, as a fraction of a large matrix product's.
    pub(crate) m2l_fraction: f64,
}

/// Explains the columns that [`line`] fills.
pub(crate) const LEGEND: &str = "\
error    relative l2, against direct sums in f64 at 1,000 targets
plan     seconds of a first plan (tree + lists + operators; `built`: no operators were remembered)
replan   seconds of the same plan again, with remembered operators
apply    seconds from charges to values, median; then the parts of a timed run: order, P2M, M2M, M2L,
         L2L (with P2L), L2P, M2P, near (pairs)
n r k s  nodes per axis, terms per cell, mean rank of M2L (deepest level), most points in a leaf
B/pt     bytes per point of plan and workspace, without the operators
ns/pt    apply per point
near     pairs per second and thread in the near field / in the bare loop
M2L      flops per second and thread in M2L / in a large product, in the row's precision. Flops are
         those of full interaction lists at the deepest level, in proportion to the pairs of cells; part
         of it is done in f32, so that it may exceed 100 %";

/// The heading above [`line`]s.
pub(crate) fn heading() -> String {
    format!(
        "{:<8}{:>7}{:>4}{:>9} {:>9}{:>9} ({:<25}){:>9}{:>9} ({:<55}){:>4}{:>5}{:>6}{:>5}{:>7}{:>7}{:>6}{:>6}",
        "cloud",
        "eps",
        "thr",
        "N",
        "error",
        "plan",
        "tree  lists    ops",
        "replan",
        "apply",
        "order    P2M    M2M    M2L    L2L    L2P    M2P   near",
        "n",
        "r",
        "k",
        "s",
        "B/pt",
        "ns/pt",
        "near",
        "M2L"
    )
}

/// One line of the table.
pub(crate) fn line(setting: &Setting, outcome: &Outcome) -> String {
    let Setting { n, cloud, tolerance, threads, .. } = setting;
    let mut text = format!("{:<8}{tolerance:>7.0e}{threads:>4}{n:>9} ", name(*cloud));
    // Writing to a string can't fail.
    let _ = match outcome {
        Outcome::Failed(error) => write!(text, "{error:>9.1e} FAILED: more than asked for"),
        Outcome::Refused(reason) => write!(text, "  refused: {reason}"),
        Outcome::Passed(row) => {
            let b = &row.build;
            let ops = format!("{:.4}{}", b.operators, if row.built { " built" } else { "" });
            let parts = parts(&row.parts).map(|(_, seconds)| format!("{seconds:.4}")).join(" ");
            write!(
                text,
                "{:>9.1e}{:>9.4} ({:.4} {:.4} {ops:<12}){:>9.4}{:>9.4} ({parts:<55}){:>4}{:>5}{:>6.1}{:>5}{:>7.0}{:>7.0}{:>5.0}%{:>5.0}%",
                row.error,
                row.plan,
                b.tree,
                b.lists,
                row.replan,
                row.apply,
                row.nodes,
                row.rank,
                row.m2l_rank,
                row.leaf_size,
                row.bytes_per_point,
                1e9 * row.apply / *n as f64,
                100.0 * row.near_fraction,
                100.0 * row.m2l_fraction
            )
        }
    };
    text
}

/// All rows as comma-separated values, with a header.
pub(crate) fn csv(rows: &[(Setting, Outcome)]) -> String {
    let names = parts(&ApplyTimes::default()).map(|(name, _)| name).join(",");
    let mut text = format!(
        "n,cloud,kernel,precision,tolerance,threads,outcome,error,plan,tree,lists,operators,built,\
         replan,apply,{names},nodes_per_axis,rank,m2l_rank,leaf_size,bytes_per_point,near_fraction,\
         m2l_fraction\n"
    );
    let commas = text.matches(',').count();
    for (setting, outcome) in rows {
        let Setting { n, cloud, kernel, precision, tolerance, threads } = *setting;
        let (cloud, kernel, precision) = (name(cloud), name(kernel), name(precision));
        let mut line = format!("{n},{cloud},{kernel},{precision},{tolerance:e},{threads},");
        let _ = match outcome {
            Outcome::Failed(error) => write!(line, "failed,{error:e}"),
            Outcome::Refused(_) => write!(line, "refused"),
            Outcome::Passed(row) => {
                let BuildTimes { tree, lists, operators, .. } = row.build;
                let parts = parts(&row.parts).map(|(_, seconds)| seconds.to_string()).join(",");
                write!(
                    line,
                    "passed,{:e},{},{tree},{lists},{operators},{},{},{},{parts},{},{},{},{},{},{},{}",
                    row.error,
                    row.plan,
                    row.built,
                    row.replan,
                    row.apply,
                    row.nodes,
                    row.rank,
                    row.m2l_rank,
                    row.leaf_size,
                    row.bytes_per_point,
                    row.near_fraction,
                    row.m2l_fraction
                )
            }
        };
        // Rows without times have empty fields in their place.
        let missing = commas.saturating_sub(line.matches(',').count());
        let _ = writeln!(text, "{line}{}", ",".repeat(missing));
    }
    text
}

fn parts(times: &ApplyTimes) -> [(&'static str, f64); 8] {
    let &ApplyTimes { permutation, p2m, m2m, m2l, l2l, l2p, m2p, near, .. } = times;
    [
        ("order", permutation),
        ("p2m", p2m),
        ("m2m", m2m),
        ("m2l", m2l),
        ("l2l", l2l),
        ("l2p", l2p),
        ("m2p", m2p),
        ("near", near),
    ]
}

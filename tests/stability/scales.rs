//! Clouds of many scales: what lies between them is a chain of cells, and costs no more than that.

use farfield::{Fmm, Report, WithGradient, direct, formula, relative_l2_error};
use farfield_potentials::{HarmonicExpansion, InverseDistance};
use farfield_testing::clouds::{self, Random, charges};
use glam::{DVec3, Vec3};

use crate::table::row;
use crate::{Formula, build, plain};

const INVERSE_DISTANCE: Formula = |x, y| 1.0 / x.distance(y);
const YUKAWA: Formula = |x, y| (-5.0 * x.distance(y)).exp() / x.distance(y);

/// Kernels of all scales and of one, with what is asked of them.
const KERNELS: [(Formula, f64); 2] = [(INVERSE_DISTANCE, 1e-6), (YUKAWA, 1e-3)];

/// A cloud of unit size with a point that many extents away.
fn with_escaper(n: usize, extents: f64) -> Vec<DVec3> {
    let mut points = clouds::cube(n - 1, 1);
    points.push(DVec3::new(0.9, -0.5, 0.7) * extents);
    points
}

/// Clusters of `n` points that are each smaller than the one before, and inside it.
fn nested(n: usize, clusters: i32, ratio: f64) -> Vec<DVec3> {
    let (mut random, at) = (Random::new(3), DVec3::new(0.317, -0.273, 0.711));
    let cluster = |k: i32| (0..n).map(move |_| ratio.powi(k));
    let scales: Vec<f64> = (0..clusters).flat_map(cluster).collect();
    scales.into_iter().map(|scale| random.in_cube() * scale + at).collect()
}

/// A plan that keeps its tolerance and sums few pairs directly.
fn held(formula: Formula, tolerance: f64, points: &[DVec3]) -> (f64, Report) {
    let charges = charges(points.len(), 2);
    let fmm = build(formula, tolerance, points, points).unwrap();
    let values = fmm.apply(&charges).unwrap();
    let exact = direct(&plain(formula), points, &charges, points).unwrap();
    let error = relative_l2_error(&values, &exact);
    assert!(error < tolerance, "{error:e}");
    let report = fmm.report();
    let pairs = (points.len() as u64).pow(2);
    assert!(report.stats.direct_pairs < pairs / 3, "{:?}", report.stats);
    (error, report)
}

/// How many levels have expansions.
fn expanded_levels(report: &Report) -> usize {
    report.levels.iter().filter(|level| level.multipole_terms + level.local_terms > 0).count()
}

#[test]
fn an_escaper_costs_a_chain_of_cells_and_no_operators() {
    const N: usize = 3000;
    let mut said = Vec::new();
    for (formula, tolerance) in KERNELS {
        let (_, alone) = held(formula, tolerance, &clouds::cube(N - 1, 1));
        for exponent in [6, 9, 12] {
            let (error, report) = held(formula, tolerance, &with_escaper(N, 10f64.powi(exponent)));
            assert!(expanded_levels(&report) <= expanded_levels(&alone), "{report}");
            // But for pairs with the escaper, and its path of cells.
            let (own, others) = (&report.stats, &alone.stats);
            assert!(own.direct_pairs <= others.direct_pairs + 4 * N as u64, "{own:?}");
            assert!(own.cell_pairs[0] <= others.cell_pairs[0] && own.cells < others.cells + 100);
            let share = report.stats.direct_pairs as f64 / (N * N) as f64;
            said.push(format!("{error:.0e}, {:.0} %", 100.0 * share));
        }
    }
    row(
        "One point at 1e6, 1e9, 1e12 extents",
        "cells of the last level that one key tells hold all others: N² pairs",
        "100 % of all pairs direct",
        format!("1/r at 1e-6, Yukawa at 1e-3: errors and direct pairs {}", said.join("; ")),
    );
}

#[test]
fn clusters_far_apart_keep_the_tolerance() {
    let mut errors = Vec::new();
    for (formula, tolerance) in KERNELS {
        for distance in [1e6, 1e9, 1e12] {
            let mut points = clouds::cube(1500, 1);
            let other = DVec3::new(distance, 0.3 * distance, 0.0);
            // As coarse as coordinates are there.
            points.extend(clouds::cube(1500, 2).iter().map(|p| *p + other));
            errors.push(format!("{:.0e}", held(formula, tolerance, &points).0));
        }
    }
    row(
        "Two clusters 1e6, 1e9, 1e12 extents apart",
        "one leaf each: all pairs within them",
        "50 % of all pairs direct",
        format!("1/r at 1e-6, Yukawa at 1e-3: errors {}", errors.join(", ")),
    );
}

#[test]
fn clusters_in_clusters_keep_the_tolerance() {
    let errors: Vec<String> = KERNELS
        .iter()
        .map(|&(formula, tolerance)| {
            let points = nested(1000, 3, 1e-5);
            let (error, report) = held(formula, tolerance, &points);
            assert!(report.stats.depth > 33);
            format!("{error:.0e}")
        })
        .collect();
    row(
        "A cluster in a cluster in a cluster, each 1e-5 of the one around it",
        "the innermost is one leaf, or the tree has no end",
        "11 % of all pairs direct",
        format!("1/r at 1e-6, Yukawa at 1e-3: errors {}", errors.join(", ")),
    );
}

#[test]
fn pairs_on_a_line_of_powers_of_two_keep_the_tolerance() {
    let at = |i: i32| DVec3::new(1.0, 0.4, -0.3) * 0.5f64.powi(i);
    let points: Vec<DVec3> = (0..60).flat_map(|i| [at(i), at(i) * (1.0 + 1e-3)]).collect();
    let charges = charges(points.len(), 2);
    let kernel = InverseDistance::<f64>::new();
    let exact = direct(&kernel, &points, &charges, &points).unwrap();
    let expansion = HarmonicExpansion::with_tolerance(kernel, 1e-6).unwrap();
    let fmm = Fmm::with_expansion(expansion).leaf_size(1).build(&points, &points).unwrap();
    let stats = fmm.report().stats;
    assert!(stats.depth > 58 && stats.expansion_pairs > 0, "{stats:?}");
    assert!(relative_l2_error(&fmm.apply(&charges).unwrap(), &exact) < 1e-6);
    let fmm = Fmm::builder(kernel).tolerance(1e-6).leaf_size(2).build(&points, &points).unwrap();
    assert!(relative_l2_error(&fmm.apply(&charges).unwrap(), &exact) < 1e-6);
}

#[test]
fn single_precision_keeps_the_tolerance_on_all_scales() {
    let kernel = InverseDistance::<f32>::new();
    let single = |points: &[DVec3]| points.iter().map(|p| p.as_vec3()).collect::<Vec<Vec3>>();
    let mut clouds = [1e6, 1e9, 1e12].map(|extents| single(&with_escaper(3000, extents))).to_vec();
    // In coordinates that are as fine as the smallest of them.
    let at = DVec3::new(0.317, -0.273, 0.711);
    let inside: Vec<DVec3> = nested(1000, 3, 1e-5).iter().map(|p| *p - at).collect();
    clouds.push(single(&inside));
    for points in clouds {
        let charges: Vec<f32> = charges(points.len(), 2).iter().map(|&q| q as f32).collect();
        let exact = direct(&kernel, &points, &charges, &points).unwrap();
        let fmm = Fmm::builder(kernel).tolerance(1e-4).leaf_size(20).build(&points, &points);
        let fmm = fmm.unwrap();
        let stats = fmm.report().stats;
        assert!(stats.direct_pairs < 3000 * 1000 && stats.depth > 20, "{stats:?}");
        let error = relative_l2_error(&fmm.apply(&charges).unwrap(), &exact);
        assert!(error < 1e-4, "{error:e}");
    }
}

#[test]
fn gradients_of_what_grows_keep_the_tolerance_from_far_away() {
    let mut random = Random::new(3);
    let apart: Vec<DVec3> =
        (0..8000).map(|i| random.in_cube() + DVec3::X * (1e4 * (i % 2) as f64)).collect();
    // Values are rounded by more than gradients are large within the smallest cells.
    let widest: Vec<DVec3> =
        (0..8000).map(|_| random.direction() * 10f64.powf(random.between(-6.0, 6.0))).collect();
    let charges = charges(8000, 4);
    let kernel = formula!(|d| d.length()).skip_coincident().gradient();
    for (points, is_expanded) in [(apart, true), (widest, false)] {
        let plan = Fmm::builder(kernel).tolerance(1e-3).applications(2000);
        let fmm = plan.build(&points, &points).unwrap();
        assert_eq!(fmm.report().stats.expansion_pairs > 0, is_expanded);
        let values = fmm.apply(&charges).unwrap();
        let targets: Vec<DVec3> = points.iter().step_by(37).copied().collect();
        let exact = direct(&kernel, &points, &charges, &targets).unwrap();
        let slopes = |values: &mut dyn Iterator<Item = &WithGradient<f64>>| -> Vec<f64> {
            values.flat_map(|u| u.gradient).collect()
        };
        let [found, exact] = [slopes(&mut values.iter().step_by(37)), slopes(&mut exact.iter())];
        let error = relative_l2_error(&found, &exact);
        assert!(error < 1e-3, "{error:e}");
    }
}

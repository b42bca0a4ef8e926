//! The tolerance is that of whole sums, near and far, whatever the charges and wherever the points.

use farfield::{Fmm, Scheme, direct};
use farfield_testing::clouds::{charges, cube};
use glam::DVec3;

use crate::any_kernel::{Formula, error, error_at, plain};

#[test]
fn the_budget_is_that_of_whole_sums() {
    // Next to nothing of these sums comes from afar: no digit of it is kept.
    let formulas: [(&str, Formula, usize); 4] = [
        ("r^-4", |x, y| x.distance_squared(y).powi(-2), 90),
        ("r^-12", |x, y| x.distance_squared(y).powi(-6), 0),
        (
            "Lennard-Jones",
            |x, y| {
                let s = 1e-3 / x.distance_squared(y);
                s.powi(6) - s.powi(3)
            },
            0,
        ),
        ("narrow", |x, y| (-x.distance_squared(y) / 0.001).exp(), 60),
    ];
    let points = cube(3000, 14);
    let any_sign = charges(3000, 15);
    let one_sign: Vec<f64> = any_sign.iter().map(|q| 1.0 + 0.5 * q).collect();
    for (name, formula, terms) in formulas {
        let fmm = Fmm::builder(plain(formula)).tolerance(1e-3).leaf_size(30);
        let fmm = fmm.build(&points, &points).unwrap();
        let report = fmm.report();
        assert_eq!(report.stats.scheme, Scheme::Fmm, "{name}");
        let most = report.levels.iter().map(|level| level.multipole_terms).max().unwrap();
        assert!(most <= terms, "{name}: {most} terms");
        for qs in [&any_sign, &one_sign] {
            let error = error(formula, &points, qs, &fmm.apply(qs).unwrap());
            assert!(error <= 1e-3, "{name}: {error:e}");
        }
        assert_eq!(fmm.report().unusual_applications, 0, "{name}");
    }
}

#[test]
fn charges_that_are_only_far_away_keep_the_tolerance() {
    let points = cube(3000, 16);
    let everywhere = charges(3000, 17);
    let right = |p: &DVec3, q: f64| if p.x > 0.7 { q } else { 0.0 };
    let far_away: Vec<f64> = points.iter().zip(&everywhere).map(|(p, &q)| right(p, q)).collect();
    let left: Vec<DVec3> = points.iter().copied().filter(|p| p.x < 0.3).collect();
    let formulas: [(&str, Formula); 2] = [
        ("r^-6", |x, y| x.distance_squared(y).powi(-3)),
        ("narrow", |x, y| (-x.distance_squared(y) / 0.02).exp()),
    ];
    for (name, formula) in formulas {
        let kernel = plain(formula);
        // So often that operators for such charges are worth more than direct sums.
        let builder = Fmm::builder(kernel).tolerance(1e-3).leaf_size(30).applications(1000);
        let fmm = builder.build(&points, &left).unwrap();
        assert_eq!(fmm.report().stats.scheme, Scheme::Fmm, "{name}");
        let before = fmm.apply(&everywhere).unwrap();
        for round in 1..3 {
            let sums = fmm.apply(&far_away).unwrap();
            let error = error_at(&left, formula, &points, &far_away, &sums);
            assert!(error <= 1e-3, "{name}: {error:e}");
            let (certified, certificate) = fmm.apply_certified(&far_away).unwrap();
            assert_eq!(certified, sums, "{name}");
            let exact = direct(&kernel, &points, &far_away, &left).unwrap();
            let delivered = farfield::relative_l2_error(&sums, &exact);
            // Direct sums of the judge and of the certificate round differently.
            let rounding = 1e-14;
            assert!(delivered <= certificate.relative_l2 + rounding, "{name}: {certificate:?}");
            assert_eq!(fmm.report().unusual_applications, 2 * round, "{name}");
        }
        // The plan for others stays as it is.
        assert_eq!(fmm.apply(&everywhere).unwrap(), before, "{name}");
    }
}

#[test]
fn charges_where_next_to_nothing_arrives_keep_the_tolerance() {
    // Squares of what arrives are no numbers any more.
    let ball = |at: f64, seed: u64| {
        cube(1000, seed).into_iter().map(move |p| DVec3::splat(at) + (p - DVec3::splat(0.5)) * 0.2)
    };
    let targets: Vec<DVec3> = ball(0.1, 22).collect();
    let sources: Vec<DVec3> = targets.iter().copied().chain(ball(0.9, 23)).collect();
    let kernel = plain(|x: DVec3, y: DVec3| (-300.0 * x.distance(y)).exp());
    let fmm = Fmm::builder(kernel).tolerance(1e-3).leaf_size(30).build(&sources, &targets).unwrap();
    let mut qs = vec![0.0; 1000];
    qs.resize(2000, 1.0);
    let exact = direct(&kernel, &sources, &qs, &targets).unwrap();
    let error = farfield::relative_l2_error(&fmm.apply(&qs).unwrap(), &exact);
    assert!(error <= 1e-3, "{error:e}");
}

#[test]
fn charges_that_no_sampled_target_meets_keep_the_tolerance() {
    // 64 sites with sources and targets. Charges are where no targets are, and at one site more.
    let sites = (0..64).map(|i| DVec3::new((i % 4) as f64, (i / 4 % 4) as f64, (i / 16) as f64));
    let ball = |at: DVec3, seed: u64| {
        cube(50, seed).into_iter().map(move |p| at + (p - DVec3::splat(0.5)) * 0.04)
    };
    let (mut ys, mut xs, mut qs) = (Vec::new(), Vec::new(), Vec::new());
    for (i, site) in sites.enumerate() {
        let site = site + cube(64, 24)[i] * 0.3;
        ys.extend(ball(site, 2 * i as u64));
        let aside = if i == 17 { DVec3::new(0.1, 0.03, 0.02) } else { DVec3::ZERO };
        if i > 0 {
            xs.extend(ball(site + aside, 2 * i as u64 + 1));
        }
        let charge = [(0, 1e17), (17, 1.0)].into_iter().find(|&(at, _)| at == i);
        qs.resize(ys.len(), charge.map_or(0.0, |(_, q)| q));
    }
    let formula: Formula = |x, y| {
        let r = x.distance(y);
        (-r).exp() / r.powi(3)
    };
    for tolerance in [1e-2, 1e-3] {
        let builder = Fmm::builder(plain(formula)).tolerance(tolerance).leaf_size(30);
        let fmm = builder.applications(1000).build(&ys, &xs).unwrap();
        let error = error_at(&xs, formula, &ys, &qs, &fmm.apply(&qs).unwrap());
        assert!(error <= tolerance, "{error:e}");
    }
}

#[test]
fn sums_depend_on_their_charges_alone() {
    let points = cube(3000, 25);
    let series: Vec<f64> = (0..3000).map(|i| 10f64.powf(-12.0 * f64::from(i) / 3000.0)).collect();
    let few: Vec<f64> = (0..3000).map(|i| f64::from(u8::from(i < 40))).collect();
    let corner: Vec<f64> =
        points.iter().map(|p| f64::from(u8::from(p.max_element() < 0.2))).collect();
    let kernel = plain(|x: DVec3, y: DVec3| (-8.0 * x.distance(y)).exp() / x.distance_squared(y));
    let plan = || {
        let builder = Fmm::builder(kernel).tolerance(1e-4).leaf_size(30).applications(1000);
        builder.build(&points, &points).unwrap()
    };
    let fmm = plan();
    for charges in [&series, &few, &corner, &series] {
        let alone = plan();
        assert_eq!(fmm.apply(charges).unwrap(), alone.apply(charges).unwrap());
        assert_eq!(fmm.apply_timed(charges).unwrap().0, alone.apply(charges).unwrap());
        assert_eq!(fmm.apply_certified(charges).unwrap().0, alone.apply(charges).unwrap());
    }
    assert!(fmm.report().unusual_applications > 0);
}

#[test]
fn clusters_that_face_each_other_keep_the_tolerance() {
    // All that is far comes from one cell, and from its corner.
    let cluster = |corner: f64, seed: u64| {
        let points = cube(1500, seed).into_iter().map(move |p| p * 0.01 + DVec3::splat(corner));
        points.chain([DVec3::ZERO, DVec3::ONE]).collect::<Vec<_>>()
    };
    let (ys, xs) = (cluster(0.24, 18), cluster(0.5, 19));
    let qs: Vec<f64> = charges(1502, 20).iter().map(|q| 1.0 + 0.5 * q).collect();
    let formulas: [(&str, Formula); 2] =
        [("1/r", |x, y| 1.0 / x.distance(y)), ("exp(-r)", |x, y| (-x.distance(y)).exp())];
    for (name, formula) in formulas {
        let kernel = plain(formula);
        // A plan for other points was made before.
        let other = Fmm::builder(kernel).tolerance(1e-3).leaf_size(30).build(&cube(1000, 21), &xs);
        other.unwrap();
        let fmm = Fmm::builder(kernel).tolerance(1e-3).leaf_size(30).build(&ys, &xs).unwrap();
        let error = error_at(&xs, formula, &ys, &qs, &fmm.apply(&qs).unwrap());
        assert!(error <= 1e-3, "{name}: {error:e}");
    }
}

#[test]
fn what_grows_keeps_the_tolerance_from_far_away() {
    // Next to all comes from the other cluster, through cells that are tiny beside the way.
    let formulas: [(&str, Formula); 3] = [
        ("r^2 log r", |x, y| x.distance_squared(y) * x.distance(y).ln()),
        ("r^3 + r", |x, y| x.distance(y).powi(3) + x.distance(y)),
        ("multiquadric", |x, y| (x.distance_squared(y) + 0.01).sqrt()),
    ];
    let qs = charges(2000, 26);
    for apart in [100.0, 1e6] {
        let points: Vec<DVec3> = cube(2000, 27)
            .into_iter()
            .enumerate()
            .map(|(i, p)| p + DVec3::X * f64::from(i as u32 % 2) * apart)
            .collect();
        for (name, formula) in formulas {
            for tolerance in [1e-3, 1e-6] {
                let fmm = Fmm::builder(plain(formula)).tolerance(tolerance).leaf_size(30);
                let fmm = fmm.build(&points, &points).unwrap();
                assert_eq!(fmm.report().stats.scheme, Scheme::Fmm, "{name}");
                let error = error(formula, &points, &qs, &fmm.apply(&qs).unwrap());
                assert!(error <= tolerance, "{name}, {apart} apart: {error:e}");
            }
        }
    }
}

#[test]
fn thin_clouds_keep_the_tolerance() {
    // Where all cells of a level stand in a row, their errors add up.
    let formulas: [(&str, Formula); 2] =
        [("1/r", |x, y| 1.0 / x.distance(y)), ("yukawa", |x, y| yukawa(0.01 * x.distance(y)))];
    fn yukawa(r: f64) -> f64 {
        (-r).exp() / r
    }
    let extents = [DVec3::new(1000.0, 1.0, 1e-3), DVec3::new(1000.0, 1000.0, 1e-3)];
    let qs: Vec<f64> = charges(3000, 8).iter().map(|q| 1.0 + 0.5 * q).collect();
    for extent in extents {
        let points: Vec<DVec3> = cube(3000, 2).into_iter().map(|p| p * extent).collect();
        for (name, formula) in formulas {
            let fmm = Fmm::builder(plain(formula)).tolerance(1e-3).leaf_size(30);
            let fmm = fmm.build(&points, &points).unwrap();
            assert_eq!(fmm.report().stats.scheme, Scheme::Fmm, "{name}");
            let error = error(formula, &points, &qs, &fmm.apply(&qs).unwrap());
            assert!(error <= 1e-3, "{name}, {extent}: {error:e}");
        }
    }
}

//! Point sets on which trees get deep, large or slow. No test asserts a time: what is bounded is what
//! takes it, which is levels, cells, pairs and bytes.

use farfield::conformance::Counting;
use farfield::{Error, Fmm, MAX_LEVEL, Stats, direct, relative_l2_error};
use farfield_potentials::{HarmonicExpansion, InverseDistance};
use farfield_testing::clouds::{self, Random, charges};
use glam::DVec3;

use crate::table::row;

/// What every plan keeps to, per point of either set: one cell on every level, a few lists each.
const BYTES_PER_POINT: usize = 16 << 10;

/// Offsets of M2L are at most all children of the parent's neighbours.
const M2L_PER_CELL: u64 = 189;

/// Sums of ones: exact, every pair once, within the bounds that hold for all sets of points.
fn counted(sources: &[DVec3], targets: &[DVec3], leaf_size: usize) -> Stats {
    let fmm = Fmm::with_expansion(Counting::<f64>::new()).leaf_size(leaf_size);
    let fmm = fmm.build(sources, targets).unwrap();
    let charges: Vec<f64> = (0..sources.len()).map(|i| (i % 7) as f64 - 2.0).collect();
    let total: f64 = charges.iter().sum();
    assert!(fmm.apply(&charges).unwrap().iter().all(|&u| u == total), "every pair once");
    bounded(&fmm.report().stats);
    fmm.report().stats.clone()
}

fn bounded(stats: &Stats) {
    let points = stats.sources + stats.targets;
    let pairs = stats.sources as u64 * stats.targets as u64;
    assert_eq!(stats.expansion_pairs + stats.direct_pairs, pairs);
    assert!(stats.depth <= MAX_LEVEL, "{stats:?}");
    assert!(stats.cells <= 2 + points * MAX_LEVEL, "{stats:?}");
    assert!(stats.cell_pairs[0] <= M2L_PER_CELL * stats.cells as u64, "{stats:?}");
    let bytes = stats.plan_bytes() + stats.workspace_bytes;
    assert!(bytes <= BYTES_PER_POINT * (points + 1), "{stats:?}");
}

/// How often a cube is halved until no part of it holds more than `leaf_size` points, if no key ends it;
/// none beyond `limit`.
fn naive_depth(points: &[DVec3], leaf_size: usize, limit: usize) -> Option<usize> {
    let low = points.iter().copied().reduce(DVec3::min).unwrap();
    let high = points.iter().copied().reduce(DVec3::max).unwrap();
    let mut open = vec![(points.to_vec(), low, (high - low).max_element(), 0)];
    let mut deepest = 0;
    while let Some((points, low, edge, depth)) = open.pop() {
        deepest = deepest.max(depth);
        if points.len() <= leaf_size {
            continue;
        }
        if depth == limit {
            return None;
        }
        let middle = low + DVec3::splat(0.5 * edge);
        let mut octants = vec![Vec::new(); 8];
        for p in points {
            let [x, y, z] = [p.x >= middle.x, p.y >= middle.y, p.z >= middle.z].map(usize::from);
            octants[x | y << 1 | z << 2].push(p);
        }
        for (octant, points) in octants.into_iter().enumerate().filter(|(_, p)| !p.is_empty()) {
            let at = |axis: usize| if octant >> axis & 1 == 1 { middle[axis] } else { low[axis] };
            open.push((points, DVec3::new(at(0), at(1), at(2)), 0.5 * edge, depth + 1));
        }
    }
    Some(deepest)
}

/// One cloud as sources and targets, in a row of its own.
fn held(mode: &str, why: &str, points: &[DVec3], leaf_size: usize) -> Stats {
    const LIMIT: usize = 2000;
    let stats = counted(points, points, leaf_size);
    let naive = match naive_depth(points, leaf_size, LIMIT) {
        Some(depth) => format!("{depth} levels"),
        None => format!("no end after {LIMIT} levels: stack overflow"),
    };
    let Stats { depth, cells, direct_pairs, sources, .. } = stats;
    let near = direct_pairs as f64 / (sources as f64).powi(2);
    row(
        mode,
        why,
        naive,
        format!(
            "{depth} levels, {cells} cells, {:.0} bytes per point, {:.0} % of {sources}² pairs direct",
            stats.bytes_per_point(),
            100.0 * near
        ),
    );
    stats
}

/// Asserts that harmonics for a tolerance deliver it in the sums of 1/r over one cloud, in leaves of 10.
fn harmonics_reach(tolerance: f64, points: &[DVec3]) {
    let charges = charges(points.len(), 2);
    let kernel = InverseDistance::<f64>::new();
    let expansion = HarmonicExpansion::with_tolerance(kernel, tolerance).unwrap();
    let fmm = Fmm::with_expansion(expansion).leaf_size(10).build(points, points).unwrap();
    let exact = direct(&kernel, points, &charges, points).unwrap();
    let error = relative_l2_error(&fmm.apply(&charges).unwrap(), &exact);
    assert!(error < tolerance, "{error:e} for {tolerance:e}");
}

#[test]
fn equal_points_share_a_leaf() {
    let points = clouds::coincident(3000);
    let stats = held("All points equal", "no cut tells them apart", &points, 10);
    assert_eq!((stats.depth, stats.cells), (0, 1));
    // And where they are a part of a cloud.
    let mut points = clouds::cube(3000, 1);
    points.extend(vec![points[5]; 500]);
    let stats = counted(&points, &points, 10);
    assert!(stats.direct_pairs < 2 * 501 * 501 + 3000 * 27 * 20 * 2, "{stats:?}");
}

#[test]
fn ten_million_duplicates_are_one_leaf() {
    const N: usize = 10_000_000;
    let here = DVec3::new(0.1, -0.2, 0.3);
    let mut sources = vec![here; N];
    sources.push(DVec3::splat(4.0));
    let targets = clouds::cube(100, 1);
    let fmm = Fmm::with_expansion(Counting::<f64>::new()).build(&sources, &targets).unwrap();
    bounded(&fmm.report().stats);
    assert!(fmm.apply(&vec![1.0; N + 1]).unwrap().iter().all(|&u| u == (N + 1) as f64));
    let Stats { depth, cells, .. } = fmm.report().stats;
    let per_source = fmm.report().stats.bytes_per_point();
    assert!(
        per_source < 100.0 && depth == 3 && cells < 30,
        "{per_source} bytes per source, {cells} cells"
    );
    drop(fmm);

    // Among themselves all pairs are near: that is said before any of them is summed.
    let builder = Fmm::with_expansion(Counting::<f64>::new());
    let estimate = builder.estimate(&sources, &sources).unwrap();
    let pairs = (N as f64).powi(2);
    assert!((estimate.direct_pairs / pairs - 1.0).abs() < 0.01, "{estimate:?}");
    row(
        "10⁷ duplicates",
        "recursion to the last bit; a list entry per pair",
        "no end, as above",
        format!(
            "{depth} levels, {cells} cells, {per_source:.0} bytes per source; as sources and targets \
             1e14 direct pairs, foretold by `estimate`"
        ),
    );
}

#[test]
fn clusters_far_apart_are_divided_as_far_as_they_differ() {
    // Next to the origin 1e-12 can be told apart; at 1e6 only along the other axes.
    let mut random = Random::new(1);
    let mut points: Vec<DVec3> =
        (0..2000).map(|i| random.in_cube() * 1e-12 + DVec3::X * (1e6 * (i % 2) as f64)).collect();
    let why = "depth is log2 of distance over size";
    let stats = held("Two clusters of 1e-12, 1e6 apart", why, &points, 10);
    assert!(stats.depth > 60 && stats.cells < 1500 && stats.direct_pairs < 2000 * 500);
    harmonics_reach(1e-10, &points);
    // One of them lies in a plane, which is now a face of cells on no level.
    points.push(DVec3::X * 1.3e6);
    harmonics_reach(1e-10, &points);
    // What one place holds is one leaf, however deep the tree is elsewhere.
    let mut random = Random::new(1);
    let mut equal = vec![DVec3::X * 1e6; 1000];
    equal.extend((0..1000).map(|_| random.in_cube() * 1e-12));
    let stats = counted(&equal, &equal, 10);
    assert!((1_000_000..1_300_000).contains(&stats.direct_pairs), "{stats:?}");
}

#[test]
fn walls_of_a_room_lie_on_faces_of_cells() {
    let mut random = Random::new(3);
    let wall = |i: usize| {
        let mut p = random.in_cube();
        p[i % 3] = (i / 3 % 2) as f64;
        p
    };
    let points: Vec<DVec3> = (0..3000).map(wall).collect();
    for tolerance in [1e-4, 1e-6, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12] {
        harmonics_reach(tolerance, &points);
    }
}

#[test]
fn an_outlier_costs_levels_but_no_digits() {
    let alone = counted(&clouds::cube(2000, 1), &clouds::cube(2000, 1), 10);
    let mut points = clouds::cube(2000, 1);
    points.push(DVec3::new(1e12, -1e12, 1e12));
    let stats = held("One outlier at 1e12", "depth is log2 of extent over spacing", &points, 10);
    assert!((40..50).contains(&stats.depth) && stats.cells < 2 * alone.cells + 100);
    assert!(stats.direct_pairs < 2 * alone.direct_pairs, "{stats:?} {alone:?}");
    let mut points = clouds::cube(2000, 1);
    points.push(DVec3::splat(1e4));
    let stats = counted(&points, &points, 10);
    assert!(stats.direct_pairs < 2000 * 1000, "an outlier at 1e4 leaves a far field");
}

#[test]
fn pairs_close_together_are_chains_of_cells() {
    let mut random = Random::new(1);
    let points: Vec<DVec3> =
        (0..1000).map(|_| random.in_cube()).flat_map(|p| [p, p + DVec3::splat(2e-6)]).collect();
    let why = "a chain of cells for each pair";
    let stats = held("1,000 pairs 1e-6 apart", why, &points, 1);
    assert!(stats.depth > 15);
}

#[test]
fn every_cloud_keeps_the_bounds() {
    for (_, points) in clouds::all(1500) {
        for leaf_size in [1, 10, 100] {
            counted(&points, &points, leaf_size);
            counted(&points[..500], &points, leaf_size);
        }
    }
}

#[test]
fn lines_planes_and_curves_have_small_trees() {
    let points = clouds::line(3000, 1);
    let stats = held("Collinear points", "empty octants, unequal leaves", &points, 10);
    assert!(stats.direct_pairs < 3000 * 30, "{stats:?}");
    let points: Vec<DVec3> = clouds::cube(3000, 2).iter().map(|p| p.with_z(0.25)).collect();
    let stats = held("Coplanar points", "faces of cells in the plane", &points, 10);
    assert!(stats.direct_pairs < 3000 * 45, "{stats:?}");
    let points: Vec<DVec3> = (0..4096).map(hilbert).collect();
    let stats =
        held("Points along a space-filling curve", "equal spacing, on a lattice", &points, 10);
    assert!(stats.direct_pairs < 4096 * 170, "{stats:?}");
}

/// The i-th point of Hilbert's curve through a lattice of 16³ (Skilling 2004).
fn hilbert(i: u32) -> DVec3 {
    const BITS: u32 = 4;
    let mut x = [0u32; 3];
    for bit in 0..3 * BITS {
        x[(2 - bit % 3) as usize] |= (i >> bit & 1) << (bit / 3);
    }
    let gray = x[2] >> 1;
    (x[2], x[1]) = (x[2] ^ x[1], x[1] ^ x[0]);
    x[0] ^= gray;
    let mut q = 2;
    while q != 1 << BITS {
        let p = q - 1;
        for k in (0..3).rev() {
            if x[k] & q != 0 {
                x[0] ^= p;
            } else {
                let t = (x[0] ^ x[k]) & p;
                x[0] ^= t;
                x[k] ^= t;
            }
        }
        q <<= 1;
    }
    DVec3::from_array(x.map(|c| f64::from(c) / 16.0))
}

#[test]
fn points_on_the_borders_of_cells_belong_to_one() {
    // Dyadic coordinates: corners, edges and faces of cells of every level, the root's included.
    let lattice: Vec<DVec3> = (0..17 * 17 * 17)
        .map(|k| DVec3::new(f64::from(k % 17), f64::from(k / 17 % 17), f64::from(k / 289)) / 16.0)
        .collect();
    // Closed cells, as one writes at first: a point on a border lies in up to eight of them.
    let inside = |p: &DVec3, k: i32| {
        let low = DVec3::new(f64::from(k % 2), f64::from(k / 2 % 2), f64::from(k / 4)) * 0.5;
        p.cmpge(low).all() && p.cmple(low + DVec3::splat(0.5)).all()
    };
    let naive: usize =
        lattice.iter().map(|p| (0..8).filter(|&k| inside(p, k)).count()).sum::<usize>();
    assert!(naive > lattice.len());
    for leaf_size in [1, 8, 100] {
        counted(&lattice, &lattice, leaf_size);
    }
    let charges: Vec<f64> = charges(lattice.len(), 3).iter().map(|q| q.abs()).collect();
    let kernel = InverseDistance::<f64>::new();
    let expansion = HarmonicExpansion::with_tolerance(kernel, 1e-6).unwrap();
    let fmm = Fmm::with_expansion(expansion).leaf_size(30).build(&lattice, &lattice).unwrap();
    let exact = direct(&kernel, &lattice, &charges, &lattice).unwrap();
    let error = relative_l2_error(&fmm.apply(&charges).unwrap(), &exact);
    assert!(error < 1e-6, "{error:e}");
    row(
        "Dyadic coordinates on cell borders",
        "a point on a border lies in several closed cells, or in none",
        format!("{naive} places for {} points", lattice.len()),
        format!("every pair once, error {error:.0e} at tolerance 1e-6"),
    );
}

#[test]
fn sources_and_targets_may_be_of_any_number_and_anywhere() {
    let many = clouds::cube(1_000_000, 1);
    let one = [DVec3::new(0.3, 0.4, 0.5)];
    let far: Vec<DVec3> = clouds::cube(2000, 2).iter().map(|p| *p + DVec3::splat(1e5)).collect();
    let near = clouds::cube(2000, 3);
    let gathered = counted(&many, &one, 60);
    let spread = counted(&one, &many, 60);
    for stats in [&gathered, &spread] {
        assert!(stats.direct_pairs <= 1_000_000 && stats.cell_pairs[0] == 0, "{stats:?}");
    }
    assert!(gathered.list_bytes < 200, "one run of all sources: {gathered:?}");
    let outside = counted(&far, &near, 20);
    assert_eq!(outside.direct_pairs, 0, "{outside:?}");
    assert!(outside.cell_pairs.iter().sum::<u64>() < 10, "{outside:?}");
    row(
        "10⁶ sources for one target, and the reverse; sources far outside the targets' hull",
        "lists per point of the other set; one tree for both",
        format!("{} pairs", many.len()),
        format!(
            "{} and {} direct pairs; outside the hull {} pairs of cells",
            gathered.direct_pairs,
            spread.direct_pairs,
            outside.cell_pairs.iter().sum::<u64>()
        ),
    );
}

#[test]
fn extents_at_the_ends_of_the_range_are_met_or_refused() {
    let points = clouds::cube(500, 1);
    for scale in [f64::MIN_POSITIVE, 1e-300, 1e300, f64::MAX / 5.0] {
        let scaled: Vec<DVec3> = points.iter().map(|p| *p * scale).collect();
        counted(&scaled, &scaled, 10);
    }
    let subnormal: Vec<DVec3> = points.iter().map(|p| *p * 1e-320).collect();
    counted(&subnormal, &subnormal, 10);
    // No larger than a tenth, but where the sum of two coordinates overflows.
    let away: Vec<DVec3> =
        points.iter().map(|p| (*p * 0.1 + DVec3::splat(0.8)) * f64::MAX).collect();
    counted(&away, &away, 10);
    // A few hundred of the smallest numbers wide, points in cells of their own.
    let bell = |x: DVec3, y: DVec3| (-x.distance(y)).exp();
    let mut tiny: Vec<DVec3> = points[..250].iter().map(|p| *p * 1e-321).collect();
    tiny.extend(tiny.clone().iter().map(|p| *p + DVec3::splat(5e-324)));
    let fmm = Fmm::builder(crate::plain(bell)).order(3).leaf_size(1).build(&tiny, &tiny).unwrap();
    let exact = direct(&crate::plain(bell), &tiny, &vec![1.0; 500], &tiny).unwrap();
    assert!(relative_l2_error(&fmm.apply(&vec![1.0; 500]).unwrap(), &exact) < 1e-12);
    let huge: Vec<DVec3> = points.iter().map(|p| (*p - DVec3::splat(0.5)) * f64::MAX).collect();
    let refused = Fmm::with_expansion(Counting::<f64>::new()).build(&huge, &huge).map(|_| ());
    let Err(Error::ExtentTooLarge { extent, limit }) = refused else { panic!("{refused:?}") };
    assert!(extent > limit);
    // The half-width of a box by its squared diagonal.
    let diagonal = (DVec3::splat(1e300).length_squared()).sqrt();
    assert!(diagonal.is_infinite());
    row(
        "Extents of 1e-320 to 1e308",
        "squares of extents overflow, cells become subnormal",
        format!("diagonal of a cube of 1e300: {diagonal}"),
        format!("exact counts up to 3.6e307; `ExtentTooLarge` above {limit:.1e}"),
    );
}

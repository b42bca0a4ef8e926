//! Sums over many ranks, held against direct sums and, bit by bit, against one plan.

use farfield::{Cube, Fmm, Unmasked, direct, from_fn, relative_l2_error};
use farfield_mpi::{DistributedFmm, Error, PartStats, Transport, on_threads};
use farfield_testing::clouds::{self, Random};
use glam::DVec3;

/// 1/r, which looks different from place to place if `warp` is not zero.
fn kernel(
    warp: f64,
) -> impl farfield::Kernel<Real = f64, Source = DVec3, Target = DVec3, Charge = f64, Value = f64> + Copy
{
    from_fn(move |x: DVec3, y: DVec3| {
        let r = x.distance(y);
        if r > 0.0 { (1.0 + warp * (x.z + 2.0 * y.x)) / r } else { 0.0 }
    })
}

const TOLERANCE: f64 = 1e-4;

/// Charges of either sign.
fn charges(n: usize) -> Vec<f64> {
    let mut random = Random::new(77);
    (0..n).map(|_| random.between(-0.5, 1.0)).collect()
}

/// The part of `all` that the rank brings, if ranks bring as many as `shares` says.
fn mine<'a, V>(all: &'a [V], shares: &[usize], rank: usize) -> &'a [V] {
    let first: usize = shares[..rank].iter().sum();
    &all[first..first + shares[rank]]
}

/// As many shares of about the same size.
fn even(n: usize, size: usize) -> Vec<usize> {
    (0..size).map(|rank| (rank + 1) * n / size - rank * n / size).collect()
}

/// What ranks come to that bring these shares of sources and targets, in the order of ranks.
fn sums(
    warp: f64,
    leaf_size: usize,
    sources: (&[DVec3], &[usize]),
    targets: (&[DVec3], &[usize]),
    charges: &[f64],
) -> Vec<f64> {
    let sums = on_threads(sources.1.len(), |ranks| {
        let rank = ranks.rank();
        let my_targets = mine(targets.0, targets.1, rank);
        let builder = DistributedFmm::builder(kernel(warp), ranks).tolerance(TOLERANCE);
        let fmm =
            builder.leaf_size(leaf_size).build(mine(sources.0, sources.1, rank), my_targets)?;
        // Twice: nothing is left from one application to the next.
        let first = fmm.apply(mine(charges, sources.1, rank))?;
        assert_eq!(fmm.apply(mine(charges, sources.1, rank))?, first);
        Ok::<_, Error>(first)
    });
    sums.into_iter().flat_map(|sums| sums.unwrap()).collect()
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}

/// The order of points along the curve.
fn order(points: &[DVec3]) -> Vec<usize> {
    let low = points.iter().copied().reduce(DVec3::min).unwrap();
    let high = points.iter().copied().reduce(DVec3::max).unwrap();
    let root = Cube::<f64>::around_box(low.to_array(), high.to_array()).unwrap();
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by_key(|&i| (root.curve_key(points[i], true), i));
    order
}

/// The sums of one plan for the same points along the curve, in their own order.
fn of_one_plan(warp: f64, leaf_size: usize, points: &[DVec3], charges: &[f64]) -> Vec<f64> {
    let order = order(points);
    let along: Vec<DVec3> = order.iter().map(|&i| points[i]).collect();
    // With a mask, errors are relative to pairs of points, as they are over many ranks.
    let builder = Fmm::builder(kernel(warp)).tolerance(TOLERANCE).mask(Unmasked);
    let fmm = builder.leaf_size(leaf_size).build(&along, &along).unwrap();
    assert!(fmm.report().stats.cell_pairs[0] > 0, "the far field is used");
    let charges: Vec<f64> = order.iter().map(|&i| charges[i]).collect();
    let mut values = vec![0.0; points.len()];
    for (&i, value) in order.iter().zip(fmm.apply(&charges).unwrap()) {
        values[i] = value;
    }
    values
}

#[test]
fn values_have_the_same_bits_on_any_number_of_ranks_and_in_one_plan() {
    let n = 2500;
    for (name, points) in [
        ("cube", clouds::cube(n, 1)),
        ("plummer", clouds::plummer(n, 3)),
        ("sphere", clouds::sphere(n, 2)),
    ] {
        let charges = charges(n);
        let one = of_one_plan(0.0, 20, &points, &charges);
        let exact = direct(&kernel(0.0), &points, &charges, &points).unwrap();
        let error = relative_l2_error(&one, &exact);
        assert!(error <= TOLERANCE, "{name}: {error:e}");
        for size in [1, 2, 3, 4, 7] {
            let points = (&points[..], &even(n, size)[..]);
            let own = sums(0.0, 20, points, points, &charges);
            assert!(relative_l2_error(&own, &exact) <= TOLERANCE, "{name} on {size} ranks");
            assert!(bits(&own) == bits(&one), "{name} on {size} ranks");
        }
    }
}

#[test]
fn other_sources_than_targets_may_be_anywhere_and_ranks_may_have_none() {
    let (sources, targets) = (clouds::cube(1500, 4), clouds::plummer(900, 5));
    let charges = charges(sources.len());
    let own = |source_shares: &[usize], target_shares: &[usize]| {
        sums(0.0, 16, (&sources, source_shares), (&targets, target_shares), &charges)
    };
    let one = own(&[1500], &[900]);
    let exact = direct(&kernel(0.0), &sources, &charges, &targets).unwrap();
    let error = relative_l2_error(&one, &exact);
    assert!(error <= TOLERANCE, "{error:e}");
    for (source_shares, target_shares) in [
        (vec![0, 1500, 0, 0], vec![300, 0, 600, 0]),
        (vec![500, 1, 999], vec![0, 0, 900]),
        (vec![100; 15], vec![60; 15]),
    ] {
        let many = own(&source_shares, &target_shares);
        assert!(bits(&many) == bits(&one), "{source_shares:?} {target_shares:?}");
    }
}

#[test]
fn few_points_many_ranks_and_none_at_all() {
    let points = [DVec3::ZERO, DVec3::X, DVec3::new(0.3, 0.9, 0.2)];
    let exact = direct(&kernel(0.0), &points, &[1.0, 2.0, -3.0], &points).unwrap();
    for leaf_size in [1, 10] {
        let shares = [0, 1, 0, 0, 2, 0, 0];
        let points = (&points[..], &shares[..]);
        let own = sums(0.0, leaf_size, points, points, &[1.0, 2.0, -3.0]);
        assert!(relative_l2_error(&own, &exact) <= TOLERANCE);
    }
    let (none, some) = ((&[][..], &[0, 0][..]), (&points[..], &[1, 2][..]));
    assert_eq!(sums(0.0, 5, none, some, &[]), [0.0; 3]);
    assert!(sums(0.0, 5, some, none, &[1.0; 3]).is_empty());
    assert!(sums(0.0, 5, none, none, &[]).is_empty());
}

#[test]
fn coincident_points_and_clusters_in_clusters_are_divided_as_one_plan_does() {
    let mut random = Random::new(8);
    let mut clusters: Vec<DVec3> = (0..400).map(|_| random.in_cube()).collect();
    clusters.extend((0..400).map(|_| DVec3::splat(0.3) + 1e-9 * random.in_cube()));
    let places = clouds::cube(90, 9);
    let coincident = (0..1350).map(|i| places[i % 90]).collect();
    for (name, points) in [("coincident", coincident), ("clusters", clusters)] {
        let charges = charges(points.len());
        let one = of_one_plan(0.0, 12, &points, &charges);
        let exact = direct(&kernel(0.0), &points, &charges, &points).unwrap();
        assert!(relative_l2_error(&one, &exact) <= TOLERANCE, "{name}");
        for size in [1, 2, 5] {
            let points = (&points[..], &even(points.len(), size)[..]);
            let own = sums(0.0, 12, points, points, &charges);
            assert!(bits(&own) == bits(&one), "{name} on {size} ranks");
        }
    }
}

#[test]
fn kernels_that_look_different_from_place_to_place_come_to_the_same_bits() {
    let points = clouds::cube(400, 6);
    let charges = charges(points.len());
    let one = of_one_plan(0.5, 15, &points, &charges);
    let exact = direct(&kernel(0.5), &points, &charges, &points).unwrap();
    let error = relative_l2_error(&one, &exact);
    assert!(error <= TOLERANCE, "{error:e}");
    let points = (&points[..], &even(points.len(), 3)[..]);
    assert!(bits(&sums(0.5, 15, points, points, &charges)) == bits(&one));
}

/// What a rank brings: points, charges, a tolerance and a leaf size.
type Input = (Vec<DVec3>, Vec<f64>, f64, usize);

/// The error that every rank gets where the input of rank 1 is spoilt.
fn error_of_all(spoil: &(dyn Fn(&mut Input) + Sync)) -> Error {
    let errors = on_threads(3, |ranks| {
        let points = clouds::cube(50, ranks.rank() as u64);
        let mut input: Input = (points, vec![1.0; 50], TOLERANCE, 8);
        if ranks.rank() == 1 {
            spoil(&mut input);
        }
        let (points, charges, tolerance, leaf_size) = input;
        let builder = DistributedFmm::builder(kernel(0.0), ranks).tolerance(tolerance);
        builder.leaf_size(leaf_size).build(&points, &points)?.apply(&charges)
    });
    assert!(errors.iter().all(|error| *error == errors[0]), "{errors:?}");
    errors[0].clone().unwrap_err()
}

#[test]
fn what_one_rank_refuses_every_rank_refuses_alike() {
    let names = |spoil: &(dyn Fn(&mut Input) + Sync), text: &str| {
        let error = error_of_all(spoil);
        let is_of_rank = matches!(error, Error::Refused { rank: 1, .. });
        assert!(is_of_rank && error.to_string().contains(text), "{error}");
    };
    names(&|input| input.0[7].y = f64::NAN, "rank 1: source 7 is at");
    names(&|input| input.1[9] = f64::NAN, "charge 9 is [NaN]");
    names(&|input| input.1.truncate(49), "charges: expected 50 entries, found 49");
    names(&|input| input.3 = 0, "leaf size 0");
}

#[test]
fn ranks_that_choose_differently_are_told_so() {
    let unlike = |what: &'static str, found: &str, expected: &str| {
        let [found, expected] = [found, expected].map(String::from);
        Error::Unlike { rank: 1, what, found, expected }
    };
    assert_eq!(error_of_all(&|input| input.3 = 7), unlike("leaf size", "7", "8"));
    let tolerances = unlike("tolerance of a pair", "1e-4", "1e-5");
    assert_eq!(error_of_all(&|input| input.2 = 1e-3), tolerances);
}

#[test]
fn other_kernels_on_other_ranks_are_refused() {
    let built = |shift: f64| {
        let results = on_threads(3, |ranks| {
            let points = clouds::cube(50, ranks.rank() as u64);
            let shift = if ranks.rank() == 2 { shift } else { 0.0 };
            let kernel = from_fn(move |x: DVec3, y: DVec3| (-(1.0 + shift) * x.distance(y)).exp());
            DistributedFmm::builder(kernel, ranks).build(&points, &points).map(|_| ())
        });
        assert!(results.iter().all(|result| *result == results[0]), "{results:?}");
        results[0].clone()
    };
    assert_eq!(built(0.0), Ok(()));
    let what = "digest of values of the kernel";
    for shift in [1.0, 1e-9] {
        let error = built(shift).unwrap_err();
        assert!(matches!(error, Error::Unlike { rank: 2, what: w, .. } if w == what), "{error}");
    }
}

/// The most that a rank sends in an application, needs of others, and holds.
#[derive(Debug)]
struct Most {
    words: f64,
    needed: f64,
    held: f64,
}

/// What ranks send that have so many points each, in a cube, and mostly their own already.
fn sent(size: usize, each: usize) -> Most {
    let points = clouds::cube(size * each, 12);
    let points: Vec<DVec3> = order(&points).into_iter().map(|i| points[i]).collect();
    let of_ranks = on_threads(size, |ranks| {
        let points = mine(&points, &even(points.len(), size), ranks.rank());
        let builder = DistributedFmm::builder(kernel(0.0), ranks).tolerance(1e-2);
        let fmm = builder.leaf_size(8).build(points, points)?;
        let before = ranks.volume();
        fmm.apply(&vec![1.0; points.len()])?;
        Ok::<_, Error>(((ranks.volume() - before).words, fmm.stats()))
    });
    let of_ranks: Vec<(u64, PartStats)> = of_ranks.into_iter().map(Result::unwrap).collect();
    let most = |of: fn(&(u64, PartStats)) -> u64| of_ranks.iter().map(of).max().unwrap() as f64;
    let needed = most(|(_, stats)| stats.sources_of_others as u64);
    let held = most(|(_, stats)| stats.sources as u64);
    Most { words: most(|(words, _)| *words), needed, held }
}

#[test]
fn what_ranks_send_is_what_lies_near_their_borders() {
    let [few, many, more_ranks] = [sent(8, 512), sent(8, 4096), sent(64, 512)];
    println!("{few:?}\n{many:?}\n{more_ranks:?}");
    // Eight times as many points have four times the surface.
    assert!(many.words < 5.0 * few.words && many.needed < 5.0 * few.needed);
    // In the midst of others a rank has more neighbours than in a corner, but not eight times as many.
    assert!(more_ranks.words < 4.0 * few.words && more_ranks.needed < 4.0 * few.needed);
    for (most, each) in [(few, 512.0), (many, 4096.0), (more_ranks, 512.0)] {
        assert!(most.held < 1.15 * each, "{most:?}");
    }
}

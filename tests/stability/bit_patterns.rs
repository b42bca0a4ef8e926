//! Trees and lists over coordinates of any bit pattern, in both precisions: an error that names the
//! first that is not finite, or exact counts within bounds, and sums that are direct sums.
//!
//! `FARFIELD_FUZZ_SECONDS=600 cargo test --release --test stability bit_patterns` looks longer; what
//! fails prints the seed that makes it fail again.

use std::time::{Duration, Instant};

use farfield::conformance::Counting;
use farfield::{
    Error, Expansion, Fmm, Kernel, MAX_LEVEL, Point, PointSet, Real, Scheme, Vector, direct,
};
use farfield_potentials::{HarmonicExpansion, InverseDistance};
use farfield_testing::clouds::Random;
use glam::{DVec3, Vec3};

use crate::plain;
use crate::table::row;

/// Seeds tried without the environment's asking for more.
const SEEDS: u64 = 1500;

#[test]
fn any_bits_are_counted_or_named() {
    let outcomes = match std::env::var("FARFIELD_FUZZ_SECONDS") {
        Ok(seconds) => {
            let limit = Duration::from_secs(seconds.parse().expect("a number of seconds"));
            let start = Instant::now();
            // Other seeds every time, and those that were tried are told.
            let first = std::time::UNIX_EPOCH.elapsed().unwrap().as_secs() << 24;
            let seeds = (first..).take_while(|_| start.elapsed() < limit);
            let outcomes = try_all(seeds);
            println!("seeds {first}..{}", first + outcomes.iter().sum::<u64>());
            outcomes
        }
        Err(_) => try_all(0..SEEDS),
    };
    let [summed, not_finite, too_large] = outcomes;
    assert!(summed > 100 && not_finite > 100 && too_large > 0, "{outcomes:?}");
    row(
        "Coordinates of any bit pattern, f32 and f64",
        "NaN in comparisons, subnormal cells, extents that overflow",
        "NaN sorts nowhere; `(x − low) / extent` is 0/0",
        format!(
            "of {SEEDS} seeds or more, about {:.0} % summed, {:.0} % `NonFinitePosition`, {:.0} % \
             `ExtentTooLarge`",
            share(summed, outcomes),
            share(not_finite, outcomes),
            share(too_large, outcomes)
        ),
    );
}

fn share(count: u64, outcomes: [u64; 3]) -> f64 {
    100.0 * count as f64 / outcomes.iter().sum::<u64>() as f64
}

/// What failed once.
#[test]
fn finds_stay_fixed() {
    // The square of 1e-230 was compared, and the far field taken for zero.
    let lattice = |scale: f64| -> Vec<DVec3> {
        let place = |k: u32| DVec3::new(f64::from(k % 4), f64::from(k / 4 % 4), f64::from(k / 16));
        (0..64).map(|k| place(k) * scale).collect()
    };
    for points in [lattice(1e230), lattice(1e-230)] {
        summed(&points, &points, 1, Scheme::Fmm);
    }
}

fn try_all(seeds: impl Iterator<Item = u64>) -> [u64; 3] {
    let mut outcomes = [0; 3];
    for seed in seeds {
        outcomes[attempt(seed)] += 1;
    }
    outcomes
}

/// Tells the seed that fails.
struct Told(u64);

impl Drop for Told {
    fn drop(&mut self) {
        if std::thread::panicking() {
            println!("seed {}", self.0);
        }
    }
}

/// Which outcome a seed has: summed, not finite, too large.
fn attempt(seed: u64) -> usize {
    let _told = Told(seed);
    let mut random = Random::new(seed);
    let mut bits = move || {
        (random.unit() * 2f64.powi(32)) as u64 | ((random.unit() * 2f64.powi(32)) as u64) << 32
    };
    let wild = bits() % 4 == 0;
    let counts = [bits() % 40, bits() % 40];
    let leaf_size = 1 + bits() as usize % 6;
    let scheme = [Scheme::Fmm, Scheme::Treecode { m2m: true }, Scheme::Direct][bits() as usize % 3];
    let near = bits();
    let mut number = |single: bool| coordinate(single, wild, near, &mut bits);
    if seed.is_multiple_of(2) {
        let [ys, xs] = counts.map(|n| {
            (0..n)
                .map(|_| DVec3::new(number(false), number(false), number(false)))
                .collect::<Vec<_>>()
        });
        let outcome = counted::<f64>(&ys, &xs, leaf_size, scheme);
        if outcome == 0 {
            summed(&ys, &xs, leaf_size, scheme);
        }
        outcome
    } else {
        let [ys, xs] = counts.map(|n| {
            let mut number = || number(true) as f32;
            (0..n).map(|_| Vec3::new(number(), number(), number())).collect::<Vec<_>>()
        });
        counted::<f32>(&ys, &xs, leaf_size, scheme)
    }
}

/// A coordinate: any bits at all if `wild`, else finite ones whose exponents and leading digits agree
/// with `near` more or less.
fn coordinate(single: bool, wild: bool, near: u64, bits: &mut impl FnMut() -> u64) -> f64 {
    let number = |double: u64, narrow: u32| {
        if single { f32::from_bits(narrow).into() } else { f64::from_bits(double) }
    };
    let any = bits();
    let choice = bits() % 16;
    if wild && choice < 4 {
        let any = if choice == 0 { any | 0x7ff0_0000_7f80_0000 } else { any };
        return number(any, any as u32);
    }
    let kept = [12, 20, 30, 45, 60][(choice % 5) as usize];
    let low = u64::MAX >> kept;
    let pattern = (near & !low) | (any & low);
    let value = match choice {
        14 => 0.0,
        15 => -0.0,
        // The smallest numbers, and those of one exponent.
        13 => number(any & 0x000f_ffff_ffff_ffff, any as u32 & 0x007f_ffff),
        12 => number(
            (any & 0x801f_ffff_ffff_ffff) | 0x4000_0000_0000_0000,
            (any as u32 & 0x80ff_ffff) | 0x4000_0000,
        ),
        _ => number(pattern, (pattern >> 32) as u32),
    };
    if wild || value.is_finite() { value } else { 1.0 }
}

/// Exact counts and bounded trees, or the right error.
fn counted<T: Real>(ys: &[Point<T>], xs: &[Point<T>], leaf_size: usize, scheme: Scheme) -> usize
where
    Counting<T>: Expansion<
        Kernel: Kernel<Real = T, Source = Point<T>, Target = Point<T>, Charge = T, Value = T>,
    >,
{
    let finite = |p: &Point<T>| p.to_array().iter().all(|c| c.as_f64().is_finite());
    let expected = [(PointSet::Sources, ys), (PointSet::Targets, xs)]
        .into_iter()
        .find_map(|(set, points)| Some((set, points.iter().position(|p| !finite(p))?)));
    let builder = Fmm::with_expansion(Counting::<T>::new()).leaf_size(leaf_size).scheme(scheme);
    match (builder.build(ys, xs), expected) {
        (Err(Error::NonFinitePosition { set, index, position }), Some(named)) => {
            assert_eq!((set, index), named);
            assert!(position.iter().any(|c| !c.is_finite()));
            1
        }
        (Err(Error::ExtentTooLarge { extent, limit }), None) => {
            assert!(extent > limit || extent.is_infinite());
            2
        }
        (Ok(fmm), None) => {
            let ones = vec![T::from_f64(1.0); ys.len()];
            let total = T::from_f64(ys.len() as f64);
            assert!(fmm.apply(&ones).unwrap().iter().all(|&u| u == total));
            let stats = fmm.report().stats;
            let pairs = (ys.len() * xs.len()) as u64;
            assert_eq!(stats.expansion_pairs + stats.direct_pairs, pairs);
            assert!(stats.depth <= MAX_LEVEL);
            assert!(stats.cells <= 2 + (ys.len() + xs.len()) * MAX_LEVEL);
            0
        }
        (outcome, expected) => panic!("{:?} instead of {expected:?}", outcome.map(|_| ())),
    }
}

/// Sums of 1/r by both expansions against direct ones, wherever those are within the range of numbers.
fn summed(ys: &[DVec3], xs: &[DVec3], leaf_size: usize, scheme: Scheme) {
    let kernel = InverseDistance::<f64>::new();
    let charges = vec![1.0; ys.len()];
    let exact = direct(&kernel, ys, &charges, xs).unwrap();
    let in_range = |u: &f64| *u == 0.0 || (1e-290..1e290).contains(u);
    let within = exact.iter().all(in_range);
    let hold = |what: &str, values: Result<Vec<f64>, Error>, bound: f64| match values {
        Ok(values) => {
            for (value, exact) in values.iter().zip(&exact).filter(|(_, exact)| in_range(exact)) {
                assert!((value - exact).abs() <= bound * exact, "{what}: {value:e} {exact:e}");
            }
        }
        Err(error) => assert!(!within, "{what}: {error}"),
    };
    let expansion = HarmonicExpansion::new(kernel, 6).unwrap();
    let builder = Fmm::with_expansion(expansion).leaf_size(leaf_size).scheme(scheme);
    hold("harmonics", builder.build(ys, xs).and_then(|fmm| fmm.apply(&charges)), 0.02);

    // 1/r without squares of lengths.
    let inverse = |x: DVec3, y: DVec3| {
        let d = x - y;
        let unit = d.abs().max_element();
        1.0 / unit / (d / unit).length()
    };
    let builder = Fmm::builder(plain(inverse)).order(4).leaf_size(leaf_size).scheme(scheme);
    hold("interpolation", builder.build(ys, xs).and_then(|fmm| fmm.apply(&charges)), 0.1);
}

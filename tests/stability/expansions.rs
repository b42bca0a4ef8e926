//! Expansions at high order, at every scale, at special points, and shifted many times.

use farfield::{
    Cell, Cube, Error, Expansion, Kernel, Numbers, Outcome, Point, Real, ValueOf, Vector, direct,
    relative_l2_error,
};
use farfield_potentials::harmonic::{Harmonic, MAX_ORDER, Scratch};
use farfield_potentials::{HarmonicExpansion, InverseDistance};
use farfield_testing::clouds::{Random, charges};
use glam::DVec3;

use crate::table::row;

/// Two cells of half-width `scale` with a child each, between which expansions are shifted.
struct Cells<T: Real> {
    source: [Cell<T>; 2],
    target: [Cell<T>; 2],
}

impl<T: Real> Cells<T> {
    fn new(offset: [u32; 3], scale: f64) -> Self {
        let root = Cube::new(Point::<T>::default(), T::from_f64(8.0 * scale));
        let cell = |at: [u32; 3], octant: u32| {
            [
                Cell::new(&root, 3, at.map(u64::from)),
                Cell::new(&root, 4, at.map(|c| u64::from(2 * c + octant))),
            ]
        };
        Self { source: cell([0; 3], 1), target: cell(offset, 0) }
    }

    /// P2M, M2M, M2L, L2L, L2P; also all terms in passing.
    fn carry<E>(
        &self,
        expansion: &E,
        ys: &[Point<T>],
        qs: &[T],
        xs: &[Point<T>],
    ) -> (Vec<ValueOf<E>>, Vec<T>)
    where
        E: Expansion<MultipoleTerm = T, LocalTerm = T>,
        E::Kernel: Kernel<Real = T, Source = Point<T>, Target = Point<T>, Charge = T>,
    {
        let terms = || vec![T::from_f64(0.0); expansion.multipole_len(3)];
        let [mut m, mut above, mut l, mut below] = [terms(), terms(), terms(), terms()];
        let ([from, from_child], [to, to_child]) = (&self.source, &self.target);
        expansion.p2m(from_child, ys, qs, &mut m);
        expansion.m2m(from_child, from, &m, &mut above);
        expansion.m2l(from, to, &above, &mut l);
        expansion.l2l(to, to_child, &l, &mut below);
        let mut values = vec![<ValueOf<E> as Numbers>::zero(); xs.len()];
        expansion.l2p(to_child, &below, xs, &mut values);
        (values, [m, above, l, below].concat())
    }
}

/// Places of a cell, given points of [−1, 1]³.
fn inside<T: Real>(cell: &Cell<T>, points: &[DVec3]) -> Vec<Point<T>> {
    let place = |p: &DVec3| {
        let p = Point::<T>::from_array(p.to_array().map(T::from_f64));
        cell.centre() + p * cell.half_width()
    };
    points.iter().map(place).collect()
}

/// Points of [−1, 1]³.
fn scattered(n: usize, seed: u64) -> Vec<DVec3> {
    let mut random = Random::new(seed);
    (0..n).map(|_| random.in_cube() * 2.0 - DVec3::ONE).collect()
}

#[test]
fn scene_units_overflow_and_half_widths_do_not() {
    let harmonic = Harmonic::<f64>::new(0.5, MAX_ORDER).unwrap();
    let expansion = HarmonicExpansion::new(InverseDistance::<f64>::new(), MAX_ORDER).unwrap();
    let (mut lost, mut naive_subnormal) = (Vec::new(), 0);
    let (mut worst, mut ours_subnormal) = (0.0f64, 0);
    for scale in [1e-150, 1e-12, 1.0, 1e12, 1e150] {
        let cells = Cells::<f64>::new([5, 4, 2], scale);
        let ys = inside(&cells.source[1], &scattered(30, 1));
        let xs = inside(&cells.target[1], &scattered(30, 2));
        let qs = charges(30, 3);
        let units = |values: &[f64]| values.iter().map(|u| u * scale).collect::<Vec<_>>();
        let exact = units(&direct(expansion.kernel(), &ys, &qs, &xs).unwrap());
        let (values, terms) = cells.carry(&expansion, &ys, &qs, &xs);
        let error = relative_l2_error(&units(&values), &exact);
        assert!(error < 1e-13, "{scale:e}: {error:e}");
        worst = worst.max(error);
        ours_subnormal += terms.iter().filter(|term| term.is_subnormal()).count();

        // The same series without a unit of length.
        let centre = cells.source[1].centre();
        let (mut functions, mut moments) = (vec![0.0; harmonic.len()], vec![0.0; harmonic.len()]);
        for (y, q) in ys.iter().zip(&qs) {
            harmonic.regular(*y - centre, &mut functions);
            moments.iter_mut().zip(&functions).for_each(|(m, f)| *m += q * f);
        }
        naive_subnormal += moments.iter().filter(|m| m.is_subnormal()).count();
        let mut at = |x: &DVec3| {
            harmonic.singular(*x - centre, &mut functions);
            moments.iter().zip(&functions).map(|(m, f)| m * f).sum::<f64>()
        };
        let values: Vec<f64> = xs.iter().map(&mut at).collect();
        let error = relative_l2_error(&units(&values), &exact);
        if error.is_nan() || error > 1e-9 {
            lost.push(scale);
        }
    }
    assert!(worst < 1e-13 && ours_subnormal == 0, "{worst:e}, {ours_subnormal} subnormal");
    assert_eq!(lost, [1e-150, 1e-12, 1e12, 1e150]);
    assert!(naive_subnormal > 0);
    row(
        "Order 40, cells of 1e-150 to 1e150",
        "powers of lengths in scene units leave the range of numbers",
        format!("NaN or wrong at {lost:?}; {naive_subnormal} subnormal terms"),
        format!("error ≤ {worst:.0e} at all scales, no subnormal term"),
    );
}

#[test]
fn poles_centres_faces_edges_and_corners_are_points_like_others() {
    // ∂/∂θ of P_l(cos θ), divided by sin θ as textbooks have it.
    let naive_slope = |l: usize, x: f64| {
        let (mut before, mut now) = (1.0, x);
        for k in 1..l {
            let k = k as f64;
            (before, now) = (now, ((2.0 * k + 1.0) * x * now - k * before) / (k + 1.0));
        }
        l as f64 * (x * now - before) / (1.0 - x * x).sqrt()
    };
    let naive: Vec<bool> = [-1.0, 0.3, 1.0].map(|x| naive_slope(5, x).is_finite()).to_vec();
    assert_eq!(naive, [false, true, false]);

    let special: Vec<DVec3> = (0..27)
        .map(|k| DVec3::new(f64::from(k % 3), f64::from(k / 3 % 3), f64::from(k / 9)) - DVec3::ONE)
        .collect();
    let kernel = InverseDistance::<f64>::new().with_gradient();
    let expansion = HarmonicExpansion::new(kernel, MAX_ORDER).unwrap();
    let mut worst = 0.0f64;
    for offset in [[6, 0, 0], [0, 0, 6], [5, 5, 0], [4, 4, 4]] {
        let cells = Cells::<f64>::new(offset, 1.0);
        let ys = inside(&cells.source[1], &special);
        let xs = inside(&cells.target[1], &special);
        for (j, y) in ys.iter().enumerate() {
            let exact = direct(&kernel, &[*y], &[1.0], &xs).unwrap();
            let (values, _) = cells.carry(&expansion, &[*y], &[1.0], &xs);
            let mut moments = vec![0.0; expansion.multipole_len(4)];
            expansion.p2m(&cells.source[1], &[*y], &[1.0], &mut moments);
            let mut by_moments = vec![Numbers::zero(); xs.len()];
            let outcome = expansion.m2p(&cells.source[1], &moments, &xs, &mut by_moments);
            assert_eq!(outcome, Outcome::Done);
            for (i, exact) in exact.iter().enumerate() {
                for found in [values[i], by_moments[i]] {
                    let error = relative_l2_error(&[found], &[*exact]);
                    assert!(error < 1e-11, "{} to {}: {error:e}", special[j], special[i]);
                    worst = worst.max(error);
                }
            }
        }
    }
    row(
        "Points at poles, centre, faces, edges, corners",
        "angles degenerate at the poles, 1/sin θ in gradients",
        "gradient NaN at both poles",
        format!("values and gradients to {worst:.0e} for all 27² pairs"),
    );
}

/// The largest difference of two sets of terms, in units of what a field of the first weighs.
fn deviation(harmonic: &Harmonic<f64>, found: &[f64], expected: &[f64]) -> f64 {
    let mut weights = vec![0.0; harmonic.len()];
    harmonic.singular(DVec3::new(2.0, 3.0, -2.0), &mut weights);
    let field = |terms: &[f64]| terms.iter().zip(&weights).map(|(a, b)| a * b).sum::<f64>();
    (field(found) - field(expected)).abs() / field(expected).abs()
}

#[test]
fn a_thousand_shifts_lose_few_digits() {
    const SHIFTS: usize = 1000;
    let harmonic = Harmonic::<f64>::new(0.5, 12).unwrap();
    let len = harmonic.len();
    let mut scratch = Scratch::new(&harmonic);
    let y = DVec3::new(0.4, -0.2, 0.3);
    let regular = |y: DVec3| {
        let mut out = vec![0.0; len];
        harmonic.regular(y, &mut out);
        out
    };
    let mut random = Random::new(4);
    let octants: Vec<DVec3> =
        (0..SHIFTS).map(|_| (random.in_cube() - DVec3::splat(0.5)).signum() * 0.5).collect();

    // Up from child to parent, a thousand times; the source is followed exactly.
    let (mut moments, mut at) = (regular(y), y);
    for &octant in &octants {
        let mut above = vec![0.0; len];
        harmonic.m2m(octant, 0.5, &moments, &mut above, &mut scratch);
        (moments, at) = (above, at * 0.5 + octant);
    }
    let up = deviation(&harmonic, &moments, &regular(at));

    // Down a thousand times, without the unit that each child takes on: λ = 0 would be that of a
    // potential without one, so it is taken out.
    let source = DVec3::new(4.0, -3.0, 5.0);
    let mut local = vec![0.0; len];
    harmonic.singular(source, &mut local);
    let field =
        |local: &[f64], x: DVec3| -> f64 { local.iter().zip(regular(x)).map(|(l, r)| l * r).sum() };
    let (top, mut below) = (local.clone(), y);
    for &octant in octants.iter().rev() {
        below = below * 0.5 + octant;
    }
    for &octant in &octants {
        let mut child = vec![0.0; len];
        harmonic.l2l(octant, 0.5, &local, &mut child, &mut scratch);
        child.iter_mut().for_each(|l| *l *= 2.0);
        local = child;
    }
    let down = (field(&local, y) / field(&top, below) - 1.0).abs();

    // There and back in one unit of length, as if cells did not grow with their contents.
    let mut away = regular(y);
    for way in [1.0, -1.0] {
        for _ in 0..SHIFTS / 2 {
            let mut moved = vec![0.0; len];
            harmonic.m2m(DVec3::splat(0.5 * way), 1.0, &away, &mut moved, &mut scratch);
            away = moved;
        }
    }
    let naive = deviation(&harmonic, &away, &regular(y));
    assert!(up < 1e-13 && down < 1e-13, "{up:e} {down:e}");
    assert!(naive > 1.0, "{naive:e}");
    row(
        "1,000 M2M and 1,000 L2L in a row",
        "shifts back and forth amplify rounding as (distance / size)^p",
        format!("error {naive:.0e}, terms not rescaled"),
        format!("up {up:.0e}, down {down:.0e}, each cell in its own half-width"),
    );
}

/// Errors by order, from 4 to 40.
fn errors_by_order<T: Real>() -> Vec<(usize, f64)> {
    let cells = Cells::<T>::new([3, 3, 2], 1.0);
    let [ys, xs] = [(&cells.source[1], 5), (&cells.target[1], 6)]
        .map(|(cell, seed)| inside(cell, &scattered(40, seed)));
    let qs = vec![T::from_f64(1.0); 40];
    let wide = |points: &[Point<T>]| -> Vec<DVec3> {
        points.iter().map(|p| DVec3::from_array(p.to_array().map(Real::as_f64))).collect()
    };
    let exact = direct(&InverseDistance::<f64>::new(), &wide(&ys), &[1.0; 40], &wide(&xs)).unwrap();
    let error = |order| {
        let expansion = HarmonicExpansion::new(InverseDistance::<T>::new(), order).unwrap();
        let (values, _) = cells.carry(&expansion, &ys, &qs, &xs);
        let values: Vec<f64> = values.iter().map(|u| u.as_f64()).collect();
        (order, relative_l2_error(&values, &exact))
    };
    (4..=MAX_ORDER).step_by(4).map(error).collect()
}

fn where_rounding_takes_over<T: Real>(epsilon: f64, asked: f64, offered: f64) -> String {
    let errors = errors_by_order::<T>();
    let least = errors.iter().map(|(_, error)| *error).fold(f64::INFINITY, f64::min);
    let (order, _) = errors.iter().copied().find(|(_, error)| *error < 4.0 * least).unwrap();
    let (_, highest) = errors[errors.len() - 1];
    assert!(highest < 4.0 * least && least < 64.0 * epsilon, "{errors:?}");

    let kernel = InverseDistance::<T>::new();
    let Err(Error::UnreachableTolerance { requested, reachable }) =
        HarmonicExpansion::with_tolerance(kernel, asked).map(|e| e.order())
    else {
        panic!("{asked:e} is below rounding");
    };
    assert!(requested == asked && reachable >= least && reachable < offered, "{reachable:e}");
    let reached = HarmonicExpansion::with_tolerance(kernel, reachable).map(|e| e.order());
    assert!(reached.is_ok_and(|p| p <= MAX_ORDER), "what is said to be reachable is");
    format!(
        "no better than {least:.0e} from order {order} on; {asked:.0e} refused, {reachable:.0e} offered"
    )
}

#[test]
fn orders_beyond_rounding_are_known() {
    let [single, double] = [
        where_rounding_takes_over::<f32>(f32::EPSILON.into(), 1e-7, 1e-5),
        where_rounding_takes_over::<f64>(f64::EPSILON, 1e-15, 1e-12),
    ];
    // The order that the series alone would need for nine digits.
    let naive = (1e-9f64.ln() / 0.46f64.ln()).ceil() as usize;
    let errors = errors_by_order::<f32>();
    let (_, error) = errors.iter().copied().find(|(order, _)| *order >= naive).unwrap();
    assert!(error > 10.0 * 1e-9);
    row(
        "Orders beyond rounding",
        "the series converges, sums of rounded terms do not",
        format!("1e-9 taken for met in f32 at order {naive}, error {error:.0e}"),
        format!("f32: {single}; f64: {double}"),
    );
}

//! Texts against the same formulas written in Rust.

use farfield::glam::{DVec3, Vec3};
use farfield::{Kernel, WithGradient, WithHessian, direct, from_fn, math};
use farfield_formula::{Coincident, TextFormula};
use farfield_testing::clouds::Random;

type Function = fn(DVec3, DVec3) -> f64;

/// Formulas that use everything there is; k = 1.5.
const FORMULAS: [(&str, Function); 24] = [
    ("1/r", |x, y| 1.0 / x.distance(y)),
    ("exp(-k*r)/r", |x, y| (-1.5 * x.distance(y)).exp() / x.distance(y)),
    ("exp(-(r/k)^2)", |x, y| (-(x.distance(y) / 1.5).powi(2)).exp()),
    ("-r^2", |x, y| -x.distance_squared(y)),
    ("2^-1^2*r", |x, y| 0.5 * x.distance(y)),
    ("2^3^2 / (1 + r2)", |x, y| 512.0 / (1.0 + x.distance_squared(y))),
    ("r**3 - 2*r2 + 1e-1", |x, y| x.distance(y).powi(3) - 2.0 * x.distance_squared(y) + 0.1),
    ("r2*log(r)", |x, y| x.distance_squared(y) * x.distance(y).ln()),
    ("sqrt(r2 + k^2)", |x, y| (x.distance_squared(y) + 2.25).sqrt()),
    ("r2^-2.5 + r^-7", |x, y| x.distance(y).powi(-5) + x.distance(y).powi(-7)),
    ("r^k + k^r + 3^k", |x, y| {
        x.distance(y).powf(1.5) + 1.5f64.powf(x.distance(y)) + 3f64.powf(1.5)
    }),
    ("cos(k*r)/r + sin(20*r)", |x, y| {
        let r = x.distance(y);
        (1.5 * r).cos() / r + (20.0 * r).sin()
    }),
    ("sin(1e6*d1) * cos(-d2)", |x, y| ((x - y).x * 1e6).sin() * (x - y).y.cos()),
    ("tanh(d1*d2) + erf(d3) - erfc(r)", |x, y| {
        let d = x - y;
        (d.x * d.y).tanh() + math::erf(d.z) - math::erfc(d.length())
    }),
    ("abs(d1) + min(d1, d2, d3) * max(d2, 0.25)", |x, y| {
        let d = x - y;
        d.x.abs() + d.min_element() * d.y.max(0.25)
    }),
    ("where(r < 1, 1 - r, r2 - 1)", |x, y| {
        let r = x.distance(y);
        if r < 1.0 { 1.0 - r } else { r * r - 1.0 }
    }),
    ("where(d1 >= d2, where(d3 != d1, 2, 3), d3 - 1)", |x, y| {
        let d = x - y;
        if d.x >= d.y { 2.0 } else { d.z - 1.0 }
    }),
    ("where(x1 == y1, 1, where(0.5 > y2, x3, -(-y3)))", |x, y| {
        if x.x == y.x {
            1.0
        } else if 0.5 > y.y {
            x.z
        } else {
            y.z
        }
    }),
    ("(x1 - y1)*(x2 + y2) - x3*y3/(1 + x1^2)", |x, y| {
        (x.x - y.x) * (x.y + y.y) - x.z * y.z / (1.0 + x.x * x.x)
    }),
    ("(2*x1 + y2) / sqrt(1 + r)", |x, y| (2.0 * x.x + y.y) / (1.0 + x.distance(y)).sqrt()),
    ("d1*d2/r^5 - 3*d1*d2/r^5", |x, y| -2.0 * (x - y).x * (x - y).y / x.distance(y).powi(5)),
    ("r*r + r2 - (r - r2) - -r", |x, y| 3.0 * x.distance_squared(y) + 0.0 * x.distance(y)),
    ("k", |_, _| 1.5),
    ("+ +pi*d1*0 + 2*(k - 1.5) + 7", |_, _| 7.0),
];

fn parameters(text: &str) -> Vec<(&'static str, f64)> {
    let uses = text.split(|c: char| !c.is_alphanumeric()).any(|word| word == "k");
    if uses { vec![("k", 1.5)] } else { vec![] }
}

fn formula(text: &str) -> TextFormula {
    TextFormula::new(text, &parameters(text)).unwrap_or_else(|error| panic!("{error}"))
}

fn points(n: usize, seed: u64) -> Vec<DVec3> {
    let mut random = Random::new(seed);
    (0..n).map(|_| random.in_cube()).collect()
}

#[test]
fn sums_are_those_of_the_formula_in_blocks_of_any_size() {
    let (sources, targets) = (points(150, 1), points(75, 2));
    let charges: Vec<f64> = (0..150).map(|j| f64::from(j).cos()).collect();
    for (text, function) in FORMULAS {
        let kernel = formula(text).kernel::<DVec3, f64, f64>();
        for (n, m) in [(1, 1), (1, 150), (75, 1), (7, 9), (33, 31), (75, 150)] {
            let (xs, ys, qs) = (&targets[..n], &sources[..m], &charges[..m]);
            let mut sums = vec![0.0; n];
            kernel.add_block(xs, ys, qs, 0.0, &mut sums);
            for (x, sum) in xs.iter().zip(sums) {
                let terms = || ys.iter().zip(qs).map(|(y, q)| function(*x, *y) * q);
                let (exact, size) = (terms().sum::<f64>(), terms().map(f64::abs).sum::<f64>());
                assert!((sum - exact).abs() <= 2e-14 * size, "{text}: {sum} {exact}");
            }
        }
    }
}

#[test]
fn entries_are_those_of_the_formula_in_both_precisions() {
    for (text, function) in FORMULAS {
        let kernel = formula(text).kernel::<DVec3, f64, f64>();
        let single = formula(text).kernel::<Vec3, f32, f32>();
        for (n, m) in [(1, 1), (1, 300), (300, 1), (13, 11)] {
            let (xs, ys) = (points(n, 3), points(m, 4));
            let mut found = vec![0.0; n * m];
            kernel.entries_block(&xs, &ys, &mut found);
            let narrow = |points: &[DVec3]| points.iter().map(|p| p.as_vec3()).collect::<Vec<_>>();
            let mut rough = vec![0.0; n * m];
            single.entries_block(&narrow(&xs), &narrow(&ys), &mut rough);
            for (k, (found, rough)) in found.into_iter().zip(rough).enumerate() {
                let exact = function(xs[k / m], ys[k % m]);
                assert!(
                    (found - exact).abs() <= 1e-14 * (1.0 + exact.abs()),
                    "{text}: {found} {exact}"
                );
                // Single precision has no digits left of an angle of a million.
                let error = (f64::from(rough) - exact).abs();
                let near = error <= 1e-4 * (1.0 + exact.abs()) || text.contains("1e6");
                assert!(near || text.contains("where"), "{text}: {rough} {exact}");
            }
        }
    }
}

#[test]
fn derivatives_agree_with_differences() {
    let kinks = ["where(d1 >=", "min(", "where(x1", "1e6"];
    for (text, function) in
        FORMULAS.into_iter().filter(|(t, _)| !kinks.iter().any(|k| t.contains(k)))
    {
        let kernel = formula(text).kernel::<DVec3, f64, f64>().hessian::<WithHessian<f64>>();
        let first = formula(text).kernel::<DVec3, f64, f64>().gradient::<WithGradient<f64>>();
        for (x, y) in points(20, 5).into_iter().zip(points(20, 6)) {
            let close = |found: f64, expected: f64, size: f64, what: &str| {
                assert!((found - expected).abs() <= size, "{text}, {what}: {found} {expected}");
            };
            let sum = direct(&kernel, &[y], &[1.0], &[x]).unwrap()[0];
            let fewer = direct(&first, &[y], &[1.0], &[x]).unwrap()[0];
            assert_eq!((fewer.value, fewer.gradient), (sum.value, sum.gradient), "{text}");
            let mut slopes = [[0.0; 3]];
            assert_eq!(first.entry_gradients(x, y, &mut slopes), farfield::Outcome::Done);
            assert_eq!(slopes[0], sum.gradient, "{text}");
            close(sum.value, function(x, y), 1e-14 * (1.0 + sum.value.abs()), "value");
            let size = 1.0 + sum.hessian.iter().fold(sum.value.abs(), |a, b| a.max(b.abs()));
            let h = 1e-4 * x.distance(y).min(1.0);
            let at = |i: usize, a: f64, j: usize, b: f64| {
                let mut p = x;
                p[i] += a * h;
                p[j] += b * h;
                function(p, y)
            };
            let mut second = 0;
            for i in 0..3 {
                let slope = (at(i, 1.0, i, 0.0) - at(i, -1.0, i, 0.0)) / (2.0 * h);
                close(sum.gradient[i], slope, 1e-6 * size, "slope");
                for j in i..3 {
                    let (a, b) = (at(i, 1.0, j, 1.0) - at(i, 1.0, j, -1.0), at(i, -1.0, j, 1.0));
                    let curvature = (a - b + at(i, -1.0, j, -1.0)) / (4.0 * h * h);
                    close(sum.hessian[second], curvature, 1e-4 * size / x.distance(y), "curvature");
                    second += 1;
                }
            }
        }
    }
}

#[test]
fn derivatives_are_those_of_the_engines_own_numbers() {
    use farfield::formula as rust;
    let (sources, targets) = (points(60, 7), points(40, 8));
    let charges: Vec<f64> = (0..60).map(|j| f64::from(j).sin()).collect();
    macro_rules! check {
        ($($text:literal $formula:expr;)*) => {$(
            let expected = direct(&$formula.hessian(), &sources, &charges, &targets).unwrap();
            let kernel = formula($text).kernel::<DVec3, f64, f64>().hessian::<WithHessian<f64>>();
            for (found, expected) in direct(&kernel, &sources, &charges, &targets).unwrap().iter().zip(expected) {
                let numbers = |u: &WithHessian<f64>| [&[u.value], &u.gradient[..], &u.hessian].concat();
                let expected = numbers(&expected);
                let size = expected.iter().fold(1.0, |a: f64, b| a.max(b.abs()));
                for (found, expected) in numbers(found).into_iter().zip(expected) {
                    assert!((found - expected).abs() <= 1e-12 * size, "{}: {found} {expected}", $text);
                }
            }
        )*};
    }
    check! {
        "exp(-1.5*r)/r" rust!(|d| (-d.length() * 1.5).exp() / d.length());
        "erf(r)*erfc(d1) + tanh(d2)" rust!(|d| d.length().erf() * d.x.erfc() + d.y.tanh());
        "log(1 + r2)*sin(d1)*cos(d2*d3)" rust!(|d| (d.length_squared() + 1.0).ln() * d.x.sin() * (d.y * d.z).cos());
        "r2^0.75 + r2^-1.5" rust!(|d| d.length_squared().powf(0.75) + d.length_squared().powf(-1.5));
        "abs(d1)*max(d2, d3) + min(r, 1)" rust!(|d| d.x.abs() * d.y.max(d.z) + d.length().min(farfield::Number::constant(1.0)));
        "x1*y2*d3/(2 + x2*x3)" rust!(|x, y| x.x * y.y * (x.z - y.z) / (x.y * x.z + 2.0));
    }
}

#[test]
fn points_at_one_place_follow_the_rule() {
    let at = [DVec3::X, DVec3::Y, DVec3::X];
    let charges = [1.0, 10.0, 100.0];
    let sums = |text: &str, rule: Coincident| {
        let formula = TextFormula::new(text, &[]).unwrap().coincident(rule);
        direct(&formula.kernel::<DVec3, f64, f64>(), &at, &charges, &at).unwrap()
    };
    let root = 2f64.sqrt().recip();
    assert_eq!(sums("1/r", Coincident::Skip)[0], 10.0 * root);
    assert_eq!(sums("1/r", Coincident::Value(3.0))[0], 10.0 * root + 303.0);
    assert_eq!(sums("1/r", Coincident::Formula)[0], f64::INFINITY);
    assert_eq!(sums("2", Coincident::Skip), [20.0, 202.0, 20.0]);
    assert_eq!(sums("2", Coincident::Formula), [222.0; 3]);
    assert_eq!(sums("exp(-r2)", Coincident::Formula)[1], 10.0 + 101.0 * math::exp(-2.0));
    // The formula is not finite there, and the value has no derivatives.
    let kernel = TextFormula::new("exp(d1)", &[]).unwrap().coincident(Coincident::Value(5.0));
    let kernel = kernel.kernel::<DVec3, f64, f64>().gradient::<[f64; 4]>();
    assert_eq!(direct(&kernel, &[DVec3::X], &[2.0], &[DVec3::X]).unwrap(), [[10.0, 0.0, 0.0, 0.0]]);
    // r² has derivatives at r = 0 however it is written.
    for text in ["r2", "r^2", "r*r", "r**4/r2", "exp(-r^2)"] {
        let kernel = formula(text).coincident(Coincident::Formula).kernel::<DVec3, f64, f64>();
        let sum = direct(&kernel.gradient::<[f64; 4]>(), &[DVec3::X], &[2.0], &[DVec3::X]).unwrap();
        assert!(text.contains('/') || sum[0][1..] == [0.0; 3], "{text}: {sum:?}");
    }
    // Points that are so near that r² vanishes are not at one place.
    let near = [DVec3::X, DVec3::X * 1e-200, DVec3::ZERO];
    let kernel = formula("d1").kernel::<DVec3, f64, f64>();
    assert_eq!(direct(&kernel, &near[1..2], &[1.0], &near[2..]).unwrap(), [-1e-200]);
}

#[test]
fn tensors_take_and_give_as_many_numbers_as_they_say() {
    let formula = TextFormula::new("[[d1, 2, r], [d2, 1/r, x1]]", &[]).unwrap();
    assert_eq!((formula.rows(), formula.columns()), (2, 3));
    let (x, y) = (DVec3::new(1.0, 2.0, 3.0), DVec3::new(1.0, 0.0, 3.0));
    let expected = [0.0 + 2.0 * 20.0 + 2.0 * 300.0, 2.0 + 10.0 + 300.0];
    let kernel = formula.kernel::<DVec3, [f64; 3], [f64; 2]>();
    assert_eq!(direct(&kernel, &[y], &[[1.0, 20.0, 300.0]], &[x]).unwrap(), [expected]);
    // The same as lists, with two right-hand sides, of which the second is twice the first.
    let kernel = formula.kernel::<DVec3, Vec<f64>, Vec<f64>>().with_columns(2);
    let charges = [vec![1.0, 2.0, 20.0, 40.0, 300.0, 600.0]];
    let sums = direct(&kernel, &[y], &charges, &[x]).unwrap();
    assert_eq!(sums, [vec![expected[0], 2.0 * expected[0], expected[1], 2.0 * expected[1]]]);
    // Gradients follow, axis by axis.
    let kernel = formula.kernel::<DVec3, [f64; 3], [f64; 2]>().gradient::<[f64; 8]>();
    let sum = direct(&kernel, &[y], &[[1.0, 20.0, 300.0]], &[x]).unwrap()[0];
    assert_eq!(sum, [expected[0], expected[1], 1.0, 300.0, 300.0, 1.0 - 5.0, 0.0, 0.0]);
    // Sizes that do not fit are refused.
    let kernel = formula.kernel::<DVec3, [f64; 2], [f64; 2]>();
    let error = direct(&kernel, &[y], &[[1.0; 2]], &[x]).unwrap_err().to_string();
    assert!(error.contains("a charge of this kernel has 3 numbers"), "{error}");
    let kernel = formula.kernel::<DVec3, [f64; 3], f64>();
    let error = direct(&kernel, &[y], &[[1.0; 3]], &[x]).unwrap_err().to_string();
    assert!(error.contains("a value of this kernel has 2 numbers"), "{error}");
    // The value at coincident points is on the diagonal, also where all entries are one expression.
    let kernel =
        TextFormula::new("[[1, 1], [1, 1]]", &[]).unwrap().coincident(Coincident::Value(3.0));
    let kernel = kernel.kernel::<DVec3, [f64; 2], [f64; 2]>();
    let sums = direct(&kernel, &[x, y], &[[1.0, 10.0], [100.0, 1000.0]], &[x]).unwrap();
    assert_eq!(sums, [[1103.0, 1130.0]]);
}

#[test]
fn what_is_not_chosen_does_no_harm() {
    let kernel = TextFormula::new("where(x1 > 0, sqrt(x1), 0)", &[]).unwrap();
    let kernel = kernel.kernel::<DVec3, f64, f64>().gradient::<[f64; 4]>();
    let sum = direct(&kernel, &[DVec3::X], &[1.0], &[DVec3::ZERO, DVec3::Y - DVec3::X]).unwrap();
    assert_eq!(sum, [[0.0; 4]; 2]);
    // One that is no number is seen, whichever side it is on.
    for text in ["min(1, sqrt(d1))", "min(sqrt(d1), 1)", "max(1, sqrt(d1))", "max(sqrt(d1), 1)"] {
        let kernel = formula(text).kernel::<DVec3, f64, f64>();
        let sum = direct(&kernel, &[DVec3::X], &[1.0], &[DVec3::ZERO]).unwrap();
        assert!(sum[0].is_nan(), "{text}");
    }
}

#[test]
fn quotients_that_are_compared_are_rounded_once() {
    // As cut-offs at the spacing of a lattice ask for: 49 · (1/49) < 1.
    let text = "where(r/k < 1, 1, 0) + where(r2/(k*k) >= 1, 2, 0) + where(1 == k/d1, 4, 0)";
    for k in 1..2000 {
        let k = f64::from(k);
        let kernel = TextFormula::new(text, &[("k", k)]).unwrap();
        let at = [DVec3::ZERO];
        let sum: Vec<f64> = direct(&kernel.kernel(), &at, &[1.0], &[DVec3::X * k]).unwrap();
        assert_eq!(sum, [6.0], "{k}");
        let kernel = kernel.kernel::<DVec3, f64, f64>().gradient::<[f64; 4]>();
        let sum = direct(&kernel, &at, &[1.0], &[DVec3::X * (0.5 * k)]).unwrap();
        assert_eq!(sum, [[1.0, 0.0, 0.0, 0.0]]);
    }
}

#[test]
fn closures_and_texts_are_interchangeable() {
    let at = points(50, 9);
    let charges = vec![1.0; 50];
    let closure = from_fn(|x: DVec3, y: DVec3| x.distance(y));
    let text: Vec<f64> = direct(&formula("r").kernel(), &at, &charges, &at).unwrap();
    let error = farfield::relative_l2_error(&text, &direct(&closure, &at, &charges, &at).unwrap());
    assert!(error < 1e-15, "{error:e}");
}

//! How fast kernels from text are summed directly, beside the same formula in Rust and beside a closure that calls
//! the standard library.
//!
//! ```sh
//! cargo run --release -p farfield-benches --example texts
//! ```

use std::time::Instant;

use farfield::{Kernel, direct, formula, from_fn, relative_l2_error};
use farfield_benches::clouds::{charges, even};
use farfield_formula::TextFormula;
use glam::DVec3;

/// Sources and targets of a sum: enough for blocks, few enough for caches.
const POINTS: usize = 4000;
/// The median of so many sums is taken.
const RUNS: usize = 7;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let points = even(POINTS);
    let charges = charges(POINTS);
    println!("nanoseconds per pair and thread of all, and their ratios to a Formula");
    println!(
        "{:<28} {:>7} {:>7} {:>8} {:>6} {:>8}",
        "", "Formula", "text", "closure", "text", "closure"
    );
    macro_rules! rows {
        ($($text:literal $formula:expr, $closure:expr;)*) => {$({
            let rust = $formula.skip_coincident();
            let text = TextFormula::new($text, &[])?.kernel();
            let closure = from_fn($closure).skip_coincident();
            row($text, &points, &charges, &rust, &text, &closure)?;
        })*};
    }
    rows! {
        "1/r" formula!(|d| d.length().recip()), |x: DVec3, y: DVec3| 1.0 / x.distance(y);
        "1/r^3" formula!(|d| d.length().powi(3).recip()), |x: DVec3, y: DVec3| x.distance(y).powi(-3);
        "exp(-2*r)/r" formula!(|d| (d.length() * -2.0).exp() / d.length()),
            |x: DVec3, y: DVec3| (-2.0 * x.distance(y)).exp() / x.distance(y);
        "exp(-4*r2)" formula!(|d| (d.length_squared() * -4.0).exp()),
            |x: DVec3, y: DVec3| (-4.0 * x.distance_squared(y)).exp();
        "(1 + 3*r)*exp(-3*r)" formula!(|d| (d.length() * 3.0 + 1.0) * (d.length() * -3.0).exp()),
            |x: DVec3, y: DVec3| (1.0 + 3.0 * x.distance(y)) * (-3.0 * x.distance(y)).exp();
        "sqrt(1 + r2)" formula!(|d| (d.length_squared() + 1.0).sqrt()),
            |x: DVec3, y: DVec3| (1.0 + x.distance_squared(y)).sqrt();
        "r2*log(r)" formula!(|d| d.length_squared() * d.length().ln()),
            |x: DVec3, y: DVec3| x.distance_squared(y) * x.distance(y).ln();
        "cos(5*r)/r" formula!(|d| (d.length() * 5.0).cos() / d.length()),
            |x: DVec3, y: DVec3| (5.0 * x.distance(y)).cos() / x.distance(y);
        "erfc(2*r)/r" formula!(|d| (d.length() * 2.0).erfc() / d.length()),
            |x: DVec3, y: DVec3| farfield::math::erfc(2.0 * x.distance(y)) / x.distance(y);
        "r^1.7" formula!(|d| d.length().powf(1.7)), |x: DVec3, y: DVec3| x.distance(y).powf(1.7);
    }
    Ok(())
}

fn row<F, T, C>(
    name: &str,
    points: &[DVec3],
    charges: &[f64],
    rust: &F,
    text: &T,
    closure: &C,
) -> Result<(), Box<dyn std::error::Error>>
where
    F: Summed,
    T: Summed,
    C: Summed,
{
    let exact = direct(rust, points, charges, points)?;
    for sums in [direct(text, points, charges, points)?, direct(closure, points, charges, points)?]
    {
        let error = relative_l2_error(&sums, &exact);
        if error > 1e-12 {
            return Err(format!("{name} is off by {error:.1e}").into());
        }
    }
    // One after the other, so that all see the same machine.
    let mut seconds = [Vec::new(), Vec::new(), Vec::new()];
    for _ in 0..RUNS {
        seconds[0].push(time(|| direct(rust, points, charges, points))?);
        seconds[1].push(time(|| direct(text, points, charges, points))?);
        seconds[2].push(time(|| direct(closure, points, charges, points))?);
    }
    let [rust, text, closure] = seconds.map(|mut seconds| {
        seconds.sort_by(f64::total_cmp);
        1e9 * seconds[RUNS / 2] / (POINTS * POINTS) as f64
    });
    let ratios = [text / rust, closure / rust];
    println!(
        "{name:<28} {rust:>7.3} {text:>7.3} {closure:>8.3} {:>6.2} {:>8.2}",
        ratios[0], ratios[1]
    );
    Ok(())
}

/// A real kernel between bare points.
trait Summed: Kernel<Real = f64, Source = DVec3, Target = DVec3, Charge = f64, Value = f64> {}

impl<K> Summed for K where
    K: Kernel<Real = f64, Source = DVec3, Target = DVec3, Charge = f64, Value = f64>
{
}

fn time<R, E>(work: impl FnOnce() -> Result<R, E>) -> Result<f64, E> {
    let start = Instant::now();
    work()?;
    Ok(start.elapsed().as_secs_f64())
}

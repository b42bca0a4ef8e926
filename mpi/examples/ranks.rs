//! A sum over the ranks of MPI, held against direct sums and, bit by bit, against ranks that are threads.
//!
//! ```sh
//! cargo build -p farfield-mpi --features mpi --example ranks
//! mpirun -n 3 target/debug/examples/ranks
//! ```

use farfield::glam::DVec3;
use farfield::{direct, from_fn, relative_l2_error};
use farfield_mpi::{DistributedFmm, Error, MpiTransport, Transport, on_threads};

const POINTS: usize = 3000;
const TOLERANCE: f64 = 1e-5;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let universe = mpi::initialize().ok_or("MPI has been initialised already")?;
    let ranks = MpiTransport::new(universe.world());
    let my_values = sums(&ranks)?;

    // Bits of all values, where one process can compare them.
    let bits: Vec<u64> = my_values.iter().map(|value| value.to_bits()).collect();
    let all = ranks.gather(&bits)?.concat();
    if ranks.rank() == 0 {
        let threads = on_threads(ranks.size(), |ranks| sums(ranks));
        let threads = threads.into_iter().collect::<Result<Vec<_>, Error>>()?.concat();
        assert!(
            threads.iter().map(|value| value.to_bits()).eq(all.iter().copied()),
            "the same bits"
        );
        let points = points(0..POINTS);
        let exact = direct(&kernel(), &points, &vec![1.0; POINTS], &points)?;
        let error = relative_l2_error(&threads, &exact);
        assert!(error <= TOLERANCE, "{error:e}");
        println!(
            "{POINTS} points on {} ranks: off by {error:.1e}, the bits of threads",
            ranks.size()
        );
    }
    // An error of one rank is that of all.
    let fmm = DistributedFmm::builder(kernel(), &ranks).build(&[DVec3::ZERO], &[DVec3::ZERO])?;
    let last = ranks.size() - 1;
    let charge = if ranks.rank() == last { f64::NAN } else { 1.0 };
    assert!(matches!(fmm.apply(&[charge]), Err(Error::Refused { rank, .. }) if rank == last));
    Ok(())
}

/// The sums at this rank's points.
fn sums(ranks: &dyn Transport) -> Result<Vec<f64>, Error> {
    let [first, last] = [ranks.rank(), ranks.rank() + 1].map(|rank| rank * POINTS / ranks.size());
    let my_points = points(first..last);
    let builder = DistributedFmm::builder(kernel(), ranks).tolerance(TOLERANCE);
    builder.build(&my_points, &my_points)?.apply(&vec![1.0; my_points.len()])
}

fn points(numbers: std::ops::Range<usize>) -> Vec<DVec3> {
    let steps = DVec3::new(0.754_877, 0.569_840, 0.362_719);
    numbers.map(|i| (steps * i as f64).fract()).collect()
}

fn kernel()
-> impl farfield::Kernel<Real = f64, Source = DVec3, Target = DVec3, Charge = f64, Value = f64> {
    from_fn(|x: DVec3, y: DVec3| 1.0 / x.distance(y)).skip_coincident()
}

//! The kernels, and the ways to sum each.

use std::rc::Rc;

use clap::ValueEnum;
use farfield::{Error, Interpolation, Kernel, Numbers, Point, Real, Scheme};
use farfield_benches::cli::Precision;
use farfield_potentials::{
    Exponent, HarmonicExpansion, MinusFour, MinusOne, PlusTwo, PowerLaw, squared_distance_sum,
};
use farfield_radiosity::{Irradiance, SixteenMoment};
use farfield_testing::clouds::half_width;
use farfield_testing::formulas::{
    anisotropic, anisotropic_gaussian, cube, gaussian, helmholtz, inverse_quadratic, log, matern,
    multiquadric, r_log_r, yukawa,
};
use farfield_testing::stokeslet::stokeslet;
use glam::DVec3;

use crate::placed::Placed;
use crate::problem::{Measured, Problem};

/// A kernel; r = |x − y|, and h is half the longest side of the cloud's bounding box.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum KernelName {
    /// 1/r
    #[value(name = "1/r")]
    InverseDistance,
    /// 1/r⁴
    #[value(name = "1/r4")]
    InverseFourth,
    /// r²
    #[value(name = "r2")]
    SquaredDistance,
    /// n_x·(d dᵀ/πr⁴) n_y, d = x − y, signed
    Radiosity,
    /// exp(−r/h)/r
    Yukawa,
    /// exp(−(r/h)²)
    Gaussian,
    /// log(r/h)
    Log,
    /// (r/h)³
    R3,
    /// exp(ikr)/r with kh = 3
    Helmholtz,
    /// 1/√((x − y)ᵀ M (x − y)), M full
    Anisotropic,
    /// Matérn's covariance of smoothness 5/2 and length h
    Matern,
    /// √(r² + h²/16)
    Multiquadric,
    /// r log(r/h)
    #[value(name = "r-log-r")]
    RLogR,
    /// 1/(1 + (r/h)²)
    InverseQuadratic,
    /// exp(−(x − y)ᵀ M (x − y)/h²), M full
    AnisotropicGaussian,
    /// 1/r + d dᵀ/r³, 3 × 3
    Stokeslet,
}

impl KernelName {
    /// Those of the chart of speed.
    pub(crate) const SPEED: [Self; 6] = [
        Self::InverseDistance,
        Self::InverseFourth,
        Self::SquaredDistance,
        Self::Radiosity,
        Self::Yukawa,
        Self::Gaussian,
    ];

    /// What charts call it.
    pub(crate) fn label(self) -> &'static str {
        match self {
            Self::InverseDistance => "1/r",
            Self::InverseFourth => "1/r⁴",
            Self::SquaredDistance => "r²",
            Self::Radiosity => "radiosity tensor",
            Self::Yukawa => "Yukawa",
            Self::Gaussian => "Gaussian",
            Self::Log => "log r",
            Self::R3 => "r³",
            Self::Helmholtz => "exp(ikr)/r",
            Self::Anisotropic => "anisotropic 1/r",
            Self::Matern => "Matérn 5/2",
            Self::Multiquadric => "multiquadric",
            Self::RLogR => "r log r",
            Self::InverseQuadratic => "1/(1 + r²)",
            Self::AnisotropicGaussian => "anisotropic Gaussian",
            Self::Stokeslet => "Stokeslet",
        }
    }
}

/// A way to sum.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Way {
    /// FMM, black-box interpolation
    Interpolation,
    /// FMM, solid harmonics
    Harmonic,
    /// FMM, 16 moments
    SixteenMoments,
    /// Treecode with interpolation
    InterpolationTreecode,
    /// Treecode with solid harmonics
    HarmonicTreecode,
    /// The kernel as a sum of products
    Separable,
    /// All pairs
    Direct,
}

impl Way {
    /// What charts call it.
    pub(crate) fn label(self) -> &'static str {
        match self {
            Self::Interpolation => "FMM, interpolation",
            Self::Harmonic => "FMM, harmonics",
            Self::SixteenMoments => "FMM, 16 moments",
            Self::InterpolationTreecode => "treecode, interpolation",
            Self::HarmonicTreecode => "treecode, harmonics",
            Self::Separable => "separable sum",
            Self::Direct => "direct sum",
        }
    }

    /// Whether an error can be asked for.
    pub(crate) fn asks(self) -> bool {
        !matches!(self, Self::Separable | Self::Direct)
    }
}

/// A way to sum one problem.
pub(crate) struct Method {
    /// Which.
    pub(crate) way: Way,
    run: Box<Run>,
}

/// From a tolerance and a number of repeats to what the sum took.
type Run = dyn Fn(f64, usize) -> Result<Measured, Error>;

impl Method {
    fn new(way: Way, run: impl Fn(f64, usize) -> Result<Measured, Error> + 'static) -> Self {
        Self { way, run: Box::new(run) }
    }

    /// Sums to a tolerance; without repeats, for the error alone.
    ///
    /// # Errors
    /// Those of the engine: the tolerance may be out of reach.
    pub(crate) fn run(&self, tolerance: f64, repeats: usize) -> Result<Measured, Error> {
        (self.run)(tolerance, repeats)
    }
}

/// All ways to sum a kernel over a cloud, judged at about so many targets; none if the kernel is not
/// there in this precision.
pub(crate) fn methods(
    kernel: KernelName,
    precision: Precision,
    cloud: &[DVec3],
    samples: usize,
) -> Option<Vec<Method>> {
    use KernelName as N;
    use Precision::{F32, F64};
    // Rounded, so that both precisions have the same kernel.
    let single = half_width(cloud) as f32;
    let h = f64::from(single);
    let at = (cloud, samples);
    Some(match (kernel, precision) {
        (N::InverseDistance, F32) => power_law::<MinusOne, f32>(at),
        (N::InverseDistance, F64) => power_law::<MinusOne, f64>(at),
        (N::InverseFourth, F32) => power_law::<MinusFour, f32>(at),
        (N::InverseFourth, F64) => power_law::<MinusFour, f64>(at),
        (N::SquaredDistance, F32) => squared_distance::<f32>(at),
        (N::SquaredDistance, F64) => squared_distance::<f64>(at),
        (N::Radiosity, F32) => radiosity::<f32>(at),
        (N::Radiosity, F64) => radiosity::<f64>(at),
        (N::Yukawa, F32) => by_points(&problem(yukawa(single), &yukawa(h), at)),
        (N::Yukawa, F64) => own_judge(yukawa(h), at),
        (N::Gaussian, F32) => by_points(&problem(gaussian(single), &gaussian(h), at)),
        (N::Gaussian, F64) => own_judge(gaussian(h), at),
        (_, F32) => return None,
        (N::Log, F64) => own_judge(log(h), at),
        (N::R3, F64) => own_judge(cube(h), at),
        (N::Helmholtz, F64) => own_judge(helmholtz(h), at),
        (N::Anisotropic, F64) => own_judge(anisotropic(), at),
        (N::Matern, F64) => own_judge(matern(h), at),
        (N::Multiquadric, F64) => own_judge(multiquadric(h), at),
        (N::RLogR, F64) => own_judge(r_log_r(h), at),
        (N::InverseQuadratic, F64) => own_judge(inverse_quadratic(h), at),
        (N::AnisotropicGaussian, F64) => own_judge(anisotropic_gaussian(h), at),
        (N::Stokeslet, F64) => own_judge(stokeslet(), at),
    })
}

/// A cloud, and how many targets are judged.
type At<'a> = (&'a [DVec3], usize);

/// A kernel whose sums this example can make, over points that it can make.
trait Summed<P: Placed>: Kernel<Source = P, Target = P> + Copy + 'static {}

impl<P: Placed, K> Summed<P> for K where K: Kernel<Source = P, Target = P> + Copy + 'static {}

fn problem<P, K, J>(kernel: K, judge: &J, (cloud, samples): At) -> Rc<Problem<K>>
where
    P: Placed,
    K: Summed<P>,
    J: Kernel<Real = f64, Source = P::Wide, Target = P::Wide>,
    J::Charge: Numbers<Real = f64>,
    J::Value: Numbers<Real = f64>,
{
    Rc::new(Problem::new(kernel, judge, cloud, samples))
}

fn own_judge<K: Summed<DVec3> + Kernel<Real = f64>>(kernel: K, at: At) -> Vec<Method> {
    by_points(&problem(kernel, &kernel, at))
}

/// What any kernel can do.
fn by_points<P: Placed, K: Summed<P>>(problem: &Rc<Problem<K>>) -> Vec<Method> {
    let interpolated = |way, scheme| {
        let problem = Rc::clone(problem);
        Method::new(way, move |tolerance, repeats| {
            let make = || Ok(Interpolation::new(problem.kernel).tolerance(tolerance));
            problem.measure(scheme, make, repeats)
        })
    };
    let direct = Rc::clone(problem);
    vec![
        Method::new(Way::Direct, move |_, _| Ok(direct.directly())),
        interpolated(Way::Interpolation, Scheme::Fmm),
        interpolated(Way::InterpolationTreecode, Scheme::Treecode { m2m: true }),
    ]
}

fn power_law<E: Exponent, T: Real>(at: At) -> Vec<Method>
where
    Point<T>: Placed<Wide = DVec3>,
{
    harmonics(&problem(PowerLaw::<E, T>::new(), &PowerLaw::<E, f64>::new(), at))
}

fn harmonics<E: Exponent, T: Real>(problem: &Rc<Problem<PowerLaw<E, T>>>) -> Vec<Method>
where
    Point<T>: Placed,
{
    let harmonic = |way, scheme| {
        let problem = Rc::clone(problem);
        Method::new(way, move |tolerance, repeats| {
            let make = || HarmonicExpansion::with_tolerance(problem.kernel, tolerance);
            problem.measure(scheme, make, repeats)
        })
    };
    let mut methods = by_points(problem);
    methods.push(harmonic(Way::Harmonic, Scheme::Fmm));
    methods.push(harmonic(Way::HarmonicTreecode, Scheme::Treecode { m2m: true }));
    methods
}

fn squared_distance<T: Real>(at: At) -> Vec<Method>
where
    Point<T>: Placed<Wide = DVec3>,
{
    let problem = problem(PowerLaw::<PlusTwo, T>::new(), &PowerLaw::<PlusTwo, f64>::new(), at);
    let mut methods = harmonics(&problem);
    methods.push(Method::new(Way::Separable, move |_, repeats| {
        problem
            .without_plan(|points, charges| squared_distance_sum(points, charges, points), repeats)
    }));
    methods
}

fn radiosity<T: Real>(at: At) -> Vec<Method> {
    let problem = problem(Irradiance::<T>::signed(), &Irradiance::<f64>::signed(), at);
    let mut methods = by_points(&problem);
    methods.push(Method::new(Way::SixteenMoments, move |tolerance, repeats| {
        let make = || SixteenMoment::with_tolerance(problem.kernel, tolerance);
        let measured = problem.measure(Scheme::Fmm, make, repeats)?;
        Ok(Measured { terms: 16 * measured.terms, ..measured })
    }));
    methods
}

//! Plans over points that are repeated.

use std::fmt;

use crate::error::{Error, PointSet};
use crate::expansion::Expansion;
use crate::interpolation::black_box::Interpolation;
use crate::interpolation::entries::Entries;
use crate::interpolation::probe::translation_invariant;
use crate::kernel::mask::Unmasked;
use crate::kernel::traits::Kernel;
use crate::numbers::traits::{Movable, Numbers, Point, Real, Scalar, Vector};
use crate::octree::geometry::Cube;
use crate::parallel;
use crate::periodic::lattice::Lattice;
use crate::periodic::operator::Operator;
use crate::periodic::summed::Summed;
use crate::plan::builder::Builder;
use crate::plan::fmm::{Fmm, check_values};
use crate::plan::report::Report;

/// Starts a [`Periodic`] plan: see [`Builder::periodic`].
#[must_use = "call `build`"]
pub struct PeriodicBuilder<'a, K: Kernel> {
    near: Builder<'a, Interpolation<K>, Unmasked>,
    periods: [Option<K::Real>; 3],
}

/// A plan for sums over sources that are repeated along some axes, u(x_i) = Σ_n Σ_j K(x_i − y_j − n L) q_j over all integer
/// vectors n with zeros where there is no period.
///
/// Any kernel of the difference x − y will do. The images around the box, 27 boxes for a cube, are sources of an
/// [`Fmm`]. All others act as a smooth field in the box, which the plan finds by sums over blocks of images that grow
/// threefold, and checks: the sum over all images has to be periodic.
///
/// # What the sums are
///
/// * Where Σ_n K converges for the kernel alone, as Yukawa's does, they are that sum.
/// * Where it does not, but does for [neutral](Self::needs_neutral) charges, they are that: 1/r along one, two or three
///   axes, or log r along one. Other charges are refused.
/// * Where they depend on the order in which images are added, as for 1/r in three axes if the box has a dipole moment D,
///   they are those that do not depend on where the box is cut: the periodic ones, of Ewald's method with a conductor
///   (tin foil) around. For a cube of such boxes in vacuum, of volume V each, add (4π/3V) D·x − (2π/3V) Σ_j q_j |y_j|².
/// * Where even these don't exist, as for waves, the kernel is refused.
///
/// # Cost
///
/// The plan has as many sources as the near images together: 3^D N in a box whose edges are much the same, for D periodic
/// axes, and more if one period is shorter than another edge. Set-up evaluates the kernel some ten million times, whatever
/// the number of points, and eight times as often if its entries change more than signs under reflections of the axes. An
/// application costs that of the [`Fmm`], and O(N) for some hundred products of polynomials.
///
/// ```
/// use farfield::{Fmm, formula};
///
/// // Rock salt: each ion is at the potential −1.747… over the distance to the nearest.
/// let ions: Vec<[f64; 3]> = (0..8).map(|i| [i / 4, i / 2 % 2, i % 2].map(f64::from)).collect();
/// let charges: Vec<f64> = ions.iter().map(|[x, y, z]| if (x + y + z) % 2.0 == 0.0 { 1.0 } else { -1.0 }).collect();
/// let kernel = formula!(|d| d.length().recip()).skip_coincident();
/// let fmm = Fmm::builder(kernel).tolerance(1e-6).periodic([Some(2.0); 3]).build(&ions, &ions)?;
/// for (potential, charge) in fmm.apply(&charges)?.iter().zip(&charges) {
///     assert!((potential * charge + 1.747_564_594_633).abs() < 1e-5);
/// }
/// # Ok::<(), farfield::Error>(())
/// ```
pub struct Periodic<K: Kernel> {
    near: Fmm<Interpolation<K>>,
    /// None without periods.
    far: Option<Operator<K::Entry>>,
    sources: Vec<K::Source>,
    targets: Vec<K::Target>,
    /// How many images are near.
    images: usize,
    needs_neutral: bool,
    /// Net charges up to this share of all are rounding.
    net: f64,
}

impl<'a, K: Kernel> Builder<'a, Interpolation<K>, Unmasked> {
    /// Repeats the sources with a period along each axis that has one: see [`Periodic`].
    ///
    /// The box lies where the points are. Along an axis with a period, all of them lie within one period of the least of
    /// their coordinates. Only kernels are repeated, not masks.
    pub fn periodic(self, periods: [Option<K::Real>; 3]) -> PeriodicBuilder<'a, K> {
        PeriodicBuilder { near: self, periods }
    }
}

impl<K: Kernel<Source: Movable>> PeriodicBuilder<'_, K> {
    /// Builds the plan.
    ///
    /// # Errors
    /// Those of [`Builder::build`]; [`Error::InvalidPeriod`]; [`Error::OutsidePeriod`] for a point that is farther than a
    /// period from another; [`Error::TooManyImages`] for a box that is very flat or very long; [`Error::PositionDependent`] if the kernel is not one of the difference; [`Error::DivergentImages`]
    /// if there is no sum over its images, and [`Error::UnreachableTolerance`] if it is not known well enough.
    pub fn build(self, sources: &[K::Source], targets: &[K::Target]) -> Result<Periodic<K>, Error> {
        let Self { near, periods } = self;
        let kernel = near.expansion.kernel();
        kernel.check_sizes()?;
        let periods = periods.map(|period| period.map(Real::as_f64));
        let lattice = Lattice::new(periods, sources, targets)?;
        let accuracy = near.expansion.costs(2).pair_tolerance / PAIR_SHARE;
        let tolerance = if accuracy > 0.0 { accuracy } else { ALL_DIGITS };
        let (mut far, mut needs_neutral) = (None, false);
        if lattice.dimensions() > 0 {
            check_invariance(kernel, &lattice)?;
            let images = Summed { kernel, lattice: &lattice }.images(tolerance)?;
            needs_neutral = images.needs_neutral;
            far = Some(Operator::new(&lattice, &images, tolerance));
        }
        let places = lattice.near_places();
        let (limit, found) = (u32::MAX as usize / 2, sources.len().saturating_mul(places.len()));
        if found > limit {
            return Err(Error::TooManyPoints { set: PointSet::Sources, limit, found });
        }
        let all = parallel::map_many(found, &|i| {
            let place = places[i / sources.len()].map(K::Real::from_f64);
            sources[i % sources.len()].moved_by(Point::<K::Real>::from_array(place))
        });
        let near = near.build(&all, targets)?;
        let rounding = 64.0 * <K::Real as num_traits::Float>::epsilon().as_f64();
        Ok(Periodic {
            near,
            far,
            sources: sources.to_vec(),
            targets: targets.to_vec(),
            images: places.len(),
            needs_neutral,
            net: rounding.max(NET_SHARE * tolerance),
        })
    }
}

impl<K: Kernel> Periodic<K> {
    /// The sums at all targets, in the caller's order, to the tolerance that [`Fmm::apply`] promises, relative to what
    /// near images send.
    ///
    /// # Errors
    /// Those of [`Fmm::apply`], and [`Error::NotNeutral`] if charges must add up to zero and do not.
    pub fn apply(&self, charges: &[K::Charge]) -> Result<Vec<K::Value>, Error> {
        let kernel = self.near.expansion().kernel();
        let (expected, found) = (self.sources.len(), charges.len());
        if expected != found {
            return Err(Error::LengthMismatch { what: "charges", expected, found });
        }
        let of_image = |i: usize| charges[i % found].clone();
        let repeated = parallel::map_many(found * self.images, &of_image);
        // What is wrong with a charge is wrong with the first of its images.
        self.near.check_charges(&repeated)?;
        self.check_neutral(charges)?;
        let mut values = self.near.apply(&repeated)?;
        if let Some(far) = &self.far {
            far.add(kernel, (&self.sources, charges), &self.targets, &mut values);
        }
        check_values(&values)?;
        Ok(values)
    }

    /// Whether charges have to add up to zero: density by density, in every column.
    pub fn needs_neutral(&self) -> bool {
        self.needs_neutral
    }

    /// The images, the box among them, that are sources of the plan one by one.
    pub fn near_images(&self) -> usize {
        self.images
    }

    /// A report on the plan for what is near. O(cells).
    pub fn report(&self) -> Report {
        self.near.report()
    }

    fn check_neutral(&self, charges: &[K::Charge]) -> Result<(), Error> {
        if !self.needs_neutral {
            return Ok(());
        }
        let kernel = self.near.expansion().kernel();
        let mut sent = vec![<K::Entry as Numbers>::zero(); kernel.densities() * kernel.columns()];
        let mut sums = vec![([0.0; 2], 0.0); sent.len()];
        for (y, q) in self.sources.iter().zip(charges) {
            kernel.density(y, q, &mut sent);
            for ((net, all), density) in sums.iter_mut().zip(&sent) {
                let parts = density.parts().map(Real::as_f64);
                net.iter_mut().zip(parts).for_each(|(net, part)| *net += part);
                *all += parts[0].hypot(parts[1]);
            }
        }
        for (density, (net, all)) in sums.into_iter().enumerate() {
            let net = net[0].hypot(net[1]);
            if net > self.net * all {
                return Err(Error::NotNeutral { density, net, all });
            }
        }
        Ok(())
    }
}

/// The share of the tolerance that a pair has, by which the tolerance is known.
const PAIR_SHARE: f64 = crate::interpolation::budget::PAIR_SHARE;

/// The tolerance where an order is given instead.
const ALL_DIGITS: f64 = 1e-9;

/// The share of the tolerance that a net charge may make up.
const NET_SHARE: f64 = 0.01;

/// Refuses a kernel that is not one of the difference.
fn check_invariance<K: Kernel>(kernel: &K, lattice: &Lattice) -> Result<(), Error> {
    let centre = Point::<K::Real>::from_array(lattice.centre.map(K::Real::from_f64));
    let half = lattice.half_widths.into_iter().fold(0.0, f64::max);
    let root = Cube::new(centre, K::Real::from_f64(half));
    let block = |xs: &[Point<K::Real>], ys: &[Point<K::Real>], g: &mut [K::Entry]| {
        kernel.entries_block(xs, ys, g);
    };
    let entries = Entries::new(kernel.fields(), kernel.densities(), &block);
    if translation_invariant(&entries, &root) { Ok(()) } else { Err(Error::PositionDependent) }
}

impl<K: Kernel> fmt::Debug for PeriodicBuilder<'_, K> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PeriodicBuilder")
            .field("near", &self.near)
            .field("periods", &self.periods)
            .finish()
    }
}

impl<K: Kernel> fmt::Debug for Periodic<K> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Periodic")
            .field("near", &self.near)
            .field("images", &self.images)
            .field("needs_neutral", &self.needs_neutral)
            .finish_non_exhaustive()
    }
}

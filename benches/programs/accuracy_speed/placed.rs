//! What can be summed over at any points: sources and targets, charges and values.

use farfield::{Located, Numbers, Real};
use farfield_radiosity::Surfel;
use glam::{DVec3, Vec3};

/// Something that acts and is acted upon, made from a position alone.
pub(crate) trait Placed: Located {
    /// The same in double precision.
    type Wide: Placed<Real = f64>;
    /// The `index`-th of all, at about this position.
    fn at(position: DVec3, index: usize) -> Self;
    /// The same in double precision.
    fn widened(&self) -> Self::Wide;
}

/// Puts numbers into charges, each rounded to the precision.
pub(crate) fn charges<T: Real, C: Numbers<Real = T>>(numbers: &[f64]) -> Vec<C> {
    let charge = |numbers: &[f64]| {
        let mut charge = C::zero();
        for (i, &number) in numbers.iter().enumerate() {
            charge.set(i, T::from_f64(number));
        }
        charge
    };
    numbers.chunks_exact(C::LEN).map(charge).collect()
}

/// The numbers in charges or values.
pub(crate) fn numbers<'a, T: Real, C: Numbers<Real = T>>(
    of: impl IntoIterator<Item = &'a C>,
) -> Vec<f64> {
    of.into_iter().flat_map(|c| (0..C::LEN).map(|i| c.get(i).as_f64())).collect()
}

impl Placed for DVec3 {
    type Wide = Self;

    fn at(position: DVec3, _index: usize) -> Self {
        position
    }

    fn widened(&self) -> Self {
        *self
    }
}

impl Placed for Vec3 {
    type Wide = DVec3;

    fn at(position: DVec3, _index: usize) -> Self {
        position.as_vec3()
    }

    fn widened(&self) -> DVec3 {
        self.as_dvec3()
    }
}

impl<T: Real> Placed for Surfel<T> {
    type Wide = Surfel<f64>;

    fn at(position: DVec3, index: usize) -> Self {
        // Normals that point anywhere: z and the angle are multiples of irrational numbers.
        let z = 2.0 * (0.618_033_988_749_894_9 * index as f64).fract() - 1.0;
        let (sin, cos) =
            (std::f64::consts::TAU * (0.754_877_666_246_692_7 * index as f64)).sin_cos();
        let r = (1.0 - z * z).sqrt();
        let normal = DVec3::new(r * cos, r * sin, z);
        Surfel { position, normal, area: 1.0, face: Surfel::<f64>::NO_FACE }.cast()
    }

    fn widened(&self) -> Surfel<f64> {
        self.cast()
    }
}

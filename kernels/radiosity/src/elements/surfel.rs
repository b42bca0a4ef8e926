//! Surface elements, and the one rule for whether two of them face each other.

use farfield::{Located, Point, Real, Vector};

use crate::error::Error;

/// A small flat piece of surface: what exchanges light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surfel<T: Real = f64> {
    /// Its centroid.
    pub position: Point<T>,
    /// Unit normal on the side that radiates and receives.
    pub normal: Point<T>,
    /// Its area, in squared scene units.
    pub area: T,
    /// The occluder face that it lies on, which never hides it; [`NO_FACE`](Self::NO_FACE) if none.
    pub face: u32,
}

impl<T: Real> Surfel<T> {
    /// The face of a surfel that lies on no occluder.
    pub const NO_FACE: u32 = u32::MAX;

    /// The same surfel in another precision.
    pub fn cast<U: Real>(&self) -> Surfel<U> {
        let cast =
            |p: Point<T>| Point::<U>::from_array(p.to_array().map(|c| U::from_f64(c.as_f64())));
        Surfel {
            position: cast(self.position),
            normal: cast(self.normal),
            area: U::from_f64(self.area.as_f64()),
            face: self.face,
        }
    }
}

impl<T: Real> Located for Surfel<T> {
    type Real = T;

    #[inline(always)]
    fn position(&self) -> Point<T> {
        self.position
    }
}

/// The geometry of one pair, receiver x and source y: all that the kernel and the facing rule need.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projections<T> {
    /// −n_x·(x − y) = r cos θ_x.
    pub receiver: T,
    /// n_y·(x − y) = r cos θ_y.
    pub source: T,
    /// r² = |x − y|².
    pub distance_squared: T,
    /// The larger of the two areas.
    pub area: T,
}

/// Surfels closer than this, r²/A, are no points to each other: the kernel is larger there than any sum of
/// it could be rounded for, and says nothing about what the two exchange.
pub(crate) const CLOSEST: f64 = 1e-3;

impl<T: Real> Projections<T> {
    /// Those of receiver `x` and source `y`. Swapping the two swaps the projections, bit for bit.
    #[inline(always)]
    pub fn new(x: &Surfel<T>, y: &Surfel<T>) -> Self {
        let d = x.position - y.position;
        Self {
            receiver: -x.normal.dot(d),
            source: y.normal.dot(d),
            distance_squared: d.length_squared(),
            area: x.area.max(y.area),
        }
    }

    /// Whether the two face each other as points: cos θ_x > √ε and cos θ_y > √ε, ε the unit round-off, and
    /// r² > A/1000, A the larger area.
    ///
    /// The first threshold lies far above the rounding of positions and normals, so that surfels of one
    /// plane never see each other by accident, and far below any cosine that matters. The second keeps out
    /// what coincides, such as the two sides of one sheet. What two surfels exchange that are so close and
    /// look at each other all the same is left to [`Corrections`](crate::Corrections).
    #[inline(always)]
    pub fn facing(&self) -> bool {
        self.distance_squared > T::from_f64(CLOSEST) * self.area && self.in_front()
    }

    /// Whether they face each other, however close they are.
    #[inline(always)]
    pub(crate) fn in_front(&self) -> bool {
        let zero = T::from_f64(0.0);
        let threshold = T::epsilon() * self.distance_squared;
        self.receiver > zero
            && self.source > zero
            && self.receiver * self.receiver > threshold
            && self.source * self.source > threshold
    }

    /// cos θ_x cos θ_y / (π r²), negative where exactly one of the two looks away. Undefined at r = 0.
    #[inline(always)]
    pub fn kernel(&self) -> T {
        let r2 = self.distance_squared;
        // One division by r² per factor: r⁴ itself would underflow for small scenes.
        (self.receiver / r2) * (self.source / r2) * T::FRAC_1_PI()
    }
}

/// How far apart surfels of these areas are at least, to [face](Projections::facing) each other.
pub(crate) fn closest<T: Real>(surfels: &[Surfel<T>]) -> T {
    let largest = surfels.iter().fold(T::from_f64(0.0), |most, surfel| most.max(surfel.area));
    (T::from_f64(CLOSEST) * largest).sqrt()
}

/// Checks that positions are finite, normals unit vectors and areas positive.
///
/// # Errors
/// [`Error::InvalidPosition`], [`Error::InvalidNormal`] or [`Error::InvalidArea`] for the first
/// surfel that is invalid. The squared length of a normal may differ from 1 by the square root of the
/// round-off unit.
pub fn check_surfels<T: Real>(surfels: &[Surfel<T>]) -> Result<(), Error> {
    for (index, surfel) in surfels.iter().enumerate() {
        let position = surfel.position.to_array().map(T::as_f64);
        if position.iter().any(|c| !c.is_finite()) {
            return Err(Error::InvalidPosition { index, position });
        }
        let normal = surfel.normal.to_array().map(T::as_f64);
        let length_squared: f64 = normal.iter().map(|c| c * c).sum();
        let unit = (length_squared - 1.0).abs() <= T::epsilon().as_f64().sqrt();
        if !unit {
            return Err(Error::InvalidNormal { index, normal });
        }
        let area = surfel.area.as_f64();
        if !(area > 0.0 && area.is_finite()) {
            return Err(Error::InvalidArea { index, area });
        }
    }
    Ok(())
}

/// Checks that every reflectance lies in [0, 1], band by band. 1 is that of a surface that gives back all it
/// receives, an adiabatic one: where all are such, there may be no solution.
///
/// # Errors
/// [`Error::InvalidReflectance`] for the first that doesn't.
pub fn check_reflectance<T: Real, const BANDS: usize>(
    reflectance: &[[T; BANDS]],
) -> Result<(), Error> {
    match first_band(reflectance, |rho| (0.0..=1.0).contains(&rho)) {
        Some((index, band, found)) => Err(Error::InvalidReflectance { index, band, found }),
        None => Ok(()),
    }
}

/// Checks that every emission is finite and not negative, band by band.
///
/// # Errors
/// [`Error::InvalidEmission`] for the first that isn't.
pub fn check_emission<T: Real, const BANDS: usize>(emission: &[[T; BANDS]]) -> Result<(), Error> {
    match first_band(emission, |e| e.is_finite() && e >= 0.0) {
        Some((index, band, found)) => Err(Error::InvalidEmission { index, band, found }),
        None => Ok(()),
    }
}

/// Row, band and value of the first entry that isn't `valid`.
fn first_band<T: Real, const BANDS: usize>(
    rows: &[[T; BANDS]],
    valid: impl Fn(f64) -> bool,
) -> Option<(usize, usize, f64)> {
    rows.iter().enumerate().find_map(|(index, row)| {
        let bad = row.iter().map(|v| v.as_f64()).enumerate().find(|&(_, v)| !valid(v));
        bad.map(|(band, found)| (index, band, found))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn surfel(position: DVec3, normal: DVec3) -> Surfel {
        Surfel { position, normal, area: 1.0, face: Surfel::<f64>::NO_FACE }
    }

    #[test]
    fn surfels_of_an_oblique_plane_never_face_each_other() {
        let normal = DVec3::new(1.0, 2.0, 3.0).normalize();
        let (u, v) = normal.any_orthonormal_pair();
        let origin = DVec3::new(-31.7, 812.3, 5.1);
        let on_plane = |i: usize| {
            let (a, b) = ((i as f64 * 0.618).fract() * 500.0, (i as f64 * 0.755).fract() * 500.0);
            surfel(origin + u * a + v * b, normal)
        };
        let mut rounded_up = 0;
        for i in 0..100 {
            for j in 0..100 {
                let pair = Projections::new(&on_plane(i), &on_plane(j));
                assert!(!pair.facing());
                let back = surfel(on_plane(j).position, -normal);
                let two_sided = Projections::new(&on_plane(i), &back);
                assert!(!two_sided.facing());
                rounded_up += usize::from(two_sided.receiver > 0.0 && two_sided.source > 0.0);
            }
        }
        assert!(rounded_up > 0, "the rule is only tested where rounding alone would say yes");
    }

    #[test]
    fn facing_is_symmetric_and_excludes_coincident_points() {
        let x = surfel(DVec3::new(0.1, 0.2, 1.0), DVec3::NEG_Z);
        let y = surfel(DVec3::new(0.7, -0.2, 0.0), DVec3::Z);
        let pair = Projections::new(&x, &y);
        let swapped = Projections::new(&y, &x);
        assert!(pair.facing() && swapped.facing());
        assert_eq!((pair.receiver, pair.source), (swapped.source, swapped.receiver));
        assert!(!Projections::new(&x, &x).facing());
    }

    #[test]
    fn the_two_sides_of_one_place_do_not_face_each_other() {
        // Centroids that rounding has set apart by less than the surfels are large.
        let x = surfel(DVec3::ZERO, DVec3::Z);
        for gap in [1e-17, 1e-9, 0.03] {
            let y = surfel(DVec3::Z * gap, DVec3::NEG_Z);
            let pair = Projections::new(&x, &y);
            assert!(pair.in_front() && !pair.facing(), "{gap}");
            // Of a surfel that is small enough they are points.
            let [x, y] = [x, y].map(|s| Surfel { area: gap * gap, ..s });
            assert!(Projections::new(&x, &y).facing(), "{gap}");
        }
        assert_eq!(closest(&[x, Surfel { area: 0.1, ..x }]), 1e-3f64.sqrt());
    }

    #[test]
    fn checks_name_the_surfel_and_the_band() {
        let good = surfel(DVec3::ZERO, DVec3::X);
        assert_eq!(check_surfels(&[good]), Ok(()));
        let long = surfel(DVec3::ZERO, DVec3::X * 1.001);
        let normal = [1.001, 0.0, 0.0];
        assert_eq!(check_surfels(&[good, long]), Err(Error::InvalidNormal { index: 1, normal }));
        for normal in [DVec3::ZERO, DVec3::NAN, DVec3::INFINITY] {
            assert!(check_surfels(&[surfel(DVec3::ZERO, normal)]).is_err());
        }
        for area in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(check_surfels(&[Surfel { area, ..good }]).is_err());
        }
        let nowhere = surfel(DVec3::NAN, DVec3::X);
        assert!(matches!(check_surfels(&[nowhere]), Err(Error::InvalidPosition { index: 0, .. })));

        let reflectance = [[0.0, 1.0], [0.3, 1.01]];
        let error = Error::InvalidReflectance { index: 1, band: 1, found: 1.01 };
        assert_eq!(check_reflectance(&reflectance), Err(error));
        let error = Error::InvalidEmission { index: 0, band: 1, found: -1.0 };
        assert_eq!(check_emission(&[[0.0, -1.0]]), Err(error));
        assert!(
            check_reflectance(&[[f64::NAN]]).is_err() && check_emission(&[[f64::NAN]]).is_err()
        );
        assert!(check_emission(&[[7.0, 0.0]]).is_ok());
    }

    #[test]
    fn a_cast_keeps_everything() {
        let x = Surfel { face: 7, ..surfel(DVec3::new(0.5, 1.0, -2.0), DVec3::Y) };
        assert_eq!(x.cast::<f32>().cast::<f64>(), x);
    }
}

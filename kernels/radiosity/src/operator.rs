//! From the radiosity of all elements to their irradiance: a fast sum over centroids, what near
//! elements change in it, and what closes it.

use crate::corrections::Corrections;
use crate::element::Element;
use crate::error::Error;

/// H = A⁻¹ D (A K + C) D: the irradiance of elements by their radiosity, all bands in one pass.
///
/// K is a sum over centroids (any fast sum of [`Irradiance`](crate::Irradiance) over
/// [`Element::surfel`]s), C its [`Corrections`], A the areas, D the scaling that
/// [`close`](Self::close) finds; without it D = 1.
///
/// ```
/// use farfield::Fmm;
/// use farfield_radiosity::{Corrections, Irradiance, Occluders, RadiosityOperator, Visibility, furnace};
///
/// let room = furnace(6);
/// let occluders = Occluders::new(&room.triangles)?;
/// let mask = Visibility::new(&occluders);
/// let kernel = Irradiance::<f64, [f64; 3]>::clamped();
/// let fmm = Fmm::builder(kernel).mask(&mask).tolerance(1e-3).build(&room.surfels, &room.surfels)?;
/// let corrections = Corrections::new(&room.elements, &occluders, 1e-3)?;
/// let operator = RadiosityOperator::new(&room.elements, |b| fmm.apply(b), corrections)?;
/// // In a closed room, whatever radiates 1 receives 1.
/// assert!(operator.row_sums()?.iter().all(|s| (s - 1.0).abs() < 4e-3));
/// # Ok::<(), farfield_radiosity::Error>(())
/// ```
pub struct RadiosityOperator<'a, const BANDS: usize> {
    sum: Box<Sum<'a, BANDS>>,
    corrections: Corrections,
    areas: Vec<f64>,
    /// D; empty if it is 1.
    scaling: Vec<f64>,
}

type Sum<'a, const BANDS: usize> =
    dyn Fn(&[[f64; BANDS]]) -> Result<Vec<[f64; BANDS]>, farfield::Error> + Sync + 'a;

/// The size of the corrections that [`RadiosityOperator::close`] made.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Closure {
    /// The largest |d_i d_j − 1|, at most: the largest relative change of a form factor.
    pub largest: f64,
    /// The root mean square of d_i² − 1 over the area.
    pub rms: f64,
}

/// What is known of the surfaces as a whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Enclosure {
    /// They close a room: all light that leaves one arrives at others, so rows sum to 1.
    Closed,
    /// Light may escape: rows sum to 1 at most.
    Open,
}

/// Iterations of the scaling; each takes one sum.
const SCALINGS: usize = 20;

impl<'a, const BANDS: usize> RadiosityOperator<'a, BANDS> {
    /// The operator of `elements` by `sum`, from radiosities to irradiances by centroids, such as
    /// `|b| fmm.apply(b)`.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`] if `corrections` are those of another number of elements.
    pub fn new(
        elements: &[Element],
        sum: impl Fn(&[[f64; BANDS]]) -> Result<Vec<[f64; BANDS]>, farfield::Error> + Sync + 'a,
        corrections: Corrections,
    ) -> Result<Self, Error> {
        let (expected, found) = (elements.len(), corrections.len());
        if found != expected {
            return Err(Error::LengthMismatch { what: "corrections", expected, found });
        }
        let areas = elements.iter().map(|element| element.surfel().area).collect();
        Ok(Self { sum: Box::new(sum), corrections, areas, scaling: Vec::new() })
    }

    /// The irradiance H of each element for radiosities B, in the same units.
    ///
    /// # Errors
    /// Those of the sum.
    pub fn apply(&self, radiosity: &[[f64; BANDS]]) -> Result<Vec<[f64; BANDS]>, Error> {
        let scaled = self.scaled(radiosity);
        let mut irradiance = (self.sum)(&scaled)?;
        self.corrections.add(&scaled, &mut irradiance);
        Ok(match self.scaling.is_empty() {
            true => irradiance,
            false => self.scaled(&irradiance),
        })
    }

    /// The share of each element's light that arrives at others, Σ_j F_ij: its irradiance when all
    /// radiate 1. One sum.
    ///
    /// # Errors
    /// Those of the sum.
    pub fn row_sums(&self) -> Result<Vec<f64>, Error> {
        Ok(self.apply(&vec![[1.0; BANDS]; self.areas.len()])?.iter().map(|h| h[0]).collect())
    }

    /// |⟨w, A H v⟩ − ⟨A H w, v⟩| / (‖w‖ ‖A H v‖) for two vectors of random signs: how far the exchange is
    /// from reciprocal, A_i F_ij = A_j F_ji. Two sums.
    ///
    /// # Errors
    /// Those of the sum.
    pub fn reciprocity_error(&self) -> Result<f64, Error> {
        let signs = |start: u64| {
            let sign = |i: usize| if mixed(start + i as u64) & 1 == 0 { 1.0 } else { -1.0 };
            (0..self.areas.len()).map(sign).collect::<Vec<f64>>()
        };
        let (v, w) = (signs(0), signs(1 << 40));
        let received = |b: &[f64]| -> Result<Vec<f64>, Error> {
            let columns: Vec<_> = b.iter().map(|&b| [b; BANDS]).collect();
            let h = self.apply(&columns)?;
            Ok(h.iter().zip(&self.areas).map(|(h, area)| area * h[0]).collect())
        };
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let (hv, hw) = (received(&v)?, received(&w)?);
        let size = dot(&w, &w).sqrt() * dot(&hv, &hv).sqrt();
        let difference = (dot(&w, &hv) - dot(&hw, &v)).abs();
        Ok(if size > 0.0 { difference / size } else { 0.0 })
    }

    /// Scales the exchange K to D K D, which keeps it reciprocal, so that the rows of closed surfaces
    /// sum to 1 and those of open ones to 1 at most: without, an iteration of bounces may gain light.
    ///
    /// d_i ← √(d_i A_i / (K d)_i), of open surfaces 1 at most (Sinkhorn's scaling in its symmetric
    /// form: Knight, Ruiz and Uçar, SIAM J. Matrix Anal. Appl. 35, 2014). Some ten sums; none if no
    /// row of open surfaces sums to more than 1.
    ///
    /// # Errors
    /// [`Error::NotClosable`] if a form factor would have to change by more than `limit`: then elements
    /// are missing or far too coarse, and the operator is left as it was. Those of the sum.
    pub fn close(&mut self, enclosure: Enclosure, limit: f64) -> Result<Closure, Error> {
        let before = std::mem::take(&mut self.scaling);
        let closed = self.scaling_for(enclosure).and_then(|d| {
            let change = |d: f64| d * d - 1.0;
            let largest = d.iter().map(|&d| change(d).abs()).fold(0.0, f64::max);
            let squares = d.iter().zip(&self.areas).map(|(&d, area)| area * change(d).powi(2));
            let rms = (squares.sum::<f64>()
                / self.areas.iter().sum::<f64>().max(f64::MIN_POSITIVE))
            .sqrt();
            let worst =
                (0..d.len()).max_by(|&i, &j| change(d[i]).abs().total_cmp(&change(d[j]).abs()));
            match worst {
                Some(index) if largest > limit || largest.is_nan() => {
                    Err(Error::NotClosable { index, change: change(d[index]), limit })
                }
                _ => Ok((d, Closure { largest, rms })),
            }
        });
        match closed {
            Ok((d, closure)) => {
                self.scaling = if closure.largest > 0.0 { d } else { Vec::new() };
                Ok(closure)
            }
            Err(error) => {
                self.scaling = before;
                Err(error)
            }
        }
    }

    /// The factor d_j by which an element's radiosity counts, and its irradiance.
    pub fn scaling(&self, j: usize) -> f64 {
        self.scaling.get(j).copied().unwrap_or(1.0)
    }

    fn scaling_for(&self, enclosure: Enclosure) -> Result<Vec<f64>, Error> {
        let mut d = vec![1.0; self.areas.len()];
        for _ in 0..SCALINGS {
            let columns: Vec<_> = d.iter().map(|&d| [d; BANDS]).collect();
            let received = self.apply(&columns)?;
            let mut change = 0.0f64;
            for (d, h) in d.iter_mut().zip(&received) {
                // An element that nothing sees has nothing to scale.
                let wanted = if h[0] > 0.0 { (*d / h[0]).sqrt() } else { *d };
                let wanted = if enclosure == Enclosure::Open { wanted.min(1.0) } else { wanted };
                change = change.max((wanted / *d - 1.0).abs());
                *d = wanted;
            }
            if change < CLOSED {
                break;
            }
        }
        Ok(d)
    }

    fn scaled(&self, columns: &[[f64; BANDS]]) -> Vec<[f64; BANDS]> {
        let scaled = |(i, column): (usize, &[f64; BANDS])| column.map(|c| self.scaling(i) * c);
        columns.iter().enumerate().map(scaled).collect()
    }
}

/// Rows that sum to 1 within this are closed.
const CLOSED: f64 = 1e-4;

impl<const BANDS: usize> std::fmt::Debug for RadiosityOperator<'_, BANDS> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RadiosityOperator")
            .field("elements", &self.areas.len())
            .field("zones", &self.corrections.zones())
            .field("scaled", &!self.scaling.is_empty())
            .finish_non_exhaustive()
    }
}

/// Well-mixed bits of a number (Steele, Lea and Flood, "Fast splittable pseudorandom number
/// generators", OOPSLA 2014).
pub(crate) fn mixed(n: u64) -> u64 {
    let z = n.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

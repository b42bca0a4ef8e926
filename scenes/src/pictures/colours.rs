//! Which colour a radiosity has, in a picture and on its elements alike.

use std::f64::consts::FRAC_1_PI;
use std::ops::RangeInclusive;

use crate::cutting::fields::Fields;
use crate::pictures::palette;
use crate::pictures::tone::{Rgb, ToneMap, colour};
use crate::scene::{Quantity, STEFAN_BOLTZMANN};

/// Which colour a radiosity has: that of the light, by an exposure, or that of its temperature, on a scale.
#[derive(Clone, Debug)]
pub struct Colours(Scale);

#[derive(Clone, Debug)]
enum Scale {
    Light(ToneMap),
    Heat(RangeInclusive<f64>),
}

impl Colours {
    /// Those of elements without a picture: the exposure, or the range of temperatures, is that of all of them.
    pub fn of_elements(fields: &Fields, quantity: Quantity) -> Self {
        match quantity {
            Quantity::Light => {
                let bands = fields.radiosity.chunks(fields.bands.max(1));
                let radiances: Vec<Rgb> = bands.map(|b| colour(b).map(|b| FRAC_1_PI * b)).collect();
                Self::of_light(ToneMap::exposing(&radiances))
            }
            Quantity::Heat => {
                let first = fields.radiosity.iter().step_by(fields.bands.max(1));
                Self::of_heat(palette::range(first.map(|&b| temperature(b))))
            }
        }
    }

    /// Those of light at an exposure.
    pub(crate) fn of_light(tone: ToneMap) -> Self {
        Self(Scale::Light(tone))
    }

    /// Those of temperatures in a range \[K].
    pub(crate) fn of_heat(range: RangeInclusive<f64>) -> Self {
        Self(Scale::Heat(range))
    }

    /// The sRGB code of a radiosity \[W/m²]; its temperature is that of its first band.
    pub(crate) fn code(&self, radiosity: &Rgb) -> [u8; 3] {
        match &self.0 {
            Scale::Light(tone) => tone.code(&radiosity.map(|band| FRAC_1_PI * band)),
            Scale::Heat(range) => palette::code(temperature(radiosity[0]), range),
        }
    }

    /// The sRGB codes of all elements.
    pub fn codes(&self, fields: &Fields) -> Vec<[u8; 3]> {
        fields.radiosity.chunks(fields.bands.max(1)).map(|b| self.code(&self.bands(b))).collect()
    }

    /// The numbers of an element's bands as this takes them: a colour for light, the first one for heat.
    pub(crate) fn bands(&self, bands: &[f64]) -> Rgb {
        match self.0 {
            Scale::Light(_) => colour(bands),
            Scale::Heat(_) => [bands.first().copied().unwrap_or(0.0); 3],
        }
    }

    /// The reflectance of a material of these bands in a solution of `solved` bands, of which a single one stands for
    /// their mean.
    pub(crate) fn reflectance(&self, bands: &[f64], solved: usize) -> Rgb {
        match self.0 {
            Scale::Light(_) => colour(bands),
            Scale::Heat(_) if solved == 1 => {
                [bands.iter().sum::<f64>() / bands.len().max(1) as f64; 3]
            }
            Scale::Heat(_) => self.bands(bands),
        }
    }

    /// By what a radiance is multiplied before it is mapped to a display; none for heat.
    pub(crate) fn exposure(&self) -> Option<f64> {
        match &self.0 {
            Scale::Light(tone) => Some(tone.exposure()),
            Scale::Heat(_) => None,
        }
    }

    /// The range of temperatures \[K]; none for light.
    pub(crate) fn range(&self) -> Option<RangeInclusive<f64>> {
        match &self.0 {
            Scale::Light(_) => None,
            Scale::Heat(range) => Some(range.clone()),
        }
    }
}

/// The temperature \[K] of a black surface of this radiosity.
pub(crate) fn temperature(radiosity: f64) -> f64 {
    (radiosity / STEFAN_BOLTZMANN).max(0.0).powf(0.25)
}

//! From radiances to the colours of a display.

/// A colour: red, green and blue.
pub type Rgb = [f64; 3];

/// Brings radiances of a scene into the range of a display.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ToneMap {
    exposure: f64,
}

/// The share of a picture that is darker than the reference white.
const WHITE_QUANTILE: f64 = 0.95;
/// What the reference white is exposed to.
const WHITE_EXPOSED: f64 = 1.5;
/// The exposed radiance that is mapped to full white.
pub(crate) const BURN: f64 = 4.0;

impl ToneMap {
    /// Exposes so that the brightest twentieth of what isn't black becomes nearly white.
    pub(crate) fn exposing(radiances: &[Rgb]) -> Self {
        let mut luminances: Vec<f64> =
            radiances.iter().map(luminance).filter(|&y| y > 0.0).collect();
        luminances.sort_unstable_by(f64::total_cmp);
        let reference = luminances.get((luminances.len() as f64 * WHITE_QUANTILE) as usize);
        Self { exposure: reference.map_or(1.0, |white| WHITE_EXPOSED / white) }
    }

    /// By what radiances are multiplied.
    pub(crate) fn exposure(&self) -> f64 {
        self.exposure
    }

    /// The sRGB code of a radiance. Every band follows Reinhard's curve x (1 + x/w²)/(1 + x), so that
    /// bright colours pale towards white as on film.
    pub(crate) fn code(&self, radiance: &Rgb) -> [u8; 3] {
        radiance.map(|band| {
            let x = self.exposure * band;
            let linear = (x * (1.0 + x / (BURN * BURN)) / (1.0 + x)).clamp(0.0, 1.0);
            (255.0 * srgb(linear)).round() as u8
        })
    }
}

/// The colour of numbers in some bands: three are red, green and blue, others count by their mean.
pub(crate) fn colour(bands: &[f64]) -> Rgb {
    match *bands {
        [r, g, b] => [r, g, b],
        _ => [bands.iter().sum::<f64>() / bands.len().max(1) as f64; 3],
    }
}

/// Relative luminance of linear sRGB primaries (Rec. 709).
fn luminance([r, g, b]: &Rgb) -> f64 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// The transfer curve of sRGB (IEC 61966-2-1).
fn srgb(linear: f64) -> f64 {
    if linear <= 0.0031308 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn black_stays_black_and_more_light_is_never_darker() {
        let tone = ToneMap::exposing(&[[1.0; 3]; 20]);
        assert_eq!(tone.code(&[0.0; 3]), [0; 3]);
        let greys: Vec<u8> = (0..100).map(|k| tone.code(&[f64::from(k) * 0.05; 3])[0]).collect();
        assert!(greys.is_sorted() && greys[99] == 255);
    }

    #[test]
    fn the_picture_does_not_depend_on_the_unit_of_light() {
        let scene = [[0.2, 0.1, 0.0], [0.7, 0.6, 0.9], [0.0; 3]];
        let brighter = scene.map(|rgb| rgb.map(|band| 64.0 * band));
        let tone = ToneMap::exposing(&scene);
        let other = ToneMap::exposing(&brighter);
        for (a, b) in scene.iter().zip(&brighter) {
            assert_eq!(tone.code(a), other.code(b));
        }
        assert_eq!(ToneMap::exposing(&[[0.0; 3]]).code(&[0.0; 3]), [0; 3]);
    }

    #[test]
    fn three_bands_are_a_colour_and_others_their_mean() {
        assert_eq!(colour(&[1.0, 2.0]), [1.5; 3]);
        assert_eq!(colour(&[1.0, 2.0, 4.0]), [1.0, 2.0, 4.0]);
    }
}

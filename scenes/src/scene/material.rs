//! What surfaces are made of.

use crate::scene::error::SceneError;

/// How many bands the materials of generated scenes and of mesh files have: red, green and blue.
pub(crate) const RGB_BANDS: usize = 3;

/// What a surface does with light, band by band.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Its name, for messages.
    pub name: String,
    /// Diffuse reflectance ρ, in [0, 1]; 1 is that of an adiabatic wall, which gives back all it receives.
    pub reflectance: Vec<f64>,
    /// Emitted exitance E \[W/m²\].
    pub emission: Vec<f64>,
    /// Its temperature \[K], for heat: then E = (1 − ρ) σ T⁴ takes the place of `emission`.
    pub temperature: Option<f64>,
    /// Whether the back of a surface is like its front; otherwise it neither radiates nor receives.
    pub two_sided: bool,
}

impl Material {
    /// A one-sided material in three bands, without a temperature.
    pub fn rgb(name: &str, reflectance: [f64; 3], emission: [f64; 3]) -> Self {
        Self {
            name: name.to_owned(),
            reflectance: reflectance.to_vec(),
            emission: emission.to_vec(),
            temperature: None,
            two_sided: false,
        }
    }

    /// What things are made of that nobody has said anything about.
    pub fn grey() -> Self {
        Self::rgb("grey", [0.5; 3], [0.0; 3])
    }

    /// Checks its values, and that it has this many bands.
    ///
    /// # Errors
    /// [`SceneError::Bands`], [`SceneError::Reflectance`], [`SceneError::Emission`] or
    /// [`SceneError::Temperature`].
    pub fn check(&self, bands: usize) -> Result<(), SceneError> {
        let material = || self.name.clone();
        for (what, values) in [("reflectance", &self.reflectance), ("emission", &self.emission)] {
            let found = values.len();
            if found != bands || bands == 0 {
                let expected = if bands == 0 { "1 or more".to_owned() } else { bands.to_string() };
                return Err(SceneError::Bands { material: material(), what, found, expected });
            }
        }
        // Written so that NaN is refused as well.
        let bad_reflectance = |rho: &f64| !(0.0..=1.0).contains(rho);
        if let Some(band) = self.reflectance.iter().position(bad_reflectance) {
            let found = self.reflectance[band];
            return Err(SceneError::Reflectance { material: material(), band, found });
        }
        let bad = |value: &f64| !(value.is_finite() && *value >= 0.0);
        if let Some(band) = self.emission.iter().position(bad) {
            let found = self.emission[band];
            return Err(SceneError::Emission { material: material(), band, found });
        }
        match self.temperature.filter(bad) {
            Some(found) => Err(SceneError::Temperature { material: material(), found }),
            None => Ok(()),
        }
    }
}

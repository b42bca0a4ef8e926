//! Materials of glTF assets: the base colour is what they reflect, and what they emit is theirs.

use crate::formats::gltf::document::{Document, Material as Entry};
use crate::scene::material::Material;

/// The materials of an asset that are in use, in the order of their first use.
#[derive(Debug, Default)]
pub(crate) struct Materials {
    pub(crate) materials: Vec<Material>,
    /// For each of them its index in the document; none for primitives without one.
    origins: Vec<Option<usize>>,
    /// What of them can't be read, one sentence each.
    pub(crate) missing: Vec<String>,
    /// What was mended in them, one sentence each.
    pub(crate) repairs: Vec<String>,
}

/// The most that a material reflects where a file says that it reflects everything.
const WHITEST: f64 = 0.999;
/// The extension by which a material emits more than 1.
const STRENGTH: &str = "KHR_materials_emissive_strength";
/// Extensions that change nothing of what a material reflects in all: how, or whether programs shade it.
const PASSED: [&str; 8] = [
    "KHR_materials_unlit",
    "KHR_materials_ior",
    "KHR_materials_specular",
    "KHR_materials_clearcoat",
    "KHR_materials_sheen",
    "KHR_materials_anisotropy",
    "KHR_materials_iridescence",
    "KHR_materials_dispersion",
];

/// Whether all that an extension of this name says of a material is read, or of no concern.
pub(crate) fn is_read(extension: &str) -> bool {
    extension == STRENGTH || PASSED.contains(&extension)
}

impl Materials {
    /// The number of a material, which is added if it is in use for the first time. Without one, things are grey.
    ///
    /// # Errors
    /// What was expected of the material.
    pub(crate) fn number(
        &mut self,
        document: &Document,
        index: Option<usize>,
    ) -> Result<usize, String> {
        if let Some(known) = self.origins.iter().position(|&origin| origin == index) {
            return Ok(known);
        }
        let material = match index {
            None => {
                self.missing.push("faces without a material made grey".to_owned());
                Material { name: String::new(), ..Material::grey() }
            }
            Some(index) => {
                let materials = &document.materials;
                let entry = materials.get(index);
                let count = materials.len();
                self.read(
                    index,
                    entry.ok_or_else(|| format!("a material below {count}, found {index}"))?,
                )?
            }
        };
        self.origins.push(index);
        self.materials.push(material);
        Ok(self.materials.len() - 1)
    }

    /// The material of an entry. Its reflectance is the base colour, metallic or not: what metals reflect, they
    /// reflect in all directions here.
    fn read(&mut self, index: usize, entry: &Entry) -> Result<Material, String> {
        let name = entry.name.clone().unwrap_or_else(|| format!("material {index}"));
        let mut note = |what: &str| self.missing.push(format!("material `{name}`: {what}"));
        let pbr = &entry.pbr_metallic_roughness;
        let [r, g, b, alpha] = pbr.base_color_factor.unwrap_or([1.0; 4]);
        if pbr.base_color_texture.is_some() {
            note(
                "its texture of colours is not read, the factor before it taken for the reflectance",
            );
        }
        if entry.emissive_texture.is_some() {
            note(
                "its texture of emission is not read, the factor before it taken for the emission",
            );
        }
        if alpha < 1.0 && entry.alpha_mode.as_deref().is_some_and(|mode| mode != "OPAQUE") {
            note("light passes through it, which is not read: taken to be opaque");
        }
        for extension in entry.extensions.keys().filter(|extension| !is_read(extension)) {
            note(&format!("what it says by {extension} is not read"));
        }
        let strength =
            match entry.extensions.get(STRENGTH).map(|values| &values["emissiveStrength"]) {
                None | Some(serde_json::Value::Null) => 1.0,
                Some(value) => value.as_f64().ok_or_else(|| {
                    format!("a number as emissiveStrength of material `{name}`, found {value}")
                })?,
            };
        let whole = [r, g, b];
        let reflectance = whole.map(|band| if band == 1.0 { WHITEST } else { band });
        if reflectance != whole {
            let what = "reflects everything, taken for 0.999";
            self.repairs.push(format!("material `{name}` {what}"));
        }
        let emission = entry.emissive_factor.unwrap_or_default().map(|band| strength * band);
        let two_sided = entry.double_sided;
        Ok(Material { two_sided, ..Material::rgb(&name, reflectance, emission) })
    }
}

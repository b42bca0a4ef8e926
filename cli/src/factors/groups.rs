//! What form factors are summed over: which surfaces add to which group, and what the groups exchange.

use std::collections::HashMap;

use farfield_radiosity::{Element, Patch};
use farfield_scenes::{Scene, View3d, View3dRole};

use super::args::By;
use super::failure::Failure;

/// The sides of all surfaces that exchange anything, and what they add to.
#[derive(Debug, Default)]
pub(crate) struct Groups {
    /// The groups.
    pub(crate) groups: Vec<Group>,
    /// The sides.
    pub(crate) sides: Vec<Element>,
    /// For each side the groups that it adds to, or takes from, by which factor.
    pub(crate) shares: Vec<Vec<(usize, f64)>>,
    /// Masks: two groups that exchange an area, whatever rays say.
    pub(crate) masks: Vec<(usize, usize, f64)>,
}

/// A row of the matrix.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Group {
    /// Its name.
    pub(crate) name: String,
    /// Its area, both sides of what has two.
    pub(crate) area: f64,
    /// ∫ ε dA.
    pub(crate) emitting: f64,
}

impl Groups {
    /// The sides of a scene's surfaces, summed over.
    ///
    /// # Errors
    /// [`Failure::Points`] if there are points, which have no shape.
    pub(crate) fn of_scene(scene: &Scene, by: By) -> Result<Self, Failure> {
        if !scene.points.is_empty() {
            return Err(Failure::Points(scene.points.len()));
        }
        let mut groups = Self::default();
        let mut known = HashMap::new();
        for (index, surface) in scene.surfaces.iter().enumerate() {
            let material = &scene.materials[surface.material];
            let name = match by {
                By::Surface => format!("{index}:{}", material.name),
                By::Material => material.name.clone(),
                By::File => file(scene, index),
            };
            let group = *known.entry(name.clone()).or_insert(groups.groups.len());
            if group == groups.groups.len() {
                groups.groups.push(Group { name, ..Group::default() });
            }
            let mean = material.reflectance.iter().sum::<f64>() / material.reflectance.len() as f64;
            let mut corners = scene.corners(surface);
            for _ in 0..if material.two_sided { 2 } else { 1 } {
                let patch = Patch::new(&corners)?;
                groups.add(Element::patch(patch, surface.face), vec![(group, 1.0)]);
                groups.groups[group].area += patch.area();
                groups.groups[group].emitting += (1.0 - mean) * patch.area();
                corners.reverse();
            }
        }
        Ok(groups)
    }

    /// The surfaces of View3D as it reports them: combined, without nulls and obstructions, and bases without what
    /// covers them.
    ///
    /// # Errors
    /// What the surfaces' shapes are refused for.
    pub(crate) fn of_view3d(found: &View3d) -> Result<Self, Failure> {
        let mut groups = Self::default();
        // Which group a surface adds to.
        let mut own: Vec<Option<usize>> = Vec::with_capacity(found.surfaces.len());
        for (surface, shape) in found.surfaces.iter().zip(&found.scene.surfaces) {
            let patch = Patch::new(&found.scene.corners(shape))?;
            let reports = matches!(surface.role, View3dRole::Radiating | View3dRole::Mask);
            let group = reports.then(|| match surface.combined.and_then(|other| own[other]) {
                Some(group) => group,
                None => {
                    let name = surface.name.clone();
                    groups.groups.push(Group { name, ..Group::default() });
                    groups.groups.len() - 1
                }
            });
            own.push(group);
            let base = surface.base.and_then(|base| own[base]);
            let mut shares = Vec::new();
            if let Some(group) = group {
                groups.groups[group].area += patch.area();
                groups.groups[group].emitting += surface.emissivity * patch.area();
                if surface.role == View3dRole::Radiating {
                    shares.push((group, 1.0));
                }
            }
            if let Some(base) = base {
                // What lies on a base takes its place; a mask leaves it its area.
                shares.push((base, -1.0));
                let emissivity = surface.base.map_or(0.0, |base| found.surfaces[base].emissivity);
                match (surface.role, group) {
                    (View3dRole::Mask, Some(group)) => {
                        groups.masks.push((group, base, patch.area()))
                    }
                    _ => {
                        groups.groups[base].area -= patch.area();
                        groups.groups[base].emitting -= emissivity * patch.area();
                    }
                }
            }
            groups.add(Element::patch(patch, shape.face), shares);
        }
        Ok(groups)
    }

    fn add(&mut self, side: Element, shares: Vec<(usize, f64)>) {
        self.sides.push(side);
        self.shares.push(shares);
    }
}

/// The file that a surface comes from, or what its scene is called without files.
fn file(scene: &Scene, surface: usize) -> String {
    let part = scene.parts.iter().find(|part| {
        let place = surface.checked_sub(part.first);
        place.is_some_and(|place| place < part.numbers.len())
    });
    part.map_or_else(|| "scene".to_owned(), |part| part.file.clone())
}

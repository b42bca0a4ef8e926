//! Putting together what a scene description asks for.

use std::collections::{BTreeMap, HashSet};
use std::path::Path;

use glam::{DAffine3, DQuat, DVec3};

use crate::formats::description::{Camera, Description, Finish, MeshFile, Rotation};
use crate::formats::mesh_file::{file_name, read_mesh};
use crate::formats::text::read_text;
use crate::generators::{GENERATORS, generate};
use crate::repair::facing::face_room;
use crate::repair::flat::flat_pieces;
use crate::scene::Scene;
use crate::scene::error::SceneError;
use crate::scene::geometry::is_watertight;
use crate::scene::material::{Material, RGB_BANDS};
use crate::scene::place::Part;
use crate::scene::surface::Surface;
use crate::scene::viewpoint::Viewpoint;
use crate::scene::weld::Weld;

/// The scene that a TOML file describes. The names of mesh files start from its folder.
///
/// # Errors
/// [`SceneError::Toml`] for what isn't a description, [`SceneError::File`] for one that makes no
/// sense, or whatever is wrong with a mesh.
pub(crate) fn read(path: &Path) -> Result<Scene, SceneError> {
    let text = read_text(path)?;
    let description: Description = toml::from_str(&text)
        .map_err(|source| SceneError::Toml { path: path.to_owned(), source: Box::new(source) })?;
    Assembly::new(path, &description)?.assemble(description)
}

/// A described scene in the making.
struct Assembly<'a> {
    path: &'a Path,
    scene: Scene,
    /// Index of the first of the materials that the description defines, which are in the order of
    /// their names.
    first: usize,
    faces: u32,
}

impl<'a> Assembly<'a> {
    /// The generated scene, if any, with the materials of the description in the file `path`.
    ///
    /// # Errors
    /// [`SceneError::File`] if there is no such generated scene, or whatever is wrong with a material.
    pub(crate) fn new(path: &'a Path, description: &Description) -> Result<Self, SceneError> {
        let mut assembly = Self { path, scene: Scene::default(), first: 0, faces: 0 };
        if let Some(name) = &description.generator {
            let generated = generate(name);
            assembly.scene = generated.ok_or_else(|| {
                let names = GENERATORS.join(", ");
                assembly.refusal(format!("one of {names} as generator, found `{name}`"))
            })?;
        }
        let scene = &mut assembly.scene;
        scene.watertight = scene.surfaces.is_empty() || scene.closed;
        assembly.faces = scene.surfaces.iter().map(|s| s.face + 1).max().unwrap_or(0);
        assembly.first = scene.materials.len();
        scene.materials.extend(description.materials.iter().map(|(name, finish)| Material {
            name: name.clone(),
            reflectance: finish.reflectance.clone(),
            emission:
                finish.emission.clone().unwrap_or_else(|| vec![0.0; finish.reflectance.len()]),
            temperature: finish.temperature,
            two_sided: finish.two_sided,
        }));
        let bands = if assembly.first > 0 { RGB_BANDS } else { scene.bands() };
        scene.materials.iter().try_for_each(|material| material.check(bands))?;
        Ok(assembly)
    }

    /// Adds everything else.
    ///
    /// # Errors
    /// [`SceneError::File`] for what makes no sense, or whatever is wrong with a mesh file.
    pub(crate) fn assemble(mut self, description: Description) -> Result<Scene, SceneError> {
        for mesh in &description.mesh {
            self.add_mesh(mesh, &description.materials)?;
        }
        self.add_quads(&description)?;
        if let Some(camera) = &description.camera {
            self.scene.camera = Some(self.viewpoint(camera)?);
        }
        if let Some(closed) = description.closed {
            (self.scene.closed, self.scene.watertight) = (closed, closed);
        }
        let units = description.units;
        if !(units > 0.0 && units.is_finite()) {
            return Err(
                self.refusal(format!("a positive number of metres as units, found {units}"))
            );
        }
        scale(&mut self.scene, units);
        // What a check refuses stays as it is.
        if self.scene.closed && self.scene.check().is_ok() {
            let turned = face_room(&mut self.scene);
            self.scene.repairs.extend(turned);
        }
        Ok(self.scene)
    }

    /// Adds the quadrilaterals, in two triangles each where they are not quite flat.
    fn add_quads(&mut self, description: &Description) -> Result<(), SceneError> {
        let (first, mut numbers) = (self.scene.surfaces.len(), Vec::new());
        let (mut bent, mut duplicate, mut two_sided) = (0, 0, true);
        let mut seen = HashSet::new();
        for (index, quad) in description.quad.iter().enumerate() {
            let material = self.named(&quad.material, &description.materials)?;
            if !seen.insert((cycle(&quad.corners), material)) {
                duplicate += 1;
                continue;
            }
            self.scene.closed &= self.scene.materials[material].two_sided;
            two_sided &= self.scene.materials[material].two_sided;
            let pieces = flat_pieces(&quad.corners.map(DVec3::from_array));
            bent += usize::from(pieces.len() > 1);
            for piece in pieces {
                self.scene.add(&piece, material, self.faces);
                self.faces += 1;
            }
            numbers.resize(self.scene.surfaces.len() - first, index as u32 + 1);
        }
        self.scene.watertight &= two_sided || self.is_sealed(first);
        let file = file_name(self.path);
        self.scene.parts.push(Part { file, kind: "quad", first, numbers });
        for (count, what) in [
            (duplicate, "duplicate quads, dropped"),
            (bent, "quads that aren't flat and convex, cut into triangles"),
        ] {
            self.scene.repairs.extend((count > 0).then(|| format!("{what}: {count}")));
        }
        Ok(())
    }

    /// Whether the surfaces from this one on enclose volumes without gaps. Each has vertices of its own.
    fn is_sealed(&self, first: usize) -> bool {
        let mut weld = Weld::default();
        let welded = |surface: &Surface| {
            let corners = self.scene.corners(surface);
            let corners = corners.into_iter().map(|corner| weld.vertex(corner)).collect();
            Surface { corners, ..surface.clone() }
        };
        let surfaces: Vec<Surface> = self.scene.surfaces[first..].iter().map(welded).collect();
        is_watertight(&surfaces)
    }

    fn add_mesh(
        &mut self,
        mesh: &MeshFile,
        finishes: &BTreeMap<String, Finish>,
    ) -> Result<(), SceneError> {
        let place = self.transform(mesh)?;
        let folder = self.path.parent().unwrap_or(Path::new(""));
        let mut part = read_mesh(&folder.join(&mesh.file))?;
        let first = self.scene.materials.len();
        let material = match &mesh.material {
            Some(name) => Some(self.named(name, finishes)?),
            None => None,
        };
        match (material, mesh.two_sided) {
            (Some(material), None) => self.give(&mut part, |_| material),
            (Some(material), Some(two_sided)) => {
                let finish = self.scene.materials[material].clone();
                self.scene.materials.push(Material { two_sided, ..finish });
                self.give(&mut part, |_| first);
            }
            (None, two_sided) => {
                let own = part.materials.drain(..).map(|material| Material {
                    two_sided: two_sided.unwrap_or(material.two_sided),
                    ..material
                });
                self.scene.materials.extend(own);
                self.give(&mut part, |material| first + material);
            }
        }
        let materials = &self.scene.materials;
        let two_sided = part.surfaces.iter().all(|s| materials[s.material].two_sided)
            && part.points.iter().all(|p| materials[p.material].two_sided);
        // Light that arrives at the back of an open sheet is lost.
        let sealed = part.points.is_empty() && is_watertight(&part.surfaces);
        self.scene.closed &= sealed || two_sided;
        self.scene.watertight &= sealed || two_sided;
        part.vertices.iter_mut().for_each(|p| *p = place.transform_point3(*p));
        let vertices = self.scene.vertices.len() as u32;
        for surface in &mut part.surfaces {
            surface.corners.iter_mut().for_each(|k| *k += vertices);
            surface.face += self.faces;
        }
        for point in &mut part.points {
            point.position = place.transform_point3(point.position);
            point.normal = place.transform_vector3(point.normal).normalize_or_zero();
            point.area *= mesh.scale * mesh.scale;
        }
        self.faces = part.surfaces.iter().map(|s| s.face + 1).max().unwrap_or(self.faces);
        let before = self.scene.surfaces.len();
        part.parts.iter_mut().for_each(|part| part.first += before);
        self.scene.parts.append(&mut part.parts);
        self.scene.vertices.append(&mut part.vertices);
        self.scene.surfaces.append(&mut part.surfaces);
        self.scene.points.append(&mut part.points);
        let named = |what: String| format!("{}: {what}", mesh.file);
        self.scene.repairs.extend(part.repairs.into_iter().map(named));
        // A description's material takes the place of what the file lacks.
        if mesh.material.is_none() {
            self.scene.missing.extend(part.missing.into_iter().map(named));
        }
        self.scene.doubts.extend(part.doubts.into_iter().map(named));
        Ok(())
    }

    /// Changes the materials of all that is in a scene.
    fn give(&self, part: &mut Scene, material: impl Fn(usize) -> usize) {
        part.surfaces.iter_mut().for_each(|s| s.material = material(s.material));
        part.points.iter_mut().for_each(|p| p.material = material(p.material));
    }

    /// Where a mesh goes.
    fn transform(&self, mesh: &MeshFile) -> Result<DAffine3, SceneError> {
        let MeshFile { file, scale, translate, .. } = mesh;
        if !(*scale > 0.0 && scale.is_finite()) {
            return Err(self.refusal(format!("a positive scale of {file}, found {scale}")));
        }
        let translation = DVec3::from_array(*translate);
        if !translation.is_finite() {
            return Err(self.refusal(format!("a finite translation of {file}")));
        }
        let rotation = match &mesh.rotate {
            None => DQuat::IDENTITY,
            Some(Rotation { axis, degrees }) => {
                let axis = DVec3::from_array(*axis).try_normalize();
                match axis.filter(|_| degrees.is_finite()) {
                    Some(axis) => DQuat::from_axis_angle(axis, degrees.to_radians()),
                    None => {
                        let expected = format!("an axis and a finite angle to rotate {file}");
                        return Err(self.refusal(expected));
                    }
                }
            }
        };
        Ok(DAffine3::from_scale_rotation_translation(DVec3::splat(*scale), rotation, translation))
    }

    /// The index of a material of the description or, failing that, of the generated scene.
    fn named(&self, name: &str, finishes: &BTreeMap<String, Finish>) -> Result<usize, SceneError> {
        let own = finishes.keys().position(|own| own == name).map(|k| self.first + k);
        let generated = &self.scene.materials[..self.first];
        let index = own.or_else(|| generated.iter().position(|material| material.name == name));
        index.ok_or_else(|| {
            let known: Vec<_> = finishes
                .keys()
                .chain(generated.iter().map(|m| &m.name))
                .map(String::as_str)
                .collect();
            let expected = format!("one of the materials [{}], found `{name}`", known.join(", "));
            self.refusal(expected)
        })
    }

    fn viewpoint(&self, camera: &Camera) -> Result<Viewpoint, SceneError> {
        let [eye, target, up] = [camera.eye, camera.target, camera.up].map(DVec3::from_array);
        let degrees = camera.fov_degrees;
        if !(degrees > 0.0 && degrees < 180.0) {
            let expected = format!("a field of view between 0 and 180 degrees, found {degrees}");
            return Err(self.refusal(expected));
        }
        let film_over_focal = 2.0 * (0.5 * degrees.to_radians()).tan();
        Ok(Viewpoint { eye, target, up, film_over_focal })
    }

    fn refusal(&self, expected: String) -> SceneError {
        SceneError::File { path: self.path.to_owned(), expected }
    }
}

/// The same corners in the same order, from the smallest on, as numbers that can be compared.
fn cycle(corners: &[[f64; 3]; 4]) -> [[u64; 3]; 4] {
    // Adding zero turns −0 into 0.
    let mut corners = corners.map(|corner| corner.map(|x| (x + 0.0).to_bits()));
    let smallest = (0..corners.len()).min_by_key(|&k| corners[k]).unwrap_or(0);
    corners.rotate_left(smallest);
    corners
}

/// Scales all lengths.
fn scale(scene: &mut Scene, factor: f64) {
    scene.vertices.iter_mut().for_each(|p| *p *= factor);
    for point in &mut scene.points {
        point.position *= factor;
        point.area *= factor * factor;
    }
    if let Some(camera) = &mut scene.camera {
        camera.eye *= factor;
        camera.target *= factor;
    }
}

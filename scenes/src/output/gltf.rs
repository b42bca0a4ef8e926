//! A mesh with its colours as binary glTF 2.0.

use std::io::{self, Write};

use glam::{DMat4, DVec3};
use serde_json::{Value, json};

use crate::cutting::fields::Fields;
use crate::cutting::mesh::Mesh;
use crate::pictures::colours::Colours;
use crate::pictures::shading::Shading;
use crate::pictures::tone::Rgb;
use crate::scene::Scene;

/// Writes elements as triangles, one primitive for each material, with a colour at every vertex: that of the
/// radiosity B = E + ρH. They are shown as they are, without any light of the viewer's
/// (`KHR_materials_unlit`), from their fronts. The scene's camera is in the file as well.
///
/// # Errors
/// Those of `file`, those of [`Fields::rows`], and [`io::ErrorKind::InvalidInput`] if the shading is not that of the
/// mesh, or the file would be larger than the format allows.
pub(crate) fn write(
    file: &mut impl Write,
    scene: &Scene,
    mesh: &Mesh,
    fields: &Fields,
    shading: &Shading,
    colours: &Colours,
) -> io::Result<()> {
    let rows = fields.rows(mesh)?;
    if shading.elements() != mesh.elements.len() {
        let (found, expected) = (shading.elements(), mesh.elements.len());
        return Err(refusal(format!("a shading of {found} elements: expected {expected}")));
    }
    let centre = centre(&shading.positions);
    let mut buffer = Buffer::default();
    let (mut primitives, mut materials) = (Vec::new(), Vec::new());
    for (index, material) in scene.materials.iter().enumerate() {
        let reflectance = colours.reflectance(&material.reflectance, fields.bands);
        let mut part = Part::default();
        // For each vertex of the shading its number among those of this material.
        let mut numbers = vec![u32::MAX; shading.positions.len()];
        for (element, row) in rows.clone().enumerate().filter(|(_, r)| r.material as usize == index)
        {
            let emission = colours.bands(row.emission);
            let mut corner = |&vertex: &u32| {
                let k = vertex as usize;
                if numbers[k] == u32::MAX {
                    numbers[k] = part.positions.len() as u32;
                    let irradiance = shading.irradiance[k];
                    let radiosity: Rgb =
                        [0, 1, 2].map(|b| emission[b] + reflectance[b] * irradiance[b]);
                    part.positions.push((shading.positions[k] - centre).as_vec3().to_array());
                    part.colours.push(colours.code(&radiosity));
                }
                numbers[k]
            };
            let corners: Vec<u32> = shading.corners(element).iter().map(&mut corner).collect();
            part.triangles
                .extend((2..corners.len()).map(|k| [corners[0], corners[k - 1], corners[k]]));
        }
        if !part.triangles.is_empty() {
            primitives.push(buffer.add(&part, materials.len()));
            materials.push(json!({
                "name": material.name,
                "pbrMetallicRoughness": { "metallicFactor": 0, "roughnessFactor": 1 },
                "extensions": { "KHR_materials_unlit": {} },
            }));
        }
    }
    let mut document = json!({
        "asset": { "version": "2.0", "generator": "farfield radiosity" },
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "name": "radiosity", "mesh": 0, "translation": centre.to_array() }],
        "meshes": [{ "name": "radiosity", "primitives": primitives }],
        "materials": materials,
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{ "byteLength": buffer.bytes.len() }],
    });
    if let Some((camera, matrix)) = camera(scene) {
        document["cameras"] = json!([camera]);
        document["scenes"][0]["nodes"] = json!([0, 1]);
        let node = json!({ "name": "camera", "camera": 0, "matrix": matrix.to_cols_array() });
        document["nodes"].as_array_mut().expect("it is one").push(node);
    }
    chunks(file, &document, &buffer.bytes)
}

/// The middle of the box around all points.
fn centre(points: &[DVec3]) -> DVec3 {
    let [low, high] = points
        .iter()
        .fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], &p| [low.min(p), high.max(p)]);
    Some(0.5 * (low + high)).filter(|centre| centre.is_finite()).unwrap_or_default()
}

/// The scene's camera, and the matrix that places it; none where it has none.
fn camera(scene: &Scene) -> Option<(Value, DMat4)> {
    let view = scene.camera?;
    let back = (view.eye - view.target).try_normalize()?;
    let right = view.up.cross(back).try_normalize()?;
    let up = back.cross(right);
    let matrix =
        DMat4::from_cols(right.extend(0.0), up.extend(0.0), back.extend(0.0), view.eye.extend(1.0));
    let yfov = 2.0 * (0.5 * view.film_over_focal).atan();
    let near = 1e-3 * view.eye.distance(view.target);
    let perspective = json!({ "yfov": yfov, "znear": near, "aspectRatio": 1 });
    Some((json!({ "type": "perspective", "perspective": perspective }), matrix))
}

/// The elements of one material.
#[derive(Default)]
struct Part {
    positions: Vec<[f32; 3]>,
    /// sRGB codes.
    colours: Vec<[u8; 3]>,
    triangles: Vec<[u32; 3]>,
}

/// The bytes of all numbers, and what says where they are.
#[derive(Default)]
struct Buffer {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

/// What the numbers of a view are for, and how they are stored: names of the specification.
const VERTICES: u32 = 34962;
const INDICES: u32 = 34963;
const FLOAT: u32 = 5126;
const SHORT: u32 = 5123;
const INTEGER: u32 = 5125;

impl Buffer {
    /// Adds the numbers of a part; returns its primitive.
    fn add(&mut self, part: &Part, material: usize) -> Value {
        let count = part.positions.len();
        self.view(VERTICES, part.positions.as_flattened().iter().flat_map(|x| x.to_le_bytes()));
        let bound = |pick: fn(f32, f32) -> f32| -> [f32; 3] {
            std::array::from_fn(|axis| {
                part.positions.iter().map(|p| p[axis]).reduce(pick).unwrap_or(0.0)
            })
        };
        let (min, max) = (bound(f32::min), bound(f32::max));
        let positions = self.accessor(json!({
            "componentType": FLOAT, "count": count, "type": "VEC3", "min": min, "max": max,
        }));
        let colours = part.colours.iter().flat_map(|code| {
            let [r, g, b] = code.map(linear);
            [r, g, b, u16::MAX]
        });
        self.view(VERTICES, colours.flat_map(u16::to_le_bytes));
        let colours = self.accessor(json!({
            "componentType": SHORT, "normalized": true, "count": count, "type": "VEC4",
        }));
        self.view(INDICES, part.triangles.as_flattened().iter().flat_map(|k| k.to_le_bytes()));
        let indices = self.accessor(json!({
            "componentType": INTEGER, "count": 3 * part.triangles.len(), "type": "SCALAR",
        }));
        json!({
            "attributes": { "POSITION": positions, "COLOR_0": colours },
            "indices": indices,
            "material": material,
        })
    }

    /// Adds bytes, a multiple of four, as a view.
    fn view(&mut self, target: u32, bytes: impl Iterator<Item = u8>) {
        let first = self.bytes.len();
        self.bytes.extend(bytes);
        let length = self.bytes.len() - first;
        let view = json!({
            "buffer": 0, "byteOffset": first, "byteLength": length, "target": target,
        });
        self.views.push(view);
    }

    /// Adds an accessor of the latest view; returns its index.
    fn accessor(&mut self, mut accessor: Value) -> usize {
        accessor["bufferView"] = json!(self.views.len() - 1);
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }
}

/// The linear fraction, of 65535, that an sRGB code stands for (IEC 61966-2-1).
fn linear(code: u8) -> u16 {
    let x = f64::from(code) / 255.0;
    let linear = if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) };
    (linear * 65535.0).round() as u16
}

/// Writes the chunks of a binary file.
fn chunks(file: &mut impl Write, document: &Value, bytes: &[u8]) -> io::Result<()> {
    let mut json = serde_json::to_vec(document)?;
    json.resize(json.len().next_multiple_of(4), b' ');
    let whole = 12 + 8 + json.len() + 8 + bytes.len();
    let size = |length: usize| {
        let expected = "expected less than 4 GiB of glTF";
        u32::try_from(length).map_err(|_| refusal(format!("{length} bytes: {expected}")))
    };
    file.write_all(b"glTF")?;
    file.write_all(&2u32.to_le_bytes())?;
    file.write_all(&size(whole)?.to_le_bytes())?;
    for (kind, content) in [(b"JSON", &json[..]), (b"BIN\0", bytes)] {
        file.write_all(&size(content.len())?.to_le_bytes())?;
        file.write_all(kind)?;
        file.write_all(content)?;
    }
    Ok(())
}

fn refusal(message: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidInput, message)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::gltf::for_tests::numbers;
    use crate::formats::load::load;
    use crate::generators::generate;
    use crate::pictures::sight::Sight;
    use crate::scene::Quantity;
    use crate::scene::geometry::vector_area;
    use crate::scene::material::Material;
    use crate::scene::surface::ScenePoint;
    use std::fs;

    /// The Cornell box with two sides of a wall, a triangle and a disk.
    fn scene() -> Scene {
        let mut scene = generate("cornell").expect("listed");
        scene.materials[1] = Material { two_sided: true, ..scene.materials[1].clone() };
        scene.points.push(ScenePoint {
            position: DVec3::new(278.0, 300.0, 100.0),
            normal: DVec3::NEG_Z,
            area: 400.0,
            material: 2,
        });
        let triangle = [[100.0, 90.0, 50.0], [190.0, 90.0, 50.0], [140.0, 10.0, 50.0]];
        scene.add(&triangle.map(DVec3::from_array), 0, 99);
        scene
    }

    fn fields(mesh: &Mesh, scene: &Scene) -> Fields {
        let count = mesh.elements.len();
        let of = |field: fn(&Material) -> &Vec<f64>| -> Vec<f64> {
            mesh.material
                .iter()
                .flat_map(|&m| field(&scene.materials[m as usize]).clone())
                .collect()
        };
        let (emission, reflectance) = (of(|m| &m.emission), of(|m| &m.reflectance));
        let irradiance: Vec<f64> = (0..3 * count).map(|k| 1.0 + (k % 7) as f64).collect();
        let radiosity = (0..3 * count).map(|k| emission[k] + reflectance[k] * irradiance[k]);
        Fields {
            bands: 3,
            radiosity: radiosity.collect(),
            emission,
            irradiance,
            row_sums: vec![1.0; count],
        }
    }

    #[test]
    fn a_solution_comes_back_with_its_places_materials_colours_and_camera() {
        let scene = scene();
        let mesh = Mesh::new(&scene, 500).expect("valid");
        let fields = fields(&mesh, &scene);
        let colours = Colours::of_elements(&fields, Quantity::Light);
        let codes = colours.codes(&fields);
        let sight = Sight::new(&scene, &mesh).expect("finite");
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("elements.glb");
        for (shading, is_exact) in [
            (Shading::constant(&mesh, &fields, &colours).expect("matching"), true),
            (Shading::smooth(&sight, &fields, &colours).expect("matching"), false),
        ] {
            let mut bytes = Vec::new();
            write(&mut bytes, &scene, &mesh, &fields, &shading, &colours).expect("written");
            fs::write(&path, &bytes).expect("written");
            let back = load(&path.to_string_lossy()).expect("valid");
            // White things come first, whatever they are of.
            let mut order: Vec<usize> = (0..mesh.elements.len()).collect();
            order.sort_by_key(|&k| mesh.material[k]);
            let counts = |k: usize| shading.corners(k).len() - 2;
            assert_eq!(back.surfaces.len(), order.iter().map(|&k| counts(k)).sum::<usize>());
            let mut surfaces = back.surfaces.iter();
            for &k in &order {
                let own: Vec<_> = surfaces.by_ref().take(counts(k)).collect();
                let (area, surfel) =
                    (own.iter().map(|s| back.area(s)).sum::<f64>(), mesh.elements[k].surfel());
                assert!((area / surfel.area - 1.0).abs() < 1e-4, "{area} {}", surfel.area);
                for surface in own {
                    let corners = back.corners(surface);
                    let normal = vector_area(&corners).normalize();
                    assert!(normal.dot(surfel.normal) > 0.999);
                    let material = &scene.materials[mesh.material[k] as usize];
                    assert_eq!(back.materials[surface.material].name, material.name);
                    assert!(corners.iter().all(|p| p.distance(surfel.position) < 200.0));
                }
            }
            let camera = (back.camera.expect("written"), scene.camera.expect("published"));
            assert!(camera.0.eye.abs_diff_eq(camera.1.eye, 1e-9));
            assert!((camera.0.film_over_focal - camera.1.film_over_focal).abs() < 1e-12);
            if is_exact {
                let expected = order.iter().flat_map(|&k| vec![codes[k]; shading.corners(k).len()]);
                let found = numbers::<4>(&path, "COLOR_0");
                let found = found.iter().map(|&[r, g, b, _]| {
                    [r, g, b].map(|x| {
                        (0..=255)
                            .min_by_key(|&code| {
                                (i32::from(linear(code)) - (x * 65535.0) as i32).abs()
                            })
                            .expect("there are some")
                    })
                });
                assert!(found.eq(expected));
            }
            let other = Mesh::new(&scene, 200).expect("valid");
            let refused = write(&mut Vec::new(), &scene, &other, &fields, &shading, &colours);
            assert!(refused.is_err());
        }
    }
}

//! A solution as a page to walk through: one file that needs no network and no other file.

use std::io::{self, Write};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::DVec3;
use serde_json::{Value, json};

use crate::cutting::fields::Fields;
use crate::pictures::colours::Colours;
use crate::pictures::palette;
use crate::pictures::shading::Shading;
use crate::pictures::sight::{Backs, Sight};
use crate::pictures::tone::{BURN, Rgb};
use crate::pictures::view::View;
use crate::scene::Quantity;

/// What a page shows.
#[derive(Clone, Copy, Debug)]
pub struct Page<'a> {
    /// What the scene is called.
    pub title: &'a str,
    /// What is exchanged.
    pub quantity: Quantity,
    /// Whether there is a solution; if not, sums of form factors are all that is shown.
    pub is_solved: bool,
    /// The scene, its elements, and what is seen of them.
    pub sight: &'a Sight<'a>,
    /// The fields on the elements.
    pub fields: &'a Fields,
    /// The elements as renderers take them.
    pub shading: &'a Shading,
    /// Which colours radiosities have in the picture.
    pub colours: &'a Colours,
}

/// Writes a page of HTML with the elements in base 64 and what shows them: JavaScript and shaders for WebGL 2. It holds
/// about a hundred bytes for each element.
///
/// # Errors
/// Those of `file`, those of [`Fields::rows`], and [`io::ErrorKind::InvalidInput`] if the shading is not that of the
/// mesh.
pub(crate) fn write(file: &mut impl Write, page: &Page<'_>) -> io::Result<()> {
    let mut data = Data::default();
    let meta = meta(page, &mut data)?;
    // Within a script, nothing but `</script` and `<!--` would end the text.
    let meta = serde_json::to_string(&meta)?.replace('<', "\\u003c");
    let script = SCRIPTS.concat();
    let parts = [
        ("style", STYLE),
        ("vertex", VERTEX),
        ("colour", COLOUR),
        ("number", NUMBER),
        ("script", &script),
        ("meta", &meta),
        ("data", ""),
    ];
    let mut rest = SKELETON;
    while let Some((before, after)) = rest.split_once("{{") {
        file.write_all(before.as_bytes())?;
        let (name, after) = after.split_once("}}").unwrap_or_default();
        if name == "data" {
            data.write(file)?;
        }
        let part = parts.iter().find(|(part, _)| *part == name);
        file.write_all(part.map_or("", |(_, text)| text).as_bytes())?;
        rest = after;
    }
    file.write_all(rest.as_bytes())
}

const SKELETON: &str = include_str!("page/scene.html");
const STYLE: &str = include_str!("page/style.css");
const VERTEX: &str = include_str!("page/scene.vert");
const COLOUR: &str = include_str!("page/colour.frag");
const NUMBER: &str = include_str!("page/number.frag");
/// One module in parts; what each uses comes before it.
const SCRIPTS: [&str; 6] = [
    include_str!("page/data.js"),
    include_str!("page/quantities.js"),
    include_str!("page/camera.js"),
    include_str!("page/drawing.js"),
    include_str!("page/gestures.js"),
    include_str!("page/main.js"),
];
/// Colours of a scale.
const PALETTE: usize = 256;

/// The description of a scene; its numbers go to `data`.
fn meta(page: &Page<'_>, data: &mut Data) -> io::Result<Value> {
    let Page { title, quantity, is_solved, sight, fields, shading, colours } = *page;
    let Sight { scene, mesh, .. } = *sight;
    let rows = fields.rows(mesh)?;
    if shading.elements() != mesh.elements.len() || mesh.origin.len() != mesh.elements.len() {
        let message = "a shading or origins of other elements than those of the mesh";
        return Err(io::Error::new(io::ErrorKind::InvalidInput, message));
    }
    let View { place, backs, .. } = View::new(scene, sight);
    let [low, high] = shading
        .positions
        .iter()
        .fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], &p| [low.min(p), high.max(p)]);
    let centre = 0.5 * (low + high);
    let around = |p: DVec3| (p - centre).to_array();

    data.floats("positions", shading.positions.iter().flat_map(|&p| around(p)));
    data.floats("vertexIrradiance", shading.irradiance.iter().flatten().copied());
    data.integers("corners", shading.all_corners().iter().copied());
    let elements = 0..shading.elements();
    data.bytes("sizes", elements.map(|k| shading.corners(k).len() as u8));
    data.integers("shades", mesh.material.iter().copied());
    data.integers("surfaces", mesh.origin.iter().copied());
    data.floats("radiosity", fields.radiosity.iter().copied());
    data.floats("irradiance", fields.irradiance.iter().copied());
    data.floats("rows", fields.row_sums.iter().copied());
    data.floats("areas", rows.map(|row| row.element.surfel().area));
    let scale = 0.0..=1.0;
    let shares = (0..PALETTE).map(|k| k as f64 / (PALETTE - 1) as f64);
    data.bytes("palette", shares.flat_map(|share| palette::code(share, &scale)));

    let materials = scene.materials.iter().enumerate().map(|(index, material)| {
        let emission = scene.emission(index, quantity);
        let mean = |bands: &[f64]| bands.iter().sum::<f64>() / bands.len().max(1) as f64;
        let solved = |bands: &[f64]| match fields.bands {
            1 => vec![mean(bands)],
            _ => bands.to_vec(),
        };
        let emitted = solved(&emission);
        let shown: Rgb = colours.bands(&emitted);
        json!({
            "name": material.name,
            "emission": shown,
            "reflectance": colours.reflectance(&material.reflectance, fields.bands),
            "emitted": emitted,
            "rho": solved(&material.reflectance),
        })
    });
    let parts = scene.parts.iter().map(|part| json!({ "first": part.first, "file": part.file }));
    Ok(json!({
        "title": title,
        "heat": quantity == Quantity::Heat,
        "solved": is_solved,
        "bands": fields.bands,
        "exposure": colours.exposure().unwrap_or(1.0),
        "burn": BURN,
        "range": colours.range().map(|range| [*range.start(), *range.end()]),
        "centre": centre.to_array(),
        "extent": (0.5 * (high - low)).to_array(),
        "radius": 0.5 * low.distance(high),
        "camera": {
            "eye": around(place.eye),
            "target": around(place.target),
            "up": place.up.to_array(),
            "film": place.film_over_focal,
            "outside": backs == Backs::Transparent,
        },
        "materials": materials.collect::<Vec<_>>(),
        "parts": parts.collect::<Vec<_>>(),
        "arrays": data.arrays,
    }))
}

/// Arrays of numbers, one after the other, each at a multiple of four bytes.
#[derive(Default)]
struct Data {
    bytes: Vec<u8>,
    /// Where each is, as JavaScript finds it.
    arrays: Vec<Value>,
}

impl Data {
    /// Adds numbers in single precision.
    fn floats(&mut self, name: &str, numbers: impl Iterator<Item = f64>) {
        self.add(name, "f32", numbers.flat_map(|x| (x as f32).to_le_bytes()), 4);
    }

    fn integers(&mut self, name: &str, numbers: impl Iterator<Item = u32>) {
        self.add(name, "u32", numbers.flat_map(u32::to_le_bytes), 4);
    }

    fn bytes(&mut self, name: &str, numbers: impl Iterator<Item = u8>) {
        self.add(name, "u8", numbers, 1);
    }

    fn add(&mut self, name: &str, kind: &str, bytes: impl Iterator<Item = u8>, size: usize) {
        let offset = self.bytes.len();
        self.bytes.extend(bytes);
        let count = (self.bytes.len() - offset) / size;
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let array = json!({ "name": name, "kind": kind, "offset": offset, "count": count });
        self.arrays.push(array);
    }

    /// Writes all bytes in base 64.
    fn write(&self, file: &mut impl Write) -> io::Result<()> {
        // Whole triples, so that pieces can be put together.
        const PIECE: usize = 3 << 16;
        self.bytes
            .chunks(PIECE)
            .try_for_each(|piece| file.write_all(STANDARD.encode(piece).as_bytes()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cutting::mesh::Mesh;
    use crate::generators::generate;

    /// The page of a furnace whose walls have a name that would end a script.
    fn page() -> (String, usize) {
        let mut scene = generate("furnace").expect("listed");
        scene.materials[0].name = "</script><b>&".to_owned();
        let mesh = Mesh::new(&scene, 600).expect("valid");
        let count = mesh.elements.len();
        let numbers = |count: usize| (0..count).map(|k| k as f64).collect::<Vec<_>>();
        let fields = Fields {
            bands: 3,
            radiosity: numbers(3 * count),
            emission: numbers(3 * count),
            irradiance: numbers(3 * count),
            row_sums: numbers(count),
        };
        let sight = Sight::new(&scene, &mesh).expect("finite");
        let colours = Colours::of_elements(&fields, Quantity::Light);
        let shading = Shading::smooth(&sight, &fields, &colours).expect("matching");
        let mut file = Vec::new();
        let page = Page {
            title: "<furnace>",
            quantity: Quantity::Light,
            is_solved: true,
            sight: &sight,
            fields: &fields,
            shading: &shading,
            colours: &colours,
        };
        write(&mut file, &page).expect("written");
        let short = Fields { row_sums: Vec::new(), ..fields.clone() };
        assert!(write(&mut Vec::new(), &Page { fields: &short, ..page }).is_err());
        (String::from_utf8(file).expect("text"), count)
    }

    /// What is between two marks.
    fn between<'a>(text: &'a str, before: &str, after: &str) -> &'a str {
        let (_, rest) = text.split_once(before).expect(before);
        rest.split_once(after).expect(after).0
    }

    #[test]
    fn the_numbers_are_in_the_page_and_nothing_comes_from_elsewhere() {
        let (text, count) = page();
        let meta = between(&text, "id=\"meta\">", "</script>");
        let meta: Value = serde_json::from_str(meta).expect("whole, whatever names there are");
        assert_eq!(meta["title"], "<furnace>");
        assert_eq!(meta["materials"][0]["name"], "</script><b>&");
        let data = between(&text, "id=\"data\">", "</script>");
        let data = STANDARD.decode(data).expect("base 64");
        let array = |name: &str| {
            let arrays = meta["arrays"].as_array().expect("a list");
            let array = arrays.iter().find(|array| array["name"] == name).expect(name);
            let number = |key: &str| array[key].as_u64().expect("a number") as usize;
            (number("offset"), number("count"))
        };
        let (offset, number) = array("radiosity");
        assert_eq!(number, 3 * count);
        for k in 0..number {
            let bytes = data[offset + 4 * k..][..4].try_into().expect("four");
            assert_eq!(f32::from_le_bytes(bytes), k as f32);
        }
        let (offset, number) = array("sizes");
        assert!(number == count && data[offset..][..count].iter().all(|&size| size == 4));
        assert_eq!(array("palette").1, 3 * PALETTE);
        for outside in ["http:", "https:", "src=\"", "href=", "import(", "@import", "url("] {
            assert!(!text.contains(outside), "{outside}");
        }
        assert!(!text.contains("{{") && text.ends_with("</html>\n"));
        assert!(text.contains("#version 300 es") && text.contains("class Drawing"));
    }
}

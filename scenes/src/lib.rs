//! Scenes for radiosity: read from files or generated, mended, cut into elements, pictured and written.
//!
//! The folders of this crate are the stages that a scene passes through, and each imports only from
//! those above it:
//!
//! | folder | what it does |
//! |---|---|
//! | `scene` | surfaces, oriented points, materials and camera, with the checks they must pass |
//! | `repair` | mends what files hold: welding, triangulation, orientation, panels that look out of closed rooms |
//! | `generators` | scenes by name, such as the Cornell box |
//! | `formats` | reads OBJ, STL, PLY, OFF, VS3, glTF, and descriptions in TOML |
//! | `cutting` | cuts surfaces into elements, as small as a tolerance asks for |
//! | `pictures` | casts rays, smooths fields, maps values to colours |
//! | `output` | writes PNG, PLY, VTU, CSV and glTF files, all of them or none |
//!
//! Nothing here knows how light is exchanged: the fields on a mesh come from elsewhere.
//!
//! ```
//! use farfield_scenes::{Mesh, load};
//!
//! let scene = load("cornell")?;
//! let mesh = Mesh::new(&scene, 1_000)?;
//! assert!((900..=1_000).contains(&mesh.elements.len()));
//! # Ok::<(), farfield_scenes::SceneError>(())
//! ```

mod scene;
mod repair;
mod generators;
mod formats;
mod cutting;
mod pictures;
mod output;

pub use cutting::fields::Fields;
pub use cutting::lamps::with_lamps_cut;
pub use cutting::mesh::{Mesh, even_cuts, fewest_elements};
pub use cutting::optics::Optics;
pub use cutting::pieces::Cuts;
pub use cutting::refine::Refinement;
pub use formats::load::load;
pub use formats::view3d::{View3d, View3dRole, View3dSurface};
pub use generators::{GENERATORS, generate};
pub use output::files::{Output, OutputError, png_uri, write_file};
pub use output::page::Page;
pub use output::replacing::is_same_file;
pub use output::table::Table;
pub use pictures::colours::Colours;
pub use pictures::lamps::{ByPixel, direct_light_by_pixel};
pub use pictures::picture::Picture;
pub use pictures::shading::Shading;
pub use pictures::sight::Sight;
pub use pictures::tone::Rgb;
pub use scene::error::SceneError;
pub use scene::material::Material;
pub use scene::place::Part;
pub use scene::surface::{ScenePoint, Surface};
pub use scene::viewpoint::Viewpoint;
pub use scene::{Quantity, STEFAN_BOLTZMANN, Scene};

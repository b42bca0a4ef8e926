//! What exchanges light: surfels, patches, elements, and scenes made of them.

mod surfel;
mod triangle;
mod patch;
mod element;
mod scene;

pub use element::Element;
pub use patch::Patch;
pub use scene::{
    Scene, furnace, quad_pieces, quad_surfels, quad_triangles, sphere_interior, two_rooms,
};
pub(crate) use surfel::{CLOSEST, closest};
pub use surfel::{Projections, Surfel, check_emission, check_reflectance, check_surfels};
pub use triangle::Triangle;

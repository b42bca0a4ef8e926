//! Pictures of a solved scene: a camera, rays, smooth fields, light from lamps, colours.

pub(crate) mod camera;
pub(crate) mod colours;
pub(crate) mod exposure;
pub(crate) mod film;
pub(crate) mod fit;
pub(crate) mod lamps;
pub(crate) mod neighbours;
pub(crate) mod palette;
pub(crate) mod picture;
#[cfg(test)]
mod samples;
pub(crate) mod shading;
pub(crate) mod sight;
pub(crate) mod smooth;
pub(crate) mod tone;
pub(crate) mod vertices;
pub(crate) mod view;

//! Scenes cut into elements, what these are made of, and how small a tolerance asks them to be.

pub(crate) mod contacts;
pub(crate) mod fields;
pub(crate) mod lamps;
pub(crate) mod mesh;
pub(crate) mod optics;
pub(crate) mod overlaps;
pub(crate) mod pieces;
pub(crate) mod polygon;
pub(crate) mod refine;
pub(crate) mod slopes;

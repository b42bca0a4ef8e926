//! Mending of what files hold: vertices welded, polygons cut into flat convex pieces, neighbours made to
//! agree about their fronts and look into closed rooms, areas of points estimated.

pub(crate) mod facing;
pub(crate) mod flat;
pub(crate) mod memory;
pub(crate) mod orient;
pub(crate) mod point_areas;
pub(crate) mod soup;
pub(crate) mod triangulate;

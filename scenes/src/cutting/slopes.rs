//! How much a field changes from a surface in one piece to those beyond its edges.

use std::collections::HashMap;

use glam::{DMat2, DVec2, DVec3};

use crate::cutting::mesh::Mesh;
use crate::cutting::pieces::piece_count;
use crate::scene::Scene;
use crate::scene::weld::Weld;

/// The slopes of a field on surfaces that are one piece each.
pub(crate) struct Slopes<'a> {
    scene: &'a Scene,
    mesh: &'a Mesh,
    values: &'a [f64],
    /// For each surface, those beyond its edges.
    neighbours: Vec<Vec<u32>>,
}

/// The least cosine between the normals of two sides that continue each other.
const LEAST_COSINE: f64 = 0.5;

/// The least ratio of the two principal scatters of neighbours around a piece from which both components
/// of a slope follow.
const LEAST_SCATTER: f64 = 0.05;

/// How much a field changes along an edge at most, in units of what it differs by from a neighbour's.
const MOST_CHANGE: f64 = 6.0;

impl<'a> Slopes<'a> {
    /// The slopes of `values`, a field on the mesh of a scene: any number of bands per element.
    pub(crate) fn new(scene: &'a Scene, mesh: &'a Mesh, values: &'a [f64]) -> Self {
        let surfaces = mesh.wholes.iter().take(scene.surfaces.len());
        let whole = surfaces.map(|whole| whole.cuts == [1, 1]).collect::<Vec<_>>();
        Self { scene, mesh, values, neighbours: neighbours(scene, &whole) }
    }

    /// The mean square deviations of the field along the edges from a surface's first corner to its second
    /// and to its last, times area, on the side that is the element `own`, summed over bands. None without
    /// neighbours.
    ///
    /// The slope is that of the linear function that fits the means of neighbours best. Where they all lie
    /// in one direction, the field is taken to change across it as along it, but along no edge by more than a few
    /// times what neighbours differ by: those of slivers are so near that a slope is a quotient of nothings.
    pub(crate) fn squares(&self, surface: usize, own: usize) -> Option<[f64; 2]> {
        let surfel = self.mesh.elements[own].surfel();
        let (u, v) = surfel.normal.any_orthonormal_pair();
        let flat = |p: DVec3| DVec2::new(p.dot(u), p.dot(v));
        let beyond: Vec<(DVec2, Vec<f64>)> = self.neighbours[surface]
            .iter()
            .filter_map(|&other| self.mean(other as usize, surfel.normal))
            .map(|(centre, mean)| (flat(centre - surfel.position), mean))
            .filter(|(offset, _)| offset.length_squared() > 0.0)
            .collect();
        if beyond.is_empty() {
            return None;
        }
        let corners = self.scene.corners(&self.scene.surfaces[surface]);
        let [first, second, .., last] = corners.as_slice() else { return None };
        let edges = [flat(second - first), flat(last - first)];

        // Near neighbours and far ones count alike.
        let unit = |offset: &DVec2| *offset / offset.length();
        let outer = |d: DVec2| DMat2::from_cols(d * d.x, d * d.y);
        let scatter: DMat2 =
            beyond.iter().map(|(offset, _)| outer(unit(offset))).fold(DMat2::ZERO, |a, b| a + b);
        let half = 0.5 * (scatter.x_axis.x + scatter.y_axis.y);
        let is_spread = scatter.determinant() > LEAST_SCATTER * half * half;
        let mut squares = [0.0; 2];
        for (band, &here) in self.value(own).iter().enumerate() {
            let most = beyond.iter().map(|(_, mean)| (mean[band] - here).abs()).fold(0.0, f64::max);
            let most = (MOST_CHANGE * most).powi(2);
            let rises = || beyond.iter().map(|(d, mean)| (d, (mean[band] - here) / d.length()));
            if is_spread {
                let moment: DVec2 = rises().map(|(d, rise)| rise * unit(d)).sum();
                let slope = scatter.inverse() * moment;
                squares = [0, 1].map(|k| squares[k] + slope.dot(edges[k]).powi(2).min(most));
            } else {
                let square: f64 = rises().map(|(_, rise)| rise * rise).sum();
                let square = square / beyond.len() as f64;
                let along = |k: usize| square * edges[k].length_squared();
                squares = [0, 1].map(|k| squares[k] + along(k).min(most));
            }
        }
        Some(squares.map(|square| surfel.area * square / 12.0))
    }

    /// The centre of the side of a surface that looks about along `normal`, and the mean of the field
    /// there; none if it has no such side.
    fn mean(&self, surface: usize, normal: DVec3) -> Option<(DVec3, Vec<f64>)> {
        let whole = self.mesh.wholes[surface];
        let count = piece_count(self.scene.surfaces[surface].corners.len(), whole.cuts);
        let two_sided = self.scene.materials[self.scene.surfaces[surface].material].two_sided;
        let starts = [Some(whole.first), two_sided.then_some(whole.first + count)];
        let along =
            |start: &usize| self.mesh.elements[*start].surfel().normal.dot(normal) >= LEAST_COSINE;
        let start = starts.into_iter().flatten().find(along)?;
        let (mut centre, mut sum, mut area) = (DVec3::ZERO, vec![0.0; self.bands()], 0.0);
        for element in start..start + count {
            let surfel = self.mesh.elements[element].surfel();
            centre += surfel.area * surfel.position;
            area += surfel.area;
            let values = sum.iter_mut().zip(self.value(element));
            values.for_each(|(sum, value)| *sum += surfel.area * value);
        }
        sum.iter_mut().for_each(|sum| *sum /= area);
        Some((centre / area, sum))
    }

    fn value(&self, element: usize) -> &[f64] {
        &self.values[element * self.bands()..][..self.bands()]
    }

    fn bands(&self) -> usize {
        self.values.len() / self.mesh.elements.len().max(1)
    }
}

/// For each surface that is a `whole`, the surfaces that share an edge with it.
fn neighbours(scene: &Scene, whole: &[bool]) -> Vec<Vec<u32>> {
    let mut neighbours = vec![Vec::new(); scene.surfaces.len()];
    if !whole.contains(&true) {
        return neighbours;
    }
    let mut weld = Weld::default();
    let mut sides: HashMap<[u32; 2], Vec<u32>> = HashMap::new();
    for (index, surface) in scene.surfaces.iter().enumerate() {
        let corners: Vec<_> =
            scene.corners(surface).into_iter().map(|place| weld.vertex(place)).collect();
        for (&a, &b) in corners.iter().zip(corners.iter().cycle().skip(1)) {
            sides.entry([a.min(b), a.max(b)]).or_default().push(index as u32);
        }
    }
    // Where more surfaces meet than can continue each other, which of them do isn't known.
    for side in sides.values().filter(|side| side.len() <= MOST_AT_AN_EDGE) {
        for &one in side.iter().filter(|&&one| whole[one as usize]) {
            let others = side.iter().copied().filter(|&other| other != one);
            neighbours[one as usize].extend(others);
        }
    }
    // In an order that doesn't depend on that of the table.
    neighbours.iter_mut().for_each(|others| others.sort_unstable());
    neighbours
}

/// The most surfaces at an edge that count as neighbours.
const MOST_AT_AN_EDGE: usize = 8;

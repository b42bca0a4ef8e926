//! Oriented points: how much of a surface each of them stands for.

use glam::DVec3;
use rstar::RTree;

/// For points spread over surfaces, the area around each as its nearest neighbours tell; none if there
/// are fewer than two places.
///
/// With d_k the distance of the k-th neighbour, π Σ d_k² = Σ k · area in the mean over points spread
/// at random; over a square grid that comes out a fifth too large, over a hexagonal one 4 % too large.
pub(crate) fn areas(positions: &[DVec3]) -> Option<Vec<f64>> {
    let tree = RTree::bulk_load(positions.iter().map(|p| p.to_array()).collect());
    let area = |p: &DVec3| {
        let neighbours = tree.nearest_neighbor_iter_with_distance_2(p.to_array());
        // The point itself is among them, and so is what lies at its place.
        let distances = neighbours.map(|(_, squared)| squared).filter(|&squared| squared > 0.0);
        let (count, sum) = distances
            .take(NEIGHBOURS)
            .fold((0, 0.0), |(count, sum), squared| (count + 1, sum + squared));
        let ranks = count * (count + 1) / 2;
        (ranks > 0).then(|| std::f64::consts::PI * sum / f64::from(ranks))
    };
    positions.iter().map(area).collect()
}

/// How many neighbours are asked.
const NEIGHBOURS: usize = 6;

#[cfg(test)]
mod tests {
    use super::*;
    use farfield_radiosity::sphere_interior;

    #[test]
    fn a_sphere_of_points_has_its_area() {
        let surfels = sphere_interior(2_000, DVec3::ONE, 2.0);
        let positions: Vec<_> = surfels.iter().map(|s| s.position).collect();
        let total: f64 = areas(&positions).expect("neighbours").iter().sum();
        let exact = 16.0 * std::f64::consts::PI;
        assert!((total / exact - 1.0).abs() < 0.15, "{}", total / exact);
    }

    #[test]
    fn a_square_grid_comes_out_a_fifth_too_large() {
        let positions: Vec<_> =
            (0..900).map(|k| DVec3::new((k % 30) as f64, (k / 30) as f64, 0.0)).collect();
        let middle = areas(&positions).expect("neighbours")[15 * 30 + 15];
        assert!((middle - 8.0 * std::f64::consts::PI / 21.0).abs() < 1e-12, "{middle}");
    }

    #[test]
    fn points_without_neighbours_have_no_area() {
        assert!(areas(&[DVec3::ONE]).is_none());
        assert!(areas(&[DVec3::ONE; 5]).is_none());
        assert_eq!(areas(&[]), Some(vec![]));
    }
}

//! The pieces that a polygon is cut into, and which of them holds a point.

use glam::{DVec2, DVec3};

/// Into how many pieces the edges of a surface are cut: those from its first corner to its second and
/// from its first to its last. A triangle's edges are all cut alike, as the first number says.
pub type Cuts = [u32; 2];

/// The pieces of a triangle or quadrilateral, each with the orientation of the whole.
///
/// A quadrilateral is cut into a bilinear grid: piece i·nv + j covers u ∈ [i, i+1]/nu and
/// v ∈ [j, j+1]/nv, where u runs from the first corner to the second, v from the first to the fourth.
/// A triangle is cut into n² similar ones, row by row from its first corner to its second.
pub(crate) fn pieces(corners: &[DVec3], [nu, nv]: Cuts) -> Vec<Vec<DVec3>> {
    let mut pieces = Vec::new();
    match *corners {
        [a, b, c] => {
            let n = nu;
            let at = |i: u32, j: u32| {
                // Exact at the corners, and alike on both sides of a shared edge.
                let weights = [n - i - j, i, j].map(|weight| f64::from(weight) / f64::from(n));
                a * weights[0] + b * weights[1] + c * weights[2]
            };
            for i in 0..n {
                for j in 0..n - i {
                    pieces.push(vec![at(i, j), at(i + 1, j), at(i, j + 1)]);
                    if i + j + 1 < n {
                        pieces.push(vec![at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
                    }
                }
            }
        }
        [a, b, c, d] => {
            let at = |i: u32, j: u32| {
                let (u, v) = (f64::from(i) / f64::from(nu), f64::from(j) / f64::from(nv));
                a.lerp(b, u).lerp(d.lerp(c, u), v)
            };
            for i in 0..nu {
                for j in 0..nv {
                    pieces.push(vec![at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
                }
            }
        }
        _ => (),
    }
    pieces
}

/// The number among [`pieces`] of the one in row i and column j: of a triangle, of those that are not
/// turned. None beyond the last.
pub(crate) fn piece_number(corners: usize, [nu, nv]: Cuts, [i, j]: [u32; 2]) -> Option<usize> {
    let number = match corners {
        3 if i + j < nu => 2 * nu * i - i * i + 2 * j,
        4 if i < nu && j < nv => i * nv + j,
        _ => return None,
    };
    Some(number as usize)
}

/// How many [`pieces`] there are.
pub(crate) fn piece_count(corners: usize, [nu, nv]: Cuts) -> usize {
    nu as usize * if corners == 3 { nu } else { nv } as usize
}

/// The number among [`pieces`] of the one that holds a point, given its [`parameters`] on the
/// whole.
pub(crate) fn piece_at(corners: usize, cuts: Cuts, DVec2 { x: u, y: v }: DVec2) -> Option<usize> {
    let [nu, nv] = cuts.map(f64::from);
    // What lies on the far border belongs to the last one.
    let row = |x: f64, count: u32| (x as u32).min(count - 1);
    if corners != 3 {
        return piece_number(corners, cuts, [row(u * nu, cuts[0]), row(v * nv, cuts[1])]);
    }
    let (x, y) = (u * (1.0 - v) * nu, v * nu);
    let j = row(y, cuts[0]);
    let i = row(x, cuts[0] - j);
    let turned = i + j + 1 < cuts[0] && x + y > f64::from(i + j + 1);
    piece_number(corners, cuts, [i, j]).map(|number| number + usize::from(turned))
}

/// Where a point of a polygon's plane is on the polygon: its corners 0, 1, 2, 3 are at (0, 0), (1, 0), (1, 1),
/// (0, 1). A triangle's corner 2 is the whole edge v = 1, so that what is bilinear in these is linear
/// on it. What has fewer corners is all centre.
pub(crate) fn parameters(corners: &[DVec3], position: DVec3) -> DVec2 {
    let [a, b, c, ref rest @ ..] = *corners else { return DVec2::splat(0.5) };
    let d = rest.first().copied().unwrap_or(c);
    // The inverse of p = a + u e + v f + uv g.
    let (e, f, g, h) = (b - a, d - a, a - b + c - d, position - a);
    let normal = (c - a).cross(d - b);
    // (h - v f) × (e + v g) = 0 is quadratic in v.
    let cross = |p: DVec3, q: DVec3| normal.dot(p.cross(q));
    let [constant, linear, square] = [cross(h, e), cross(h, g) + cross(e, f), cross(g, f)];
    let root = (linear * linear - 4.0 * constant * square).max(0.0).sqrt();
    let v = unit(-2.0 * constant / (linear + root));
    let along = e + v * g;
    DVec2::new(unit((h - v * f).dot(along) / along.length_squared()), v)
}

/// Within [0, 1]; 0 if the corner is one where any value will do.
fn unit(x: f64) -> f64 {
    if x.is_nan() { 0.0 } else { x.clamp(0.0, 1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::geometry::vector_area;
    use farfield_radiosity::Patch;

    #[test]
    fn pieces_fill_their_surface_and_look_the_same_way() {
        let trapezium =
            [DVec3::ZERO, DVec3::X * 3.0, DVec3::new(2.0, 1.0, 1.0), DVec3::new(1.0, 1.0, 1.0)];
        let triangle = [DVec3::ONE, DVec3::X * 3.0, DVec3::Y];
        for (corners, cuts, number) in [
            (&trapezium[..], [4, 7], 28),
            (&trapezium[..], [1, 1], 1),
            (&triangle[..], [5, 1], 25),
            (&triangle[..], [1, 9], 1),
        ] {
            let pieces = pieces(corners, cuts);
            assert_eq!(pieces.len(), number);
            let whole = vector_area(corners);
            let sum: DVec3 = pieces.iter().map(|piece| vector_area(piece)).sum();
            assert!(sum.distance(whole) < 1e-14);
            assert!(pieces.iter().all(|piece| {
                let area = vector_area(piece);
                area.angle_between(whole) < 1e-7 && piece.len() == corners.len()
            }));
        }
        for (corners, cuts) in [(&trapezium[..], [4, 7]), (&triangle[..], [5, 1])] {
            let at = |number: usize| {
                let centre = Patch::new(&pieces(corners, cuts)[number]).expect("flat").centroid();
                piece_at(corners.len(), cuts, parameters(corners, centre))
            };
            let count = piece_count(corners.len(), cuts);
            assert!((0..count).all(|number| at(number) == Some(number)));
            for border in [DVec2::X, DVec2::Y, DVec2::ONE] {
                assert!(piece_at(corners.len(), cuts, border).is_some_and(|number| number < count));
            }
        }
        let similar = pieces(&triangle, [4, 4]);
        let area = vector_area(&triangle).length() / 16.0;
        assert!(similar.iter().all(|piece| (vector_area(piece).length() - area).abs() < 1e-15));
        assert!(pieces(&triangle[..2], [1, 1]).is_empty());
    }
}

//! Turning faces so that neighbours agree which side is the front.

use glam::DVec3;

use crate::scene::geometry::vector_area;
use crate::scene::surface::Surface;

/// What was done to the orientation of a mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Oriented {
    /// How many faces were turned round.
    pub(crate) turned: usize,
    /// How many connected components can't be oriented, like a Möbius strip, and were left as they are.
    pub(crate) unorientable: usize,
    /// How many closed components were made to look outwards although more of them looked inwards.
    pub(crate) doubtful: usize,
}

/// Turns faces until neighbours agree.
///
/// Two faces that share an edge, and no third does, are neighbours and agree if they run along it in
/// opposite directions. A component that agrees already is left alone, since it
/// may well be a room seen from inside. Otherwise, if it is closed, it is made to look inwards where four
/// fifths of its area do so already, as those of a room do, and outwards elsewhere; if it is open, the fewer
/// faces are turned.
pub(crate) fn orient(vertices: &[DVec3], faces: &mut [Surface]) -> Oriented {
    let edges = Edges::new(faces);
    let mut turn: Vec<Option<bool>> = vec![None; faces.len()];
    let mut report = Oriented::default();
    for seed in 0..faces.len() {
        if turn[seed].is_some() {
            continue;
        }
        let component = Component::flood(seed, &edges, &mut turn);
        if !component.orientable {
            report.unorientable += 1;
            continue;
        }
        let of = |face: usize| turn[face] == Some(true);
        let flips = component.faces.iter().filter(|&&face| of(face)).count();
        if flips == 0 {
            continue;
        }
        let mut inwards = 0.0;
        let invert = if component.closed {
            let origin = vertices[faces[seed].corners[0] as usize];
            let volume = |&face: &usize| {
                let corners = faces[face].corners.iter();
                let corners: Vec<_> = corners.map(|&v| vertices[v as usize] - origin).collect();
                let volume = vector_area(&corners).dot(corners[0]);
                if of(face) { -volume } else { volume }
            };
            let invert = component.faces.iter().map(volume).sum::<f64>() < 0.0;
            let area = |face: usize| {
                let corners = faces[face].corners.iter();
                vector_area(&corners.map(|&v| vertices[v as usize]).collect::<Vec<_>>()).length()
            };
            inwards = share(&component.faces, |face| of(face) != invert, area);
            invert != (inwards >= ROOM)
        } else {
            2 * flips > component.faces.len()
        };
        report.doubtful += usize::from(inwards > 0.5 && inwards < ROOM);
        for &face in component.faces.iter().filter(|&&face| of(face) != invert) {
            faces[face].corners.reverse();
            report.turned += 1;
        }
    }
    report
}

/// The share of the area of a closed component that looks inwards if it is a room of which some faces are turned.
const ROOM: f64 = 0.8;

/// The share of the area of faces that those of one kind have.
fn share(faces: &[usize], is_one: impl Fn(usize) -> bool, area: impl Fn(usize) -> f64) -> f64 {
    let of = |one: bool| -> f64 {
        faces.iter().filter(|&&face| !one || is_one(face)).map(|&face| area(face)).sum()
    };
    of(true) / of(false).max(f64::MIN_POSITIVE)
}

/// A face along an edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Side {
    /// The vertices of the edge, the smaller one first.
    edge: [u32; 2],
    /// The face.
    face: usize,
    /// Whether it runs along the edge from the smaller vertex to the larger one.
    forward: bool,
}

/// The faces along every edge.
struct Edges {
    /// All sides by edge.
    sides: Vec<Side>,
    /// For each face, the positions of its sides in that list.
    of_face: Vec<Vec<usize>>,
}

impl Edges {
    fn new(faces: &[Surface]) -> Self {
        let mut sides = Vec::with_capacity(3 * faces.len());
        for (face, Surface { corners, .. }) in faces.iter().enumerate() {
            for (&a, &b) in corners.iter().zip(corners.iter().cycle().skip(1)) {
                sides.push(Side { edge: [a.min(b), a.max(b)], face, forward: a < b });
            }
        }
        sides.sort_unstable();
        let mut of_face = vec![Vec::new(); faces.len()];
        for (position, side) in sides.iter().enumerate() {
            of_face[side.face].push(position);
        }
        Self { sides, of_face }
    }

    /// The other side at the edge of a side; none unless it is one of two there.
    fn opposite(&self, position: usize) -> Option<Side> {
        let edge = self.sides[position].edge;
        let alike = |k: usize| self.sides.get(k).is_some_and(|side| side.edge == edge);
        // Where many faces meet, three of them tell as much as all.
        let before = (0..position).rev().take(3);
        let start = before.take_while(|&k| alike(k)).last().unwrap_or(position);
        let pair = alike(start + 1) && !alike(start + 2);
        pair.then(|| self.sides[if position == start { start + 1 } else { start }])
    }
}

/// Faces that are connected through neighbours.
struct Component {
    faces: Vec<usize>,
    /// Whether all its faces can agree.
    orientable: bool,
    /// Whether all its faces have neighbours at all their edges.
    closed: bool,
}

impl Component {
    /// The component of the face `seed`. Notes for each of its faces whether to turn it for all to
    /// agree with the seed.
    fn flood(seed: usize, edges: &Edges, turn: &mut [Option<bool>]) -> Self {
        let mut component = Self { faces: vec![seed], orientable: true, closed: true };
        turn[seed] = Some(false);
        let mut next = 0;
        while let Some(&face) = component.faces.get(next) {
            next += 1;
            for &position in &edges.of_face[face] {
                let Some(other) = edges.opposite(position) else {
                    component.closed = false;
                    continue;
                };
                let disagree = edges.sides[position].forward == other.forward;
                let wanted = turn[face].map(|turned| turned != disagree);
                if turn[other.face].is_none() {
                    turn[other.face] = wanted;
                    component.faces.push(other.face);
                }
                component.orientable &= turn[other.face] == wanted;
            }
        }
        component
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;

    const TETRAHEDRON: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

    fn vertices() -> Vec<DVec3> {
        vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z]
    }

    fn surfaces(faces: &[[u32; 3]]) -> Vec<Surface> {
        let surface = |face: &[u32; 3]| Surface { corners: face.to_vec(), material: 0, face: 0 };
        faces.iter().map(surface).collect()
    }

    #[test]
    fn turned_faces_of_a_closed_mesh_are_turned_back_outwards() {
        for mask in 1..15u32 {
            let mut faces = surfaces(&TETRAHEDRON);
            for (k, face) in faces.iter_mut().enumerate() {
                if mask >> k & 1 == 1 {
                    face.corners.reverse();
                }
            }
            let report = orient(&vertices(), &mut faces);
            let areas = [0.5, 0.5, 0.5, 0.75f64.sqrt()];
            let inwards: f64 = (0..4).filter(|k| mask >> k & 1 == 1).map(|k| areas[k]).sum();
            let doubtful = usize::from(2.0 * inwards > areas.iter().sum());
            let turned = mask.count_ones() as usize;
            let expected = Oriented { turned, unorientable: 0, doubtful };
            assert_eq!(report, expected, "{mask:b}");
            let scene = Scene { vertices: vertices(), surfaces: faces, ..Scene::default() };
            assert!((scene.volume() - 1.0 / 6.0).abs() < 1e-15, "{mask:b}");
        }
    }

    #[test]
    fn a_room_with_few_faces_turned_stays_a_room() {
        let corner = |k: u32| DVec3::new((k & 1).into(), (k >> 1 & 1).into(), (k >> 2).into());
        let vertices: Vec<_> = (0..8).map(corner).collect();
        let outwards =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let volume = |turned: &[usize]| {
            let mut faces: Vec<_> = outwards
                .iter()
                .map(|face| Surface { corners: face.to_vec(), material: 0, face: 0 })
                .collect();
            for &k in turned {
                faces[k].corners.reverse();
            }
            let report = orient(&vertices, &mut faces);
            let scene = Scene { vertices: vertices.clone(), surfaces: faces, ..Scene::default() };
            (scene.volume().round(), report.turned, report.doubtful)
        };
        assert_eq!(
            volume(&[0, 1, 2, 3, 4]),
            (-1.0, 1, 0),
            "a room of six walls, one of them turned"
        );
        assert_eq!(volume(&[0, 1, 2, 3]), (1.0, 4, 1), "who knows");
        assert_eq!(volume(&[5]), (1.0, 1, 0), "a body");
    }

    #[test]
    fn a_mesh_in_agreement_is_left_alone_even_inside_out() {
        for reverse in [false, true] {
            let mut faces = surfaces(&TETRAHEDRON);
            if reverse {
                faces.iter_mut().for_each(|face| face.corners.reverse());
            }
            let before = faces.clone();
            assert_eq!(orient(&vertices(), &mut faces), Oriented::default());
            assert_eq!(faces, before);
        }
    }

    #[test]
    fn of_an_open_sheet_the_fewer_faces_are_turned() {
        let strip =
            |k: u32| if k.is_multiple_of(2) { [k, k + 1, k + 2] } else { [k + 1, k, k + 2] };
        let vertices: Vec<_> = (0..9).map(|k| DVec3::new(k as f64, (k % 2) as f64, 0.0)).collect();
        let right: Vec<_> = (0..7).map(strip).collect();
        for wrong in [vec![3], vec![0, 4, 6]] {
            let mut faces = surfaces(&right);
            wrong.iter().for_each(|&k: &usize| faces[k].corners.reverse());
            let report = orient(&vertices, &mut faces);
            assert_eq!(report.turned, wrong.len());
            let directed = |face: &Surface| {
                let mut f = face.corners.clone();
                let first = f.iter().position(|v| v == f.iter().min().expect("a corner"));
                f.rotate_left(first.expect("found above"));
                f
            };
            let found: Vec<_> = faces.iter().map(directed).collect();
            let expected: Vec<_> = surfaces(&right).iter().map(directed).collect();
            assert_eq!(found, expected);
        }
    }

    #[test]
    fn a_moebius_strip_is_left_as_it_is() {
        // Six triangles in a strip; its end, twisted, is its beginning.
        let mut faces =
            surfaces(&[[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 5], [4, 5, 1], [1, 5, 0]]);
        let before = faces.clone();
        let vertices = vec![DVec3::ZERO; 6];
        let expected = Oriented { unorientable: 1, ..Oriented::default() };
        assert_eq!(orient(&vertices, &mut faces), expected);
        assert_eq!(faces, before);
    }

    #[test]
    fn edges_of_three_faces_connect_nothing() {
        let mut faces = surfaces(&[[0, 1, 2], [0, 1, 3], [0, 1, 4]]);
        let vertices = vec![DVec3::ZERO; 5];
        assert_eq!(orient(&vertices, &mut faces), Oriented::default());
    }
}

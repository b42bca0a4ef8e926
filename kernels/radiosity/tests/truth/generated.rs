//! Small scenes made at random from what goes wrong: bodies that touch, overlap or stand on each other, walls
//! that end within others, sheets, slivers, needles, holes, odd angles, any scale.

use farfield_radiosity::{Element, Patch, Scene, quad_pieces};
use farfield_testing::clouds::Random;
use glam::{DQuat, DVec3};

/// A scene, and what it is made of.
pub(crate) struct Generated {
    pub(crate) scene: Scene,
    pub(crate) names: Vec<&'static str>,
}

/// The scene of a seed: a room, a floor or nothing, and two to four things in it. A few hundred elements.
pub(crate) fn generated(seed: u64) -> Generated {
    let mut random = Random::new(seed.wrapping_mul(0x2545_f491_4f6c_dd1d));
    let frame = Frame::new(&mut random);
    let mut maker = Maker { random, frame, scene: Scene::new(), names: Vec::new() };
    match seed % 4 {
        0 | 1 => maker.room(),
        2 => maker.floor(),
        _ => maker.name("nothing"),
    }
    for _ in 0..2 + maker.random.below(3) {
        maker.thing();
    }
    Generated { scene: maker.scene, names: maker.names }
}

/// Where the unit cube of the scene lies.
struct Frame {
    scale: f64,
    turn: DQuat,
    shift: DVec3,
}

impl Frame {
    fn new(random: &mut Random) -> Self {
        let scale = [1.0, 1.0, 1e-6, 1e6, 30.0][random.below(5)];
        let turned = random.below(3) > 0;
        let angle = if turned { random.between(0.1, 3.0) } else { 0.0 };
        let shift = if random.below(3) == 0 { random.in_cube() * 5.0 } else { DVec3::ZERO };
        Self { scale, turn: DQuat::from_axis_angle(random.direction(), angle), shift }
    }

    fn place(&self, p: DVec3) -> DVec3 {
        (self.turn * p + self.shift) * self.scale
    }
}

/// A scene as far as it is made.
struct Maker {
    random: Random,
    frame: Frame,
    scene: Scene,
    names: Vec<&'static str>,
}

impl Maker {
    fn name(&mut self, name: &'static str) {
        self.names.push(name);
    }

    /// The unit cube from inside.
    fn room(&mut self) {
        self.name("room");
        self.cuboid(DVec3::ZERO, DVec3::ONE, [4; 3], false);
    }

    fn floor(&mut self) {
        self.name("floor");
        self.quad([DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y], [5, 5]);
    }

    fn thing(&mut self) {
        match self.random.below(12) {
            0 => {
                self.name("box on the floor");
                let (low, size) = self.footprint();
                self.body(low, size);
            }
            1 => {
                self.name("box in the floor, overlapping the next");
                let (low, size) = self.footprint();
                self.body(low - DVec3::Z * 0.1, size);
                self.body(low + 0.4 * size.with_z(0.0), size * 0.8);
            }
            2 => {
                self.name("stacked boxes");
                let (low, size) = self.footprint();
                self.body(low, size);
                self.body(low + size * DVec3::new(0.1, 0.2, 1.0), size * 0.5);
            }
            3 => {
                self.name("boxes side by side, tops in one plane");
                let (low, size) = self.footprint();
                let half = size * DVec3::new(0.5, 1.0, 1.0);
                self.body(low, half);
                self.body(low + half.with_y(0.0).with_z(0.0), half);
            }
            4 => {
                self.name("partition");
                let at = [0.5, self.random.between(0.1, 0.9)][self.random.below(2)];
                let height = [1.0, self.random.between(0.2, 0.9)][self.random.below(2)];
                self.wall([at, 0.0], [at, 1.0], height);
            }
            5 => {
                self.name("partition that ends within another");
                let [x, y] = [0.2, 0.3].map(|low| self.random.between(low, low + 0.5));
                self.wall([x, 0.0], [x, 1.0], 0.8);
                self.wall([x, y], [1.0, y], 0.6);
            }
            6 => {
                self.name("sheet");
                let corners = self.tilted(0.4);
                self.sheet(corners, [3, 3]);
            }
            7 => {
                self.name("sheets that cross");
                let first = self.tilted(0.3);
                let middle = first.iter().sum::<DVec3>() / 4.0;
                let turn = DQuat::from_axis_angle(self.random.direction(), 1.1);
                self.sheet(first, [3, 2]);
                self.sheet(first.map(|corner| middle + turn * (corner - middle)), [2, 3]);
            }
            8 => {
                self.name("plate of next to no thickness");
                let (low, size) = self.footprint();
                let thickness = [1e-3, 1e-6][self.random.below(2)];
                let height = self.random.between(0.1, 0.8);
                self.body(low + DVec3::Z * height, size.with_z(thickness));
            }
            9 => {
                self.name("needle and slivers");
                let from = self.inside();
                let along = self.random.direction() * 0.4;
                let (aside, _) = along.any_orthonormal_pair();
                let wide = aside * 1e-3;
                self.sheet([from, from + along, from + along + wide, from + wide], [6, 1]);
                for k in 0..5 {
                    let tip = |k: f64| from + along + aside * 0.02 * k;
                    self.triangle([from, tip(f64::from(k)), tip(f64::from(k + 1))]);
                }
            }
            10 => {
                self.name("frame around a hole");
                let (low, size) = self.footprint();
                let at = |u: f64, v: f64| low + DVec3::new(u * size.x, 0.0, 0.1 + v * 0.6);
                for [u, v, w, t] in [
                    [0.0, 0.0, 1.0, 0.3],
                    [0.0, 0.7, 1.0, 1.0],
                    [0.0, 0.3, 0.3, 0.7],
                    [0.7, 0.3, 1.0, 0.7],
                ] {
                    self.sheet([at(u, v), at(w, v), at(w, t), at(u, t)], [2, 2]);
                }
            }
            _ => {
                self.name("tetrahedron");
                let corners: [DVec3; 4] = std::array::from_fn(|_| self.inside());
                let middle = corners.iter().sum::<DVec3>() / 4.0;
                for face in [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]] {
                    let [a, b, c] = face.map(|k: usize| corners[k]);
                    let outwards = (b - a).cross(c - a).dot(a - middle) > 0.0;
                    self.triangle(if outwards { [a, b, c] } else { [a, c, b] });
                }
            }
        }
    }

    /// A point well inside.
    fn inside(&mut self) -> DVec3 {
        DVec3::splat(0.1) + self.random.in_cube() * 0.7
    }

    /// The low corner and the size of a box that stands on the floor.
    fn footprint(&mut self) -> (DVec3, DVec3) {
        let low = self.inside().with_z(0.0);
        let size = DVec3::splat(0.1) + self.random.in_cube() * 0.3;
        (low, size.min(DVec3::ONE - low))
    }

    /// The corners of a square of this side in mid-air, tilted.
    fn tilted(&mut self, side: f64) -> [DVec3; 4] {
        let (middle, normal) = (self.inside(), self.random.direction());
        let (u, v) = normal.any_orthonormal_pair();
        [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
            .map(|[x, y]| middle + (u * x + v * y) * (0.5 * side))
    }

    /// A box from outside.
    fn body(&mut self, low: DVec3, size: DVec3) {
        let counts = std::array::from_fn(|_| 1 + self.random.below(2));
        self.cuboid(low, size, counts, true);
    }

    fn cuboid(&mut self, low: DVec3, size: DVec3, counts: [usize; 3], outwards: bool) {
        for axis in 0..3 {
            let [i, j] = [(axis + 1) % 3, (axis + 2) % 3];
            let [u, v, w] = [i, j, axis].map(|k| DVec3::AXES[k] * size[k]);
            let (near, far) =
                ([low, low + u, low + u + v, low + v], [low, low + v, low + u + v, low + u]);
            let [near, far] = if outwards { [far, near] } else { [near, far] };
            let count =
                |first: bool| if first != outwards { [i, j] } else { [j, i] }.map(|k| counts[k]);
            self.quad(near, count(true));
            self.quad(far.map(|corner| corner + w), count(false));
        }
    }

    /// A wall of no thickness that stands on the floor, a face for each of its sides.
    fn wall(&mut self, [x, y]: [f64; 2], [u, v]: [f64; 2], height: f64) {
        let [a, b] = [DVec3::new(x, y, 0.0), DVec3::new(u, v, 0.0)];
        let up = DVec3::Z * height;
        self.quad([a, b, b + up, a + up], [4, 3]);
        self.quad([b, a, a + up, b + up], [3, 2]);
    }

    /// Both sides of one face.
    fn sheet(&mut self, corners: [DVec3; 4], counts: [usize; 2]) {
        let face = self.quad(corners, counts);
        let [a, b, c, d] = corners.map(|corner| self.frame.place(corner));
        let back = [b, a, d, c];
        for piece in quad_pieces(back, counts[0], counts[1]) {
            self.element(&piece, face);
        }
    }

    fn triangle(&mut self, [a, b, c]: [DVec3; 3]) {
        let corners = [a, b, c].map(|corner| self.frame.place(corner));
        let face = self.scene.add_quad([corners[0], corners[1], corners[2], corners[2]], 0, 0);
        self.element(&corners, face);
    }

    fn element(&mut self, corners: &[DVec3], face: u32) {
        let element = Element::patch(Patch::new(corners).expect("flat"), face);
        self.scene.surfels.push(*element.surfel());
        self.scene.elements.push(element);
    }

    fn quad(&mut self, corners: [DVec3; 4], [nu, nv]: [usize; 2]) -> u32 {
        let corners = corners.map(|corner| self.frame.place(corner));
        self.scene.add_quad(corners, nu, nv)
    }
}

//! What must hold for the exchange of any scene, by exact and by fractional visibility.
//!
//! `PROPTEST_CASES=2000 cargo test -p farfield-radiosity --test truth properties` looks longer.

use std::f64::consts::TAU;

use farfield::{Fmm, Mask};
use farfield_radiosity::{
    Element, Irradiance, Occluders, RadiosityOperator, Stop, Surfel, Surroundings, Triangle,
    Visibility, conjugate_gradients,
};
use farfield_testing::clouds::Random;
use glam::DVec3;

use crate::generated::{Generated, generated};

/// Scenes, unless the environment asks for more.
const SCENES: u64 = 50;

/// Elements whose pairs with all others are looked at.
const COLUMNS: usize = 40;

/// Rows that are held against rays, and rays of each.
const ROWS: usize = 2;
const RAYS: usize = 2000;

#[test]
fn the_exchange_of_any_scene_is_that_of_light() {
    let asked = std::env::var("PROPTEST_CASES").ok().and_then(|count| count.parse::<u64>().ok());
    let count = asked.unwrap_or(SCENES);
    let mut wrong = Vec::new();
    let mut refused = 0u64;
    let mut judged = Judged::default();
    for seed in 0..count {
        let made = generated(seed);
        for (fractional, tolerance) in [(false, 1e-2), (true, 1e-1)] {
            let mut case = Case { made: &made, tolerance, fractional, wrong: Vec::new() };
            refused += u64::from(case.check(seed, &mut judged).is_none());
            let found = case.wrong.into_iter();
            wrong.extend(found.map(|what| format!("{seed} {:?} {what}", made.names)));
        }
    }
    println!("refused {refused}, {judged:?}");
    assert!(wrong.is_empty(), "{wrong:#?}");
    // Elements wider than the gap that they bound are too coarse for their rows to be closed.
    assert!(refused * 100 <= count, "{refused} scenes whose rows could not be closed");
}

/// How far factors are from those by rays, beyond what these are off by.
#[derive(Debug, Default)]
struct Judged {
    rows: usize,
    sum: f64,
    squares: f64,
    worst: f64,
}

/// One scene by one kind of visibility.
struct Case<'a> {
    made: &'a Generated,
    tolerance: f64,
    fractional: bool,
    wrong: Vec<String>,
}

impl Case<'_> {
    /// Notes what is wrong; none if the rows can't be closed.
    fn check(&mut self, seed: u64, judged: &mut Judged) -> Option<()> {
        let Self { made: Generated { scene, .. }, tolerance, fractional, .. } = *self;
        let (elements, surfels) = (&scene.elements, &scene.surfels);
        let occluders = Occluders::new(&scene.triangles).expect("finite");
        let pairwise = Visibility::of_elements(&occluders, elements);
        let mask = Visibility::of_elements(&occluders, elements);
        let mask =
            if fractional { mask.fractional(tolerance, vec![]).expect("valid") } else { mask };
        let kernel = Irradiance::<f64, [f64; 1]>::clamped();
        let builder = Fmm::builder(kernel).mask(&mask).tolerance(tolerance).leaf_size(8);
        let fmm = builder.build(surfels, surfels).expect("planned");
        let corrections = mask.corrections(elements, tolerance).expect("valid");
        let operator = RadiosityOperator::new(elements, |b| fmm.apply(b), corrections);
        let mut operator = operator.expect("of one length");

        self.pairs(&operator, &pairwise);
        self.sums(&operator, seed);
        if !fractional {
            self.rows(&operator, judged, seed);
        }

        let around = Surroundings::new(elements, &occluders, 64);
        operator.leave_out(around.buried()).expect("of one length");
        let parts = around.closed_parts();
        if let Err(error) = operator.close_parts(parts.to_vec(), 0.5) {
            println!("{seed} {:?} {fractional}: {error}", self.made.names);
            return None;
        }
        self.closed(&operator, parts, seed);
        Some(())
    }

    /// Each pair by itself: A_i F_ij from 0 to the smaller of both areas, the same both ways, and what a
    /// table of factors says of it.
    fn pairs(&mut self, operator: &RadiosityOperator<'_, 1>, pairwise: &Visibility<'_>) {
        let surfels = &self.made.scene.surfels;
        let count = surfels.len();
        let some: Vec<usize> = (0..count).step_by(count.div_ceil(COLUMNS)).collect();
        let column = |&j: &usize| {
            let mut unit = vec![[0.0]; count];
            unit[j] = [1.0];
            operator.apply(&unit).expect("applied")
        };
        let columns: Vec<Vec<[f64; 1]>> = some.iter().map(column).collect();
        let kernel = Irradiance::<f64>::clamped();
        let [mut low, mut high, mut uneven, mut off] = [0.0f64; 4];
        for (&j, column) in some.iter().zip(&columns) {
            let y = &surfels[j];
            let mut formed: Vec<f64> = surfels
                .iter()
                .map(|x| {
                    let share = Mask::<Irradiance<f64>>::pair(pairwise, x, y);
                    if share > 0.0 { share * kernel.factor(x, y) * x.area * y.area } else { 0.0 }
                })
                .collect();
            for (i, value) in operator.corrections().column(j) {
                formed[i] += value * surfels[i].area;
            }
            for (i, x) in surfels.iter().enumerate() {
                let least = x.area.min(y.area);
                low = low.max(-formed[i] / least);
                high = high.max(formed[i] / least);
                off = off.max((x.area * column[i][0] - formed[i]).abs() / least);
            }
            for (&i, back) in some.iter().zip(&columns) {
                let x = &surfels[i];
                let difference = (x.area * column[i][0] - y.area * back[j][0]).abs();
                uneven = uneven.max(difference / x.area.min(y.area));
            }
        }
        self.holds(low < 1e-6, || format!("a factor of {:e}", -low));
        self.holds(high < 1.0 + 1e-6, || format!("a factor of {high}"));
        self.holds(uneven < 1e-4, || format!("{uneven:e} there and not back"));
        let most = if self.fractional { 0.5 } else { 0.1 } * self.tolerance;
        self.holds(off < most, || format!("{off:e} off from the table"));
    }

    /// The sum of two lights is that of their sums.
    fn sums(&mut self, operator: &RadiosityOperator<'_, 1>, seed: u64) {
        let mut random = Random::new(seed);
        let mut light = || -> Vec<[f64; 1]> {
            self.made.scene.surfels.iter().map(|_| [random.between(-1.0, 1.0)]).collect()
        };
        let (u, v) = (light(), light());
        let both: Vec<[f64; 1]> =
            u.iter().zip(&v).map(|(u, v)| [2.0 * u[0] - 3.0 * v[0]]).collect();
        let [of_u, of_v, of_both] = [&u, &v, &both].map(|b| operator.apply(b).expect("applied"));
        let (mut error, mut size) = (0.0, 0.0);
        for ((u, v), both) in of_u.iter().zip(&of_v).zip(&of_both) {
            error += (2.0 * u[0] - 3.0 * v[0] - both[0]).powi(2);
            size += both[0].powi(2);
        }
        let error = (error / size.max(f64::MIN_POSITIVE)).sqrt();
        self.holds(error < 1e-6, || format!("{error:e} off from linear"));
        let uneven = operator.reciprocity_error().expect("applied");
        self.holds(uneven < 2e-6, || format!("{uneven:e} off from reciprocal"));
    }

    /// Some rows against rays that know nothing of the crate.
    fn rows(&mut self, operator: &RadiosityOperator<'_, 1>, judged: &mut Judged, seed: u64) {
        let scene = &self.made.scene;
        let count = scene.elements.len();
        let mut random = Random::new(seed ^ 0x5eed);
        for _ in 0..ROWS {
            let i = random.below(count);
            let by_rays = by_rays(&scene.elements, &scene.triangles, i, &mut random);
            let mut unit = vec![[0.0]; count];
            unit[i] = [1.0];
            let sent = operator.apply(&unit).expect("applied");
            let area = scene.surfels[i].area;
            let row = sent.iter().zip(&scene.surfels).map(|(h, s)| h[0] * s.area / area);
            let row: Vec<f64> = row.collect();
            for (j, (found, rays)) in row.iter().zip(&by_rays).enumerate() {
                let noise = (rays.max(1.0 / RAYS as f64) / RAYS as f64).sqrt();
                let off = ((found - rays).abs() - 4.0 * noise).max(0.0);
                judged.worst = judged.worst.max(off);
                self.holds(off < 0.03, || format!("{i} gives {j} {found}, by rays {rays}"));
            }
            let (sum, rays): (f64, f64) = (row.iter().sum(), by_rays.iter().sum());
            let noise = (rays * (1.0 - rays).max(0.0) / RAYS as f64).sqrt();
            judged.rows += 1;
            judged.sum += sum - rays;
            judged.squares += (sum - rays).powi(2) - noise * noise;
            let off = (sum - rays).abs() - 4.0 * noise;
            self.holds(off < 0.1, || format!("row {i} sums to {sum}, by rays {rays}"));
        }
    }

    /// Rows sum to 1 where surfaces are closed and to no more elsewhere, and no light is below zero.
    fn closed(&mut self, operator: &RadiosityOperator<'_, 1>, parts: &[Option<u32>], seed: u64) {
        let surfels = &self.made.scene.surfels;
        for (sum, part) in operator.row_sums().expect("applied").iter().zip(parts) {
            let fits = if part.is_some() { (sum - 1.0).abs() < 1e-6 } else { *sum < 1.0 + 1e-3 };
            self.holds(fits && *sum > -1e-6, || format!("a row sums to {sum}, {part:?}"));
        }
        let mut random = Random::new(seed);
        let emission: Vec<[f64; 1]> =
            surfels.iter().map(|_| [f64::from(u8::from(random.below(9) == 0))]).collect();
        let reflectance: Vec<[f64; 1]> =
            surfels.iter().map(|_| [random.between(0.0, 0.95)]).collect();
        let stop = Stop { tolerance: 1e-4, max_iterations: 100 };
        let gather = |b: &[[f64; 1]]| operator.apply(b);
        let solution =
            conjugate_gradients(surfels, &emission, &reflectance, stop, gather, |_, _| ());
        let solution = solution.expect("solved");
        let area: f64 = surfels.iter().map(|surfel| surfel.area).sum();
        let squares = solution.irradiance.iter().zip(surfels).map(|(h, s)| s.area * h[0].powi(2));
        let rms = (squares.sum::<f64>() / area).sqrt();
        let least = solution.irradiance.iter().fold(0.0f64, |least, h| least.min(h[0]));
        self.holds(least >= -self.tolerance * rms, || format!("light of {least:e}, rms {rms:e}"));
    }

    fn holds(&mut self, holds: bool, what: impl Fn() -> String) {
        if !holds {
            self.wrong.push(format!("(fractional: {}): {}", self.fractional, what()));
        }
    }
}

/// A row of form factors: which elements rays from all over one arrive at, spread by the cosine law.
fn by_rays(
    elements: &[Element],
    triangles: &[Triangle],
    i: usize,
    random: &mut Random,
) -> Vec<f64> {
    let mut row = vec![0.0; elements.len()];
    let &Surfel { normal, face, .. } = elements[i].surfel();
    let corners = elements[i].as_patch().expect("flat").corners();
    let (x, y) = normal.any_orthonormal_pair();
    // What lies on the element is next to no distance from it.
    let places = elements.iter().map(|element| element.surfel().position);
    let size =
        places.map(|place| place.distance(elements[i].surfel().position)).fold(0.0, f64::max);
    let met = |corners, from, to| met(corners, from, to).filter(|&at| at > 1e-8 * size);
    for _ in 0..RAYS {
        let [u, v] = [random.unit(), random.unit()];
        let [along, aside] =
            if corners.len() == 4 || u + v <= 1.0 { [u, v] } else { [1.0 - u, 1.0 - v] };
        let last = corners[corners.len() - 1];
        let from = corners[0] + (corners[1] - corners[0]) * along + (last - corners[0]) * aside;
        let (sine, (sin, cos)) = (random.unit(), (TAU * random.unit()).sin_cos());
        let to = (x * cos + y * sin) * sine.sqrt() + normal * (1.0 - sine).sqrt();
        let hits: Vec<(f64, u32)> = triangles
            .iter()
            .filter(|triangle| triangle.face != face)
            .filter_map(|triangle| Some((met(triangle.vertices, from, to)?, triangle.face)))
            .collect();
        for (j, element) in elements.iter().enumerate() {
            if element.surfel().normal.dot(to) >= 0.0 {
                continue;
            }
            let corners = element.as_patch().expect("flat").corners();
            let [first, .., last] = corners else { panic!() };
            let halves = [[*first, corners[1], corners[2]], [*first, corners[2], *last]];
            let at = halves[..corners.len() - 2].iter().find_map(|half| met(*half, from, to));
            let Some(at) = at else { continue };
            let hidden = |&(distance, between): &(f64, u32)| {
                between != element.surfel().face && distance < at - 1e-8 * size
            };
            if !hits.iter().any(hidden) {
                row[j] += 1.0 / RAYS as f64;
            }
        }
    }
    row
}

/// How far along a ray a triangle lies (Möller and Trumbore, "Fast, minimum storage ray/triangle
/// intersection", J. Graphics Tools 2, 1997).
fn met([a, b, c]: [DVec3; 3], from: DVec3, along: DVec3) -> Option<f64> {
    let (u, v, start) = (b - a, c - a, from - a);
    let across = along.cross(v);
    let volume = u.dot(across);
    let second = start.cross(u);
    let [s, t, at] = [start.dot(across), along.dot(second), v.dot(second)].map(|x| x / volume);
    (s >= 0.0 && t >= 0.0 && s + t <= 1.0).then_some(at)
}

//! The visibility mask: facing and not hidden.

use std::sync::atomic::{AtomicBool, Ordering};

use farfield::{CellView, Coverage, Mask, Numbers, Real};

use crate::elements::{Element, Projections, Surfel};
use crate::error::Error;
use crate::expansion::Irradiance;
use crate::form_factors::Corrections;
use crate::masks::asked::Asked;
use crate::masks::counts::{Counters, PairCounts};
use crate::masks::facing::facing;
use crate::masks::sampling::{RAYS, Sampling, Seen, even, order};
use crate::occlusion::{Occluders, Shaft, Shape, Sights, SomePairs};

/// The mask V(x, y): a pair counts if the two surfels [face each other](Projections::facing) and no
/// occluder [hides](Occluders::blocked) them from each other; of [elements](Self::of_elements) that see part of
/// each other, by the share of that part. Symmetric, bit for bit.
///
/// Between cells that certainly face each other, a shaft of the occluders' hierarchy certifies that
/// all pairs see each other, a single convex wall that none do. Elsewhere the pairs are asked for one by
/// one, down to the leaves: Θ(N^1.5) rays in all. A [`fractional`](Self::fractional) mask takes fewer.
#[derive(Debug)]
pub struct Visibility<'a> {
    sights: Sights<'a>,
    sampling: Option<Sampling>,
    /// Whether each pair of leaves is asked for once for both directions.
    mirrored: AtomicBool,
    counters: Counters,
}

impl<'a> Visibility<'a> {
    /// The mask of points among these occluders: pairs that no certificate settles have a ray each.
    pub fn new(occluders: &'a Occluders) -> Self {
        Self::with(Sights::of_points(occluders))
    }

    /// The mask of elements, which counts the share of each pair that is unhidden: by four rays from all over
    /// one to all over the other, and by one ray between points at random where one gives the other less
    /// than 1/4096 of its light. Elements are found by their surfels; others are points.
    pub fn of_elements(occluders: &'a Occluders, elements: &[Element]) -> Self {
        Self::with(Sights::of_elements(occluders, elements))
    }

    fn with(sights: Sights<'a>) -> Self {
        let counters = Counters::new(sights.occluders.margin());
        Self { sights, sampling: None, mirrored: AtomicBool::new(false), counters }
    }

    /// Takes visibility by samples where that adds no more than about `tolerance` to the relative l2
    /// error of irradiances: cells of which one gives the other little light, and whose points see about
    /// the same share of each other, are weighed by the share of 16 rays that pass
    /// ([`Coverage::Eighths`]). So are groups within pairs of leaves: all pairs alike if the rays agree,
    /// else row by row or column by column, else in halves.
    ///
    /// `brightness` says how much brighter than the mean radiosity the surfels of a face may be, face by
    /// face, and may be short or empty: lamps need it, whose light would otherwise be taken for little.
    ///
    /// # Errors
    /// [`Error::InvalidTolerance`] unless the tolerance lies between 0 and 1.
    pub fn fractional(self, tolerance: f64, brightness: Vec<f64>) -> Result<Self, Error> {
        Ok(Self { sampling: Some(Sampling::new(tolerance, brightness)?), ..self })
    }

    /// The pairs asked about so far. Those of cells that were found [`Coverage::Partial`] count when
    /// their parts are asked about.
    pub fn counts(&self) -> PairCounts {
        self.counters.pairs()
    }

    /// The standard error that samples bring to irradiances, relative to surfels in an enclosure of even
    /// radiosity: the root of the summed variances of all samples over the `area` of all surfels. 0 if
    /// every pair was asked for. Samples count as independent, which those of one cell are not: errors of
    /// two to five times as much were seen.
    pub fn uncertainty(&self, area: f64) -> f64 {
        (self.counters.variance() / area).sqrt()
    }

    /// The corrections for a sum over the centroids of `elements` that this masks; see [`Corrections::new`].
    ///
    /// # Errors
    /// Those of [`Corrections::new`].
    pub fn corrections(&self, elements: &[Element], tolerance: f64) -> Result<Corrections, Error> {
        Corrections::with(elements, &self.sights, tolerance)
    }

    /// How many of the sampled pairs of two cells that face each other see each other, if so little light
    /// passes between them that this is enough.
    fn visible_samples<T: Real>(
        &self,
        [a, b]: [CellView<'_, Surfel<T>>; 2],
        [a_shapes, b_shapes]: [&[Shape]; 2],
    ) -> Option<usize> {
        let apart = a.cell.level() == b.cell.level() && a.cell.well_separated(b.cell);
        let sampling = self.sampling.as_ref().filter(|_| apart)?;
        let (in_order, key) = order(&a, &b);
        let (a, b) = ((a.points, a_shapes), (b.points, b_shapes));
        let (xs, ys) = if in_order { (a, b) } else { (b, a) };
        let (x, y) = (xs.0, ys.0);
        let strength = sampling.strength(x, y);
        if !sampling.accepts(&strength) || sampling.are_near([a_shapes, b_shapes]) {
            return None;
        }
        let seen = Seen::of(x.len(), y.len(), key, |pairs| {
            self.counters.rays.add(pairs.len() as u64);
            SomePairs { sights: &self.sights, xs, ys, pairs, last: &mut None }.run()
        });
        let uneven = !(seen.rows_agree() && seen.columns_agree());
        if uneven && !sampling.accepts_blindly(&strength) {
            return None;
        }
        // Asked for from both ends, and both count.
        self.counters.add_variance(0.5 * strength.variance(seen.count()));
        Some(even(seen.count(), key))
    }
}

impl<T: Real, C: Numbers<Real = T>> Mask<Irradiance<T, C>> for Visibility<'_> {
    fn cells(
        &self,
        targets: CellView<'_, Surfel<T>>,
        sources: CellView<'_, Surfel<T>>,
    ) -> Coverage {
        let pairs = targets.points.len() as u64 * sources.points.len() as u64;
        match facing(targets.points, sources.points) {
            Coverage::Empty => {
                self.counters.facing_away.add(pairs);
                return Coverage::Empty;
            }
            Coverage::Full => {}
            coverage => return coverage,
        }
        let shapes = [targets.points, sources.points].map(|points| self.sights.shapes_of(points));
        let shaft = Shaft::new((targets.points, &shapes[0]), (sources.points, &shapes[1]));
        if shaft.is_clear(self.sights.occluders) {
            self.counters.certified.add(pairs);
            return Coverage::Full;
        }
        let visible = if shaft.is_blocked(self.sights.occluders) {
            Some(0)
        } else {
            self.visible_samples([targets, sources], [&shapes[0], &shapes[1]])
        };
        match visible {
            None => Coverage::Partial,
            Some(0) => {
                self.counters.hidden.add(pairs);
                Coverage::Empty
            }
            Some(RAYS) => {
                self.counters.sampled.add(pairs);
                Coverage::Full
            }
            Some(visible) => {
                self.counters.sampled.add(pairs);
                Coverage::Eighths((visible / 2) as u8)
            }
        }
    }

    fn pair(&self, x: &Surfel<T>, y: &Surfel<T>) -> f64 {
        if !Projections::new(x, y).facing() {
            self.counters.facing_away.add(1);
            return 0.0;
        }
        let (share, rays) = self.sights.share(x, y);
        self.counters.rays.add(rays as u64);
        if share > 0.0 { &self.counters.unhidden } else { &self.counters.hidden }.add(1);
        share
    }

    fn pairs(
        &self,
        targets: CellView<'_, Surfel<T>>,
        sources: CellView<'_, Surfel<T>>,
        count: &mut dyn FnMut(usize, usize, f64),
    ) {
        let same = targets.cell == sources.cell;
        let (xs, ys) = (targets.points, sources.points);
        let [x_shapes, y_shapes] = [xs, ys].map(|points| self.sights.shapes_of(points));
        let mirrored = self.mirrored.load(Ordering::Relaxed);
        let mut asked = Asked {
            xs: (xs, &x_shapes),
            ys: (ys, &y_shapes),
            sights: &self.sights,
            counters: &self.counters,
            mirrored,
            last: None,
            count,
            facing: 0,
            visible: 0,
            rays: 0,
        };
        match &self.sampling {
            // Both halves of a cell with itself have to come out alike.
            Some(sampling) if !same => asked.groups(sampling, 0..xs.len(), 0..ys.len()),
            _ => asked.one_by_one(0..xs.len(), 0..ys.len()),
        }
        let Asked { facing, visible, rays, .. } = asked;
        let both = if mirrored && !same { 2 } else { 1 };
        self.counters.facing_away.add(both * ((xs.len() * ys.len()) as u64 - facing));
        self.counters.hidden.add(both * (facing - visible));
        self.counters.unhidden.add(both * visible);
        self.counters.rays.add(rays);
    }

    fn is_mirrored(&self, targets: &[Surfel<T>], sources: &[Surfel<T>]) -> bool {
        let mirrored = targets == sources;
        self.mirrored.store(mirrored, Ordering::Relaxed);
        mirrored
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elements::Triangle;
    use crate::occlusion::triangles;
    use farfield::{Cell, Cube};
    use farfield_testing::clouds::Random;
    use glam::DVec3;

    type Kernel = Irradiance<f64>;

    fn square(z: f64, side: f64, up: bool, face: u32) -> Vec<Surfel> {
        let (normal, area) = (if up { DVec3::Z } else { DVec3::NEG_Z }, side * side / 16.0);
        let step = side / 4.0;
        let along = |k: usize| step * (k as f64 - 1.5);
        let at = |k: usize| DVec3::new(along(k / 4), along(k % 4), z);
        (0..16).map(|k| Surfel { position: at(k), normal, area, face }).collect()
    }

    fn screen(z: f64, side: f64, face: u32) -> [Triangle; 2] {
        let [a, b, c, d] = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
            .map(|[x, y]| DVec3::new(x * side / 2.0, y * side / 2.0, z));
        [[a, b, c], [a, c, d]].map(|vertices| Triangle { vertices, face })
    }

    /// What a mask says of two small squares far apart, from both ends alike, with a screen that hides a
    /// quarter of the view between them; its counts, and its uncertainty.
    fn sampled(scale: f64, tolerance: f64, brightness: Vec<f64>) -> (Coverage, PairCounts, f64) {
        let grown =
            |s: Surfel| Surfel { position: s.position * scale, area: s.area * scale * scale, ..s };
        let squares: [Vec<Surfel>; 2] = [square(0.0, 0.2, true, 0), square(3.0, 0.2, false, 1)]
            .map(|square| square.into_iter().map(grown).collect());
        let moved = |v: DVec3| (v + DVec3::X * 0.05) * scale;
        let screen = screen(1.5, 0.1, 2).map(|t| Triangle { vertices: t.vertices.map(moved), ..t });
        let occluders = Occluders::new(&screen).unwrap();
        let root = Cube::new(DVec3::ZERO, 4.0 * scale);
        let cells = [4, 7].map(|z| Cell::new(&root, 3, [4, 4, z]));
        let view = |k: usize| CellView { cell: &cells[k], points: &squares[k][..] };
        let mask = Visibility::new(&occluders).fractional(tolerance, brightness).unwrap();
        let verdict = Mask::<Kernel>::cells(&mask, view(0), view(1));
        assert_eq!(verdict, Mask::<Kernel>::cells(&mask, view(1), view(0)));
        (verdict, mask.counts(), mask.uncertainty(scale * scale))
    }

    fn verdict(mask: &Visibility<'_>, t: &[Surfel], s: &[Surfel]) -> Coverage {
        let cell = Cell::new(&Cube::new(DVec3::ZERO, 4.0), 0, [0; 3]);
        let view = |points| CellView { cell: &cell, points };
        Mask::<Kernel>::cells(mask, view(t), view(s))
    }

    fn together(mask: &Visibility<'_>, t: &[Surfel], s: &[Surfel]) -> Vec<(usize, usize)> {
        let cell = Cell::new(&Cube::new(DVec3::ZERO, 4.0), 0, [0; 3]);
        let view = |points| CellView { cell: &cell, points };
        let mut found = Vec::new();
        Mask::<Kernel>::pairs(mask, view(t), view(s), &mut |i, j, _| found.push((i, j)));
        found
    }

    fn ask_all(mask: &Visibility<'_>, t: &[Surfel], s: &[Surfel]) -> usize {
        let pairs = t.iter().flat_map(|x| s.iter().map(move |y| (x, y)));
        pairs.filter(|(x, y)| Mask::<Kernel>::pair(mask, x, y) == 1.0).count()
    }

    #[test]
    fn counts_tell_how_every_pair_fell_out() {
        let floor = square(0.0, 1.0, true, 0);
        let ceiling = square(1.0, 1.0, false, 1);
        let roof = square(1.0, 1.0, true, 1);
        let walls = [screen(0.0, 1.0, 0), screen(1.0, 1.0, 1)].concat();
        let open = Occluders::new(&walls).unwrap();
        let mask = Visibility::new(&open);
        assert_eq!(verdict(&mask, &ceiling, &floor), Coverage::Full);
        assert_eq!(verdict(&mask, &roof, &floor), Coverage::Empty);
        let counts = PairCounts { certified: 256, facing_away: 256, ..PairCounts::default() };
        assert_eq!(mask.counts(), counts);
        assert_eq!(ask_all(&mask, &ceiling, &floor), 256);
        assert_eq!(mask.counts(), PairCounts { unhidden: 256, rays: 256, ..counts });
    }

    #[test]
    fn a_screen_hides_and_is_never_overlooked() {
        let floor = square(0.0, 1.0, true, 0);
        let ceiling = square(1.0, 1.0, false, 1);
        // A segment passes the screen's plane at (i + j − 3)/8 along either axis, i and j in 0..4.
        for (side, hidden) in [(1.0, 16 * 16), (0.45, 10 * 10), (0.05, 4 * 4)] {
            let visible = 256 - hidden;
            let occluders = Occluders::new(&screen(0.5, side, 2)).unwrap();
            let mask = Visibility::new(&occluders);
            let mask_of_cells = Visibility::new(&occluders);
            let whole = if visible == 0 { Coverage::Empty } else { Coverage::Partial };
            assert_eq!(verdict(&mask_of_cells, &ceiling, &floor), whole);
            assert_eq!(verdict(&mask_of_cells, &floor, &ceiling), whole);
            assert_eq!(ask_all(&mask, &ceiling, &floor), visible, "screen of side {side}");
            assert_eq!(ask_all(&mask, &floor, &ceiling), visible, "screen of side {side}");
            assert_eq!(mask.counts().total(), 512);
            assert_eq!(mask.counts().rays, 512);
        }
    }

    #[test]
    fn groups_that_exchange_little_are_sampled_from_both_ends_alike() {
        let (verdict, counts, uncertainty) = sampled(1.0, 0.1, vec![]);
        let Coverage::Eighths(visible) = verdict else { panic!("{verdict:?}") };
        assert!((5..=7).contains(&visible), "{visible} eighths of about three quarters");
        assert_eq!((counts.sampled, counts.rays), (512, 32));
        // Each receives A/(πr²) ≈ 0.0014 of what it sees of the other, half of which is in doubt, on an
        // area of 0.04 each.
        assert!((1e-4..3e-4).contains(&uncertainty), "{uncertainty}");
        // What is weak on its own isn't if one of the two is a lamp.
        for strong in [sampled(1.0, 0.003, vec![]), sampled(1.0, 0.1, vec![1.0, 100.0])] {
            assert_eq!((strong.0, strong.1.rays, strong.2), (Coverage::Partial, 0, 0.0));
        }
        let error = Error::InvalidTolerance { found: 1.0 };
        let nothing = Occluders::new(&[]).unwrap();
        let refused = Visibility::new(&nothing).fractional(1.0, vec![]);
        assert_eq!(refused.map(|_| ()), Err(error));
    }

    #[test]
    fn the_uncertainty_is_that_of_the_scene_at_any_scale() {
        let uncertainty = |scale: f64| sampled(scale, 0.1, vec![]).2;
        let unit = uncertainty(1.0);
        assert!(unit > 1e-5);
        for scale in [0.5f64.powi(30), 2f64.powi(40)] {
            assert!((uncertainty(scale) / unit - 1.0).abs() < 1e-3, "{scale}");
        }
    }

    #[test]
    fn pairs_of_leaves_are_asked_in_groups_of_about_the_same_share() {
        let floor = square(0.0, 0.2, true, 0);
        let ceiling = square(1.0, 0.2, false, 1);
        let occluders = Occluders::new(&screen(0.5, 0.07, 2)).unwrap();
        let exact = together(&Visibility::new(&occluders), &ceiling, &floor).len();
        let mut before = u64::MAX;
        for tolerance in [1e-3, 1e-2, 3e-2, 0.1] {
            let mask = Visibility::new(&occluders).fractional(tolerance, vec![]).unwrap();
            let cells = [0, 1].map(|k| Cell::new(&Cube::new(DVec3::ZERO, 4.0), 1, [k; 3]));
            let mut found = 0;
            let view = |k: usize, points| CellView { cell: &cells[k], points };
            let (t, s) = (view(0, &ceiling[..]), view(1, &floor[..]));
            Mask::<Kernel>::pairs(&mask, t, s, &mut |_, _, _| found += 1);
            let counts = mask.counts();
            assert!(counts.rays <= before && counts.rays > 0);
            before = counts.rays;
            assert_eq!(counts.unhidden, found as u64);
            assert_eq!(counts.total(), 256);
            if counts.rays == 256 {
                assert_eq!(found, exact);
            } else {
                assert!(found.abs_diff(exact) < 80, "{found} {exact}");
            }
        }
        assert!(before < 64, "{before}");
    }

    #[test]
    fn blocks_and_cells_answer_as_their_pairs_do() {
        for seed in 0..256 {
            let random = &mut Random::new(seed);
            let occluders = Occluders::new(&triangles(random)).unwrap();
            let floor = square(-0.5, 1.0, true, 0);
            let tilt = 0.6 * random.in_cube() - 0.3;
            let shift = tilt.with_z(random.between(-1.0, 1.0));
            let normal = (DVec3::NEG_Z + tilt * 2.0).normalize();
            let other: Vec<Surfel> = square(0.0, 0.5, false, 1)
                .into_iter()
                .map(|s| Surfel { position: s.position + shift, normal, ..s })
                .collect();
            let masks: [_; 3] = std::array::from_fn(|_| Visibility::new(&occluders));
            let found = together(&masks[0], &other, &floor);
            for (i, x) in other.iter().enumerate() {
                for (j, y) in floor.iter().enumerate() {
                    let counts = Mask::<Kernel>::pair(&masks[1], x, y);
                    assert_eq!(counts == 1.0, found.contains(&(i, j)), "{seed}");
                }
            }
            assert_eq!(masks[0].counts(), masks[1].counts(), "{seed}");
            match verdict(&masks[2], &other, &floor) {
                Coverage::Full => assert_eq!(found.len(), 256, "{seed}"),
                Coverage::Empty => assert!(found.is_empty(), "{seed}"),
                Coverage::Partial | Coverage::Eighths(_) => {}
            }
        }
    }
}

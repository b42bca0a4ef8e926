//! From rays to pixels: many rays only where one a pixel doesn't tell the same.

use glam::{DMat2, DVec2};
use rayon::prelude::*;

use crate::pictures::tone::Rgb;

/// Rays per pixel and axis.
pub(crate) const RAYS: usize = 3;

/// What the [`RAYS`]² rays of a pixel see.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Pixel {
    /// The mean over those rays that meet something.
    pub(crate) mean: Rgb,
    /// The share of them.
    pub(crate) share: f64,
}

/// A ray through a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Ray {
    /// Where it passes: (0, 0) is the upper left corner, (1, 1) the lower right one.
    pub(crate) place: DVec2,
    /// Which of its pixel's rays it is, from 0 on.
    pub(crate) turn: usize,
}

/// The pixels of a picture of so many columns and rows, row by row from the upper left corner. A pixel is cut into
/// RAYS × RAYS squares, with a ray through the middle of each. Only one of them is cast at first, another one for
/// each of nine pixels around. Where what these nine see is a linear function, or nothing at all, their mean is what
/// all rays of the pixel in their middle see. For other pixels, and those at the border, all are cast; and around
/// pixels whose own rays differ, so that thin lines are followed. `evenness` is how far from a linear function what
/// is seen may be, relative to its largest band; `see` says what a ray sees, and `row_done` is called after every
/// row of first rays, from any thread.
pub(crate) fn expose(
    [width, height]: [usize; 2],
    evenness: f64,
    see: impl Fn(Ray) -> Option<Rgb> + Sync,
    row_done: impl Fn() + Sync,
) -> Vec<Pixel> {
    let size = DVec2::new(width as f64, height as f64);
    let look = |[column, row]: [usize; 2], part: [usize; 2]| {
        let [x, y] = part.map(|part| (part as f64 + 0.5) / RAYS as f64);
        let place = DVec2::new(column as f64 + x, row as f64 + y) / size;
        see(Ray { place, turn: part[1] * RAYS + part[0] })
    };
    let mut first: Vec<Option<Rgb>> = vec![None; width * height];
    first.par_chunks_mut(width.max(1)).enumerate().for_each(|(row, seen)| {
        for (column, seen) in seen.iter_mut().enumerate() {
            *seen = look([column, row], part([column, row]));
        }
        row_done();
    });
    let around = |k: usize| {
        let [column, row] = [k % width, k / width];
        let inside = column > 0 && column + 1 < width && row > 0 && row + 1 < height;
        inside.then(|| std::array::from_fn(|n| [column + n % 3 - 1, row + n / 3 - 1]))
    };
    let from_first = |k: usize| {
        let nine: [[usize; 2]; 9] = around(k)?;
        let seen = |n: usize| (offset(n, part(nine[n])), first[nine[n][1] * width + nine[n][0]]);
        even(&std::array::from_fn(seen), evenness)
    };
    let mut pixels: Vec<Option<Pixel>> =
        (0..width * height).into_par_iter().map(from_first).collect();
    let mut next: Vec<usize> = (0..pixels.len()).filter(|&k| pixels[k].is_none()).collect();
    let mut is_whole: Vec<bool> = pixels.iter().map(Option::is_none).collect();
    while !next.is_empty() {
        let all = |k: usize| {
            let place = [k % width, k / width];
            let seen = std::array::from_fn(|turn| {
                let one = [turn % RAYS, turn / RAYS];
                let offset = DVec2::new(one[0] as f64 - 1.0, one[1] as f64 - 1.0);
                (offset, if one == part(place) { first[k] } else { look(place, one) })
            });
            (k, whole(&seen), even(&seen, evenness).is_some())
        };
        let found: Vec<(usize, Pixel, bool)> = next.into_par_iter().map(all).collect();
        next = Vec::new();
        for (k, pixel, is_even) in found {
            pixels[k] = Some(pixel);
            for [column, row] in around(k).filter(|_| !is_even).into_iter().flatten() {
                let k = row * width + column;
                if !std::mem::replace(&mut is_whole[k], true) {
                    next.push(k);
                }
            }
        }
    }
    pixels.into_iter().map(Option::unwrap_or_default).collect()
}

/// Which square of a pixel the first ray passes. Among any three by three pixels each square occurs once, and
/// among three in a row or in a column all columns and rows of squares do.
fn part([column, row]: [usize; 2]) -> [usize; 2] {
    [row % RAYS, column % RAYS]
}

/// How far the first ray of the k-th of nine pixels is from the middle of these, in pixels.
fn offset(k: usize, part: [usize; 2]) -> DVec2 {
    let along =
        |pixel: usize, part: usize| pixel as f64 - 1.0 + (part as f64 + 0.5) / RAYS as f64 - 0.5;
    DVec2::new(along(k % 3, part[0]), along(k / 3, part[1]))
}

/// What nine rays see in the middle of them, if that is nothing or nearly a linear function.
fn even(around: &[(DVec2, Option<Rgb>); 9], evenness: f64) -> Option<Pixel> {
    if around.iter().all(|(_, seen)| seen.is_none()) {
        return Some(Pixel::default());
    }
    let (mut mean, mut square) = ([0.0; 3], DMat2::ZERO);
    let mut moment = [DVec2::ZERO; 3];
    for &(offset, seen) in around {
        let seen = seen?;
        square += DMat2::from_cols(offset * offset.x, offset * offset.y);
        for band in 0..3 {
            mean[band] += seen[band] / 9.0;
            moment[band] += seen[band] * offset;
        }
    }
    // The offsets add up to zero.
    let inverse = square.inverse();
    let slope = moment.map(|moment| inverse * moment);
    let largest = mean.iter().copied().fold(0.0, f64::max);
    let bound = evenness * largest;
    // Each is held against what the other eight say, which is further from it than the function of all nine.
    let is_close = |&(offset, seen): &(DVec2, Option<Rgb>)| {
        let seen = seen.unwrap_or_default();
        let others = 1.0 - 1.0 / 9.0 - offset.dot(inverse * offset);
        let bound = bound * others;
        (0..3).all(|band| (seen[band] - mean[band] - slope[band].dot(offset)).abs() <= bound)
    };
    around.iter().all(is_close).then_some(Pixel { mean, share: 1.0 })
}

/// What all rays of a pixel see.
fn whole(seen: &[(DVec2, Option<Rgb>); 9]) -> Pixel {
    let (mut sum, mut hits) = ([0.0; 3], 0);
    for value in seen.iter().filter_map(|(_, seen)| *seen) {
        hits += 1;
        sum = [0, 1, 2].map(|band| sum[band] + value[band]);
    }
    let count = f64::from(hits);
    let mean = if hits > 0 { sum.map(|band| band / count) } else { sum };
    Pixel { mean, share: count / (RAYS * RAYS) as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    const SIZE: [usize; 2] = [61, 53];
    const EVENNESS: f64 = 0.02;

    /// The largest and the root mean square difference between pixels that are exposed and ones of which all
    /// rays are cast, and how many rays there are for each pixel.
    fn difference(see: impl Fn(DVec2, usize) -> Option<Rgb> + Sync) -> [f64; 3] {
        let [width, height] = SIZE;
        let (rays, rows) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let count = |counter: &AtomicUsize| {
            counter.fetch_add(1, Ordering::Relaxed);
        };
        let look = |ray: Ray| {
            count(&rays);
            see(ray.place * DVec2::new(width as f64, height as f64), ray.turn)
        };
        let found = expose(SIZE, EVENNESS, look, || count(&rows));
        assert_eq!(rows.into_inner(), height);
        let (mut largest, mut squares) = (0.0f64, 0.0);
        for (k, found) in found.iter().enumerate() {
            let mut sum = [0.0; 3];
            for turn in 0..9 {
                let [x, y] = [turn % 3, turn / 3].map(|part| (part as f64 + 0.5) / 3.0);
                let place = DVec2::new((k % width) as f64 + x, (k / width) as f64 + y);
                let seen = see(place, turn).unwrap_or_default();
                sum = [0, 1, 2].map(|band| sum[band] + seen[band] / 9.0);
            }
            for (mean, whole) in found.mean.iter().zip(sum) {
                let change = (found.share * mean - whole).abs();
                largest = largest.max(change);
                squares += change * change;
            }
        }
        let count = (width * height) as f64;
        [largest, (squares / (3.0 * count)).sqrt(), rays.into_inner() as f64 / count]
    }

    #[test]
    fn one_ray_a_pixel_is_enough_for_linear_functions_and_for_nothing() {
        let linear = |p: DVec2| [5.0 + 0.02 * p.x, 9.0 - 0.1 * p.y, 3.0];
        let [largest, _, rays] = difference(|p, _| Some(linear(p)));
        // All rays at the border.
        assert!(largest < 1e-12 && rays < 1.6, "{largest} {rays}");
        let [largest, _, rays] = difference(|_, _| None);
        assert!(largest == 0.0 && rays < 1.6, "{rays}");
    }

    #[test]
    fn edges_and_lines_as_thin_as_a_square_are_as_all_rays_see_them() {
        for k in 0..40 {
            let normal = DVec2::from_angle(std::f64::consts::PI * f64::from(k) / 40.0);
            let across = |p: DVec2| normal.dot(p - DVec2::new(30.3, 26.1));
            let edge = |p: DVec2, _: usize| Some([if across(p) > 0.0 { 1.0 } else { 0.5 }; 3]);
            let line = |p: DVec2, _: usize| (across(p).abs() < 0.25).then_some([1.0; 3]);
            let dim =
                |p: DVec2, _: usize| Some([if across(p).abs() < 0.25 { 0.9 } else { 1.0 }; 3]);
            // What nine rays hardly tell from a linear function is off by hardly more.
            for (name, found, bound) in [
                ("edge", difference(edge), 1e-12),
                ("line", difference(line), 1e-12),
                ("dim line", difference(dim), 2.0 * EVENNESS),
            ] {
                let [largest, _, rays] = found;
                assert!(largest < bound && rays < 3.0, "{name} {k}: {largest} {rays}");
            }
        }
    }

    #[test]
    fn soft_shadows_are_as_smooth_as_by_all_rays() {
        // A lamp of which each ray sees one of nine parts, hidden one after the other.
        let shadow = |p: DVec2, turn: usize| {
            let hidden = (p.x - 20.0) / 20.0 > (turn as f64 + 0.5) / 9.0;
            Some([if hidden { 1.0 } else { 1.1 }, 1.0, 1.0])
        };
        let [largest, mean, rays] = difference(shadow);
        assert!(largest < 0.02 && mean < 2e-3 && rays < 6.0, "{largest} {mean} {rays}");
    }

    #[test]
    fn pictures_of_few_pixels_have_all_rays() {
        for size in [[1, 1], [2, 7], [7, 2], [0, 5], [5, 0]] {
            let half = |ray: Ray| (ray.place.x < 0.5).then_some([1.0; 3]);
            let pixels = expose(size, EVENNESS, half, || ());
            assert_eq!(pixels.len(), size[0] * size[1]);
            let shares: f64 = pixels.iter().map(|pixel| pixel.share).sum();
            assert!((shares - 0.5 * pixels.len() as f64).abs() <= 0.2 * pixels.len() as f64);
        }
    }
}

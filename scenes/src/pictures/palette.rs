//! Numbers in false colours.

use std::ops::RangeInclusive;

/// The range of what is finite among `values`; 0 to 1 if nothing is.
pub(crate) fn range(values: impl Iterator<Item = f64>) -> RangeInclusive<f64> {
    let finite = values.filter(|value| value.is_finite());
    let bounds = finite.fold(None, |bounds: Option<(f64, f64)>, value| {
        let (low, high) = bounds.unwrap_or((value, value));
        Some((low.min(value), high.max(value)))
    });
    bounds.map_or(0.0..=1.0, |(low, high)| low..=high)
}

/// The sRGB code of a value: from nearly black at the lower end of `range` over red to pale yellow at
/// the upper one, in perceptually even steps.
pub(crate) fn code(value: f64, range: &RangeInclusive<f64>) -> [u8; 3] {
    let width = range.end() - range.start();
    let fraction = if width > 0.0 { (value - range.start()) / width } else { 0.5 };
    // A clamp leaves NaN as it is.
    let fraction = if fraction.is_nan() { 0.0 } else { fraction.clamp(0.0, 1.0) };
    colorous::INFERNO.eval_continuous(fraction).into_array()
}

/// A picture of so many columns and rows of values, row by row from the upper left corner, with a bar at its
/// right edge that shows which colours stand for which numbers. Where there is no value it is grey.
pub(crate) fn picture(
    values: &[Option<f64>],
    [width, height]: [usize; 2],
    range: &RangeInclusive<f64>,
) -> Vec<[u8; 3]> {
    let colour = |value: &Option<f64>| value.map_or(NOTHING, |value| code(value, range));
    let mut pixels: Vec<_> = values.iter().map(colour).collect();
    // Digits of about a fortieth of the picture, in whole pixels.
    let size = width.min(height);
    let scale = (size / 240).max(1);
    if size < LEAST_SIZE {
        return pixels;
    }
    let mut paint = |x: usize, y: usize, colour: [u8; 3]| {
        if x < width
            && let Some(pixel) = pixels.get_mut(y * width + x)
        {
            *pixel = colour;
        }
    };
    let (top, bottom) = (height / 10, height - height / 10);
    let (left, right) = (width - 8 * scale, width - 3 * scale);
    for y in top..bottom {
        let fraction = (bottom - 1 - y) as f64 / (bottom - 1 - top) as f64;
        let value = range.start() + fraction * (range.end() - range.start());
        for x in left - 1..=right {
            let frame = x == left - 1 || x == right || y == top || y == bottom - 1;
            paint(x, y, if frame { INK } else { code(value, range) });
        }
    }
    for mark in 0..=MARKS {
        let fraction = mark as f64 / MARKS as f64;
        let value = range.start() + fraction * (range.end() - range.start());
        let label = label(value, range.end().abs().max(range.start().abs()));
        let y = bottom - 1 - (fraction * (bottom - 1 - top) as f64) as usize;
        let start = left - (3 + GLYPH[0] * label.len()) * scale;
        write(&label, [start, y - GLYPH[1] * scale / 2], scale, &mut paint);
        (left - 2 * scale..left).for_each(|x| paint(x, y, INK));
    }
    pixels
}

/// The colour of what has no value.
const NOTHING: [u8; 3] = [120; 3];
/// The colours of digits and lines, and of what is around them.
const INK: [u8; 3] = [255; 3];
const OUTLINE: [u8; 3] = [0; 3];
/// Intervals between the numbers at the bar.
const MARKS: usize = 5;
/// Smaller pictures have no bar.
const LEAST_SIZE: usize = 120;
/// Columns and rows of a character, the gap to the next one included.
const GLYPH: [usize; 2] = [4, 6];

/// A number with four digits, those of numbers as large as `largest`.
fn label(value: f64, largest: f64) -> String {
    // What is left of rounding at the zero of a scale.
    let value = if value.abs() < 1e-9 * largest { 0.0 } else { value };
    if value != 0.0 && !(1e-2..1e5).contains(&largest) {
        return format!("{value:.2e}");
    }
    let decimals =
        if largest > 0.0 { 3 - (largest.log10().floor() as i32).clamp(-2, 3) } else { 0 };
    format!("{value:.0$}", decimals as usize)
}

/// Paints characters from the upper left corner `x`, `y` on, with an outline.
fn write(
    text: &str,
    [x, y]: [usize; 2],
    scale: usize,
    mut paint: impl FnMut(usize, usize, [u8; 3]),
) {
    let dots = |text: &str| -> Vec<[usize; 2]> {
        let glyphs = text.chars().enumerate().flat_map(|(place, character)| {
            let rows = glyph(character);
            (0..15).filter_map(move |k| {
                let (row, column) = (k / 3, k % 3);
                let set = rows[row] >> (2 - column) & 1 == 1;
                set.then_some([place * GLYPH[0] + column, row])
            })
        });
        glyphs.collect()
    };
    for (margin, colour) in [(1, OUTLINE), (0, INK)] {
        for [column, row] in dots(text) {
            let (x, y) = (x + column * scale, y + row * scale);
            for y in y - margin..y + scale + margin {
                (x - margin..x + scale + margin).for_each(|x| paint(x, y, colour));
            }
        }
    }
}

/// The five rows of a character of a number, three dots each.
fn glyph(character: char) -> [u8; 5] {
    match character {
        '0' => [0b111, 0b101, 0b101, 0b101, 0b111],
        '1' => [0b010, 0b110, 0b010, 0b010, 0b111],
        '2' => [0b111, 0b001, 0b111, 0b100, 0b111],
        '3' => [0b111, 0b001, 0b111, 0b001, 0b111],
        '4' => [0b101, 0b101, 0b111, 0b001, 0b001],
        '5' => [0b111, 0b100, 0b111, 0b001, 0b111],
        '6' => [0b111, 0b100, 0b111, 0b101, 0b111],
        '7' => [0b111, 0b001, 0b010, 0b010, 0b010],
        '8' => [0b111, 0b101, 0b111, 0b101, 0b111],
        '9' => [0b111, 0b101, 0b111, 0b001, 0b111],
        'e' => [0b000, 0b111, 0b111, 0b100, 0b111],
        '-' => [0b000, 0b000, 0b111, 0b000, 0b000],
        '.' => [0b000, 0b000, 0b000, 0b000, 0b010],
        _ => [0; 5],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_is_brighter_and_ends_are_the_palettes() {
        let range = range([3.0, f64::NAN, 1.0, f64::INFINITY, 2.0].into_iter());
        assert_eq!(range, 1.0..=3.0);
        let brightness = |value| code(value, &range).map(u32::from).iter().sum::<u32>();
        let steps: Vec<u32> = (0..=40).map(|k| brightness(1.0 + f64::from(k) / 20.0)).collect();
        assert!(steps.is_sorted() && steps[0] < 10 && steps[40] > 650);
        assert_eq!(code(-9.0, &range), code(1.0, &range));
        assert_eq!(code(f64::NAN, &range), code(1.0, &range));
        assert_eq!(code(2.0, &(5.0..=5.0)), code(2.0, &range));
        assert_eq!(super::range([f64::NAN].into_iter()), 0.0..=1.0);
    }

    #[test]
    fn the_bar_shows_the_palette_and_its_numbers() {
        let range = 0.0..=300.0;
        let pixels = picture(&vec![None; 240 * 240], [240, 240], &range);
        assert_eq!(pixels[0], NOTHING);
        let bar = |y: usize| pixels[y * 240 + 234];
        assert_eq!(bar(26), code(300.0 * (215.0 - 26.0) / 191.0, &range));
        assert!(bar(30) > bar(210));
        // The zero at the lower end: a ring of ink with a dark middle.
        let zero = |column: usize, row: usize| pixels[(215 - 3 + row) * 240 + 232 - 7 + column];
        assert_eq!(zero(0, 0), INK);
        assert_eq!(zero(1, 2), OUTLINE);
        assert_eq!(picture(&[Some(300.0), None], [2, 1], &range), [code(300.0, &range), NOTHING]);
    }

    #[test]
    fn labels_have_as_many_digits_as_tell_the_marks_apart() {
        let found = [(293.15, 400.0), (0.5, 1.0), (1e-17, 1.0), (2.5e-7, 1e-6), (0.0, 0.0)];
        let labels = found.map(|(value, largest)| label(value, largest));
        assert_eq!(labels, ["293.1", "0.500", "0.000", "2.50e-7", "0"]);
    }
}

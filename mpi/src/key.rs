//! Places along the Morton curve, and the cells that begin there.

/// A place along the curve: three words of [`WORD_LEVELS`] levels each, three bits a level, as
/// [`Cube::curve_key`](farfield::Cube::curve_key) gives them.
pub(crate) type Key = [u64; 3];

/// Levels of one word.
pub(crate) const WORD_LEVELS: usize = 21;

/// The bits of the levels below `level` in the n-th word.
fn below(level: usize, n: usize) -> u64 {
    let levels = level.saturating_sub(n * WORD_LEVELS).min(WORD_LEVELS);
    (1u64 << (3 * (WORD_LEVELS - levels))) - 1
}

/// The first place of the cell of a level that holds a place.
pub(crate) fn first_of(key: Key, level: usize) -> Key {
    std::array::from_fn(|n| key[n] & !below(level, n))
}

/// The last place of that cell.
pub(crate) fn last_of(key: Key, level: usize) -> Key {
    std::array::from_fn(|n| key[n] | below(level, n))
}

/// Which octant of the cell above, of level `level` − 1, a place is in.
pub(crate) fn octant(key: Key, level: usize) -> u64 {
    let (word, digit) = ((level - 1) / WORD_LEVELS, (level - 1) % WORD_LEVELS);
    key[word] >> (3 * (WORD_LEVELS - 1 - digit)) & 7
}

/// The first place of an octant of the cell of level `level` − 1 that begins at a place.
pub(crate) fn child(key: Key, level: usize, octant: u64) -> Key {
    let (word, digit) = ((level - 1) / WORD_LEVELS, (level - 1) % WORD_LEVELS);
    let mut child = key;
    child[word] |= octant << (3 * (WORD_LEVELS - 1 - digit));
    child
}

/// The integer coordinates of the cell of a level that holds a place.
pub(crate) fn coordinates(key: Key, level: usize) -> [u64; 3] {
    let mut coordinates = [0; 3];
    for level in 1..=level {
        let octant = octant(key, level);
        for (axis, c) in coordinates.iter_mut().enumerate() {
            *c = *c << 1 | octant >> axis & 1;
        }
    }
    coordinates
}

#[cfg(test)]
mod tests {
    use super::*;
    use farfield::Cube;
    use farfield_testing::clouds::Random;
    use glam::DVec3;

    #[test]
    fn cells_of_keys_hold_their_points() {
        let root = Cube::new(DVec3::splat(0.5), 0.5);
        let mut random = Random::new(3);
        for k in 0..300 {
            let p = random.in_cube();
            let key = root.curve_key(p, k % 2 == 0);
            let (mut cell, levels) = (Key::default(), if k % 2 == 0 { 63 } else { 21 });
            for level in 1..=levels {
                cell = child(cell, level, octant(key, level));
                assert_eq!(cell, first_of(key, level));
                assert!(cell <= key && key <= last_of(key, level));
                assert_eq!(first_of(last_of(key, level), level), cell);
                let scale = 2f64.powi(level as i32);
                let c = DVec3::from_array(coordinates(key, level).map(|c| c as f64));
                let inside = p * scale - c;
                if level <= 21 {
                    assert!((inside - 0.5).abs().max_element() <= 0.5 + 1e-9, "{level} {inside}");
                }
            }
            assert_eq!(first_of(key, 63), key);
        }
    }

    #[test]
    fn keys_go_along_the_curve() {
        let root = Cube::new(DVec3::ZERO, 1.0);
        let at = |x: f64, y: f64, z: f64| root.curve_key(DVec3::new(x, y, z), true);
        let corners =
            [at(-0.5, -0.5, -0.5), at(0.5, -0.5, -0.5), at(-0.5, 0.5, -0.5), at(-0.5, -0.5, 0.5)];
        assert!(corners.is_sorted());
        assert_eq!(corners.map(|key| octant(key, 1)), [0, 1, 2, 4]);
    }
}

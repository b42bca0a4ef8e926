//! Bits of a block of pairs: which of them count.

/// Calls `visit(j)` for every set bit j of row `i` in a block of `columns` columns.
pub(crate) fn for_each_set_bit(
    bits: &[u64],
    i: usize,
    columns: usize,
    mut visit: impl FnMut(usize),
) {
    let mut j = 0;
    while j < columns {
        let bit = i * columns + j;
        let width = (64 - bit % 64).min(columns - j);
        let mut word = bits[bit / 64] >> (bit % 64);
        if width < 64 {
            word &= (1 << width) - 1;
        }
        while word != 0 {
            visit(j + word.trailing_zeros() as usize);
            word &= word - 1;
        }
        j += width;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn set_bits_are_visited_across_word_borders() {
        let columns = 50;
        let set = |i: usize, j: usize| (i * 7 + j * 3).is_multiple_of(5) || j == 49;
        let mut bits = vec![0u64; 3 * columns / 64 + 1];
        for i in 0..3 {
            for j in (0..columns).filter(|&j| set(i, j)) {
                bits[(i * columns + j) / 64] |= 1 << ((i * columns + j) % 64);
            }
        }
        for i in 0..3 {
            let mut seen = Vec::new();
            for_each_set_bit(&bits, i, columns, |j| seen.push(j));
            assert_eq!(seen, (0..columns).filter(|&j| set(i, j)).collect::<Vec<_>>());
        }
    }
}

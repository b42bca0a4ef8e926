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

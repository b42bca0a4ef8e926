//! Charges, points and terms as the words of messages.

use farfield::{Numbers, Real};

/// Appends items to a message: each its numbers, after their count where it is not the same for all. A number of less than
/// 64 bits takes a word as well.
pub(crate) fn write<'a, V: Numbers>(items: impl IntoIterator<Item = &'a V>, words: &mut Vec<u64>) {
    for item in items {
        if V::LEN == 0 {
            words.push(item.count() as u64);
        }
        words.extend((0..item.count()).map(|i| item.number(i).as_f64().to_bits()));
    }
}

/// Takes as many items from the front of a message. What is missing comes out as zeros.
pub(crate) fn read<V: Numbers>(count: usize, words: &mut std::slice::Iter<'_, u64>) -> Vec<V> {
    let mut item = || {
        let mut item = V::zero();
        let len = if V::LEN == 0 { next(words) as usize } else { V::LEN };
        for i in 0..len {
            item.set_number(i, Real::from_f64(f64::from_bits(next(words))));
        }
        item
    };
    (0..count).map(|_| item()).collect()
}

/// The next word of a message; 0 at its end.
pub(crate) fn next(words: &mut std::slice::Iter<'_, u64>) -> u64 {
    words.next().copied().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn back<V: Numbers + PartialEq + std::fmt::Debug>(items: &[V]) -> usize {
        let mut words = vec![7];
        write(items, &mut words);
        let mut rest = words[1..].iter();
        assert_eq!(read::<V>(items.len(), &mut rest), items);
        assert_eq!(rest.len(), 0);
        words.len() - 1
    }

    #[test]
    fn items_come_back_as_they_were() {
        assert_eq!(back(&[0.1, -0.0, f64::MIN_POSITIVE / 3.0, f64::MAX]), 4);
        assert_eq!(back(&[Vec3::new(0.1, -2.5e-40, 3.0)]), 3);
        assert_eq!(back(&[vec![1.0f64, 2.0], vec![], vec![3.0]]), 6);
        assert_eq!(back::<[f64; 2]>(&[]), 0);
    }
}

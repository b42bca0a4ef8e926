//! Items in groups, one group after the other in a flat array.

use crate::parallel;

/// Items grouped by the index of their group.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Grouped<V> {
    /// Where each group starts; one more entry ends the last.
    pub(crate) starts: Vec<usize>,
    /// The items. Those after the last start belong to the group that is being filled.
    pub(crate) items: Vec<V>,
}

impl<V> Default for Grouped<V> {
    /// No groups.
    fn default() -> Self {
        Self { starts: vec![0], items: Vec::new() }
    }
}

/// Groups per parallel task.
const GROUPS: usize = 64;

impl<V: Copy + Default + Send + Sync> Grouped<V> {
    /// The items of group `g`.
    pub(crate) fn of(&self, g: usize) -> &[V] {
        &self.items[self.starts[g]..self.starts[g + 1]]
    }

    /// Number of groups.
    pub(crate) fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Adds a group.
    pub(crate) fn push_group(&mut self, items: impl IntoIterator<Item = V>) {
        self.items.extend(items);
        self.end_group();
    }

    /// Makes a group of the items added since the last call.
    pub(crate) fn end_group(&mut self) {
        self.starts.push(self.items.len());
    }

    /// The groups of all `parts`, one part after the other.
    pub(crate) fn join(parts: impl Iterator<Item = Self>) -> Self {
        let parts: Vec<Self> = parts.collect();
        let mut starts = Vec::with_capacity(1 + parts.iter().map(Self::len).sum::<usize>());
        starts.push(0);
        let mut total = 0;
        for part in &parts {
            starts.extend(part.starts[1..].iter().map(|start| total + start));
            total += part.items.len();
        }
        let mut items = vec![V::default(); total];
        let mut rest = &mut items[..];
        let mut places: Vec<(&mut [V], Self)> = parts
            .into_iter()
            .map(|part| {
                let (place, tail) = std::mem::take(&mut rest).split_at_mut(part.items.len());
                rest = tail;
                (place, part)
            })
            .collect();
        parallel::for_each_piece(&mut places, 1, &|_, place| {
            let (place, part) = &mut place[0];
            place.copy_from_slice(&part.items);
        });
        Self { starts, items }
    }

    /// As many groups, group `g` holding what `map(g, items, out)` appends to `out`.
    pub(crate) fn mapped<W: Copy + Default + Send + Sync>(
        &self,
        map: impl Fn(usize, &[V], &mut Vec<W>) + Sync,
    ) -> Grouped<W> {
        let part = |part: usize| {
            let first = part * GROUPS;
            let mut part = Grouped::default();
            for g in first..(first + GROUPS).min(self.len()) {
                map(g, self.of(g), &mut part.items);
                part.end_group();
            }
            part
        };
        let parts: Vec<Grouped<W>> = parallel::map(self.len().div_ceil(GROUPS), &part);
        Grouped::join(parts.into_iter())
    }

    /// The items for which `keep(g, item)` holds.
    pub(crate) fn filtered(&self, keep: impl Fn(usize, V) -> bool + Sync) -> Self {
        self.mapped(|g, items, out| out.extend(items.iter().copied().filter(|&v| keep(g, v))))
    }

    /// Whether `holds(g, item)` is true of every item.
    pub(crate) fn all(&self, holds: impl Fn(usize, V) -> bool + Sync) -> bool {
        self.items.is_empty()
            || parallel::all(self.len(), &|g| self.of(g).iter().all(|&v| holds(g, v)))
    }

    /// Its size in memory.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&self.starts[..]) + size_of_val(&self.items[..])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grouped(groups: &[&[u32]]) -> Grouped<u32> {
        let mut grouped = Grouped::default();
        groups.iter().for_each(|group| grouped.push_group(group.iter().copied()));
        grouped
    }

    #[test]
    fn parts_join_in_their_order() {
        let parts = [grouped(&[&[3, 1], &[]]), grouped(&[]), grouped(&[&[2], &[5, 4]])];
        assert_eq!(Grouped::join(parts.into_iter()), grouped(&[&[3, 1], &[], &[2], &[5, 4]]));
        assert_eq!(Grouped::<u32>::join(std::iter::empty()), Grouped::default());
    }

    #[test]
    fn filtering_keeps_groups_and_order() {
        let sizes = (0..3 * GROUPS as u32 + 5).map(|g| g % 7);
        let mut all = Grouped::default();
        sizes.clone().for_each(|n| all.push_group(0..n));
        let odd = all.filtered(|_, v| v % 2 == 1);
        for (g, n) in sizes.enumerate() {
            assert_eq!(odd.of(g), (0..n).filter(|v| v % 2 == 1).collect::<Vec<_>>());
        }
        assert_eq!(odd.len(), all.len());
        assert!(odd.all(|_, v| v % 2 == 1) && !all.all(|_, v| v % 2 == 1));
        assert!(!all.all(|g, _| g != 3 * GROUPS));
    }
}

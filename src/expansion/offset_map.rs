//! A value for each offset between cells.

use crate::parallel;

/// One value per integer offset, found by binary search: where expansions keep their operators.
#[derive(Clone, Debug)]
pub struct OffsetMap<V> {
    offsets: Vec<[i32; 3]>,
    values: Vec<V>,
}

impl<V> Default for OffsetMap<V> {
    fn default() -> Self {
        Self { offsets: Vec::new(), values: Vec::new() }
    }
}

impl<V: Send> OffsetMap<V> {
    /// Makes one value for each of `offsets`, in parallel.
    pub fn build(offsets: &[[i32; 3]], make: impl Fn([i32; 3]) -> V + Sync) -> Self {
        let mut offsets = offsets.to_vec();
        offsets.sort_unstable();
        offsets.dedup();
        let values = parallel::map(offsets.len(), &|i| make(offsets[i]));
        Self { offsets, values }
    }

    /// The value at `offset`, if it was built.
    pub fn get(&self, offset: [i32; 3]) -> Option<&V> {
        self.index(offset).map(|i| &self.values[i])
    }

    /// Where the value at `offset` stands in [`values`](Self::values), if it was built.
    pub fn index(&self, offset: [i32; 3]) -> Option<usize> {
        self.offsets.binary_search(&offset).ok()
    }

    /// The offsets of all values, in ascending order.
    pub fn offsets(&self) -> &[[i32; 3]] {
        &self.offsets
    }

    /// All values, in ascending order of their offsets.
    pub fn values(&self) -> &[V] {
        &self.values
    }
}

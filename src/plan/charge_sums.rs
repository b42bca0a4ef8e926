//! Sizes of charges, added up cell by cell.

use crate::numbers::traits::{Numbers, l2_norm};
use crate::octree::shape::Shape;
use crate::parallel;
use crate::plan::tuning::PIECE;

/// Sizes of charges, and for each cell Σ |q| and (Σ |q|²)^½.
pub(crate) struct ChargeSums {
    /// In tree order, relative to the largest.
    pub(crate) sizes: Vec<f64>,
    pub(crate) cells: Vec<[f64; 2]>,
}

impl ChargeSums {
    /// The sums of charges that are given in the caller's order; none if all are zero. O(N).
    pub(crate) fn new<Q: Numbers>(charges: &[Q], shape: &Shape) -> Option<Self> {
        let order = &shape.order;
        let mut sizes = vec![0.0; order.len()];
        parallel::for_each_piece(&mut sizes, PIECE, &|piece, sizes| {
            let order = order[PIECE * piece..].iter();
            sizes.iter_mut().zip(order).for_each(|(size, &i)| *size = charges[i as usize].norm());
        });
        let largest = sizes.iter().fold(0.0, |a: f64, &b| a.max(b));
        if largest == 0.0 {
            return None;
        }
        let sizes: Vec<f64> = sizes.into_iter().map(|size| size / largest).collect();
        let mut cells = vec![[0.0; 2]; shape.nodes.len()];
        // Children come after their parents.
        for (c, node) in shape.nodes.iter().enumerate().rev() {
            let children = node.children();
            cells[c] = if children.is_empty() {
                let own = &sizes[node.points()];
                [own.iter().sum(), l2_norm(own.iter().copied())]
            } else {
                let own = &cells[children];
                [own.iter().map(|sums| sums[0]).sum(), l2_norm(own.iter().map(|sums| sums[1]))]
            };
        }
        Some(Self { sizes, cells })
    }
}

//! Many segments at once, each between two points of its own.

use farfield::DispatchLevel;
use pulp::{Simd, WithSimd};

use crate::occlusion::occluders::Occluders;
use crate::occlusion::packet::{LANES, Packet};
use crate::occlusion::sights::Segment;

impl Occluders {
    /// Tells `answer` of each segment by its index whether its ends are hidden from each other, as
    /// [`blocked`](Self::blocked) has it to the bit. Segments that run side by side, all of them from one
    /// point for example, take a fraction of the time that they take one by one.
    pub fn blocked_each(&self, segments: &[Segment], answer: impl FnMut(usize, bool)) {
        // A cap that isn't understood is refused where plans are made.
        let level = DispatchLevel::in_force().unwrap_or(DispatchLevel::Portable);
        level.run(Each { occluders: self, segments, answer });
    }
}

/// Segments to be asked for, and who wants to know.
struct Each<'a, F> {
    occluders: &'a Occluders,
    segments: &'a [Segment],
    answer: F,
}

impl<F: FnMut(usize, bool)> WithSimd for Each<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, _simd: S) {
        let mut last = None;
        for (first, segments) in self.segments.chunks(LANES).enumerate() {
            let mut packet = Packet::new(self.occluders, segments);
            packet.trace(&mut last);
            for lane in 0..segments.len() {
                (self.answer)(LANES * first + lane, !packet.unhidden[lane]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elements::Surfel;
    use crate::occlusion::occluders::tests::triangles;
    use farfield_testing::clouds::Random;

    #[test]
    fn many_segments_are_blocked_as_each_alone() {
        let mut hidden = [0; 2];
        for seed in 0..64 {
            let random = &mut Random::new(seed);
            let occluders = Occluders::new(&triangles(random)).expect("finite");
            let from = 2.0 * random.in_cube() - 1.0;
            let segment = |random: &mut Random| {
                let to = 2.0 * random.in_cube() - 1.0;
                Segment {
                    ends: [from, to],
                    faces: [random.below(4) as u32, Surfel::<f64>::NO_FACE],
                }
            };
            let segments: Vec<Segment> = (0..seed as usize).map(|_| segment(random)).collect();
            let mut told = vec![None; segments.len()];
            occluders.blocked_each(&segments, |k, is_hidden| {
                assert_eq!(told[k].replace(is_hidden), None);
            });
            for (Segment { ends: [from, to], faces }, told) in segments.iter().zip(told) {
                let expected = occluders.blocked(*from, *to, *faces);
                assert_eq!(told, Some(expected));
                hidden[usize::from(expected)] += 1;
            }
        }
        assert!(hidden.iter().all(|&count| count > 200), "{hidden:?}");
    }
}

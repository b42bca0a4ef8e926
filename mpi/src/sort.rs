//! Points of all ranks along the Morton curve, by sample sort; the way there, and the way back.

use farfield::Numbers;

use crate::collective::combine;
use crate::key::Key;
use crate::transport::{Transport, TransportError};
use crate::words::{read, write};

/// Samples of all points, for each rank.
const SAMPLES: usize = 32;

/// Multiples of the golden ratio are spread evenly between whole numbers.
const GOLDEN: f64 = 0.618_033_988_749_895;

/// The order of points by their keys, those of equal keys in the caller's order. O(n log n).
pub(crate) fn order(keys: &[Key]) -> Vec<u32> {
    let mut order: Vec<u32> = (0..keys.len() as u32).collect();
    order.sort_unstable_by_key(|&i| (keys[i as usize], i));
    order
}

/// Keys at which the curve is cut for the ranks to have points of about the same weight: the first of each rank but the
/// first rank. `sorted` are the keys of this rank's points with their weights, ascending. All ranks together take O(P)
/// samples, each as many as it has weight, and count what lies between them.
pub(crate) fn cuts(
    ranks: &dyn Transport,
    sorted: &[(Key, f64)],
) -> Result<Vec<Key>, TransportError> {
    let (rank, size) = (ranks.rank(), ranks.size());
    let own: f64 = sorted.iter().map(|(_, weight)| weight).sum();
    let all = ranks.gather(&[own.to_bits()])?.concat();
    let weights = || all.iter().map(|bits| f64::from_bits(*bits));
    let (before, total): (f64, f64) = (weights().take(rank).sum(), weights().sum());
    // Each sample is somewhere else in its stretch of the weight: ranks with much the same points are not all sampled at
    // the same of them.
    let step = total / (SAMPLES * size) as f64;
    let sample_at = |k: usize| (k as f64 + (k as f64 * GOLDEN).fract()) * step;
    let mut words = Vec::new();
    let (mut k, mut next_point, mut sum) = ((before / step) as usize, 0, before);
    while next_point < sorted.len() && k < SAMPLES * size {
        let after = sum + sorted[next_point].1;
        if sample_at(k) < sum {
            k += 1;
        } else if sample_at(k) < after {
            words.extend(sorted[next_point].0);
            k += 1;
        } else {
            (sum, next_point) = (after, next_point + 1);
        }
    }
    let samples = ranks.gather(&words)?.concat();
    let mut samples: Vec<Key> = samples.as_chunks::<3>().0.to_vec();
    samples.sort_unstable();
    // Which share of the weight is before a sample is counted.
    let (mut next_point, mut sum) = (0, 0.0);
    let mut below = Vec::with_capacity(samples.len());
    for sample in &samples {
        while next_point < sorted.len() && sorted[next_point].0 < *sample {
            sum += sorted[next_point].1;
            next_point += 1;
        }
        below.push(f64::to_bits(sum));
    }
    let add = |a, b| (f64::from_bits(a) + f64::from_bits(b)).to_bits();
    let below: Vec<f64> = combine(ranks, &below, add)?.into_iter().map(f64::from_bits).collect();
    let cut = |rank: usize| {
        let wanted = total * rank as f64 / size as f64;
        let after = below.partition_point(|weight| *weight < wanted).min(samples.len() - 1);
        let before = after.saturating_sub(1);
        let is_nearer = wanted - below[before] < below[after] - wanted;
        samples[if is_nearer { before } else { after }]
    };
    let cuts = 1..size;
    Ok(if samples.is_empty() { vec![Key::default(); size - 1] } else { cuts.map(cut).collect() })
}

/// Which points went where, and where those that are here came from.
#[derive(Clone, Debug)]
pub(crate) struct Route {
    /// For each rank, the caller's points that went there, in the order in which they went.
    sent: Vec<Vec<u32>>,
    /// For each point that is here: the rank that it came from, and which of those that came from there it was.
    origins: Vec<(u32, u32)>,
}

impl Route {
    /// Sends each point to the rank whose first key is the last that is not above its own. `firsts` are the first keys of
    /// all ranks but the first. Returns the keys that are here, ascending; equal keys are in the order of ranks and, on each, in the
    /// caller's order.
    pub(crate) fn new(
        ranks: &dyn Transport,
        keys: &[Key],
        order: &[u32],
        firsts: &[Key],
    ) -> Result<(Self, Vec<Key>), TransportError> {
        let mut sent = vec![Vec::new(); ranks.size()];
        for &i in order {
            let key = keys[i as usize];
            sent[firsts.partition_point(|first| *first <= key)].push(i);
        }
        let message = |to: &Vec<u32>| to.iter().flat_map(|&i| keys[i as usize]).collect();
        let arrived = ranks.exchange(sent.iter().map(message).collect())?;
        let mut here: Vec<(Key, (u32, u32))> = Vec::new();
        for (from, words) in arrived.iter().enumerate() {
            let keys = words.as_chunks::<3>().0.iter().enumerate();
            here.extend(keys.map(|(index, key)| (*key, (from as u32, index as u32))));
        }
        here.sort_unstable();
        let (keys, origins) = here.into_iter().unzip();
        Ok((Self { sent, origins }, keys))
    }

    /// How many points the caller has.
    pub(crate) fn callers(&self) -> usize {
        self.sent.iter().map(Vec::len).sum()
    }

    /// Brings what belongs to the caller's points to where the points are, in the order of the curve.
    pub(crate) fn to_owners<V: Numbers>(
        &self,
        ranks: &dyn Transport,
        items: &[V],
    ) -> Result<Vec<V>, TransportError> {
        let message = |to: &Vec<u32>| {
            let mut words = Vec::new();
            write(to.iter().map(|&i| &items[i as usize]), &mut words);
            words
        };
        let arrived = ranks.exchange(self.sent.iter().map(message).collect())?;
        let mut counts = vec![0; ranks.size()];
        self.origins.iter().for_each(|&(from, _)| counts[from as usize] += 1);
        let parts: Vec<Vec<V>> = arrived
            .iter()
            .zip(counts)
            .map(|(words, count)| read(count, &mut words.iter()))
            .collect();
        let item = |&(from, index): &(u32, u32)| parts[from as usize][index as usize].clone();
        Ok(self.origins.iter().map(item).collect())
    }

    /// Brings what belongs to the points that are here back to their callers, in the caller's order.
    pub(crate) fn to_callers<V: Numbers>(
        &self,
        ranks: &dyn Transport,
        items: &[V],
    ) -> Result<Vec<V>, TransportError> {
        let mut places: Vec<Vec<u32>> = vec![Vec::new(); ranks.size()];
        for (place, &(from, index)) in self.origins.iter().enumerate() {
            let places = &mut places[from as usize];
            places.resize(places.len().max(index as usize + 1), 0);
            places[index as usize] = place as u32;
        }
        let message = |places: &Vec<u32>| {
            let mut words = Vec::new();
            write(places.iter().map(|&place| &items[place as usize]), &mut words);
            words
        };
        let arrived = ranks.exchange(places.iter().map(message).collect())?;
        let mut back = vec![V::zero(); self.callers()];
        for (sent, words) in self.sent.iter().zip(&arrived) {
            for (&i, item) in sent.iter().zip(read(sent.len(), &mut words.iter())) {
                back[i as usize] = item;
            }
        }
        Ok(back)
    }
}

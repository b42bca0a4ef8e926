//! What all ranks find out together.

use crate::error::Error;
use crate::transport::{Transport, TransportError};

/// Up to how many words all are sent to all ranks, rather than in parts to those that add them up.
const FEW: usize = 16;

/// Combines numbers of all ranks, index by index and in the order of ranks, into numbers that all ranks have: as many on
/// every rank. Each sends O(n + P) words.
pub(crate) fn combine(
    ranks: &dyn Transport,
    numbers: &[u64],
    with: impl Fn(u64, u64) -> u64,
) -> Result<Vec<u64>, TransportError> {
    let together = |all: Vec<Vec<u64>>| {
        let add = |mut sum: Vec<u64>, own: Vec<u64>| {
            sum.iter_mut().zip(own).for_each(|(sum, own)| *sum = with(*sum, own));
            sum
        };
        all.into_iter().reduce(add).unwrap_or_default()
    };
    if numbers.len() <= FEW {
        return Ok(together(ranks.gather(numbers)?));
    }
    let part = numbers.len().div_ceil(ranks.size());
    let mut parts: Vec<Vec<u64>> = numbers.chunks(part).map(<[u64]>::to_vec).collect();
    parts.resize(ranks.size(), Vec::new());
    let own = together(ranks.exchange(parts)?);
    Ok(ranks.gather(&own)?.concat())
}

/// The sum of a number of all ranks.
pub(crate) fn sum(ranks: &dyn Transport, number: u64) -> Result<u64, TransportError> {
    Ok(combine(ranks, &[number], u64::wrapping_add)?[0])
}

/// Whether something holds on any rank.
pub(crate) fn any(ranks: &dyn Transport, holds: bool) -> Result<bool, TransportError> {
    Ok(sum(ranks, u64::from(holds))? > 0)
}

/// What a rank has got, if all ranks have got theirs; the error of the first that hasn't otherwise, on all of them.
///
/// What a rank can't do, the others mustn't wait for: every step that may fail on one rank ends here on all.
pub(crate) fn agree<V, E: std::fmt::Display>(
    ranks: &dyn Transport,
    own: Result<V, E>,
) -> Result<V, Error> {
    let reason = own.as_ref().err().map(|error| error.to_string());
    let words = reason.map_or(Vec::new(), |reason| {
        std::iter::once(reason.len() as u64).chain(reason.bytes().map(u64::from)).collect()
    });
    let all = ranks.gather(&words)?;
    match (all.iter().position(|words| !words.is_empty()), own) {
        (Some(rank), _) => {
            let bytes: Vec<u8> = all[rank][1..].iter().map(|&byte| byte as u8).collect();
            Err(Error::Refused { rank, reason: String::from_utf8_lossy(&bytes).into_owned() })
        }
        (None, Ok(own)) => Ok(own),
        // An error is never silent: it has sent its length at least.
        (None, Err(error)) => Err(Error::Refused { rank: ranks.rank(), reason: error.to_string() }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::threads::on_threads;

    #[test]
    fn numbers_of_all_ranks_are_combined_on_all() {
        for (size, len) in [(1, 3), (3, 0), (3, 16), (3, 17), (5, 100), (40, 20)] {
            let sums = on_threads(size, |ranks| {
                let own: Vec<u64> = (0..len).map(|i| i * 100 + ranks.rank() as u64).collect();
                let sums = combine(ranks, &own, u64::wrapping_add).unwrap();
                (sums, combine(ranks, &own, u64::max).unwrap(), ranks.volume().words)
            });
            let (p, all) = (size as u64, (size * (size - 1) / 2) as u64);
            for (sum, most, words) in sums {
                assert!(sum.into_iter().eq((0..len).map(|i| p * i * 100 + all)));
                assert!(most.into_iter().eq((0..len).map(|i| i * 100 + p - 1)));
                assert!(len <= 16 || words <= 2 * (2 * len + 2 * p), "{words}");
            }
        }
    }

    #[test]
    fn what_one_rank_refuses_all_refuse_alike() {
        let results = on_threads(5, |ranks| {
            let rank = ranks.rank();
            let own = if rank % 3 == 1 { Err(format!("charge {rank} is NaN")) } else { Ok(rank) };
            (agree(ranks, own), agree(ranks, Ok::<_, String>(rank)))
        });
        let refused = Error::Refused { rank: 1, reason: "charge 1 is NaN".into() };
        for (rank, (first, second)) in results.into_iter().enumerate() {
            assert_eq!((first, second), (Err(refused.clone()), Ok(rank)));
        }
    }
}

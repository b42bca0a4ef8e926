//! Files that something has happened to.

use std::time::{Duration, Instant};

/// Numbers and words that readers stumble over.
const WORDS: [&[u8]; 16] = [
    b"nan",
    b"-inf",
    b"1e999",
    b"-1",
    b"0",
    b"4294967295",
    b"18446744073709551616",
    b"99999999999999999999999999",
    b"1e-320",
    b"0x1p3",
    b"\n",
    b"\r\n",
    b" ",
    b"\0",
    b"\xff\xfe",
    b",,",
];

/// Calls `read` with damaged copies of `samples` and the seeds they come from: as many as `count` for each,
/// or for as many seconds as `FARFIELD_FUZZ_SECONDS` says. Returns how many copies there were.
pub fn for_each_damaged(samples: &[&[u8]], count: u64, mut read: impl FnMut(u64, &[u8])) -> u64 {
    let limit = std::env::var("FARFIELD_FUZZ_SECONDS").ok();
    let limit = limit.map(|s| Duration::from_secs(s.parse().expect("a number of seconds")));
    let start = Instant::now();
    let goes_on = |seed: u64| match limit {
        Some(limit) => start.elapsed() < limit,
        None => seed < count,
    };
    let mut seed = 0;
    while goes_on(seed) {
        for sample in samples {
            read(seed, &damaged(seed, sample));
        }
        seed += 1;
    }
    seed * samples.len() as u64
}

/// A copy with one to four changes: bits, bytes, pieces left out, doubled or moved, words put in, the end
/// cut off.
pub fn damaged(seed: u64, sample: &[u8]) -> Vec<u8> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let mut pick = |below: usize| {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % below.max(1) as u64) as usize
    };
    let mut bytes = sample.to_vec();
    for _ in 0..1 + pick(4) {
        let at = pick(bytes.len());
        let piece = at..(at + 1 + pick(12)).min(bytes.len());
        match pick(7) {
            _ if bytes.is_empty() => bytes.push(pick(256) as u8),
            0 => bytes[at] ^= 1 << pick(8),
            1 => bytes[at] = pick(256) as u8,
            2 => drop(bytes.drain(piece)),
            3 => {
                let copy = bytes[piece].to_vec();
                let to = pick(bytes.len());
                bytes.splice(to..to, copy);
            }
            4 => {
                let word = WORDS[pick(WORDS.len())];
                bytes.splice(piece, word.iter().copied());
            }
            5 => {
                let word = WORDS[pick(WORDS.len())];
                bytes.splice(at..at, word.iter().copied());
            }
            _ => bytes.truncate(at),
        }
    }
    bytes
}

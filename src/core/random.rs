//! Named random streams. Each run has one seed, and every consumer draws from its own stream, so that an additional
//! draw in the camera does not change the friction.

use rand_pcg::Pcg64;
use rand_pcg::rand_core::SeedableRng;

/// The generator used everywhere: its output is specified by the algorithm, independent of a library's version.
pub type Rng = Pcg64;

/// All random streams of one run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Streams {
    seed: u64,
}

impl Streams {
    /// The streams for `seed`.
    pub fn new(seed: u64) -> Self {
        Self { seed }
    }

    /// The stream called `name`: equal seed and name, equal numbers.
    pub fn stream(&self, name: &str) -> Rng {
        Rng::seed_from_u64(splitmix(self.seed ^ fnv1a(name)))
    }

    /// The streams below `name`, for numbered consumers.
    pub fn numbered(&self, name: &str, number: u64) -> Rng {
        Rng::seed_from_u64(splitmix(splitmix(self.seed ^ fnv1a(name)).wrapping_add(number)))
    }
}

/// FNV-1a, 64 bits (Fowler, Noll, Vo).
fn fnv1a(name: &str) -> u64 {
    name.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

/// One step of SplitMix64 (Steele, Lea, Flood, OOPSLA 2014): spreads seeds that differ in few bits.
fn splitmix(seed: u64) -> u64 {
    let z = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_pcg::rand_core::Rng as _;

    #[test]
    fn first_draws_never_change() {
        let mut stream = Streams::new(7).stream("camera");
        let draws = [stream.next_u64(), stream.next_u64()];
        assert_eq!(draws, GOLDEN, "the generator's output is part of every journal");
    }

    /// Recorded values; changing them changes every recorded run.
    const GOLDEN: [u64; 2] = [5_841_741_068_360_979_714, 4_750_037_569_847_884_715];
}

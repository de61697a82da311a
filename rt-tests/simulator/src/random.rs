//! Random numbers of the tests.

use glam::{DQuat, DVec3};
use rand_xoshiro::SplitMix64;
use rand_xoshiro::rand_core::{RngCore, SeedableRng};

/// A generator whose stream is the same on every machine.
///
/// When the test that owns it panics, it writes its seed to standard error.
#[derive(Debug, Clone)]
pub struct Random {
    seed: u64,
    generator: SplitMix64,
}

impl Random {
    /// The stream of a seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self {
            seed,
            generator: SplitMix64::seed_from_u64(seed),
        }
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.generator.next_u64()
    }

    /// Uniform in 0 to 1, 1 excluded.
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A whole number below a bound, which is not 0.
    pub fn below(&mut self, bound: u64) -> u64 {
        self.bits() % bound
    }

    /// Whether an event of this probability happens. An impossible one draws nothing.
    pub fn happens(&mut self, probability: f64) -> bool {
        probability > 0.0 && self.unit() < probability
    }

    /// Uniform in the cube from -1 to 1.
    pub fn vector(&mut self) -> DVec3 {
        let mut coordinate = || 2.0 * self.unit() - 1.0;
        DVec3::new(coordinate(), coordinate(), coordinate())
    }

    /// A rotation.
    pub fn orientation(&mut self) -> DQuat {
        loop {
            let xyz = self.vector();
            let q = DQuat::from_vec4(xyz.extend(2.0 * self.unit() - 1.0));
            if q.length() > 0.1 {
                return q.normalize();
            }
        }
    }
}

impl Drop for Random {
    fn drop(&mut self) {
        if std::thread::panicking() {
            eprintln!("random seed {}", self.seed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_stay_in_their_ranges() {
        let mut random = Random::new(1);
        for _ in 0..1000 {
            assert!((0.0..1.0).contains(&random.unit()));
            assert!(random.below(3) < 3);
            assert!(random.vector().abs().max_element() <= 1.0);
            assert!(random.orientation().is_normalized());
        }
    }

    #[test]
    fn an_impossible_event_draws_nothing() {
        let (mut one, mut other) = (Random::new(2), Random::new(2));
        assert!(!one.happens(0.0));
        assert_eq!(one.bits(), other.bits());
    }
}

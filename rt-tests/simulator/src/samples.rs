//! What a bad device does to its samples: noise, spikes, numbers that are none, silence.

use crate::random::Random;
use haptic_device::Sample;

/// Properties of a device. The default does nothing.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SampleModel {
    /// Largest noise of each coordinate, metres; uniform.
    pub noise_m: f64,
    /// Probability that a sample is a spike.
    pub spikes: f64,
    /// Largest coordinate of a spike, metres.
    pub spike_m: f64,
    /// Probability that a coordinate of a sample is not a finite number.
    pub nonsense: f64,
    /// Probability that the device falls silent at a sample.
    pub silence: f64,
    /// Longest silence, ticks.
    pub silent_ticks: u64,
}

/// The samples of a client's devices on their way to the controller, and counts of what happened
/// to them.
#[derive(Debug, Clone)]
pub struct SampleFaults {
    model: SampleModel,
    random: Random,
    /// Samples for which each device stays silent.
    silent: Vec<u64>,
    /// Samples with noise.
    pub noisy: u64,
    /// Spikes.
    pub spikes: u64,
    /// Samples that are not finite.
    pub nonsense: u64,
    /// Samples missing.
    pub missing: u64,
}

impl SampleFaults {
    /// Nothing happens to the samples of so many probes.
    #[must_use]
    pub fn new(probes: usize) -> Self {
        Self {
            model: SampleModel::default(),
            random: Random::new(0),
            silent: vec![0; probes],
            noisy: 0,
            spikes: 0,
            nonsense: 0,
            missing: 0,
        }
    }

    /// From now on.
    pub(crate) fn disturb(&mut self, model: SampleModel, seed: u64) {
        self.model = model;
        self.random = Random::new(seed);
        self.silent.fill(0);
    }

    /// What arrives of a probe's sample.
    pub(crate) fn pass(&mut self, probe: usize, sample: Option<Sample>) -> Option<Sample> {
        let mut sample = sample?;
        let (model, random) = (self.model, &mut self.random);
        if self.silent[probe] == 0 && random.happens(model.silence) {
            self.silent[probe] = 1 + random.below(model.silent_ticks.max(1));
        }
        if self.silent[probe] > 0 {
            self.silent[probe] -= 1;
            self.missing += 1;
            return None;
        }
        if model.noise_m > 0.0 {
            sample.pose.position += random.vector() * model.noise_m;
            self.noisy += 1;
        }
        if random.happens(model.spikes) {
            sample.pose.position += random.vector() * model.spike_m;
            self.spikes += 1;
        }
        if random.happens(model.nonsense) {
            let none = [f64::NAN, f64::INFINITY, f64::MAX, f64::NEG_INFINITY];
            let value = none[random.below(none.len() as u64) as usize];
            sample.pose.position[random.below(3) as usize] = value;
            self.nonsense += 1;
        }
        Some(sample)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::Pose;
    use glam::DVec3;

    fn passed(model: SampleModel) -> (SampleFaults, Vec<Option<Sample>>) {
        let mut faults = SampleFaults::new(1);
        faults.disturb(model, 1);
        let sample = Some(Sample::at(Pose::at(DVec3::ZERO)));
        let samples = (0..1000).map(|_| faults.pass(0, sample)).collect();
        (faults, samples)
    }

    #[test]
    fn by_default_samples_pass_as_they_are() {
        let (faults, samples) = passed(SampleModel::default());
        let is_same =
            |sample: &Option<Sample>| sample.is_some_and(|of| of.pose.position == DVec3::ZERO);
        assert!(samples.iter().all(is_same));
        assert_eq!(
            faults.missing + faults.spikes + faults.noisy + faults.nonsense,
            0
        );
    }

    #[test]
    fn each_fault_does_what_it_says_and_is_counted() {
        let (faults, samples) = passed(SampleModel {
            noise_m: 1e-4,
            spikes: 0.1,
            spike_m: 1.0,
            nonsense: 0.1,
            silence: 0.05,
            silent_ticks: 5,
        });
        let missing = samples.iter().filter(|sample| sample.is_none()).count();
        assert_eq!(faults.missing, missing as u64);
        let places: Vec<DVec3> = samples
            .iter()
            .flatten()
            .map(|of| of.pose.position)
            .collect();
        let is_nonsense = |at: &&DVec3| !(at.is_finite() && at.length() < 1e9);
        assert_eq!(
            faults.nonsense,
            places.iter().filter(is_nonsense).count() as u64
        );
        assert!(faults.spikes > 20 && faults.noisy as usize == places.len());
        assert!(faults.missing > 20 && faults.nonsense > 20);
    }
}

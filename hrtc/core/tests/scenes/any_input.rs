//! Any input of the device or the link: no panic, no force beyond its limits, and contact works
//! again afterwards.

use crate::common::{World, change_records, plan, spm, world};
use geometry::Pose;
use glam::{DQuat, DVec3};
use haptic_device::Sample;
use hrtc_core::streaming::chunk::InboxChunk;
use proptest::prelude::*;
use protocol::{CHUNK_SLOTS, ChunkKind, MeasuredError, Refusal};
use simulator::Random;
use spm::VspRecord;
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};
use std::sync::OnceLock;

fn model() -> Vec<u8> {
    static MODEL: OnceLock<Vec<u8>> = OnceLock::new();
    let made = || spm(generate(Shape::Relief, 30_000, 1), &BuildOptions::default());
    MODEL.get_or_init(made).clone()
}

/// A world that watches every force.
struct Watched {
    world: World,
    last: DVec3,
    force_max: f64,
    step_max: f64,
}

impl Watched {
    fn new() -> Self {
        let plan = plan("");
        Self {
            world: world(&plan, &model(), 20.0),
            last: DVec3::ZERO,
            force_max: plan.safety.force_max_n,
            step_max: plan.safety.slew_n_per_s / plan.loop_.rate_hz,
        }
    }

    /// After a second and a half, in contact.
    fn in_contact() -> Self {
        let mut watched = Self::new();
        watched.tour(1500);
        assert!(watched.world.summary().last.contact);
        watched
    }

    fn check(&mut self) {
        let force = self.world.force();
        assert!(force.is_finite(), "{force}");
        assert!(force.length() <= self.force_max, "{force}");
        let step = force.distance(self.last);
        assert!(step <= self.step_max * (1.0 + 1e-12), "a step of {step} N");
        self.last = force;
    }

    fn sample(&mut self, sample: Option<Sample>) {
        self.world.step(sample);
        self.check();
    }

    fn tour(&mut self, ticks: u64) {
        for _ in 0..ticks {
            self.world.step_led();
            self.check();
        }
    }

    /// Share of the next ticks in contact with a force.
    fn contact_share(&mut self, ticks: u64) -> f64 {
        let mut touched = 0;
        for _ in 0..ticks {
            let record = self.world.step_led().record;
            self.check();
            touched += u64::from(record.contact && self.last.length() > 0.0);
        }
        touched as f64 / ticks as f64
    }

    /// The tour goes on, and after a moment it touches as before.
    fn is_in_contact_again(&mut self) {
        self.tour(500);
        let share = self.contact_share(2000);
        // Refused regions stay coarse, and a coarse front may lie below what the hand intends.
        println!("in contact {share} of the time");
        assert!(share > 0.3, "in contact {share} of the time");
        self.world.controller().cache().check();
    }

    fn position(&mut self) -> DVec3 {
        let sample = self.world.client_mut().hand(0).read(1);
        sample.map_or(DVec3::ZERO, |sample| sample.pose.position)
    }
}

fn at(position: DVec3) -> Option<Sample> {
    Some(Sample::at(Pose::at(position)))
}

#[test]
fn samples_that_are_not_finite_are_rejected_and_counted() {
    let mut watched = Watched::in_contact();
    let good = watched.position();
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for k in 0..3 {
            let mut position = good;
            position[k] = bad;
            watched.sample(at(position));
            assert!(watched.world.summary().last.rejected_sample);
        }
        watched.sample(Some(Sample::at(Pose {
            position: good,
            orientation: DQuat::from_xyzw(0.0, bad, 0.0, 1.0),
        })));
        assert!(watched.world.summary().last.rejected_sample);
    }
    watched.is_in_contact_again();
}

#[test]
fn without_samples_the_force_ramps_down_and_comes_back() {
    let mut watched = Watched::in_contact();
    for _ in 0..100 {
        watched.sample(None);
    }
    assert!(!watched.world.summary().last.rejected_sample);
    for _ in 0..400 {
        watched.sample(None);
    }
    assert_eq!(watched.last.length(), 0.0);
    watched.is_in_contact_again();
}

#[test]
fn jumps_of_any_length() {
    for jump in [1e-2, 1.0, 1e6, 1e150, 1e300, f64::MAX] {
        println!("jumps of {jump} m");
        let mut watched = Watched::in_contact();
        let home = watched.position();
        for direction in [DVec3::X, DVec3::NEG_Z, DVec3::new(-0.6, 0.8, 0.0)] {
            watched.sample(at(home + direction * jump));
            watched.sample(at(home));
            for _ in 0..20 {
                watched.sample(at(home - direction * jump));
            }
            watched.sample(at(home));
        }
        watched.is_in_contact_again();
    }
}

#[test]
fn noise_instead_of_samples() {
    println!("seed 5");
    let mut random = Random::new(5);
    let mut watched = Watched::in_contact();
    for _ in 0..3000 {
        let bits = [random.bits(), random.bits(), random.bits()];
        let position = DVec3::from_array(bits.map(f64::from_bits));
        watched.sample(at(position));
    }
    watched.is_in_contact_again();
}

/// Noise over a chunk's payload and its description in the header. Sender and number stay right.
fn noise(chunk: &mut InboxChunk, random: &mut Random) {
    let header = &mut chunk.header;
    match random.below(4) {
        // Only the payload.
        0 => {}
        // A likely kind and count.
        1 => {
            header.kind = 1 + random.below(7) as u32;
            header.count = random.below(64 * CHUNK_SLOTS as u64 + 2) as u32;
        }
        2 => {
            header.region = random.below(1 << 20) as u32;
            header.last = random.below(2) as u32;
        }
        _ => {
            header.kind = random.bits() as u32;
            header.count = random.bits() as u32;
            header.code = random.bits() as u32;
            header.region = random.bits() as u32;
            header.last = random.bits() as u32;
        }
    }
    let unknown_model = Refusal::UnknownModel as u32;
    if header.kind == ChunkKind::Refused as u32 && header.code == unknown_model {
        // The controller believes a station that does not know the model: contact ends by right.
        header.code = Refusal::UnknownRegion as u32;
    }
    let from = random.below(CHUNK_SLOTS as u64) as usize;
    for slot in &mut chunk.slots[from..] {
        for word in &mut slot.words {
            *word = random.bits() as u32;
        }
    }
}

#[test]
fn chunks_of_noise_with_right_numbers() {
    for seed in 1..=6 {
        println!("seed {seed}");
        let mut random = Random::new(seed);
        let mut watched = Watched::in_contact();
        watched.world.client_mut().link().tamper(move |chunk| {
            if random.below(3) == 0 {
                noise(chunk, &mut random);
            }
        });
        watched.tour(2500);
        watched.world.controller().cache().check();
        watched.world.client_mut().link().stop_tampering();
        assert_eq!(watched.world.controller().fault(), None);
        watched.is_in_contact_again();
    }
}

#[test]
fn a_measured_error_that_is_no_number_is_in_the_record() {
    for bad in [f64::NAN, f64::INFINITY] {
        let mut watched = Watched::in_contact();
        watched.world.client_mut().link().tamper(move |chunk| {
            if chunk.header.kind == ChunkKind::Measured as u32 {
                let errors: &mut [MeasuredError] = bytemuck::cast_slice_mut(&mut chunk.slots);
                errors[0].distance = bad;
            }
        });
        let mut told = 0;
        for _ in 0..2000 {
            watched.tour(1);
            let measured_m = watched.world.outputs().record.measured_error_m;
            told += u32::from(!measured_m.is_finite());
        }
        assert!(told > 0, "{bad}");
    }
}

#[test]
fn a_model_of_noise_is_a_fault_and_no_panic() {
    let mut faults = 0;
    for seed in 1..=40 {
        println!("seed {seed}");
        let mut random = Random::new(seed);
        let mut watched = Watched::new();
        let rarely = 1 + random.below(30);
        watched.world.client_mut().link().tamper(move |chunk| {
            if random.below(rarely) == 0 {
                let slot = random.below(CHUNK_SLOTS as u64) as usize;
                let word = random.below(16) as usize;
                chunk.slots[slot].words[word] ^= 1 << random.below(32);
            }
        });
        let mut is_fault = false;
        for _ in 0..600 {
            watched.tour(1);
            is_fault |= watched.world.controller().has_faults();
        }
        faults += u32::from(is_fault);
    }
    println!("{faults} faults");
    assert!(faults > 0);
}

#[test]
fn damaged_records_are_refused_and_counted_and_contact_goes_on() {
    type Damage = fn(&mut VspRecord, u32);
    let damages: [(&str, Damage); 6] = [
        ("position", |record, _| record.pos_u[1] = f32::NAN),
        ("parent", |record, _| record.vs = u32::MAX - 1),
        ("left neighbours", |record, _| {
            record.fn_[..2].fill(u32::MAX)
        }),
        ("leaf", |record, _| record.leaf_l = 0),
        ("leaf of another face", |record, other| {
            record.leaf_l = other
        }),
        ("another parent", |record, _| record.vs = 0),
    ];
    for (name, damage) in damages {
        let mut random = Random::new(9);
        let mut watched = Watched::in_contact();
        let mut other = 1;
        watched.world.client_mut().link().tamper(move |chunk| {
            change_records(chunk, |record| {
                if random.below(128) == 0 {
                    damage(record, other);
                    other = record.leaf_l;
                }
            });
        });
        let before = watched.world.summary().last.resubscribed;
        watched.tour(3000);
        watched.world.controller().cache().check();
        watched.world.client_mut().link().stop_tampering();
        let (refused, _) = watched.world.controller().refused();
        let again = watched.world.summary().last.resubscribed - before;
        println!("{name}: {refused} regions refused, {again} epochs ended");
        assert!(refused > 0, "{name}");
        watched.is_in_contact_again();
        // Refused regions are asked for again after two seconds, and are sound now.
        let (mut contact, mut full) = (0, 0);
        for _ in 0..1500 {
            let record = watched.world.step_led().record;
            watched.check();
            contact += u32::from(record.contact);
            full += u32::from(record.contact_full);
        }
        println!("{name}: full in {full} of {contact} contact ticks");
        // A record that turns out not to fit at its split stays in the cache while another region
        // holds it: there the surface stays coarse, and each region that needs it is refused again.
        let least = if name == "another parent" { 3 } else { 9 };
        assert!(contact > 0 && full * 10 >= contact * least, "{name}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 24,
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn any_bytes_as_chunks(
        chunks in prop::collection::vec(
            (prop::collection::vec(any::<u32>(), 6), any::<u64>(), 0..4u8), 1..40),
    ) {
        let mut watched = Watched::new();
        watched.tour(150);
        let mut chunks = chunks.into_iter();
        watched.world.client_mut().link().tamper(move |chunk| {
            let Some((words, seed, keep)) = chunks.next() else {
                return;
            };
            let own = chunk.header;
            let mut random = Random::new(seed);
            for slot in &mut chunk.slots {
                for word in &mut slot.words {
                    *word = random.bits() as u32;
                }
            }
            let header = &mut chunk.header;
            header.kind = words[0] % 8;
            header.region = words[1] % (1 << 24);
            header.count = words[2] % 130;
            header.last = words[3] % 2;
            header.code = words[4] % 300;
            header.sequence = own.sequence + u64::from(keep == 3);
            header.epoch = own.epoch.wrapping_add(u32::from(keep == 2));
            if keep == 1 {
                header.model = u64::from(words[5]);
            }
        });
        watched.tour(500);
        watched.world.controller().cache().check();
    }
}

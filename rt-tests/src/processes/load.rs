//! Load on the other core while a loop is measured.

use super::stop::is_set;
use clap::{Args, ValueEnum};
use std::hint::black_box;
use std::sync::atomic::AtomicBool;

/// Kinds of load.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Load {
    /// None of ours.
    None,
    /// Two threads of arithmetic.
    Cpu,
    /// Two threads that stream through more memory than any cache holds.
    Memory,
}

impl Load {
    /// As it is typed.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Cpu => "cpu",
            Self::Memory => "memory",
        }
    }
}

/// What the load's role is told.
#[derive(Debug, Args)]
pub struct LoadArgs {
    /// Kind.
    pub kind: Load,
}

/// Words of each of the two memories of a thread: 64 MB.
const WORDS: usize = 8 << 20;

/// Loads the cores that this process may use until `stop` is set.
pub fn load(args: &LoadArgs, stop: &AtomicBool) {
    std::thread::scope(|scope| {
        for seed in 1..=2_u64 {
            scope.spawn(move || match args.kind {
                Load::None => {}
                Load::Cpu => spin(seed, stop),
                Load::Memory => stream(seed, stop),
            });
        }
    });
}

fn spin(seed: u64, stop: &AtomicBool) {
    let mut x = seed;
    while !is_set(stop) {
        x = arithmetic(x, 100_000);
    }
    black_box(x);
}

fn stream(seed: u64, stop: &AtomicBool) {
    let (mut from, mut to) = (vec![seed; WORDS], vec![0; WORDS]);
    while !is_set(stop) {
        to.copy_from_slice(&from);
        from[0] = from[0].wrapping_add(1);
        black_box(&to);
    }
}

/// A chain of dependent multiplications; returns its end so that it cannot be left out.
#[must_use]
#[inline(never)]
pub fn arithmetic(mut x: u64, steps: u64) -> u64 {
    for _ in 0..steps {
        x = black_box(x.wrapping_mul(6_364_136_223_846_793_005).rotate_left(17) ^ 1);
    }
    x
}

//! Models for tests.

use spm::{SpmFile, write_spm};
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, NoProgress, build_model};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Bytes that count how often they are read.
#[derive(Debug, Clone)]
pub struct Counted {
    bytes: Vec<u8>,
    reads: Arc<AtomicU64>,
}

impl Counted {
    /// With the count.
    pub fn new(bytes: Vec<u8>) -> (Self, Arc<AtomicU64>) {
        let reads = Arc::<AtomicU64>::default();
        let counted = Self {
            bytes,
            reads: Arc::clone(&reads),
        };
        (counted, reads)
    }
}

impl AsRef<[u8]> for Counted {
    fn as_ref(&self) -> &[u8] {
        self.reads.fetch_add(1, Ordering::Relaxed);
        &self.bytes
    }
}

/// The bytes of a small built model.
pub fn model_bytes(shape: Shape, faces: u32, regions: u32) -> Vec<u8> {
    let options = BuildOptions {
        base_faces: Some(100),
        regions: Some(regions),
    };
    let parts = build_model(generate(shape, faces, 1), &options, &NoProgress).unwrap();
    let mut bytes = Vec::new();
    write_spm(&parts, &mut bytes).unwrap();
    bytes
}

/// A small built model.
pub fn model(shape: Shape, faces: u32, regions: u32) -> SpmFile<Vec<u8>> {
    SpmFile::open(model_bytes(shape, faces, regions)).unwrap()
}

//! Models for tests.

use crate::build::{BuildOptions, NoProgress, build_model};
use crate::generate::{Shape, generate};
use shared::spm::{SpmFile, write_spm};

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

//! From mesh files to SPM files: what the builder counts, cuts, bounds and keeps.

#[path = "../common/mod.rs"]
mod common;

mod any_file;
mod expected_error;
mod full_refinement;
mod summary;
mod tools_from_spm_files;

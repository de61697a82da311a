//! Reads an SPM file and prints its header, regions and first records.
//!
//! ```text
//! cargo run -p spm --example read_spm -- bunny.spm
//! ```
//!
//! Without an argument it reads a tiny model that it makes in memory.

use spm::{FileError, SpmFile, SpmParts, write_spm};
use std::process::ExitCode;

/// Regions and records to print.
const SHOWN: usize = 5;

fn main() -> ExitCode {
    let mut arguments = std::env::args_os().skip(1);
    let (name, bytes) = match (arguments.next(), arguments.next()) {
        (None, _) => {
            println!("no file given (usage: read_spm FILE.spm), so a hexagon made in memory:");
            let mut bytes = Vec::new();
            let written = write_spm(&SpmParts::hexagon(), &mut bytes);
            ("hexagon".to_string(), written.map(|_| bytes))
        }
        (Some(path), None) => (path.display().to_string(), std::fs::read(&path)),
        (Some(_), Some(_)) => {
            eprintln!("read_spm takes one file: read_spm FILE.spm");
            return ExitCode::from(2);
        }
    };
    let bytes = match bytes {
        Ok(bytes) => bytes,
        Err(error) => {
            eprintln!("{name}: {error}");
            return ExitCode::from(2);
        }
    };
    match print(&bytes) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{name}: {error}");
            ExitCode::from(2)
        }
    }
}

fn print(bytes: &[u8]) -> Result<(), FileError> {
    let file = SpmFile::open(bytes)?;
    let header = file.model_header();
    println!("model {:016x}, {} bytes", header.model, file.file_bytes());
    println!(
        "base mesh of {} vertices and {} faces, {} splits, {} faces in all",
        header.base_vertices, header.base_faces, header.vsps, header.faces
    );
    println!("box from {:?} to {:?}", header.lower, header.upper);
    let [x, y, z] = header.grid.cells;
    println!("{} regions of {x} x {y} x {z} cells", file.regions().len());
    for &region in file.regions().iter().take(SHOWN) {
        let seeds = file.seeds(region)?.unwrap_or_default();
        println!("  cell {}: {} seeds", region.cell(), seeds.len());
    }
    for i in (0..header.vsps).take(SHOWN) {
        let record = file.record(i)?;
        println!(
            "  split {i}: vertex {} to {:?} and {:?}",
            record.vs, record.pos_t, record.pos_u
        );
    }
    Ok(())
}

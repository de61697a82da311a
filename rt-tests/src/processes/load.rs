//! Load on the other core while a loop is measured.

use super::stop::is_set;
use crate::failure::Failure;
use clap::{Args, ValueEnum};
use std::fs::File;
use std::hint::black_box;
use std::io::{self, Seek, Write};
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
    /// Two threads that write and sync files of 8 MB in the folder for temporary files (TMPDIR).
    Io,
}

impl Load {
    /// As it is typed.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Cpu => "cpu",
            Self::Memory => "memory",
            Self::Io => "io",
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

/// Bytes that are written before each sync, and of a file.
const BLOCK: usize = 256 << 10;
const FILE: usize = 8 << 20;

/// Loads the cores that this process may use until `stop` is set.
///
/// # Errors
/// When a file cannot be written.
pub fn load(args: &LoadArgs, stop: &AtomicBool) -> Result<(), Failure> {
    let ended = std::thread::scope(|scope| {
        let one = |seed: u64| {
            move || {
                match args.kind {
                    Load::None => {}
                    Load::Cpu => spin(seed, stop),
                    Load::Memory => stream(seed, stop),
                    // Without a name: it is gone with this process, however that ends.
                    Load::Io => write_and_sync(&mut tempfile::tempfile()?, stop)?,
                }
                Ok::<(), io::Error>(())
            }
        };
        let threads = [1, 2].map(|seed| scope.spawn(one(seed)));
        threads.map(|thread| thread.join().unwrap_or(Ok(())))
    });
    let written: io::Result<()> = ended.into_iter().collect();
    written.map_err(|error| {
        let folder = std::env::temp_dir();
        Failure::Run(format!(
            "the load cannot write in {} ({error}); set TMPDIR to a folder of a disk",
            folder.display()
        ))
    })
}

/// Writes a file of bounded size over and over, with a sync after each block.
fn write_and_sync(file: &mut File, stop: &AtomicBool) -> io::Result<()> {
    let block = vec![0xA5; BLOCK];
    while !is_set(stop) {
        if file.stream_position()? >= FILE as u64 {
            file.rewind()?;
        }
        file.write_all(&block)?;
        file.sync_data()?;
    }
    Ok(())
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::Ordering;
    use std::time::{Duration, Instant};

    #[test]
    fn the_files_of_the_load_stay_bounded_and_go_with_it() {
        let stop = AtomicBool::new(false);
        let mut file = tempfile::tempfile().unwrap();
        let watched = file.try_clone().unwrap();
        std::thread::scope(|scope| {
            let writer = scope.spawn(|| write_and_sync(&mut file, &stop));
            let until = Instant::now() + Duration::from_secs(20);
            let size = || watched.metadata().unwrap().len();
            while size() < FILE as u64 && Instant::now() < until {
                std::thread::sleep(Duration::from_millis(5));
            }
            std::thread::sleep(Duration::from_millis(50));
            assert!(size() > 0 && size() <= FILE as u64, "{}", size());
            stop.store(true, Ordering::Relaxed);
            writer.join().unwrap().unwrap();
        });
        use std::os::unix::fs::MetadataExt;
        assert_eq!(watched.metadata().unwrap().nlink(), 0, "it has no name");
    }
}

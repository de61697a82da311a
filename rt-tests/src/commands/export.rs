//! `rt-tests export`: a recording as tables.

use crate::failure::{Chosen, Failure};
use crate::report::output::{make_folder_at, print};
use clap::Args;
use hrtc::recorder::{Entry, Hole, RecordingReader};
use hrtc::tick_record::{STAGES, TickRecord};
use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// Stretches of missing ticks that are named; of more only how many.
const HOLES_NAMED: usize = 3;

/// Arguments of `rt-tests export`.
#[derive(Debug, Args)]
#[command(override_usage = "rt-tests export <FILE> --csv [<DIR>]")]
pub struct ExportArgs {
    /// A file of a recording
    pub file: PathBuf,
    /// Write CSV tables into this folder [default: beside the file]
    #[arg(long, value_name = "DIR", num_args = 0..=1, required = true)]
    pub csv: Option<Option<PathBuf>>,
}

/// Runs the command.
///
/// # Errors
/// One sentence, with its status.
pub fn export(args: &ExportArgs) -> Result<(), Failure> {
    let reader =
        RecordingReader::open(&args.file).map_err(|error| Failure::Input(error.to_string()))?;
    let beside = args.file.with_extension("csv");
    let folder = args.csv.clone().flatten().unwrap_or(beside);
    make_folder_at(Chosen::By("--csv"), &folder)?;
    let probes = reader.head().probes();
    let written = write(reader, &folder, probes);
    let found = written.map_err(|e| Failure::Run(format!("{}: {e}", folder.display())))?;
    print(&found.words(&folder))
}

/// What was written, and what could not be.
#[derive(Debug, Default)]
struct Exported {
    ticks: u64,
    /// Messages that are not as they were written.
    damaged: u64,
    /// Ticks that the recording lacks.
    holes: Vec<Hole>,
    /// Whether the recording has its end.
    is_whole: bool,
}

impl Exported {
    fn words(&self, folder: &Path) -> String {
        let mut text = format!("{} ticks in {}", self.ticks, folder.display());
        if self.damaged > 0 {
            let _ = write!(text, "; {} damaged messages left out", self.damaged);
        }
        for hole in self.holes.iter().take(HOLES_NAMED) {
            let _ = write!(text, "; ticks {} to {} are missing", hole.first, hole.last);
        }
        if self.holes.len() > HOLES_NAMED {
            let more = self.holes.len() - HOLES_NAMED;
            let _ = write!(text, "; {more} more stretches are missing");
        }
        if !self.is_whole {
            text += "; it was cut short";
        }
        text + "\n"
    }
}

/// Writes one table of the run's ticks and one of each probe.
fn write(mut reader: RecordingReader, folder: &Path, probes: usize) -> io::Result<Exported> {
    let create = |name: String| File::create(folder.join(name)).map(BufWriter::new);
    let mut run = create("ticks.csv".to_string())?;
    let stages = STAGES.map(|stage| format!("{stage}_ns")).join(",");
    writeln!(
        run,
        "tick,start_ns,skipped,wake_ns,work_cpu_ns,work_wall_ns,{stages},record_ns,work_units,query_work,\
         operation_faces,allowed_ns,spent_ns,vsplits,ecols,geomorphing,unfinished,early,late_contacts,stuck,\
         active_faces,cache_bytes,bytes_received,requests"
    )?;
    let tables = (0..probes).map(|k| create(format!("probe-{k}.csv")));
    let mut tables = tables.collect::<io::Result<Vec<_>>>()?;
    for table in &mut tables {
        writeln!(
            table,
            "tick,x_m,y_m,z_m,qw,qx,qy,qz,fx_n,fy_n,fz_n,tx_nm,ty_nm,tz_nm,object,face,depth_m,\
             contact_full,energy_j,force_withheld"
        )?;
    }
    let mut found = Exported::default();
    for entry in reader.by_ref() {
        let record = match entry {
            Entry::Tick(record) => record,
            Entry::Damaged(_) => {
                found.damaged += 1;
                continue;
            }
            Entry::Hole(hole) => {
                found.holes.push(hole);
                continue;
            }
            _ => continue,
        };
        // Of a tick that is here only inputs or messages were lost, which no table has.
        found.holes.retain(|hole| hole.last < record.tick);
        writeln!(run, "{}", run_row(&record))?;
        for (k, table) in tables.iter_mut().enumerate() {
            writeln!(table, "{}", probe_row(&record, k))?;
        }
        found.ticks += 1;
    }
    found.is_whole = reader.is_whole();
    for table in tables.iter_mut().chain([&mut run]) {
        table.flush()?;
    }
    Ok(found)
}

fn run_row(record: &TickRecord) -> String {
    let core = &record.core;
    let mut row = format!(
        "{},{},{},{},{},{}",
        record.tick,
        record.start_ns,
        record.skipped,
        record.wake_ns,
        record.work_cpu_ns,
        record.work_wall_ns
    );
    for number in record.stage_ns.into_iter().chain([record.record_ns]) {
        let _ = write!(row, ",{number}");
    }
    for number in [
        core.work_units,
        core.query_work,
        core.operation_faces,
        core.allowed_ns,
        core.spent_ns,
        core.vsplits,
        core.ecols,
        core.geomorphing,
        core.unfinished,
        core.early,
        core.late_contacts,
        core.stuck,
        core.active_faces,
    ] {
        let _ = write!(row, ",{number}");
    }
    for number in [
        core.cache_bytes,
        core.bytes_received,
        record.requests.into(),
    ] {
        let _ = write!(row, ",{number}");
    }
    row
}

/// A probe's row; cells of what there was not are empty.
fn probe_row(record: &TickRecord, k: usize) -> String {
    let mut row = record.tick.to_string();
    match record.samples[k] {
        Some(sample) => {
            let at = sample.pose.position.to_array();
            for number in at.into_iter().chain(sample.pose.wxyz()) {
                let _ = write!(row, ",{number}");
            }
        }
        None => row.push_str(",,,,,,,"),
    }
    let wrench = record.wrenches[k];
    for number in [wrench.force, wrench.torque].map(|v| v.to_array()).concat() {
        let _ = write!(row, ",{number}");
    }
    let core = &record.core.probes[k];
    let _ = match record.contacts[k] {
        Some(of) => write!(row, ",{},{}", of.object, of.contact.face),
        None => write!(row, ",,"),
    };
    let full = u8::from(core.contact_full);
    let _ = write!(
        row,
        ",{},{full},{},{}",
        core.depth_m, core.energy_j, core.force_withheld
    );
    row
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_in_the_tables_is_said() {
        let folder = Path::new("out");
        let whole = Exported {
            ticks: 9,
            is_whole: true,
            ..Exported::default()
        };
        assert_eq!(whole.words(folder), "9 ticks in out\n");
        let hole = |first: u64| Hole {
            first,
            last: first + 1,
            reason: "a test".to_string(),
        };
        let found = Exported {
            ticks: 9,
            damaged: 2,
            holes: [3, 7, 20, 30, 40].map(hole).to_vec(),
            is_whole: false,
        };
        assert_eq!(
            found.words(folder),
            "9 ticks in out; 2 damaged messages left out; ticks 3 to 4 are missing; \
             ticks 7 to 8 are missing; ticks 20 to 21 are missing; \
             2 more stretches are missing; it was cut short\n"
        );
    }
}

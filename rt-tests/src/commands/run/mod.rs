//! `rt-tests run`: both processes on a scene, a live line, a closing report.

use crate::scenes::{check_seconds, prepare_models};
use scene_args::OverrideArgs;
mod report;
mod viewer;

use self::report::Report;
use self::viewer::Viewer;
use crate::failure::Failure;
use crate::machine::Machine;
use crate::pictures::playback::Playback;
use crate::pictures::shots::Shots;
use crate::processes::pair::{PairArgs, Shown, other_core, run_pair};
use crate::processes::roles::LoopArgs;
use crate::processes::stop::stop_flag;
use crate::report::output::{make_folder, print_either, print_json, status_bar, status_line};
use crate::report::units::{bytes, grouped, length};
use clap::Args;
use hrtc::result::Status;
use indicatif::ProgressBar;
use scene::{ModelSource, ScenePlan, load};
use scene_files::DiskFiles;
use std::path::{Path, PathBuf};

/// The recording in the folder of a report.
const RECORDING: &str = "recording.mcap";

/// Every file that a report may have.
const REPORT_FILES: [&str; 6] = [
    "report.html",
    "result.json",
    "touch.png",
    "force.svg",
    "timing.svg",
    "resolution.svg",
];

/// Arguments of `rt-tests run`.
#[derive(Debug, Args)]
pub struct RunArgs {
    /// The scene file
    pub scene: PathBuf,
    /// Length of the run, seconds
    #[arg(
        long,
        value_name = "S",
        default_value_t = 20.0,
        allow_negative_numbers = true
    )]
    pub seconds: f64,
    /// Over the scene.
    #[command(flatten)]
    pub overrides: OverrideArgs,
    /// Print one JSON object with the result on standard output
    #[arg(long)]
    pub json: bool,
    /// Folder of the report [default: reports/SCENE-MODEL]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// First file of the recording, or "off" [default: the scene's, else recording.mcap in the
    /// report's folder]
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
    /// Let every stage of a tick take F times as long, as on a slower machine; at least 1
    #[arg(long, value_name = "F", default_value_t = 1.0, value_parser = slowness)]
    pub slow: f64,
    /// Show the run in the viewer rerun while it goes on, from a process of its own; OUT as that of
    /// rt-tests view --rerun [default: viewer]. Needs a build with --features view
    #[arg(
        long,
        value_name = "OUT",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "viewer"
    )]
    pub view: Option<String>,
}

/// A finite number, at least 1.
fn slowness(text: &str) -> Result<f64, String> {
    let number = text.parse().ok();
    let slow = number.filter(|number: &f64| *number >= 1.0 && number.is_finite());
    slow.ok_or_else(|| "write a number, at least 1".to_owned())
}

/// Runs the command.
///
/// # Errors
/// One sentence, with its status.
pub fn run(args: &RunArgs) -> Result<(), Failure> {
    check_seconds(args.seconds)?;
    let plan = load(&args.scene, &args.overrides.overrides(), &DiskFiles)?;
    let out = args.out.clone().unwrap_or_else(|| {
        PathBuf::from("reports").join(format!("{}-{}", plan.name, model_name(&plan)))
    });
    let record = recording(args, &plan, &out);
    let viewer = args.view.as_deref();
    let mut viewer = viewer
        .map(|target| Viewer::new(&record, target, other_core(&plan)))
        .transpose()?;
    prepare_models(&plan)?;
    make_folder(&out)?;
    let has_report = out.join("report.html").is_file();
    if has_report && record == out.join(RECORDING) {
        remove_earlier(&out, is_recording)?;
    }
    let stop = stop_flag()?;
    let line = LiveLine::new(args.seconds);
    let pair = PairArgs {
        scene: &args.scene,
        plan: &plan,
        seconds: args.seconds,
        overrides: &args.overrides,
        loop_: LoopArgs {
            slow: (args.slow > 1.0).then_some(args.slow),
            ..LoopArgs::default()
        },
        record: Some(&record),
        device: None,
    };
    let outcome = run_pair(&pair, &stop, &mut |shown| {
        if let (Some(viewer), Shown::Status(_)) = (&mut viewer, shown) {
            viewer.start();
        }
        line.show(shown);
    });
    line.bar.finish_and_clear();
    // What was refused has changed nothing.
    if has_report && !outcome.as_ref().is_err_and(|failure| failure.status() == 2) {
        remove_earlier(&out, |name| REPORT_FILES.contains(&name))?;
    }
    let outcome = outcome?;
    if let Err(failure) = outcome.check_finite() {
        // A report has no place for figures that are left out.
        if args.json {
            print_json(&outcome.finished.result)?;
        }
        return Err(failure);
    }
    let machine = Machine::read();
    let mut notes = outcome.told();
    notes.extend(viewer.and_then(Viewer::finish));
    let picture = touch_picture(&record, &mut notes);
    let report = Report {
        plan: &plan,
        finished: &outcome.finished,
        machine: &machine,
        notes: &notes,
        picture: picture.as_deref(),
    };
    report.write(&out)?;
    let words = format!(
        "{}{:<11} {}\n",
        report.words(),
        "report",
        out.join("report.html").display()
    );
    print_either(args.json, &words, &outcome.finished.result)
}

/// Removes what an earlier run wrote into the folder of its report under such a name, so that
/// nothing of it stands beside the new one. Other files stay.
fn remove_earlier(folder: &Path, is_of_a_run: impl Fn(&str) -> bool) -> Result<(), Failure> {
    let entries = std::fs::read_dir(folder).map_err(|error| Failure::write(folder, &error))?;
    for entry in entries.flatten() {
        let is_file = entry.file_type().is_ok_and(|kind| kind.is_file());
        if !is_file || !entry.file_name().to_str().is_some_and(&is_of_a_run) {
            continue;
        }
        let path = entry.path();
        std::fs::remove_file(&path).map_err(|error| Failure::write(&path, &error))?;
    }
    Ok(())
}

/// Whether a file has a name that the recorder gives for `recording.mcap`: that, those of the files
/// after it and of what it keeps of a fault.
fn is_recording(name: &str) -> bool {
    let Some(rest) = name.strip_prefix("recording") else {
        return false;
    };
    let Some(rest) = rest.strip_suffix(".mcap") else {
        return false;
    };
    match rest.strip_prefix('-') {
        None => rest.is_empty(),
        Some("fault") => true,
        Some(number) => number.len() >= 4 && number.bytes().all(|digit| digit.is_ascii_digit()),
    }
}

/// Where the recording goes: as typed, as the scene says, or into the report's folder.
fn recording(args: &RunArgs, plan: &ScenePlan, out: &Path) -> PathBuf {
    let of_scene = match (&plan.record.path, plan.record.keep_bytes) {
        (_, None) => PathBuf::from("off"),
        (Some(path), _) => path.clone(),
        (None, _) => out.join(RECORDING),
    };
    args.record.clone().unwrap_or(of_scene)
}

/// The picture of the touch from the recording; a note tells why there is none.
fn touch_picture(record: &Path, notes: &mut Vec<String>) -> Option<Vec<u8>> {
    if record == Path::new("off") {
        notes.push("nothing was recorded, so there is no picture of the touch".to_string());
        return None;
    }
    let line = status_line();
    line.set_message("drawing the touch");
    let drawn = Playback::open(record).and_then(|of| {
        let picture = Shots::new(&of).strongest_png()?;
        if of.lacks_start {
            let [first, last] = of.ticks;
            notes.push(format!(
                "the picture is of the last {:.1} s: what was recorded before had to go",
                of.seconds(last - first + 1)
            ));
        }
        Ok(picture)
    });
    line.finish_and_clear();
    if let Err(failure) = &drawn {
        notes.push(format!("there is no picture of the touch: {failure}"));
    }
    drawn.ok()
}

/// A short name of the first object's model, fit for a folder.
fn model_name(plan: &ScenePlan) -> String {
    match plan.objects.first().map(|object| &object.model) {
        Some(ModelSource::File(path)) => path
            .file_stem()
            .map_or_else(|| "model".to_string(), |s| s.to_string_lossy().into_owned()),
        Some(ModelSource::Generate { shape, faces }) => format!("{shape}-{faces}"),
        None => "none".to_string(),
    }
}

/// The status line on standard error; silent where that is no terminal.
struct LiveLine {
    bar: ProgressBar,
}

impl LiveLine {
    fn new(seconds: f64) -> Self {
        let bar = status_bar((seconds * 10.0).ceil() as u64);
        bar.set_message("starting both processes");
        Self { bar }
    }

    fn show(&self, shown: Shown) {
        match shown {
            Shown::Status(status) => {
                self.bar.set_position((status.seconds * 10.0) as u64);
                self.bar.set_message(worded(status));
            }
            // A process's last sentence is told when its end is judged.
            Shown::Said(_, line) if line.starts_with("error: ") || line.is_empty() => {}
            Shown::Said(name, line) => {
                let line = format!("{name}: {line}");
                if self.bar.is_hidden() {
                    eprintln!("{line}");
                } else {
                    self.bar.println(line);
                }
            }
        }
    }
}

fn worded(status: &Status) -> String {
    let touch = match (status.ready, status.station, status.contact) {
        (_, false, _) => "station not there".to_string(),
        (false, ..) => "waiting for the model".to_string(),
        (.., true) => {
            let probes = match status.in_contact {
                0 | 1 => String::new(),
                count => format!(" with {count} probes"),
            };
            let (force, errors) = (status.force_n, errors(status));
            format!("touching{probes}, {force:.2} N, error {errors}")
        }
        (.., false) => "in free space".to_string(),
    };
    let awake = match status.awake {
        0 | 1 => String::new(),
        count => format!("  {count} objects awake"),
    };
    format!(
        "{:.1} s  {touch}{awake}  {} faces refined  cache {}  missed {}",
        status.seconds,
        grouped(status.refined_faces),
        bytes(status.cache_bytes),
        status.missed
    )
}

/// The certified error at the contact, and the newest measured one.
fn errors(status: &Status) -> String {
    let certified = format!("at most {}", length(status.certified_error_m));
    if status.measured_error_m < 0.0 {
        certified
    } else {
        format!("{certified}, measured {}", length(status.measured_error_m))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_files_of_an_earlier_run_are_removed() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        let recordings = [RECORDING, "recording-0001.mcap", "recording-fault.mcap"];
        let others = [
            "recording-of-mine.mcap",
            "recording-1.mcap",
            "recording.mcap.old",
            "notes.svg",
            "my-report.html",
        ];
        for name in REPORT_FILES.iter().chain(&recordings).chain(&others) {
            std::fs::write(at(name), b"earlier").expect("it is written");
        }
        std::fs::create_dir(at("recording-0002.mcap")).expect("a folder");
        assert_eq!(remove_earlier(folder.path(), is_recording), Ok(()));
        assert!(REPORT_FILES.iter().all(|name| at(name).is_file()));
        let is_of_report = |name: &str| REPORT_FILES.contains(&name);
        assert_eq!(remove_earlier(folder.path(), is_of_report), Ok(()));
        let mut of_a_run = REPORT_FILES.iter().chain(&recordings);
        assert!(of_a_run.all(|name| !at(name).exists()));
        assert!(others.iter().all(|name| at(name).is_file()));
        assert!(at("recording-0002.mcap").is_dir());
    }

    #[test]
    fn the_live_line_says_what_is_no_number() {
        let status = Status {
            contact: true,
            ready: true,
            station: true,
            force_n: f64::NAN,
            certified_error_m: f64::INFINITY,
            measured_error_m: f64::NAN,
            ..Status::default()
        };
        let line = worded(&status);
        assert!(
            line.contains("NaN N, error at most inf m, measured NaN m"),
            "{line}"
        );
    }
}

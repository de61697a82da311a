//! The command line: what was typed, and which library function answers it.

use crate::link;
use clap::{Args, Parser, Subcommand};
use scene_args::OverrideArgs;
use serde::Serialize;
use spm_builder::generate::{self, Shape};
use spm_builder::{BuildOptions, TerminalProgress};
use std::error::Error;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;
use ve_station::export::{self, Detail, ExportFormat};
use ve_station::inspect::{self, Facts};
use ve_station::output::{check_is_not_input, check_output};
use ve_station::serve::{ServeArgs, serve};

/// Status for a bad file, option or scene.
const BAD_INPUT: u8 = 2;

#[derive(Debug, Parser)]
#[command(
    version,
    about = "Builds space-partitioned progressive meshes (SPM) and serves them"
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Builds an SPM file from a mesh file (OBJ, PLY, STL, OFF, or the thesis's CDPM and SPM text)
    Build {
        /// The mesh file
        mesh: PathBuf,
        /// The SPM file to write
        #[arg(short, long, value_name = "FILE.spm")]
        output: PathBuf,
        /// Faces of the base mesh to aim at [default: 300 to 700, by the size of the mesh]
        #[arg(long, value_name = "N")]
        base_faces: Option<u32>,
        /// Grid cells along the longest side, a power of two [default: 40 to 140 faces a region]
        #[arg(long, value_name = "D")]
        regions: Option<u32>,
        /// Prints one JSON object instead of text
        #[arg(long)]
        json: bool,
    },
    /// Generates a mesh of known geometry: sphere, torus, terrain, plate, wedge, relief
    Generate {
        /// The shape
        shape: Shape,
        /// Faces, about; each shape rounds to its pattern
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32)
            .range(i64::from(generate::FEWEST_FACES)..=i64::from(generate::MAX_FACES)))]
        faces: u32,
        /// Seed of terrain and relief
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// The mesh file to write: .obj or .ply
        #[arg(short, long, value_name = "FILE")]
        output: PathBuf,
    },
    /// Shows what an SPM file holds, after checking every block of it
    Inspect {
        /// The SPM file
        file: PathBuf,
        /// Longest side of the model in the world, metres, for the greatest speed
        #[arg(
            long,
            value_name = "M",
            default_value_t = 0.15,
            allow_negative_numbers = true
        )]
        size: f64,
        /// Writes a picture too: where the mesh was cut, its regions and its levels of detail
        #[arg(long, value_name = "FILE.png")]
        picture: Option<PathBuf>,
        /// The axis of the model that points upwards in the picture
        #[arg(long, value_name = "AXIS", default_value = "z", requires = "picture")]
        up: inspect::Axis,
        /// Prints one JSON object instead of text
        #[arg(long)]
        json: bool,
    },
    /// Writes an SPM file as a mesh that any viewer shows, or as the thesis's text
    ///
    /// The ending of the output names the format: .obj, .ply, .stl and .off hold the mesh, .cdpm
    /// and .spmtxt the base mesh and the splits as in appendices A and B of the thesis; `build`
    /// reads all of them.
    Export {
        /// The SPM file
        file: PathBuf,
        /// The file to write
        #[arg(short, long, value_name = "FILE")]
        output: PathBuf,
        /// The format, whatever the ending: obj, ply, stl, off, cdpm or spmtxt
        #[arg(long, value_name = "NAME", value_parser = format_named)]
        format: Option<ExportFormat>,
        /// At most so many faces: the first splits only; never fewer than the base mesh has
        #[arg(long, value_name = "N", conflicts_with = "tolerance")]
        faces: Option<u32>,
        /// Only the splits whose expected error is larger than this, in the units of the model
        #[arg(long, value_name = "E", allow_negative_numbers = true)]
        tolerance: Option<f64>,
        /// Prints one JSON object instead of text
        #[arg(long)]
        json: bool,
    },
    /// Serves the models of a scene until Ctrl-C
    Serve(ServeOptions),
    /// Makes the keys of a link to controllers on other machines, and says how to copy them
    Keys {
        /// A new folder for them
        folder: PathBuf,
        /// Name or address by which controllers call the station; several times for several
        /// [default: this machine's]
        #[arg(long, value_name = "HOST")]
        host: Vec<String>,
        /// Days for which they are valid; with 0 they have expired in a second, for trials
        #[arg(long, value_name = "N", default_value_t = 365)]
        days: u32,
    },
    /// The process of a link, started by `serve --listen`
    #[cfg(feature = "tunnel")]
    #[command(hide = true)]
    Tunnel(tunnel::TunnelArgs),
}

#[derive(Debug, Args)]
struct ServeOptions {
    /// The scene file
    scene: PathBuf,
    /// Name of the iceoryx2 domain that both processes join
    #[arg(long, value_name = "NAME", default_value = "hrtc")]
    domain: String,
    /// Serves controllers on other machines too, which call this address: tls/0.0.0.0:7447
    #[arg(long, value_name = "ADDRESS")]
    listen: Option<String>,
    /// Folder of the station's keys [default: hrtc/keys in the user's folder of settings]
    #[arg(long, value_name = "DIR", requires = "listen")]
    keys: Option<PathBuf>,
    /// Shows each touch of a controller on this machine in rerun while it goes on: OUT as that of
    /// rt-tests view --rerun [default: viewer]. Needs rt-tests beside this program, built with
    /// --features view
    #[arg(
        long,
        value_name = "OUT",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "viewer"
    )]
    view: Option<String>,
    #[command(flatten)]
    overrides: OverrideArgs,
    /// Prints one JSON object at the end
    #[arg(long)]
    json: bool,
}

impl From<ServeOptions> for ServeArgs {
    fn from(typed: ServeOptions) -> Self {
        Self {
            scene: typed.scene,
            domain: typed.domain,
            overrides: typed.overrides.overrides(),
            view: typed.view,
            json: typed.json,
        }
    }
}

/// The object of `build --json`.
#[derive(Serialize)]
struct BuildResult {
    #[serde(flatten)]
    facts: Facts,
    seconds: f64,
    peak_rss_bytes: u64,
    file_bytes: u64,
}

/// Runs the command; says in one sentence on standard error why it could not.
pub fn main() -> ExitCode {
    let command = Cli::parse().command;
    // It has a log of its own.
    #[cfg(feature = "tunnel")]
    if let Command::Tunnel(args) = &command {
        return tunnel::run(args);
    }
    transport::logging::start();
    match run(command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // Nobody may be left to read it.
            let _ = writeln!(std::io::stderr(), "ve-station: {error}");
            ExitCode::from(BAD_INPUT)
        }
    }
}

fn run(command: Command) -> Result<(), Box<dyn Error>> {
    match command {
        Command::Build {
            mesh,
            output,
            base_faces,
            regions,
            json,
        } => {
            let options = BuildOptions {
                base_faces,
                regions,
            };
            build(&mesh, &output, &options, json)
        }
        Command::Generate {
            shape,
            faces,
            seed,
            output,
        } => generate_mesh(shape, faces, seed, &output),
        Command::Inspect {
            file,
            size,
            picture,
            up,
            json,
        } => inspect_file(&file, size, picture.as_deref().map(|path| (path, up)), json),
        Command::Export {
            file,
            output,
            format,
            faces,
            tolerance,
            json,
        } => {
            let detail = match (faces, tolerance) {
                (Some(faces), _) => Detail::Faces(faces),
                (None, Some(tolerance)) => Detail::Tolerance(tolerance),
                (None, None) => Detail::Full,
            };
            export_file(&file, &output, format, detail, json)
        }
        Command::Serve(options) => serve_until_signal(options),
        Command::Keys { folder, host, days } => print(&link::make_keys(&folder, &host, days)?),
        #[cfg(feature = "tunnel")]
        Command::Tunnel(_) => Ok(()),
    }
}

fn build(
    mesh: &Path,
    output: &Path,
    options: &BuildOptions,
    json: bool,
) -> Result<(), Box<dyn Error>> {
    check_output(output, mesh, "spm")?;
    let start = Instant::now();
    let progress = TerminalProgress::new();
    let built = spm_builder::build_file(mesh, output, options, &progress);
    progress.finish();
    let report = built?;
    let parts = &report.parts;
    let result = BuildResult {
        facts: Facts::new(&parts.header, &parts.summary, parts.regions.len()),
        seconds: start.elapsed().as_secs_f64(),
        peak_rss_bytes: peak_rss_bytes(),
        file_bytes: report.file_bytes,
    };
    let text = if json {
        serde_json::to_string(&result)?
    } else {
        format!(
            "{}{:<12} {} bytes in {}, {:.1} s",
            result.facts.to_text(),
            "written",
            result.file_bytes,
            output.display(),
            result.seconds
        )
    };
    print_beside(output, &text)
}

fn generate_mesh(shape: Shape, faces: u32, seed: u64, output: &Path) -> Result<(), Box<dyn Error>> {
    let make = || generate::generate(shape, faces, seed);
    let mesh = spm_builder::make_mesh_file(output, make)?;
    let text = format!(
        "{shape}: {} vertices, {} faces, seed {seed}, in {}",
        mesh.positions.len(),
        mesh.triangles.len(),
        output.display()
    );
    print_beside(output, &text)
}

fn inspect_file(
    file: &Path,
    size: f64,
    picture: Option<(&Path, inspect::Axis)>,
    json: bool,
) -> Result<(), Box<dyn Error>> {
    let failed = |path: &Path, error: std::io::Error| format!("{}: {error}", path.display());
    if let Some((path, _)) = picture {
        check_output(path, file, "png")?;
        spm_builder::try_output(path).map_err(|error| failed(path, error))?;
    }
    let found = inspect::inspect(file, size)?;
    if let Some((path, up)) = picture {
        let bytes = inspect::model_picture(file, up)?;
        let written = spm_builder::write_atomically(path, |out| out.write_all(&bytes));
        written.map_err(|error| failed(path, error))?;
    }
    if json {
        print(&serde_json::to_string(&found)?)
    } else {
        print(found.to_text().trim_end())
    }
}

fn export_file(
    file: &Path,
    output: &Path,
    format: Option<ExportFormat>,
    detail: Detail,
    json: bool,
) -> Result<(), Box<dyn Error>> {
    check_is_not_input(output, file)?;
    let done = export::export(file, output, format, detail)?;
    let text = if json {
        serde_json::to_string(&done)?
    } else {
        format!(
            "{} vertices, {} faces, {} splits: {} bytes in {}",
            done.vertices,
            done.faces,
            done.vsps,
            done.file_bytes,
            output.display()
        )
    };
    print_beside(output, &text)
}

fn serve_until_signal(options: ServeOptions) -> Result<(), Box<dyn Error>> {
    let stop = transport::signals::stop_flag()
        .map_err(|error| format!("the handler of Ctrl-C was refused ({error})"))?;
    // Dropped after the link.
    let _lines = transport::logging::queue();
    let listen = options.listen.as_deref();
    let _link = link::listen(&options.domain, listen, options.keys.as_deref())?;
    serve(&options.into(), &stop)?;
    Ok(())
}

fn format_named(name: &str) -> Result<ExportFormat, String> {
    ExportFormat::named(name).ok_or_else(|| "choose obj, ply, stl, off, cdpm or spmtxt".to_string())
}

/// Prints a line about an output; on standard error where that is standard output: behind it, it
/// would be part of it.
fn print_beside(output: &Path, text: &str) -> Result<(), Box<dyn Error>> {
    if spm_builder::standard_output(output).is_none() {
        return print(text);
    }
    // Nobody may be left to read it.
    let _ = writeln!(std::io::stderr(), "{text}");
    Ok(())
}

/// Prints a line; a reader that went away (`| head`) is no error.
fn print(text: &str) -> Result<(), Box<dyn Error>> {
    match writeln!(std::io::stdout(), "{text}") {
        Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        written => Ok(written?),
    }
}

/// The most memory that this process had at once.
fn peak_rss_bytes() -> u64 {
    // SAFETY: `getrusage` fills in the struct it is given; all zeros is a valid value of it.
    let usage = unsafe {
        let mut usage: libc::rusage = std::mem::zeroed();
        libc::getrusage(libc::RUSAGE_SELF, &mut usage);
        usage
    };
    u64::try_from(usage.ru_maxrss).unwrap_or(0) * 1024
}

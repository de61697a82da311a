//! `rt-tests codecs`: what records and closures cost on the way between two machines, by codec, and
//! what coding takes.
//!
//! Each model is touched along a tour in virtual time, with a cache that does not hold all of it,
//! and what the station sends goes through every codec and back, to the bit. Bytes are those of the
//! chunks of answers, in slots of 64 bytes as they travel, with their headers. Times are of a chunk
//! of answers, on this machine, beside whatever else it does.
//!
//! With `--json` one object ([`Codecs`]).

mod candidates;
mod trace;

use crate::clocks::Clocks;
use crate::failure::Failure;
use crate::models::source::typed_or;
use crate::report::output::print_either;
use crate::report::quantile::Quantiles;
use crate::report::table::Table;
use crate::scenes::check_seconds;
use crate::trajectory::scene_model::SceneModel;
use candidates::{Codec, all};
use clap::Args;
use protocol::{ChunkHeader, ChunkKind, ChunkSlot};
use serde::Serialize;
use trace::{Trace, touch};

/// What is touched when no model is named.
const DEFAULT_MODELS: [&str; 2] = ["relief:100000", "terrain:130000"];
/// The cache, bytes.
const CACHE_BYTES: usize = 4 << 20;
/// Speed of the tour, m/s.
const SPEED_M_PER_S: f64 = 0.1;

/// Arguments of `rt-tests codecs`.
#[derive(Debug, Args)]
pub struct CodecsArgs {
    /// Mesh or SPM files, or shapes as SHAPE:FACES [default: relief:100000 terrain:130000]
    #[arg(value_name = "MODEL")]
    pub models: Vec<String>,
    /// Seed of the tour over each model
    #[arg(long, value_name = "S", default_value_t = 1)]
    pub seed: u64,
    /// Length of the tour
    #[arg(
        long,
        value_name = "S",
        default_value_t = 10.0,
        allow_negative_numbers = true
    )]
    pub seconds: f64,
    /// Print one JSON object with the result on standard output
    #[arg(long)]
    pub json: bool,
}

/// What is printed as JSON.
#[derive(Debug, Serialize)]
pub struct Codecs {
    /// Seed of the tours.
    pub seed: u64,
    /// Length of each tour, seconds.
    pub seconds: f64,
    /// Bytes of the cache.
    pub cache_bytes: usize,
    /// Slots are this long, bytes.
    pub slot_bytes: usize,
    /// What was sent, one for each model.
    pub models: Vec<Sent>,
    /// One for each codec.
    pub codecs: Vec<Coded>,
}

/// What a station sent in a touch.
#[derive(Debug, Serialize)]
pub struct Sent {
    /// The model.
    pub model: String,
    /// VSPs in it.
    pub vsps: u32,
    /// Records received.
    pub vsps_received: u64,
    /// Chunks of answers.
    pub answers: u64,
    /// Chunks of all other kinds.
    pub others: u64,
}

/// A codec.
#[derive(Debug, Serialize)]
pub struct Coded {
    /// Its name.
    pub codec: &'static str,
    /// Bytes of answers in slots, headers too, a record received; one for each model, null where it
    /// received none.
    pub bytes_per_vsp: Vec<Option<f64>>,
    /// Their mean; null without any.
    pub mean_bytes_per_vsp: Option<f64>,
    /// Bytes of all other chunks in slots, headers too; one for each model.
    pub other_bytes: Vec<u64>,
    /// Time to code a chunk of answers, microseconds.
    pub encode_us: Quantiles,
    /// Time to decode it.
    pub decode_us: Quantiles,
}

/// Runs the command.
///
/// # Errors
/// One sentence, status 2 for bad input, 1 when a chunk comes back changed.
pub fn codecs(args: &CodecsArgs) -> Result<(), Failure> {
    check_seconds(args.seconds)?;
    let mut found = Codecs {
        seed: args.seed,
        seconds: args.seconds,
        cache_bytes: CACHE_BYTES,
        slot_bytes: size_of::<ChunkSlot>(),
        models: Vec::new(),
        codecs: Vec::new(),
    };
    let mut traces = Vec::new();
    for typed in typed_or(&args.models, &DEFAULT_MODELS) {
        let mut model = SceneModel::open(&typed)?;
        model.set_speed(SPEED_M_PER_S);
        eprintln!("a touch of {}", model.mesh.name);
        let trace = touch(&model, args.seed, args.seconds, CACHE_BYTES)?;
        let answers = trace.chunks.iter().filter(|of| is_answer(&of.header));
        let answers = answers.count() as u64;
        found.models.push(Sent {
            model: model.mesh.name.clone(),
            vsps: trace.sizes.vsps,
            vsps_received: trace.vsps,
            answers,
            others: trace.chunks.len() as u64 - answers,
        });
        traces.push(trace);
    }
    for k in 0..all().len() {
        found.codecs.push(code(k, &traces)?);
    }
    print_either(args.json, &table(&found), &found)
}

fn is_answer(header: &ChunkHeader) -> bool {
    header.kind == ChunkKind::Answers as u32
}

/// All traces through a codec, which begins anew with each.
fn code(codec: usize, traces: &[Trace]) -> Result<Coded, Failure> {
    let clocks = Clocks::new();
    let (mut bytes_per_vsp, mut other_bytes) = (Vec::new(), Vec::new());
    let (mut encode_us, mut decode_us) = (Vec::new(), Vec::new());
    let mut name = "";
    for trace in traces {
        let mut codec: Box<dyn Codec> = all().swap_remove(codec);
        name = codec.name();
        let changed = || Failure::Run(format!("{name}: a chunk comes back changed"));
        let (mut answers, mut others) = (0, 0);
        for chunk in &trace.chunks {
            let (encode_ns, bytes) = clocks.time(|| codec.encode(chunk, trace.sizes));
            let bytes = bytes.ok_or_else(changed)?;
            let (decode_ns, slots) = clocks.time(|| codec.decode(chunk, &bytes));
            if slots != Some(chunk.slots) {
                return Err(changed());
            }
            let slots = bytes.len().next_multiple_of(size_of::<ChunkSlot>());
            let length = (size_of::<ChunkHeader>() + slots) as u64;
            if is_answer(&chunk.header) {
                answers += length;
                encode_us.push(1e-3 * encode_ns);
                decode_us.push(1e-3 * decode_ns);
            } else {
                others += length;
            }
        }
        bytes_per_vsp.push((trace.vsps > 0).then(|| answers as f64 / trace.vsps as f64));
        other_bytes.push(others);
    }
    let seen: Vec<f64> = bytes_per_vsp.iter().copied().flatten().collect();
    let mean = seen.iter().sum::<f64>() / seen.len() as f64;
    Ok(Coded {
        codec: name,
        mean_bytes_per_vsp: (!seen.is_empty()).then_some(mean),
        bytes_per_vsp,
        other_bytes,
        encode_us: Quantiles::of(&mut encode_us),
        decode_us: Quantiles::of(&mut decode_us),
    })
}

/// What is said where nothing is compared with zstd.
const WITHOUT_ZSTD: &str = "Codecs with zstd are left out; with them: \
    cargo run --release -p rt-tests --features zstd -- codecs\n";

/// A row for each codec, a column for each model.
fn table(found: &Codecs) -> String {
    let mut words = String::from("bytes of records and closures a VSP received\n");
    let models = found.models.iter().map(|of| of.model.as_str());
    let heads: Vec<&str> = ["codec"]
        .into_iter()
        .chain(models)
        .chain(["mean"])
        .chain(["encode, us\nmedian", "99 %", "max"])
        .chain(["decode, us\nmedian", "99 %", "max"])
        .collect();
    let mut table = Table::new(1, &heads.join(" | "));
    for of in &found.codecs {
        let bytes = of.bytes_per_vsp.iter().chain([&of.mean_bytes_per_vsp]);
        let bytes = bytes.map(|of| of.map_or("none".to_string(), |bytes| format!("{bytes:.1}")));
        let times = [of.encode_us, of.decode_us];
        let times = times.iter().flat_map(|us| [us.p50, us.p99, us.max]);
        let times = times.map(|us| format!("{us:.0}"));
        let name = [of.codec.to_string()];
        table.row(name.into_iter().chain(bytes).chain(times));
    }
    words += &table.to_string();
    for of in &found.models {
        words += &format!(
            "{}: {} records in {} chunks of answers, {} other chunks; the model has {} VSPs\n",
            of.model, of.vsps_received, of.answers, of.others, of.vsps
        );
    }
    if cfg!(not(feature = "zstd")) {
        words += WITHOUT_ZSTD;
    }
    words
}

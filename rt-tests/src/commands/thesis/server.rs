//! What a subscription costs the station (5.8).

use super::result::{Figure, Quote, Series};
use super::{Study, StudyModel};
use crate::clocks::Clocks;
use crate::failure::Failure;
use crate::models::Model;
use crate::report::chart::{Axis, Chart, Curve, Stroke, Unit, xs, ys};
use crate::report::quantile::{median, range};
use crate::report::units::digits;
use protocol::AnswersWriter;
use station_core::collection::{RegionAt, closure};

/// Regions that are asked for on each model, spread evenly.
const REGIONS: usize = 256;
/// Times that each is collected: the least counts.
const REPEATS: usize = 3;

/// Times that a region is written in one measurement: once is hardly longer than a look at the
/// clock.
const WRITES: u32 = 16;

/// A subscription of a region.
struct Subscription {
    /// Records of its closure.
    records: f64,
    /// Time to collect it, µs.
    collect_us: f64,
    /// Time to write all of it into chunks, µs.
    write_us: f64,
}

fn subscribe(of: &StudyModel) -> Result<Vec<Subscription>, Failure> {
    let model = &of.model;
    let clocks = Clocks::new();
    let regions = model.file.regions();
    let step = regions.len().div_ceil(REGIONS).max(1);
    let mut rows = Vec::new();
    for region in regions.iter().step_by(step) {
        let asked = RegionAt::full(*region);
        let (mut collect, mut write) = (f64::INFINITY, f64::INFINITY);
        let mut records = 0;
        for _ in 0..REPEATS {
            let (ns, found) = clocks.time(|| closure(&model.file, asked));
            let found = found.map_err(|error| Failure::Run(format!("{}: {error}", of.name)))?;
            collect = collect.min(ns);
            records = found.len();
            let write_all = || (0..WRITES).all(|_| chunks(model, asked, &found).is_some());
            let (ns, is_written) = clocks.time(write_all);
            if !is_written {
                return Err(Failure::Run(format!(
                    "{}: {asked} does not fit its chunks",
                    of.name
                )));
            }
            write = write.min(ns / f64::from(WRITES));
        }
        if records > 0 {
            rows.push(Subscription {
                records: records as f64,
                collect_us: collect * 1e-3,
                write_us: write * 1e-3,
            });
        }
    }
    Ok(rows)
}

/// Writes a closure with every record into chunks; their bytes, `None` when a part does not fit.
fn chunks(model: &Model, asked: RegionAt, ids: &[u32]) -> Option<u64> {
    let (mut bytes, mut left) = (0, ids);
    while !left.is_empty() {
        let mut writer = AnswersWriter::new();
        let is_first = left.len() == ids.len();
        writer.begin(asked.region.0, asked.tolerance_bits, is_first);
        let fitting = (writer.room() - PADDING) / (RECORD_BYTES + MAX_ID_BYTES);
        let (now, later) = left.split_at(fitting.min(left.len()));
        let is_written = now.iter().all(|&id| writer.id(id, true))
            && now
                .iter()
                .all(|&id| writer.record(&model.records[id as usize]));
        writer.end(later.is_empty());
        bytes += u64::from(writer.finish().0);
        left = later;
        if !is_written {
            return None;
        }
    }
    Some(bytes)
}

/// Bytes of a record, of its id at the most, and between ids and records.
const RECORD_BYTES: usize = size_of::<spm::VspRecord>();
const MAX_ID_BYTES: usize = 5;
const PADDING: usize = 3;

/// The server's load of a subscription.
///
/// # Errors
/// When a region cannot be collected.
pub fn load(study: &Study) -> Result<Figure, Failure> {
    let mut series = Vec::new();
    let (mut collecting, mut writing) = (Vec::new(), Vec::new());
    let (mut shares, mut slopes) = (Vec::new(), Vec::new());
    for of in &study.models {
        study.says(of, "load of the station");
        let rows = subscribe(of)?;
        let over =
            |time: fn(&Subscription) -> f64| median(&rows.iter().map(time).collect::<Vec<_>>());
        let collect = over(|row| row.collect_us);
        let write = over(|row| row.write_us);
        let a_record = over(|row| 1e3 * (row.collect_us + row.write_us) / row.records);
        shares.push(collect / (collect + write));
        slopes.push(a_record);
        let name = |what: &str| format!("{}: {what}", of.name);
        series.push(Series::new(
            name("records of a region, median"),
            "VSPs",
            over(|row| row.records),
        ));
        series.push(Series::new(
            name("collecting a region, median"),
            "µs",
            collect,
        ));
        series.push(Series::new(name("writing its chunks, median"), "µs", write));
        series.push(Series::new(name("both, a record"), "ns", a_record));
        let mut points: Vec<(f64, f64)> = rows
            .iter()
            .map(|row| (row.records, row.collect_us))
            .collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        collecting.push(Curve::new(&of.name, of.color, Stroke::Dots, points));
        let points = rows.iter().map(|row| (row.records, row.write_us));
        writing.push(Curve::new(&of.name, of.color, Stroke::Dots, points));
    }
    let chart = |title: &str, curves: Vec<Curve>| {
        let x = Axis::over("records of the region", Unit::Number, xs(&curves));
        let y = Axis::over("µs", Unit::Time, ys(&curves));
        Chart::new(title, x, y, curves)
    };
    let [least_ns, most_ns] = range(slopes);
    let [least_share, most_share] = range(shares);
    Ok(Figure {
        figure: "5.8",
        title: "Load of the station for a subscription",
        says: format!(
            "Collecting and writing a region takes {} to {} ns a record at the median of a model, and {} to {} % of it \
             is the collecting: both grow in proportion to the records, as the thesis says. Its first cost, a walk \
             through the whole sequence, is not there: the file's index names the first splits of a region, and the \
             rest follows from their ids. The thesis publishes no times.",
            digits(least_ns),
            digits(most_ns),
            digits(100.0 * least_share),
            digits(100.0 * most_share)
        ),
        series,
        quotes: vec![
            quote(
                3929,
                "Traversing the list of VSP has a cost which is linearly proportional to the size of VSP sequence of \
                 the model",
            ),
            quote(
                3932,
                "Selectively collecting some records whose cost is proportional to the number of regions to be refined \
                 and the volume of primitives inside the regions",
            ),
            quote(
                3935,
                "Reformatting and sending those records for transmission, the cost of which is proportional to the \
                 number of VSP records collected",
            ),
        ],
        charts: vec![
            chart("Collecting a region", collecting),
            chart("Writing its chunks", writing),
        ],
        names: study.names(),
    })
}

fn quote(line: u32, text: &'static str) -> Quote {
    Quote {
        section: "5.8",
        line,
        text,
    }
}

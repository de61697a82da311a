//! A probe against the coarse, the locally refined and the full mesh (Figure 5.20), and a level of
//! detail as part of a CDPM against the same as a static mesh (4.3.2).

use super::Study;
use super::pairs::{ask, copy_of, touching};
use super::result::{Figure, Quote, Series};
use crate::commands::compare::full_front::FullFront;
use crate::commands::compare::levels::{Level, PROBE, Probe, levels};
use crate::failure::Failure;
use crate::models::Model;
use crate::models::surface::Surface as Full;
use crate::report::chart::{Axis, COLORS, Chart, Curve, GREY, Stroke, Unit, xs, ys};
use crate::report::quantile::range;
use crate::report::units::digits;
use glam::DVec3;
use spm_builder::{BuildOptions, NoProgress, SoupMesh};
use std::collections::BTreeMap;

/// Shares of the splits at which a CDPM is compared with a static mesh.
const SHARES: [f64; 4] = [0.03, 0.1, 0.3, 1.0];

/// A probe that reaches beyond what is refined around its touch.
const LARGE: Probe = Probe {
    radius: 16.0,
    length: 80.0,
    depth: 4.0,
    ..PROBE
};

/// The smallest and the largest of some ratios, in words.
fn span(of: &[f64]) -> String {
    let [low, high] = range(of.iter().copied());
    format!("{} to {}", digits(low), digits(high))
}

/// Figure 5.20.
///
/// # Errors
/// When a region cannot be loaded.
pub fn figure_5_20(study: &Study) -> Result<Figure, Failure> {
    let mut series = Vec::new();
    let (mut coarse, mut full, mut large) = (Vec::new(), Vec::new(), Vec::new());
    let mut curves: Vec<Curve> = FRONTS
        .into_iter()
        .map(|(front, color)| Curve::new(front, color, Stroke::Solid, []))
        .collect();
    for of in &study.models {
        study.says(of, "queries of a probe on three fronts");
        let surface = Full::new(of.model.full_triangles());
        let front = FullFront::new(&of.model)?;
        let measured = |probe| -> Result<[Level; 3], Failure> {
            let rows = levels(&of.model, &surface, &front, probe, &mut study.random())?;
            three(&rows).ok_or_else(|| Failure::Run(format!("{}: a front is missing", of.name)))
        };
        let [low, local, high] = &measured(PROBE)?;
        let [_, large_local, large_full] = measured(LARGE)?;
        for (curve, row) in curves.iter_mut().zip([low, local, high]) {
            let at = (f64::from(row.faces), row.p50_ns * 1e-3, String::new());
            curve.points.push(at);
        }
        let less = 1.0 - low.p50_ns / local.p50_ns;
        let more = high.p50_ns / local.p50_ns;
        coarse.push(100.0 * less);
        full.push(more);
        let name = |what: &str| format!("{}: {what}", of.name);
        for row in [low, local, high] {
            let what = format!("query on the {} mesh, median", row.front);
            series.push(Series::new(name(&what), "µs", row.p50_ns * 1e-3));
        }
        series.push(
            Series::new(name("coarse less than local"), "%", 100.0 * less).beside(&[0.09, 37.0]),
        );
        series.push(Series::new(name("full over local"), "", more).beside(&[1.2, 2.5]));
        series.push(Series::new(
            name("pairs of nodes, full over local"),
            "",
            nodes(high) / nodes(local),
        ));
        let beyond = large_full.p50_ns / large_local.p50_ns;
        large.push(beyond);
        let what = name("full over local, probe of four times the size");
        series.push(Series::new(what, "", beyond).beside(&[1.2, 2.5]));
    }
    sort(&mut curves);
    let x = Axis::over("faces of the full mesh", Unit::Number, xs(&curves));
    let y = Axis::linear("query, median, µs", ys(&curves)).with_room();
    let names = FRONTS.map(|(front, color)| (front.to_string(), color, Stroke::Solid));
    Ok(Figure {
        figure: "5.20",
        title: "Query of a cylinder probe on the coarse, the locally refined and the full mesh",
        says: format!(
            "The query on the coarse mesh takes {} % less than on the locally refined one (thesis: 0.09 % to 37 %), \
             and on the full mesh {} times as long (thesis: 1.2 to 2.5). Our probe's end lies within what is refined \
             and meets the same faces on both, so only the search differs, and that grows with the logarithm; the \
             full mesh is faster where it lies in memory in the order of the tree. A probe of four times the size \
             reaches beyond what is refined, meets coarse faces there, and takes {} times as long on the full mesh: \
             the thesis does not give the size of its probe, and a larger one comes nearer to its ratio.",
            span(&coarse),
            span(&full),
            span(&large)
        ),
        series,
        quotes: vec![
            quote(
                "5.8",
                3973,
                "the time for collision queries in a coarse mesh is 0.09% to 37% less than the time cost in a locally \
                 high resolution mesh",
            ),
            quote(
                "5.8",
                3975,
                "Whereas, the cost for the finest resolution mesh is 1.2 to 2.5 times more than the cost for refined \
                 meshes.",
            ),
        ],
        charts: vec![Chart::new("A probe that touches", x, y, curves)],
        names: names.to_vec(),
    })
}

/// The fronts of Figure 5.20 and their colours.
const FRONTS: [(&str, &str); 3] = [("coarse", GREY), ("local", COLORS[0]), ("full", COLORS[2])];

/// The fronts of the figure, of all that were measured.
fn three(rows: &[Level]) -> Option<[Level; 3]> {
    let of_front = |name: &str| rows.iter().find(|row| row.front == name).cloned();
    let [low, local, high] = FRONTS.map(|(name, _)| of_front(name));
    Some([low?, local?, high?])
}

fn nodes(row: &Level) -> f64 {
    row.node_pairs.max(1.0)
}

fn sort(curves: &mut [Curve]) {
    for curve in curves {
        curve.points.sort_by(|a, b| a.0.total_cmp(&b.0));
    }
}

fn quote(section: &'static str, line: u32, text: &'static str) -> Quote {
    Quote {
        section,
        line,
        text,
    }
}

/// Static levels of detail against a CDPM at the same resolution.
///
/// # Errors
/// When a level cannot be built, or the two do not find as many pairs.
pub fn static_against_cdpm(study: &Study) -> Result<Figure, Failure> {
    let (mut series, mut curves) = (Vec::new(), Vec::new());
    let (mut ratios, mut savings) = (Vec::new(), Vec::new());
    for of in &study.models {
        study.says(of, "static levels of detail against the CDPM");
        let full = FullFront::new(&of.model)?;
        let poses = touching(&of.model, &full, &mut study.random())?;
        let mut times = Vec::new();
        for share in SHARES {
            let splits = (share * of.model.records.len() as f64) as usize;
            let cdpm = FullFront::prefix(&of.model, splits)?;
            let alone = static_level(&of.model, &cdpm)?;
            let alone = FullFront::new(&alone)?;
            let mut copy = copy_of(&of.model, alone.surface())?;
            let both = ask(&[cdpm.surface(), alone.surface()], &mut copy, &poses);
            if both[0].pairs != both[1].pairs {
                return Err(Failure::Run(format!(
                    "{}: {} pairs on the CDPM and {} on the static mesh",
                    of.name, both[0].pairs, both[1].pairs
                )));
            }
            let ratio = both[0].sum_ns / both[1].sum_ns;
            ratios.push(ratio);
            times.push((share, both[0].sum_ns * 1e-3 / poses.len() as f64));
            let name = format!(
                "{}: CDPM over static at {} faces",
                of.name,
                cdpm.mesh().active_faces()
            );
            series.push(Series::new(name, "", ratio).beside(&[1.0]));
        }
        let (first, last) = (times[0].1, times[times.len() - 1].1);
        savings.push(last / first);
        let name = format!("{}: CDPM, query of all splits over that of 3 %", of.name);
        series.push(Series::new(name, "", last / first));
        curves.push(Curve::new(&of.name, of.color, Stroke::Solid, times));
    }
    let x = Axis::over("share of the splits", Unit::Number, xs(&curves));
    let y = Axis::over("query of two objects, mean, µs", Unit::Time, ys(&curves));
    Ok(Figure {
        figure: "4.3.2",
        title: "Static levels of detail and the CDPM at the same resolution",
        says: format!(
            "At the same faces the query on the CDPM takes {} times that on a static mesh with a tree of its own; the \
             same pairs are found. The thesis observes no loss. What loss there is comes from the fixed shape of the \
             AB-tree, which is balanced over the full mesh and not over this level, and from faces that lie in the \
             order of their splits. From 3 % of the splits to all of them the query grows by a factor of {}: that is \
             what a coarser level saves.",
            span(&ratios),
            span(&savings)
        ),
        series,
        quotes: vec![quote(
            "4.3.2",
            2555,
            "We do not observe a performance loss on the CDPMs, which require a complex data structure in comparison \
             with a simple data structure used by the static LOD.",
        )],
        charts: vec![Chart::new("The CDPM from coarse to full", x, y, curves)],
        names: study.names(),
    })
}

/// The faces of a front as a model of their own that is never refined, with a tree built for it.
fn static_level(model: &Model, front: &FullFront) -> Result<Model, Failure> {
    let origin = DVec3::from_array(model.file.model_header().origin);
    let mut mesh = SoupMesh::default();
    let mut places = BTreeMap::new();
    front.mesh().for_each_active_face(|face| {
        let corners = front.mesh().face(face).corners.map(|vertex| {
            *places.entry(vertex).or_insert_with(|| {
                let position = front.mesh().position(vertex).as_dvec3() + origin;
                mesh.positions.push(position.to_array());
                mesh.positions.len() as u32 - 1
            })
        });
        mesh.triangles.push(corners);
    });
    let all = BuildOptions {
        base_faces: Some(u32::MAX),
        ..BuildOptions::default()
    };
    Model::build(model.name.clone(), mesh, &all, &NoProgress)
        .map_err(|error| Failure::Run(format!("{}: a static level: {error}", model.name)))
}

//! The loaded and the refined front in a touch, at three sizes of the cache (what Figure 5.16
//! draws).

use super::Study;
use super::result::{Figure, Quote, Series};
use crate::failure::Failure;
use crate::report::chart::{Axis, COLORS, Chart, Curve, Stroke, xs, ys};
use crate::report::quantile::median;
use crate::report::units::{bytes, digits};
use crate::trajectory::scene_model::SceneModel;
use crate::trajectory::touch::touch;

/// Length of the tour, seconds of simulated time.
const SECONDS: f64 = 20.0;
/// Ticks from one point of the curves to the next.
const EVERY: u64 = 50;
/// Share of the records that a small cache has room for beside the base mesh.
const SMALL: f64 = 0.06;
/// Bytes of the cache for a loaded record, all told: what the design allows for one.
const BYTES_A_RECORD: f64 = 400.0;

/// What a touch with one cache gave.
struct Touch {
    cache_bytes: usize,
    /// Seconds, loaded and refined VSPs.
    points: Vec<[f64; 3]>,
    received: u64,
    evicted: u64,
    /// Ticks in which regions were asked for, and those of the tour.
    asking_ticks: u64,
    ticks: u64,
}

impl Touch {
    fn median(&self, of: usize) -> f64 {
        median(
            &self
                .points
                .iter()
                .map(|point| point[of])
                .collect::<Vec<_>>(),
        )
    }
}

fn measure(model: &SceneModel, seed: u64, cache_bytes: usize) -> Result<Touch, Failure> {
    let mut plan = model.plan.clone();
    plan.cache_bytes = cache_bytes;
    let mut simulation = model.simulation(&plan)?;
    let mut found = Touch {
        cache_bytes,
        points: Vec::new(),
        received: 0,
        evicted: 0,
        asking_ticks: 0,
        ticks: 0,
    };
    let period_s = 1.0 / plan.loop_.rate_hz;
    let mut asked = 0;
    touch(model, &mut simulation, seed, SECONDS, &mut |simulation| {
        let record = simulation.outputs().record;
        let cache = simulation.controller().cache();
        found.ticks += 1;
        found.asking_ticks += u64::from(record.regions_subscribed > asked);
        asked = record.regions_subscribed;
        if found.ticks.is_multiple_of(EVERY) {
            let fronts = [cache.loaded(), cache.mesh().performed()].map(f64::from);
            found
                .points
                .push([found.ticks as f64 * period_s, fronts[0], fronts[1]]);
        }
    })?;
    let record = simulation.outputs().record;
    (found.received, found.evicted) = (record.vsps_received, record.evicted);
    Ok(found)
}

/// What Figure 5.16 draws, as a measurement on the largest model.
///
/// # Errors
/// When the model cannot be touched.
pub fn figure_5_16(study: &Study) -> Result<Figure, Failure> {
    let largest = study.models.iter().max_by_key(|of| of.faces());
    let of = largest.ok_or_else(|| Failure::Input("no model is given".to_string()))?;
    study.says(of, "the two fronts at three sizes of the cache");
    let model = SceneModel::open(&of.typed)?;
    let vsps = f64::from(model.mesh.file.model_header().vsps);
    let small = (SMALL * vsps * BYTES_A_RECORD) as usize + (1 << 18);
    let sizes = [small, model.plan.cache_bytes, model.cache_for_all()];
    let touches = sizes
        .into_iter()
        .map(|bytes| measure(&model, study.seed, bytes))
        .collect::<Result<Vec<_>, _>>()?;
    let (mut series, mut charts) = (Vec::new(), Vec::new());
    for touch in &touches {
        let cache = bytes(touch.cache_bytes as u64);
        let name = |what: &str| format!("{}, cache of {cache}: {what}", of.name);
        let (loaded, refined) = (touch.median(1), touch.median(2));
        series.push(Series::new(name("loaded front, median"), "VSPs", loaded));
        series.push(Series::new(name("refined front, median"), "VSPs", refined));
        series.push(Series::new(
            name("refined over loaded"),
            "",
            refined / loaded,
        ));
        let again = touch.evicted as f64 / touch.received.max(1) as f64;
        series.push(Series::new(
            name("records evicted, of those received"),
            "",
            again,
        ));
        let seconds = SECONDS / touch.asking_ticks.max(1) as f64;
        series.push(Series::new(
            name("from one question to the next, mean"),
            "s",
            seconds,
        ));
        charts.push(chart(touch, &cache));
    }
    Ok(Figure {
        figure: "5.16",
        title: "The loaded front and the refined front",
        series,
        says: says(&touches),
        quotes: quotes(),
        charts,
        names: vec![
            ("loaded front".to_string(), COLORS[1], Stroke::Line),
            ("refined front".to_string(), COLORS[0], Stroke::Line),
        ],
    })
}

fn chart(touch: &Touch, cache: &str) -> Chart {
    let curve = |name: &str, color, k: usize| {
        let points = touch.points.iter().map(|point| (point[0], point[k]));
        Curve::new(name, color, Stroke::Line, points)
    };
    let curves = vec![
        curve("refined front", COLORS[0], 2),
        curve("loaded front", COLORS[1], 1),
    ];
    let x = Axis::linear("time, s", xs(&curves));
    let y = Axis::linear("VSPs", ys(&curves)).with_room();
    Chart::new(&format!("cache of {cache}"), x, y, curves)
}

fn says(touches: &[Touch]) -> String {
    let share = |touch: &Touch| digits(touch.median(2) / touch.median(1));
    let [small, product, whole] = touches else {
        return String::new();
    };
    format!(
        "Before the first region is asked for both fronts are the base mesh, as in Figure 5.16 a. With a small cache \
         the refined front is {} of the loaded one at the median, and {} records were evicted (b: the thesis lets \
         the two overlap where no space is free; ours keeps some of what lies ahead even then). With the product's \
         cache it is {}, and with room for the whole mesh {} (c): what was loaded stays, so the space between the \
         two grows, and nothing is evicted or asked for twice ({} evicted; d). The thesis reloads mesh once in a few \
         seconds; we ask for cells ahead of the hand every {} s.",
        share(small),
        small.evicted,
        share(product),
        share(whole),
        whole.evicted,
        digits(SECONDS / product.asking_ticks.max(1) as f64)
    )
}

fn quotes() -> Vec<Quote> {
    let quote = |section, line, text| Quote {
        section,
        line,
        text,
    };
    vec![
        quote(
            "5.7.2",
            3875,
            "In preprocessing phase, the two boundaries are overlapped (Figure 5.16a). In the runtime phase, the two \
             boundaries continue to overlap when free cache space is not available (Figure 5.16b). The space between \
             the two boundaries increases when more cache space is available or collisions regions on the meshes are \
             shifted (Figure 5.16c).",
        ),
        quote(
            "5.8",
            3980,
            "Mesh reloading takes place once in a few seconds.",
        ),
    ]
}

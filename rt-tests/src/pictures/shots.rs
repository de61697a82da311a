//! A still picture of a recording, and a film.

use super::legend::force_scale;
use super::moment::{Body, Moment};
use super::playback::Playback;
use super::sight::upwards;
use super::touch_picture::{TouchPicture, Views};
use super::trail::{TRAIL_S, Trails};
use crate::failure::Failure;
use picture::Canvas;
use std::ops::ControlFlow;

/// A film shows this much before and after its moment, seconds, with so many pictures a second.
const BEFORE_S: f64 = 2.0;
const AFTER_S: f64 = 1.0;
const RATE: f64 = 10.0;
/// Time between two pictures of a film, milliseconds.
pub const FRAME_MS: u16 = (1000.0 / RATE) as u16;
/// Share of the way to the probe and to its normal that a film's view goes in a picture.
const TURN: f64 = 0.35;

/// A run to be shown.
#[derive(Debug)]
pub struct Shots<'a> {
    playback: &'a Playback,
}

impl<'a> Shots<'a> {
    /// Shots of a recording.
    #[must_use]
    pub fn new(playback: &'a Playback) -> Self {
        Self { playback }
    }

    /// The picture of a tick, and the tick that it shows: the next one where the run skipped it.
    ///
    /// # Errors
    /// When the recording does not replay up to there.
    pub fn still(&self, tick: u64) -> Result<(u64, Canvas), Failure> {
        let mut canvas = None;
        let shown = self.shoot(tick, tick, |picture| {
            canvas = Some(picture.draw(&picture.views()));
        })?;
        shown.zip(canvas).ok_or_else(|| self.missing(tick))
    }

    /// Pictures of the time around a tick, in its order, seen by a camera that goes with the probe;
    /// and the tick, as of [`Shots::still`].
    ///
    /// # Errors
    /// As those of [`Shots::still`].
    pub fn film(
        &self,
        tick: u64,
        mut done: impl FnMut(usize),
    ) -> Result<(u64, Vec<Canvas>), Failure> {
        let plan = &self.playback.plan;
        let [first, last] = self.playback.ticks;
        let ticks = |seconds: f64| (seconds * plan.loop_.rate_hz).round() as u64;
        let from = tick.saturating_sub(ticks(BEFORE_S)).max(first);
        let until = (tick + ticks(AFTER_S)).min(last);
        // The first view is that of the moment, so that the film shows it as the still does.
        let mut views = None;
        let shown = self.shoot(tick, tick, |picture| views = Some(picture.views()))?;
        let shown = shown.zip(views).ok_or_else(|| self.missing(tick));
        let (shown, mut views) = shown?;
        let mut pictures = Vec::new();
        self.shoot(from, until, |picture| {
            follow(&mut views, picture.moment, pictures.is_empty());
            pictures.push(picture.draw(&views));
            done(pictures.len());
        })?;
        Ok((shown, pictures))
    }

    /// The picture of the greatest force in contact, else of the end, as a PNG file.
    ///
    /// # Errors
    /// As those of [`Shots::still`].
    pub fn strongest_png(&self) -> Result<Vec<u8>, Failure> {
        let (_, picture) = self.still(self.playback.shown_tick())?;
        let png = picture.to_png();
        png.map_err(|error| Failure::Run(error.to_string()))
    }

    fn missing(&self, tick: u64) -> Failure {
        Failure::Input(format!(
            "the controller at {:.3} s cannot be had from the recording: inputs up to it are missing",
            self.playback.seconds(tick)
        ))
    }

    /// Shows the ticks from one to another, as many a second as a film has; the first one shown.
    fn shoot(
        &self,
        from: u64,
        until: u64,
        mut show: impl FnMut(&TouchPicture<'_>),
    ) -> Result<Option<u64>, Failure> {
        let plan = &self.playback.plan;
        let rate_hz = plan.loop_.rate_hz;
        let bodies: Vec<Body> = plan.probes.iter().map(|of| Body::new(&of.shape)).collect();
        let mut trails = Trails::new(plan.probes.len(), rate_hz);
        let step = (rate_hz / RATE).round().max(1.0) as u64;
        let begin = from.saturating_sub((TRAIL_S * rate_hz) as u64);
        let mut next = from;
        let mut shown = None;
        self.playback.play(begin, |record, twin| {
            // A tick stands for those that were skipped before it, not for those that are missing.
            let stands_from = record.tick.saturating_sub(u64::from(record.skipped));
            if stands_from > until || (record.tick > until && shown.is_some()) {
                return ControlFlow::Break(());
            }
            trails.take(record, twin);
            if record.tick >= next {
                next = record.tick + step;
                shown.get_or_insert(record.tick);
                show(&TouchPicture {
                    plan,
                    moment: &Moment::new(plan, record, twin),
                    bodies: &bodies,
                    paths: &trails.paths(),
                    scale: force_scale(self.playback.force_max_n),
                });
            }
            if record.tick >= until {
                return ControlFlow::Break(());
            }
            ControlFlow::Continue(())
        })?;
        Ok(shown)
    }
}

/// Moves the close-ups with their probes; the first picture begins where they are.
fn follow(views: &mut Views, moment: &Moment, is_first: bool) {
    let strongest = views.close_ups.iter().map(|of| of.0).next();
    let share = if is_first { 1.0 } else { TURN };
    if let Some(k) = strongest
        && moment.probes[k].touch.is_some()
    {
        let up = views.sight.up.lerp(upwards(&moment.probes[k]), share);
        views.sight = views.sight.turned_to(up.normalize_or(views.sight.up));
    }
    for (k, camera) in &mut views.close_ups {
        if let Some(at) = moment.probes[*k].position() {
            let half_width = camera.half_width();
            let goal = views.sight.close_up(at, half_width);
            let target = camera.target().lerp(goal.target(), share);
            *camera = views.sight.look_at(target, half_width);
        }
    }
}

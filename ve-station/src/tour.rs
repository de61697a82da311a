//! Tours: scripted paths that touch any mesh (approach, press, slide, lift, move on), from a seed.
//!
//! A ball rolls over the mesh: its centre is moved along the surface, the closest point of the full mesh is
//! the contact, and the line from there to the centre is the outward normal. So neither winding nor closed
//! surfaces are needed, thin parts keep their sides, and what the ball cannot enter is not visited. It turns
//! at rims (the normal turns over within the ball's own length), dead ends, and where the contact jumps to
//! another sheet. The intent lies `depth` below where a probe of the asked radius would touch.
//!
//! Everything is in model units relative to the file's origin; only [`TourPoint`]s carry the origin.
//! The path is made touch by touch, so that its length costs no memory.

mod path;
mod roll;

use glam::{DQuat, DVec3};
use path::{Leg, Resampler};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{RngCore, SeedableRng};
use roll::{Ball, Contact};
use shared::protocol::{Refusal, TourAsk, TourPoint};
use shared::spm::{FileError, SpmFile};
use thiserror::Error;

/// Seconds between two points.
const PERIOD: f64 = 0.005;
/// The longest tour, seconds.
const LONGEST: f64 = 86_400.0;
/// Height above the surface for moves between touches, as a share of the longest side.
const HOVER: f64 = 0.12;
/// The ball's radius at least, as a share of the longest side.
const LEAST_BALL: f64 = 0.004;
/// Touches given up for damage of the file before the tour is refused.
const MOST_DAMAGED: u32 = 1024;
/// Places looked at for the next touch before one far away is taken.
const NEAR_TRIES: usize = 24;
/// Faces drawn for the first touch, of which one is kept in proportion to its area.
const AREA_DRAWS: usize = 64;
/// The highest speed, longest sides a second: beyond it a period passes whole touches.
const FASTEST: f64 = 20.0;

/// Why there is no tour.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum TourError {
    /// A number of the ask is out of range.
    #[error(
        "seconds must lie in 0 to 86400, the speed be positive and at most 20 model lengths a second, depth and radius not negative and no larger than the model"
    )]
    Numbers,
    /// The file is damaged where the tour goes.
    #[error("{0}")]
    File(#[from] FileError),
}

impl TourError {
    /// What the client is told.
    #[must_use]
    pub fn refusal(&self) -> Refusal {
        match self {
            Self::Numbers => Refusal::Tour,
            Self::File(_) => Refusal::DamagedBlock,
        }
    }
}

/// All points of a tour.
///
/// # Errors
/// When a number of the ask is out of range, or the file is damaged where the tour goes.
pub fn make_tour<D: AsRef<[u8]>>(
    file: &SpmFile<D>,
    ask: TourAsk,
) -> Result<Vec<TourPoint>, TourError> {
    let mut tour = Tour::new(file, ask)?;
    let mut points = Vec::new();
    while let Some(point) = tour.next_point(file)? {
        points.push(point);
    }
    Ok(points)
}

/// A tour in the making.
#[derive(Debug)]
pub struct Tour {
    ask: TourAsk,
    draw: Draw,
    /// Middle of the model's box.
    centre: DVec3,
    /// Longest side of the box.
    size: f64,
    /// Radius around the middle outside of which there is nothing.
    outside: f64,
    ball: Ball,
    resampler: Resampler,
    /// Where the path ends, once it has begun: the last contact and the way up from it.
    last: Option<(Contact, DVec3)>,
    /// Points given.
    given: u64,
    /// Points to give.
    total: u64,
    before: DVec3,
}

/// Random numbers; the stream is part of a replay.
#[derive(Debug)]
struct Draw(Xoshiro256PlusPlus);

impl Draw {
    /// Uniform in 0..1.
    fn unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 * (-53f64).exp2()
    }

    /// Uniform in low..high.
    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Uniform on the unit sphere.
    fn direction(&mut self) -> DVec3 {
        let z = self.between(-1.0, 1.0);
        let angle = self.between(0.0, std::f64::consts::TAU);
        let r = (1.0 - z * z).max(0.0).sqrt();
        DVec3::new(r * angle.cos(), r * angle.sin(), z)
    }

    /// Uniform below a count, which is not 0.
    fn below(&mut self, count: u32) -> u32 {
        ((self.unit() * f64::from(count)) as u32).min(count - 1)
    }
}

impl Tour {
    /// Checks the ask. Nothing of the path is made yet.
    ///
    /// # Errors
    /// When a number of the ask is out of range.
    pub fn new<D: AsRef<[u8]>>(file: &SpmFile<D>, ask: TourAsk) -> Result<Self, TourError> {
        let header = file.model_header();
        let (lower, upper) = (
            DVec3::from_array(header.lower),
            DVec3::from_array(header.upper),
        );
        let size = (upper - lower).max_element();
        let TourAsk {
            seconds,
            speed,
            depth,
            radius,
            ..
        } = ask;
        let good = seconds > 0.0
            && seconds <= LONGEST
            && speed.is_normal()
            && speed > 0.0
            && speed <= FASTEST * size
            && (0.0..=size).contains(&depth)
            && (0.0..=size).contains(&radius);
        if !good {
            return Err(TourError::Numbers);
        }
        let rolling = radius.max(LEAST_BALL * size);
        let diagonal = (upper - lower).length();
        Ok(Self {
            ask,
            draw: Draw(Xoshiro256PlusPlus::seed_from_u64(ask.seed)),
            centre: (lower + upper) * 0.5,
            size,
            outside: 0.51 * diagonal + 2.0 * rolling,
            ball: Ball {
                radius: rolling,
                step: (speed * PERIOD).min(0.5 * rolling),
                lower,
                upper,
            },
            resampler: Resampler::new(speed * PERIOD),
            last: None,
            given: 0,
            total: (seconds / PERIOD).ceil() as u64 + 1,
            before: DVec3::ZERO,
        })
    }

    /// Whether every point was given.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.given == self.total
    }

    /// The next point, `None` after the last.
    ///
    /// # Errors
    /// When the file is damaged where the tour goes.
    pub fn next_point<D: AsRef<[u8]>>(
        &mut self,
        file: &SpmFile<D>,
    ) -> Result<Option<TourPoint>, FileError> {
        Ok(self.next(file)?.map(|(point, _)| point))
    }

    /// The next point and what it belongs to.
    fn next<D: AsRef<[u8]>>(
        &mut self,
        file: &SpmFile<D>,
    ) -> Result<Option<(TourPoint, Leg)>, FileError> {
        if self.is_over() {
            return Ok(None);
        }
        let mut damaged = 0;
        let sample = loop {
            match self.resampler.next() {
                Some(sample) => break sample,
                // Where the file is damaged there is no touch; elsewhere there is.
                None => match self.add_touch(file) {
                    Err(_) if damaged < MOST_DAMAGED => damaged += 1,
                    added => added?,
                },
            }
        };
        let full = self.given as f64 * PERIOD;
        let t = full.min(self.ask.seconds);
        // The last period may be cut short: so is its way.
        let share = (1.0 - (full - t) / PERIOD).clamp(0.0, 1.0);
        let position = if self.given == 0 {
            sample.position
        } else {
            self.before.lerp(sample.position, share)
        };
        self.before = sample.position;
        self.given += 1;
        let origin = DVec3::from_array(file.model_header().origin);
        let turn = DQuat::from_rotation_arc(DVec3::Z, sample.axis);
        let point = TourPoint {
            t,
            position: (position + origin).to_array(),
            orientation_wxyz: [turn.w, turn.x, turn.y, turn.z],
        };
        Ok(Some((point, sample.leg)))
    }

    /// Adds one touch to the path, whole or not at all: travel, approach, press, slide, lift.
    fn add_touch<D: AsRef<[u8]>>(&mut self, file: &SpmFile<D>) -> Result<(), FileError> {
        let hover = HOVER * self.size;
        let (contact, up, direct) = self.choose(file, hover)?;
        let above = contact.centre + up * hover;
        let mut way = vec![
            (above, up, Leg::Free),
            (contact.centre, contact.normal, Leg::Free),
        ];
        let length = (self.ask.speed * self.draw.between(4.0, 6.0)).min(20.0 * self.size);
        let slide = self.ball.slide(file, contact, length, &mut self.draw);
        let sink = self.ball.radius - self.ask.radius + self.ask.depth;
        let mut normal = contact.normal;
        let mut push = |way: &mut Vec<_>, contact: &Contact| {
            // Facets make the normal jitter; the intent of a hand does not.
            normal = normal
                .lerp(contact.normal, 0.2)
                .normalize_or(contact.normal);
            let position = contact.centre - normal * sink;
            way.push((position, normal, Leg::Slide));
        };
        for contact in &slide {
            push(&mut way, contact);
        }
        // Lift where a way out exists: here, or where the ball came from; at the start there is one.
        let stride = slide.len().div_ceil(16).max(1);
        let mut end = slide.len().saturating_sub(1);
        let lift = loop {
            let here = slide.get(end).copied().unwrap_or(contact);
            if let Ok(Some(lift)) = self.way_up(file, here, up) {
                break lift;
            }
            if end == 0 {
                break up;
            }
            let back = end.saturating_sub(stride);
            for contact in slide[back..end].iter().rev() {
                push(&mut way, contact);
            }
            end = back;
        };
        let leave = slide.get(end).copied().unwrap_or(contact);
        way.push((leave.centre, leave.normal, Leg::Slide));
        way.push((leave.centre + lift * hover, lift, Leg::Free));
        if let Some((last, last_up)) = self.last
            && !direct
        {
            self.travel_around(last.centre + last_up * hover, last_up, above, up);
        }
        for (position, axis, leg) in way {
            self.resampler.push(position, axis, leg);
        }
        self.last = Some((leave, lift));
        Ok(())
    }

    /// The next contact, its way out, and whether the straight way from the last one is free.
    fn choose<D: AsRef<[u8]>>(
        &mut self,
        file: &SpmFile<D>,
        hover: f64,
    ) -> Result<(Contact, DVec3, bool), FileError> {
        let mut fallback = None;
        for _ in 0..NEAR_TRIES {
            let from = match self.last {
                Some((contact, _)) => {
                    let away = self.draw.direction() * self.draw.between(0.05, 0.35) * self.size;
                    contact.centre + away
                }
                None => self.draw_by_area(file, hover)?,
            };
            let Some((contact, up)) = self.ball.drop_from(file, from)? else {
                continue;
            };
            if !self.ball.escapes(file, contact.centre, up)? {
                continue;
            }
            let direct = match self.last {
                Some((last, last_up)) => self.ball.segment_is_clear(
                    file,
                    last.centre + last_up * hover,
                    contact.centre + up * hover,
                )?,
                None => true,
            };
            if direct {
                return Ok((contact, up, true));
            }
            fallback = fallback.or(Some((contact, up)));
        }
        if let Some((contact, up)) = fallback {
            return Ok((contact, up, false));
        }
        // From outside of everything the way to the closest point is free, and so is the way back.
        loop {
            let from = self.centre + self.draw.direction() * (self.outside + self.size);
            if let Some((contact, up)) = self.ball.drop_from(file, from)? {
                return Ok((contact, up, false));
            }
        }
    }

    /// A point near a face drawn by area, on either side of it.
    fn draw_by_area<D: AsRef<[u8]>>(
        &mut self,
        file: &SpmFile<D>,
        height: f64,
    ) -> Result<DVec3, FileError> {
        let faces = file.model_header().faces;
        let (mut sum, mut kept) = (0.0, self.centre);
        for _ in 0..AREA_DRAWS {
            let [a, b, c] = file.leaf_corners(self.draw.below(faces))?;
            let normal = (b - a).cross(c - a);
            let area = normal.length();
            sum += area;
            let side = if self.draw.unit() < 0.5 {
                -height
            } else {
                height
            };
            if self.draw.unit() * sum < area {
                kept = (a + b + c) / 3.0 + normal / area * side;
            }
        }
        Ok(kept)
    }

    /// A free way from a contact to the outside: along the normal, along a hint, or nearby.
    fn way_up<D: AsRef<[u8]>>(
        &mut self,
        file: &SpmFile<D>,
        contact: Contact,
        hint: DVec3,
    ) -> Result<Option<DVec3>, FileError> {
        for attempt in 0..8 {
            let way = match attempt {
                0 => contact.normal,
                1 => hint,
                _ => (contact.normal + 0.9 * self.draw.direction()).normalize_or(contact.normal),
            };
            if way.dot(contact.normal) > 0.1 && self.ball.escapes(file, contact.centre, way)? {
                return Ok(Some(way));
            }
        }
        Ok(None)
    }

    /// Out along one free line, around the sphere that holds everything, in along another.
    fn travel_around(&mut self, from: DVec3, from_up: DVec3, to: DVec3, to_up: DVec3) {
        let exit = |p: DVec3, way: DVec3| {
            // The far root of |p + s way - centre| = outside; when p is outside already, p itself.
            let q = p - self.centre;
            let half = q.dot(way);
            let rest = self.outside * self.outside - q.length_squared();
            if rest <= 0.0 {
                p
            } else {
                p + way * ((half * half + rest).sqrt() - half)
            }
        };
        let (out, into) = (exit(from, from_up), exit(to, to_up));
        let (a, b) = (out - self.centre, into - self.centre);
        let (from_axis, to_axis) = (a.normalize_or(from_up), b.normalize_or(to_up));
        self.resampler.push(out, from_axis, Leg::Free);
        let angle = from_axis.angle_between(to_axis);
        let steps = (angle / 0.1).ceil().max(1.0);
        let around = from_axis
            .cross(to_axis)
            .try_normalize()
            .unwrap_or_else(|| from_axis.any_orthonormal_vector());
        // The polygon's middles must stay outside as well: cos(0.05) is 0.9988.
        let (ra, rb) = (a.length() * 1.002, b.length() * 1.002);
        for k in 0..=steps as u32 {
            let share = f64::from(k) / steps;
            let axis = DQuat::from_axis_angle(around, angle * share) * from_axis;
            let radius = ra + (rb - ra) * share;
            self.resampler
                .push(self.centre + axis * radius, axis, Leg::Free);
        }
        self.resampler.push(into, to_axis, Leg::Free);
    }
}

#[cfg(test)]
mod tests;

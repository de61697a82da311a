//! Tours: scripted paths that touch any mesh (approach, press, slide, lift, move on), from a seed.
//!
//! A ball rolls over the mesh: its centre is moved along the surface, the closest point of the full
//! mesh is the contact, and the line from there to the centre is the outward normal. So neither
//! winding nor closed surfaces are needed, thin parts keep their sides, and what the ball cannot
//! enter is not visited. It turns at rims (the normal turns over within the ball's own length),
//! dead ends, and where the contact jumps to another sheet. The intent lies `depth` below where a
//! probe of the asked radius would touch.
//!
//! Everything is in model units relative to the file's origin; only [`TourPoint`]s carry the
//! origin. The path is made touch by touch, so that its length costs no memory, and a touch step by
//! step, each of one search of the mesh at the most: over ten million faces a touch takes thousands
//! of searches, and whoever makes the tour has others to answer in between. Where it is interrupted
//! changes no bit of it.

mod path;
mod roll;
mod touch;

use crate::tuning::tour::{MAX_DAMAGED, MAX_MOVED_RADII};
use geometry::Pose;
use geometry::portable::{about, angle_between, cos, sin};
use glam::{DQuat, DVec3};
use path::{Leg, Resampler, Sample};
use protocol::tour::{FASTEST_SIDES_PER_S, HOVER_SIDES, ball_radius, hover_height};
use protocol::{LONGEST_TOUR_S, Refusal, TOUR_PERIOD_S, TourAsk, TourPoint, tour_points};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{RngCore, SeedableRng};
use roll::{Ball, Slide};
use spm::{FileError, SpmFile};
use thiserror::Error;
use touch::{Choice, End, Leave, Place, Space};

/// Why there is no tour.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum TourError {
    /// A number of the ask is out of range: a sentence that names it, its value and its limits,
    /// lengths as shares of the model's longest side.
    #[error("{0}")]
    Number(String),
    /// The file is damaged where the tour goes.
    #[error("{0}")]
    File(#[from] FileError),
}

impl TourError {
    /// What the client is told.
    #[must_use]
    pub fn refusal(&self) -> Refusal {
        match self {
            Self::Number(_) => Refusal::Tour,
            Self::File(_) => Refusal::DamagedBlock,
        }
    }
}

/// Checks the numbers of an ask for a model of this longest side: a sentence about the first that
/// is out of range.
fn check(ask: &TourAsk, size: f64) -> Result<(), String> {
    let &TourAsk {
        seconds,
        speed,
        depth,
        radius,
        ..
    } = ask;
    // NaN is in no range.
    if !(seconds > 0.0 && seconds <= LONGEST_TOUR_S) {
        return Err(format!(
            "it is {seconds} seconds long: ask for more than 0 and at most {LONGEST_TOUR_S}"
        ));
    }
    // A scene lets in what is just at these limits; in model units that is rounded.
    let longest = size * (1.0 + 1e-12);
    if !(speed > 0.0 && speed.is_normal() && speed <= FASTEST_SIDES_PER_S * longest) {
        return Err(format!(
            "its speed is {:.3e} lengths of the model a second: make it positive and at most {FASTEST_SIDES_PER_S}, or the object larger",
            speed / size
        ));
    }
    for (name, length) in [("depth", depth), ("radius of the probe", radius)] {
        if !(0.0..=longest).contains(&length) {
            return Err(format!(
                "its {name} is {:.3e} lengths of the model: make it at least 0 and at most 1, or the object larger",
                length / size
            ));
        }
    }
    Ok(())
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
    space: Space,
    resampler: Resampler,
    /// The touch that is being made.
    making: Option<Making>,
    /// Touches given up for damage of the file since the last point.
    damaged: u32,
    /// Where the path ends, once it has begun.
    last: Option<End>,
    /// Points given.
    given: u64,
    /// Points to give.
    total: u64,
    before: DVec3,
    /// Axes of the tool at the last point.
    turn: DQuat,
}

/// How far a touch is.
#[derive(Debug)]
enum Making {
    Choosing(Choice),
    Sliding(Place, Slide),
    Leaving(Place, Leave),
}

/// What a step of a tour came to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Step {
    /// The next point.
    Point(TourPoint),
    /// The next point is nearer.
    Nearer,
    /// Every point was given.
    Over,
}

/// Random numbers; the stream is part of a replay.
#[derive(Debug)]
struct Draw(Xoshiro256PlusPlus);

impl Draw {
    /// Uniform in 0..1.
    fn unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 * 0.5f64.powi(53)
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
        DVec3::new(r * cos(angle), r * sin(angle), z)
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
        check(&ask, size).map_err(TourError::Number)?;
        let TourAsk {
            seconds,
            speed,
            radius,
            ..
        } = ask;
        let ball_radius = ball_radius(size, radius);
        let hover = hover_height(size, speed, radius);
        let diagonal = (upper - lower).length();
        Ok(Self {
            ask,
            draw: Draw(Xoshiro256PlusPlus::seed_from_u64(ask.seed)),
            space: Space {
                ball: Ball {
                    radius: ball_radius,
                    step: (speed * TOUR_PERIOD_S).min(MAX_MOVED_RADII * ball_radius),
                    lower,
                    upper,
                },
                centre: (lower + upper) * 0.5,
                size,
                outside: 0.51 * diagonal + 2.0 * ball_radius,
                hover,
                reach: size * (hover / (HOVER_SIDES * size)),
            },
            resampler: Resampler::new(speed * TOUR_PERIOD_S),
            making: None,
            damaged: 0,
            last: None,
            given: 0,
            total: tour_points(seconds),
            before: DVec3::ZERO,
            turn: DQuat::IDENTITY,
        })
    }

    /// Whether every point was given.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.given == self.total
    }

    /// The next point, `None` after the last: as many steps as it takes.
    ///
    /// # Errors
    /// When the file is damaged where the tour goes.
    pub fn next_point<D: AsRef<[u8]>>(
        &mut self,
        file: &SpmFile<D>,
    ) -> Result<Option<TourPoint>, FileError> {
        loop {
            match self.step(file)? {
                Step::Point(point) => return Ok(Some(point)),
                Step::Nearer => {}
                Step::Over => return Ok(None),
            }
        }
    }

    /// One step towards the next point: one search of the mesh or one face read, at the most.
    ///
    /// # Errors
    /// When the file is damaged where the tour goes.
    pub fn step<D: AsRef<[u8]>>(&mut self, file: &SpmFile<D>) -> Result<Step, FileError> {
        if self.is_over() {
            return Ok(Step::Over);
        }
        if self.making.is_none()
            && let Some(sample) = self.resampler.next()
        {
            self.damaged = 0;
            return Ok(Step::Point(self.give(file, sample)));
        }
        match self.make(file) {
            // Where the file is damaged there is no touch; elsewhere there is.
            Err(_) if self.damaged < MAX_DAMAGED => self.damaged += 1,
            made => made?,
        }
        Ok(Step::Nearer)
    }

    /// The point at a place of the path.
    fn give<D: AsRef<[u8]>>(&mut self, file: &SpmFile<D>, sample: Sample) -> TourPoint {
        let full = self.given as f64 * TOUR_PERIOD_S;
        let is_last = self.given + 1 == self.total;
        let t = if is_last {
            self.ask.seconds
        } else {
            full.min(self.ask.seconds)
        };
        // The last period may be cut short: so is its way.
        let share = (1.0 - (full - t) / TOUR_PERIOD_S).clamp(0.0, 1.0);
        let position = if self.given == 0 {
            sample.position
        } else {
            self.before.lerp(sample.position, share)
        };
        self.before = sample.position;
        self.given += 1;
        let origin = DVec3::from_array(file.model_header().origin);
        // On from where it was by the shortest way: it never spins about its own axis, whichever
        // way that points.
        let arc = DQuat::from_rotation_arc(self.turn * DVec3::Z, sample.axis);
        self.turn = (arc * self.turn).normalize();
        let turn = Pose {
            position: DVec3::ZERO,
            orientation: self.turn,
        };
        TourPoint {
            t,
            position: (position + origin).to_array(),
            orientation_wxyz: turn.wxyz(),
        }
    }

    /// The most that the ball need roll for the points that are left: their way, and half as much
    /// for a slide whose intent, inside of a bend, gets less far than the ball.
    fn remaining_length(&self) -> f64 {
        1.5 * (self.total - self.given) as f64 * TOUR_PERIOD_S * self.ask.speed
    }

    /// Takes the touch in the making a step further. An error gives it up.
    fn make<D: AsRef<[u8]>>(&mut self, file: &SpmFile<D>) -> Result<(), FileError> {
        let ball = &self.space.ball;
        self.making = match self.making.take() {
            None => Some(Making::Choosing(Choice::new(self.last))),
            Some(Making::Choosing(mut choice)) => {
                match choice.step(&self.space, file, &mut self.draw)? {
                    None => Some(Making::Choosing(choice)),
                    Some(place) => {
                        let length = self.ask.speed * self.draw.between(4.0, 6.0);
                        let length = length
                            .min(20.0 * self.space.size)
                            .min(self.remaining_length());
                        let slide = Slide::new(ball, place.contact, length, &mut self.draw);
                        Some(Making::Sliding(place, slide))
                    }
                }
            }
            Some(Making::Sliding(place, mut slide)) => {
                if slide.step(ball, file, &mut self.draw) {
                    Some(Making::Sliding(place, slide))
                } else {
                    let leave = Leave::new(slide.into_path(), place.contact.normal);
                    Some(Making::Leaving(place, leave))
                }
            }
            Some(Making::Leaving(place, mut leave)) => {
                match leave.step(ball, file, &mut self.draw) {
                    None => Some(Making::Leaving(place, leave)),
                    Some(lift) => {
                        self.add_touch(place, &leave, lift);
                        None
                    }
                }
            }
        };
        Ok(())
    }

    /// Adds a touch to the path: travel, approach, press, slide, lift.
    fn add_touch(&mut self, place: Place, leave: &Leave, lift: DVec3) {
        let contact = place.contact;
        let (hover, up) = (self.space.hover, contact.normal);
        let above = contact.centre + up * hover;
        if let Some(last) = self.last
            && !place.direct
        {
            let from = last.contact.centre + last.up * hover;
            self.travel_around(from, last.up, above, up);
        }
        self.resampler.push(above, up, Leg::Free);
        self.resampler.push(contact.centre, up, Leg::Free);
        let sink = self.space.ball.radius - self.ask.radius + self.ask.depth;
        let mut normal = up;
        for contact in leave.contacts() {
            // Facets make the normal jitter; the intent of a hand does not.
            normal = normal
                .lerp(contact.normal, 0.2)
                .normalize_or(contact.normal);
            let position = contact.centre - normal * sink;
            self.resampler.push(position, normal, Leg::Slide);
        }
        let left = leave.contact().unwrap_or(contact);
        self.resampler.push(left.centre, left.normal, Leg::Slide);
        let away = left.centre + lift * hover;
        self.resampler.push(away, lift, Leg::Free);
        self.last = Some(End {
            contact: left,
            up: lift,
        });
    }

    /// Out along one free line, around the sphere that holds everything, in along another.
    fn travel_around(&mut self, from: DVec3, from_up: DVec3, to: DVec3, to_up: DVec3) {
        let exit = |p: DVec3, direction: DVec3| {
            // The far root of |p + s direction - centre| = outside; when p is outside already, p
            // itself.
            let q = p - self.space.centre;
            let half = q.dot(direction);
            let rest = self.space.outside * self.space.outside - q.length_squared();
            if rest <= 0.0 {
                p
            } else {
                p + direction * ((half * half + rest).sqrt() - half)
            }
        };
        let (out, into) = (exit(from, from_up), exit(to, to_up));
        let (a, b) = (out - self.space.centre, into - self.space.centre);
        let (from_axis, to_axis) = (a.normalize_or(from_up), b.normalize_or(to_up));
        self.resampler.push(out, from_axis, Leg::Free);
        let angle = angle_between(from_axis, to_axis);
        let steps = (angle / 0.1).ceil().max(1.0);
        let around = from_axis
            .cross(to_axis)
            .try_normalize()
            .unwrap_or_else(|| from_axis.any_orthonormal_vector());
        // The polygon's middles must stay outside as well: cos(0.05) is 0.9988.
        let (ra, rb) = (a.length() * 1.002, b.length() * 1.002);
        for k in 0..=steps as u32 {
            let share = f64::from(k) / steps;
            let axis = about(around, angle * share) * from_axis;
            let radius = ra + (rb - ra) * share;
            self.resampler
                .push(self.space.centre + axis * radius, axis, Leg::Free);
        }
        self.resampler.push(into, to_axis, Leg::Free);
    }
}

#[cfg(test)]
mod tests;

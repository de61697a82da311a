//! One touch in the making: a place is chosen, the ball slides, a way up is found. Every step
//! searches the mesh once at the most, so that who makes a tour can do something else in between.

use super::Draw;
use super::roll::{Ball, Contact, Line};
use crate::tuning::tour::{AREA_DRAWS, MAX_DIRECTIONS, NEAR_TRIES};
use glam::DVec3;
use spm::{FileError, SpmFile};

/// Where a path ends: the contact that was left, and the way up from it.
#[derive(Debug, Clone, Copy)]
pub struct End {
    pub contact: Contact,
    pub up: DVec3,
}

/// The ball, and the space around the mesh.
#[derive(Debug)]
pub struct Space {
    pub ball: Ball,
    /// Middle of the model's box.
    pub centre: DVec3,
    /// Longest side of the box.
    pub size: f64,
    /// Radius around the middle outside of which there is nothing.
    pub outside: f64,
    /// Height above the surface for moves between touches.
    pub hover: f64,
    /// The next touch is looked for within about a third of this: the longest side, and less for a
    /// slow tour, in proportion to its height.
    pub reach: f64,
}

/// A place for a touch.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    /// The contact; its normal is a free way out.
    pub contact: Contact,
    /// Whether the straight way from the last touch is free.
    pub direct: bool,
}

/// The choice of a place.
#[derive(Debug)]
pub struct Choice {
    /// Where the touch before ended.
    last: Option<End>,
    /// Places near the last one that may still be looked at.
    tries: usize,
    /// The first place from which there is a way out, but none that is straight from the last
    /// touch.
    fallback: Option<Contact>,
    next: Look,
}

/// What the choice looks at next.
#[derive(Debug)]
enum Look {
    /// A face, for the first touch: each is kept in proportion to its area.
    Face { left: usize, sum: f64, kept: DVec3 },
    /// What lies below a point near the last touch.
    Below(DVec3),
    /// What lies below a point outside of everything.
    FarBelow(DVec3),
    /// The way out from there.
    Out(Contact, Line),
    /// The straight way to there.
    Direct(Contact, Line),
    /// The next place.
    Another,
}

impl Choice {
    /// The choice of the first place, or the one after `last`.
    pub fn new(last: Option<End>) -> Self {
        Self {
            last,
            tries: NEAR_TRIES,
            fallback: None,
            next: Look::Another,
        }
    }

    /// One search or one face further; the place, once it is found.
    pub fn step<D: AsRef<[u8]>>(
        &mut self,
        space: &Space,
        file: &SpmFile<D>,
        draw: &mut Draw,
    ) -> Result<Option<Place>, FileError> {
        let ball = &space.ball;
        match &mut self.next {
            Look::Another => return Ok(self.look_at_another(space, draw)),
            Look::Face { left: 0, kept, .. } => self.next = Look::Below(*kept),
            Look::Face { left, sum, kept } => {
                *left -= 1;
                draw_face(space.hover, file, draw, sum, kept)?;
            }
            Look::Below(from) => {
                self.next = match ball.touch(file, *from)? {
                    Some(contact) => {
                        let line = Line::out_of_box(ball, contact.centre, contact.normal);
                        Look::Out(contact, line)
                    }
                    None => Look::Another,
                };
            }
            Look::FarBelow(from) => match ball.touch(file, *from)? {
                // From out there the way to the closest point is free, and so is the way back.
                Some(contact) => {
                    return Ok(Some(Place {
                        contact,
                        direct: false,
                    }));
                }
                None => self.next = Look::Another,
            },
            Look::Out(contact, line) => match line.step(ball, file)? {
                None => {}
                Some(false) => self.next = Look::Another,
                Some(true) => {
                    let contact = *contact;
                    let Some(last) = self.last else {
                        return Ok(Some(Place {
                            contact,
                            direct: true,
                        }));
                    };
                    let from = last.contact.centre + last.up * space.hover;
                    let to = contact.centre + contact.normal * space.hover;
                    self.next = Look::Direct(contact, Line::between(from, to));
                }
            },
            Look::Direct(contact, line) => match line.step(ball, file)? {
                None => {}
                Some(true) => {
                    return Ok(Some(Place {
                        contact: *contact,
                        direct: true,
                    }));
                }
                Some(false) => {
                    self.fallback = self.fallback.or(Some(*contact));
                    self.next = Look::Another;
                }
            },
        }
        Ok(None)
    }

    /// Goes on to the next place: near the last touch, then the fallback, then from far away.
    fn look_at_another(&mut self, space: &Space, draw: &mut Draw) -> Option<Place> {
        if self.tries > 0 {
            self.tries -= 1;
            self.next = match self.last {
                Some(last) => {
                    let away = draw.direction() * draw.between(0.05, 0.35) * space.reach;
                    Look::Below(last.contact.centre + away)
                }
                None => Look::Face {
                    left: AREA_DRAWS,
                    sum: 0.0,
                    kept: space.centre,
                },
            };
            return None;
        }
        if let Some(contact) = self.fallback {
            return Some(Place {
                contact,
                direct: false,
            });
        }
        let from = space.centre + draw.direction() * (space.outside + space.size);
        self.next = Look::FarBelow(from);
        None
    }
}

/// Draws a face and a side of it; the point there replaces the one kept in proportion to the areas
/// so far.
fn draw_face<D: AsRef<[u8]>>(
    height: f64,
    file: &SpmFile<D>,
    draw: &mut Draw,
    sum: &mut f64,
    kept: &mut DVec3,
) -> Result<(), FileError> {
    let [a, b, c] = file.leaf_corners(draw.below(file.model_header().faces))?;
    let normal = (b - a).cross(c - a);
    let area = normal.length();
    *sum += area;
    let side = if draw.unit() < 0.5 { -height } else { height };
    if draw.unit() * *sum < area {
        *kept = (a + b + c) / 3.0 + normal / area * side;
    }
    Ok(())
}

/// The search for a free way up from where a slide ended or, where there is none, from where the
/// ball came.
#[derive(Debug)]
pub struct Leave {
    /// The slide.
    path: Vec<Contact>,
    /// The way out at its start.
    hint: DVec3,
    /// Contacts to go back where there is no way up.
    stride: usize,
    /// The contact to leave from.
    end: usize,
    /// Ways tried from there.
    tried: u32,
    /// The way that is being tried.
    line: Option<(DVec3, Line)>,
}

impl Leave {
    /// From the end of a slide, whose start has a way out.
    pub fn new(path: Vec<Contact>, hint: DVec3) -> Self {
        Self {
            stride: path.len().div_ceil(16).max(1),
            end: path.len().saturating_sub(1),
            path,
            hint,
            tried: 0,
            line: None,
        }
    }

    /// The contacts of the slide, and those on the way back to where it is left, in their order.
    pub fn contacts(&self) -> impl Iterator<Item = &Contact> {
        let last = self.path.len().saturating_sub(1);
        let back = self.path[self.end.min(last)..last].iter().rev();
        self.path.iter().chain(back)
    }

    /// The contact that is left from.
    pub fn contact(&self) -> Option<Contact> {
        self.path.get(self.end).copied()
    }

    /// One search further; the way up from [`Leave::contact`], once it is found.
    pub fn step<D: AsRef<[u8]>>(
        &mut self,
        ball: &Ball,
        file: &SpmFile<D>,
        draw: &mut Draw,
    ) -> Option<DVec3> {
        let Some(contact) = self.contact() else {
            return Some(self.hint);
        };
        if let Some((direction, line)) = &mut self.line {
            match line.step(ball, file) {
                Ok(None) => return None,
                Ok(Some(true)) => return Some(*direction),
                Ok(Some(false)) => {}
                // Where the file is damaged no other way is tried.
                Err(_) => self.tried = MAX_DIRECTIONS,
            }
            self.line = None;
        }
        while self.tried < MAX_DIRECTIONS {
            let direction = match self.tried {
                0 => contact.normal,
                1 => self.hint,
                _ => (contact.normal + 0.9 * draw.direction()).normalize_or(contact.normal),
            };
            self.tried += 1;
            if direction.dot(contact.normal) > 0.1 {
                self.line = Some((direction, Line::out_of_box(ball, contact.centre, direction)));
                return None;
            }
        }
        if self.end == 0 {
            return Some(self.hint);
        }
        self.end = self.end.saturating_sub(self.stride);
        self.tried = 0;
        None
    }
}

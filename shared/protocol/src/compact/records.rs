//! Records by what is known when they come: the record of the split vertex, the closure that they
//! belong to, and the record before.

use super::numbers::{Difference, Number, Tree};
use super::range_coder::{Bit, Code};
use bytemuck::Zeroable;
use spm::{NONE, Sizes, VspRecord};

/// Records that are kept, 1 MiB at the most; a new one takes the place of another when it is full.
const MAX_KEPT: usize = 1 << 14;
/// Ids of an answer that are kept, over all of its parts, half a megabyte at the most.
const MAX_IDS: usize = 1 << 16;

/// Records received, by their number.
#[derive(Debug, Clone, Default)]
pub struct Records {
    /// Each at its number's remainder.
    places: Vec<VspRecord>,
}

impl Records {
    pub fn get(&self, i: u32) -> Option<&VspRecord> {
        let place = self.places.get(i as usize % MAX_KEPT)?;
        (place.i == i).then_some(place)
    }

    pub fn keep(&mut self, record: &VspRecord) {
        let at = record.i as usize % MAX_KEPT;
        if at >= self.places.len() {
            let mut none = VspRecord::zeroed();
            none.i = NONE;
            self.places.resize((at + 1).next_power_of_two(), none);
        }
        self.places[at] = *record;
    }
}

/// The ids of the present answer, as far as they came.
#[derive(Debug, Clone, Default)]
pub struct Closure {
    /// Ascending, as long as the answer is sound.
    pub ids: Vec<u32>,
    /// Those whose records are to come.
    announced: Vec<u32>,
    /// Records that came.
    came: usize,
}

impl Closure {
    pub fn clear(&mut self) {
        self.ids.clear();
        self.announced.clear();
        self.came = 0;
    }

    pub fn push(&mut self, id: u32, record_follows: bool) {
        if self.ids.len() < MAX_IDS {
            self.ids.push(id);
            if record_follows {
                self.announced.push(id);
            }
        }
    }

    /// Records that are to come.
    pub fn expected(&self) -> usize {
        self.announced.len().saturating_sub(self.came)
    }

    /// The id of the next record.
    pub fn next_record(&mut self) -> Option<u32> {
        let id = self.announced.get(self.came).copied();
        self.came += 1;
        id
    }
}

/// What is known before a record.
#[derive(Debug, Clone, Copy)]
pub struct Known<'a> {
    /// Its number, if it is the one that is announced.
    pub expected: Option<u32>,
    /// The ids of its answer, ascending.
    pub closure: &'a [u32],
    pub kept: &'a Records,
    pub bases: Bases,
}

/// Where the ids of what records create begin; 0 where it is not known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Bases {
    /// The first vertex that a record creates.
    pub vertices: u32,
    /// The first face that a record creates.
    pub faces: u32,
}

impl Bases {
    pub fn of(sizes: Option<Sizes>) -> Self {
        sizes.map_or(Self::default(), |sizes| Self {
            vertices: sizes.base_vertices,
            faces: sizes.base_faces,
        })
    }

    /// The record that creates a face, and which of its two.
    fn creator_of_face(self, face: u32) -> Option<(u32, bool)> {
        let of = face.checked_sub(self.faces)?;
        Some((of / 2, of & 1 == 1))
    }

    /// A face that a record creates.
    fn face(self, i: u32, is_right: bool) -> u32 {
        let left = self.faces.wrapping_add(i.wrapping_mul(2));
        left.wrapping_add(u32::from(is_right))
    }
}

impl Known<'_> {
    /// How far before the record at a place of the closure another one stands.
    fn rank(&self, place: usize, i: u32) -> Option<u32> {
        let at = self.closure.binary_search(&i).ok()?;
        (at < place).then_some((place - at) as u32)
    }

    /// The record so far before a place.
    fn of_rank(&self, place: usize, rank: u32) -> u32 {
        let at = place.wrapping_sub(rank as usize);
        self.closure.get(at).copied().unwrap_or_default()
    }

    fn leaf(&self, face: u32) -> Option<u32> {
        let (i, is_right) = self.bases.creator_of_face(face)?;
        let creator = self.kept.get(i)?;
        Some(if is_right {
            creator.leaf_r
        } else {
            creator.leaf_l
        })
    }
}

/// A float as a number that ascends with it.
fn ascending(float: f32) -> u32 {
    let bits = float.to_bits();
    if bits >> 31 == 1 {
        !bits
    } else {
        bits | 1 << 31
    }
}

fn of_ascending(number: u32) -> f32 {
    f32::from_bits(if number >> 31 == 1 {
        number & !(1 << 31)
    } else {
        !number
    })
}

/// The exponent in the bits of a float.
fn exponent(float: f32) -> i32 {
    (float.to_bits() >> 23 & 255) as i32
}

/// Largest difference of two positions along an axis.
fn distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    // No `max`: what it does with a number that is none is not the same on every machine.
    (0..3).fold(0.0, |most, k| {
        let along = (a[k] - b[k]).abs();
        if along > most { along } else { most }
    })
}

/// Contexts of a position: the length of the edge in units of the last place.
const SCALES: usize = 48;

/// How far a difference of a coordinate is to be expected.
fn scale(edge: f32, at: f32) -> usize {
    (exponent(edge) - exponent(at) + 32).clamp(0, SCALES as i32 - 1) as usize
}

/// Contexts of a leaf's code: the bits of the difference of the parent's.
const LEAF_SIZES: usize = 33;

/// What is known of records.
#[derive(Debug)]
pub struct RecordModel {
    is_kept: Bit,
    is_expected: Bit,
    number: Difference,
    parent_kind: Tree<4>,
    parent_rank: Number,
    parent_back: Number,
    side: Bit,
    vertex: Number,
    face_kind: Vec<Tree<16>>,
    face_rank: Vec<Number>,
    face_side: [Bit; 4],
    face: Vec<Difference>,
    leaves: Vec<Difference>,
    positions: Vec<Difference>,
    errors: Vec<Difference>,
    has_error: [Bit; 3],
    close: [Difference; 2],
    is_split: [Bit; 2],
    begin: [Difference; 2],
    last: VspRecord,
}

impl Default for RecordModel {
    fn default() -> Self {
        Self {
            is_kept: Bit::NEW,
            is_expected: Bit::NEW,
            number: Difference::NEW,
            parent_kind: Tree::NEW,
            parent_rank: Number::NEW,
            parent_back: Number::NEW,
            side: Bit::NEW,
            vertex: Number::NEW,
            face_kind: vec![Tree::NEW; 8],
            face_rank: vec![Number::NEW; 4],
            face_side: [Bit::NEW; 4],
            face: vec![Difference::NEW; 4],
            leaves: vec![Difference::NEW; 2 * LEAF_SIZES],
            positions: vec![Difference::NEW; 2 * SCALES],
            errors: vec![Difference::NEW; 4],
            has_error: [Bit::NEW; 3],
            close: [Difference::NEW; 2],
            is_split: [Bit::NEW; 2],
            begin: [Difference::NEW; 2],
            last: VspRecord::zeroed(),
        }
    }
}

impl RecordModel {
    /// Codes a record.
    pub fn code(
        &mut self,
        code: &mut impl Code,
        given: &VspRecord,
        known: &Known<'_>,
    ) -> VspRecord {
        let mut record = VspRecord::zeroed();
        let is_expected = code.bit(known.expected == Some(given.i), &mut self.is_expected);
        record.i = match known.expected.filter(|_| is_expected) {
            Some(i) => i,
            None => self.number.code(code, given.i, self.last.i),
        };
        if let Some(kept) = known.kept.get(record.i) {
            let is_kept = bytemuck::bytes_of(kept) == bytemuck::bytes_of(given);
            if code.bit(is_kept, &mut self.is_kept) {
                self.last = *kept;
                return *kept;
            }
        }
        let place = known.closure.binary_search(&record.i);
        let place = place.unwrap_or(known.closure.len());
        let (parent, is_u) = self.vertex(code, given.vs, &mut record, place, known);
        let of = *parent.unwrap_or(&self.last);
        for k in 0..4 {
            record.fn_[k] = self.face(code, given.fn_[k], &record, (k, is_u), place, known);
        }
        self.leaves(code, given, &mut record, &of, known);
        let at = if is_u { of.pos_u } else { of.pos_t };
        self.positions(code, given, &mut record, at, distance(of.pos_t, of.pos_u));
        self.errors(
            code,
            given,
            &mut record,
            of.certified[usize::from(is_u)].radius,
        );
        self.last = record;
        record
    }

    /// Codes the split vertex; the record that creates it, if it is kept, and whether it is the
    /// second of that.
    fn vertex<'a>(
        &mut self,
        code: &mut impl Code,
        given: u32,
        record: &mut VspRecord,
        place: usize,
        known: &Known<'a>,
    ) -> (Option<&'a VspRecord>, bool) {
        let base = known.bases.vertices;
        let creator = given.checked_sub(base).map(|of| of / 2);
        let rank = creator.and_then(|of| known.rank(place, of));
        // A vertex of the base mesh, one of the closure, any other.
        let kind = match (creator, rank) {
            (None, _) => 0,
            (Some(_), Some(_)) => 1,
            (Some(_), None) => 2,
        };
        let creator = match self.parent_kind.code(code, kind) {
            1 => {
                let rank = self.parent_rank.code(code, rank.unwrap_or_default());
                known.of_rank(place, rank)
            }
            2 => {
                let back = record.i.wrapping_sub(creator.unwrap_or_default());
                record.i.wrapping_sub(self.parent_back.code(code, back))
            }
            _ => {
                record.vs = self.vertex.code(code, given);
                return (None, false);
            }
        };
        let is_u = code.bit(given.wrapping_sub(base) & 1 == 1, &mut self.side);
        let first = base.wrapping_add(creator.wrapping_mul(2));
        record.vs = first.wrapping_add(u32::from(is_u));
        (known.kept.get(creator), is_u)
    }

    /// Codes neighbour `k` of the new faces.
    fn face(
        &mut self,
        code: &mut impl Code,
        given: u32,
        record: &VspRecord,
        (k, is_u): (usize, bool),
        place: usize,
        known: &Known<'_>,
    ) -> u32 {
        let near = near_faces(record, k, known);
        let bases = known.bases;
        let creator = bases.creator_of_face(given);
        let rank = creator.and_then(|(i, _)| known.rank(place, i));
        // None, one of the closure, any other, one nearby.
        let kind = if given == NONE {
            0
        } else if let Some(at) = near.iter().position(|&face| face == given) {
            3 + at as u32
        } else if rank.is_some() {
            1
        } else {
            2
        };
        let context = k + 4 * usize::from(is_u);
        match self.face_kind[context].code(code, kind) {
            0 => NONE,
            1 => {
                let rank = self.face_rank[k].code(code, rank.unwrap_or_default());
                let is_right = creator.is_some_and(|(_, is_right)| is_right);
                let is_right = code.bit(is_right, &mut self.face_side[k]);
                bases.face(known.of_rank(place, rank), is_right)
            }
            2 => self.face[k].code(code, given, bases.face(record.i, false)),
            kind => near.get(kind as usize - 3).copied().unwrap_or(NONE),
        }
    }

    fn leaves(
        &mut self,
        code: &mut impl Code,
        given: &VspRecord,
        record: &mut VspRecord,
        of: &VspRecord,
        known: &Known<'_>,
    ) {
        let near = record.fn_.iter().find_map(|&face| known.leaf(face));
        let near = near.unwrap_or(of.leaf_l);
        let size = (u32::BITS - of.leaf_l.abs_diff(of.leaf_r).leading_zeros()) as usize;
        record.leaf_l = self.leaves[size].code(code, given.leaf_l, near);
        let (right, near) = (&mut self.leaves[LEAF_SIZES + size], record.leaf_l);
        record.leaf_r = right.code(code, given.leaf_r, near);
    }

    /// Codes both positions: `at` is the split vertex, and `edge` is as long as the edge is likely
    /// to be.
    fn positions(
        &mut self,
        code: &mut impl Code,
        given: &VspRecord,
        record: &mut VspRecord,
        at: [f32; 3],
        edge: f32,
    ) {
        for (k, &at) in at.iter().enumerate() {
            let model = &mut self.positions[scale(edge, at)];
            let t = model.code(code, ascending(given.pos_t[k]), ascending(at));
            record.pos_t[k] = of_ascending(t);
        }
        let edge = distance(record.pos_t, at);
        for (k, &at) in at.iter().enumerate() {
            // On the other side.
            let (s, t) = (ascending(at), ascending(record.pos_t[k]));
            let opposite = s.wrapping_add(s.wrapping_sub(t));
            let model = &mut self.positions[SCALES + scale(edge, at)];
            let u = model.code(code, ascending(given.pos_u[k]), opposite);
            record.pos_u[k] = of_ascending(u);
        }
    }

    fn errors(&mut self, code: &mut impl Code, given: &VspRecord, record: &mut VspRecord, of: u8) {
        let radii = given.certified.map(|of| of.radius);
        let has_t = code.bit(radii[0] != 0, &mut self.has_error[0]);
        let second = 1 + usize::from(has_t);
        if has_t {
            record.certified[0].radius =
                self.errors[0].code(code, radii[0].into(), of.into()) as u8;
        }
        record.e = self.errors[3].code(code, u32::from(given.e), u32::from(self.last.e)) as u16;
        if code.bit(radii[1] != 0, &mut self.has_error[second]) {
            record.certified[1].radius =
                self.errors[second].code(code, radii[1].into(), of.into()) as u8;
        }
        for k in 0..2 {
            let (given, last) = (given.certified[k], self.last.certified[k]);
            let coded = &mut record.certified[k];
            // What no VSP splits has no R, mostly.
            let has_radius = usize::from(coded.radius != 0);
            let close = &mut self.close[has_radius];
            coded.close = close.code(code, given.close.into(), last.close.into()) as u8;
            coded.begin = u8::MAX;
            if code.bit(given.begin != u8::MAX, &mut self.is_split[has_radius]) {
                let begin = &mut self.begin[has_radius];
                coded.begin = begin.code(code, given.begin.into(), 0) as u8;
            }
        }
    }
}

/// Faces that are likely to be neighbours of a record's: those around its parent, and around the
/// neighbour before.
fn near_faces(record: &VspRecord, k: usize, known: &Known<'_>) -> [u32; 11] {
    let mut near = [NONE; 11];
    let bases = known.bases;
    let parent = record.vs.checked_sub(bases.vertices);
    if let Some(parent) = parent.and_then(|of| known.kept.get(of / 2)) {
        near[0] = bases.face(parent.i, false);
        near[1] = bases.face(parent.i, true);
        near[2..6].copy_from_slice(&parent.fn_);
    }
    let before = record.fn_[..k].iter().rev().find(|&&face| face != NONE);
    let creator = before.and_then(|&face| bases.creator_of_face(face));
    if let Some((i, is_right)) = creator
        && let Some(creator) = known.kept.get(i)
    {
        near[6] = bases.face(i, !is_right);
        near[7..11].copy_from_slice(&creator.fn_);
    }
    near
}

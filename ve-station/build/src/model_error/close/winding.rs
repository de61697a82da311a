//! Patches whose traces cross each other, as round a thin leg: how often they go round each vertex.
//!
//! From an end of a side to the other one that number, counterclockwise, changes by as often as
//! traces cross the side, and no other side changes it. So it is known of the ends of all crossed
//! sides but for a constant: they are connected, since a trace goes from side to side of one face.
//! Beyond them the traces are not seen, and it is that of the end that a vertex hangs together
//! with. The constant makes it 0 outside, where there is more than a patch may have.

use super::super::full_surface::FullSurface;
use super::patch::{Rings, Search};
use super::plane::Plane;
use super::trace::Crossing;
use std::collections::{BTreeMap, BTreeSet};

/// How often traces go round vertices.
#[derive(Debug, Clone)]
struct Winding {
    /// By side, the smaller end first: how much more often round that one.
    crossed: BTreeMap<(u32, u32), i32>,
    /// By vertex, but for a constant.
    times: BTreeMap<u32, i32>,
}

impl Winding {
    /// Round the ends of the sides that are crossed, each with the end on the left first; `None`
    /// where nothing is crossed, or going round changes the number, as round a handle.
    fn new(sides: impl Iterator<Item = Crossing>, rings: &Rings) -> Option<Self> {
        let mut winding = Self {
            crossed: BTreeMap::new(),
            times: BTreeMap::new(),
        };
        for (left, right) in sides {
            let more = if left < right { 1 } else { -1 };
            let side = (left.min(right), left.max(right));
            *winding.crossed.entry(side).or_default() += more;
        }
        let ends = winding.crossed.keys().flat_map(|side| [side.0, side.1]);
        let ends: BTreeSet<u32> = ends.collect();
        let first = *ends.first()?;
        winding.times.insert(first, 0);
        let mut waiting = vec![first];
        while let Some(vertex) = waiting.pop() {
            for &beside in rings.of(vertex).iter().filter(|v| ends.contains(v)) {
                if winding.reach(vertex, beside)? {
                    waiting.push(beside);
                }
            }
        }
        (winding.times.len() == ends.len()).then_some(winding)
    }

    /// Goes along a side: whether the number of its other end was not known. `None` where another
    /// one was.
    fn reach(&mut self, from: u32, to: u32) -> Option<bool> {
        let side = (from.min(to), from.max(to));
        let more = self.crossed.get(&side).copied().unwrap_or(0);
        let times = self.times[&from] - if from < to { more } else { -more };
        match self.times.insert(to, times) {
            None => Some(true),
            Some(known) => (known == times).then_some(false),
        }
    }

    /// The numbers that may be that of the outside, the likeliest first: a loop has more ends
    /// outside than inside.
    fn outsides(&self) -> Vec<i32> {
        let mut counts: BTreeMap<i32, usize> = BTreeMap::new();
        for &times in self.times.values() {
            *counts.entry(times).or_default() += 1;
        }
        let mut outsides: Vec<i32> = counts.keys().copied().collect();
        outsides.sort_by_key(|times| std::cmp::Reverse(counts[times]));
        outsides
    }
}

impl Search {
    /// As [`Self::farthest`], of traces that cross each other, by the sides that they cross, each
    /// with the end on the left first.
    pub fn farthest_wound(
        &mut self,
        sides: impl Iterator<Item = Crossing>,
        rings: &Rings,
        (full, plane): (&FullSurface<'_>, &Plane),
        limit: usize,
    ) -> Option<f64> {
        let winding = Winding::new(sides, rings)?;
        let outsides = winding.outsides();
        let mut tries = outsides.into_iter().map(|outside| {
            let mut winding = winding.clone();
            self.begin_search();
            for (&vertex, _) in winding.times.iter().filter(|of| *of.1 != outside) {
                self.take(vertex, full, plane);
            }
            let mut next = 0;
            while let Some(&(vertex, _)) = self.inside().get(next) {
                next += 1;
                for &beside in rings.of(vertex) {
                    if winding.reach(vertex, beside)? {
                        self.take(beside, full, plane);
                    }
                }
                if self.inside().len() > limit {
                    return None;
                }
            }
            let away = self.inside().iter().map(|(_, seen)| seen.away);
            Some(away.fold(0.0, f64::max))
        });
        tries.find_map(|found| found)
    }
}

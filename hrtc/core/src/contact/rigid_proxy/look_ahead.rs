//! The length of the path for which candidates are collected, found by trying.
//!
//! A longer path has more candidates, a shorter one is collected more often. Which of them moves
//! the tool at the least cost depends on what is around it, and changes as it moves on. While the
//! tool lags behind the device, each collection is half or twice as long as the last one that was
//! used up: as before where that made the motion cheaper, the other way where it made it dearer
//! (perturb and observe). While it does not lag, the length grows.
//!
//! A step may deviate from its path by some distance without a new search. A path shorter than that
//! moves the tool as far at less cost, and would seem best, though each collection pays for its
//! descent through the trees. So the length is not reduced below that distance but for lack of room
//! or budget, and grows from there.

/// Shortest and longest path, as fractions of the radius of gyration: a shorter one hardly costs
/// less, and from a longer one the tool turns off.
const SHORTEST: f64 = 1e-4;
const LONGEST: f64 = 0.1;
/// Where a tick needs a longer path than [`LONGEST`], one over this of it may be looked at: a tick
/// has few steps for a fast motion.
const FEW: f64 = 4.0;
/// Growth of the length, and its reduction.
const CHANGE: f64 = 2.0;
/// The part of the length of which a tool that lags must have moved more: else it turned off, and
/// the path was too long. By `rt-tests tools` on the comb (3 s) 599 of the 865 longest collections
/// brought less than 0.3 of their length, half of these no more than their margin.
const LITTLE: f64 = 0.25;
/// The part of the length that the tool must have moved for it to count as tried: a path that the
/// tool's rotation bends is shorter than the length. On dragon, bunny, relief and comb (a copy of
/// the measure of `rt-tests tools`, with longer paths allowed) 0.3 to 0.9 differ less than seeds.
const TRIED: f64 = 0.5;

/// Length of the path of the next collection, and what the last one brought. Model units.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub(super) struct LookAhead {
    length: f64,
    shortest: f64,
    longest: f64,
    is_growing: bool,
    /// Since the last collection began: its cost and that of the steps, in node pairs, and the
    /// motion of the tool.
    cost: u32,
    moved: f64,
    /// Motion for a cost of 1 at the length before.
    before: f64,
}

impl LookAhead {
    /// The longest path for a tool with a radius of gyration, of which nothing is known yet.
    pub(super) fn new(gyration: f64) -> Self {
        let longest = LONGEST * gyration;
        Self {
            length: longest,
            shortest: SHORTEST * gyration,
            longest,
            is_growing: false,
            cost: 0,
            moved: 0.0,
            before: 0.0,
        }
    }

    pub(super) fn length(&self) -> f64 {
        self.length
    }

    /// Whether a shorter path is not looked at.
    pub(super) fn is_shortest(&self) -> bool {
        self.length <= self.shortest
    }

    /// Begins a collection: finds its length. `look_around`: how far a step may deviate from its
    /// path; `needed`: the path for which a tick needs candidates.
    pub(super) fn begin(&mut self, is_lagging: bool, [look_around, needed]: [f64; 2]) {
        let (cost, moved) = (self.cost.max(1), self.moved);
        if moved > TRIED * self.length {
            let least = look_around.max(self.shortest).min(self.longest);
            let now = moved / f64::from(cost);
            let turns = now < self.before;
            self.is_growing = !is_lagging || self.length <= least || self.is_growing ^ turns;
            self.before = now;
            let length = if self.is_growing {
                CHANGE * self.length
            } else {
                (self.length / CHANGE).max(least)
            };
            self.length = length.min(self.longest.max(needed / FEW));
        } else if is_lagging && moved > 0.0 && moved < LITTLE * self.length {
            let least = look_around.max(self.shortest).min(self.longest);
            self.length = (self.length / CHANGE).max(least.min(self.length));
            // If all of that is used, a longer one is tried.
            (self.is_growing, self.before) = (true, moved / f64::from(cost));
        }
        (self.cost, self.moved) = (0, 0.0);
    }

    /// Notes what a collection or a step cost, and how far it moved the tool.
    pub(super) fn note(&mut self, cost: u32, moved: f64) {
        self.cost = self.cost.saturating_add(cost);
        self.moved += moved;
    }

    /// Reduces the length where the candidates are too many for a tick.
    pub(super) fn shorten(&mut self) {
        self.shorten_to(self.length / CHANGE);
    }

    /// The same, to a length.
    pub(super) fn shorten_to(&mut self, length: f64) {
        self.length = length.min(self.length).max(self.shortest);
        (self.cost, self.moved) = (0, 0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where the tool moves along all of the path, at a cost of a constant, a part with the length
    /// and one with its square, the length stays around that of least cost.
    #[test]
    fn the_length_comes_to_that_of_least_cost() {
        // Least where base / length + of_square * length is, at the root of their ratio.
        for (base, of_square) in [(1e3, 1e5), (5e3, 1e5), (1e4, 1e7), (400.0, 1e6)] {
            let best: f64 = f64::sqrt(base / of_square);
            let mut look_ahead = LookAhead::new(10.0);
            let mut lengths = Vec::new();
            for _ in 0..60 {
                look_ahead.begin(true, [0.02, 0.0]);
                let length = look_ahead.length();
                let cost = base + 1e3 * length + of_square * length * length;
                look_ahead.note(cost as u32, length);
                lengths.push(length);
            }
            for length in &lengths[20..] {
                let off = (length / best).log2();
                assert!(off.abs() <= 2.0, "{length} of {best}: {lengths:?}");
            }
        }
    }

    /// A path that the tool turns off comes to two to four times what it uses, and grows from there
    /// when all of it is used.
    #[test]
    fn the_length_comes_to_what_is_used_where_the_tool_turns_off() {
        const USED: f64 = 0.004;
        let mut look_ahead = LookAhead::new(1.0);
        for _ in 0..10 {
            look_ahead.begin(true, [0.002, 0.0]);
            look_ahead.note(1000, USED);
        }
        let length = look_ahead.length();
        assert!((USED..=4.0 * USED).contains(&length), "{length}");
        for _ in 0..10 {
            look_ahead.begin(true, [0.002, 0.0]);
            look_ahead.note(1000, look_ahead.length());
        }
        assert_eq!(look_ahead.length(), LONGEST);
    }

    /// A path of which the tool used somewhat less than half says nothing about its length.
    #[test]
    fn the_length_stays_where_it_is_not_used() {
        let mut look_ahead = LookAhead::new(1.0);
        for _ in 0..10 {
            look_ahead.begin(true, [0.002, 0.0]);
            look_ahead.note(1000, 0.4 * look_ahead.length());
        }
        assert_eq!(look_ahead.length(), LONGEST);
    }

    /// Below the distance that a step moves in any case a shorter path only seems to be cheaper:
    /// from there the length grows to where the motion is cheapest, and does not come back.
    #[test]
    fn the_length_is_not_trapped_where_a_shorter_path_moves_as_far() {
        const AROUND: f64 = 0.002;
        let mut look_ahead = LookAhead::new(1.0);
        look_ahead.shorten_to(0.0);
        let mut lengths = Vec::new();
        for _ in 0..40 {
            look_ahead.begin(true, [AROUND, 0.0]);
            let length = look_ahead.length();
            let cost = 550.0 + 230.0 * length / AROUND;
            look_ahead.note(cost as u32, length.max(AROUND));
            lengths.push(length);
        }
        assert!(lengths[0] < AROUND, "lack of room makes it shorter");
        let is_long = |&length: &f64| length > 2.0 * AROUND;
        assert!(lengths[20..].iter().all(is_long), "{lengths:?}");
    }

    /// It never leaves its range.
    #[test]
    fn the_length_has_a_least() {
        let mut look_ahead = LookAhead::new(1.0);
        (0..100).for_each(|_| look_ahead.shorten());
        assert!(look_ahead.is_shortest());
        assert_eq!(look_ahead.length(), SHORTEST);
    }
}

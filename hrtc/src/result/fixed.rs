//! Histograms of bounded size.

use super::{Buckets, MedianMax, ShortSpread, Spread};

/// Bits of a value's place in its row.
const ROW_BITS: u32 = 10;
/// Places of a row: an octave in parts of a thousandth.
const ROW: usize = 1 << ROW_BITS;

/// How often each place of a row was met. 32 bits suffice for 49 days at 1 kHz; 64 bits would
/// double the locked memory.
type Row = [u32; ROW];

/// A histogram with a fixed range, three significant digits and an exact maximum. Only an octave
/// that was met has a row, of 4 KiB: the whole range, which no sound run needs, would take several
/// times as much locked memory. Its buckets are those of hdrhistogram, a crate that takes one
/// logarithm from the C library's mathematics: another 0.9 MB that would be locked.
pub(super) struct Fixed {
    /// Values below [`ROW`] steps, then each octave above, up to the end of the range.
    rows: Vec<Option<Box<Row>>>,
    /// Values in all rows.
    values: u64,
    /// End of the range, steps.
    most: u64,
    /// Steps a unit of the quantity.
    scale: f64,
    /// Largest value, in the unit of the quantity.
    max: f64,
    /// Whether every value was finite; the others are not in the table.
    pub(super) is_finite: bool,
}

/// Row of a value in steps, and its place there.
fn place_of(steps: u64) -> (usize, usize) {
    let octave = steps.max(1).ilog2();
    if octave < ROW_BITS {
        return (0, steps as usize);
    }
    let shift = octave - ROW_BITS;
    (1 + shift as usize, (steps >> shift) as usize - ROW)
}

/// The largest value of a place, steps.
fn largest(row: usize, place: usize) -> u64 {
    if row == 0 {
        return place as u64;
    }
    let next = (ROW + place + 1) as u64;
    (next << (row - 1)) - 1
}

impl Fixed {
    /// For a quantity counted in steps of 1 / `scale`, up to 2^`bits` steps, below 2^63.
    pub(super) fn new(scale: f64, bits: u32) -> Self {
        let most = 1 << bits;
        Self {
            rows: vec![None; 1 + place_of(most).0],
            values: 0,
            most,
            scale,
            max: 0.0,
            is_finite: true,
        }
    }

    pub(super) fn push(&mut self, value: f64) {
        if !value.is_finite() {
            self.is_finite = false;
            return;
        }
        let value = value.max(0.0);
        self.max = self.max.max(value);
        // `as` saturates too.
        let steps = ((value * self.scale).round() as u64).min(self.most);
        let (row, place) = place_of(steps);
        self.add(row, place, 1);
    }

    fn add(&mut self, row: usize, place: usize, values: u32) {
        let row = self.rows[row].get_or_insert_with(|| Box::new([0; ROW]));
        row[place] = row[place].saturating_add(values);
        self.values += u64::from(values);
    }

    /// Row, place and number of values of each place that was met, ascending.
    fn counts(&self) -> impl Iterator<Item = (usize, usize, u32)> {
        let rows = self.rows.iter().enumerate();
        let rows = rows.filter_map(|(row, counts)| Some((row, counts.as_deref()?)));
        let all = rows.flat_map(|(row, counts)| {
            let places = counts.iter().enumerate();
            places.map(move |(place, &count)| (row, place, count))
        });
        all.filter(|of| of.2 > 0)
    }

    pub(super) fn quantile(&self, q: f64) -> f64 {
        let wanted = ((q * self.values as f64).ceil() as u64).max(1);
        let mut below = 0;
        let found = self.counts().find(|of| {
            below += u64::from(of.2);
            below >= wanted
        });
        // None: an empty table, or one of more values than its counts hold.
        found.map_or(self.max, |(row, place, _)| {
            (largest(row, place) as f64 / self.scale).min(self.max)
        })
    }

    pub(super) fn spread(&self) -> Spread {
        Spread {
            p50: self.quantile(0.5),
            p99: self.quantile(0.99),
            p999: self.quantile(0.999),
            max: self.max,
        }
    }

    pub(super) fn short(&self) -> ShortSpread {
        let Spread { p50, p99, max, .. } = self.spread();
        ShortSpread { p50, p99, max }
    }

    pub(super) fn median_max(&self) -> MedianMax {
        let Spread { p50, max, .. } = self.spread();
        MedianMax { p50, max }
    }

    /// The sum of two tables of one range.
    pub(super) fn together(mut self, other: Self) -> Self {
        for (row, place, values) in other.counts() {
            self.add(row, place, values);
        }
        self.max = self.max.max(other.max);
        self.is_finite &= other.is_finite;
        self
    }

    pub(super) fn buckets(&self) -> Buckets {
        let counts = self.counts();
        counts
            .map(|(row, place, count)| (largest(row, place), u64::from(count)))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_lies_in_a_place_of_a_thousandth_and_places_ascend_with_values() {
        let mut last = place_of(0);
        assert_eq!(last, (0, 0));
        for octave in 0..50 {
            for part in 0..3000 {
                let begin = 1u64 << octave;
                let steps = begin + begin * part / 3000;
                let (row, place) = place_of(steps);
                let is_after = place < ROW && (row, place) >= last;
                assert!(is_after, "{steps}: {row}, {place}");
                let end = largest(row, place);
                assert!(
                    steps <= end && end - steps <= steps >> ROW_BITS,
                    "{steps}: up to {end}"
                );
                assert_eq!(place_of(end), (row, place));
                assert_ne!(place_of(end + 1), (row, place));
                last = (row, place);
            }
        }
        assert_eq!(place_of(1 << 50), (41, 0));
    }

    #[test]
    fn only_octaves_that_were_met_take_memory_and_a_value_beyond_the_range_is_its_end() {
        let rows = |table: &Fixed| table.rows.iter().flatten().count();
        let mut table = Fixed::new(1.0, 32);
        assert_eq!((rows(&table), table.quantile(0.5)), (0, 0.0));
        table.push(1000.0);
        assert_eq!((rows(&table), table.quantile(0.5)), (1, 1000.0));
        for _ in 0..9 {
            table.push(1e30);
        }
        assert_eq!(rows(&table), 2);
        let bound = 2f64.powi(32);
        assert!((table.quantile(0.9) - bound).abs() < 1e-3 * bound);
        assert_eq!(table.spread().max, 1e30);
    }

    #[test]
    fn tables_with_other_octaves_are_added_up() {
        let of = |value: f64| {
            let mut table = Fixed::new(1.0, 32);
            table.push(value);
            table
        };
        for [a, b] in [[10.0, 5e8], [5e8, 10.0]] {
            let both = of(a).together(of(b));
            assert_eq!(both.quantile(0.5), 10.0);
            assert_eq!(both.spread().max, 5e8);
            assert_eq!(both.buckets().iter().map(|of| of.1).sum::<u64>(), 2);
        }
    }
}

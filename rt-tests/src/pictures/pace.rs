//! How much of a run is sent: less of a long one, so that its file stays bounded.

/// Bytes of space in a file at the most, before it is packed to less than half, and the time in
/// which half of it is filled, seconds: of a front of five thousand faces, half a megabyte, a run
/// of ten seconds has all pictures, one of an hour some thousand.
const FILE_BYTES: f64 = (512u32 << 20) as f64;
const HALF_FILE_S: f64 = 30.0;
/// Bytes of space a second for a viewer that listens, which forgets the oldest by itself: a front
/// of twenty thousand faces ten times a second.
const STREAM_BYTES_PER_S: f64 = (16u32 << 20) as f64;
/// Pictures of space a second at the most, and points of a curve.
const FRAMES_HZ: f64 = 20.0;
const POINTS_HZ: f64 = 100.0;
/// A point of a curve in a file stands for at least such a share of the time before it.
const POINT_SHARE: f64 = 1.0 / 2000.0;

/// Where a run is sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Medium {
    /// Into a file, all of it.
    File,
    /// To a viewer that listens.
    Stream,
}

/// When the next picture of space and the next point of the curves are due. All times count from
/// the first one shown: of a long run the recording has its last minutes only.
#[derive(Debug)]
pub struct Pace {
    medium: Medium,
    /// The first time shown, seconds of the run.
    first_s: Option<f64>,
    /// Seconds since then.
    next_frame_s: f64,
    next_point_s: f64,
    /// Bytes of space sent so far.
    bytes: f64,
    /// Pictures of space sent so far.
    pub frames: u64,
    /// Pictures of space left out so far for want of room.
    pub left_out: u64,
}

impl Pace {
    /// The pace of a medium.
    #[must_use]
    pub fn new(medium: Medium) -> Self {
        Self {
            medium,
            first_s: None,
            next_frame_s: 0.0,
            next_point_s: 0.0,
            bytes: 0.0,
            frames: 0,
            left_out: 0,
        }
    }

    /// Whether space is shown at this time of the run, seconds.
    pub fn is_frame_due(&mut self, seconds: f64) -> bool {
        let seconds = self.since_first(seconds);
        if seconds < self.next_frame_s {
            return false;
        }
        self.next_frame_s = seconds + 1.0 / FRAMES_HZ;
        let has_room = self.bytes <= self.allowed(seconds);
        self.left_out += u64::from(!has_room);
        has_room
    }

    /// Whether the curves get a point at this time of the run, seconds.
    pub fn is_point_due(&mut self, seconds: f64) -> bool {
        let seconds = self.since_first(seconds);
        if seconds < self.next_point_s {
            return false;
        }
        let share = match self.medium {
            Medium::File => POINT_SHARE,
            Medium::Stream => 0.0,
        };
        self.next_point_s = seconds + f64::max(1.0 / POINTS_HZ, share * seconds);
        true
    }

    /// Counts a picture of space of so many bytes.
    pub fn sent(&mut self, bytes: usize) {
        self.bytes += bytes as f64;
        self.frames += 1;
    }

    /// Seconds from the first time shown to this one.
    fn since_first(&mut self, seconds: f64) -> f64 {
        seconds - *self.first_s.get_or_insert(seconds)
    }

    /// Bytes that may be sent up to a time, seconds since the first one shown.
    fn allowed(&self, seconds: f64) -> f64 {
        match self.medium {
            Medium::File => FILE_BYTES * seconds / (seconds + HALF_FILE_S),
            Medium::Stream => STREAM_BYTES_PER_S * seconds,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_minutes_of_a_day_are_shown_as_closely_as_the_first() {
        const FRAME: usize = 500_000;
        const RATE_HZ: u64 = 1000;
        for begin in [0, 86_160] {
            let mut pace = Pace::new(Medium::File);
            let (mut points, mut last_frame_s) = (0u32, 0.0);
            for tick in begin * RATE_HZ..(begin + 240) * RATE_HZ {
                let seconds = tick as f64 / RATE_HZ as f64;
                points += u32::from(pace.is_point_due(seconds));
                if pace.is_frame_due(seconds) {
                    pace.sent(FRAME);
                    last_frame_s = seconds - begin as f64;
                }
            }
            assert!(points > 1000, "{points} points from {begin} s on");
            assert!(last_frame_s > 230.0, "{last_frame_s} s from {begin} s on");
        }
    }

    #[test]
    fn a_file_of_a_day_is_bounded_and_a_stream_goes_on() {
        const FRAME: usize = 2_000_000;
        const STEP_S: f64 = 0.05;
        for (medium, is_bounded) in [(Medium::File, true), (Medium::Stream, false)] {
            let mut pace = Pace::new(medium);
            let (mut points, mut seconds) = (0u32, 0.0);
            while seconds < 86_400.0 {
                if pace.is_frame_due(seconds) {
                    pace.sent(FRAME);
                }
                points += u32::from(pace.is_point_due(seconds));
                seconds += STEP_S;
            }
            assert!(pace.frames > 200 && pace.left_out > pace.frames);
            assert_eq!(pace.bytes <= FILE_BYTES + FRAME as f64, is_bounded);
            assert_eq!(points < 20_000, is_bounded, "{points}");
        }
    }
}

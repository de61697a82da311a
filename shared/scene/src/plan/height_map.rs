//! A height map: a picture whose brightness is height, with coarser levels (a mip map).

use glam::DVec2;
use std::io::{BufReader, Read, Seek};
use thiserror::Error;

/// Largest number of pixels of a picture.
const MAX_PIXELS: u64 = 1 << 24;

/// Heights from -1 (black) to 1 (white) on a periodic grid. Each level has half as many samples a
/// side as the one before, down to a single sample. A coarser level leaves out detail that the loop
/// cannot render.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct HeightMap {
    levels: Vec<Level>,
}

#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
struct Level {
    width: usize,
    height: usize,
    samples: Vec<f32>,
}

/// Errors of reading a height map.
#[derive(Debug, Error)]
pub enum HeightMapError {
    /// Not a readable PNG.
    #[error(transparent)]
    Png(#[from] png::DecodingError),
    /// Too many pixels.
    #[error("it has {0} pixels, more than {MAX_PIXELS}")]
    TooLarge(u64),
}

/// Height and slope at a point.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Height {
    /// -1 to 1.
    pub height: f64,
    /// Derivative of the height, per width and height of the picture.
    pub slope: DVec2,
}

impl HeightMap {
    /// Reads a PNG picture; colours become their brightness.
    ///
    /// # Errors
    /// When the data is no PNG, is damaged, or has too many pixels.
    pub fn read_png(from: impl Read + Seek) -> Result<Self, HeightMapError> {
        let mut decoder = png::Decoder::new(BufReader::new(from));
        decoder.set_transformations(png::Transformations::EXPAND);
        let mut reader = decoder.read_info()?;
        let (width, height) = reader.info().size();
        let pixels = u64::from(width) * u64::from(height);
        let bytes = reader
            .output_buffer_size()
            .filter(|_| pixels <= MAX_PIXELS)
            .ok_or(HeightMapError::TooLarge(pixels))?;
        let mut buffer = vec![0; bytes];
        let frame = reader.next_frame(&mut buffer)?;
        let channels = frame.color_type.samples();
        let value = |sample: &[u8]| match *sample {
            [high, low] => f32::from(u16::from_be_bytes([high, low])) / 65535.0,
            [one] => f32::from(one) / 255.0,
            _ => 0.0,
        };
        let depth = if frame.bit_depth == png::BitDepth::Sixteen {
            2
        } else {
            1
        };
        let brightness = |pixel: &[u8]| {
            let mut of = pixel.chunks_exact(depth).map(value);
            let mut next = || of.next().unwrap_or(0.0);
            match channels {
                // Luma of ITU-R BT.601.
                3 | 4 => 0.299 * next() + 0.587 * next() + 0.114 * next(),
                _ => next(),
            }
        };
        let rows = buffer.chunks_exact(frame.line_size).take(height as usize);
        let samples = rows
            .flat_map(|row| {
                row.chunks_exact(channels * depth)
                    .take(width as usize)
                    .map(|pixel| 2.0 * brightness(pixel) - 1.0)
            })
            .collect();
        Ok(Self::new(width as usize, height as usize, samples))
    }

    /// Map of samples from -1 to 1, row by row.
    ///
    /// # Panics
    /// When there are no samples, or not `width` times `height`.
    #[must_use]
    pub fn new(width: usize, height: usize, samples: Vec<f32>) -> Self {
        assert!(!samples.is_empty() && samples.len() == width * height);
        let mut levels = vec![Level {
            width,
            height,
            samples,
        }];
        while let Some(coarser) = levels.last().and_then(Level::halved) {
            levels.push(coarser);
        }
        Self { levels }
    }

    /// Width over height.
    #[must_use]
    pub fn aspect(&self) -> f64 {
        self.levels[0].width as f64 / self.levels[0].height as f64
    }

    /// Samples across.
    #[must_use]
    pub fn width(&self) -> usize {
        self.levels[0].width
    }

    /// Bound of the slope anywhere at any coarseness: of the relative height, per width of the
    /// picture. It is that of all levels: a coarser one may be the steepest, since half of an odd
    /// number of samples is rounded up, and so they are less than twice as far apart.
    #[must_use]
    pub fn steepest(&self) -> f64 {
        let aspect = self.aspect();
        let of = |level: &Level| {
            let (across, along) = (level.width as f64, level.height as f64 * aspect);
            level.steepest(DVec2::new(across, along))
        };
        self.levels.iter().map(of).fold(0.0, f64::max)
    }

    /// Bytes of all levels.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let of = |level: &Level| std::mem::size_of_val(&level.samples[..]);
        self.levels.iter().map(of).sum()
    }

    /// Height and slope at a point, 0 to 1 across the picture and periodic beyond.
    ///
    /// `coarseness` is the level: 0 for all samples, 1 for samples twice as far apart, and so on;
    /// fractions interpolate between two levels.
    #[must_use]
    pub fn at(&self, place: DVec2, coarseness: f64) -> Height {
        let last = self.levels.len() - 1;
        let coarseness = coarseness.clamp(0.0, last as f64);
        let finer = coarseness.floor();
        let share = coarseness - finer;
        let index = finer as usize;
        let a = self.levels[index].at(place);
        if share == 0.0 {
            return a;
        }
        let b = self.levels[(index + 1).min(last)].at(place);
        Height {
            height: a.height + share * (b.height - a.height),
            slope: a.slope.lerp(b.slope, share),
        }
    }
}

impl Level {
    /// Means of two by two samples; `None` for a single sample.
    fn halved(&self) -> Option<Self> {
        if self.samples.len() == 1 {
            return None;
        }
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let of = |x: usize, y: usize| self.samples[(y % self.height) * self.width + x % self.width];
        let samples = (0..width * height).map(|k| {
            let (x, y) = (2 * (k % width), 2 * (k / width));
            0.25 * (of(x, y) + of(x + 1, y) + of(x, y + 1) + of(x + 1, y + 1))
        });
        Some(Self {
            width,
            height,
            samples: samples.collect(),
        })
    }

    /// Bound of the slope, given the slopes of a difference of 1 between two samples along each
    /// side.
    fn steepest(&self, slope_of_one: DVec2) -> f64 {
        let (width, height) = (self.width, self.height);
        let around = |k: usize, count: usize| [(k + count - 1) % count, k, (k + 1) % count];
        let mut squared = 0.0f64;
        for y in 0..height {
            let rows = around(y, height).map(|row| &self.samples[row * width..(row + 1) * width]);
            for x in 0..width {
                let columns = around(x, width);
                let samples = rows.map(|row| columns.map(|column| f64::from(row[column])));
                let slopes = control_slopes(samples).map(|slope| slope * slope_of_one);
                let squares = slopes.map(DVec2::length_squared);
                squared = squares.into_iter().fold(squared, f64::max);
            }
        }
        squared.sqrt()
    }

    /// Quadratic spline over three by three samples; height and slope are continuous.
    fn at(&self, place: DVec2) -> Height {
        let size = DVec2::new(self.width as f64, self.height as f64);
        let place = place * size;
        if !place.is_finite() {
            return Height::default();
        }
        // Samples are in the middle of their cells.
        let cell = place.floor();
        let within = place - cell - 0.5;
        let column = |offset: i64| (cell.x as i64 + offset).rem_euclid(self.width as i64) as usize;
        let row = |offset: i64| (cell.y as i64 + offset).rem_euclid(self.height as i64) as usize;
        let (wx, dx) = spline(within.x);
        let (wy, dy) = spline(within.y);
        let mut found = Height::default();
        for (j, (wy, dy)) in wy.into_iter().zip(dy).enumerate() {
            let start = row(j as i64 - 1) * self.width;
            for (i, (wx, dx)) in wx.into_iter().zip(dx).enumerate() {
                let sample = f64::from(self.samples[start + column(i as i64 - 1)]);
                found.height += sample * wx * wy;
                found.slope += sample * size * DVec2::new(dx * wy, wx * dy);
            }
        }
        found
    }
}

/// Quadratic B-spline: weights of the samples before, at and after the nearest one, and their
/// derivatives, at `t` from the nearest sample (-0.5 to 0.5).
fn spline(t: f64) -> ([f64; 3], [f64; 3]) {
    let (before, after) = (0.5 - t, 0.5 + t);
    (
        [0.5 * before * before, 0.75 - t * t, 0.5 * after * after],
        [-before, -2.0 * t, after],
    )
}

/// The spline's slope over the cell of the middle one of three by three samples, as the control
/// points of a Bézier patch, per distance of two samples: every slope there is a mean of these.
fn control_slopes(samples: [[f64; 3]; 3]) -> [DVec2; 9] {
    let heights = |[a, b, c]: [f64; 3]| [0.5 * (a + b), b, 0.5 * (b + c)];
    let differences = |[a, b, c]: [f64; 3]| [b - a, 0.5 * (c - a), c - b];
    let across = transposed(samples.map(differences)).map(heights);
    let along = transposed(transposed(samples).map(differences)).map(heights);
    std::array::from_fn(|k| DVec2::new(across[k % 3][k / 3], along[k / 3][k % 3]))
}

fn transposed(rows: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    std::array::from_fn(|column| rows.map(|row| row[column]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn waves(n: usize) -> HeightMap {
        let turn = std::f64::consts::TAU / n as f64;
        let sample = |k: usize| ((k % n) as f64 * turn).sin() as f32;
        HeightMap::new(n, n, (0..n * n).map(sample).collect())
    }

    #[test]
    fn the_slope_is_that_of_the_height_and_the_picture_repeats() {
        let map = waves(16);
        for k in 0..200 {
            let place = DVec2::new(0.013 * f64::from(k) - 1.0, 0.4);
            for coarseness in [0.0, 0.7, 2.3] {
                let h = 1e-6;
                let here = map.at(place, coarseness);
                let step = |d: DVec2| {
                    let (a, b) = (map.at(place + d, coarseness), map.at(place - d, coarseness));
                    (a.height - b.height) / (2.0 * h)
                };
                assert!((step(DVec2::X * h) - here.slope.x).abs() < 1e-3, "{place}");
                assert!((step(DVec2::Y * h) - here.slope.y).abs() < 1e-3, "{place}");
                let again = map.at(place + DVec2::new(3.0, -2.0), coarseness);
                assert!((again.height - here.height).abs() < 1e-9);
            }
        }
    }

    /// The steepest slope that is found, of all coarsenesses.
    fn found(map: &HeightMap) -> f64 {
        let slopes = (0..13_000).map(|k| {
            let place = DVec2::new(0.013 * f64::from(k), 0.0071 * f64::from(k));
            let slope = map.at(place, 0.5 * f64::from(k % 13)).slope;
            // Per width of the picture along both sides: its pixels are square.
            DVec2::new(slope.x, slope.y * map.aspect()).length()
        });
        slopes.fold(0.0, f64::max)
    }

    #[test]
    fn no_slope_is_above_the_bound_and_that_of_waves_is_near_it() {
        // Pseudorandom heights, of odd sizes too, and waves, whose slope is a turn.
        let random = |n: usize| ((n * 7919 + 13) % 101) as f32 / 50.0 - 1.0;
        for (width, height) in [(16, 16), (9, 7), (32, 5), (1, 3)] {
            let map = HeightMap::new(width, height, (0..width * height).map(random).collect());
            let (found, most) = (found(&map), map.steepest());
            assert!(found <= most * (1.0 + 1e-6), "{found} {most}");
        }
        let most = waves(64).steepest() / std::f64::consts::TAU;
        assert!((0.99..1.01).contains(&most), "{most}");
    }

    #[test]
    fn a_coarse_level_that_is_steeper_than_the_finest_is_within_the_bound() {
        // Triangular waves along one side; each side is halved by its own number of samples.
        let wave = |k: usize, count: usize| 1.0 - (2.0 * k as f32 / count as f32 - 1.0).abs();
        for (width, height) in [(7, 7), (9, 9), (17, 17), (33, 33), (16, 33), (64, 9)] {
            let places = || 0..width * height;
            let along = places().map(|k| wave(k / width, height));
            let across = places().map(|k| wave(k % width, width));
            for samples in [along.collect(), across.collect()] {
                let map = HeightMap::new(width, height, samples);
                let (found, most) = (found(&map), map.steepest());
                assert!(
                    found <= most * (1.0 + 1e-6),
                    "{width} {height}: {found} {most}"
                );
                // The bound is that of the waves, not more.
                assert!(found > 0.95 * most, "{width} {height}: {found} {most}");
            }
        }
    }

    #[test]
    fn coarser_levels_lose_what_is_fine_and_no_mean() {
        let map = waves(64);
        let size = |coarseness| {
            (0..100)
                .map(|k| {
                    map.at(DVec2::new(0.01 * f64::from(k), 0.5), coarseness)
                        .height
                })
                .fold(0.0f64, |max, h| max.max(h.abs()))
        };
        assert!(size(0.0) > 0.95, "{}", size(0.0));
        assert!(size(6.0) < 1e-6, "{}", size(6.0));
    }

    #[test]
    fn a_png_is_read_back_at_both_depths_and_damage_is_an_error() {
        for (depth, bytes) in [
            (png::BitDepth::Eight, vec![0u8, 255, 128, 64]),
            (png::BitDepth::Sixteen, vec![0, 0, 255, 255, 128, 0, 64, 0]),
        ] {
            let mut file = Vec::new();
            let mut encoder = png::Encoder::new(&mut file, 2, 2);
            encoder.set_color(png::ColorType::Grayscale);
            encoder.set_depth(depth);
            let mut writer = encoder.write_header().unwrap();
            writer.write_image_data(&bytes).unwrap();
            drop(writer);
            let map = HeightMap::read_png(std::io::Cursor::new(&file)).unwrap();
            let expected = [-1.0, 1.0, 0.0, -0.5];
            for (sample, expected) in map.levels[0].samples.iter().zip(expected) {
                assert!((sample - expected).abs() < 0.01, "{sample} {expected}");
            }
            for cut in 0..file.len() {
                let read = HeightMap::read_png(std::io::Cursor::new(&file[..cut]));
                assert!(read.is_err() || read.is_ok_and(|read| read == map), "{cut}");
            }
        }
    }
}

//! PNG files and animations.

use crate::canvas::Canvas;
use png::{BitDepth, ColorType, Compression, Encoder, EncodingError, Filter};
use thiserror::Error;

/// Why a picture is no file.
#[derive(Debug, Error)]
pub enum PictureError {
    /// The encoder refused it.
    #[error("the picture cannot be encoded: {0}")]
    Png(#[from] EncodingError),
    /// An animation without a picture, or of pictures that are not all of one size.
    #[error("an animation needs a picture, and all of one size")]
    Sizes,
}

impl Canvas {
    /// The picture as a PNG file.
    ///
    /// # Errors
    /// When the encoder refuses it, for example a picture without a pixel.
    pub fn to_png(&self) -> Result<Vec<u8>, PictureError> {
        let mut bytes = Vec::new();
        let mut writer = encoder(&mut bytes, self).write_header()?;
        writer.write_image_data(self.bytes())?;
        writer.finish()?;
        Ok(bytes)
    }
}

/// Pictures as an animated PNG file that repeats, each shown for so many milliseconds.
///
/// # Errors
/// When there is none, or they are not of one size.
pub fn animation(pictures: &[Canvas], milliseconds: u16) -> Result<Vec<u8>, PictureError> {
    let first = pictures.first().ok_or(PictureError::Sizes)?;
    let is_same = |of: &Canvas| of.width() == first.width() && of.height() == first.height();
    if !pictures.iter().all(is_same) {
        return Err(PictureError::Sizes);
    }
    let mut bytes = Vec::new();
    let mut encoder = encoder(&mut bytes, first);
    let count = u32::try_from(pictures.len()).map_err(|_| PictureError::Sizes)?;
    encoder.set_animated(count, 0)?;
    encoder.set_frame_delay(milliseconds, 1000)?;
    let mut writer = encoder.write_header()?;
    for picture in pictures {
        writer.write_image_data(picture.bytes())?;
    }
    writer.finish()?;
    Ok(bytes)
}

fn encoder<'a>(bytes: &'a mut Vec<u8>, picture: &Canvas) -> Encoder<'a, &'a mut Vec<u8>> {
    let mut encoder = Encoder::new(bytes, picture.width(), picture.height());
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_compression(Compression::High);
    // Faces of one colour: a filter makes them no smaller.
    encoder.set_filter(Filter::NoFilter);
    encoder
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::WHITE;

    #[test]
    fn files_are_read_back() {
        let mut second = Canvas::new(5, 4, WHITE);
        second.set(4, 3, [1, 2, 3]);
        let pictures = [Canvas::new(5, 4, [7; 3]), second];
        let bytes = animation(&pictures, 40).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes))
            .read_info()
            .unwrap();
        let animated = reader.info().animation_control().unwrap();
        assert_eq!(animated.num_frames, 2);
        for picture in &pictures {
            let mut frame = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut frame).unwrap();
            assert_eq!(&frame, picture.bytes());
        }
    }

    #[test]
    fn an_animation_has_pictures_of_one_size() {
        let sizes = [Canvas::new(1, 1, WHITE), Canvas::new(1, 2, WHITE)];
        assert!(matches!(animation(&sizes, 40), Err(PictureError::Sizes)));
        assert!(matches!(animation(&[], 40), Err(PictureError::Sizes)));
    }
}

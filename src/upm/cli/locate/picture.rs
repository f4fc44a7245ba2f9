//! Reads picture files as gray frames.

use std::fmt::Display;
use std::fs::File;
use std::io::{self, Cursor, Read};
use std::path::Path;

use image::metadata::Orientation;
use image::{ColorType, DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};

use crate::cli::output::Failure;
use upm_core::signal::Frame;
use upm_runner::config::reason;

/// Largest number of pixels: the limit of the table search.
const MOST_PIXELS: u64 = 64_000_000;
/// Largest size of a file, and of its decoded pixels, bytes.
const MOST_BYTES: u64 = 512 << 20;

/// Markers of JPEG files (ITU-T T.81, Annex B).
const START_OF_SCAN: u8 = 0xDA;
const END_OF_IMAGE: [u8; 2] = [0xFF, 0xD9];

/// A decoded picture, as it is searched.
#[derive(Debug)]
pub(super) struct InputPicture {
    pub frame: Frame,
    /// Bits of a pixel value that are used; `None` for a picture of 8 bits.
    pub bits: Option<u32>,
    /// Focal length that the file states, in longer sides of the picture.
    pub focal_sides: Option<f64>,
}

pub(super) fn read(file: &Path) -> Result<InputPicture, Failure> {
    let (path, wanted) = (file.display(), "expected a picture (PNG, JPEG, BMP, PNM or TIFF)");
    let refuse = |found: String| Failure::bad_input(format!("{path}: {wanted}, found {found}"));
    let unread = |error: io::Error| Failure::bad_input(format!("cannot read {path}: {}; {wanted}", reason(&error)));
    let mut bytes = Vec::new();
    let opened = File::open(file).map_err(unread)?;
    opened.take(MOST_BYTES + 1).read_to_end(&mut bytes).map_err(unread)?;
    if bytes.len() as u64 > MOST_BYTES {
        return Err(refuse(format!("a file larger than {} MB", MOST_BYTES >> 20)));
    }
    decode(&bytes).map_err(refuse)
}

/// Decodes `bytes` in the orientation in which the picture is to be viewed; the error says what the bytes hold instead.
/// A picture that is too large is refused before it is decoded.
pub(super) fn decode(bytes: &[u8]) -> Result<InputPicture, String> {
    let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(no_picture)?;
    let format = reader.format().filter(ImageFormat::reading_enabled);
    let format = format.ok_or_else(|| unreadable(bytes))?;
    if format == ImageFormat::Jpeg && !is_whole_jpeg(bytes) {
        return Err("a JPEG picture that ends too early".into());
    }
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(MOST_BYTES);
    reader.limits(limits);
    let mut decoder = reader.into_decoder().map_err(no_picture)?;
    let (width, height) = decoder.dimensions();
    if u64::from(width) * u64::from(height) > MOST_PIXELS {
        return Err(format!("{width}x{height} px, more than {} million pixels", MOST_PIXELS / 1_000_000));
    }
    if matches!(decoder.color_type(), ColorType::Rgb32F | ColorType::Rgba32F) {
        return Err("levels of 32 bits, more than 16".into());
    }
    let focal_sides = decoder.exif_metadata().ok().flatten().and_then(|exif| focal_sides(&exif));
    let orientation = decoder.orientation().unwrap_or(Orientation::NoTransforms);
    let mut picture = DynamicImage::from_decoder(decoder).map_err(no_picture)?;
    picture.apply_orientation(orientation);
    let (frame, bits) = gray(picture)?;
    Ok(InputPicture { frame, bits, focal_sides })
}

/// True when the JPEG picture that `bytes` begin with is not truncated: the decoder fills what is missing with gray and
/// reports no error. Segments before the first scan may hold a preview picture with an end of its own.
fn is_whole_jpeg(bytes: &[u8]) -> bool {
    let mut rest = bytes.get(2..).unwrap_or_default();
    while let Some(&[first, marker, high, low]) = rest.first_chunk() {
        let length = match (first, marker) {
            (0xFF, START_OF_SCAN) => return rest.windows(2).any(|pair| pair == END_OF_IMAGE),
            // stray and filling bytes between segments, which decoders skip
            (..0xFF, _) | (0xFF, 0xFF) => 1,
            (0xFF, _) => 2 + usize::from(u16::from_be_bytes([high, low])),
        };
        rest = rest.get(length..).unwrap_or_default();
    }
    false
}

fn no_picture(error: impl Display) -> String {
    format!("no picture that can be read ({error})")
}

/// Description of bytes that are no picture that can be read.
fn unreadable(bytes: &[u8]) -> String {
    match image::guess_format(bytes) {
        _ if bytes.is_empty() => "an empty file".to_owned(),
        _ if bytes.get(4..8) == Some(b"ftyp".as_slice()) => "an AVIF or HEIC picture".to_owned(),
        Ok(format) => format!("a {format:?} picture"),
        Err(_) => "none of these".to_owned(),
    }
}

/// Focal length in longer sides of the picture, by the Exif entry of the equivalent on 35 mm film (36 mm wide).
fn focal_sides(exif: &[u8]) -> Option<f64> {
    const FILM_MM: f64 = 36.0;
    let exif = exif::Reader::new().read_raw(exif.to_vec()).ok()?;
    let focal_mm = exif.get_field(exif::Tag::FocalLengthIn35mmFilm, exif::In::PRIMARY)?.value.get_uint(0)?;
    Some(f64::from(focal_mm) / FILM_MM).filter(|sides| (0.2..20.0).contains(sides))
}

/// Luminance in 8 bits, with the bits used of more; transparent pixels become black, like the ground around a plate.
fn gray(image: DynamicImage) -> Result<(Frame, Option<u32>), String> {
    let (width, height, color) = (image.width() as usize, image.height() as usize, image.color());
    let (pixels, bits) = match color {
        ColorType::L8 | ColorType::Rgb8 => (image.into_luma8().into_raw(), None),
        ColorType::La8 | ColorType::Rgba8 => {
            (over_black(image).iter().map(|&level| (level / 257) as u8).collect(), None)
        }
        ColorType::L16 | ColorType::Rgb16 | ColorType::La16 | ColorType::Rgba16 => narrowed(&over_black(image)),
        _ => return Err(format!("{color:?} pixels")),
    };
    let frame = Frame::of_picture(width, height, pixels).ok_or("fewer pixels than the picture has room for")?;
    Ok((frame, bits))
}

/// Levels of 16 bits, composed over black.
fn over_black(image: DynamicImage) -> Vec<u16> {
    let full = u32::from(u16::MAX);
    let composed = |[level, opacity]: [u16; 2]| ((u32::from(level) * u32::from(opacity) + full / 2) / full) as u16;
    image.into_luma_alpha16().pixels().map(|pixel| composed(pixel.0)).collect()
}

/// 16-bit levels in 8 bits. Cameras with 10 or 12 bits often use the low bits only, so white is the largest number of
/// the fewest bits, 8, 10, 12, 14 or 16, that hold the brightest pixel: the second value.
fn narrowed(levels: &[u16]) -> (Vec<u8>, Option<u32>) {
    let brightest = levels.iter().copied().max().unwrap_or(0);
    let bits = [8, 10, 12, 14].into_iter().find(|&bits| brightest >> bits == 0).unwrap_or(16);
    let white = (1u32 << bits) - 1;
    let narrow = |&level: &u16| ((u32::from(level) * 255 + white / 2) / white) as u8;
    (levels.iter().map(narrow).collect(), Some(bits))
}

#[cfg(test)]
mod tests;

//! Encoding of pictures that keeps recordings small.

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, GrayImage, ImageEncoder, RgbImage};
use re_sdk_types::archetypes::EncodedImage;

use upm_core::signal::Frame;

const JPEG_QUALITY: u8 = 75;

/// `frame` at full size as JPEG.
pub(super) fn jpeg(frame: &Frame) -> Result<EncodedImage, String> {
    encode_jpeg(&frame.pixels, frame.width, frame.height)
}

/// `frame` at half its size, each pixel the mean of four, as JPEG. `halved` is a scratch buffer.
pub(super) fn jpeg_at_half_size(frame: &Frame, halved: &mut Vec<u8>) -> Result<EncodedImage, String> {
    let (width, height) = (frame.width / 2, frame.height / 2);
    let mut columns: Vec<u16> = Vec::with_capacity(frame.width);
    halved.clear();
    for y in 0..height {
        let (top, bottom) = (frame.row(2 * y), frame.row(2 * y + 1));
        columns.clear();
        columns.extend(top.iter().zip(bottom).map(|(&a, &b)| u16::from(a) + u16::from(b)));
        halved.extend(columns.as_chunks::<2>().0.iter().map(|[left, right]| ((left + right + 2) / 4) as u8));
    }
    encode_jpeg(halved, width, height)
}

fn encode_jpeg(pixels: &[u8], width: usize, height: usize) -> Result<EncodedImage, String> {
    let (Ok(w), Ok(h)) = (u16::try_from(width), u16::try_from(height)) else {
        return Err(format!("a picture of {width} × {height} px is too large for JPEG"));
    };
    let mut bytes = Vec::with_capacity(pixels.len() / 8);
    jpeg_encoder::Encoder::new(&mut bytes, JPEG_QUALITY)
        .encode(pixels, w, h, jpeg_encoder::ColorType::Luma)
        .map_err(|e| e.to_string())?;
    Ok(EncodedImage::new(bytes).with_media_type("image/jpeg"))
}

/// A gray picture as PNG.
pub(super) fn gray_png(map: &GrayImage) -> Result<EncodedImage, String> {
    encode_png(map.as_raw(), map.dimensions(), ExtendedColorType::L8)
}

/// A colour picture as PNG.
pub(super) fn color_png(map: &RgbImage) -> Result<EncodedImage, String> {
    encode_png(map.as_raw(), map.dimensions(), ExtendedColorType::Rgb8)
}

fn encode_png(pixels: &[u8], (width, height): (u32, u32), color: ExtendedColorType) -> Result<EncodedImage, String> {
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Sub)
        .write_image(pixels, width, height, color)
        .map_err(|e| e.to_string())?;
    Ok(EncodedImage::new(bytes).with_media_type("image/png"))
}

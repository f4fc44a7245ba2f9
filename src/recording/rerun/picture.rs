//! Pictures small enough for a recording.

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use rerun::EncodedImage;

use crate::signal::Frame;
use crate::vision::Plane;

const JPEG_QUALITY: u8 = 75;

/// `frame` at full size as JPEG.
pub(super) fn jpeg(frame: &Frame) -> Result<EncodedImage, String> {
    encode_jpeg(&frame.pixels, frame.width, frame.height)
}

/// `frame` at half its size, each pixel the mean of four, as JPEG. `halved` is working space.
pub(super) fn jpeg_at_half_size(frame: &Frame, halved: &mut Vec<u8>) -> Result<EncodedImage, String> {
    let (width, height) = (frame.width / 2, frame.height / 2);
    halved.clear();
    for y in 0..height {
        let (top, bottom) = (frame.row(2 * y), frame.row(2 * y + 1));
        halved.extend(top.chunks_exact(2).zip(bottom.chunks_exact(2)).map(|(a, b)| {
            let sum: u16 = a.iter().chain(b).map(|&level| u16::from(level)).sum();
            ((sum + 2) / 4) as u8
        }));
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

/// The largest value of every cell of so many columns and rows, so that thin lines and sharp peaks survive shrinking.
pub(super) fn pooled(plane: &Plane, [columns, rows]: [usize; 2]) -> Plane {
    let (columns, rows) = (columns.max(1), rows.max(1));
    let (width, height) = (plane.width.div_ceil(columns), plane.height.div_ceil(rows));
    let mut values = vec![0.0_f32; width * height];
    for (y, row) in plane.values.chunks_exact(plane.width.max(1)).take(plane.height).enumerate() {
        let out = &mut values[y / rows * width..][..width];
        for (cell, inside) in out.iter_mut().zip(row.chunks(columns)) {
            *cell = inside.iter().copied().fold(*cell, f32::max);
        }
    }
    Plane { width, height, values }
}

/// Values from 0 to `top` as shades of gray.
pub(super) fn gray_png(plane: &Plane, top: f32) -> Result<EncodedImage, String> {
    let pixels: Vec<u8> = plane.values.iter().map(|&value| (255.0 * share(value, top)) as u8).collect();
    encode_png(&pixels, plane, ExtendedColorType::L8)
}

/// Values from 0 to `top` from black over red and yellow to white.
pub(super) fn heat_png(plane: &Plane, top: f32) -> Result<EncodedImage, String> {
    let pixels: Vec<u8> = plane.values.iter().flat_map(|&value| heat(share(value, top))).collect();
    encode_png(&pixels, plane, ExtendedColorType::Rgb8)
}

fn share(value: f32, top: f32) -> f32 {
    if top > 0.0 { (value / top).clamp(0.0, 1.0) } else { 0.0 }
}

/// Straight between five colours of matplotlib's `inferno`.
fn heat(share: f32) -> [u8; 3] {
    const STOPS: [[f32; 3]; 5] =
        [[0.0, 0.0, 4.0], [87.0, 16.0, 110.0], [188.0, 55.0, 84.0], [249.0, 142.0, 9.0], [252.0, 255.0, 164.0]];
    let place = share * 4.0;
    let stop = (place as usize).min(3);
    let t = place - stop as f32;
    std::array::from_fn(|c| (STOPS[stop][c] * (1.0 - t) + STOPS[stop + 1][c] * t) as u8)
}

fn encode_png(pixels: &[u8], plane: &Plane, color: ExtendedColorType) -> Result<EncodedImage, String> {
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Sub)
        .write_image(pixels, plane.width as u32, plane.height as u32, color)
        .map_err(|e| e.to_string())?;
    Ok(EncodedImage::new(bytes).with_media_type("image/png"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pooling_keeps_the_peak_of_every_cell() {
        let plane = Plane { width: 5, height: 3, values: (0..15).map(|i| i as f32).collect() };
        let small = pooled(&plane, [2, 2]);
        assert_eq!((small.width, small.height), (3, 2));
        assert_eq!(small.values, [6.0, 8.0, 9.0, 11.0, 13.0, 14.0]);
    }

    #[test]
    fn heat_runs_from_black_to_white() {
        assert_eq!(heat(0.0), [0, 0, 4]);
        assert_eq!(heat(0.5), [188, 55, 84]);
        assert_eq!(heat(1.0), [252, 255, 164]);
        assert_eq!(share(1.0, 0.0), 0.0);
    }
}

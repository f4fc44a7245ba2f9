//! Encoding of frames that keeps recordings small.

use re_sdk_types::archetypes::EncodedImage;

use upm_core::signal::Frame;

const JPEG_QUALITY: u8 = 75;

/// `frame` at half its size, each pixel the mean of four, as JPEG.
pub(super) fn jpeg_at_half_size(frame: &Frame) -> Result<EncodedImage, String> {
    let (width, height) = (frame.width / 2, frame.height / 2);
    let mut halved = Vec::with_capacity(width * height);
    let mut columns: Vec<u16> = Vec::with_capacity(frame.width);
    for y in 0..height {
        let (top, bottom) = (frame.row(2 * y), frame.row(2 * y + 1));
        columns.clear();
        columns.extend(top.iter().zip(bottom).map(|(&a, &b)| u16::from(a) + u16::from(b)));
        halved.extend(columns.as_chunks::<2>().0.iter().map(|[left, right]| ((left + right + 2) / 4) as u8));
    }
    let (Ok(w), Ok(h)) = (u16::try_from(width), u16::try_from(height)) else {
        return Err(format!("a picture of {width} × {height} px is too large for JPEG"));
    };
    let mut bytes = Vec::with_capacity(halved.len() / 8);
    jpeg_encoder::Encoder::new(&mut bytes, JPEG_QUALITY)
        .encode(&halved, w, h, jpeg_encoder::ColorType::Luma)
        .map_err(|e| e.to_string())?;
    Ok(EncodedImage::new(bytes).with_media_type("image/jpeg"))
}

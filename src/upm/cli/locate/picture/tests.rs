use image::codecs::jpeg::JpegEncoder;
use image::codecs::pnm::{PnmEncoder, PnmSubtype, SampleEncoding};
use image::{DynamicImage, ExtendedColorType, GrayImage, ImageEncoder, ImageFormat, Luma};
use proptest::prelude::*;

use super::*;

const SIZE: [u32; 2] = [24, 17];

fn level(x: u32, y: u32) -> u8 {
    (9 * x + 2 * y) as u8
}

fn ramp() -> DynamicImage {
    DynamicImage::ImageLuma8(GrayImage::from_fn(SIZE[0], SIZE[1], |x, y| Luma([level(x, y)])))
}

fn levels() -> Vec<u8> {
    (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| level(x, y))).collect()
}

fn written(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

/// One file of each kind of picture, all of the same ramp.
fn files() -> Vec<Vec<u8>> {
    let ramp = ramp();
    let mut files = Vec::new();
    for format in [ImageFormat::Png, ImageFormat::Tiff, ImageFormat::Pnm] {
        for image in [ramp.clone(), ramp.to_rgb8().into(), ramp.to_luma16().into(), ramp.to_rgb16().into()] {
            files.push(written(&image, format));
        }
    }
    files.push(written(&ramp, ImageFormat::Bmp));
    for format in [ImageFormat::Png, ImageFormat::Tiff] {
        for image in [DynamicImage::from(ramp.to_rgba8()), ramp.to_rgba16().into()] {
            files.push(written(&image, format));
        }
    }
    for image in [DynamicImage::from(ramp.to_luma_alpha8()), ramp.to_luma_alpha16().into()] {
        files.push(written(&image, ImageFormat::Png));
    }
    for subtype in [PnmSubtype::Graymap(SampleEncoding::Ascii), PnmSubtype::ArbitraryMap] {
        let mut bytes = Vec::new();
        let encoder = PnmEncoder::new(&mut bytes).with_subtype(subtype);
        encoder.write_image(ramp.as_bytes(), SIZE[0], SIZE[1], ExtendedColorType::L8).unwrap();
        files.push(bytes);
    }
    files.extend([written(&ramp, ImageFormat::Jpeg), written(&ramp.to_rgb8().into(), ImageFormat::Jpeg)]);
    files
}

#[test]
fn every_kind_of_file_shows_the_same_levels() {
    for file in files() {
        let InputPicture { frame, .. } = decode(&file).unwrap();
        assert_eq!([frame.width, frame.height], SIZE.map(|side| side as usize));
        let worst = frame.pixels.iter().zip(levels()).map(|(&a, b)| a.abs_diff(b)).max().unwrap();
        let lossy = file.starts_with(&[0xFF, 0xD8]);
        assert!(worst <= if lossy { 5 } else { 1 }, "off by {worst}: {:?}", &file[..8]);
    }
}

/// A JPEG file with an Exif segment that sets the orientation.
fn turned(orientation: u8) -> Vec<u8> {
    let mut file = Vec::new();
    JpegEncoder::new_with_quality(&mut file, 100).encode_image(&ramp()).unwrap();
    let tag = [0x01, 0x12, 0, 3, 0, 0, 0, 1, 0, orientation, 0, 0];
    let exif = [b"Exif\0\0MM\0\x2a\0\0\0\x08\0\x01".as_slice(), &tag, &[0; 4]].concat();
    let length = (exif.len() as u16 + 2).to_be_bytes();
    [&file[..2], &[0xFF, 0xE1], &length, &exif, &file[2..]].concat()
}

#[test]
fn a_turned_photograph_is_turned_back() {
    let frame = decode(&turned(1)).unwrap().frame;
    assert_eq!([frame.width, frame.height], [24, 17]);
    // orientation 6: the first row of the file is the right-hand side, its first column the top
    let frame = decode(&turned(6)).unwrap().frame;
    assert_eq!([frame.width, frame.height], [17, 24]);
    for (x, y) in [(0, 0), (5, 3), (23, 16)] {
        let seen = frame.row(x as usize)[16 - y as usize];
        assert!(seen.abs_diff(level(x, y)) <= 4, "({x}, {y}): {seen}");
    }
}

#[test]
fn exif_states_the_focal_length() {
    let directory = |tag: &[u8], value: &[u8]| [&[0, 1], tag, value, &[0; 4]].concat();
    let first = directory(&[0x87, 0x69, 0, 4, 0, 0, 0, 1], &[0, 0, 0, 26]);
    let second = directory(&[0xA4, 0x05, 0, 3, 0, 0, 0, 1], &[0, 27, 0, 0]);
    let exif = [b"MM\0\x2a\0\0\0\x08".as_slice(), &first, &second].concat();
    assert_eq!(focal_sides(&exif), Some(0.75));
    assert_eq!(focal_sides(&exif[..20]), None);
}

#[test]
fn a_file_cut_short_is_refused() {
    for file in files() {
        // decoders need neither the last chunk of a PNG nor the last digits of a text picture
        let needless = if file.starts_with(b"\x89PNG") { 12 } else { 4 };
        let least = file.len() - needless;
        for length in (0..least).step_by(7).chain([least]) {
            assert!(decode(&file[..length]).is_err(), "{length} of {} bytes: {:?}", file.len(), &file[..4]);
        }
    }
}

#[test]
fn a_whole_jpeg_is_known_by_its_markers() {
    let file = written(&ramp(), ImageFormat::Jpeg);
    assert!(is_whole_jpeg(&file));
    assert!(is_whole_jpeg(&[file.as_slice(), b"a film that \xFF\xDA comes after it"].concat()));
    assert!(is_whole_jpeg(&turned(3)));
    // an embedded preview inside a segment does not end the picture
    let comment = [0xFF, 0xFE, 0, 6, 0xFF, 0xD9, 0xFF, 0xD9].as_slice();
    let with_comment = [&file[..2], comment, &file[2..]].concat();
    assert!(is_whole_jpeg(&with_comment));
    assert!(!is_whole_jpeg(&with_comment[..with_comment.len() - 2]));
}

#[test]
fn unsupported_picture_is_reported_in_one_line() {
    let wide = format!("P5\n{} {}\n255\n", 20_000, 20_000);
    let float = DynamicImage::ImageRgb32F(ramp().to_rgb32f());
    let cases = [
        (b"".to_vec(), "an empty file"),
        (b"{\"name\": 1}".to_vec(), "none of these"),
        (b"GIF89a".to_vec(), "a Gif picture"),
        (wide.into_bytes(), "20000x20000 px, more than 64 million pixels"),
        (written(&float, ImageFormat::Tiff), "levels of 32 bits, more than 16"),
    ];
    for (bytes, reason) in cases {
        let found = decode(&bytes).unwrap_err();
        assert!(found.starts_with(reason) && found.lines().count() == 1, "{found}");
    }
}

proptest! {
    #[test]
    fn no_bytes_make_it_panic(
        which in any::<prop::sample::Index>(),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..12),
        cut in prop::option::of(any::<prop::sample::Index>()),
    ) {
        let files = files();
        let mut bytes = which.get(&files).clone();
        for (at, byte) in changes {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        match decode(&bytes) {
            Ok(InputPicture { frame, .. }) => prop_assert_eq!(frame.pixels.len(), frame.width * frame.height),
            Err(reason) => prop_assert!(!reason.is_empty()),
        }
    }
}

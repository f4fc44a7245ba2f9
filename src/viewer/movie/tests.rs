use std::io::{self, Write};
use std::sync::{Arc, Mutex};

use super::Movie;
use crate::MovieContext;
use upm_control::{EventFacts, EventLevel, Sink};
use upm_core::geometry::Vec2;
use upm_core::job::LayoutPart;
use upm_fixtures::synthetic_run::{RADIUS_M, SyntheticRun};

/// A file in memory, full after a number of bytes.
#[derive(Clone)]
struct Disk {
    bytes: Arc<Mutex<Vec<u8>>>,
    room: usize,
}

impl Write for Disk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut held = self.bytes.lock().unwrap();
        if held.len() + bytes.len() > self.room {
            return Err(io::ErrorKind::StorageFull.into());
        }
        held.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The movie of a made-up run on a disk of this size: three parts, of which the first jumps in the middle.
fn filmed(room: usize, film: impl FnOnce(&mut SyntheticRun, &mut Movie)) -> (io::Result<()>, Vec<u8>) {
    let mut run = SyntheticRun::new(3);
    let part = LayoutPart { id: "penny-1".into(), kind: "penny".into(), radius_m: RADIUS_M };
    // noise of 0 to 7
    let noise_sd = [2.3; 256];
    let (targets_m, bins, paths) = (vec![Vec2::new(0.0, 0.05)], Vec::new(), Vec::new());
    let disk = Disk { bytes: Arc::default(), room };
    let context = MovieContext { parts: vec![part], targets_m, bins, paths, noise_sd };
    let mut movie = Movie::into_file(Box::new(disk.clone()), context).unwrap();
    film(&mut run, &mut movie);
    movie.event(&EventFacts::note(run.now, EventLevel::Info, "the end"));
    let finished = movie.finish();
    (finished, disk.bytes.lock().unwrap().clone())
}

/// A third of a second at rest, a jump, and as long again.
fn jump(run: &mut SyntheticRun, movie: &mut Movie) {
    run.localise(movie);
    for k in 1..=40 {
        if k == 20 {
            run.parts_m[0].y -= 0.02;
        }
        if k % 4 == 0 {
            run.draw();
        }
        run.observe(movie, true, false);
    }
}

/// Size, and the pictures with their delays, of a GIF.
fn decoded(bytes: &[u8]) -> ([u16; 2], Vec<gif::Frame<'static>>) {
    let mut decoder = gif::DecodeOptions::new().read_info(bytes).unwrap();
    let size = [decoder.width(), decoder.height()];
    let pictures = std::iter::from_fn(|| decoder.read_next_frame().unwrap().cloned());
    (size, pictures.collect())
}

#[test]
fn pictures_change_where_parts_move_and_noise_is_left_out() {
    let (finished, bytes) = filmed(usize::MAX, jump);
    finished.unwrap();
    let (size, pictures) = decoded(&bytes);
    assert!(size.iter().all(|px| (300..=600).contains(px)), "{size:?}");
    assert_eq!([pictures[0].width, pictures[0].height], size);
    // every fourth frame from the one of the localisation on
    assert_eq!(pictures.len(), 11);
    let changed = |picture: &gif::Frame<'_>| picture.buffer.iter().filter(|&&index| index != 0).count();
    let counts: Vec<usize> = pictures.iter().map(changed).collect();
    // 4300 px to a metre, two of them to a pixel of the movie
    let part_px = std::f64::consts::PI * (RADIUS_M * 4300.0 / 2.0).powi(2);
    for (k, &count) in counts.iter().enumerate().skip(1) {
        // a part leaves one disc and covers another; of the noise less than a pixel in a thousand
        let expected = if k == 5 { 1.8 * part_px..2.3 * part_px } else { 0.0..1e-3 * counts[0] as f64 };
        assert!(expected.contains(&(count as f64)), "picture {k}: {counts:?}, a part has {part_px} px");
    }
    let delays_cs: u32 = pictures.iter().map(|picture| u32::from(picture.delay)).sum();
    // from 0.1 s on, which the first picture shows as well
    assert_eq!(delays_cs, 10 + (100 * 40_u32).div_ceil(60) + 200);
    assert!(pictures[1..10].iter().all(|picture| matches!(picture.delay, 6 | 7)), "true to 1/15 s");
    assert_eq!(filmed(usize::MAX, jump).1, bytes, "equal runs, equal bytes");
}

#[test]
fn full_disk_and_run_without_a_picture_are_reported_at_the_end() {
    let (finished, bytes) = filmed(1000, jump);
    assert_eq!((finished.unwrap_err().kind(), bytes.len() <= 1000), (io::ErrorKind::StorageFull, true));
    let (finished, bytes) = filmed(1000, |_, _| ());
    assert!(finished.unwrap_err().to_string().contains("no picture") && bytes.is_empty());
}

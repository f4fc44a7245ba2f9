//! `upm run --movie`: the film of a run, read by a decoder.

use std::fs::{self, File};

use serde_json::Value;
use tempfile::TempDir;

use super::{root, run, status};

#[test]
fn movie_shows_the_run_at_its_pace() {
    let (folder, job) = (TempDir::new().unwrap(), root().join("configs/arrange-2.json"));
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let [movie, again, frame] = ["movie.gif", "again.gif", "frame.pgm"].map(path);
    let (_, report) = run(&job, &folder.path().join("a"), &["--movie", &movie], 0);
    run(&job, &folder.path().join("b"), &["--movie", &again], 0);
    let bytes = fs::read(&movie).unwrap();
    assert!(bytes == fs::read(&again).unwrap() && bytes.len() < 300_000, "equal runs, equal bytes; {}", bytes.len());
    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::RGBA);
    let mut decoder = options.read_info(File::open(&movie).unwrap()).unwrap();
    assert_eq!(decoder.repeat(), gif::Repeat::Infinite);
    let [width, height] = [decoder.width(), decoder.height()].map(u32::from);
    let pictures: Vec<_> = std::iter::from_fn(|| decoder.read_next_frame().unwrap().cloned()).collect();
    let total_cs: f64 = pictures.iter().map(|picture| f64::from(picture.delay)).sum();
    let plate_cs = 100.0 * report["plate_time_s"].as_f64().unwrap();
    assert!((total_cs - plate_cs - 200.0).abs() <= 1.0, "{total_cs} for {plate_cs}, and a hold of two seconds");
    // every second pixel of the rendered frame from the plate's margin on; rings and blurred edges differ
    let (truth, _) = status(&["render", job.to_str().unwrap(), "--out", &frame, "--json"], 0);
    let corners_px = serde_json::from_str::<Value>(&truth).unwrap()["table"]["corners_px"].clone();
    let rendered = image::open(&frame).unwrap().into_luma8();
    let least_px = |axis: usize| (0..4).map(|k| corners_px[k][axis].as_f64().unwrap()).fold(1e9, f64::min);
    let [left, top] = [0, 1].map(|axis| (least_px(axis) - 0.06 / 1.06 * f64::from(width.max(height))) as u32);
    let differs = |at: u32| {
        let level = rendered.get_pixel(left + at % width * 2, top + at / width * 2)[0];
        level.abs_diff(pictures[0].buffer[4 * at as usize]) > 40
    };
    let off = (0..width * height).filter(|&at| differs(at)).count();
    assert!(off < (width * height / 50) as usize, "{off} of {width} × {height} pixels differ");
}

#[test]
#[cfg(target_os = "linux")]
fn movie_that_cannot_be_written_is_reported() {
    let folder = TempDir::new().unwrap();
    let [full, out] = ["full.gif", "out"].map(|name| folder.path().join(name));
    std::os::unix::fs::symlink("/dev/full", &full).unwrap();
    for file in [full, folder.path().join("none/a.gif")] {
        let (file, out) = (file.to_str().unwrap(), out.to_str().unwrap());
        let (_, stderr) = status(&["run", "configs/arrange-2.json", "--movie", file, "--out", out, "-q"], 1);
        assert!(stderr.lines().count() == 1 && stderr.contains(&format!("cannot write {file}")), "{stderr}");
    }
}

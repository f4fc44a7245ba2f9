//! `upm locate` as a subprocess.

use std::fs;
use std::path::Path;

use image::{DynamicImage, GrayImage, Luma};
use serde_json::{Value, json};
use tempfile::TempDir;

use super::status;

const SIZE: [u32; 2] = [480, 400];
const SIDE_PX: f64 = 300.0;
const MIDDLE_PX: [f64; 2] = [240.3, 199.6];
const PENNY_PX: f64 = SIDE_PX * 19.05 / 203.2 / 2.0;
const PARTS_PX: [[f64; 2]; 2] = [[170.25, 140.5], [280.0, 260.75]];

/// Covered share of a pixel whose centre is `inside_px` inside an edge.
fn covered(inside_px: f64) -> f64 {
    (inside_px + 0.5).clamp(0.0, 1.0)
}

/// Picture of a plate with two pennies, with the gray levels of ground, plate and parts.
fn plate([ground, plate, part]: [f64; 3]) -> GrayImage {
    GrayImage::from_fn(SIZE[0], SIZE[1], |x, y| {
        let at = [f64::from(x), f64::from(y)];
        let inside = |i: usize| covered(SIDE_PX / 2.0 - (at[i] - MIDDLE_PX[i]).abs());
        let disk = |center: [f64; 2]| covered(PENNY_PX - (at[0] - center[0]).hypot(at[1] - center[1]));
        let parts: f64 = PARTS_PX.into_iter().map(disk).sum();
        let level = ground + inside(0) * inside(1) * (plate - ground);
        Luma([(level + parts * (part - plate)).round() as u8])
    })
}

fn papers_plate() -> GrayImage {
    plate([30.0, 220.0, 60.0])
}

fn saved(folder: &TempDir, name: &str, image: impl Into<DynamicImage>) -> String {
    let path = folder.path().join(name);
    image.into().save(&path).unwrap();
    text(&path)
}

fn text(path: &Path) -> String {
    path.to_str().unwrap().to_owned()
}

fn located(args: &[&str]) -> Value {
    let (stdout, _) = status(&[&["locate", "--json"], args].concat(), 0);
    serde_json::from_str(&stdout).unwrap()
}

fn keys(value: &Value) -> Vec<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

fn assert_near(found: &Value, expected: [f64; 2], within: f64) {
    for (i, expected) in expected.iter().enumerate() {
        let off = found[i].as_f64().unwrap() - expected;
        assert!(off.abs() < within, "{found} is off by {off}");
    }
}

/// Asserts that plate and parts are found where they were drawn.
fn assert_found(found: &Value) {
    let parts = found["parts"].as_array().unwrap();
    assert_eq!(parts.len(), 2, "{parts:?}");
    for (part, center) in parts.iter().zip(PARTS_PX) {
        assert_eq!(part["kind"], "penny");
        assert_near(&part["center_px"], center, 0.1);
        let mm_per_px = 203.2 / SIDE_PX;
        let at_mm = [(center[0] - MIDDLE_PX[0]) * mm_per_px, (MIDDLE_PX[1] - center[1]) * mm_per_px];
        assert_near(&part["position_mm"], at_mm, 0.2);
    }
    let h = SIDE_PX / 2.0;
    for (corner, [x, y]) in [[-h, -h], [h, -h], [h, h], [-h, h]].into_iter().enumerate() {
        assert_near(&found["table"]["corners_px"][corner], [MIDDLE_PX[0] + x, MIDDLE_PX[1] + y], 0.15);
    }
}

#[test]
fn the_result_is_as_the_contract_has_it() {
    let folder = TempDir::new().unwrap();
    let found = located(&[&saved(&folder, "plate.png", papers_plate())]);
    assert_found(&found);
    assert_eq!(keys(&found), ["others", "parts", "plate", "table", "time_us"]);
    assert_eq!(keys(&found["table"]), ["corners_px", "focal_px", "rotation_deg", "side_px", "tilt_deg"]);
    assert_eq!(keys(&found["time_us"]), ["decode", "parts", "table"]);
    assert_eq!(keys(&found["plate"]), ["doubt", "height_mm", "side_mm", "source"]);
    let expected = ["center_px", "diameter_mm", "doubts", "kind", "position_mm", "radius_px", "score"];
    assert_eq!(keys(&found["parts"][0]), expected);
}

#[test]
fn options_say_what_is_known() {
    let folder = TempDir::new().unwrap();
    let dark = saved(&folder, "dark.png", plate([30.0, 110.0, 240.0]));
    assert_found(&located(&[&dark]));
    // on a plate half as large again, the former penny is larger than any coin
    let light = saved(&folder, "light.png", papers_plate());
    assert_eq!(located(&[&light, "--plate-side-mm", "304.8", "--kinds", "penny"])["parts"], json!([]));
    let smaller = located(&[&light, "--plate-side-mm", "258.8", "--kinds", "dime,quarter"]);
    assert_eq!(smaller["parts"][1]["kind"], "quarter");
    // corners in any order, as a person reads them off
    let corners = ["390,350", "90,50", "390,50", "90,350"];
    let given = located(&[&["--corners"][..], &corners, &["--plate-side-mm", "203.2", &light]].concat());
    assert_eq!(given["parts"][1]["kind"], "penny");
    // the picture as the plane, with the scale of one coin, or as a number
    let px_per_mm = format!("{}px/mm", SIDE_PX / 203.2);
    for scale in [["--scale-from", "penny@171,142"], ["--scale-from", "penny"], ["--scale", &px_per_mm]] {
        let whole = located(&[&["--plate", "whole"], &scale[..], &[&light]].concat());
        assert_eq!((&whole["parts"][0]["kind"], whole["parts"].as_array().unwrap().len()), (&json!("penny"), 2));
        let x_mm = |part: usize| whole["parts"][part]["position_mm"][0].as_f64().unwrap();
        let apart_mm = (PARTS_PX[1][0] - PARTS_PX[0][0]) * 203.2 / SIDE_PX;
        assert!((x_mm(1) - x_mm(0) - apart_mm).abs() < 0.5, "{whole}");
    }
    let euro = located(&[&light, "--coins", "eu", "--plate-side-mm", "210.7"]);
    assert_eq!(euro["parts"][0]["kind"], "cent-10");
    let mut oblong = GrayImage::from_pixel(800, 600, Luma([30]));
    image::imageops::replace(&mut oblong, &GrayImage::from_pixel(600, 300, Luma([220])), 100, 150);
    let oblong = saved(&folder, "oblong.png", oblong);
    assert_eq!(located(&[&oblong, "--rectangle", "150x300"])["plate"]["side_mm"], 300.0);
    for (args, fault) in [
        (
            &["--kinds", "penny,pennyy"][..],
            "--kinds: expected one of dime, penny, nickel, quarter (did you mean penny?), found \"pennyy\"",
        ),
        (&["--plate-side-mm", "-3"], "--plate-side-mm: expected a length above 0, up to "),
        (&["--plate-side-mm", "nan"], " mm, found NaN"),
        (&["--rectangle", "297"], "--rectangle: expected two lengths above 0, up to 100000 mm, as 297x210, found 297"),
        (&["--scale", "12"], "--scale: expected a number from 0.001 to 10000 and its unit, as 12.3px/mm, found 12"),
        (&["--scale-from", "dime@3"], "--scale-from: expected KIND@X,Y with X and Y in px, found dime@3"),
        (&["--coins", "dk"], "--coins: expected one of us, eu, uk, jp, or the name of a file, found \"dk\""),
        (&["--rig", "configs/rigs/upm-1.json"], "px from the camera of rig upm-1, found 480x400 px"),
    ] {
        let (stdout, stderr) = status(&[&["locate", &light], args].concat(), 2);
        assert!(stderr.contains(fault) && stderr.lines().count() == 1 && stdout.is_empty(), "{stderr}");
    }
    let (_, stderr) = status(&["locate", &light, "--corners", "1,2", "3,4", "5,6", "8,9"], 1);
    assert!(stderr.ends_with("--corners: expected a rectangle seen from above\n"), "{stderr}");
    let (_, stderr) = status(&["locate", &light, "--scale-from", "penny@5,5"], 1);
    assert!(stderr.contains("no disc at 5,5; discs are at 170,14"), "{stderr}");
}

#[test]
fn unreadable_picture_is_refused_in_one_line() {
    let folder = TempDir::new().unwrap();
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        text(&path)
    };
    let mut cases = vec![
        (write("empty.png", b""), "found an empty file"),
        (write("text.png", b"not a picture"), "found none of these"),
        (write("a.heic", b"\0\0\0\x18ftypheic\0\0\0\0mif1heic"), "found an AVIF or HEIC picture"),
        (write("a.webp", b"RIFF\x1a\0\0\0WEBPVP8L\r\0\0\0/\0\0\0"), "found a WebP picture"),
        (write("huge.pgm", b"P5 20000 20000 255\n"), "found 20000x20000 px"),
        (text(folder.path()), "it is a folder"),
        (text(&folder.path().join("no-such.png")), "no such file"),
    ];
    for name in ["cut.png", "cut.jpg", "cut.pgm", "cut.tif", "cut.bmp"] {
        let bytes = fs::read(saved(&folder, name, papers_plate())).unwrap();
        cases.push((write(name, &bytes[..bytes.len() / 2]), "found "));
    }
    for (path, reason) in cases {
        let (stdout, stderr) = status(&["locate", &path], 2);
        let refused = [format!("upm: {path}: expected a picture"), format!("upm: cannot read {path}: ")];
        assert!(refused.iter().any(|begin| stderr.starts_with(begin)) && stderr.contains(reason), "{stderr}");
        assert!(stderr.lines().count() == 1 && stdout.is_empty(), "{stderr}");
    }
}

#[test]
fn picture_without_one_whole_table_is_refused_in_one_line() {
    let folder = TempDir::new().unwrap();
    let plates_at = |width: u32, places: &[i64]| {
        let mut image = GrayImage::from_pixel(width, SIZE[1], Luma([30]));
        places.iter().for_each(|&x| image::imageops::overlay(&mut image, &papers_plate(), x, 0));
        image
    };
    for (name, picture) in [
        ("black.png", GrayImage::new(640, 480)),
        ("dot.png", GrayImage::new(1, 1)),
        ("even.png", GrayImage::from_pixel(640, 480, Luma([180]))),
        ("cut.png", plates_at(SIZE[0], &[150])),
        ("two.png", plates_at(2 * SIZE[0], &[0, i64::from(SIZE[0])])),
    ] {
        let path = saved(&folder, name, picture);
        let (stdout, stderr) = status(&["locate", &path], 1);
        assert!(stderr.starts_with(&format!("upm: {path}: ")), "{stderr}");
        assert!(stderr.lines().count() == 1 && stdout.is_empty(), "{stderr}");
        assert!(name != "even.png" || stderr.contains("no edges stand out"), "{stderr}");
    }
}

#[test]
fn each_of_several_pictures_is_reported_and_the_worst_status_wins() {
    let folder = TempDir::new().unwrap();
    let good = saved(&folder, "good.png", papers_plate());
    let black = saved(&folder, "black.png", GrayImage::new(640, 480));
    let lines = |args: &[&str], expected: i32| -> (Vec<Value>, String) {
        let (stdout, stderr) = status(&[&["locate", "--json"], args].concat(), expected);
        (stdout.lines().map(|line| serde_json::from_str(line).unwrap()).collect(), stderr)
    };
    let (found, stderr) = lines(&[&good, &good], 0);
    assert_eq!((found.len(), stderr.as_str()), (2, ""));
    for found in &found {
        assert_eq!(found["image"], good.as_str());
        assert_found(found);
    }
    let (found, stderr) = lines(&[&black, &good], 1);
    assert!(found[0]["error"].as_str().unwrap().contains("black.png") && stderr.lines().count() == 1, "{stderr}");
    assert_found(&found[1]);
    let (found, stderr) = lines(&["no-such.png", &black, &good], 2);
    assert_eq!((found.len(), stderr.lines().count()), (3, 2));
}

#[test]
fn overlay_shows_the_parts() {
    let folder = TempDir::new().unwrap();
    let good = saved(&folder, "good.png", papers_plate());
    let drawn = folder.path().join("a/drawn");
    status(&["locate", &good, "--overlay", &text(&drawn)], 0);
    let drawn = image::open(drawn.join("good.png")).unwrap().into_rgb8();
    let at = |[x, y]: [f64; 2]| drawn.get_pixel(x.round() as u32, y.round() as u32).0;
    let colored = |[r, g, b]: [u8; 3]| r.abs_diff(g).max(g.abs_diff(b)) > 20;
    let [x, y] = PARTS_PX[1];
    assert!(colored(at([x + PENNY_PX, y])) && !colored(at(MIDDLE_PX)), "rings are round the parts");
}

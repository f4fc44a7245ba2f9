//! Messages of `upm locate` about discs that it does not name, and scores of the names it gives.

use image::{DynamicImage, Luma};
use serde_json::Value;
use tempfile::TempDir;

use super::coin_pictures::{Coin, CoinPicture};
use super::coin_scenes::{PENNY, QUARTER, plain};
use super::status;

fn saved(folder: &TempDir, picture: &CoinPicture) -> String {
    let drawn = DynamicImage::from(picture.drawn());
    written(folder, if picture.gray { drawn.into_luma8().into() } else { drawn })
}

fn written(folder: &TempDir, picture: impl Into<DynamicImage>) -> String {
    let path = folder.path().join("picture.png");
    picture.into().save(&path).unwrap();
    path.to_str().unwrap().to_owned()
}

fn said(path: &str, options: &[&str]) -> String {
    status(&[&["locate", path], options].concat(), 0).0
}

fn located(path: &str, options: &[&str]) -> Value {
    serde_json::from_str(&said(path, &[&["--json"], options].concat())).unwrap()
}

/// Score of the part within 2 mm of a place on the plate; 0 if there is none.
fn score_at(found: &Value, at_mm: [f64; 2]) -> f64 {
    let off = |part: &Value| {
        let [x, y] = [0, 1].map(|i| part["position_mm"][i].as_f64().unwrap() - at_mm[i]);
        x.hypot(y)
    };
    let parts = found["parts"].as_array().unwrap();
    parts.iter().find(|part| off(part) < 2.0).map_or(0.0, |part| part["score"].as_f64().unwrap())
}

const SIDE: [&str; 2] = ["--plate-side-mm", "203.2"];
const PLACES: [[f64; 2]; 5] = [[-60.0, 50.0], [0.0, 55.0], [60.0, 40.0], [-50.0, -40.0], [40.0, -45.0]];

#[test]
fn discs_of_a_kind_not_asked_for_are_reported_in_one_line_with_the_option() {
    let folder = TempDir::new().unwrap();
    let coins = [QUARTER, QUARTER, QUARTER, PENNY, PENNY];
    let picture = saved(&folder, &plain(203.2, &coins.into_iter().zip(PLACES).collect::<Vec<_>>()));
    let text = said(&picture, &["--kinds", "penny"]);
    let line = text.lines().find(|line| line.contains("quarter?")).unwrap_or_else(|| panic!("{text}"));
    assert!(line.starts_with("3 discs of 24.") && line.ends_with(" mm: quarter? use --kinds penny,quarter"), "{line}");
    let found = located(&picture, &["--kinds", "penny"]);
    assert_eq!((found["parts"].as_array().unwrap().len(), found["others"].as_array().unwrap().len()), (2, 3));
    assert_eq!(found["others"][0]["option"], "--kinds penny,quarter");
    assert_eq!(located(&picture, &[])["others"].as_array().unwrap().len(), 0, "all kinds are looked for");
}

#[test]
fn score_falls_where_the_rim_is_off_or_half_hidden() {
    let folder = TempDir::new().unwrap();
    let larger = Coin { diameter_mm: 1.045 * PENNY.diameter_mm, ..PENNY };
    let picture = plain(203.2, &[(PENNY, PLACES[0]), (larger, PLACES[2]), (PENNY, PLACES[3])]);
    let mut pixels = DynamicImage::from(picture.drawn()).into_luma8();
    // a card as white as the plate covers the left third of the last coin
    let [x, y] = picture.centers_px()[2];
    let radius_px = 0.85 * 640.0 / 203.2 * PENNY.diameter_mm / 2.0;
    let plate = pixels.get_pixel((x - 1.4 * radius_px) as u32, y as u32).0[0];
    for (column, row, pixel) in pixels.enumerate_pixels_mut() {
        let off = [f64::from(column) - x, f64::from(row) - y];
        if off[0] < -0.3 * radius_px && off[0].hypot(off[1]) < 1.2 * radius_px {
            *pixel = Luma([plate]);
        }
    }
    let found = located(&written(&folder, pixels), &[&SIDE[..], &["--kinds", "penny"]].concat());
    let [whole, off, hidden] = [PLACES[0], PLACES[2], PLACES[3]].map(|at| score_at(&found, at));
    assert!(whole > 0.9 && off < 0.6 && hidden < 0.85, "{whole} {off} {hidden}\n{found}");
}

#[test]
fn plate_side_is_determined_by_two_kinds_but_not_by_one() {
    let folder = TempDir::new().unwrap();
    let two = saved(&folder, &plain(260.0, &[(PENNY, PLACES[0]), (QUARTER, PLACES[1]), (PENNY, PLACES[2])]));
    let found = located(&two, &[]);
    let side_mm = found["plate"]["side_mm"].as_f64().unwrap();
    assert!((side_mm / 260.0 - 1.0).abs() < 0.02 && found["plate"]["source"] == "two_kinds", "{found}");
    assert!(said(&two, &[]).contains("from the ratio of the parts' sizes"));
    let bare = CoinPicture { size_px: [480, 400], ..plain(203.2, &[]) };
    assert!(said(&saved(&folder, &bare), &[]).contains("no parts: 0 discs found"));
    let one = saved(&folder, &plain(260.0, &[(QUARTER, PLACES[0]), (QUARTER, PLACES[1]), (QUARTER, PLACES[2])]));
    let text = said(&one, &[]);
    assert!(
        text.contains("plate: 203.2 x 203.2 mm assumed; --plate-side-mm, --scale or --scale-from gives it"),
        "{text}"
    );
    let found = located(&one, &["--plate-side-mm", "260"]);
    assert_eq!((&found["plate"]["source"], &found["parts"][0]["kind"]), (&"given".into(), &"quarter".into()));
}

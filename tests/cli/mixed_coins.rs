//! `upm locate` on realistic pictures: twelve scenes rendered by a ray tracer that shares no code with the program.

use std::path::Path;

use image::DynamicImage;
use serde_json::{Value, json};
use tempfile::TempDir;

use super::coin_pictures::Coin;
use super::coin_scenes::{CoinScene, everywhere, scenes};
use super::page::FigurePage;
use super::status;

/// Seed of pictures that the program was not tuned on.
const SEED: u64 = 424_242;
/// Score above which a name counts as trusted.
const TRUSTED: f64 = 0.9;

/// Results for the coins of pictures.
#[derive(Debug, Default)]
struct Tally {
    coins: usize,
    /// Coins of kinds that the program knows.
    known: usize,
    named: usize,
    misnamed: usize,
    misnamed_and_trusted: usize,
    reported: usize,
    silent: usize,
    /// Parts and discs reported where there is no coin.
    invented: usize,
}

/// Draws the scene and has it searched with these options as well; returns the output.
fn searched(folder: &Path, scene: &CoinScene, options: &[&str]) -> String {
    let path = folder.join("coins.png");
    let drawn = scene.picture.drawn();
    let picture =
        if scene.picture.gray { DynamicImage::from(drawn).into_luma8().into() } else { DynamicImage::from(drawn) };
    picture.save(&path).unwrap();
    let of_scene: Vec<&str> = scene.options.iter().map(String::as_str).collect();
    status(&[&["locate", path.to_str().unwrap()], options, of_scene.as_slice()].concat(), 0).0
}

/// Compares a row of the page's table.
fn compare_row(page: &mut FigurePage, name: &str, tally: &Tally) {
    let &Tally { coins, named, misnamed, misnamed_and_trusted, reported, silent, .. } = tally;
    let columns: [(&str, &[usize]); 5] = [
        ("coins", &[coins]),
        ("named", &[named]),
        // the heading has the score
        ("misnamed (score", &[misnamed, misnamed_and_trusted]),
        ("reported", &[reported]),
        ("silent", &[silent]),
    ];
    for (column, counts) in columns {
        let measured: Vec<f64> = counts.iter().map(|&count| count as f64).collect();
        page.cell("| picture | coins |", name, column, &measured);
    }
}

/// Those of `discs` whose centre is on the coin.
fn on_coin(discs: &Value, center_px: [f64; 2], radius_px: f64) -> Vec<&Value> {
    let off = |disc: &Value| {
        let [x, y] = [0, 1].map(|i| disc["center_px"][i].as_f64().unwrap() - center_px[i]);
        x.hypot(y)
    };
    discs.as_array().unwrap().iter().filter(|disc| off(disc) < 0.5 * radius_px).collect()
}

/// Adds the results of a scene.
fn count(tally: &mut Tally, scene: &CoinScene, found: &Value) {
    let px_per_mm = found["table"]["side_px"].as_f64().unwrap() / scene.picture.side_mm;
    let mut claimed = 0;
    for (Coin { name, diameter_mm, .. }, center_px) in scene.picture.coins.iter().zip(scene.picture.centers_px()) {
        let near = |discs| on_coin(discs, center_px, diameter_mm / 2.0 * px_per_mm);
        let (parts, others) = (near(&found["parts"]), near(&found["others"]));
        claimed += parts.len() + others.len();
        tally.coins += 1;
        tally.known += usize::from(name.is_some());
        match (parts.first(), others.first()) {
            (Some(part), _) if part["kind"] == json!(name) => tally.named += 1,
            (Some(part), _) => {
                tally.misnamed += 1;
                tally.misnamed_and_trusted += usize::from(part["score"].as_f64().unwrap() > TRUSTED);
            }
            (None, Some(_)) => tally.reported += 1,
            (None, None) => tally.silent += 1,
        }
    }
    let all = found["parts"].as_array().unwrap().len() + found["others"].as_array().unwrap().len();
    tally.invented += all - claimed;
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn mixed_coins_are_named_doubted_or_reported() {
    let folder = TempDir::new().unwrap();
    let mut page = FigurePage::open("docs/locate.md");
    let mut all = Tally::default();
    for scene in scenes(SEED) {
        let found: Value = serde_json::from_str(&searched(folder.path(), &scene, &["--json"])).unwrap();
        if scene.name == "foreign coins" {
            let output = searched(folder.path(), &scene, &[]);
            // the last line has times of the computer
            let (sample, _) = output.split_once("time: ").unwrap();
            assert_eq!(page.text_between("```text ", "```"), sample, "docs/locate.md");
        }
        count(&mut all, &scene, &found);
        let off = found["plate"]["side_mm"].as_f64().unwrap() / scene.picture.side_mm - 1.0;
        assert!(found["plate"]["source"] == "assumed" || off.abs() < 0.08, "{}: side off by {off}", scene.name);
    }
    assert_eq!(all.misnamed_and_trusted, 0, "{all:?}");
    assert!(all.invented <= all.coins / 50, "{all:?}");
    assert!(all.named * 4 >= all.known * 3, "{all:?}");
    compare_row(&mut page, "all", &all);
    page.assert_as_measured();
}

#[test]
#[ignore = "campaign: `cargo test --test cli -- --ignored campaign_of` runs it"]
fn campaign_of_coins_on_cloth_wood_and_paper() {
    let folder = TempDir::new().unwrap();
    let (mut tally, mut off) = (Tally::default(), Vec::new());
    for picture in (SEED..SEED + 3).flat_map(everywhere) {
        let [x, y] = picture.centers_px()[0];
        let from = format!("{}@{x:.0},{y:.0}", picture.coins[0].name.unwrap());
        let options = ["--json", "--plate", "whole", "--scale-from", &from];
        let scene = CoinScene { name: "everywhere", picture, options: Vec::new() };
        let found: Value = serde_json::from_str(&searched(folder.path(), &scene, &options)).unwrap();
        count(&mut tally, &scene, &found);
        for part in found["parts"].as_array().unwrap() {
            let coin = scene.picture.coins.iter().find(|coin| part["kind"] == json!(coin.name)).unwrap();
            off.push((part["diameter_mm"].as_f64().unwrap() / coin.diameter_mm - 1.0).abs());
        }
    }
    let far = off.iter().filter(|off| **off > 0.015).count();
    eprintln!("{tally:?}; {far} of {} diameters off by more than 1.5 %", off.len());
    assert!(tally.named * 100 >= 95 * tally.coins && tally.invented <= 3, "{tally:?}");
    assert!(far * 50 <= off.len(), "{far} of {}", off.len());
}

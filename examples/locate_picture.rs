//! Finds the table and the coins in a picture from a file, or in one rendered here with known truth.
//!
//! ```text
//! cargo run --example locate_picture
//! cargo run --example locate_picture -- PICTURE.png
//! ```
#![allow(clippy::print_stdout)] // an example talks to its reader

use std::error::Error;

use upm::geometry::{Lens, Vec2};
use upm::signal::Frame;
use upm::units::{INCH_M, mm_from_m};
use upm::vision::{CoinFinder, Detection, locate_table};
use upm_scene::{Difficulty, Scene, ScenePartTruth, kinds};

/// Side of the papers' small plate, m; a picture does not reveal the size of its plate.
const PLATE_SIDE_M: f64 = 8.0 * INCH_M;

fn main() -> Result<(), Box<dyn Error>> {
    let scene = Scene::generate(Difficulty::Rough, 7);
    let picture = std::env::args().nth(1);
    let (frame, lens, side_m) = match &picture {
        Some(path) => {
            let frame = frame_of(path)?;
            let lens = Lens::centered([frame.width, frame.height], 4.0);
            (frame, lens, PLATE_SIDE_M)
        }
        None => (scene.frame(), scene.lens, scene.side_m),
    };

    let table = locate_table(&frame, &lens, side_m)?;
    let turned_deg = table.rotation_rad.to_degrees();
    println!("table: {:.1} px a side, turned by {turned_deg:.2} degrees", table.side_px);

    let kinds = kinds();
    let coins = CoinFinder::new(&table, [frame.width, frame.height], &kinds, true).find(&frame);
    for coin in &coins {
        let [x_mm, y_mm] = [coin.position_m.x, coin.position_m.y].map(mm_from_m);
        println!("{:>8} at {x_mm:7.2}, {y_mm:7.2} mm, score {:.2}", kinds[coin.kind].name, coin.score);
    }
    println!("{} coins found", coins.len());
    if picture.is_none() {
        compare(&coins, &scene.truth());
    }
    Ok(())
}

fn frame_of(path: &str) -> Result<Frame, Box<dyn Error>> {
    let gray = image::open(path)?.into_luma8();
    let (width, height) = (gray.width() as usize, gray.height() as usize);
    Frame::of_picture(width, height, gray.into_raw()).ok_or("the picture has no pixels".into())
}

/// Compares the coins found with those rendered.
fn compare(coins: &[Detection], truth: &[ScenePartTruth]) {
    let nearest_m = |at_m: Vec2| coins.iter().map(|coin| (coin.position_m - at_m).norm()).fold(f64::INFINITY, f64::min);
    let errors_mm: Vec<f64> = truth.iter().map(|part| mm_from_m(nearest_m(part.at_m))).collect();
    let found = errors_mm.iter().filter(|&&error_mm| error_mm < 1.0).count();
    let worst_mm = errors_mm.iter().copied().filter(|&error_mm| error_mm < 1.0).fold(0.0, f64::max);
    println!("{found} of {} true coins found, the worst {worst_mm:.3} mm off", truth.len());
}

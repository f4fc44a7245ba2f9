//! Twelve pictures of mixed coins, with the options that a user would type for each.

use super::coin_pictures::{Coin, CoinPicture, Metal, Rng, Surface};

/// A picture, and the options with which it is searched.
pub(super) struct CoinScene {
    pub name: &'static str,
    pub picture: CoinPicture,
    pub options: Vec<String>,
}

pub(super) const PENNY: Coin = coin(Some("penny"), 19.05, 1.52, Metal::Copper);
const BROWN_PENNY: Coin = coin(Some("penny"), 19.05, 1.52, Metal::Brown);
const NICKEL: Coin = coin(Some("nickel"), 21.21, 1.95, Metal::Silver);
const DIME: Coin = coin(Some("dime"), 17.91, 1.35, Metal::Silver);
pub(super) const QUARTER: Coin = coin(Some("quarter"), 24.26, 1.75, Metal::Silver);
const HALF_DOLLAR: Coin = coin(None, 30.61, 2.15, Metal::Silver);
const CENT: Coin = coin(None, 16.25, 1.67, Metal::Copper);
const EURO: Coin = coin(None, 23.25, 2.33, Metal::Brass);
const TWO_EURO: Coin = coin(None, 25.75, 2.2, Metal::Silver);

const fn coin(name: Option<&'static str>, diameter_mm: f64, height_mm: f64, metal: Metal) -> Coin {
    Coin { name, diameter_mm, height_mm, metal, at_mm: [0.0; 2] }
}

/// Places each of `coins` `count` times, in turn, at random positions with gaps of at least `gap_mm`.
fn scattered(rng: &mut Rng, side_mm: f64, coins: &[Coin], count: usize, gap_mm: f64) -> Vec<Coin> {
    let mut placed: Vec<Coin> = Vec::new();
    for coin in coins.iter().cycle().take(coins.len() * count) {
        let reach = side_mm / 2.0 - coin.diameter_mm / 2.0 - 5.0;
        for _ in 0..2000 {
            let at_mm = [rng.within(-reach, reach), rng.within(-reach, reach)];
            let gap = |other: &Coin| {
                let apart = (other.at_mm[0] - at_mm[0]).hypot(other.at_mm[1] - at_mm[1]);
                apart - (other.diameter_mm + coin.diameter_mm) / 2.0
            };
            if placed.iter().all(|other| gap(other) >= gap_mm) {
                placed.push(Coin { at_mm, ..*coin });
                break;
            }
        }
    }
    placed
}

/// The twelve scenes; `seed` draws places, light and noise.
pub(super) fn scenes(seed: u64) -> Vec<CoinScene> {
    let four = [PENNY, NICKEL, DIME, QUARTER];
    let silver = [NICKEL, DIME, QUARTER];
    let mut rng = Rng(seed);
    let mut scenes: Vec<CoinScene> = Vec::new();
    let mut add = |name, side_mm: f64, coins: &[Coin], count, change: &dyn Fn(&mut CoinPicture)| {
        let coins = scattered(&mut rng, side_mm, coins, count, 2.0);
        let mut picture = daylight(&mut rng, side_mm, coins);
        change(&mut picture);
        scenes.push(CoinScene { name, picture, options: Vec::new() });
    };
    add("daylight", 203.2, &four, 3, &|_| {});
    add("gray and noisy", 203.2, &four, 3, &|p| {
        (p.gray, p.noise_sd, p.blur_px) = (true, 6.0, 1.2);
        (p.shadow, p.shadow_at_mm, p.softness_mm) = (0.5, [2.5, -2.0], 2.5);
    });
    add("silver on white", 203.2, &silver, 4, &|p| {
        (p.gray, p.shadow, p.shadow_at_mm, p.softness_mm) = (true, 0.45, [0.4, -0.4], 3.0);
    });
    add("telephone, tilted", 203.2, &four, 3, &|p| {
        (p.focal_widths, p.tilt_deg, p.side_share) = (0.8, [4.0, -3.0, 10.0], 0.7);
    });
    add("plate of 150 mm", 150.0, &four, 2, &|p| (p.tilt_deg, p.side_share) = ([1.0, 2.0, -14.0], 0.7));
    add("plate of 297 mm", 297.0, &four, 4, &|p| (p.size_px, p.gray) = ([1600, 1200], true));
    add("foreign coins", 203.2, &[PENNY, DIME, QUARTER, HALF_DOLLAR, CENT, EURO, TWO_EURO], 2, &|_| {});
    add("evening", 203.2, &four, 3, &|p| {
        (p.fall, p.vignette, p.noise_sd) = (0.55, 0.35, 6.0);
        (p.shadow, p.shadow_at_mm, p.softness_mm) = (0.6, [-4.0, -2.0], 4.0);
    });
    add("brown pennies, tilted", 203.2, &[BROWN_PENNY, NICKEL, DIME, QUARTER], 3, &|p| {
        (p.focal_widths, p.tilt_deg, p.side_share) = (1.2, [-3.0, 4.0, -20.0], 0.65);
    });
    add("quarters alone on 225 mm", 225.0, &[QUARTER], 6, &|_| {});
    add("out of focus", 203.2, &four, 3, &|p| (p.blur_px, p.noise_sd) = (2.6, 3.0));
    add("silver, evening, tilted", 203.2, &silver, 5, &|p| {
        (p.gray, p.fall, p.focal_widths, p.tilt_deg) = (true, 0.5, 1.0, [3.0, 3.0, 5.0]);
        (p.side_share, p.shadow, p.softness_mm) = (0.72, 0.5, 3.5);
    });
    for scene in &mut scenes {
        if scene.name == "foreign coins" {
            scene.options = ["--plate-side-mm", "203.2"].map(String::from).into();
        }
    }
    scenes
}

/// Ten pictures of coins of a country on cloth, wood and paper, from about straight above; the first coin gives the
/// scale.
pub(super) fn everywhere(seed: u64) -> Vec<CoinPicture> {
    let coins = [PENNY, NICKEL, DIME, QUARTER, QUARTER, BROWN_PENNY];
    let mut rng = Rng(seed);
    let picture = |i: usize| {
        let surface = [Surface::Cloth, Surface::Wood, Surface::Paper][i % 3];
        let coins = scattered(&mut rng, 160.0, &coins, 2, 3.0);
        CoinPicture { surface, side_share: 0.95, size_px: [1200, 1200], ..daylight(&mut rng, 180.0, coins) }
    };
    (0..10).map(picture).collect()
}

/// A sharp picture in colour from above, with a shadow to one side.
fn daylight(rng: &mut Rng, side_mm: f64, coins: Vec<Coin>) -> CoinPicture {
    CoinPicture {
        seed: rng.within(0.0, 1e9) as u64,
        size_px: [1200, 1000],
        side_mm,
        surface: Surface::Plate,
        focal_widths: 3.0,
        side_share: 0.85,
        tilt_deg: [0.5, -0.5, rng.within(-8.0, 8.0)],
        coins,
        shadow: 0.35,
        shadow_at_mm: [1.5, -1.0],
        softness_mm: 1.5,
        fall: rng.within(0.1, 0.3),
        fall_direction: rng.within(0.0, std::f64::consts::TAU),
        vignette: 0.1,
        blur_px: 0.8,
        noise_sd: 2.0,
        gray: false,
    }
}

/// A small sharp gray picture from above, without shadows, of coins at these places.
pub(super) fn plain(side_mm: f64, coins: &[(Coin, [f64; 2])]) -> CoinPicture {
    let coins = coins.iter().map(|(coin, at_mm)| Coin { at_mm: *at_mm, ..*coin }).collect();
    CoinPicture {
        size_px: [720, 640],
        focal_widths: 4.0,
        tilt_deg: [0.0, 0.0, 3.0],
        shadow: 0.0,
        fall: 0.1,
        vignette: 0.0,
        gray: true,
        ..daylight(&mut Rng(7), side_mm, coins)
    }
}

//! Consecutive ledges that bring a batch of blocks, initially on any of their faces, onto the largest one.
//!
//! A ledge exchanges a block's length along its direction of motion and its height; it cannot turn the third edge. So a
//! quarter turn about the vertical follows the first ledge, and a second ledge topples the blocks that stand then.

use rand::RngExt;

use super::Topple;
use super::peg::{Peg, Shape};
use crate::LabError;
use upm_core::random::Streams;

/// Blocks of a batch.
const BATCH: u32 = 2_000;

/// A block on the belt, and its edge across its direction of motion, m.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Lying {
    peg: Peg,
    across_m: f64,
}

impl Lying {
    fn critical_mps(&self, ledge_m: f64) -> f64 {
        self.peg.pivot(ledge_m).map_or(f64::INFINITY, |pivot| pivot.critical_mps())
    }

    fn stands(&self) -> bool {
        self.peg.height_m > self.peg.length_m
    }

    fn toppled(self) -> Self {
        Self { peg: self.peg.toppled(), ..self }
    }

    fn turned(self) -> Self {
        Self { peg: Peg { length_m: self.across_m, ..self.peg }, across_m: self.peg.length_m }
    }
}

/// Orientation of a batch after each ledge.
#[derive(Clone, Debug, PartialEq)]
pub struct Cascade {
    /// Speed at each ledge, m/s.
    pub speeds_mps: Vec<f64>,
    /// Lowest and highest speed that would suffice there without scatter, m/s.
    pub windows_mps: Vec<[f64; 2]>,
    /// Share of the batch on its largest face: initially, and after each ledge.
    pub flat: Vec<f64>,
}

/// A batch of blocks with edges `edges_m` through two ledges with a quarter turn between, and a third ledge at the
/// second's speed for blocks that the scatter left standing.
///
/// # Errors
///
/// Blocks so close to a cube that no speed topples standing ones and leaves lying ones.
pub fn cascade(topple: &Topple, mut edges_m: [f64; 3], streams: &Streams) -> Result<Cascade, LabError> {
    let ledge_m = topple.ledge_m;
    edges_m.sort_by(f64::total_cmp);
    let orders = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let lying = orders.map(|order| {
        let [length_m, height_m, across_m] = order.map(|i: usize| edges_m[i]);
        Lying { peg: Peg { shape: Shape::BLOCK, length_m, height_m }, across_m }
    });
    let first = window(&lying, ledge_m)?;
    let after = lying.map(|block| if block.stands() { block.toppled() } else { block }.turned());
    let second = window(&after, ledge_m)?;
    let windows_mps = vec![first, second, second];
    let speeds_mps: Vec<f64> = windows_mps.iter().map(|[low, high]| (low * high).sqrt()).collect();

    let mut rng = streams.stream("cascade of ledges");
    let mut batch: Vec<Lying> = (0..BATCH).map(|_| lying[rng.random_range(0..lying.len())]).collect();
    let share = |batch: &[Lying]| {
        batch.iter().filter(|block| block.peg.height_m == edges_m[0]).count() as f64 / f64::from(BATCH)
    };
    let mut flat = vec![share(&batch)];
    for (i, &speed_mps) in speeds_mps.iter().enumerate() {
        for block in &mut batch {
            if topple.scatter.approach_mps(speed_mps, &mut rng) > block.critical_mps(ledge_m) {
                *block = block.toppled();
            }
        }
        flat.push(share(&batch));
        if i == 0 {
            batch.iter_mut().for_each(|block| *block = block.turned());
        }
    }
    Ok(Cascade { speeds_mps, windows_mps, flat })
}

/// Range of speeds that topple every one of `blocks` that stands, and none that is flat.
fn window(blocks: &[Lying], ledge_m: f64) -> Result<[f64; 2], LabError> {
    let of = |stands: bool| {
        let alike = blocks.iter().filter(move |block| block.stands() == stands);
        alike.map(|block| block.critical_mps(ledge_m))
    };
    let (low, high) = (of(true).fold(0.0, f64::max), of(false).fold(f64::INFINITY, f64::min));
    if low < high {
        return Ok([low, high]);
    }
    Err(LabError::Setting(format!(
        "no speed topples all blocks that stand ({:.0} mm/s) and leaves all that lie ({:.0} mm/s): edges must differ more",
        1e3 * low,
        1e3 * high
    )))
}

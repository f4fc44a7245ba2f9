//! The torque wave of every row: duty, phase offsets and the strobing of rows (M-Chip paper, section III-A).

use super::device::ROWS;

/// The drive of an array, and the strobing of its rows: a wave of rows that are off, running against the feed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ResonatorDrive {
    /// Fraction of a cycle in which the torque is on.
    pub duty: f64,
    /// Delay of a row against the one before it, in cycles.
    pub row_delay: f64,
    /// 1 where rows are strobed, else 0.
    pub strobe: u32,
    /// Rows from one row that is off to the next: the paper's λ.
    pub spacing: u32,
    /// Drive cycles for which a row is off: the paper's γ.
    pub cycles: u32,
}

impl ResonatorDrive {
    /// All rows driven alike, 50 % duty.
    pub fn plain() -> Self {
        Self { duty: 0.5, row_delay: 0.0, strobe: 0, spacing: 4, cycles: 50 }
    }

    /// The strobing that the paper found best: λ = 4 rows, γ = 50 cycles.
    pub fn strobed() -> Self {
        Self { strobe: 1, ..Self::plain() }
    }

    /// True while `row` is driven up, `cycles` drive cycles after the start.
    pub fn pushes(&self, row: usize, cycles: f64) -> bool {
        !self.is_off(row, cycles) && (cycles - self.row_delay * row as f64).rem_euclid(1.0) < self.duty
    }

    /// True while `row` is off: the last row first, then the one before it.
    pub fn is_off(&self, row: usize, cycles: f64) -> bool {
        let (turn, spacing) = ((cycles / f64::from(self.cycles)) as usize, self.spacing as usize);
        self.strobe == 1 && (row + turn) % spacing == (ROWS - 1) % spacing
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn off_rows_run_against_the_feed() {
        let drive = ResonatorDrive::strobed();
        let off = |cycles: f64| -> Vec<usize> { (0..8).filter(|&row| drive.is_off(row, cycles)).collect() };
        assert_eq!(off(0.0), [3, 7]);
        assert_eq!(off(49.9), [3, 7]);
        assert_eq!(off(50.0), [2, 6]);
        assert_eq!(off(200.0), [3, 7]);
        assert!(!drive.pushes(7, 0.1) && drive.pushes(6, 0.1) && !drive.pushes(6, 0.6));
    }
}

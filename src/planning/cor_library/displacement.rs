use super::{DisplacementModel, Library};
use upm_core::geometry::Vec2;

/// Tolerance beyond the ends of the measured distances, clamped to the ends, m.
const SLACK_M: f64 = 1e-9;

impl DisplacementModel {
    /// Distance that a part flows on a belt of speed amplitude `speed_mps` held for `sustain_s`, m: bilinear in the
    /// grid.
    ///
    /// Beyond the grid the value at its end holds, except for speeds below the first of the grid: from there the
    /// distance falls linearly to zero for a plate at rest. Zero for an empty grid.
    pub fn distance(&self, speed_mps: f64, sustain_s: f64) -> f64 {
        self.bilinear(&self.distance_m, speed_mps, sustain_s)
    }

    /// Standard deviation of one such pulse, m; interpolated like [`Self::distance`].
    pub fn sd(&self, speed_mps: f64, sustain_s: f64) -> f64 {
        self.bilinear(&self.sd_m, speed_mps, sustain_s)
    }

    /// Distance of the shortest pulse of the grid at this speed, m.
    pub fn min_distance(&self, speed_mps: f64) -> f64 {
        self.sustain_s.first().map_or(0.0, |&shortest| self.distance(speed_mps, shortest))
    }

    /// Distance of the longest pulse of the grid at this speed, m.
    pub fn max_distance(&self, speed_mps: f64) -> f64 {
        self.sustain_s.last().map_or(0.0, |&longest| self.distance(speed_mps, longest))
    }

    /// Distance of the longest pulse on the fastest measured belt, m.
    pub(crate) fn farthest(&self) -> f64 {
        self.speed_mps.last().map_or(0.0, |&fastest| self.max_distance(fastest))
    }

    /// The shortest sustain that moves a part `distance_m` at this speed, s: the inverse of [`Self::distance`]. `None`
    /// outside [`Self::min_distance`] to [`Self::max_distance`]; those two are the clamps to report.
    pub fn sustain_for(&self, speed_mps: f64, distance_m: f64) -> Option<f64> {
        let (row, weight) = self.row_at(speed_mps)?;
        let at = |k: usize| self.in_column(&self.distance_m, row, weight, k);
        let (shortest, last) = (at(0), self.sustain_s.len() - 1);
        if distance_m <= shortest {
            return (distance_m >= shortest - SLACK_M).then(|| self.sustain_s[0]);
        }
        let (mut short, mut long) = (0, last);
        if distance_m > at(last) {
            return (distance_m <= at(last) + SLACK_M).then(|| self.sustain_s[last]);
        }
        while long - short > 1 {
            let middle = (short + long) / 2;
            if distance_m <= at(middle) { long = middle } else { short = middle }
        }
        let (below, above) = (at(short), at(long));
        let part = (distance_m - below) / (above - below);
        Some(self.sustain_s[short] + part * (self.sustain_s[long] - self.sustain_s[short]))
    }

    fn bilinear(&self, table: &[Vec<f64>], speed_mps: f64, sustain_s: f64) -> f64 {
        let (Some((row, row_weight)), Some((column, column_weight))) =
            (self.row_at(speed_mps), bracket(&self.sustain_s, sustain_s))
        else {
            return 0.0;
        };
        let before = self.in_column(table, row, row_weight, column);
        let after = self.in_column(table, row, row_weight, (column + 1).min(self.sustain_s.len() - 1));
        before + column_weight * (after - before)
    }

    /// The value at column `k` between `row` and the next; below the first speed `weight` is negative and scales it.
    fn in_column(&self, table: &[Vec<f64>], row: usize, weight: f64, k: usize) -> f64 {
        let value = |i: usize| table.get(i).and_then(|line| line.get(k)).copied().unwrap_or(0.0);
        if weight < 0.0 {
            return value(row) * (1.0 + weight);
        }
        let low = value(row);
        if weight == 0.0 { low } else { low + weight * (value(row + 1) - low) }
    }

    /// Row below `speed_mps` and the fraction to the next; below the grid row 0 and the missing fraction of its speed,
    /// negative.
    fn row_at(&self, speed_mps: f64) -> Option<(usize, f64)> {
        let slowest = *self.speed_mps.first()?;
        self.sustain_s.first()?;
        if speed_mps < slowest {
            return Some((0, speed_mps.max(0.0) / slowest - 1.0));
        }
        bracket(&self.speed_mps, speed_mps)
    }
}

/// Index of the last grid point not above `x` and the fraction to the next, 0 to 1; clamped at both ends.
pub(crate) fn bracket(grid: &[f64], x: f64) -> Option<(usize, f64)> {
    let last = grid.len().checked_sub(1)?;
    let above = grid.partition_point(|&g| g <= x);
    if above == 0 {
        return Some((0, 0.0));
    }
    if above > last {
        return Some((last, 0.0));
    }
    let (low, high) = (grid[above - 1], grid[above]);
    Some((above - 1, (x - low) / (high - low)))
}

impl Library {
    /// Displacement of a part at `p_m` by entry number `entry` held for `sustain_s`, m: along the flow, over the
    /// distance measured for the plate's speed there. Zero when there is no such entry.
    pub fn displacement_at(&self, entry: usize, p_m: Vec2, sustain_s: f64) -> Vec2 {
        self.entries.get(entry).map_or_else(Vec2::zeros, |entry| {
            entry.pump.direction_at(p_m) * self.displacement.distance(entry.speed_at(p_m), sustain_s)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn model() -> DisplacementModel {
        let (speed_mps, sustain_s) = (vec![0.1, 0.2, 0.5], vec![0.01, 0.05, 0.1, 0.2]);
        let distance_m =
            vec![vec![1e-4, 1e-3, 2e-3, 5e-3], vec![2e-4, 2e-3, 4e-3, 9e-3], vec![3e-4, 3e-3, 7e-3, 20e-3]];
        let sd_m = distance_m.iter().map(|row| row.iter().map(|d| 0.05 * d).collect()).collect();
        DisplacementModel { speed_mps, sustain_s, distance_m, sd_m }
    }

    #[test]
    fn meets_the_grid_and_clamps_beyond_it() {
        let m = model();
        for (i, &v) in m.speed_mps.iter().enumerate() {
            for (k, &s) in m.sustain_s.iter().enumerate() {
                assert!((m.distance(v, s) - m.distance_m[i][k]).abs() < 1e-15);
            }
        }
        assert!((m.distance(0.35, 0.15) - 0.25 * (4e-3 + 9e-3 + 7e-3 + 20e-3)).abs() < 1e-15);
        assert!((m.distance(9.0, 9.0) - 20e-3).abs() < 1e-15);
        assert!((m.distance(0.2, 0.0) - 2e-4).abs() < 1e-15);
        assert!((m.sd(0.2, 0.1) - 2e-4).abs() < 1e-15);
    }

    #[test]
    fn unreachable_distance_has_no_sustain() {
        let m = model();
        assert_eq!(m.sustain_for(0.2, 1e-4), None);
        assert_eq!(m.sustain_for(0.2, 10e-3), None);
        assert_eq!(m.sustain_for(0.2, m.min_distance(0.2)), Some(0.01));
        assert_eq!(m.sustain_for(0.2, m.max_distance(0.2)), Some(0.2));
    }

    proptest! {
        #[test]
        fn sustain_inverts_distance(speed in 0.01..0.8f64, sustain in 0.01..0.2f64) {
            let m = model();
            let read = m.sustain_for(speed, m.distance(speed, sustain)).unwrap();
            prop_assert!((read - sustain).abs() < 1e-9);
        }
    }
}
